"""Priors: proper, in units, from a file of one's own, and refused in words where they cannot be."""

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit
from fitmodels.core.errors import DataError, FitError, UsageError
from fitmodels.fit.bayes.priors import Beta, Flat, HalfT, Normal, Priors, reference, weak
from fitmodels.fit.bayes.priors_file import read_priors, replaced
from scipy import integrate, stats


@pytest.mark.parametrize(
    ("prior", "peer"),
    [
        (Normal(0.4, 2.0), stats.norm(0.4, 2.0)),
        (HalfT(4.0, 0.3), None),
        (Beta(2.0, 3.0), stats.beta(2.0, 3.0)),
    ],
    ids=["normal", "half-t", "beta"],
)
def test_densities_are_scipys_and_integrate_to_one(prior, peer):
    x = np.linspace(0.01, 0.99, 50)
    expected = peer.logpdf(x) if peer else np.log(2) + stats.t(4.0, scale=0.3).logpdf(x)
    np.testing.assert_allclose(prior.log_density(x), expected, rtol=1e-12)
    low, high = (-np.inf, np.inf) if isinstance(prior, Normal) else (0.0, 1.0 if isinstance(prior, Beta) else np.inf)
    assert integrate.quad(lambda v: np.exp(prior.log_density(np.array(v))), low, high)[0] == pytest.approx(1.0)
    draws = prior.draw(np.random.default_rng(1), 20_000)
    assert stats.kstest(draws, peer.cdf if peer else lambda v: 2 * stats.t(4.0, scale=0.3).cdf(v) - 1).pvalue > 1e-3


def test_scaling_widens_and_keeps_the_centre():
    assert Normal(1.0, 2.0).scaled(0.5) == Normal(1.0, 1.0)
    assert HalfT(4.0, 0.3).scaled(2.0) == HalfT(4.0, 0.6)
    assert Beta(1.0, 1.0).scaled(2.0) == Beta(1.0, 1.0)


def wear_law(**options):
    return fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"], **options)


@pytest.mark.parametrize("error", ["multiplicative", "additive"])
def test_the_default_is_proper_in_units_and_with_a_source(error):
    priors = weak(wear_law(error=error), edges=True)
    assert priors.proper
    assert set(priors.of) == {"level", "V", "f", "d", "t", "sd", "icc"}
    assert priors.units["level"] == "ln mm"
    assert priors.units["sd"] == ("ln" if error == "multiplicative" else "mm")
    assert all(priors.sources[name] for name in priors.of)


def test_the_published_law_lies_well_inside_the_default():
    """Alaskari & Oraby, doi 10.15242/IIE.E1216006: exponents .577, .168, .248, .245."""
    priors = weak(wear_law(), edges=True).of
    for name, value in {"V": 0.577, "f": 0.168, "d": 0.248, "t": 0.245}.items():
        assert abs(value - priors[name].mean) < priors[name].sd


def test_lines_and_unknown_quantities_take_widths_from_the_data():
    rng = np.random.default_rng(1)
    fm, VB = rng.uniform(200, 1000, 30), rng.uniform(0, 0.2, 30)
    table = pd.DataFrame({"fm [mm/min]": fm, "VB": VB, "I": 0.1 + 1e-4 * fm + 0.2 * VB + rng.normal(0, 0.005, 30)})
    law = fit.load_law(datasets.runs_from_frame(table))
    priors = weak(law, edges=False)
    assert priors.units == {
        "level": "A", "B": "A/(mm/min)", "k1": "A/(mm)", "sd": "A", "icc": "1",
    }  # fmt: skip
    assert priors.of["B"].sd == pytest.approx(2.5 * law.observed.std(ddof=1) / fm.std(ddof=1))
    post = fit.posterior(law)
    assert post.method == "exact"
    assert post.draws[:, 1].mean() == pytest.approx(law.params["B"], rel=0.02)


FILE = """
[AW]
source = "forty tests of the same grade"
level = {{ distribution = "lognormal", median = {median}, factor = 3, unit = "{unit}" }}
V = {{ distribution = "normal", mean = 2.0, sd = 0.5 }}
sd = {{ distribution = "half-t", df = 4, scale = 0.1 }}
icc = {{ distribution = "beta", a = 1, b = 3 }}
"""


@pytest.mark.parametrize(("median", "unit"), [(0.2, "mm"), (200, "um"), (0.2 / 25.4, "in")])
def test_a_file_replaces_what_it_names_in_any_unit(tmp_path, median, unit):
    path = tmp_path / "mine.toml"
    path.write_text(FILE.format(median=median, unit=unit), encoding="utf-8")
    post = fit.posterior(wear_law(), priors=path)
    assert post.priors.name == "mine.toml"
    assert post.priors.of["level"].mean == pytest.approx(np.log(0.2))
    assert post.priors.of["V"] == Normal(2.0, 0.5)
    assert post.priors.of["f"] == Normal(0.0, 2.0)
    assert post.priors.sources["V"] == "forty tests of the same grade"


def test_a_tight_prior_pulls_and_a_weak_one_does_not():
    law = wear_law()
    tight = fit.posterior(law, priors={"AW": {"V": {"distribution": "normal", "mean": 2.0, "sd": 0.001}}})
    assert tight.draws[:, 1].mean() == pytest.approx(2.0, abs=0.01)
    assert fit.posterior(law).draws[:, 1].mean() == pytest.approx(law.params["V"], abs=0.01)


WRONG = {
    "a negative scale": ({"V": {"distribution": "normal", "mean": 0, "sd": -1}}, r"sd is -1; it must lie above 0"),
    "no width": ({"V": {"distribution": "normal", "mean": 0, "sd": 0}}, r"sd is 0; it must lie above 0"),
    "a missing number": ({"V": {"distribution": "normal", "mean": 0}}, r"sd is None; a normal prior needs mean and sd"),
    "not a number": ({"V": {"distribution": "normal", "mean": "x", "sd": 1}}, r"mean is 'x'"),
    "infinity": ({"V": {"distribution": "normal", "mean": 0, "sd": float("inf")}}, r"sd is inf"),
    "an improper one": ({"sd": {"distribution": "flat"}}, r"a flat prior is improper"),
    "one over sigma": ({"sd": {"distribution": "1/sigma"}}, r"improper"),
    "a table as a distribution": ({"V": {"distribution": {}}}, r"no distribution \{\}"),
    "a long value": ({"V": {"distribution": "normal", "mean": "x" * 10**5, "sd": 1}}, r"is 'x{56}\.\.\.; a"),
    "a distribution that there is not": ({"V": {"distribution": "cauchy", "scale": 1}}, r"no distribution 'cauchy'"),
    "a parameter that there is not": ({"vc": {"distribution": "normal", "mean": 0, "sd": 1}}, r"no parameter 'vc'"),
    "a normal scatter": ({"sd": {"distribution": "normal", "mean": 0, "sd": 1}}, r"takes a half-t one"),
    "a share beyond one": ({"icc": {"distribution": "half-t", "df": 4, "scale": 1}}, r"takes a beta one"),
    "a wrong unit": (
        {"level": {"distribution": "lognormal", "median": 3, "factor": 2, "unit": "kN"}},
        r"is in mm, not in kN",
    ),
    "a unit that there is not": (
        {"level": {"distribution": "lognormal", "median": 3, "factor": 2, "unit": "blorp"}},
        r"is in mm, not in blorp",
    ),
    "a factor below one": ({"level": {"distribution": "lognormal", "median": 0.2, "factor": 0.5}}, r"above 1"),
    "a number beside": ({"V": {"distribution": "normal", "mean": 0, "sd": 1, "df": 3}}, r"has no 'df'"),
    "no table": ({"V": 3}, r"write it as"),
}  # fmt: skip


@pytest.mark.parametrize(("given", "words"), WRONG.values(), ids=WRONG.keys())
def test_bad_priors_are_refused_in_a_sentence(given, words):
    with pytest.raises(UsageError, match=words) as error:
        fit.posterior(wear_law(), priors={"AW": given})
    assert "\n" not in str(error.value)


def test_files_that_are_no_priors(tmp_path):
    with pytest.raises(DataError, match="cannot be read"):
        read_priors(tmp_path / "none.toml")
    broken = tmp_path / "broken.toml"
    broken.write_text("[AW\n", encoding="utf-8")
    with pytest.raises(DataError, match="is not TOML"):
        read_priors(broken)


def test_a_set_of_ones_own_is_complete_and_proper():
    law = wear_law()
    with pytest.raises(UsageError, match="no prior for"):
        fit.posterior(law, priors=Priors({"level": Normal(0, 1)}, "mine"))
    half = Priors({**weak(law, edges=True).of, "V": Flat()}, "mine")
    with pytest.raises(UsageError, match="improper"):
        fit.posterior(law, priors=half)
    assert not reference(law, edges=True).proper


def test_priors_far_from_the_data_are_refused():
    """An exponent of 1e15 leaves no number in the posterior."""
    far = {"AW": {"V": {"distribution": "normal", "mean": 1e15, "sd": 0.5}}}
    with pytest.raises(FitError, match="the priors contradict the data"), np.errstate(all="ignore"):
        fit.posterior(wear_law(), priors=far)


def test_a_file_without_priors_is_refused(tmp_path):
    (tmp_path / "priors.toml").write_text("# nothing yet\n")
    with pytest.raises(DataError, match="holds no table of priors"):
        read_priors(tmp_path / "priors.toml")


@pytest.mark.parametrize("sd", [5e-324, 1e300])
def test_numbers_that_no_parameter_has_are_refused(sd):
    given = {"AW": {"V": {"distribution": "normal", "mean": 0.5, "sd": sd}}}
    law = fit.power_law(datasets.read_runs(datasets.bundled("ac2017_table1")), "AW", ["V", "f"])
    with pytest.raises(UsageError, match="give it between 1e-12 and 1e\\+12"):
        replaced(weak(law, edges=False), law, given, "mine")
