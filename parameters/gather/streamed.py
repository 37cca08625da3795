"""A law of a stream of rows becomes a law section, but for what only rows can tell: that stays empty and is said."""

from typing import TYPE_CHECKING, Any, cast

from pydantic import ValidationError

from ..errors import ParameterError, in_words
from ..evaluate import coefficient_names
from ..sections.law import Law
from .law import _by, _statistics, _uncertainty
from .law_facts import equation, factor, finite, known, quantity_of

if TYPE_CHECKING:
    from ...fit import LawFit
    from ...fit.streamed.streamed_law import StreamedLaw


def streamed_section(law: "StreamedLaw") -> Law:
    """Turn a law of a stream into its section of the file.

    The region is the range of each factor; checks, smearing, the published law beside it and the fit with additive
    errors need rows, and the notes of the section say so.

    Raises
    ------
    ParameterError
        The fit holds what the schema refuses.

    Examples
    --------
    >>> from fitmodels import datasets
    >>> from fitmodels.fit.streamed.one_pass import streamed_power_law
    >>> table = datasets.read_runs(datasets.bundled("gc435_709m40")).data
    >>> section = streamed_section(streamed_power_law([table[:60], table[60:]], "AW", ["V", "f", "d", "t"]))
    >>> round(float(section.predict(V=100.0, f=0.2, d=2.0, t=10.0)), 3), section.n_edges, section.region is None
    (0.169, 24, True)
    """
    data = _section(law)
    try:
        return Law.model_validate(data)
    except ValidationError as error:
        raise ParameterError(f"the law of {law.response} cannot be handed over: {in_words(error, data)}.") from None


def _section(law: "StreamedLaw") -> dict[str, Any]:
    moments = cast("LawFit", law)  # of which these functions ask nothing of rows
    params = {str(name): float(value) for name, value in law.params.items()}
    return {
        "form": law.form,
        "response": law.response,
        "quantity": quantity_of(law.response),
        "unit": law.units[law.response],
        "equation": equation(moments),
        "error": law.error,
        "coefficients": {name: params[name] for name in coefficient_names(law.form, law.factors)},
        "factors": [factor(moments, symbol) for symbol in law.factors],
        "by": _by(moments, params),
        "uncertainty": _uncertainty(moments),
        "residual_se": known(law.scale_se),
        "residual_scale": law.scale_unit,
        "n": law.nobs,
        "df": law.df_resid,
        "n_edges": law.n_edges,
        "statistics": _statistics(moments),
        "edges": _edges(law),
        "standard_errors": finite(law.bse),
        "row_standard_errors": finite(law.row_bse) if law.edges else {},
        "left_out": [{"factor": out.factor, "reason": out.reason} for out in law.left_out],
        "dropped_rows": [{"reason": d.reason, "count": int(d.count), "lines": list(d.lines)} for d in law.dropped],
        "notes": [*law.notes, *_not_available(law)],
    }


def _not_available(law: "StreamedLaw") -> list[str]:
    reasons = {"checks": law.checks, "region": law.region, "smearing": law.smearing, "additive errors": law.alternative}
    return [f"{name} not available: {reason}" for name, reason in reasons.items()]


def _edges(law: "StreamedLaw") -> dict[str, Any]:
    from ...fit import NotAvailable

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
        "rows_per_edge": law.rows_per_edge,
        "df_between": law.df_between,
        "df_within": law.df_within,
        "random_level": dict(zip(law.theta_names, edges.mixed.bse.tolist(), strict=True)),
    }
