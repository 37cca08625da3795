"""The power law as a scikit-learn estimator, for pipelines, cross-validation and searches over their settings.

It fits what ``fit.power_law`` fits. Imported on first use: ``pip install 'fitmodels[sklearn]'``.
"""

from collections.abc import Sequence
from typing import Any, Self

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from sklearn.base import BaseEstimator, RegressorMixin  # type: ignore[import-untyped, import-not-found, unused-ignore]
from sklearn.utils.validation import (  # type: ignore[import-untyped, import-not-found, unused-ignore]
    check_is_fitted,
    validate_data,
)

from ..core.arrays import Array
from ..core.errors import FitmodelsError
from ..core.intervals import Edge, Kind
from ..datasets import Runs
from ..datasets.runs import Source
from .lawfit import LawFit
from .laws import Error
from .regression import power_law

NEEDS = "a power law needs values above zero"


class PowerLawRegressor(RegressorMixin, BaseEstimator):  # type: ignore[misc, unused-ignore]
    """``y = c0 prod X_j^b_j``, fitted as ``fit.power_law`` fits it.

    Parameters
    ----------
    error : {"multiplicative", "additive"}
        Scale of the residuals: the logarithm of y, or its own unit.
    floor : float, optional
        Resolution of the gauge, above zero: smaller readings, zero among them, are taken as ``floor``. Without it
        a zero is refused, as a power law has no logarithm of it. Negative readings are refused always.
    response : str
        What y is called in ``law_`` and in messages.

    Attributes
    ----------
    law_ : LawFit
        The fit, with its standard errors, tables and figures; factors are called as the columns of a
        DataFrame, or ``x0``, ``x1`` ...
    coef_ : ndarray, shape (n_features,)
        Exponents; 0 of a feature that the rows do not identify or that does not change.
    intercept_ : float
        ln c0.
    n_features_in_, feature_names_in_
        As scikit-learn has them.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> runs = datasets.read_runs(datasets.bundled("gc435_709m40")).to_frame()
    >>> model = fit.PowerLawRegressor().fit(runs[["V", "f", "d", "t"]], runs["AW"], edge=runs["edge"])
    >>> model.coef_.round(3).tolist()
    [0.533, 0.167, 0.316, 0.246]
    >>> model.law_.n_edges
    24
    """

    def __init__(self, error: Error = "multiplicative", floor: float | None = None, response: str = "y") -> None:
        self.error = error
        self.floor = floor
        self.response = response

    def fit(self, X: ArrayLike, y: ArrayLike, edge: ArrayLike | None = None) -> Self:
        """Fit.

        Parameters
        ----------
        X : array_like or DataFrame, shape (n, k)
            Factors, above zero.
        y : array_like, shape (n,)
            Response; above zero where errors multiply.
        edge : array_like, shape (n,), optional
            Cutting edge of each row: standard errors of ``law_`` are then by edge.

        Raises
        ------
        ValueError
            As scikit-learn has it, with the sentence of ``fit.power_law``.
        """
        X, y = validate_data(self, X, y, dtype=np.float64, y_numeric=True)
        X, y = self._above(np.asarray(X), "X"), np.asarray(y, dtype=np.float64)
        if self.error == "multiplicative":
            y = self._above(y, "y")
        names = self._names(X.shape[1])
        frame = pd.DataFrame(X, columns=list(names)).assign(**{self.response: y})
        if edge is not None:
            frame["edge"] = [str(name) for name in np.ravel(np.asarray(edge, dtype=object))]
        try:
            self.law_: LawFit = power_law(_runs(frame), self.response, names, error=self.error)
        except FitmodelsError as error:
            raise ValueError(f"{error} ({len(y)} samples)") from None
        self.coef_ = np.array([float(self.law_.params.get(name, 0.0)) for name in names])
        self.intercept_ = float(self.law_.theta[0])
        return self

    def predict(self, X: ArrayLike) -> Array:
        """The law at X, shape (n,): with errors that multiply it is the median of y."""
        table = self._table(X)
        return np.asarray(self.law_.values(table))

    def predict_interval(
        self, X: ArrayLike, kind: Kind = "prediction", level: float = 0.95, edge: Edge = "new"
    ) -> Array:
        """Low and high end at each row of X, shape (n, 2), as ``fit.interval`` gives them.

        Raises
        ------
        FitError
            There is no interval: as many parameters as rows.
        UsageError
            A kind, edge or level that does not exist.
        """
        table = self._table(X)
        band = self.law_.predict(table, kind, level=level, edge=edge)
        return np.column_stack([band.low, band.high])

    def _table(self, X: ArrayLike) -> pd.DataFrame:
        check_is_fitted(self)
        X = self._above(np.asarray(validate_data(self, X, reset=False, dtype=np.float64)), "X")
        return pd.DataFrame(X, columns=list(self._names(X.shape[1])))

    def _above(self, values: Array, what: str) -> Array:
        """Values above zero: small ones lifted to the floor, others refused."""
        if self.floor is not None and not self.floor > 0:
            raise ValueError(f"floor {self.floor!r}: the resolution of the gauge is above zero, for instance 0.001.")
        least = float(values.min())
        if least < 0:
            raise ValueError(f"Negative values in data: {what} holds {least:g}, and {NEEDS}. Leave such rows out.")
        if least == 0 and self.floor is None:
            raise ValueError(
                f"{what} holds 0, and {NEEDS}. Leave such rows out, or give floor, the resolution of the gauge."
            )
        return values if self.floor is None else np.maximum(values, self.floor)

    def _names(self, k: int) -> Sequence[str]:
        names = [str(name) for name in getattr(self, "feature_names_in_", [f"x{j}" for j in range(k)])]
        taken = {self.response, "edge"} & set(names)
        if taken:
            raise ValueError(f"a feature is called {taken.pop()!r}, as the response or the edge: rename it.")
        return names

    def __sklearn_tags__(self) -> Any:  # noqa: ANN401
        tags = super().__sklearn_tags__()
        tags.input_tags.positive_only = True
        tags.target_tags.positive_only = True  # errors that add are fitted from a start in logarithms
        tags.regressor_tags.poor_score = True  # the data of its checks are straight lines through zero
        return tags


def _runs(frame: pd.DataFrame) -> Runs:
    """Rows in memory, in whatever units they come."""
    units = {str(name): "" for name in frame if name != "edge"}
    lines = np.arange(len(frame))
    return Runs(frame, units, (), lines, Source("arrays", "", len(frame), "in memory"), "unnamed-tool", "unnamed-work")
