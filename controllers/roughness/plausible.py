"""Values of control at constant roughness that no cut has, or that contradict the laws of the file."""

from typing import TYPE_CHECKING, Final

from ...core.errors import UsageError
from .reference import force_at

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ...parameters import LawSection
    from .plant import Cut

KC_POSSIBLE: Final = (100.0, 30000.0)  # N/mm2, of turning
TIMES_POSSIBLE: Final = (1e-3, 10.0)  # s, of servo and process
HIGHEST_READING: Final = 20.0  # times the reference force: a valid reading beyond, of either sign, is refused
OTHER_GAIN: Final = 3.0  # times the kc a of the force law, or a share of it: a given kc a beyond needs a reason


def check_plausible(
    gain: float | None = None, depth: float | None = None, times: "Mapping[str, float] | None" = None
) -> None:
    """Refuse a kc a, N per mm/rev, at a depth, mm, or time constants, s, that no cut has.

    Raises
    ------
    UsageError
        The specific force is not 100 to 30000 N/mm2, or a time constant not 1 ms to 10 s.
    """
    low, high = KC_POSSIBLE
    if gain is not None and depth is not None and not low <= gain / depth <= high:
        raise UsageError(
            f"kc a {gain:.4g} N per mm/rev at a depth of {depth:g} mm is a specific force of {gain / depth:.3g} N/mm2, "
            f"not {low:g} to {high:g}; check the values and their units."
        )
    low, high = TIMES_POSSIBLE
    for name, time in (times or {}).items():
        if not low <= time <= high:
            words = f"the time constant of the {name}, {time:.4g} s, is not {low:g} to {high:g} s"
            raise UsageError(f"{words}; check its unit.")


def check_readings(low: float, high: float, threshold: float, reference: float, *, given: bool = True) -> None:
    """Refuse valid readings, N, that do not enclose threshold and reference, or that are as good as no limit.

    Raises
    ------
    UsageError
        With the limit, and the remedy for a range that is given or derived.

    Examples
    --------
    >>> check_readings(-50.0, 3000.0, 56.0, 580.0)
    """
    if not low < threshold < reference < high:
        raise UsageError(
            f"valid={low:g}:{high:g}N: valid readings enclose the threshold {threshold:g} N and the "
            f"reference {reference:.4g} N; widen the range."
        )
    most = HIGHEST_READING * reference
    if max(-low, high) > most:
        remedy = "narrow the range" if given else "check kc a and the feed, or give valid=-50:3000N"
        raise UsageError(
            f"valid={low:.4g}:{high:.4g}N: a valid reading is at most {HIGHEST_READING:g} times the reference force "
            f"{reference:.4g} N, which is {most:.4g} N, of either sign; {remedy}."
        )


def gain_off_law(cut: "Cut", law: "LawSection | None", gain: float, feed: float) -> str:
    """Sentence on a given kc a, N per mm/rev, far from that of the force law; empty where it is near."""
    if law is None or (cut.force_per_feed is None and cut.kc is None):
        return ""
    try:
        own = force_at(law, feed, cut.depth, cut.conditions) / feed
    except UsageError:  # a factor of the law is not given: nothing to compare with
        return ""
    if own / OTHER_GAIN <= gain <= OTHER_GAIN * own:
        return ""
    return (
        f"kc a {gain:.4g} N per mm/rev and the {own:.4g} N per mm/rev of the force law {law.equation} differ by more "
        f"than {OTHER_GAIN:g} times."
    )
