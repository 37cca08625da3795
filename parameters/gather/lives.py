"""Laws of tool life and tool lives as fields of the parameter file."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from typing import TYPE_CHECKING, Any

from ...core.verdict import RESERVATIONS, Verdict, verdict_from
from ..sections.base import VerdictSection

if TYPE_CHECKING:
    import pandas as pd

    from ...datasets import Runs
    from ...fit import LawFit
    from ...fit.life import TaylorConstants, ToolLife
    from ..sections.law import LawSection

MOST_CURVES = 500  # edges whose lives are listed


def life_fields(law: "LawFit") -> dict[str, Any] | None:
    """Distribution of tool lives and Taylor's constants, None for other laws."""
    from ...fit.life import taylor_constants

    if law.life is None:
        return None
    found = asdict(law.life)
    distribution = found.pop("name")
    return {
        **found,
        "distribution": distribution,
        "with_scale": dict(zip(law.theta_names, found["with_scale"], strict=True)),
        "longest": float(law.observed.max()),
        "log_likelihood": known(law.life.log_likelihood),
        "taylor": taylor_fields(taylor_constants(law), law),
    }


def taylor_fields(found: "TaylorConstants | None", law: "LawFit") -> dict[str, Any] | None:
    """Taylor's constants, None without V; an end that is not bounded is None."""
    if found is None:
        return None
    ends = {name: getattr(found, name) for name in ("n_interval", "C_interval")}
    bounded = {name: None if pair is None else tuple(map(known, pair)) for name, pair in ends.items()}
    return {**asdict(found), **bounded, "unit": law.units["V"]}


def tool_life_section(
    life: "ToolLife | None",
    laws: "Sequence[LawFit]" = (),
    sections: "Mapping[str, LawSection] | None" = None,
    runs: "Runs | None" = None,
) -> dict[str, Any] | None:
    """Section of a tool life, None where there is none; its verdict is known where its wear law is among the laws."""
    if life is None:
        return None
    law = next((law for law in laws if law.response == life.wear), None)
    curves = _curves(life, runs)
    verdict = None if law is None else _life_verdict(life, law, (sections or {}).get(life.wear), runs)
    if verdict is not None and curves is not None and curves.pop("contradicts"):
        reasons = (*verdict.reasons, curves["words"][-1])
        verdict = replace(verdict, level=max(verdict.level, RESERVATIONS), reasons=reasons)
    return {
        "wear": life.wear,
        "criterion": float(life.criterion),
        "unit_of_wear": life.unit_of_wear,
        "unit": life.unit,
        "coefficients": {str(name): float(value) for name, value in life.coefficients.items()},
        "standard_errors": {} if life.bse is None else {str(k): float(v) for k, v in life.bse.items()},
        "taylor_n": life.taylor_n,
        "t_observed": life.t_observed,
        "wear_observed": None if life.law is None or life.law.rows is None else float(life.law.observed.max()),
        "typical": life.typical,
        "typical_at": dict(life.typical_at),
        "taylor": None if life.law is None else taylor_fields(life.taylor, life.law),
        "curves": None if curves is None else {k: v for k, v in curves.items() if k != "contradicts"},
        "verdict": None if verdict is None else VerdictSection.of(verdict).model_dump(),
    }


def _curves(life: "ToolLife", runs: "Runs | None") -> dict[str, Any] | None:
    """Lives of the edges by their wear curves and the law of these lives; None where edges have no curves.

    None also where readings are known as at least a value: the law, and with it the curves, lack their ends.
    """
    from ...fit.available import NotAvailable, computed
    from ...fit.life import taylor_constants
    from ...fit.wear_curves import wear_curve_lives

    of = None if life.law is None else runs_of(life.law, runs)
    if life.law is None or (of is not None and of.marked(life.wear, ">")):
        return None
    found = computed(partial(wear_curve_lives, life.law, life.criterion))
    if isinstance(found, NotAvailable):
        return None
    data: dict[str, Any] = {
        "lives": [asdict(one) for one in found.lives[:MOST_CURVES]],
        "ratio": found.ratio,
        "ratio_interval": found.ratio_interval,
        "expected": found.expected,
        "words": found.sentences,
        "contradicts": found.contradicts,
    }
    if isinstance(found.law, NotAvailable) or found.law.no_interval:
        return data
    one = found.law.predict({name: life.typical_at[name] for name in found.law.factors}, "mean")
    return {
        **data,
        "coefficients": finite(found.law.params),
        "typical": float(one.value),
        "typical_interval": (float(one.low), float(one.high)),
        "taylor": taylor_fields(taylor_constants(found.law), found.law),
    }


def _life_verdict(life: "ToolLife", law: "LawFit", section: "LawSection | None", runs: "Runs | None") -> Verdict:
    from ...fit.available import NotAvailable, computed
    from ...fit.life import life_verdict

    of_law = None if section is None or section.verdict is None else section.verdict.verdict
    found = computed(partial(life_verdict, life, law, runs_of(law, runs), of_law))
    if not isinstance(found, NotAvailable):
        return found
    return verdict_from([(RESERVATIONS, f"The tool life was not checked: {found.reason}.")])


def runs_of(law: "LawFit", runs: "Runs | None") -> "Runs | None":
    """The runs, if they are those that the law was fitted to."""
    same = runs is not None and (law.source.sha256, law.source.n_rows) == (runs.source.sha256, len(runs))
    return runs if same else None


def finite(values: "pd.Series[float]") -> dict[str, float]:
    """The finite ones of some values, by name."""
    return {str(name): float(value) for name, value in values.items() if math.isfinite(value)}


def known(value: float | None) -> float | None:
    """A finite number, or None."""
    return float(value) if value is not None and math.isfinite(value) else None
