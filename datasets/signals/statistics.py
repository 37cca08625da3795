"""Figures of a cut: mean, peak per revolution and standard deviation over its window, less the line of the zero."""

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Array
from .contrast import Interval, block_means
from .cuts import Cut
from .recording import Recording

FEWEST_A_TURN = 4  # samples; fewer do not show a peak within a revolution
WINDOW = 0.1  # s over which peaks are taken where the spindle speed is not known
FEWEST_A_WINDOW = 10  # samples of such a window
AVERAGED = 0.1  # s of air in a mean: whole periods of 50 and 60 Hz
FEWEST_MEANS = 3
PARTS = 10


@dataclass(frozen=True, slots=True)
class ZeroLine:
    """Straight line through the air before and after a cut: level at sample 0, and change per sample."""

    level: float
    slope: float

    def at(self, sample: float) -> float:
        """Level at a sample."""
        return self.level + self.slope * sample


@dataclass(frozen=True, slots=True)
class ChannelFigures:
    """Figures of one channel over the window of a cut, in the unit of the channel.

    Attributes
    ----------
    mean, sd : float
        Less the line of the zero.
    peak : float
        Mean of the largest values of the revolutions, or of windows of ``peak_window`` seconds.
    samples : int
        Samples with a value.
    se : float
        Standard error of the mean from parts of the window, with that of the zero; NaN where it is not known.
    before, after : float
        Level of the air; NaN where there is none.
    line : ZeroLine
    """

    mean: float
    sd: float
    peak: float
    samples: int
    se: float
    before: float
    after: float
    line: ZeroLine

    @property
    def idle(self) -> float:
        """Mean level of the air."""
        return float(np.nanmean([self.before, self.after])) if not np.isnan([self.before, self.after]).all() else 0.0

    @property
    def drift(self) -> float:
        """Change of the zero from before to after the cut; NaN where one is missing."""
        return self.after - self.before


def channel_figures(values: Array, cut: Cut, turn: float, step: float) -> ChannelFigures:
    """Figures of a channel, shape (n,), over the window of a cut.

    ``turn`` is the length of a peak window in samples, ``step`` the sample time in s. The sign is that of
    the load: where the mean is negative, the peak is the lowest value.
    """
    line, before, after = zero_line(values, cut, step)
    first, end = cut.window
    part = values[first:end] - line.level - line.slope * np.arange(first, end)
    known = np.isfinite(part)
    count = int(np.count_nonzero(known))
    if not count:
        return ChannelFigures(np.nan, np.nan, np.nan, 0, np.nan, before, after, line)
    if _lost(values, cut, line):
        return ChannelFigures(np.nan, np.nan, np.nan, 0, np.nan, before, after, line)
    full = part if count == len(part) else part[known]
    mean, sd = float(full.mean()), float(full.std(ddof=1)) if count > 1 else np.nan
    sign = 1.0 if mean >= 0 else -1.0
    se = _standard_error(full, [values[a:b] for a, b in (cut.before, cut.after)])
    return ChannelFigures(mean, sd, sign * _peak(sign * part, turn), count, se, before, after, line)


def zero_line(values: Array, cut: Cut, step: float) -> tuple[ZeroLine, float, float]:
    """Line through the means of the air before and after a cut, and these means; level 0 where there is no air."""
    (level_0, at_0), (level_1, at_1) = _air(values, cut.before, step), _air(values, cut.after, step)
    if np.isnan(level_0) and np.isnan(level_1):
        return ZeroLine(0.0, 0.0), level_0, level_1
    if np.isnan(level_0) or np.isnan(level_1):
        return ZeroLine(level_1 if np.isnan(level_0) else level_0, 0.0), level_0, level_1
    slope = (level_1 - level_0) / (at_1 - at_0)
    return ZeroLine(level_0 - slope * at_0, slope), level_0, level_1


def _air(values: Array, air: Interval, step: float) -> tuple[float, float]:
    """Median of the means of a few periods of the mains, and the middle: an axis moving in the air hardly counts."""
    part = values[air[0] : air[1]]
    size = max(1, min(round(AVERAGED / step), len(part) // FEWEST_MEANS))
    means = block_means(part, size) if part.size else part
    known = means[np.isfinite(means)]
    return (float(np.median(known)) if known.size else np.nan), (air[0] + air[1] - 1) / 2


def _lost(values: Array, cut: Cut, line: ZeroLine) -> bool:
    """Whether a channel is constant in the window, and at the level of the air: its signal is lost."""
    part = values[cut.window[0] : cut.window[1]]
    if np.nanmin(part) != np.nanmax(part):
        return False
    air = np.concatenate([values[a:b] for a, b in (cut.before, cut.after)])
    reach = float(np.nanmax(np.abs(air - np.nanmedian(air)))) if air.size else 0.0
    return bool(abs(np.nanmedian(part) - line.at(sum(cut.window) / 2)) <= reach)


def _standard_error(part: Array, airs: list[Array]) -> float:
    """Of the mean of a window less the zero, from the means of ten parts of each; a trend within them is taken out."""
    known = [air for air in airs if len(air) >= PARTS]
    squares = [batch_variance(air) for air in known]
    zero = sum(squares) / len(squares) ** 2 if squares else 0.0
    return float(np.sqrt(batch_variance(part) + zero)) if len(part) >= PARTS else np.nan


def batch_variance(part: Array) -> float:
    """Variance of the mean of a signal, shape (n,), by differences of the means of ten parts."""
    means = block_means(part, len(part) // PARTS)[:PARTS]
    return float(np.nanmean(np.diff(means) ** 2) / 2 / PARTS)


def _peak(part: Array, turn: float) -> float:
    """Mean of the largest value of each whole turn, shape (n,) in samples."""
    turns = int(len(part) / turn)
    if turns < 1:
        return float(np.nanmax(part))
    starts = np.floor(turn * np.arange(turns)).astype(np.intp)
    largest = np.fmax.reduceat(part[: int(turn * turns)], starts)
    return float(np.nanmean(largest))


def peak_window(recording: Recording, n: float | None) -> tuple[float, str]:
    """Length of the windows whose largest values are the peak, in samples, and its name.

    Parameters
    ----------
    recording : Recording
    n : float or None, 1/min
    """
    if n is not None and n > 0:
        turn = 60 / n / recording.sample_time
        if turn >= FEWEST_A_TURN:
            return turn, "revolution"
    seconds = max(WINDOW, FEWEST_A_WINDOW * recording.sample_time)
    return seconds / recording.sample_time, f"{seconds:.3g} s"
