"""Edges whose speed, feed or depth is in another unit than that of the others, found by their wear or load."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ..core.rounding import format_decimal
from .doubts import Doubt
from .draft import Draft
from .vocabulary import ROLES

Array = NDArray[np.float64]

RATIOS = {
    "V": {3.280839895: "sfm and m/min", 60.0: "m/s and m/min", 10.0: "a decimal mark"},
    "f": {25.4: "inch and mm", 10.0: "a decimal mark"},
    "d": {25.4: "inch and mm", 10.0: "cm and mm, or a decimal mark"},
}
RESPONSES = {
    ("AW", "VB"): ("V", "f", "d"),
    ("Fc", "P", "Fxz", "F", "Fz", "Fx", "Fy", "Ff", "Fp"): ("f", "d"),  # forces hardly depend on V
}
GAP = 1.3  # ratio between the shifted edges and the others
INSIDE = 1.5  # shifted edges land among the others, or this ratio beside them
MINORITY = 1 / 3  # of the edges
EVIDENCE = 6.6  # n ln(RSS0/RSS1): 0 of 300 sound tests reach it, with 24 edges of 6 rows
CLOSE = 4.6  # less than this, 2 ln(10), and two ratios cannot be told apart
FEWEST = 8  # edges
SPARE = 3  # edges beyond the coefficients
EXACT = 1e-10  # of the total sum of squares: a test without scatter tells nothing by its residuals
MOST_ROWS = 20_000
LISTED = 6


@dataclass(frozen=True, slots=True)
class _Edges:
    """Each edge in one row: its name, the logarithms of its conditions and of its response at one time."""

    names: list[str]
    response: str
    settings: dict[str, Array]
    others: Array  # indicators of tool and work, shape (edges, levels)
    y: Array

    def residual(self, moved: dict[str, Array]) -> float:
        """Residual sum of squares of the regression on all conditions, some of them replaced."""
        columns = [moved.get(role, x) for role, x in self.settings.items()]
        X = np.column_stack([np.ones(len(self.y)), self.others, *columns])
        return float(np.sum((self.y - X @ np.linalg.lstsq(X, self.y, rcond=None)[0]) ** 2))


@dataclass(frozen=True, slots=True)
class _Shift:
    role: str
    edges: NDArray[np.bool_]
    factor: float
    evidence: float


def check_mixed_units(draft: Draft) -> None:
    """Doubt a condition of some edges that another unit brings to agree with the response of all others.

    Edges beyond a gap in one condition are moved by the ratio of two units; the doubt is raised where the
    regression of the edges' mean response then leaves much less. Residuals alone do not show such edges: by their
    leverage the exponent follows them.
    """
    measured = {use.role for use in draft.uses}
    doubted = {role for doubt in draft.doubts for role in doubt.columns}
    found: list[tuple[_Edges, list[_Shift]]] = []
    for responses, roles in RESPONSES.items():
        response = next((role for role in responses if role in measured), None)
        if response is not None and (edges := _edges(draft, response)) is not None:
            tried = [role for role in edges.settings if role in roles and role not in doubted]
            found.append((edges, [one for role in tried for one in _shifts(edges, role)]))
    found.sort(key=_most)
    if found and (best := _most(found[-1])) > EVIDENCE:
        edges, shifts = found[-1]
        first = next(one for one in shifts if one.evidence == best)
        limit = max(EVIDENCE, best - CLOSE)
        equals = [one for one in shifts if np.array_equal(one.edges, first.edges) and one.evidence > limit]
        draft.doubts.append(_doubt(edges, sorted(equals, key=lambda one: -one.evidence)))


def _most(found: tuple[_Edges, list[_Shift]]) -> float:
    return max((one.evidence for one in found[1]), default=0.0)


def _edges(draft: Draft, response: str) -> _Edges | None:
    """The edges of the first rows, where there are enough of them; rows of the same conditions without edges."""
    rows = slice(0, MOST_ROWS)
    data = {role: x[rows] for role, x in draft.numbers().items()}
    settings = {role: data[role] for role in RATIOS if role in data}
    t, y = data.get("t", np.ones(len(data[response]))), data[response]
    good = np.logical_and.reduce([x > 0 for x in (y, t, *settings.values())])
    if not settings or np.count_nonzero(good) < FEWEST:
        return None
    labels = [draft.data[role][rows][good] for role in ("edge", "tool", "work") if role in draft.data]
    by = labels if "edge" in draft.data else [*labels, *(x[good] for x in settings.values())]
    code = np.zeros(int(np.count_nonzero(good)), dtype=np.intp)
    for one in by:
        each, levels = pd.factorize(one)
        code = pd.factorize(code * len(levels) + each)[0].astype(np.intp)
    count = np.bincount(code)
    if len(count) < FEWEST:
        return None

    def mean(x: Array) -> Array:
        return np.asarray(np.bincount(code, x) / count)

    log = {role: mean(np.log(x[good])) for role, x in settings.items()}
    varying = {role: x for role, x in log.items() if np.ptp(x) > 1e-9}
    first = np.unique(code, return_index=True)[1]
    kinds = [pd.get_dummies(one[first], drop_first=True, dtype=float).to_numpy() for one in labels[-2:]
             if 1 < len(set(one[first])) <= len(count) // 4]  # fmt: skip
    others = np.column_stack([np.empty((len(count), 0)), *kinds])
    if not varying or len(count) < 1 + others.shape[1] + len(varying) + SPARE:
        return None
    names = draft.data["edge"][rows][good][first] if "edge" in draft.data else draft.lines[rows][good][first]
    level = _at_one_time(np.log(y[good]), np.log(t[good]), code, count)
    return _Edges(list(map(str, names)), response, varying, others, level)


def _at_one_time(y: Array, t: Array, code: NDArray[np.intp], count: NDArray[np.intp]) -> Array:
    """Mean of each edge, brought to ln t = 0 by the slope within edges."""
    y_mean, t_mean = np.bincount(code, y) / count, np.bincount(code, t) / count
    within = t - t_mean[code]
    spread = float(within @ within)
    slope = float(within @ (y - y_mean[code])) / spread if spread > 0 else 0.0
    return np.asarray(y_mean - slope * t_mean)


def _shifts(edges: _Edges, role: str) -> list[_Shift]:
    """Minorities beyond a gap of a condition that the ratio of two units brings among the others."""
    x, left = edges.settings[role], edges.residual({})
    if left <= EXACT * float(np.sum((edges.y - edges.y.mean()) ** 2)):
        return []
    levels = np.unique(x)
    found = []
    for cut in np.flatnonzero(np.diff(levels) > np.log(GAP)):
        below = x <= levels[cut]
        for side, sign in ((below, 1.0), (~below, -1.0)):
            if np.count_nonzero(side) > MINORITY * len(x):
                continue
            rest = x[~side]
            for factor in RATIOS[role]:
                moved = np.where(side, x + sign * np.log(factor), x)
                near = np.log(INSIDE)
                if moved[side].min() < rest.min() - near or moved[side].max() > rest.max() + near:
                    continue
                then = max(edges.residual({role: moved}), 1e-300)
                found.append(_Shift(role, side, factor**sign, len(x) * float(np.log(left / then))))
    return found


def _doubt(edges: _Edges, shifts: list[_Shift]) -> Doubt:
    best = shifts[0]
    names = [name for name, shifted in zip(edges.names, best.edges, strict=True) if shifted]
    named = ", ".join(names[:LISTED]) + (f" and {len(names) - LISTED} more" if len(names) > LISTED else "")
    ways = []
    for one in shifts:
        x = np.exp(edges.settings[one.role][one.edges])
        low, high = format_decimal(float(x.min())), format_decimal(float(x.max()))
        values = low if low == high else f"{low} to {high}"
        ratio = max(one.factor, 1 / one.factor)
        way = "multiplied" if one.factor > 1 else "divided"
        units = next(cause for known, cause in RATIOS[one.role].items() if np.isclose(known, ratio))
        ways.append(f"{one.role} {values} {ROLES[one.role].unit} {way} by {ratio:.4g} ({units})")
    one_edge = len(names) == 1
    sentence = (
        f"edge{'' if one_edge else 's'} {named}: with {', or '.join(ways)} the {edges.response} agrees with that of "
        f"the other edges; check the unit of {'this edge' if one_edge else 'these edges'}"
    )
    return Doubt(tuple(dict.fromkeys(one.role for one in shifts)), sentence)
