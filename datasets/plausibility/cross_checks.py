"""Columns of a file of tests compared with each other: specific force, power, roughness, resultant force."""

import numpy as np
from numpy.typing import NDArray

from ...core.rounding import format_decimal
from ..doubts import Doubt
from ..draft import Draft
from ..options import ReadOptions
from ..vocabulary import ROLES
from .quantities import table_process
from .stray_values import places

KC_USUAL = (500, 6000)  # N/mm2, steel and cast iron to hard metals and small chips
KC_LIMITS = (250, 15000)
ROUGHNESS_LIMITS = (2.0, 15)  # Rz/Ra; usual 3 to 10
DEVIATION = 8.0  # of a row from the median of the ratio
FEWEST = 5

Array = NDArray[np.float64]


def check_columns(draft: Draft, options: ReadOptions) -> None:
    """Doubt columns that contradict each other."""
    measured = {use.role for use in draft.uses if use.role}
    values = {role: np.asarray(draft.data[role], dtype=float) for role in measured if ROLES[role].unit}
    turning = table_process(draft, options) in (None, "turning") and measured.isdisjoint(("ae", "fz", "fm", "z"))
    if turning and {"f", "d"} <= measured:
        area = values["f"] * values["d"]
        if "Fc" in measured:
            _compare(draft, ("Fc", "f", "d"), "kc = Fc/(f d)", _over(values["Fc"], area), KC_LIMITS, KC_USUAL, "N/mm2")
        elif {"P", "V"} <= measured:
            kc = _over(60000 * values["P"], values["V"] * area)
            _compare(draft, ("P", "V", "f", "d"), "kc = 60000 P/(V f d)", kc, KC_LIMITS, KC_USUAL, "N/mm2")
    if {"Rz", "Ra"} <= measured:
        _compare(draft, ("Rz", "Ra"), "Rz/Ra", _over(values["Rz"], values["Ra"]), ROUGHNESS_LIMITS, (3, 10), "")
    _compare_force(draft, values)


def _over(above: Array, below: Array) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = above / below
    return np.where(np.isfinite(ratio) & (ratio > 0), ratio, np.nan)


def _compare(
    draft: Draft, roles: tuple[str, ...], name: str, ratio: Array, limits: tuple[float, float],
    usual: tuple[float, float], unit: str,
) -> None:  # fmt: skip
    """Doubt a ratio of columns whose median is implausible, or that is far from its median in a few rows."""
    known = ratio[~np.isnan(ratio)]
    if len(known) < FEWEST:
        return
    middle = float(np.sort(known)[len(known) // 2])
    low, high = map(format_decimal, usual)
    if not limits[0] <= middle <= limits[1]:
        sentence = (
            f"{name} is {format_decimal(middle)} {unit}".rstrip()
            + f" (usual {low} to {high}): {_one_of(roles)} is in another unit or exchanged"
        )
        draft.doubts.append(Doubt(roles, sentence))
        return
    with np.errstate(invalid="ignore"):
        odd = np.flatnonzero((ratio > middle * DEVIATION) | (ratio < middle / DEVIATION))
    if 0 < len(odd) <= len(known) // 3:
        sentence = (
            f"{places(draft, odd)}: {name} is {format_decimal(float(ratio[odd[0]]))} {unit}".rstrip()
            + f", {format_decimal(middle)} in the middle of all rows: {_one_of(roles)} is wrong there"
        )
        draft.doubts.append(Doubt(roles, sentence))


def _one_of(roles: tuple[str, ...]) -> str:
    return f"{', '.join(roles[:-1])} or {roles[-1]}"


def _compare_force(draft: Draft, values: dict[str, Array]) -> None:
    """Doubt a resultant force that is not the root of the squares of its three components."""
    if not {"F", "Fx", "Fy", "Fz"} <= set(values):
        return
    ratio = _over(values["F"], np.sqrt(values["Fx"] ** 2 + values["Fy"] ** 2 + values["Fz"] ** 2))
    known = ratio[~np.isnan(ratio)]
    if len(known) >= FEWEST and not 0.8 < float(np.median(known)) < 1.25:
        times = format_decimal(float(np.median(known)))
        sentence = f"F is {times} times sqrt(Fx^2 + Fy^2 + Fz^2): one of the four is in another unit"
        draft.doubts.append(Doubt(("F", "Fx", "Fy", "Fz"), sentence))
