"""Plan the source, fit its blocks on the engine, write the results."""

import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import pandas as pd

from ..core.errors import UsageError
from ..core.progress import Meter
from ..pipeline.options import FitOptions
from .engine import SERIAL, Run, engine, largest_memory
from .fitting.block import fit_block
from .outcomes import BlockOutcome, PairOutcome
from .output_folder import folder_names, prepare, sweep
from .pair_table import is_identity, read_pairs, with_groups
from .plan import BatchOptions, Block, Pair, Plan, Reading
from .records import as_json, key_of, record, recorded
from .result import Batch, Effort
from .site import check_card, site_of
from .source import existing_path, open_source
from .tables import FIGURES, csv_bytes, results_frame, tables_of, write_tables

MOST_ROWS = 250_000  # of a block: some tens of megabytes
MOST_PAIRS = {False: 2000, True: 16}  # of a block, without and with files: both take about as long
ENOUGH_ROWS = 5_000_000  # of a table without files: with fewer, processes take longer to start than they save
READS = {False: 4.0, True: 100.0}  # how often a source may be read; next to fits with files it costs nothing
WORK = Path(".batch", "source")


@dataclass(frozen=True, slots=True)
class FittedBlocks:
    """All blocks of a plan.

    Attributes
    ----------
    outcomes : tuple of BlockOutcome
        In the order of the blocks, without the bytes of files.
    keys : tuple of str
        Of their records.
    effort : Effort
    """

    outcomes: tuple[BlockOutcome, ...]
    keys: tuple[str, ...]
    effort: Effort


def run(
    source: str | os.PathLike[str],
    out: str | os.PathLike[str] | None = None,
    *,
    options: FitOptions | None = None,
    groups: Sequence[str] = (),
    pairs: str | os.PathLike[str] | None = None,
    files: bool = True,
    keep_draws: bool = False,
    site: bool = True,
    card: str | os.PathLike[str] | None = None,
    title: str | None = None,
    jobs: int = 1,
    dask: str | None = None,
    force: bool = False,
    command: str | None = None,
    meter: Meter | None = None,
) -> Batch:
    """Fit every pair of a source, and write results, parameter files, the comparison of families and the site of cards.

    Results that were finished before an interruption are kept: the same call continues. Numbers do not depend on
    ``jobs``, on ``dask`` or on the order in which blocks are finished.

    Parameters
    ----------
    source : path
        A folder of lab files, one lab file, a Parquet file or data set, or a text file of any size.
    out : path, optional
        ``./<source>-batch`` unless given.
    options : FitOptions, optional
        How the source is read and its pairs are fitted.
    groups : sequence of str
        Columns of the source that group the pairs.
    pairs : path, optional
        A table with columns tool, work and groups of the pairs.
    files : bool
        Make a parameter file for each pair; the table alone takes a hundredth of the time.
    keep_draws : bool
        Write the draws of each posterior too.
    site : bool
        Write the site of cards, where files are made.
    card : path, optional
        A card.toml for all pairs: licence, authors, machine.
    title : str, optional
        Of the site; `TITLE` of ``cards.publishing`` unless given.
    jobs : int
        Processes on this machine.
    dask : str, optional
        ``local``, or the address of a scheduler, whose workers find ``source`` and ``out`` under the same paths.
    force : bool
        Replace what an earlier batch wrote, and fit all again.
    command : str, optional
        Recorded in the parameter files.
    meter : Meter, optional
        Receives progress updates.

    Raises
    ------
    UsageError, DataError
        The source cannot be used at all; the folder belongs to another batch; the engine is not available; an option
        or the card is invalid.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> from fitmodels import batch, datasets
    >>> with TemporaryDirectory() as folder:
    ...     result = batch.run(datasets.bundled("gc435_709m40"), Path(folder, "out"), files=False)
    >>> result.results[["response", "nobs", "params_V"]].round(3).values.tolist()
    [['AW', 239, 0.533], ['Fxz', 239, -0.376], ['P', 239, 0.862]]
    """
    options, meter = options or FitOptions(), meter or Meter(0, "pairs")
    if options.correct or options.leave_out:
        given = "--correct" if options.correct else "--leave-out"
        raise UsageError(
            f"{given}: edges and lines are of one file; correct the file, or fit it alone: fitmodels FILE."
        )
    each = BatchOptions.of(options, files=files, keep_draws=keep_draws, command=command)
    reading = Reading(**options.reading(), groups=tuple(dict.fromkeys(groups)))
    source = existing_path(source)
    out = Path(out) if out is not None else Path(f"{source.stem}-batch")
    table = None if pairs is None else read_pairs(pairs)
    if card is not None:
        check_card(card)
    with prepare(out, source.name, each, force), engine(jobs, dask, meter.say) as workers:
        plan = _planned(source, reading, files, out, workers, meter, table)
        each = replace(each, **plan.reading.reading())  # names of tool and work that a long CSV has above its table
        folders = folder_names(plan.pairs) if files else {}
        blocks = fit_blocks(plan, each, out, folders, workers, meter)
        removed = sweep(out, set(blocks.keys))
        meter.say("comparing")
        tables = tables_of(plan, blocks.outcomes, table, workers)
        new = write_tables(out, tables, blocks.outcomes)
        report = site_of(out, card, title, jobs, meter, blocks.keys) if site and files else None
        published = report is not None and report.site is not None and not report.unchanged
    folders_made = {FIGURES: True, "pairs/": files, "site/": report is not None}
    return Batch(
        out=out,
        plan=plan,
        results=tables.results,
        attention=tables.attention,
        concerns=tables.concerns,
        comparison=tables.comparison,
        units={symbol: unit for one in blocks.outcomes for symbol, unit in one.units.items()},
        unreadable={**plan.unreadable, **{k: v for one in blocks.outcomes for k, v in one.unreadable.items()}},
        warnings=tables.warnings,
        effort=replace(blocks.effort, memory_here=largest_memory()),
        written=(*tables.files(), *(name for name, made in folders_made.items() if made and (out / name).is_dir())),
        changed=bool(blocks.effort.fitted or removed or new or published),
        site=report,
    )


def fit_blocks(
    plan: Plan, options: BatchOptions, out: Path, folders: Mapping[Pair, str], workers: Run, meter: Meter
) -> FittedBlocks:
    """Fit every block without a record in ``out``, and those with failures that may be temporary."""
    keys = tuple(key_of(block, plan, options) for block in plan.blocks)
    found = {i: recorded(out, key, folders) for i, key in enumerate(keys)}
    outcomes = {i: outcome for i, outcome in found.items() if outcome is not None and outcome.settled}
    todo = [i for i in range(len(keys)) if i not in outcomes]
    kept = sum(len(plan.blocks[i].pairs) for i in outcomes)
    meter.expect(len(plan.pairs))
    meter.skip(kept)
    meter.say("fitting")
    begun = time.perf_counter()
    memory = 0
    work = partial(_fitted, plan=replace(plan, blocks=(), unreadable={}), options=options)
    rows = sum(plan.blocks[i].rows for i in todo)
    run_on = workers.where(options.files or rows >= ENOUGH_ROWS) if len(todo) > 1 else SERIAL
    for at, (outcome, text) in run_on(work, [plan.blocks[i] for i in todo]):
        i = todo[at]
        record(out, keys[i], outcome, folders, text)
        memory = max(memory, outcome.memory)
        outcomes[i] = _without_files(outcome)
        meter.advance(len(plan.blocks[i].pairs))
    seconds = time.perf_counter() - begun
    effort = Effort(run_on.describe(), len(plan.pairs) - kept, kept, seconds, memory, largest_memory())
    return FittedBlocks(tuple(outcomes[i] for i in range(len(keys))), keys, effort)


def _fitted(block: Block, plan: Plan, options: BatchOptions) -> tuple[BlockOutcome, str]:
    """The outcome of a block, its part of the table, and the text of its record, by the process that has the task."""
    outcome = fit_block(block, plan, options)
    if not options.files:
        rows = results_frame(outcome.pairs, outcome.laws, plan.reading.groups)
        outcome = replace(outcome, csv=csv_bytes(rows))
    return outcome, as_json(outcome)


def _without_files(outcome: BlockOutcome) -> BlockOutcome:
    """The outcome once its files are written, as its record contains it."""
    return replace(outcome, pairs=tuple(replace(pair, files={}) if pair.files else pair for pair in outcome.pairs))


def _planned(
    source: Path, reading: Reading, files: bool, out: Path, workers: Run, meter: Meter, table: pd.DataFrame | None
) -> Plan:
    meter.say(f"reading {source.name}")
    plan = open_source(
        source, reading, most_rows=MOST_ROWS, most_pairs=MOST_PAIRS[files], reads=READS[files],
        work=(out / WORK).absolute(), report=meter.say, workers=workers,
    )  # fmt: skip
    return plan if table is None else _with_identity(plan, table)


def _with_identity(plan: Plan, table: pd.DataFrame) -> Plan:
    """The plan with those groups of the table of pairs that belong into the parameter files."""
    outcomes = with_groups([PairOutcome(pair.tool, pair.work, 0) for pair in plan.pairs], table)
    groups = [tuple((k, v) for k, v in one.groups.items() if v and is_identity(k)) for one in outcomes]
    known = dict(zip(plan.pairs, groups, strict=True))
    blocks = tuple(replace(block, identity=tuple(known[pair] for pair in block.pairs)) for block in plan.blocks)
    return replace(plan, blocks=blocks)
