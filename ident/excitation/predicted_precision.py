"""Predicted precision of an output-error fit to a planned excitation: the Cramer-Rao bound.

    cov theta = sigma^2 (J'J)^-1,   J = d yhat / d theta by sensitivity filters, at an assumed plant

The lower bound of unbiased estimates, attained by output error for white noise and long records. Source: Ljung 1999,
sections 7.4 and 13.3.
"""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ...core.arrays import Array, is_positive
from ...core.display import Plottable
from ...core.errors import IdentError
from ..estimators.filters import inverse_of_squares
from ..estimators.free_simulation import FreeRun, sensitivities
from ..estimators.input_checks import check_identifiable
from ..model import Model
from ..responses.confidence_bands import response_slope
from ..responses.spectra import checked_frequencies

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, slots=True, repr=False)
class PredictedErrors(Plottable):
    """Predicted standard errors of a fit to an excitation.

    Attributes
    ----------
    params : DataFrame
        One row per coefficient: assumed ``value``, ``se``.
    response : DataFrame, index ``frequency`` in Hz
        ``gain`` (unit_y per unit_u), ``gain_se`` in %, ``phase`` and ``phase_se`` in degrees.
    model : Model
        The assumed plant with the predicted covariance, for `response_band` and `step_band`.
    snr : float
        Signal-to-noise ratio of the output, dB.
    """

    params: "pd.DataFrame"
    response: "pd.DataFrame"
    model: Model
    snr: float


def predicted_errors(
    guess: Model, u: ArrayLike, noise_sd: float, *, frequency: ArrayLike | None = None, runs: int = 1
) -> PredictedErrors:
    """Predicted standard errors of coefficients, gain and phase for an excitation.

    Parameters
    ----------
    guess : Model
        Assumed plant, with the orders of the later fit.
    u : array_like, shape (N,)
        The excitation, at the sample time of the plant.
    noise_sd : float
        Standard deviation of the noise on the output, in its unit; white.
    frequency : array_like, optional
        Hz; by default 20 from one period in the record to half the sample rate.
    runs : int
        Number of repetitions, each from rest.

    Returns
    -------
    PredictedErrors

    Raises
    ------
    IdentError
        An unstable plant, a constant excitation, coefficients that are not identifiable, no noise.

    Examples
    --------
    >>> guess = Model(b=[0.0, 0.1], a=[1.0, -0.9], nk=1, sample_time=0.02)
    >>> u = np.sin(0.002 * np.arange(750.0) ** 2)
    >>> predicted_errors(guess, u, 0.01, frequency=[0.5]).response.gain_se.round(2).to_dict()
    {0.5: 0.3}
    """
    import pandas as pd

    values = np.asarray(u, dtype=np.float64)
    _check(guess, values, noise_sd, runs)
    run = FreeRun(values, np.zeros_like(values), (slice(0, len(values)),), guess.na, guess.nb, guess.nk)
    e, J = sensitivities(run, guess.theta)
    check_identifiable(J, {"nb": guess.nb, "nf": guess.na})
    cov = noise_sd**2 / runs * inverse_of_squares(J)
    model = replace(guess, structure="output_error", cov_params=cov, noise_variance=noise_sd**2)
    nyquist = 0.5 / guess.sample_time
    if frequency is None:
        frequency = np.geomspace(1 / (len(values) * guess.sample_time), nyquist, 20)
    f = checked_frequencies(frequency, nyquist)
    slope, g = response_slope(model, f), model.response(f)
    errors = [np.sqrt(((d @ cov) * d).sum(axis=1)) for d in (slope.real, slope.imag)]
    response = pd.DataFrame(
        {
            "gain": np.abs(g),
            "gain_se": 100 * errors[0],
            "phase": np.degrees(np.unwrap(np.angle(g))),
            "phase_se": np.degrees(errors[1]),
        },
        index=pd.Index(f, name="frequency"),
    )
    params = pd.DataFrame({"value": model.params, "se": model.bse})
    return PredictedErrors(params, response, model, float(20 * np.log10(np.std(e) / noise_sd)))


def _check(guess: Model, u: Array, noise_sd: float, runs: int) -> None:
    if u.ndim != 1 or not np.isfinite(u).all() or np.ptp(u) == 0:
        raise IdentError(f"an excitation of shape {u.shape}: one column of finite numbers that vary is needed.")
    if not is_positive(noise_sd):
        raise IdentError(
            f"noise_sd {noise_sd!r}: above zero, in the unit of the output. Estimate it from a record at rest."
        )
    if runs != int(runs) or runs < 1:
        raise IdentError(f"runs {runs!r}: a whole number, 1 or more.")
    if not guess.stable:
        raise IdentError(
            f"the assumed plant has a pole at radius {guess.radius:.4g}: errors are predicted for stable plants only."
        )
