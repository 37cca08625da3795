"""Uncertainty budgets: figures of GTC, the sum of the lines, the centre, degrees of freedom, and the command."""

import json
import math

import numpy as np
import pytest
from fitmodels import datasets, fit, parameters
from fitmodels.cli import main
from fitmodels.core.errors import ParameterError
from fitmodels.fit.regression import fit_form
from fitmodels.parameters import LawSection
from fitmodels.parameters.budget import effective_df, uncertainty_budget

EXACT = 1e-9
# GTC 1.5.1: multiple_ureal of the coefficients (df 76), ureal of the settings, y = exp(b0 + sum b ln(x/g)); then a new
# reading, ureal(0, s, 76) added to the exponent: value, u, effective df.
B, SE = (-1.859481, 0.571231, 0.174582, 0.262824, 0.279137), (0.008649, 0.026124, 0.015282, 0.022537, 0.011724)
CENTRE, AT = (120.0, 0.2, 1.6, 5.24148), {"V": 150.0, "f": 0.25, "d": 2.0, "t": 8.0}
U_AT = {"V": 1.5, "f": 0.005, "d": 0.05, "t": 0.1}
SCATTER = 0.0778383
GTC_LAW = (0.2195049429945927, 0.003609846743901501, 191.71454610821607)
GTC_READING = (0.2195049429945927, 0.01746306632376482, 82.87091083746178)
GTC_LINES = {
    "constant at the centre": 0.0018984982519602324,
    "exponent of V": 0.001279582583233095,
    "exponent of f": 0.0007485293613906047,
    "exponent of d": 0.0011038873326567242,
    "exponent of t": 0.00108816249923104,
    "setting V": 0.0012538799,
    "setting f": 0.0007664322391576397,
    "setting d": 0.001442279178440271,
    "setting t": 0.0007658993909085204,
}


def law_of_gtc():
    """The same law with its constant at V = f = d = t = 1, as a parameter file holds it."""
    away, se = np.log(CENTRE), np.array(SE)
    C = np.diag(se**2)
    C[0, 0] += away**2 @ se[1:] ** 2
    C[0, 1:] = C[1:, 0] = -away * se[1:] ** 2
    names = ("V", "f", "d", "t")
    return LawSection.model_validate({
        "form": "power", "response": "AW", "quantity": "average wear", "unit": "mm", "equation": "AW = ...",
        "error": "multiplicative",
        "coefficients": {"c0": math.exp(B[0] - away @ np.array(B[1:])), **dict(zip(names, B[1:], strict=True))},
        "factors": [
            {"symbol": s, "quantity": s, "unit": "", "low": g / 2, "high": 2 * g}
            for s, g in zip(names, CENTRE, strict=True)
        ],
        "uncertainty": {"kind": "covariance", "of": ["ln c0", *names], "matrix": C.tolist(), "df": 76},
        "residual_se": SCATTER, "residual_scale": "ln", "n": 81, "df": 76,
    })  # fmt: skip


@pytest.fixture(scope="module")
def simulated():
    laws, _ = fit.default_laws(datasets.read_runs(datasets.bundled("gc435_709m40")))
    return parameters.collect(laws=laws)


def test_the_budget_is_that_of_gtc():
    found = law_of_gtc().budget(AT, "mean", u=U_AT)
    assert (found.value, found.u, found.df) == pytest.approx(GTC_LAW, rel=1e-6)
    contributions = {line.name: line.contribution for line in found.lines}
    assert {name: abs(c) for name, c in contributions.items()} == pytest.approx(GTC_LINES, rel=1e-5)
    assert found.k == pytest.approx(1.972415117984819, rel=1e-6)  # reporting.k_factor of GTC


def test_a_reading_shares_its_deviations_with_the_coefficients():
    found = law_of_gtc().budget(AT, u=U_AT)
    assert (found.value, found.u) == pytest.approx(GTC_READING[:2], rel=1e-6)
    model, settings = 0.0130490**2, 0.0100085**2
    apart = [(model, 76, "coefficients"), (SCATTER**2, 76, "rows"), (settings, math.inf, "settings")]
    assert effective_df(apart) == pytest.approx(GTC_READING[2], abs=0.01)  # GTC takes the two as independent
    together = [(model, 76, "rows"), (SCATTER**2, 76, "rows"), (settings, math.inf, "settings")]
    assert found.df == pytest.approx(effective_df(together), rel=1e-4)
    assert 76 < found.df < GTC_READING[2]


def test_a_monte_carlo_of_the_inputs_gives_the_same_interval():
    rng, n = np.random.default_rng(1), 400_000
    b = rng.normal(B, SE, size=(n, 5))
    x = rng.normal(list(AT.values()), list(U_AT.values()), size=(n, 4))
    y = np.exp(b[:, 0] + (b[:, 1:] * np.log(x / CENTRE)).sum(axis=1))
    found = law_of_gtc().budget(AT, "mean", u=U_AT)
    assert y.std() == pytest.approx(found.u, rel=0.015)
    assert np.quantile(y, [0.025, 0.975]) == pytest.approx([found.low, found.high], rel=2e-3)


@pytest.mark.parametrize("kind", ["mean", "prediction"])
@pytest.mark.parametrize("response", ["AW", "Fxz", "P"])
def test_the_lines_add_up_to_the_variance_of_the_interval(simulated, response, kind):
    law = simulated.laws[response]
    at = {f.symbol: f.low * (f.high / f.low) ** 0.7 for f in law.factors}
    found = law.budget(at, kind)
    assert sum(line.share for line in found.lines) == pytest.approx(1, abs=EXACT)
    total = sum(math.copysign(line.contribution**2, line.contribution) for line in found.lines)
    assert math.sqrt(total) == pytest.approx(found.u, rel=EXACT)
    low, high = law.interval(kind=kind, **at)
    t = math.log(high / low) / 2 / (found.u / found.value)  # the interval of the file, in standard uncertainties
    assert t == pytest.approx(2.068657610419, rel=1e-6)  # Student's t, 23 degrees of freedom
    if kind == "mean":
        assert found.df == pytest.approx(23)
        assert (found.low, found.high) == pytest.approx((low, high), rel=1e-6)


def test_contributions_do_not_depend_on_the_units_of_the_factors(simulated):
    """The uncentred variances do: that is the trap (GUM H.3.5)."""
    law, at = simulated.laws["AW"], AT
    C = np.array(law.uncertainty.matrix)
    z = np.array([1.0, *np.log(list(at.values()))])
    naive = math.sqrt(sum(z**2 * np.diag(C)))
    found = law.budget(at, "mean")
    assert naive > 8 * found.u / found.value
    inch = law.model_dump()
    inch["factors"] = [{**f, "unit": "in"} if f["symbol"] == "d" else f for f in inch["factors"]]
    move = np.eye(len(z))
    move[0, 3] = np.log(25.4)  # ln c0 of a law in inches
    names = list(law.parameter_names)
    inch["uncertainty"] = {**inch["uncertainty"], "of": names, "matrix": (move @ C @ move.T).tolist()}
    inch["coefficients"] = {**inch["coefficients"], "c0": law.coefficients["c0"] * 25.4 ** law.coefficients["d"]}
    other = LawSection.model_validate({**inch, "region": None, "alternative": None})
    again = other.budget({**at, "d": at["d"] / 25.4}, "mean")
    assert [line.contribution for line in again.lines] == pytest.approx([x.contribution for x in found.lines], rel=1e-6)


@pytest.mark.parametrize("error", ["multiplicative", "additive"])
@pytest.mark.parametrize(
    "form", ["power", "linear", "exponential", "additive_wear", "second_order", "second_order_original"]
)
def test_a_law_of_every_form_has_the_budget_of_its_interval(form, error):
    runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    if form in ("linear", "second_order_original"):
        error = "additive"
    fitted = fit_form(runs, form, "P", ["V", "f", "AW"], error=error)
    law = parameters.collect(laws=[fitted]).laws["P"]
    at = {"V": 120.0, "f": 0.3, "AW": 0.2}
    found = law.budget(at, "mean")
    assert (found.low, found.high) == pytest.approx(law.interval(**at), rel=1e-9)
    assert sum(line.share for line in found.lines) == pytest.approx(1, abs=1e-9)


def test_an_additive_law_adds_in_the_unit_of_the_response():
    runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    fitted = fit.power_law(runs, "AW", ["V", "f", "d", "t"], error="additive")
    law = parameters.collect(laws=[fitted]).laws["AW"]
    found = law.budget(AT, u={"V": 1.5}, gauge=0.01)
    low, high = law.interval(kind="mean", **AT)
    mean = law.budget(AT, "mean")
    assert (mean.low, mean.high) == pytest.approx((low, high), rel=1e-6)
    assert found.u**2 == pytest.approx(
        mean.u**2 + law.edges.sd_between**2 + law.edges.sd_within**2 + 0.01**2
        + (law.coefficients["V"] * found.value / 150 * 1.5) ** 2, rel=1e-6,
    )  # fmt: skip
    assert not found.multiplies


def test_settings_act_through_the_wear_too(simulated):
    """dP/dV is the direct effect and that of V on the wear, which the law of power takes from the wear law."""
    wear = simulated.laws["AW"].budget(AT, u={"V": 1.5})
    power = simulated.laws["P"]
    found = power.budget(AT, u={"V": 1.5}, sources={"AW": wear})
    whole = power.coefficients["V"] + power.coefficients["AW"] * simulated.laws["AW"].coefficients["V"]
    (line,) = [line for line in found.lines if line.name == "setting V"]
    assert line.sensitivity == pytest.approx(whole * found.value / 150, rel=1e-6)
    (own,) = [line for line in found.lines if line.name == "AW from its own law"]
    without = simulated.laws["AW"].budget(AT)
    expected = power.coefficients["AW"] * without.u / without.value * found.value
    assert own.contribution == pytest.approx(expected, rel=1e-6)
    with pytest.raises(ParameterError, match="taken from its own law"):
        power.budget(AT, u={"AW": 0.01}, sources={"AW": wear})


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"u": {"V": -1.0}}, "standard uncertainty of V: -1"),
        ({"u": {"z": 1.0}}, "has no setting 'z'"),
        ({"gauge": math.nan}, "of the gauge: nan"),
        ({"level": 1.0}, "level 1 of an interval"),
        ({"kind": "tolerance"}, "mean or of a prediction"),
    ],
)
def test_what_has_no_budget(options, words):
    with pytest.raises(ParameterError, match=words):
        law_of_gtc().budget(AT, **options)
    bare = law_of_gtc().model_dump()
    none = LawSection.model_validate({**bare, "uncertainty": {"kind": "none", "reason": "printed law"}})
    with pytest.raises(ParameterError, match="no budget: printed law"):
        uncertainty_budget(none, AT)


def test_degrees_of_freedom_of_few_edges_are_not_those_of_rows(simulated):
    law = simulated.laws["AW"]
    few = LawSection.model_validate({
        **law.model_dump(), "edges": {**law.edges.model_dump(), "df_between": 3}, "alternative": None,
    })  # fmt: skip
    assert few.budget(AT).df < 12 < law.budget(AT).df
    assert "exact" in few.budget(AT).notes[0]


def test_the_command_prints_a_budget(simulated, tmp_path, capsys):
    path = tmp_path / "params.json"
    parameters.write(simulated, path)
    at = [str(path), *(f"{name}={value:g}" for name, value in AT.items()), "--budget"]
    assert main(["predict", *at, "--u", "V=1%", "--u", "f=+-0.01", "--gauge", "AW=3um", "--law", "P"]) == 0
    printed = capsys.readouterr().out
    assert "Uncertainty budget of P" in printed
    assert "AW from its own law" in printed
    assert main(["predict", *at, "--u", "V=1%", "--u", "f=+-0.01", "--gauge", "AW=3um", "--json"]) == 0
    wear, *_ = json.loads(capsys.readouterr().out)["budgets"]
    u = {line["name"]: line["u"] for line in wear["lines"]}
    assert (u["setting V"], u["setting f"], u["gauge"]) == pytest.approx((1.5, 0.01 / math.sqrt(3), 0.003))
    for wrong, words in (
        (["--u", "x=1"], "no law of the file has this factor"),
        (["--u", "V=fast"], "give a number of zero or more"),
        (["--gauge", "Ra=1"], "--gauge Ra"),
        (["--interval", "tolerance"], "mean or prediction"),
    ):
        assert main(["predict", *at, *wrong]) == 2
        assert words in " ".join(capsys.readouterr().err.split())
    assert main(["predict", *at[:-1], "--u", "V=1"]) == 2
    assert "add --budget" in capsys.readouterr().err
