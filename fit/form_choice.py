"""Forms of a law that a user can choose by name, the fit of a law in one of them, and its AICc on one scale."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from ..core.arrays import Array, Ints
from ..core.display import Displayable
from ..core.errors import FitError, UsageError
from ..core.suggestions import did_you_mean
from ..datasets import Runs
from ..datasets.vocabulary import ROLES
from .available import NotAvailable
from .censored_lives import life_law, lives_of
from .checks.strata import LIFE, units_of
from .edges import changes_within
from .kienzle import FORCES, kienzle_law
from .lawfit import LawFit
from .laws import Error
from .regression import fit_form, load_law
from .rows import SELECTED, LeftOut

ICCS = np.concatenate([[0.0], np.linspace(0.02, 0.98, 49)])  # shares of the variance between edges
REDUCED = "second-order-reduced"
TIME = "t"
FEEDS = ("f", "fz", "fm")
WEAR_LAST = ("power_exponential", "additive_wear")  # forms in which the last factor enters as it is
Unsuited = Callable[[str, tuple[str, ...]], str]  # reason why a form is none of a response on factors, or ""
Fit = Callable[[Runs, str, tuple[str, ...], Error, str | None], LawFit]


@dataclass(frozen=True, slots=True, repr=False)
class FormChoice(Displayable):
    """A form that can be chosen.

    Attributes
    ----------
    name : str
        As the option ``--form`` takes it, e.g. ``second-order``.
    equation : str
        General equation of a response R on factors X, of which w is the wear.
    form : str
        Key of ``core.formula.FORMS`` of its laws.
    unsuited : callable
        Reason why it is no form of a response on factors; empty where it is one.
    fitted : callable
        Fits it.
    """

    name: str
    equation: str
    form: str
    unsuited: Unsuited
    fitted: Fit


def wear_among(factors: tuple[str, ...]) -> str | None:
    """The wear among factors.

    >>> wear_among(("V", "f", "AW"))
    'AW'
    """
    return next((name for name in factors if name in ROLES and ROLES[name].kind == "wear"), None)


def _any(response: str, factors: tuple[str, ...]) -> str:
    return ""


def _of_wear(response: str, factors: tuple[str, ...]) -> str:
    wear = wear_among(factors)
    if wear is None:
        return f"it is a form of a load on wear, and no wear is among the factors {', '.join(factors)}"
    return "" if len(factors) > 1 else f"it needs a factor besides {wear}"


def _of_load(response: str, factors: tuple[str, ...]) -> str:
    if response not in ROLES or ROLES[response].kind != "load":
        return f"it is a form of loads, and {response} is none"
    feed_and_wear = len(factors) == 2 and factors[0] in FEEDS and factors[1] == wear_among(factors)
    return "" if feed_and_wear else f"its factors are a feed and a wear, not {', '.join(factors)}"


def _of_chip(response: str, factors: tuple[str, ...]) -> str:
    if response in (*FORCES, "M", "P"):
        return ""
    return f"it is a form of cutting forces, torque and power, and {response} is none"


def _of_life(response: str, factors: tuple[str, ...]) -> str:
    if response != LIFE:
        return f"it is the form of tool lives T, and {response} is none"
    return "" if "V" in factors else "it needs the cutting speed V among the factors"


def _of_lives(response: str, factors: tuple[str, ...]) -> str:
    return "" if response == LIFE else f"it is a law of tool lives T, and {response} is none"


def _weibull(runs: Runs, response: str, factors: tuple[str, ...], error: Error, by: str | None) -> LawFit:
    """The law of Weibull lives, run-outs among them."""
    if error != "multiplicative":
        raise FitError(f"{response}: Weibull lives have multiplicative errors. Leave --error out.")
    return life_law(runs, factors, "weibull", by=by)


def _of(form: str) -> Fit:
    """The fit of a form of the table of formulas; a wear that enters as it is stands last."""

    def fitted(runs: Runs, response: str, factors: tuple[str, ...], error: Error, by: str | None) -> LawFit:
        if response == LIFE:
            _refuse_bounds(runs, form)
        wear = wear_among(factors) if form in WEAR_LAST else None
        lost = 0 if wear is None else _at_time_zero(runs, response, factors, wear)
        rest = (name for name in factors if name != wear and not (lost and name == TIME))
        ordered = (*rest, *([wear] if wear else []))
        law = fit_form(runs, form, response, ordered, error=error, by=by)
        if not lost:
            return law
        why = f"{lost} rows at {TIME} = 0 have no logarithm of it, and {wear} shows what time does"
        note = f"the time {TIME} is left out: {why}"
        return replace(law, notes=(*law.notes, note))

    return fitted


def _at_time_zero(runs: Runs, response: str, factors: tuple[str, ...], wear: str) -> int:
    """Number of rows of new edges, at time zero, that a factor t would leave out."""
    if TIME not in factors or set(factors) == {TIME, wear}:
        return 0
    known = np.isfinite(runs.values(response)) & np.isfinite(runs.values(wear))
    return int(np.count_nonzero(known & (runs.values(TIME) == 0)))


def _power(runs: Runs, response: str, factors: tuple[str, ...], error: Error, by: str | None) -> LawFit:
    """A power law; of tool lives with their run-outs."""
    if response == LIFE and error == "multiplicative":
        return life_law(runs, factors, by=by)
    return _of("power")(runs, response, factors, error, by)


def _reduced(runs: Runs, response: str, factors: tuple[str, ...], error: Error, by: str | None) -> LawFit:
    """Second order in logarithms with the terms that AICc chooses."""
    from .surface.surfaces import response_surface

    if response == LIFE:
        _refuse_bounds(runs, "second_order")
    if error != "multiplicative":
        raise FitError(f"{response}: terms are selected with multiplicative errors. Leave --error out.")
    law = response_surface(runs, response, factors, model="reduced", blocks=by).law
    known = {*law.factors, *(item.factor for item in law.left_out)}
    gone = tuple(LeftOut(name, SELECTED) for name in factors if name not in known)
    return replace(law, left_out=(*law.left_out, *gone))


def _load_line(runs: Runs, response: str, factors: tuple[str, ...], error: Error, by: str | None) -> LawFit:
    """The load line; of another load than the spindle current not the line of feed at a held load."""
    law = load_law(runs, response, feed=factors[0], wear=factors[1])
    if law.form != "load_line" and response != "I":
        raise FitError(f"{response} is held at one value in most rows: measure it at several feeds of one wear.")
    return law


def _kienzle(runs: Runs, response: str, factors: tuple[str, ...], error: Error, by: str | None) -> LawFit:
    """Kienzle's law; a note names the factors that it does not have."""
    if error != "multiplicative":
        raise FitError(f"{response}: Kienzle's law is fitted with multiplicative errors. Leave --error out.")
    law = kienzle_law(runs, response, by=by).law
    without = [name for name in factors if name not in law.factors]
    effects = "its effect is" if len(without) == 1 else "their effects are"
    note = f"Kienzle's law has no {', '.join(without)}: {effects} part of the scatter"
    return replace(law, notes=(*law.notes, note)) if without else law


def _refuse_bounds(runs: Runs, form: str) -> None:
    """Refuse lives of which some are known by a bound alone: only the power law of tool lives counts them."""
    side = lives_of(runs).side
    if np.any(side != 0):
        raise FitError(
            f"{LIFE}: {np.count_nonzero(side)} of {len(side)} lives are run-outs or bounds, which the form "
            f"{form.replace('_', '-')} would count as lives. Keep power or weibull; without these rows the lives of "
            "the law would be too short."
        )


CHOICES: Mapping[str, FormChoice] = {
    one.name: one
    for one in (
        FormChoice("power", "R = c0 prod X^b", "power", _any, _power),
        FormChoice("exponential", "R = a exp(sum b X)", "exponential", _any, _of("exponential")),
        FormChoice("linear", "R = c0 + sum b X", "linear", _any, _of("linear")),
        FormChoice(
            "second-order", "ln R = polynomial of degree 2 in ln X", "second_order", _any, _of("second_order")
        ),
        FormChoice(REDUCED, "second order with the terms that AICc chooses", "second_order", _any, _reduced),
        FormChoice(
            "second-order-original", "R = polynomial of degree 2 in X", "second_order_original", _any,
            _of("second_order_original"),
        ),
        FormChoice(
            "power-exponential", "R = c0 prod X^b exp(k w)", "power_exponential", _of_wear,
            _of("power_exponential"),
        ),
        FormChoice("additive", "R = c0 prod X^b + k w", "additive_wear", _of_wear, _of("additive_wear")),
        FormChoice("load-line", "R = A + B f + k1 w", "load_line", _of_load, _load_line),
        FormChoice("kienzle", "Fc = kc1.1 b h^(1 - mc)", "power", _of_chip, _kienzle),
        FormChoice("taylor", "T = C V^a prod X^b", "power", _of_life, _power),
        FormChoice("weibull", "T = c0 prod X^b, Weibull lives", "power", _of_lives, _weibull),
    )
}  # fmt: skip


def form_named(name: str) -> FormChoice:
    """The form of a name, with - or _ between its words.

    Raises
    ------
    UsageError
        There is none; the message names the closest one.

    Examples
    --------
    >>> form_named("second_order").form
    'second_order'
    """
    known = CHOICES.get(str(name).strip().lower().replace("_", "-").replace(" ", "-"))
    if known is None:
        raise UsageError(f"form {name!r}: there is no such form. {did_you_mean(name, CHOICES, names='Forms: ')}")
    return known


def fit_in_form(
    runs: Runs,
    form: str,
    response: str,
    factors: tuple[str, ...],
    *,
    error: Error = "multiplicative",
    by: str | None = None,
) -> LawFit:
    """The law of a response on factors in a chosen form.

    Raises
    ------
    UsageError
        There is no such form.
    FitError
        It is no form of this response on these factors, or the rows do not allow it.

    Examples
    --------
    >>> from fitmodels import datasets
    >>> runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    >>> fit_in_form(runs, "linear", "Fxz", ("V", "f", "d", "AW")).form
    'linear'
    """
    chosen = form_named(form)
    if reason := chosen.unsuited(response, tuple(factors)):
        raise FitError(f"{response} in the form {chosen.name}: {reason}. Choose another form with --form.")
    return chosen.fitted(runs, response, tuple(factors), error, by)


def aicc(law: LawFit) -> float | NotAvailable:
    """AICc of a law on the scale of its response, with a random level of each edge and a correction for each stratum.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> runs = datasets.read_runs(datasets.bundled("ac2017_table1"))
    >>> round(aicc(fit.power_law(runs, "AW", ["V", "f"])), 2)
    -433.06
    """
    if law.life is not None and not law.life.least_squares:
        k, n = len(law.theta) + 1, law.life.ended
        if n - k - 1 <= 0:
            return NotAvailable(f"{n} lives that ended are too few for AICc of {k - 1} coefficients")
        return float(-2 * law.life.log_likelihood + 2 * k + 2 * k * (k + 1) / (n - k - 1))
    Z, p = free_gradient(law), n_estimated(law)
    codes = units_of(law)[1]
    G, n = int(codes.max()) + 1, law.nobs
    strata = [(n, p)]
    if 1 < G < n:
        within = int(changes_within(law.design, codes).sum())
        strata = [(G, p - within), (n - G, within)]
    else:
        codes = np.arange(n)
    penalty = 0.0
    for m, coefficients in strata:
        k = coefficients + 1
        if m - k - 1 <= 0:
            what = "edges" if len(strata) > 1 and m == G else "rows"
            return NotAvailable(f"{m} {what} are too few for AICc of {coefficients} coefficients")
        penalty += 2 * k + 2 * k * (k + 1) / (m - k - 1)
    jacobian = float(np.log(law.observed).sum()) if law.error == "multiplicative" else 0.0
    return float(penalty - 2 * (log_likelihood(Z, law.residuals, codes) - jacobian))


def n_estimated(law: LawFit) -> int:
    """Number of coefficients that were estimated, and not fixed by the form."""
    return len(law.theta) - len(law.formula.fixed)


def free_gradient(law: LawFit) -> Array:
    """Columns along which the fit is linear, of the estimated coefficients alone, shape (n, q)."""
    return law.gradient[:, law.formula.free(law.shifts.shape[1])]


def log_likelihood(Z: Array, y: Array, codes: Ints) -> float:
    """Largest log-likelihood of ``y = Z b + u_unit + e`` with a normal random level u of each unit.

    Parameters
    ----------
    Z : ndarray, shape (n, p)
    y : ndarray, shape (n,)
    codes : ndarray of int, shape (n,)
        Number of the unit of each row; with one row each the level is left out.
    """
    from scipy.optimize import minimize_scalar

    n, m = len(y), np.bincount(codes)
    both = np.column_stack([Z / np.maximum(np.linalg.norm(Z, axis=0), 1e-300), y])
    means = np.column_stack([np.bincount(codes, weights=column) / m for column in both.T])[codes]

    def negative(icc: float) -> float:
        ratio = icc / (1 - icc)
        turned = both - (1 - 1 / np.sqrt(1 + m * ratio))[codes, None] * means
        left = abs(np.asarray(np.linalg.qr(turned, mode="r"))[-1, -1])
        return float(n * (np.log(left) + np.log(2 * np.pi / n) / 2 + 0.5) + np.log1p(m * ratio).sum() / 2)

    if len(m) == n:
        return -negative(0.0)
    values = [negative(float(icc)) for icc in ICCS]
    i = int(np.argmin(values))
    ends = float(ICCS[max(i - 1, 0)]), float(ICCS[min(i + 1, len(ICCS) - 1)])
    found = minimize_scalar(negative, bounds=ends, method="bounded", options={"xatol": 1e-6})
    return -min(float(found.fun), values[i])
