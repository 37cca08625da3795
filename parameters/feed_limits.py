"""Feed at a load and a wear from a load law, its interval, and how likely the wear is where the feed stands.

    load_line   I = A + B fm + k1 VB, so fm = (I - A)/B - (k1/B) VB    (CLM-2023 eq. 14, 15)
    feed_line   fm = fm0 + slope VB, at the one current it was held at

The first is a ratio of estimates: its interval is Fieller's, the feeds at which the load is not told from the
reference. It is the delta method's where B is known well, and has no end where B is not told from zero.
Sources: Tai, Tsai & Li 2023, doi 10.1109/ACCESS.2023.3330587; Fieller 1954, J. R. Stat. Soc. B 16, 175.
"""

import numpy as np
from numpy.typing import NDArray

from ..core.errors import ParameterError
from .evaluation import IntervalOptions, interval_band
from .sections.covariance import Covariance
from .sections.law import LawSection
from .sections.load_line import FeedLimit, LimitInterval, NoInterval

Array = NDArray[np.float64]


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
        What it stands on, or why there is none.
    """
    if not isinstance(law.uncertainty, Covariance) or law.residual_se is None:
        return None, _reason(law)
    below = [_below(law, load, feed, wear, by) for wear in window]
    scatter = f"residual {law.residual_se:.3g} {law.unit}, {law.uncertainty.df} degrees of freedom"
    return float(np.clip(below[1] - below[0], 0.0, 1.0)), f"t of the law's prediction of one further tool ({scatter})"


def _below(law: LawSection, load: float, feed: float, wear: float, by: str | None) -> float:
    """P(wear <= w) at this load and feed."""
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
        return float(law.predict(by, **_at(law, 0.0, wear)))
    B = law.coefficients["B"]
    if B <= 0:
        raise ParameterError(
            f"the law of {law.response} has B {B:g}: the load must rise with feed to tell a feed limit."
        )
    value = (load - float(law.predict(by, **_at(law, 0.0, wear)))) / B
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
        return NoInterval(reason=f"at {level:.0%} B is not told from zero, so no feed is ruled out; vary the feed more")
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
