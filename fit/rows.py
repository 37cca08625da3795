"""Selection of the rows and factors that a law is fitted to; what is left out is recorded with the reason."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from ..core.arrays import Array, Flags, Ints, Texts
from ..core.display import Displayable
from ..core.errors import FitError, UsageError
from ..core.formula import FORMS, Term, second_order_terms
from ..core.rounding import count, label_of
from ..datasets import Runs
from ..datasets.derived import COMPUTED, OF_CUT
from ..datasets.vocabulary import ROLES
from .laws import LARGEST_LOG, LawForm
from .least_squares import linear

Points = Mapping[str, object] | pd.DataFrame

# Fewer distinct rows than this may repeat by chance, where a gauge reads to 0.01 mm.
FEWEST = 4
# R2 of a factor on the others above 1 - 1e-8 is a computed column, not a measured one: a wear printed to
# six decimals from a power law of V and f still leaves a condition number of 3e5, so a rank test misses it.
EXACT = 1e-8
# The same above which a column is clearly not a function of the others, before each is tested alone.
CLEAR = 1e-6
# Rows of that first test, where there are more.
SOME = 10_000
# Relative spread below which a column is the same number written down n times.
CONSTANT = 1e-9
SELECTED = "AICc keeps none of its terms"  # reason why a selection left a factor out
# Spread of a logarithm below which a factor was not varied: a speed computed from a rounded spindle speed, a depth
# measured again. Its exponent would be that of its rounding.
HARDLY = 0.01


@dataclass(frozen=True, slots=True, repr=False)
class Dropped(Displayable):
    """Rows left out of a fit: reason, number, and their first lines in the file."""

    reason: str
    count: int
    lines: tuple[int, ...]


@dataclass(frozen=True, slots=True, repr=False)
class By(Displayable):
    """A category whose level shifts a law: its column, the level of reference and the others."""

    column: str
    reference: str
    levels: tuple[str, ...]


def reference_level(by: By | None, n: int) -> dict[str, object]:
    """The level of reference of a category for n points, by its column; empty without a category."""
    return {} if by is None else {by.column: np.full(n, by.reference)}


@dataclass(frozen=True, slots=True, repr=False)
class LeftOut(Displayable):
    """A factor left out of the law, with the reason."""

    factor: str
    reason: str

    @property
    def confounded(self) -> bool:
        """Whether it changes, and the factors that are kept, or the category, carry its effect."""
        return not self.reason.startswith(("constant", SELECTED))


@dataclass(frozen=True, slots=True)
class Rows:
    """Rows selected for a fit.

    Attributes
    ----------
    X : ndarray, shape (n, k)
        Factors, in the units of the runs.
    y : ndarray, shape (n,)
        Response.
    shifts : ndarray, shape (n, s)
        One indicator column for each level beyond the reference.
    lines : ndarray of int, shape (n,)
        Line of each row in the file.
    edge : ndarray of str, shape (n,), or None
        Cutting edge of each row.
    by : By or None
    dropped : tuple of Dropped
    repeats : int
        How often each measurement was repeated in the file; 1 without repeats.
    """

    X: Array
    y: Array
    shifts: Array
    lines: Ints
    edge: Texts | None
    by: By | None
    dropped: tuple[Dropped, ...]
    repeats: int

    def factors(self, keep: Sequence[int]) -> Array:
        """Columns ``keep`` of X."""
        return self.X[:, list(keep)]


def select(
    runs: Runs,
    response: str,
    factors: Sequence[str],
    *,
    by: str | None = None,
    edge: str | None = "edge",
    positive: Collection[str] | None = None,
) -> Rows:
    """Rows of ``runs`` in which response, factors and category are there; ``positive`` ones (None: all) above zero."""
    if not factors:
        raise UsageError(f"{response}: no factor is named; a law needs at least one, for instance V.")
    if response in factors:
        raise UsageError(f"{response} is the response and cannot be its own factor; leave it out of the factors.")
    if len(set(factors)) < len(factors):
        raise UsageError(f"{response} on {', '.join(factors)}: a factor is named twice; name each once.")
    columns = {name: runs.values(name) for name in (response, *factors)}
    level = runs.labels(by) if by is not None else None
    keep = np.ones(len(runs), dtype=bool)
    dropped: list[Dropped] = []
    lines = np.asarray(runs.lines)

    def drop(bad: Flags, reason: str) -> None:
        bad = bad & keep
        if bad.any():
            dropped.append(Dropped(reason, int(bad.sum()), tuple(int(i) for i in lines[bad][:5])))
            keep[bad] = False

    for name, values in columns.items():
        drop(np.isnan(values), f"{name} missing")
    if by is not None and level is not None:
        drop(np.asarray(level == "", dtype=bool), f"{by} missing")
    for name in columns if positive is None else positive:
        drop(columns[name] <= 0, f"{name} zero or negative")
    labels = runs.labels(edge) if edge is not None and (edge != "edge" or runs.has(edge)) else None
    keep, repeats = _without_copies(columns, (labels, level), keep)
    shifts, category = _indicators(level, keep, by)
    return Rows(
        X=np.column_stack([columns[name][keep] for name in factors]),
        y=columns[response][keep],
        shifts=shifts,
        lines=lines[keep],
        edge=None if labels is None else labels[keep],
        by=category,
        dropped=tuple(dropped),
        repeats=repeats,
    )


def _without_copies(
    columns: dict[str, Array],
    labels: tuple[Texts | None, ...],
    keep: Flags,
) -> tuple[Flags, int]:
    """Keep one row of each measurement where a file repeats every one of them.

    A mean force repeated with six roughness readings is one measurement, not six. Only the plain case
    counts: every distinct row (response, factors, edge and category, to all digits) occurs 6, 12 ...
    times.
    """
    table = pd.DataFrame({name: values[keep] for name, values in columns.items()})
    if len(table) < 2 * FEWEST or _alone(table):
        return keep, 1
    for i, label in enumerate(labels):
        if label is not None:
            table[f"label {i} of the row"] = label[keep]
    group = table.groupby(list(table.columns), sort=False)
    counts = group.size().to_numpy()
    repeats = int(np.gcd.reduce(counts))
    if repeats < 2 or len(counts) < FEWEST:
        return keep, 1
    kept = keep.copy()
    kept[np.flatnonzero(keep)[group.cumcount().to_numpy() % repeats > 0]] = False
    return kept, repeats


def _alone(table: pd.DataFrame) -> bool:
    """Whether the first row has no copy, so that not every row has one."""
    equal = np.ones(len(table), dtype=bool)
    for name in table:
        values = table[name].to_numpy()
        equal &= values == values[0]
    return bool(equal.sum() == 1)


def _indicators(level: Texts | None, keep: Flags, by: str | None) -> tuple[Array, By | None]:
    if level is None or by is None:
        return np.empty((int(keep.sum()), 0)), None
    names = sorted(set(level[keep]))
    if len(names) < 2:
        raise FitError(
            f"by={by!r}: the usable rows hold one level only ({', '.join(names) or 'none'}); "
            "a shift needs two. Fit without by."
        )
    shifts = np.column_stack([(level[keep] == name).astype(float) for name in names[1:]])
    return shifts, By(by, names[0], tuple(names[1:]))


def identifiable(
    names: Sequence[str], terms: Array, shifts: Array, *, logs: bool | Sequence[bool]
) -> tuple[list[int], tuple[LeftOut, ...]]:
    """Positions of the factors that can be fitted, in their order, and the others with the reason.

    Parameters
    ----------
    names : the k factors, most important first: of two dependent ones the later is left out
    terms : ndarray, shape (n, k), the factors as they enter the law (their logarithms in a power law)
    shifts : ndarray, shape (n, s), indicator columns of a category
    logs : whether ``terms``, or each of them, are logarithms; used in the reason only

    Examples
    --------
    >>> keep, out = identifiable(["V", "d"], np.log([[50, 2], [80, 2], [99, 2.0]]), np.empty((3, 0)), logs=True)
    >>> keep, out[0].reason
    ([0], 'constant (2 in all 3 rows)')
    """
    keep: list[int] = []
    out: list[LeftOut] = []
    n, each = len(terms), [logs] * len(names) if isinstance(logs, bool) else logs
    ends = zip(terms[0], terms.min(axis=0), terms.max(axis=0), each, strict=True) if n > 1 else ()
    constant = [constant_reason(float(a), float(b), float(c), n, log=log) for a, b, c, log in ends] or [""] * len(names)
    clear = _independent(terms[:, [not reason for reason in constant]], shifts)
    for j, (name, reason) in enumerate(zip(names, constant, strict=True)):
        if not reason and not clear:
            reason = _dependence(terms[:, j], terms[:, keep], shifts, [names[i] for i in keep], all(each)) or ""
        if reason:
            out.append(LeftOut(name, reason))
        else:
            keep.append(j)
    return keep, tuple(out)


def constant_reason(first: float, low: float, high: float, n: int, *, log: bool) -> str:
    """Reason why a factor counts as constant, by its first, least and greatest value in n rows; empty where it varies.

    >>> constant_reason(np.log(80), np.log(79.98), np.log(80), 27, log=True)
    'constant (79.98 to 80 in all 27 rows)'
    """
    same = max(high - first, first - low) <= CONSTANT * max(1.0, abs(first))
    if not same and not (log and high - low <= HARDLY):
        return ""
    ends = dict.fromkeys(f"{np.exp(end) if log else end:.6g}" for end in ((first,) if same else (low, high)))
    return f"constant ({' to '.join(ends)} in all {n} rows)"


def _dependence(column: Array, others: Array, shifts: Array, names: list[str], logs: bool) -> str | None:
    """Reason why ``column`` depends on ``others``, or None where it does not."""
    n = len(column)
    p = 1 + others.shape[1] + shifts.shape[1]
    if p < 2 or n <= p:  # too few rows for a test: the fit itself counts them
        return None
    fit = linear(np.hstack([np.ones((n, 1)), shifts, others]), column)
    if fit.rss > EXACT * fit.tss:
        return None
    slopes = fit.params[1 + shifts.shape[1] :]
    used = [(name, b) for name, b in zip(names, slopes, strict=True) if abs(b) > 1e-6]
    if not used:
        return "it changes only with the category"
    if logs:
        law = " ".join(f"{name}^{b:.4g}" for name, b in used)
        return f"an exact product of others ({law}): these rows do not identify its effect"
    law = " + ".join(f"{b:.4g} {name}" for name, b in used)
    return f"an exact sum of others ({law}): these rows do not identify its effect"


def _independent(terms: Array, shifts: Array) -> bool:
    """Whether an even selection of rows shows that no column of terms is a function of those before it.

    The sum of squares that these rows leave unexplained is a lower bound of that of all rows.
    """
    few = slice(None, None, max(1, -(-len(terms) // SOME)))
    A = np.hstack([shifts[few], terms[few]])
    if len(A) <= A.shape[1] + 1:
        return False
    R = np.linalg.qr(A - A.mean(axis=0), mode="r")
    left, total = np.square(np.diag(R)[shifts.shape[1] :]), np.square(terms - terms.mean(axis=0)).sum(axis=0)
    return bool(np.all(left > CLEAR * total))


def identified(law: LawForm, columns: Array, rows: Rows) -> tuple[list[int], tuple[LeftOut, ...]]:
    """Positions of the factors that are fixed or can be estimated, and the others with the reason."""
    free = [j for j, name in enumerate(law.factors) if name not in dict(law.fixed)]
    logs, names = law.logs, [law.factors[j] for j in free]
    keep, left_out = identifiable(names, columns[:, free], rows.shifts, logs=[logs[j] for j in free])
    kept = {free[i] for i in keep}
    return [j for j in range(len(law.factors)) if j in kept or j not in free], left_out


def second_order_form(law: LawForm, rows: Rows, terms: Sequence[Term] | None) -> tuple[LawForm, tuple[LeftOut, ...]]:
    """The formula with centres near the middle of the rows and the terms that they identify, and the others.

    Centres are rounded to four digits: where they lie does not change the fit, and the equation has round numbers.
    """
    logs = FORMS[law.name].log_factors
    middle = np.exp(np.log(rows.X).mean(axis=0)) if logs else rows.X.mean(axis=0)
    whole = replace(
        law,
        terms=tuple(second_order_terms(law.factors) if terms is None else terms),
        centres=tuple(float(f"{value:.4g}") for value in middle),
    )
    if whole.fault:
        raise UsageError(f"{law.response}: {whole.fault}.")
    names = [term.name for term in whole.terms]
    keep, left_out = identifiable(names, whole.columns(rows.X)[:, 1:], rows.shifts, logs=False)
    two = {f"{x}^2": x for j, x in enumerate(law.factors) if len(np.unique(rows.X[:, j])) == 2}
    why = "has two levels only, which do not show a curvature"
    stated = (LeftOut(o.factor, f"{two[o.factor]} {why}") if o.factor in two else o for o in left_out)
    return replace(whole, terms=tuple(whole.terms[j] for j in keep)), tuple(stated)


def computed_note(runs: Runs, response: str) -> tuple[str, ...]:
    """That a response was computed from a measured result and conditions: it is no measurement of its own."""
    rule = next((one for one in runs.derived if one.role == response), None)
    if rule is None:
        return ()
    sources = [name for name in rule.inputs if ROLES[name].kind not in ("condition", "time", "other")]
    if len(sources) != 1 or len(rule.inputs) == 1:
        return ()
    of_cut = f"; it is {OF_CUT}" if response == "P" else ""
    return (
        f"{response}{COMPUTED}{rule.equation}; its law is that of {sources[0]} with this equation, "
        f"which R2, F and t contain{of_cut}",
    )


def check_enough(law: LawForm, rows: Rows, left_out: tuple[LeftOut, ...]) -> None:
    """Refuse too few rows, a constant response, and a law without factors."""
    why = "".join(f"; {item.factor} is left out: {item.reason}" for item in left_out)
    gone = "".join(f"; {_gone(item)}" for item in rows.dropped)
    shifts = rows.shifts.shape[1]
    p = sum(law.estimated) + shifts
    if len(rows.y) < p:
        estimated = (name for name, free in zip(law.names, law.estimated, strict=True) if free)
        names = ", ".join(estimated) + (f" and {shifts} shifts of {rows.by.column}" if rows.by else "")
        mend = "Correct the rows left out, measure" if gone else "Measure"
        less = f", or leave a factor out (--map {law.factors[-1]}=none)" if law.factors else ""
        raise FitError(
            f"{law.response}: {count(len(rows.y), 'usable row')} for {count(p, 'parameter')} ({names}){gone}{why}. "
            f"{mend} at least {p + 1 - len(rows.y)} more{less}."
        )
    if np.all(rows.y == rows.y[0]):
        raise FitError(
            f"{law.response} is {rows.y[0]:g} in all {len(rows.y)} rows: there is nothing to explain. Check the column."
        )
    if not law.factors:
        raise FitError(f"{law.response}: no factor to fit it on{why}{gone}. Vary at least one condition.")


def _gone(item: Dropped) -> str:
    lines = ", ".join(map(str, item.lines)) + (", ..." if item.count > len(item.lines) else "")
    return f"{item.count} rows left out: {item.reason} (lines {lines})"


def check_constant(law: LawForm, theta: Array, Z: Array) -> None:
    """Refuse a constant that overflows: a factor hardly changes, or changes with others, and its exponent diverges."""
    if not law.logarithmic or abs(theta[0]) < LARGEST_LOG:
        return
    runaway = 1 + int(np.argmax(np.abs(theta[1:] * Z[0, 1:])))
    name = law.factors[min(runaway, len(law.factors)) - 1]
    others = [other for other in law.factors if other != name]
    together = bool(others) and float(np.ptp(Z[:, runaway])) > HARDLY
    why = f"varies with {' and '.join(others)}" if together else "hardly changes"
    remedy = f"Vary {name} independently of them" if together else f"Vary {name}"
    raise FitError(
        f"{law.response}: its constant comes out as exp({theta[0]:.4g}), which overflows, since {name} "
        f"{why} in these rows and its coefficient comes out as {theta[runaway]:.3g}. {remedy}, "
        f"or leave it out (--map {name}=none)."
    )


def as_table(response: str, new: Mapping[str, object] | pd.DataFrame) -> pd.DataFrame:
    """Single values and columns of one length as a table."""
    columns = {str(name): np.atleast_1d(np.asarray(values)) for name, values in new.items()}
    n = max((len(values) for values in columns.values() if len(values) != 1), default=1)
    odd = [name for name, values in columns.items() if values.shape not in ((1,), (n,))]
    if odd:
        raise FitError(
            f"{response}: {odd[0]} has shape {columns[odd[0]].shape}; each factor is one value or a column of {n}."
        )
    return pd.DataFrame({name: np.broadcast_to(values, n) for name, values in columns.items()})


def level_names(column: "pd.Series[str]", known: Sequence[str], name: str) -> Texts:
    """Levels of a category as text; FitError where one is not among the fitted."""
    level = [label_of(v) for v in column]
    strange = sorted(set(level) - set(known))
    if strange:
        raise FitError(f"{name} {strange[0]!r} is not among the fitted: {', '.join(known)}.")
    return np.array(level, dtype=object)
