"""Outcomes of all blocks become the tables and pictures of a batch."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from ..core.progress import grouped
from .blocks_done import Done
from .law_table import below_each_other, numbered_anew
from .outcome import BlockOutcome, PairOutcome
from .plan import Plan
from .result.attention import Attention, attention_frame, attention_summary, with_families
from .result.comparison import Comparison, compare
from .result.place import claim, claimed, holds, put, retire
from .result.read_pairs import unknown_pairs, with_groups
from .result.table import csv_bytes, results_frame

PART = "Part of the source could not be read: a pair that has rows there too was fitted without them."
FIGURES = "figures/"


@dataclass(frozen=True, slots=True)
class Tables:
    """What the pairs say, each and together, and how many are simulated; the fields are those of `Batch`."""

    results: pd.DataFrame
    attention: pd.DataFrame
    comparison: Comparison
    concerns: tuple[Attention, ...]
    warnings: tuple[str, ...]
    simulated: int

    def files(self) -> dict[str, pd.DataFrame]:
        """The tables by the names of their files."""
        return {
            "results.csv": self.results,
            "attention.csv": self.attention,
            "comparison.csv": self.comparison.families,
            "pooled.csv": self.comparison.pairs,
        }


def tables_of(plan: Plan, done: Done, about: pd.DataFrame | None) -> Tables:
    """Gather the tables of a batch; ``about`` says what pairs belong to."""
    outcomes = [pair for block in done.outcomes for pair in block.pairs]
    warnings = [PART] if plan.unreadable else []
    if about is not None:
        strange = unknown_pairs(outcomes, about)
        warnings += [strange] if strange else []
        outcomes = list(with_groups(outcomes, about))
    groups = _groupings(outcomes, plan.reading.groups)
    results = results_frame(outcomes, laws_of(done.outcomes), groups)
    comparison = compare(results, groups)
    outcomes = with_families(outcomes, results, comparison.pairs)
    return Tables(
        results=results,
        attention=attention_frame(outcomes),
        comparison=comparison,
        concerns=tuple(attention_summary(outcomes)),
        warnings=tuple(warnings),
        simulated=sum(one.simulated for one in outcomes),
    )


def laws_of(blocks: Sequence[BlockOutcome]) -> pd.DataFrame:
    """The laws of all blocks, a pair by its number among the pairs of all."""
    first = np.cumsum([0, *(len(block.pairs) for block in blocks)])
    return below_each_other([
        numbered_anew(block.laws, np.arange(len(block.pairs)) + start)
        for block, start in zip(blocks, first, strict=False)
    ])  # fmt: skip


def write_tables(out: Path, tables: Tables) -> bool:
    """Write tables and pictures into ``out``, and take away pictures of laws that are gone; whether anything is new.

    Pictures come first: tables that are as they were say that their pictures are, too.
    """
    contents = {name: csv_bytes(frame) for name, frame in tables.files().items()}
    pictured = {name: contents[name] for name in ("comparison.csv", "pooled.csv")}
    if not (all(holds(out, name, content) for name, content in pictured.items()) and _stand(out, tables.comparison)):
        drawn = _drawn(out, tables)
        claim(out, drawn)
        retire(out, FIGURES, drawn)
    new = [put(out, name, content) for name, content in contents.items()]  # all of them
    return any(new)


def _groupings(outcomes: Sequence[PairOutcome], of_source: Sequence[str]) -> tuple[str, ...]:
    """Columns that group the pairs: those of the source first, then those of the table of pairs."""
    return tuple(dict.fromkeys((*of_source, *(name for one in outcomes for name in one.groups))))


def _stand(out: Path, comparison: Comparison) -> bool:
    """Whether the pictures that were drawn are all there."""
    made = claimed(out, FIGURES)
    return bool(made) == bool(len(comparison.families)) and all((out / name).is_file() for name in made)


def _drawn(out: Path, tables: Tables) -> list[str]:
    if not len(tables.comparison.families):
        return []
    from .result.draw import draw_comparison

    banner = f"{grouped(tables.simulated)} of these pairs simulated, not measured" if tables.simulated else ""
    return [f"{FIGURES}{path.name}" for path in draw_comparison(tables.comparison, out / FIGURES, banner)]
