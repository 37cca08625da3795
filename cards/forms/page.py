"""The card as a page: one self-contained HTML file that makes no requests."""

import re
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple
from urllib.parse import quote

from markupsafe import Markup, escape

from ...core.rounding import format_plain, format_rounded
from ...parameters import ParameterFile
from ..content.card import Card
from ..content.parts import CoefficientPart, FactorRangePart, NumberPart, ProfilerPart
from ..content.profiler import Value, inside, profile_all
from .page_figures import vector_figures
from .rendering import asset, checksum, environment

if TYPE_CHECKING:
    from jinja2 import Template

SPACES = re.compile(r"\s+")
UNITS = "mm/rev|mm/min|m/min|1/min|min|mm|µm|um|kW|kN|Nm|N|Hz|ms|s|V|A|%"
WORTH = re.compile(
    r"(?P<doi>\b10\.\d{4,9}/[\w.;()/:-]*\w)"
    rf"|(?P<quantity>(?:\b\w{{1,3}} )?[-−+]?\d[\d.e+-]* (?:{UNITS})(?![\w/]))"
    r"|(?P<probability>\bp (?:[<=] ?)?\d?\.\d+(?:e-\d+)?)"
    r"|(?P<power_of_ten>[-−]?\d[\d.]*e-?\d+)"
    rf"|(?P<letters>\bU = k u\b|\b[uk] = \d[\d.e-]*(?: (?:{UNITS})(?![\w/]))?)"
)
LEVELS = " for "  # separates an equation from the level of the category that it is of
TOKEN = re.compile(r"(?P<number>\d+\.?\d*(?:e[+-]?\d+)?)|(?P<function>exp|ln)(?=\()|(?P<name>[^\W\d]\w*)")
POWER = re.compile(r"\^(-?[\d.]+(?:e[+-]?\d+)?)")
DOI = re.compile(r"(?:https?://(?:dx\.)?doi\.org/)?(10\.\d{4,9}/\S+)")
LONGEST = 24  # characters


class ProfiledPoint(NamedTuple):
    """A line of the table in place of the profiler: a point and the predictions there."""

    at: tuple[str, ...]
    values: tuple["ProfiledValue", ...]
    removal: str


class ProfiledValue(NamedTuple):
    """A prediction as text, and whether the point was tested."""

    value: str
    low: str
    high: str
    inside: bool


def page_html(card: Card, pf: ParameterFile | None = None, *, json_ld: str = "", neighbours: Sequence[str] = ()) -> str:
    """The page of a card: all its content in one HTML file.

    Parameters
    ----------
    card : Card
        The content.
    pf : ParameterFile, optional
        The source of the card, for figures of laws, dynamics and loop; without it there are only text alternatives.
    json_ld : str
        A JSON text for programs that read pages, put in as ``application/ld+json``.
    neighbours : sequence of str
        Files in the folder of the page, in a site: the page links to them and back to the site.

    Returns
    -------
    str
        HTML5. It makes no request, and a policy in it forbids any; scripts and styles run by their checksums. The
        same card gives the same bytes.

    Examples
    --------
    >>> from fitmodels import parameters
    >>> from fitmodels.cards.content.card import compose
    >>> text = page_html(compose(parameters.collect(tool="<b>", work="709M40")))
    >>> "&lt;b&gt; on 709M40</h1>" in text, "http-equiv" in text
    (True, True)
    """
    figures = vector_figures(card, pf)
    style = asset("page.css") + _running_title(card.title)
    script = asset("profiler.js")
    return _template().render(
        card=card,
        figures=figures,
        style=Markup(style),  # noqa: S704  our own, the title in it as a CSS string
        script=Markup(script),  # noqa: S704  our own
        style_hash=checksum(style),
        script_hash=checksum(script),
        profiler=None if card.profiler is None else data_block(card.profiler.model_dump_json()),
        points=[] if card.profiler is None else list(points(card.profiler)),
        json_ld=data_block(json_ld),
        neighbours=neighbours,
    )


def points(profiler: ProfilerPart) -> Iterator[ProfiledPoint]:
    """Predictions at the start of the sliders, and with one of them at either end of its range."""
    yield _point(profiler, profiler.start)
    for factor in profiler.factors:
        for end in (factor.low, factor.high):
            if end.value is not None and end.value != profiler.start[factor.symbol]:
                yield _point(profiler, {**profiler.start, factor.symbol: end.value})


def _point(profiler: ProfilerPart, at: Mapping[str, float]) -> ProfiledPoint:
    answers = profile_all(profiler, at)
    wears = {law.wear: answers[law.wear][0] for law in profiler.laws if law.wear}
    laws = {law.response: law for law in profiler.laws}
    known = {law.response: inside(law, {**at, **wears}) for law in profiler.laws}
    values = tuple(
        ProfiledValue(*value_texts(answers[name]), known[name] and (not law.wear or known[law.wear]))
        for name, law in laws.items()
    )
    settings = tuple(format_plain(at[f.symbol], 4) for f in profiler.factors)
    return ProfiledPoint(settings, values, _removal_rate(profiler, at))


def _removal_rate(profiler: ProfilerPart, at: Mapping[str, float]) -> str:
    """Material removal rate, mm3/min; empty where the settings do not give it."""
    return f"{float(format_plain(1000 * at['V'] * at['f'] * at['d'], 4)):.12g}" if profiler.removal else ""


def value_texts(answer: Value) -> tuple[str, str, str]:
    """A prediction to the digits that its band supports, as in the script of the page.

    >>> value_texts((0.15213, 0.1231, 0.1884))
    ('0.152', '0.123', '0.188')
    >>> value_texts((0.15213, None, None))
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


@lru_cache(maxsize=1)
def _template() -> "Template":
    return environment(
        autoescape=True, n=number, interval=interval, spread=spread, equation=equation, prose=prose, doi=doi,
        anchor=anchor,
    ).get_template("page.html")  # fmt: skip


def number(n: NumberPart) -> Markup:
    """A number with its unit, which no line break parts."""
    unit = Markup('\u00a0<span class="unit">{}</span>').format(n.unit) if n.unit and n.text else Markup()
    return Markup('<span class="number{}">{}{}</span>').format(_kept(n.text + n.unit), n.text, unit)


def interval(c: CoefficientPart) -> str:
    """Both ends, or nothing."""
    return f"{c.low.text} … {c.high.text}" if c.low.text else ""


def spread(f: FactorRangePart) -> Markup:
    """A factor's range: symbol, both ends, unit."""
    return Markup('<span class="number{}"><var>{}</var> {} to {}\u00a0<span class="unit">{}</span></span>').format(
        _kept(f.symbol + f.unit), f.symbol, f.low.text, f.high.text, f.unit
    )


def _kept(text: str) -> str:
    """Class of what no line break parts: not of a name longer than a line of a phone."""
    return " kept" if len(text) <= LONGEST else ""


def equation(text: str) -> Markup:
    """An equation typeset: names as variables, powers raised; what is read and copied is the text as it was.

    >>> print(equation("AW = 0.5 V^0.3"))
    <var>AW</var> = 0.5 <var>V</var><span class="hat">^</span><sup>0.3</sup>
    """
    text, separator, level = text.partition(LEVELS)
    out, at = [], 0
    for power in POWER.finditer(text):
        out += [_names(text[at : power.start()]), Markup('<span class="hat">^</span><sup>{}</sup>').format(power[1])]
        at = power.end()
    return Markup().join([*out, _names(text[at:]), escape(separator + level)])


def prose(text: str) -> Markup:
    """A sentence: numbers stay with their units, a p with its value, and a DOI is a link."""
    out, at = [], 0
    for found in WORTH.finditer(text):
        out.append(escape(text[at : found.start()]))
        out.append(doi(found[0]) if found["doi"] else Markup('<span class="kept">{}</span>').format(found[0]))
        at = found.end()
    return Markup().join([*out, escape(text[at:])])


def doi(text: str) -> Markup:
    """A DOI as a link to its resolver; anything else as it is."""
    found = DOI.fullmatch(text.strip())
    if found is None:
        return escape(text)
    address = f"https://doi.org/{quote(found[1], safe='/.:;()-_')}"
    return Markup('<a href="{}" rel="noopener noreferrer">{}</a>').format(address, text)


def anchor(index: int, prefix: str) -> str:
    """An id that holds no name from the file."""
    return f"{prefix}-{index}"


def data_block(text: str) -> Markup:
    """JSON for a script element: nothing in it can end the element or begin a comment."""
    for letter in "<>&\u2028\u2029":
        text = text.replace(letter, f"\\u{ord(letter):04x}")
    return Markup(text)  # noqa: S704


def _names(text: str) -> Markup:
    out, at = [], 0
    for token in TOKEN.finditer(text):
        if token["name"]:
            out += [escape(text[at : token.start()]), Markup("<var>{}</var>").format(token[0])]
            at = token.end()
    return Markup().join([*out, escape(text[at:])])
