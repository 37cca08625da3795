"""Simulated tests: seeded, stopped at the criterion, and true to the laws they were drawn from."""

import io

import numpy as np
import pandas as pd
import pytest
from fitmodels.core.errors import DataError, UsageError
from fitmodels.datasets.design import central_composite
from fitmodels.datasets.simulation import SimulatedLaw, SimulatedResponse, simulate, weibull_deviation, write_csv
from scipy.stats import norm, weibull_min

WEAR = SimulatedLaw("AW", "mm", 7.62e-3, {"V": 0.577, "f": 0.168, "d": 0.248, "t": 0.245}, 0.07, 0.07)
POWER = SimulatedLaw("P", "kW", 0.14, {"V": 0.82, "f": 0.627, "d": 0.844, "t": -0.049, "AW": 0.342}, 0.04, 0.03)
RANGES = {"V": (50.0, 200.0), "f": (0.06, 0.6), "d": (1.5, 3.0)}
PLAN = central_composite(RANGES, seed=1)
SIGMAS = 4.0  # Monte Carlo allowance: 4 standard errors, with the seed fixed


def test_the_same_seed_gives_the_same_rows_and_another_seed_others():
    first, again, other = (simulate(PLAN, [WEAR, POWER], seed=s) for s in (7, 7, 8))
    pd.testing.assert_frame_equal(first, again)
    assert not first["AW"].iloc[:10].equals(other["AW"].iloc[:10])


def test_columns_are_the_edge_the_factors_the_time_and_the_responses():
    rows = simulate(PLAN, [WEAR, POWER], seed=7)
    assert list(rows.columns) == ["edge", "point", "V", "f", "d", "t", "AW", "P"]
    assert rows.groupby("edge")[["V", "f", "d"]].nunique().max().max() == 1
    assert rows["edge"].unique().tolist() == PLAN["edge"].tolist()


def test_every_edge_stops_with_the_first_row_that_reaches_the_criterion():
    rows = simulate(PLAN, [WEAR], t_max=60.0, criterion=0.2, seed=7)
    stopped = 0
    for _, edge in rows.groupby("edge"):
        assert edge["t"].tolist() == [2.0 * (i + 1) for i in range(len(edge))]
        assert (edge["AW"].iloc[:-1] < 0.2).all()
        assert edge["AW"].iloc[-1] >= 0.2 or edge["t"].iloc[-1] == 60.0
        stopped += edge["AW"].iloc[-1] >= 0.2
    assert 5 < stopped < 24


def test_wear_written_down_as_the_criterion_itself_stops_the_edge():
    law = SimulatedLaw("AW", "mm", 0.1, {"t": 0.5}, 0.0, 0.0)
    rows = simulate(pd.DataFrame({"edge": ["E1"]}), [law], interval=1.0, criterion=0.2, seed=1)
    assert rows["AW"].tolist() == [0.1, 0.1414, 0.1732, 0.2]


@pytest.mark.parametrize(
    ("interval", "t_max", "count", "last"), [(2.0, 20.0, 10, 20.0), (3.0, 20.0, 6, 18.0), (0.1, 0.3, 3, 0.3)]
)
def test_without_a_criterion_every_edge_runs_to_the_end(interval, t_max, count, last):
    rows = simulate(PLAN, [WEAR], interval=interval, t_max=t_max, criterion=None, seed=7)
    assert (rows.groupby("edge").size() == count).all()
    assert rows["t"].max() == last


def test_longer_tests_other_criteria_and_further_laws_leave_the_other_numbers():
    whole = simulate(PLAN, [WEAR, POWER], t_max=30.0, criterion=None, seed=7)
    part = simulate(PLAN, [WEAR], t_max=20.0, criterion=0.2, seed=7)
    joined = part.merge(whole, on=["edge", "t"], suffixes=("", "_whole"), validate="one_to_one")
    assert len(joined) == len(part)
    assert (joined["AW"] == joined["AW_whole"]).all()


def test_a_later_law_takes_the_response_as_it_was_written():
    power = SimulatedLaw("P", "kW", 2.0, {"AW": 3.0}, 0.0, 0.0, digits=12)
    rows = simulate(PLAN, [WEAR, power], seed=7)
    assert rows["P"].to_numpy() == pytest.approx(2 * rows["AW"].to_numpy() ** 3, rel=1e-10)


def test_values_have_the_digits_of_their_law():
    rows = simulate(PLAN, [SimulatedLaw("AW", "mm", 0.01, {"V": 0.5, "t": 0.2}, 0.1, 0.1, digits=2)], seed=7)
    assert all(float(f"{x:.2g}") == x for x in rows["AW"])
    assert rows["AW"].nunique() > 10


@pytest.mark.parametrize("law", [WEAR, POWER])
def test_a_large_simulated_set_gives_back_exponents_and_both_deviations(law):
    plan = central_composite(RANGES, centre=200, axial_repeats=200, seed=2)
    rows = simulate(plan, [WEAR, POWER], criterion=None, seed=11)
    m = rows.groupby("edge").size().iloc[0]
    factors = list(law.exponents)
    residual = np.log(rows[law.response] / law.median({c: rows[c] for c in factors}))
    by_edge = residual.groupby(rows["edge"])
    n = by_edge.ngroups
    within = by_edge.var().mean()
    between = by_edge.mean().var() - within / m
    # standard errors of the variance estimates of a balanced one-way layout
    assert within == pytest.approx(law.sd_row**2, abs=SIGMAS * law.sd_row**2 * np.sqrt(2 / (n * (m - 1))))
    spread = (law.sd_edge**2 + law.sd_row**2 / m) * np.sqrt(2 / (n - 1))
    assert between == pytest.approx(law.sd_edge**2, abs=SIGMAS * spread)
    x = np.column_stack([np.ones(len(rows)), np.log(rows[factors].to_numpy())])
    fitted, *_ = np.linalg.lstsq(x, np.log(rows[law.response].to_numpy()), rcond=None)
    inverse = np.linalg.inv(x.T @ x)
    scores = pd.DataFrame(x).mul(residual.to_numpy(), axis=0).groupby(rows["edge"].to_numpy()).sum().to_numpy()
    error = np.sqrt(np.diag(inverse @ (scores.T @ scores) @ inverse))
    truth = np.array([np.log(law.c0), *law.exponents.values()])
    assert (abs(fitted - truth) < SIGMAS * error).all()
    assert (error[1:] < 0.02).all()


def test_the_design_stays_as_it_was():
    before = PLAN.copy(deep=True)
    simulate(PLAN, [WEAR], seed=7)
    pd.testing.assert_frame_equal(PLAN, before)


@pytest.mark.parametrize(
    ("laws", "options", "words"),
    [
        ([POWER], {}, ["law of P", "'AW'"]),
        ([POWER, WEAR], {}, ["law of P", "'AW'", "first"]),
        ([WEAR, WEAR], {}, ["law of AW", "taken"]),
        ([], {}, ["no laws"]),
        ([WEAR], {"wear": "VB"}, ["'VB'", "AW"]),
        ([WEAR], {"interval": 0.0}, ["interval 0 min"]),
        ([WEAR], {"t_max": 1.0}, ["t_max 1 min", "2 min"]),
        ([WEAR], {"criterion": 0.0}, ["criterion 0"]),
    ],
)
def test_what_cannot_be_asked_is_reported_in_a_sentence(laws, options, words):
    with pytest.raises(UsageError) as error:
        simulate(PLAN, laws, seed=7, **options)
    assert all(word in str(error.value) for word in words)


@pytest.mark.parametrize(
    ("design", "words"),
    [
        (PLAN.drop(columns="edge"), ["'edge'"]),
        (PLAN.iloc[:0], ["no rows"]),
        (pd.concat([PLAN, PLAN.iloc[[0]]]), [PLAN["edge"].iloc[0], "twice"]),
        (PLAN.assign(V=[-5.0, *PLAN["V"][1:]]), [PLAN["edge"].iloc[0], "V -5", "positive"]),
        (PLAN.assign(t=1.0), ["'t'"]),
    ],
)
def test_a_design_that_cannot_be_cut_is_reported_in_a_sentence(design, words):
    with pytest.raises(DataError) as error:
        simulate(design, [WEAR], seed=7)
    assert all(word in str(error.value) for word in words)


@pytest.mark.parametrize(
    "change",
    [
        {"c0": 0.0},
        {"c0": float("inf")},
        {"sd_edge": -0.1},
        {"sd_row": float("nan")},
        {"exponents": {"V": float("nan")}},
        {"digits": 0},
    ],
)
def test_a_law_checks_its_numbers(change):
    sound = {
        "response": "AW",
        "unit": "mm",
        "c0": 1.0,
        "exponents": {"V": 1.0},
        "sd_edge": 0.1,
        "sd_row": 0.1,
    }
    SimulatedLaw(**sound)
    with pytest.raises(UsageError, match="law of AW"):
        SimulatedLaw(**{**sound, **change})


def test_a_written_file_reads_back_the_same(tmp_path):
    rows = simulate(PLAN, [WEAR, POWER], seed=7)
    path = tmp_path / "data.csv"
    write_csv(rows, path, ["simulated: yes", "two\nlines"])
    text = path.read_bytes().decode()
    assert text.startswith("# simulated: yes\n# two\n# lines\n")
    assert text.splitlines()[3] == "edge,point,V [m/min],f [mm/rev],d [mm],t [min],AW [mm],P [kW]"
    assert "\r" not in text
    back = pd.read_csv(path, comment="#", dtype=str).set_axis(rows.columns, axis=1)
    pd.testing.assert_frame_equal(back.astype(rows.dtypes.to_dict()), rows, check_exact=True)
    assert [p.name for p in tmp_path.iterdir()] == ["data.csv"]


def test_a_stream_and_given_units_and_whole_numbers():
    stream = io.StringIO()
    write_csv(pd.DataFrame({"V": [100.0, 0.1], "n": [1, 2]}), stream, [], units={"V": "m/s"})
    assert stream.getvalue() == "V [m/s],n\n100,1\n0.1,2\n"


def test_weibull_lives_have_the_quantiles_of_their_distribution():
    """Deviations by scipy's weibull_min: ln T less its median, of the shape 1/s, at ranks of normal deviates."""
    z = np.linspace(-3, 3, 13)
    shape = 3.7
    lives = weibull_min(shape, scale=20.0)
    expected = np.log(lives.ppf(norm.cdf(z)) / lives.median())
    np.testing.assert_allclose(weibull_deviation(z) / shape, expected, atol=1e-9)
    law = SimulatedResponse("T", "min", (), lambda _: np.array(lives.median()), 0.0, 1 / shape, weibull=True, digits=12)
    np.testing.assert_allclose(law.recorded({}, 0.0, z), lives.ppf(norm.cdf(z)), rtol=1e-9)
