"""The covariance of a model carried to its poles: natural frequency and damping with their errors."""

from typing import TYPE_CHECKING

import numpy as np

from ..model import Model
from .bands import covariance_of

if TYPE_CHECKING:
    import pandas as pd


def pole_band(model: Model, level: float = 0.95) -> "pd.DataFrame":
    """Poles with standard errors: ``radius`` and ``angle`` (z-plane), ``hertz`` and ``damping`` of the continuous pole.

    Notes
    -----
    d p / d a_i = -p^(na - i) / prod_{q != p} (p - q). Poles that (nearly) coincide have no first derivative: their
    errors come out huge, and mean that the two cannot be told apart.

    Examples
    --------
    >>> model = Model(b=[0.0, 0.5], a=[1.0, -0.5], nk=1, sample_time=0.1, cov_params=np.diag([1e-4, 1e-4]))
    >>> pole_band(model)[["radius", "radius_error"]].round(3).to_dict("records")
    [{'radius': 0.5, 'radius_error': 0.01}]
    """
    import pandas as pd

    cov = covariance_of(model, level)[: model.na, : model.na]
    poles = np.roots(model.a).astype(np.complex128)
    rows = []
    for k, p in enumerate(poles[: np.count_nonzero(poles)]):
        apart = np.prod(p - np.delete(poles, k))
        slope = -(p ** (model.na - np.arange(1, model.na + 1))) / (apart or np.finfo(float).tiny)
        log, s = slope / p, np.log(p) / model.sample_time
        by_s = log / model.sample_time
        damping = -(by_s / abs(s)).real + s.real * (s.conj() * by_s).real / abs(s) ** 3
        hertz = (s.conj() * by_s).real / (2 * np.pi * abs(s))
        errors = [float(np.sqrt(d @ cov @ d)) for d in (abs(p) * log.real, log.imag, hertz, damping)]
        values = [abs(p), float(np.angle(p)), abs(s) / (2 * np.pi), -s.real / abs(s)]
        rows.append([x for pair in zip(values, errors, strict=True) for x in pair])
    names = [n for name in ("radius", "angle", "hertz", "damping") for n in (name, f"{name}_error")]
    return pd.DataFrame(rows, columns=names)
