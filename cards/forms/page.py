"""The card as a page: one HTML file that asks nothing of the outside, reads on a phone and prints on A4."""

import base64
import hashlib
import re
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from importlib.resources import files
from typing import NamedTuple

from jinja2 import Environment, PackageLoader, StrictUndefined, Template
from markupsafe import Markup

from ...core.rounding import format_plain, format_rounded
from ...parameters import ParameterFile
from ..content.parts import Card, Profiler
from ..content.profiler import Value, inside, profile_all
from .typeset import anchor, data_block, doi, equation, interval, number, prose, spread
from .vector_figures import vector_figures

SPACES = re.compile(r"\s+")


class Point(NamedTuple):
    """A line of the table that stands in for the profiler: where, and what each law says there."""

    at: tuple[str, ...]
    values: tuple["Prediction", ...]
    removal: str


class Prediction(NamedTuple):
    """A prediction as text, and whether the point was tested."""

    value: str
    low: str
    high: str
    inside: bool


def page(card: Card, pf: ParameterFile | None = None, *, json_ld: str = "", beside: Sequence[str] = ()) -> str:
    """The page of a card: everything that it tells, in one HTML file.

    Parameters
    ----------
    card : Card
        What is told.
    pf : ParameterFile, optional
        Behind it, for the figures of laws, drive and loop; without it they are told in words alone.
    json_ld : str
        A JSON text for programs that read pages, put in as ``application/ld+json``.
    beside : sequence of str
        Files beside the page, where it stands in a site: it links to them, and back to the site.

    Returns
    -------
    str
        HTML5. It makes no request, and a policy in it forbids any; scripts and styles run by their checksums. The
        same card gives the same bytes.

    Examples
    --------
    >>> from fitmodels import parameters
    >>> from fitmodels.cards.content.compose import compose
    >>> text = page(compose(parameters.collect(tool="<b>", work="709M40")))
    >>> "&lt;b&gt; on 709M40</h1>" in text, "http-equiv" in text
    (True, True)
    """
    figures = vector_figures(card, pf)
    style = _asset("page.css") + _running_title(card.title)
    script = _asset("profiler.js")
    return _template().render(
        card=card,
        figures=figures,
        style=Markup(style),  # noqa: S704  our own, the title in it as a CSS string
        script=Markup(script),  # noqa: S704  our own
        style_hash=_checksum(style),
        script_hash=_checksum(script),
        profiler=None if card.profiler is None else data_block(card.profiler.model_dump_json()),
        points=[] if card.profiler is None else list(points(card.profiler)),
        json_ld=data_block(json_ld),
        beside=beside,
    )


def points(profiler: Profiler) -> Iterator[Point]:
    """Predictions at the start of the sliders, and with one of them at either end of its range."""
    yield _point(profiler, profiler.start)
    for factor in profiler.factors:
        for end in (factor.low, factor.high):
            if end.value is not None and end.value != profiler.start[factor.symbol]:
                yield _point(profiler, {**profiler.start, factor.symbol: end.value})


def _point(profiler: Profiler, at: Mapping[str, float]) -> Point:
    answers = profile_all(profiler, at)
    wears = {law.wear: answers[law.wear][0] for law in profiler.laws if law.wear}
    laws = {law.response: law for law in profiler.laws}
    known = {law.response: inside(law, {**at, **wears}) for law in profiler.laws}
    values = tuple(
        Prediction(*tell(answers[name]), known[name] and (not law.wear or known[law.wear]))
        for name, law in laws.items()
    )
    removal = f"{float(format_plain(1000 * at['V'] * at['f'] * at['d'], 4)):.12g}" if profiler.removal else ""
    return Point(tuple(format_plain(at[f.symbol], 4) for f in profiler.factors), values, removal)


def tell(answer: Value) -> tuple[str, str, str]:
    """A prediction to the digits that its band deserves, as the script of the page tells it.

    >>> tell((0.15213, 0.1231, 0.1884))
    ('0.152', '0.123', '0.188')
    >>> tell((0.15213, None, None))
    ('0.1521', '', '')
    """
    value, low, high = answer
    if low is None or high is None:
        return format_plain(value, 4), "", ""
    half = (high - low) / 2
    width = min(half, low) if low > 0 else half
    return format_rounded(value, width)[0], format_rounded(low, width)[0], format_rounded(high, width)[0]


def _running_title(title: str) -> str:
    """The title at the head of every printed page, as a CSS string that holds letters, digits and escapes alone."""
    said = SPACES.sub(" ", title)[:80]
    safe = "".join(c if c.isascii() and (c.isalnum() or c in " .,-()") else f"\\{ord(c):06x}" for c in said)
    return f'\n@page{{@top-left{{content:"{safe}"}}}}\n'


def _checksum(text: str) -> str:
    return base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


@lru_cache(maxsize=8)
def _asset(name: str) -> str:
    return files("fitmodels.cards").joinpath("templates", name).read_text("utf-8")


@lru_cache(maxsize=1)
def _template() -> Template:
    environment = Environment(
        loader=PackageLoader("fitmodels.cards"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters.update(
        n=number, interval=interval, spread=spread, equation=equation, prose=prose, doi=doi, anchor=anchor
    )
    return environment.get_template("page.html")
