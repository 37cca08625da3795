"""The setting rules of CLM-2023: from a load law and wear tests to reference load, feed limits and tool change.

1. The load that a worn tool withstands, times a safety factor, is the reference: 0.85 x 0.28 A, in print 0.24 A.
2. The upper feed limit is the feed at the reference with a sharp tool (VB 0).
3. The lower feed limit is the feed at the reference when the wear reaches its limit (eq. 15).
4. The tool is changed when the feed command rests on the lower limit; the wear is then to lie in a window.

Source: Tai, Tsai & Li 2023, IEEE Access, doi 10.1109/ACCESS.2023.3330587, sections II.E and III.A.
"""

import math
import re
from collections.abc import Mapping
from typing import Any

import numpy as np
from pydantic import ValidationError

from ..core.arrays import is_positive
from ..core.calls import check_share
from ..core.errors import ParameterError, UsageError
from ..core.suggestions import did_you_mean
from ..datasets.units import convert
from .evaluation import IntervalOptions, interval_band
from .file import ParameterFile
from .messages import schema_message
from .sections.base import Covariance
from .sections.law import LawSection
from .sections.load_line import Engagement, FeedLimit, LimitInterval, LoadLineSection, NoInterval
from .setting_words import cause_of_refusal, feeds_far_beyond_tests, no_overload, rounded, window_note

SAFETY_FACTOR = 0.85
WINDOW = (0.18, 0.22)  # mm
RESOLUTION = 0.01  # of the reference, in A: as the paper rounds it
HELD = 0.01  # of the reference: within the regulation error of the paper
LOAD_FORMS = ("load_line", "feed_line")
# The load at which a feed_line holds: the last sentence of the note that fit.regression._held_law writes. The schema of
# the law has no field of it, and files of every version state it in this note.
HELD_LOAD = re.compile(r"It is true at ([\d.eE+-]+) (\S+) alone")


def settings(
    pf: ParameterFile,
    worn: float,
    *,
    safety_factor: float = SAFETY_FACTOR,
    rounded_to: float | None = RESOLUTION,
    window: tuple[float, float] | None = None,
    wear_limit: float | None = None,
    law: str | None = None,
    by: str | None = None,
    level: float = 0.95,
    dwell: float | None = None,
    engagement: Mapping[str, Any] | None = None,
) -> LoadLineSection:
    """Settings of milling at constant load, by the paper's rules.

    Parameters
    ----------
    pf : ParameterFile
        With a law of the form load_line or feed_line.
    worn : float
        Load that a worn tool withstands without chipping, from the wear tests, in the unit of the load; at most 3 times
        the largest load tested.
    safety_factor : float
        At least 0.5, below 1: below, twice the reference would be no overload.
    rounded_to : float or None
        Step that the reference is rounded to; None leaves it as it is.
    window : tuple of float, optional
        Wear between which the tool is to be changed, in the law's unit of wear; by default 0.18 to 0.22 mm.
    wear_limit : float, optional
        Wear at the lower limit; the top of the window unless given. Half the tools have worn further than
        this when they reach the limit, so a limit in the middle of the window keeps more of them in it.
    law, by : str, optional
        Response of the law, needed where the file holds several, and its level.
    level : float
        Of the intervals.
    dwell : float, optional
        s that the command stays at the lower limit before the tool counts as worn.
    engagement : mapping, optional
        Engagement of the loop; see `Engagement`.

    Returns
    -------
    LoadLineSection

    Raises
    ------
    UsageError
        A number out of range, or an unknown setting of the engagement.
    ParameterError
        The file holds no load law; the limits come out in the wrong order; a line of feed held at another load.

    Examples
    --------
    >>> from fitmodels import datasets, fit, parameters
    >>> runs = datasets.read_runs(datasets.bundled("clm2023_end_milling"))
    >>> pf = parameters.collect(tool="end mill", work="S45C", laws=[fit.load_law(runs)])
    >>> line = settings(pf, worn=0.28)
    >>> line.reference, round(line.upper.value), round(line.lower.value)
    (0.24, 996, 563)
    """
    found = load_law_of(pf, law)
    assumed, window = window is None, _usual_window(found) if window is None else window
    limit = window[1] if wear_limit is None else wear_limit
    _check(worn, safety_factor, rounded_to, window, limit, level)
    reference = rounded(safety_factor * worn, rounded_to)
    notes = [*_check_held(found, reference), *([window_note(*window, found.factors[-1].unit)] if assumed else [])]
    upper, lower = (feed_limit(found, reference, wear, by=by, level=level) for wear in (0.0, limit))
    _check_order(found, float(worn), reference, lower, upper)
    if words := no_overload(found, worn, safety_factor, found.unit if found.form == "load_line" else "A"):
        raise UsageError(f"{words}.")
    probability, words = wear_in_window(found, reference, lower.value, window, by=by)
    return LoadLineSection.model_validate({
        "reference": reference,
        "worn": float(worn),
        "safety_factor": float(safety_factor),
        "rounded_to": None if rounded_to is None else float(rounded_to),
        "load": found.response if found.form == "load_line" else "I",
        "unit_load": found.unit if found.form == "load_line" else "A",
        "upper": upper.model_dump(),
        "lower": lower.model_dump(),
        "unit_feed": found.factors[0].unit if found.form == "load_line" else found.unit,
        "window": [float(wear) for wear in window],
        "unit_wear": found.factors[-1].unit,
        "probability": probability,
        "probability_of": words,
        "dwell": dwell,
        "law": found.response,
        "by": by,
        "engagement": None if engagement is None else _engagement(engagement),
        "notes": [*notes, *_beyond(found, limit, lower.value, upper.value)],
    })  # fmt: skip


def _engagement(given: Mapping[str, Any]) -> dict[str, Any]:
    """The engagement as it was given, its names and values checked."""
    for name in given:
        if name not in Engagement.model_fields:
            raise UsageError(
                f"engagement {name}: there is no such setting. {did_you_mean(name, Engagement.model_fields)}"
            )
    try:
        Engagement.model_validate(dict(given))
    except ValidationError as error:
        raise UsageError(f"engagement: {schema_message(error, dict(given))}.") from None
    return dict(given)


def load_law_of(pf: ParameterFile, name: str | None) -> "LawSection":
    """The load law of a file, by its response where there are several.

    Raises
    ------
    UsageError
        There is no law of this name, or there are several.
    ParameterError
        The file has no load law.
    """
    if name is not None and name not in pf.laws:
        raise UsageError(f"--law {name}: the file holds laws of {', '.join(pf.laws) or 'nothing'}.")
    found = [law for key, law in pf.laws.items() if law.form in LOAD_FORMS and name in (None, key)]
    if not found:
        raise ParameterError(
            "the file has no load law (load on feed and wear): fit runs that have the columns fm, VB and I, the "
            "spindle current in A; of another load, such as the power P, ask for it: --law 'P ~ fm, VB' --form "
            "P=load-line."
        )
    if len(found) > 1:
        raise UsageError(f"there are load laws of {', '.join(law.response for law in found)}; choose one with --law.")
    return found[0]


def _check(
    worn: float, factor: float, step: float | None, window: tuple[float, float], limit: float, level: float
) -> None:
    for name, value in (("worn", worn), ("rounded_to", step), ("wear_limit", limit)):
        if value is not None and not is_positive(value):
            raise UsageError(f"{name} {value!r}: it must be above zero.")
    if not 0 < factor < 1:
        raise UsageError(f"safety_factor {factor!r}: it must be between 0 and 1, in the paper 0.85 (1/1.17).")
    check_share("level", level)
    low, high = window
    if not 0 <= low < high < math.inf:
        raise UsageError(f"window {low:g} to {high:g}: two wears, the smaller first, in the law's unit of wear.")
    if not low <= limit <= high:
        raise UsageError(f"wear_limit {limit:g} lies outside the window {low:g} to {high:g}.")


def _usual_window(law: "LawSection") -> tuple[float, float]:
    """The paper's window in the unit of the law's wear: 180 to 220 where that is um."""
    low, high = (float(f"{end:.12g}") for end in convert(np.array(WINDOW), "mm", law.factors[-1].unit))
    return low, high


def _check_held(law: "LawSection", reference: float) -> list[str]:
    """Notes on the load of a feed_line, which holds at one load only; the notes of the fit give that load."""
    if law.form != "feed_line":
        return []
    found = [m for note in law.notes if (m := HELD_LOAD.search(note))]
    if not found:
        return [f"The limits hold at the load of the tests of {law.response}, which the file does not state."]
    held = float(found[0][1])
    if abs(held - reference) > HELD * held:
        raise ParameterError(
            f"the law of {law.response} was measured at {held:g} {found[0][2]} and does not apply to {reference:g}: "
            "fit runs at several loads, or choose the safety factor that gives the load of the tests."
        )
    return [f"The limits come from feeds at {held:g} {found[0][2]}, and hold only there."]


def _check_order(law: "LawSection", worn: float, reference: float, lower: FeedLimit, upper: FeedLimit) -> None:
    if not 0 < lower.value < upper.value:
        feed = law.factors[0].unit if law.form == "load_line" else law.unit
        load = f" {law.unit}" if law.form == "load_line" else ""
        raise ParameterError(
            f"the feed limits come out as {lower.value:.4g} and {upper.value:.4g} {feed} at load {reference:g}{load}: "
            f"the lower must lie above zero and below the upper. {cause_of_refusal(law, worn, reference, lower)}"
        )
    if far := feeds_far_beyond_tests(law, lower.value, upper.value):
        raise ParameterError(f"{far}. {cause_of_refusal(law, worn, reference, lower)}")


def _beyond(law: "LawSection", limit: float, lower: float, upper: float) -> list[str]:
    wear, feed, notes = law.factors[-1], law.factors[0], []
    if limit > wear.high:
        notes.append(
            f"No tool was tested at a wear above {wear.high:g} {wear.unit}: the lower limit at {limit:g} {wear.unit} "
            "is extrapolated. Test tools worn further, or give a smaller --window."
        )
    outside = [f"{end:.4g}" for end in (lower, upper) if not feed.low <= end <= feed.high]
    if law.form == "load_line" and outside:
        verb = "limits {} and {} are" if len(outside) == 2 else "limit {} is"
        notes.append(
            f"Feeds were tested from {feed.low:g} to {feed.high:g} {feed.unit}: the {verb.format(*outside)} "
            "extrapolated."
        )
    return notes


def feed_limit(law: LawSection, load: float, wear: float, *, by: str | None = None, level: float = 0.95) -> FeedLimit:
    """The feed at which a tool of this wear draws the load.

    Parameters
    ----------
    law : LawSection
        Of the form ``load_line`` or ``feed_line``.
    load, wear : float
        In the units of the law; a feed_line has its load by itself.
    by : str, optional
        Level of the law.
    level : float
        Of the interval.
    """
    value = _feed(law, load, wear, by)
    return FeedLimit(value=value, wear=wear, interval=_interval(law, load, wear, by, level))


def wear_in_window(
    law: LawSection, load: float, feed: float, window: tuple[float, float], *, by: str | None = None
) -> tuple[float | None, str]:
    """Probability that the wear of a further tool lies in a window when it draws the load at this feed.

    The wear is below w where a tool of wear w would draw at least the load at this feed (hold at most this feed): a t
    of the law's prediction at w. Levels of tools and readings count as the law's scatter.

    Returns
    -------
    probability : float or None
    words : str
        Its basis, or why there is none.
    """
    if not isinstance(law.uncertainty, Covariance) or law.residual_se is None:
        return None, _reason(law)
    below = [worn_below(law, load, feed, wear, by) for wear in window]
    scatter = f"residual {law.residual_se:.3g} {law.unit}, {law.uncertainty.df} degrees of freedom"
    return float(np.clip(below[1] - below[0], 0.0, 1.0)), f"t of the law's prediction of one further tool ({scatter})"


def worn_below(law: LawSection, load: float, feed: float, wear: float, by: str | None) -> float:
    """Probability that a further tool is worn no more than this at this load and feed."""
    from scipy.special import stdtr, stdtrit

    at = _at(law, feed, wear)
    found = interval_band(law, IntervalOptions("prediction", 0.5), by, at)
    half = float(found.high - found.low) / 2
    df = float(law.uncertainty.df) if isinstance(law.uncertainty, Covariance) else 1.0
    sd = half / float(stdtrit(df, 0.75))
    off = float(found.value) - load if law.form == "load_line" else feed - float(found.value)
    return float(stdtr(df, off / sd)) if sd > 0 else float(off >= 0)


def _at(law: LawSection, feed: float, wear: float) -> dict[str, float]:
    symbols = [factor.symbol for factor in law.factors]
    return dict(zip(symbols, (feed, wear) if law.form == "load_line" else (wear,), strict=True))


def _feed(law: LawSection, load: float, wear: float, by: str | None) -> float:
    if law.form == "feed_line":
        return float(law.values(_at(law, 0.0, wear), by=by))
    B = law.coefficients["B"]
    if B <= 0:
        raise ParameterError(
            f"the law of {law.response} has B {B:g}: the load must increase with feed for a feed limit."
        )
    value = (load - float(law.values(_at(law, 0.0, wear), by=by))) / B
    if not np.isfinite(value):
        raise ParameterError(f"the feed at {load:g} {law.unit} is not finite: B {B:g} is too small to divide by.")
    return value


def _interval(law: LawSection, load: float, wear: float, by: str | None, level: float) -> LimitInterval | NoInterval:
    held = law.uncertainty
    if not isinstance(held, Covariance):
        return NoInterval(reason=_reason(law))
    if law.form == "feed_line":
        found = interval_band(law, IntervalOptions("mean", level), by, _at(law, 0.0, wear))
        return LimitInterval(low=float(found.low), high=float(found.high), level=level, method="t of the line's mean")
    ends = _fieller(law, held, load, wear, by, level)
    if ends is None:
        return NoInterval(
            reason=f"B does not differ from zero at {level:.0%}, so no feed is excluded; vary the feed more"
        )
    return LimitInterval(low=ends[0], high=ends[1], level=level, method="Fieller")


def _fieller(
    law: LawSection, held: Covariance, load: float, wear: float, by: str | None, level: float
) -> tuple[float, float] | None:
    """Feeds f with (load - m(f))^2 <= t^2 var m(f); both sides are quadratic in f. None where they have no end."""
    from scipy.special import stdtrit

    names = law.parameter_names
    order = [held.of.index(name) for name in names]
    C, p = np.array(held.matrix)[np.ix_(order, order)], law.theta
    fixed = np.array([1.0, 0.0, wear, *(float(by is not None and name.endswith(f"[{by}]")) for name in names[3:])])
    moving = np.eye(len(names))[1]
    t2 = float(stdtrit(held.df, (1 + level) / 2)) ** 2
    off, B = load - float(fixed @ p), float(moving @ p)
    with np.errstate(all="ignore"):
        a = B * B - t2 * float(moving @ C @ moving)
        b = -off * B - t2 * float(fixed @ C @ moving)
        c = off * off - t2 * float(fixed @ C @ fixed)
        root = b * b - a * c
    if not (np.isfinite([a, b, c]).all() and a > 0 and root >= 0):
        return None
    ends = sorted(((-b - root**0.5) / a, (-b + root**0.5) / a))
    return (float(ends[0]), float(ends[1])) if np.isfinite(ends).all() else None


def _reason(law: LawSection) -> str:
    if isinstance(law.uncertainty, Covariance):
        return f"the law of {law.response} has no residual standard error"
    return f"no interval: {law.uncertainty.reason.removeprefix('no interval: ').rstrip('.')}"
