"""Fitted laws and tool lives as sections of the parameter file, number for number, with the checks of the laws."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import ValidationError

from ...core.errors import FitError, ParameterError, UsageError
from ...datasets.vocabulary import FLANK_WEAR, ROLES
from ..messages import schema_message
from ..sections.base import VerdictSection
from ..sections.law import LawSection
from ..sections.law_parts import CompositeLaw
from .lives import finite, known, life_fields, runs_of

if TYPE_CHECKING:
    from ...datasets import Runs
    from ...fit import LawFit
    from ...fit.bayes.posterior import Posterior
    from ...fit.checks.check import Check
    from ...fit.checks.judgement import Judgement
    from ...fit.gram_by_edge import EdgeTriangle

WITHOUT_ROWS = (
    "region not available: a stream keeps no rows to compute the region from; each factor has its range instead",
    "smearing not available: residuals need the law first and a stream is read once; the value of the law is a median",
    "additive errors not available: least squares on the original scale takes several passes and a stream is read once",
)


def laws_by_response(
    laws: "Sequence[LawFit]",
    tool: str,
    work: str,
    gauge_sd: float | None,
    runs: "Runs | None" = None,
    posteriors: Sequence["Posterior"] = (),
) -> dict[str, LawSection]:
    """Sections of laws by response, judged together; ``runs`` are those that the laws were fitted to.

    A wear law is substituted into the others where both keep their rows.
    """
    found: dict[str, LawSection] = {}
    for law in laws:
        if law.response in found:
            raise ParameterError(f"there are two laws of {law.response}; a parameter file holds one for each response.")
        posterior = next((one for one in posteriors if one.response == law.response), None)
        section = law_section(law, tool, work, gauge_sd, runs=runs_of(law, runs), posterior=posterior, laws=len(laws))
        found[law.response] = _with_composite(section, law, laws)
    return found


def _with_composite(section: LawSection, law: "LawFit", laws: "Sequence[LawFit]") -> LawSection:
    """The section with the wear law substituted, where there is one and both keep their rows."""
    wear = next((w for w in laws if w.response in FLANK_WEAR and w.response in law.factors), None)
    if wear is None or law.rows is None or wear.rows is None:
        return section
    made, notes = _optional({"composite": partial(_composite, law, wear)})
    return section.model_copy(update={**made, "notes": (*section.notes, *notes)})


def _composite(law: "LawFit", wear: "LawFit") -> CompositeLaw | None:
    from ...fit import composite

    try:
        found = composite(law, wear)
    except UsageError:  # another unit or another category: nothing to put in
        return None
    se = {name: value for name, value in finite(found.bse).items() if name in found.params}
    return CompositeLaw(
        wear=wear.response,
        coefficients={str(name): float(value) for name, value in found.params.items()},
        standard_errors=se,
        assumption=found.assumption,
    )


def law_section(
    law: "LawFit",
    tool: str = "",
    work: str = "",
    gauge_sd: float | None = None,
    *,
    runs: "Runs | None" = None,
    posterior: "Posterior | None" = None,
    laws: int = 1,
) -> LawSection:
    """The section of a fitted law of this tool and work; what needs the rows is left out for a law of a stream.

    ``runs`` are those that it was fitted to, and ``posterior`` is compared with it; ``laws`` is the number of laws that
    are judged together.

    Raises
    ------
    ParameterError
        The fit holds values that the schema refuses, an infinite coefficient for one.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> table = datasets.read_runs(datasets.bundled("gc435_709m40")).data
    >>> section = law_section(fit.streamed_power_law([table[:60], table[60:]], "AW", ["V", "f", "d", "t"]))
    >>> round(float(section.values(V=100.0, f=0.2, d=2.0, t=10.0)), 3), section.n_edges, section.region is None
    (0.169, 24, True)
    """
    from ...fit import judge
    from ...fit.available import NotAvailable, computed

    data = fitted_fields(law)
    if law.rows is None:
        data |= judged_fields(judge(law, runs=runs, laws=laws))
        data |= {"sums": sums_of(law)}
        data["notes"] += WITHOUT_ROWS
    else:
        other = computed(lambda: law.alternative)
        known_other = None if isinstance(other, NotAvailable) else other
        judged = partial(judge, law, gauge_sd, runs=runs, alternative=known_other, laws=laws)
        made, notes = _optional(
            {
                "checks": lambda: judged_fields(_compared(judged(), law, posterior)),
                "region": lambda: _region(law),
                "sums": lambda: sums_of(law),
                "published": lambda: _published(law, tool, work),
                "alternative": lambda: None if known_other is None else fitted_fields(known_other),
            }
        )
        data |= (made.pop("checks") or {}) | made
        data["notes"] += notes
        if isinstance(other, NotAvailable):
            data["notes"].append(f"additive errors not available: {other}")
    try:
        return LawSection.model_validate(data)
    except ValidationError as error:
        raise ParameterError(f"the law of {law.response} cannot be written: {schema_message(error, data)}.") from None


def sums_of(law: "LawFit") -> dict[str, Any]:
    """The rows of a law as sums by edge, or the reason why there are none."""
    from ...fit import NotAvailable
    from ...fit.gram_by_edge import edge_triangles

    found = edge_triangles(law)
    if isinstance(found, NotAvailable):
        return {"reason": found.reason}
    return {"columns": (*law.theta_names[1:], law.response), "edges": [edge_sums(one) for one in found]}


def edge_sums(triangle: "EdgeTriangle") -> dict[str, Any]:
    """The triangle of an edge as its section."""
    root = [row[i:].tolist() for i, row in enumerate(triangle.root)]
    return {
        "edge": triangle.edge,
        "batch": triangle.batch,
        "rows": triangle.rows,
        "mean": triangle.mean.tolist(),
        "moves": triangle.moves,
        "root": root,
    }


def _optional(parts: Mapping[str, Callable[[], Any]]) -> tuple[dict[str, Any], list[str]]:
    """Parts of a section by name, None for one whose computation fails; and a note with the reason of each of these."""
    from ...fit.available import NotAvailable, computed

    found = {name: computed(make) for name, make in parts.items()}
    failed = {name: value for name, value in found.items() if isinstance(value, NotAvailable)}
    notes = [f"{name} not available: {reason}" for name, reason in failed.items()]
    return {name: None if name in failed else value for name, value in found.items()}, notes


def disagreement(law: "LawFit", posterior: "Posterior | None") -> "dict[str, Check]":
    """The concern of a posterior by its key: a prior that contradicts the tests, or exponents that disagree.

    Of several causes of disagreement the prior is known, so that the others are not named. Empty where there is none.
    """
    from ...fit.available import NotAvailable, computed
    from ...fit.checks.agreement import contradicting_prior, posterior_agreement

    for key, check in (("priors", contradicting_prior), ("agreement", posterior_agreement)):
        found = None if posterior is None else computed(partial(check, law, posterior))
        if found is not None and not isinstance(found, NotAvailable) and found.concern:
            return {key: found}
    return {}


def _compared(found: "Judgement", law: "LawFit", posterior: "Posterior | None") -> "Judgement":
    """The judgement with the concern of the posterior, a prior that contradicts the tests before all others."""
    checks = disagreement(law, posterior)
    first = {} if "agreement" in checks else checks
    return replace(found, checks={**first, **found.checks, **checks}) if checks else found


def fitted_fields(law: "LawFit") -> dict[str, Any]:
    """Fields of the section that every fit has."""
    params = {str(name): float(value) for name, value in law.params.items()}
    return {
        "form": law.form,
        "response": law.response,
        "quantity": quantity_of(law.response),
        "unit": law.units[law.response],
        "equation": _equation(law),
        "error": law.error,
        "coefficients": {name: params[name] for name in law.formula.names},
        "factors": [_factor(law, symbol) for symbol in law.factors],
        **_formula_fields(law),
        "life": life_fields(law),
        "by": _by(law, params),
        "uncertainty": _uncertainty(law),
        "residual_se": known(law.scale_se),
        "residual_scale": law.scale_unit,
        "n": int(law.nobs),
        "df": int(law.df_resid),
        "n_edges": law.n_edges,
        "statistics": _statistics(law),
        "standard_errors": finite(law.bse),
        "row_standard_errors": finite(law.row_bse) if law.edges else {},
        "left_out": [{"factor": out.factor, "reason": out.reason} for out in law.left_out],
        "dropped_rows": [{"reason": d.reason, "count": int(d.count), "lines": list(d.lines)} for d in law.dropped],
        "notes": list(law.notes),
        "smearing": _smearing(law, "new" if law.edges else "independent rows"),
        "edges": _edges(law),
    }


def _formula_fields(law: "LawFit") -> dict[str, Any]:
    """Terms and centres of a law of second order, and coefficients that are fixed."""
    formula = law.formula
    powers = ({x: d for x, d in zip(formula.factors, term.degrees, strict=True) if d} for term in formula.terms)
    terms = [{"name": term.name, "powers": of} for term, of in zip(formula.terms, powers, strict=True)]
    centres = dict(zip(formula.factors, formula.centres, strict=False))
    return {"terms": terms, "centres": centres, "fixed": dict(formula.fixed)}


def _edges(law: "LawFit") -> dict[str, Any]:
    """Inference by edge, or the reason why there is none."""
    from ...fit import NotAvailable

    edges = law.edges
    if isinstance(edges, NotAvailable):
        return {"reason": edges.reason}
    F = known(edges.fvalue)
    return {
        "between": [name for name, within in zip(edges.names[1:], edges.within[1:], strict=True) if not within],
        "F": F,
        "F_df": None if F is None else (edges.f_df, edges.df),
        "F_p": known(edges.f_pvalue),
        "row_F": known(edges.row_fvalue),
        "sd_between": edges.mixed.sd_between,
        "sd_within": edges.mixed.sd_within,
        "icc": edges.icc,
        "random_level": dict(zip(edges.names, edges.mixed.bse.tolist(), strict=True)),
        "rows_per_edge": edges.rows_per_edge,
        "df_between": edges.df_between,
        "df_within": edges.df_within,
        "smearing_within": _smearing(law, "same"),
    }


def _smearing(law: "LawFit", of: str) -> float | None:
    from ...fit.prediction import smearing

    return (
        known(smearing(law, of))
        if law.error == "multiplicative" and law.rows is not None and not law.not_least_squares
        else None
    )


def _by(law: "LawFit", params: Mapping[str, float]) -> dict[str, Any] | None:
    if law.by is None:
        return None
    shifts = {str(level): params[f"{law.by.column}[{level}]"] for level in law.by.levels}
    return {"column": law.by.column, "reference": str(law.by.reference), "shifts": shifts}


def _uncertainty(law: "LawFit") -> dict[str, Any]:
    if law.cov_theta is None:
        return {"kind": "none", "reason": law.no_interval or "the fit gives no covariance"}
    cov = np.asarray(law.covariance(), dtype=np.float64)
    return {
        "kind": "covariance",
        "method": "jackknife by edge (CR3)" if law.edges else "rows taken as independent",
        "of": list(law.theta_names),
        "matrix": ((cov + cov.T) / 2).tolist(),  # symmetric to the last bit, as no product of factors is
        "df": int(law.df),
    }


def _statistics(law: "LawFit") -> dict[str, Any]:
    F = known(law.fvalue)
    return {
        "r2": known(law.rsquared),
        "r2_adj": known(law.rsquared_adj),
        "F": F,
        "F_df": None if F is None else (int(law.df_model), int(law.df_resid)),
        "F_p": known(law.f_pvalue),
    }


def _region(law: "LawFit") -> dict[str, Any] | None:
    try:
        found = law.region
    except FitError:  # too few settings to span a region
        return None
    names = ("logs", "centre", "half_range", "largest_radius", "levels", "spaces")
    return {name: value for name, value in found.facts().items() if name in names}


def judged_fields(found: "Judgement") -> dict[str, Any]:
    """Fields of the section of a law that its judgement gives."""
    from ...fit import NotAvailable

    checks = {
        name: {"reason": check.reason} if isinstance(check, NotAvailable) else check_fields(check)
        for name, check in found.checks.items()
    }
    return {
        "verdict": VerdictSection.of(found.verdict).model_dump(),
        "checks": checks,
        "verdicts": found.verdicts(),
        "checked_rows": found.nobs,
        "without": _without(found),
    }


def check_fields(check: "Check") -> dict[str, Any]:
    """Fields of one check."""
    return {
        "null": check.null,
        "symbol": check.symbol,
        "statistic": known(check.statistic),
        "df": check.df,
        "p": known(check.pvalue),
        "concern": check.concern,
        "verdict": check.verdict,
        "suspects": [
            {**asdict(one), "lines": [int(line) for line in one.lines], "correction": one.correction}
            for one in check.suspects
        ],
    }


def _without(found: "Judgement") -> dict[str, Any] | None:
    """The law fitted again without its suspects, None where there are none or it cannot be fitted."""
    if (other := found.without) is None:
        return None
    return {
        "edges": list(dict.fromkeys(str(edge) for suspect in found.suspects for edge in suspect.edges)),
        "lines": sorted({int(line) for suspect in found.suspects if not suspect.edges for line in suspect.lines}),
        "coefficients": finite(other.params),
        "standard_errors": finite(other.bse),
        "residual_se": known(other.scale_se),
        "r2": known(other.rsquared),
        "n": int(other.nobs),
        "n_edges": other.n_edges,
    }


def _published(law: "LawFit", tool: str, work: str) -> dict[str, Any] | None:
    from ...fit.published import compare_published

    found = compare_published(law, tool, work)
    return None if found is None else asdict(found)


def _equation(law: "LawFit") -> str:
    """The equation with its numbers at six digits: at the reference level, then the factor or shift of each level."""
    params = dict(law.params)
    right = law.formula.equation([f"{float(params[name]):.6g}" for name in law.formula.names])
    text = f"{law.response} = {right}"
    if law.by is None:
        return text
    levels = [_level(law, level, float(params[f"{law.by.column}[{level}]"])) for level in law.by.levels]
    return "; ".join([f"{text} for {law.by.column} {law.by.reference}", *levels])


def _level(law: "LawFit", level: str, shift: float) -> str:
    if law.formula.logarithmic:
        return f"times {math.exp(shift):.6g} for {level}"
    return f"{'minus' if shift < 0 else 'plus'} {abs(shift):.6g} for {level}"


def _factor(law: "LawFit", symbol: str) -> dict[str, Any]:
    """One factor: symbol, words, unit, and its range among the rows used."""
    low, high = law.domain[symbol]
    ends = {"low": float(low), "high": float(high)}
    return {"symbol": symbol, "quantity": quantity_of(symbol), "unit": law.units[symbol], **ends}


def quantity_of(symbol: str) -> str:
    """Meaning of a symbol in words; the symbol itself where it is unknown."""
    role = ROLES.get(symbol)
    return role.quantity if role is not None else symbol
