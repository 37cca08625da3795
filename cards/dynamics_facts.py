"""What is told of an identified model, once for screen and paper."""

from collections.abc import Sequence

import numpy as np

from ..core.rounding import format_plain
from ..parameters import DynamicsSection


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
