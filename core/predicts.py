"""Bases of results that predict: one signature of ``predict`` and ``values`` in all classes."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike

from .calls import Conditions, Takes, conditions
from .intervals import Centre, Edge, Kind
from .predictions import Prediction

if TYPE_CHECKING:
    from pandas import DataFrame


class Predicts:
    """Base of laws and of what follows from them: `predict` and `values` with one signature."""

    __slots__ = ()

    def predict(
        self,
        new: "Mapping[str, object] | DataFrame | None" = None,
        kind: Kind = "prediction",
        *,
        level: float = 0.95,
        edge: Edge = "new",
        coverage: float = 0.95,
        centre: Centre = "median",
        by: str | None = None,
        **factors: ArrayLike,
    ) -> Prediction:
        """Value with its interval, and whether each point lies in the tested region, as numbers and as a sentence.

        Parameters
        ----------
        new : mapping or DataFrame, optional
            A value or a column for each factor, in the unit of the law; what the law does not use is ignored.
        kind : {"mean", "prediction", "tolerance"}
            Interval of the law itself, of one new row, or limits that contain a share ``coverage`` of all rows.
        level, coverage : float
            Of the interval, and the share that a tolerance interval contains; between 0 and 1.
        edge : {"new", "same"}
            Rows of an edge not yet cut, or further rows of an edge of the fit, named by a column ``edge`` of ``new``.
        centre : {"median", "mean", "smeared"}
            What the value is where errors multiply.
        by : str, optional
            Level of the category of the law, where it has one; or a column of ``new`` under the name of the category.
        **factors
            Factors by name, in place of ``new`` or in addition to it.

        Returns
        -------
        Prediction
            ``value``, ``low``, ``high``, ``inside``: a number where each factor is one number, arrays otherwise;
            ``words``; ``to_frame()``.

        Raises
        ------
        UsageError, FitError, ParameterError
            An option that does not exist, a factor that is missing or no number, or there is no interval.

        Examples
        --------
        >>> from fitmodels import datasets, fit
        >>> law = fit.power_law(datasets.bundled("gc435_709m40"), "AW", ["V", "f", "d", "t"])
        >>> found = law.predict(V=100, f=0.2, d=2, t=8)
        >>> print(f"{found.value:.3f} {found.unit}, {found.low:.3f} to {found.high:.3f}, inside: {found.inside}")
        0.160 mm, 0.129 to 0.197, inside: True
        >>> law.predict({"V": [100, 140], "f": 0.2, "d": 2, "t": 8}, "mean", level=0.9).value.round(3).tolist()
        [0.16, 0.191]
        """
        given = conditions(self._takes, new, by, factors)
        return self._predicted(given, kind=kind, level=level, edge=edge, coverage=coverage, centre=centre)

    def values(
        self, new: "Mapping[str, object] | DataFrame | None" = None, *, by: str | None = None, **factors: ArrayLike
    ) -> Any:  # noqa: ANN401
        """The equation alone at new points: a number where each factor is one number, otherwise an array.

        Of errors that multiply it is the median of the response, otherwise the mean. Arguments as of `predict`.

        Examples
        --------
        >>> from fitmodels import datasets, fit
        >>> law = fit.power_law(datasets.bundled("gc435_709m40"), "AW", ["V", "f", "d", "t"])
        >>> round(law.values(V=100, f=0.2, d=2, t=8), 3)
        0.16
        """
        return self._values(conditions(self._takes, new, by, factors))

    @property
    def _takes(self) -> Takes:
        raise NotImplementedError

    def _predicted(self, given: Conditions, *, kind: Kind, level: float, **other: Any) -> Prediction:  # noqa: ANN401
        raise NotImplementedError

    def _values(self, given: Conditions) -> Any:  # noqa: ANN401
        raise NotImplementedError


class PredictsByLaw(Predicts):
    """Base of results with a ``law`` that predicts for them."""

    __slots__ = ()

    @property
    def _takes(self) -> Takes:
        return self._of_law._takes

    def _predicted(self, given: Conditions, *, kind: Kind, level: float, **other: Any) -> Prediction:  # noqa: ANN401
        return self._of_law._predicted(given, kind=kind, level=level, **other)

    def _values(self, given: Conditions) -> Any:  # noqa: ANN401
        return self._of_law._values(given)

    @property
    def _of_law(self) -> Predicts:
        law: Predicts = self.law  # type: ignore[attr-defined]
        return law
