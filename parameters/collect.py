"""Gather fitted laws into a parameter file: a LawFit becomes a law section, number for number."""

import math
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from importlib.metadata import version
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import JsonValue, ValidationError

from .. import __version__
from .errors import ParameterError, in_words
from .evaluate import LOGARITHMIC, coefficient_names
from .file import ParameterFile
from .law import Law
from .posterior_section import posterior_section
from .sections import Composite

if TYPE_CHECKING:
    import pandas as pd

    from ..fit import LawFit, NotAvailable, Posterior, ToolLife


def collect(
    *,
    tool: str,
    work: str,
    laws: Sequence["LawFit"] = (),
    tool_life: "ToolLife | None" = None,
    posteriors: Sequence["Posterior"] = (),
    no_posterior: "Mapping[str, NotAvailable] | None" = None,
    gauge_sd: float | None = None,
    machine: str | None = None,
    simulated: bool = False,
    note: str | None = None,
    data_file: str | PurePath | None = None,
    data_sha256: str | None = None,
    n_rows: int | None = None,
    created: str | None = None,
    command: str | None = None,
    options: Mapping[str, JsonValue] | None = None,
    seed: int | None = None,
    **more: object,
) -> ParameterFile:
    """Gather results into a parameter file.

    Parameters
    ----------
    tool, work, machine, note : str
        Whose parameters these are.
    laws : sequence of LawFit
        At most one for each response. Where a paper prints the law of this tool and work, it is set beside.
    tool_life : ToolLife, optional
        Solved from one of the laws.
    posteriors : sequence of Posterior
        At most one for each response, of one seed, every gate open.
    no_posterior : mapping of str to NotAvailable, optional
        Why a response has none.
    gauge_sd : float, optional
        Standard deviation of the wear gauge, in the unit of the wear.
    simulated : bool
        True when the data came from a simulation.
    data_file, data_sha256, n_rows, created, command, options, seed
        Provenance, as given: nothing is looked up but the versions of the programs. Of ``data_file``
        only the name is kept; ``created`` is an ISO date.
    **more
        Further sections, written as they are.

    Returns
    -------
    ParameterFile

    Raises
    ------
    GateError
        The gate of a posterior is shut.
    ParameterError
        Two laws of one response, or something the schema refuses.

    Examples
    --------
    >>> pf = collect(tool="GC435", work="709M40", laws=[], data_file="tests/data.csv", n_rows=120)
    >>> pf.identity.tool, pf.provenance.data_file
    ('GC435', 'data.csv')
    """
    identity = {"tool": tool, "work": work, "machine": machine, "simulated": simulated, "note": note}
    provenance = {
        "created": created,
        "data_file": None if data_file is None else PurePath(data_file).name,
        "data_sha256": data_sha256,
        "n_rows": n_rows,
        "fitmodels": __version__,
        "versions": _versions(),
        "command": command,
        "options": dict(options or {}),
        "seed": seed,
    }
    sections = {"identity": identity, "laws": _by_response(laws, tool, work, gauge_sd), "provenance": provenance}
    if tool_life is not None:
        sections["tool_life"] = _tool_life(tool_life)
    if posteriors or no_posterior:
        sections["posterior"] = posterior_section(posteriors, no_posterior or {})
    taken = sorted({"schema_version", *sections} & set(more))
    if taken:
        raise ParameterError(f"{taken[0]} is written by collect itself; give its parts by name.")
    try:
        return ParameterFile.model_validate({**sections, **more})
    except ValidationError as error:
        raise ParameterError(f"cannot collect: {in_words(error, {**sections, **more})}.") from None


def _by_response(laws: Sequence["LawFit"], tool: str, work: str, gauge_sd: float | None) -> dict[str, Law]:
    found: dict[str, Law] = {}
    for law in laws:
        if law.response in found:
            raise ParameterError(f"there are two laws of {law.response}; a parameter file holds one for each response.")
        section = law_section(law, tool, work, gauge_sd)
        wear = next((w for w in laws if w.response in ("AW", "VB") and w.response in law.factors), None)
        found[law.response] = (
            section if wear is None else section.model_copy(update={"composite": _composite(law, wear)})
        )
    return found


def _composite(law: "LawFit", wear: "LawFit") -> Composite | None:
    from ..datasets.errors import UsageError
    from ..fit import composite

    try:
        found = composite(law, wear)
    except UsageError:  # another unit or another category: nothing to put in
        return None
    se = {name: value for name, value in _finite(found.bse).items() if name in found.params}
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
        "quantity": _quantity(law.response),
        "unit": law.units[law.response],
        "equation": equation(law),
        "error": law.error,
        "coefficients": {name: params[name] for name in names},
        "factors": [_factor(law, symbol) for symbol in law.factors],
        "by": _by(law, params),
        "uncertainty": _uncertainty(law),
        "residual_se": _known(law.scale_se),
        "residual_scale": law.scale_unit,
        "smearing": _smearing(law, "new" if law.edges else "independent rows"),
        "n": int(law.nobs),
        "df": int(law.df_resid),
        "n_edges": law.n_edges,
        "statistics": _statistics(law),
        "edges": _edges(law),
        "standard_errors": _finite(law.bse),
        "row_standard_errors": _finite(law.row_bse) if law.edges else {},
        "left_out": [{"factor": out.factor, "reason": out.reason} for out in law.left_out],
        "dropped_rows": [{"reason": d.reason, "count": int(d.count), "lines": list(d.lines)} for d in law.dropped],
        "notes": list(law.notes),
    }


def equation(law: "LawFit") -> str:
    """Tell the equation, its numbers at six digits: at the reference level, then what each level changes."""
    constant, *slopes = (float(law.params[name]) for name in coefficient_names(law.form, law.factors))
    if law.form == "power":
        right = " ".join([_six(constant), *(f"{x}^{_six(b)}" for x, b in zip(law.factors, slopes, strict=True))])
    elif law.form == "exponential":
        right = f"{_six(constant)} exp({_six(slopes[0])} {law.factors[0]})"
    else:
        signed = ("-" if b < 0 else "+" for b in slopes)
        terms = (f"{s} {_six(abs(b))} {x}" for s, b, x in zip(signed, slopes, law.factors, strict=True))
        right = " ".join([_six(constant), *terms])
    text = f"{law.response} = {right}"
    if law.by is None:
        return text
    levels = [_level(law, level, float(law.params[f"{law.by.column}[{level}]"])) for level in law.by.levels]
    return "; ".join([f"{text} for {law.by.column} {law.by.reference}", *levels])


def _level(law: "LawFit", level: str, shift: float) -> str:
    if law.form in LOGARITHMIC:
        return f"times {_six(math.exp(shift))} for {level}"
    return f"{'minus' if shift < 0 else 'plus'} {_six(abs(shift))} for {level}"


def _six(value: float) -> str:
    return f"{value:.6g}"


def _factor(law: "LawFit", symbol: str) -> dict[str, Any]:
    low, high = law.domain[symbol]
    ends = {"low": float(low), "high": float(high)}
    return {"symbol": symbol, "quantity": _quantity(symbol), "unit": law.units[symbol], **ends}


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
    from ..fit.about import smearing

    return _known(smearing(law, of)) if law.error == "multiplicative" else None


def _edges(law: "LawFit") -> dict[str, Any] | None:
    from ..fit import NotAvailable
    from ..fit.about import df_between, df_within, rows_per_edge

    edges = law.edges
    if isinstance(edges, NotAvailable):
        return {"reason": edges.reason}
    F = _known(edges.fvalue)
    return {
        "between": [name for name, within in zip(law.names[1:], edges.within[1:], strict=True) if not within],
        "F": F,
        "F_df": None if F is None else (edges.f_df, edges.df),
        "F_p": _known(edges.f_pvalue),
        "row_F": _known(edges.row_fvalue),
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
    from ..fit import FitError, domain

    try:
        found = domain(law)
    except FitError:  # too few settings to span a region
        return None
    names = ("logs", "centre", "half_range", "largest_radius", "levels", "spaces")
    return {name: value for name, value in found.facts().items() if name in names}


def _judged(law: "LawFit", gauge_sd: float | None) -> dict[str, Any]:
    """The findings of a law, and what they say."""
    from ..fit import NotAvailable, judge

    found = judge(law, gauge_sd)
    checks = {
        name: {"reason": check.reason}
        if isinstance(check, NotAvailable)
        else {
            "null": check.null,
            "statistic": _known(check.statistic),
            "df": check.df,
            "p": _known(check.pvalue),
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
    from ..fit import beside_published

    beside = beside_published(law, tool, work)
    return None if beside is None else asdict(beside)


def _tool_life(life: "ToolLife") -> dict[str, Any]:
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
    F = _known(law.fvalue)
    return {
        "r2": _known(law.rsquared),
        "r2_adj": _known(law.rsquared_adj),
        "F": F,
        "F_df": None if F is None else (int(law.df_model), int(law.df_resid)),
        "F_p": _known(law.f_pvalue),
    }


def _finite(values: "pd.Series[float]") -> dict[str, float]:
    return {str(name): float(value) for name, value in values.items() if math.isfinite(value)}


def _known(value: float | None) -> float | None:
    """Keep a finite number; NaN or infinity is one that cannot be had."""
    return float(value) if value is not None and math.isfinite(value) else None


def _quantity(symbol: str) -> str:
    from ..datasets.vocabulary import ROLES

    role = ROLES.get(symbol)
    return role.quantity if role is not None else symbol


def _versions() -> dict[str, str]:
    return {"python": platform.python_version(), "numpy": np.__version__, "scipy": version("scipy")}
