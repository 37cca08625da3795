"""Who uses it: controllers made from a parameter file alone, the plants they act on, and one loop that runs both.

    loop             the protocols of controller and plant, replay, Trace
    constant_load    CLM-2023's PI on load, as LinuxCNC runs it
    plants           what the controllers act on

>>> from fitmodels import controllers
>>> controllers.replay.__name__
'replay'
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .constant_load import ConstantLoad
    from .loop import Controller, Event, Plant, Trace, replay
    from .plants import Cut

_HOME = {
    "ConstantLoad": "constant_load",
    "Controller": "loop",
    "Cut": "plants",
    "Event": "loop",
    "Plant": "loop",
    "Trace": "loop",
    "replay": "loop",
}

__all__ = ["ConstantLoad", "Controller", "Cut", "Event", "Plant", "Trace", "replay"]


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f".{_HOME[name]}", __name__), name)
    globals()[name] = value
    return value
