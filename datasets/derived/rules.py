"""Quantities computed from others of a file: the table of rules, and their application.

Formulas: V, MRR and P of turning, milling and drilling as in the formula pages of Sandvik Coromant and the technical
information of Kyocera (R27-R28); Fxz, and Fy as the power force, as Alaskari and Oraby (doi 10.15242/IIE.E1216006).
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from math import pi, prod
from typing import Any, TypeAlias

import numpy as np
import pandas as pd

from ...core.arrays import Array
from ...core.errors import UsageError
from ...core.rounding import format_decimal, join_words
from ..columns import NONE, Values
from ..design import round_significant
from ..notes import Given, given_values
from ..options import Process, ReadOptions
from ..plausibility.ranges import KC, process_of
from ..vocabulary import ROLES

Number: TypeAlias = Array | float

TORQUE = 60000 / (2 * pi)  # P in kW from M in N m and n in 1/min: P = M n/9549.2966
LONG = 20_000.0  # mm: a cut length in turning above it is along the cut, at 50 to 1000 times the travel of the feed
HALF = 0.5
PLANNED = 4  # digits of planned settings
SOME = 10_000  # rows from which a convention is recognized
ROTATING = ("fz", "ae", "z", "Dc")  # columns of tests with a rotating tool


@dataclass(frozen=True, slots=True)
class Rule:
    """A formula of one quantity.

    Attributes
    ----------
    role, formula : str
    inputs : tuple of str
        Roles of the arguments of ``function``, which are in their units, as the result is.
    function : callable
    processes : tuple of str
        Processes in which it holds; empty: in all.
    agree : tuple of float
        Least and greatest ratio of a measured value to the computed one at which the two agree.
    """

    role: str
    formula: str
    inputs: tuple[str, ...]
    function: Callable[..., Any]
    processes: tuple[Process, ...] = ()
    agree: tuple[float, float] = (0.97, 1.03)

    @property
    def equation(self) -> str:
        """The formula with its result."""
        return f"{self.role} = {self.formula}"


FEED = (0.99, 1.01)
RATE = (0.85, 1.1)  # (1 - d/D) of it where V is that of the uncut diameter
POWER = (0.7, 5.0)  # at the drive up to twice the power of the cut
RULES = (
    Rule("V", "pi Dc n/1000", ("Dc", "n"), lambda D, n: pi * D * n / 1000),
    Rule("V", "pi D n/1000", ("D", "n"), lambda D, n: pi * D * n / 1000),
    Rule("n", "1000 V/(pi Dc)", ("V", "Dc"), lambda V, D: 1000 * V / (pi * D)),
    Rule("n", "1000 V/(pi D)", ("V", "D"), lambda V, D: 1000 * V / (pi * D)),
    Rule("f", "fm/n", ("fm", "n"), lambda fm, n: fm / n, agree=FEED),
    Rule("f", "fz z", ("fz", "z"), lambda fz, z: fz * z, agree=FEED),
    Rule("fz", "fm/(n z)", ("fm", "n", "z"), lambda fm, n, z: fm / (n * z), ("milling",), FEED),
    Rule("fz", "f/z", ("f", "z"), lambda f, z: f / z, ("milling",), FEED),
    Rule("fm", "f n", ("f", "n"), lambda f, n: f * n, agree=FEED),
    Rule("t", "lf/(1000 V)", ("lf", "V"), lambda lf, V: lf / (1000 * V), ("turning",)),
    Rule("t", "lf/fm", ("lf", "fm"), lambda lf, fm: lf / fm),
    Rule("t", "lc/V", ("lc", "V"), lambda lc, V: lc / V),
    Rule("AW", "(VBC + VB + VBN)/3", ("VBC", "VB", "VBN"), lambda *lands: sum(lands) / 3, agree=(0.9, 1.1)),
    Rule("Fxz", "sqrt(Fx^2 + Fz^2)", ("Fx", "Fz"), np.hypot),
    Rule("P", "Fc V/60000", ("Fc", "V"), lambda F, V: F * V / 60000, agree=POWER),
    Rule("P", "M n/9549.2966", ("M", "n"), lambda M, n: M * n / TORQUE, agree=POWER),
    Rule("P", "Fy V/60000", ("Fy", "V"), lambda F, V: F * V / 60000, ("turning",), POWER),
    Rule("MRR", "1000 V f d", ("V", "f", "d"), lambda V, f, d: 1000 * V * f * d, ("turning",), RATE),
    Rule("MRR", "ae d fm", ("ae", "d", "fm"), lambda ae, d, fm: ae * d * fm, ("milling",)),
    Rule("MRR", "pi Dc^2/4 f n", ("Dc", "f", "n"), lambda D, f, n: pi * D**2 / 4 * f * n, ("drilling",)),
    Rule("MRR", "pi D^2/4 f n", ("D", "f", "n"), lambda D, f, n: pi * D**2 / 4 * f * n, ("drilling",)),
)
"""Rules of a quantity in the order in which they are tried."""

TARGETS = ("V", "f", "fz", "t", "AW", "Fxz", "P", "MRR")
"""Quantities that are computed where they are not measured; others only on the way to these."""


SETTINGS = ("fm", "n", "f", "V", "fz", "z", "Dc", "D")
"""Settings of which some follow from others, in the order in which a plan does without them."""


@dataclass(frozen=True, slots=True)
class Derived:
    """A quantity that was computed: its role, the equation, the roles that entered, and the sentence that says so."""

    role: str
    equation: str
    inputs: tuple[str, ...]
    sentence: str


@dataclass(frozen=True, slots=True)
class Known:
    """Inputs of rules: columns by role, constants, roles that are not wanted, the process, and roles of peak values.

    Nothing follows from peak values: a power is the mean force times the speed.
    """

    data: dict[str, Values]
    given: dict[str, Given]
    unwanted: frozenset[str]
    process: Process | None
    stated: bool  # the process is given or seen from the columns, not read from the notes
    peaks: frozenset[str] = frozenset()

    def has(self, role: str) -> bool:
        """Whether a role is a constant, or a column of numbers that is not empty."""
        if role in self.given or role not in self.data:
            return role in self.given
        values = self.data[role]
        return values.dtype != object and bool(len(values) == 0 or not (np.isnan(values[0]) and np.isnan(values).all()))

    def value(self, role: str) -> Number:
        """The column, or else the constant."""
        return np.asarray(self.data[role], dtype=np.float64) if role in self.data else self.given[role].value

    @property
    def turned(self) -> bool:
        """Whether these may be tests of turning."""
        return self.process == "turning" or (self.process is None and set(ROTATING).isdisjoint(self.data))

    def allows(self, rule: Rule) -> bool:
        """Whether a rule holds for the process, and for the values where its formula does not decide."""
        if not self.peaks.isdisjoint(rule.inputs):
            return False
        if rule.formula.startswith("Fy"):
            return fy_is_cutting(self)
        if rule.formula.startswith("lf/(1000"):
            return self.turned and bool(np.mean(np.asarray(self.value("lf")) > LONG) > HALF)
        if rule.role == "MRR" and not self.stated:
            return False
        if "D" in rule.inputs and self.process != "turning" and self.has("Dc"):
            return False
        if "Dc" in rule.inputs and self.process == "turning" and self.has("D"):
            return False
        if "z" in rule.inputs and not (self.has("z") and whole(self.value("z"))):
            return False
        return not rule.processes or self.process in rule.processes or (rule.role == "fz" and self.process is None)


def whole(z: Number) -> bool:
    """Whether all known numbers of teeth are whole and above zero: a coordinate z is not."""
    known = np.asarray(z)[~np.isnan(z)]
    return bool(known.size and np.all(known >= 1) and np.all(known == np.round(known)))


def fy_is_cutting(known: Known) -> bool:
    """Whether Fy is the main cutting force of a turning file: the largest of three, with a usual specific force."""
    if known.has("Fc") or not known.turned:
        return False
    if not all(role in known.data and known.has(role) for role in ("Fx", "Fy", "Fz", "f", "d")):
        return False
    Fx, Fy, Fz, f, d = (known.value(role) for role in ("Fx", "Fy", "Fz", "f", "d"))
    full = ~np.isnan(Fx + Fy + Fz + f * d) & (np.asarray(f) > 0) & (np.asarray(d) > 0)
    if not full.any():
        return False
    largest = np.mean((np.abs(Fy) >= np.maximum(np.abs(Fx), np.abs(Fz)))[full])  # the sign is that of an axis
    middle = np.median(Fy[full] / (f * d)[full])  # type: ignore[index]
    return bool(largest > 0.9 and KC.usual[0] <= middle <= KC.usual[1])


def known_of(data: dict[str, Values], notes: Iterable[str], options: ReadOptions) -> Known:
    """Inputs of rules from a table."""
    notes = tuple(notes)
    unwanted = frozenset(role for role, name in options.map.items() if name.strip().lower() == NONE)
    given = {role: one for role, one in given_values(options.constants, notes).items() if role not in data}
    stated = options.process or process_of(data, ())
    process = stated or process_of(data, notes)
    return Known(data, given, unwanted, process, stated is not None)


def apply(
    known: Known, words: Mapping[str, str], only: Iterable[str] | None = None, targets: Iterable[str] = TARGETS
) -> list[Derived]:
    """Compute in place every target that is missing and follows from what is known.

    Parameters
    ----------
    known : Known
    words : mapping of str to str
        Header of each role's column, for the sentences.
    only : iterable of str, optional
        Equations that may be used; all where None.
    targets : iterable of str
        Quantities to compute.
    """
    found: list[Derived] = []
    names = dict(words)
    allowed = None if only is None else frozenset(only)
    for target in targets:
        if known.has(target) or target in known.data or target in known.unwanted:
            continue
        steps = _steps(target, known, frozenset(), allowed) or ()
        found.extend(_computed(rule, known, names) for rule in steps if not known.has(rule.role))
    return found


def check_settings(given: Mapping[str, Array], process: Any) -> None:  # noqa: ANN401
    """Refuse a setting that follows from others, constants first, and a width of cut above the diameter of the mill.

    Raises
    ------
    UsageError

    >>> check_settings({"V": np.array([50.0, 100.0]), "Dc": np.array([20.0])}, "milling")
    """
    _check_width(given, process)
    order = sorted((name for name in SETTINGS if name in given), key=lambda name: given[name].size > 1)
    if found := _redundant({name: given[name] for name in order}, process):
        role, rules = found
        others = [name for name in given if any(name in rule.inputs for rule in rules)]
        raise UsageError(
            f"{role} {_ends(given[role])} {ROLES[role].unit}: it follows from {join_words(others)}, which are given "
            f"too ({', '.join(rule.equation for rule in rules)}). Leave out {role}, or one of these."
        )


def _redundant(given: Mapping[str, Array], process: Any) -> tuple[str, tuple[Rule, ...]] | None:  # noqa: ANN401
    """The first setting that follows from the others, with the rules by which it does; None where none does."""
    for role in given:
        others: dict[str, Values] = {name: values for name, values in given.items() if name != role}
        rules = _steps(role, Known(others, {}, frozenset(), process, process is not None), frozenset(), None)
        if rules:
            return role, rules
    return None


def _check_width(given: Mapping[str, Array], process: str | None) -> None:
    """Refuse a width of cut above the diameter of the mill."""
    tool = "Dc" if "Dc" in given else "D"
    if process in ("milling", None) and {"ae", tool} <= given.keys() and given["ae"].max() > given[tool].min():
        raise UsageError(
            f"ae {given['ae'].max():g} mm: the width of cut is at most the diameter, {tool} {given[tool].min():g} mm."
        )


def _ends(values: Array) -> str:
    low, high = (format_decimal(float(end)) for end in (values.min(), values.max()))
    return low if low == high else f"{low} to {high}"


def _steps(role: str, known: Known, above: frozenset[str], allowed: frozenset[str] | None) -> tuple[Rule, ...] | None:
    """Rules that give a role, in the order of their use; None where none does."""
    if known.has(role):
        return ()
    if role in above or role in known.unwanted or role in known.data:
        return None
    for rule in RULES:
        if rule.role != role or (allowed is not None and rule.equation not in allowed):
            continue
        parts = [_steps(name, known, above | {role}, allowed) for name in rule.inputs]
        if all(part is not None for part in parts) and (allowed is not None or known.allows(rule)):
            return (*(step for part in parts if part for step in part), rule)
    return None


def _computed(rule: Rule, known: Known, names: dict[str, str]) -> Derived:
    """Apply a rule; a result of constants alone is a constant."""
    with np.errstate(all="ignore"):
        value = rule.function(*(known.value(role) for role in rule.inputs))
    columns = [names[role] for role in rule.inputs if role in known.data and role in names]
    others = [str(known.given[role]) for role in rule.inputs if role in known.given]
    computed = [role for role in rule.inputs if role in known.data and role not in names]
    of = "column" if len(columns) == 1 else "columns"
    parts = [f"{of} {join_words(columns)}"] * bool(columns) + computed + others
    listed = f"{parts[0]}, and {join_words(parts[1:])}" if len(columns) > 1 and parts[1:] else join_words(parts)
    sentence = f"{rule.equation}, computed from {listed}"
    if rule.formula.startswith("lf/(1000"):
        sentence += "; lengths of so many metres are along the cut, not along the feed"
    if rule.role == "Fxz":
        sentence += _not_thrust(known)
    if rule.formula.startswith("Fy"):
        sentence += "; Fy is taken as the cutting force, being the largest of the three"
    if isinstance(value, np.ndarray):
        known.data[rule.role] = np.where(np.isfinite(value), value, np.nan)
    else:
        known.given[rule.role] = Given(rule.role, float(value), f"{rule.formula}, {join_words(others)}")
    return Derived(rule.role, rule.equation, rule.inputs, sentence)


def _not_thrust(known: Known) -> str:
    """Remark where Fy, the cutting force in Alaskari and Oraby, is not the largest of the three components."""
    if not ("Fy" in known.data and known.has("Fy")):
        return ""
    middle = {role: float(np.median(np.nan_to_num(np.abs(known.value(role))[:SOME]))) for role in ("Fx", "Fy", "Fz")}
    largest = max(middle, key=lambda role: middle[role])
    if largest == "Fy":
        return ""
    return f"; it is the thrust only where Fy is the cutting force, and {largest} is the largest of the three here"


def machine_settings(plan: pd.DataFrame, process: str | None) -> dict[str, Array]:
    """Cutting speed, spindle speed and feed rate, where they follow from the other settings; 4 digits."""
    names = ("V", "n", "f", "fz", "fm", "z", "Dc", "D")
    has = {name: plan[name].to_numpy(dtype=float) for name in names if name in plan}
    diameter, out = has.get("Dc", has.get("D")), dict[str, Array]()
    if "V" not in has and "n" in has and diameter is not None:
        out["V"] = round_significant(pi * diameter * has["n"] / 1000, PLANNED)
    if "n" not in has and "V" in has and diameter is not None:
        out["n"] = has["n"] = round_significant(1000 * has["V"] / (pi * diameter), PLANNED)
    per_turn = has["fz"] * has["z"] if {"fz", "z"} <= has.keys() else has.get("f")
    if "fm" not in has and "n" in has and process != "turning" and per_turn is not None:
        out["fm"] = round_significant(per_turn * has["n"], PLANNED)
    return out


def removal_rate(plan: pd.DataFrame, process: str | None) -> Array | None:
    """Material removal rate of each row, mm3/min; None where a setting is missing or the process is not known.

    Examples
    --------
    >>> removal_rate(pd.DataFrame({"V": [150.0], "f": [0.3], "d": [2.5]}), "turning").tolist()
    [112500.0]
    """
    diameter = "Dc" if "Dc" in plan else "D"
    needed = {"turning": ("V", "f", "d"), "milling": ("d", "ae", "fm"), "drilling": ("V", "f", diameter)}
    if process is None:
        process = "turning" if {"V", "f", "d"} <= set(plan) and not {"fz", "fm", "ae"} & set(plan) else ""
    names = needed.get(process, ())
    if not names or not set(names) <= set(plan):
        return None
    rate = prod((plan[name].to_numpy(dtype=float) for name in names), start=np.ones(len(plan)))
    return np.asarray({"turning": 1000.0, "milling": 1.0, "drilling": 250.0}[process] * rate, dtype=np.float64)
