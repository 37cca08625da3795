"""A law fitted again in another way, beside the plain fit: what its refits have in common."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from ..lawfit import LawFit
from .columns import Array


@dataclass(frozen=True, slots=True)
class Refit:
    """Other parameters of a law on the same rows.

    Attributes
    ----------
    law : LawFit
        The plain fit.
    theta, cov_theta : ndarray, shape (p,) and (p, p)
        Parameters, as ``law.theta``, and their covariance.
    """

    law: LawFit
    theta: Array
    cov_theta: Array

    @property
    def params(self) -> "pd.Series[float]":
        """Coefficients, as ``LawFit.params``."""
        return pd.Series(self.law.law.coefficients(self.theta), index=list(self.law.names), name=self.law.response)

    @property
    def bse(self) -> "pd.Series[float]":
        """Standard errors of ``theta``."""
        return pd.Series(np.sqrt(np.diag(self.cov_theta)), index=list(self.law.theta_names), name="bse")


def tangent(law: LawFit, Z: Array, theta: Array) -> tuple[Array, Array]:
    """Gradient (n, p) and residuals (n,) at theta, on the scale of the errors."""
    if law.error == "multiplicative":
        return Z, np.log(law.observed) - Z @ theta
    return law.law.gradient(theta, Z), law.observed - law.law.response_at(theta, Z)
