"""Parts of a law section."""

from collections.abc import Mapping
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from ..messages import short
from .base import Count, NotNegative, Number, Positive, Section, Text, VerdictSection


class Factor(Section):
    """A factor of a law and the range of it in the data, ``low`` to ``high`` in ``unit``.

    Examples
    --------
    >>> Factor(symbol="V", quantity="cutting speed", unit="m/min", low=50.0, high=200.0).high
    200.0
    """

    symbol: Text
    quantity: str
    unit: str
    low: Number
    high: Number

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.low > self.high:
            raise ValueError(f"the range of {short(self.symbol)} has low {self.low:g} above high {self.high:g}")
        return self


class TermSection(Section):
    """A term of a law of second order: the name of its coefficient and the power of each centred factor in it.

    Examples
    --------
    >>> TermSection(name="V*f", powers={"V": 1, "f": 1}).powers["V"]
    1
    """

    name: Text
    powers: dict[str, Annotated[int, Field(strict=True, ge=1, le=2)]]


class LevelShifts(Section):
    """Levels of a column that share the exponents: times exp(shift), or plus the shift of a line.

    Examples
    --------
    >>> LevelShifts(column="material", reference="1", shifts={"2": 0.1}).names
    {'material[2]': '2'}
    """

    column: Text
    reference: str
    shifts: dict[str, Number]

    @property
    def names(self) -> Mapping[str, str]:
        """Parameter name of each shift -> its level."""
        return {f"{self.column}[{level}]": level for level in self.shifts}

    @model_validator(mode="after")
    def _reference_apart(self) -> Self:
        if self.reference in self.shifts:
            raise ValueError(f"the reference level {short(self.reference)} cannot have a shift")
        return self


class LeftOutFactor(Section):
    """A factor that was requested and is not in the law, with the reason.

    Examples
    --------
    >>> LeftOutFactor(factor="d", reason="the same in every row").factor
    'd'
    """

    factor: str
    reason: str


class DroppedRows(Section):
    """Rows of the data that the fit did not use; ``lines`` are the first of them in the data file.

    Examples
    --------
    >>> DroppedRows(reason="AW is empty", count=2).count
    2
    """

    reason: str
    count: Count
    lines: tuple[Count, ...] = ()


class Statistics(Section):
    """Statistics of the fit in the papers' letters, None where one is not available.

    Examples
    --------
    >>> Statistics(r2=0.98, F=120.0, F_df=(4, 20)).F_df
    (4, 20)
    """

    r2: Number | None = None
    r2_adj: Number | None = None
    F: Number | None = None
    F_df: tuple[Count, Count] | None = None
    F_p: Number | None = None


class Published(Section):
    """Published law for the same response, tool and work, and the deviation of the data from it.

    ``rms_percent`` and ``worst_percent`` are of ``100 (observed / printed law - 1)`` over the rows of the
    fit, None where the file lacks a factor of the printed law; ``worst_line`` is a line of the data file.

    Examples
    --------
    >>> Published(source="a paper, eq. 5", coefficients={"a": 0.24, "b": 0.0034}).rms_percent is None
    True
    """

    source: Text
    coefficients: dict[str, Number]
    standard_error: NotNegative | None = None
    rms_percent: NotNegative | None = None
    worst_percent: Number | None = None
    worst_line: Count | None = None


class TaylorSection(Section):
    """Taylor's ``V T^n = C``: n, and C in the unit of V at the middle ``at`` of the other factors, with intervals.

    An end is null where the interval is not bounded.

    Examples
    --------
    >>> TaylorSection(n=0.3, n_interval=[0.23, 0.42], C=410.0, C_interval=[340.0, None], unit="m/min").n
    0.3
    """

    n: Number
    n_interval: tuple[Number | None, Number | None] | None = None
    C: NotNegative
    C_interval: tuple[Number | None, Number | None] | None = None
    unit: str
    at: dict[str, Number] = Field(default_factory=dict)
    level: Positive = 0.95


class EdgeLifeSection(Section):
    """Life of an edge at the criterion, by its wear curve and by the wear law at its own level.

    ``reached`` states whether the curve crosses the criterion; otherwise ``curve`` is its last or first time.
    """

    edge: str
    reached: Literal["interpolated", "extrapolated", "before the first reading"]
    curve: NotNegative
    law: NotNegative


class WearCurveSection(Section):
    """Lives read from the wear curves of the edges, compared with the wear law, and the law of these lives.

    ``ratio`` is life by curve over life by law, ``expected`` the same where scatter alone makes it (simulated).
    """

    lives: tuple[EdgeLifeSection, ...] = ()
    ratio: Positive | None = None
    ratio_interval: tuple[Positive, Positive] | None = None
    expected: Positive | None = None
    words: tuple[str, ...] = ()
    coefficients: dict[str, Number] = Field(default_factory=dict)
    typical: NotNegative | None = None
    typical_interval: tuple[NotNegative, NotNegative] | None = None
    taylor: TaylorSection | None = None


class ToolLifeSection(Section):
    """Tool life ``T = c0 V^a f^b ...`` at a wear criterion, solved from the wear law.

    ``typical`` is T at ``typical_at``, the middle of each factor's range, and ``t_observed`` the longest
    time in the data: beyond it T is extrapolated; ``wear_observed`` is the largest
    wear, which earlier files lack. ``taylor`` holds Taylor's constants with intervals, ``curves`` the
    lives read from the wear curves of the edges; files before version 6 lack both. ``verdict`` states how far T can be
    used; files of versions 1 and 2 have none.

    Examples
    --------
    >>> ToolLifeSection(wear="AW", criterion=0.3, unit_of_wear="mm", unit="min", coefficients={"c0": 1e6, "V": -2.4},
    ...                 t_observed=20.0, typical=16.0, typical_at={"V": 100.0}).coefficients["V"]
    -2.4
    """

    wear: Text
    criterion: Positive
    unit_of_wear: str
    unit: str
    coefficients: dict[str, Number]
    standard_errors: dict[str, NotNegative] = Field(default_factory=dict)
    taylor_n: Number | None = None
    t_observed: NotNegative
    wear_observed: NotNegative | None = None
    typical: NotNegative
    typical_at: dict[str, Number]
    taylor: TaylorSection | None = None
    curves: WearCurveSection | None = None
    verdict: VerdictSection | None = None


class LifeSection(Section):
    """Distribution of tool lives about their law, whose value is the median life.

    ``scale`` is s of ``ln T``: the standard deviation of lognormal lives, the reciprocal shape of Weibull ones; it is
    corrected for the parameters of the law. ``ended`` lives ended, ``run_outs`` are longer and ``earlier`` shorter than
    their time in the data. ``with_scale`` holds the covariance of ln s with each parameter, ``longest`` the longest
    time in the data, ended or not, in the unit of the law; earlier files lack it.

    Examples
    --------
    >>> LifeSection(distribution="lognormal", scale=0.13, log_scale_sd=0.3, ended=9, run_outs=3).censored
    True
    """

    distribution: Literal["lognormal", "weibull"]
    scale: NotNegative
    log_scale_sd: NotNegative
    with_scale: dict[str, Number] = Field(default_factory=dict)
    ended: Count
    run_outs: Count = 0
    earlier: Count = 0
    log_likelihood: Number | None = None
    longest: NotNegative | None = None
    taylor: TaylorSection | None = None

    @property
    def censored(self) -> bool:
        """Whether some life is known by a bound alone."""
        return self.run_outs + self.earlier > 0


class Edges(Section):
    """Inference by cutting edge: variance between and within edges, and F of the factors that vary between edges.

    ``between`` names the factors that vary between edges; ``F`` on ``F_df`` is theirs by edge and ``row_F`` theirs
    with rows taken as independent; ``icc`` is the share of the variance between edges. ``random_level`` holds
    the standard errors with a random level of each edge, the cross-check of the jackknife. ``reason`` is set
    where inference by edge is not available.

    ``rows_per_edge`` (harmonic mean) and the degrees of freedom ``df_between`` and ``df_within`` give the precision
    of the two standard deviations; ``smearing_within`` is the mean of exp(residual) about each edge's own level, where
    errors are multiplicative. Earlier files lack these four.

    Examples
    --------
    >>> Edges(reason="no edge column").F is None
    True
    """

    reason: str | None = None
    between: tuple[str, ...] = ()
    F: Number | None = None
    F_df: tuple[Count, Count] | None = None
    F_p: Number | None = None
    row_F: Number | None = None
    sd_between: NotNegative | None = None
    sd_within: NotNegative | None = None
    icc: NotNegative | None = None
    rows_per_edge: Annotated[float, Field(strict=True, ge=1)] | None = None
    df_between: Annotated[int, Field(strict=True, ge=1, lt=2**63)] | None = None
    df_within: Annotated[int, Field(strict=True, ge=1, lt=2**63)] | None = None
    smearing_within: Positive | None = None
    random_level: dict[str, NotNegative] = Field(default_factory=dict)


class SuspectValues(Section):
    """Rows or whole edges whose values of one column are probably wrong.

    ``lines`` are those of the data file. Multiplied by ``factor``, or with ``offset`` added, the values agree with the
    others; ``correction`` is the argument of ``--correct`` that does it, empty where no known mistake explains them,
    and ``cause`` the mistake in words.

    Examples
    --------
    >>> SuspectValues(column="f", edges=["E07"], factor=25.4, correction="E07:f*25.4", cause="inch for mm").lines
    ()
    """

    column: Text
    edges: tuple[str, ...] = ()
    lines: tuple[Count, ...] = ()
    factor: Positive | None = None
    offset: Number | None = None
    correction: str = ""
    cause: str = ""


class LawCheck(Section):
    """One check of a law: null hypothesis, statistic, p and verdict in words, or the reason why it was not computed.

    ``symbol`` names the statistic, and is empty where the check has none; earlier files lack it. ``concern`` is 0 for
    no concern, 1 for a reservation, 2 where the law must not be used for control; ``suspects`` are the rows and edges
    that the check finds wrong.

    Examples
    --------
    >>> LawCheck(reason="no replicated edges: pure error unknown").verdict is None
    True
    """

    reason: str | None = None
    null: str | None = None
    symbol: str | None = None
    statistic: Number | None = None
    df: Count | tuple[Count, Count] | None = None
    p: Number | None = None
    concern: Count = 0
    verdict: str | None = None
    suspects: tuple[SuspectValues, ...] = ()


class LawWithoutSuspects(Section):
    """The law fitted again without the rows and edges that its checks find wrong, for comparison.

    Examples
    --------
    >>> LawWithoutSuspects(edges=["E07"], coefficients={"c0": 0.01, "V": 0.5}, n=230).coefficients["V"]
    0.5
    """

    edges: tuple[str, ...] = ()
    lines: tuple[Count, ...] = ()
    coefficients: dict[str, Number]
    standard_errors: dict[str, NotNegative] = Field(default_factory=dict)
    residual_se: NotNegative | None = None
    r2: Number | None = None
    n: Count
    n_edges: Count | None = None


class LeverageSpace(Section):
    """Columns of a law for which leverage is computed: their matrix, and the largest leverage of the design."""

    of: str
    columns: tuple[Count, ...]
    matrix: tuple[tuple[Number, ...], ...]
    largest: tuple[Number, ...]

    @model_validator(mode="after")
    def _square(self) -> Self:
        size = len(self.columns)
        if len(self.matrix) != size or any(len(row) != size for row in self.matrix):
            raise ValueError(f"the matrix of the leverage of {short(self.of)} must be {size} x {size}, as its columns")
        return self


class Region(Section):
    """Tested region of a design (operating window), by range, radius and leverage.

    The numbers are those that ``fitmodels.datasets.region`` evaluates.
    """

    logs: bool | tuple[bool, ...]
    centre: tuple[Number, ...]
    half_range: tuple[Positive, ...]
    largest_radius: NotNegative
    levels: tuple[str, ...] = ()
    spaces: tuple[LeverageSpace, ...] = ()

    @model_validator(mode="after")
    def _of_one_design(self) -> Self:
        size, levels = len(self.centre), max(1, len(self.levels))
        if len(self.half_range) != size or (not isinstance(self.logs, bool) and len(self.logs) != size):
            raise ValueError(f"the region has {size} centres, and another number of half ranges or scales")
        for space in self.spaces:
            if max(space.columns, default=0) >= size + levels or len(space.largest) != levels:
                raise ValueError(f"a leverage of the region needs columns below {size + levels}, {levels} limits")
        return self


class CompositeLaw(Section):
    """A law with its wear replaced by the wear law: the effect of the conditions alone.

    ``assumption`` states how the standard errors of the two laws were combined.
    """

    wear: str
    coefficients: dict[str, Number]
    standard_errors: dict[str, NotNegative] = Field(default_factory=dict)
    assumption: str
