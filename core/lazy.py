"""Loading of the public names of a package when they are first used.

A package names its public objects in its stub ``__init__.pyi``, one line each: ``from .module import name as name``.
lazy_loader does the same, but importing it and parsing stubs with ``ast`` takes longer than a whole package here does.
"""

from collections.abc import Callable
from importlib import import_module


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
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(import_module(modules[name], package), name)

    return load, lambda: list(modules), list(modules)
