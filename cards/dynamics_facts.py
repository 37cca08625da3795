"""What is told of an identified model, once for screen and paper."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..parameters import Dynamics
from ..parameters.rounding import plain
from .content.coefficients import between, model_coefficients


@dataclass(frozen=True, slots=True)
class CoefficientRow:
    """One coefficient as text."""

    name: str
    estimate: str
    se: str
    interval: str


def transfer_function_words(d: Dynamics) -> str:
    """``G(z) = (...) / (...)`` to the digits one computes with."""
    return f"G(z) = ({_polynomial(d.b)}) / ({_polynomial(d.a)})"


def model_rows(d: Dynamics) -> list[CoefficientRow]:
    """A row for each coefficient, with its 95 % interval."""
    return [CoefficientRow(c.name, c.estimate.text, c.se.text, between(c.low, c.high)) for c in model_coefficients(d)]


def model_words(d: Dynamics) -> list[str]:
    """Gain, poles and noise in sentences."""
    unit = f"{d.unit_y or 'output'}/{d.unit_u or 'input'}"
    radius = float(np.abs(d.poles).max(initial=0.0))
    said = [
        f"{d.structure.replace('_', ' ')}; sampled every {d.sample_time:g} s; delay {d.nk} "
        f"sample{'s' if d.nk != 1 else ''}; gain at rest "
        f"{plain(d.dc_gain, 4)} {unit}; largest pole {plain(radius, 4)}"
        + (f"; fitted to {d.n} samples" if d.n is not None else "")
    ]
    zeros = np.roots(np.trim_zeros(np.asarray(d.b)))
    wrong_way = zeros[(np.abs(zeros) > 1) & (zeros.real > 0)]  # others come from sampling alone
    if wrong_way.size:
        at = ", ".join(f"{z.real:.3g}{z.imag:+.3g}i" if abs(z.imag) > 1e-9 else f"{z.real:.3g}" for z in wrong_way)
        said.append(
            f"non-minimum phase (zeros at {at}, outside the unit circle): the output turns the wrong way before it "
            "settles, and a fast controller makes that worse"
        )
    if d.noise_variance is not None:
        said.append(f"noise sd {plain(float(np.sqrt(d.noise_variance)), 3)} {d.unit_y}".rstrip())
    return said


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
