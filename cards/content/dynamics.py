"""Identified dynamics, and the gains of a loop about them, as parts of a card."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from ...parameters.sections.base import ModelCovariance
from ...parameters.sections.dynamics import AlternativeModel, DynamicsSection, PiFigures, PiSection
from .numbers import INFINITE, NONE, count, fact, figure, number, percent, places, sentence, spread
from .parts import CoefficientPart, DynamicsPart, FactPart, NumberPart, Part
from .verdicts import DYNAMICS, verdict_part

SIMULATED = "of samples not used in the fit, by simulation"
OWN = "of the samples fitted, by simulation"
STRUCTURES = {
    "box_jenkins": "plant and noise model independent (Box-Jenkins)",
    "output_error": "output error, white noise",
    "arx": "ARX, noise through the poles of the plant",
    "armax": "ARMAX, noise through the poles of the plant",
    "sriv": "instrumental variables (SRIV)",
}
NORMAL = 1.96  # quantile of the intervals of a model
FORMS = {
    "position": "position: u_k = kp e_k + ki S_k",
    "incremental": "incremental: u_k = u_(k-1) + kp (e_k - e_(k-1)) + ki (S_k - S_(k-1))",
    "incremental_sum": "incremental with the sum: u_k = u_(k-1) + kp e_k + ki S_k",
}
RULES = {
    "backward": "S_k = S_(k-1) + T e_k (backward)",
    "forward": "S_k = S_(k-1) + T e_(k-1) (forward)",
    "trapezoidal": "S_k = S_(k-1) + T (e_k + e_(k-1)) / 2 (trapezoidal)",
}
WINDUP = {"clamping": "clamping", "back_calculation": "back calculation", "none": "none"}
# name of a figure -> words, unit ("%": a share; "u": of the command), whether a specification is a lower limit
FIGURES: Mapping[str, tuple[str, str, bool]] = {
    "rise_time": ("rise time, 10 to 90 %", "s", False),
    "settling_time": ("settling time, within 2 %", "s", False),
    "overshoot": ("overshoot", "%", False),
    "undershoot": ("undershoot", "%", False),
    "steady_error": ("steady-state error", "%", False),
    "ms": ("Ms, peak of |1/(1 + L)|", "", False),
    "mt": ("Mt, peak of |L/(1 + L)|", "", False),
    "phase_margin": ("phase margin", "°", True),
    "gain_margin": ("gain margin (factor)", "", True),
    "delay_margin": ("delay margin", "s", True),
    "disturbance_peak": ("peak after a unit load disturbance", "", False),
    "disturbance": ("peak after a unit load disturbance", "", False),
    "travel": ("total variation of the command", "", False),
    "peak_u": ("peak of the command", "", False),
    "noise_gain": ("noise gain of the command", "", False),
    "integral_time": ("integral time", "s", False),
}
CHOSEN = {  # selection rules that need an explanation
    "smallest ms": "of the gains that meet the specification, these have the smallest peak sensitivity, Ms",
    "smallest iae": "of the gains that meet the specification, these have the smallest integral of absolute error",
}
UNBOUNDED = ("rise_time", "settling_time", "gain_margin", "delay_margin")


def dynamics_part(d: DynamicsSection | None, apart: Sequence[str] = ()) -> DynamicsPart | None:
    """Transfer function, its coefficients, facts and limits of validity; ``apart`` are notes on its record."""
    if d is None:
        return None
    return DynamicsPart(
        title=f"{d.output} from {d.input}",
        verdict=verdict_part(DYNAMICS, d.verdict),
        equation=f"G(z) = ({_polynomial(d.b)}) / ({_polynomial(d.a)})",
        coefficients=_coefficients(d),
        facts=_facts(d),
        sentences=tuple(sentence(text) for text in (*apart, *_alternatives(d), *_nonminimum_phase(d), *d.notes)),
    )


def _facts(d: DynamicsSection) -> tuple[FactPart, ...]:
    """Properties of a model by name."""
    gain = d.dc_gain
    unit = f"{d.unit_y or 'output'}/{d.unit_u or 'input'}"
    noise = None if d.noise_variance is None else math.sqrt(d.noise_variance)
    low, high = d.band or (None, None)
    u, y = d.operating_point or (None, None)
    return (
        *fact("structure", NONE, _structure(d)),
        *fact("sample time", figure(d.sample_time, 6, "s")),
        *fact(
            "first response",
            count(d.nk, "samples" if d.nk != 1 else "sample"),
            f"after the command{f', dead time {(d.nk - 1) * d.sample_time:.4g} s or more' if d.nk > 1 else ''}",
        ),
        *fact("static gain", figure(gain, 4, unit) if math.isfinite(gain) else INFINITE),
        *(fact("gain per second", figure(_rate_gain(d), 4, f"{unit}/s")) if d.integrating else ()),
        *fact("largest pole magnitude", figure(float(np.abs(d.poles).max(initial=0.0))), _stability(d)),
        *fact("excited from", figure(low, 3, "Hz")),
        *(fact("excited up to", figure(high, 3, "Hz"), "valid range of the model") if d.band else ()),
        *(
            fact("held-out fit", places(d.held_out_fit, 1, "%"), d.held_out_on or SIMULATED)
            if d.held_out_fit is not None
            else ()
        ),
        *(fact("fit to its own record", places(d.own_fit, 1, "%"), OWN) if d.own_fit is not None else ()),
        *fact("noise SD", figure(noise, 3, d.unit_y)),
        *fact("operating point, input", figure(u, 4, d.unit_u)),
        *fact("operating point, output", figure(y, 4, d.unit_y)),
        *fact("samples", count(d.n)),
        *fact("SHA-256 of the record", NONE, d.record_sha256 or ""),
        *fact("SHA-256 of the held-out record", NONE, d.held_out_sha256 or ""),
    )


def _structure(d: DynamicsSection) -> str:
    """The structure in words, with the order of a noise model of its own."""
    words, order = STRUCTURES.get(d.structure, d.structure.replace("_", " ")), len(d.d) - 1
    noise = f", noise an autoregression of order {order}" if order else ", white noise"
    return f"{words}{noise}" if d.structure == "box_jenkins" else words


def _stability(d: DynamicsSection) -> str:
    return "" if d.stable else "integrating" if d.integrating else "unstable"


def _rate_gain(d: DynamicsSection) -> float:
    """Final slope of the response to a constant input of 1, per second, of an integrating model."""
    return float(np.sum(d.b)) / float(np.cumsum(d.a)[:-1].sum()) / d.sample_time


def _alternatives(d: DynamicsSection) -> list[str]:
    """Sentence on the other structures that the record supports, with their weights."""
    if not d.alternatives:
        return []
    own = 1 - sum(other.weight for other in d.alternatives)
    named = [
        f"{_orders(other)} ({100 * other.weight:.2g} %)"
        for other in sorted(d.alternatives, key=lambda other: -other.weight)
    ]
    if any(other.structure.startswith(AlternativeModel.LINEAR_PART) for other in d.alternatives):
        return [
            "gain and delay depend on the amplitude: bands, gains and their probability include this structure "
            f"(weight {100 * own:.2g} %), {', '.join(named)}"
        ]
    return [
        f"the record does not decide between this structure (weight {100 * own:.2g} %) and {', '.join(named)}: bands, "
        "gains and their probability include all of them"
    ]


def _orders(other: AlternativeModel) -> str:
    """The name of a continuous form, or orders and delay."""
    if other.structure not in STRUCTURES:
        return other.structure
    kind = "ARX of " if other.structure == "arx" else ""
    return f"{kind}na {len(other.a) - 1}, nb {len(other.b) - other.nk}, nk {other.nk}"


def _coefficients(d: DynamicsSection) -> tuple[CoefficientPart, ...]:
    """A line for each coefficient of a model, with its 95 % interval."""
    errors: dict[str, float] = {}
    if isinstance(d.uncertainty, ModelCovariance):
        errors = dict(zip(d.uncertainty.of, np.sqrt(np.diag(np.array(d.uncertainty.matrix))).tolist(), strict=True))
    lines = []
    blank = dict.fromkeys(("t", "p", "row_se", "other", "printed"), NONE)
    for name, value in zip(d.names, [*d.a[1:], *d.b[d.nk :]], strict=True):
        se = errors.get(name)
        low, high = (number(value + q * se, se) if se else NONE for q in (-NORMAL, NORMAL))
        lines.append(
            CoefficientPart(name=name, estimate=number(value, se), se=spread(value, se), low=low, high=high, **blank)
        )
    return tuple(lines)


def _nonminimum_phase(d: DynamicsSection) -> list[str]:
    zeros = np.roots(np.trim_zeros(np.asarray(d.b)))
    outside = zeros[(np.abs(zeros) > 1) & (zeros.real > 0)]  # others come from sampling alone
    if not outside.size:
        return []
    at = ", ".join(f"{z.real:.3g}{z.imag:+.3g}i" if abs(z.imag) > 1e-9 else f"{z.real:.3g}" for z in outside)
    odd = np.count_nonzero(np.abs(outside.imag) < 1e-9) % 2  # an even number leaves the first direction
    moves = "first moves in the opposite direction" if odd else "reverses its direction for a time, soon after the step"
    return [
        f"non-minimum phase (zeros at {at}, outside the unit circle): the step response {moves}, and a fast "
        "controller amplifies that"
    ]


def _polynomial(p: Sequence[float]) -> str:
    """Coefficients with powers of z, as papers print them."""
    parts: list[str] = []
    for k, value in enumerate(p):
        if value == 0:
            continue
        power = "" if k == 0 else f" z^-{k}"
        sign = " - " if value < 0 else " + "
        parts.append((sign if parts else ("-" if value < 0 else "")) + f"{abs(value):.6g}{power}")
    return "".join(parts) or "0"


class GainsPart(Part):
    """The PI controller: gains with form and units, and its performance."""

    facts: tuple[FactPart, ...]  # Kp, Ki, Ti, sample time, form ...
    reached: tuple[FactPart, ...] = ()  # rise, settling, Ms, margins, probability
    asked: tuple[FactPart, ...] = ()
    sentences: tuple[str, ...] = ()


def gains_part(pi: PiSection | None, dynamics: DynamicsSection | None) -> GainsPart | None:
    """Gains with all that a controller needs to run them."""
    if pi is None:
        return None
    return GainsPart(
        facts=as_they_run(pi),
        reached=(*reached(pi.figures), *_held(pi)),
        asked=asked(pi),
        sentences=tuple(sentence(text) for text in _sentences(pi, dynamics)),
    )


def as_they_run(pi: PiSection) -> tuple[FactPart, ...]:
    """Kp, Ki and Ti with their units, form and limits."""
    per = f"{pi.unit_u or 'command'}/{pi.unit_y or 'measurement'}"
    return (
        *fact("Kp", figure(pi.kp, 6, per)),
        *fact("Ki", figure(pi.ki, 6, f"{per}/s"), "parallel: Kp does not multiply it"),
        *(fact("Ti", figure(pi.ti, 6, "s"), "Kp / Ki") if pi.ti is not None else ()),
        *fact("sample time", figure(pi.sample_time, 6, "s")),
        *_unless_one("setpoint weight", pi.setpoint_weight, "of the reference in the proportional part"),
        *fact("form", NONE, FORMS[pi.form]),
        *fact("integral", NONE, RULES[pi.integration]),
        *fact("delay", count(pi.delay, "samples")),
        *(fact("low-pass of the measurement", figure(pi.filter_time, 6, "s")) if pi.filter_time else ()),
        *(fact(f"moving average of the {pi.average_of}", count(pi.average, "samples")) if pi.average > 1 else ()),
        *fact("minimum command", figure(pi.low, 6, pi.unit_u)),
        *fact("maximum command", figure(pi.high, 6, pi.unit_u)),
        *fact("rate limit of the command", figure(pi.rate, 6, f"{pi.unit_u}/s".lstrip("/"))),
        *fact("anti-windup", NONE, WINDUP[pi.anti_windup]),
        *fact("tracking time", figure(pi.tracking_time, 6, "s")),
        *_unless_one("units of the command per unit of the model input", pi.scaling_u),
        *_unless_one("units of the measurement per unit of the model output", pi.scaling_y),
    )


def _unless_one(name: str, factor: float, words: str = "") -> tuple[FactPart, ...]:
    """A factor that changes nothing where it is 1; nothing then."""
    return () if factor == 1 else fact(name, figure(factor, 6), words)


def reached(figures: PiFigures | None) -> tuple[FactPart, ...]:
    """Performance of the loop on the dynamics of the file."""
    if figures is None:
        return ()
    out: list[FactPart] = []
    for name, (words, unit, _) in FIGURES.items():
        value = getattr(figures, name, None)
        endless = value is None and name in UNBOUNDED and name in figures.model_fields_set
        out += fact(words, INFINITE if endless else _number(value, unit))
    return tuple(out)


def asked(pi: PiSection) -> tuple[FactPart, ...]:
    """The specification: a limit for each specified figure."""
    limits = {} if pi.specification is None else pi.specification.asked
    out: list[FactPart] = []
    for name, value in limits.items():
        words, unit, least = FIGURES[name]
        out += fact(words, _number(value, unit), "at least" if least else "at most")
    return tuple(out)


def _number(value: float | None, unit: str) -> NumberPart:
    return percent(value) if unit == "%" else figure(value, 3, unit)


def _held(pi: PiSection) -> tuple[FactPart, ...]:
    """The probability that the specification holds, what was required, and the share of draws that miss each limit."""
    if pi.probability is None:
        return ()
    words = "" if pi.draws is None else f"share of {pi.draws} models drawn from the uncertainty of the dynamics"
    if pi.required_probability is not None:
        words += f", required {100 * pi.required_probability:g} %"
    ends = zip(("low", "high"), pi.probability_interval or (), strict=False)
    interval = (fact(f"probability, {end} end", percent(p), "95 % interval of the estimate") for end, p in ends)
    missed = ((FIGURES[name][0] if name in FIGURES else name, share) for name, share in pi.missed.items())
    return (
        *fact("probability of meeting the specification", percent(pi.probability), words),
        *(item for each in interval for item in each),
        *fact("required probability", percent(pi.required_probability)),
        *(item for words, share in missed for item in fact(f"share of these that miss {words}", percent(share))),
    )


def _sentences(pi: PiSection, dynamics: DynamicsSection | None) -> list[str]:
    notes = [CHOSEN.get(pi.method, f"chosen by {pi.method}")] if pi.method else []
    if pi.verdict is not None and pi.verdict.concern:
        notes.append(" ".join([f"verdict on the gains: {pi.verdict.level}.", *pi.verdict.reasons]))
    if pi.forced:
        notes.append(f"FORCED: these gains do not meet their specification and were written nevertheless ({pi.forced})")
    if pi.figures is None:
        words = "the file holds no performance of these gains: tune them, or simulate the loop before it is closed"
        notes.append(words)
    elif not pi.figures.stable:
        notes.append("the loop is NOT stable on the dynamics of the file: do not close it")
    else:
        notes.append("all figures are computed on the dynamics of the file, not measured on a machine")
    if dynamics is None:
        notes.append("the file holds no dynamics, so the gains cannot be checked")
    return [*notes, *pi.notes]
