"""Which rows of a block a law can use; every row that is left out is counted, and the first of them named."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..rows import Dropped
from .blocks import Block, Index, Names

Array = NDArray[np.float64]

NAMED = 5  # rows of each reason that are named


@dataclass(frozen=True, slots=True)
class Usable:
    """Rows that are used: response and factors as they are (m, 1 + k), edge and level of each."""

    values: Array
    edge: Index | None
    level: Index | None


@dataclass(slots=True)
class Sieve:
    """Leaves out rows for the reasons, and in the order, of a fit in memory."""

    names: Sequence[str]
    by: str | None
    counts: dict[str, int] = field(default_factory=dict)
    lines: dict[str, list[int]] = field(default_factory=dict)

    def usable(self, block: Block, levels: Names) -> Usable:
        """Rows of the block in which everything is there and above zero."""
        values = np.column_stack(block.columns)
        bad = [(f"{name} missing", np.isnan(values[:, j])) for j, name in enumerate(self.names)]
        if block.level is not None:
            bad.append((f"{self.by} missing", np.asarray(block.level == levels.numbers.get("", -1))))
        bad += [(f"{name} zero or negative", values[:, j] <= 0) for j, name in enumerate(self.names)]
        keep = np.ones(len(block), dtype=bool)
        for reason, rows in bad:
            self._count(reason, block.first, rows & keep)
            keep &= ~rows
        if keep.all():
            return Usable(values, block.edge, block.level)
        return Usable(
            values[keep],
            None if block.edge is None else block.edge[keep],
            None if block.level is None else block.level[keep],
        )

    def dropped(self) -> tuple[Dropped, ...]:
        """What was left out, reason by reason."""
        return tuple(
            Dropped(reason, count, tuple(self.lines[reason])) for reason, count in self.counts.items() if count
        )

    def _count(self, reason: str, first: int, rows: NDArray[np.bool_]) -> None:
        self.counts.setdefault(reason, 0)  # so that reasons keep their order
        if not rows.any():
            return
        found = self.lines.setdefault(reason, [])
        self.counts[reason] += int(rows.sum())
        found += (first + np.flatnonzero(rows)[: NAMED - len(found)]).tolist()
