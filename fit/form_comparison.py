"""Result of the comparison of forms of one law, and what it says in words."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial

import numpy as np
import pandas as pd

from ..core.arrays import Array
from ..core.display import Displayable, Plottable
from ..core.errors import FitError
from ..core.rounding import count, format_plain
from ..core.verdict import DO_NOT_USE, Verdict
from .available import NotAvailable, computed
from .checks.check import SIGNIFICANT, format_p
from .checks.competing_models import LARGEST
from .lawfit import LawFit
from .rows import reference_level

BEYOND = 0.3  # of the tested range, by which curves of forms go beyond it
HEAVY = 0.95  # weight of a form that is not preferred, from which it is named


@dataclass(frozen=True, slots=True, repr=False)
class ComparedForm(Displayable):
    """One form of a law.

    Attributes
    ----------
    name : str
        As the option ``--form`` takes it.
    law : LawFit
        Of all rows that the form can have.
    parameters : int
        Number of estimated coefficients.
    error : float
        Root mean squared prediction error of left-out units in ln R; infinite where the form predicts zero or less.
    error_in_unit : float
        Root mean squared prediction error of left-out units, in the unit of the response.
    not_positive : int
        Rows for which it predicts zero or less when their unit is left out.
    difference, standard_error : float
        Error less that of the default form with its standard error over units; whitened within edges, in ln R or, for
        additive errors, in the unit of the response.
    pvalue : float
        One-sided p of so low a difference; of a form that contains the default one, p of its squares and products.
    aicc : float or NotAvailable
        On the scale of the response.
    weight : float
        From AICc, 0 where there is none; sum 1 over all forms.
    verdict : Verdict or NotAvailable
        Of all checks of the law.
    behind : tuple of float
        Error less that of the form of lowest error, and the standard error of this difference.
    more_rows : int
        Rows that this form can have and another cannot, such as those at zero wear.
    more_error : float or None
        Root mean squared prediction error of these, in the unit of the response.
    turns : tuple of str
        Factors over which the law falls and rises again within their range, the others at the middle.
    """

    name: str
    law: LawFit
    parameters: int
    error: float
    error_in_unit: float
    not_positive: int
    difference: float
    standard_error: float
    pvalue: float
    aicc: float | NotAvailable
    verdict: Verdict | NotAvailable
    behind: tuple[float, float] = (0.0, 0.0)
    weight: float = 0.0
    more_rows: int = 0
    more_error: float | None = None
    turns: tuple[str, ...] = ()

    @property
    def percent(self) -> float:
        """Prediction error of left-out units in per cent of the response; infinite where it predicts zero or less."""
        return float(100 * np.expm1(self.error)) if self.error < LARGEST else np.inf

    @property
    def forbidden(self) -> str:
        """The first reason not to use its law; empty where its checks do not forbid that."""
        found = self.verdict
        return found.reasons[0] if isinstance(found, Verdict) and found.level == DO_NOT_USE else ""

    @property
    def as_good(self) -> bool:
        """Whether its error is higher than the lowest by no more than the standard error of the difference."""
        return self.behind[0] <= self.behind[1]


@dataclass(frozen=True, slots=True, repr=False)
class FormComparison(Plottable):
    """Forms of one law, compared.

    Attributes
    ----------
    response, unit : str
    factors : tuple of str
    default : str
        Name of the form that is fitted without an option.
    forms : tuple of ComparedForm
        The default and those compared with it, lowest error of left-out units first.
    not_fitted : mapping of str to NotAvailable
        Forms that these rows do not allow.
    left_out : str
        What was left out, ``edge`` or ``row``.
    units, rows : int
        Number of edges (or rows) and of the rows that all forms have.
    logs : bool
        Whether errors are compared in ln R, in per cent; otherwise in the unit of the response.
    points : DataFrame
        The middle of the ranges, then the tested settings furthest towards each of their corners: a column for each
        factor, ``rows`` there, their mean ``measured`` (NaN without any), one column for each form, and ``low`` and
        ``high``, the 95 % interval of the preferred law.
    """

    response: str
    unit: str
    factors: tuple[str, ...]
    default: str
    forms: tuple[ComparedForm, ...]
    not_fitted: Mapping[str, NotAvailable]
    left_out: str
    units: int
    rows: int
    logs: bool
    points: pd.DataFrame = field(compare=False)

    def __getitem__(self, name: str) -> ComparedForm:
        found = next((form for form in self.forms if form.name == name), None)
        if found is None:
            raise KeyError(f"{name}: forms compared are {', '.join(form.name for form in self.forms)}")
        return found

    @property
    def best(self) -> ComparedForm:
        """The form of lowest error."""
        return self.forms[0]

    @property
    def preferred(self) -> ComparedForm:
        """The default form; where others are better by more than chance, the simplest as good as the best of them.

        As good: an error that is higher by no more than the standard error of the difference. A form whose law is not
        to be used is not preferred, unless the reason is that of the default form as well.
        """
        better = [form for form in self._better if not self._refused(form)]
        close = [form for form in better if form.as_good] or better[:1]
        return min(close, key=lambda form: form.parameters, default=self[self.default])

    @property
    def _better(self) -> list[ComparedForm]:
        """Forms that predict better than the default by more than chance."""
        others = len(self.forms) - 1
        return [form for form in self.forms if form.difference < 0 and form.pvalue * others < SIGNIFICANT]

    def _refused(self, form: ComparedForm) -> bool:
        """Whether the checks forbid the law in a form, for another reason than in the default one."""
        return form.forbidden not in ("", self[self.default].forbidden)

    @property
    def supported(self) -> tuple[ComparedForm, ...]:
        """The preferred form, and those that predict as well as the best."""
        preferred = self.preferred
        return tuple(form for form in self.forms if form is preferred or (form.as_good and not self._refused(form)))

    @property
    def verdict(self) -> str:
        """The preferred form with the reason, in a sentence."""
        default, preferred, others = self[self.default], self.preferred, len(self.forms) - 1
        if not others:
            return f"{self.response}: no other form than {self.default} can be fitted to these rows."
        left = f"error of left-out {self.left_out}s"
        if preferred is not default:
            reason = (
                ""
                if preferred is self.best or not preferred.as_good
                else f" as good as the best ({self.best.name}) within chance and simpler,"
            )
            return (
                f"{self.response}: {preferred.name} is preferred:{reason} {left} {self.error_text(preferred)}, against "
                f"{self.error_text(default)} of {default.name} ({format_p(min(1.0, others * preferred.pvalue))}, "
                f"corrected for {count(others, 'form')})."
            )
        if better := self._better:
            return (
                f"{self.response}: {default.name} is kept: {left} {self.error_text(default)}; that of {better[0].name} "
                f"is {self.error_text(better[0])}, but this law is not to be used: "
                f"{better[0].forbidden}"
            )
        best = next(form for form in self.forms if form is not default)
        chance = " by more than chance" if best is self.best else ""
        return (
            f"{self.response}: {default.name} is kept: {left} {self.error_text(default)}; no other form is better"
            f"{chance} (best: {best.name}, {self.error_text(best)})."
        )

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks to know before a form is chosen, one sentence each."""
        return tuple(
            filter(
                None,
                (
                    self._weighty(),
                    self._agreement(),
                    *map(self._of_form, self.forms),
                    self._more_rows(),
                    self._without_weight(),
                ),
            )
        )

    def error_text(self, form: ComparedForm) -> str:
        """The error of a form on left-out units, in per cent where it has one."""
        if not self.logs or not np.isfinite(form.percent):
            return f"{format_plain(form.error_in_unit, 3)} {self.unit}".rstrip()
        return f"{format_plain(form.percent, 3)} %"

    def _weighty(self) -> str:
        """That a form which is not preferred has nearly all of the weight, and no higher error."""
        heavy = max(self.forms, key=lambda form: form.weight)
        if heavy is self.preferred or heavy.weight < HEAVY or heavy.difference > 0 or self._refused(heavy):
            return ""
        return (
            f"{heavy.name} has the weight {heavy.weight:.2f} and a lower error, though not by more than chance: see "
            "its predictions below, and test more settings, or keep it if the process is curved in this way."
        )

    def _agreement(self) -> str:
        """Difference of the supported forms at the tested settings, beside the scatter of one row."""
        names = [form.name for form in self.supported]
        if len(names) < 2:
            return ""
        tested = self.points.iloc[1:]
        values = tested[names]
        spread = (values.max(axis=1) - values.min(axis=1)) / values.abs().min(axis=1)
        worst = int(spread.argmax())
        place = tested.iloc[worst]
        at = ", ".join(f"{name} {format_plain(float(place[name]), 3)}" for name in self.factors)
        ends = " to ".join(format_plain(float(end), 3) for end in (values.iloc[worst].min(), values.iloc[worst].max()))
        ends = f"{ends} {self.unit}".rstrip()
        return (
            f"{', '.join(names)}: their errors differ by no more than chance; at the tested settings below they differ "
            f"by at most {format_plain(100 * float(spread.iloc[worst]), 2)} % ({at}: {ends}), beyond them by more."
        )

    def _of_form(self, form: ComparedForm) -> str:
        """Predictions of a form that cutting contradicts."""
        sentences = []
        if form.not_positive:
            sentences.append(
                f"predicts {self.response} of zero or less for {form.not_positive} of {self.rows} rows when their "
                f"{self.left_out} is left out"
            )
        if form.turns:
            sentences.append(
                f"falls and rises again over {', '.join(form.turns)} within the tested range: does the process?"
            )
        return f"{form.name} {'; it '.join(sentences)}.".replace("?.", "?") if sentences else ""

    def _more_rows(self) -> str:
        """Rows that only some forms can have, such as those at zero wear, and how well these predict them."""
        known = [form for form in self.forms if form.more_rows]
        if not known:
            return ""
        n, none = max(form.more_rows for form in known), [form.name for form in self.forms if not form.more_rows]
        errors = ", ".join(
            f"{form.name} {format_plain(form.more_error, 3)}" for form in known if form.more_error is not None
        )
        rows = "1 further row has" if n == 1 else f"{n} further rows have"
        return (
            f"{rows} values of zero, which {', '.join(none)} cannot take and the table leaves out; errors there when "
            f"left out{f', {self.unit}' if self.unit else ''}: {errors}."
        )

    def _without_weight(self) -> str:
        none = [(form.name, form.aicc.reason) for form in self.forms if isinstance(form.aicc, NotAvailable)]
        return f"No weight: {'; '.join(f'{name} ({why})' for name, why in none)}." if none else ""


@dataclass(frozen=True, slots=True)
class FormCurves:
    """Predictions of forms over one factor, the others at the middle.

    Attributes
    ----------
    label, others : str
        The factor with its unit; the values of the others.
    tested : tuple of float
        Range of the factor among the rows.
    x : ndarray, shape (m,)
    predicted : mapping of str to ndarray, shape (m,)
        By form; NaN where it has no value.
    rows_x, rows_y : ndarray, shape (n,)
        Rows moved to the middle of the other factors along the preferred form.
    """

    label: str
    others: str
    tested: tuple[float, float]
    x: Array
    predicted: Mapping[str, Array]
    rows_x: Array
    rows_y: Array


def predictions_over(found: FormComparison, factor: str | None = None) -> FormCurves:
    """Predictions of the compared forms over a factor, by default the one over which they differ most.

    Raises
    ------
    FitError
        The factor is none of the preferred form.
    """
    law = found.preferred.law
    if factor is None:
        drawn = [predictions_over(found, name) for name in law.factors]
        return max(drawn, key=_spread)
    if factor not in law.factors:
        raise FitError(f"{factor}: it is no factor of {law.response}; its factors are {', '.join(law.factors)}.")
    low, high = law.domain[factor]
    x = np.linspace(max(low - BEYOND * (high - low), low / 2 if low > 0 else 0.0), high + BEYOND * (high - low), 121)
    middle_of = {name: float(found.points[name].iloc[0]) for name in found.factors}
    at = {**_repeated(middle_of, len(x)), factor: x, **reference_level(law.by, len(x))}
    values = {}
    for form in found.forms:
        made = computed(partial(form.law.values, at))
        values[form.name] = np.full(len(x), np.nan) if isinstance(made, NotAvailable) else made
    unit = law.units.get(factor, "")
    held = (f"{k} {v:.3g} {law.units.get(k, '')}".rstrip() for k, v in middle_of.items() if k != factor)
    label = f"{factor} [{unit}]" if unit else factor
    own, moved = _rows_moved(law, factor, {name: middle_of[name] for name in law.factors})
    return FormCurves(label, ", ".join(held), (low, high), x, values, own, moved)


def _rows_moved(law: LawFit, factor: str, middle: Mapping[str, float]) -> tuple[Array, Array]:
    """Values of a factor in the rows, and the observations moved along the law to the middle of the other factors."""
    own = law.X[:, law.factors.index(factor)]
    there = law.values({**_repeated(middle, law.nobs), factor: own, **reference_level(law.by, law.nobs)})
    moved = law.observed * there / law.fitted if law.formula.logarithmic else law.observed + there - law.fitted
    return own, moved


def _repeated(values: Mapping[str, float], n: int) -> dict[str, Array]:
    return {name: np.full(n, value) for name, value in values.items()}


def _spread(drawn: FormCurves) -> float:
    """Largest difference of the forms inside the tested range, relative to the least prediction."""
    inside = (drawn.x >= drawn.tested[0]) & (drawn.x <= drawn.tested[1])
    values = np.array([v[inside] for v in drawn.predicted.values()])
    return float(np.nanmax((np.nanmax(values, axis=0) - np.nanmin(values, axis=0)) / np.nanmedian(np.abs(values))))
