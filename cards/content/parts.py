"""Content of a card, the same for print, browser and programs: every number with its text."""

from textwrap import shorten

from pydantic import BaseModel, ConfigDict, Field

from ...core.display import HasRepr

BRIEF = 110  # characters of a reason in a list of verdicts


class Part(HasRepr, BaseModel):
    """A part of a card: frozen, nothing unknown, no NaN."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


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


class VerdictPart(Part):
    """How far one result of the card can be used.

    ``level`` is 0 usable inside the tested region, 1 usable with reservations, 2 do not use for control, and null where
    the result was not judged; ``words`` state it. Reasons are sentences, those against any use first.
    """

    of: str  # the response of a law, "tool life", "dynamics", "adaptive force"
    level: int | None
    words: str
    reasons: tuple[str, ...] = ()
    checked: tuple[str, ...] = ()
    not_checked: tuple[str, ...] = ()  # each with its reason

    @property
    def first(self) -> str:
        """The beginning of the first reason and the number of the others; empty where there is none."""
        if not self.reasons:
            return ""
        more = len(self.reasons) - 1
        rest = [f"{more} more reason{'s' if more > 1 else ''} below."] if more else []
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


class LawPart(Part):
    """One fitted equation."""

    response: str
    quantity: str
    unit: str
    equation: str  # to the digits one computes with
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
    """Tool life at a criterion."""

    verdict: VerdictPart
    equation: str
    words: tuple[str, ...]


class BudgetLinePart(Part):
    """A contribution to the uncertainty of a prediction."""

    name: str  # ``exponent of V``, ``between edges``, ``rows of one edge`` ...
    evaluation: str  # type A or B of the GUM
    standard: NumberPart  # standard uncertainty of the source; empty of correlations
    sensitivity: NumberPart  # change of the response by the source
    contribution: NumberPart  # in the unit of the response; negative where correlations lower the sum
    share: NumberPart  # of the combined variance, per cent
    df: NumberPart


class UncertaintyPart(Part):
    """One statement according to the GUM: value, u, expanded uncertainty U = k u, coverage factor and level.

    ``low`` and ``high`` are the same interval where it is asymmetric (multiplicative errors).
    """

    quantity: str
    symbol: str
    at: str  # where: ``V 100 m/min, f 0.19 mm/rev, t 10 min``
    of: str  # the fitted law, or one new observation on a new edge
    value: NumberPart
    standard: NumberPart  # u, and U of it: first order for multiplicative errors
    expanded: NumberPart
    k: NumberPart
    df: NumberPart  # of the t that k is a quantile of
    level: NumberPart
    low: NumberPart
    high: NumberPart
    words: str  # the whole statement
    budget: tuple[BudgetLinePart, ...] = ()  # of one new observation; the shares add up to 100 %
    budget_words: str = ""  # effective degrees of freedom and k, and what the budget does not contain


class DynamicsPart(Part):
    """The identified dynamics."""

    title: str
    verdict: VerdictPart
    equation: str
    coefficients: tuple[CoefficientPart, ...]
    facts: tuple[FactPart, ...] = ()  # band, sample time, held-out fit, gain at rest, delay ...
    sentences: tuple[str, ...] = ()


class GainsPart(Part):
    """The PI controller: gains with form and units, and its performance."""

    facts: tuple[FactPart, ...]  # Kp, Ki, Ti, sample time, form ...
    reached: tuple[FactPart, ...] = ()  # rise, settling, Ms, margins, probability
    asked: tuple[FactPart, ...] = ()
    sentences: tuple[str, ...] = ()


class WindowPart(Part):
    """The operation window and its best point, or the settings of a controller."""

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
    start: dict[str, float] = Field(default_factory=dict)
    laws: tuple[ProfiledLawPart, ...] = ()
    of: str = "one new observation"  # kind of the bands
    level: float = 0.95
    removal: bool = False  # MRR = 1000 V f d can be computed
