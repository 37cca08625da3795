"""The data sets that come with the package, by name."""

from difflib import get_close_matches
from importlib.resources import files
from pathlib import Path

from ..core.errors import UsageError


def bundled_names() -> tuple[str, ...]:
    """Names of the bundled sets, in alphabetical order.

    >>> from fitmodels.datasets.bundles import bundled_names
    >>> "gc435_709m40" in bundled_names()
    True
    """
    return tuple(sorted(f.name for f in _folder().iterdir() if (f / "data.csv").is_file()))


def bundled(name: str) -> Path:
    """Path of a bundled set's data.csv; its README.md, with source, units and traps, stands beside it.

    Parameters
    ----------
    name : str
        one of `bundled_names()`

    Raises
    ------
    UsageError
        for a name that is not bundled, with the nearest that is

    Examples
    --------
    >>> from fitmodels.datasets.bundles import bundled
    >>> bundled("ac2017_table1").name
    'data.csv'

    """
    known = bundled_names()
    if name not in known:
        near = get_close_matches(name, known, n=1)
        hint = f"did you mean {near[0]!r}?" if near else "give one of those."
        raise UsageError(f"no bundled data set {name!r} (there are {', '.join(known)}); {hint}")
    return _folder() / name / "data.csv"


def _folder() -> Path:
    return Path(str(files(__package__)))
