"""Whether noise in the sensor has bent an ARX model: ARX beside output error, inside the excited band.

ARX filters the error by its own a, so noise on y biases it (Ljung 1999, section 7.3); output error stays unbiased.
Where they differ by more than chance, the record says which one to use.

If ARX is right it is also the efficient one, and the difference has no more than the variance of output error alone
(Hausman 1978, doi 10.2307/1913827). ARX's own standard errors take no part: noise that bends it makes them too wide.
"""

import numpy as np
from numpy.typing import NDArray

from ...core.errors import IdentError
from ..model import Model

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
