"""Priors from a TOML file with a table for each law, which replace the weak priors they name.

    [AW]
    source = "forty tests of the same grade, 2019"
    level = { distribution = "lognormal", median = 0.2, factor = 3, unit = "mm" }
    V     = { distribution = "normal", mean = 2.0, sd = 0.5 }
    sd    = { distribution = "half-t", df = 4, scale = 0.1 }
    icc   = { distribution = "beta", a = 1, b = 3 }

``level`` is the response at the middle of the tests, in its unit; ``factor`` is one standard deviation either way.
"""

from collections.abc import Mapping
from math import isfinite, log
from pathlib import Path

import numpy as np

from ...core.bounded import parse_toml, read_bounded
from ...core.errors import DataError, UsageError
from ...core.suggestions import did_you_mean
from ...core.text import shortened
from ...datasets.units import convert
from ..lawfit import LawFit
from .priors import Beta, HalfT, Normal, Prior, Priors

# The numbers of each distribution, and which of them must lie above zero.
NUMBERS: Mapping[str, tuple[str, ...]] = {
    "normal": ("mean", "sd"),
    "lognormal": ("median", "factor"),
    "half-t": ("df", "scale"),
    "beta": ("a", "b"),
}
FREE = ("mean",)
IMPROPER = ("flat", "uniform", "improper", "jeffreys", "1/sigma")
LARGEST = 1e12  # of a scatter, which no parameter of a law in usual units exceeds
LONGEST_SHOWN = 60  # characters of a value in a message


def read_priors(path: str | Path) -> dict[str, object]:
    """The tables of a priors file, by law; DataError names what cannot be read."""
    file = Path(path)
    try:
        found = parse_toml(read_bounded(file, "priors"), file.name, remedy="Write a table of priors for each law.")
    except OSError as error:
        raise DataError(f"{path} cannot be read: {error.strerror or error}. Give the path of a TOML file.") from None
    if not found:
        raise DataError(f"{path} holds no table of priors. Write one for each law, as [AW], or leave --priors out.")
    return found


def laws_of(tables: Mapping[str, object]) -> list[str]:
    """Responses that tables of priors are of; what is no table of a law is refused with the law (`replaced`).

    >>> laws_of({"AW": {"V": {"distribution": "normal", "mean": 2.0, "sd": 0.5}}, "sd": {"distribution": "half-t"}})
    ['AW']
    """
    return [key for key, given in tables.items() if isinstance(given, Mapping) and "distribution" not in given]


def replaced(priors: Priors, law: LawFit, tables: Mapping[str, object], name: str) -> Priors:
    """The priors of a law with those that ``tables`` gives for it.

    Raises
    ------
    UsageError
        A parameter or distribution that there is not, a number that is missing or impossible, a wrong unit, an
        improper prior.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> from fitmodels.fit.bayes.priors import weak
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("ac2017_table1")), "AW", ["V", "f"])
    >>> given = {"AW": {"V": {"distribution": "normal", "mean": 2.0, "sd": 0.5}}}
    >>> replaced(weak(law, edges=False), law, given, "mine").of["V"]
    Normal: mean 2, sd 0.5
    """
    table = tables.get(law.response)
    alone = [key for key, given in tables.items() if not isinstance(given, Mapping) or "distribution" in given]
    if alone:
        example = f"{{{law.response!r}: {{'V': {{'distribution': 'normal', 'mean': 0.5, 'sd': 0.2}}}}}}"
        raise UsageError(f"{name}: {_shown(alone[0])} is no table of a law; priors are by response: {example}.")
    if table is None:
        return priors
    if not isinstance(table, dict):
        raise UsageError(f"{name}: {law.response} must be a table of priors, not {_shown(table)}.")
    of, sources = dict(priors.of), dict(priors.sources)
    stated = {key: given for key, given in table.items() if key != "source"}
    for key, given in stated.items():
        if key not in of:
            hint = did_you_mean(key, priors.of, names="Its parameters are ")
            raise UsageError(f"{name}: the law of {law.response} has no parameter {_shown(key)}. {hint}")
        of[key] = _prior(f"{name}: {law.response}.{key}", key, given, priors.units[key], law)
        sources[key] = str(table.get("source", name))
    return Priors(of, name, priors.units, sources)


def _prior(where: str, key: str, given: object, unit: str, law: LawFit) -> Prior:
    if not isinstance(given, dict) or "distribution" not in given:
        raise UsageError(f'{where} = {_shown(given)}: write it as {{ distribution = "normal", mean = 0, sd = 1 }}.')
    kind = given["distribution"]
    if kind in IMPROPER:
        raise UsageError(
            f"{where}: a {kind} prior is improper, and a posterior from it may not exist; give a wide proper one "
            '(normal with a large sd), or take the whole set called "reference".'
        )
    if not isinstance(kind, str) or kind not in NUMBERS:
        raise UsageError(f"{where}: no distribution {_shown(kind)}; there are {', '.join(NUMBERS)}.")
    values = _numbers(where, kind, given)
    _fits_the_parameter(where, key, kind, law)
    values = _in_unit(where, kind, values, given.get("unit"), unit)
    if kind == "normal":
        return Normal(values["mean"], values["sd"])
    if kind == "lognormal":
        return Normal(log(values["median"]), log(values["factor"]))
    return HalfT(values["df"], values["scale"]) if kind == "half-t" else Beta(values["a"], values["b"])


def _shown(value: object) -> str:
    """A value of the file in a message, cut where it is long."""
    return shortened(repr(value), LONGEST_SHOWN)


def _numbers(where: str, kind: str, given: Mapping[str, object]) -> dict[str, float]:
    values: dict[str, float] = {}
    for name in NUMBERS[kind]:
        value = given.get(name)
        if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
            raise UsageError(
                f"{where}: {name} is {_shown(value)}; a {kind} prior needs {' and '.join(NUMBERS[kind])}, numbers."
            )
        least = 1.0 if name == "factor" else 0.0
        if name not in FREE and value <= least:
            raise UsageError(f"{where}: {name} is {value:g}; it must lie above {least:g}.")
        if name not in FREE and not 1 / LARGEST <= value <= LARGEST:
            raise UsageError(f"{where}: {name} is {value:g}; give it between {1 / LARGEST:g} and {LARGEST:g}.")
        values[name] = float(value)
    strange = sorted(set(given) - {*NUMBERS[kind], "distribution", "unit"})
    if strange:
        raise UsageError(
            f"{where}: a {kind} prior has no {_shown(strange[0])}; it has {', '.join(NUMBERS[kind])} and unit."
        )
    return values


def _fits_the_parameter(where: str, key: str, kind: str, law: LawFit) -> None:
    """Validate the support: a scatter above zero, a share between 0 and 1, other parameters real."""
    wanted = {"sd": ("half-t",), "icc": ("beta",)}.get(key, ("normal",))
    if key == "level" and law.formula.logarithmic:
        wanted = ("lognormal",)
    if kind not in wanted:
        raise UsageError(f"{where}: a {kind} prior does not fit it; it takes a {' or '.join(wanted)} one.")


def _in_unit(where: str, kind: str, values: dict[str, float], given: object, unit: str) -> dict[str, float]:
    """Numbers in the unit of the law; without a unit they are taken to be in it."""
    own = unit.removeprefix("ln ") if kind == "lognormal" else unit
    if given is None or given == own:
        return values
    try:
        ratio = float(convert(np.ones(1), str(given), own)[0])
    except (UsageError, DataError):
        raise UsageError(f"{where} is in {own}, not in {given}: give its numbers in {own}.") from None
    scaled = {"lognormal": ("median",), "normal": ("mean", "sd"), "half-t": ("scale",)}.get(kind, ())
    return {name: value * ratio if name in scaled else value for name, value in values.items()}
