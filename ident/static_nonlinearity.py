"""Static nonlinearity of the input (dead zone, backlash, saturation, curvature), and quantised or clipped output.

The input that acts on the plant is u + g(u). Lags of g for a grid of widths and levels are added to a regression of
high order, and the one that decreases the sum of squares most is named if its F test, at the level divided by the
number of candidates, is significant.

Source: Haber & Keviczky 1999, Nonlinear System Identification, section 4 (Hammerstein models, tests of nonlinearity).
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Array
from ..datasets.records.record import Record
from .estimators.long_arx import LongArx, golden, lagged_rows, long_arx

LAGS = 7  # of g, spread over those of u
FALSE_ALARM = 1e-4  # of all candidates together
WIDTHS = (0.05, 0.1, 0.2, 0.3, 0.5)  # of dead zone and backlash, of half the range of u
LEVELS = (0.9, 0.8, 0.65, 0.5)  # of saturation, of half the range of u from its middle
REFINED = 8  # evaluations of the width or level
CLIPPED = 0.01  # share of repeated samples
CHANGES = (-1.0, -0.7, -0.4, 0.4, 1.0)  # of the gain, relative; -1 where the input is lost
LOST = -0.5  # above it the input is not lost but amplified differently
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
    share : float
        Of the innovations' sum of squares that it explains.
    p : float
    beyond : float
        Share of the samples inside the dead zone, or beyond the level of saturation.
    change : float
        Relative change of the gain there: -1 where the input is lost.
    """

    kind: str
    low: float
    high: float
    share: float
    p: float
    beyond: float
    change: float


@dataclass(frozen=True, slots=True)
class Candidate:
    """A kind of nonlinearity with its function of u and its size, a share of half the range of u."""

    kind: str
    function: Callable[[Array, float], Array]
    sizes: tuple[float, ...]
    ends: Callable[[float], tuple[float, float]]


def nonlinearity(fit: LongArx, rec: Record, raw: Array, beside: Array) -> Nonlinearity | None:
    """The static nonlinearity that explains the innovations best, if significant.

    Parameters
    ----------
    fit : LongArx
    rec : Record
    raw : ndarray, shape (N,)
        Input with its operating point, unit of u.
    beside : ndarray, shape (N, k)
        Further columns of the regression.
    """
    if len(np.unique(raw)) <= FEW_VALUES or fit.free < 3 * LAGS:
        return None
    held = list(_candidates(rec, raw))
    lags = _lags(fit)
    columns = [(c, x, c.function(raw, x)) for c in held for x in c.sizes]
    stacked = np.column_stack([lagged_rows(g, lags, fit.rows) for _, _, g in columns])
    found = _best(fit, stacked, len(columns))
    if found is None:
        return None
    best, size, _ = columns[found]
    p = fit.f_test(stacked[:, found * len(lags) : (found + 1) * len(lags)])[0]
    if p > FALSE_ALARM / len(columns):
        return None
    return _refined(fit, rec, raw, beside, best, size, p)


def _best(fit: LongArx, stacked: Array, count: int) -> int | None:
    """Candidate with the largest decrease of the sum of squares; ``stacked`` (m, count times lags)."""
    length = np.linalg.norm(stacked, axis=0)
    free = fit.orthogonal(stacked) / np.where(length > 0, length, 1.0)
    blocks = free.T.reshape(count, -1, len(fit.rows))
    square, vector = np.linalg.eigh(blocks @ blocks.transpose(0, 2, 1))
    c = np.einsum("kij,ki->kj", vector, blocks @ fit.left)
    usable = square > 1e-6 * np.maximum(square[:, -1:], 1e-9)
    fell = np.where(usable, c**2 / np.where(usable, square, 1.0), 0.0).sum(axis=1)
    return int(np.argmax(fell)) if fell.max() > 0 else None


def _lags(fit: LongArx) -> NDArray[np.intp]:
    return np.unique(np.linspace(1, max(int(fit.lags[-1]) - 1, LAGS), LAGS).round().astype(np.intp))


def _candidates(rec: Record, raw: Array) -> Iterator[Candidate]:
    low, high = float(raw.min()), float(raw.max())
    centre, half = (low + high) / 2, (high - low) / 2
    zero = [0.0] if low + 0.1 * half < 0.0 < high - 0.1 * half else []
    middle = [] if zero and abs(centre) < 0.05 * half else [centre]
    for at in (*zero, *middle):
        yield Candidate(
            "dead zone", partial(_inside, at, half), WIDTHS, lambda x, at=at: (at - x * half, at + x * half)
        )
    yield Candidate("backlash", partial(_lost, rec, half), WIDTHS, lambda x: (0.0, 2 * x * half))
    for above, below in ((True, False), (False, True), (True, True)):
        yield Candidate(
            "saturation", partial(_excess, centre, half, above, below), LEVELS,
            lambda x, above=above, below=below: (
                centre - x * half if below else -np.inf, centre + x * half if above else np.inf
            ),
        )  # fmt: skip
    yield Candidate("curvature", lambda u, _: ((u - centre) / half) ** 2, (1.0,), lambda _: (low, high))


def _inside(at: float, half: float, u: Array, x: float) -> Array:
    """What a dead zone takes from u."""
    return np.clip(u - at, -x * half, x * half)


def _excess(centre: float, half: float, above: bool, below: bool, u: Array, x: float) -> Array:
    """What a saturation takes from u."""
    v = u - centre
    return np.maximum(v - x * half, 0.0) * above + np.minimum(v + x * half, 0.0) * below


def _lost(rec: Record, half: float, u: Array, x: float) -> Array:
    """What backlash of width 2 x half takes from u, in each stretch."""
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


def _refined(
    fit: LongArx, rec: Record, raw: Array, beside: Array, best: Candidate, size: float, p: float
) -> Nonlinearity:
    """The nonlinearity with the change of gain and the size that leave the smallest innovations of u + change g(u)."""

    def left(x: float, change: float) -> float:
        acting = replace(rec, u=raw + change * best.function(raw, x))
        return long_arx(acting, len(fit.a) - 1, fit.lags, beside).rss

    change = min(CHANGES, key=lambda value: left(size, value))
    if len(best.sizes) > 1:
        grid = np.array(sorted((0.5 * min(best.sizes), *best.sizes, min(1.4 * max(best.sizes), 0.97))))
        k = int(np.argmin(np.abs(grid - size)))
        size = golden(lambda x: left(x, change), float(grid[k - 1]), float(grid[k + 1]), REFINED)
    ends = best.ends(size)
    kind = "curvature" if best.kind != "backlash" and change > LOST else best.kind
    share = 1 - left(size, change) / fit.rss
    return Nonlinearity(kind, *ends, share, p, _affected(best.kind, raw, *ends), change)


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
