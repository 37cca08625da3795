"""Which laws of a file a region needs, and which it can tell beside."""

from contextlib import suppress
from typing import TYPE_CHECKING

from ...core.errors import UsageError
from .allowed import FORCES
from .surfaces import USUAL, Setting, plane, wear_law

if TYPE_CHECKING:
    from ...parameters import LawSection, ParameterFile


def wear_needed(pf: "ParameterFile", setting: Setting, named: str | None) -> "LawSection | None":
    """The law of wear; None where the file has none that the setting can answer, as one of a further factor."""
    wear = wear_law(pf, named)
    if wear is not None and wear.response in setting.at and named is None:
        return None
    if wear is not None:
        plane(wear, setting)  # refuses here, by its own name
    return wear


def also_told(pf: "ParameterFile", setting: Setting, wear: "LawSection | None") -> tuple[str, ...]:
    """Power and forces without a limit, where their laws can be asked: they are told, no more."""
    out = []
    for name in ("P", *FORCES):
        if name in pf.laws:
            with suppress(UsageError):
                plane(pf.laws[name], setting, wear)
                out.append(name)
    return tuple(out)


def check_held(pf: "ParameterFile", setting: Setting) -> None:
    """Refuse to hold what no law has."""
    factors = {factor.symbol for law in pf.laws.values() for factor in law.factors}
    for name in setting.at:
        if name in USUAL:
            cure = f"give {name}=" if name in ("d", "t") else "the limits give its range"
            raise UsageError(f"at: {name} does not belong there; {cure}.")
        if name not in {*factors, "D"}:
            raise UsageError(f"at: no law has a factor {name!r}; they have {', '.join(sorted(factors))}.")
