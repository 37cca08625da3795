"""Signal of the highest contrast: means of blocks, smoothed, without short peaks, and their noise and reach."""

import numpy as np

from ...core.arrays import Array, Ints
from ...core.errors import DataError, UsageError
from .options import ReduceOptions
from .recording import Recording

Interval = tuple[int, int]
MEDIAN = 0.5  # s; shorter peaks are neither cut nor idle
SCATTERED = 0.3  # of the contrast of a standard deviation counts: the mean is preferred
QUIET = 25  # percentile of the scatter of the seconds of a record: those in the air


def block_means(values: Array, size: int) -> Array:
    """Means of blocks of ``size`` values, shape (n // size,); a block without a number takes the level before it."""
    if size == 1:
        out = np.array(values, dtype=np.float64)
    else:
        blocks = values[: len(values) // size * size].reshape(-1, size)
        out = blocks.mean(axis=1)
        for k in np.flatnonzero(np.isnan(out)):
            row = blocks[k][np.isfinite(blocks[k])]
            out[k] = row.mean() if row.size else np.nan
    lost = np.isnan(out)
    if lost.any() and not lost.all():
        places = np.maximum.accumulate(np.where(lost, 0, np.arange(len(out))))
        out = out[places]
        out[np.isnan(out)] = out[np.flatnonzero(np.isfinite(out))[0]]
    return out


def chosen_signal(
    recording: Recording, how: ReduceOptions, size: int, width: int, step: float
) -> tuple[str, Array, Array]:
    """The signal of the highest contrast, with and without its short peaks: the mean of a channel, or its scatter."""
    names = list(recording.channels)
    if how.channel is not None:
        if how.channel not in names:
            raise UsageError(f"--channel {how.channel}: {recording.name} has {', '.join(names)}.")
        names = [how.channel]
    found: list[tuple[float, str, Array, Array]] = []
    for name in names:
        values = recording.channels[name]
        if not np.isfinite(values).any():
            continue
        peaks = smoothed(block_means(values, size), width)
        load = without_peaks(peaks, step)
        found.append((_contrast(load, step), name, peaks, load))
        if size >= 4:
            peaks = smoothed(_block_sd(values, size), width)
            load = without_peaks(peaks, step)
            found.append((SCATTERED * _contrast(load, step), f"standard deviation of {name}", peaks, load))
    if not found:
        raise DataError(f"{recording.name}: {', '.join(names)} contain no numbers.")
    return max(found, key=lambda item: item[0])[1:]


def _block_sd(values: Array, size: int) -> Array:
    blocks = np.nan_to_num(values[: len(values) // size * size]).reshape(-1, size)
    return np.asarray(blocks.std(axis=1), dtype=np.float64)


def smoothed(values: Array, width: int) -> Array:
    """Moving mean over ``width`` values, shorter at the ends."""
    if width <= 1:
        return values
    total = np.concatenate([[0.0], np.cumsum(values - values[0])])
    first = np.maximum(np.arange(len(values)) - width // 2, 0)
    last = np.minimum(np.arange(len(values)) + (width + 1) // 2, len(values))
    return np.asarray((total[last] - total[first]) / (last - first) + values[0], dtype=np.float64)


def without_peaks(load: Array, step: float) -> Array:
    """Moving median over half a second."""
    from scipy.ndimage import median_filter

    size = 2 * round(MEDIAN / step / 2) + 1
    return load if size < 3 else np.asarray(median_filter(load, size=size, mode="nearest"), dtype=np.float64)


def noise_and_reach(load: Array, step: float) -> tuple[float, float]:
    """Noise of the quiet part, and largest step between half seconds: neither sees a slow drift."""
    size = max(4, round(1.0 / step))
    windows = load[: len(load) // size * size].reshape(-1, size)
    scatter = windows.std(axis=1) if len(windows) else load.std(keepdims=True)
    moving = scatter[scatter > 1e-9 * np.abs(load).max()]  # a dead or coarse signal is not a quiet one
    noise = float(np.percentile(moving, QUIET)) if moving.size else 0.0
    half = max(2, round(0.5 / step))
    means = smoothed(load, half)
    apart = 3 * half
    reach = float(np.abs(means[apart:] - means[:-apart]).max()) if len(means) > apart else float(np.ptp(means))
    return noise, reach


def _contrast(load: Array, step: float) -> float:
    """Reach over noise; less where the signal is dead for a part of the record."""
    noise, reach = noise_and_reach(load, step)
    dead = float(np.mean(np.diff(load) == 0))
    return (1 - dead) * reach / max(noise, 1e-3 * reach, 1e-300)


def widened(numbers: Ints, by: int) -> list[Interval]:
    """Runs of consecutive numbers as intervals [first, end), for messages and pictures; gaps up to ``by`` are closed.

    >>> widened(np.array([1, 2, 3, 9]), 1)
    [(1, 4), (9, 10)]
    """
    if not numbers.size:
        return []
    breaks = np.flatnonzero(np.diff(numbers) > by) + 1
    return [(int(part[0]), int(part[-1]) + 1) for part in np.split(numbers, breaks)]
