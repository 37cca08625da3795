"""Fitted laws become law sections, number for number, with what judged them."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import ValidationError

from ..errors import ParameterError, in_words
from ..evaluate import coefficient_names
from ..sections.law import Law
from ..sections.law_parts import Composite
from .law_facts import equation, factor, finite, known, quantity_of

if TYPE_CHECKING:
    from ...fit import LawFit, StreamedLaw, ToolLife


def laws_by_response(
    laws: "Sequence[LawFit | StreamedLaw]", tool: str, work: str, gauge_sd: float | None
) -> dict[str, Law]:
    """Sections of laws by response; one of wear is put into the others, where both were fitted to rows in memory."""
    from ...fit import StreamedLaw

    found: dict[str, Law] = {}
    whole = [law for law in laws if not isinstance(law, StreamedLaw)]
    for law in laws:
        if law.response in found:
            raise ParameterError(f"there are two laws of {law.response}; a parameter file holds one for each response.")
        if isinstance(law, StreamedLaw):
            from .streamed import streamed_section

            found[law.response] = streamed_section(law)
            continue
        section = law_section(law, tool, work, gauge_sd)
        wear = next((w for w in whole if w.response in ("AW", "VB") and w.response in law.factors), None)
        found[law.response] = (
            section if wear is None else section.model_copy(update={"composite": _composite(law, wear)})
        )
    return found


def _composite(law: "LawFit", wear: "LawFit") -> Composite | None:
    from ...datasets.errors import UsageError
    from ...fit import composite

    try:
        found = composite(law, wear)
    except UsageError:  # another unit or another category: nothing to put in
        return None
    se = {name: value for name, value in finite(found.bse).items() if name in found.params}
    return Composite(
        wear=wear.response,
        coefficients={str(name): float(value) for name, value in found.params.items()},
        standard_errors=se,
        assumption=found.assumption,
    )


def law_section(law: "LawFit", tool: str = "", work: str = "", gauge_sd: float | None = None) -> Law:
    """Turn a fitted law of this tool and work into its section of the file.

    Raises
    ------
    ParameterError
        The fit holds what the schema refuses, an infinite coefficient for one.
    """
    data = {
        **_section(law),
        **_judged(law, gauge_sd),
        "region": _region(law),
        "published": _published(law, tool, work),
        "alternative": _alternative(law),
    }
    try:
        return Law.model_validate(data)
    except ValidationError as error:
        raise ParameterError(f"the law of {law.response} cannot be handed over: {in_words(error, data)}.") from None


def _section(law: "LawFit") -> dict[str, Any]:
    params = {str(name): float(value) for name, value in law.params.items()}
    names = coefficient_names(law.form, law.factors)
    return {
        "form": law.form,
        "response": law.response,
        "quantity": quantity_of(law.response),
        "unit": law.units[law.response],
        "equation": equation(law),
        "error": law.error,
        "coefficients": {name: params[name] for name in names},
        "factors": [factor(law, symbol) for symbol in law.factors],
        "by": _by(law, params),
        "uncertainty": _uncertainty(law),
        "residual_se": known(law.scale_se),
        "residual_scale": law.scale_unit,
        "smearing": _smearing(law, "new" if law.edges else "independent rows"),
        "n": int(law.nobs),
        "df": int(law.df_resid),
        "n_edges": law.n_edges,
        "statistics": _statistics(law),
        "edges": _edges(law),
        "standard_errors": finite(law.bse),
        "row_standard_errors": finite(law.row_bse) if law.edges else {},
        "left_out": [{"factor": out.factor, "reason": out.reason} for out in law.left_out],
        "dropped_rows": [{"reason": d.reason, "count": int(d.count), "lines": list(d.lines)} for d in law.dropped],
        "notes": list(law.notes),
    }


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


def _smearing(law: "LawFit", of: str) -> float | None:
    from ...fit.about import smearing

    return known(smearing(law, of)) if law.error == "multiplicative" else None


def _edges(law: "LawFit") -> dict[str, Any] | None:
    from ...fit import NotAvailable
    from ...fit.about import df_between, df_within, rows_per_edge

    edges = law.edges
    if isinstance(edges, NotAvailable):
        return {"reason": edges.reason}
    F = known(edges.fvalue)
    return {
        "between": [name for name, within in zip(law.names[1:], edges.within[1:], strict=True) if not within],
        "F": F,
        "F_df": None if F is None else (edges.f_df, edges.df),
        "F_p": known(edges.f_pvalue),
        "row_F": known(edges.row_fvalue),
        "sd_between": edges.mixed.sd_between,
        "sd_within": edges.mixed.sd_within,
        "icc": edges.icc,
        "rows_per_edge": rows_per_edge(law),
        "df_between": int(df_between(law)),
        "df_within": int(df_within(law)),
        "smearing_within": _smearing(law, "same"),
        "random_level": dict(zip(law.theta_names, edges.mixed.bse.tolist(), strict=True)),
    }


def _region(law: "LawFit") -> dict[str, Any] | None:
    from ...fit import FitError, domain

    try:
        found = domain(law)
    except FitError:  # too few settings to span a region
        return None
    names = ("logs", "centre", "half_range", "largest_radius", "levels", "spaces")
    return {name: value for name, value in found.facts().items() if name in names}


def _judged(law: "LawFit", gauge_sd: float | None) -> dict[str, Any]:
    """The findings of a law, and what they say."""
    from ...fit import NotAvailable, judge

    found = judge(law, gauge_sd)
    checks = {
        name: {"reason": check.reason}
        if isinstance(check, NotAvailable)
        else {
            "null": check.null,
            "statistic": known(check.statistic),
            "df": check.df,
            "p": known(check.pvalue),
            "concern": check.concern,
            "verdict": check.verdict,
        }
        for name, check in found.checks.items()
    }
    return {"checks": checks, "verdicts": found.verdicts(), "checked_rows": found.nobs}


def _alternative(law: "LawFit") -> dict[str, Any] | None:
    other = law.alternative
    return None if other is None else _section(other)


def _published(law: "LawFit", tool: str, work: str) -> dict[str, Any] | None:
    from ...fit import beside_published

    beside = beside_published(law, tool, work)
    return None if beside is None else asdict(beside)


def tool_life_section(life: "ToolLife") -> dict[str, Any]:
    """Section of a tool life."""
    return {
        "wear": life.wear,
        "criterion": float(life.criterion),
        "unit_of_wear": life.unit_of_wear,
        "unit": life.unit,
        "coefficients": {str(name): float(value) for name, value in life.coefficients.items()},
        "standard_errors": {} if life.bse is None else {str(k): float(v) for k, v in life.bse.items()},
        "taylor_n": life.taylor_n,
        "t_observed": life.t_observed,
        "typical": life.typical,
        "typical_at": dict(life.typical_at),
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
