"""Sensitivity peaks and stability margins of many stable loops: a common frequency grid, then local refinement.

The open loop is L = kp' X + ki T W, so that |L|, Im L and |1 + L| on the grid are products of small matrices. Each
relevant crossing and extremum is then refined: crossings by the Illinois rule, extrema by parabolas, to about 1e-12.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Array, Flags, Ints
from .loops import Loops

Complex = NDArray[np.complex128]

WIDTH = 256  # loops on the grid at once
SLACK = 1.08  # extrema within this factor of the best on the grid are refined
ILLINOIS, PARABOLAS = 9, 4
CLOSER = 0.15  # reduction of the distance of the three points; smaller values end in rounding


@dataclass(frozen=True, slots=True)
class Brackets:
    """Intervals of the grid to refine: loop, and angles left, centre and right."""

    loop: Ints
    left: Array
    centre: Array
    right: Array


def margin_figures(loops: Loops) -> dict[str, Array]:
    """Margins and sensitivity peaks, one value per loop; all loops must be stable."""
    found = _look(loops)
    m, T = len(loops), loops.kind.sample_time
    figures = {"ms": _peak(loops, found["ms"], _distance), "mt": _peak(loops, found["mt"], _share)}
    _with_ends(loops, figures)
    return figures | _gain_margin(loops, found["phase"]) | _phase_margin(loops, found["gain"], m, T)


def _look(loops: Loops) -> dict[str, Brackets]:
    """Intervals to refine, by figure."""
    places: dict[str, list[tuple[Any, ...]]] = {"ms": [], "mt": [], "gain": [], "phase": []}
    for b, a, first, stop in _by_plant(loops):
        theta = grid(b, a, loops[slice(first, stop)])
        X, W = parts(b, a, loops, theta)
        basis = np.stack([X, W])
        for k in range(first, stop, WIDTH):
            part = slice(k, min(k + WIDTH, stop))
            gains = np.stack([loops.proportional[part], loops.integral[part]], axis=1)
            for name, (row, column) in _places(gains @ basis.real, gains @ basis.imag).items():
                middle = np.clip(column, 1, len(theta) - 2) if name in ("ms", "mt") else column
                ends = (middle - 1, middle + 1) if name in ("ms", "mt") else (column, column + 1)
                places[name].append((row + k, theta[ends[0]], theta[middle], theta[ends[1]]))
    return {name: Brackets(*(np.concatenate(c) for c in zip(*rows, strict=True))) for name, rows in places.items()}


def _by_plant(loops: Loops) -> list[tuple[Array, Array, int, int]]:
    """Consecutive loops with the same plant: b, a, first and stop."""
    if loops.shared:
        return [(loops.b[:, 0], loops.a[:, 0], 0, len(loops))]
    both = np.vstack([loops.b, loops.a])
    new = np.flatnonzero(np.r_[True, (both[:, 1:] != both[:, :-1]).any(axis=0)])
    stops = np.r_[new[1:], len(loops)]
    return [(loops.b[:, i], loops.a[:, i], int(i), int(j)) for i, j in zip(new, stops, strict=True)]


def _places(re: Array, im: Array) -> dict[str, tuple[Ints, Ints]]:
    """Rows and columns of candidate extrema, and columns before the crossings, of L (m, nf)."""
    size = re * re
    size += im * im
    distance = size + 2 * re
    distance += 1.0
    below = im < 0
    below[:, -1] = below[:, -2]  # L is real at the Nyquist frequency, which is treated separately
    return {
        "ms": _minima(distance),
        "mt": _minima(distance / size) if size.all() else _minima(distance / np.maximum(size, 1e-300)),
        "gain": _changes(size > 1),
        "phase": _changes(below),
    }


def _minima(x: Array) -> tuple[Ints, Ints]:
    """Local minima along rows close to the smallest of the row, ends included."""
    low = x <= SLACK * x.min(axis=1, keepdims=True)
    low[:, 1:] &= x[:, 1:] <= x[:, :-1]
    low[:, :-1] &= x[:, :-1] <= x[:, 1:]
    rows, columns = np.nonzero(low)
    return rows, columns


def _changes(x: Flags) -> tuple[Ints, Ints]:
    rows, columns = np.nonzero(x[:, 1:] != x[:, :-1])
    return rows, columns


def _distance(L: Complex) -> Array:
    """1/|S|^2, which is smooth where |S| has a sharp peak."""
    M = 1.0 + L
    return np.asarray(M.real**2 + M.imag**2)


def _share(L: Complex) -> Array:
    """1/|T|^2, infinite where L is 0."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(_distance(L) / (L.real**2 + L.imag**2), dtype=np.float64)


def _peak(loops: Loops, at: Brackets, of: Callable[[Complex], Array]) -> Array:
    """1/sqrt of the smallest value over the candidates of each loop, refined by parabolic interpolation."""
    mine = loops[at.loop]
    x = np.stack([at.left, at.centre, at.right])
    reach = (at.right - at.left) / 2
    least = np.full(len(loops), np.inf)
    for _ in range(PARABOLAS):
        y = np.stack([of(open_loops(mine, v)) for v in x])
        np.minimum.at(least, at.loop, y.min(axis=0))
        vertex = np.clip(_vertex(x, y), at.left, at.right)
        reach = CLOSER * reach
        x = np.clip(np.stack([vertex - reach, vertex, vertex + reach]), at.left, at.right)
    np.minimum.at(least, at.loop, of(open_loops(mine, vertex)))
    return np.asarray(1.0 / np.sqrt(least))


def _vertex(x: Array, y: Array) -> Array:
    """Minimum of the parabola through three points; if there is none, or two points coincide, the lowest point."""
    (x0, x1, x2), (y0, y1, y2) = x, y
    with np.errstate(divide="ignore", invalid="ignore"):
        left, right = (y1 - y0) / (x1 - x0), (y2 - y1) / (x2 - x1)
        foot = 0.5 * (x0 + x1 - left * (x2 - x0) / (right - left))
    lowest = np.take_along_axis(x, y.argmin(axis=0)[None], axis=0)[0]
    return np.asarray(np.where(np.isfinite(foot) & (right > left), foot, lowest))


def _with_ends(loops: Loops, figures: dict[str, Array]) -> None:
    """Peaks at frequency zero, outside the grid: 1 - final value, and the final value."""
    final = np.abs(loops.final)
    np.maximum(figures["ms"], np.abs(1.0 - loops.final), out=figures["ms"])
    np.maximum(figures["mt"], final, out=figures["mt"])


def _crossing(loops: Loops, at: Brackets, of: Callable[[Complex], Array]) -> tuple[Array, Complex]:
    """Angle where a real function of L changes sign between two angles, and L there, by the Illinois rule."""
    mine = loops[at.loop]
    x0, x1 = at.left.copy(), at.right.copy()
    f0, f1 = of(open_loops(mine, x0)), of(open_loops(mine, x1))
    x, L = x1, open_loops(mine, x1)
    for _ in range(ILLINOIS):
        with np.errstate(divide="ignore", invalid="ignore"):
            guess = x1 - f1 * (x1 - x0) / (f1 - f0)
        x = np.where(np.isfinite(guess), guess, x1)
        L = open_loops(mine, x)
        f = of(L)
        turned = np.sign(f) * np.sign(f1) < 0
        x0, f0 = np.where(turned, x1, x0), np.where(turned, f1, f0 / 2)
        x1, f1 = x, f
    return x, L


def _log_size(L: Complex) -> Array:
    return np.asarray(np.log(np.abs(L)))


def _imaginary(L: Complex) -> Array:
    return np.asarray(L.imag)


def _phase_margin(loops: Loops, at: Brackets, m: int, T: float) -> dict[str, Array]:
    """Phase margin, its crossover frequency, and the delay margin."""
    theta, L = _crossing(loops, at, _log_size)
    lead = np.angle(-L)
    margin, delay, crossover = np.full(m, np.inf), np.full(m, np.inf), np.zeros(m)
    np.minimum.at(margin, at.loop, np.abs(lead))
    np.minimum.at(delay, at.loop, np.mod(lead, 2 * np.pi) / theta * T)
    smallest = np.abs(lead) == margin[at.loop]
    crossover[at.loop[smallest]] = theta[smallest] / T
    return {"phase_margin": np.degrees(margin), "delay_margin": delay, "crossover": crossover}


def _gain_margin(loops: Loops, at: Brackets) -> dict[str, Array]:
    """The factor nearest 1, as a ratio, that moves L to -1: crossings of the negative real axis, and both ends."""
    _, L = _crossing(loops, at, _imaginary)
    every = np.arange(len(loops))
    ends = open_loops(loops, np.full(len(loops), np.pi)).real
    rows, values = np.concatenate([at.loop, every]), np.concatenate([L.real, ends])
    with np.errstate(divide="ignore", invalid="ignore"):
        start = np.where(loops.final == 1, 0.0, loops.final / (1 - loops.final))
    rows, values = np.concatenate([rows, every]), np.concatenate([values, start])
    use = values < 0
    rows, logs = rows[use], -np.log(-values[use])
    nearest = np.full(len(loops), np.inf)
    np.minimum.at(nearest, rows, np.abs(logs))
    margin = np.full(len(loops), np.inf)
    hit = np.abs(logs) == nearest[rows]
    margin[rows[hit]] = np.exp(logs[hit])
    return {"gain_margin": margin}


RATIO = 1.08  # between neighbours of the grid at low frequencies
DECADES = 10  # below the Nyquist frequency
TINY = 1e-9  # a pole this close to 1 is an integrator


def open_loops(loops: Loops, theta: Array) -> Complex:
    """L of loop k at angle ``theta[k]`` = omega T in (0, pi], shape (m,)."""
    z, sine = np.exp(-1j * theta), _one_less(theta)
    plant = _horner(loops.b, z) / _horner(loops.a, z)
    return np.asarray(plant * _around(loops, z, sine) * (loops.proportional + loops.integral / sine))


def parts(b: Array, a: Array, loops: Loops, theta: Array) -> tuple[Complex, Complex]:
    """X and W (nf,) of one plant, so that L = kp' X + ki T W."""
    z, sine = np.exp(-1j * theta), _one_less(theta)
    X = _horner(b[:, None], z) / _horner(a[:, None], z) * _around(loops, z, sine)
    return X, X / sine


def grid(b: Array, a: Array, loops: Loops) -> Array:
    """Angles in (0, pi]: logarithmic, then linear, and dense near sharp resonances."""
    kind = loops.kind
    step = np.pi / (20 * (2 + kind.delay + kind.average + len(b)))
    bend = step / np.log(RATIO)
    roots = np.concatenate([np.roots(np.trim_zeros(p, "b")) for p in (a, np.trim_zeros(b, "f")) if np.any(p)])
    low = min(_lowest(b, a, loops), bend / 2)
    slow = np.geomspace(low, bend, int(np.log(bend / low) / np.log(RATIO)) + 2)
    even = np.linspace(bend, np.pi, int((np.pi - bend) / step) + 2)
    angles = np.concatenate([slow, even, *_near(roots)])
    return np.unique(angles[(angles >= low) & (angles <= np.pi)])


def _lowest(b: Array, a: Array, loops: Loops) -> float:
    """Lowest angle, below every crossover and corner frequency."""
    gaps = np.abs(1 - np.roots(np.trim_zeros(a, "b")))
    corners = [*gaps[gaps > TINY], *_corners(loops)]
    decades = np.pi * np.power(10.0, np.arange(-DECADES, 0))
    X, W = parts(b, a, loops, decades)
    size = np.abs(np.outer(loops.proportional, X) + np.outer(loops.integral, W))
    above = np.all(size > 3, axis=0)
    if above[0]:  # an integrator: no crossover where all |L| exceed 3
        corners.append(decades[-1 if above.all() else int(np.argmin(above)) - 1])
    return float(max(0.05 * min(corners, default=1.0), decades[0]))


def _corners(loops: Loops) -> Array:
    """Smallest corner angle of the PI."""
    both = (loops.proportional != 0) & (loops.integral != 0)
    return np.abs(loops.integral[both] / loops.proportional[both]).min(keepdims=True) if both.any() else np.empty(0)


def _near(roots: Complex) -> list[Array]:
    """Angles near the roots close to the unit circle and away from 1, where L changes rapidly."""
    out = []
    for root in roots:
        centre, width = abs(np.angle(root)), max(abs(1 - abs(root)), 1e-7)
        if width < 0.2 * centre:
            away = width * np.geomspace(0.05, 20, 24)
            out.append(np.concatenate([centre - away, [centre], centre + away]))
    return out


def _around(loops: Loops, z: Complex, sine: Complex) -> Complex:
    """Loop without plant and PI: delay, average, low-pass, and the further sum of incremental_sum."""
    kind = loops.kind
    out = z**kind.delay if kind.delay else np.ones_like(z)
    if kind.average > 1:
        out = out * _horner(np.full((kind.average, 1), 1.0 / kind.average), z)
    if kind.filter_time:
        gain = float(-np.expm1(-kind.sample_time / kind.filter_time))
        out = out * gain / (gain + (1 - gain) * sine)
    return out / sine if kind.form == "incremental_sum" else out


def _one_less(theta: Array) -> Complex:
    """1 - exp(-j theta), accurate at small angles."""
    return np.asarray(2 * np.sin(theta / 2) ** 2 + 1j * np.sin(theta))


def _horner(p: Array, z: Complex) -> Complex:
    """Polynomial in z^-1 given as rows of coefficients (n, 1) or (n, m) at m points."""
    out = np.broadcast_to(p[-1] + 0j, np.broadcast_shapes(p[-1].shape, z.shape)).copy()
    for c in p[-2::-1]:
        out *= z
        out += c
    return out
