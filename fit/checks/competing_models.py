"""Competing models of a power law, compared by cross-validation over edges.

Each form is fitted to ln R and leaves out one edge at a time (one row, where there are no edges); its prediction error
of that edge, in ln R, is compared. An alternative is better where its error is smaller by more than chance: by a t test
of the difference over the edges, at a level shared among the alternatives.

Rows of an edge share its level, which no form predicts. So errors are compared after whitening by the intraclass
correlation c of the power law: from the m errors of an edge the part ``1 - sqrt((1 - c) / (1 - c + m c))`` of their
mean is subtracted.

Sources: Hastie, Tibshirani & Friedman 2009, The Elements of Statistical Learning, section 7.10 (cross-validation and
its standard error); Pinheiro & Bates 2000, Mixed-Effects Models in S and S-PLUS, section 2.2 (whitening); Cook &
Weisberg 1982, Residuals and Influence in Regression, section 2.2 (deletion without refitting).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ...core.arrays import Array, Ints
from ...core.display import Displayable, Plottable
from ...core.errors import FitError
from ...core.rounding import count
from ...core.verdict import DO_NOT_USE
from ...datasets.runs import Readable, Runs, as_runs
from ..available import NotAvailable, computed
from ..composite_law import without_fixed
from ..edges import EdgeInference
from ..form_choice import fit_in_form
from ..lawfit import LawFit
from ..least_squares import linear
from .check import SIGNIFICANT, Check
from .competing_forms import FittedForm, Form, FormRows, alternative_forms, power_form, rows_of, wear_of, with_zero_wear
from .deletion_diagnostics import ALONE
from .strata import NO_ROWS, no_scatter, units_of
from .time_exponent import CommonExponent, common_exponent
from .tool_lives import longest_lives

LARGEST = 3.0  # error in logarithms from which a form does not predict at all


@dataclass(frozen=True, slots=True, repr=False)
class ZeroWear(Displayable):
    """A form fitted to rows at zero wear as well, which a power of wear cannot have.

    Attributes
    ----------
    rows : int
        Rows at zero wear.
    error : float
        Root mean squared prediction error of these rows, in ln R, their units left out.
    coefficients : mapping of str to float
        With these rows; those of the form itself are of the rows that all forms share.
    """

    rows: int
    error: float
    coefficients: Mapping[str, float]


@dataclass(frozen=True, slots=True, repr=False)
class CompetingModel(Displayable):
    """One form, fitted.

    Attributes
    ----------
    name, formula : str
    coefficients : mapping of str to float
        As the formula names them, ``ln c0`` for the constant.
    error : float
        Root mean squared prediction error of left-out units, in ln R.
    difference, standard_error : float
        Root mean square of its whitened errors less that of the power law, and the standard error of the difference
        over the units.
    pvalue : float
        P of so low a difference where the power law predicts as well, one-sided.
    zero_wear : ZeroWear or None
        Where the form allows rows at zero wear and the runs have some.
    """

    name: str
    formula: str
    coefficients: Mapping[str, float]
    error: float
    difference: float
    standard_error: float
    pvalue: float = 1.0
    zero_wear: ZeroWear | None = None


@dataclass(frozen=True, slots=True, repr=False, kw_only=True)
class CompetingModels(Check, Plottable):
    """Competing models of one law; the statistic is the ``difference`` of the one of smallest p, or of the chosen one.

    The p-value is its own times the number of alternatives (Bonferroni).

    Attributes
    ----------
    response : str
    power : CompetingModel
        The power law itself; its difference is 0.
    alternatives : tuple of CompetingModel
        Best first.
    not_fitted : tuple of (str, NotAvailable)
        Forms that could not be fitted, each with its reason.
    common_exponent : CommonExponent or NotAvailable
        Test of one time exponent of all edges.
    unit, units : str, int
        What was left out, ``edge`` or ``row``, and how many there are.
    """

    response: str
    power: CompetingModel
    alternatives: tuple[CompetingModel, ...]
    not_fitted: tuple[tuple[str, NotAvailable], ...]
    common_exponent: CommonExponent | NotAvailable
    unit: str
    units: int

    @property
    def chosen(self) -> CompetingModel:
        """The power law, or the best alternative where the test rejects the power law at its own level."""
        return _chosen(self.power, self.alternatives)


def compare_forms(law: LawFit, runs: Readable | None = None) -> CompetingModels | NotAvailable:
    """Fit competing models to the rows of a power law, and compare them by cross-validation over units.

    Parameters
    ----------
    law : LawFit
        A power law with either error structure; all forms are fitted in logarithms.
    runs : Runs, DataFrame or path, optional
        The runs that it was fitted to. Forms are compared on the rows of the power law; those that allow it are fitted
        to rows at zero wear as well, and predict these.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    >>> fit.compare_forms(fit.power_law(runs, "AW", ["V", "f", "d", "t"])).chosen.name
    'power law'
    """
    law = without_fixed(law)
    if reason := not_comparable(law):
        return NotAvailable(reason)
    unit, codes = units_of(law)
    if codes.max() == 0:
        unit, codes = "row", np.arange(law.nobs)
    icc = law.edges.icc if unit == "edge" and isinstance(law.edges, EdgeInference) else 0.0
    form = power_form(law)
    base = prediction_errors(form, codes)
    if isinstance(base, NotAvailable):
        return NotAvailable(f"the power law without one {unit} cannot be fitted: {base}")
    zero = None if runs is None else with_zero_wear(law, as_runs(runs))
    found = {one.name: _alternative(one, rows_of(law), base, codes, icc, zero) for one in alternative_forms(law)}
    fitted = [model for model in found.values() if isinstance(model, CompetingModel)]
    power = replace(_compared(form, base, base, codes, icc), pvalue=1.0)
    alternatives = tuple(sorted(fitted, key=lambda model: model.difference))
    chosen, zero_words = _chosen(power, alternatives), _zero_words(law, alternatives, zero)
    tested = min(alternatives, key=lambda model: model.pvalue, default=power) if chosen is power else chosen
    return CompetingModels(
        null="no competing model predicts left-out units better than the power law",
        statistic=tested.difference,
        symbol="difference of RMS error",
        pvalue=min(1.0, len(alternatives) * tested.pvalue) if alternatives else None,
        concern=int(chosen is not power),
        verdict=_verdict(law.response, unit, power, alternatives, chosen) + _command(law, chosen) + zero_words,
        kept=_verdict(law.response, unit, power, alternatives, power) + zero_words,
        response=law.response,
        power=power,
        alternatives=alternatives,
        not_fitted=tuple((name, why) for name, why in found.items() if isinstance(why, NotAvailable)),
        common_exponent=common_exponent(law),
        unit=unit,
        units=int(codes.max()) + 1,
    )


Judged = Callable[[LawFit], Mapping[str, Check | NotAvailable]]  # makes the checks of a law


def preferable_form(law: LawFit, runs: Runs | None, judged: Judged) -> CompetingModels | NotAvailable | None:
    """The comparison of forms of a power law, which proposes another form only where the law in it may be used.

    Run-outs that are written as lives bend every form: lives with them are not compared.
    """
    if law.form != "power":
        return None
    if (lives := longest_lives(law)) is not None and lives.concern:
        return NotAvailable("the longest lives are equal, as of run-outs that are not marked: mark them first")
    found = compare_forms(law, runs)
    if runs is None or isinstance(found, NotAvailable):
        return found
    refused = _refused(law, runs, _choice(law, found.chosen), judged)
    if not refused:
        return found
    errors = found.verdict.partition(f": {found.chosen.name} is preferred.")[0]
    why = f"{refused[0].lower()}{refused[1:]}"
    return replace(found, verdict=f"{errors}, but in that form {why} So neither form holds over all of these tests.")


def _refused(law: LawFit, runs: Runs, choice: str, judged: Judged) -> str:
    """Why the law in another form is not to be used; empty where it may be, or where no option gives this form.

    Doubts of the reading are those of every form.
    """
    if not choice:
        return ""
    by = None if law.by is None else law.by.column
    other = computed(partial(fit_in_form, runs, choice, law.response, law.factors, error=law.error, by=by))
    checks = {} if isinstance(other, NotAvailable) else judged(other)
    held = (one for name, one in checks.items() if name != "reading" and isinstance(one, Check))
    return next((one.verdict for one in held if one.concern >= DO_NOT_USE), "")


def _chosen(power: CompetingModel, alternatives: tuple[CompetingModel, ...]) -> CompetingModel:
    better = [model for model in alternatives if model.pvalue * len(alternatives) < SIGNIFICANT]
    return better[0] if better else power


def _verdict(
    response: str,
    unit: str,
    power: CompetingModel,
    alternatives: tuple[CompetingModel, ...],
    chosen: CompetingModel,
) -> str:
    left = f"Leave-one-{unit}-out error of {response}: power law {_percent(power.error)}"
    if not alternatives:
        return f"{left}; no competing model can be fitted to these rows."
    best = alternatives[0] if chosen is power else chosen
    difference = f"difference {best.difference:.2g} ± {best.standard_error:.2g} in ln {response}"
    kept = "the power law is kept" if chosen is power else f"{best.name} is preferred"
    return f"{left}, {best.name} {_percent(best.error)} ({difference}): {kept}."


def _command(law: LawFit, chosen: CompetingModel) -> str:
    """The options that keep a preferred form, or compare it with others where it has none."""
    if chosen.name == "power law":
        return ""
    choice = _choice(law, chosen)
    keep = f"Keep it with --form {law.response}={choice}, or compare" if choice else "Compare"
    return f" {keep} forms with fitmodels compare."


def _choice(law: LawFit, chosen: CompetingModel) -> str:
    """The name of a form as the option ``--form`` takes it; empty where it has none."""
    return next((form.choice for form in alternative_forms(law) if form.name == chosen.name), "")


def _percent(error: float) -> str:
    """An error in logarithms as a share of the response; the largest are not printed."""
    return f"{100 * np.expm1(error):.3g} %" if error < LARGEST else f"more than {100 * np.expm1(LARGEST):.0f} %"


def _alternative(
    form: Form, rows: FormRows, base: Array, codes: Ints, icc: float, zero: FormRows | NotAvailable | None
) -> CompetingModel | NotAvailable:
    """A form fitted and compared with the errors of the power law, or the reason why it is not."""
    fitted = computed(partial(form.fitted, rows))
    if isinstance(fitted, NotAvailable):
        return fitted
    errors = prediction_errors(fitted, codes)
    if isinstance(errors, NotAvailable):
        return errors
    return replace(_compared(fitted, errors, base, codes, icc), zero_wear=_at_zero(form, zero))


def _at_zero(form: Form, rows: FormRows | NotAvailable | None) -> ZeroWear | None:
    """A form fitted with the rows at zero wear, and its error there when edges (rows) are left out."""
    if not form.zero_wear or not isinstance(rows, FormRows):
        return None
    fitted = computed(partial(form.fitted, rows))
    if isinstance(fitted, NotAvailable):
        return None
    codes = np.arange(len(rows.y)) if rows.edge is None else np.unique(rows.edge, return_inverse=True)[1]
    errors = prediction_errors(fitted, codes if codes.max() else np.arange(len(rows.y)))
    if isinstance(errors, NotAvailable):
        return None
    return ZeroWear(int(rows.zero.sum()), float(np.sqrt(np.mean(errors[rows.zero] ** 2))), fitted.coefficients)


def _zero_words(law: LawFit, models: tuple[CompetingModel, ...], rows: FormRows | NotAvailable | None) -> str:
    """A sentence on the rows at zero wear, where there are any."""
    wear = wear_of(law)
    if rows is None:
        return ""
    if isinstance(rows, NotAvailable):
        return f" No form has the rows at {wear} = 0: {rows.reason}."
    n = int(rows.zero.sum())
    first = f" {count(n, 'row')} at {wear} = 0, where a power of {wear} is zero,"
    held = [(model.zero_wear.error, model.name) for model in models if model.zero_wear is not None]
    if not held:
        return f"{first} {'are' if n > 1 else 'is'} in none of these forms."
    error, name = min(held)
    predicted = f"{'are' if n > 1 else 'is'} predicted by the form {name}"
    return f"{first} {predicted} with an error of {100 * np.expm1(error):.3g} %."


def not_comparable(law: LawFit) -> str | None:
    """Reason why a law has no competing models, or None."""
    if law.form != "power":
        return f"competing models are those of a power law, and this is of the form {law.form.replace('_', ' ')}"
    if law.rows is None:
        return NO_ROWS
    if (law.observed <= 0).any():
        return f"{law.response} is zero or negative in some rows: models are compared in its logarithm"
    return no_scatter(law)


def prediction_errors(fit: FittedForm, codes: Ints) -> Array | NotAvailable:
    """Prediction error of each row when its unit is left out, shape (n,), in ln R.

    With Q = columns L orthonormal, leaving unit g out moves theta by ``-L (I - Q_g'Q_g)^-1 Q_g' rest_g``.
    """
    try:
        L = np.linalg.cholesky(linear(fit.columns, fit.rest).cov_unscaled)
    except (FitError, np.linalg.LinAlgError):
        return NotAvailable("its columns are nearly linearly dependent in these rows, which rounding does not resolve")
    Q = fit.columns @ L
    if int(codes.max()) + 1 == len(codes):
        left = 1.0 - np.einsum("ij,ij->i", Q, Q)
        if left.min() < ALONE:
            return NotAvailable("one row alone determines one of its parameters: measure near it again")
        return np.asarray(fit.residuals + np.einsum("ij,ij->i", fit.Z @ L, Q) * fit.rest / left)
    missed = fit.residuals.copy()
    order = np.argsort(codes, kind="stable")
    units = np.split(order, np.searchsorted(codes[order], np.arange(1, int(codes.max()) + 1)))
    left = np.eye(Q.shape[1]) - np.stack([Q[rows].T @ Q[rows] for rows in units])
    if np.linalg.eigvalsh(left)[:, 0].min() < ALONE:
        return NotAvailable("one edge alone determines one of its parameters: test another edge near its conditions")
    moves = np.linalg.solve(left, np.stack([Q[rows].T @ fit.rest[rows] for rows in units])[:, :, None])[:, :, 0]
    for rows, move in zip(units, moves, strict=True):
        missed[rows] += fit.Z[rows] @ (L @ move)
    return missed


def _whitened(errors: Array, codes: Ints, icc: float) -> Array:
    """Errors less the part of the mean of their unit that rows of one unit share, shape (n,)."""
    m = np.bincount(codes)
    part = 1 - np.sqrt((1 - icc) / (1 - icc + m * icc))
    return np.asarray(errors - (part * np.bincount(codes, weights=errors) / m)[codes])


def _compared(fit: FittedForm, missed: Array, base: Array, codes: Ints, icc: float) -> CompetingModel:
    """Error as root mean square, and its difference from that of the power law."""
    error = float(np.sqrt(np.mean(missed**2)))
    return CompetingModel(fit.name, fit.formula, fit.coefficients, error, *paired_difference(missed, base, codes, icc))


def paired_difference(missed: Array, base: Array, codes: Ints, icc: float) -> tuple[float, float, float]:
    """Root mean square of whitened errors less that of others, its standard error over units, and one-sided p.

    Parameters
    ----------
    missed, base : ndarray, shape (n,)
        Prediction errors of the same rows.
    codes : ndarray of int, shape (n,)
        Number of the unit of each row.
    icc : float
        Intraclass correlation by which both are whitened.
    """
    from scipy.special import stdtr

    n, G = len(codes), int(codes.max()) + 1
    missed, base = _whitened(missed, codes, icc), _whitened(base, codes, icc)
    own, power = float(np.sqrt(np.mean(missed**2))), float(np.sqrt(np.mean(base**2)))
    by_unit = np.bincount(codes, weights=missed**2 - base**2)
    about = by_unit - np.bincount(codes) * by_unit.sum() / n
    scatter = float(np.sqrt(G / (G - 1) * np.sum(about**2))) / n
    t = float(by_unit.sum()) / (n * scatter) if scatter > 0 else 0.0
    return own - power, scatter / (own + power), float(stdtr(G - 1, t))
