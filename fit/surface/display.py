"""Display of response surfaces and canonical analyses: tables, verdicts and reservations."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from ...core.display import Display, TextTable, display_of, joined_facts
from ...core.rounding import count, format_plain, with_error
from ..available import NotAvailable
from ..checks.check import SIGNIFICANT, format_p
from ..checks.exponent_ranges import usual_exponents
from ..checks.model_checks import LackOfFit
from ..edges import EdgeInference
from .canonical import SIDES, CanonicalAnalysis, Side
from .split_plot import EDGES, WITHIN, EdgeModel, TermTest, error_mean_square
from .surfaces import ResponseSurface
from .term_selection import TermSelection

FEW_DF = 5.0  # degrees of freedom of an error term below which a test finds large effects alone


def _canonical_words(found: CanonicalAnalysis | NotAvailable) -> str:
    return f"No canonical analysis: {found}." if isinstance(found, NotAvailable) else found.verdict


@display_of.register
def of_surface(surface: ResponseSurface) -> Display:
    """Terms with their tests; error terms, lack of fit, slopes; verdict, reservations and the canonical analysis."""
    law, full, chosen = surface.law, surface.full, surface.selection
    rows = f"{law.nobs} rows" + ("" if law.n_edges is None else f" of {law.n_edges} edges")
    terms = f"{len(law.formula.terms)} terms" + ("" if chosen is None else " kept")
    scale = "ln " if law.formula.logarithmic else ""
    head = f"{scale}{law.response} of second order in {', '.join(full.factors)}, {terms}, R2 {law.rsquared:.3f}, {rows}"
    canonical = surface.canonical()
    shown = isinstance(surface.model, EdgeModel)
    sentences = [
        verdict_of(surface), *reservations(surface), *_selection_words(chosen),
        _canonical_words(canonical),
        *(f"Left out: {item.factor}, {item.reason}." for item in law.left_out),
        *(f"{count(item.count, 'row')} left out: {item.reason}." for item in law.dropped),
        *law.notes,
    ]  # fmt: skip
    return Display(head, tuple(_facts(surface)), _table(surface) if shown else None, tuple(sentences))


@display_of.register
def of_canonical(found: CanonicalAnalysis) -> Display:
    """Verdict; curvatures with their intervals and directions; lowest and highest response in the tested region."""
    names = tuple(f"{name} (coded)" for name in found.factors)
    rows = tuple(
        (f"curvature {j + 1}", *(format_plain(float(v), 3) for v in (value, low, high)),
         *(f"{q:+.2f}" for q in found.directions[:, j]))
        for j, (value, low, high) in enumerate(zip(found.eigenvalues, found.low, found.high, strict=True))
    )  # fmt: skip
    facts = [(f"{side} in the tests", _point(found, side)) for side in SIDES]
    if found.held:
        facts.append(("held", joined_facts((name, format_plain(value, 3)) for name, value in found.held.items())))
    table = TextTable(("", "estimate", "95 % low", "high", *names), rows)
    return Display(found.verdict, tuple(facts), table)


def _point(found: CanonicalAnalysis, side: Side) -> str:
    best = found.best(side)
    if best is None:
        return "no point of its path lies in the tested region"
    at = joined_facts((name, format_plain(float(best[name]), 3)) for name in found.factors)
    value = f"{format_plain(float(best[found.response]), 3)} {found.unit}".rstrip()
    return f"{found.response} {value} at {at}"


def verdict_of(surface: ResponseSurface) -> str:
    """Whether squares and products are needed, all of them counted together (Holm 1979)."""
    if isinstance(surface.model, NotAvailable):
        return f"The terms are not tested: {surface.model}."
    second = second_order_tests(surface)
    if not second:
        return "The surface has no squares or products."
    holding, (smallest, corrected) = _holm(second)
    n = f"of {len(second)} squares and products, counted together," if len(second) > 1 else ""
    if not holding and len(second) == 1:
        return f"Second order is not needed: {smallest.name} does not hold ({format_p(smallest.pvalue)})."
    if not holding:
        return (
            f"Second order is not needed: {n} none holds (smallest p of {smallest.name}, {format_p(smallest.pvalue)}, "
            f"Holm-corrected {format_p(corrected)})."
        )
    named = ", ".join(
        f"{one.name} (F({one.df:g}, {format_plain(one.df_error, 3)}) = {format_plain(one.fvalue, 3)}, "
        f"{format_p(one.pvalue)})"
        for one in holding
    )
    hold = f"{named} hold{'s' if len(holding) == 1 else ''}"
    if surface.full.selected:
        return f"Of the terms that AICc kept, {hold}; on the rows that chose them p-values are too small, no evidence."
    return " ".join(["Second order is needed:", *filter(None, [n]), f"{hold}."])


def second_order_tests(surface: ResponseSurface) -> list[TermTest]:
    """Tests of the squares and products of the full surface."""
    second = {term.name for term in surface.full.formula.terms if term.order == 2}
    return [test for test in surface.tests() if test.name in second]


def _holm(tests: Sequence[TermTest]) -> tuple[list[TermTest], tuple[TermTest, float]]:
    """Tests that hold when all are counted together, and the smallest p with its correction."""
    ordered = sorted(tests, key=lambda test: test.pvalue)
    holding = []
    for at, test in enumerate(ordered):
        if test.pvalue * (len(tests) - at) >= SIGNIFICANT:
            break
        holding.append(test)
    return holding, (ordered[0], min(1.0, ordered[0].pvalue * len(tests)))


def reservations(surface: ResponseSurface) -> list[str]:
    """Reservations about the surface: few degrees of freedom, tests that disagree, slopes, impossible values."""
    signs = {name: one.sign for name, one in usual_exponents(surface.law.response, surface.law.factors).items()}
    slopes = surface.local_exponents()
    found = [text for name in slopes.index if (text := _slope_words(surface, str(name), signs.get(str(name), 0)))]
    return [
        *_independent(surface), *_few_edges(surface), *_confounded_squares(surface), *_disagreement(surface), *found,
        *_not_positive(surface), *_lack_words(surface),
    ]  # fmt: skip


def _independent(surface: ResponseSurface) -> list[str]:
    """Rows that are taken as independent because no edge is known."""
    law = surface.law
    if isinstance(law.edges, EdgeInference) or law.no_interval:
        return []
    reason = f"{law.edges}."
    if law.edge is None or law.n_edges == law.nobs:
        return [reason[0].upper() + reason[1:]]
    return [f"Intervals of the law take rows as independent, and are too narrow: {reason}"]


def _confounded_squares(surface: ResponseSurface) -> list[str]:
    """A square that stands for those of other factors, as in two levels with a centre point."""
    law = surface.full
    kept = [term.name for term in law.formula.terms if max(term.degrees) == 2]
    gone = [out for out in law.left_out if out.factor.endswith("^2")]
    found = []
    for name in kept:
        others = [out.factor for out in gone if f" {name}" in out.reason.replace("(", "( ")]
        if others:
            found.append(
                f"{name} stands for {', '.join([name, *others])} together: these tests show a curvature but not of "
                "which factor; add tests at the ends of each range with the others at their middle."
            )
    return found


def _few_edges(surface: ResponseSurface) -> list[str]:
    model = surface.model
    if isinstance(model, NotAvailable) or not model.n_edges or model.df_between >= FEW_DF:
        return []
    return [
        f"{model.n_edges} edges leave {model.df_between} degrees of freedom between edges: the tests of what changes "
        "between edges find very large effects only; cut more edges before dropping or trusting such a term."
    ]


def _disagreement(surface: ResponseSurface) -> list[str]:
    """Terms within edges that hold against rows and not by edge: edges that differ in their course over time."""
    law, model = surface.full, surface.model
    if isinstance(model, NotAvailable) or not isinstance(law.edges, EdgeInference):
        return []
    table = surface.anova()
    inner = table[(table["error"] == WITHIN) & (table["p"] < SIGNIFICANT) & (table["p by edge"] >= SIGNIFICANT)]
    if inner.empty:
        return []
    named = ", ".join(
        f"{name} ({format_p(row['p'])}, by edge {format_p(row['p by edge'])})" for name, row in inner.iterrows()
    )
    return [
        f"{named}: significant against rows within edges but not by edge, as where edges differ in their course over "
        "time; take the p by edge."
    ]


def _slope_words(surface: ResponseSurface, name: str, sign: int) -> str:
    """A slope that changes its sign, or has the wrong one, over the tests."""
    low, high = surface.local_exponents().loc[[name]].to_numpy(dtype=float)[0]
    law = surface.law
    wrong = sign and (sign * low < 0 or sign * high < 0)
    if not wrong and not low < 0 < high:
        return ""
    kind = (
        "exponent"
        if law.formula.logarithmic
        else f"slope [{law.units.get(law.response, '')}/({law.units.get(name, '')})]"
    )
    text = f"Over the tests the {kind} of {name} runs from {format_plain(low, 2)} to {format_plain(high, 2)}"
    if not wrong:
        return f"{text}: {law.response} rises with {name} at some of them and falls at others."
    must = "rise" if sign > 0 else "fall"
    return (
        f"{text}, though {law.response} must {must} with {name} in cutting: there the surface follows scatter; use the "
        "power law, or fewer terms."
    )


def _not_positive(surface: ResponseSurface) -> list[str]:
    law, canonical = surface.law, surface.canonical()
    if law.formula.logarithmic or not (law.observed > 0).all():
        return []
    lowest = float(law.fitted.min())
    if isinstance(canonical, CanonicalAnalysis) and (best := canonical.best("lowest")) is not None:
        lowest = min(lowest, float(best[law.response]))
    if lowest > 0:
        return []
    value = f"{format_plain(lowest, 3)} {law.units.get(law.response, '')}".rstrip()
    return [
        f"The surface predicts {law.response} down to {value} inside the tested region, though all measured values are "
        "above zero: use scale='log'."
    ]


def _lack_words(surface: ResponseSurface) -> list[str]:
    found = surface.lack_of_fit
    if isinstance(found, NotAvailable):
        return [f"Lack of fit is not tested: {found}."]
    return [found.verdict] if found.concern else []


def _selection_words(found: TermSelection | None) -> list[str]:
    if found is None:
        return []
    near = f"; {count(found.close, 'other set')} of terms within 2 of it" if found.weights else ""
    full = format_plain(found.aicc_full, 5) if np.isfinite(found.aicc_full) else "none, as they leave too few tests"
    return [
        f"AICc {format_plain(found.aicc, 5)}, of all terms {full}{near}. AICc keeps terms "
        "that improve predictions, which need not be significant."
    ]


def _errors_of_strata(model: EdgeModel) -> list[tuple[str, str]]:
    if not model.n_edges:
        return []
    return [("error between edges", _error_text(model, EDGES)), ("error within edges", _error_text(model, WITHIN))]


def _facts(surface: ResponseSurface) -> list[tuple[str, str]]:
    model, law, lack = surface.model, surface.law, surface.lack_of_fit
    facts = [("effect", "by the term alone, from the centre of the tests to its farthest value")]
    if isinstance(surface.full.edges, EdgeInference):
        facts.append(("by edge", "p of the inference by edge of the law (CR3)"))
    facts += [] if isinstance(model, NotAvailable) else _errors_of_strata(model)
    facts += [("lack of fit", lack.result)] if isinstance(lack, LackOfFit) else []
    unit = "exponent" if law.formula.logarithmic else "slope"
    for name, ends in surface.local_exponents().iterrows():
        low, high = (format_plain(float(end), 2) for end in ends)
        facts.append((f"{unit} of {name} over the tests", low if low == high else f"{low} to {high}"))
    return facts


def _error_text(model: EdgeModel, error: str) -> str:
    df = model.df_between if error == EDGES else model.df_within
    return f"mean square {format_plain(error_mean_square(model, error), 3)}, {df} degrees of freedom"


def _table(surface: ResponseSurface) -> TextTable:
    """Coefficient, change from the centre to the end of the range, error term, F and p of each term.

    Kept narrow: with two columns more it does not fit a terminal of 100 characters.
    """
    law, table, chosen = surface.full, surface.anova(), surface.selection
    unit = "%" if law.formula.logarithmic else law.units.get(law.response, "")
    header = ["term", "coefficient", f"effect {unit}".rstrip(), "error", "df", "F", "p"]
    columns = [_cells(surface, str(name), row) for name, row in table.iterrows()]
    if "p by edge" in table:
        header = [*header, "by edge"]
        columns = [[*cells, _p_cell(float(p))] for cells, p in zip(columns, table["p by edge"], strict=True)]
    if chosen is not None:
        header = [*header, "AICc"]
        columns = [[*cells, _kept_cell(surface, chosen, cells[0])] for cells in columns]
    return TextTable(tuple(header), tuple(map(tuple, columns)))


def _cells(surface: ResponseSurface, name: str, row: "pd.Series[Any]") -> list[str]:
    """Name, coefficient, effect, error term, degrees of freedom, F and p of one test."""
    b, se, df, df_error = (float(row[key]) for key in ("estimate", "se", "df", "df_error"))
    coefficient = with_error(b, se) if np.isfinite(se) else ""
    error = "within" if row["error"] == WITHIN else str(row["error"])
    tested = (f"{df:g}, {format_plain(df_error, 3)}", format_plain(float(row["F"]), 3), _p_cell(float(row["p"])))
    return [name, coefficient, _effect(surface, name), error, *tested]


def _kept_cell(surface: ResponseSurface, chosen: TermSelection, name: str) -> str:
    own = {term.name for term in surface.full.formula.terms}
    return "" if name not in own else "kept" if name in chosen.kept else "out"


def _p_cell(p: float) -> str:
    """A p-value without its letter; empty where there is none."""
    return format_p(p).removeprefix("p ").removeprefix("= ") if np.isfinite(p) else ""


def _effect(surface: ResponseSurface, name: str) -> str:
    """Change by a term alone from the centre to the far ends of the ranges: per cent, or the unit of the response."""
    law = surface.full
    term = next((one for one in law.formula.terms if one.name == name), None)
    if term is None:
        return ""
    U = law.formula.transformed(law.X)
    reach = float(np.prod(np.abs(U).max(axis=0) ** np.array(term.degrees)))
    change = float(law.params[name]) * reach
    return f"{100 * np.expm1(change):+.3g}" if law.formula.logarithmic else f"{change:+.3g}"
