"""Rough turning of 709M40 with GC435: the laws and limits of Alaskari and Oraby, 2016 and 2017.

    AW  = 7.62e-3 V^0.577 f^0.168 d^0.248 t^0.245            mm    R2 0.84  SE 0.1    F 831
    P   = 0.140  V^0.82  f^0.627 d^0.844 t^-0.049 AW^0.342    kW    R2 0.97  SE 0.062  F 4156
    Fxz = 55354  V^-0.484 f^0.236 d^0.715 t^-0.173 AW^1.1     N     R2 0.83  SE 0.12   F 670

AC-2016: ICAESAM'2016, doi 10.15242/IIE.E1216006, eq. 4-6; limits 7 kW and 1300 N. AC-2017: "Adaptive control simulation
to optimize metal removal for rough turning", Kuwait J. Sci. (accepted June 2017), eq. 1-3; limits 7 kW, 1500 N and wear
0.3 mm. The later paper prints V^0.877 in its eq. 1; its tables, its eq. 5 and the earlier paper have 0.577.
"""

from collections.abc import Mapping
from typing import Any

from ...core.version import __version__
from ...datasets.gc435 import DOMAIN, LAWS, STANDARD_ERROR
from ...datasets.simulation import SimulatedLaw
from ...datasets.vocabulary import ROLES
from ..file import ParameterFile, sealed
from . import unchecked

R2: Mapping[str, float] = {"AW": 0.84, "P": 0.97, "Fxz": 0.83}
F: Mapping[str, float] = {"AW": 831.0, "P": 4156.0, "Fxz": 670.0}
TESTS = 24

# Neither paper prints a range of t or AW: from the first sub-test to the last minute that AC-2017 asks of the laws,
# and from the least wear of the law over the domain (rounded) to the criterion of AC-2017.
ASSUMED: Mapping[str, tuple[float, float]] = {"t": (2.0, 15.0), "AW": (0.05, 0.3)}

POWER, FORCE_2016, FORCE_2017, WEAR_2017 = 7.0, 1300.0, 1500.0, 0.3  # kW, N, N, mm

SOURCE_2016 = "Alaskari and Oraby 2016, doi 10.15242/IIE.E1216006"
SOURCE_2017 = "Alaskari and Oraby 2017, Kuwait J. Sci. (accepted June 2017)"

NO_ROWS = "the papers print no rows and no standard errors of coefficients"


def ac2016() -> ParameterFile:
    """AC-2016: the laws, 7 kW and 1300 N.

    Examples
    --------
    >>> pf = ac2016()
    >>> round(pf.laws["AW"].values(V=154.7, f=0.53, d=2.5, t=10.0), 3), pf.limits.force.value
    (0.277, 1300.0)
    """
    misprint = "AC-2016 names the insert GC345, AC-2017 GC435."
    return _file("AC-2016", SOURCE_2016, ("eq. 6", "eq. 4", "eq. 5"), {"force": _force(FORCE_2016)}, misprint)


def ac2017() -> ParameterFile:
    """AC-2017: the laws, 7 kW, 1500 N and wear 0.3 mm.

    Examples
    --------
    >>> pf = ac2017()
    >>> pf.laws["AW"].coefficients["V"], pf.limits.wear.value
    (0.577, 0.3)
    """
    misprint = "Eq. 1 prints V^0.877; eq. 5, every table value and AC-2016 have V^0.577, which stands here."
    more = {"force": _force(FORCE_2017), "wear": {"value": WEAR_2017, "unit": "mm", "of": "AW"}}
    return _file("AC-2017", SOURCE_2017, ("eq. 1 (its exponent of V as in eq. 5)", "eq. 2", "eq. 3"), more, misprint)


def _file(
    paper: str, source: str, equations: tuple[str, str, str], limits: Mapping[str, object], note: str
) -> ParameterFile:
    sections: dict[str, object] = {
        "identity": {
            "tool": "GC435", "work": "709M40 (En 19)", "machine": "Colchester Mascot centre lathe", "iso513": "P",
            "setup": "dry rough turning, multi-coated carbide", "simulated": False, "note": note,
        },
        "laws": {law.response: _law(law, f"{source}, {eq}") for law, eq in zip(LAWS, equations, strict=True)},
        "limits": {
            "power": {"value": POWER, "unit": "kW", "of": "P"}, **limits, "speed": _range("V"), "feed": _range("f"),
        },
        "provenance": {"fitmodels": __version__, "options": {"paper": paper, "source": source}},
    }  # fmt: skip
    return sealed(ParameterFile.model_validate(sections))


def _law(law: SimulatedLaw, source: str) -> dict[str, Any]:
    powers = " ".join(f"{name}^{exponent:g}" for name, exponent in law.exponents.items())
    return {
        "form": "power", "response": law.response, "quantity": ROLES[law.response].quantity, "unit": law.unit,
        "equation": f"{law.response} = {law.c0:g} {powers}", "error": "multiplicative",
        "coefficients": {"c0": law.c0, **law.exponents}, "factors": [_factor(name) for name in law.exponents],
        "uncertainty": {"kind": "none", "reason": NO_ROWS}, "residual_se": STANDARD_ERROR[law.response],
        "residual_scale": "ln", "n": 0, "df": 0, "n_edges": TESTS,
        "statistics": {"r2": R2[law.response], "F": F[law.response]},
        "verdict": unchecked(NO_ROWS, f"Assumed, not printed: the range of {' and '.join(_assumed(law))}."),
        "notes": [
            f"{source}.",
            f"SE {STANDARD_ERROR[law.response]:g} is printed without its scale; taken as of the natural logarithm.",
            "The number of rows is not printed: n and df are 0 for unknown; 24 edges, sub-tests of 2 min.",
            *_assumptions(law),
        ],
    }  # fmt: skip


def _assumptions(law: SimulatedLaw) -> list[str]:
    return [
        f"Assumption: {name} from {low:g} to {high:g} {ROLES[name].unit}; no range of it is printed."
        for name, (low, high) in ASSUMED.items()
        if name in law.exponents
    ]


def _assumed(law: SimulatedLaw) -> list[str]:
    return [name for name in law.exponents if name in ASSUMED]


def _factor(name: str) -> dict[str, object]:
    low, high = {**DOMAIN, **ASSUMED}[name]
    return {"symbol": name, "quantity": ROLES[name].quantity, "unit": ROLES[name].unit, "low": low, "high": high}


def _range(name: str) -> dict[str, object]:
    low, high = DOMAIN[name]
    return {"low": low, "high": high, "unit": ROLES[name].unit}


def _force(value: float) -> dict[str, object]:
    return {"value": value, "unit": "N", "of": "Fxz"}
