"""Tool life at constant load by calculation: ideal regulation, tool change on reaching the lower feed limit.

    fm(VB) = fm0 - s VB between the limits, fm0 = (I - A)/B, s = k1/B    eq. 15 of Tai, Tsai & Li 2023
    life = integral of dVB / (dVB/dt at fm(VB)),    length = integral of fm dt

A replay adds the dwell on the limit and the transients of the loop. Computed for one tool or for many draws.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...core.arrays import Array
from ...core.display import Plottable, as_columns
from ...parameters.draws import Draws
from .control_laws import line_of
from .cut_model import CutModel, unit_factor

if TYPE_CHECKING:
    from ...core.display import Frame
    from ...parameters import LawSection, ParameterFile
    from ...parameters.sections.load_line import LoadLineSection

STEPS = 400  # of the wear, for the integrals


@dataclass(frozen=True, slots=True, repr=False)
class SteadyLife(Plottable):
    """Wear at the lower limit, s in the cut and mm up to it, shape (n,), one per tool; NaN where it is not reached."""

    wear: Array
    time: Array
    length: Array

    def to_frame(self) -> "Frame":
        """One row per tool: wear, s and mm."""
        return as_columns(self, "wear", "time", "length")


def steady_life(cut: CutModel, line: "LoadLineSection", **changed: Array) -> SteadyLife:
    """Life of tools at constant load.

    Parameters
    ----------
    cut : CutModel
    line : LoadLineSection
        Reference and feed limits.
    **changed : ndarray, shape (n,)
        Coefficients that differ from tool to tool: A, B, k1, c0, n, m.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> pf = published("CLM-2023")
    >>> life = steady_life(CutModel.from_parameters(pf), pf.load_line)
    >>> print(f"{life.wear[0]:.0f} um, {life.time[0] / 60:.2f} min, {life.length[0]:.0f} mm")
    201 um, 2.58 min, 2067 mm
    """
    names = ("A", "B", "k1", "c0", "n", "m")
    A, B, k1, c0, n, m = np.broadcast_arrays(*(np.atleast_1d(changed.get(k, np.array(getattr(cut, k)))) for k in names))
    low, high = line.lower.value, line.upper.value
    wear = (line.reference - A - B * low) / k1
    wear = np.where((wear > 0) & (B > 0) & (k1 > 0) & (n > 0), wear, np.nan)
    grid = np.linspace(0.0, 1.0, STEPS + 1)[:, None] * wear ** (1 / n)  # of wear^(1/n), which grows evenly at one feed
    feed = np.clip((line.reference - A - k1 * grid**n) / B, low, high)
    pace = (c0 * feed**m) ** (-1 / n)
    return SteadyLife(wear, _integral(pace, grid), _integral(pace * feed * unit_factor(cut.unit_feed, "mm/s"), grid))


def drawn_life(pf: "ParameterFile", draws: Mapping[str, Draws]) -> tuple[SteadyLife, tuple[str, ...]]:
    """Life over the draws of load law and wear law, with the responses whose draws were used.

    Draws of two laws are paired in order, up to the smaller number; a law without draws is fixed at its estimates.
    """
    cut, line = CutModel.from_parameters(pf), line_of(pf)
    law = pf.laws[line.law]
    wear = pf.laws[law.factors[-1].symbol]
    found = {of.response: _columns(of, draws[of.response]) for of in (law, wear) if of.response in draws}
    n = min((len(next(iter(columns.values()))) for columns in found.values()), default=0)
    changed: dict[str, Array] = {}
    for response, columns in found.items():
        kept = {name: values[:n] for name, values in columns.items()}
        changed |= _load(kept, cut, line) if response == law.response else _wear(kept, cut, wear)
    return steady_life(cut, line, **changed), tuple(found)


def _columns(law: "LawSection", of: Draws) -> dict[str, Array]:
    return {name: of.values[:, of.names.index(name)] for name in law.parameter_names if name in of.names}


def _load(columns: dict[str, Array], cut: CutModel, line: "LoadLineSection") -> dict[str, Array]:
    if "fm0" in columns:
        return {"A": line.reference - cut.B * columns["fm0"], "k1": -cut.B * columns["slope"]}
    return columns


def _wear(columns: dict[str, Array], cut: CutModel, law: "LawSection") -> dict[str, Array]:
    """c0 for time in s: the constant of the file times the ratio of each draw to it."""
    per_min = {"n": columns.get("t"), "m": columns.get("fm")}
    out = {name: values for name, values in per_min.items() if values is not None}
    ln = columns["ln c0"] - np.log(law.coefficients["c0"])
    for factor in law.factors:
        moved = columns.get(factor.symbol, law.coefficients[factor.symbol]) - law.coefficients[factor.symbol]
        if factor.symbol == "t":
            ln = ln - moved * np.log(unit_factor(factor.unit, "s"))
        elif factor.symbol == "fm":
            ln = ln + moved * np.log(unit_factor(cut.unit_feed, factor.unit))
        else:
            ln = ln + moved * np.log(factor.low)
    return {**out, "c0": cut.c0 * np.exp(ln)}


def _integral(y: Array, x: Array) -> Array:
    return np.asarray(((y[1:] + y[:-1]) / 2 * np.diff(x, axis=0)).sum(axis=0), dtype=np.float64)
