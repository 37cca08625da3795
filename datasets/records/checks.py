"""What a record's numbers say against it, in words: an input that does not move, a signal that ran into a limit."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FLAT = 4  # samples in a row at the extreme: fewer come by chance where readings are coarse
STEEP = 4.0  # quanta a sample: a signal that settles at its extreme comes in slower than that
REACH = 6.0  # quanta by which the signal would have passed the extreme, had it gone on for half the flat time
LEVELS = 16  # a signal of no more distinct values steps between levels, and stands on each by intent


def findings(name: str, values: Array, unit: str = "") -> tuple[str, ...]:
    """What is odd about one signal, shape (n,): it is constant, or looks clipped.

    >>> findings("u", np.ones(50))
    ('u is constant at 1: nothing moves, so nothing can be learned from it',)
    """
    low, high = float(values.min()), float(values.max())
    tail = f" {unit}" if unit else ""
    if low == high:
        return (f"{name} is constant at {low:g}{tail}: nothing moves, so nothing can be learned from it",)
    if _is_staircase(values):
        return ()
    out = []
    for extreme, which in ((high, "largest"), (low, "smallest")):
        places, samples = clipped(values, extreme)
        if places:
            out.append(
                f"{name} looks clipped: {places} time(s) it runs into its {which} value {extreme:g}{tail} and stays "
                f"there, {samples} samples in all. A linear model knows no limits: lower the level, or widen the range"
            )
    return tuple(out)


def clipped(values: Array, extreme: float) -> tuple[int, int]:
    """How often a signal, shape (n,), runs straight into its extreme value and stays there, and for how many samples.

    Coarse readings stand still at the crest of every slow sine, and a settled machine stands still too. Neither
    comes in with a slope that would have carried it well past the extreme.

    >>> wave = np.sin(np.arange(200) / 5)
    >>> clipped(wave.round(2), 1.0), clipped(np.minimum(wave, 0.7), 0.7)[0]
    ((0, 0), 7)
    """
    sign = 1.0 if extreme >= values.max() else -1.0
    at = np.concatenate([[False], values == extreme, [False]])
    begins, ends = np.flatnonzero(~at[:-1] & at[1:]), np.flatnonzero(at[:-1] & ~at[1:])
    lengths = ends - begins
    steps = np.abs(np.diff(values))
    quantum = float(steps[steps > 1e-9 * np.ptp(values)].min())
    before = np.maximum(begins - 3, 0)
    slope = sign * (extreme - values[before]) / np.maximum(begins - before, 1)
    hit = (lengths >= FLAT) & (begins > 0) & (slope > STEEP * quantum) & (slope * lengths / 2 > REACH * quantum)
    return int(hit.sum()), int(lengths[hit].sum())


def _is_staircase(values: Array) -> bool:
    """Whether a signal steps between levels: few of them, or mostly standing still off its extremes."""
    inner = (values[1:] > values.min()) & (values[1:] < values.max())
    if not inner.any() or np.count_nonzero(np.diff(values)[inner] == 0) > 0.5 * np.count_nonzero(inner):
        return True
    some = values[:: max(1, len(values) // 10_000)]
    return len(np.unique(some)) <= LEVELS and len(np.unique(values)) <= LEVELS
