"""Identified dynamics as a part of a card."""

import math

import numpy as np

from ...parameters import DynamicsSection
from ..dynamics_facts import transfer_function_words, wrong_way
from .coefficients import model_coefficients
from .numbers import ENDLESS, NONE, count, fact, figure, places
from .parts import Named, Transfer

FREE_RUN = "of samples it was not fitted to, by a free run"


def transfer_part(d: DynamicsSection | None) -> Transfer | None:
    """Transfer function, its coefficients and how far it may be trusted."""
    if d is None:
        return None
    sentences = [*wrong_way(d), *_trust(d), *d.notes]
    return Transfer(
        title=f"{d.output} from {d.input}",
        equation=transfer_function_words(d),
        coefficients=model_coefficients(d),
        facts=facts(d),
        sentences=tuple(sentence(text) for text in sentences),
    )


def facts(d: DynamicsSection) -> tuple[Named, ...]:
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
