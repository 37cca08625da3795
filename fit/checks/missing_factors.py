"""Factors that a law lacks: columns of the file that it does not use, and conditions that the file does not hold.

A column is tested as an added variable, by edge: one that changes between edges against the levels of edges about the
law, weighted by the variance between and within edges; one that changes within edges against the rows about the levels
of their edges, with a jackknife by edge. The smallest p counts, times the number of columns (Bonferroni).

Sources: Cook & Weisberg 1982, Residuals and Influence in Regression, section 2.3.2 (added variables); ISO 3685:1993
(turning), ISO 8688-1:1989 (milling): conditions that a tool-life test records.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from shlex import quote

import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Array, Flags, Ints, Texts
from ...core.rounding import format_plain, join_words, label_of
from ...datasets import Runs
from ...datasets.edges.columns import BLOCK
from ...datasets.notes import conditions_of_file
from ...datasets.units import is_unit
from ...datasets.vocabulary import ROLES, WEAR, fits
from ..available import NotAvailable
from ..edges import changes_within, left_out_moves
from ..lawfit import LawFit
from ..least_squares import sums_by
from .check import Check, concern_of, format_p
from .strata import FEWEST, blocks_between, levels_of_edges, no_scatter, rows_in, units_of

# Conditions that determine the response in each process, and quantities that stand for them.
NEEDED: Mapping[str | None, tuple[str, ...]] = {
    None: ("V", "f", "d"),
    "turning": ("V", "f", "d"),
    "milling": ("V", "f", "d", "ae"),
    "drilling": ("V", "f"),
    "grinding": ("V", "d"),
}
STAND_INS: Mapping[str, tuple[str, ...]] = {"V": ("n",), "f": ("fz", "fm"), "t": ("lf", "lc")}
DRILLS = ("D", "Dc")  # a diameter in place of a depth: the process may be drilling
TESTED = ("V", "f", "fz", "fm", "d", "ae", "n", "t", "D", "Dc", "z", "re")  # are set; others are measured
LEAST = np.log(1.05)  # spread of a column, given the factors, below which it is a rounding or a copy of them
MOST_LEVELS = 7  # of a column without a role: a setting of the plan, not a measurement
KNOWN = 0.9  # share of the rows in which a column has a value


@dataclass(frozen=True, slots=True)
class Added:
    """The test of one column as an added variable; of blocks ``t`` is F and ``levels`` their number, 0 otherwise."""

    name: str
    coefficient: float
    t: float
    df: int
    p: float
    span: str
    levels: int = 0
    alike: tuple[str, ...] = ()  # columns whose levels are in the same rows

    @property
    def blocks_verdict(self) -> str:
        """The finding of a column of blocks."""
        test = f"F({self.levels - 1}, {self.df}) = {self.t:.3g}, {format_p(self.p)}"
        by = f"fit it with --by {quote(self.name)}"
        words = "" if BLOCK.fullmatch(self.name) else f", or name the work by it with --map work={quote(self.name)}"
        alike = f" (as {join_words([repr(name) for name in self.alike])} does, in the same rows)" if self.alike else ""
        return f"Column {self.name!r} shifts the law{alike}; {by}{words} (levels {self.span}; {test})."


def missing_conditions(law: LawFit, runs: Runs | None) -> Check | None:
    """Conditions that the process needs and that the file does not hold; None without the runs of the law.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    >>> law = fit.power_law(runs, "AW", ["V", "f", "d", "t"])
    >>> missing_conditions(law, runs).verdict
    'The conditions V, f, d and t of turning are known.'
    """
    if runs is None or not _of_conditions(law):
        return None
    needed = (*NEEDED[runs.process], *(("t",) if law.response in WEAR else ()))
    held = lambda name: runs.has(name) or name in runs.constants or is_noted(runs.notes, name)  # noqa: E731
    missing = missing_of(needed, held, runs.process)
    known = f"The conditions {join_words(needed)} of {runs.process or 'cutting'} are known."
    verdict = absent(missing) if missing else known
    return Check(null="the file holds the conditions of the process", concern=int(bool(missing)), verdict=verdict)


def _of_conditions(law: LawFit) -> bool:
    """Whether a law predicts from the conditions of cutting: a power law, or another form with one of them."""
    if law.form in ("load_line", "feed_line"):
        return False
    return law.form == "power" or bool(set(TESTED).intersection(law.factors))


def missing_of(needed: Sequence[str], stated: Callable[[str], bool], process: str | None) -> list[str]:
    """Conditions that are not stated, nor a quantity that stands for them."""
    stand_ins = STAND_INS if process else {**STAND_INS, "d": DRILLS}
    return [name for name in needed if not any(stated(one) for one in (name, *stand_ins.get(name, ())))]


def is_noted(notes: Sequence[str], name: str) -> bool:
    """Whether a quantity stands in notes by any of its names (``ap = 2 mm``), or by its symbol (``d 2.5 mm``)."""
    named = any(one.role == name for one in conditions_of_file("", notes))
    stated = re.compile(rf"(?<![\w./]){name}[ \t=:]+\d[\d.,]*[ \t]*([^\s,;]+)")
    units = (match[1].rstrip(".") for note in notes for match in stated.finditer(note))
    return named or any(is_unit(unit) and fits(name, unit) for unit in units)


def absent(missing: Sequence[str], where: str = "this file") -> str:
    """Sentences on conditions that are not known."""
    sentences = []
    conditions = [name for name in missing if name != "t"]
    if conditions:
        words = join_words([f"{ROLES[name].quantity} {name}" for name in conditions])
        given = " ".join(f"--value {name}=..." for name in conditions)
        be, its, they, s = ("is", "its", "it was", "") if len(conditions) == 1 else ("are", "their", "they were", "s")
        sentences.append(
            f"{words[0].upper()}{words[1:]} {be} not in {where}: exponents of the other factors absorb {its} "
            f"effect{s} where they varied together. Add a column, or {given} where {they} constant."
        )
    if "t" in missing:
        sentences.append(
            f"Cutting time t is not in {where}: the law is of wear after unknown times in cut. Add a column t."
        )
    return " ".join(sentences)


def unused_columns(law: LawFit, runs: Runs | None, icc: float) -> Check | NotAvailable | None:
    """Test columns of the file that vary and are not in the law; None where there are none.

    Parameters
    ----------
    law : LawFit
    runs : Runs or None
    icc : float
        Share of the residual variance that lies between edges.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    >>> unused_columns(fit.power_law(runs, "AW", ["V", "f", "t"]), runs, 0.5).concern
    1
    """
    if runs is None:
        return None
    columns = settings_of(law, runs)
    if isinstance(columns, NotAvailable):
        return columns
    blocks = blocks_of(law, runs)
    if not columns and not blocks:
        return None
    tests = [one for name, x in columns.items() if (one := _tested(law, name, x, icc)) is not None]
    tests += [one for names, x in _apart(blocks) if (one := _tested_blocks(law, names, x, icc)) is not None]
    if not tests:
        return NotAvailable(f"{', '.join((*columns, *blocks))}: constant, or not separable from the factors of the law")
    return _check(law, runs, min(tests, key=lambda one: one.p), tests)


def settings_of(law: LawFit, runs: Runs) -> dict[str, Array] | NotAvailable:
    """Columns that are set by the plan of tests and that the law does not use, at the rows of the law."""
    names = _unused(law, runs)
    if not names:
        return {}
    if reason := no_scatter(law):
        return NotAvailable(reason)
    rows = rows_in(law, runs)
    if rows is None:
        return NotAvailable("rows of several files share their line numbers: columns cannot be assigned to rows")
    columns = ((name, runs.values(name)[rows]) for name in names)
    return {name: x for name, x in columns if _is_set(law, name, x)}


def _unused(law: LawFit, runs: Runs) -> list[str]:
    used = {*law.factors, law.response, *(one.role for one in runs.derived), "" if law.by is None else law.by.column}
    names = [name for name in map(str, runs.data.columns) if name not in used and not BLOCK.fullmatch(name)]
    return [name for name in names if _varies(runs, name)]


def blocks_of(law: LawFit, runs: Runs | None) -> dict[str, Texts]:
    """Columns of blocks, and of words, at the rows of the law: of few levels, constant within edges, two edges each."""
    rows = None if runs is None or law.by is not None or no_scatter(law) else rows_in(law, runs)
    if runs is None or rows is None:
        return {}
    every = {str(name): runs.data[name].to_numpy() for name in runs.data.columns}
    columns = {name: _as_labels(x[rows]) for name, x in every.items() if _is_block(name, x)}
    unit = units_of(law)[1]
    return {name: x for name, x in columns.items() if _are_blocks(x, unit)}


def _is_block(name: str, values: NDArray[np.generic]) -> bool:
    """Whether a column without a role is named as a block, or has a word in every row."""
    if name in (*ROLES, "point"):  # point: of a plan
        return False
    words = values.dtype.kind == "O" and all(isinstance(x, str) and x.strip() for x in values)
    return words or BLOCK.fullmatch(name) is not None


def _as_labels(values: NDArray[np.generic]) -> Texts:
    """Levels as text, whole numbers without a decimal point."""
    return np.array([label_of(x) for x in values.tolist()], dtype=object)


def _are_blocks(x: Texts, unit: Ints) -> bool:
    pairs = set(zip(unit.tolist(), x.tolist(), strict=True))
    levels = [level for _, level in pairs]
    numbers = [levels.count(level) for level in set(levels)]
    return len(pairs) == int(unit.max()) + 1 and 2 <= len(numbers) <= MOST_LEVELS and min(numbers) > 1


def _apart(blocks: Mapping[str, Texts]) -> list[tuple[list[str], Texts]]:
    """Columns of blocks with the names of those whose levels are in the same rows: no test separates them."""
    groups: dict[bytes, list[str]] = {}
    for name, x in blocks.items():
        first = np.unique(x.astype(str), return_index=True, return_inverse=True)
        groups.setdefault(first[1][first[2]].tobytes(), []).append(name)
    return [(names, blocks[names[0]]) for names in groups.values()]


def _tested_blocks(law: LawFit, names: list[str], x: Texts, icc: float) -> Added | None:
    """Blocks as added indicators between edges."""
    levels = sorted(set(x.tolist()))
    D = np.column_stack([(x == level).astype(float) for level in levels[1:]])
    unit = units_of(law)[1]
    columns = np.column_stack([D * law.gradient[:, :1], law.gradient])
    moving = changes_within(columns, unit)
    if moving[: len(levels) - 1].any():
        return None
    k = len(levels) - 1
    y, others, blocks, size = levels_of_edges(law.gradient, law.residuals, columns[:, :k], unit, moving[k:])
    found = blocks_between(y, others, blocks, 1 / (icc + (1 - icc) / size))
    shown = ", ".join(levels[:4]) + (", ..." if len(levels) > 4 else "")
    return None if found is None else Added(names[0], 0.0, *found, shown, len(levels), tuple(names[1:]))


def _check(law: LawFit, runs: Runs, first: Added, tests: list[Added]) -> Check:
    p = min(1.0, first.p * len(tests))
    unit = runs.units.get(first.name, "")
    values = f"{first.span} {unit}".rstrip()
    # a law with fixed exponents has the factors of its form alone
    add = "Keep a form that can have it" if law.formula.fixed else f'Add it (--law "{law.response} ~ + {first.name}")'
    remedy = f"{add}, or fit the tests at one {first.name}."
    if law.form == "exponential" and len(law.factors) == 1 and law.units.get(law.factors[0]) == "N":
        remedy = _at_one(law.response, law.factors[0], first.name)
    size = f"exponent {first.coefficient:.2f}" if law.form == "power" else f"coefficient {first.coefficient:.3g}"
    others = ", ".join(f"{one.name} {format_p(one.p)}" for one in sorted(tests, key=lambda one: one.p))
    kept = f"Columns that are not in the law have no effect that these tests show ({others})."
    many = f"; {len(tests)} columns tested" if len(tests) > 1 else ""
    verdict = (
        f"{first.name} ({values}) is not in the law of {law.response} and matters: {size} when it is added "
        f"({format_p(p)}{many}). {remedy}"
    )
    blocks = bool(first.levels)
    return Check(
        null="columns of the file that are not in the law have no effect", statistic=first.t,
        symbol="F" if blocks else "t", df=(first.levels - 1, first.df) if blocks else first.df, pvalue=p,
        concern=concern_of(p), verdict=first.blocks_verdict if blocks else verdict, kept=kept,
    )  # fmt: skip


def _at_one(response: str, force: str, name: str) -> str:
    """Remedy of a law on force alone, which roughness control needs: the control changes the force by the feed."""
    what = f"value of each condition other than {name}" if name in ("f", "fz", "fm") else name
    why = f"roughness control needs {response} on {force} alone"
    return f"Fit the tests at one {what} and leave the others out: {why}."


def _varies(runs: Runs, name: str) -> bool:
    """Whether a column without a role, or of a quantity that is set, holds numbers in most rows and varies."""
    if runs.data[name].dtype.kind not in "if" or (name in ROLES and name not in TESTED):
        return False
    values = runs.values(name)
    known = values[np.isfinite(values)]
    return len(known) >= max(KNOWN * len(values), 1) and bool(np.ptp(known) > 0)


def _number_of_test(values: Array) -> bool:
    """Whether values only count: three and more whole numbers that rise by one.

    >>> _number_of_test(np.array([1.0, 1, 2, 2, 3, 3])), _number_of_test(np.array([0.0, 0, 0, 1, 1, 1]))
    (True, False)
    """
    step = np.diff(values)
    return bool(np.all(values == np.round(values)) and np.isin(step, (0.0, 1.0)).all() and step.sum() > 1)


def _is_set(law: LawFit, name: str, values: Array) -> bool:
    """Whether a column is a setting of the plan; without a role: few levels, each repeated, constant in each edge."""
    if name in TESTED:
        return True
    known = np.isfinite(values)
    levels, counts = np.unique(values[known], return_counts=True)
    if len(levels) > MOST_LEVELS or counts.min() < 2 or _number_of_test(values):
        return False
    unit = np.unique(units_of(law)[1][known], return_inverse=True)[1]
    return not changes_within(values[known][:, None], unit)[0]


def _tested(law: LawFit, name: str, values: Array, icc: float) -> Added | None:
    """A column as an added variable; None where it does not vary beside the factors."""
    known = np.isfinite(values)
    x = np.log(values, where=known, out=np.full(len(values), np.nan)) if (values[known] > 0).all() else values.copy()
    if (values[known] <= 0).any():
        x = x / max(float(np.ptp(x[known])), 1e-300)
    Z, r = law.gradient[known], law.residuals[known]
    x = x[known] * Z[:, 0]
    unit = np.unique(units_of(law)[1][known], return_inverse=True)[1]
    moving = changes_within(np.column_stack([x, Z]), unit)
    found = _within(Z, r, x, unit, moving[1:]) if moving[0] else _between(Z, r, x, unit, moving[1:], icc)
    if found is None:
        return None
    low, high = (format_plain(float(end)) for end in (values[known].min(), values[known].max()))
    return Added(name, *found, f"{low} to {high}")


def _between(
    Z: Array, r: Array, x: Array, unit: Ints, moving: Flags, icc: float
) -> tuple[float, float, int, float] | None:
    """Coefficient, t, degrees of freedom and p of a column that is constant within edges."""
    levels, others, means, size = levels_of_edges(Z, r, x[:, None], unit, moving)
    return added_between(levels, others, means[:, 0], 1 / (icc + (1 - icc) / size))


def added_between(levels: Array, others: Array, x: Array, weight: Array) -> tuple[float, float, int, float] | None:
    """Weighted regression of levels of edges on other columns and x: coefficient of x, its t, df and p.

    Returns None where x hardly varies beside the other columns, or too few degrees of freedom are left.

    Examples
    --------
    >>> x = np.log([1.0, 2, 4, 8, 16, 32])
    >>> found = added_between(0.5 * x + [0.01, -0.01, 0, 0.01, -0.01, 0], np.ones((6, 1)), x, np.ones(6))
    >>> round(found[0], 2), found[2]
    (0.5, 4)
    """
    from scipy.special import stdtr

    alone = x - others @ np.linalg.lstsq(others, x, rcond=1e-9)[0]
    root = np.sqrt(weight)
    U, s, _ = np.linalg.svd(others * root[:, None], full_matrices=False)
    Q = U[:, s > 1e-9 * s[0]]
    df = len(x) - Q.shape[1] - 1
    if np.ptp(alone) < LEAST or df < FEWEST:
        return None
    x, y = (root * v - Q @ (Q.T @ (root * v)) for v in (x, levels))
    b = float(x @ y / (x @ x))
    left = y - b * x
    se = float(np.sqrt(left @ left / df / (x @ x)))
    t = b / se if se > 0 else 0.0
    return b, t, df, float(2 * stdtr(df, -abs(t)))


def _within(Z: Array, r: Array, x: Array, unit: Ints, moving: Flags) -> tuple[float, float, int, float] | None:
    """Coefficient, t, degrees of freedom and p of a column that changes within edges."""
    columns = np.column_stack([x, Z[:, moving], r])
    size = np.bincount(unit).astype(float)
    inside = columns - (sums_by(unit, columns, len(size)) / size[:, None])[unit]
    return added_within(inside[:, :-1], inside[:, -1], unit)


def added_within(
    columns: Array, y: Array, edge: Ints, least: float = LEAST / 2
) -> tuple[float, float, int, float] | None:
    """Regression within edges, with a jackknife by edge: coefficient of the first column, its t, df and p.

    Parameters
    ----------
    columns, y : ndarray, shape (n, k) and (n,)
        Less the mean of their edge; the column that is added first.
    edge : ndarray of int, shape (n,)
    least : float
        Spread of the first column beside the others below which it is not tested.
    """
    from scipy.special import stdtr

    G = int(edge.max()) + 1
    x, others = columns[:, 0], columns[:, 1:]
    alone = x - others @ np.linalg.lstsq(others, x, rcond=1e-9)[0] if others.shape[1] else x
    if np.ptp(alone) < least or G < FEWEST + 1 or len(y) <= G + columns.shape[1]:
        return None
    size = np.linalg.norm(columns, axis=0)
    if np.linalg.matrix_rank(columns / np.where(size > 0, size, 1.0), tol=1e-7) < columns.shape[1]:
        return None
    cov = np.linalg.inv(columns.T @ columns)
    theta = cov @ (columns.T @ y)
    moves = left_out_moves(columns, y - columns @ theta, np.asarray(cov, dtype=float), edge, G)
    if isinstance(moves, int):
        return None
    se = float(np.sqrt((G - 1) / G * moves[:, 0] @ moves[:, 0]))
    t = float(theta[0]) / se if se > 0 else 0.0
    return float(theta[0]), t, G - 1, float(2 * stdtr(G - 1, -abs(t)))
