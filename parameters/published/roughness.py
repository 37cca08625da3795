"""Turning of Ck 45 at constant roughness through constant force: SURF, eq. 5, Table 1 and the text round them.

    Ra = 0.2401 exp(0.0034 F)                       um, N                                        eq. 5
    F(s)/fc(s) = kc a / ((tc s + 1)(ts s + 1))      N per mm/rev                                 reconstructed

Source: the paper on surface roughness control in turning by constant force (GF NDM 16 lathe, Ck 45; the copy used names
neither authors nor year). It prints eq. 5, ts 0.13 s, 610 rpm, 10 ms, the override of 0 to 150 % of 0.2 mm/rev and the
threshold of 100 N. Reconstructed or assumed: eq. 4 (reference force), kc a, tc, the time above the threshold.
"""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from ...core.errors import UsageError
from ...core.verdict import DO_NOT_USE
from ...core.version import __version__
from ...datasets.sets import bundled
from ..file import ParameterFile, sealed
from . import unchecked

Reading = Literal["inverse", "regression"]

A, B = 0.2401, 0.0034  # eq. 5: um, 1/N
EXPERIMENTS = 1500
SPINDLE_SPEED = 610.0  # 1/min
SERVO_TIME, SAMPLE_TIME = 0.13, 0.01  # s
FEED, OVERRIDE, THRESHOLD = 0.2, 1.5, 100.0  # mm/rev, share of it, N
REVOLUTION = 60 / SPINDLE_SPEED  # s
WAIT = 0.3  # s; the paper says "a specified time": three revolutions, in which the force builds up to 95 %

SOURCE = "constant-roughness paper (SURF), Table 1 and eq. 5"


@dataclass(frozen=True, slots=True)
class TableRow:
    """A row of Table 1: roughness in um, force in N, feed in mm/rev; ``F_without`` and ``f_without`` are one cut."""

    number: int
    Ra_ref: float
    F_without: float
    f_without: float
    F: float
    f: float
    Ra: float


def table1() -> tuple[TableRow, ...]:
    """The eight simulations of the paper, from the bundled set ``surf_table1``.

    Examples
    --------
    >>> table1()[2].F_without
    556.23
    """
    lines = bundled("surf_table1").read_text(encoding="utf-8").splitlines()
    rows = [[float(cell) for cell in line.split(",")] for line in lines if line[:1].isdigit()]
    return tuple(TableRow(int(number), *rest) for number, *rest in rows)


def surf(simulation: int = 3, *, force_from: Reading = "inverse", feed: float = FEED) -> ParameterFile:
    """SURF: one of its simulations as a parameter file.

    Parameters
    ----------
    simulation : int
        Row of Table 1: its desired roughness, and kc a = F/f of its cut without control.
    force_from : {"inverse", "regression"}
        The reading of the lost eq. 4, each with the roughness law that it belongs to: the inverse of eq. 5 with eq. 5;
        or the regression of the controlled forces on ln Ra_ref (450 + 260 ln Ra N) with the law of the controlled
        columns, on which eq. 5 does not lie.
    feed : float
        Programmed feed, mm/rev: 0.2 is the one that the paper states (for simulation 3).

    Raises
    ------
    UsageError
        Table 1 has no such row.

    Examples
    --------
    >>> round(surf().roughness.force), round(surf(force_from="regression").roughness.force)
    (558, 573)
    """
    rows = {row.number: row for row in table1()}
    if simulation not in rows:
        raise UsageError(f"simulation {simulation!r}: Table 1 of the paper has {', '.join(map(str, rows))}.")
    a, b = (A, B) if force_from == "inverse" else _line("ln Ra", tuple(rows.values()))
    sections: dict[str, object] = {
        "identity": {
            "tool": "unnamed-tool", "work": "Ck 45", "machine": "GF NDM 16 lathe",
            "setup": f"turning at {SPINDLE_SPEED:g} rpm; d 1 mm is stated for simulation 3 alone",
            "sensors": [{"symbol": "F", "unit": "N", "model": "Kistler dynamometer", "sample_rate": 1 / SAMPLE_TIME}],
            "simulated": True, "note": "Table 1 holds simulations by the paper's own model, no measurement.",
        },
        "laws": {"Ra": _equation_5(rows) if force_from == "inverse" else _controlled(a, b, rows)},
        "roughness": _settings(rows[simulation], force_from, feed, (a, b), _line("F", tuple(rows.values()))),
        "provenance": {
            "fitmodels": __version__,
            "options": {"paper": "SURF", "source": SOURCE, "simulation": simulation, "force_from": force_from},
        },
    }  # fmt: skip
    return sealed(ParameterFile.model_validate(sections))


def _line(what: Literal["ln Ra", "F"], rows: tuple[TableRow, ...]) -> tuple[float, float]:
    """Least squares over the controlled columns: (a, b) of Ra = a exp(b F), or F on ln Ra_ref as (constant, slope)."""
    F = np.array([row.F for row in rows])
    if what == "F":
        slope, constant = np.polyfit(np.log([row.Ra_ref for row in rows]), F, 1)
        return float(constant), float(slope)
    b, ln_a = np.polyfit(F, np.log([row.Ra for row in rows]), 1)
    return float(np.exp(ln_a)), float(b)


def _settings(
    row: TableRow, force_from: Reading, feed: float, law: tuple[float, float], line: tuple[float, float]
) -> dict[str, object]:
    a, b = law
    constant, slope = line
    ln = float(np.log(row.Ra_ref))
    return {
        "law": "Ra", "roughness": row.Ra_ref,
        "force": (ln - float(np.log(a))) / b if force_from == "inverse" else constant + slope * ln,
        "force_from": force_from, "regression": {"constant": constant, "slope": slope, "unit": "N"},
        "threshold": THRESHOLD, "threshold_time": WAIT, "override_low": 0.0, "override_high": OVERRIDE, "feed": feed,
        "sample_time": SAMPLE_TIME, "servo_time": SERVO_TIME, "force_per_feed": row.F_without / row.f_without,
        "process_time": REVOLUTION,
        "notes": [
            f"Reconstruction: eq. 4 is lost; the reference force is {_READING[force_from]}.",
            f"Reconstruction: kc a is F/f of simulation {row.number} without control (Table 1 spans 2586 to 2781 "
            "N per mm/rev), the process time constant one revolution.",
            f"Assumption: {WAIT:g} s above the threshold, three revolutions; the paper says a specified time.",
            "The paper limits the feed by chip thickness too and prints no value: none stands here.",
        ],
    }  # fmt: skip


_READING = {"inverse": "the inverse of eq. 5", "regression": "the regression of Table 1's controlled F on ln Ra_ref"}


def _equation_5(rows: dict[int, TableRow]) -> dict[str, Any]:
    forces = [row.F_without for row in rows.values()]
    return _law(
        A, B, forces, n=EXPERIMENTS, uncertainty="the paper prints none",
        verdict=unchecked(
            "the paper prints neither its experiments nor an error of the law",
            "The range of F is that of simulations; feed, which roughness depends on most, is not in the law.",
        ),
        notes=[
            f"Eq. 5 as printed, by the paper from {EXPERIMENTS} experiments that it does not print. Least squares of "
            "ln Ra_ref on F_without over the eight rows of Table 1 gives the same digits.",
            "Assumption: F from and to the forces without control of Table 1; no range is printed.",
        ],
    )  # fmt: skip


def _controlled(a: float, b: float, rows: dict[int, TableRow]) -> dict[str, Any]:
    forces = [row.F for row in rows.values()]
    why = "the eight points are results of a simulation: their scatter is no error of measurement"
    how = "least squares of ln Ra on F over the controlled columns of Table 1, where eq. 5 is up to 16 % high"
    reason = "The law was fitted to eight results of a simulation, on which the printed law is up to 16 % high."
    verdict = unchecked("the eight points are no measurements", reason, level=DO_NOT_USE)
    return _law(a, b, forces, n=len(rows), uncertainty=why, verdict=verdict, notes=[f"Reconstruction: {how}."])


def _law(
    a: float, b: float, forces: list[float], *, n: int, uncertainty: str, verdict: dict[str, object], notes: list[str]
) -> dict[str, Any]:
    low, high = min(forces), max(forces)
    return {
        "form": "exponential", "response": "Ra", "quantity": "arithmetic mean roughness", "unit": "um",
        "equation": f"Ra = {a:.6g} exp({b:.6g} F)", "error": "multiplicative", "coefficients": {"a": a, "b": b},
        "factors": [{"symbol": "F", "quantity": "resultant cutting force", "unit": "N", "low": low, "high": high}],
        "uncertainty": {"kind": "none", "reason": uncertainty}, "residual_scale": "ln", "n": n, "df": n - 2,
        "verdict": verdict,
        "notes": notes,
    }  # fmt: skip
