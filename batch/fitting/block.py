"""A block of pairs is fitted: the table from stacks, the files pair by pair, and every failure is a reason."""

import gc
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING

from ...datasets.threads import one_thread
from ..how import How
from ..outcome import BlockOutcome, Concern, PairOutcome
from ..plan import Block, Pair, Plan
from .concerns import concerns_of_rows
from .failures import Failed, tried
from .groups import groups_of_pairs
from .laws_of_pairs import laws_of_pairs
from .pair_file import PairFiles, files_of_pair, with_cells
from .pairs_of_rows import PairsOfRows, looked_over
from .streamed_pair import no_law_asked, streamed_outcome
from .table_rows import reason_of

if TYPE_CHECKING:
    from ...datasets import Runs
    from ..rows import Rows

NOW_AND_THEN = 25  # files
GONE = "the source holds no row of this pair any more: it changed after it was looked over. Run it again."


@one_thread
def fit_block(block: Block, plan: Plan, how: How) -> BlockOutcome:
    """Fit the pairs of a block, in any process.

    Parameters
    ----------
    block : Block
        Of ``plan``; its rows are read here.
    plan : Plan
    how : How

    Returns
    -------
    BlockOutcome
        An outcome for each pair of the block, in its order, the same wherever and whenever it is made. Nothing is
        raised but KeyboardInterrupt and MemoryError: what fails is the reason of the pairs that it touches.
    """
    from ..engine.memory import largest_memory

    begun = time.perf_counter()
    with _uncollected():
        made = tried(lambda: _fitted(block, plan, how))
    if isinstance(made, Failed):
        made = _none(block, made.reason), {}, {}
    pairs, unreadable, units = made
    memory = largest_memory()
    return BlockOutcome(pairs, unreadable, units, time.perf_counter() - begun, memory if isinstance(memory, int) else 0)


@contextmanager
def _uncollected() -> Iterator[None]:
    """Leave garbage where it is: the collector takes a sixth of the time; `_with_files` calls it now and then."""
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collecting:
            gc.enable()


Found = tuple[tuple[PairOutcome, ...], dict[str, str], dict[str, str]]


def _fitted(block: Block, plan: Plan, how: How) -> Found:
    if block.streamed:
        one = streamed_outcome(block, plan, how)
        return (one,), {}, _units(one)
    from ..source import rows_of

    tables, unreadable = rows_of(block, plan)
    spoiled = spoiled_pairs(block, unreadable)
    outcomes: dict[Pair, PairOutcome] = {}
    units: dict[str, str] = {}
    for rows in tables:
        units |= rows.units
        for one in _of_rows(rows, block, plan, how, spoiled):
            pair = Pair(one.tool, one.work)
            outcomes[pair] = one if pair not in outcomes else _twice(outcomes[pair], one)
    found = tuple(outcomes.get(pair) or _without(pair, spoiled.get(pair, GONE)) for pair in block.pairs)
    return found, unreadable, units


def spoiled_pairs(block: Block, unreadable: Mapping[str, str]) -> dict[Pair, str]:
    """Pairs that need a piece which cannot be read, and the sentence: part of a pair's rows is another pair.

    Where a block does not tell which pieces a pair needs, it may need any of them.
    """
    if not unreadable:
        return {}
    of_pair = block.of_pair or (tuple(range(len(block.pieces))),) * len(block.pairs)
    spoiled: dict[Pair, str] = {}
    for pair, at in zip(block.pairs, of_pair, strict=True):
        why = [unreadable[block.pieces[i].name] for i in at if block.pieces[i].name in unreadable]
        if why:
            spoiled[pair] = " ".join(dict.fromkeys(why))
    return spoiled


def _of_rows(rows: "Rows", block: Block, plan: Plan, how: How, spoiled: Mapping[Pair, str]) -> list[PairOutcome]:
    """Outcomes of the pairs that these rows name."""
    of = looked_over(rows, set(block.pairs) - set(spoiled))
    if not of.pairs:
        return []
    laws = laws_of_pairs(of, how)
    groups, concerns = groups_of_pairs(of, plan.reading.groups)
    outcomes = []
    for i, pair in enumerate(of.pairs):
        reason = reason_of(laws[i])
        if not laws[i]:
            reason = no_law_asked(name for name in of.held if of.has(i, name))
        told = concerns_of_rows(laws[i]) or ((Concern("no law", reason),) if reason else ())
        outcomes.append(
            PairOutcome(
                pair.tool,
                pair.work,
                int(of.counts[i]),
                tuple(laws[i]),
                reason,
                (*told, *concerns[i]),
                groups[i],
                rows.simulated(pair),
            )
        )
    return _with_files(of, outcomes, block, plan, how) if how.files else outcomes


def _with_files(of: PairsOfRows, outcomes: list[PairOutcome], block: Block, plan: Plan, how: How) -> list[PairOutcome]:
    """The same with the files of each pair that has a law, and with what came up on the way."""
    place = {pair: i for i, pair in enumerate(of.pairs)}
    for done, (pair, runs) in enumerate(of.rows.runs(), 1):
        i = place[pair]
        if not outcomes[i].reason:
            outcomes[i] = _with_file(outcomes[i], runs, block.told_of(pair), plan, how)
        if done % NOW_AND_THEN == 0:
            gc.collect()  # the command runs without the collector
    return outcomes


def _with_file(found: PairOutcome, runs: "Runs", beside: Mapping[str, str], plan: Plan, how: How) -> PairOutcome:
    known = {header: name for header, name in found.groups.items() if name}  # what the rows say counts first
    made: PairFiles = files_of_pair(runs, how, plan.reading, {**beside, **known})
    laws = with_cells([dict(row) for row in found.laws], made.cells)
    return replace(found, laws=laws, concerns=(*found.concerns, *made.concerns), files=made.files)


def _twice(one: PairOutcome, other: PairOutcome) -> PairOutcome:
    why = "a defect of fitmodels, not of the data: the rows of this pair were handed over in two tables."
    return replace(_without(Pair(one.tool, one.work), why), nobs=one.nobs + other.nobs, groups=one.groups)


def _without(pair: Pair, reason: str) -> PairOutcome:
    return PairOutcome(pair.tool, pair.work, 0, reason=reason, concerns=(Concern("no law", reason),))


def _none(block: Block, reason: str) -> tuple[PairOutcome, ...]:
    return tuple(_without(pair, reason) for pair in block.pairs)


def _units(found: PairOutcome) -> dict[str, str]:
    """The usual units, which those of a stream are."""
    from ...datasets.vocabulary import ROLES

    factors = {name.removeprefix("params_") for row in found.laws for name in row if name.startswith("params_")}
    named = factors | {str(row["response"]) for row in found.laws}
    return {name: role.unit for name, role in ROLES.items() if name in named}
