"""Regression of power, exponential and load laws, in two stages as in the papers.

The first stage, linear least squares of the logarithms, is the maximum-likelihood fit for multiplicative errors; its
result starts the second, least squares on the original scale, which is that fit for additive errors. ``error`` names
the one that a law reports; ``LawFit.alternative`` gives the other.

Load line: Tai, Tsai & Li 2023, IEEE Access, doi 10.1109/ACCESS.2023.3330587, eq. 14 and 15.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, get_args

import numpy as np

from ..core.arrays import Array, Flags
from ..core.errors import FitError, UsageError
from ..core.formula import FORMS, Term
from ..core.threads import one_thread
from ..datasets.runs import Readable, Runs, as_runs
from .available import NotAvailable
from .edges import EXACT_FIT, NO_EDGES, EdgeInference, infer_by_edge
from .fitted_rows import FittedRows, LawSource
from .lawfit import LawFit
from .laws import Error, LawForm
from .least_squares import linear
from .nonlinear import minimise
from .rows import (
    Dropped,
    LeftOut,
    Rows,
    check_constant,
    check_enough,
    identifiable,
    identified,
    second_order_form,
    select,
)

# theta, its covariance (None without degrees of freedom), fitted response, residuals, total sum of squares
Stage = tuple[Array, Array | None, Array, Array, float]

# A load held by a controller stays within 1 % of its reference (the paper's own regulation): a current that
# moves no more than this is a setting, not a response.
HELD = 0.01


def power_law(
    runs: Readable,
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
    runs : Runs, DataFrame or path
    response : str
        Symbol of the response, e.g. ``"AW"``; its unit becomes the unit of c0 times the factors' powers.
    factors : sequence of str
        Symbols, most important first. A constant, or an exact product of earlier ones, is left out by name.
    error : {"multiplicative", "additive"}
        Least squares of ln R, or of R itself. ``LawFit.alternative`` gives the other one.
    edge : str or None
        Column with the cutting edge of each row; standard errors and intervals are then by edge.
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
    return fit_form(as_runs(runs), "power", response, factors, error=error, edge=edge, by=by)


def exponential_law(
    runs: Readable,
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
    fitted = fit_form(as_runs(runs), "exponential", response, [factor], error=error, by=by)
    different = len(np.unique(fitted.X))
    if different > fitted.nobs / 2:
        return fitted
    note = (
        f"{factor} has {different} distinct values in {fitted.nobs} rows: rows with the same value are not independent"
    )
    return replace(fitted, notes=(*fitted.notes, note))


def fit_form(
    runs: Runs,
    form: str,
    response: str,
    factors: Sequence[str],
    *,
    error: Error = "multiplicative",
    edge: str | None = "edge",
    by: str | None = None,
    terms: Sequence[Term] | None = None,
    fixed: Mapping[str, float] | None = None,
) -> LawFit:
    """Fit a law of any form of ``core.formula.FORMS``; arguments and errors as for :func:`power_law`.

    A form with named coefficients needs all its factors; others leave out those that are not identified. ``terms`` of
    second order: by default factors, squares and products, less those that are not identified. ``fixed`` are exponents
    that are given, not estimated; they need no change of their factor, and multiplicative errors.
    """
    if error not in get_args(Error):
        raise UsageError(f"error={error!r}: it is 'multiplicative' or 'additive'.")
    if form not in FORMS:
        raise UsageError(f"form {form!r}: it is one of {', '.join(FORMS)}.")
    shape = FORMS[form]
    response, *factors = map(runs.symbol, (response, *factors))
    asked = LawForm(form, response, tuple(factors), fixed=tuple((fixed or {}).items()))
    _check_fixed(asked, error)
    rows = select(runs, response, factors, by=by, edge=edge, positive=asked.positive(error))
    logs = asked.logs
    columns = np.column_stack([np.log(x) if log else x for x, log in zip(rows.X.T, logs, strict=True)])
    keep, left_out = identified(asked, columns, rows)
    needed = shape.coefficients is not None or (shape.last_unlogged and len(factors) - 1 not in keep)
    if left_out and needed:
        out = left_out[-1] if shape.last_unlogged else left_out[0]
        raise FitError(f"{response} on {', '.join(factors)}: {out.factor} is {out.reason}; nothing to fit.")
    kept = tuple(factors[j] for j in keep)
    rows = replace(rows, X=rows.factors(keep))
    law = replace(asked, factors=kept)
    if shape.second_order and kept:
        law, more = second_order_form(law, rows, terms)
        left_out += more
    return fit_rows(runs, law, rows, left_out, error)


def _check_fixed(law: LawForm, error: Error) -> None:
    """Refuse fixed exponents that are not of factors, or with additive errors."""
    if not law.fixed:
        return
    if law.fault:
        raise UsageError(f"{law.response}: {law.fault}.")
    if error == "additive":
        raise UsageError(f"{law.response}: a law with fixed exponents has multiplicative errors; leave error out.")


def load_law(runs: Readable, current: str = "I", *, feed: str = "fm", wear: str = "VB") -> LawFit:
    """Fit the load line ``I = A + B fm + k1 VB`` (Tai, Tsai & Li 2023, eq. 14).

    Where most rows are at one held current, eq. 14 cannot be fitted; eq. 15, feed on wear, is fitted to
    those rows instead and the notes say so. Errors are additive.

    Raises
    ------
    FitError
        A coefficient of the wrong sign (current falls with feed or wear) in rows whose current does vary,
        or too few rows.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> runs = datasets.read_runs(datasets.bundled("clm2023_end_milling"))
    >>> fit.load_law(runs).form
    'feed_line'
    """
    runs = as_runs(runs)
    current, feed, wear = map(runs.symbol, (current, feed, wear))
    rows = select(runs, current, [feed, wear], positive=())
    if not len(rows.y):
        gone = "; ".join(f"{item.count} rows: {item.reason}" for item in rows.dropped)
        raise FitError(f"load line {current} on {feed} and {wear}: no usable row ({gone}). Fill those cells in.")
    held = _held(rows.y)
    if held.all():
        return _held_law(runs, current, feed, wear, rows, held, "the current is held, so it cannot be a response")
    _, left_out = identifiable([feed, wear], rows.X, rows.shifts, logs=False)
    if left_out:
        reasons = "; ".join(f"{item.factor} is {item.reason}" for item in left_out)
        raise FitError(f"load line {current} on {feed} and {wear}: {reasons}. Add runs in which both change.")
    fitted = fit_rows(runs, LawForm("load_line", current, (feed, wear)), rows, (), "additive")
    wrong = _wrong_sign(fitted)
    if wrong is None:
        return fitted
    if held.sum() > len(held) / 2:
        return _held_law(runs, current, feed, wear, rows, held, f"eq. 14 is refused: {wrong}")
    raise FitError(f"load line refused: {wrong}. Vary feed at one wear, and wear at one feed, over a wider range.")


@one_thread
def fit_rows(runs: Runs, law: LawForm, rows: Rows, left_out: tuple[LeftOut, ...], error: Error) -> LawFit:
    """The law of the selected rows with this error structure."""
    check_enough(law, rows, left_out)
    Z = law.design(rows.X, rows.shifts)
    start = None
    if law.logarithmic and (error == "additive" or not law.linearisable):
        start = law.guess(Z, rows.y) if (rows.y > 0).all() else _start(law, Z, rows, left_out)
    stage = _stage(law, error, Z, rows.y, start)
    check_constant(law, stage[0], Z)
    return law_of(
        law, error if law.logarithmic else "additive", stage,
        FittedRows(rows.X, rows.shifts, rows.y, stage[2], stage[3], rows.lines, rows.edge),
        units={name: runs.units.get(name, "") for name in (law.response, *law.factors)},
        by=rows.by, left_out=left_out, dropped=rows.dropped, notes=_notes(rows), repeats=rows.repeats,
        source=LawSource.of_runs(runs),
    )  # fmt: skip


def refitted(law: LawFit, error: Error, keep: slice | Flags = slice(None)) -> LawFit:
    """The same law fitted to ``keep`` of its rows, a slice or a mask, with either error structure.

    Raises
    ------
    FitError
        The rows miss a level or a setting, or least squares on the original scale does not converge.
    """
    part = law.with_rows(keep)
    stage = _stage(law.formula, error, part.design, part.observed, law.theta)
    check_constant(law.formula, stage[0], part.design)
    rows = FittedRows(part.X, part.shifts, part.observed, stage[2], stage[3], part.lines, part.edge)
    return law_of(law.formula, error, stage, rows, **facts_of(law))


def facts_of(law: LawFit) -> dict[str, Any]:
    """The fields of a law that a refit to its rows keeps."""
    names = ("units", "by", "left_out", "dropped", "notes", "repeats", "source", "selected")
    return {name: getattr(law, name) for name in names}


def law_of(formula: LawForm, error: Error, stage: Stage, rows: FittedRows, **facts: Any) -> LawFit:  # noqa: ANN401
    """The law of a fitted stage and its rows, with inference by edge."""
    theta, cov, _, r, tss = stage
    law = LawFit.of_rows(rows, formula, error=error, theta=theta, cov_theta=cov, rss=float(r @ r), tss=tss, **facts)
    return replace(law, edges=edge_inference(law))


def edge_inference(law: LawFit) -> EdgeInference | NotAvailable:
    """Inference by edge of a law of rows in memory, an additive one along its gradient.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    >>> edges = fit.power_law(runs, "AW", ["V", "f", "d", "t"]).edges
    >>> edges.df, edges.within
    (23, (False, False, False, False, True))
    """
    if law.edge is None:
        return NO_EDGES
    if law.cov_theta is None or law.exact:
        return EXACT_FIT
    free = law.free
    row_cov = law.cov_theta[np.ix_(free, free)]
    names = tuple(name for name, estimated in zip(law.theta_names, free, strict=True) if estimated)
    return infer_by_edge(
        law.gradient[:, free], law.residuals, theta=law.theta[free], row_cov=row_cov,
        cov_unscaled=row_cov * (law.df_resid / law.rss), names=names, edge=law.edge, within_of=law.design[:, free],
    )  # fmt: skip


def other_structure(law: LawFit) -> LawFit | None:
    """The same law fitted to the same rows with the other error structure; None where there is no such fit.

    A line has none; rows that are not above zero have no logarithm; least squares on the original scale may fail to
    converge; and a law of a stream keeps no rows.
    """
    logarithmic = law.rows is not None and law.formula.logarithmic and bool((law.observed > 0).all())
    if not logarithmic or law.formula.fixed or law.not_least_squares:
        return None
    try:
        return refitted(law, "additive" if law.error == "multiplicative" else "multiplicative")
    except FitError:
        return None


def _start(law: LawForm, Z: Array, rows: Rows, left_out: tuple[LeftOut, ...]) -> Array:
    """Log-linear start from the rows above zero, where not all of them are."""
    above = rows.y > 0
    below = rows.lines[~above]
    reason = f"{law.response} zero or negative, and the fit starts from logarithms"
    unusable = Dropped(reason, len(below), tuple(int(i) for i in below[:5]))
    check_enough(law, replace(rows, y=rows.y[above], dropped=(*rows.dropped, unusable)), left_out)
    try:
        return law.guess(Z[above], rows.y[above])
    except FitError:
        raise FitError(
            f"{law.response}: the {int(above.sum())} rows above zero do not identify the parameters, so "
            "least squares on the original scale has no start. Leave out a factor or the category, or add such rows."
        ) from None


def _notes(rows: Rows) -> tuple[str, ...]:
    if rows.repeats == 1:
        return ()
    n = len(rows.y)
    found = f"the file contains each of {n} measurements {rows.repeats} times ({n * rows.repeats} rows)"
    return (f"{found}; duplicates add no information, so each is counted once",)


def _stage(law: LawForm, error: Error, Z: Array, y: Array, start: Array | None) -> Stage:
    """Linear least squares of the response or of its logarithm, or nonlinear least squares from ``start``."""
    if not law.logarithmic:
        return linear_stage(Z, y)
    if law.linearisable and (error == "multiplicative" or start is None):
        theta, cov, eta, residuals, tss = _with_fixed(law, Z, np.log(y))
        return theta, cov, np.exp(eta), residuals, tss
    theta, cov = minimise(law, Z, y, law.guess(Z, y) if start is None else start, error)
    fitted = law.response_at(theta, Z)
    target, value = (np.log(y), np.log(fitted)) if error == "multiplicative" else (y, fitted)
    return theta, cov, fitted, target - value, float(np.sum((target - target.mean()) ** 2))


def _with_fixed(law: LawForm, Z: Array, y: Array) -> Stage:
    """Linear least squares of y less the fixed terms; the total sum of squares is that of y."""
    if not law.fixed:
        return linear_stage(Z, y)
    shifts = Z.shape[1] - len(law.estimated)
    theta, free = law.start(shifts), law.free(shifts)
    offset = Z @ theta
    part, cov_part, eta, residuals, _ = linear_stage(Z[:, free], y - offset)
    theta[free] = part
    cov = None
    if cov_part is not None:
        cov = np.zeros((len(theta),) * 2)
        cov[np.ix_(free, free)] = cov_part
    return theta, cov, eta + offset, residuals, float(np.sum((y - y.mean()) ** 2))


def linear_stage(Z: Array, y: Array) -> Stage:
    """Linear least squares of y on Z."""
    fit = linear(Z, y)
    eta = Z @ fit.params
    return fit.params, fit.cov_params if fit.df_resid else None, eta, y - eta, fit.tss


def _held(current: Array) -> Flags:
    middle = np.median(current)
    return np.asarray(np.abs(current - middle) <= HELD * abs(middle) * (1 + 1e-9), dtype=bool)


def _wrong_sign(fitted: LawFit) -> str | None:
    _, feed, wear = fitted.params
    for name, value, symbol in (("B", feed, fitted.factors[0]), ("k1", wear, fitted.factors[1])):
        if value <= 0:
            unit = f"{fitted.units[fitted.response]}/({fitted.units[symbol]})"
            return (
                f"{name} comes out as {value:.3g} {unit}, but {fitted.response} rises with {symbol} on a "
                f"machine ({fitted.response} ranges over {np.ptp(fitted.observed):.3g} "
                f"{fitted.units[fitted.response]} only)"
            )
    return None


def _held_law(runs: Runs, current: str, feed: str, wear: str, rows: Rows, held: Flags, why: str) -> LawFit:
    level = float(np.median(rows.y))
    unit = runs.units[current]
    law = LawForm("feed_line", feed, (wear,))
    keep, left_out = identifiable([wear], rows.X[held][:, 1:], rows.shifts[held], logs=False)
    if not keep:
        raise FitError(f"{why}; feed on wear (eq. 15) fails too: {wear} is {left_out[0].reason}.")
    at_level = replace(
        rows,
        X=rows.X[held][:, 1:],
        y=rows.X[held][:, 0],
        shifts=rows.shifts[held],
        lines=rows.lines[held],
        edge=None if rows.edge is None else rows.edge[held],
    )
    fitted = fit_rows(runs, law, at_level, (), "additive")
    if fitted.params["slope"] >= 0:
        raise FitError(f"{why}; feed on wear (eq. 15) has the wrong sign too: {feed} does not fall with {wear}.")
    others = len(held) - int(held.sum())
    used = f"the {int(held.sum())} rows held at {level:g} {unit}" + (f" ({others} others not used)" if others else "")
    # The parameter file has no field of the held load: HELD_LOAD of parameters.setting_rules reads the last sentence.
    note = f"{why}; feed is fitted on wear instead (eq. 15), on {used}. It is true at {level:g} {unit} alone."
    return replace(fitted, notes=(*fitted.notes, note))
