"""Usual ranges of the exponents of cutting laws, by response, factor, process and tool.

Sources. Wear: Alaskari & Oraby 2016, doi 10.15242/IIE.E1216006 (V .577, f .168, d .248, t .245), and the milling data
of NASA Ames (f .32, d .63, t .79; current f .40, d .51, VB .31); life: Taylor 1907, with n of high-speed steel .08 to
.20, carbide .20 to .30 (coated to .5) and ceramic .40 to .60. Main force and power: Kienzle 1952, exponent of f equal
to 1 - mc with mc .20 to .27, Tabellenbuch Zerspantechnik 2022; feed force 1 - mf .2 to .5, passive force 1 - mp .4 to
.6. Drilling: torque as D^1.9 f^.8 and thrust as D f^.7 (Shaw & Oxford 1957). Roughness: f^2 / (8 r) of the geometry
is the exponent 2 of f and -1 of the nose radius. Temperature: .5 of V and .3 of f by dimensional analysis (Shaw, Metal
Cutting Principles, ch. 12), less where heat is lost. Limits beyond the usual, and what has no source, are judgement.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Array
from ...datasets.options import Process
from ...datasets.vocabulary import WEAR
from ..lawfit import LawFit

Range = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Exponent:
    """Usual range of an exponent, limits beyond which it is doubted, and the sign that it must have (0: either)."""

    usual: Range
    limits: Range
    sign: int = 0


# Names in four languages and grades; limits of n are judgement
_COATED = r"\bgc ?\d{3,4}\b|coat|beschichtet|revêtu|recubiert|\btin\b|tialn|altin|ticn"
ANY_TOOL = "any tool material"


@dataclass(frozen=True, slots=True)
class TaylorN:
    """Taylor's n of a tool material: usual range, and limits beyond which it is doubted."""

    material: str
    usual: Range
    limits: Range


_TAYLOR = {
    r"\bhss\b|high.speed steel|schnellarbeitsstahl|acier rapide": TaylorN("high-speed steel", (0.08, 0.2), (0.05, 0.3)),
    r"ceramic|keramik|céramique|cerámica|\bsialon\b|\bwhisker": TaylorN("ceramic", (0.4, 0.6), (0.25, 1.0)),
    _COATED: TaylorN("coated carbide", (0.2, 0.5), (0.12, 0.7)),
    r"carbide|hartmetall|carbure|metal duro|\b[pmk]\d\d\b": TaylorN("carbide", (0.2, 0.3), (0.12, 0.5)),
}


def usual_taylor_n(tool: str) -> TaylorN:
    """Range of Taylor's n by the tool material that a name states.

    Examples
    --------
    >>> usual_taylor_n("GC435").usual, usual_taylor_n("T1").material
    ((0.2, 0.5), 'any tool material')
    """
    found = (row for names, row in _TAYLOR.items() if re.search(names, tool.casefold()))
    return next(found, TaylorN(ANY_TOOL, (0.08, 0.6), (0.05, 1.0)))


_NO_TREND = Exponent((-0.1, 0.3), (-0.5, 0.8))  # of time in a law that may contain wear
_WEAR = {
    "V": Exponent((0.3, 3), (0.25, 5), 1),
    "f": Exponent((0, 1), (0, 1.5)),
    "d": Exponent((0, 1), (0, 1.5)),
    "ae": Exponent((0, 1), (0, 1.5)),
    "t": Exponent((0.2, 1.2), (0.05, 2), 1),
}
_LIFE = {
    "V": Exponent((-8, -1.5), (-15, -0.8), -1),
    "f": Exponent((-2, -0.5), (-4, 0)),
    "d": Exponent((-1, -0.1), (-3, 0)),
    "ae": Exponent((-1, 0), (-3, 0.3)),
}
_MAIN = {
    "V": Exponent((-0.3, 0.1), (-0.6, 0.4)),
    "f": Exponent((0.6, 1), (0.4, 1.2), 1),
    "d": Exponent((0.85, 1.1), (0.5, 1.4), 1),
    "ae": Exponent((0.3, 1.1), (0, 1.5), 1),
    "t": _NO_TREND,
    "wear": Exponent((0, 1), (0, 1.5)),
}
_POWER = _MAIN | {  # of the drive, which also runs idle, exponents are smaller than of the cut
    "V": Exponent((0.7, 1.1), (0.2, 1.5), 1),
    "f": Exponent((0.6, 1), (0.2, 1.2), 1),
    "d": Exponent((0.8, 1.1), (0.2, 1.4), 1),
    "wear": Exponent((0, 0.6), (0, 1.2)),
}
_COMPONENT = _MAIN | {  # of a direction that the symbol does not name: main, feed or passive force
    "V": Exponent((-0.5, 0.1), (-1, 0.5)),
    "f": Exponent((0.2, 1), (0, 1.3), 1),
    "d": Exponent((0.3, 1.3), (0, 2), 1),
    "wear": Exponent((0, 1), (0, 2)),
}
_FEED = _COMPONENT | {"f": Exponent((0.2, 0.5), (0, 0.9), 1), "d": Exponent((0.8, 1.3), (0.3, 2), 1)}
_PASSIVE = _COMPONENT | {"f": Exponent((0.4, 0.6), (0.1, 1), 1), "d": Exponent((0.2, 1), (-0.3, 1.4))}
_ROUGHNESS = {
    "V": Exponent((-0.6, 0.2), (-1.5, 1)),
    "f": Exponent((0.5, 2), (0, 3)),
    "d": Exponent((-0.2, 0.5), (-1, 1)),
    "re": Exponent((-1.2, 0), (-2, 0.6)),
}
_TEMPERATURE = {
    "V": Exponent((0.1, 0.6), (0, 1), 1),
    "f": Exponent((0.05, 0.4), (-0.2, 0.8)),
    "d": Exponent((0, 0.2), (-0.3, 0.6)),
    "t": Exponent((0, 0.3), (-0.3, 0.8)),
    "wear": Exponent((0, 0.4), (-0.2, 1)),
}
_CURRENT = {  # of a drive, which also runs idle; below its rated speed it follows the torque, above it the power
    "V": Exponent((0, 1), (-0.5, 1.5)),
    "f": Exponent((0.2, 1), (0, 1.2), 1),
    "d": Exponent((0.2, 1.1), (0, 1.4), 1),
    "ae": Exponent((0.2, 1.1), (0, 1.5), 1),
    "wear": Exponent((0, 0.6), (0, 1.2)),
}
_THRUST = {"f": Exponent((0.5, 0.9), (0.2, 1.3), 1), "D": Exponent((0.8, 1.2), (0.3, 2), 1)}
_DRILLING: Mapping[str, Mapping[str, Exponent]] = {
    "M": {"f": Exponent((0.6, 1), (0.3, 1.3), 1), "D": Exponent((1.6, 2.1), (1, 2.8), 1)},
    "P": {"D": Exponent((0.6, 1.2), (0, 2), 1)},
    **dict.fromkeys(("F", "Fz", "Fxz", "Ff"), _THRUST),
}
ROUGHNESS = ("Ra", "Rz")
_TABLE: Mapping[str, Mapping[str, Exponent]] = {
    **dict.fromkeys(WEAR, _WEAR),
    "T": _LIFE,
    "Fc": _MAIN,
    "M": _MAIN | {"V": Exponent((-0.3, 0.1), (-0.6, 0.6))},
    "Ff": _FEED,
    "Fp": _PASSIVE,
    **dict.fromkeys(("F", "Fx", "Fy", "Fz", "Fxz"), _COMPONENT),
    "P": _POWER,
    **dict.fromkeys(ROUGHNESS, _ROUGHNESS),
    "theta": _TEMPERATURE,
    "I": _CURRENT,
}
_LENGTHS = {"lf": "t", "lc": "t"}
SAME = {
    "n": "V",
    "fz": "f",
    "fm": "f",
    "Dc": "D",
    **_LENGTHS,
    **dict.fromkeys(WEAR, "wear"),
}  # factors with the range of another


def _is_drilled(factors: tuple[str, ...], process: Process | None) -> bool:
    """Whether the process is drilling, by its name or, without one, by a diameter without a depth of cut."""
    return process == "drilling" or (process is None and "d" not in factors and bool({"D", "Dc"} & set(factors)))


def usual_exponents(
    response: str, factors: tuple[str, ...], process: Process | None = None, tool: str = ""
) -> dict[str, Exponent]:
    """Ranges of the exponents of a response by factor, for those factors that have one.

    That of the speed in wear and life follows Taylor's n, where the name of the tool states its material. Beside a
    feed rate the exponent of the speed is that at a constant feed rate, which has no usual range, nor have speed and
    feed in wear after a length of cut; the depth in drilling is that of the hole.

    Examples
    --------
    >>> usual_exponents("Fc", ("f", "D"))["f"].usual, usual_exponents("P", ("V", "d"), "drilling").keys()
    ((0.6, 1), dict_keys(['V']))
    >>> usual_exponents("T", ("V",), tool="HSS")["V"].usual
    (-12.5, -5.0)
    """
    of_drilling = _DRILLING.get(response, {}) if _is_drilled(factors, process) else {}
    ranges = {**_TABLE.get(response, {}), **_of_tool(response, tool), **of_drilling}
    if process == "grinding":
        ranges = {name: one for name, one in ranges.items() if name == "t"}
    without = _without_range(response, factors, process)
    named = {name: SAME.get(name, name) for name in factors if name not in without}
    return {name: ranges[same] for name, same in named.items() if same in ranges}


def _without_range(response: str, factors: tuple[str, ...], process: Process | None) -> set[str]:
    """Factors that mean something else in these tests than in those of the usual ranges."""
    without = {"d"} if process == "drilling" else set[str]()
    if "fm" in factors:
        without |= {"V", "n"}
    if response in WEAR and not _LENGTHS.keys().isdisjoint(factors):
        without |= {"V", "n", "f", "fz", "fm"}
    return without


def _of_tool(response: str, tool: str) -> dict[str, Exponent]:
    """Exponent of the speed by the material of the tool: -1/n in life, k/n in wear on t^k."""
    n = usual_taylor_n(tool)
    if n.material == ANY_TOOL or response not in (*WEAR, "T"):
        return {}
    if response == "T":
        return {"V": Exponent(_negative_inverse(n.usual), _negative_inverse(n.limits), -1)}
    low, high = (_WEAR["t"].usual[0] / n.usual[1], _WEAR["t"].usual[1] / n.usual[0])
    return {"V": Exponent((round(low, 2), round(high, 1)), (low / 2, 1.5 * high), 1)}


def _negative_inverse(ends: Range) -> Range:
    return -1 / ends[0], -1 / ends[1]


STEP = 1e-4  # of the logarithm of a factor, and of a coefficient relative to its standard error


def local_exponents(law: LawFit, level: float = 0.95) -> dict[str, tuple[float, float, float]]:
    """Exponent d ln R/d ln X of each factor at the middle of the rows, with the ends of its interval (delta method).

    Those of a power law are its coefficients. Factors whose middle is zero, and laws that are not above zero there,
    have none.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    >>> law = fit.power_law(runs, "AW", ["V", "f", "d", "t"])
    >>> [round(b, 3) for b, _, _ in local_exponents(law).values()] == law.params.round(3).tolist()[1:]
    True
    """
    form, theta = law.formula, law.theta
    X = law.X
    middle = np.array([np.exp(np.log(x).mean()) if log else x.mean() for x, log in zip(X.T, form.logs, strict=True)])
    cov = law.covariance()
    se = np.sqrt(np.diag(cov))

    def slopes(at: Array) -> Array:
        """Exponents of the k factors for coefficients ``at``, shape (k,)."""
        up, down = (middle * np.exp(np.diag(np.full(len(middle), sign * STEP))) for sign in (1, -1))
        ends = [form.response_at(at, _without_shifts(law, form.design(points))) for points in (up, down)]
        with np.errstate(all="ignore"):
            return np.asarray((np.log(ends[0]) - np.log(ends[1])) / (2 * STEP), dtype=np.float64)

    b = slopes(theta)
    steps = np.where(se > 0, se, 0.0) * STEP
    J = np.column_stack(
        [(slopes(theta + h * e) - slopes(theta - h * e)) / (2 * h) if h else np.zeros(len(b))
         for h, e in zip(steps, np.eye(len(theta)), strict=True)]
    )  # fmt: skip
    half = law.t_quantile(level) * np.sqrt(np.einsum("ij,jk,ik->i", J, cov, J))
    found = zip(law.factors, b, half, middle, strict=True)
    return {name: (float(e), float(e - w), float(e + w)) for name, e, w, x in found if x > 0 and np.isfinite(e + w)}


def _without_shifts(law: LawFit, Z: Array) -> Array:
    """A design at the level of reference of the category, with as many columns as the law has coefficients."""
    return np.hstack([Z, np.zeros((len(Z), len(law.theta) - Z.shape[1]))])


def built_up_edge(law: LawFit, name: str) -> str:
    """The remedy where a roughness rises and then falls over the speed, as with a built-up edge; "" otherwise.

    The maximum is that of a square of the logarithm of the speed beside the other terms of a power law.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> built_up_edge(law, "V")
    ''
    """
    if law.response not in ROUGHNESS or SAME.get(name, name) != "V" or law.form != "power":
        return ""
    v = np.log(law.X[:, law.factors.index(name)])
    theta = np.linalg.lstsq(np.column_stack([law.design, v**2]), np.log(law.observed), rcond=None)[0]
    top = -float(theta[1 + law.factors.index(name)]) / (2 * float(theta[-1]))
    if theta[-1] >= 0 or not v.min() < top < v.max():
        return ""
    at = f"{float(f'{np.exp(top):.2g}'):g} {law.units.get(name, '')}".rstrip()
    return (
        f"{law.response} rises with {name} up to about {at} and then falls, as with a built-up edge: fit the tests "
        "below and above the maximum separately"
    )


SPEEDS = ("V", "n")
CUT = {"V": 1.0, "n": 1.0, "f": 0.75, "fz": 0.75, "d": 1.0, "ae": 1.0}  # exponents of the power of the cut
BETTER, CLEARLY_BETTER = 1.5, 3.0  # ratio of the variance about the law to that with a part in air: power, force
SURE = 4.0  # standard errors of the part in air


def power_in_air(law: LawFit) -> str:
    """The evidence that a power contains the power in air, which does not depend on the cut; "" without any.

    Exponents are then below the range of a cut, and ``P = P0 + b V f^0.75 d`` follows the rows better than the law, by
    relative residuals. P0 may rise with the speed, whose exponent need not be low then.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "P", ["V", "f", "d"])
    >>> power_in_air(law)
    ''
    """
    usual = {name: _POWER[SAME.get(name, name)].usual[0] for name in law.factors if name in CUT}
    if not (_has_rows(law) and {*law.factors} <= {*usual, *WEAR, "t"}):
        return ""
    low = {name: least for name, least in usual.items() if float(law.params[name]) < least}
    return next(filter(None, (_with_air(law, low, speed) for speed in _speeds(usual, low))), "")


def _speeds(usual: Mapping[str, float], low: Mapping[str, float]) -> list[str]:
    """Speeds over which a power in air is looked for, "" for a constant one; ``low``: factors of low exponents."""
    feeds = [name for name in usual if name not in SPEEDS]
    if len(usual) < 2 or not low.keys() >= set(feeds):
        return []
    speeds = [name for name in usual if name in SPEEDS and len(feeds) > 1]
    return ["", *speeds] if len(low) == len(usual) else speeds


def _has_rows(law: LawFit) -> bool:
    return law.form == "power" and law.rows is not None and law.df > 1


def _product(law: LawFit, powers: Mapping[str, float]) -> Array:
    """Product of the factors at each row, to these powers, or exponents of the law."""
    each = [law.X[:, j] ** powers.get(x, float(law.params[x])) for j, x in enumerate(law.factors)]
    return np.asarray(np.prod(each, axis=0), dtype=np.float64)


def _power(name: str) -> str:
    return name if CUT[name] == 1 else f"{name}^{CUT[name]:g}"


def _with_air(law: LawFit, low: Mapping[str, float], speed: str) -> str:
    """The sentence where a power in air, or a line of it over ``speed``, and a cut are better than the law; else ""."""
    cut = _product(law, CUT)
    of_air = np.ones((law.nobs, 1)) if not speed else np.column_stack([cut**0, law.X[:, law.factors.index(speed)]])
    Z = np.column_stack([of_air, cut])
    theta, s2, inverse = _relative(Z, law.observed)
    of_law = float(np.sum(np.log(law.observed / law.fitted) ** 2)) / law.df_resid
    air, middle = of_air @ theta[:-1], of_air.mean(axis=0)
    sure = SURE * np.sqrt(s2 * middle @ inverse[:-1, :-1] @ middle) < middle @ theta[:-1]
    if not (sure and (theta[1:] > 0).all() and (air < law.observed).all() and BETTER * s2 < of_law):
        return ""
    scatter = f"scatter {100 * np.sqrt(s2):.2g} % instead of {100 * np.sqrt(of_law):.2g} %"
    at = int(np.argmax(cut))
    return _in_air_words(law, low, speed, air, scatter, 100 * (1 - float(law.fitted[at] / (Z[at] @ theta))))


def _relative(Z: Array, observed: Array) -> tuple[Array, float, Array]:
    """Coefficients of columns Z by least relative squares, their residual variance, and the unscaled covariance."""
    A = Z / observed[:, None]
    inverse = np.asarray(np.linalg.pinv(A.T @ A), dtype=np.float64)
    theta: Array = inverse @ A.sum(axis=0)
    return theta, float(np.sum((1 - A @ theta) ** 2)) / max(len(observed) - len(theta), 1), inverse


def constant_in_force(law: LawFit, name: str, force: Array) -> str:
    """What shows that a main force, from which the law may be computed, contains a constant; "" where nothing does.

    ``F0 + b f^0.75 d`` then follows ``force``, shape (n,), N, much better than the law, whose other exponents it has.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "P", ["V", "f", "d"])
    >>> constant_in_force(law, "P", law.observed)
    ''
    """
    powers = {one: CUT[one] for one in law.factors if one in CUT and one not in SPEEDS}
    if len(powers) < 2 or not _has_rows(law):
        return ""
    cut = _product(law, {**CUT, **dict.fromkeys(SPEEDS, 0.0)})
    (constant, _), s2, inverse = _relative(np.column_stack([np.ones(law.nobs), cut]), force)
    of_law = float(np.sum(np.log(law.observed / law.fitted) ** 2)) / law.df_resid
    sure = SURE * np.sqrt(s2 * inverse[0, 0]) < constant < force.min()
    if not (sure and CLEARLY_BETTER * s2 < of_law):
        return ""
    return (
        f"{constant:.2g} N + b {' '.join(map(_power, powers))} follows {name} better than the law (scatter "
        f"{100 * np.sqrt(s2):.2g} % instead of {100 * np.sqrt(of_law):.2g} %): probably the zero of the dynamometer "
        "was not subtracted, or a force on the edge that does not depend on the cut is in it. If it reads about "
        f"{constant:.2g} N in air: --correct 'all:{name}-{constant:.2g}'."
    )


def _in_air_words(law: LawFit, low: Mapping[str, float], speed: str, air: Array, scatter: str, low_by: float) -> str:
    """The sentence on a power in air, by which the law is too low at the largest cut, in per cent."""
    found = ", ".join(f"{name} {float(law.params[name]):.2g} (usual from {least:g})" for name, least in low.items())
    unit = law.units.get(law.response, "")
    size = f"{' to '.join(dict.fromkeys(f'{end:.2g}' for end in (air.min(), air.max())))} {unit}".rstrip()
    cut = " ".join(_power(name) for name in law.factors if name in CUT)
    constant = ("", f": --correct 'all:{law.response}-{air[0]:.2g}'.")
    over, end = (f" over {speed}", f", at each {speed}.") if speed else constant
    return (
        f"{law.response} rises less than that of a cut, exponents {found}, and {size}{over} + b {cut} follows the rows "
        f"better ({scatter}): the power in air is probably in it, and at the largest cut the law is "
        f"{abs(low_by):.2g} % too {'low' if low_by > 0 else 'high'}. Subtract the power measured in air, about "
        f"{size}{end}"
    )
