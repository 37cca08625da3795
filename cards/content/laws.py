"""Laws and tool life of a parameter file as parts of a card."""

import math

from ...core.rounding import format_plain, format_rounded, p_value
from ...parameters import LawSection, ParameterFile
from ...parameters.sections.base import Covariance
from ...parameters.sections.law_parts import DroppedRows
from .coefficients import LEVEL, degrees, lacking, law_coefficients
from .design import factor_ranges
from .numbers import count, fact, figure, percent, places, probability
from .parts import FactPart, LawPart
from .posterior import posterior_of, posterior_part


def law_part(pf: ParameterFile, law: LawSection) -> LawPart:
    """One law of the file."""
    return LawPart(
        response=law.response,
        quantity=law.quantity,
        unit=law.unit,
        equation=law.equation,
        form=law.form.replace("_", " "),
        structure=structure_words(law),
        level=percent(LEVEL),
        statistics=statistics(law),
        by_edge=by_edge(law),
        edge_words=edge_words(law),
        coefficients=law_coefficients(law),
        other_heading=other_words(law),
        has_row_se=bool(law.row_standard_errors),
        has_printed=law.published is not None and not lacking(law),
        domain=factor_ranges(law.factors, pf.design),
        verdicts=law.verdicts,
        cautions=tuple(cautions(law)),
        printed_words=published_words(law),
        composite_words=composite_words(law),
        posterior=posterior_part(law, posterior_of(pf, law)),
    )


def statistics(law: LawSection) -> tuple[FactPart, ...]:
    """R2, F, residual standard error and counts, as a paper prints them: rows as independent."""
    s, se = law.statistics, law.residual_se
    unit = law.unit if law.error == "additive" else "in ln"
    scatter = "" if law.error == "additive" or se is None else f"one row scatters by about {_share(se)} %"
    free = "" if s.F_df is None else f"on {s.F_df[0]} and {s.F_df[1]} degrees of freedom, rows as independent"
    return (
        *fact("R²", places(s.r2, 4)),
        *fact("R² adjusted", places(s.r2_adj, 4)),
        *(fact("F", figure(s.F), free) if s.F is not None else ()),
        *fact("p of F", probability(s.F_p)),
        *fact("residual SE", figure(se, 3, unit), scatter),
        *fact("n", count(law.n, "rows")),
        *fact("residual degrees of freedom", count(law.df)),
    )


def by_edge(law: LawSection) -> tuple[FactPart, ...]:
    """What the edges say: how the scatter is split, and F of what only edges can tell."""
    e = law.edges
    if e is None or e.reason is not None:
        return fact("edges", count(law.n_edges))
    unit = law.unit if law.error == "additive" else "in ln"
    of = ", ".join(e.between)
    free = "" if e.F_df is None else f"on {e.F_df[0]} and {e.F_df[1]} degrees of freedom"
    return (
        *fact("edges", count(law.n_edges)),
        *fact("degrees of freedom of t", count(degrees(law))),
        *fact("SD between edges", figure(e.sd_between, 3, unit)),
        *fact("SD within edges", figure(e.sd_within, 3, unit)),
        *fact("share of the scatter between edges", percent(e.icc, 2), "intraclass correlation"),
        *(fact(f"F of {of} by edge", figure(e.F), free) if e.F is not None else ()),
        *fact(f"p of F of {of} by edge", probability(e.F_p)),
        *fact(f"F of {of}, rows as independent", figure(e.row_F)),
    )


def _share(se: float) -> str:
    return format_plain(100 * math.expm1(se), 2)


CONDITIONS = ("V", "f", "fz", "d", "ae")  # what is usually set once for an edge


def statistics_line(law: LawSection) -> str:
    """R2, F, residual standard error and count in one line, as a paper prints them."""
    s = law.statistics
    parts = []
    if s.r2 is not None:
        parts.append(f"R² {s.r2:.4f}" + (f" (adjusted {s.r2_adj:.4f})" if s.r2_adj is not None else ""))
    if s.F is not None and s.F_df is not None and s.F_p is not None:
        p = p_value(s.F_p)
        parts.append(f"F({s.F_df[0]}, {s.F_df[1]}) {format_plain(s.F)}, p {p if p[0] == '<' else '= ' + p}")
    if law.residual_se is not None:
        parts.append(residual_words(law))
    edges = "" if law.n_edges is None else f" from {law.n_edges} edge{'s' if law.n_edges != 1 else ''}"
    parts.append(f"n {law.n} rows{edges}")
    return "; ".join(parts)


def residual_words(law: LawSection) -> str:
    """Residual standard error, and what it means for one measurement."""
    se = law.residual_se or 0.0
    if law.error == "additive":
        return f"residual SE {format_plain(se, 3)} {law.unit}"
    return f"residual SE {format_plain(se, 3)} in ln (one row scatters by about {100 * math.expm1(se):.2g} %)"


def structure_words(law: LawSection) -> str:
    """Which fit this is, in words."""
    if law.form in ("load_line", "feed_line"):
        return "straight line, least squares"
    if law.error == "multiplicative":
        return f"errors multiply: least squares of ln {law.response}"
    return f"errors add: least squares of {law.response} itself, started from the fit of its logarithm"


def other_words(law: LawSection) -> str:
    """Heading of the column that holds the other fit."""
    other = law.alternative
    if other is None:
        return ""
    return "natural units" if other.error == "additive" else "log-linear"


def cautions(law: LawSection) -> list[str]:
    """What a reader must know before using the law, one sentence each."""
    out = []
    if not isinstance(law.uncertainty, Covariance):
        out.append(f"{law.uncertainty.reason}: nothing is left over to judge the law by.")
    if law.form in ("power", "exponential") and law.alternative is None:
        out.append(
            "There is no fit with the other error structure beside it: it needs every row above zero, and least "
            "squares in natural units that converges."
        )
    if law.checked_rows is not None and law.checked_rows < law.n:
        out.append(f"The checks were made on an even choice of {law.checked_rows} of the {law.n} rows.")
    out += [f"{item.factor} is left out: {item.reason}." for item in law.left_out]
    out += [_dropped_words(rows) for rows in law.dropped_rows]
    out += [f"{note[0].upper()}{note[1:]}." if not note.endswith(".") else note for note in law.notes]
    return out


def _dropped_words(rows: DroppedRows) -> str:
    lines = ", ".join(map(str, rows.lines)) + (", ..." if rows.count > len(rows.lines) else "")
    where = f" (line{'s' if rows.count > 1 else ''} {lines})" if rows.lines else ""
    return f"{rows.count} row{'s' if rows.count > 1 else ''} left out, {rows.reason}{where}."


def about_intervals(pf: ParameterFile) -> str:
    """What standard errors and intervals stand on, for all laws of a pair."""
    by_edge = [law for law in pf.laws.values() if law.edges is not None and law.edges.reason is None]
    named = any(law.n_edges is not None for law in pf.laws.values())
    if by_edge and isinstance(by_edge[0].uncertainty, Covariance):
        law = by_edge[0]
        others = [law.response for law in pf.laws.values() if law not in by_edge]
        but = f" In {', '.join(others)} they take rows as independent." if others else ""
        return (
            f"SE, t, p and intervals are by edge: the jackknife over {law.n_edges} edges, t with {degrees(law)} "
            "degrees of freedom. R², F and residual SE, and the row SE beside them, are the papers': they take the "
            f"{law.n} rows as independent.{but}"
        )
    if not named:
        return (
            "Standard errors, t, p, F and intervals take rows as independent: the file has no edge column. If "
            "several rows come from one edge, they are less certain than printed here."
        )
    return "Standard errors, t, p, F and intervals take rows as independent."


def published_words(law: LawSection) -> str:
    """How far the rows lie from the printed law."""
    p = law.published
    if p is None:
        return ""
    if p.rms_percent is None or p.worst_percent is None:
        printed = ", ".join(f"{name} {format_plain(value, 6)}" for name, value in p.coefficients.items())
        return (
            f"{p.source} prints {printed}; the fit is without {', '.join(lacking(law))}, so neither its "
            "coefficients nor the rows can be held against the print one by one."
        )
    return (
        f"Beside {p.source}: the {law.n} rows lie off the printed law by {p.rms_percent:.2g} % (root mean "
        f"square), at most by {p.worst_percent:+.2g} % (line {p.worst_line} of the file)."
    )


def edge_words(law: LawSection) -> str:
    """What the edges say of the law: where the scatter lies, and what the papers' F is worth."""
    e = law.edges
    if e is None:
        return ""
    if e.reason is not None:
        return "" if law.n_edges is None else f"No inference by edge: {e.reason}."
    parts = [f"{100 * (e.icc or 0):.0f} % of the scatter lies between edges"]
    if e.F is not None and e.F_df is not None and e.F_p is not None and e.row_F is not None:
        p = p_value(e.F_p)
        parts.append(
            f"F of {', '.join(e.between)} is {format_plain(e.F)} by edge (df {e.F_df[0]}, {e.F_df[1]}; p "
            f"{p if p[0] == '<' else '= ' + p}), and {format_plain(e.row_F)} if rows were independent, "
            f"{format_plain(e.row_F / e.F, 2)} times as much"
        )
    held = [f.symbol for f in law.factors if f.symbol in CONDITIONS and f.symbol not in e.between]
    if held and law.row_standard_errors:
        change, are = ("changes", "is") if len(held) == 1 else ("change", "are")
        parts.append(
            f"{', '.join(held)} {change} within edges and {are} told there: if an edge was cut at one setting only, "
            "look at the edge column"
        )
    return "; ".join(parts) + "."


def composite_words(law: LawSection) -> str:
    """The law with wear put in from its own law, exponents with their standard errors."""
    c = law.composite
    if c is None:
        return ""
    shown = []
    for name, value in c.coefficients.items():
        if name != "c0":
            estimate, se = format_rounded(value, c.standard_errors.get(name))
            shown.append(f"{name}^{estimate}" + (f" (SE {se})" if se else ""))
    return (
        f"With {c.wear} put in from its own law: {law.response} = {c.coefficients['c0']:.6g} {' '.join(shown)}. The "
        f"standard errors assume {c.assumption}."
    )


def life_equation(pf: ParameterFile) -> str:
    """The tool-life law, to the digits one computes with."""
    life = pf.tool_life
    if life is None:
        return ""
    c0, *exponents = life.coefficients.items()
    return " ".join([f"T = {c0[1]:.6g}", *(f"{name}^{value:.6g}" for name, value in exponents)])


def life_words(pf: ParameterFile) -> str:
    """Tool life at the middle of the ranges, and whether anybody has waited that long."""
    life = pf.tool_life
    if life is None:
        return ""
    at = ", ".join(f"{name} {value:.3g}" for name, value in life.typical_at.items())
    place = f"At the middle of the ranges ({at})" if at else "At these conditions"
    where = f"{place} T is {format_plain(life.typical, 3)} {life.unit}"
    if life.typical <= life.t_observed:
        return f"{where}; the longest test ran {format_plain(life.t_observed, 3)} {life.unit}."
    return (
        f"{where}, but the longest test ran {format_plain(life.t_observed, 3)} {life.unit}: beyond it this is an "
        "extrapolation, not a measurement."
    )
