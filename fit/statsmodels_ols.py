"""A fitted law as an OLS result of statsmodels, and the comparison of both.

statsmodels is imported here alone, and only in the functions that need it: its import takes about as long as all
else together.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from ..core.arrays import Array, Ints
from ..core.display import Displayable
from ..core.errors import FitError
from .available import NotAvailable
from .fitted_rows import FittedRows
from .laws import LawForm
from .prediction import Fitted

TOLERANCE = 1e-6  # relative: far above rounding, far below any difference that matters
ROUNDING = 1e-7  # of the residual SE relative to the response: below it residuals hold too few digits to compare
COLUMN = "by"  # of the category in the formula
SMALLEST = 1e-10  # intraclass correlation: statsmodels inverts the variance between edges


@dataclass(frozen=True, slots=True, repr=False)
class StatsmodelsComparison(Displayable):
    """Largest relative differences between a law and statsmodels.

    Attributes
    ----------
    response : str
    version : str
        Of statsmodels.
    differences : mapping of str to float
        Largest relative difference of ``coefficients`` (relative to the larger of coefficient and standard error), of
        ``standard errors by edge`` (or ``standard errors``, rows independent) and of ``variance components`` (relative
        to the total variance).
    not_compared : mapping of str to str
        What statsmodels was not asked, with the reason.
    """

    response: str
    version: str
    differences: dict[str, float]
    not_compared: dict[str, str]

    @property
    def largest(self) -> float:
        """The largest difference; 0 where nothing was compared."""
        return max(self.differences.values(), default=0.0)

    @property
    def agrees(self) -> bool:
        """True where no difference is above 1e-6."""
        return all(value <= TOLERANCE for value in self.differences.values())  # NaN does not agree

    @property
    def sentence(self) -> str:
        """The comparison in words."""
        compared = ", ".join(f"{name} {value:.1e}" for name, value in self.differences.items())
        parts = [f"largest relative differences: {compared}"] if compared else []
        parts += [f"{name} not compared: {reason}" for name, reason in self.not_compared.items()]
        return f"{self.response} against statsmodels {self.version}: {'; '.join(parts)}."


def ols_results(law: Fitted) -> Any:  # noqa: ANN401  statsmodels has no types
    """The law as a results object of ``statsmodels.formula.api.ols``.

    The covariance is ``cluster-crv3`` by edge with t quantiles (``use_t=True``) where the law has inference by edge,
    and that of independent rows otherwise. Functions of statsmodels apply to the result, with these limits:
    ``anova_lm`` of type I ignores the cluster covariance, and influence measures are by row, not by edge.

    Parameters
    ----------
    law : LawFit
        With multiplicative error, or a line; with its rows in memory.

    Returns
    -------
    statsmodels RegressionResultsWrapper
        Of a formula such as ``np.log(AW) ~ np.log(V) + np.log(f)``.

    Raises
    ------
    FitError
        A nonlinear law with additive error is no linear model; a law of a stream has no rows.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> results = law.to_statsmodels()
    >>> results.cov_type, bool(abs(results.params["np.log(V)"] - law.params["V"]) < 1e-9)
    ('cluster-crv3', True)
    """
    if law.not_least_squares:
        raise FitError(f"{law.formula.response}: {law.not_least_squares}; statsmodels' OLS does not fit such lives.")
    import statsmodels.formula.api as smf  # type: ignore[import-untyped]

    formula, table, _ = _formula(law)
    model = smf.ols(formula, table)
    groups = _groups(law)
    if groups is None or isinstance(law.edges, NotAvailable):
        return model.fit(use_t=True)
    return model.fit(cov_type="cluster-crv3", cov_kwds={"groups": groups}, use_t=True)


def compare_statsmodels(law: Fitted) -> StatsmodelsComparison:
    """Differences between a law and statsmodels' OLS and, for the variance components, its mixed model.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> compare_statsmodels(law).agrees
    True
    """
    import statsmodels

    version = statsmodels.__version__
    try:
        results = ols_results(law)
    except FitError as error:
        return StatsmodelsComparison(law.formula.response, version, {}, {"the law": str(error).rstrip(".")})
    except Exception as error:  # a failure of statsmodels costs the comparison, not the fit
        reason = f"statsmodels failed: {type(error).__name__}: {error}".rstrip(".")
        return StatsmodelsComparison(law.formula.response, version, {}, {"the law": reason})
    names = _formula(law)[2]  # statsmodels puts the category before the factors
    free = law.free
    bse, theta = np.sqrt(np.diag(law.covariance()))[free], law.theta[free]
    by_edge = not isinstance(law.edges, NotAvailable)
    name = "standard errors by edge" if by_edge else "standard errors, rows independent"
    differences = {"coefficients": _largest(results.params[names] - theta, np.fmax(np.abs(theta), bse))}
    missing = {}
    if not law.no_interval and _above_rounding(results):
        differences[name] = _largest(results.bse[names] - bse, bse)
    else:
        missing[name] = law.no_interval or "the residuals are rounding errors"
    if by_edge:
        differences["variance components"] = _variance_difference(law)
    else:
        missing["variance components"] = str(law.edges).rstrip(".")
    return StatsmodelsComparison(law.formula.response, version, differences, missing)


def _formula(law: Fitted) -> tuple[str, pd.DataFrame, list[str]]:
    """Formula, table and names of the coefficients of the linear model; a FitError where there is none."""
    if not law.formula.linearisable or (law.formula.logarithmic and law.error == "additive"):
        remedy = "; fit it with error='multiplicative'" if law.formula.linearisable else ""
        raise FitError(
            f"{law.formula.response}: the {law.formula.name} law with error={law.error!r} is nonlinear in its "
            f"parameters and no OLS of statsmodels{remedy}."
        )
    rows = _rows(law)
    table = pd.DataFrame(np.asarray(rows.X), columns=list(law.formula.factors))
    table[law.formula.response] = rows.observed
    terms = _terms(law.formula)
    names = ["Intercept", *terms]
    if law.by is not None:
        # named with their column: a level called "nan" would be taken for a missing value
        levels = [f"{law.by.column}={level}" for level in (law.by.reference, *law.by.levels)]
        level = np.hstack([1 - rows.shifts.sum(axis=1, keepdims=True), rows.shifts]).argmax(axis=1)
        table[COLUMN] = pd.Categorical.from_codes(level, categories=pd.Index(levels))  # the first is the reference
        terms.append(f"C({COLUMN})")
        names += [f"{terms[-1]}[T.{name}]" for name in levels[1:]]
    left = f"np.log({law.formula.response})" if law.formula.logarithmic else law.formula.response
    if law.formula.fixed:
        left = f"I({' - '.join([left, *(f'{value!r} * np.log({name})' for name, value in law.formula.fixed)])})"
    return f"{left} ~ {' + '.join(terms)}", table, names


def _terms(formula: LawForm) -> list[str]:
    """Estimated terms of a law in the language of formulas, as statsmodels names their coefficients."""
    each = zip(formula.factors, formula.logs, formula.centres or (None,) * len(formula.factors), strict=True)
    factors = [_term(name, log, centre) for name, log, centre in each]
    if formula.first_order:
        given = dict(formula.fixed)
        return [text for name, text in zip(formula.factors, factors, strict=True) if name not in given]
    products = [
        [text for text, d in zip(factors, term.degrees, strict=True) for _ in range(d)] for term in formula.terms
    ]
    return [f"I({' * '.join(parts)})" if len(parts) > 1 else parts[0] for parts in products]


def _term(name: str, log: bool, centre: float | None) -> str:
    if log:
        return f"np.log({name})" if centre is None else f"np.log({name} / {centre!r})"
    return name if centre is None else f"I({name} - {centre!r})"


def _above_rounding(results: Any) -> bool:  # noqa: ANN401
    y = results.model.endog
    return bool(np.sqrt(results.scale) > ROUNDING * np.sqrt(np.mean(y**2)))


def _groups(law: Fitted) -> Ints | None:
    edge = _rows(law).edge
    return None if edge is None else np.asarray(pd.factorize(edge)[0])


def _rows(law: Fitted) -> FittedRows:
    if law.rows is None:
        raise FitError(f"the law of {law.formula.response} was fitted to a stream and keeps no rows for statsmodels.")
    return law.rows


def _largest(difference: Any, scale: Array) -> float:  # noqa: ANN401
    return float(np.max(np.abs(np.asarray(difference, dtype=float)) / scale))


def _variance_difference(law: Fitted) -> float:
    """Difference of the REML variance components from those that maximise statsmodels' likelihood, over their sum."""
    from scipy.optimize import brentq, minimize_scalar
    from statsmodels.regression.mixed_linear_model import (  # type: ignore[import-untyped]
        MixedLM,
        MixedLMParams,
    )

    assert not isinstance(law.edges, NotAvailable)  # noqa: S101  compare_statsmodels asked
    mixed = law.edges.mixed
    observed = _rows(law).observed
    y = np.log(observed) if law.formula.logarithmic else observed
    free = law.free
    y, Z = y - law.design[:, ~free] @ law.theta[~free], law.design[:, free]
    model = MixedLM(y, Z, groups=_groups(law))
    model.cov_pen = None  # set by its fit, which is not called: its optimisers stop far from 1e-6

    def fixed(icc: float) -> tuple[Array, Array]:
        cov_re = np.array([[icc / (1 - icc)]])
        return np.asarray(model.get_fe_params(cov_re, np.zeros(0))[0]), cov_re

    def criterion(icc: float) -> float:
        theta, cov_re = fixed(icc)
        held = MixedLMParams.from_components(fe_params=theta, cov_re=cov_re, vcomp=np.zeros(0))
        return -float(model.loglike(held, profile_fe=False))

    def slope(icc: float) -> float:
        """Derivative by differences of fourth order: the least value alone gives the share to 1e-7."""
        h = 0.01 * icc * (1 - icc)
        near, far = criterion(icc + h) - criterion(icc - h), criterion(icc + 2 * h) - criterion(icc - 2 * h)
        return (8 * near - far) / (12 * h)

    found = minimize_scalar(criterion, bounds=(SMALLEST, 1 - 1e-6), method="bounded", options={"xatol": 1e-7})
    icc = float(found.x) if found.fun < criterion(SMALLEST) else SMALLEST
    ends = icc * (1 - 1e-3 * (1 - icc)), icc * (1 + 1e-3 * (1 - icc))
    if slope(ends[0]) < 0 < slope(ends[1]):
        icc = float(brentq(slope, *ends, xtol=1e-14))
    theta, cov_re = fixed(icc)
    scale = float(model.get_scale(theta, cov_re, np.zeros(0)))
    theirs = np.array([scale * cov_re[0, 0], scale])
    ours = np.array([mixed.sd_between, mixed.sd_within]) ** 2
    return _largest(theirs - ours, np.array(theirs.sum()))


def centred_words(law: Fitted) -> dict[str, str]:
    """Each term of a law of second order in the language of formulas, in the columns of `centred_rows`.

    Products are interactions, so that ``anova_lm`` of type II knows what they contain: ``V``, ``I(V ** 2)``, ``V:f``.
    """
    names = [_safe(name) for name in law.formula.factors]
    return {
        term.name: _word([(name, power) for name, power in zip(names, term.degrees, strict=True) if power])
        for term in law.formula.terms
    }


def centred_rows(law: Fitted) -> pd.DataFrame:
    """Rows of a law of second order: ``y`` on the scale of the fit, centred factors, ``block`` and ``edge``."""
    rows = _rows(law)
    table = pd.DataFrame(law.formula.transformed(rows.X), columns=[_safe(name) for name in law.formula.factors])
    table.insert(0, "y", scaled_response(law))
    if law.by is not None:
        level = (rows.shifts @ np.arange(1, 1 + rows.shifts.shape[1])).astype(int)
        table["block"] = np.array([law.by.reference, *law.by.levels])[level]
    return table if rows.edge is None else table.assign(edge=rows.edge)


def scaled_response(law: Fitted) -> Array:
    """Response of a linear model on the scale of its fit, shape (n,)."""
    observed = _rows(law).observed
    return np.log(observed) if law.formula.logarithmic else observed


def _safe(name: str) -> str:
    """A factor as a name in a formula: patsy has C, I and Q for itself."""
    return f"x_{name}" if name in ("C", "I", "Q", "y", "edge", "block") or not name.isidentifier() else name


def _word(powers: list[tuple[str, int]]) -> str:
    """A term from the factors that it has, with their powers."""
    return ":".join(name for name, _ in powers) if max(p for _, p in powers) == 1 else f"I({powers[0][0]} ** 2)"
