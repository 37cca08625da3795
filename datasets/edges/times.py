"""Contradictions of the time in cut within cutting edges and between them, and wear that begins anew within them."""

from collections.abc import Iterator, Mapping
from itertools import pairwise
from math import log

import numpy as np

from ...core.arrays import Array, Flags, Ints
from ...core.rounding import format_plain
from ..doubts import Doubt
from ..draft import CORRECTS, Draft, numbers_of, target_of
from ..headers import parse_header
from ..options import Process
from ..plausibility.ranges import process_of
from ..plausibility.unused_columns import COUNTS, of_counts
from ..tables import Column
from ..units import canonical, same_dimension
from ..vocabulary import ROLES
from .columns import differs
from .rows import FEW, EdgeRows, listed, median

RISES = 0.8  # share of the steps of wear along the edges
OF_FEED = ("mm", "cm", "in")  # units of lengths along the feed; others are of the path of the cut
LATE = 5.0  # times the largest other step of time in its edge
FAR = 3.0  # factor from the time at which nearly all edges begin
RISING = 4.0  # standard errors by which wear rises where time does not: times of sub-tests, not of the edge
SHIFTED = 0.8  # share of the falls that stand at one place of the edges where a column is shifted
CLEARLY = 10.0  # n ln(RSS0/RSS1) from which times that are counted in another way explain the wear better
ADD_UP = "A law needs the time in cut since the edge was new: add the times up"


def doubts_of_no_time(draft: Draft, edges: EdgeRows, numbers: dict[str, Array]) -> Iterator[Doubt]:
    """Wear that rises along the edges while no column is the time or the length of cut."""
    if any(role in numbers and np.ptp(numbers[role]) > 0 for role in ("lf", "lc")):
        return
    wear = next((role for role in numbers if ROLES[role].kind == "wear"), None)
    if wear is None or len(edges.order) < 3 * len(edges.first):
        return
    step = np.diff(numbers[wear][edges.order])[edges.same]
    known = step[~np.isnan(step)]
    if len(known) < 6 or (known > 0).mean() < RISES:
        return
    found = [
        column
        for column, use in zip(draft.columns, draft.uses, strict=True)
        if use.role is None and column.is_numeric and (np.diff(column.values[edges.order])[edges.same] > 0).all()
    ]
    process = process_of(draft.data, draft.notes)
    rising = [(column.name, role) for column in found if (role := _clock(column, process))]
    name, role = rising[0] if rising else ("", "")
    counted = COUNTS.search(name) is not None
    other = f"; column {name!r} rises in each" if rising else ""
    other += f" as a number of parts, holes or passes: {of_counts('t')}" if counted else ""
    yield Doubt(
        (wear, "t"),
        f"{wear} rises along the edges but no column is the cutting time: the laws are of the mean wear of each edge"
        f"{other}",
        f'--map "{role}={name}"' if rising and not counted else "",
    )


def _clock(column: Column, process: Process | None) -> str:
    """The role that a column which rises along the edges may have, by its unit: time, length of cut, or none.

    A length in milling is that of the path of the feed, also in metres.
    """
    text = column.unit_cell or parse_header(column.name).unit_text
    unit = canonical(text) if text else None
    if unit is None or same_dimension(unit, ROLES["t"].unit):
        return "t"
    if same_dimension(unit, ROLES["lc"].unit):
        return "lf" if unit in OF_FEED or process == "milling" else "lc"
    return ""


def doubts_of_time(draft: Draft, edges: EdgeRows, t: Array, wear: Array | None, copies: Flags) -> Iterator[Doubt]:
    """Times that fall or repeat within an edge, stand far above the others, or run on from edge to edge."""
    x = t[edges.order]
    falls, repeats = edges.same & (x[1:] < x[:-1]), edges.same & (x[1:] == x[:-1])
    if repeats.any():
        repeats &= ~copies[edges.order][1:]
    apart = None if wear is None or edges.edges_of(falls | repeats) <= edges.few else _sub_tests(draft, edges, x, wear)
    if apart is not None:
        yield apart
        return
    if repeats.any():
        yield from _repeats(draft, edges, x, repeats, wear)
    yield from _of_falls(draft, edges, t, falls)


def _of_falls(draft: Draft, edges: EdgeRows, t: Array, falls: Flags) -> Iterator[Doubt]:
    """Times that fall within an edge, stand far above the others, or run on from edge to edge."""
    x = t[edges.order]
    if falls.any():
        yield from _falls(draft, edges, x, falls)
    if not falls.any() or edges.edges_of(falls) > edges.few:
        yield from _late(draft, edges, t)
    yield from _begun(draft, edges, x)
    if not falls.any():
        yield from _running_on(edges, x)


def _falls(draft: Draft, edges: EdgeRows, x: Array, falls: Flags) -> Iterator[Doubt]:
    lines = draft.lines[edges.order]
    if edges.edges_of(falls) <= edges.few:
        cells = (
            f"{format_plain(x[i + 1])} min at line {lines[i + 1]} after {format_plain(x[i])} in edge "
            f"{edges.names[edges.order[i]]}"
            for i in np.flatnonzero(falls)
        )
        what = "correct the time, or begin a new edge there"
        at = _of_steps(draft, edges, falls)
        yield Doubt(("t", "edge"), f"t falls within an edge: {listed(cells)}; {what}", lines=at)
        return
    first = np.zeros(len(x), dtype=bool)
    first[edges.first] = True
    last = np.append(first[1:], True)
    for name, place in (("first to the second", first[:-1]), ("last but one to the last", last[1:])):
        if (
            edges.together
            and falls[place & edges.same].mean() >= SHIFTED
            and (falls & place).sum() >= SHIFTED * falls.sum()
        ):
            yield Doubt(
                ("t", "edge"),
                f"t falls from the {name} row of {int((falls & place).sum())} of {edges.several} edges: a column is "
                "shifted by one row against the others; correct it in the file",
            )
            return


def _repeats(draft: Draft, edges: EdgeRows, x: Array, repeats: Flags, wear: Array | None) -> Iterator[Doubt]:
    lines = draft.lines[edges.order]
    if edges.edges_of(repeats) <= edges.few:
        cells = (
            f"{format_plain(x[i])} min at lines {lines[i]} and {lines[i + 1]} of edge {edges.names[edges.order[i]]}"
            for i in np.flatnonzero(repeats)
        )
        what = "correct the time or the name of the edge"
        at = _of_steps(draft, edges, repeats)
        yield Doubt(("t", "edge"), f"t repeats within an edge: {listed(cells)}; {what}", lines=at)
    elif wear is not None:
        yield from duration(draft, wear[edges.order][:-1][repeats], wear[edges.order][1:][repeats])


def _of_steps(draft: Draft, edges: EdgeRows, steps: Flags) -> tuple[int, ...]:
    """Lines of both rows of marked steps, of shape (n - 1,) as sorted: either may be the wrong one."""
    return numbers_of(draft, edges.order[np.append(steps, False) | np.append(False, steps)])


def _sub_tests(draft: Draft, edges: EdgeRows, x: Array, wear: Array) -> Doubt | None:
    """Doubt that t is the time of each sub-test, where the wear of the edges follows the times added up far better."""
    code, y = edges.codes[edges.order], wear[edges.order]
    known = (x > 0) & (y > 0)
    apart = np.isin(code, code[known][of_sub_tests(code[known], np.log(y[known]), x[known])])
    if not apart.any():
        return None
    anew = begins_anew(code, x) & apart
    target = "all" if apart.all() else target_of(draft, edges.order[apart])
    worn = tuple(role for role in draft.numbers() if np.ptp(x) == 0 and ROLES[role].kind == "wear")
    return Doubt(
        ("t", *worn),
        f"t does not rise in {int(anew.sum())} rows of {len(set(code[anew].tolist()))} edges while wear does, which "
        f"follows the times added up: t is probably the time of each sub-test. {ADD_UP}",
        f'{CORRECTS} "{target}:t=cumulative"' if target else "",
        unsettled=True,
        lines=numbers_of(draft, edges.order[apart]),
    )


def begins_anew(edge: Ints, t: Array) -> Flags:
    """Whether the time of a row, sorted by edge, does not rise from the row before of its edge."""
    return np.append(False, (edge[1:] == edge[:-1]) & (t[1:] <= t[:-1]))


def counted_on(edge: Ints, t: Array) -> Array:
    """Times that do not rise counted on from the time before; rows are sorted by edge.

    >>> counted_on(np.array([0, 0, 0, 0]), np.array([2.0, 4.0, 2.0, 4.0]))
    array([2., 4., 6., 8.])
    """
    ahead = np.cumsum(np.where(begins_anew(edge, t), np.append(0.0, t[:-1]), 0.0))
    return np.asarray(t + ahead - ahead[np.searchsorted(edge, edge)])


def added_up(edge: Ints, t: Array) -> Array:
    """Times of sub-tests added up within each edge; rows are sorted by edge.

    >>> added_up(np.array([0, 0, 1, 1]), np.array([2.0, 3.0, 2.0, 2.0]))
    array([2., 5., 2., 4.])
    """
    total = np.cumsum(t)
    first = np.searchsorted(edge, edge)
    return np.asarray(total - total[first] + t[first])


def of_sub_tests(edge: Ints, y: Array, t: Array) -> Flags:
    """Rows of edges whose wear follows the times added up far better than as they are, and no worse than from restarts.

    Edges in which the times rise are among them, where all wear follows the times added up better then.

    Parameters
    ----------
    edge : ndarray of int, shape (n,)
        Rows are sorted by it.
    y : ndarray, shape (n,)
        Logarithm of the wear.
    t : ndarray, shape (n,), above zero

    Examples
    --------
    >>> edge, total = np.repeat(np.arange(6), 4), np.tile([2.0, 5.0, 9.0, 11.0], 6)
    >>> of_sub_tests(edge, np.log(total) / 2, np.tile([2.0, 3.0, 4.0, 2.0], 6)).all()
    np.True_
    >>> of_sub_tests(edge, np.log(total) / 2, np.tile([2.0, 5.0, 4.0, 6.0], 6)).any()  # a clock that was reset once
    np.False_
    """
    some = np.isin(edge, edge[begins_anew(edge, t)])
    total, anew = added_up(edge, t), counted_on(edge, t)
    of = edge[some], y[some], np.log(total[some])
    if not some.any() or evidence(*of, np.log(t[some])) <= CLEARLY or evidence(*of, np.log(anew[some])) < 0:
        return np.zeros(len(edge), dtype=bool)
    all_apart = evidence(edge, y, np.log(total), np.log(np.where(some, total, t))) >= 0
    return some | all_apart


def evidence(edge: Ints, y: Array, counted: Array, as_is: Array) -> float:
    """Evidence n ln(RSS0/RSS1) of rows about the level of their edge for times counted in another way than as they are.

    The times are logarithms. Zero where ``y`` does not rise with those counted in another way.
    """
    edge = np.unique(edge, return_inverse=True)[1]
    size = np.bincount(edge).astype(float)
    r = [x - (np.bincount(edge, weights=x) / size)[edge] for x in (y, counted, as_is)]
    slope, own = (float(r[0] @ x) / max(float(x @ x), 1e-300) for x in r[1:])
    before, after = r[0] - own * r[2], r[0] - slope * r[1]
    ratio = max(float(before @ before), 1e-300) / max(float(after @ after), 1e-300)
    return len(y) * log(ratio) if slope > 0 else 0.0


def sub_tests_in_order(
    draft: Draft, settings: Mapping[str, Array], t: Array | None, wear: Array | None, *, inferred: bool
) -> Iterator[Doubt]:
    """Doubt that t is the time of each sub-test where no column names the edges, by rows that follow each other.

    With ``inferred`` a row whose time is not longer was taken as the first of a new edge.
    """
    if t is None or wear is None or not settings:
        return
    step = np.diff(t)
    alike = ~np.logical_or.reduce([differs(x[1:], x[:-1]) for x in settings.values()])
    alike &= step <= 0 if inferred else step == 0
    yield from duration(draft, wear[:-1][alike], wear[1:][alike], certain=inferred)


def duration(draft: Draft, before: Array, after: Array, *, certain: bool = False) -> Iterator[Doubt]:
    """Doubt that t is the time of each sub-test, by the wear of neighbouring rows of one edge in which t is equal.

    A time that is the same in all rows is in no law, so that the doubt is on the wear as well. It is ``certain`` of
    rows that edges were inferred from, since the wear of a new edge does not begin above that of the one before.
    """
    there = (before > 0) & (after > 0)
    known = np.log(after[there] / before[there])
    if len(known) >= 6 and known.mean() > RISING * known.std() / np.sqrt(len(known)):
        constant = float(np.nanmin(draft.numbers()["t"])) == float(np.nanmax(draft.numbers()["t"]))
        worn = tuple(role for role in draft.numbers() if constant and ROLES[role].kind == "wear")
        yield Doubt(
            ("t", *worn),
            f"t does not rise while wear does, in {len(known)} rows of edges: is it the time of each sub-test? "
            f"{ADD_UP} in the file",
            unsettled=constant or certain,
        )


def _late(draft: Draft, edges: EdgeRows, t: Array) -> Iterator[Doubt]:
    """A last time that is far from the others of its edge."""
    order = np.lexsort((t, edges.codes))
    x = t[order]
    step = np.zeros(len(x))
    step[1:] = np.where(edges.same, np.diff(x), 0.0)
    last = edges.first + edges.sizes - 1
    inner = step.copy()
    inner[last] = 0.0
    most = np.fmax.reduceat(inner, edges.first)
    odd = np.flatnonzero((edges.sizes >= 4) & (most > 0) & (step[last] > LATE * most))
    if 0 < len(odd) <= edges.few:
        lines = draft.lines[order]
        cells = (
            f"{format_plain(x[i])} min at line {lines[i]} after {format_plain(x[i - 1])}" for i in last[odd].tolist()
        )
        yield Doubt(
            ("t",),
            f"t jumps at the end of an edge: {listed(cells)}; a digit or decimal mark may have slipped",
            lines=numbers_of(draft, order[last[odd]]),
        )


def _begun(draft: Draft, edges: EdgeRows, x: Array) -> Iterator[Doubt]:
    """A first time that is far from the one at which nearly all edges begin."""
    at = edges.first[edges.sizes > 1]
    start = x[at]
    usual = median(start)
    odd = (start > 0) & ((start > FAR * usual) | (start < usual / FAR))
    if not usual > 0 or not odd.any() or odd.sum() > edges.few:
        return
    if (np.abs(start - usual) <= 0.01 * usual).mean() >= 1 - FEW:
        lines = draft.lines[edges.order]
        cells = (f"{format_plain(x[i])} min at line {lines[i]}" for i in at[odd])
        yield Doubt(
            ("t",),
            f"t begins at {format_plain(usual)} min in most edges, but at {listed(cells)}; correct the time",
            lines=numbers_of(draft, edges.order[at[odd]]),
        )


def _running_on(edges: EdgeRows, x: Array) -> Iterator[Doubt]:
    """Time that does not begin anew with an edge."""
    if edges.several < 3 or 2 * edges.several <= len(edges.first):
        return
    place = np.argsort(edges.order[edges.first], kind="stable")
    first, last = x[edges.first][place], x[edges.first + edges.sizes - 1][place]
    if (first[1:] > last[:-1]).all():
        yield Doubt(
            ("t",),
            f"t runs on from edge to edge, to {format_plain(float(np.nanmax(x)))} min: each edge begins above the last "
            "time of the one before. Is it the time of the machine? A law needs the time in cut of the edge, from its "
            "first cut",
            unsettled=True,
        )


FALL_ANEW, FIRST_WEAR, RISE_ANEW = 2 / 3, 1.6, 1.2  # factors of a step, of the wear after it to the first, of its rise
LONG, SHARE = 5, 0.5  # rows of an edge in which wear may begin anew, and the share of such edges


def begun_anew(draft: Draft, edges: EdgeRows, role: str, wear: Array, order: Ints, fell: Flags) -> Doubt | None:
    """Doubt wear that falls to its first values and rises again in most edges: several inserts under one name.

    Parameters
    ----------
    wear : ndarray, shape (n,)
        Wear of the rows of the file.
    order : ndarray of int, shape (m,)
        Rows by edge and time.
    fell : ndarray of bool, shape (m - 1,)
        Whether the wear falls beyond its scatter from a row of ``order`` to the next.
    """
    code, x = edges.codes[order], wear[order]
    begins = np.flatnonzero(np.append(True, code[1:] != code[:-1]))
    long, cells = 0, []
    for first, end in pairwise([*begins.tolist(), len(order)]):
        at = 1 + first + np.flatnonzero(fell[first : end - 1] & (x[first + 1 : end] < FALL_ANEW * x[first : end - 1]))
        long += end - first >= LONG
        risen = [x[i] <= FIRST_WEAR * x[first] and x[i:end].max() >= RISE_ANEW * x[i] for i in at]
        if end - first >= LONG and 1 <= len(at) <= 2 and all(risen):
            i = int(at[0])
            name, ends = edges.names[order[i]], f"{format_plain(x[i - 1])} to {format_plain(x[i])}"
            cells.append(f"{name} from {ends} {draft.units.get(role, '')} at line {draft.lines[order[i]]}")
    if len(cells) < max(3, SHARE * long):
        return None
    return Doubt(
        (role, "edge"),
        f"{role} falls to its first values and rises again in {len(cells)} of {long} edges: {listed(cells)}; several "
        "inserts probably have one name: give each insert a name of its own, and its times from its first cut on",
    )
