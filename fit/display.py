"""Display of the results of this package: one registered function per class."""

from typing import Any

import numpy as np
import pandas as pd

from ..core.display import Display, TextTable, display_of, estimates, joined_facts
from ..core.rounding import decimals, format_plain, p_value, with_error, with_unit
from .available import NotAvailable
from .bootstrap import EdgeBootstrap
from .checks.check import LEVELS, UNTESTABLE, Check, check_table, line_of_check
from .checks.competing_models import CompetingModels
from .checks.gauge_error import GaugeFit
from .checks.judgement import Judgement
from .checks.robust_fit import RobustFit
from .composite_law import Composite
from .confirmation import Confirmation
from .edges import EdgeInference
from .form_comparison import FormComparison
from .lawfit import LawFit
from .least_squares import LinearFit
from .life import ToolLife
from .published import PublishedComparison
from .region import DesignRegion

LARGE = 1e7  # from here on a number is shown with its power of ten
SHORT = ("usable", "reservations", "do not use")
FORMS_SHOWN, POINTS_SHOWN = 4, 8  # forms and settings in the table of predictions
ERRORS = {"multiplicative": "multiplicative errors (log scale)", "additive": "additive errors (original scale)"}


def equation(law: "LawFit") -> str:
    """The law with its coefficients, each rounded by its standard error."""
    params, bse = law.params, law.bse
    c = [_rounded(float(v), float(s)) for v, s in zip(params, bse, strict=True)][: len(law.formula.names)]
    left = with_unit(law.response, law.units.get(law.response, ""))
    return f"{left} = {law.formula.equation(c)}"


@display_of.register
def of_law(law: LawFit) -> Display:
    """Equation, R2, residual standard error and rows; inference, F and the coefficients with their intervals."""
    se, ends = law.scale_se, law.conf_int()
    rows = f"{law.nobs} rows" + ("" if law.n_edges is None else f" of {law.n_edges} edges")
    scatter = f"residual SE {format_plain(se, 3)} {law.scale_unit}".rstrip() if se is not None else str(law.no_interval)
    more = {"t": [_number(v) for v in law.tvalues], "p": [p_value(float(v)) for v in law.pvalues]}
    facts = [("form", f"{law.form.replace('_', ' ')}, {ERRORS[law.error]}"), ("standard errors", inference(law))]
    if law.fvalue is not None:
        facts.append(("F test", f_test(law)))
    left_out = [f"Left out: {item.factor}, {item.reason}." for item in law.left_out]
    return Display(
        f"{equation(law)}, R2 {law.rsquared:.3f}, {scatter}, {rows}",
        tuple(facts),
        estimates(law.names, law.params, law.bse, list(ends["low"]), list(ends["high"]), more=more),
        (*left_out, *law.notes),
    )


def inference(law: LawFit) -> str:
    """The inference that standard errors, t, p and intervals stand on, with its degrees of freedom."""
    if isinstance(law.edges, EdgeInference):
        return f"cluster-robust by edge (CR3), df {law.df}"
    return f"rows assumed independent, df {law.df} ({law.edges.reason})"


def f_test(law: LawFit) -> str:
    """F of the factors: cluster-robust where inference is by edge, with that of independent rows."""
    if isinstance(law.edges, EdgeInference) and law.edges.fvalue is not None and law.edges.row_fvalue is not None:
        between = [name for name, within in zip(law.edges.names[1:], law.edges.within[1:], strict=True) if not within]
        return (
            f"cluster-robust F({law.edges.f_df}, {law.edges.df}) = {format_plain(law.edges.fvalue, 3)} of "
            f"{', '.join(between)}; assuming independent rows it would be {format_plain(law.edges.row_fvalue, 4)}"
        )
    return f"F({law.df_model}, {law.df_resid}) = {format_plain(law.fvalue or 0.0, 4)}, rows assumed independent"


@display_of.register
def of_linear(fit: LinearFit) -> Display:
    """Rows, R2 and residual standard error; the coefficients."""
    names = [f"x{j}" for j in range(len(fit.params))]
    head = f"{len(names)} coefficients from {fit.nobs} rows, R2 {fit.rsquared:.3f}"
    return Display(f"{head}, residual SE {format_plain(fit.scale**0.5)}", table=estimates(names, fit.params, fit.bse))


@display_of.register
def of_edges(edges: EdgeInference) -> Display:
    """Edges, share of the variance between them, what repeated rows did to F; the standard errors."""
    grew = (
        ""
        if edges.inflation is None
        else f", F of independent rows {format_plain(edges.inflation, 3)} times the cluster-robust F"
    )
    grid = TextTable(("", "se by edge", "estimated from"), tuple(
        (name, format_plain(float(se), 2), "differences within edges" if within else "differences between edges")
        for name, se, within in zip(edges.names, edges.bse, edges.within, strict=True)
    ))  # fmt: skip
    return Display(
        f"{edges.n_edges} edges, df {edges.df}, {edges.icc:.0%} of the variance between edges{grew}", (), grid
    )


@display_of.register
def of_bootstrap(found: EdgeBootstrap) -> Display:
    """Number of refits, the interval of each coefficient, and estimates of an exponent that disagree."""
    ends = found.interval()
    lost = f", {found.impossible} resamples did not identify the law" if found.impossible else ""
    grid = estimates(found.names, found.draws.mean(axis=0), found.bse, list(ends["low"]), list(ends["high"]))
    compared = found.agreement
    words = (compared.verdict,) if isinstance(compared, Check) and compared.concern else ()
    return Display(f"{len(found.draws)} refits to edges resampled with replacement{lost}", (), grid, sentences=words)


@display_of.register
def of_life(life: ToolLife) -> Display:
    """Life as an equation, at the middle of the tests, and Taylor's n."""
    c0, *powers = life.coefficients.items()
    shown = " ".join([format_plain(float(c0[1])), *(f"{name}^{format_plain(float(k), 3)}" for name, k in powers)])
    head = f"{life.wear} reaches {life.criterion:g} {life.unit_of_wear} after T [{life.unit}] = {shown}"
    at = joined_facts((name, format_plain(value)) for name, value in life.typical_at.items())
    facts = [
        (f"at {at}", f"{format_plain(life.typical, 3)} {life.unit}"),
        ("longest test", f"{life.t_observed:g} {life.unit}"),
    ]
    if life.taylor_n is not None:
        facts.append(("Taylor's n", format_plain(life.taylor_n, 3)))
    errors = [None] * len(life.coefficients) if life.bse is None else list(life.bse)
    grid = estimates([str(name) for name in life.coefficients.index], life.coefficients, errors)
    return Display(f"{head}; {format_plain(life.typical, 3)} {life.unit} at {at}", tuple(facts), grid)


@display_of.register
def of_checks(found: Judgement) -> Display:
    """The verdict with its reasons; each check with its statistic, p and level; corrections; what was not tested."""
    lines = [line_of_check(name, check) for name, check in found.checks.items()]
    levels = [level for *_, level in lines]
    counts = ", ".join(f"{n} {level}" for level in (*LEVELS, UNTESTABLE) if (n := levels.count(level)))
    verdict = found.verdict
    corrections = tuple(f"Corrected with --correct {one.correction!r}." for one in found.suspects if one.correction)
    missing = tuple(text for text in found.verdicts() if text.startswith("Not testable"))
    without = () if found.without is None else (f"Without the suspects: {display_of(found.without).head}.",)
    table = check_table(lines)
    head = f"{verdict.mark.icon} {verdict.words}: {len(lines)} checks on {found.nobs} rows, {counts}"
    return Display(head, (), table, (*verdict.reasons, *corrections, *without, *missing))


@display_of.register(RobustFit)
@display_of.register(GaugeFit)
def of_refit(fit: RobustFit | GaugeFit) -> Display:
    """The verdict; both fits side by side."""
    errors = np.sqrt(np.diag(fit.law.covariance()))
    plainly = [with_error(float(v), float(s)) for v, s in zip(fit.law.theta, errors, strict=True)]
    again = [with_error(float(v), float(s)) for v, s in zip(fit.theta, fit.bse, strict=True)]
    rows = tuple(zip(fit.law.theta_names, plainly, again, strict=True))
    return Display(fit.verdict, (), TextTable(("", "least squares", "this fit"), rows))


@display_of.register
def of_composite(found: Composite) -> Display:
    """The verdict and the law without its wear."""
    return Display(
        found.verdict, (), estimates(found.names, found.theta, found.bse), (f"It assumes {found.assumption}.",)
    )


@display_of.register
def of_confirmation(found: Confirmation) -> Display:
    """The verdict; each edge."""
    return Display(found.verdict, (), of_frame(found.edges))


@display_of.register
def of_domain(domain: DesignRegion) -> Display:
    """The range of each factor."""
    logs, centre, half = np.array(domain.logs), np.array(domain.centre), np.array(domain.half_range)
    low, middle, high = (
        np.where(logs, np.exp(np.where(logs, x, 0.0)), x) for x in (centre - half, centre, centre + half)
    )
    shown = [
        (format_plain(float(a), 4), format_plain(float(m), 4), format_plain(float(b), 4))
        for a, m, b in zip(low, middle, high, strict=True)
    ]
    names = list(zip(domain.factors, domain.units, strict=True))
    head = ", ".join(f"{x} {a} to {b} {u}".rstrip() for (x, u), (a, _, b) in zip(names, shown, strict=True))
    rows = tuple((with_unit(x, u), *ends) for (x, u), ends in zip(names, shown, strict=True))
    radius = (("largest coded radius", format_plain(domain.largest_radius, 3)),)
    return Display(f"{domain.response} was tested at {head}", radius, TextTable(("", "low", "middle", "high"), rows))


@display_of.register
def of_beside(found: PublishedComparison) -> Display:
    """The printed law and how far the rows lie from it."""
    law = joined_facts((name, format_plain(value)) for name, value in found.coefficients.items())
    far = "" if found.rms_percent is None else f"; rows deviate by {format_plain(found.rms_percent, 3)} % (rms)"
    if found.worst_percent is not None:
        far += f", at most {format_plain(found.worst_percent, 3)} % (line {found.worst_line})"
    return Display(f"{found.source}: {law}{far}")


@display_of.register
def of_forms(found: CompetingModels) -> Display:
    """The verdict; each model with its prediction error."""
    rows = tuple(
        (form.name, format_plain(form.error, 3), format_plain(form.difference, 2), format_plain(form.standard_error, 2))
        for form in (found.power, *found.alternatives)
    )
    words = tuple(f"{name}: {reason}." for name, reason in found.not_fitted)
    return Display(
        found.verdict, (), TextTable(("", f"leave-one-{found.unit}-out RMS error", "difference", "se"), rows), words
    )


@display_of.register
def of_form_comparison(found: FormComparison) -> Display:
    """The preferred form; each form with its errors, weight and verdict; remarks."""
    return Display(found.verdict, (), forms_table(found), found.remarks)


def forms_table(found: FormComparison) -> TextTable:
    """Each form: coefficients, errors of left-out units, weight, prediction at the middle, result of its checks."""
    unit = f", {found.unit}" if found.unit else ""
    header = ("form", "coefficients", "error, %", f"error{unit}", "weight", f"middle{unit}", "checks")
    rows = []
    for form in found.forms:
        percent = (
            format_plain(form.percent, 3)
            if np.isfinite(form.percent)
            else "predicts <= 0"
            if form.not_positive
            else "-"
        )
        verdict = "not judged" if isinstance(form.verdict, NotAvailable) else SHORT[form.verdict.level]
        weight = f"{form.weight:.2f}" if isinstance(form.aicc, float) else "-"
        at = _plain(float(found.points[form.name].iloc[0]))
        rows.append((form.name, str(form.parameters), percent, _plain(form.error_in_unit), weight, at, verdict))
    return TextTable(header, tuple(rows))


def predictions_table(found: FormComparison) -> TextTable:
    """The middle of the ranges, then tested settings: what was measured and what forms predict there.

    Of many settings those where the forms differ most; of many forms the preferred one and those of lowest error. The
    last column is the interval of the preferred form.
    """
    names = list(dict.fromkeys((found.preferred.name, found.default, *(form.name for form in found.forms))))
    names = [form.name for form in found.forms if form.name in names[:FORMS_SHOWN]]
    values = found.points[names]
    spread = (values.max(axis=1) - values.min(axis=1)) / values.abs().min(axis=1)
    shown = sorted(spread.iloc[1:].nlargest(POINTS_SHOWN).index)
    rows = []
    for i in (0, *shown):
        place = found.points.loc[i]
        at = [_plain(float(place[name]), 4) for name in found.factors]
        ends = [_plain(float(place[end])) for end in ("low", "high") if np.isfinite(place[end])]
        measured = _plain(float(place["measured"])) if place["rows"] else ""
        rows.append((*at, measured, *(_plain(float(place[name])) for name in names), " to ".join(ends)))
    return TextTable((*found.factors, "measured", *names, f"95 % of {found.preferred.name}"), tuple(rows))


def _plain(value: float, digits: int = 3) -> str:
    """A number to so many digits, large ones without a power of ten."""
    text = format_plain(value, digits)
    return f"{float(text):.0f}" if "e+" in text and abs(value) < LARGE else text


def of_frame(frame: "pd.DataFrame", most: int = 12) -> TextTable:
    """A frame as a grid of plain numbers, its first rows where it is long."""
    rows = tuple(
        (str(name), *(_cell(value) for value in row))
        for name, row in zip(frame.index[:most], frame.head(most).itertuples(index=False), strict=True)
    )
    return TextTable(("", *map(str, frame.columns)), rows)


def _cell(value: Any) -> str:  # noqa: ANN401
    return format_plain(float(value)) if isinstance(value, float) else str(value)


def _number(value: float) -> str:
    return format_plain(value, 3) if np.isfinite(value) else ""


def _rounded(value: float, se: float) -> str:
    """A number to the decimals of its standard error, to four digits where that is unknown or zero."""
    places = decimals(se) if np.isfinite(se) and se > 1e-5 * abs(value) else 7
    return format_plain(value) if not 0 <= places <= 6 or abs(value) < se else f"{value:.{places}f}"
