"""Fitted laws become law sections, number for number, with what judged them."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from ...core.errors import ParameterError
from ..messages import schema_message
from ..sections.law import LawSection
from ..sections.law_parts import CompositeLaw
from .law_facts import finite, known
from .moments import edge_moments, moments

if TYPE_CHECKING:
    from ...fit import LawFit, StreamedLaw, ToolLife


def laws_by_response(
    laws: "Sequence[LawFit | StreamedLaw]", tool: str, work: str, gauge_sd: float | None
) -> dict[str, LawSection]:
    """Sections of laws by response; one of wear is put into the others, where both were fitted to rows in memory."""
    from ...fit import StreamedLaw

    found: dict[str, LawSection] = {}
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


def _composite(law: "LawFit", wear: "LawFit") -> CompositeLaw | None:
    from ...core.errors import UsageError
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


def law_section(law: "LawFit", tool: str = "", work: str = "", gauge_sd: float | None = None) -> LawSection:
    """Turn a fitted law of this tool and work into its section of the file.

    Raises
    ------
    ParameterError
        The fit holds what the schema refuses, an infinite coefficient for one.
    """
    other = law.alternative
    data = {
        **_section(law),
        **_judged(law, gauge_sd, other),
        "region": _region(law),
        "published": _published(law, tool, work),
        "alternative": None if other is None else _section(other),
    }
    try:
        return LawSection.model_validate(data)
    except ValidationError as error:
        raise ParameterError(
            f"the law of {law.response} cannot be handed over: {schema_message(error, data)}."
        ) from None


def _section(law: "LawFit") -> dict[str, Any]:
    return {
        **moments(law),
        "smearing": _smearing(law, "new" if law.edges else "independent rows"),
        "edges": _edges(law),
    }


def _smearing(law: "LawFit", of: str) -> float | None:
    from ...fit.about import smearing

    return known(smearing(law, of)) if law.error == "multiplicative" else None


def _edges(law: "LawFit") -> dict[str, Any]:
    from ...fit.about import df_between, df_within, rows_per_edge

    told = edge_moments(law, law.edges)
    if not law.edges:
        return told
    return told | {
        "rows_per_edge": rows_per_edge(law),
        "df_between": int(df_between(law)),
        "df_within": int(df_within(law)),
        "smearing_within": _smearing(law, "same"),
    }


def _region(law: "LawFit") -> dict[str, Any] | None:
    from ...core.errors import FitError
    from ...fit import domain

    try:
        found = domain(law)
    except FitError:  # too few settings to span a region
        return None
    names = ("logs", "centre", "half_range", "largest_radius", "levels", "spaces")
    return {name: value for name, value in found.facts().items() if name in names}


def _judged(law: "LawFit", gauge_sd: float | None, other: "LawFit | None") -> dict[str, Any]:
    """The findings of a law, and what they say; ``other`` is the law with the other error structure."""
    from ...fit import NotAvailable, judge

    found = judge(law, gauge_sd, alternative=other)
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
