"""The law section: one fitted equation with its domain, its uncertainty and its statistics, and its predictions."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from ...core.calls import Conditions, Takes
from ...core.display import Plottable
from ...core.errors import ParameterError
from ...core.intervals import Centre, Edge, Kind
from ...core.predictions import Prediction
from ...core.predicts import Predicts
from ...datasets.derived import OF_CUT, computed_by
from ..evaluation import IntervalOptions, as_given, interval_band, point_values, region_contains
from ..prediction import predict_with_interval
from .law_fields import LawFields

if TYPE_CHECKING:
    from ..budget import UncertaintyBudget

EXAMPLE: Mapping[str, object] = {  # the law of the examples below
    "form": "power",
    "response": "AW",
    "quantity": "flank wear",
    "unit": "mm",
    "equation": "AW = 0.01 V^0.5",
    "error": "multiplicative",
    "coefficients": {"c0": 0.01, "V": 0.5},
    "factors": [{"symbol": "V", "quantity": "cutting speed", "unit": "m/min", "low": 50.0, "high": 200.0}],
    "uncertainty": {
        "kind": "covariance",
        "of": ["ln c0", "V"],
        "matrix": [[0.9, -0.19], [-0.19, 0.0405]],
        "df": 6,
    },
    "residual_se": 0.1,
    "residual_scale": "ln",
    "n": 8,
    "df": 6,
}


class LawSection(Predicts, Plottable, LawFields):
    """One fitted equation, which predicts from the file alone.

    Attributes
    ----------
    form, error : str
        ``power``, ``exponential``, ``load_line`` or ``feed_line``; ``multiplicative`` or ``additive``.
    response, quantity, unit, equation : str
        Symbol, words, unit, and the equation with its numbers at six digits, for people.
    coefficients : dict of float
        c0 and each factor's exponent; or a, b; or A, B, k1; or fm0, slope: for the units of
        ``response`` and ``factors`` and the reference level of ``by``.
    factors : tuple of Factor
        Symbol, unit and domain of each.
    by : By or None
        Levels that share the exponents, and the shift of each from the reference.
    life : LifeSection or None
        Of a law of tool lives: their distribution and how many of them ended.
    uncertainty : Covariance or NoCovariance
        Covariance of ``ln c0`` (``ln a``), the exponents and the shifts; of A, B, k1 as they are.
    residual_se : float or None
        Standard deviation about the law, in ``residual_scale``: ``ln`` or the response's unit.
    smearing : float or None
        Mean of exp(residual) where errors are multiplicative: over edges with equal weights, or over independent rows.
    n, df : int
        Observations and residual degrees of freedom, rows taken as independent.
    n_edges : int or None
        Cutting edges among the observations, where the data name them.
    statistics, standard_errors, left_out, dropped_rows, notes
        Of the fit; standard errors are those of ``coefficients`` and shifts.
    alternative : Law or None
        The same law fitted with the other error structure.
    region : Region or None
        The tested region: the operating window.
    edges : Edges or None
        Variance components between and within cutting edges, and F by edge.
    verdict : VerdictSection or None
        How far the law can be used; None where it was not judged, as in files of versions 1 and 2.
    checks : dict of LawCheck
        By the keys of ``fit.checks.check.TITLES``.
    verdicts : tuple of str
        Verdicts of the checks, worst first, at most six sentences.
    checked_rows : int or None
        Rows that were checked: a uniform sample of very many.
    row_standard_errors : dict of float
        Standard errors with rows taken as independent, as the papers print them, where others are by edge.
    published : Published or None
        Published values for the same response, tool and work.
    composite : Composite or None
        The law with its wear replaced by the wear law.
    without : LawWithoutSuspects or None
        The law without the rows and edges that its checks find wrong; None where they find none.
    sums : LawSums or None
        Its rows as sums by edge, to be fitted again with further edges; None in files before version 9.

    Examples
    --------
    >>> law = LawSection.model_validate(EXAMPLE)
    >>> print(law.predict(V=100.0).words)
    AW 0.100 mm at V 100 m/min; 95 % prediction interval for one row 0.071 to 0.140 mm; inside the tested region.
    """

    alternative: "LawSection | None" = None

    @property
    def computed(self) -> str:
        """Equation by which the response was computed from a measured one; empty where it was measured."""
        return computed_by(self.response, self.notes)

    @property
    def of_cut(self) -> str:
        """That a power is that of the cut, as it was computed; empty of a measured power and of other responses.

        Examples
        --------
        >>> note = "P is computed, not measured: P = Fc V/60000; its law is that of Fc with this equation"
        >>> LawSection.model_validate(EXAMPLE | {"response": "P", "notes": [note]}).of_cut
        'P is the power of the cut, without the losses of the drive, computed by P = Fc V/60000'
        """
        by = self.computed if self.response == "P" else ""
        return by and f"{self.response} is {OF_CUT}, computed by {by}"

    @property
    def _takes(self) -> Takes:
        units = {factor.symbol: factor.unit for factor in self.factors}
        return Takes(f"the law of {self.response}", units, self.by.column if self.by else None, ParameterError)

    def _predicted(self, given: Conditions, *, kind: Kind, level: float, **other: Any) -> Prediction:  # noqa: ANN401
        by, factors = self._level(given)
        return predict_with_interval(self, IntervalOptions(kind, level, **other), by, factors)

    def _values(self, given: Conditions) -> Any:  # noqa: ANN401
        by, factors = self._level(given)
        return point_values(self, by, factors)

    def _level(self, given: Conditions) -> tuple[str | None, Conditions]:
        """The level of the category, and the factors; of an edge a file knows nothing."""
        factors = {name: value for name, value in given.items() if name in self._takes.units}
        levels = {str(one) for one in np.ravel(given[self.by.column])} if self.by and self.by.column in given else set()
        if len(levels) > 1:
            raise ParameterError(f"the law of {self.response}: one level of {self._takes.category} at a time.")
        return next(iter(levels), None), factors

    def interval(
        self,
        level: float = 0.95,
        kind: Kind = "mean",
        by: str | None = None,
        *,
        edge: Edge = "new",
        coverage: float = 0.95,
        centre: Centre = "median",
        **factors: ArrayLike,
    ) -> tuple[Any, Any]:
        """Two-sided interval of the response by the delta method, as ``fit.interval`` gives it.

        The interval of a multiplicative law is computed on the log scale; that of an additive law is symmetric and
        may reach below zero.

        Parameters
        ----------
        level : float
            Confidence, between 0 and 1.
        kind : {"mean", "prediction", "tolerance"}
            Interval of the mean response; of one new row; or limits that contain a share ``coverage`` of all rows.
        by : str, optional
            Level of the ``by`` column; needed where the law has one.
        edge : {"new", "same"}
            Rows of a new edge, or of an edge whose own level is known and equals that of the law: only the scatter
            within an edge counts. Without inference by edge both are the same.
        coverage : float
            Of a tolerance interval, between 0 and 1.
        centre : {"median", "mean", "smeared"}
            Quantity bounded by a "mean" interval where errors are multiplicative; it does not affect the other kinds.
        **factors : float or array_like
            As in `predict`.

        Returns
        -------
        low, high : float or ndarray
            In the law's unit.

        Raises
        ------
        ParameterError
            As in `predict`; or the file holds no covariance (the message gives the reason); or it was written by an
            earlier version and lacks what this interval needs.

        Examples
        --------
        >>> law = LawSection.model_validate(EXAMPLE)
        >>> low, high = law.interval(V=100.0)
        >>> print(f"{low:.3f} {high:.3f}")
        0.079 0.126
        """
        found = interval_band(self, IntervalOptions(kind, level, edge, coverage, centre), by, factors)
        return as_given(self, found.low), as_given(self, found.high)

    def budget(
        self,
        at: Mapping[str, float],
        kind: Literal["mean", "prediction"] = "prediction",
        level: float = 0.95,
        by: str | None = None,
        *,
        u: Mapping[str, float] | None = None,
        gauge: float = 0.0,
        sources: "Mapping[str, UncertaintyBudget] | None" = None,
    ) -> "UncertaintyBudget":
        """Uncertainty budget of a prediction according to the GUM: contributions, u, effective df, k and U.

        Parameters
        ----------
        at : mapping of float
            Value of each factor, in the unit of the law.
        kind : {"mean", "prediction"}
            Of the law, or of one new row.
        level : float
            Of confidence, between 0 and 1.
        by : str, optional
            Level of the ``by`` column; needed where the law has one.
        u : mapping of float, optional
            Standard uncertainty of each setting, in the unit of its factor; of a tolerance ``+-a`` it is a/sqrt(3).
        gauge : float
            Standard uncertainty of the calibration of the gauge, in the unit of the response. The repeatability of
            the gauge is part of the scatter of rows and must not be given again.
        sources : mapping of UncertaintyBudget, optional
            Budgets of factors that were predicted, such as the wear in a law of power.

        Raises
        ------
        ParameterError
            As in `interval`; or an uncertainty is negative.

        Examples
        --------
        >>> law = LawSection.model_validate(EXAMPLE)
        >>> found = law.budget({"V": 100.0}, u={"V": 2.0})
        >>> print(f"u {found.u:.4f} mm, k {found.k:.2f}, U {found.U:.4f} mm")
        u 0.0138 mm, k 2.44, U 0.0337 mm
        """
        from ..budget import uncertainty_budget

        return uncertainty_budget(self, at, kind=kind, level=level, by=by, u=u, gauge=gauge, sources=sources)

    def inside(self, by: str | None = None, **factors: ArrayLike) -> Any:  # noqa: ANN401
        """Whether the points lie in the tested region; the law is not supported by data outside it.

        A point is inside when every factor is within its range and, where the file holds the region, leverage and
        coded radius do not exceed those of the outermost point of the design.

        Parameters
        ----------
        by : str, optional
            Level of the ``by`` column; its reference level unless given.
        **factors : float or array_like
            As in `predict`.

        Returns
        -------
        bool or ndarray of bool
            A bool when every factor is one number.

        Raises
        ------
        ParameterError
            A factor is missing, unknown, or not a number the law can take.

        Examples
        --------
        >>> law = LawSection.model_validate(EXAMPLE)
        >>> law.inside(V=[100.0, 300.0]).tolist()
        [True, False]
        """
        inside = region_contains(self, by, factors)
        return inside if inside.ndim else bool(inside)
