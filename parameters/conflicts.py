"""Sections of several parameter files: which file each is taken from, and the conflicts that leave this open.

A section that follows from another one (a tool life from its wear law, gains from dynamics, settings from a load law)
is only taken from a file that holds the same as the result.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from ..core.display import Displayable
from ..core.errors import ParameterError, UsageError
from ..core.suggestions import did_you_mean
from .draws import Draws
from .file import ParameterFile
from .messages import ROUNDING, agree, difference, in_unit, short
from .sections.base import Section
from .sections.law import LawSection
from .sections.law_parts import ToolLifeSection
from .sections.load_line import Bound, LimitsSection, Range, ResponseLimit
from .sections.origin import DesignSection
from .setting_rules import LOAD_FORMS

WHOLE: Final = ("design", "dynamics", "drive", "costs", "adaptive_force")
FOLLOWING: Final = ("pi", "tool_life", "load_line", "roughness")  # each from the file of what it was computed from
IDENTITY: Final = ("machine", "iso513", "setup")
RANGES: Final = ("feed", "feed_rate", "speed", "spindle_speed")
ITERATED: Final = {"edges": 1e-5, "checks": 1e-5}  # parts of a law found by iterations: relative difference
OF_EDGES: Final = {"sums", "curves"}  # parts of a law and of a tool life with an entry for each edge, by its name
NAMED: Final = ("verdict", "suspects")  # of a check: words that hold names of edges
ASSUMED: Final = "average flank wear of ISO 3685"  # source of a criterion that nobody gave
AGAIN: Final = {
    "pi": "fitmodels tune", "load_line": "fitmodels settings", "roughness": "fitmodels roughness",
    "tool_life": "fitmodels FILE --criterion",
}  # fmt: skip


@dataclass(frozen=True, slots=True, repr=False)
class MergeInput(Displayable):
    """A parameter file to be merged: the name that messages use, the file, and its draws."""

    name: str
    pf: ParameterFile
    draws: Mapping[str, Draws] = field(default_factory=dict)


def parts(pf: ParameterFile) -> dict[str, Any]:
    """Sections that are taken whole, by name: ``laws.VB``, ``limits.power``, ``pi``, ``identity.machine``.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> [name for name in parts(published("AC-2016")) if name.startswith("laws.")]
    ['laws.AW', 'laws.P', 'laws.Fxz']
    """
    identity = pf.identity
    found: dict[str, Any] = {f"identity.{name}": getattr(identity, name) for name in IDENTITY}
    found |= {f"identity.iso13399.{name}": value for name, value in identity.iso13399.items()}
    found |= {f"identity.sensors.{sensor.symbol}": sensor for sensor in identity.sensors}
    found |= {f"laws.{name}": law for name, law in pf.laws.items()}
    found |= {name: getattr(pf, name) for name in (*WHOLE, *FOLLOWING)}
    found |= {**_limits(pf), **(pf.model_extra or {})}
    return {name: value for name, value in found.items() if value is not None}


def _limits(pf: ParameterFile) -> dict[str, Any]:
    limits = pf.limits or LimitsSection()
    found: dict[str, Any] = {f"limits.{name}": getattr(limits, name) for name in ("power", "force", "wear", *RANGES)}
    return found | {f"limits.responses.{name}": limit for name, limit in limits.responses.items()}


def check_pair(inputs: Sequence[MergeInput]) -> None:
    """Refuse other tools or works, and symbols whose units are of other quantities: no option can decide these."""
    first = inputs[0]
    for each in inputs[1:]:
        for name in ("tool", "work"):
            one, two = (getattr(of.pf.identity, name) for of in (first, each))
            if one != two:
                raise ParameterError(
                    f"{first.name} is of {name} {short(one)} and {each.name} of {short(two)}: only files of one tool "
                    "and work material are merged. Fit again with --tool and --work where both are the same."
                )
    _check_units(inputs)


def _check_units(inputs: Sequence[MergeInput]) -> None:
    seen: dict[str, tuple[str, str]] = {}
    for each in inputs:
        for symbol, unit in units_of(each.pf):
            former, where = seen.setdefault(symbol, (unit, each.name))
            if in_unit(1.0, unit, former) is None:
                raise ParameterError(
                    f"{symbol} is in {former or 'no unit'} in {where} and in {unit or 'no unit'} in {each.name}: these "
                    "are not one quantity. Fit one of both again with the name or unit of the other (--map, --unit)."
                )


def units_of(pf: ParameterFile) -> Iterator[tuple[str, str]]:
    """Symbol and unit of each response and factor of the laws."""
    for law in pf.laws.values():
        yield law.response, law.unit
        yield from ((factor.symbol, factor.unit) for factor in law.factors)


@dataclass(slots=True)
class SectionChoice:
    """Sections of all files, the decisions that were given, and the conflicts that these leave."""

    inputs: Sequence[MergeInput]
    take: dict[str, int]
    prefer: int | None
    conflicts: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    held: list[dict[str, Any]] = field(init=False)

    def __post_init__(self) -> None:
        self.held = [parts(each.pf) for each in self.inputs]
        for section, number in self.take.items():
            known = {prefix for name in self.held[number] for prefix in _prefixes(name)} | {"criterion"}
            if section not in known:
                file = self.inputs[number].name
                raise UsageError(f"--take {section}: {file} has no such section. {did_you_mean(section, known, 0.6)}")

    def name(self, number: int) -> str:
        """Name of a file in messages."""
        return self.inputs[number].name

    def asked(self, name: str) -> int | None:
        """The file that ``take`` names for a section, by the longest name."""
        return next((self.take[prefix] for prefix in reversed(_prefixes(name)) if prefix in self.take), None)

    def decided(self, name: str, among: Sequence[int], words: str) -> int:
        """The file of a section that several hold with other contents; a conflict where nothing decides."""
        asked = self.asked(name)
        for number in (asked, self.prefer):
            if number in among and number is not None:
                self.notes.append(f"{name} is taken from {self.name(number)}: {words}.")
                return number
        self.conflicts.append(f"{name}: {words}.")
        return among[0]


def _prefixes(name: str) -> list[str]:
    """Names that stand for a section, from the widest.

    >>> _prefixes("limits.responses.Ra")
    ['limits', 'limits.responses', 'limits.responses.Ra']
    """
    words = name.split(".", 2) if name.startswith(("limits.responses.", "identity.")) else name.split(".", 1)
    return [".".join(words[: count + 1]) for count in range(len(words))]


def resolved(choice: SectionChoice) -> dict[str, int]:
    """File of each section, first of those that stand alone and then of those that follow from them."""
    names = dict.fromkeys(name for held in choice.held for name in held)
    chosen: dict[str, int] = {}
    for name in sorted(names, key=lambda name: name in FOLLOWING):
        among = _among(choice, name, chosen)
        if among:
            chosen[name] = _design(choice, among) if name == "design" else _one_of(choice, name, among)
    _criterion(choice, chosen)
    return chosen


def _among(choice: SectionChoice, name: str, chosen: Mapping[str, int]) -> list[int]:
    """The files from which a section may be taken."""
    among = [number for number, held in enumerate(choice.held) if name in held]
    return [number for number in among if name not in FOLLOWING or _follows(choice, name, number, chosen)]


def _one_of(choice: SectionChoice, name: str, among: Sequence[int]) -> int:
    """The file of a section that several may hold."""
    first, asked = choice.held[among[0]][name], choice.asked(name)
    others = [number for number in among if not same_section(choice.held[number][name], first)]
    if others:
        return choice.decided(name, among, _differ(choice, name, among[0], others[0]))
    return asked if asked is not None and asked in among else among[0]


def _design(choice: SectionChoice, among: Sequence[int]) -> int:
    """The tests that are described: a file has room for those of one data file."""
    number = next((n for n in (choice.asked("design"),) if n in among and n is not None), among[0])
    if choice.asked("design") is None and len({choice.inputs[n].pf.provenance.data_sha256 for n in among}) > 1:
        choice.notes.append(
            f"design: the tests described are those of {choice.name(number)}; each law keeps its own ranges. "
            "--take design=FILE describes the others."
        )
    return number


def _sources(pf: ParameterFile, name: str) -> list[str]:
    """Sections from which one follows, in its own file."""
    section: Any = getattr(pf, name)
    if name == "tool_life":
        return [f"laws.{section.wear}"]
    if name != "pi":
        return [f"laws.{section.law}"]
    loads = [key for key, law in pf.laws.items() if law.form in LOAD_FORMS]
    if pf.load_line is not None:
        loads = [pf.load_line.law]
    return ["dynamics", *(f"laws.{key}" for key in loads if section.scaling_u != 1)]


def _follows(choice: SectionChoice, name: str, number: int, chosen: Mapping[str, int]) -> bool:
    """Whether a section of a file belongs to what the result holds; what is left out is noted."""
    for source in _sources(choice.inputs[number].pf, name):
        if source not in chosen:
            continue
        own, taken = choice.held[number].get(source), choice.held[chosen[source]][source]
        if own is not None and same_section(own, taken):
            continue
        if own is None and not _without_source(choice, name, number, source, chosen[source]):
            return False
        if own is not None:
            _leave_out(choice, name, number, source, choice.name(chosen[source]))
            return False
    return True


def _without_source(choice: SectionChoice, name: str, number: int, source: str, of: int) -> bool:
    """Whether a section is taken although its file lacks what it was computed from, which another file holds."""
    mine, taken, file = choice.held[number][name], choice.held[of][source], choice.name(number)
    for held in choice.held:
        if source in held and same_section(held[source], taken) and same_section(held.get(name), mine):
            return True  # another file holds both
    asked = choice.prefer if choice.asked(name) is None else choice.asked(name)
    words = f"{name} of {file} was not computed from the {source} of {choice.name(of)}, which {file} does not hold"
    if asked is None:
        choice.conflicts.append(f"{words}.")
        return True
    choice.notes.append(f"{words}; it is {'taken as given' if asked == number else 'left out'}.")
    return asked == number


def _leave_out(choice: SectionChoice, name: str, number: int, source: str, of: str) -> None:
    """Note that a section is left out, as it was computed from another source than that of the result."""
    file = choice.name(number)
    if choice.asked(name) == number:
        raise UsageError(
            f"--take {name}: that of {file} was computed from its own {source}, and that of {of} is taken; take "
            f"both from one file, or run {AGAIN[name]} on the merged file."
        )
    choice.notes.append(
        f"{name} of {file} is left out: it was computed from another {source}; run {AGAIN[name]} on the result."
    )


def _criterion(choice: SectionChoice, chosen: dict[str, int]) -> None:
    """A wear limit and a tool life of two files at other criteria are a conflict; an assumed criterion gives way."""
    if not {"limits.wear", "tool_life"} <= chosen.keys() or chosen["limits.wear"] == chosen["tool_life"]:
        return
    one, two = chosen["limits.wear"], chosen["tool_life"]
    limit, life = choice.held[one]["limits.wear"], choice.held[two]["tool_life"]
    if limit.of not in (None, life.wear) or in_unit(limit.value, limit.unit, life.unit_of_wear) == life.criterion:
        return
    words = (
        f"the wear limit of {choice.name(one)} is {limit.value:g} {limit.unit}, the tool life of {choice.name(two)} is "
        f"at {life.criterion:g} {life.unit_of_wear}"
    )
    if _assumed(choice.inputs[two].pf.design):
        choice.notes.append(f"criterion: {words}, which was assumed; the limit counts.")
        return
    kept = choice.decided("criterion", sorted((one, two)), words)
    chosen.pop("tool_life" if kept == one else "limits.wear")


def _assumed(design: DesignSection | None) -> bool:
    """Whether nobody gave the criterion of the tests."""
    return design is not None and design.criterion is not None and design.criterion.source == ASSUMED


def plain(value: Any) -> Any:  # noqa: ANN401
    """A section as data; anything else as it is."""
    return value.model_dump() if isinstance(value, Section) else value


def same_section(one: Any, two: Any) -> bool:  # noqa: ANN401
    """Whether two sections say the same within rounding; limits also in other units."""
    a, b = plain(one), plain(two)
    if isinstance(one, LawSection | ToolLifeSection) and type(one) is type(two):
        return _of_same_data(a, b)
    if not (isinstance(one, (Bound, Range, ResponseLimit)) and type(one) is type(two)):
        return agree(a, b)
    return all(_end(b, key, a["unit"]) == value for key, value in a.items() if key != "unit")


def _of_same_data(one: Mapping[str, Any], two: Mapping[str, Any]) -> bool:
    """Whether two laws, or tool lives, are of the same data; names of edges may differ."""
    for key in {**one, **two}.keys() - OF_EDGES:
        x, y = one.get(key), two.get(key)
        if key == "alternative" and isinstance(x, Mapping) and isinstance(y, Mapping):
            same = _of_same_data(x, y)
        else:
            x, y = (_unnamed(value) if key == "checks" else value for value in (x, y))
            same = agree(x, y, ITERATED.get(key, ROUNDING))
        if not same:
            return False
    return True


def _unnamed(checks: Any) -> Any:  # noqa: ANN401
    """Checks without the words that hold names of edges."""
    if not isinstance(checks, Mapping):
        return checks
    return {
        name: {key: value for key, value in check.items() if key not in NAMED} if isinstance(check, Mapping) else check
        for name, check in checks.items()
    }


def _end(limit: Mapping[str, Any], key: str, to: str) -> Any:  # noqa: ANN401
    """An end of a limit in another unit; what is no number as it is."""
    value = limit.get(key)
    return in_unit(value, limit["unit"], to) if isinstance(value, float) else value


def _differ(choice: SectionChoice, name: str, one: int, two: int) -> str:
    a, b = (plain(choice.held[number][name]) for number in (one, two))
    return difference(a, b, choice.name(one), choice.name(two))
