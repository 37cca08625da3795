"""Identified models, drives and cuts, tuned gains and limits as sections.

Gains that miss their specification need a reason.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields, is_dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from ...core.errors import GateError, ParameterError
from ...core.suggestions import did_you_mean
from ...core.verdict import Verdict
from ..messages import short
from ..sections.base import ModelCovariance, Section, VerdictSection, check_length
from ..sections.dynamics import AlternativeModel, DynamicsSection, PiFigures, PiSection, PiSpecification
from ..sections.force_control import COEFFICIENTS, TESTED, AdaptiveForceSection, RecordRanges
from ..sections.load_line import LimitsSection

if TYPE_CHECKING:
    from ...core.arrays import Array
    from ...datasets import Record
    from ...ident.identification import Identification
    from ...ident.model import Model
    from ...ident.physical_models.drive import DriveFit
    from ...ident.physical_models.force_process import ForceProcess
    from ...ident.physical_models.step_response import StepFit
    from ...ident.pi.gains import PiGains
    from ...ident.pi.tuning import TunedPi

Gains: TypeAlias = "PiGains | TunedPi | PiSection | Mapping[str, Any]"

BOUNDS = {"power": "kW", "force": "N", "wear": "mm"}
ESTIMATES = ("m", "alpha", "beta")  # m/k, (mc+d)/k, dc/k
UNITS = ("unit_u", "unit_force")
DESIGNED_BEFORE = "Kd, lambda and rates are of earlier estimates: renew them, fitmodels adaptive-force PARAMS --force."
RANGES = {"feed": "mm/rev", "feed_rate": "mm/min", "speed": "m/min", "spindle_speed": "1/min"}


def dynamics_section(
    dynamics: "Identification | Model | Section | Mapping[str, Any]", held_out_fit: float | None = None
) -> dict[str, Any]:
    """The section of a model; of an identification with its verdict and its fit to other samples.

    Parameters
    ----------
    dynamics : Identification, Model, or a section as it is
    held_out_fit : float, optional
        Per cent of another record's output that a free run explains.
    """
    if isinstance(dynamics, Section | Mapping):
        return as_data(dynamics)
    from ...ident.identification import Identification

    if isinstance(dynamics, Identification):
        judged = dynamics.judged
        fit, where = (None, None) if judged.unseen else (judged.structure.fit, judged.where)
        section = _model(dynamics.model, fit if held_out_fit is None else held_out_fit)
        form = () if dynamics.by_choice or dynamics.form is None else (dynamics.form.words,)
        return {
            **section,
            "alternatives": _by_form(dynamics, section["alternatives"]),
            "notes": list(dict.fromkeys([*form, *section["notes"], *dynamics.notes])),
            "held_out_on": where if held_out_fit is None else None,
            "own_fit": float(judged.own.fit),
            "verdict": VerdictSection.of(dynamics.verdict).model_dump(),
        }
    return _model(dynamics, held_out_fit)


def _by_form(found: "Identification", alternatives: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The alternatives, those of a continuous form and a linear part under their names; the candidates' order."""
    others = [one for one in found.search.candidates if one.weight > 0 and one is not found.chosen]
    names = [one.form.name if one.form else None for one in others]
    if found.search.without:
        names.insert(0, f"{AlternativeModel.LINEAR_PART} {found.search.without}")
    if found.by_choice or len(names) != len(alternatives):
        return alternatives
    return [
        {**section, "structure": name or section["structure"]}
        for name, section in zip(names, alternatives, strict=True)
    ]


def _model(model: "Model", held_out_fit: float | None) -> dict[str, Any]:
    check_length(max(len(model.a), len(model.b)), model.nk, model.sample_time)
    return {
        "structure": model.structure,
        **{name: [float(x) for x in getattr(model, name)] for name in ("b", "a", "c", "d")},
        "nk": int(model.nk),
        "sample_time": float(model.sample_time),
        **{name: getattr(model, name) for name in ("input", "output", "unit_u", "unit_y")},
        "uncertainty": _uncertainty(model),
        "noise_variance": None if model.noise_variance is None else float(model.noise_variance),
        "n": None if model.n is None else int(model.n),
        "record_sha256": model.record,
        "operating_point": _pair(model.operating_point),
        "band": _pair(model.band),
        "held_out_fit": None if held_out_fit is None else float(held_out_fit),
        "alternatives": [
            {
                "weight": float(weight),
                "structure": other.structure,
                "b": other.b.tolist(),
                "a": other.a.tolist(),
                "nk": int(other.nk),
                "uncertainty": _uncertainty(other),
            }
            for weight, other in model.alternatives
        ],
        "notes": list(model.notes),
    }


def model_of(section: DynamicsSection) -> "Model":
    """A section of dynamics as a model, with covariance and alternatives where it has them.

    >>> none = {"kind": "none", "reason": "given"}
    >>> model_of(DynamicsSection(b=[0.0, 0.5], a=[1.0, -0.5], nk=1, sample_time=0.1, uncertainty=none)).dc_gain
    1.0
    """
    import numpy as np

    from ...ident.model import Model

    def covariance(of: "DynamicsSection | AlternativeModel") -> "Array | None":
        if not isinstance(of.uncertainty, ModelCovariance):
            return None
        order = [of.uncertainty.of.index(name) for name in of.names]
        return np.array(of.uncertainty.matrix, dtype=np.float64).reshape(len(order), len(order))[np.ix_(order, order)]

    T, s = section.sample_time, section
    others = tuple(
        (o.weight, Model(b=np.array(o.b), a=np.array(o.a), nk=o.nk, sample_time=T, cov_params=covariance(o)))
        for o in s.alternatives
    )
    return Model(
        b=np.array(s.b), a=np.array(s.a), nk=s.nk, sample_time=T, cov_params=covariance(s), input=s.input,
        output=s.output, unit_u=s.unit_u, unit_y=s.unit_y, band=s.band, alternatives=others,
    )  # fmt: skip


def step_section(
    fit: "StepFit", rec: "Record", verdict: Verdict, held_out: "tuple[float, str | None] | None" = None
) -> dict[str, Any]:
    """The section ``dynamics`` of a step response, sampled as its record.

    Parameters
    ----------
    fit : StepFit
    rec : Record
        The record that it was fitted to, with its operating point removed, for sample time and excited band.
    verdict : Verdict
        Of the fit, and of its simulation of other samples where there are any.
    held_out : (float, str or None), optional
        Per cent of the output of another record that a free run explains, and the checksum of that record.
    """
    from ...ident.estimators.build_model import record_facts
    from ...ident.responses.spectra import excited_band

    model = replace(fit.model(rec.sample_time), **record_facts(rec), band=excited_band(rec))
    name = {1: "first", 2: "second"}[fit.order]
    return {
        **dynamics_section(model, None if held_out is None else held_out[0]),
        "structure": f"step response of {name} order with delay",
        "held_out_sha256": None if held_out is None else held_out[1],
        "verdict": VerdictSection.of(verdict).model_dump(),
        "notes": [f"Estimates: {fit.words}", *fit.notes],
    }


def drive_section(
    fit: "DriveFit", rec: "Record", verdict: Verdict, held_out: "tuple[float, str | None] | None" = None
) -> dict[str, Any]:
    """The section ``drive`` of inertia and friction; ``verdict`` and ``held_out`` as of `step_section`."""
    rotary = fit.motion.speed_unit == "rad/s"
    force = "N m" if rotary else "N"
    return {
        **dict(zip(COEFFICIENTS, map(float, fit.theta), strict=True)),
        "uncertainty": {
            "kind": "covariance",
            "of": list(COEFFICIENTS),
            "matrix": ((fit.cov_params + fit.cov_params.T) / 2).tolist(),
            "df": fit.df,
        },
        "unit_inertia": "kg m^2" if rotary else "kg",
        "unit_viscous": f"{force} s/{'rad' if rotary else 'm'}",
        "unit_force": force,
        "unit_speed": fit.motion.speed_unit,
        **{name: getattr(rec, name) for name in ("input", "output", "unit_u")},
        "unit_y": fit.motion.unit,
        "force_per_unit": None if fit.motion.factor is None else float(fit.motion.factor),
        "relative_error": fit.relative_error,
        "simulated_fit": fit.own_run[1] if fit.possible else None,
        "sample_time": float(rec.sample_time),
        "cutoff": float(fit.cutoff),
        "n": int(fit.rows),
        "record_sha256": rec.sha256,
        "held_out_fit": None if held_out is None else held_out[0],
        "held_out_sha256": None if held_out is None else held_out[1],
        "verdict": VerdictSection.of(verdict).model_dump(),
        "notes": list(fit.notes),
    }


def force_process_section(
    fit: "ForceProcess",
    former: AdaptiveForceSection | None = None,
    depth: float | None = None,
    spindle_speed: float | None = None,
    rec: "Record | None" = None,
) -> dict[str, Any]:
    """The section ``adaptive_force``: the estimates of a force process; the settings are those of a former section.

    Parameters
    ----------
    fit : ForceProcess
    former : AdaptiveForceSection, optional
        Its rates, gains, set points and limits are kept.
    depth : float, optional
        Depth of cut of the run, mm; without it no plant can be simulated, as k is proportional to it.
    spindle_speed : float, optional
        1/min, of the run; the force is averaged over one of its revolutions.
    rec : Record, optional
        The run as it was recorded, for the ranges of command and force that were tested.

    Raises
    ------
    ParameterError
        The settings of the former section are in other units than the record.
    """
    units = dict(zip(UNITS, (fit.unit_u, fit.unit_y or "N"), strict=True))
    kept = {} if former is None else former.model_dump()
    for name, unit in units.items():
        if former is not None and getattr(former, name) not in ("", unit):
            raise ParameterError(
                f"adaptive_force: the settings of the file are in {short(getattr(former, name))}, the record in "
                f"{short(unit)}: estimates and settings need the same units. Convert the column, give its unit, or "
                "write to another file."
            )
    cov = (fit.cov_params + fit.cov_params.T) / 2
    designed = former is not None and former.sources.get("Kd", "").startswith("design rule")
    turning = {} if spindle_speed is None else {"spindle_speed": spindle_speed, "average_time": 60 / spindle_speed}
    return {
        **kept,
        **dict(zip(ESTIMATES, map(float, fit.ratios), strict=True)),
        **units,
        **turning,
        "uncertainty": {"kind": "covariance", "of": list(ESTIMATES), "matrix": cov.tolist(), "df": fit.df},
        "depth": depth,
        "sources": {**kept.get("sources", {}), **_sources(fit, depth, spindle_speed, rec)},
        "verdict": VerdictSection.of(fit.verdict).model_dump(),
        "notes": [f"Estimates: {fit.words}", *([DESIGNED_BEFORE] if designed else []), *fit.notes],
    }


def _sources(
    fit: "ForceProcess", depth: float | None, spindle_speed: float | None, rec: "Record | None"
) -> dict[str, str]:
    """Origin of the estimates, and of the timing that follows from the spindle."""
    name = "the record" if rec is None or rec.source is None else Path(rec.source).name
    found = dict.fromkeys(ESTIMATES, f"identified from {name}, eq. 2.3 (fit {fit.fit:.1f} %)")
    found |= {} if depth is None else {"depth": f"given: of {name}"}
    if spindle_speed is not None:
        found |= {"spindle_speed": f"given: of {name}", "average_time": f"one revolution at {spindle_speed:g} 1/min"}
    if rec is not None:
        found[TESTED] = RecordRanges.of(rec.u, rec.y).words(fit.unit_u, fit.unit_y or "N", name)
    return found


def pi_section(pi: Gains, *, scaling_u: float = 1.0, forced: str | None = None) -> dict[str, Any]:
    """The section of gains, or of gains with what they were tuned to.

    Parameters
    ----------
    pi : PiGains or TunedPi, or a section as it is
    scaling_u : float
        Units of the command in one unit of the model's input.
    forced : str, optional
        Reason why gains that miss their specification are kept.

    Raises
    ------
    GateError
        They miss it, and no reason is given why they are kept.
    """
    if isinstance(pi, Section | Mapping):
        return as_data(pi)
    gains = getattr(pi, "gains", pi)
    section: dict[str, Any] = {field.name: getattr(gains, field.name) for field in fields(gains)}
    section["scaling_u"] = float(scaling_u)
    return section | (_tuned(pi, forced) if gains is not pi else {"forced": forced})


def _tuned(tuned: Any, forced: str | None) -> dict[str, Any]:  # noqa: ANN401
    misses = tuple(tuned.misses)
    if misses and not forced:
        raise GateError(
            f"the gains miss their specification ({'; '.join(misses)}); relax it, identify a better model, or give "
            "the reason why they are kept (pi_forced)."
        )
    held = tuned.robustness
    return {
        "specification": _named(tuned.specification, PiSpecification),
        "figures": _named(tuned.figures, PiFigures),
        "probability": None if held is None else float(held.probability),
        "draws": None if held is None else int(held.n),
        "probability_interval": None if held is None or held.given else [float(v) for v in held.interval],
        "required_probability": None if tuned.probability is None else float(tuned.probability),
        "missed": {} if held is None else {name: float(v) for name, v in held.missed.items()},
        "verdict": VerdictSection.of(tuned.verdict).model_dump(),
        "forced": f"{forced}: {'; '.join(misses)}" if misses else None,
        "method": f"smallest {tuned.aim}" if tuned.aim in ("ms", "iae") else str(tuned.aim),
        "notes": [str(note) for note in tuned.assumed],
    }


def _named(found: Any, section: type[Section]) -> dict[str, Any]:  # noqa: ANN401
    """Fields of a result, those of the section first; infinite values are None."""
    values = asdict(found)
    order = [
        *(name for name in section.model_fields if name in values),
        *(n for n in values if n not in section.model_fields),
    ]
    return {name: _bounded(values[name]) for name in order}


def _bounded(value: Any) -> bool | float | None:  # noqa: ANN401
    if value is None or isinstance(value, bool):
        return value
    return float(value) if math.isfinite(value) else None


def _uncertainty(model: "Model") -> dict[str, Any]:
    if model.cov_params is None:
        return {
            "kind": "none",
            "reason": "the model was given, not estimated" if model.structure == "given" else "not estimated",
        }
    names, matrix = list(model.names), model.cov_params
    df = None if model.n is None else max(int(model.n) - len(names), 0)
    return {"kind": "covariance", "of": names, "matrix": ((matrix + matrix.T) / 2).tolist(), "df": df}


def _pair(pair: "tuple[float, float] | None") -> list[float] | None:
    return None if pair is None else [float(x) for x in pair]


def as_data(section: Any) -> dict[str, Any]:  # noqa: ANN401
    """A section, a mapping or a dataclass as plain data; a verdict among its values becomes a section.

    >>> from fitmodels.core.verdict import Verdict
    >>> as_data({"Kd": 0.5, "verdict": Verdict()})["verdict"]["level"]
    'usable inside the tested region'
    """
    if isinstance(section, Section):
        return section.model_dump()
    if is_dataclass(section) and not isinstance(section, type):
        return asdict(section)
    return {
        name: VerdictSection.of(value).model_dump() if isinstance(value, Verdict) else value
        for name, value in section.items()
    }


def limits_section(limits: LimitsSection | Mapping[str, Any]) -> dict[str, Any]:
    """The section of limits; a bare number or pair is in the usual unit: kW, N, mm, mm/rev, mm/min, m/min, 1/min.

    Raises
    ------
    ParameterError
        A limit that is neither a number, a pair, nor a section of its own.

    Examples
    --------
    >>> limits_section({"power": 7, "speed": (50, 200)})
    {'power': {'value': 7.0, 'unit': 'kW'}, 'speed': {'low': 50.0, 'high': 200.0, 'unit': 'm/min'}}
    """
    given = as_data(limits)
    strange = next(
        (name for name in given if isinstance(limits, Mapping) and name not in LimitsSection.model_fields), ""
    )
    if strange:
        hint = did_you_mean(strange, LimitsSection.model_fields, names="There are ")
        raise ParameterError(f"limits: there is no limit {strange!r}. {hint}")
    return {name: _limit(name, value) for name, value in given.items()}


def _limit(name: str, value: Any) -> Any:  # noqa: ANN401
    if name in BOUNDS and isinstance(value, int | float) and not isinstance(value, bool):
        return {"value": float(value), "unit": BOUNDS[name]}
    if name in RANGES and isinstance(value, Sequence) and not isinstance(value, str):
        if len(value) != 2:
            raise ParameterError(
                f"limits: {name} {short(list(value))} of {len(value)} numbers; a range is low and high."
            )
        return {"low": float(value[0]), "high": float(value[1]), "unit": RANGES[name]}
    return value
