"""Disturbances of a record: spikes, jumps, held readings, missing samples, drift, lines, nonlinearity, quantisation.

Spikes are replaced in the record; drift and lines are additional regressors of the output; the others cannot be
removed and are reservations. Records of more than 4000 samples are tested on their middle part, spikes on all samples.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..core.arrays import Array, Ints
from ..core.display import Display, Displayable
from ..core.rounding import format_plain as plain
from ..core.verdict import DO_NOT_USE, RESERVATIONS, USABLE
from ..datasets.records.reading import clipped as runs_into
from ..datasets.records.record import Record
from .additive_disturbances import (
    additional_columns,
    amplitudes,
    drift_and_lines,
    drift_of_longest,
    origins_of_line,
    relative_size,
)
from .estimators.high_order_arx import EXACT, LongArx, input_lags, long_arx, middle, offsets_of, order_of, spread
from .outliers import JUMP, MOST_SPIKES, held, innovations, jumps, repeats, skips, without_spikes
from .static_nonlinearity import Nonlinearity, clipped, nonlinearity, quantum

RELEVANT = 0.02  # of the standard deviation of y: smaller drift and lines are named without a reservation
NARROW = 0.02  # of half the range of u: smaller dead zones and backlash are named without a reservation
FEWEST_STEPS = 20  # of a quantised output over its range
COARSE = 0.5  # standard deviation of the rounding per standard deviation of the innovations
CHECKED = "Spikes, jumps, held readings, missing samples, drift, lines and nonlinearity"
CLIPPED_TWICE = 2  # times that an output comes in with a slope and is held at its extreme: not by chance
SHOWN = 6  # samples of spikes that are named


@dataclass(frozen=True, slots=True)
class Disturbance:
    """One disturbance of a record.

    Attributes
    ----------
    kind : str
        ``spikes``, ``heavy tails``, ``jump``, ``drift``, ``line``, ``dead zone``, ``backlash``, ``saturation``,
        ``curvature``, ``held output``, ``slow sensor``, ``missing samples``, ``quantisation``, or ``clipped output``.
    size : float
        In ``unit``: amplitude of a line, range of a drift, largest spike or jump, width of a dead zone, level of a
        saturation, number of missing samples or of equal readings.
    unit : str
    place : str
        Samples, frequency or range of the input.
    sentence : str
        Description with what was done and what to do.
    level : int
        Of the verdict: 0 named only, 1 reservations, 2 do not use.
    """

    kind: str
    size: float
    unit: str
    place: str
    sentence: str
    level: int = RESERVATIONS


@dataclass(frozen=True, slots=True, repr=False)
class Disturbances(Displayable):
    """Disturbances of a record, and the additional regressors for drift and lines.

    Attributes
    ----------
    found : tuple of Disturbance
    record : Record
        The record with spikes replaced.
    lines : tuple of float
        Frequencies in Hz of sine and cosine columns.
    drift : int
        Degree of the polynomial in time; 0 for none.
    replaced : ndarray of int
        Samples of the output that were replaced.
    remark : str or None
        Reason why nothing was tested.
    nonlinearity : Nonlinearity or None
        Of the input.
    """

    found: tuple[Disturbance, ...]
    record: Record
    lines: tuple[float, ...] = ()
    drift: int = 0
    replaced: Ints = field(default_factory=lambda: np.empty(0, dtype=np.intp))
    remark: str | None = None
    nonlinearity: Nonlinearity | None = None

    def _display(self) -> Display:
        head = ", ".join(item.kind for item in self.found) or self.remark or "no disturbance found"
        return Display(head, sentences=tuple(item.sentence for item in self.found))

    @property
    def reservations(self) -> tuple[tuple[int, str], ...]:
        """Level and sentence of each disturbance that lowers the verdict."""
        return tuple((item.level, item.sentence) for item in self.found if item.level > USABLE)

    @property
    def linear(self) -> Record | None:
        """The record with the input that acts behind the nonlinearity; None without one."""
        if self.nonlinearity is None:
            return None
        raw = self.record.u + offsets_of(self.record)[:, 0]
        return replace(self.record, u=self.nonlinearity.acting(self.record, raw), sha256=None).centred()

    @property
    def columns(self) -> Array | None:
        """Additional regressors (N, k) of the output; None without drift and lines."""
        return self.columns_of(self.record)

    @property
    def count(self) -> int:
        """Number of additional regressors."""
        return len(self.record.starts) * (self.drift + 2 * len(self.lines))

    def without_drift(self) -> "Disturbances":
        """The same without its drift, where the plant explains it."""
        return replace(self, drift=0, found=tuple(item for item in self.found if item.kind != "drift"))

    def columns_of(self, rec: Record) -> Array | None:
        """The same columns for another record of the same rate."""
        return additional_columns(rec, self.lines, self.drift) if self.lines or self.drift else None


def disturbances(rec: Record, *, closed: bool = False) -> Disturbances:
    """Disturbances of a record.

    Parameters
    ----------
    rec : Record
    closed : bool
        A controller was active, as in a record with its reference: its input responds to the output within the sample.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> u = np.repeat(rng.standard_normal(75), 10)
    >>> y = np.convolve(u, 0.2 * 0.8 ** np.arange(40))[:750] + 0.02 * rng.standard_normal(750)
    >>> y += 0.1 * np.sin(2 * np.pi * 7.3 * 0.02 * np.arange(750))
    >>> y[300] += 1.0
    >>> [(item.kind, item.place) for item in disturbances(Record(u=u, y=y, sample_time=0.02)).found]
    [('spikes', 'sample 301'), ('line', '7.3 Hz')]
    """
    order = order_of(rec)
    if not order:
        return Disturbances((), rec, remark=f"{len(rec)} samples are too few")
    if (every := repeats(rec)) > 1:
        slow = _of_slow_sensor(rec, every)
        return Disturbances((slow, *_of_missing_samples(rec)), rec, remark=f"{rec.output} repeats its readings")
    least = int(closed or rec.reference is not None)
    clean, replaced, heavy = _spikes(rec, order, least)
    part = middle(clean)
    fit = long_arx(part, order, input_lags(part, order, least))
    static = [*_of_missing_samples(rec), *_of_quantum(rec, fit), *(_of_clipping(rec) or _of_held(rec, fit))]
    clean = replace(rec, y=clean.y + offsets_of(clean)[:, 1] - offsets_of(rec)[:, 1], sha256=rec.sha256)
    if fit.rss <= EXACT * float(part.y @ part.y):
        return Disturbances(tuple(static), clean, remark="the record has no noise")
    drift, lines, whole = drift_and_lines(part, fit)
    found = None
    if all(item.level < DO_NOT_USE for item in static):  # a sensor at its end resembles backlash
        found = _static(spread(clean), order, least, lines, drift, whole if len(part) == len(rec) else None)
    named = [
        *_of_spikes(rec, clean, replaced, heavy),
        *_of_jumps(clean, fit),
        *_of_drift(part, whole, drift),
        *_of_lines(part, whole, lines, drift),
    ]
    named += [*_of_nonlinearity(rec, found), *static]
    return Disturbances(tuple(named), clean, lines, drift, replaced, nonlinearity=found)


def _spikes(rec: Record, order: int, least_lag: int) -> tuple[Record, Ints, bool]:
    """The centred record with spikes replaced, their samples, and whether outliers are too many to be spikes.

    A nonlinearity of the input leaves innovations that resemble spikes; where there is one, spikes are those that
    remain with it in the model.
    """
    rec = rec.centred()
    clean, replaced, heavy = without_spikes(rec, order, least_lag)
    if not (replaced.size or heavy):
        return clean, replaced, heavy
    part = spread(rec)
    fit = long_arx(part, order, input_lags(part, order, least_lag))
    found = nonlinearity(fit, part, part.u + offsets_of(part)[:, 0], np.empty((len(part), 0)))
    if found is None:
        return clean, replaced, heavy
    acting = found.acting(rec, rec.u + offsets_of(rec)[:, 0])
    clean, replaced, heavy = without_spikes(replace(rec, u=acting).centred(), order, least_lag)
    return replace(clean, u=rec.u, offsets=rec.offsets), replaced, heavy


def _static(
    rec: Record, order: int, least_lag: int, lines: tuple[float, ...], drift: int, fit: LongArx | None
) -> Nonlinearity | None:
    """Nonlinearity of the input, tested with drift and lines; ``fit`` is their regression on this record, if known."""
    additional = additional_columns(rec, lines, drift)
    fit = fit or long_arx(rec, order, input_lags(rec, order, least_lag), additional)
    return nonlinearity(fit, rec, rec.u + offsets_of(rec)[:, 0], additional)


def _unit(unit: str) -> str:
    return f" {unit}" if unit else ""


def _of_spikes(rec: Record, clean: Record, at: Ints, heavy: bool) -> list[Disturbance]:
    if heavy:
        words = (
            f"more than {100 * MOST_SPIKES:.0f} % of the samples of {rec.output} are outliers of its noise, too many "
            "to replace: check the sensor and its wiring, and record again"
        )
        return [Disturbance("heavy tails", float("nan"), rec.unit_y, "all samples", words)]
    if not at.size:
        return []
    largest = float(np.abs(rec.y[at] - clean.y[at]).max())
    place = _shown(at)
    words = (
        f"the output {rec.output} has spikes of up to {plain(largest, 3)}{_unit(rec.unit_y)} at {len(at)} of "
        f"{len(rec)} samples ({place}); they were replaced by values consistent with the other samples: check "
        "shielding and contacts of the sensor"
    )
    return [Disturbance("spikes", largest, rec.unit_y, place, words)]


def _of_jumps(rec: Record, fit: LongArx) -> list[Disturbance]:
    e = innovations(rec, fit)
    at = jumps(e, JUMP[1] * float(np.std(rec.y)))
    if not at.size:
        return []
    largest, place = float(np.abs(e[at]).max()), _shown(at)
    words = (
        f"the output {rec.output} jumps by up to {plain(largest, 2)}{_unit(rec.unit_y)} at {place}, which neither "
        f"{rec.input} nor the noise of the other samples explains: the load or the offset of the sensor changed there, "
        "or samples are missing. Record again, or identify what is before and after it separately"
    )
    return [Disturbance("jump", largest, rec.unit_y, place, words)]


def _of_missing_samples(rec: Record) -> list[Disturbance]:
    found = skips(rec.u, rec.stretches)
    if not found:
        return []
    place, most = _shown([k for k, _ in found]), max(n for _, n in found)
    words = (
        f"the input {rec.input}, smooth elsewhere, continues at {place} as if up to {most} samples before it were "
        "missing, though the times go on: the acquisition loses samples. Record again, with times from its clock"
    )
    return [Disturbance("missing samples", float(most), "", place, words)]


def _of_slow_sensor(rec: Record, every: int) -> Disturbance:
    rate = rec.rate / every
    words = (
        f"the sensor of {rec.output} gives a new reading every {every} samples only: the model has up to "
        f"{plain(1 / rate, 2)} s of delay from that. Read it faster, or resample at its rate (--resample {rate:.4g})"
    )
    return Disturbance("slow sensor", float(every), "", "all samples", words)


def _of_held(rec: Record, fit: LongArx) -> list[Disturbance]:
    found = held(rec, float(np.sqrt(fit.rss / max(fit.free, 1))))
    if not found:
        return []
    place, most = _shown([k for k, _ in found]), max(n for _, n in found)
    words = (
        f"the output {rec.output} has up to {most} equal readings in a row from {place} on, while {rec.input} changes "
        "and its other readings differ: the sensor or the acquisition held its value, or the machine stood still. "
        "Record again, or leave these samples out"
    )
    return [Disturbance("held output", float(most), "", place, words)]


def _shown(at: Sequence[int] | Ints) -> str:
    """Numbers of samples, counted from 1."""
    more = f" and {len(at) - SHOWN} more" if len(at) > SHOWN else ""
    return f"sample{'s' * (len(at) > 1)} {', '.join(str(k + 1) for k in at[:SHOWN])}{more}"


def _of_drift(rec: Record, fit: LongArx, drift: int) -> list[Disturbance]:
    if not drift:
        return []
    size, count = drift_of_longest(rec, fit, drift)
    if size is None:
        return []
    relative, time = relative_size(size, rec), count * rec.sample_time
    words = (
        f"the output {rec.output} drifts by {plain(size, 2)}{_unit(rec.unit_y)} within {plain(time)} s "
        f"({100 * relative:.0f} % of its standard deviation), estimated simultaneously with the plant as a polynomial "
        f"of degree {drift}: warm up the machine, or correct the offset of the sensor before each run"
    )
    return [Disturbance("drift", size, rec.unit_y, "whole record", words, _level(relative))]


def _level(relative: float) -> int:
    return RESERVATIONS if relative >= RELEVANT else USABLE


def _of_lines(rec: Record, fit: LongArx, lines: tuple[float, ...], drift: int) -> list[Disturbance]:
    out = []
    for f, size in zip(lines, amplitudes(rec, fit, lines, drift), strict=True):
        relative = relative_size(size, rec)
        words = (
            f"the output {rec.output} has a line at {f:.4g} Hz of amplitude {plain(size, 2)}{_unit(rec.unit_y)} "
            f"({100 * relative:.0f} % of its standard deviation), estimated simultaneously with the plant. "
            f"{origins_of_line(f, rec.rate)}"
        )
        out.append(Disturbance("line", size, rec.unit_y, f"{f:.4g} Hz", words, _level(relative)))
    return out


def _of_nonlinearity(rec: Record, found: Nonlinearity | None) -> list[Disturbance]:
    if found is None:
        return []
    place, words = {
        "dead zone": _dead_zone,
        "backlash": _backlash,
        "saturation": _saturation,
        "curvature": _curvature,
    }[found.kind](rec, found)
    low, high = found.low, found.high
    size = {"dead zone": high - low, "backlash": high, "saturation": high if np.isfinite(high) else low}
    narrow = found.kind in ("dead zone", "backlash") and size[found.kind] < NARROW * float(np.ptp(rec.u)) / 2
    level = USABLE if narrow else RESERVATIONS
    return [Disturbance(found.kind, size.get(found.kind, found.change), rec.unit_u, place, words, level)]


def _dead_zone(rec: Record, found: Nonlinearity) -> tuple[str, str]:
    place = f"{rec.input} from {plain(found.low, 3)} to {plain(found.high, 3)}{_unit(rec.unit_u)}"
    return place, (
        f"dead zone: {rec.output} does not respond to {place} ({100 * found.beyond:.0f} % of the samples), so that "
        "gain and delay depend on the amplitude: record with the amplitude of the controller, or away from this range"
    )


def _backlash(rec: Record, found: Nonlinearity) -> tuple[str, str]:
    place = f"reversals of {rec.input}"
    return place, (
        f"backlash of {plain(found.high, 3)}{_unit(rec.unit_u)} at {place}, so that gain and delay depend on the "
        "amplitude: record with the amplitude that the controller will use, or preload the drive"
    )


def _saturation(rec: Record, found: Nonlinearity) -> tuple[str, str]:
    unit = _unit(rec.unit_u)
    below, above = f"below {plain(found.low, 3)}{unit}", f"above {plain(found.high, 3)}{unit}"
    sides = [words for words, end in ((below, found.low), (above, found.high)) if np.isfinite(end)]
    place = f"{rec.input} {' and '.join(sides)}"
    return place, (
        f"saturation: {rec.output} hardly responds to {place} ({100 * found.beyond:.0f} % of the samples), so that the "
        "gain is understated: record with a smaller amplitude, or record the limited signal as the input"
    )


def _curvature(rec: Record, found: Nonlinearity) -> tuple[str, str]:
    raw = rec.u + offsets_of(rec)[:, 0]
    place = f"{rec.input} from {plain(float(raw.min()), 3)} to {plain(float(raw.max()), 3)}{_unit(rec.unit_u)}"
    return place, (
        f"the gain from {rec.input} to {rec.output} varies over {place}: the model holds for this operating point and "
        "amplitude only; record runs of several amplitudes and compare their gains"
    )


def _of_quantum(rec: Record, fit: LongArx) -> list[Disturbance]:
    step = quantum(rec.y)
    if step is None:
        return []
    scatter = np.sqrt(fit.rss / max(fit.free, 1))
    span = float(np.ptp(rec.y))
    if step / np.sqrt(12) < COARSE * scatter or span > 50 * FEWEST_STEPS * step:
        return []
    words = (
        f"the output {rec.output} is quantised in steps of {plain(step)}{_unit(rec.unit_y)}, {span / step:.0f} over "
        "its range, which is most of its noise: use a finer range of the converter, or a larger amplitude"
    )
    level = RESERVATIONS if span < FEWEST_STEPS * step else USABLE
    return [Disturbance("quantisation", step, rec.unit_y, "all samples", words, level)]


def _of_clipping(rec: Record) -> list[Disturbance]:
    found = clipped(rec.y)
    if found is None:
        return []
    sure = runs_into(rec.y, found[0])[0] >= CLIPPED_TWICE
    value = found[0] + float(offsets_of(rec)[0, 1])
    place = f"{rec.output} {plain(value)}{_unit(rec.unit_y)}"
    words = (
        f"the output {rec.output} is held at {plain(value)}{_unit(rec.unit_y)} in {100 * found[1]:.0f} % of the "
        "samples, the end of the range of its sensor, so that the model is wrong: use another range or amplitude"
    )
    return [Disturbance("clipped output", value, rec.unit_y, place, words, DO_NOT_USE if sure else RESERVATIONS)]
