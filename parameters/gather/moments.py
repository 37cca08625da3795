"""What a law's section takes from the fit alone: the same for rows in memory and for a stream of them."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from ..sections.law_fields import coefficient_names
from .law_facts import equation, factor, finite, known, quantity_of

if TYPE_CHECKING:
    from ...fit import EdgeInference, LawFit, NotAvailable, StreamedLaw

Fitted: TypeAlias = "LawFit | StreamedLaw"


def moments(law: Fitted) -> dict[str, Any]:
    """Fields of the section that need no row."""
    params = {str(name): float(value) for name, value in law.params.items()}
    return {
        "form": law.form,
        "response": law.response,
        "quantity": quantity_of(law.response),
        "unit": law.units[law.response],
        "equation": equation(law),
        "error": law.error,
        "coefficients": {name: params[name] for name in coefficient_names(law.form, law.factors)},
        "factors": [factor(law, symbol) for symbol in law.factors],
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
    }


def edge_moments(law: Fitted, edges: "EdgeInference | NotAvailable") -> dict[str, Any]:
    """What the edges say, or why they say nothing."""
    from ...fit import NotAvailable

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
        "random_level": dict(zip(law.theta_names, edges.mixed.bse.tolist(), strict=True)),
    }


def _by(law: Fitted, params: Mapping[str, float]) -> dict[str, Any] | None:
    if law.by is None:
        return None
    shifts = {str(level): params[f"{law.by.column}[{level}]"] for level in law.by.levels}
    return {"column": law.by.column, "reference": str(law.by.reference), "shifts": shifts}


def _uncertainty(law: Fitted) -> dict[str, Any]:
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


def _statistics(law: Fitted) -> dict[str, Any]:
    F = known(law.fvalue)
    return {
        "r2": known(law.rsquared),
        "r2_adj": known(law.rsquared_adj),
        "F": F,
        "F_df": None if F is None else (int(law.df_model), int(law.df_resid)),
        "F_p": known(law.f_pvalue),
    }
