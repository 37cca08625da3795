"""Static nonlinearity of the input (dead zone, backlash, saturation, curvature), and quantised or clipped output.

The input that acts on the plant is u + g(u). Lags of g for a grid of widths and levels are added to a regression of
high order, and the one that decreases the sum of squares most is named if its F test, at the level divided by the
number of candidates, is significant.

Source: Haber & Keviczky 1999, Nonlinear System Identification, section 4 (Hammerstein models, tests of nonlinearity).
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from ..core.arrays import Array, Ints
from ..core.verdict import DO_NOT_USE, RESERVATIONS
from ..datasets.records.reading import clipped as runs_into
from ..datasets.records.record import Record
from .estimators.high_order_arx import (
    EXACT,
    LongArx,
    golden,
    input_lags,
    lagged_rows,
    long_arx,
    offsets_of,
    order_of,
    rss_of,
    spread,
)
from .physical_models.step_shapes import without_noise

LAGS = np.array([1, 2, 4, 7, 11, 16, 22, 30, 40, 55])  # of g: dense near, wide apart for slow plants and long delays
FALSE_ALARM = 1e-3  # of all candidates together; with 1e-4 a dead zone of 20 % is named in .78 of records, not .83
WIDTHS = (0.05, 0.1, 0.2, 0.35)  # of dead zone and backlash, of half the range of u
SURE, SMALL_OFFSET = 3.0, 0.05  # standard errors; of the range of the output: smaller offsets are not judged
USUAL_POWER = (0.5, 0.9)  # of the feed in a cutting force: 1 - m of Kienzle, m .1 to .5
OFFSET, LARGE_OFFSET = 0.15, 0.3  # of the larger mean: an offset named, and one that no usual cut has
LEVELS = (0.5, 0.7, 0.85)  # of saturation, of half the range of u from its middle
REFINED = 8  # evaluations of the width or level
LEAST_CLIPPED = 3  # times that an output runs into the end of its range
CLIPPED = 0.01  # share of repeated samples
LOSS = (-1.0, -0.6, 0.6)  # change of the gain, relative; -1 where the input is lost
CHANGES = {"dead zone": LOSS, "backlash": (-1.0,), "saturation": LOSS, "curvature": (-0.3, -0.1, 0.1, 0.3)}
ALIKE = 1.02  # sums of squares of the innovations that do not decide between a partial and a whole loss
LOST = -0.8  # above it the input is not lost but amplified differently
FEW_VALUES = 3  # of u: a signal of two or three values shows no static characteristic


@dataclass(frozen=True, slots=True)
class Nonlinearity:
    """A static nonlinearity of the input.

    Attributes
    ----------
    kind : str
        ``dead zone``, ``backlash``, ``saturation`` or ``curvature``.
    low, high : float
        Ends of the dead zone, width of the backlash (0 to width), levels of saturation (infinite where there is none),
        in the unit of u; range of u for a curvature.
    p : float
    beyond : float
        Share of the samples inside the dead zone, or beyond the level of saturation.
    change : float
        Relative change of the gain there: -1 where the input is lost.
    lost : callable
        What a change of -1 takes from the input of a record.
    """

    kind: str
    low: float
    high: float
    p: float
    beyond: float
    change: float
    lost: Callable[[Record, Array], Array] = field(repr=False)

    def acting(self, rec: Record, raw: Array) -> Array:
        """Input (N,) that acts on the plant, from the input ``raw`` of a record with its operating point."""
        return raw + self.change * self.lost(rec, raw)


@dataclass(frozen=True, slots=True)
class Candidate:
    """A kind of nonlinearity with its function of u and its size, a share of half the range of u."""

    kind: str
    function: Callable[[Record, Array, float], Array]
    sizes: tuple[float, ...]
    ends: Callable[[float], tuple[float, float]]


def nonlinearity(fit: LongArx, rec: Record, raw: Array, additional: Array) -> Nonlinearity | None:
    """The static nonlinearity that explains the innovations best, if significant.

    Parameters
    ----------
    fit : LongArx
    rec : Record
    raw : ndarray, shape (N,)
        Input with its operating point, unit of u.
    additional : ndarray, shape (N, k)
        Further columns of the regression.

    Notes
    -----
    Steps are taken without the noise of their measurement: what cuts that noise off, as a saturation at the levels
    does, would explain the output better than the measured input.
    """
    measured, raw = raw, without_noise(raw)
    if len(np.unique(raw)) <= FEW_VALUES:
        return None
    rec = replace(rec, u=rec.u + (raw - measured))
    lags = LAGS[max(s.stop - s.start for s in rec.stretches) // 6 > LAGS]
    both = np.union1d(fit.lags, lags)  # u as far back as g, so that g does not stand for dynamics that are linear
    wide = long_arx(rec, len(fit.a) - 1, both, additional)
    if wide.free < 3 * len(lags):
        return None
    held = list(_candidates(rec, raw))
    columns = [(candidate, x) for candidate in held for x in candidate.sizes]
    stacked = np.column_stack([lagged_rows(c.function(rec, raw, x), lags, wide.rows) for c, x in columns])
    fell = _decreases(wide, stacked, len(columns))
    first = int(np.argmax(fell))
    p = wide.f_test(stacked[:, first * len(lags) : (first + 1) * len(lags)])[0]
    if p > FALSE_ALARM / len(columns):
        return None
    best = {c.kind: c for _, (c, _) in sorted(zip(fell, columns, strict=True), key=lambda item: item[0])}
    acting = Acting(rec, raw, additional, len(fit.a) - 1, both)
    return _refined(acting, list(best.values()), p)


def _decreases(fit: LongArx, stacked: Array, count: int) -> Array:
    """Decrease of the sum of squares by each candidate (count,); ``stacked`` (m, count times lags)."""
    length = np.linalg.norm(stacked, axis=0)
    free = fit.orthogonal(stacked) / np.where(length > 0, length, 1.0)
    blocks = free.T.reshape(count, -1, len(fit.rows))
    square, vector = np.linalg.eigh(blocks @ blocks.transpose(0, 2, 1))
    c = np.einsum("kij,ki->kj", vector, blocks @ fit.left)
    usable = square > 1e-6 * np.maximum(square[:, -1:], 1e-9)
    return np.asarray(np.where(usable, c**2 / np.where(usable, square, 1.0), 0.0).sum(axis=1))


@dataclass(frozen=True, slots=True)
class Acting:
    """Regression on the input that acts on the plant."""

    rec: Record
    raw: Array
    additional: Array
    y_lags: int
    lags: Ints

    def left(self, candidate: "Candidate", size: float, change: float) -> float:
        """Sum of squares of the innovations with the input u + change g(u)."""
        acting = replace(self.rec, u=self.raw + change * candidate.function(self.rec, self.raw, size))
        return rss_of(acting, self.y_lags, self.lags, self.additional)


def _candidates(rec: Record, raw: Array) -> Iterator[Candidate]:
    low, high = float(raw.min()), float(raw.max())
    centre, half = (low + high) / 2, (high - low) / 2
    zero = [0.0] if low + 0.1 * half < 0.0 < high - 0.1 * half else []
    middle = [] if zero and abs(centre) < 0.05 * half else [centre]
    for at in (*zero, *middle):
        yield Candidate("dead zone", partial(_inside, at, half), WIDTHS, partial(_ends, at, half, True, True))
    yield Candidate("backlash", partial(_lost, half), WIDTHS, lambda x: (0.0, 2 * x * half))
    for above, below in ((True, False), (False, True), (True, True)):
        yield Candidate(
            "saturation", partial(_excess, centre, half, above, below), LEVELS,
            partial(_ends, centre, half, above, below),
        )  # fmt: skip
    yield Candidate("curvature", lambda rec, u, _: ((u - centre) / half) ** 2, (1.0,), lambda _: (low, high))


def _ends(centre: float, half: float, above: bool, below: bool, x: float) -> tuple[float, float]:
    """Range within x times ``half`` of the centre, without end on a side that does not saturate."""
    return centre - x * half if below else -np.inf, centre + x * half if above else np.inf


def _inside(at: float, half: float, rec: Record, u: Array, x: float) -> Array:
    """The part of u that a dead zone removes."""
    return np.asarray(np.clip(u - at, -x * half, x * half))


def _excess(centre: float, half: float, above: bool, below: bool, rec: Record, u: Array, x: float) -> Array:
    """The part of u that a saturation removes."""
    v = u - centre
    return np.asarray(np.maximum(v - x * half, 0.0) * above + np.minimum(v + x * half, 0.0) * below)


def _lost(half: float, rec: Record, u: Array, x: float) -> Array:
    """The part of u that backlash of width 2 x half removes, in each stretch."""
    out = np.empty_like(u)
    for s in rec.stretches:
        out[s] = u[s] - backlash(u[s], 2 * x * half)
    return out


def backlash(u: Array, width: float) -> Array:
    """Output of backlash (play) of a width, from its middle.

    >>> backlash(np.array([0.0, 2.0, 1.5, 0.0]), 1.0).tolist()
    [0.0, 1.5, 1.5, 0.5]
    """
    out, held, half = [], float(u[0]), width / 2
    for x in u.tolist():
        held = min(max(held, x - half), x + half)
        out.append(held)
    return np.array(out)


def _refined(acting: Acting, best: list[Candidate], p: float) -> Nonlinearity:
    """Kind, size and change of gain with the smallest innovations; ``best`` has the best candidate of each kind."""
    tried = [(acting.left(c, x, change), c, x, change) for c in best for x in c.sizes for change in CHANGES[c.kind]]
    _, candidate, size, change = min(tried, key=lambda item: item[0])
    if len(candidate.sizes) > 1:
        whole = -1.0  # what is lost altogether has a name; part of it may have the wrong size only
        at = {value: _size(acting, candidate, tried, value) for value in {change, whole}}
        left = {value: acting.left(candidate, x, value) for value, x in at.items()}
        change = whole if left[whole] < ALIKE * left[change] else change
        size = at[change]
    ends = candidate.ends(size)

    def lost(rec: Record, raw: Array) -> Array:
        return candidate.function(rec, raw, size)

    kind = "curvature" if change > LOST else candidate.kind
    return Nonlinearity(kind, *ends, p, _affected(candidate.kind, acting.raw, *ends), change, lost)


def _size(
    acting: Acting, candidate: Candidate, tried: list[tuple[float, Candidate, float, float]], change: float
) -> float:
    """Size with the smallest innovations at one change of gain, between the neighbours on the grid."""
    best = min((left, x) for left, c, x, value in tried if c is candidate and value == change)[1]
    grid = np.array(sorted((0.5 * min(candidate.sizes), *candidate.sizes, 0.97)))
    k = int(np.argmin(np.abs(grid - best)))
    return golden(lambda x: acting.left(candidate, x, change), float(grid[k - 1]), float(grid[k + 1]), REFINED)


def _affected(kind: str, raw: Array, low: float, high: float) -> float:
    """Share of the samples in the dead zone or beyond the saturation; 1 for backlash and curvature."""
    inside = (raw > low) & (raw < high)
    if kind == "dead zone":
        return float(inside.mean())
    return float((~inside).mean()) if kind == "saturation" else 1.0


def quantum(values: Array) -> float | None:
    """Step of a quantised signal, or None where its values lie on no common grid.

    >>> quantum(np.array([0.5, 1.0, 0.0, 2.5, 1.5, 1.0, 0.5, 0.0, 0.0, 0.5]))
    0.5
    """
    levels = np.unique(values)
    if not 3 <= len(levels) <= len(values) / 2:
        return None
    gaps = np.diff(levels)
    span = float(levels[-1] - levels[0])
    gaps = gaps[gaps > 1e-9 * span]
    step = float(gaps.min())
    multiple = gaps / step
    return step if bool(np.all(np.abs(multiple - multiple.round()) < 1e-3 * multiple)) else None


def clipped(values: Array) -> tuple[float, float] | None:
    """Extreme value at which a signal is held, and the share of samples there, or None.

    Successive equal values occur at the extreme only: a quantised or settled signal repeats others too.
    """
    repeated = np.flatnonzero(np.diff(values) == 0.0)
    if len(repeated) < CLIPPED * len(values):
        return None
    at = {float(v): int((values[repeated] == v).sum()) for v in (values.min(), values.max())}
    if sum(at.values()) < 0.9 * len(repeated):
        return None
    level = max(at, key=lambda v: at[v])
    return level, float((values == level).mean())


def off_proportion(rec: Record, inverse_gain: float, error: float) -> Iterator[tuple[int, str]]:
    """Level and sentence on an output that is not proportional to the input at the operating point of a record.

    The line of the gain through the means of a record meets no input at an offset of the output: an edge force, or the
    zero of the sensor. A force in proportion to the power 1 - m of the feed (Kienzle) has one of the share m, usually
    0.15 to 0.3.

    Parameters
    ----------
    rec : Record
        With its operating point, in its values or, of a centred record, in its offsets.
    inverse_gain, error : float
        Input per output, and its standard error.
    """
    centred = all(abs(rec.u[s].mean()) <= 1e-6 * float(np.ptp(rec.u)) for s in rec.stretches)
    u, y = map(float, offsets_of(rec).mean(axis=0) if centred else (rec.u.mean(), rec.y.mean()))
    by_gain = u / inverse_gain
    offset = y - by_gain
    share = abs(offset) / max(abs(y), abs(by_gain), 1e-300)
    uncertain = max(SURE * abs(by_gain) * error / inverse_gain, SMALL_OFFSET * float(np.ptp(rec.y)))
    if share <= OFFSET or abs(offset) <= uncertain:
        return
    unit = f" {rec.unit_y}".rstrip()
    power = by_gain / y if y else 0.0  # of u in a force that is a power of it: the local gain over the mean ratio
    alternative = (
        f", or the {rec.output} rises as {rec.input}^{power:.2g} (Kienzle's law: then deduct nothing, the gain holds "
        "near this mean only)"
        if USUAL_POWER[0] <= power <= USUAL_POWER[1]
        else ""
    )
    yield (
        DO_NOT_USE if share > LARGE_OFFSET else RESERVATIONS,
        f"The {rec.output} is not proportional to the {rec.input}: at a mean of {u:.4g} {rec.unit_u or '1'} it is "
        f"{y:.4g}{unit}, and by the estimated gain {by_gain:.4g}{unit}. {offset:+.4g}{unit} at no {rec.input} are the "
        f"zero of the sensor, an edge force, or a command recorded as a deviation{alternative}. A control takes both "
        "as proportional, so that its feeds are wrong: deduct the offset from force and set points, in the control "
        "too, or record both from their zeros.",
    )


def limits_reached(rec: Record, averaged: Record, period: int) -> Iterator[tuple[int, str]]:
    """Level and sentence on an output at the end of its range and on a saturated input.

    Parameters
    ----------
    rec : Record
        As recorded.
    averaged : Record
        The record without the ripple of ``period`` samples; every half of them is tested for saturation.
    """
    highest, lowest = float(rec.y.max()), float(rec.y.min())
    own = rec.y + offsets_of(rec)[:, 1]
    extreme = highest if own.max() >= -own.min() else lowest  # a force of zero between teeth is no end of a range
    times, samples = runs_into(rec.y, extreme)
    if times >= LEAST_CLIPPED:
        at = f"{float(own.max() if extreme == highest else own.min()):.4g} {rec.unit_y}".rstrip()
        yield (
            DO_NOT_USE,
            f"The {rec.output} runs into {at} and stays there, in {samples} samples, as at the end of the range of a "
            "sensor: the gain is not known. Use another range or less load.",
        )
    yield from _saturated(rec, spread(averaged.decimated(max(period // 2, 1))))


def _saturated(rec: Record, part: Record) -> Iterator[tuple[int, str]]:
    """Level and sentence on a saturated input, found in a part of a record."""
    if not (order := order_of(part)):
        return
    fit = long_arx(part, order, input_lags(part, order))
    if fit.rss <= EXACT * float(part.y @ part.y):  # no noise, against which a nonlinearity is tested
        return
    found = nonlinearity(fit, part, part.u + offsets_of(part)[:, 0], np.empty((len(part), 0)))
    if found is not None and found.kind == "saturation":
        sides = ((found.low, "below"), (found.high, "above"))
        where = " and ".join(f"{side} {end:.3g} {rec.unit_u}".rstrip() for end, side in sides if np.isfinite(end))
        yield (
            RESERVATIONS,
            f"The {rec.output} hardly responds to a {rec.input} {where}, {100 * found.beyond:.0f} % of the samples, as "
            "where the command is limited: the gain is understated. Record a smaller range, or the limited command.",
        )
