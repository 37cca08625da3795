"""The whole way: a source is looked through, its blocks are fitted wherever, and everything is written."""

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TypeVar

import pandas as pd

from .blocks_done import Done, blocks_done
from .engine import Meter, Run, engine, largest_memory
from .fitting.groups import is_identity
from .how import How
from .made import Batch, Effort
from .outcome import PairOutcome
from .plan import Pair, Plan, Reading
from .result.place import folder_names, prepare, sweep
from .result.read_pairs import read_pairs, with_groups
from .site import TITLE, check_card, site_of
from .source import open_source, there
from .tables import FIGURES, tables_of, write_tables

T = TypeVar("T")
R = TypeVar("R")

MOST_ROWS = 250_000  # of a block: some tens of megabytes
QUICK, CAREFUL = 2000, 16  # pairs of a block: so many without files take as long as a few with them
READS = {False: 4.0, True: 100.0}  # how often a source may be read over: beside fits with files it costs nothing
WORK = Path(".batch", "source")


def run(
    source: str | os.PathLike[str],
    out: str | os.PathLike[str] | None = None,
    *,
    reading: Reading | None = None,
    how: How | None = None,
    jobs: int = 1,
    dask: str | None = None,
    pairs: str | os.PathLike[str] | None = None,
    site: bool = True,
    card: str | os.PathLike[str] | None = None,
    title: str = TITLE,
    force: bool = False,
    meter: Meter | None = None,
) -> Batch:
    """Fit every pair of a source, and write results, parameter files, the comparison of families and the site of cards.

    What was finished before an interruption is not fitted again: the same call goes on. Numbers do not depend on
    ``jobs``, on ``dask`` or on the order in which blocks are done.

    Parameters
    ----------
    source : path
        A folder of lab files, one lab file, a Parquet file or data set, or a text file of any size.
    out : path, optional
        ``./<source>-batch`` unless given.
    reading : Reading, optional
        How the source is read, and which of its columns group the pairs.
    how : How, optional
        How the pairs are fitted; ``How(files=False)`` makes the table only, in a hundredth of the time.
    jobs : int
        Processes on this machine.
    dask : str, optional
        ``local``, or the address of a scheduler, whose workers see ``source`` and ``out`` under the same paths.
    pairs : path, optional
        A table with columns tool, work and what the pairs belong to.
    site : bool
        Write the site of cards, where files are made.
    card : path, optional
        A card.toml that holds for all pairs: licence, authors, machine.
    title : str
        Of the site.
    force : bool
        Replace what an earlier batch wrote, and fit all again.
    meter : Meter, optional
        Hears how far it is.

    Raises
    ------
    UsageError, DataError
        The source cannot be used at all; the folder is another's; the engine cannot be had; an option or the card is
        impossible.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> from fitmodels import batch, datasets
    >>> with TemporaryDirectory() as place:
    ...     made = batch.run(datasets.bundled("gc435_709m40"), Path(place, "out"), how=batch.How(files=False))
    >>> made.results[["response", "nobs", "params_V"]].round(3).values.tolist()
    [['AW', 239, 0.533], ['Fxz', 239, -0.376], ['P', 239, 0.862]]
    """
    how, reading, meter = how or How(), reading or Reading(), meter or Meter(0, "pairs")
    source = there(source)
    how.check()
    place = Path(out) if out is not None else Path(f"{source.stem}-batch")
    table = None if pairs is None else read_pairs(pairs)
    if card is not None:
        check_card(card)
    with prepare(place, source.name, how, force), engine(jobs, dask, meter.say) as workers:
        plan = _planned(source, reading, how, place, workers, meter, table)
        folders = folder_names(plan.pairs) if how.files else {}
        done = blocks_done(plan, how, place, folders, workers, meter)
        removed = sweep(place, set(done.keys))
        meter.say("comparing")
        tables = tables_of(plan, done, table)
        new = write_tables(place, tables)
        report = site_of(place, card, title, jobs, meter, done.keys) if site and how.files else None
        published = report is not None and report.site is not None and not report.unchanged
        effort = Effort(
            workers.describe(), done.fitted, done.kept, done.seconds, done.memory, largest_memory() or 0
        )  # fmt: skip
    folders_made = {FIGURES: True, "pairs/": how.files, "site/": report is not None}
    return Batch(
        out=place,
        plan=plan,
        results=tables.results,
        attention=tables.attention,
        concerns=tables.concerns,
        comparison=tables.comparison,
        units={symbol: unit for one in done.outcomes for symbol, unit in one.units.items()},
        unreadable=_unreadable(plan, done),
        warnings=tables.warnings,
        effort=effort,
        written=(*tables.files(), *(name for name, made in folders_made.items() if made and (place / name).is_dir())),
        changed=bool(done.fitted or removed or new or published),
        site=report,
    )


def _planned(
    source: Path, reading: Reading, how: How, out: Path, workers: Run, meter: Meter, table: pd.DataFrame | None
) -> Plan:
    most = CAREFUL if how.files else QUICK
    meter.say(f"looking through {source.name}")
    plan = open_source(
        source, reading, most_rows=MOST_ROWS, most_pairs=most, reads=READS[how.files], work=(out / WORK).absolute(),
        told=meter.say, map_over=partial(_in_order, workers),
    )  # fmt: skip
    return plan if table is None else _with_identity(plan, table)


def _in_order(workers: Run, work: Callable[[T], R], tasks: Iterable[T]) -> Iterator[R]:
    """Results in the order of the tasks, each as soon as those before it are there."""
    waiting: dict[int, R] = {}
    following = 0
    for position, result in workers(work, tasks):
        waiting[position] = result
        while following in waiting:
            yield waiting.pop(following)
            following += 1


def _with_identity(plan: Plan, table: pd.DataFrame) -> Plan:
    """The plan with what the table of pairs says of them that belongs into their parameter files."""
    told = with_groups([PairOutcome(pair.tool, pair.work, 0) for pair in plan.pairs], table)
    known = {
        Pair(one.tool, one.work): tuple((k, v) for k, v in one.groups.items() if v and is_identity(k)) for one in told
    }
    blocks = tuple(replace(block, identity=tuple(known[pair] for pair in block.pairs)) for block in plan.blocks)
    return replace(plan, blocks=blocks)


def _unreadable(plan: Plan, done: Done) -> Mapping[str, str]:
    said = {one.name: one.reason for one in plan.unreadable}
    return said | {name: why for block in done.outcomes for name, why in block.unreadable.items()}
