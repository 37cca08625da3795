"""Identified dynamics as a part of a card."""

import math
from collections.abc import Sequence

import numpy as np

from ...core.rounding import format_plain
from ...parameters.sections.dynamics import DynamicsSection
from .coefficients import model_coefficients
from .numbers import ENDLESS, NONE, count, fact, figure, places
from .parts import DynamicsPart, FactPart

FREE_RUN = "of samples it was not fitted to, by a free run"


def transfer_part(d: DynamicsSection | None) -> DynamicsPart | None:
    """Transfer function, its coefficients and how far it may be trusted."""
    if d is None:
        return None
    sentences = [*wrong_way(d), *_trust(d), *d.notes]
    return DynamicsPart(
        title=f"{d.output} from {d.input}",
        equation=transfer_function_words(d),
        coefficients=model_coefficients(d),
        facts=facts(d),
        sentences=tuple(sentence(text) for text in sentences),
    )


def facts(d: DynamicsSection) -> tuple[FactPart, ...]:
    """The figures of a model by name."""
    gain = d.dc_gain
    unit = f"{d.unit_y or 'output'}/{d.unit_u or 'input'}"
    noise = None if d.noise_variance is None else math.sqrt(d.noise_variance)
    low, high = d.band or (None, None)
    u, y = d.operating_point or (None, None)
    return (
        *fact("structure", NONE, d.structure.replace("_", " ")),
        *fact("sample time", figure(d.sample_time, 6, "s")),
        *fact("delay", count(d.nk, "samples" if d.nk != 1 else "sample")),
        *fact("gain at rest", figure(gain, 4, unit) if math.isfinite(gain) else ENDLESS),
        *fact("largest pole", figure(float(np.abs(d.poles).max(initial=0.0))), "" if d.stable else "not stable"),
        *fact("excited from", figure(low, 3, "Hz")),
        *fact("excited up to", figure(high, 3, "Hz")),
        *(fact("held-out fit", places(d.held_out_fit, 1, "%"), FREE_RUN) if d.held_out_fit is not None else ()),
        *fact("noise SD", figure(noise, 3, d.unit_y)),
        *fact("operating point, input", figure(u, 4, d.unit_u)),
        *fact("operating point, output", figure(y, 4, d.unit_y)),
        *fact("samples", count(d.n)),
        *fact("SHA-256 of the record", NONE, d.record_sha256 or ""),
        *fact("SHA-256 of the held-out record", NONE, d.held_out_sha256 or ""),
    )


def sentence(text: str) -> str:
    """A clause as a sentence: a capital first, a full stop last."""
    text = text.strip()
    return text[:1].upper() + text[1:] + ("" if text.endswith((".", "!", "?")) else ".")


def _trust(d: DynamicsSection) -> list[str]:
    said = []
    if d.band:
        said.append(f"trust it from {d.band[0]:.3g} to {d.band[1]:.3g} Hz, where the input had power")
    if d.held_out_fit is not None:
        said.append(f"a free run explains {d.held_out_fit:.1f} % of samples that it was not fitted to")
    return said


def transfer_function_words(d: DynamicsSection) -> str:
    """``G(z) = (...) / (...)`` to the digits one computes with."""
    return f"G(z) = ({_polynomial(d.b)}) / ({_polynomial(d.a)})"


def model_words(d: DynamicsSection) -> list[str]:
    """Gain, poles and noise in sentences."""
    unit = f"{d.unit_y or 'output'}/{d.unit_u or 'input'}"
    radius = float(np.abs(d.poles).max(initial=0.0))
    said = [
        f"{d.structure.replace('_', ' ')}; sampled every {d.sample_time:g} s; delay {d.nk} "
        f"sample{'s' if d.nk != 1 else ''}; gain at rest "
        f"{format_plain(d.dc_gain, 4)} {unit}; largest pole {format_plain(radius, 4)}"
        + (f"; fitted to {d.n} samples" if d.n is not None else "")
    ]
    said += wrong_way(d)
    if d.noise_variance is not None:
        said.append(f"noise sd {format_plain(float(np.sqrt(d.noise_variance)), 3)} {d.unit_y}".rstrip())
    return said


def wrong_way(d: DynamicsSection) -> list[str]:
    """That the output first turns the wrong way, where it does."""
    zeros = np.roots(np.trim_zeros(np.asarray(d.b)))
    outside = zeros[(np.abs(zeros) > 1) & (zeros.real > 0)]  # others come from sampling alone
    if not outside.size:
        return []
    at = ", ".join(f"{z.real:.3g}{z.imag:+.3g}i" if abs(z.imag) > 1e-9 else f"{z.real:.3g}" for z in outside)
    return [
        f"non-minimum phase (zeros at {at}, outside the unit circle): the output turns the wrong way before it "
        "settles, and a fast controller makes that worse"
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
