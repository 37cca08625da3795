"""The exported HAL controller of a parameter file: what may be written, the words of consent, comparison with HAL."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from ..core.errors import GateError, UsageError

if TYPE_CHECKING:
    from ..parameters import ParameterFile
    from ..parameters.exports.loop import LoadLoop

Value = bool | int | float

LEAST_SPAN: Final = 0.1  # of the feed range: the upper limit stays so far above the lower one
SAME: Final = 1e-9  # relative difference of a setting in HAL and in the file
STATUS: Final = ("fm-fault", "fm-overload", "fm-worn", "fm-dead", "fm-armed", "fm-enable", "fm-cut", "fm-reset")
READINGS: Final = ("fm-feed", "fm-filtered")
CHANGED: Final = ("fm.pid.command", "fm.entry.offset", "fm.centre.offset", "fm.pid.maxoutput", "fm.limit.max")


@dataclass(frozen=True, slots=True)
class Controller:
    """The exported constant-load controller of a parameter file: its settings in HAL, and what may change.

    Attributes
    ----------
    settings : mapping
        Value of each pin and parameter of the HAL export.
    reference : tuple of float
        Lowest and highest reference that may be written, unit_load; the highest is that of the file.
    high : tuple of float
        Lowest and highest upper limit of the feed, unit_feed; the highest is that of the file.
    heartbeat : float
        s without a change of the heartbeat after which the controller trips.
    """

    loop: "LoadLoop"
    settings: Mapping[str, Value]
    reference: tuple[float, float]
    high: tuple[float, float]
    heartbeat: float

    def pins(self, reference: float, high: float) -> dict[str, float]:
        """Values of the pins for a reference and an upper limit of the feed."""
        loop = self.loop
        most = high / loop.feed_programmed
        middle, half = (loop.low + most) / 2, (most - loop.low) / 2
        return dict(zip(CHANGED, (reference, loop.entry_gain * reference - middle, middle, half, most), strict=True))

    def limits(self) -> dict[str, tuple[float, float]]:
        """Lowest and highest value of each pin that is written."""
        corners = [self.pins(reference, high) for reference in self.reference for high in self.high]
        return {pin: (min(c[pin] for c in corners), max(c[pin] for c in corners)) for pin in CHANGED}


def controller_of(pf: "ParameterFile") -> Controller:
    """The HAL controller of a parameter file.

    Raises
    ------
    GateError
        The file has no controller that can be exported to HAL, or one without a heartbeat.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> try:
    ...     controller_of(published("CLM-2023"))
    ... except GateError as error:
    ...     print(str(error)[:47])
    the controller has law pi, form incremental_sum
    """
    from ..controllers.constant_load_milling.control_laws import loop_of

    return controller_of_loop(loop_of(pf))


def controller_of_loop(loop: "LoadLoop") -> Controller:
    """The HAL controller of a loop; errors as for `controller_of`.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from fitmodels.controllers.constant_load_milling.control_laws import loop_of
    >>> from fitmodels.parameters.published import published
    >>> loop = replace(loop_of(published("CLM-2023")), form="position", average=1)
    >>> controller_of_loop(loop).reference[1]
    0.24
    """
    from ..controllers.exports.hal import settings_of

    if loop.average > 1 or loop.form != "position" or loop.law != "pi":
        raise GateError(
            f"the controller has law {loop.law}, form {loop.form} and a moving average of {loop.average} samples, "
            "which the HAL export does not have; only there are reference and limits pins. Nothing is written."
        )
    if not loop.heartbeat:
        raise GateError(
            "the controller has no heartbeat (engagement.heartbeat is 0), so that it would not notice the loss of this "
            "program; set heartbeat to 0.2 s with `fitmodels settings`, export and load it again. Nothing is written."
        )
    span = loop.feed_high - loop.feed_low
    return Controller(
        loop, {f"fm.{pin}": _value(text) for pin, text in settings_of(loop)},
        (min(loop.engage_at + loop.hysteresis, loop.reference), loop.reference),
        (loop.feed_low + LEAST_SPAN * span, loop.feed_high), loop.heartbeat,
    )  # fmt: skip


def _value(text: str) -> Value:
    if text in ("TRUE", "FALSE"):
        return text == "TRUE"
    return int(text, 16) if text.startswith("0x") else float(text)


def consent_words(controller: Controller) -> str:
    """The words that a user repeats to allow writing: what is written, and within which range.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from fitmodels.controllers.constant_load_milling.control_laws import loop_of
    >>> from fitmodels.parameters.published import published
    >>> loop = replace(loop_of(published("CLM-2023")), form="position", average=1)
    >>> consent_words(controller_of_loop(loop))
    'write reference 0.177 to 0.24 A and feed limit 640 to 1000 mm/min'
    """
    loop = controller.loop
    (least, most), (low, high) = controller.reference, controller.high
    return (
        f"write reference {least:.3g} to {most:.3g} {loop.unit_load} and feed limit "
        f"{low:.4g} to {high:.4g} {loop.unit_feed}"
    )


def require_consent(controller: Controller, given: str) -> None:
    """Refuse where the given words are not those of `consent_words`, spaces and case apart.

    Raises
    ------
    UsageError
    """
    words = consent_words(controller)
    if given.lower().split() != words.lower().split():
        raise UsageError(
            f'--write changes the machine, and needs consent to its range: --consent "{words}"; '
            f'given was "{given[:200]}". Without --write nothing is written.'
        )


def differences(controller: Controller, values: Mapping[str, Value]) -> list[str]:
    """Settings in HAL that are not those of the file; what may be written must be inside its limits."""
    limits, wrong = controller.limits(), []
    missing = [name for name in (*STATUS, *READINGS, *controller.settings) if name not in values]
    if missing:
        return [f"HAL has no {', '.join(missing[:3])}{' and others' if len(missing) > 3 else ''}"]
    for pin, value in controller.settings.items():
        low, high = limits.get(pin, (value, value))
        slack = SAME * max(abs(low), abs(high))
        if not low - slack <= values[pin] <= high + slack:
            wrong.append(f"{pin} is {values[pin]}, in the file {value}")
    if not wrong:
        whole = controller.pins(values["fm.pid.command"], values["fm.limit.max"] * controller.loop.feed_programmed)
        if any(not is_same(values[pin], value) for pin, value in whole.items()):
            wrong.append("its feed limit was written in part; load the HAL file again")
    return wrong


def write_order(pins: Mapping[str, float], before: Mapping[str, float]) -> list[str]:
    """Pins in the order in which a write that is interrupted leaves the loop free to go to its lower limit."""
    rises = pins.get("fm.pid.maxoutput", 0.0) > before["fm.pid.maxoutput"]
    order = (0, 3, 1, 2, 4) if rises else (0, 4, 2, 3, 1)
    return [CHANGED[k] for k in order if CHANGED[k] in pins]


def is_same(one: Value | None, two: float) -> bool:
    """Whether a setting has a value, but for rounding."""
    return one is not None and math.isclose(one, two, rel_tol=SAME, abs_tol=1e-12)
