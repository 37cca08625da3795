"""Text of the reference of a package: its public names and the classes its functions return.

Packages import their names on first use; names are therefore taken from ``__all__`` and not from the module's contents.
"""

import inspect
import re
import sys
from collections import defaultdict
from collections.abc import Iterator
from importlib import import_module
from types import ModuleType
from typing import Any

PACKAGES = ("datasets", "fit", "ident", "parameters", "controllers", "cards", "pipeline", "batch")


def lines(package: ModuleType) -> Iterator[str]:
    """The reference of a package in reStructuredText."""
    yield from (inspect.getdoc(package) or "").split("\n\n")[0].splitlines()
    yield from ("", f".. currentmodule:: {package.__name__}", "")
    grouped = groups(package)
    for part in sorted(grouped):
        if len(grouped) > 1:
            yield from _heading(_title(package, part))
        yield from _entries(package, {name: getattr(package, name) for name in grouped[part]})
    if results := returned(package):
        yield from _heading("Classes of results")
        yield from ("Returned by the functions and methods above; not created directly.", "")
        yield from _entries(package, {f"{kind.__module__}.{kind.__qualname__}": kind for kind in results})


def _heading(title: str) -> tuple[str, ...]:
    return title, "-" * len(title), ""


def _entries(package: ModuleType, objects: dict[str, Any]) -> Iterator[str]:
    yield from (".. autosummary::", "   :nosignatures:", "")
    yield from (f"   {'~' if '.' in name else ''}{name.removeprefix(package.__name__ + '.')}" for name in objects)
    yield ""
    for name, value in objects.items():
        yield from (f".. {_directive(value)}:: {name}", "")


def groups(package: ModuleType) -> dict[str, list[str]]:
    """Public names by subpackage; names of modules of the package itself are under ``""``."""
    found: dict[str, list[str]] = defaultdict(list)
    for name in sorted(package.__all__, key=str.lower):
        home = getattr(getattr(package, name), "__module__", None) or package.__name__
        inside = home.removeprefix(f"{package.__name__}.").split(".")
        part = inside[0] if home.startswith(package.__name__) and _is_package(package, inside[0]) else ""
        found[part].append(name)
    return dict(found)


def returned(package: ModuleType) -> list[type]:
    """Classes of the package that its public functions and methods return and ``__all__`` does not name."""
    public = [getattr(package, name) for name in package.__all__]
    found: dict[str, type] = {}
    for value in public:
        for name in _names_returned(value):
            kind = _class_of(package.__name__, name)
            if kind is not None and kind not in public and kind.__doc__:
                found[kind.__name__] = kind
    return [found[name] for name in sorted(found, key=str.lower)]


def _names_returned(value: object) -> Iterator[str]:
    """Names in the return annotations of a function, or of the public methods and properties of a class."""
    calls: list[Any] = [value]
    if inspect.isclass(value):
        members = (member for name, member in vars(value).items() if not name.startswith("_"))
        calls = [getattr(member, "fget", None) or getattr(member, "__func__", member) for member in members]
    for call in filter(inspect.isfunction, calls):
        hint = call.__annotations__.get("return")
        yield from re.findall(r"\w+", hint if isinstance(hint, str) else inspect.formatannotation(hint))


def _class_of(package: str, name: str) -> type | None:
    """The public class of this name that a module of the package defines, where there is one."""
    for module in [module for module in sys.modules if module.startswith(f"{package}.")]:
        kind = getattr(sys.modules[module], name, None)
        if inspect.isclass(kind) and kind.__module__ == module and not name.startswith("_"):
            return kind
    return None


def _is_package(package: ModuleType, part: str) -> bool:
    try:
        return hasattr(import_module(f"{package.__name__}.{part}"), "__path__")
    except ModuleNotFoundError:
        return False


def _title(package: ModuleType, part: str) -> str:
    if not part:
        return "Main package"
    doc = (inspect.getdoc(import_module(f"{package.__name__}.{part}")) or "").split("\n\n")[0]
    first = " ".join(doc.split()).split(":")[0].split(". ")[0].rstrip(".")
    return f"{part.replace('_', ' ')}: {first}" if first else part


def _directive(value: object) -> str:
    if inspect.isclass(value):
        return "autoexception" if issubclass(value, BaseException) else "autoclass"
    return "autofunction" if callable(value) else "autodata"
