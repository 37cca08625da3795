"""Whether a law serves its use: explained variance and predictive error, readings, edges, doubts of the reading."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ...core.arrays import Array
from ...core.rounding import count, format_decimal
from ...core.verdict import DO_NOT_USE
from ...datasets import Runs
from ...datasets.doubts import Doubt
from ...datasets.edges.columns import meant_by
from ...datasets.vocabulary import ROLES, WEAR
from ..available import NotAvailable
from ..edges import EdgeInference
from ..lawfit import LawFit
from .check import TITLES, Check
from .strata import has_repeated_edges, no_scatter, rows_in

LEAST_R2, LOW_R2 = 0.1, 0.3  # below which a law is not used, or used with reservations
WIDE, VERY_WIDE = 2.0, 4.0  # factor within which 95 % of results lie
NORMAL_95 = 1.96
FEW_EDGES = 5
MOST_DOUBTS = 3  # quoted
FEWEST_LEFT = 3  # degrees of freedom below which a standard deviation is hardly known


def predictive_use(law: LawFit, runs: Runs | None = None) -> Check | NotAvailable:
    """R2 of a law, and the factor within which its results lie, against what control needs.

    A response that was computed from a measured one and factors of the law (P = Fc V/60000) is judged by the R2 of the
    measured one: its trend with these factors follows from the equation alone.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> predictive_use(law).verdict
    'R2 0.893: the law explains 89.3 % of the variance; 95 % of results lie within a factor of 1.21 of it.'
    """
    if law.df_resid < 1:
        return _exactly_determined(law)
    source, values = measured_of(law, runs)
    if source and np.ptp(values) == 0:
        return _of_a_constant(law, source, float(values[0]))
    if reason := no_scatter(law):
        return NotAvailable(reason)
    r2 = law.rsquared
    if source:
        of_source = 1 - law.rss / float(np.sum((np.log(values) - np.log(values).mean()) ** 2))
        r2, source = (of_source, source) if of_source < r2 else (r2, "")
    factor, within = _scatter(law)
    concern = max(_level(r2, LOW_R2, LEAST_R2), _level(-factor, -WIDE, -VERY_WIDE))
    ends = (".", ": allow for it.", ": too much for control.")
    end = ends[concern]
    if r2 < LOW_R2:
        end = f". The mean {source or law.response} predicts {'about' if r2 < LEAST_R2 else 'nearly'} as well."
    few = _hardly_determined(law)
    of = f" of {source}, from which {law.response} is computed" if source else ""
    explained = f"R2 {r2:.3g}: the law explains {100 * r2:.3g} % of the variance{of}; 95 % of results lie {within}"
    return Check(
        null=f"the law explains at least {100 * LOW_R2:g} % of the variance and predicts within a factor of {WIDE:g}",
        statistic=r2,
        symbol="R2",
        concern=max(concern, int(bool(few))),
        verdict=few + explained + end,
    )


def limited_readings(law: LawFit, runs: Runs | None) -> Check | None:
    """The finding that a response was read in large steps, or no lower than a floor; None where it was not.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    >>> limited_readings(fit.power_law(runs, "AW", ["V", "f", "d", "t"]), runs) is None
    True
    """
    if law.rows is None or law.life is not None:
        return None
    return _steps(law) or (_floor(law) or _below_floor(law, runs) if law.response in WEAR else None)


def _steps(law: LawFit) -> Check | None:
    """The finding that a response was read in steps that are large relative to it; None where it was not."""
    values = np.unique(law.observed)
    if not 1 < len(values) <= MOST_STEPS or law.nobs < FEWEST_READINGS * len(values):
        return None
    step, middle = float(np.diff(values).min()), float(np.median(law.observed))
    least = COARSE if len(values) <= FEW_STEPS else 2 * COARSE
    if step < least * middle or np.abs((places := (values - values[0]) / step) - np.round(places)).max() > ROUNDED:
        return None
    shown = f"{_shown(values)} {law.units.get(law.response, '')}".rstrip()
    return Check(
        null=NULL_OF_READINGS,
        concern=1 + int(law.exact or step > LARGE_STEP * middle),
        verdict=(
            f"{law.response} has only {len(values)} different values ({shown}) in {law.nobs} "
            f"rows, in steps of {100 * step / middle:.2g} % of the median: read it finer; errors and intervals do not "
            "contain the step."
        ),
    )


def _shown(values: Array) -> str:
    """The values, of many the ends."""
    few = len(values) <= FEW_STEPS
    return (", " if few else " to ").join(f"{value:.4g}" for value in (values if few else values[[0, -1]]))


def _floor(law: LawFit) -> Check | None:
    """The finding that the smallest wear repeats, as where a microscope reads no less; None where it does not."""
    values, counts = np.unique(law.observed, return_counts=True)
    n, least = law.nobs, int(counts[0])
    if least < max(FEWEST_AT_FLOOR, AT_FLOOR * n) or max(counts[1:].max(initial=0), 1) > least / 3:
        return None
    if len(values) - 1 < (n - least) / 2:  # readings are coarse, and ties are no sign of a floor
        return None
    size = f"{values[0]:.4g} {law.units.get(law.response, '')}".rstrip()
    return _of_floor(
        law, f"{least} of {n} readings of {law.response} are {size}, the smallest", "the wear is smaller then"
    )


def _below_floor(law: LawFit, runs: Runs | None) -> Check | None:
    """The finding that wear after t = 0 was read as zero, or below a mark, and is not in the law; None otherwise."""
    if runs is None or not runs.has("t"):
        return None
    marks = runs.data.get(f"{law.response} mark")
    marked = np.zeros(len(runs), dtype=bool) if marks is None else marks.astype(str).str.startswith("<").to_numpy()
    below = int(((runs.values("t") > 0) & ((runs.values(law.response) == 0) | marked)).sum())
    if below < max(FEWEST_AT_FLOOR, AT_FLOOR * (law.nobs + below)):
        return None
    size = f"{law.observed.min():.4g} {law.units.get(law.response, '')}".rstrip()
    what = f"{below} of {law.nobs + below} readings of {law.response} after t = 0 are zero or below a limit"
    return _of_floor(law, f"{what}, the others {size} or more", "the small wear is missing in the law")


def _of_floor(law: LawFit, readings: str, so: str) -> Check:
    """The concern about readings at a floor, or below it."""
    verdict = (
        f"{readings}: probably the floor of the instrument, and {so}: exponents, that of t first, are biased. Measure "
        f"finer, or use rows of larger {law.response} alone."
    )
    return Check(null=NULL_OF_READINGS, concern=1, verdict=verdict)


def _exactly_determined(law: LawFit) -> Check:
    """The refusal of a law of as many rows as parameters: whatever the rows, it passes through them."""
    return Check(
        null="the rows leave degrees of freedom from which an error of the law can be estimated",
        concern=2,
        verdict=(
            f"No degrees of freedom are left: {law.nobs} rows fix {len(law.theta)} parameters exactly, so the error of "
            f"the law is unknown and nothing was checked. Measure at least {FEWEST_LEFT} more."
        ),
    )


def _hardly_determined(law: LawFit) -> str:
    """The sentence on a law of hardly more rows than parameters, empty where its error is known."""
    left = int(law.df_resid)
    if left >= FEWEST_LEFT:
        return ""
    return (
        f"Only {count(left, 'degree')} of freedom {'are' if left > 1 else 'is'} left ({law.nobs} rows, "
        f"{len(law.theta)} parameters), so that the error of the law is hardly known: measure at least "
        f"{FEWEST_LEFT - left} more. "
    )


def measured_of(law: LawFit, runs: Runs | None) -> tuple[str, Array]:
    """The quantity that a response was computed from with factors of the law alone, and its values; "" where none."""
    none = "", np.empty(0)
    rule = None if runs is None else next((one for one in runs.derived if one.role == law.response), None)
    if runs is None or rule is None or law.rows is None or law.form != "power" or not law.formula.logarithmic:
        return none
    sources = [role for role in rule.inputs if role not in law.factors]
    rows = rows_in(law, runs)
    if len(sources) != 1 or len(rule.inputs) < 2 or sources[0] not in runs.data or rows is None:
        return none
    values = runs.values(sources[0])[rows]
    return (sources[0], values) if bool(np.all(values > 0)) else none


def _of_a_constant(law: LawFit, source: str, value: float) -> Check:
    """The refusal of a law of a response that was computed from a constant: it repeats the equation."""
    return Check(
        null="the quantity that the response was computed from varies",
        concern=2,
        verdict=(
            f"{law.response} is computed from {source}, which is {value:.4g} in all rows: the law repeats the equation "
            f"and nothing was measured. Check column {source}."
        ),
    )


def _level(value: float, doubted: float, refused: float) -> int:
    """0 from ``doubted`` up, 1 below it, 2 below ``refused``."""
    return int(value < doubted) + int(value < refused)


def _scatter(law: LawFit) -> tuple[float, str]:
    """Factor within which 95 % of results lie, and the words for it."""
    error = NORMAL_95 * float(np.sqrt(law.rss / law.df_resid))
    if law.error == "multiplicative":
        factor = float(np.exp(min(error, 50.0)))
        return factor, f"within a factor of {factor:.3g} of it"
    share = error / float(np.abs(law.observed).mean())
    return (
        1 + share,
        f"within {error:.3g} {law.scale_unit} of it, {format_decimal(float(f'{100 * share:.2g}'))} % of the mean",
    )


NULL_OF_READINGS = "the response is read in steps that are small relative to it, and has no floor"
FEW_STEPS, MOST_STEPS = 5, 15  # different values of a coarse response; above the first its steps must be larger
FEWEST_READINGS = 3  # rows for each value
FEWEST_AT_FLOOR, AT_FLOOR = 5, 0.1  # readings at the floor of an instrument, and their share
LARGE_STEP = 0.5  # share of the median from which a law of such readings is not to be used
COARSE, ROUNDED = 0.1, 1e-6  # step as a share of the median; distance of a value from a step, in steps
CLOCKS = ("t", "lf", "lc")
SET = ("condition", "other")  # kinds of quantities that are set, not measured
# Least share of different settings among rows that are runs of their own; wear repeats a setting along its edge.
SETTINGS_OF_RUNS, SETTINGS_OF_WEAR = 0.5, 1.0


def number_of_edges(law: LawFit, runs: Runs | None = None) -> Check:
    """Whether the edges of a law are named, and enough of them for inference by edge.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> number_of_edges(fit.power_law(datasets.read_runs(datasets.bundled("surf_table1")), "F", ["f"])).verdict[:36]
    'No edge is named: rows of an edge ar'
    """
    null = f"rows are of at least {FEW_EDGES} named edges, or each is a run of its own"
    if each_row_a_run(law, runs):
        words = "Each row is taken as an independent run: the file has no time in cut, and names no edges."
        return Check(null=null, statistic=0.0, symbol="edges", verdict=words)
    few = _few_edges(law, runs)
    return Check(
        null=null,
        statistic=float(law.n_edges or 0),
        symbol="edges",
        concern=int(bool(few)),
        verdict=few or f"The rows are of {law.n_edges} named edges.",
    )


def _has_edges_or_time(law: LawFit, runs: Runs) -> bool:
    return law.rows is None or law.n_edges is not None or any(map(runs.has, CLOCKS))


def each_row_a_run(law: LawFit, runs: Runs | None) -> bool:
    """Whether rows without edges are runs of their own: no time or length of cut, and settings that hardly repeat."""
    if runs is None or _has_edges_or_time(law, runs):
        return False
    if tools_of_rows(runs):
        return False
    were_set = [law.X[:, j] for j, name in enumerate(law.factors) if name not in ROLES or ROLES[name].kind in SET]
    were_set += _set_but_left_out(law, runs)
    settings = len(np.unique(np.column_stack(were_set), axis=0)) if were_set else 0
    return settings >= (SETTINGS_OF_WEAR if law.response in WEAR else SETTINGS_OF_RUNS) * law.nobs


def tools_of_rows(runs: Runs) -> str:
    """Name of an unused column that numbers tools or edges and has each of them in several rows; empty without one."""
    unused = [use.name for use in runs.columns if use.role is None and use.name in runs.data]
    numbering = [name for name in unused if meant_by(name) in ("edge", "tool")]
    repeated = (name for name in numbering if 1 < runs.data[name].nunique() <= len(runs) / 2)
    return next(repeated, "")


def _set_but_left_out(law: LawFit, runs: Runs) -> list[Array]:
    """Settings at the rows of the law that it has no term of, such as a factor that the selection of terms left out."""
    names = [out.factor for out in law.left_out if out.factor in runs.data and out.factor in ROLES]
    if not np.isin(law.lines, runs.lines).all():
        return []
    order = np.argsort(runs.lines)
    at = order[np.searchsorted(runs.lines, law.lines, sorter=order)]
    return [runs.values(name)[at] for name in names if ROLES[name].kind in SET]


def _few_edges(law: LawFit, runs: Runs | None) -> str:
    """Limit of inference by edge, empty where there is none."""
    n = law.n_edges
    tools = "" if runs is None or n is not None else tools_of_rows(runs)
    if runs is not None and tools:
        number = runs.data[tools].nunique()
        return (
            f"Column {tools} has {number} values in {len(runs)} rows: rows of one tool are not independent, so that "
            f"intervals may be too narrow; name its edges with --edge {tools}."
        )
    if n is None:
        return (
            "No edge is named: rows of an edge are not independent, so that intervals may be too narrow; name the "
            "edges with --edge."
        )
    if n < FEW_EDGES:
        edges = "1 edge" if n == 1 else f"{n} edges"
        return f"Only {edges}: the variance between edges is hardly known; test at least {FEW_EDGES}."
    if runs is not None and _has_no_edge_column(runs):
        return (
            f"The file names no edges; {n} were found from the order of its rows, and intervals depend on that: name "
            "the edges in a column."
        )
    if has_repeated_edges(law) and not isinstance(law.edges, EdgeInference):
        return f"No inference by edge ({law.edges.reason}): intervals may be too narrow."
    return ""


def _has_no_edge_column(runs: Runs) -> bool:
    return bool(runs.columns) and all(use.role != "edge" for use in runs.columns)


def doubts_of_reading(law: LawFit, runs: Runs | None) -> Check | NotAvailable | None:
    """Doubts of the reading on columns of the law, or on columns that one of them was computed from.

    None where the runs are not known. A doubt that states how to correct rows has found values that are wrong.
    """
    if runs is None:
        return None
    if not runs.judged:
        return NotAvailable("the values were not judged when they were read")
    doubts = _doubts_on(law, runs)
    words = [doubt.sentence.rstrip(".") for doubt in doubts[:MOST_DOUBTS]]
    words += [f"and {len(doubts) - MOST_DOUBTS} more"] if len(doubts) > MOST_DOUBTS else []
    return Check(
        null="the reading has no doubt on a column of the law",
        statistic=float(len(doubts)),
        symbol="doubts",
        concern=max((1 + int(doubt.unsettled or "--correct" in doubt.remedy) for doubt in doubts), default=0),
        verdict=f"Doubts of the reading: {'; '.join(words)}."
        if doubts
        else "The reading has no doubt on these columns.",
    )


def _doubts_on(law: LawFit, runs: Runs) -> list[Doubt]:
    """Doubts on columns of a law, and on those that they were computed from.

    Doubts on a column without a role are that it is not used, which is untrue of a law with such a factor. A reversed
    sign is none of what is computed from squares.
    """
    columns = {name for name in (law.response, *law.factors, "edge") if name in ROLES}
    signed = set(columns)
    for one in reversed(runs.derived):
        squared = all(f"{role}^2" in one.equation for role in one.inputs)
        signed |= set(one.inputs) if one.role in signed and not squared else set()
        columns |= set(one.inputs) if one.role in columns else set()
    concerned = ((signed if doubt.remedy.endswith("*-1") else columns, doubt) for doubt in runs.doubts)
    return [doubt for roles, doubt in concerned if roles.intersection(doubt.columns) and _uses_doubted(law, doubt)]


def _uses_doubted(law: LawFit, doubt: Doubt) -> bool:
    """Whether a law uses a row that a doubt would leave out; also where the doubt names no rows, or it is not known."""
    return law.rows is None or "--leave-out" not in doubt.remedy or doubt.concerns(law.lines)


OF_SCATTER = ("predictive use", "prediction", "signal to noise")  # checks that find that a law says little
OF_FORM = ("form", "curvature")  # and those of which this may be the effect


def form_first(checks: Mapping[str, Check | NotAvailable]) -> dict[str, Check | NotAvailable]:
    """The checks where lack of fit or curvature is raised to the level of a law that says little because of it.

    This is so where it makes up most of what the law leaves: repeats agree, or a square explains the rest, and it is no
    scatter that more tests would overcome.
    """
    held = {name: check for name, check in checks.items() if isinstance(check, Check)}
    if all(held[name].concern < DO_NOT_USE for name in OF_SCATTER if name in held):
        return dict(checks)
    raised = (name for name in OF_FORM if name in held and _explains_most(held[name]))
    return {**checks, **{name: replace(held[name], concern=DO_NOT_USE) for name in raised}}


def _explains_most(check: Check) -> bool:
    """Whether a test rejects, and the sum of squares that its F is of is larger than that of its error."""
    return bool(check.concern) and isinstance(check.df, tuple) and check.statistic * check.df[0] > check.df[1]


def order_of_reason(item: tuple[str, Check]) -> tuple[bool, bool]:
    """Place of a check, given with its title, among the reasons of a verdict: wrong values, a wrong form, others.

    >>> order_of_reason((TITLES["form"], Check(null="", concern=2, verdict="")))
    (True, False)
    """
    title, check = item
    return not check.suspects, check.concern < DO_NOT_USE or title not in [TITLES[name] for name in OF_FORM]
