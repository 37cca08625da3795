"""m, d, c and k of LYAP from the three ratios that a record tells and one value known from elsewhere.

With r = (m/k, (mc+d)/k, dc/k) the poles -c and -d/m are the roots of r0 s^2 + r1 s + r2, and k = m / r0.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def parameters_of(
    ratios: Array, cov: Array, given: Mapping[str, float], drive: str | None
) -> tuple[dict[str, float], dict[str, float]]:
    """Values and standard errors (delta method) of m, d, c, k; both empty where they do not follow.

    >>> r = np.array([2.0, 76.0, 480.0]) / 400
    >>> values, _ = parameters_of(r, np.zeros((3, 3)), {"k": 400.0}, "faster")
    >>> {name: round(value, 9) for name, value in values.items()}
    {'m': 2.0, 'd': 60.0, 'c': 8.0, 'k': 400.0}
    """
    if _open(ratios, given, drive):
        return {}, {}
    values = _values(ratios, given, drive)
    J = np.empty((4, 3))
    for j in range(3):
        h = np.zeros(3)
        h[j] = 1e-6 * abs(ratios[j])
        J[:, j] = (_values(ratios + h, given, drive) - _values(ratios - h, given, drive)) / (2 * h[j])
    errors = np.sqrt(np.maximum(np.diag(J @ cov @ J.T), 0.0))
    names = ("m", "d", "c", "k")
    told = dict(zip(names, errors.tolist(), strict=True)) | dict.fromkeys(given, 0.0)
    return dict(zip(names, values.tolist(), strict=True)), told


def basis_of(ratios: Array, given: Mapping[str, float], drive: str | None) -> dict[str, str]:
    """What each of m, d, c, k and the ratios rests on."""
    told = dict.fromkeys(("m/k", "(mc+d)/k", "dc/k"), "from the record alone")
    slow, fast = np.sort(np.abs(np.roots(ratios)))
    pair = f"c and d/m are {slow:.4g} and {fast:.4g} rad/s, the record does not tell which is which"
    why = _open(ratios, given, drive)
    for name in ("m", "d", "c", "k"):
        if name in given:
            told[name] = "given"
        else:
            told[name] = f"not identifiable: {why}" if why else f"from the record, with {_with(given, drive)}"
    if "swinging" not in why:
        told["c, d/m"] = pair if not drive else f"from the record, with the drive taken as {drive}"
    return told


def _with(given: Mapping[str, float], drive: str | None) -> str:
    return " and ".join([*(f"{n} {v:g} given" for n, v in given.items()), f"the drive taken as {drive}"])


def _open(ratios: Array, given: Mapping[str, float], drive: str | None) -> str:
    """Why m, d, c, k do not follow; empty where they do."""
    roots = np.roots(ratios)
    if np.abs(np.imag(roots)).max() > 0 or not (ratios > 0).all():
        return "the poles are a swinging or unstable pair, which no positive m, d, c gives"
    if not given:
        return "m, d and k only as the products m/k, (mc+d)/k and dc/k; give one of m, k, d"
    if not drive:
        return "which pole is the drive's is open; say drive='faster' or 'slower'"
    return ""


def _values(ratios: Array, given: Mapping[str, float], drive: str | None) -> Array:
    """m, d, c, k."""
    slow, fast = np.sort(np.abs(np.roots(ratios)))
    pole, c = (fast, slow) if drive == "faster" else (slow, fast)
    ((name, value),) = given.items()
    m = {"m": value, "k": value * ratios[0], "d": value / pole}[name]
    return np.array([m, m * pole, c, m / ratios[0]])
