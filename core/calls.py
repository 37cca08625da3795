"""Arguments of public functions, checked against their annotations: a wrong call ends in one sentence with a remedy."""

import os
import re
import sys
from collections.abc import Callable, Collection, Iterable, Mapping, Sized
from dataclasses import dataclass
from functools import lru_cache, wraps
from inspect import Parameter, Signature, signature
from numbers import Integral, Real
from types import NoneType, UnionType
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, ParamSpec, TextIO, TypeVar, Union, get_args, get_origin

from .errors import FitmodelsError, UsageError
from .suggestions import closest, did_you_mean

if TYPE_CHECKING:
    from pandas import DataFrame

P = ParamSpec("P")
R = TypeVar("R")

OURS = (__name__.partition(".")[0], "builtins", "numpy", "pandas")
Conditions = dict[str, Any]
OPTIONS = ("kind", "level", "edge", "coverage", "centre", "by")  # of a prediction, in addition to the factors
LONG = 60  # letters of a value that is shown
# What makes an object that a function wants, and the attribute of other results that holds one.
MADE_BY: Mapping[str, str] = {
    "Runs": "datasets.read_runs(path)",
    "LawFit": 'fit.power_law(runs, "AW", ["V", "f"])',
    "Posterior": "fit.posterior(law)",
    "ToolLife": "fit.tool_life(law)",
    "ParameterFile": "parameters.read(path)",
    "FitOptions": "fitmodels.FitOptions(draws=2000)",
    "Record": "datasets.read_record(path)",
    "Model": "ident.arx(record, na, nb)",
    "Identification": "ident.identify(record)",
    "DataFrame": "pandas.DataFrame(...)",
}
HELD_AS: Mapping[str, tuple[str, ...]] = {
    "Runs": ("runs",),
    "LawFit": ("law", "laws[0]"),
    "ParameterFile": ("parameters",),
    "Posterior": ("posteriors[0]",),
    "Model": ("model",),
}


class Wanted(NamedTuple):
    """Test of an argument, and what it has to be, in words."""

    fits: Callable[[Any], bool]
    words: str


def checked(function: Callable[P, R]) -> Callable[P, R]:
    """Decorator: arguments are bound and compared with the annotations before the function runs.

    Numbers, texts, choices, lists of texts, mappings, paths and classes are checked; annotations of arrays are not.

    Raises
    ------
    UsageError
        An argument is unknown, missing or of another kind than its annotation.

    Examples
    --------
    >>> @checked
    ... def halved(length: float, unit: Literal["mm", "um"] = "mm") -> float:
    ...     return length / 2
    >>> halved(3)
    1.5
    >>> halved(3, unti="um")
    Traceback (most recent call last):
    fitmodels.core.errors.UsageError: halved: there is no argument 'unti'. Did you mean 'unit'?
    """

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            given = _signature(function).bind(*args, **kwargs).arguments
        except TypeError:
            raise UsageError(f"{_name(call)}: {_wrong_names(function, args, kwargs)}") from None
        if wrong := _wrong_value(function, given):
            raise UsageError(f"{_name(call)}: {wrong}")
        return function(*args, **kwargs)

    return call


def check_share(name: str, value: float, error: type[FitmodelsError] = UsageError) -> None:
    """Refuse a level or another share that is not between 0 and 1.

    >>> check_share("level", 95)
    Traceback (most recent call last):
    fitmodels.core.errors.UsageError: level 95 of an interval: it must be between 0 and 1; for 95 % give 0.95.
    """
    number = isinstance(value, Real) and not isinstance(value, bool)
    if number and 0 < value < 1:
        return
    shown = f"{value:g}" if number else repr(value)
    remedy = f"for {value:g} % give {value / 100:g}" if number and 1 < value < 100 else "for instance 0.95"
    raise error(f"{name} {shown} of an interval: it must be between 0 and 1; {remedy}.")


@dataclass(frozen=True, slots=True)
class Takes:
    """Needs of a prediction: the law in words, the unit of each factor, the category, the error to raise."""

    law: str
    units: Mapping[str, str]
    category: str | None
    error: type[FitmodelsError]


def conditions(
    takes: Takes, new: "Mapping[str, object] | DataFrame | None", by: str | None, factors: Mapping[str, object]
) -> Conditions:
    """Conditions given as a mapping or DataFrame, by name, or both: factors as numbers, category and edge as text.

    Raises
    ------
    FitmodelsError
        A name that the law does not take, a value that is no number, or something else than a mapping.
    """
    given = _as_mapping(takes, new)
    known = (*takes.units, "edge", *([] if takes.category is None else [takes.category]))
    for name in factors:
        if name in given:
            raise takes.error(f"{name} is given twice, in the mapping and by name; give it once.")
        if name not in known:
            raise takes.error(_unknown_factor(takes, name, known))
    given |= factors
    if by is not None:
        if takes.category is None:
            raise takes.error(f"{takes.law} has no levels; leave {by!r} out.")
        given[takes.category] = str(by)
    _check_conditions(takes, new, given, known)
    return {name: _number(takes, name, given[name]) for name in known if name in given}


def _unknown_factor(takes: Takes, name: str, known: Iterable[str]) -> str:
    has = f"its factors are {', '.join(takes.units)}" if takes.units else "it has none"
    near = "kind" if name == "interval" else closest(name, (*known, *OPTIONS), 0.6)
    hint = f" Did you mean {near!r}?" if near else ""
    return f"{takes.law} has no factor {name!r}; {has}.{hint}"


def _check_conditions(takes: Takes, new: object, given: Mapping[str, object], known: Collection[str]) -> None:
    """Refuse names in place of symbols, and columns in another unit than the law's."""
    missing = [name for name in takes.units if name not in given]
    if missing and any(name not in known for name in given):
        raise takes.error(f"{takes.law} needs {', '.join(missing)}, by symbol; given: {', '.join(given)}.")
    stated = getattr(new, "attrs", {}).get("units") or {}
    for name, unit in takes.units.items():
        if stated.get(name, unit) != unit:
            raise takes.error(f"{takes.law}: {name} is in {stated[name]} in the DataFrame; give it in {unit}.")


def _as_mapping(takes: Takes, new: "Mapping[str, object] | DataFrame | None") -> dict[str, object]:
    if new is None:
        return {}
    if not isinstance(new, Mapping) and not hasattr(new, "columns"):
        first = next(iter(takes.units), "V")
        example = f'{{"{first}": 100, ...}}'
        raise takes.error(
            f"{takes.law}: conditions as {type(new).__name__}; give a mapping, {example}, a DataFrame, or {first}=100."
        )
    return {str(name): value for name, value in new.items()}


def _number(takes: Takes, name: str, value: object) -> Any:  # noqa: ANN401
    """A factor as an array of numbers, shape () or (n,); the category and the edge as they are."""
    import numpy as np

    if name not in takes.units:
        return np.asarray(value, dtype=object)
    try:
        if np.asarray(value).dtype.kind in "US":
            raise TypeError
        number = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        unit = takes.units[name] or "its unit"
        raise takes.error(f"{takes.law}: {name} = {_short(value)} is not a number; give it in {unit}.") from None
    if not np.isfinite(number).all():
        raise takes.error(f"{takes.law}: {name} = {number[~np.isfinite(number)].flat[0]}: give a finite number.")
    return number


@lru_cache(maxsize=512)
def _signature(function: Callable[..., object]) -> Signature:
    return signature(function)


@lru_cache(maxsize=2048)
def _wanted(function: Callable[..., object], name: str) -> Wanted | None:
    """Type that an argument must have; None where everything is accepted, or the function checks it itself."""
    parameter = _signature(function).parameters[name]
    if parameter.kind in (Parameter.VAR_KEYWORD, Parameter.VAR_POSITIONAL):
        return None
    return _of_hint(_resolved(parameter.annotation, function))


def _resolved(hint: object, function: Callable[..., object]) -> object:
    """An annotation in quotes evaluated; as text where its names are only imported for type checking."""
    if not isinstance(hint, str):
        return hint
    try:
        return eval(hint, vars(sys.modules[function.__module__]))  # noqa: S307  our own annotations
    except (NameError, TypeError):
        return hint


def _of_hint(hint: object) -> Wanted | None:
    if isinstance(hint, str):
        return _of_text(hint)
    if hint in PLAIN:
        return PLAIN[hint]
    origin = get_origin(hint)
    if origin in (Union, UnionType):
        return _of_union(get_args(hint))
    if origin is not None:
        return _of_generic(origin, get_args(hint))
    if not isinstance(hint, type) or hint is object or getattr(hint, "_is_protocol", False):
        return None
    return _of_class(hint.__name__)


def _of_text(hint: str) -> Wanted | None:
    """Of names that are not imported: classes and lists of them by the names of their classes."""
    parts = [_of_hint(None) if name == "None" else _by_name(name) for name in hint.split(" | ")]
    return _joined(parts)


def _by_name(name: str) -> Wanted | None:
    if listed := re.fullmatch(r"Sequence\[(\w+)\]", name):
        return _listed(_by_name(listed[1]))
    if name.startswith("Mapping["):
        return _of_generic(Mapping, ())
    return _of_class(name, OURS) if name in MADE_BY or name.endswith("Section") else None


def _of_class(name: str, refused: tuple[str, ...] = ()) -> Wanted:
    """Of the name of a class; with ``refused``, objects of other modules than these pass too, as stand-ins."""
    made = f", for instance {MADE_BY[name]}" if name in MADE_BY else ""

    def fits(value: object) -> bool:
        stand_in = refused and type(value).__module__.partition(".")[0] not in refused
        return bool(stand_in) or name in {base.__name__ for base in type(value).__mro__}

    return Wanted(fits, f"{_article(name)}{made}")


def _of_union(parts: tuple[object, ...]) -> Wanted | None:
    path = next((part for part in parts if get_origin(part) is os.PathLike), None)
    found = [_of_hint(part) for part in parts if not (path and part is str)]
    return _joined(found)


def _joined(found: list[Wanted | None]) -> Wanted | None:
    known = [one for one in found if one is not None]
    if not known or len(known) < len(found):
        return None
    words = [one.words if len(known) == 1 else one.words.partition(", for instance")[0] for one in known]
    some = [one for one in words if one != "None"]
    shown = f"{_or(some)}, or None" if len(some) < len(words) else _or(words)
    return Wanted(lambda v: any(one.fits(v) for one in known), shown)


def _of_generic(origin: object, of: tuple[object, ...]) -> Wanted | None:
    if origin is Literal:
        return Wanted(lambda v: any(v is one or (isinstance(v, str) and v == one) for one in of), _either(of))
    if origin is os.PathLike:
        return Wanted(lambda v: isinstance(v, str | os.PathLike), "a path")
    if not isinstance(origin, type):
        return None
    if issubclass(origin, Mapping):
        return Wanted(lambda v: isinstance(v, Mapping), "a mapping, for instance {'V': ...}")
    if issubclass(origin, Callable):  # type: ignore[arg-type]
        return Wanted(callable, "a function")
    if issubclass(origin, Iterable) and "numpy" not in origin.__module__:
        return _listed(_of_hint(of[0]) if origin is not tuple and of else None)
    return None


def _listed(of: Wanted | None) -> Wanted:
    def fits(value: object) -> bool:
        if isinstance(value, str | bytes | Mapping) or not isinstance(value, Iterable) or hasattr(value, "columns"):
            return False
        return of is None or not isinstance(value, Sized) or all(map(of.fits, value))

    return Wanted(fits, "a list" if of is None else f"a list of {_plural(of.words)}")


def _is_number(value: object, kind: type = Real) -> bool:
    single = getattr(value, "shape", None) == () and hasattr(value, "item")
    value = value.item() if single else value  # type: ignore[attr-defined]
    return isinstance(value, kind) and not isinstance(value, bool)


PLAIN: Mapping[object, Wanted | None] = {
    Any: None,
    Parameter.empty: None,
    None: Wanted(lambda v: v is None, "None"),
    NoneType: Wanted(lambda v: v is None, "None"),
    float: Wanted(_is_number, "a number"),
    int: Wanted(lambda v: _is_number(v, Integral), "a whole number"),
    str: Wanted(lambda v: isinstance(v, str), "a text"),
    TextIO: Wanted(lambda v: hasattr(v, "write"), "an open file"),
    bool: Wanted(lambda v: isinstance(v, bool) or type(v).__name__ in ("bool", "bool_"), "True or False"),
}


def _wrong_names(function: Callable[..., object], args: tuple[object, ...], kwargs: Mapping[str, object]) -> str:
    """Fault in the names or the number of the arguments."""
    known = _signature(function).parameters
    for name in kwargs:
        if name not in known:
            names = [one for one in known if one != "self"]
            return f"there is no argument {name!r}. {did_you_mean(name, names, 0.6, names='It has ')}"
    by_order = [name for name, one in known.items() if one.kind in (0, 1)]
    if len(args) > len(by_order):
        most = len(by_order) - ("self" in known)
        return f"at most {most} argument{'' if most == 1 else 's'} without a name; give the others as name=value."
    given = dict(zip(by_order, args, strict=False))
    for name in kwargs:
        if name in given:
            return f"{name} is given twice, by its place and by its name."
    return _wrong_value(function, {**given, **kwargs}) or _missing(function, {*given, *kwargs})


def _missing(function: Callable[..., object], given: Collection[str]) -> str:
    """The first argument without a default that is not given."""
    known = _signature(function).parameters.items()
    needed = (name for name, one in known if one.default is one.empty and one.kind not in (2, 4))
    missing = next(name for name in needed if name not in given)
    wanted = _wanted(function, missing)
    return f"{missing} is missing{'' if wanted is None else f'; give {wanted.words}'}."


def _wrong_value(function: Callable[..., object], given: Mapping[str, object]) -> str:
    """The first argument of another kind than its annotation, in a sentence; empty where there is none."""
    for name, value in given.items():
        wanted = _wanted(function, name)
        if wanted is not None and not wanted.fits(value):
            return _value_words(name, value, wanted.words)
    return ""


def _value_words(name: str, value: object, words: str) -> str:
    """The argument, what it is and what to give."""
    if isinstance(value, str) and words.startswith("a list of texts"):
        return f"{name}={value!r} is one text; give a list of texts, for instance {re.findall(r'[^, ~]+', value)}."
    if isinstance(value, str | float | int | NoneType):
        near = closest(value, re.findall(r"'(.+?)'", words)) if isinstance(value, str) else None
        return f"{name}={_short(value)}: give {words}.{f' Did you mean {near!r}?' if near else ''}"
    return f"{name} is {_article(type(value).__name__)}{_contents(value)}; give {words}.{_held(value, words)}"


def _contents(value: object) -> str:
    """Contents of a list."""
    if not isinstance(value, list | tuple):
        return ""
    return f" of {', '.join(dict.fromkeys(type(item).__name__ for item in value)) or 'nothing'}"


def _held(value: object, words: str) -> str:
    """Place in a result of the one that is wanted."""
    wanted = next((name for name in HELD_AS if re.match(rf"(an? )?{name}\b", words)), "")
    places = (at for at in HELD_AS.get(wanted, ()) if hasattr(type(value), at.removesuffix("[0]")))
    place = next(places, "")
    return f" This {type(value).__name__} has one as .{place}." if place else ""


def _name(function: Callable[..., object]) -> str:
    package, _, module = function.__module__.partition(".")
    shown = f"{module}." if package == __name__.partition(".")[0] and module and "." not in module else ""
    return f"{shown}{function.__qualname__.rpartition('<locals>.')[2]}"


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= LONG else f"{text[: LONG - 3]}..."


def _article(name: str) -> str:
    return name if name == "Runs" else f"{'an' if name[0] in 'AEIOaeio' else 'a'} {name}"


def _plural(words: str) -> str:
    return f"{re.sub(r'^an? ', '', words.partition(',')[0])}s"


def _either(choices: tuple[object, ...]) -> str:
    return _or([repr(choice) for choice in choices])


def _or(words: list[str]) -> str:
    *first, last = words
    return f"{', '.join(first)} or {last}" if first else last
