"""Identified dynamics as a part of a card."""

import math
from collections.abc import Sequence

import numpy as np

from ...parameters.sections.base import ModelCovariance
from ...parameters.sections.dynamics import AlternativeModel, DynamicsSection
from .numbers import INFINITE, NONE, count, fact, figure, number, places, sentence, spread
from .parts import CoefficientPart, DynamicsPart, FactPart
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


def dynamics_part(d: DynamicsSection | None) -> DynamicsPart | None:
    """Transfer function, its coefficients, facts and limits of validity."""
    if d is None:
        return None
    return DynamicsPart(
        title=f"{d.output} from {d.input}",
        verdict=verdict_part(DYNAMICS, d.verdict),
        equation=f"G(z) = ({_polynomial(d.b)}) / ({_polynomial(d.a)})",
        coefficients=_coefficients(d),
        facts=_facts(d),
        sentences=tuple(sentence(text) for text in (*_alternatives(d), *_nonminimum_phase(d), *d.notes)),
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
        *fact("delay", count(d.nk, "samples" if d.nk != 1 else "sample")),
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
    return [
        f"non-minimum phase (zeros at {at}, outside the unit circle): the step response first moves in the opposite "
        "direction, and a fast controller amplifies that"
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
