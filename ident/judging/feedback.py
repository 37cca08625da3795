"""Whether the input answers to the output: data of a closed loop, which bend output error and measured responses."""

from typing import TYPE_CHECKING

import numpy as np

from ..estimators.gram import Lags
from ..estimators.regressors import r_of, triangle

if TYPE_CHECKING:
    from ...datasets import Record

PAST = 20  # lags of u and y that carry what the machine does and the colour of its noise
AHEAD = 5  # samples within which a controller answers
RARE = 1e-3  # chance of a false alarm
MATTERS = 0.2  # of the residual variance: a servo's quantised, bent answer to its demand reaches half of that


def feedback_detected(rec: "Record", nk: int = 0) -> str | None:
    """A sentence where the input answers to the noise in the output, else None.

    y is regressed on 20 past y and 20 past u, then on 5 coming u beside them. Where nobody computes u from y, the
    coming u tell nothing more of y; a controller lets the noise of y show in them.

    Parameters
    ----------
    rec : Record
    nk : {0, 1}
        Least delay that the machine can have. With 0, u of the same sample counts as past, and a controller without
        delay stays hidden: it looks like a machine that answers within the sample. With 1 it counts as coming.

    Returns
    -------
    str or None

    Notes
    -----
    An F test at 0.1 %, and a fall of the residual variance by 20 % or more. A loop without noise, and one whose noise
    is lost under the excitation, cannot be told; nor do they bend the model. Source: Sims 1972 with lagged y as in
    Geweke, Meese & Dent 1983, doi 10.1016/0304-4076(83)90028-7.

    Examples
    --------
    >>> from fitmodels.datasets import Record
    >>> rng = np.random.default_rng(1)
    >>> e, r, y, u = rng.standard_normal(500), rng.standard_normal(500), np.zeros(500), np.zeros(500)
    >>> for t in range(1, 500):
    ...     y[t] = 0.8 * y[t - 1] + 0.5 * u[t - 1] + 0.3 * e[t]
    ...     u[t] = 0.3 * r[t] - y[t - 1]
    >>> print(str(feedback_detected(Record(u=u, y=y, sample_time=0.02))).split(":")[0])
    the input answers to the output
    >>> feedback_detected(Record(u=r, y=np.convolve(r, [0, 0.5, 0.4])[:500] + e, sample_time=0.02)) is None
    True
    """
    from scipy.stats import f as f_distribution

    longest = max(s.stop - s.start for s in rec.stretches)
    past = min(PAST, (longest - AHEAD) // 8)
    if past < 1:
        return None
    lags = Lags(past, 0, past + AHEAD)
    found = triangle(_advanced(rec.centred(), AHEAD), lags)
    y = np.arange(1, past + 1)
    first = AHEAD + (nk > 0)
    behind, coming = past + 1 + np.arange(first, AHEAD + past + 1), past + 1 + np.arange(first)
    r = r_of(found.matrix[:, [*y, *behind, *coming, 0]])
    left = float(r[-1, -1] ** 2)
    fell = float((r[-1 - first : -1, -1] ** 2).sum())
    free = found.rows - len(r) + 1
    if free < 1 or left + fell <= 1e-20 * float(rec.y @ rec.y):
        return None
    statistic = fell / first / max(left / free, np.finfo(float).tiny)
    p, share = float(f_distribution.sf(statistic, first, free)), fell / (fell + left)
    if p > RARE or share < MATTERS:
        return None
    return (
        f"the input answers to the output: the coming samples of {rec.input} take {share:.0%} off what is left of "
        f"{rec.output} (p {p:.1g}), so u was computed from y, by a controller. Output error and measured responses are "
        "bent then; identify with armax or arx of high order, or open the loop."
    )


def _advanced(rec: "Record", by: int) -> "Record":
    """Y beside u of ``by`` samples later; the last samples of each stretch, which have no coming u, are left out."""
    from dataclasses import replace

    kept = [s for s in rec.stretches if s.stop - s.start > by]
    u = np.concatenate([rec.u[s.start + by : s.stop] for s in kept])
    y = np.concatenate([rec.y[s.start : s.stop - by] for s in kept])
    starts = np.cumsum([0, *(s.stop - s.start - by for s in kept)])[:-1]
    return replace(rec, u=u, y=y, starts=tuple(int(s) for s in starts), offsets=None, sha256=None)
