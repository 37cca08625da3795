"""Refinement of the best gains: a small grid that contracts towards the best point."""

from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from ...core.arrays import Array
from ...core.errors import IdentError, UsageError
from ..model import Model
from .feasible_region import FeasibleMap, feasible_map, horizon
from .figures_of_merit import MARGINS, specified_figures
from .gains import PiGains
from .loop import loop_of
from .specification import Specification, table_of

Aim = Literal["ms", "iae", "disturbance_iae", "travel", "noise_gain", "rise_time", "settling_time", "largest_ki"]
SIDE = 9  # gains per side of the small grid
ROUNDS = 40
SHRINK = 0.4
ENOUGH, IDLE = 1e-5, 8  # rounds with less improvement shrink the grid; so many in a row end the search
LONGER, ATTEMPTS = 4.0, 4  # factor of the simulated duration while it cuts off a part of the objective
SUMS, CUT_OFF = ("iae", "disturbance_iae", "travel"), 1e-3  # objectives that grow with the duration; share cut off
STEPS = 2.0  # initial half width of the grid, in steps of the map


@dataclass(frozen=True, slots=True)
class GainPoint:
    """Gains, their largest violation, and the value of the objective."""

    kp: float
    ki: float
    worst: float
    aim: float


def check_aim(aim: str) -> None:
    """Raise UsageError for an unknown objective."""
    if aim not in get_args(Aim):
        raise UsageError(f"objective (aim) {aim!r} of PI gains: one of {', '.join(get_args(Aim))}.")


def aim_of(figures: dict[str, Array], ki: Array, aim: Aim) -> Array:
    """Objective to minimise, in the shape of the figures; ki broadcasts to it."""
    if aim == "largest_ki":
        return np.asarray(np.broadcast_to(-np.abs(ki), figures["stable"].shape))
    return figures[aim]


def best_of(worst: Array, aim: Array) -> int:
    """Flat index of the smallest objective among feasible points, or of the smallest violation if there are none."""
    if (worst <= 0).any():
        return int(np.argmin(np.where(worst <= 0, aim, np.inf)))
    return int(np.argmin(worst))


def nominal_gains(
    model: Model, target: Specification, template: PiGains, aim: Aim, n: int
) -> tuple[FeasibleMap, PiGains]:
    """Map and best gains; with longer simulations if slow transients appear beyond the horizon.

    A sum over a step that is cut off is too small for every loop: where the best one is not cut off, it is the best of
    all.
    """
    time = horizon(model, target)
    for _ in range(ATTEMPTS):
        found = feasible_map(model, target, template, n, duration=time)
        point = refined(model, target, template, found, aim)
        gains = replace(template, kp=point.kp, ki=point.ki)
        settled = loop_of(model, gains).figures()
        held = float(target.worst(table_of(settled, gains.kp, gains.ki))) <= 0
        whole = aim not in SUMS or getattr(settled, aim) <= (1 + CUT_OFF) * point.aim
        if point.worst > 0 or (held and whole):
            break
        time *= LONGER
    return found, gains


def refined(model: Model, specification: Specification, template: PiGains, found: FeasibleMap, aim: Aim) -> GainPoint:
    """The best gains near the best point of a map; where nothing is feasible, those of the least violation.

    Small grids along the axes and along a line of constant integral time alternate; both shrink without improvement.
    """
    steps = [STEPS / max(len(v) - 1, 1) * float(abs(v[-1] - v[0])) for v in (found.kp, found.ki)]
    starts = starts_of(found, aim)
    if not starts:
        raise IdentError(
            f"no PI meets a finite settling time with this model: its largest pole has radius {model.radius:.4g}. "
            "Identify with lower orders, or on a longer record."
        )
    ends = [search_near(model, specification, template, found, aim, start, steps) for start in starts]
    return min(ends, key=lambda end: (end.worst, end.aim))


def starts_of(found: FeasibleMap, aim: Aim) -> list[GainPoint]:
    """The best point of a map; where nothing is feasible, also the best of each quadrant (local minima)."""
    shape = found.worst.shape
    kp, ki = np.broadcast_to(found.kp[:, None], shape), np.broadcast_to(found.ki, shape)
    halves = [(slice(None), slice(None))]
    if not found.any:
        cuts = [(slice(0, n // 2), slice(n // 2, None)) for n in shape]
        halves += [(p, i) for p in cuts[0] for i in cuts[1]]
    points = []
    for half in halves:
        table = {name: values[half].ravel() for name, values in found.figures.items()}
        worst = found.worst[half].ravel()
        if worst.size and np.isfinite(worst).any():
            points.append(point_of(table, worst, kp[half].ravel(), ki[half].ravel(), aim))
    return list({(p.kp, p.ki): p for p in points}.values())


def search_near(
    model: Model,
    specification: Specification,
    template: PiGains,
    found: FeasibleMap,
    aim: Aim,
    best: GainPoint,
    steps: list[float],
) -> GainPoint:
    """The best gains near one point."""
    sizes = [*steps, STEPS / len(found.ki), STEPS / len(found.ki)]
    more = (aim,) if aim in MARGINS else ()
    offsets, sign, idle = np.linspace(-1, 1, SIDE), float(np.sign(found.range.ki)), 0
    for k in range(ROUNDS):
        along_axes = k % 2 == 0
        first, second = (offsets * s for s in (sizes[:2] if along_axes else sizes[2:]))
        kp, ki = in_quadrant(*(axes_grid if along_axes else ray_grid)(best, first, second), sign)
        table = specified_figures(model, kp, ki, template, found.duration, specification, *more)
        trial = point_of(table, specification.worst(table), kp, ki, aim)
        gained = better(trial, best, ENOUGH)
        best = trial if better(trial, best, 0.0) else best
        idle = 0 if gained else idle + 1
        sizes = [s if gained or (j < 2) != along_axes else SHRINK * s for j, s in enumerate(sizes)]
        if idle >= IDLE:
            break
    return best


def better(one: GainPoint, other: GainPoint, by: float) -> bool:
    """Whether a point violates less, or has a smaller objective, by more than a relative amount."""
    if one.worst != other.worst:
        return one.worst < other.worst * (1 - by)
    return one.aim < other.aim - by * abs(other.aim)


def axes_grid(at: GainPoint, kp: Array, ki: Array) -> tuple[Array, Array]:
    """Gains about a point, as two flat arrays."""
    return np.repeat(at.kp + kp, len(ki)), np.tile(at.ki + ki, len(kp))


def ray_grid(at: GainPoint, size: Array, angle: Array) -> tuple[Array, Array]:
    """Gains along and across a line of constant integral time, as two flat arrays."""
    scale, turn = 1 + np.repeat(size, len(angle)), 1 + np.tile(angle, len(size))
    return at.kp * scale, at.ki * scale * turn


def in_quadrant(kp: Array, ki: Array, sign: float) -> tuple[Array, Array]:
    """Gains of one sign with integral action; a kp of the other sign becomes zero."""
    kp = sign * np.maximum(sign * kp, 0.0)
    return kp[sign * ki > 0], ki[sign * ki > 0]


def point_of(table: dict[str, Array], worst: Array, kp: Array, ki: Array, aim: Aim) -> GainPoint:
    """The best of an array of gains."""
    score = aim_of(table, ki, aim)
    k = best_of(worst, score)
    return GainPoint(float(kp[k]), float(ki[k]), float(worst[k]), float(score[k]))
