"""PI gains from a lag and a delay: Skogestad's SIMC rules, and the ways to a lag and a delay.

Source: Skogestad 2003, J. Process Control 13, 291, doi 10.1016/S0959-1524(02)00062-8.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...core.errors import IdentError
from ..model import Model
from .designs import Design

Array = NDArray[np.float64]


def simc(gain: float, lag: float, delay: float, closed_lag: float | None = None) -> Design:
    """SIMC: Kp = lag / (gain (closed_lag + delay)), Ti = min(lag, 4 (closed_lag + delay)).

    Parameters
    ----------
    gain : float
        Of gain exp(-delay s) / (lag s + 1); its slope (gain / lag) where ``lag`` is infinite: an integrating plant.
    lag, delay, closed_lag : float
        s; the closed loop is to have the lag ``closed_lag``, by default the delay, Skogestad's tight choice.

    Notes
    -----
    Source: Skogestad 2003, J. Process Control 13, 291, eq. 23-25, doi 10.1016/S0959-1524(02)00062-8.

    Examples
    --------
    >>> design = simc(1.0, lag=1.1, delay=0.1)
    >>> round(design.kp, 6), round(design.kp / design.ki, 6)
    (5.5, 0.8)
    """
    closed_lag = delay if closed_lag is None else closed_lag
    if gain == 0 or not (lag >= 0 and delay >= 0 and closed_lag >= 0 and closed_lag + delay > 0):
        raise IdentError(
            f"SIMC of gain {gain:g}, lag {lag:g} s, delay {delay:g} s, closed_lag {closed_lag:g} s: a gain that is not "
            "zero, times that are not negative, and closed_lag + delay above zero."
        )
    slow = closed_lag + delay
    if lag == 0:
        return Design(0.0, 1 / (gain * slow))
    kp = 1 / (gain * slow) if np.isinf(lag) else lag / (gain * slow)
    return Design(kp, kp / min(lag, 4 * slow))


def half_rule(
    lags: Sequence[float], delay: float = 0.0, inverse: Sequence[float] = (), sample_time: float = 0.0
) -> tuple[float, float]:
    """One lag and a delay for many: (lag, delay), s.

    The largest lag takes half of the second; the delay takes the other half, the smaller lags, the inverse responses
    (-T s + 1) and half a sample. Source: Skogestad 2003, eq. 10 and 11.

    >>> half_rule([1.0, 0.2])
    (1.1, 0.1)
    """
    slow = [*sorted(lags, reverse=True), 0.0, 0.0]
    return slow[0] + slow[1] / 2, delay + slow[1] / 2 + sum(slow[2:]) + sum(inverse) + sample_time / 2


def lag_and_delay(model: Model) -> tuple[float, float, float]:
    """Gain, lag and delay of a stable model from the times at which its step response stays above 28.3 and 63.2 %.

    The two-point method (Smith 1972, Digital Computer Process Control): lag = 1.5 (t63 - t28), delay = t63 - lag.
    """
    if not model.stable or model.dc_gain == 0:
        raise IdentError(
            f"largest pole at radius {model.radius:.4g}, gain at rest {model.dc_gain:g}: a lag and a delay are told "
            "only of a stable model with a gain. Use simc(slope, inf, delay) for an integrating plant, or tune_pi."
        )
    samples = int(min(20 / -np.log(max(model.radius, 0.1)) + 4 * len(model.b), 1e6)) + 2
    share = model.simulate(np.ones(samples)) / model.dc_gain
    t28, t63 = (model.sample_time * last_rise(share, float(-np.expm1(-part))) for part in (1 / 3, 1))
    lag = 1.5 * (t63 - t28)
    return model.dc_gain, lag, max(t63 - lag, 0.0)


def last_rise(y: Array, level: float) -> float:
    """Sample, between samples, after which y stays above a level."""
    below = np.flatnonzero(y < level)
    if not below.size or below[-1] + 1 >= len(y):
        return 0.0
    k = int(below[-1])
    return k + (level - float(y[k])) / float(y[k + 1] - y[k])
