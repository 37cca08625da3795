"""Verdicts expected of the bundled and real sets and of faulty files, written down before the checks were programmed.

Each entry is what a person who knows cutting would conclude from the data: the level, and words that the reasons name.
"""

from typing import NamedTuple

USABLE, RESERVATIONS, DO_NOT_USE = 0, 1, 2


class Expected(NamedTuple):
    """Levels that are right for a law, and words of which the reasons name each (any of those separated by ``|``)."""

    set: str
    response: str
    levels: tuple[int, ...]
    named: tuple[str, ...] = ()


BUNDLED = (
    # 24 edges of a composite design, drawn from laws whose exponents are usual: nothing to find
    Expected("gc435_709m40", "AW", (USABLE,)),
    Expected("gc435_709m40", "P", (USABLE,)),
    # a thrust force: its exponents of V and wear are at the limit of the usual, and their intervals are wide
    Expected("gc435_709m40", "Fxz", (USABLE, RESERVATIONS)),
    # 16 computed rows without edges, at one depth and one time
    Expected("ac2017_table1", "AW", (RESERVATIONS,), ("edge",)),
    Expected("ac2017_table1", "P", (RESERVATIONS,), ("edge",)),
    Expected("ac2017_table1", "Fxz", (RESERVATIONS,), ("edge",)),
    # wear cumulated over a change of V and f: V^0.08, far below what wear does with speed
    Expected("ac2017_table2", "AW", (RESERVATIONS, DO_NOT_USE), ("edge", "V")),
    # seven rows at a held current, one of them far from the others
    Expected("clm2023_end_milling", "fm", (RESERVATIONS,), ("edge",)),
    # five rows, one of which alone determines the slope: left out, the others do not predict it
    Expected("clm2023_slot_milling", "fm", (DO_NOT_USE,), ("predicted",)),
    # 18 means without an edge, speed or depth; the idle current dominates
    Expected("cnc_mill_current", "I", (RESERVATIONS,), ("edge",)),
    Expected("surf_table1", "F", (USABLE,), ()),
    Expected("surf_table1", "Ra", (RESERVATIONS,), ("edge",)),
)

REAL = (
    # one cutting speed only, time exponents that differ between edges
    Expected("nasa_milling, material 1", "VB", (RESERVATIONS,), ("speed|V", "time exponent")),
    Expected("nasa_milling, material 2", "VB", (RESERVATIONS,), ("speed|V",)),
    # forces of 54 tests on unnamed edges, a narrow range of V
    Expected("turning_forces/exp1_runs.csv", "Fx", (RESERVATIONS,), ("edge",)),
    Expected("turning_forces/exp1_runs.csv", "Fy", (RESERVATIONS,), ("edge",)),
    Expected("turning_forces/exp1_runs.csv", "Fz", (RESERVATIONS,), ("edge",)),
    Expected("turning_forces/Exp1.csv", "Fx", (RESERVATIONS,)),
)

FAULTY = (
    Expected("V and f exchanged", "AW", (RESERVATIONS, DO_NOT_USE), ("V|f",)),
    Expected("drilling without its speed column", "VB", (RESERVATIONS, DO_NOT_USE), ("speed",)),
    Expected("wear drawn at random: R2 .02", "VB", (DO_NOT_USE,), ("R2|predicted",)),
    Expected("wear that falls with time", "VB", (DO_NOT_USE,), ("t",)),
    Expected("three rows of wear in inches", "AW", (RESERVATIONS, DO_NOT_USE), ("line",)),
    Expected("feed of four edges in inches", "AW", (DO_NOT_USE,), ("E|f",)),
    Expected("time of three edges in seconds", "AW", (RESERVATIONS, DO_NOT_USE), ("t",)),
    Expected("wear in micrometres read as mm", "AW", (DO_NOT_USE,), ("AW",)),
    Expected("four edges", "AW", (RESERVATIONS,), ("4 edges",)),
    Expected("no edge column", "AW", (RESERVATIONS,), ("edge",)),
)
