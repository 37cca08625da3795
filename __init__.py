"""fitmodels: small empirical models of machining, fitted from a laboratory's own files.

The rooms, in the order the data walk through them::

    datasets    what was measured       a lab file -> columns and units -> Runs
    fit         static laws             power, exponential and load laws
    ident       dynamics                records -> models that simulate, PI gains
    parameters  what is handed over     the parameter file: write, read, predict, export
    controllers who uses it             replayed from a parameter file alone
    cards       what is told            figures and the model card
    batch       a shop of pairs         thousands of them, on one machine or a cluster

A room is imported when it is first used, so that ``import fitmodels`` costs next to nothing.

>>> import fitmodels
>>> fitmodels.fit.power_law  # doctest: +ELLIPSIS
<function power_law at ...>
"""

from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING

from .core.version import __version__

if TYPE_CHECKING:
    from . import batch, cards, controllers, datasets, fit, ident, parameters

__all__ = ["__version__", "batch", "cards", "controllers", "datasets", "fit", "ident", "parameters"]


def __getattr__(name: str) -> ModuleType:
    if name in __all__:
        return import_module(f".{name}", __name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
