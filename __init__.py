"""Small empirical models of machining, fitted from a laboratory's own files.

``analyse`` is the main job in one call. The packages, in the order of the data::

    datasets     a laboratory's file -> columns, units, runs
    fit          static laws: power, exponential and load laws, checks, posteriors
    ident        dynamics: records -> models that simulate, PI gains
    parameters   the parameter file: write, read, predict, export
    controllers  controllers made from a parameter file, and their simulations
    cards        figures and the model card
    pipeline     the main job: tests -> laws, checks, posteriors, parameter file
    batch        thousands of pairs, on one machine or a cluster

A package is imported when it is first used.

>>> import fitmodels
>>> analysis = fitmodels.analyse(fitmodels.datasets.bundled("ac2017_table1"), draws=1000)
>>> [law.response for law in analysis.laws]
['AW', 'Fxz', 'P']
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from . import batch, cards, controllers, datasets, fit, ident, parameters, pipeline
    from .core.errors import FitmodelsError
    from .core.version import __version__
    from .pipeline import Analysis, FitOptions, analyse

__all__ = [
    "Analysis",
    "FitOptions",
    "FitmodelsError",
    "__version__",
    "analyse",
    "batch",
    "cards",
    "controllers",
    "datasets",
    "fit",
    "ident",
    "parameters",
    "pipeline",
]

# Nothing is imported here: pytest runs this file on its own where the folder of the checkout is no package name.
_MODULES = {
    "Analysis": "pipeline",
    "FitOptions": "pipeline",
    "FitmodelsError": "core.errors",
    "__version__": "core.version",
    "analyse": "pipeline",
}


def __getattr__(name: str) -> object:
    if name not in __all__:
        if not __package__:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}", name=name)
        from .core.suggestions import did_you_mean

        hint = did_you_mean(name, __all__, 0.7, names="Its public names: ")
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}. {hint}", name=name)
    module = import_module(f".{_MODULES.get(name, name)}", __name__)
    return getattr(module, name) if name in _MODULES else module


def __dir__() -> list[str]:
    return list(__all__)
