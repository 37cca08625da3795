"""The window of operation and its best point, where the file has power laws of what its limits limit."""

from typing import TYPE_CHECKING, Any

from ...core.errors import FitmodelsError
from ...parameters import ParameterFile
from .dynamics import sentence
from .middle import middle_of, reference
from .numbers import fact, figure, quantity
from .parts import Named, Number, Window

if TYPE_CHECKING:
    from ...controllers.region import Point, VisibleRegion

TITLE = "Window of operation"


def operation_window(pf: ParameterFile) -> Window | None:
    """Corners and optimum at the middle depth and time of the tests; None where limits or laws of V and f lack.

    Where the limits do not fit the laws the window says so in a sentence.
    """
    if not _can(pf):
        return None
    from ...controllers.region import visible_region

    d, t = (_middle(pf, symbol) for symbol in ("d", "t"))
    by = next((reference(law) for law in pf.laws.values() if law.by is not None), None)
    at: dict[str, Any] = {name: value for name, value in (("d", d), ("t", t)) if value is not None}
    try:
        found = visible_region(pf, by=by, **at)
        return _window(found)
    except FitmodelsError as error:
        return Window(title=TITLE, sentences=(sentence(f"no window of operation: {error}"),))


def _can(pf: ParameterFile) -> bool:
    limits = pf.limits
    if limits is None or not (limits.power or limits.force or limits.wear):
        return False
    powers = [law for law in pf.laws.values() if law.form == "power"]
    return any({"V", "f"} <= {f.symbol for f in law.factors} for law in powers)


def _middle(pf: ParameterFile, symbol: str) -> float | None:
    ranges = [(f.low, f.high) for law in pf.laws.values() for f in law.factors if f.symbol == symbol]
    if not ranges:
        return None
    return middle_of(max(low for low, _ in ranges), min(high for _, high in ranges), logs=True)


def _window(found: "VisibleRegion") -> Window:
    at = f"at d {quantity(figure(found.setting.d, 6, 'mm'))} and t {quantity(figure(found.setting.t, 6, 'min'))}"
    if found.empty:
        return Window(title=TITLE, sentences=(sentence(f"nothing is allowed {at}: {found.conflict}"),))
    best = found.best
    corners = (
        item
        for corner in found.corners
        for item in (
            *fact(f"corner {corner.letter}, V", figure(corner.V, 4, "m/min"), " and ".join(corner.limits)),
            *fact(f"corner {corner.letter}, f", figure(corner.f, 4, "mm/rev")),
        )
    )
    held = ", held there by " + " and ".join(best.held_by) if best.held_by else ""
    tested = "" if best.tested else "; the laws were not tested there, so try it with care before it is relied on"
    said = [
        f"{at}, the greatest metal removal rate within the limits is {quantity(_removal(best.MRR))}{held}{tested}",
        "the laws are taken as they stand: on a limit, about every second tool exceeds it, so stay inside by as much "
        "as the intervals say",
        *found.notes,
    ]
    return Window(title=TITLE, facts=(*_best(best), *corners), sentences=tuple(sentence(text) for text in said))


def _best(best: "Point") -> tuple[Named, ...]:
    responses = (
        item
        for name, value in best.values.items()
        for item in fact(f"{name} at the optimum", figure(value, 4, best.units[name]))
    )
    return (
        *fact("V of the optimum", figure(best.V, 4, "m/min")),
        *fact("f of the optimum", figure(best.f, 4, "mm/rev")),
        *fact("metal removal rate of the optimum", _removal(best.MRR), "MRR = 1000 V f d"),
        *responses,
        *fact("wear rate at the optimum", figure(best.wear_rate, 4, "um/min")),
    )


def _removal(value: float) -> Number:
    return figure(value, 4, "mm3/min")
