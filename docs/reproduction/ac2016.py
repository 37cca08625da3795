"""Ledger of AC-2016 (Alaskari & Oraby 2016, doi 10.15242/IIE.E1216006)."""

import math
from collections.abc import Iterator

from entry import Entry, Verdict
from fitmodels.controllers.region.operating_point import OperatingPoint
from fitmodels.controllers.region.visible import VisibleRegion, visible_region
from fitmodels.datasets.design import central_composite
from fitmodels.datasets.gc435 import DOMAIN
from fitmodels.parameters import ParameterFile
from fitmodels.parameters.published import published

NO_ROWS = "the rows of the tests are not printed"
EQUATIONS = {"P": "eq. 4", "Fxz": "eq. 5", "AW": "eq. 6"}
STATISTICS = {"P": ("0.97", "0.062", "4156"), "Fxz": ("0.83", "0.12", "670"), "AW": ("0.84", "0.1", "831")}
B, H, K = (154.7, 0.53), (144.0, 0.54), (147.0, 0.54)


def entries() -> list[Entry]:
    """Every number of the paper, in its order."""
    pf = published("AC-2016")
    region = visible_region(pf, d=2.5, t=10.0)
    return [
        *_tests(),
        *_laws(pf),
        *_substituted(pf),
        *_at_depth_and_time(region),
        *_visible(region),
        *_most_metal(region),
        *_least_wear(region),
        *_ranges(region),
        *_influence(region),
    ]


def _tests() -> Iterator[Entry]:
    edges = float(central_composite(DOMAIN, seed=1)["edge"].nunique())
    yield Entry("section II", "tests of the central composite design", "24", edges, "", "reproduced",
                "of a plan over the same three factors; the paper's own plan is not printed", "identity")  # fmt: skip
    for symbol, words, unit in (("V", "50-200", "m/min"), ("f", "0.06-0.6", "mm/rev"), ("d", "1.5-3", "mm")):
        yield Entry("section II", f"domain of {symbol}", words, None, unit, "not computable", "a choice of the tests")
    yield Entry("section II", "length of a sub-test", "2", None, "min", "not computable", "a choice of the tests")


def _laws(pf: ParameterFile) -> Iterator[Entry]:
    for name, place in EQUATIONS.items():
        law = pf.laws[name]
        numbers = ", ".join(f"{value:g}" for value in law.coefficients.values())
        yield Entry(place, f"constant and exponents of {name}", numbers, None, "", "not computable", NO_ROWS)
        r2, se, F = STATISTICS[name]
        df = float(F) * len(law.factors) * (1 - float(r2)) / float(r2)
        implied = f"{NO_ROWS}; F = (R2 / k) / ((1 - R2) / df) gives df of about {df:.0f} with k = {len(law.factors)}"
        for what, printed, why in (("R2", r2, NO_ROWS), ("SE", se, NO_ROWS), ("F", F, implied)):
            yield Entry(place, f"{what} of the law of {name}", printed, None, "", "not computable", why)


def _substituted(pf: ParameterFile) -> Iterator[Entry]:
    """Eq. 7 to 9: at 1 mm and 1 min the intercept is the constant, and what e mm or e min adds is an exponent."""
    one, deep, late = (visible_region(pf, d=d, t=t) for d, t in ((1.0, 1.0), (math.e, 1.0), (1.0, math.e)))
    h = pf.laws["AW"].coefficients["t"]
    yield Entry("eq. 7", "constant of the wear rate", "7.62e-3", h * pf.laws["AW"].coefficients["c0"], "mm/min",
                "corrected with proof", f"d/dt of t^{h} has the factor {h}, which the print omits")  # fmt: skip
    yield Entry("eq. 7", "exponent of t in the wear rate", "-0.755", h - 1, "", "reproduced")
    table: tuple[tuple[str, str, tuple[tuple[str, Verdict, str], ...]], ...] = (
        ("eq. 8", "P", (
            ("0.264", "corrected with proof", "a missing zero: 0.140 (7.62e-3)^0.342; eq. 10's 0.067 agrees with it"),
            ("1.0173", "reproduced", ""), ("0.6845", "reproduced", ""), ("0.9288", "reproduced", ""),
            ("0.0348", "reproduced", ""),
        )),
        ("eq. 9", "Fxz", (
            ("259.0", "reproduced", ""),
            ("0.1507", "reproduced", ""), ("0.4208", "reproduced", ""),
            ("1.243", "corrected with proof", "0.715 + 1.1 x 0.248, and eq. 11's 799.62 agrees with it"),
            ("0.0965", "reproduced", ""),
        )),
    )  # fmt: skip
    for place, name, lines in table:
        at = one.planes[name]
        ours = (
            math.exp(float(at.intercept)),
            float(at.slopes[0]),
            float(at.slopes[1]),
            float(deep.planes[name].intercept - at.intercept),
            float(late.planes[name].intercept - at.intercept),
        )
        for what, value, (printed, verdict, why) in zip(("", "V", "f", "d", "t"), ours, lines, strict=True):
            quantity = f"exponent of {what} in {name}" if what else f"constant of {name} with its wear substituted"
            yield Entry(place, quantity, printed, value, "" if what else at.unit, verdict, why)


def _at_depth_and_time(region: VisibleRegion) -> Iterator[Entry]:
    for place, name, printed in (("eq. 10", "P", "0.067"), ("eq. 11", "Fxz", "799.62"), ("eq. 14", "AW", "0.01681")):
        at = region.planes[name]
        value = math.exp(float(at.intercept))
        yield Entry(place, f"constant of {name} at d 2.5 mm, t 10 min", printed, value, at.unit, "reproduced")
    for place, name, i, printed in (
        ("eq. 10", "P", 0, "1.0173"), ("eq. 10", "P", 1, "0.6845"), ("eq. 11", "Fxz", 0, "0.1507"),
        ("eq. 11", "Fxz", 1, "0.4208"), ("eq. 13, 14", "AW", 0, "0.577"), ("eq. 13, 14", "AW", 1, "0.168"),
    ):  # fmt: skip
        yield Entry(place, f"exponent of {'Vf'[i]} in {name}", printed, float(region.planes[name].slopes[i]), "",
                    "reproduced", kind="identity" if name == "AW" else "finding")  # fmt: skip
    yield Entry("eq. 12", "MRR / (V f) at d 2.5 mm", "2500", region.at(1.0, 1.0).MRR, "", "reproduced", kind="identity")
    rate = region.at(1.0, 1.0).wear_rate
    yield Entry("eq. 13", "constant of the wear rate at d 2.5 mm, t 10 min", "1.681", rate, "um/min",
                "corrected with proof", "AW/t; the derivative has the further factor 0.245")  # fmt: skip


def _influence(region: VisibleRegion) -> Iterator[Entry]:
    """The text's claims on speed and feed, by exponents with the wear substituted and over the tested ranges."""
    ranges = {name: math.log(DOMAIN[name][1] / DOMAIN[name][0]) for name in ("V", "f")}
    slopes = {name: tuple(map(float, region.planes[name].slopes[:2])) for name in ("AW", "Fxz", "P")} | {"MRR": (1, 1)}
    claims: tuple[tuple[str, str, str, Verdict], ...] = (
        ("section II", "AW", "V activates edge wear and its rate more than f", "reproduced"),
        ("section II", "Fxz", "a reverse trend for the thrust force", "reproduced"),
        ("section II", "MRR", "a reverse trend for the metal removal rate", "reproduced"),
        ("section II", "P", "V and f have an equal influence on the power", "reproduced"),
    )
    for place, name, claim, verdict in claims:
        V, f = slopes[name]
        share = V * ranges["V"] / (f * ranges["f"])
        yield Entry(place, f"{claim}: effect of V over that of f on ln {name}, over the tested ranges", "in words",
                    share, "", verdict, f"exponents {V:.4g} and {f:.4g}, ranges 4-fold and 10-fold; per per cent of V "
                    f"and f the ratio is {V / f:.2f}")  # fmt: skip
    yield Entry("section III", "a lower speed reduces the cutting force: exponent of V in Fxz with its wear",
                "in words", slopes["Fxz"][0], "", "reproduced",
                "by the wear that the speed causes; at equal wear it is -0.484")  # fmt: skip


def _visible(region: VisibleRegion) -> Iterator[Entry]:
    for what, printed, unit in (("depth of cut", "2.5", "mm"), ("time", "10", "min"), ("limit of P", "7", "kW"),
                                ("limit of Fxz", "1300", "N")):  # fmt: skip
        yield Entry("section III", what, printed, None, unit, "not computable", "a choice, not a result")
    yield Entry("Fig. 4", "corners of the visible region, ABCDEFA", "6", float(len(region.corners)), "", "reproduced",
                "; ".join(f"{c.letter} {c.V:.4g}, {c.f:.4g}" for c in region.corners))  # fmt: skip


def _loads(point: OperatingPoint) -> str:
    return f"P {point.values['P']:.2f} kW and Fxz {point.values['Fxz']:.0f} N there"


def _most_metal(region: VisibleRegion) -> Iterator[Entry]:
    best, printed = region.best, region.at(*B)
    place, why = (
        "Fig. 5, point B",
        f"read off a chart: {_loads(printed)}, exceeding both limits; the computed value is their exact intersection",
    )
    yield Entry(place, "V of the greatest MRR", "154.7", best.V, "m/min", "corrected with proof", why)
    yield Entry(place, "f of the greatest MRR", "0.53", best.f, "mm/rev", "reproduced", "the exact corner")
    yield Entry(place, "greatest MRR", "205000", best.MRR, "mm3/min", "corrected with proof", why)
    yield Entry(place, "MRR at the printed pair", "205000", printed.MRR, "mm3/min", "reproduced", "to 5000 mm3/min")
    for name, limit in (("P", "7"), ("Fxz", "1300")):
        yield Entry(place, f"{name} at the printed pair, stated to lie on the boundary", limit, printed.values[name],
                    printed.units[name], "corrected with proof", "by eq. 4 to 6")  # fmt: skip
    yield from _wear_of("Fig. 6", printed, "27", "0.27")


def _wear_of(place: str, point: OperatingPoint, rate: str, wear: str) -> Iterator[Entry]:
    at = f"at V {point.V:g}, f {point.f:g}"
    without = 100 * point.values["AW"]  # AW/t in um/min after 10 min
    yield Entry(place, f"wear rate {at}", rate, point.wear_rate, "um/min", "corrected with proof",
                f"the print is AW/t, {without:.1f} truncated to whole um/min; dAW/dt is 0.245 of it")  # fmt: skip
    if wear:
        yield Entry(
            "Fig. 7", f"AW {at}", wear, point.values["AW"], "mm", "reproduced", "truncated, not rounded, in print"
        )


def _least_wear(region: VisibleRegion) -> Iterator[Entry]:
    printed, other = region.at(*H), region.at(*K)
    exact = region.least_wear(1 - 195000 / region.best.MRR)
    why = f"the exact pair of least wear at 195000 mm3/min; the printed one has {_loads(printed)[:-6]}, over 1300 N"
    place = "Fig. 6, point H"
    yield Entry(place, "V of the least wear rate", "144", exact.V, "m/min", "corrected with proof", why)
    yield Entry(place, "f of the least wear rate", "0.54", exact.f, "mm/rev", "corrected with proof", why)
    yield Entry(place, "MRR at the printed pair", "195000", printed.MRR, "mm3/min", "reproduced", "to 5000 mm3/min")
    yield Entry(place, "Fxz at the printed pair, stated to lie inside", "1300", printed.values["Fxz"], "N",
                "corrected with proof", f"{_loads(printed)}: inside the limit of power alone")  # fmt: skip
    yield from _wear_of("Fig. 6", printed, "26", "")
    why = f"at a given t wear and its rate are least at one pair; the printed one has {_loads(other)[:-6]}"
    yield Entry("Fig. 7", "V of the least wear", "147", exact.V, "m/min", "corrected with proof", why)
    yield Entry("Fig. 7", "f of the least wear", "0.54", exact.f, "mm/rev", "corrected with proof", why)
    yield Entry("Fig. 7", "AW at V 147, f 0.54", "0.26", other.values["AW"], "mm", "reproduced",
                "truncated, not rounded, in print")  # fmt: skip


def _ranges(region: VisibleRegion) -> Iterator[Entry]:
    best, exact = region.best, region.least_wear(1 - 195000 / region.best.MRR)
    why = (
        "from the exact pair of least wear at 195000 mm3/min to the exact optimum; the printed range exceeds the limits"
    )
    for what, printed, ours, unit in (
        ("least V", "144", exact.V, "m/min"), ("greatest V", "155", best.V, "m/min"),
        ("greatest f", "0.54", exact.f, "mm/rev"),
    ):  # fmt: skip
        yield Entry("region BGH", f"{what} of the practical range", printed, ours, unit, "corrected with proof", why)
    yield Entry("region BGH", "least f of the practical range", "0.53", best.f, "mm/rev", "reproduced")
    yield Entry("section III", "speed and feed beyond which nothing is gained", "144, 0.5", None, "m/min, mm/rev",
                "not computable", "a trade-off of metal and wear")  # fmt: skip
    yield Entry("section IV", "gain in MRR over fixed speed and feed", "5", None, "%", "not computable",
                "the fixed speed and feed are not named")  # fmt: skip
