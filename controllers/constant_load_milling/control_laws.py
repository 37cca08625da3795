"""The two control laws of constant load, from load error to feed override, and the settings of a file for them.

Position form, as LinuxCNC's pid runs it about the middle of the limits, from the feed at entry. Incremental form, as
Tai, Tsai & Li 2023 word eq. 16:

    u_k = u_(k-1) + Kp e_k + Ki sum(e)

"U0 is the last control signal" makes Kp an integral gain and Ki one of the integral. The limits are inside the
recursion, so it does not wind up; the sum of Ki holds while a limit is active and the error pushes further.
"""

from typing import TYPE_CHECKING

from ...core.errors import GateError, ParameterError

if TYPE_CHECKING:
    from ...parameters import ParameterFile
    from ...parameters.exports.loop import LoadLoop
    from ...parameters.sections.load_line import LoadLineSection


def line_of(pf: "ParameterFile") -> "LoadLineSection":
    """Settings of milling at constant load.

    Raises
    ------
    ParameterError
        The file has none.
    """
    if pf.load_line is None:
        raise ParameterError(
            "the file has no settings of milling at constant load; set them with `fitmodels settings params.json`."
        )
    return pf.load_line


def loop_of(pf: "ParameterFile") -> "LoadLoop":
    """Gains, limits and settings.

    Raises
    ------
    GateError
        The file has no gains or no settings of the loop, or fails the check.
    """
    from ...parameters.exports.loop import loop_settings
    from ...parameters.exports.names import plain
    from ...parameters.exports.view import require_check

    require_check(pf)
    found = loop_settings(pf, own_form=True)
    if found.loop is None:
        raise GateError(f"the parameter file of {plain(pf.identity.tool)} on {plain(pf.identity.work)} {found.lacking}")
    return found.loop


class PositionLaw:
    """PI in position form with clamping, from the override at entry.

    Attributes
    ----------
    limited : int
        1 or -1 while the PI is clipped at its upper or lower limit, else 0.
    """

    __slots__ = ("_bias", "_half", "_i", "_middle", "_p", "_sum", "_time", "limited")

    def __init__(self, loop: "LoadLoop") -> None:
        self._p, self._i, self._time = loop.p, loop.i, loop.sample_time  # properties take time
        self._middle, self._half = (loop.low + loop.high) / 2, (loop.high - loop.low) / 2
        self.enter(self._middle)

    def enter(self, override: float) -> None:
        """Begin at an override."""
        self._bias, self._sum, self.limited = override - self._middle, 0.0, 0

    def target(self, error: float) -> float:
        """Override for an error; pid holds its sum while its output is clipped and the error pushes further."""
        if error * self.limited <= 0:
            self._sum += error * self._time
        half = self._half
        out = self._bias + self._p * error + self._i * self._sum
        self.limited = (out > half) - (out < -half)
        return self._middle + min(max(out, -half), half)


class IncrementalLaw:
    """Eq. 16 inside its feed limits and rates.

    Attributes
    ----------
    limited : int
        1 or -1 while u is clipped at its upper or lower limit, else 0.
    """

    __slots__ = ("_back_off", "_high", "_i", "_last", "_low", "_p", "_recover", "_sum", "limited")

    def __init__(self, loop: "LoadLoop") -> None:
        self._low, self._high, self._p, self._i = loop.low, loop.high, loop.p, loop.i * loop.sample_time
        self._back_off, self._recover = loop.back_off * loop.sample_time, loop.recover * loop.sample_time
        self.enter(loop.low)

    def enter(self, override: float) -> None:
        """Begin at an override."""
        self._last, self._sum, self.limited = override, 0.0, 0

    def target(self, error: float) -> float:
        """Override for an error."""
        last = self._last
        if error * self.limited <= 0:
            self._sum += error
        unlimited = last + self._p * error + self._i * self._sum
        self._last = min(max(unlimited, self._low, last - self._back_off), self._high, last + self._recover)
        self.limited = (unlimited > self._high) - (unlimited < self._low)
        return self._last
