"""The card as a page: one self-contained HTML file that makes no requests."""

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, cast

from markupsafe import Markup

from ...core.display import Display, Displayable, TextTable
from ...core.errors import UsageError
from ...core.files import write_whole
from ...core.rounding import format_plain, format_rounded, join_words, with_unit
from ...core.suggestions import did_you_mean
from ...core.text import printable
from ...fit import LawFit
from ...parameters import ParameterFile, collect, read
from ..content.card import Card, compose
from ..content.numbers import ends_words, quantity
from ..content.parts import FactorRangePart, ProfilerPart
from ..content.profiler import Value, inside, profile, profile_all
from .page_figures import vector_figures
from .rendering import (
    anchor,
    asset,
    checksum,
    data_block,
    doi,
    environment,
    equation,
    interval,
    number,
    prose,
    spread,
)

if TYPE_CHECKING:
    from jinja2 import Template

SPACES = re.compile(r"\s+")
REACH = 1.2  # of a slider beyond the tested range, as in profiler.js
COUNTED = ("rows", "edges")  # facts on the tests at the head of a page


class ProfiledPoint(NamedTuple):
    """A line of the table in place of the profiler: a point and the predictions there."""

    at: tuple[str, ...]
    values: tuple["ProfiledValue", ...]
    held: tuple["ProfiledValue", ...]  # of laws on a wear, with the wear held at the middle of its range
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
    page = _template().render(
        **profiler_context(card),
        figures=figures,
        contents=_contents(card),
        style=Markup(style),  # noqa: S704  our own, the title in it as a CSS string
        script=Markup(script),  # noqa: S704  our own
        style_hash=checksum(style),
        script_hash=checksum(script),
        json_ld=data_block(json_ld),
        neighbours=neighbours,
    )
    return printable(page)


def profiler_context(card: Card) -> dict[str, object]:
    """Context of the template of the profiler: the card, its data, and predictions at a few points."""
    profiler = card.profiler
    return {
        "card": card,
        "profiler": None if profiler is None else data_block(profiler.model_dump_json()),
        "points": [] if profiler is None else list(points(profiler)),
    }


def _contents(card: Card) -> list[tuple[str, str, bool]]:
    """Anchor and heading of each section, and whether the card has it."""
    laws = bool(card.laws)
    return [
        ("results", "Results and verdicts", bool(card.verdicts)),
        ("predicts", "Predictions", laws),
        ("profiler", "Profiler", laws),
        ("laws", "Laws and checks", laws),
        ("tool-life", "Tool life", card.tool_life is not None),
        ("window", "Window and settings", bool(card.windows)),
        ("plan", "Plan of an edge", card.plan is not None),
        ("costs", "Costs", card.costs is not None),
        ("dynamics", "Dynamics", card.dynamics is not None),
        ("gains", "Gains", card.gains is not None),
        ("uncertainty", "Uncertainty", bool(card.uncertainty)),
        ("design", "Design and data", card.design is not None),
        ("use", "Use and limits", True),
        ("safety", "Safety", True),
        ("provenance", "For publishers", True),
    ]


WIDGET_STYLE = """
body { max-width: 60rem; padding: .5rem 1rem; }
h1 { font-size: 1.1rem; }
.simulated { font-size: .875rem; padding: .3rem .8rem; }
.simulated strong { font-size: 1em; display: inline; }
"""


@dataclass(frozen=True, slots=True, repr=False)
class Profiler(Displayable):
    """The profiler of a card for a notebook: a slider for each factor, and each prediction with its interval.

    In a notebook it is a page of its own in a frame, with the script of the card: it needs neither a network nor a
    running kernel. Viewers without scripts show the table of `summary`.

    Attributes
    ----------
    card : Card
    """

    card: Card

    @property
    def page(self) -> str:
        """The page in the frame: one HTML file that makes no requests."""
        style, script = asset("page.css") + WIDGET_STYLE, asset("profiler.js")
        page = _template("widget.html").render(
            **profiler_context(self.card),
            style=Markup(style),  # noqa: S704  our own
            script=Markup(script),  # noqa: S704  our own
            style_hash=checksum(style),
            script_hash=checksum(script),
        )
        return printable(page)

    def write(self, path: str | os.PathLike[str]) -> Path:
        """Write the page to a file and return its path."""
        write_whole(path, self.page)
        return Path(path)

    def _display(self) -> Display:
        part = cast(ProfilerPart, self.card.profiler)
        rows = tuple((*point.at, *map(_cell, point.values)) for point in points(part))
        head = tuple(with_unit(one.symbol, one.unit) for one in part.factors)
        held = tuple(with_unit(law.response, law.unit) for law in part.laws)
        verdicts = tuple(f"{one.of}: {one.mark.icon} {one.words}" for one in self.card.verdicts)
        title = f"{self.card.title}{', simulated, not measured' if self.card.identity.simulated else ''}"
        interval = f"Each with the {100 * part.level:g} % interval of {part.of}."
        return Display(title, table=TextTable((*head, *held), rows), sentences=(*verdicts, interval))

    def _repr_mimebundle_(self, **_: object) -> dict[str, str]:
        """The frame as HTML, and the table as text for viewers that show no HTML."""
        return {"text/html": self._repr_html_(), "text/plain": self.summary()}

    def _repr_html_(self) -> str:
        part = cast(ProfilerPart, self.card.profiler)
        height = 270 + 92 * max(len(part.factors), len(part.laws)) + 70 * bool(part.wears)
        height += 40 * bool(self.card.identity.simulated)
        frame = Markup(
            '<iframe srcdoc="{}" sandbox="allow-scripts" title="{}" width="100%" height="{}" '
            'style="border: 1px solid #8888; max-width: 62rem"></iframe>'
        ).format(self.page, f"Profiler of {self.card.title}", height)
        table = Displayable._repr_html_(self)
        return f"{frame}<details><summary>The same as a table, for viewers without scripts</summary>{table}</details>"


def profiler(source: Any, at: Mapping[str, float] | None = None) -> Profiler:  # noqa: ANN401
    """The interactive profiler of laws, for a notebook.

    Parameters
    ----------
    source : ParameterFile, path, Analysis, LawFit or sequence of LawFit
        What holds the laws; a path is that of a params.json.
    at : mapping of str to float, optional
        Where the sliders begin, in the units of the laws; in the middle of the tested ranges otherwise.

    Raises
    ------
    UsageError
        The source holds no law, or ``at`` names no factor or a value that the slider does not reach.

    Examples
    --------
    >>> from fitmodels import cards, datasets, fit
    >>> runs = datasets.read_runs(datasets.bundled("ac2017_table1"))
    >>> cards.profiler(fit.power_law(runs, "AW", ["V", "f"]))
    Profiler: GC435 on 709M40 (En 19), simulated, not measured
    """
    card = compose(_file_of(source))
    if card.profiler is None:
        raise UsageError(f"{card.title}: the parameter file holds no law; a profiler needs one.")
    start = dict(card.profiler.start)
    sliders = {one.symbol: one for one in (*card.profiler.factors, *card.profiler.wears)}
    for name, value in (at or {}).items():
        if name not in sliders:
            raise UsageError(f"at: {name!r} is no slider. {did_you_mean(name, sliders, names='There are ')}")
        start[name] = _within_reach(sliders[name], value)
    return Profiler(card.model_copy(update={"profiler": card.profiler.model_copy(update={"start": start})}))


def _within_reach(f: FactorRangePart, value: float) -> float:
    """A value on the slider of a factor, which ends a fifth beyond the tested range."""
    low, high = f.low.value or 0.0, f.high.value or 0.0
    ends = (
        (low / REACH, high * REACH)
        if low > 0
        else (low - (REACH - 1) * (high - low), high + (REACH - 1) * (high - low))
    )
    if isinstance(value, int | float) and ends[0] * (1 - 1e-9) <= value <= ends[1] * (1 + 1e-9):
        return float(value)
    tested = f"{f.low.text} to {f.high.text} {f.unit}".rstrip()
    raise UsageError(f"at: {f.symbol} {value!r} is not on its slider; tested {tested}, the slider ends a fifth beyond.")


def _file_of(source: Any) -> ParameterFile:  # noqa: ANN401
    """The parameter file of what holds laws."""
    if isinstance(source, ParameterFile):
        return source
    if isinstance(source, str | os.PathLike):
        return read(source)
    if isinstance(held := getattr(source, "parameters", None), ParameterFile):  # of an analysis
        return held
    laws: list[Any] = [getattr(one, "law", one) for one in (source if isinstance(source, list | tuple) else [source])]
    if not laws or not all(isinstance(law, LawFit) for law in laws):
        raise UsageError(
            f"{type(source).__name__}: no source of a profiler; give a law, a list of laws, an analysis, a parameter "
            "file or the path of a params.json."
        )
    first = laws[0].source
    return collect(laws=laws, tool=first.tool or "tool not stated", work=first.work or "work not stated")


def _cell(value: ProfiledValue) -> str:
    """A prediction with its interval, and a note where it was not tested."""
    band = f" ({value.low} to {value.high})" if value.low else ""
    return f"{value.value}{band}{'' if value.inside else ', not tested'}"


def data_words(card: Card) -> str:
    """Whether the data were measured, and how many rows and edges there are.

    >>> from fitmodels import parameters
    >>> from fitmodels.cards.content.card import compose
    >>> data_words(compose(parameters.collect(tool="GC435", work="709M40")))
    'measured'
    """
    kind = {True: "simulated", False: "measured", None: "not known whether measured"}[card.identity.simulated]
    facts = () if card.design is None else card.design.facts
    counts = [f"{item.number.text} {item.name}" for item in facts if item.name in COUNTED and item.number.text]
    return ", ".join([kind, *counts])


def legend(card: Card) -> list[str]:
    """Legend of the brackets after the worked predictions and of the scatter, each once for all laws."""
    brackets: dict[str, list[str]] = {}
    scatters: dict[str, list[str]] = {}
    for law in card.laws:
        for one in law.worked[:1]:
            words = f"{quantity(one.level)} prediction interval for {one.of}"
            brackets.setdefault(words, []).append(law.response)
        if law.scatter is not None:
            scatters.setdefault(law.scatter.words, []).append(law.response)
    sentences = [_each(name, found) for name, found in (("In brackets", brackets), ("Scatter", scatters)) if found]
    on_wear = [law.response for law in card.laws if len(law.worked) > 1]
    if on_wear:
        sentences.append(f"{join_words(on_wear)} at two wears; each interval is that at the wear shown.")
    return sentences


def _each(name: str, found: Mapping[str, Sequence[str]]) -> str:
    """A sentence on what a number is; where it differs between laws, of which."""
    if len(found) == 1:
        return f"{name}: {next(iter(found))}."
    return f"{name}: {'; '.join(f'of {join_words(list(laws))} {words}' for words, laws in found.items())}."


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
    known = {law.response: inside(law, {**at, **wears}) for law in profiler.laws}
    values = tuple(
        ProfiledValue(*value_texts(answers[law.response]), known[law.response] and known.get(law.wear, True))
        for law in profiler.laws
    )
    held = tuple(ProfiledValue(*value_texts(profile(law, at)), inside(law, at)) for law in profiler.laws if law.wear)
    settings = tuple(format_plain(at[f.symbol], 4) for f in profiler.factors)
    return ProfiledPoint(settings, values, held, _removal_rate(profiler, at))


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
    name = SPACES.sub(" ", title)[:80]
    safe = "".join(c if c.isascii() and (c.isalnum() or c in " .,-()") else f"\\{ord(c):06x}" for c in name)
    return f'\n@page{{@top-left{{content:"{safe}"}}}}\n'


@lru_cache(maxsize=2)
def _template(name: str = "page.html") -> "Template":
    return environment(
        autoescape=True, n=number, interval=interval, spread=spread, equation=equation, prose=prose, doi=doi,
        anchor=anchor, data_words=data_words, legend=legend, ends=ends_words,
    ).get_template(name)  # fmt: skip
