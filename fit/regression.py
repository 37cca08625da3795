"""Two stages, as the papers do it: a straight line in logarithms, then least squares in natural units.

The first stage is the maximum-likelihood fit when errors multiply (a scatter of so many per cent); its
result starts the second, which is that fit when errors add (a scatter of so many newtons). Which of them
a law reports is ``error``; ``LawFit.alternative`` gives the other.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..core.errors import FitError, UsageError
from ..core.threads import one_thread
from ..datasets import Runs
from .condense import Condensed
from .identifiable import LeftOut, identifiable
from .jackknife import edge_inference
from .lawfit import LawFit
from .laws import LARGEST_LOG, Error, Law, exponential, power
from .linear import linear
from .rows import Dropped, Rows, select

Array = NDArray[np.float64]
# theta, its covariance (None without degrees of freedom), fitted response, residuals, total sum of squares
Stage = tuple[Array, Array | None, Array, Array, float]

# Tolerances of the nonlinear stage: near machine precision, since certified sets ask for 8 to 11 digits.
TIGHT = 1e-15


def power_law(
    runs: Runs,
    response: str,
    factors: Sequence[str],
    *,
    error: Error = "multiplicative",
    edge: str | None = "edge",
    by: str | None = None,
) -> LawFit:
    """Fit ``R = c0 prod X_j^b_j`` (Alaskari & Oraby, doi 10.15242/IIE.E1216006, eq. 1-3).

    Parameters
    ----------
    runs : Runs
    response : str
        Symbol of the response, e.g. ``"AW"``; its unit becomes the unit of c0 times the factors' powers.
    factors : sequence of str
        Symbols, most important first. A constant, or an exact product of earlier ones, is left out by name.
    error : {"multiplicative", "additive"}
        Least squares of ln R, or of R itself. ``LawFit.alternative`` gives the other one.
    edge : str or None
        Column that says which cutting edge a row is from; standard errors and intervals are then by edge.
        None: rows are taken as independent, as the papers do.
    by : str, optional
        Category (work material, say) whose level multiplies the law by exp(shift).

    Raises
    ------
    FitError
        Too few usable rows, no factor left, or no convergence.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> runs = datasets.read_runs(datasets.bundled("ac2017_table1"))
    >>> fit.power_law(runs, "AW", ["V", "f"]).params.round(4).to_dict()
    {'c0': 0.0096, 'V': 0.577, 'f': 0.168}
    """
    rows = select(runs, response, factors, by=by, edge=edge, positive=_positive(error))
    keep, left_out = identifiable(factors, np.log(rows.X), rows.shifts, logs=True)
    law = power(response, tuple(factors[j] for j in keep))
    rows = replace(rows, X=rows.factors(keep))
    return fit_rows(runs, law, rows, left_out, error)


def exponential_law(
    runs: Runs,
    response: str = "Ra",
    factor: str = "F",
    *,
    error: Error = "multiplicative",
    by: str | None = None,
) -> LawFit:
    """Fit ``Ra = a exp(b F)``, roughness as an exponential of force (SURF eq. 5: a 0.2401 um, b 0.0034 1/N).

    Arguments and errors as for :func:`power_law`.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> runs = datasets.read_runs(datasets.bundled("surf_table1"))
    >>> list(fit.exponential_law(runs).params.index)
    ['a', 'b']
    """
    positive: Literal["all", "none"] = "all" if _positive(error) == "all" else "none"
    rows = select(runs, response, [factor], by=by, positive=positive)
    keep, left_out = identifiable([factor], rows.X, rows.shifts, logs=False)
    if not keep:
        raise FitError(f"{response} on {factor}: {factor} is {left_out[0].reason}; nothing to fit.")
    fitted = fit_rows(runs, exponential(response, factor), rows, left_out, error)
    different = len(np.unique(rows.X))
    if different > len(rows.X) / 2:
        return fitted
    note = f"{factor} takes {different} values in {len(rows.X)} rows: rows that share one are not independent"
    return replace(fitted, notes=(*fitted.notes, note))


def _positive(error: Error) -> Literal["all", "factors"]:
    if error not in ("multiplicative", "additive"):
        raise UsageError(f"error={error!r}: it is 'multiplicative' or 'additive'.")
    return "all" if error == "multiplicative" else "factors"


@one_thread
def fit_rows(runs: Runs, law: Law, rows: Rows, left_out: tuple[LeftOut, ...], error: Error) -> LawFit:
    """The stages that ``error`` asks for: the logarithms alone, or they and natural units after them."""
    _enough(law, rows, left_out)
    notes = _notes(rows)
    Z = law.design(rows.X, rows.shifts)
    units = {name: runs.units.get(name, "") for name in (law.response, *law.factors)}

    def result(error: Error, theta: Array, cov: Array | None, fitted: Array, r: Array, tss: float) -> LawFit:
        _within_numbers(law, theta, Z)
        return LawFit(
            law, error, theta, cov, rows.X, rows.shifts, rows.y, fitted, r, rows.lines, rows.edge,
            float(r @ r), tss, units, rows.by, left_out, rows.dropped, notes, rows.repeats,
        )  # fmt: skip

    if not law.logarithmic:
        fitted = result("additive", *_straight(Z, rows.y))
    elif error == "multiplicative":
        fitted = result("multiplicative", *_logarithmic(Z, rows.y))
    else:
        start = law.guess(Z, rows.y) if (rows.y > 0).all() else _start(law, Z, rows, left_out)
        fitted = result("additive", *_natural(law, Z, rows.y, start))
    return replace(fitted, edges=edge_inference(fitted))


def refitted(law: LawFit, error: Error, keep: slice = slice(None)) -> LawFit:
    """The same law fitted to ``keep`` of its rows with either error structure.

    Raises
    ------
    FitError
        The rows miss a level or a setting, or least squares in natural units does not converge.
    """
    X, shifts, y = law.X[keep], law.shifts[keep], law.observed[keep]
    Z = law.law.design(X, shifts)
    if not law.law.logarithmic:
        stage = _straight(Z, y)
    else:
        stage = _logarithmic(Z, y) if error == "multiplicative" else _natural(law.law, Z, y, law.theta)
    theta, cov, fitted, r, tss = stage
    _within_numbers(law.law, theta, Z)
    new = replace(
        law, error=error, theta=theta, cov_theta=cov, X=X, shifts=shifts, observed=y, fitted=fitted, residuals=r,
        lines=law.lines[keep], edge=None if law.edge is None else law.edge[keep], rss=float(r @ r), tss=tss,
    )  # fmt: skip
    return replace(new, edges=edge_inference(new))


def other_structure(law: LawFit) -> LawFit | None:
    """The same law fitted to the same rows with the other error structure; None where there is no such fit.

    A line has none; rows that are not above zero have no logarithm; and least squares in natural units may
    fail to converge.
    """
    if not law.law.logarithmic or not (law.observed > 0).all():
        return None
    try:
        return refitted(law, "additive" if law.error == "multiplicative" else "multiplicative")
    except FitError:
        return None


def _start(law: Law, Z: Array, rows: Rows, left_out: tuple[LeftOut, ...]) -> Array:
    """Log-linear start from the rows above zero, where not all of them are."""
    above = rows.y > 0
    below = rows.lines[~above]
    reason = f"{law.response} zero or negative, and the fit starts from logarithms"
    unusable = Dropped(reason, len(below), tuple(int(i) for i in below[:5]))
    _enough(law, replace(rows, y=rows.y[above], dropped=(*rows.dropped, unusable)), left_out)
    try:
        return law.guess(Z[above], rows.y[above])
    except FitError:
        raise FitError(
            f"{law.response}: the {int(above.sum())} rows above zero do not tell the parameters apart, so "
            "least squares in natural units has no start. Leave out a factor or the category, or add such rows."
        ) from None


def _enough(law: Law, rows: Rows, left_out: tuple[LeftOut, ...]) -> None:
    why = "".join(f"; {item.factor} is left out: {item.reason}" for item in left_out)
    gone = "".join(f"; {_gone(item)}" for item in rows.dropped)
    shifts = rows.shifts.shape[1]
    p = len(law.names) + shifts
    if len(rows.y) < p:
        names = ", ".join(law.names) + (f" and {shifts} shifts of {rows.by.column}" if rows.by else "")
        mend = "Correct the rows left out, measure" if gone else "Measure"
        less = f", or leave a factor out (--map {law.factors[-1]}=none)" if law.factors else ""
        raise FitError(
            f"{law.response}: {len(rows.y)} usable rows for {p} parameters ({names}){gone}{why}. "
            f"{mend} at least {p + 1 - len(rows.y)} more{less}."
        )
    if np.all(rows.y == rows.y[0]):
        raise FitError(
            f"{law.response} is {rows.y[0]:g} in all {len(rows.y)} rows: there is nothing to explain. Check the column."
        )
    if not law.factors:
        raise FitError(f"{law.response}: no factor to fit it on{why}{gone}. Vary at least one condition.")


def _gone(item: Dropped) -> str:
    lines = ", ".join(map(str, item.lines)) + (", ..." if item.count > len(item.lines) else "")
    return f"{item.count} rows left out: {item.reason} (lines {lines})"


def _within_numbers(law: Law, theta: Array, Z: Array) -> None:
    """Refuse a constant that no number holds: some factor hardly changes, and its exponent runs away."""
    if not law.logarithmic or abs(theta[0]) < LARGEST_LOG:
        return
    runaway = 1 + int(np.argmax(np.abs(theta[1:] * Z[0, 1:])))
    name = law.factors[min(runaway, len(law.factors)) - 1]
    raise FitError(
        f"{law.response}: its constant comes out as exp({theta[0]:.4g}), which no number holds, since {name} "
        f"hardly changes in these rows and its coefficient comes out as {theta[runaway]:.3g}. Vary {name}, "
        f"or leave it out (--map {name}=none)."
    )


def _notes(rows: Rows) -> tuple[str, ...]:
    if rows.repeats == 1:
        return ()
    n = len(rows.y)
    return (
        f"the file writes each of {n} measurements {rows.repeats} times ({n * rows.repeats} rows); "
        "a copy is no new evidence, so each counts once",
    )


def _straight(Z: Array, y: Array) -> Stage:
    """Least squares of y on Z: the whole fit of a line."""
    fit = linear(Z, y)
    eta = Z @ fit.params
    return fit.params, fit.cov_params if fit.df_resid else None, eta, y - eta, fit.tss


def _logarithmic(Z: Array, y: Array) -> Stage:
    """First stage: least squares of ln y."""
    theta, cov, eta, residuals, tss = _straight(Z, np.log(y))
    return theta, cov, np.exp(eta), residuals, tss


def _natural(law: Law, Z: Array, y: Array, start: Array) -> Stage:
    """Second stage: trust region on the residuals in natural units, analytic gradient, then one exact step.

    Centring the columns of Z makes the constant nearly independent of the exponents, which is what the
    solver's steps are quick and sure in.
    """
    from scipy.optimize import least_squares

    centre = np.zeros(Z.shape[1])
    centre[1:] = Z[:, 1:].mean(axis=0)
    C = Z - centre
    back = np.eye(Z.shape[1])
    back[0, 1:] = -centre[1:]
    condensed = Condensed(law, C, y, float(np.max(np.abs(y))))
    begin = np.linalg.solve(back, start)
    found = least_squares(
        condensed.residuals, begin, jac=condensed.jacobian, method="trf", x_scale="jac",
        ftol=TIGHT, xtol=TIGHT, gtol=TIGHT,
    )  # fmt: skip
    if not np.isfinite(found.x).all() or found.status == 0:
        raise FitError(
            f"{law.response}: least squares in natural units did not converge from the log-linear start. "
            "Fit with error='multiplicative'."
        )
    step = linear(condensed.jacobian(found.x), -condensed.residuals(found.x))
    theta = back @ (found.x + step.params)
    fitted = law.response_at(theta, Z)
    r = y - fitted
    df = len(y) - len(theta)
    variance = float(r @ r) / condensed.size**2 / max(df, 1)  # the step is fitted in units of size
    cov = variance * back @ step.cov_unscaled @ back.T if df else None
    return theta, cov, fitted, r, float(np.sum((y - y.mean()) ** 2))
