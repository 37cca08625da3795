"""Loading of the public names of a package when they are first used.

A package names its public objects in its stub ``__init__.pyi``, one line each: ``from .module import name as name``.
lazy_loader does the same, but importing it and parsing stubs with ``ast`` takes longer than a whole package here does.
Functions have their arguments checked (`calls.checked`) where they are used from outside; the package itself imports
them from their modules.
"""

from collections.abc import Callable
from functools import lru_cache
from importlib import import_module
from types import FunctionType

from .calls import checked
from .suggestions import did_you_mean


def lazy_names(package: str, file: str) -> tuple[Callable[[str], object], Callable[[], list[str]], list[str]]:
    """``__getattr__``, ``__dir__`` and ``__all__`` of a package, from its stub.

    Parameters
    ----------
    package, file : str
        ``__name__`` and ``__file__`` of the package.

    Examples
    --------
    >>> from fitmodels import datasets
    >>> "read_runs" in dir(datasets), datasets.read_runs.__name__
    (True, 'read_runs')
    """
    modules = {}
    with open(f"{file.removesuffix('.py')}.pyi", encoding="utf-8") as stub:  # noqa: PTH123  pathlib is slow to import
        for line in stub:
            if line.startswith("from ."):
                _, module, _, _, _, name = line.split()
                modules[name] = module

    def load(name: str) -> object:
        if name not in modules:
            hint = did_you_mean(name, modules, 0.7, names="Its public names: ")
            raise AttributeError(f"module {package!r} has no attribute {name!r}. {hint}", name=name)
        return _at_the_package(getattr(import_module(modules[name], package), name), name, package)

    return load, lambda: list(modules), list(modules)


@lru_cache(maxsize=512)
def _at_the_package(thing: object, name: str, package: str) -> object:
    """A public function with its arguments checked; everything else as it is."""
    if not isinstance(thing, FunctionType):
        return thing
    function = checked(thing)
    function.__module__, function.__name__, function.__qualname__ = package, name, name  # where pickle finds this one
    return function
