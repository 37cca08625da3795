"""Numbers must not depend on who computes them: every process of a cluster has our fitmodels, Python and numpy."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from ...core.errors import UsageError

if TYPE_CHECKING:
    from .by_dask import OfDask


def refuse_others(client: "OfDask", address: str) -> None:
    """Refuse a cluster whose workers, or scheduler (it unpacks the tasks too), have other versions than this process.

    Parameters
    ----------
    client : distributed.Client
    address : str

    Raises
    ------
    UsageError
        It names the first that differs and both versions.
    """
    look = looker()
    ours = look()
    theirs = {f"scheduler {address}": client.run_on_scheduler(look)}
    theirs |= {f"worker {name}": seen for name, seen in client.run(look).items()}
    for name, seen in theirs.items():
        if seen != ours:
            raise UsageError(
                f"the Dask {name} has {told(seen)}, this process has {told(ours)}: the same is needed there, "
                f"{cure(seen, ours)}."
            )


def looker() -> Callable[[], dict[str, str]]:
    """Make the function that looks.

    It is made in a function so that it is sent as it stands: a function of this module would be imported by the other
    side, which is what may not be possible there.
    """

    def look() -> dict[str, str]:
        import sys
        from importlib import import_module

        seen = {"Python": ".".join(map(str, sys.version_info[:2]))}
        for name in ("fitmodels", "numpy"):
            try:
                version = import_module(name).__version__
            except ImportError:
                version = ""
            seen[name] = version.split(".")[0] if name == "numpy" else version
        return seen

    return look


def told(seen: dict[str, str]) -> str:
    """Versions in words.

    >>> told({"fitmodels": "0.1.0", "Python": "3.11", "numpy": ""})
    'fitmodels 0.1.0, Python 3.11, no numpy'
    """
    names = ("fitmodels", "Python", "numpy")
    return ", ".join(f"{name} {seen[name]}" if seen[name] else f"no {name}" for name in names)


def cure(seen: dict[str, str], ours: dict[str, str]) -> str:
    """What brings the other side to our versions.

    >>> old = {"fitmodels": "0.1.0", "Python": "3.11", "numpy": "2"}
    >>> cure(old, old | {"fitmodels": "0.2.0"})
    "pip install 'fitmodels[dask]==0.2.0'"
    """
    if seen["Python"] != ours["Python"]:
        return f"in an environment of Python {ours['Python']}"
    if seen["fitmodels"] != ours["fitmodels"]:
        return f"pip install 'fitmodels[dask]=={ours['fitmodels']}'"
    return f"pip install 'numpy=={ours['numpy']}.*'"
