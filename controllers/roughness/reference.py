"""Reference force of a roughness, and the force and the ideal roughness of a feed.

SURF's eq. 4, which is missing in the copy used, in two readings:

    inverse       F_ref = ln(Ra_ref / a) / b, of the law Ra = a exp(b F) (eq. 5)
    regression    F_ref = constant + slope ln Ra_ref, fitted to forces and desired roughness (Table 1: 450 + 260 ln Ra)

Both are reconstructions. They differ by 30 N at Ra 1.0 um: the table prints 448 N, the inverse gives 420 N.
"""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ...core.arrays import Array
from ...core.errors import ParameterError, UsageError

if TYPE_CHECKING:
    from ...parameters import LawSection, ParameterFile
    from ...parameters.sections.force_control import RoughnessSection

Reading = Literal["inverse", "regression"]
LARGEST_FEED = 1.5  # mm/rev: unusual beyond it in turning (judgement, as in the ranges of plausibility)
HIGHEST_FEED = 10.0  # mm/rev: impossible beyond it, whatever the nose radius


def settings_of(pf: "ParameterFile") -> "RoughnessSection":
    """The roughness section of a file.

    Raises
    ------
    ParameterError
        There is none, or it or its law is in other units than um, N and mm/rev.
    """
    section = pf.roughness
    if section is None:
        raise ParameterError("The file has no roughness section; add it with `fitmodels roughness`.")
    law = law_of(pf)
    units = section.unit_roughness, section.unit_force, section.unit_feed, law.unit, law.factors[0].unit
    if units != ("um", "N", "mm/rev", "um", "N"):
        message = f"The roughness section is in {', '.join(units[:3])} and its law in {units[3]} and {units[4]}"
        raise ParameterError(f"{message}; write them in um, N and mm/rev.")
    return section


def law_of(pf: "ParameterFile") -> "LawSection":
    """The law Ra = a exp(b F) of a file with a roughness section.

    Raises
    ------
    ParameterError
        It is missing, of another form, by levels, or falls with force.
    """
    name = "Ra" if pf.roughness is None else pf.roughness.law
    law = pf.laws.get(name)
    if law is None:
        raise ParameterError(f"The file has no law of {name[:40]!r}; fit one to roughness and force.")
    if law.form != "exponential" or law.by is not None or not law.coefficients["b"] > 0:
        form = "Ra = a exp(b F) of one level that rises with force"
        raise ParameterError(f"The law of {name[:40]} is not {form}; fit such a law.")
    return law


def reference_force(pf: "ParameterFile", roughness: float | None = None, force_from: Reading | None = None) -> float:
    """Force that gives a roughness.

    Parameters
    ----------
    pf : ParameterFile
        With a roughness section and its law.
    roughness : float, optional
        um; by default the roughness required by the file.
    force_from : {"inverse", "regression"}, optional
        By default the file's reading.

    Returns
    -------
    float
        N. Of the file's own roughness and reading: as it is written there.

    Raises
    ------
    UsageError
        The roughness has no force above the threshold, or no regression stands in the file.
    ParameterError
        The file lacks the section or its law.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> [round(reference_force(published("SURF"), 1.0, reading)) for reading in ("inverse", "regression")]
    [420, 450]
    """
    section = settings_of(pf)
    Ra = section.roughness if roughness is None else roughness
    reading = section.force_from if force_from is None else force_from
    if (Ra, reading) == (section.roughness, section.force_from):
        return section.force
    if not Ra > 0:
        raise UsageError(f"roughness {Ra!r} um: give a value above zero.")
    if reading == "inverse":
        law = law_of(pf).coefficients
        F = math.log(Ra / law["a"]) / law["b"]
    elif section.regression is not None:
        F = section.regression.constant + section.regression.slope * math.log(Ra)
    else:
        raise UsageError(
            f"roughness {Ra:g} um: the file holds no regression of force on roughness, only the force of "
            f"{section.roughness:g} um; add it as roughness.regression, or use the inverse of the law."
        )
    if not section.threshold < F < math.inf:
        raise UsageError(
            f"roughness {Ra:g} um needs a force of {F:.4g} N, not above the threshold of the control, "
            f"{section.threshold:g} N; choose a rougher surface, or lower the threshold."
        )
    return F


def regression_of_law(law: "LawSection") -> tuple[float, float]:
    """Constant and slope of least squares of F on ln Ra over the tests of a law, from the law alone, N.

    A law of n independent rows with s and var(b) holds Sxx = s^2/var(b), the mean force -cov(ln a, b)/var(b), and
    Syy = b^2 Sxx + df s^2, so that the slope of the other regression is b Sxx/Syy. Exact, no approximation.

    Raises
    ------
    ParameterError
        The covariance is not that of independent rows, or its errors are additive.

    Examples
    --------
    >>> from fitmodels import datasets, fit, parameters
    >>> law = fit.exponential_law(datasets.bundled("surf_table1"), "Ra", "F")
    >>> pf = parameters.collect(laws=[law])
    >>> [round(value) for value in regression_of_law(pf.laws["Ra"])]
    [458, 259]
    """
    C = law.uncertainty
    if C.kind == "none" or "independent" not in C.method or law.error != "multiplicative" or C.df != law.n - 2:
        raise ParameterError(
            "the regression of force on ln Ra does not follow from the law, whose covariance is not that of "
            "independent rows; give the tests with --data."
        )
    i, j = C.of.index("ln a"), C.of.index("b")
    b, of_b, both = law.coefficients["b"], C.matrix[j][j], C.matrix[i][j]
    mean_force = -both / of_b
    slope = b / (b * b + C.df * of_b)  # b Sxx / (b^2 Sxx + df s^2), times s^2/var(b) above and below
    return mean_force - slope * (math.log(law.coefficients["a"]) + b * mean_force), slope


def regression_of_tests(force: Array, roughness: Array) -> tuple[float, float]:
    """Constant and slope of least squares of force (n,), N, on ln of roughness (n,), um.

    Raises
    ------
    UsageError
        Fewer than three tests, one roughness alone, or a force that falls as the roughness rises.

    Examples
    --------
    >>> [round(value) for value in regression_of_tests(np.array([450.0, 630.0, 655.0]), np.array([1.0, 2.0, 2.2]))]
    [450, 260]
    """
    held = np.isfinite(force) & np.isfinite(roughness) & (roughness > 0)
    x, y = np.log(roughness[held]), force[held]
    if len(x) < 3 or not np.ptp(x) > 0:
        raise UsageError(f"{len(x)} tests with force and roughness: the regression needs 3 of different roughness.")
    slope, constant = np.polyfit(x, y, 1)
    if not slope > 0:
        raise UsageError(
            f"the regression of force on ln Ra falls by {-slope:.4g} N: a roughness that falls with force cannot be "
            "controlled by it; check the columns of force and roughness."
        )
    return float(constant), float(slope)


def force_law_of(pf: "ParameterFile", symbol: str, name: str | None = None) -> "LawSection | None":
    """Law of a force on feed, in N and mm/rev: that of a symbol, or the one named; None where the file has none.

    Raises
    ------
    ParameterError
        The law that was named does not exist, is not in N, or has no feed.
    """
    law = pf.laws.get(symbol if name is None else name)
    on_feed = law is not None and any((one.symbol, one.unit) == ("f", "mm/rev") for one in law.factors)
    if law is not None and law.unit == "N" and on_feed:
        return law
    if name is not None:
        held = "no such law" if law is None else f"the law {law.equation} in {law.unit}"
        raise ParameterError(
            f"force law {name[:40]}: the file has {held}; a force law is in N, on the feed f in mm/rev."
        )
    return None


def force_at(law: "LawSection", feed: float, depth: float | None, conditions: "Mapping[str, float | str]") -> float:
    """Force by a law at a feed, mm/rev, and a depth, mm, N; ``conditions`` are its other factors.

    Raises
    ------
    UsageError
        A factor of the law is not given.
    """
    known: dict[str, Any] = {**conditions, "f": feed} | ({} if depth is None else {"d": depth})
    units = {factor.symbol: factor.unit for factor in law.factors}
    names = [*units, *([] if law.by is None else [law.by.column])]
    if missing := [name for name in names if name not in known]:
        words = " ".join(f"{name}=...{units.get(name, '')}" for name in missing)
        raise UsageError(f"the force law {law.equation} needs {', '.join(missing)}; add {words}, or give kc a itself.")
    return float(law.values({name: known[name] for name in names}))


def tested_feeds(pf: "ParameterFile", force_law: "LawSection | None") -> tuple[float, float] | None:
    """Lowest and highest feed of the tests of a file, mm/rev; None where it states none."""
    of_law = () if force_law is None else force_law.factors
    for factor in (*of_law, *(() if pf.design is None else pf.design.factors)):
        if (factor.symbol, factor.unit) == ("f", "mm/rev"):
            return factor.low, factor.high
    return None


def roughness_law(pf: "ParameterFile", name: str | None = None) -> str:
    """Response of the law Ra = a exp(b F) of a file.

    Raises
    ------
    ParameterError
        There is none of that form that rises with force, in um and N, or there are several.
    """
    fitting = [
        response for response, law in pf.laws.items()
        if law.form == "exponential" and len(law.factors) == 1 and law.by is None
        and (law.unit, law.factors[0].unit) == ("um", "N") and law.coefficients["b"] > 0
    ]  # fmt: skip
    wanted = fitting if name is None else [name] if name in fitting else []
    if len(wanted) == 1:
        return wanted[0]
    if len(wanted) > 1:
        raise ParameterError(f"the file has laws of {', '.join(wanted)} on force; choose one with --law.")
    remedy = "fit one with `fitmodels FILE --law 'Ra ~ F' --form Ra=exponential`."
    form = "Ra = a exp(b F) that rises with force, in um and N"
    if name in pf.laws:
        raise ParameterError(f"the law {pf.laws[name].equation} is not {form}; {remedy}")
    raise ParameterError(f"the file has no law {'' if name is None else f'{name[:40]} '}of the form {form}; {remedy}")


def largest_feed(nose_radius: float | None, depth: float | None) -> tuple[float, str]:
    """Largest feed that can form a turned surface, mm/rev, and the reason.

    Above the nose radius the feed marks are no longer arcs of the nose; at a small depth the arc in cut is
    2 sqrt(d (2 r - d)) wide, and a larger feed leaves stock between two revolutions.

    Examples
    --------
    >>> largest_feed(0.8, 1.0)
    (0.8, 'the nose radius of 0.8 mm')
    >>> round(largest_feed(0.8, 0.05)[0], 3)
    0.557
    """
    if nose_radius is None:
        return LARGEST_FEED, f"{LARGEST_FEED:g} mm/rev, the largest usual in turning where no nose radius is given"
    if depth is not None and depth < nose_radius:
        width = 2 * math.sqrt(depth * (2 * nose_radius - depth))
        if width < nose_radius:
            return width, f"{width:.3g} mm, the arc of the nose radius {nose_radius:g} mm at a depth of {depth:g} mm"
    if nose_radius > HIGHEST_FEED:
        return HIGHEST_FEED, f"{HIGHEST_FEED:g} mm/rev, the largest possible in turning"
    return nose_radius, f"the nose radius of {nose_radius:g} mm"


def ideal_roughness(feed: float, nose_radius: float) -> float:
    """Arithmetic mean roughness of ideal feed marks, um: 1000 f^2/(18 sqrt(3) r), of parabolas of height f^2/(8 r).

    Examples
    --------
    >>> round(ideal_roughness(0.2, 0.8), 3)
    1.604
    """
    return 1000 * feed**2 / (18 * math.sqrt(3) * nose_radius)


def feed_of_ideal_roughness(roughness: float, nose_radius: float) -> float:
    """Feed whose ideal marks have a roughness, um: the inverse of `ideal_roughness`, mm/rev.

    Examples
    --------
    >>> round(feed_of_ideal_roughness(1.604, 0.8), 3)
    0.2
    """
    return math.sqrt(roughness * nose_radius * 18 * math.sqrt(3) / 1000)


def ideal_marks(feed: float, nose_radius: float, roughness: float) -> str:
    """A sentence on the ideal roughness at a feed, mm/rev, and the feed that a required one, um, allows."""
    ideal, finer = ideal_roughness(feed, nose_radius), feed_of_ideal_roughness(roughness, nose_radius)
    words = f"Ideal feed marks at {feed:.4g} mm/rev and nose radius {nose_radius:g} mm: Ra {ideal:.3g} um"
    if ideal > 1.005 * roughness:
        words += f", more than the required {roughness:g} um; {finer:.3g} mm/rev gives it"
    return f"{words}."


def outside_tests(law: "LawSection", given: "Mapping[str, float | str]") -> list[str]:
    """A sentence on each factor of a force law, other than the feed, whose value lies outside the tests."""
    found = []
    for one in law.factors:
        value = float(given[one.symbol])
        if one.symbol != "f" and not one.low * (1 - 1e-9) <= value <= one.high * (1 + 1e-9):
            tests = f"{one.low:g} to {one.high:g} {one.unit}"
            found.append(f"{one.symbol} {value:g} {one.unit} is outside the tests of {law.response}, {tests}.")
    return found


def feed_of_force(
    law: "LawSection",
    force: float,
    tested: tuple[float, float],
    depth: float | None,
    conditions: "Mapping[str, float | str]",
) -> float:
    """Feed at which a force law gives a force, N, inside the tested feeds, rounded down to 0.001 mm/rev.

    Raises
    ------
    UsageError
        No tested feed gives it.
    """
    from scipy.optimize import brentq

    low, high = tested
    ends = [force_at(law, feed, depth, conditions) for feed in tested]
    if not ends[0] <= force <= ends[1]:
        raise UsageError(
            f"the programmed feed is missing, and by {law.equation} no tested feed ({low:g} to {high:g} mm/rev: "
            f"{ends[0]:.4g} to {ends[1]:.4g} N) gives the reference force {force:.4g} N; add f=0.2mm/rev."
        )
    exact = float(brentq(lambda feed: force_at(law, feed, depth, conditions) - force, low, high))
    return max(math.floor(1000 * exact + 1e-9) / 1000, low)
