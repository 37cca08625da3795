"""States of the constant-load controller: condition, feed and time of each, in one table.

HAL, ST and C are written from it or compared with it; `fitmodels.controllers.ConstantLoad` is its arithmetic.
"""

from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Final


class State(IntEnum):
    """State of the controller, in the number that every export gives it.

    Examples
    --------
    >>> State.FAULT.name, int(State.FAULT)
    ('FAULT', 5)
    """

    OFF = 0
    AIR = 1
    ENTRY = 2
    CONTROL = 3
    WORN = 4
    FAULT = 5


@dataclass(frozen=True, slots=True)
class StateRow:
    """One row of the table: a state, its condition, the feed in it, and how fast the feed gets there."""

    state: State
    condition: str
    feed: str
    time: str


STATES: Final = (
    StateRow(
        State.OFF,
        "enable is off, or the spindle has not run for arm_after",
        "lower limit while enable is on; while it is off the programmed feed within the limits before a cut, and after "
        "one the last feed, until the path stops and the load is below the threshold",
        "back_off and recover",
    ),
    StateRow(State.AIR, "armed, load below the threshold", "lower limit before the first cut, then the last feed",
             "back_off"),
    StateRow(State.ENTRY, "armed, load above the threshold for less than engage_after, or the path does not advance",
             "as in air", "engage_after"),
    StateRow(State.CONTROL, "armed, load above the threshold for engage_after, the path advances",
             "PI from the last feed",
             "back_off and recover"),
    StateRow(State.WORN, "control, and the mean feed rested on the lower limit for dwell; latched until reset",
             "as in control; pin worn", "dwell"),
    StateRow(
        State.FAULT,
        "armed, and readings invalid for lost_after, equal for stuck_after in the cut, or no heartbeat; or mean load "
        "above 1.05 times that of a worn tool for overload_after; latched until reset without the cause",
        "lower limit; inhibited on an overload, and on a fault where chosen; pins fault and overload",
        "back_off",
    ),
)  # fmt: skip

_HELD: Final = "the last feed, at most the approach feed, after a cut"
_OF_FORCE: Final = {
    State.OFF: f"from power-on the lower limit, the approach feed once air is known for engage_after; {_HELD}",
    State.AIR: f"from power-on the lower limit, the approach feed once air is known for engage_after; {_HELD}",
    State.ENTRY: "held",
}
_LAWS: Final = {
    "ratio": "feed of the servo times reference over force, no faster than recover from entry until it first falls and "
    "while readings repeat",
    "adaptive": "adaptive law on the force of the last revolution, no rise while the reading is below the threshold, "
    "no faster than recover while readings repeat",
}


def states_of(law: str) -> tuple[StateRow, ...]:
    """The table for one law: ``pi``, ``ratio`` (constant roughness) or ``adaptive`` (adaptive force).

    Examples
    --------
    >>> states_of("ratio")[2].feed
    'held'
    """
    if law == "pi":
        return STATES
    feeds = {**_OF_FORCE, State.CONTROL: _LAWS[law]}
    return tuple(replace(row, feed=feeds.get(row.state, row.feed)) for row in STATES)
