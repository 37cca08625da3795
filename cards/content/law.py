"""Laws of a file as parts of a card: table, the papers' statistics, those by edge, verdicts, domain, posterior."""

import math

from ...core.rounding import format_plain
from ...parameters import LawSection, ParameterFile
from ..facts import cautions, composite_words, edge_words, other_words, published_words, structure_words
from ..posterior_facts import posterior_of
from .coefficients import LEVEL, degrees, lacking, law_coefficients
from .design import factor_ranges
from .numbers import count, fact, figure, percent, places, probability
from .parts import Law, Named
from .posterior import posterior_part


def law_part(pf: ParameterFile, law: LawSection) -> Law:
    """One law of the file."""
    return Law(
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


def statistics(law: LawSection) -> tuple[Named, ...]:
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


def by_edge(law: LawSection) -> tuple[Named, ...]:
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
