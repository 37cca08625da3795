"""Content of a card, the same for print, browser and programs: every number with its text."""

from collections.abc import Iterable
from itertools import zip_longest
from textwrap import shorten

from pydantic import BaseModel, ConfigDict, Field

from ...core.display import HasRepr
from ...core.rounding import count
from ...core.verdict import DO_NOT_USE, MARKS, RESERVATIONS, USABLE, Mark

CHECKED = {"passed": USABLE, "warning": RESERVATIONS, "failed": DO_NOT_USE}  # verdict of a check -> level of its mark
BRIEF = 110  # characters of a reason in a list of verdicts


class Part(HasRepr, BaseModel):
    """A part of a card: frozen, nothing unknown, no NaN."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, defer_build=True)


class NumberPart(Part):
    """A number with its text: ``text`` is ``value`` rounded by its uncertainty, without its unit.

    Markdown and HTML show ``text``, and no number of their own. A share in per cent has its per cent as ``value``.
    """

    value: float | None = None  # None: there is none, and the text is empty or gives the reason
    text: str = ""
    unit: str = ""


class FactPart(Part):
    """A number under a name."""

    name: str
    number: NumberPart
    words: str = ""  # an explanation, if the name needs one


class SensorPart(Part):
    """A sensor: symbol, unit, model, sample rate and accuracy."""

    symbol: str
    unit: str
    model: str = ""
    words: str = ""


class IdentityPart(Part):
    """Tool, work, machine and set-up; an empty string is a missing fact."""

    tool: str
    work: str
    machine: str = ""
    iso513: str = ""
    setup: str = ""
    tool_properties: tuple[FactPart, ...] = ()  # ISO 13399 symbols
    sensors: tuple[SensorPart, ...] = ()
    simulated: bool | None  # None: not known
    note: str = ""
    content_sha256: str
    parameters_schema: str
    fitmodels: str


class PublicationPart(Part):
    """Authors, licence and so on, from ``card.toml``."""

    license: str = ""  # SPDX
    authors: tuple[str, ...] = ()
    contact: str = ""
    doi: str = ""
    title: str = ""
    keywords: tuple[str, ...] = ()


class FactorRangePart(Part):
    """A factor of the tests: its range, and its levels where there are few."""

    symbol: str
    quantity: str
    unit: str
    low: NumberPart
    high: NumberPart
    levels: tuple[NumberPart, ...] = ()


class DoubtPart(Part):
    """A doubt about the data: what was seen, the options that would correct the reading, and the whole command."""

    columns: tuple[str, ...]
    sentence: str
    remedy: str = ""
    command: str = ""


class RemedyPart(Part):
    """What to do about one reason of a verdict: a sentence, and the whole command where one does it."""

    words: str
    command: str = ""


class VerdictPart(Part):
    """How far one result of the card can be used.

    ``level`` is 0 usable inside the tested region, 1 usable with reservations, 2 do not use for control, and null where
    the result was not judged; ``words`` state it. Reasons are sentences, those against any use first; ``remedies`` has
    one for each of them, null where none is known.
    """

    of: str  # the response of a law, "tool life", "dynamics", "adaptive force"
    level: int | None
    words: str
    reasons: tuple[str, ...] = ()
    remedies: tuple[RemedyPart | None, ...] = ()
    checked: tuple[str, ...] = ()
    not_checked: tuple[str, ...] = ()  # each with its reason

    @property
    def mark(self) -> Mark:
        """Icon, colour and words of the level."""
        return MARKS[self.level]

    def without_remedy(self, suspects: "Iterable[SuspectPart]") -> tuple["SuspectPart", ...]:
        """Those suspects whose command is not that of a remedy."""
        commands = {remedy.command for remedy in self.remedies if remedy is not None}
        return tuple(suspect for suspect in suspects if suspect.command not in commands)

    @property
    def reservations(self) -> tuple[tuple[str, RemedyPart | None], ...]:
        """Each reason with its remedy, None where there is none."""
        return tuple(zip_longest(self.reasons, self.remedies[: len(self.reasons)]))

    @property
    def first(self) -> str:
        """The beginning of the first reason and the number of the others; empty where there is none."""
        if not self.reasons:
            return ""
        more = len(self.reasons) - 1
        rest = [f"{count(more, 'more reason')} below."] if more else []
        return " ".join([shorten(self.reasons[0], BRIEF, placeholder=" ..."), *rest])


class SuspectPart(Part):
    """Rows or edges that the checks find wrong, and the command that corrects them or fits without them."""

    column: str
    edges: tuple[str, ...] = ()
    lines: tuple[int, ...] = ()
    words: str
    remedy: str  # the option
    command: str  # the whole command


class DesignPart(Part):
    """The tests behind the laws."""

    factors: tuple[FactorRangePart, ...] = ()
    facts: tuple[FactPart, ...] = ()  # rows, edges, rows an edge, replicates, failed runs, wear criterion ...
    understood: tuple[str, ...] = ()  # how the data file was read, one sentence each


class CoefficientPart(Part):
    """A line of a law's table."""

    name: str
    estimate: NumberPart
    se: NumberPart
    t: NumberPart
    p: NumberPart
    low: NumberPart
    high: NumberPart
    row_se: NumberPart  # assuming independent rows, as published laws do
    other: NumberPart  # the fit with the other error structure
    printed: NumberPart  # as published
    without: NumberPart = NumberPart()  # the fit without the suspected rows and edges


class CheckPart(Part):
    """A check of a law: statistic, p value, verdict, and its sentence or the reason why it is not testable."""

    name: str
    statistic_name: str = ""
    statistic: NumberPart = NumberPart()
    p: NumberPart = NumberPart()
    verdict: str  # passed, warning, failed, not testable
    words: str = ""

    @property
    def mark(self) -> Mark:
        """Icon and colour of the verdict."""
        return MARKS[CHECKED.get(self.verdict)]


class DrawnParameterPart(Part):
    """A line of a posterior's table."""

    name: str
    median: NumberPart
    sd: NumberPart
    low: NumberPart
    high: NumberPart
    prior: str
    moved: str  # with priors of half and double width, in SD


class PosteriorPart(Part):
    """Posterior of a law; ``reason`` where there is none."""

    reason: str = ""
    method: str = ""
    priors: str = ""
    gate: tuple[FactPart, ...] = ()  # R-hat, effective draws, k-hat
    level: NumberPart = NumberPart()
    parameters: tuple[DrawnParameterPart, ...] = ()
    sentences: tuple[str, ...] = ()


class WorkedPart(Part):
    """A prediction for one new observation at the middle of the tests, and the command that makes it."""

    at: str  # ``V 100 m/min, f 0.19 mm/rev, t 6.32 min``
    wear: str = ""  # where a wear is a factor: ``AW 0.152 mm from its own law``, ``AW held at 0.158 mm``
    value: NumberPart
    low: NumberPart
    high: NumberPart
    level: NumberPart  # of the interval
    of: str  # one new observation on a new edge ...
    inside: bool  # in the tested region
    words: str  # the whole sentence
    command: str


class LawPart(Part):
    """One fitted equation."""

    response: str
    quantity: str
    unit: str
    short: str  # the equation rounded by its uncertainty
    equation: str  # to the digits one computes with
    scatter: FactPart | None = None  # of one row about the law: per cent, or in the unit
    worked: tuple[WorkedPart, ...] = ()  # of a law on a wear: with the wear from its own law, then with the wear held
    form: str
    structure: str  # error structure and method
    verdict: VerdictPart
    suspects: tuple[SuspectPart, ...] = ()
    without_words: str = ""  # the fit without the suspects
    level: NumberPart  # of the intervals
    statistics: tuple[FactPart, ...]  # R2, F, SE, n: assuming independent rows
    by_edge: tuple[FactPart, ...] = ()  # F by edge, ICC ...
    edge_words: str = ""
    coefficients: tuple[CoefficientPart, ...]
    other_heading: str = ""
    has_row_se: bool = False
    has_printed: bool = False
    has_without: bool = False
    domain: tuple[FactorRangePart, ...]
    checks: tuple[CheckPart, ...] = ()
    check_words: tuple[str, ...] = ()  # their number by result, and the reasons of those that are not testable
    cautions: tuple[str, ...] = ()
    printed_words: str = ""
    composite_words: str = ""
    posterior: PosteriorPart | None = None


class ToolLifePart(Part):
    """Tool life at a criterion: at the middle of the tests with its intervals, and as an equation."""

    verdict: VerdictPart
    criterion: str  # ``AW 0.3 mm``
    at: str  # ``V 100 m/min, f 0.19 mm/rev``
    typical: NumberPart
    level: NumberPart  # of the intervals, as their ends empty where there is none
    low: NumberPart  # of the law
    high: NumberPart
    edge_low: NumberPart  # of one new edge
    edge_high: NumberPart
    longest: NumberPart  # test
    extrapolated: bool  # beyond it
    command: str
    equation: str
    words: tuple[str, ...]


class DynamicsPart(Part):
    """The identified dynamics."""

    title: str
    verdict: VerdictPart
    equation: str
    coefficients: tuple[CoefficientPart, ...]
    facts: tuple[FactPart, ...] = ()  # band, sample time, held-out fit, gain at rest, delay ...
    sentences: tuple[str, ...] = ()


class WindowPart(Part):
    """The operation window and its best point, the settings of a controller, or the costs of a part."""

    title: str
    verdict: VerdictPart | None = None  # of estimates that a controller starts from
    facts: tuple[FactPart, ...] = ()
    sentences: tuple[str, ...] = ()


class FigurePart(Part):
    """A figure: name, caption, text alternative."""

    name: str
    caption: str
    alternative: str
    file: str = ""  # a picture in the folder of the card; empty: drawn inline in HTML


class ProvenancePart(Part):
    """Data, command, seed and versions that reproduce the file."""

    data_file: str = ""
    data_sha256: str = ""
    rows: int | None = None
    command: str = ""
    created: str = ""
    seed: int | None = None
    versions: dict[str, str] = Field(default_factory=dict)


class LeverageSpacePart(Part):
    """Columns of z = (1, coded factors) in which leverage z' M z is computed, and the largest of the design."""

    columns: tuple[int, ...]
    matrix: tuple[tuple[float, ...], ...]
    largest: float


class ProfiledRegionPart(Part):
    """The tested region; the profiler greys points outside.

    coded_i = (x_i - centre_i) / half_range_i, x_i = ln factor where its ``logs`` is true. Inside is
    |coded_i| <= 1 + rounding of every factor, sum coded_i^2 <= radius^2 (1 + slack), and z' M z <= largest (1 + slack)
    in every space.
    """

    logs: tuple[bool, ...]  # of each factor
    centre: tuple[float, ...]
    half_range: tuple[float, ...]
    radius: float
    spaces: tuple[LeverageSpacePart, ...]
    rounding: float
    slack: float


class ProfiledLawPart(Part):
    """All that the profiler needs to compute a response and its band.

    A factor enters as u = ln(factor / centre) where its ``logs`` is true, as u = factor - centre otherwise; z is 1 and
    a product of powers of u for each of the ``terms``. eta = sum(theta_i z_i), and the response is R = exp(eta) where
    ``logarithmic``, else R = eta; where ``added``, the last product is left out of eta and added to R.

    With the gradient g of R by theta (z times exp(eta), or z), the band for one new observation on a new edge is
    R exp(+- t sqrt(g' C g / R^2 + scatter^2)) for multiplicative errors, R +- t sqrt(g' C g + scatter^2) for additive.
    """

    response: str
    quantity: str
    unit: str
    form: str
    logarithmic: bool
    added: bool = False
    multiplies: bool
    factors: tuple[str, ...]
    logs: tuple[bool, ...]  # of each factor
    centres: tuple[float, ...]  # of each factor: 1 or 0 where the law has none
    terms: tuple[tuple[int, ...], ...]  # power of each factor, for each coefficient after the constant
    low: tuple[float, ...]  # tested range of each factor
    high: tuple[float, ...]
    region: ProfiledRegionPart | None = None  # None: the ranges alone
    by: str = ""  # the level shown, if the law has levels: ``material 1``
    theta: tuple[float, ...]
    covariance: tuple[tuple[float, ...], ...] = ()  # empty: no band
    scatter: float | None = None
    t: float | None = None  # quantile of the level
    wear: str = ""  # the factor substituted by the law of which it is the response


class ProfilerPart(Part):
    """Sliders and the laws they move."""

    factors: tuple[FactorRangePart, ...] = ()
    wears: tuple[FactorRangePart, ...] = ()  # that are held, where they are not taken from their own laws
    start: dict[str, float] = Field(default_factory=dict)  # of factors and wears
    laws: tuple[ProfiledLawPart, ...] = ()
    of: str = "one new observation"  # kind of the bands
    level: float = 0.95
    removal: bool = False  # MRR = 1000 V f d can be computed
