"""Which way a record runs: whether the past of u tells of y, or the past of y of u.

Whether the input answers to the output: data of a closed loop, which bend output error and measured responses.

Whether noise in the sensor has bent an ARX model: ARX beside output error, inside the excited band.

ARX filters the error by its own a, so noise on y biases it (Ljung 1999, section 7.3); output error stays unbiased.
Where they differ by more than chance, the record says which one to use.

If ARX is right it is also the efficient one, and the difference has no more than the variance of output error alone
(Hausman 1978, doi 10.2307/1913827). ARX's own standard errors take no part: noise that bends it makes them too wide.
"""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...core.errors import IdentError
from ...datasets.records.record import Record
from ..model import Model
from .regressors import Gram, Lags, gram, r_of, triangle

if TYPE_CHECKING:
    from ...datasets import Record

# Lags of each signal, and a share of a signal below which nothing is left to tell: six digits are more than a sensor's.
DEPTH = 6
FLOOR = 1e-6


def causality(rec: Record) -> str | None:
    """A note where input and output seem swapped; None where they do not.

    The variance of y one step ahead from its own past is compared with that from the past of both, and the same the
    other way about (Granger 1969, doi 10.2307/1912791). A loop closed through the machine tells both ways.

    Examples
    --------
    >>> u = np.random.default_rng(1).standard_normal(500)
    >>> y = 0.5 * np.concatenate([[0.0], u[:-1]])
    >>> causality(Record(u=u, y=y, sample_time=0.02)) is None
    True
    >>> str(causality(Record(u=y, y=u, sample_time=0.02)))[:32]
    'input and output may be swapped:'
    """
    depth = min(DEPTH, min(s.stop - s.start for s in rec.stretches) // 4)
    return causality_of(gram(rec, Lags(depth, 0, depth)), rec.input, rec.output) if depth else None


def causality_of(total: Gram, name_u: str, name_y: str) -> str | None:
    """The same from products that hold lags 0 to 1 or more of both."""
    lags = total.lags
    depth = min(DEPTH, lags.y, lags.last)
    y, u = np.arange(depth + 1), lags.y + 1 + np.arange(depth + 1)
    forward = _told(total, y, u)
    backward = _told(total, u, y)
    # twice the logarithm of a likelihood ratio is chi-squared with ``depth`` degrees of freedom where nothing is told
    if total.rows * backward < 10 * depth or backward < 2 * forward:
        return None
    return (
        f"input and output may be swapped: the past of {name_y} takes {1 - np.exp(-backward):.0%} off the one-step "
        f"variance of {name_u}, the past of {name_u} {1 - np.exp(-forward):.0%} off that of {name_y}. Look at the "
        "columns; a loop closed through the machine shows so too."
    )


def _told(total: Gram, own: NDArray[np.intp], other: NDArray[np.intp]) -> float:
    """Logarithm of the variance of own[0] from its own lags over that from lags of both."""
    alone = _left(total, [*own[1:]], own[0])
    both = _left(total, [*own[1:], *other[1:]], own[0])
    return float(np.log(max(alone, FLOOR) / max(both, FLOOR)))


def _left(total: Gram, columns: list[np.intp], target: np.intp) -> float:
    """Share of the sum of squares of one column that others leave; the ridge stands for rounding in the products."""
    chosen = np.array([*columns, target])
    g = total.matrix[chosen[:, None], chosen]
    length = np.sqrt(np.maximum(np.diag(g), np.finfo(np.float64).tiny))
    g = g / np.outer(length, length)
    theta = np.linalg.solve(g[:-1, :-1] + 1e-11 * np.eye(len(g) - 1), g[:-1, -1])
    return float(1 - g[:-1, -1] @ theta)


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


Array = NDArray[np.float64]
MATTERS = 0.05  # of |G|: gains are not tuned finer than this
BEYOND_CHANCE = 3.0  # standard errors of a complex number; under no bias exceeded at 1 frequency in 8000
FREQUENCIES = 60


def warn_of_bias(arx_model: Model, oe_model: Model, band: tuple[float, float]) -> str | None:
    """A sentence where ARX and output error differ in ``band`` by more than 5 % and more than chance, else None.

    Parameters
    ----------
    arx_model, oe_model : Model
        Of one record, the second with covariance; ``sriv`` serves as well as ``output_error``.
    band : tuple of float
        Excited band, Hz.

    Returns
    -------
    str or None

    Examples
    --------
    >>> cov = np.eye(2) * 1e-8
    >>> fast = Model(b=[0, 0.3], a=[1, -0.7], nk=1, sample_time=0.02, structure="arx", cov_params=cov)
    >>> true = Model(b=[0, 0.1], a=[1, -0.9], nk=1, sample_time=0.02, structure="output_error", cov_params=cov)
    >>> print(warn_of_bias(fast, true, (0.1, 2.0)).split(", standard")[0])
    ARX gives 0.8196 at 2 Hz where output error gives 0.3876 (+111 %
    """
    low, high = band
    nyquist = 0.5 / oe_model.sample_time
    if not 0 < low < high <= nyquist * (1 + 1e-9):
        raise IdentError(f"band {low:g} to {high:g} Hz: 0 < low < high <= {nyquist:g} Hz, half the sample rate.")
    f = np.geomspace(low, high, FREQUENCIES)
    there, here = oe_model.response(f), arx_model.response(f)
    distance = np.abs(here - there)
    error = response_error(oe_model, f)
    bent = (distance > MATTERS * np.abs(there)) & (distance > BEYOND_CHANCE * error)
    if not bent.any():
        return None
    k = int(np.argmax(np.where(bent, distance / np.abs(there), 0.0)))
    return sentence(complex(here[k]), complex(there[k]), float(error[k]), float(f[k]), band, oe_model)


def response_error(model: Model, frequency: Array) -> Array:
    """Standard error of G at frequencies in Hz, the length of its complex error; 0 without a covariance."""
    if model.cov_params is None:
        return np.zeros_like(frequency)
    z = np.exp(-2j * np.pi * frequency * model.sample_time)[:, None]
    a = np.polyval(model.a[::-1], z)
    by_a = -model.response(frequency)[:, None] * z ** np.arange(1, model.na + 1) / a
    slope = np.hstack([by_a, z ** np.arange(model.nk, model.nk + model.nb) / a])
    variance = np.einsum("fi,ij,fj->f", slope, model.cov_params, slope.conj()).real
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)), dtype=np.float64)


def sentence(here: complex, there: complex, error: float, at: float, band: tuple[float, float], model: Model) -> str:
    """What an engineer is told of the largest difference."""
    unit = f" {model.unit_y}/{model.unit_u}" if model.unit_u and model.unit_y else ""
    name = "output error" if model.structure == "output_error" else "the instrumental variable"
    ratio = abs(here) / abs(there) - 1
    if abs(ratio) > MATTERS:
        found = (
            f"ARX gives {abs(here):.4g}{unit} at {at:.3g} Hz where {name} gives {abs(there):.4g} ({100 * ratio:+.0f} %"
        )
    else:
        turn = np.degrees(np.angle(here / there))
        found = (
            f"ARX and {name} differ by {abs(turn):.0f} degrees of phase at {at:.3g} Hz ({100 * ratio:+.0f} % in gain"
        )
    use = name.removeprefix("the ").replace(" ", "-")
    where = f"inside the excited band of {band[0]:g}-{band[1]:g} Hz"
    return (
        f"{found}, standard error {100 * error / abs(there):.2g} %), {where}: noise in the sensor has most likely bent "
        f"ARX. Use the {use} model; gains tuned on ARX may not hold."
    )
