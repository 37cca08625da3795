"""The model card: a parameter file in words, for a colleague to read."""

import html
import json
import re
from collections.abc import Sequence
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined

from ..parameters import ParameterFile
from .content.coefficients import lacking
from .dynamics_facts import model_rows, model_words, transfer_function_words
from .facts import (
    about_intervals,
    cautions,
    coefficient_rows,
    composite_words,
    edge_words,
    life_equation,
    life_words,
    other_words,
    published_words,
    statistics_line,
    structure_words,
)
from .posterior_facts import drawn_rows, posterior_of, posterior_words

# Characters that Markdown would read as its own, so that a name stays a name.
SPECIAL = re.compile(r"([\\`*_\[\]|~])")


def markdown(
    pf: ParameterFile, *, figures: bool = False, dynamics_figures: bool = False, data_lines: Sequence[str] = ()
) -> str:
    """The card of a parameter file, schema ``fitmodels.card/1``: Markdown with a YAML head.

    Parameters
    ----------
    pf : ParameterFile
    figures, dynamics_figures : bool
        Whether the figures of laws, or of dynamics, stand in ``figures/`` beside the card.
    data_lines : sequence of str
        What was understood of the data, a line each.
    """
    first = next(iter(pf.laws.values()), None)
    at = [f"{f.symbol}={_middle(f.low, f.high)}" for f in first.factors] if first else []
    if first and first.by:
        at.append(f"by={json.dumps(first.by.reference, ensure_ascii=False)}")
    example = ", ".join(at)
    return (
        _environment()
        .get_template("card.md")
        .render(
            pf=pf,
            about=about_intervals(pf),
            figures=figures,
            data_lines=data_lines,
            first=first,
            example=example,
            rows=coefficient_rows,
            statistics=statistics_line,
            structure=structure_words,
            other=other_words,
            cautions=cautions,
            composite=lambda law: [words] if (words := composite_words(law)) else [],
            edge_words=edge_words,
            dynamics_figures=dynamics_figures,
            transfer_function=transfer_function_words,
            model_rows=model_rows,
            model_words=model_words,
            posterior=lambda law: posterior_of(pf, law),
            drawn=drawn_rows,
            posterior_words=posterior_words,
            published=published_words,
            printed=lambda law: law.published is not None and not lacking(law),
            life_equation=life_equation(pf),
            life_words=life_words(pf),
        )
    )


def write_card(
    pf: ParameterFile,
    folder: Path,
    *,
    figures: bool = False,
    dynamics_figures: bool = False,
    data_lines: Sequence[str] = (),
) -> Path:
    """Write the card as ``README.md`` in ``folder`` and return its path."""
    path = folder / "README.md"
    path.write_text(
        markdown(pf, figures=figures, dynamics_figures=dynamics_figures, data_lines=data_lines),
        encoding="utf-8",
        newline="\n",
    )
    return path


def _environment() -> Environment:
    environment = Environment(  # noqa: S701  Markdown, not HTML: the filters below escape for it
        loader=PackageLoader("fitmodels.cards"),
        undefined=StrictUndefined,
        keep_trailing_newline=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(text=_text, code=_code, quoted=_quoted, text_line=_one_line, sentence=_sentence)
    return environment


def _text(value: object) -> str:
    """Text that Markdown and HTML leave alone, on one line."""
    return SPECIAL.sub(r"\\\1", html.escape(_one_line(value), quote=False))


def _quoted(value: object) -> str:
    """A YAML string that no reader takes for HTML, as one that does not know the head might."""
    return json.dumps(value).replace("<", "\\u003c").replace(">", "\\u003e")


def _code(value: object) -> str:
    return _one_line(value).replace("`", "'")


def _one_line(value: object) -> str:
    return " ".join(str(value).split())


def _sentence(value: str) -> str:
    return value[:1].upper() + value[1:]


def _middle(low: float, high: float) -> str:
    middle = (low * high) ** 0.5 if low > 0 else (low + high) / 2
    return f"{middle:.3g}"
