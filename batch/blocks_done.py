"""Blocks are fitted by an engine; each is recorded as it is done, and those recorded before are taken from there."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from .engine import Meter, Run
from .fitting.block import fit_block
from .how import How
from .outcome import BlockOutcome
from .plan import Block, Pair, Plan
from .result.records import key_of, record, recorded


@dataclass(frozen=True, slots=True)
class Done:
    """All blocks of a plan.

    Attributes
    ----------
    outcomes : tuple of BlockOutcome
        In the order of the blocks, without the bytes of files.
    keys : tuple of str
        Of their records.
    fitted, kept : int
        Pairs.
    seconds : float
    memory : int
    """

    outcomes: tuple[BlockOutcome, ...]
    keys: tuple[str, ...]
    fitted: int
    kept: int
    seconds: float
    memory: int


def blocks_done(plan: Plan, how: How, out: Path, folders: Mapping[Pair, str], workers: Run, meter: Meter) -> Done:
    """Fit every block that is not recorded in ``out`` yet, or of which something failed that need not fail again."""
    keys = tuple(key_of(block, plan, how) for block in plan.blocks)
    found = {i: recorded(out, key, folders) for i, key in enumerate(keys)}
    outcomes = {i: outcome for i, outcome in found.items() if outcome is not None and outcome.settled}
    todo = [i for i in range(len(keys)) if i not in outcomes]
    kept = _pairs(plan.blocks, outcomes)
    meter.expect(len(plan.pairs))
    meter.skip(kept)
    meter.say("fitting")
    begun = time.perf_counter()
    memory = 0
    work = partial(fit_block, plan=replace(plan, blocks=(), unreadable=()), how=how)
    for at, outcome in workers(work, [plan.blocks[i] for i in todo]):
        i = todo[at]
        record(out, keys[i], outcome, folders)
        memory = max(memory, outcome.memory)
        outcomes[i] = _without_files(outcome)
        meter.advance(len(plan.blocks[i].pairs))
    in_order = tuple(outcomes[i] for i in range(len(keys)))
    return Done(in_order, keys, len(plan.pairs) - kept, kept, time.perf_counter() - begun, memory)


def _pairs(blocks: Sequence[Block], which: Mapping[int, object]) -> int:
    return sum(len(blocks[i].pairs) for i in which)


def _without_files(outcome: BlockOutcome) -> BlockOutcome:
    """The outcome once its files are written, as its record gives it back."""
    return replace(outcome, pairs=tuple(replace(pair, files={}) if pair.files else pair for pair in outcome.pairs))
