"""Forms of one law compared on the same rows: left-out edges, weights, and predictions at tested settings.

Every form is fitted as it would be written. Compared are, on the rows that all forms can have,

- the prediction error of each edge (each row, where there are no edges) that the fit has not seen, in per cent (root
  mean square of ln R) and in the unit of the response. Another form than the default is preferred where its error is
  smaller, by more than chance: a test over the edges (`checks.competing_models`), or, where it contains the default
  form, the F test of its squares and products against their own error term, which is the more powerful;
- weights from AICc, on the scale of the response: the log-likelihood of a form fitted to ln R is that of R less
  ``sum ln R`` (Jacobian). The likelihood contains a random level of each edge. Coefficients that change between edges
  only, and those that change within edges, are estimated from separate strata, G edges and n - G rows; each stratum has
  its own correction ``2k + 2k(k + 1) / (m - k - 1)``, k coefficients and a variance, m edges or rows;
- what each form predicts at the middle of the tested ranges, and at the tested settings furthest towards their corners.

Sources: Hurvich & Tsai 1989, Biometrika 76, 297 (AICc); Burnham & Anderson 2002, Model Selection and Multimodel
Inference, sections 2.4, 2.9 and 2.11.3 (weights, change of variable); Hastie, Tibshirani & Friedman 2009, section 7.10.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product

import numpy as np
import pandas as pd

from ..core.arrays import Array, Ints
from ..core.errors import FitError
from ..core.verdict import Verdict
from ..datasets.runs import Readable, Runs, as_runs
from .available import NotAvailable, computed
from .checks.competing_forms import FittedForm
from .checks.competing_models import paired_difference, prediction_errors
from .checks.judgement import judge
from .checks.strata import even_choice, units_of
from .defaults import fit_law
from .edges import EdgeInference
from .form_choice import CHOICES, REDUCED, aicc, fit_in_form, form_named, free_gradient, n_estimated
from .form_comparison import ComparedForm, FormComparison
from .lawfit import LawFit
from .least_squares import linear
from .prediction import interval
from .regression import refitted
from .rows import reference_level

MOST_REFITS = 60  # edges of which each is left out by a new fit; of more, along the gradient
MOST_FACTORS = 5  # whose corners are all looked at: at most 32 settings
SAME = 1e-6  # relative difference of settings that are the same
SELECTED = NotAvailable("its terms were selected by AICc, so that its own is too low")
GRID = 15  # values of a factor between the ends of its range
TURN = 0.02  # share of the response by which it falls and rises again over a factor


def compare_laws(
    runs: Readable, law: LawFit | str, *, forms: Sequence[str] | None = None, factors: Sequence[str] | None = None
) -> FormComparison:
    """Forms of a law fitted to the same rows and compared.

    Parameters
    ----------
    runs : Runs, DataFrame or path
        To which the law was fitted.
    law : LawFit or str
        In its default form, or as it is written: ``"Ra ~ V, f, d"``.
    forms : sequence of str, optional
        Names of the forms to compare with it; by default all that suit its response and factors.
    factors : sequence of str, optional
        Of the other forms; by default those of the law.

    Raises
    ------
    UsageError
        There is no form of such a name.
    FitError
        The law keeps no rows, or meets every row exactly.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    >>> found = compare_laws(runs, "AW ~ V, f, d, t", forms=["linear"])
    >>> found.preferred.name, found.units
    ('power', 24)
    """
    runs = as_runs(runs)
    if isinstance(law, str):
        law = fit_law(runs, law)
    default = _default_name(law)
    asked = tuple(law.factors if factors is None else factors)
    laws: dict[str, LawFit] = {default: law}
    missing: dict[str, NotAvailable] = {}
    for name in map(str, CHOICES if forms is None else forms):
        form_named(name)
        if name == default or (forms is None and CHOICES[name].unsuited(law.response, asked)):
            continue
        by = None if law.by is None else law.by.column
        found = computed(partial(fit_in_form, runs, name, law.response, asked, error=law.error, by=by))
        if isinstance(found, NotAvailable):
            missing[name] = found
        elif _repeats(found, laws.values()):
            if forms is None:
                continue
            missing[name] = NotAvailable("with these factors it is the same law as one above")
        else:
            laws[name] = found
    used = {factor for one in laws.values() for factor in one.factors}
    return _compared(laws, missing, default, tuple(name for name in asked if name in used), runs)


def _default_name(law: LawFit) -> str:
    """Name of the form of a law; its own where it is none that can be chosen."""
    return next((one.name for one in CHOICES.values() if one.form == law.form), law.form.replace("_", "-"))


def _repeats(law: LawFit, others: Iterable[LawFit]) -> bool:
    """Whether a law has as many coefficients and the same fit as another."""
    return any(
        len(law.theta) == len(one.theta) and law.nobs == one.nobs and np.allclose(law.fitted, one.fitted, rtol=1e-9)
        for one in others
    )


@dataclass(frozen=True, slots=True)
class Shared:
    """The rows that all forms have: units left out, and the scale on which their errors are compared."""

    left_out: str
    codes: Ints
    icc: float
    observed: Array
    logs: bool
    runs: Runs

    def missed(self, predicted: Array) -> Array:
        """Prediction errors, shape (n,), in ln R or in the unit of R; none where a logarithm does not exist."""
        if not self.logs:
            return self.observed - predicted
        return np.log(self.observed / predicted) if (predicted > 0).all() else np.empty(0)

    def difference(self, predicted: Array, of: Array) -> tuple[float, float, float]:
        """Error less that of other predictions, its standard error over units and one-sided p."""
        own, other = self.missed(predicted), self.missed(of)
        if not len(own) or not len(other):
            return (np.inf if not len(own) else -np.inf), 0.0, float(bool(not len(own)))
        return paired_difference(own, other, self.codes, self.icc)


def _compared(
    laws: Mapping[str, LawFit], missing: dict[str, NotAvailable], default: str, asked: tuple[str, ...], runs: Runs
) -> FormComparison:
    """The comparison of fitted laws on the rows that all of them have."""
    law = laws[default]
    if law.life is not None and law.life.censored:
        bounds = law.life.run_outs + law.life.earlier
        raise FitError(
            f"{law.response}: {bounds} of {law.nobs} lives are known by a bound alone: errors of prediction do not "
            "exist for these, and without them the longest lives would be missing. fitmodels compare scores such laws "
            "by the likelihood of left-out lives."
        )
    if law.rows is None or law.exact:
        why = "keeps no rows" if law.rows is None else "meets every row exactly, so that there is no scatter"
        raise FitError(f"the law of {law.response} {why}: its forms cannot be compared.")
    lines = np.array(sorted(set(law.lines.tolist()).intersection(*(one.lines.tolist() for one in laws.values()))))
    common = {name: computed(partial(_on_lines, one, lines)) for name, one in laws.items()}
    base = common[default]
    if isinstance(base, NotAvailable):
        raise FitError(f"{law.response}: {base}.")
    left_out, codes = units_of(base)
    if codes.max() == 0:
        left_out, codes = "row", np.arange(base.nobs)
    icc = base.edges.icc if left_out == "edge" and isinstance(base.edges, EdgeInference) else 0.0
    logs = law.error == "multiplicative" and bool((base.observed > 0).all())
    shared = Shared(left_out, codes, icc, base.observed, logs, runs)
    predicted = {name: _left_out(one, codes) for name, one in common.items()}
    full = common.get("second-order")
    if isinstance(predicted.get(REDUCED), np.ndarray) and isinstance(full, LawFit):
        predicted[REDUCED] = _with_selection(full, codes)
    known = {name: found for name, found in predicted.items() if not isinstance(found, NotAvailable)}
    missing |= {name: found for name, found in predicted.items() if isinstance(found, NotAvailable)}
    if default not in known:
        raise FitError(f"{law.response} without one {left_out} cannot be fitted: {missing[default]}.")
    forms = [_form(name, laws[name], common[name], found, known[default], shared) for name, found in known.items()]
    tested = {name: _curvature(full if name == REDUCED and full is not None else common[name], base) for name in known}
    forms = [form if (p := tested[form.name]) is None else replace(form, pvalue=p) for form in forms]
    forms.sort(key=lambda form: (form.error if logs else form.error_in_unit, form.parameters))
    behind = {name: shared.difference(found, known[forms[0].name]) for name, found in known.items()}
    beyond = {name: _beyond(laws[name], lines) for name in known}
    forms = [
        replace(form, behind=behind[form.name][:2], turns=turning_factors(form.law), more_rows=beyond[form.name][0],
                more_error=beyond[form.name][1])
        for form in _weighted(forms)
    ]  # fmt: skip
    found = FormComparison(
        law.response, law.units.get(law.response, ""), asked, default, tuple(forms), missing, left_out,
        int(codes.max()) + 1, base.nobs, logs, pd.DataFrame(),
    )  # fmt: skip
    return replace(found, points=_points(found, runs))


def _on_lines(law: LawFit, lines: Ints) -> LawFit:
    """The law on these lines of the file, and on no more rows than a check uses."""
    keep = np.isin(law.lines, lines)
    return even_choice(law if keep.all() else refitted(law, law.error, keep))


def _left_out(law: LawFit | NotAvailable, codes: Ints) -> Array | NotAvailable:
    if isinstance(law, NotAvailable):
        return law
    if law.nobs != len(codes):
        return NotAvailable("it cannot be fitted to the selection of rows by which the forms are compared")
    return left_out_predictions(law, codes)


def _with_selection(full: LawFit, codes: Ints) -> Array | NotAvailable:
    """Predictions of left-out units where the terms of second order are selected anew without each unit.

    Terms that were selected with the unit would make its prediction look better than that of a new edge.
    """
    from .surface.surfaces import surface_of
    from .surface.term_selection import selected_terms

    out = np.empty(full.nobs)
    for g in range(int(codes.max()) + 1):
        part = computed(partial(refitted, full, full.error, codes != g))
        if isinstance(part, NotAvailable):
            return part
        chosen = selected_terms(part, surface_of(part).model)
        terms = full.formula.terms
        kept = [k for k, term in enumerate(terms, 1) if chosen is None or term.name in chosen.kept]
        columns = [0, *kept, *range(1 + len(terms), len(full.theta))]
        theta = linear(part.design[:, columns], np.log(part.observed)).params
        out[codes == g] = np.exp(full.design[codes == g][:, columns] @ theta)
    return out


def _curvature(law: LawFit | NotAvailable | None, default: LawFit) -> float | None:
    """P of the squares and products of a law of second order that contains the default one; None of other laws.

    All terms of an error term (edges, rows within edges) are tested together, the smaller p of the two is doubled.
    """
    if not isinstance(law, LawFit) or law.formula.first_order or not default.formula.first_order:
        return None
    from .surface.split_plot import error_of, term_tests
    from .surface.surfaces import surface_of

    nested = law.formula.logarithmic == default.formula.logarithmic and law.formula.logs == default.formula.logs
    surface = surface_of(law)
    if not nested or law.factors != default.factors or isinstance(surface.model, NotAvailable):
        return None
    second = [term.name for term in law.formula.terms if term.order == 2]
    groups: dict[str, list[str]] = {}
    for name in second:
        groups.setdefault(error_of(surface.model, surface.terms[name]), []).append(name)
    found = {test.name: test.pvalue for test in term_tests(surface.model, surface.terms, groups=groups)}
    return min(1.0, len(groups) * min(found[name] for name in groups)) if groups else None


def _form(
    name: str, law: LawFit, common: LawFit | NotAvailable, predicted: Array, base: Array, shared: Shared
) -> ComparedForm:
    """A form with its errors on left-out units, its AICc and the verdict of its checks."""
    R, positive = shared.observed, (shared.observed > 0).all()
    wrong = int((predicted <= 0).sum()) if positive else 0
    difference, se, p = (0.0, 0.0, 1.0) if predicted is base else shared.difference(predicted, base)
    return ComparedForm(
        name=name,
        law=law,
        parameters=n_estimated(law),
        error=float(np.sqrt(np.mean(np.log(R / predicted) ** 2))) if positive and not wrong else np.inf,
        error_in_unit=float(np.sqrt(np.mean((R - predicted) ** 2))),
        not_positive=wrong,
        difference=difference,
        standard_error=se,
        pvalue=p,
        aicc=SELECTED if name == REDUCED else common if isinstance(common, NotAvailable) else aicc(common),
        verdict=_verdict(law, shared.runs),
    )


def _verdict(law: LawFit, runs: Runs) -> Verdict | NotAvailable:
    found = computed(partial(judge, law, runs=runs))
    return found if isinstance(found, NotAvailable) else found.verdict


def _weighted(forms: Sequence[ComparedForm]) -> list[ComparedForm]:
    """The forms with weights ``exp(-AICc/2)``, scaled to sum 1."""
    known = [form.aicc for form in forms if isinstance(form.aicc, float)]
    raw = [np.exp((min(known) - f.aicc) / 2) if isinstance(f.aicc, float) else 0.0 for f in forms]
    total = sum(raw) or 1.0
    return [replace(form, weight=float(value / total)) for form, value in zip(forms, raw, strict=True)]


def _beyond(law: LawFit, lines: Ints) -> tuple[int, float | None]:
    """Number of the rows that other forms cannot have, and the prediction error of these when left out."""
    more = ~np.isin(law.lines, lines)
    if not more.any() or law.nobs == len(lines):
        return 0, None
    _, codes = units_of(law)
    predicted = left_out_predictions(law, codes if codes.max() else np.arange(law.nobs))
    error = None if isinstance(predicted, NotAvailable) else float(
        np.sqrt(np.mean((law.observed - predicted)[more] ** 2))
    )  # fmt: skip
    return int(more.sum()), error


def _points(found: FormComparison, runs: Runs) -> pd.DataFrame:
    """Middle and tested settings with what was measured there and what each form predicts."""
    law = found[found.default].law
    settings = corner_settings(law)
    at = pd.DataFrame(np.vstack([[middle(law, name) for name in law.factors], settings]), columns=list(law.factors))
    for name in found.factors:
        if name not in at:
            at[name] = product_of_factors(runs, law, name, at)
    here = [np.all(np.abs(law.X - x) <= SAME * np.abs(x), axis=1) for x in at[list(law.factors)].to_numpy()]
    measured = [float(law.observed[rows].mean()) if rows.any() else np.nan for rows in here]
    out = at.assign(rows=[int(rows.sum()) for rows in here], measured=measured)
    where = {**at, **reference_level(law.by, len(at))}
    for form in found.forms:
        value = computed(partial(form.law.values, where))
        out[form.name] = np.nan if isinstance(value, NotAvailable) else value
    ends = computed(lambda: interval(found.preferred.law, where))
    for name in ("low", "high"):
        out[name] = np.nan if isinstance(ends, NotAvailable) else ends[name].to_numpy()
    return out


def _refitted_predictions(law: LawFit, codes: Ints) -> Array | NotAvailable:
    """Predictions of left-out units by one refit for each."""
    out = np.empty(law.nobs)
    for g in range(int(codes.max()) + 1):
        found = computed(partial(refitted, law, law.error, codes != g))
        if isinstance(found, NotAvailable):
            return found
        out[codes == g] = law.formula.response_at(found.theta, law.design[codes == g])
    return out


def left_out_predictions(law: LawFit, codes: Ints) -> Array | NotAvailable:
    """Predictions of a law for each row when its unit is left out of the fit, shape (n,), in the unit of the response.

    Parameters
    ----------
    law : LawFit
    codes : ndarray of int, shape (n,)
        Number of the unit of each row.
    """
    nonlinear = not law.formula.linearisable or (law.error == "additive" and law.formula.logarithmic)
    if nonlinear and codes.max() < MOST_REFITS:
        return _refitted_predictions(law, codes)
    G = free_gradient(law)
    missed = prediction_errors(FittedForm(law.form, "", {}, G, law.residuals, G, law.residuals), codes)
    if isinstance(missed, NotAvailable):
        return missed
    if law.error == "multiplicative":
        return np.asarray(law.observed * np.exp(-np.clip(missed, -700, 700)))
    return np.asarray(law.observed - missed)


def turning_factors(law: LawFit) -> tuple[str, ...]:
    """Factors over which a law of second order falls and rises again within their range, the others at the middle."""
    if law.formula.first_order:
        return ()
    out = []
    held: dict[str, object] = {name: np.full(GRID, middle(law, name)) for name in law.factors}
    for name in law.factors:
        grid = np.linspace(*law.domain[name], GRID)
        value = law.values({**held, name: grid, **reference_level(law.by, GRID)})
        rise, fall = (np.maximum(sign * np.diff(value), 0).sum() for sign in (1, -1))
        if min(rise, fall) > TURN * np.abs(value).max():
            out.append(name)
    return tuple(out)


def middle(law: LawFit, name: str) -> float:
    """Middle of the range of a factor, the geometric one where it enters by its logarithm."""
    low, high = law.domain[name]
    logs = law.formula.logs[law.factors.index(name)]
    return float(np.sqrt(low * high)) if logs and low > 0 else (low + high) / 2


def corner_settings(law: LawFit) -> Array:
    """Tested settings that lie furthest towards each corner of the ranges, shape (m, k), without repeats."""
    T = np.where(law.formula.logs, np.log(np.where(law.formula.logs, law.X, 1.0)), law.X)
    U = (T - T.min(axis=0)) / np.maximum(np.ptp(T, axis=0), 1e-300) - 0.5
    signs = np.array(list(product((-1.0, 1.0), repeat=min(U.shape[1], MOST_FACTORS))))
    furthest = np.argmax(U[:, : signs.shape[1]] @ signs.T, axis=0)
    return np.asarray(law.X[list(dict.fromkeys(furthest.tolist()))])


def product_of_factors(runs: Runs, law: LawFit, name: str, at: pd.DataFrame) -> Array:
    """A factor that is a product of the factors of the law, at points."""
    x, X = runs.values(name), np.column_stack([runs.values(factor) for factor in law.factors])
    known = (x > 0) & (X > 0).all(axis=1)
    Z = np.column_stack([np.ones(known.sum()), np.log(X[known])])
    b = np.linalg.lstsq(Z, np.log(x[known]), rcond=None)[0]
    return np.asarray(np.exp(b[0] + np.log(at[list(law.factors)].to_numpy()) @ b[1:]))
