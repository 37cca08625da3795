"""The parameter file predicts what the fit predicts, with intervals by edge, and those hold for a new edge."""

import re
from itertools import product

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit, parameters
from fitmodels.core.errors import ParameterError
from fitmodels.parameters import LawSection
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import t as student

ROUNDING = 1e-12  # a covariance made symmetric, a logarithm and its exponential
KINDS, EDGES, CENTRES = ("mean", "prediction", "tolerance"), ("new", "same"), ("median", "mean", "smeared")
LATER = {"rows_per_edge", "df_between", "df_within", "smearing_within", "smearing"}  # fields that earlier files lack
AT = {"V": [60.0, 120.0, 200.0], "f": 0.3, "d": 2.0, "t": [2.0, 10.0, 20.0]}


@pytest.mark.parametrize("error", ["multiplicative", "additive"])
@pytest.mark.parametrize("kind", ["mean", "prediction"])
def test_the_file_and_the_fit_agree(error, kind):
    runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    law = fit.power_law(runs, "AW", ["V", "f", "d", "t"], error=error)
    section = parameters.collect(tool="GC435", work="709M40", laws=[law]).laws["AW"]
    frame = {name: np.broadcast_to(values, 3) for name, values in AT.items()}
    band = law.predict(frame, kind, level=0.9).to_frame()
    low, high = section.interval(0.9, kind, **AT)
    np.testing.assert_allclose(section.values(**AT), band["value"], rtol=1e-12)
    np.testing.assert_allclose(low, band["low"], rtol=1e-9)
    np.testing.assert_allclose(high, band["high"], rtol=1e-9)
    assert section.uncertainty.method == "jackknife by edge (CR3)"
    assert section.uncertainty.df == 23


def test_prediction_intervals_hold_for_new_edges():
    """120 simulated tests, each judged on new edges of another: 95 % +- four standard errors of Monte Carlo."""
    ranges = {"V": (50, 200), "f": (0.06, 0.6), "d": (1.5, 3)}
    truth = {"V": 0.577, "f": 0.168, "d": 0.248, "t": 0.245}
    laws = [datasets.SimulatedLaw("AW", "mm", 7.62e-3, truth, 0.07, 0.07, digits=12)]
    plan = datasets.central_composite(ranges, seed=1)
    inside = []
    for seed in range(120):
        old, new = (
            datasets.runs_from_frame(datasets.simulate(plan, laws, t_max=12.0, criterion=None, seed=s))
            for s in (seed, 1000 + seed)
        )
        law = fit.power_law(old, "AW", list(truth))
        band = law.predict(new.data[list(truth)], "prediction").to_frame()
        hit = (new.values("AW") >= band["low"]) & (new.values("AW") <= band["high"])
        inside.append(hit.mean())
    error = np.std(inside) / np.sqrt(len(inside))
    assert np.mean(inside) == pytest.approx(0.95, abs=4 * error + 0.005)


def test_the_file_knows_the_region_of_the_design():
    """The corner of the axial box has 2.6 times the largest leverage of the 24 edges: outside, as `domain` says."""
    runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    law = fit.power_law(runs, "AW", ["V", "f", "d", "t"])
    section = parameters.collect(tool="GC435", work="709M40", laws=[law]).laws["AW"]
    rng = np.random.default_rng(2)
    points = {name: np.exp(rng.uniform(*np.log(ends), 300)) for name, ends in law.domain.items()}
    np.testing.assert_array_equal(section.inside(**points), law.region.inside(points))
    assert section.inside(V=100, f=0.2, d=2, t=8) is True
    assert section.inside(V=200, f=0.6, d=3, t=8) is False
    assert section.inside(**{name: runs.values(name) for name in ("V", "f", "d", "t")}).all()


# --- every interval from the file alone -----------------------------------------------------------------


def bundled(**columns):
    runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    return datasets.runs_from_frame(runs.data.drop(columns="point").assign(**columns))


def two_materials():
    """The bundled set, half of its edges of a second material that wears 30 % more."""
    frame = bundled().data
    second = frame["edge"].isin(sorted(set(frame["edge"]))[::2])
    return bundled(material=np.where(second, "hard", "soft"), AW=frame["AW"] * np.where(second, 1.3, 1.0))


def load(edges):
    rng = np.random.default_rng(3)
    edge, VB = np.repeat(np.arange(10), 5), np.tile([0.0, 0.1, 0.2, 0.25, 0.3], 10)
    fm = rng.uniform(100, 400, 50)
    I = 1 + 0.01 * fm + 3 * VB + rng.normal(0, 0.1, 10)[edge] + rng.normal(0, 0.1, 50)  # noqa: E741
    frame = pd.DataFrame({"edge": [f"E{g}" for g in edge], "fm": fm, "VB": VB, "I": I})
    return datasets.runs_from_frame(frame if edges else frame.drop(columns="edge"))


def roughness():
    rng = np.random.default_rng(5)
    F = rng.uniform(200, 700, 20)
    return datasets.runs_from_frame(pd.DataFrame({"F": F, "Ra": 0.24 * np.exp(0.003 * F + rng.normal(0, 0.1, 20))}))


def wear_law(error="multiplicative", **options):
    return fit.power_law(options.pop("runs", None) or bundled(), "AW", ["V", "f", "d", "t"], error=error, **options)


CONDITIONS = {"V": [60.0, 120.0, 200.0], "f": 0.3, "d": 2.0, "t": [2.0, 10.0, 20.0]}
FITS = {
    "errors multiply, by edge": (wear_law, CONDITIONS, {}),
    "errors add, by edge": (lambda: wear_law("additive"), CONDITIONS, {}),
    "errors multiply, independent rows": (lambda: wear_law(edge=None), CONDITIONS, {}),
    "errors add, independent rows": (lambda: wear_law("additive", edge=None), CONDITIONS, {}),
    "by material, by edge": (lambda: wear_law(runs=two_materials(), by="material"), CONDITIONS, {"material": "hard"}),
    "by material, rows": (
        lambda: wear_law("additive", runs=two_materials(), by="material", edge=None),
        CONDITIONS,
        {"material": "soft"},
    ),
    "a load line by edge": (lambda: fit.load_law(load(True)), {"fm": [150.0, 300.0, 390.0], "VB": 0.2}, {}),
    "a load line of rows": (lambda: fit.load_law(load(False)), {"fm": [150.0, 300.0, 390.0], "VB": 0.2}, {}),
    "an exponential law": (lambda: fit.exponential_law(roughness()), {"F": [250.0, 400.0, 650.0]}, {}),
}


def handed_over(law, tmp_path):
    """The law's section, written and read."""
    pf = parameters.collect(tool="a", work="b", laws=[law])
    return parameters.read(parameters.write(pf, tmp_path / "params.json")).laws[law.response]


@pytest.mark.parametrize("name", FITS)
def test_the_file_gives_every_interval_of_the_fit(name, tmp_path):
    make, at, category = FITS[name]
    law = make()
    assert bool(law.edges) == ("by edge" in name)
    section, by = handed_over(law, tmp_path), next(iter(category.values()), None)
    for kind, edge, centre in product(KINDS, EDGES, CENTRES):
        options = {"edge": edge, "coverage": 0.9, "centre": centre}
        band = law.predict({**at, **category}, kind, level=0.8, **options)
        result = section.predict(kind=kind, level=0.8, by=by, **options, **at)
        np.testing.assert_allclose(result.value, band.value, rtol=ROUNDING)
        np.testing.assert_allclose([result.low, result.high], [band.low, band.high], rtol=ROUNDING)
        np.testing.assert_array_equal(section.interval(0.8, kind, by, **options, **at), [result.low, result.high])
        np.testing.assert_array_equal(result.inside, band.inside)
        for name in ("edge", "centre", "coverage", "of", "kind", "level", "unit", "by"):
            assert getattr(result, name) == getattr(band, name)
        for ours, theirs in zip(result.given, band.given, strict=True):
            assert (ours.symbol, ours.unit, ours.low, ours.high) == (
                theirs.symbol,
                theirs.unit,
                theirs.low,
                theirs.high,
            )
            np.testing.assert_array_equal(ours.beyond, theirs.beyond)
        assert (result.low < result.value).all() or (kind, edge) == ("mean", "same") or centre != "median"


@pytest.mark.parametrize("error", ["multiplicative", "additive"])
def test_the_other_error_structure_in_the_file_gives_its_own(error, tmp_path):
    law = wear_law(error)
    other = handed_over(law, tmp_path).alternative
    band = law.alternative.predict(CONDITIONS, "tolerance", edge="same", centre="smeared").to_frame()
    np.testing.assert_allclose(
        other.interval(kind="tolerance", edge="same", centre="smeared", **CONDITIONS),
        band[["low", "high"]].T,
        rtol=1e-12,
    )


def earlier(section):
    """The section as an earlier version wrote it."""
    data = section.model_dump()
    for part in (data, data["edges"] or {}):
        for name in LATER:
            part.pop(name, None)
    return LawSection.model_validate({**data, "alternative": None})


def test_an_earlier_file_gives_what_it_can_and_names_what_it_lacks(tmp_path):
    law = wear_law()
    section = earlier(handed_over(law, tmp_path))
    for kind in ("mean", "prediction"):
        np.testing.assert_allclose(
            section.interval(kind=kind, **CONDITIONS),
            law.predict(CONDITIONS, kind).to_frame()[["low", "high"]].T,
            rtol=ROUNDING,
        )
    for options, words in (
        (
            {"kind": "tolerance"},
            r"lacks edges\.rows_per_edge, edges\.df_between, edges\.df_within .* tolerance interval",
        ),
        ({"edge": "same"}, r"lacks edges\.df_within in this file, which an interval for the same edge needs; fit the"),
        ({"kind": "mean", "centre": "mean"}, "lacks .* the interval of a mean needs"),
        ({"kind": "prediction", "centre": "smeared"}, "lacks smearing in this file, which the smeared mean needs"),
    ):
        with pytest.raises(ParameterError, match=f"the law of AW {words}"):
            section.interval(**options, **CONDITIONS)


def test_an_earlier_file_of_independent_rows_lacks_the_smearing_alone(tmp_path):
    law = wear_law(edge=None)
    section = earlier(handed_over(law, tmp_path))
    for kind, centre in product(KINDS, CENTRES[:2]):
        band = law.predict(CONDITIONS, kind, centre=centre).to_frame()
        ours = section.interval(kind=kind, centre=centre, **CONDITIONS)
        np.testing.assert_allclose(ours, band[["low", "high"]].T, rtol=ROUNDING)
    with pytest.raises(ParameterError, match="lacks smearing"):
        section.interval(centre="smeared", **CONDITIONS)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"edge": "old"}, "edge = 'old': it is one of 'new', 'same'"),
        ({"centre": "mode"}, "centre = 'mode'.*'median', 'mean', 'smeared'"),
        ({"coverage": 95}, "coverage 95 of an interval"),
        ({"V": "fast"}, "V = 'fast' is not a number"),
    ],
)
def test_what_cannot_be_determined_is_a_sentence(options, words, tmp_path):
    with pytest.raises(ParameterError, match=words):
        handed_over(wear_law(), tmp_path).predict(**{**CONDITIONS, **options})


# --- in words ---------------------------------------------------------------------------------------------


def hand_made(**changes):
    """AW = 0.01 V^0.5, of eight rows."""
    from fitmodels.parameters.sections.law import EXAMPLE

    return LawSection.model_validate({**EXAMPLE, **changes})


def test_a_sentence_with_numbers_by_hand():
    """ln 100 = 4.605: variance 0.9 - 2 x 0.19 x 4.605 + 0.0405 x 4.605^2 + 0.1^2, t(6) at 97.5 %."""
    x = np.log(100)
    half = student.ppf(0.975, 6) * np.sqrt(0.9 - 0.38 * x + 0.0405 * x**2 + 0.01)
    result = hand_made().predict(V=100.0)
    np.testing.assert_allclose([result.low, result.high], [0.1 * np.exp(-half), 0.1 * np.exp(half)], rtol=ROUNDING)
    assert result.words == (
        f"AW 0.100 mm at V 100 m/min; 95 % prediction interval for one row {0.1 * np.exp(-half):.3f} to "
        f"{0.1 * np.exp(half):.3f} mm; inside the tested region."
    )
    assert (type(result.value), result.inside, result.given[0].beyond) == (float, True, 0)


def test_what_is_outside_is_named():
    section = parameters.collect(tool="a", work="b", laws=[wear_law()]).laws["AW"]
    at = {"V": [120.0, 320.0, 40.0, 200.0], "f": [0.2, 0.2, 0.9, 0.6], "d": [2.0, 2.0, 2.0, 3.0], "t": 8.0}
    result = section.predict(**at)
    assert result.inside.tolist() == [True, False, False, False]
    assert [g.beyond.tolist() for g in result.given[:2]] == [[0, 1, -1, 0], [0, 0, 1, 0]]
    inside, fast, slow, corner = result.words.split("\n")
    assert inside.endswith("mm; inside the tested region.")
    rely = "; do not rely on it."
    assert fast.endswith(f"outside the tested region: V 320 m/min is above 200 m/min, the highest tested{rely}")
    both = "V 40 m/min is below 50 m/min, the lowest tested, and f 0.9 mm/rev is above 0.6 mm/rev, the highest tested"
    assert slow.endswith(f"outside the tested region: {both}{rely}")
    assert corner.endswith(
        f"outside the tested region: the combination is farther from the centre of the tests than any test{rely}"
    )
    assert [section.predict(**{k: v[i] if k != "t" else v for k, v in at.items()}).words for i in range(4)] == [
        inside, fast, slow, corner,
    ]  # fmt: skip


def test_without_a_region_the_ranges_tell():
    result = hand_made().predict(V=[50.0, 200.1, 49.9])
    assert result.inside.tolist() == [True, False, False]
    assert [line.split(": ")[-1] for line in result.words.split("\n")][1:] == [
        "V 200.1 m/min is above 200 m/min, the highest tested; do not rely on it.",
        "V 49.9 m/min is below 50 m/min, the lowest tested; do not rely on it.",
    ]


def test_centres_levels_and_shares_are_named():
    section = parameters.collect(tool="a", work="b", laws=[wear_law(runs=two_materials(), by="material")]).laws["AW"]
    at = {"V": 120.0, "f": 0.2, "d": 2.0, "t": 8.0}
    words = section.predict(kind="tolerance", level=0.9, by="hard", coverage=0.99, centre="smeared", **at).words
    assert "mm (smeared mean) at V 120 m/min, f 0.2 mm/rev, d 2 mm, t 8 min, material hard; " in words
    assert "90 % tolerance interval for 99 % of rows of a new edge " in words
    assert (
        "for the law at the level of an edge whose own level"
        in section.predict(kind="mean", by="soft", edge="same", **at).words
    )
    line = parameters.collect(tool="a", work="b", laws=[fit.load_law(load(True))]).laws["I"]
    assert " (" not in line.predict(centre="smeared", fm=200.0, VB=0.1).words


def test_a_wide_interval_keeps_its_lower_end():
    wide = {"kind": "covariance", "of": ["ln c0", "V"], "matrix": [[4.0, 0.0], [0.0, 0.0]], "df": 6}
    words = hand_made(uncertainty=wide).predict(V=100.0).words
    low = 0.1 * np.exp(-student.ppf(0.975, 6) * np.sqrt(4.01))
    assert f"{low:.5f}"[:-1] in words


@settings(max_examples=100, deadline=None)
@given(st.floats(1e-6, 1e6), st.floats(1e-4, 3.0), st.floats(0.5, 0.99))
def test_numbers_of_a_sentence_are_its_facts_to_the_last_digit(c0, sd, level):
    result = hand_made(coefficients={"c0": c0, "V": 0.5}, residual_se=sd).predict(level=level, V=100.0)
    number = r"(-?[0-9.]+(?:e[+-]?\d+)?)"
    found = re.fullmatch(rf"AW {number} mm at V 100 m/min; .* row {number} to {number} mm; inside .*", result.words)
    for text, fact in zip(found.groups(), (result.value, result.low, result.high), strict=True):
        digits, _, power = text.partition("e")
        unit = 10.0 ** (int(power or 0) - len(digits.partition(".")[2]))
        coarse = max(unit, 0.1 * min((result.high - result.low) / 2, result.low))  # two digits of the width, or finer
        assert abs(float(text) - fact) <= 0.51 * coarse
    assert result.low < result.value < result.high
