"""Contradictions of the time in cut within cutting edges and between them, and wear that begins anew within them."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ...core.rounding import format_plain
from ..doubts import Doubt
from ..draft import Draft
from ..vocabulary import ROLES
from .columns import Array, Flags
from .rows import FEW, EdgeRows, listed, median

LATE = 5.0  # times the largest other step of time in its edge
FAR = 3.0  # factor from the time at which nearly all edges begin
RISING = 4.0  # standard errors by which wear rises where time does not: times of sub-tests, not of the edge
SHIFTED = 0.8  # share of the falls that stand at one place of the edges where a column is shifted


def doubts_of_time(draft: Draft, edges: EdgeRows, t: Array, wear: Array | None, copies: Flags) -> Iterator[Doubt]:
    """Times that fall or repeat within an edge, stand far above the others, or run on from edge to edge."""
    x = t[edges.order]
    falls, repeats = edges.same & (x[1:] < x[:-1]), edges.same & (x[1:] == x[:-1])
    if repeats.any():
        repeats &= ~copies[edges.order][1:]
    if falls.any():
        yield from _falls(draft, edges, x, falls)
    if repeats.any():
        yield from _repeats(draft, edges, x, repeats, wear)
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
        yield Doubt(("t", "edge"), f"t falls within an edge: {listed(cells)}; {what}")
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
        yield Doubt(("t", "edge"), f"t repeats within an edge: {listed(cells)}; {what}")
    elif wear is not None:
        yield from duration(draft, wear[edges.order][:-1][repeats], wear[edges.order][1:][repeats])


def duration(draft: Draft, before: Array, after: Array) -> Iterator[Doubt]:
    """Doubt that t is the time of each sub-test, by the wear of neighbouring rows of one edge in which t is equal.

    A time that is the same in all rows is in no law, so that the doubt is on the wear as well.
    """
    there = (before > 0) & (after > 0)
    known = np.log(after[there] / before[there])
    if len(known) >= 6 and known.mean() > RISING * known.std() / np.sqrt(len(known)):
        constant = float(np.nanmin(draft.numbers()["t"])) == float(np.nanmax(draft.numbers()["t"]))
        worn = tuple(role for role in draft.numbers() if constant and ROLES[role].kind == "wear")
        yield Doubt(
            ("t", *worn),
            f"t does not rise while wear does, in {len(known)} rows of edges: is it the time of each sub-test? A law "
            "needs the time in cut since the edge was new: add the times up in the file",
            unsettled=constant,
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
        yield Doubt(("t",), f"t jumps at the end of an edge: {listed(cells)}; a digit or decimal mark may have slipped")


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
            ("t",), f"t begins at {format_plain(usual)} min in most edges, but at {listed(cells)}; correct the time"
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
        )


FALL_ANEW, FIRST_WEAR, RISE_ANEW = 2 / 3, 1.6, 1.2  # factors of a step, of the wear after it to the first, of its rise
LONG, SHARE = 5, 0.5  # rows of an edge in which wear may begin anew, and the share of such edges


def begun_anew(
    draft: Draft, edges: EdgeRows, role: str, wear: Array, order: NDArray[np.intp], fell: Flags
) -> Doubt | None:
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
