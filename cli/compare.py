"""``fitmodels compare``: forms of each law beside each other, and the one that is to be kept written out."""

import argparse
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..datasets.options import without
from .arguments import MARK, ONE_TABLE, Parser, opened
from .corrections import corrected
from .options import forms, law_option, read_keywords, reading_options
from .output import Printer, complain, output_options, print_json

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.text import Text

    from ..datasets import Runs
    from ..fit.censored_lives import LeftOutLives
    from ..fit.form_comparison import FormComparison
    from ..fit.lawfit import LawFit

    Found = tuple[list[FormComparison], list[LeftOutLives], list[str]]  # laws, lives with bounds, why others are not
    Compared = tuple[Runs, list[FormComparison], list[LeftOutLives], list[str]]  # the same with its pair


def parser() -> Parser:
    """Arguments of ``fitmodels compare``."""
    p = Parser(
        "fitmodels compare",
        "fitmodels compare data.csv",
        "Compare forms of each law (power, exponential, linear, second order, ...) on the same rows: error of edges\n"
        "that the fit has not seen, weights, and predictions at the middle and at the corners of the tests. Nothing\n"
        "is written without --write, which fits the file with the chosen forms: parameter file, card and figures.",
        ONE_TABLE,
        main="--write --out --force --figure --quiet --json --law --by --map --unit",
    )
    p.add_argument("file", metavar="FILE", help="table of tests, as of fitmodels FILE; - reads standard input")
    chosen = 'write the result with this form of all laws, or of one, "Ra=linear" (default: nothing is written)'
    p.add_argument("--write", action="append", metavar="FORM", help=chosen)
    p.add_argument("--out", metavar="DIR", help="where --write writes (default: ./<file>-fit)")
    p.add_argument("--force", action="store_true", help="replace what an earlier run wrote there")
    p.add_argument(
        "--figure", metavar="FILE", help="draw each form over each factor: .png, .pdf or .svg (default: none)"
    )
    output_options(p, "print the comparison as JSON (fitmodels.compare/1)")
    reading_options(p)
    group = p.add_argument_group("fitting")
    law_option(group)
    errors = "errors of laws that are linear for the logarithm of the response (default: multiplicative)"
    group.add_argument("--error", choices=["multiplicative", "additive"], default="multiplicative", help=errors)
    group.add_argument(
        "--by", metavar="COLUMN", help="a category whose levels shift the laws, fitted together (default: none)"
    )
    return p


def run(args: argparse.Namespace) -> int:
    """Print the comparison, draw and write what was asked for, and return the exit code."""
    from ..core.errors import UsageError
    from ..pipeline import FitOptions
    from ..pipeline.reading import read_tests

    if args.write and args.file == MARK:
        raise UsageError("--write: standard input is read once only; give the name of the file.")
    if args.out and not args.write:
        raise UsageError("--out: only --write writes a result; name the form, for instance --write second-order.")
    laws = tuple(args.laws or ())
    _check_forms(args.write)
    options = FitOptions(**read_keywords(args), laws=laws, error=args.error, by=args.by, form=forms(args.write))
    figure = None if args.figure is None else _figure_path(args)
    with opened(args.file) as path:
        runs = read_tests(path, options)
    pairs = [runs] if args.by else list(runs.pairs())
    compared = [(pair, *_comparisons(pair, args)) for pair in pairs]
    if args.json:
        print_json("compare", {"pairs": [_facts(*one) for one in compared]})
    else:
        _show(runs, compared, args)
    if figure is not None:
        _draw([found for _, comparisons, *_ in compared for found in comparisons], figure, force=args.force)
        if not args.json:
            Printer(quiet=args.quiet).wrote(f"Figure: {figure}", figure)
    if args.write:
        return _write(args)
    return 0 if any(comparisons or lives for _, comparisons, lives, _ in compared) else 4


def _check_forms(words: "Sequence[str] | None") -> None:
    """Refuse a form that does not exist, by the option that named it."""
    from ..core.errors import UsageError
    from ..fit.form_choice import form_named

    for word in words or ():
        try:
            form_named(word.rpartition("=")[2])
        except UsageError as error:
            raise UsageError(f"--write {word}: {str(error).partition(': ')[2]}") from None


def _comparisons(runs: "Runs", args: argparse.Namespace) -> "Found":
    """Comparison of each law of a pair, and why others have none."""
    from ..core.errors import UsageError
    from ..core.progress import progress_bar
    from ..fit.available import NotAvailable, computed
    from ..fit.censored_lives import LeftOutLives, left_out_lives
    from ..fit.defaults import Held, fit_asked, requested_laws
    from ..fit.form_comparison import FormComparison
    from ..fit.left_out_edges import compare_laws

    found: list[FormComparison] = []
    lives: list[LeftOutLives] = []
    missing: list[str] = []
    with progress_bar(lines=False) as step:
        for asked in requested_laws(Held.of_runs(runs), args.laws or ()):
            step.say(f"comparing forms of {asked.response}")
            fits = (OSError, UsageError)
            one: LawFit | FormComparison | LeftOutLives | NotAvailable
            one = law = computed(partial(fit_asked, runs, asked, error=args.error, by=args.by), fits)
            if not isinstance(law, NotAvailable) and law.life is not None and law.life.censored:
                one = computed(partial(left_out_lives, law))
            elif not isinstance(law, NotAvailable):
                one = computed(partial(compare_laws, runs, law, factors=asked.factors), fits)
            if isinstance(one, NotAvailable):
                missing.append(f"{asked.response}: {one.reason.removeprefix(f'{asked.response}: ')}.")
            elif isinstance(one, LeftOutLives):
                lives.append(one)
            elif isinstance(one, FormComparison):
                found.append(one)
    return found, lives, missing


def _show(runs: "Runs", compared: "Sequence[Compared]", args: argparse.Namespace) -> None:
    from ..cards import terminal
    from ..cards.reading_terminal import reading_notes

    out = Printer(quiet=args.quiet)
    out.show(reading_notes(runs, partial(corrected, args.words)))
    for pair, comparisons, lives, missing in compared:
        out.show(terminal.pair_head(pair))
        for found in comparisons:
            out.show(terminal.forms_block(found))
        for scored in lives:
            out.show(_lives_text(scored))
        for words in missing:
            complain(f"not compared: {words}")
        if not (comparisons or lives or missing):
            complain(terminal.nothing_fitted(pair, ()))
    preferred = {found.response: found.preferred.name for _, each, *_ in compared for found in each
              if found.preferred.name != found.default}  # fmt: skip
    if not args.write and any(comparisons for _, comparisons, *_ in compared):
        out.show(terminal.keep_block(preferred, partial(_replacing, args.words)))


def _lives_text(found: "LeftOutLives") -> "Text":
    """Scores of laws of lives, of which some are run-outs."""
    from rich.text import Text

    unit = f"{found.left_out}{'' if len(found.scores) == 1 else 's'}"
    head = f"{found.response}: laws of lives with run-outs, scored on {len(found.scores)} left-out {unit}"
    words = "score: mean log likelihood of left-out lives (of a run-out, that of lasting longer); higher is better"
    return Text(f"{head}\n{found.verdict}\n\n{found.table.text()}\n{words}\n")


def _main_command(words: list[str], options: str) -> str:
    """The main command that reads the file in the same way, with more options."""
    return corrected(_kept(words), options)


def _replacing(words: list[str], options: str) -> str:
    """The main command with a form, which replaces the result with the usual one."""
    return _main_command(words, f"{options} --force")


def _kept(words: list[str]) -> list[str]:
    """The words of the command as typed that the main command takes as well."""
    return without(words[1:] if words[:1] == ["compare"] else words, "comparison")


def _write(args: argparse.Namespace) -> int:
    """Run the main job with the chosen forms."""
    from . import wear

    chosen = [word for form in args.write for word in ("--form", form)]
    words = [*(word for word in _kept(args.words) if word != "--json"), *chosen]
    options = wear.parser().parse_args(words)
    options.words = words
    return wear.run(options)


def _facts(
    runs: "Runs", comparisons: "list[FormComparison]", lives: "list[LeftOutLives]", missing: list[str]
) -> dict[str, Any]:
    """The comparison of a pair for programs."""
    laws = [_law_facts(one) for one in comparisons]
    return {
        "tool": runs.tool, "work": runs.work, "laws": laws, "lives": list(map(_life_facts, lives)), "missing": missing
    }  # fmt: skip


def _life_facts(found: "LeftOutLives") -> dict[str, Any]:
    """Scores of laws of lives with bounds."""
    forms = [
        {"form": name, "score": float(found.scores[:, j].mean()), "difference": mean, "standard_error": error}
        for j, name in enumerate(found.names)
        for mean, error in [found.against_first(j)]
    ]
    return {"response": found.response, "left_out": found.left_out, "units": len(found.scores), "forms": forms,
            "better": list(found.better), "verdict": found.verdict}  # fmt: skip


def _law_facts(found: "FormComparison") -> dict[str, Any]:
    from ..fit.available import NotAvailable

    forms = [
        {
            "form": form.name,
            "coefficients": form.parameters,
            "error_percent": _number(form.percent),
            "error": form.error_in_unit,
            "difference": _number(form.difference),
            "standard_error": form.standard_error,
            "p": form.pvalue,
            "aicc": None if isinstance(form.aicc, NotAvailable) else form.aicc,
            "weight": form.weight,
            "verdict": None if isinstance(form.verdict, NotAvailable) else form.verdict.words,
        }
        for form in found.forms
    ]
    points = [{name: _number(float(value)) for name, value in row.items()} for row in found.points.to_dict("records")]
    return {
        "response": found.response, "unit": found.unit, "factors": list(found.factors), "default": found.default,
        "preferred": found.preferred.name, "left_out": found.left_out, "units": found.units, "rows": found.rows,
        "verdict": found.verdict, "remarks": list(found.remarks), "forms": forms, "points": points,
        "not_fitted": {name: why.reason for name, why in found.not_fitted.items()},
    }  # fmt: skip


def _number(value: float) -> float | None:
    """A number that JSON has."""
    return value if abs(value) < float("inf") else None


def _figure_path(args: argparse.Namespace) -> Path:
    from ..core.errors import UsageError
    from ..core.journal import recover

    path = Path(args.figure)
    recover(path)
    if path.suffix.lower() not in (".png", ".pdf", ".svg"):
        raise UsageError(f"--figure {args.figure}: the picture is a file that ends in .png, .pdf or .svg.")
    if not path.parent.is_dir() or (path.exists() and not args.force):
        why = "exists; replace it with --force" if path.exists() else f"cannot be written: there is no {path.parent}"
        raise UsageError(f"--figure {path} {why}.")
    return path


def _draw(comparisons: "list[FormComparison]", path: Path, *, force: bool) -> None:
    from io import BytesIO

    from ..cards.figures import form_panels
    from ..core.files import write_whole
    from ..core.plotting import save_figure

    held = BytesIO()
    save_figure(form_panels(comparisons), held, format=path.suffix.lower()[1:], dpi=110)
    write_whole(path, held.getvalue(), force=force)
