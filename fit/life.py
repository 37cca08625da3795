"""Tool life from a wear law: the time at which the law reaches a wear criterion (Taylor).

From ``AW = c0 V^a f^b d^g t^k`` and a criterion W follows ``T = (W/c0)^(1/k) V^(-a/k) f^(-b/k) d^(-g/k)``,
Taylor's ``V T^n = C`` with ``n = k/a``. Source: ISO 3685:1993, annex on tool-life equations.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from ..core.arrays import Array
from ..core.display import Plottable
from ..core.errors import FitError
from .lawfit import LawFit
from .laws import LARGEST_LOG


@dataclass(frozen=True, slots=True, repr=False)
class ToolLife(Plottable):
    """Tool life T, in the unit of t, at a wear criterion.

    Attributes
    ----------
    criterion : float
        Wear at which the edge is worn out, in ``unit_of_wear``.
    coefficients, bse : Series
        Constant ``c0`` and exponents of T by factor, with standard errors by the delta method (None: none).
    taylor_n : float or None
        n of ``V T^n = C``; None where the wear law has no V.
    t_observed : float
        Longest time in the data: a life beyond it is an extrapolation.
    typical, typical_at : float, mapping
        Life at the middle (geometric mean of the range) of every factor, and that middle.
    """

    wear: str
    criterion: float
    unit_of_wear: str
    unit: str
    coefficients: "pd.Series[float]"
    bse: "pd.Series[float] | None"
    taylor_n: float | None
    t_observed: float
    typical: float
    typical_at: dict[str, float]

    def predict(self, **factors: float) -> float:
        """Life at one set of conditions, in ``unit``."""
        names = [str(name) for name in self.coefficients.index[1:]]
        missing = [name for name in names if name not in factors]
        if missing:
            raise FitError(f"tool life needs {', '.join(missing)}.")
        for name in names:
            if not factors[name] > 0:
                raise FitError(f"{name} {factors[name]:g}: a power law needs values above zero.")
        return _life(self.coefficients, factors)


def tool_life(law: LawFit, criterion: float = 0.3) -> ToolLife:
    """Solve a wear law for time at a criterion.

    Parameters
    ----------
    law : LawFit
        A power law of wear that holds ``t``.
    criterion : float
        In the unit of the wear; 0.3 mm is ISO 3685's average flank wear.

    Raises
    ------
    FitError
        The law has no t, or its wear does not grow with time.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    >>> life = fit.tool_life(fit.power_law(runs, "AW", ["V", "f", "d", "t"]))
    >>> bool(0.2 < life.taylor_n < 0.7)
    True
    """
    if law.form != "power" or "t" not in law.factors:
        raise FitError(f"tool life needs a power law of wear on time t; {law.response} is fitted without t.")
    if not (criterion > 0 and np.isfinite(criterion)):
        raise FitError(f"wear criterion {criterion}: it needs a value above zero, for instance 0.3 mm.")
    if law.by is not None:
        raise FitError("tool life of a law with a category is not offered: fit each level alone.")
    k = float(law.params["t"])
    if k <= 0:
        raise FitError(f"{law.response} falls with time (t exponent {k:.3g}): it has no tool life.")
    at = law.names.index("t")
    others = [j for j in range(len(law.theta)) if j != at]
    eta = -law.theta[others] / k
    eta[0] += np.log(criterion) / k
    names = [law.names[j] for j in others]
    middle = {name: float(np.sqrt(low * high)) for name, (low, high) in law.domain.items() if name != "t"}
    values = eta.copy()
    if abs(eta[0]) > LARGEST_LOG:
        raise FitError(
            f"{law.response} hardly grows with time (t exponent {k:.3g}): it reaches {criterion:g} "
            f"{law.units[law.response]} in no finite time."
        )
    values[0] = np.exp(eta[0])
    coefficients = pd.Series(values, index=names)
    return ToolLife(
        wear=law.response,
        criterion=criterion,
        unit_of_wear=law.units[law.response],
        unit=law.units["t"],
        coefficients=coefficients,
        bse=_standard_errors(law, eta, values, others, at),
        taylor_n=k / float(law.params["V"]) if "V" in law.factors else None,
        t_observed=law.domain["t"][1],
        typical=_life(coefficients, middle),
        typical_at=middle,
    )


def _life(coefficients: "pd.Series[float]", factors: Mapping[str, float]) -> float:
    c0, *exponents = coefficients
    names = coefficients.index[1:]
    logs = [b * np.log(factors[str(x)]) for x, b in zip(names, exponents, strict=True)]
    with np.errstate(over="ignore"):  # in logarithms, since a single power may be too large for a number
        return float(np.exp(np.log(c0) + sum(logs)))


def _standard_errors(law: LawFit, eta: Array, values: Array, others: list[int], at: int) -> "pd.Series[float] | None":
    """Delta method: each parameter of ln T is a ratio -theta_j / k."""
    if law.cov_theta is None:
        return None
    k = law.theta[at]
    J = np.zeros((len(others), len(law.theta)))
    J[np.arange(len(others)), others] = -1.0 / k
    J[:, at] = -eta / k
    se = np.sqrt(np.einsum("ij,jk,ik->i", J, law.covariance(), J))
    se[0] *= values[0]
    return pd.Series(se, index=[law.names[j] for j in others])
