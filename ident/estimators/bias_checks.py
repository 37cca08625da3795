"""Checks for sources of bias: swapped signals (Granger), sensor noise in ARX (Hausman).

Sensor noise: ARX filters the error by its own a, so noise on y biases it (Ljung 1999, section 7.3); output error is
unbiased. If ARX is correct it is also efficient, and the difference of both estimates has at most the variance of
output error (Hausman 1978, doi 10.2307/1913827). The standard errors of ARX are not used: sensor noise inflates them.
"""

import numpy as np

from ...core.arrays import Array, Ints
from ...core.errors import IdentError
from ...datasets.records.record import Record
from ..model import Model
from .regressors import Gram, Lags, gram

DEPTH = 6  # lags of each signal in the test of causality
FLOOR = 1e-6  # residual share below which a prediction is exact: sensors have fewer digits
RELEVANT = 0.05  # of |G|: gains are not tuned more finely
SIGNIFICANT = 3.0  # standard errors of a complex number; without bias exceeded at 1 frequency in 8000
KNOWN = 0.3  # of |G|: where the standard error of the reference is larger, it is no reference
FREQUENCIES = 60
NAMES = {"output_error": "output error", "sriv": "instrumental variables", "box_jenkins": "Box-Jenkins"}


def causality(rec: Record) -> str | None:
    """Note if input and output appear to be swapped, otherwise None.

    Granger's test in both directions (1969, doi 10.2307/1912791): the one-step variance of y from its own past against
    that from the past of both signals, and the reverse. A closed loop is significant in both directions.

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
    """`causality` from a Gram matrix with lags 0 to 1 or more of both signals."""
    lags = total.lags
    depth = min(DEPTH, lags.y, lags.last)
    y, u = np.arange(depth + 1), lags.y + 1 + np.arange(depth + 1)
    forward = _reduction(total, y, u)
    backward = _reduction(total, u, y)
    # without causality, rows times the log variance ratio is chi-squared with ``depth`` degrees of freedom
    if total.rows * backward < 10 * depth or backward < 2 * forward:
        return None
    return (
        f"input and output may be swapped: the past of {name_y} reduces the one-step variance of {name_u} by "
        f"{1 - np.exp(-backward):.0%}, the past of {name_u} that of {name_y} by {1 - np.exp(-forward):.0%}. Check the "
        "columns; a closed loop has the same effect."
    )


def _reduction(total: Gram, own: Ints, other: Ints) -> float:
    """Log ratio of the variances of own[0] predicted from its own lags and from the lags of both signals."""
    alone = _residual_share(total, [*own[1:]], own[0])
    both = _residual_share(total, [*own[1:], *other[1:]], own[0])
    return float(np.log(max(alone, FLOOR) / max(both, FLOOR)))


def _residual_share(total: Gram, columns: list[np.intp], target: np.intp) -> float:
    """Residual share of the sum of squares of one column given others; the ridge covers rounding of the products."""
    chosen = np.array([*columns, target])
    g = total.matrix[chosen[:, None], chosen]
    length = np.sqrt(np.maximum(np.diag(g), np.finfo(np.float64).tiny))
    g = g / np.outer(length, length)
    theta = np.linalg.solve(g[:-1, :-1] + 1e-11 * np.eye(len(g) - 1), g[:-1, -1])
    return float(1 - g[:-1, -1] @ theta)


def warn_of_bias(arx_model: Model, oe_model: Model, band: tuple[float, float]) -> str | None:
    """Note if ARX and output error differ significantly and by more than 5 % in ``band``, otherwise None.

    Parameters
    ----------
    arx_model, oe_model : Model
        Of one record, the second with covariance (``output_error`` or ``sriv``).
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
    ARX gives a gain of 0.8196 at 2 Hz, output error 0.3876 (+111 %
    """
    low, high = band
    nyquist = 0.5 / oe_model.sample_time
    if not 0 < low < high <= nyquist * (1 + 1e-9):
        raise IdentError(f"band {low:g} to {high:g} Hz: 0 < low < high <= {nyquist:g} Hz, half the sample rate.")
    f = np.geomspace(low, high, FREQUENCIES)
    reference, biased = oe_model.response(f), arx_model.response(f)
    distance = np.abs(biased - reference)
    error = response_error(oe_model, f)
    found = (
        (distance > RELEVANT * np.abs(reference))
        & (distance > SIGNIFICANT * error)
        & (error < KNOWN * np.abs(reference))
    )
    if not found.any():
        return None
    k = int(np.argmax(np.where(found, distance / np.abs(reference), 0.0)))
    return bias_text(complex(biased[k]), complex(reference[k]), float(error[k]), float(f[k]), band, oe_model)


def response_error(model: Model, frequency: Array) -> Array:
    """Standard error of the complex G at frequencies in Hz; 0 without a covariance."""
    if model.cov_params is None:
        return np.zeros_like(frequency)
    z = np.exp(-2j * np.pi * frequency * model.sample_time)[:, None]
    a = np.polyval(model.a[::-1], z)
    by_a = -model.response(frequency)[:, None] * z ** np.arange(1, model.na + 1) / a
    slope = np.hstack([by_a, z ** np.arange(model.nk, model.nk + model.nb) / a])
    variance = np.einsum("fi,ij,fj->f", slope, model.cov_params, slope.conj()).real
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)), dtype=np.float64)


def bias_text(
    biased: complex, reference: complex, error: float, at: float, band: tuple[float, float], model: Model
) -> str:
    """Sentence on the largest difference between ARX and the reference estimate."""
    unit = f" {model.unit_y}/{model.unit_u}" if model.unit_u and model.unit_y else ""
    name = NAMES.get(model.structure, model.structure)
    ratio = abs(biased) / abs(reference) - 1
    if abs(ratio) > RELEVANT:
        values = f"{abs(biased):.4g}{unit} at {at:.3g} Hz, {name} {abs(reference):.4g}"
        found = f"ARX gives a gain of {values} ({100 * ratio:+.0f} %"
    else:
        turn = np.degrees(np.angle(biased / reference))
        found = (
            f"ARX and {name} differ by {abs(turn):.0f} degrees of phase at {at:.3g} Hz ({100 * ratio:+.0f} % in gain"
        )
    return (
        f"{found}, standard error {100 * error / abs(reference):.2g} %) in the excited band {band[0]:.3g} to "
        f"{band[1]:.3g} Hz: sensor noise most likely biases ARX. Use the {name} model; gains tuned on ARX may fail."
    )
