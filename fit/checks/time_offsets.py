"""Tests of times that are offset, in another unit, or begin anew within an edge.

With ``b`` the time exponent within edges and ``m_g`` the mean of ln t over the first rows of edge g, as many in each
edge, the level of an edge may not depend on ``m_g`` (Mundlak); rows that an edge has beyond those of the shortest
depend on its wear, where it was stopped at a criterion. Within edges a term in 1/t may not matter:
``ln(t - t0) = ln t - t0/t + ...``, so that its coefficient is ``-b t0``. The clearest rejection, of these and of equal
exponents of edges, is followed by a search for the edges concerned (`time_search`).

Sources: Mundlak 1978, Econometrica 46, 69; Hausman 1978, Econometrica 46, 1251.
"""

from dataclasses import replace
from math import log
from typing import TypeGuard

import numpy as np

from ...core.arrays import Array, Ints
from ...core.rounding import format_plain
from ...datasets.edges.merged_cells import lines_text
from ...datasets.edges.times import CLEARLY, added_up, begins_anew, counted_on, evidence, of_sub_tests
from ...datasets.vocabulary import FLANK_WEAR, USUAL_CRITERION, WEAR
from ..available import NotAvailable
from ..edges import changes_within
from ..lawfit import LawFit
from .check import Check, Suspect, concern_of, format_p
from .missing_factors import added_between, added_within
from .strata import NO_ROWS
from .time_exponent import FLAT, TIME, common_exponent
from .time_search import UNITS, Shift, TimeRows, first_times, refined, search

ONE_SCHEDULE = (
    "all edges follow one schedule of times: the exponent between edges, and a unit common to all, are not identified"
)
CLIP = 2.5  # robust standard deviations, of rows in the test of equal exponents
SEARCHED = 0.01  # p of a test below which edges are searched for
LISTED = 20
ALL = ("all",)
ANEW = "counted from a restart of the time"
# Usual causes of a rejection where the search names no edges.
CAUSES = {
    "time exponent": "",
    "time between edges": (
        "Times of some edges are offset or in another unit, or {response} depends on a condition that varied with the "
        "times."
    ),
    "time within edges": (
        "The times or {response} have an offset, or {response} accelerates at the end of the life of an edge."
    ),
}


def rows_of(law: LawFit) -> TimeRows | NotAvailable | None:
    """Rows of a law sorted by edge and time; None where time, or wear beside it, makes the question meaningless."""
    if law.form != "power" or TIME not in law.factors or set(WEAR) & set(law.factors):
        return None
    if law.rows is None:
        return NotAvailable(NO_ROWS)
    if law.edge is None:
        return NotAvailable("no edge column: times within and between edges cannot be separated")
    if law.n_edges == law.nobs:
        return NotAvailable("each edge has one row: there are no times within edges")
    if (law.observed <= 0).any():
        return NotAvailable(f"{law.response} is zero or negative in some rows: the test is in logarithms")
    names, edge = np.unique(law.edge.astype(str), return_inverse=True)
    j = law.factors.index(TIME)
    order = np.lexsort((law.X[:, j], edge))
    others = np.column_stack([np.ones(law.nobs), np.delete(np.log(law.X), j, axis=1), law.shifts])[order]
    edge = edge[order]
    within = changes_within(others, edge)
    return TimeRows(
        tuple(map(str, names)),
        edge,
        np.log(law.observed)[order],
        law.X[order, j],
        others[:, ~within],
        others[:, within],
    )


def time_between(law: LawFit, icc: float) -> Check | NotAvailable | None:
    """Test the time exponent between edges against that within them.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> print(time_between(law, 0.3).reason)
    all edges follow one schedule of times: the exponent between edges, and a unit common to all, are not identified
    """
    rows = rows_of(law)
    if not isinstance(rows, TimeRows):
        return rows
    columns = np.column_stack([np.log(rows.t), rows.moving])
    inside = rows.inside(columns)
    if np.linalg.norm(inside[:, 0]) <= FLAT:
        return NotAvailable("no edge was measured at two times")
    slopes = np.linalg.lstsq(inside, rows.inside(rows.y[:, None])[:, 0], rcond=1e-9)[0]
    level = rows.means((rows.y - columns @ slopes)[:, None])[:, 0]
    found = added_between(level, rows.means(rows.steady), first_times(rows), 1 / (icc + (1 - icc) / rows.size))
    if found is None:
        return NotAvailable(ONE_SCHEDULE)
    extra, t, df, p = found
    verdict = f"The time exponent is {slopes[0]:.2f} within edges and {slopes[0] + extra:.2f} between ({format_p(p)})."
    return Check(
        null="the time exponent between edges is that within edges",
        statistic=t,
        symbol="t",
        df=df,
        pvalue=p,
        concern=concern_of(p),
        verdict=verdict,
        kept=verdict,
    )


def time_within(law: LawFit) -> Check | NotAvailable | None:
    """Test a term in 1/t within edges.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> time_within(law).concern
    0
    """
    rows = rows_of(law)
    if not isinstance(rows, TimeRows):
        return rows
    columns = np.column_stack([np.median(rows.t) / rows.t, np.log(rows.t), rows.moving])
    found = added_within(rows.inside(columns), rows.inside(rows.y[:, None])[:, 0], rows.edge, 1e-6)
    if found is None:
        return NotAvailable("too few edges were measured at three times for a test of the form of their growth")
    _, t, df, p = found
    return Check(
        null="a term in 1/t within edges is zero",
        statistic=t,
        symbol="t",
        df=df,
        pvalue=p,
        concern=concern_of(p),
        verdict=f"Within edges {law.response} departs from a power of t (term in 1/t, {format_p(p)}).",
        kept=f"Within edges {law.response} follows a power of t (term in 1/t, {format_p(p)}).",
    )


def time_tests(law: LawFit, icc: float, limited: Check | None = None) -> dict[str, Check | NotAvailable | None]:
    """The tests of times by name; the clearest rejection names the edges whose times explain it, or usual causes.

    Parameters
    ----------
    law : LawFit
    icc : float
        Share of the residual variance that lies between edges.
    limited : Check, optional
        Readings in steps or at a floor, which explain a rejection: no times are suspected then.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> list(time_tests(law, 0.3))
    ['time exponent', 'time between edges', 'time within edges']
    """
    tests = _tests(law, icc)
    if limited is None:
        return _searched(law, icc, tests)
    return {name: _of_readings(one) if isinstance(one, Check) else one for name, one in tests.items()}


def _searched(
    law: LawFit, icc: float, tests: dict[str, Check | NotAvailable | None]
) -> dict[str, Check | NotAvailable | None]:
    """The tests with the edges, or usual causes, that explain the clearest rejection."""
    rejected = {name: one for name, one in tests.items() if _rejects(one)}
    if not rejected or not isinstance(rows := rows_of(law), TimeRows):
        return tests
    name = min(rejected, key=lambda one: rejected[one].pvalue or 0.0)
    named = _named(law, icc, rows)
    if named is None:
        causes = _accelerated(law, rows) or _fallen(law, rows, CAUSES[name].format(response=law.response))
        return {**tests, name: replace(rejected[name], verdict=f"{rejected[name].verdict} {causes}".rstrip())}
    others = {
        other: replace(one, concern=0, verdict=f"{one.verdict} {_explained(named)}") for other, one in rejected.items()
    }
    suspects = () if named.edges == ALL else (named,)
    clearest = replace(rejected[name], verdict=f"{rejected[name].verdict} {_sentence(law, named)}", suspects=suspects)
    return {**tests, **others, name: clearest}


def _of_readings(one: Check) -> Check:
    """The test without its concern, which coarse readings, or a floor of them, explain."""
    explained = f"{one.verdict} Steps or a floor of the readings explain it."
    return replace(one, concern=0, verdict=explained) if one.concern else one


def _rejects(one: Check | NotAvailable | None) -> TypeGuard[Check]:
    return isinstance(one, Check) and one.pvalue is not None and one.pvalue < SEARCHED


def _named(law: LawFit, icc: float, rows: TimeRows) -> Suspect | None:
    """The change of times that is likely and leaves no test that rejects."""
    suspected = (_suspect(rows, shift) for shift in search(rows))
    return next((one for one in suspected if _explains(law, icc, one)), None)


WORN_OUT, FASTER = 2.0, 1.5  # times the usual criterion; ratio of the exponents of t above and below it


def _accelerated(law: LawFit, rows: TimeRows) -> str:
    """Sentence on readings far beyond the usual criterion, where wear accelerates; empty where most edges have none."""
    if law.response not in FLANK_WEAR or law.units.get(law.response) != "mm":
        return ""
    most = np.exp(np.maximum.reduceat(rows.y, np.unique(rows.edge, return_index=True)[1]))
    count = int(np.sum(most > WORN_OUT * USUAL_CRITERION))
    same = (np.diff(rows.edge) == 0) & (np.diff(rows.t) > 0)
    slopes = np.diff(rows.y)[same] / np.diff(np.log(rows.t))[same]
    beyond = rows.y[1:][same] > log(USUAL_CRITERION)
    if count < SHARE * len(most) or beyond.all() or not beyond.any():
        return ""
    if float(np.median(slopes[beyond])) < FASTER * float(np.median(slopes[~beyond])):
        return ""
    return (
        f"{law.response} grows faster beyond the usual criterion of {USUAL_CRITERION:g} mm, and {count} of {len(most)} "
        f"edges are read up to {most.max():.2g} mm: leave readings far beyond it out, or use the lives by wear curves."
    )


FALL, SHARE = 2 / 3, 0.5  # of a wear from row to row, and of the edges in which it falls so far


def _fallen(law: LawFit, rows: TimeRows, otherwise: str) -> str:
    """Wear that falls far within most edges, which no offset explains; other causes ``otherwise``."""
    falls = (np.diff(rows.edge) == 0) & (np.diff(rows.y) < log(FALL))
    count = len(set(rows.edge[1:][falls].tolist()))
    if law.response not in WEAR or count < SHARE * len(rows.names):
        return otherwise
    return (
        f"{law.response} falls by a third or more within {count} of {len(rows.names)} edges, where wear does not heal: "
        "several inserts may have one name."
    )


def _explained(named: Suspect) -> str:
    which = "of all edges" if named.edges == ALL else f"of {_edges(len(named.edges))} named by another check"
    return f"The times {which} explain it."


def _tests(law: LawFit, icc: float) -> dict[str, Check | NotAvailable | None]:
    slopes = common_exponent(law, CLIP)
    return {
        # of laws without time, or edges with one row, it does not exist
        "time exponent": slopes if isinstance(slopes, Check) else None,
        "time between edges": time_between(law, icc),
        "time within edges": time_within(law),
    }


def _explains(law: LawFit, icc: float, one: Suspect) -> bool:
    """Whether no test rejects once the times are corrected, as one would if edges had wear curves of their own."""
    at = np.ones(law.nobs, dtype=bool) if one.edges == ALL else np.isin(np.asarray(law.edge).astype(str), one.edges)
    X, j = law.X.copy(), law.factors.index(TIME)
    X[at, j] = X[at, j] * (one.factor or 1.0) + (one.offset or 0.0)
    after = [check for check in _tests(law.with_rows(X=X), icc).values() if isinstance(check, Check)]
    return all(check.pvalue is None or check.pvalue > SEARCHED / len(after) for check in after)


def _suspect(rows: TimeRows, found: Shift) -> Suspect:
    edges = ALL if found.edges.all() else tuple(np.array(rows.names)[found.edges].tolist())
    if found.factor != 1:
        cause = UNITS[next(unit for unit in UNITS if np.isclose(max(found.factor, 1 / found.factor), unit))]
        return Suspect(TIME, edges=edges, factor=1 / found.factor, cause=cause)
    return Suspect(TIME, edges=edges, offset=-refined(rows, found), cause="times counted from another start")


def _sentence(law: LawFit, one: Suspect) -> str:
    """Result of the search in words."""
    if one.offset is None:
        size = f"in another unit ({one.cause})"
    else:
        size = f"offset: {format_plain(abs(one.offset))} min too {'large' if one.offset < 0 else 'small'}"
    if one.edges == ALL:
        return (
            f"The times of all edges may be {size} (--correct {one.correction}); an offset of {law.response}, or "
            f"{law.response} that does not follow a power of t, has the same effect."
        )
    s = "" if len(one.edges) == 1 else "s"
    more = f" and {len(one.edges) - LISTED} more" if len(one.edges) > LISTED else ""
    which = f"edge{s} {', '.join(one.edges[:LISTED])}{more}"
    return f"The times t of {which} are probably {size} against the other edges; compare with the records."


# --- times that begin anew --------------------------------------------------------------------------------------------


def time_restarts(law: LawFit) -> Check | None:
    """Rows at which the time of an edge begins anew while the response rises on; None where there are none.

    Times that do not rise are counted on from the time before; times of sub-tests are added up. Edges whose time began
    anew then follow a power of t much better; rows in another order than that of the tests, or repeated readings at one
    time, do not.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> time_restarts(law) is None
    True
    """
    if law.rows is None or law.edge is None or law.form != "power" or TIME not in law.factors:
        return None
    edge = np.unique(law.edge.astype(str), return_inverse=True)[1]
    order = np.argsort(edge, kind="stable")
    edge, t, y, lines = edge[order], law.X[order, law.factors.index(TIME)], law.observed[order], law.lines[order]
    anew = begins_anew(edge, t)
    if not anew.any() or (y <= 0).any():
        return None
    some, apart = np.isin(edge, edge[anew]), of_sub_tests(edge, np.log(y), t)
    counted = np.where(apart, added_up(edge, t), counted_on(edge, t))
    gain = evidence(edge[some], np.log(y[some]), np.log(counted[some]), np.log(t[some]))
    if gain <= CLEARLY:
        return None
    names = ",".join(np.unique(law.edge[order][apart].astype(str)))
    of_part = f"it is probably the time of each sub-test; add the times up (--correct '{names}:t=cumulative')."
    return Check(
        null="times within an edge rise from its first cut",
        statistic=gain,
        symbol="n ln(RSS0/RSS1)",
        concern=1,
        verdict=(
            f"t begins anew within {_edges(len(set(edge[anew].tolist())))} ({lines_text(lines[anew])}) while "
            f"{law.response} rises on: {of_part if names else 'a law needs the time in cut since the edge was new.'}"
        ),
        suspects=() if names else _counted_on(lines, np.where(some, counted - t, 0.0)),
    )


def _counted_on(lines: Ints, ahead: Array) -> tuple[Suspect, ...]:
    """Lines whose times need an offset, for each offset."""
    offsets = np.unique(ahead[ahead > 0])
    return tuple(
        Suspect(TIME, lines=tuple(lines[ahead == value].tolist()), offset=float(value), cause=ANEW) for value in offsets
    )


def _edges(count: int) -> str:
    return "one edge" if count == 1 else f"{count} edges"
