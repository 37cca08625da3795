"""Whether laws were tested where a region uses them: a law says nothing about where nobody cut."""

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from .points import SAME
from .surfaces import Setting, ratio

if TYPE_CHECKING:
    from ...parameters import LawSection


def tested(laws: Mapping[str, "LawSection"], setting: Setting, wear: str | None, at: Mapping[str, float]) -> bool:
    """Whether every law was tested at a pair of V and f; ``at`` holds these, and the wear there by its symbol."""
    known: dict[str, tuple[float, str | None]] = {"V": (at["V"], "m/min"), "f": (at["f"], "mm/rev")}
    if wear is not None:
        known[wear] = at[wear], laws[wear].unit
    known |= setting.known
    return all(_inside(law, setting.by, known) for law in laws.values())


def _inside(law: "LawSection", by: str | None, known: Mapping[str, tuple[float, str | None]]) -> bool:
    given = {}
    for factor in law.factors:
        value, unit = known[factor.symbol]
        value *= ratio(unit or factor.unit, factor.unit)
        ends = (end for end in (factor.low, factor.high) if abs(value - end) <= SAME * abs(end))  # a corner of the box
        given[factor.symbol] = next(ends, value)
    return bool(law.inside(None if law.by is None else by, **given))


def untested(laws: Mapping[str, "LawSection"], setting: Setting) -> tuple[str, ...]:
    """A sentence for each held factor that lies outside what was tested."""
    return tuple(dict.fromkeys(words for law in laws.values() for words in _outside(law, setting)))


def _outside(law: "LawSection", setting: Setting) -> Iterator[str]:
    for factor in law.factors:
        if factor.symbol in setting.known:
            value, unit = setting.known[factor.symbol]
            value *= ratio(unit or factor.unit, factor.unit)
            if not factor.low <= value <= factor.high:
                tested_over = f"{factor.low:g} to {factor.high:g} {factor.unit} that {law.response} was tested over"
                yield f"{factor.symbol} {value:g} lies outside the {tested_over}: do not rely on the region."
