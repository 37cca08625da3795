"""Faults of a signal in a cut, each a sentence: saturation, lost signal, gaps, mains ripple, drift, no air."""

from collections.abc import Mapping

import numpy as np

from ...core.arrays import Array
from ...core.rounding import count
from .contrast import Interval, block_means, widened
from .cuts import Cut
from .recording import Recording
from .statistics import ChannelFigures

CLIPPED = 0.002  # share of the samples of a window at the largest value of the record
RUN = 4  # samples in a row at the extreme
FEWEST_PEAKS, PILED_UP = 20, 8  # samples at the extreme, and how often those of the next level, where runs are shorter
FAR = 0.5  # of the largest size in the record
CONSTANT = 0.002  # share of the window in which the signal does not change
LEVELS = 16  # a signal of no more distinct values is coarse, not clipped
GAPS = 0.001  # share of the window without a value
RIPPLE = 0.05  # amplitude of the mains in the air, as a share of the mean
DRIFT = 0.1  # drift of the zero over the cut, as a share of the mean
STEADY = 0.3  # change from the first to the last third of the window, as a share of the mean
SCATTER = 0.25  # standard deviation of the means of revolutions, as a share of the mean
FEWEST_TURNS = 8
LOW = 0.5  # of the mean
UNCERTAIN = 0.01  # standard error, as a share of the mean
CYCLES = 10  # periods of the mains that the air must hold
MOST = 2_000_000  # samples of a window that are examined


def cut_faults(name: str, recording: Recording, cut: Cut, figures: ChannelFigures, turn: float, unit: str) -> list[str]:
    """Remarks on one channel in one cut; ``turn`` is the length of a revolution or of 0.1 s, in samples."""
    values = recording.channels[name]
    part = values[cut.window[0] : min(cut.window[1], cut.window[0] + MOST)]
    out = [*_gaps(name, part, recording.sample_time)]
    known = part[np.isfinite(part)]
    if not known.size:
        return out
    if np.isnan(figures.mean):
        return [*out, f"{name} is constant at the level of the air, {known[0]:.4g} {unit}: signal lost, left out"]
    out += _stuck(name, known, values, recording.sample_time, unit)
    out += _zero(name, figures, unit) + _uncertain(name, figures, unit)
    out += _ripple(name, recording, cut, figures, unit)
    out += _unsteady(name, known, figures, unit)
    return out + _scattered(name, known, figures, turn, unit)


def air_faults(cut: Cut, levels: Mapping[str, float]) -> list[str]:
    """Remarks on missing air before or after a cut, and on an idle level that exceeds the load."""
    missing = [word for word, (a, b) in (("before", cut.before), ("after", cut.after)) if b <= a]
    out = []
    if abs(levels["idle"]) > abs(levels["cut"]):
        out.append(
            f"the idle level {levels['idle']:.4g} is farther from zero than the cut, {levels['cut']:.4g}: offset of "
            "the amplifier, or air taken for the cut?"
        )
    if len(missing) == 2:
        return [*out, "no air before or after the cut: the zero is not removed"]
    return [*out, *(f"no air {word} the cut: the drift of the zero is not removed" for word in missing)]


def _gaps(name: str, part: Array, step: float) -> list[str]:
    lost = np.isnan(part)
    if lost.mean() <= GAPS:
        return []
    places = len(widened(np.flatnonzero(lost), 1))
    gaps, share = count(places, "gap"), 100 * lost.mean()
    return [f"{name}: {step * np.count_nonzero(lost):.2g} s in {gaps} without a value ({share:.1f} %)"]


def _stuck(name: str, known: Array, values: Array, step: float, unit: str) -> list[str]:
    """Saturated at the extreme of the record, or constant elsewhere."""
    runs = widened(np.flatnonzero(np.diff(known) == 0), 1)
    if not runs:
        return []
    lengths = np.array([b - a + 1 for a, b in runs])
    levels = known[[a for a, _ in runs]]
    if len(np.unique(known[:: max(1, len(known) // 10_000)])) <= LEVELS:
        if lengths.max() >= 0.9 * len(known):
            return [f"{name} does not change from {levels[lengths.argmax()]:.4g} {unit}: saturated, lost or too coarse"]
        return []
    out = []
    for extreme, word in ((np.nanmax(values), "largest"), (np.nanmin(values), "smallest")):
        held = int(lengths[(levels == extreme) & (lengths >= RUN)].sum())
        if abs(extreme) > FAR * np.nanmax(np.abs(values)):  # near zero, teeth are out of the work
            held = max(held, _piled_up(known, extreme))
        if held > CLIPPED * len(known):
            out.append(
                f"{name} is saturated: {100 * held / len(known):.2g} % of the samples are at its {word} value "
                f"{extreme:.4g} {unit}; mean and peak are too small"
            )
    longest = int(lengths.argmax())
    usual = float(np.percentile(lengths, 95))
    if not out and lengths[longest] > max(20, CONSTANT * len(known), 10 * usual * (len(lengths) > 20)):
        out.append(
            f"{name} is constant at {levels[longest]:.4g} {unit} for {step * lengths[longest]:.2g} s: signal lost?"
        )
    return out


def _piled_up(known: Array, extreme: float) -> int:
    """Samples at the extreme, where they are many times those of the next level, as peaks of teeth that are cut off.

    Of a sine in equal steps the outermost one holds 2.4 times the samples of the next.
    """
    held, others = int(np.count_nonzero(known == extreme)), known[known != extreme]
    if held < FEWEST_PEAKS or not others.size:
        return 0
    next_level = others.max() if extreme > others[0] else others.min()
    return held if held > PILED_UP * np.count_nonzero(others == next_level) else 0


def _zero(name: str, figures: ChannelFigures, unit: str) -> list[str]:
    if np.isfinite(figures.drift) and abs(figures.drift) > DRIFT * abs(figures.mean):
        share = 100 * abs(figures.drift / figures.mean)
        return [f"{name}: the zero drifts by {figures.drift:.3g} {unit} over the cut, {share:.0f} % of the mean"]
    return []


def _uncertain(name: str, figures: ChannelFigures, unit: str) -> list[str]:
    if figures.se > UNCERTAIN * abs(figures.mean):
        share = 100 * figures.se / max(abs(figures.mean), 1e-300)
        return [f"{name}: noise makes the mean {figures.mean:.4g} {unit} uncertain, standard error {share:.2g} %"]
    return []


def _ripple(name: str, recording: Recording, cut: Cut, figures: ChannelFigures, unit: str) -> list[str]:
    """Amplitude of 50 and 60 Hz in the longer stretch of air."""
    air = max(cut.before, cut.after, key=_length)
    part = recording.channels[name][air[0] : air[1]]
    out = []
    for frequency in (50.0, 60.0):
        period = 1 / (frequency * recording.sample_time)
        n = int(int(len(part) / period) * period)
        if period < 2.5 or n < CYCLES * period or not np.isfinite(part[:n]).all():
            continue
        held = part[:n] - part[:n].mean()
        phase = 2j * np.pi * frequency * recording.sample_time * np.arange(n)
        amplitude = 2 * abs(np.mean(held * np.exp(phase)))
        dominant = amplitude**2 / 2 > 0.2 * held.var()
        if amplitude > RIPPLE * abs(figures.mean) and dominant:
            share = 100 * amplitude / abs(figures.mean)
            out.append(
                f"{name}: ripple of {frequency:g} Hz, {amplitude:.2g} {unit} in the air, {share:.0f} % of the mean: "
                "the peak contains it"
            )
    return out


def _unsteady(name: str, known: Array, figures: ChannelFigures, unit: str) -> list[str]:
    third = len(known) // 3
    if not third:
        return []
    first, last = float(known[:third].mean()), float(known[-third:].mean())
    if abs(last - first) > STEADY * abs(figures.mean) and abs(last - first) > 3 * figures.sd / np.sqrt(third):
        return [f"{name} changes from {first:.4g} to {last:.4g} {unit} within the cut"]
    return []


def _scattered(name: str, known: Array, figures: ChannelFigures, turn: float, unit: str) -> list[str]:
    """A load whose revolutions differ: not one cut, or one that is interrupted."""
    size = max(1, round(turn))
    means = block_means(known, size) - figures.idle
    low = np.count_nonzero(means * np.sign(figures.mean) < LOW * abs(figures.mean))
    if 0 < low < LOW * len(means):
        return [f"{name} falls below half of its mean for {100 * low / len(means):.2g} % of the cut"]
    if len(means) >= FEWEST_TURNS and means.std() > SCATTER * abs(figures.mean):
        share = 100 * float(means.std()) / max(abs(figures.mean), 1e-300)
        return [f"{name} is not steady: its revolutions scatter by {share:.0f} % of the mean {figures.mean:.4g} {unit}"]
    return []


def _length(air: Interval) -> int:
    return air[1] - air[0]
