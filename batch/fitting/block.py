"""Fit of a block of pairs: the table of all pairs at once, the files pair by pair, failures as reasons."""

import gc
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING

import pandas as pd

from ...core.threads import one_thread
from ..law_rows import PAIR, joined_tables, law_table, reasons, renumbered
from ..outcomes import DEFECT, DOUBT, GONE, NO_LAW, BlockOutcome, Cell, Concern, Failure, PairOutcome, attempt
from ..plan import BatchOptions, Block, Pair, Plan
from .concerns import concerns_of_conditions, concerns_of_laws, concerns_of_values, groups_of_pairs
from .pair_file import files_of_pair, with_cells
from .pair_laws import NumberedRows, laws_of_pairs, numbered_rows
from .streamed_pair import no_law_asked, streamed_outcome

if TYPE_CHECKING:
    from ..rows import PairRows


@one_thread
def fit_block(block: Block, plan: Plan, options: BatchOptions) -> BlockOutcome:
    """Fit the pairs of a block, in any process.

    Parameters
    ----------
    block : Block
        Of ``plan``; its rows are read here.
    plan : Plan
    options : BatchOptions

    Returns
    -------
    BlockOutcome
        An outcome for each pair of the block, in its order, the same wherever and whenever it is made. Nothing is
        raised but KeyboardInterrupt and MemoryError: what fails is the reason of the pairs that it touches.
    """
    from ..engine.base import largest_memory

    begun = time.perf_counter()
    with _uncollected():
        made = attempt(lambda: _fitted(block, plan, options))
    if isinstance(made, Failure):
        pairs = tuple(_without(pair, made.reason) for pair in block.pairs)
        made = BlockOutcome(pairs, law_table(()), {}, {})
    return replace(made, seconds=time.perf_counter() - begun, memory=largest_memory())


@contextmanager
def _uncollected() -> Iterator[None]:
    """Disable garbage collection, which takes a sixth of the time; `_with_files` collects after each file."""
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collecting:
            gc.enable()


def _fitted(block: Block, plan: Plan, options: BatchOptions) -> BlockOutcome:
    if block.streamed:
        one, table = streamed_outcome(block, plan, options)
        return BlockOutcome((one,), table, {}, _units(table))
    from ..source import rows_of

    tables, unreadable = rows_of(block, plan)
    spoiled = spoiled_pairs(block, unreadable)
    place = {(pair.tool, pair.work): i for i, pair in enumerate(block.pairs)}
    outcomes: dict[int, PairOutcome] = {}
    laws: list[pd.DataFrame] = []
    twice: list[int] = []
    units: dict[str, str] = {}
    for rows in tables:
        units |= rows.units
        ones, table = _of_rows(rows, block, plan, options, spoiled)
        at = [place[one.tool, one.work] for one in ones]
        laws.append(renumbered(table, at))
        for i, one in zip(at, ones, strict=True):
            twice += [i] if i in outcomes else []
            outcomes[i] = one if i not in outcomes else _twice(outcomes[i], one)
    whole = joined_tables(laws)
    pairs = tuple(outcomes.get(i) or _without(pair, spoiled.get(pair, GONE)) for i, pair in enumerate(block.pairs))
    whole = whole[~whole[PAIR].isin(twice)].reset_index(drop=True) if twice else whole
    return BlockOutcome(pairs, whole, unreadable, units)


def spoiled_pairs(block: Block, unreadable: Mapping[str, str]) -> dict[Pair, str]:
    """Pairs with rows in a piece that cannot be read, and the reason: a pair is not fitted to part of its rows.

    Where a block does not record the pieces of its pairs, a pair may need any of them.
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


def _of_rows(
    rows: "PairRows", block: Block, plan: Plan, options: BatchOptions, spoiled: Mapping[Pair, str]
) -> tuple[list[PairOutcome], pd.DataFrame]:
    """Outcomes of the pairs that these rows name, and their laws."""
    of = numbered_rows(rows, {(pair.tool, pair.work) for pair in block.pairs if not spoiled or pair not in spoiled})
    if not of.pairs:
        return [], law_table(())
    laws = laws_of_pairs(of, options)
    groups, concerns = groups_of_pairs(of, plan.reading.groups)
    odd = concerns_of_values(of, options.process)
    unknown = [[]] * len(of.pairs) if options.files else concerns_of_conditions(of, laws)  # verdicts of files name them
    none = reasons(laws)
    of_laws = concerns_of_laws(laws, none, len(of.pairs))
    asked = set(laws[PAIR].tolist())
    outcomes = []
    remarks = rows.remarks(of.pairs)
    for i, (pair, nobs) in enumerate(zip(of.pairs, of.counts.tolist(), strict=True)):
        reason, why = none.get(i, ""), of_laws[i]
        if i not in asked:
            reason = no_law_asked(name for name in of.held if of.has(i, name))
            why = (Concern(NO_LAW, reason),)
        simulated, doubts = remarks[i]
        why = (*why, *unknown[i], *concerns[i], *(Concern(DOUBT, words) for words in doubts), *odd[i])
        outcomes.append(PairOutcome(pair.tool, pair.work, nobs, reason, why, groups[i], simulated))
    return _with_files(of, outcomes, laws, block, options) if options.files else (outcomes, laws)


def _with_files(
    of: NumberedRows, outcomes: list[PairOutcome], laws: pd.DataFrame, block: Block, options: BatchOptions
) -> tuple[list[PairOutcome], pd.DataFrame]:
    """The same with the files of each pair that has a law, and concerns from making them."""
    place = {pair: i for i, pair in enumerate(of.pairs)}
    cells: dict[int, Mapping[str, Mapping[str, Cell]]] = {}
    for pair, runs in of.rows.runs():
        i = place[pair]
        if not outcomes[i].reason:
            of_rows = {header: name for header, name in outcomes[i].groups.items() if name}  # these come first
            made = files_of_pair(runs, options, block.identity_of(pair) | of_rows)
            cells[i] = made.cells
            outcomes[i] = replace(outcomes[i], concerns=(*outcomes[i].concerns, *made.concerns), files=made.files)
        gc.collect(0)  # what a file leaves behind that refers to itself
    return outcomes, with_cells(laws, cells)


def _twice(one: PairOutcome, other: PairOutcome) -> PairOutcome:
    why = f"{DEFECT}: the rows of this pair are in two tables."
    return replace(_without(Pair(one.tool, one.work), why), nobs=one.nobs + other.nobs, groups=one.groups)


def _without(pair: Pair, reason: str) -> PairOutcome:
    return PairOutcome(pair.tool, pair.work, 0, reason=reason, concerns=(Concern(NO_LAW, reason),))


def _units(laws: pd.DataFrame) -> dict[str, str]:
    """The usual units, which those of a stream are."""
    from ...datasets.vocabulary import ROLES

    named = {str(name).removeprefix("params_") for name in laws} | set(laws["response"])
    return {name: role.unit for name, role in ROLES.items() if name in named}
