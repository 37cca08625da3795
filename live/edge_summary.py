"""Life of one edge as learning needs it, in constant memory: contact by conditions, last windows, measurements."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import exp, isfinite, log
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from ..core.arrays import is_positive
from ..core.errors import ParameterError, UsageError
from ..core.rounding import count
from .samples import Window

if TYPE_CHECKING:
    from ..parameters import LawSection, ParameterFile

MOST_CELLS = 128  # conditions that are kept apart
SAME = 0.005  # difference of ln up to which conditions are one
RECENT = 30  # windows that are kept
LAST_SHARE, FEWEST = 0.05, 3  # part of the contact, and windows, whose loads stand beside a measurement
MOST_MARKS = 50  # measurements of one edge


@dataclass(slots=True)
class Cell:
    """Contact at one set of conditions: minutes, and the mean of the ln of each condition."""

    minutes: float
    ln: dict[str, float]

    def add(self, minutes: float, ln: Mapping[str, float]) -> None:
        """Add contact at about the same conditions."""
        total = self.minutes + minutes
        self.ln = {name: value + (ln[name] - value) * (minutes / total) for name, value in self.ln.items()}
        self.minutes = total

    def distance(self, ln: Mapping[str, float]) -> float:
        """Largest difference of a ln; infinite where other conditions are known."""
        if self.ln.keys() != ln.keys():
            return float("inf")
        return max((abs(value - ln[name]) for name, value in self.ln.items()), default=0.0)


@dataclass(frozen=True, slots=True)
class Mark:
    """A measurement of the wear of an edge.

    Attributes
    ----------
    symbol : str
    wear : float
        In the unit of its law.
    minutes : float
        Of contact until then.
    cells : tuple of Cell
        Contact until then.
    ln_loads, ln_conditions : dict of float
        Mean ln of the loads in the last windows, and of the conditions there; empty where there was none.
    """

    symbol: str
    wear: float
    minutes: float
    cells: tuple[Cell, ...]
    ln_loads: dict[str, float]
    ln_conditions: dict[str, float]


@dataclass(slots=True)
class EdgeSummary:
    """One edge from its first cut on.

    Attributes
    ----------
    edge : str
        Its name, another one for every edge.
    minutes : float
        Of contact so far.
    gaps : int
        Times that contact may have been missed: a signal lost in mid-cut, a program that began at a used edge.
    chips : int
        Alarms of chipping: the wear is then not that of the law alone.

    Examples
    --------
    >>> from fitmodels.live.samples import LoadMean
    >>> edge = EdgeSummary("2024-05-01 E1")
    >>> for i in range(20):
    ...     edge.add(Window(60.0 * i, 60.0 * i + 60, 1.0, {"V": 120.0, "f": 0.2}, {"P": LoadMean(0.6, 0.01, 50)}))
    >>> mark = edge.measured("VB", 0.21)
    >>> mark.minutes, mark.ln_loads, len(mark.cells)
    (20.0, {'P': 0.6}, 1)
    >>> EdgeSummary.from_json(edge.as_json()) == edge
    True
    """

    edge: str
    minutes: float = 0.0
    cells: list[Cell] = field(default_factory=list)
    recent: list[dict[str, Any]] = field(default_factory=list)
    marks: list[Mark] = field(default_factory=list)
    gaps: int = 0
    chips: int = 0

    def missed(self) -> None:
        """Note that contact may have been missed, so that ``minutes`` may be too few."""
        self.gaps += 1

    def add(self, window: Window) -> None:
        """Take in a window: its contact, conditions and loads."""
        self.advance(window.contact, window.conditions)
        loads = {name: mean.ln for name, mean in window.loads.items() if isfinite(mean.ln)}
        self.recent.append({"at": self.minutes, "ln": _logs(window.conditions), "loads": loads})
        del self.recent[:-RECENT]

    def advance(self, minutes: float, conditions: Mapping[str, float]) -> None:
        """Take in contact without a usable load."""
        if not (minutes >= 0 and isfinite(minutes)):
            raise UsageError(f"contact of {minutes} min: it needs a number of 0 or more.")
        if minutes == 0:
            return
        self.minutes += minutes
        ln = _logs(conditions)
        near = min(self.cells, key=lambda cell: cell.distance(ln), default=None)
        if near is not None and near.distance(ln) <= (SAME if len(self.cells) < MOST_CELLS else float("1e300")):
            near.add(minutes, ln)
        else:
            self.cells.append(Cell(minutes, ln))

    def measured(self, symbol: str, wear: float) -> Mark:
        """Note a measurement of the wear, of a gauge in mid-life or of the finished edge.

        Raises
        ------
        UsageError
            The wear is not above zero, or nothing was cut since the edge was new.
        """
        if not is_positive(wear):
            raise UsageError(f"{symbol}={wear:g}: a measured wear is above zero.")
        if not self.minutes > 0:
            raise UsageError(f"a new edge has no wear: edge {self.edge!r} has not cut yet; measure it after a cut.")
        self.require_room()
        last = [one for one in self.recent if one["at"] >= (1 - LAST_SHARE) * self.minutes]
        last = last if len(last) >= FEWEST else self.recent[-FEWEST:]
        cells = tuple(Cell(cell.minutes, dict(cell.ln)) for cell in self.cells)
        mark = Mark(symbol, wear, self.minutes, cells, _means(last, "loads"), _means(last, "ln"))
        self.marks.append(mark)
        return mark

    def require_room(self) -> None:
        """Refuse a measurement beyond the number that is kept (UsageError)."""
        if len(self.marks) >= MOST_MARKS:
            raise UsageError(f"at most {MOST_MARKS} measurements are kept of one edge, and {self.edge!r} has them.")

    def as_json(self) -> dict[str, Any]:
        """Exact copy as data of JSON."""
        marks = [
            {"symbol": m.symbol, "wear": m.wear, "minutes": m.minutes, "cells": _cells(m.cells),
             "ln_loads": m.ln_loads, "ln_conditions": m.ln_conditions}
            for m in self.marks
        ]  # fmt: skip
        cells = _cells(self.cells)
        own = {"edge": self.edge, "minutes": self.minutes, "gaps": self.gaps, "chips": self.chips}
        return {**own, "cells": cells, "recent": list(self.recent), "marks": marks}

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Self:
        """The edge that `as_json` wrote."""
        marks = [Mark(**{**mark, "cells": tuple(Cell(*cell) for cell in mark["cells"])}) for mark in data["marks"]]
        cells = [Cell(*cell) for cell in data["cells"]]
        return cls(data["edge"], data["minutes"], cells, list(data["recent"]), marks, data["gaps"], data["chips"])


def _cells(cells: Any) -> list[list[Any]]:  # noqa: ANN401
    return [[cell.minutes, dict(cell.ln)] for cell in cells]


def _logs(conditions: Mapping[str, float]) -> dict[str, float]:
    """Logarithms of the conditions that are above zero."""
    return {name: log(value) for name, value in conditions.items() if isfinite(value) and value > 0}


def _means(windows: list[dict[str, Any]], key: str) -> dict[str, float]:
    """Mean of each value over the windows that have it."""
    names = dict.fromkeys(name for one in windows for name in one[key])
    held = {name: [one[key][name] for one in windows if name in one[key]] for name in names}
    return {name: sum(values) / len(values) for name, values in held.items()}


def check_edges(edges: Sequence[EdgeSummary], *, certain: bool) -> None:
    """Refuse edges without a measurement and, unless ``certain``, those that chipped or whose contact is not all known.

    Raises
    ------
    UsageError
        The message names the edge.
    """
    if not edges:
        raise UsageError("no edge is given; learning needs one whose wear was measured.")
    for edge in edges:
        if not edge.marks:
            raise UsageError(f"no measured wear of edge {edge.edge!r}; give it with --measured VB=0.21mm.")
        if edge.chips and not certain:
            raise UsageError(
                f"a chipped edge does not follow the wear law: {edge.edge!r} had "
                f"{count(edge.chips, 'alarm')} of chipping. Leave it out, or give certain=True if it did not chip."
            )
        if edge.gaps and not certain:
            raise UsageError(
                f"the contact of edge {edge.edge!r} is {edge.minutes:.3g} min or more: the signal was lost in a cut, "
                f"or the watch began at a used edge ({count(edge.gaps, 'time')}). A law of too short a time is wrong; "
                "give certain=True if the time is right."
            )


def equivalent_row(mark: Mark, exponents: Mapping[str, float], time: float) -> dict[str, float]:
    """Logarithms of the conditions and of the time t that, held constant, give the wear until a measurement.

    With ``w = C t^m`` and C = prod x^a, wear grows as ``w^(1/m) = S = integral C^(1/m) dt``, so that a minute at
    conditions x weighs ``C(x)^(1/m)`` in their mean. With t = S / C^(1/m) at that mean the law gives the same wear, and
    the same derivatives by all of its parameters: an error of the exponents used here has an effect of second order.

    Parameters
    ----------
    mark : Mark
    exponents : mapping
        a of each condition in the wear law; a condition that it lacks has none.
    time : float
        m; where it is not above zero, minutes weigh alike.

    Examples
    --------
    >>> mark = Mark("VB", 0.2, 20.0, (Cell(10.0, {"V": 4.0}), Cell(10.0, {"V": 5.0})), {}, {})
    >>> row = equivalent_row(mark, {"V": 1.0}, 0.5)
    >>> round(row["V"], 3), round(exp(row["t"]), 1), equivalent_row(mark, {}, 0.5)["V"]
    (4.881, 14.4, 4.5)
    """
    names = sorted(set.intersection(*(set(cell.ln) for cell in mark.cells)))
    m = time if time > 0 else float("inf")
    power = [sum(exponents.get(name, 0.0) * cell.ln[name] for name in names) / m for cell in mark.cells]
    weight = [cell.minutes * exp(value - max(power)) for cell, value in zip(mark.cells, power, strict=True)]
    pairs = list(zip(mark.cells, weight, strict=True))
    ln = {name: sum(w * cell.ln[name] for cell, w in pairs) / sum(weight) for name in names}
    at_mean = sum(exponents.get(name, 0.0) * value for name, value in ln.items()) / m
    return {**ln, "t": log(sum(weight)) + max(power) - at_mean}


def law_rows(
    pf: "ParameterFile", law: "LawSection", marks: Sequence[Mark], given: Mapping[str, float | str]
) -> tuple[list[list[float]], str]:
    """Rows of an edge for a law, columns and response; or the reason why there are none."""
    rows, why = [], ""
    for mark in marks:
        values, missing = _values(pf, law, mark, given)
        if missing:
            why = missing
            continue
        columns = law.formula.columns(np.array([values[factor.symbol] for factor in law.factors]))[1:]
        response = log(values[law.response]) if law.error == "multiplicative" else values[law.response]
        rows.append([*(float(x) for x in np.ravel(columns)), *_indicators(law, given), response])
    return rows, why


def _indicators(law: "LawSection", given: Mapping[str, float | str]) -> list[float]:
    """1 at the level of the category that was cut, 0 at the others."""
    if law.by is None:
        return []
    level = str(given[law.by.column])
    return [1.0 if level == name else 0.0 for name in law.by.shifts]


def _values(
    pf: "ParameterFile", law: "LawSection", mark: Mark, given: Mapping[str, float | str]
) -> tuple[dict[str, float], str]:
    """Factors and response of a law at a measurement, in its units; or why one is not known."""
    wear = pf.laws[mark.symbol]
    if law.response == mark.symbol:
        exponents = {name: value for name, value in law.coefficients.items() if law.form == "power"}
        ln = equivalent_row(mark, exponents, exponents.get("t", 0.0))
    else:
        ln = {**mark.ln_conditions, **mark.ln_loads, "t": log(mark.minutes)}
    usual = {name: exp(value) for name, value in ln.items()}
    usual |= {name: float(value) for name, value in given.items() if name not in usual and not isinstance(value, str)}
    values = {factor.symbol: _in(usual.get(factor.symbol), factor.symbol, factor.unit) for factor in law.factors}
    values |= {law.response: usual.get(law.response)}
    if mark.symbol in values:
        values[mark.symbol] = _convert(mark.wear, wear.unit, _unit(law, mark.symbol))
    if law.response != mark.symbol and values[law.response] is None:
        return {}, f"no steady {law.response} was read before its measurement"
    if missing := [name for name, value in values.items() if value is None]:
        return {}, f"{', '.join(missing)} not known at its measurement"
    if law.by is not None and str(given.get(law.by.column)) not in (law.by.reference, *law.by.shifts):
        levels = ", ".join((law.by.reference, *law.by.shifts))
        return {}, f"the level of {law.by.column} ({levels}) is not given"
    return {name: float(value) for name, value in values.items() if value is not None}, ""


def _unit(law: "LawSection", symbol: str) -> str:
    """Unit of the response or of a factor of a law."""
    return next((factor.unit for factor in law.factors if factor.symbol == symbol), law.unit)


def _in(value: float | None, symbol: str, unit: str) -> float | None:
    """A value of the usual unit of its symbol in that of a law."""
    from ..datasets.vocabulary import ROLES

    return None if value is None else _convert(value, ROLES[symbol].unit if symbol in ROLES else unit, unit)


def _convert(value: float, unit: str, to: str) -> float:
    from ..parameters.messages import in_unit

    found = in_unit(value, unit, to)
    if found is None:
        raise ParameterError(f"{value:g} {unit} cannot be converted to {to or 'no unit'}; fit the data in usual units.")
    return found
