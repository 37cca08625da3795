"""Laws of a parameter file as parts of a card."""

import math

import numpy as np

from ...core.intervals import t_quantile
from ...core.rounding import EXACT, format_plain, format_rounded
from ...core.verdict import DO_NOT_USE
from ...fit.checks.check import BY_EDGE, FAMILY_LEVEL, LEVELS, TITLES, UNTESTABLE, statistic_name
from ...parameters import LawSection, ParameterFile
from ...parameters.sections.base import Covariance, VerdictSection
from ...parameters.sections.law_parts import DroppedRows, LawCheck
from .design import factor_ranges
from .numbers import LEVEL, NONE, count, fact, figure, number, percent, places, probability, spread
from .parts import CheckPart, CoefficientPart, FactPart, LawPart, NumberPart
from .posterior import posterior_of, posterior_part
from .tool_life import fitted_by, lives_words
from .verdicts import law_verdict, suspect_parts, without_words
from .worked import scatter, short_equation, worked_predictions

WIDEST = 100.0  # half width, in ln, of an interval of a constant: a wider one is not informative
WIDE = 5.0  # half width, in ln, from which its ends are rounded each for itself
CONDITIONS = ("V", "n", "f", "fz", "d", "ae")  # usually constant for an edge
STRUCTURES = {"multiplicative": "multiplicative error (log scale)", "additive": "additive error (original scale)"}
AT_LEVEL = (
    f"; of the tests, those are rejected that Holm's procedure rejects at {100 * FAMILY_LEVEL:g} % for all laws of the "
    "file together."
)


def law_part(pf: ParameterFile, law: LawSection) -> LawPart:
    """One law of the file."""
    checks = check_parts(law)
    return LawPart(
        response=law.response,
        quantity=law.quantity,
        unit=law.unit,
        short=short_equation(law),
        equation=law.equation,
        scatter=scatter(law),
        worked=() if refused(law.verdict) else worked_predictions(pf, law),
        form=law.form.replace("_", " "),
        structure=_structure(law),
        verdict=law_verdict(pf, law),
        suspects=suspect_parts(law, pf),
        without_words=without_words(law),
        level=percent(LEVEL),
        statistics=_statistics(law),
        by_edge=_by_edge(law),
        edge_words=_edge_words(law),
        coefficients=law_coefficients(law),
        other_heading="" if law.alternative is None else STRUCTURES[law.alternative.error],
        has_row_se=bool(law.row_standard_errors),
        has_printed=law.published is not None and not _lacking(law),
        has_without=law.without is not None,
        domain=factor_ranges(law.factors, pf.design),
        checks=checks,
        check_words=_check_words(checks) if checks else law.verdicts,
        cautions=tuple(_cautions(law)),
        printed_words=_published_words(law),
        composite_words=_composite_words(law),
        posterior=posterior_part(law, posterior_of(pf, law)),
    )


def refused(verdict: VerdictSection | None) -> bool:
    """Whether a result must not be used: its card predicts nothing with it."""
    return verdict is not None and verdict.concern == DO_NOT_USE


def law_coefficients(law: LawSection, level: float = LEVEL) -> tuple[CoefficientPart, ...]:
    """A line for each coefficient, the constant first and the shifts of a category last.

    The constant of a law that is linear for ln R has no t: it is positive by its form, and its value only depends on
    the units.
    """
    printed = law.published.coefficients if law.published is not None and not _lacking(law) else {}
    other = {} if law.alternative is None else _values(law.alternative)
    without = ({}, {}) if law.without is None else (law.without.coefficients, law.without.standard_errors)
    half = _half_widths(law, level)
    lines = []
    for name, value in _values(law).items():
        se = None if name in law.fixed else law.standard_errors.get(name)
        scale = law.logarithmic and name == next(iter(law.coefficients))
        t = value / se if se and not scale else None
        low, high = _ends(value, half.get(name), se, scale)
        lines.append(
            CoefficientPart(
                name=name,
                estimate=number(value, se),
                se=spread(value, se),
                t=figure(t),
                p=NONE if t is None else probability(_two_sided(t, degrees(law))),
                low=low,
                high=high,
                row_se=NONE if name in law.fixed else spread(value, law.row_standard_errors.get(name)),
                other=number(other.get(name), se),
                printed=figure(printed.get(name), 6),
                without=number(without[0].get(name), without[1].get(name)),
            )
        )
    return tuple(lines)


def check_parts(law: LawSection) -> tuple[CheckPart, ...]:
    """A line for each check; those of edges are left out where the file names no edges."""
    return tuple(
        _check(name, check) for name, check in law.checks.items() if law.n_edges is not None or name not in BY_EDGE
    )


def degrees(law: LawSection) -> int:
    """Degrees of freedom of the law's t."""
    return law.uncertainty.df if isinstance(law.uncertainty, Covariance) else law.df


def about_intervals(pf: ParameterFile) -> str:
    """The inference behind standard errors and intervals, for all laws of a pair."""
    by_edge = [law for law in pf.laws.values() if law.edges is not None and law.edges.reason is None]
    named = any(law.n_edges is not None for law in pf.laws.values())
    if by_edge and isinstance(by_edge[0].uncertainty, Covariance):
        law = by_edge[0]
        others = [law.response for law in pf.laws.values() if law not in by_edge]
        but = f" Those of {', '.join(others)} assume independent rows." if others else ""
        return (
            f"SE, t, p and intervals are cluster-robust by edge: jackknife (CR3) over {law.n_edges} edges, t with "
            f'{degrees(law)} degrees of freedom. R², the overall F, the residual SE and the column "SE, rows '
            f'independent" assume {law.n} independent rows, as published laws do.{but}'
        )
    if pf.laws and all(law.life is not None for law in pf.laws.values()):
        return (
            "Each life is that of an edge of its own. Standard errors, t, p and intervals have as degrees of freedom "
            "the lives that ended less the parameters."
        )
    if not named:
        return (
            "Standard errors, t, p, F and intervals assume independent rows: the file has no edge column. If several "
            "rows come from one edge, the true uncertainty is larger."
        )
    return "Standard errors, t, p, F and intervals assume independent rows."


def _structure(law: LawSection) -> str:
    if not law.logarithmic:
        shape = "polynomial in the original units" if law.form == "second_order_original" else "straight line"
        return f"{shape}, least squares"
    if method := fitted_by(law):
        return f"{STRUCTURES[law.error]}, {method}"
    method = f"least squares of ln {law.response}" if law.error == "multiplicative" else (
        f"nonlinear least squares of {law.response}"
    )  # fmt: skip
    return f"{STRUCTURES[law.error]}, {method}"


def _statistics(law: LawSection) -> tuple[FactPart, ...]:
    """R2, F, residual standard error and counts, as a paper prints them: with independent rows."""
    s, se = law.statistics, law.residual_se
    multiplicative = law.error == "multiplicative"
    scatter = (
        f"about {format_plain(100 * math.expm1(se), 2)} % for one {'row' if law.life is None else 'life'}"
        if multiplicative and se is not None
        else ""
    )
    return (
        *fact("R² by likelihood (Cox-Snell)" if fitted_by(law) else "R²", places(s.r2, 4)),
        *fact("adjusted R²", places(s.r2_adj, 4)),
        *(fact(_f_name(s.F_df), figure(s.F), "assuming independent rows") if s.F is not None else ()),
        *fact("p of F", probability(s.F_p)),
        *fact("residual SE", figure(se, 3, "in ln" if multiplicative else law.unit), scatter),
        *fact("n", count(law.n, "rows" if law.life is None else "lives")),
        *fact("residual df", count(law.df)),
    )


def _by_edge(law: LawSection) -> tuple[FactPart, ...]:
    """Variance components, and the cluster-robust F of the factors that are constant within edges."""
    e = law.edges
    if e is None or e.reason is not None:
        return fact("edges", count(law.n_edges))
    unit = law.unit if law.error == "additive" else "in ln"
    return (
        *fact("edges", count(law.n_edges)),
        *fact("df of t", count(degrees(law))),
        *fact("SD between edges", figure(e.sd_between, 3, unit)),
        *fact("SD within edges", figure(e.sd_within, 3, unit)),
        *fact("intraclass correlation", percent(e.icc, 2)),
        *(
            (
                *fact(f"cluster-robust {_f_name(e.F_df)}", figure(e.F), f"of {', '.join(e.between)}"),
                *fact("p of cluster-robust F", probability(e.F_p)),
                *fact("the same F assuming independent rows", figure(e.row_F)),
            )
            if e.F is not None
            else ()
        ),
    )


def _f_name(df: tuple[int, int] | None) -> str:
    return "F" if df is None else f"F({df[0]}, {df[1]})"


def _check(name: str, check: LawCheck) -> CheckPart:
    title, symbol = TITLES.get(name, name.capitalize()), "statistic" if check.symbol is None else check.symbol
    if check.reason is not None:
        return CheckPart(name=title, verdict=UNTESTABLE, words=check.reason)
    return CheckPart(
        name=title,
        statistic_name=statistic_name(symbol, check.df, check.p),
        statistic=figure(check.statistic, 3) if symbol else NONE,
        p=probability(check.p),
        verdict=LEVELS[min(check.concern, 2)],
        words=check.verdict or "",
    )


def _check_words(checks: tuple[CheckPart, ...]) -> tuple[str, ...]:
    """The count of each result, and the reasons of checks that are not testable."""
    found = {verdict: [check for check in checks if check.verdict == verdict] for verdict in (*LEVELS, UNTESTABLE)}
    reasons: dict[str, list[str]] = {}
    for check in found[UNTESTABLE]:
        reasons.setdefault(check.words, []).append(check.name)
    counts = [f"{len(of)} {name}" + ("s" if name == "warning" and len(of) > 1 else "")
              for name, of in list(found.items())[1:] if of]  # fmt: skip
    return (
        ", ".join([f"{len(found['passed'])} of {len(checks)} checks passed", *counts]) + AT_LEVEL,
        *(f"{', '.join(names)} not testable: {reason}." for reason, names in reasons.items()),
    )


def _edge_words(law: LawSection) -> str:
    """Limits of the inference by edge, where there are any."""
    if law.life is not None:
        return lives_words(law)
    e = law.edges
    if e is None or (e.reason is not None and law.n_edges is None):
        return ""
    if e.reason is not None:
        return f"No inference by edge: {e.reason}."
    known = {*e.between, *law.fixed}
    within = [f.symbol for f in law.factors if f.symbol in CONDITIONS and f.symbol not in known]
    if not within or not law.row_standard_errors:
        return ""
    return (
        f"{', '.join(within)} {'varies' if len(within) == 1 else 'vary'} within edges: if each edge was cut at one "
        "setting only, check the edge column."
    )


def _cautions(law: LawSection) -> list[str]:
    """Meaning of the coefficients where it is not plain, and limitations of the law, one sentence each."""
    out = [_centred(law)] if law.centres else []
    if not isinstance(law.uncertainty, Covariance):
        out.append(f"{law.uncertainty.reason}: there are no residual degrees of freedom to assess the law.")
    if law.fixed:
        given = ", ".join(f"{name} at {value:g}" for name, value in law.fixed.items())
        out.append(f"Fixed by the form and not estimated: the exponent of {given}.")
    elif law.logarithmic and law.alternative is None and not fitted_by(law):
        out.append(
            "No fit with the other error structure: it needs positive responses in all rows and a nonlinear least "
            "squares fit that converges."
        )
    if law.checked_rows is not None and law.checked_rows < law.n:
        out.append(f"The checks used {law.checked_rows} of the {law.n} rows, evenly spaced.")
    out += [f"{item.factor} is left out: {item.reason}." for item in law.left_out]
    out += [_dropped_words(rows) for rows in law.dropped_rows]
    out += [f"{note[0].upper()}{note[1:]}." if not note.endswith(".") else note for note in law.notes if note]
    return out


def _centred(law: LawSection) -> str:
    """Meaning of the coefficients of a law of second order."""
    units = {f.symbol: f.unit for f in law.factors}
    at = ", ".join(f"{name} {value:g} {units[name]}".rstrip() for name, value in law.centres.items())
    kind, by = ("exponent", "ln(factor / this value)") if law.logarithmic else ("slope", "the factor less this value")
    return f"The coefficient of a factor is its {kind} at {at}; the others are those of squares and products of {by}."


def _dropped_words(rows: DroppedRows) -> str:
    lines = ", ".join(map(str, rows.lines)) + (", ..." if rows.count > len(rows.lines) else "")
    where = f" (line{'s' if rows.count > 1 else ''} {lines})" if rows.lines else ""
    return f"{rows.count} row{'s' if rows.count > 1 else ''} left out, {rows.reason}{where}."


def _published_words(law: LawSection) -> str:
    """Deviation of the rows from the published law."""
    p = law.published
    if p is None:
        return ""
    if p.rms_percent is None or p.worst_percent is None:
        printed = ", ".join(f"{name} {format_plain(value, 6)}" for name, value in p.coefficients.items())
        return (
            f"Published ({p.source}): {printed}. The fit is without {', '.join(_lacking(law))}, so neither its "
            "coefficients nor the rows can be compared with the published law one by one."
        )
    return (
        f"Compared with the published law ({p.source}), the {law.n} rows deviate by {p.rms_percent:.2g} % (root mean "
        f"square), at most {p.worst_percent:+.2g} % (line {p.worst_line} of the file)."
    )


def _composite_words(law: LawSection) -> str:
    """The law with its wear substituted by the wear law, exponents with their standard errors."""
    c = law.composite
    if c is None:
        return ""
    shown = []
    for name, value in c.coefficients.items():
        if name != "c0":
            estimate, se = format_rounded(value, c.standard_errors.get(name))
            shown.append(f"{name}^{estimate}" + (f" (SE {se})" if se else ""))
    return (
        f"With {c.wear} substituted by its own law: {law.response} = {c.coefficients['c0']:.6g} {' '.join(shown)}. "
        f"Standard errors: {c.assumption}."
    )


def _lacking(law: LawSection) -> list[str]:
    """Factors of the published law that the fit does without."""
    printed = law.published.coefficients if law.published is not None else {}
    return [name for name in printed if name not in law.coefficients]


def _values(law: LawSection) -> dict[str, float]:
    shifts = {} if law.by is None else {f"{law.by.column}[{k}]": v for k, v in law.by.shifts.items()}
    return {**law.coefficients, **shifts}


def _half_widths(law: LawSection, level: float) -> dict[str, float]:
    """Half width of the interval of each parameter, on the scale of the fit."""
    cov = law.uncertainty
    if not isinstance(cov, Covariance):
        return {}
    q = t_quantile(cov.df, level)
    se = np.sqrt(np.diag(np.array(cov.matrix)))
    return {name.removeprefix("ln "): float(q * s) for name, s in zip(cov.of, se, strict=True)}


def _ends(value: float, half: float | None, se: float | None, is_scale: bool) -> tuple[NumberPart, NumberPart]:
    if half is None or not se or (is_scale and half > WIDEST) or half <= abs(value) * EXACT:
        return NONE, NONE
    if not is_scale:
        return number(value - half, se), number(value + half, se)
    low, high = value * math.exp(-half), value * math.exp(half)
    if half > WIDE:  # the standard error has the decimals of neither end
        return figure(low, 2), figure(high, 2)
    return number(low, se), number(high, se)


def _two_sided(t: float, df: int) -> float:
    from scipy.special import stdtr

    return float(2 * stdtr(max(df, 1), -abs(t)))
