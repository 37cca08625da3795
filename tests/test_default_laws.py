"""Default laws by columns, and laws asked for in words: the commonest tables of the trade give their true exponents."""

import itertools

import numpy as np
import pandas as pd
import pytest
from fitmodels import analyse, datasets, fit
from fitmodels.core.errors import UsageError
from fitmodels.fit.defaults import asked_laws
from fitmodels.fit.law_requests import parse_law

EXACT = 1e-9  # relative, of exponents of data without scatter


def frame(**levels):
    """A full factorial of levels, a column for each header."""
    rows = list(itertools.product(*levels.values()))
    return pd.DataFrame(rows, columns=list(levels))


def laws_of(table, **options):
    return {law.response: law for law in fit.default_laws(datasets.runs_from_frame(table), **options)[0]}


def with_column(table, header, c0, **exponents):
    return table.assign(**{header: c0 * np.prod([table[x] ** b for x, b in exponents.items()], axis=0)})


TURNING = {"V": (100.0, 150, 220), "f": (0.1, 0.2, 0.35), "ap": (1.0, 2.0)}
# header of the response, constant, exponents, and the symbols of response and factors
TABLES = [
    (TURNING, "Ra", 25, {"V": -0.1, "f": 1.5, "ap": 0.05}, "Ra", ("V", "f", "d")),
    (TURNING, "Rz (um)", 90, {"V": -0.2, "f": 1.2, "ap": 0.1}, "Rz", ("V", "f", "d")),
    (TURNING, "T", 4e7, {"V": -2.9, "f": -0.9, "ap": -0.3}, "T", ("V", "f", "d")),
    (TURNING, "Temperature (°C)", 150, {"V": 0.3, "f": 0.12, "ap": 0.05}, "theta", ("V", "f", "d")),
    (TURNING, "Fz", 1800, {"V": -0.05, "f": 0.75, "ap": 1.0}, "Fz", ("V", "f", "d")),
    (
        {"n (rpm)": (600.0, 1200, 2000), "f (mm/rev)": (0.1, 0.2, 0.3), "Drill diameter (mm)": (6.0, 10, 14)},
        "Torque (N-m)", 0.3, {"f (mm/rev)": 0.8, "Drill diameter (mm)": 1.9}, "M", ("V", "f", "Dc"),
    ),
    (
        {"S (rpm)": (3000.0, 5000, 8000), "F (mm/min)": (300.0, 600, 1200), "ap": (0.5, 1), "ae": (2.0, 4)},
        "Ra", 0.002, {"F (mm/min)": 0.6, "S (rpm)": -0.4, "ap": 0.1, "ae": 0.05}, "Ra", ("n", "f", "d", "ae"),
    ),
    (
        {**TURNING, "Nose radius (mm)": (0.4, 0.8, 1.2)}, "Ra_mean", 31, {"f": 2, "Nose radius (mm)": -1}, "Ra",
        ("V", "f", "d", "re"),
    ),
]  # fmt: skip


@pytest.mark.parametrize(("levels", "header", "c0", "exponents", "response", "factors"), TABLES)
def test_the_commonest_tables_give_their_exponents_without_options(levels, header, c0, exponents, response, factors):
    law = laws_of(with_column(frame(**levels), header, c0, **exponents))[response]
    assert law.factors == factors
    found = law.params
    for name, true in zip(factors, levels, strict=True):
        if name in ("n", "f") and "S (rpm)" in levels:  # f = F/S
            true = {"n": "S (rpm)", "f": "F (mm/min)"}[name]
            expected = exponents[true] + (exponents["F (mm/min)"] if name == "n" else 0)
        else:
            expected = exponents.get(true, 0.0)
        assert found[name] == pytest.approx(expected, rel=EXACT, abs=EXACT)


def test_a_milling_table_of_n_D_fz_ae_gives_the_wear_law():
    table = frame(n=(1200.0, 1900, 3000), D=(20.0,), z=(4.0,), fz=(0.05, 0.1, 0.16), ae=(3.0, 6), t=(2.0, 5, 9))
    runs = datasets.runs_from_frame(with_column(table, "VB", 1e-3, n=0.5, fz=0.35, ae=0.15, t=0.5))
    (law,), refused = fit.default_laws(runs)
    assert (law.factors, refused) == (("V", "f", "ae", "t"), ())
    np.testing.assert_allclose(law.params.to_numpy()[1:], [0.5, 0.35, 0.15, 0.5], rtol=EXACT)


def fifteen_tools(seed=1, edge=0.05, row=0.03):
    """15 tools at 5 feeds of a machine of constant n and z: VB = c fm^.3 t^.61, as in CLM-2023."""
    rng = np.random.default_rng(seed)
    table = pd.DataFrame(
        [(k, (400, 500, 600, 700, 900)[k % 5], t) for k in range(15) for t in (0.5, 1, 1.5, 2, 2.5)],
        columns=["edge", "vf (mm/min)", "t"],
    )
    levels = rng.normal(0, edge, 15)[table["edge"]]
    noise = np.exp(levels + rng.normal(0, row, len(table)))
    return table.assign(VB=0.02 * table["vf (mm/min)"] ** 0.3 * table["t"] ** 0.61 * noise)


@pytest.mark.parametrize(
    ("more", "feed"), [({}, "fm"), ({"n": 10000, "z": 2}, "f"), ({"n": 10000, "z": 2, "D": 2}, "f")]
)
def test_a_feed_rate_enters_the_wear_law_of_fifteen_tools_at_five_feeds(more, feed):
    """The interval of the exponent covers .3 in 95 % of samples; these are the first 40 seeds."""
    covered = 0
    for seed in range(40):
        law = laws_of(fifteen_tools(seed).assign(**more))["VB"]
        assert law.factors == (feed, "t")
        ends = law.conf_int()
        covered += bool(ends.low[feed] < 0.3 < ends.high[feed])
    assert covered >= 34  # of 40; 33 or fewer have a probability below 1 % at a true level of .95


def test_a_feed_rate_that_a_constant_feed_per_revolution_does_not_show():
    table = frame(V=(60.0,), n=(10000.0,), f=(0.05,), t=(1.0, 2, 3), **{"vf (mm/min)": (400.0, 500, 700)})
    (law,) = laws_of(with_column(table, "VB", 0.01, **{"vf (mm/min)": 0.3, "t": 0.6})).values()
    assert law.params["fm"] == pytest.approx(0.3)


def test_a_cut_length_is_the_clock_where_no_time_follows():
    table = with_column(frame(V=(60.0, 90, 130), L=(100.0, 300, 600)), "VB", 1e-3, V=0.6, L=0.4)
    (law,) = laws_of(table).values()
    assert law.factors == ("V", "lf")
    assert law.params["lf"] == pytest.approx(0.4)


def test_wear_at_the_end_of_lives_is_no_response():
    table = with_column(frame(**TURNING), "T", 4e7, V=-2.9)
    wear = 0.3 + 0.01 * np.arange(len(table)) / len(table)
    found = laws_of(with_column(table, "Fc", 1900, f=0.75, ap=1).assign(VB=wear))
    assert {name: law.factors for name, law in found.items()} == {
        "T": ("V", "f", "d"), "Fc": ("V", "f", "d"), "P": ("V", "f", "d"),
    }  # fmt: skip


def test_a_numbering_of_tools_of_one_life_each_is_no_type_of_tool():
    table = with_column(frame(**TURNING), "T", 4e7, V=-2.9)
    runs = datasets.runs_from_frame(table.assign(tool=np.arange(1, len(table) + 1)))
    assert len(list(runs.pairs())) == 1
    assert runs.has("edge")


def test_a_column_T_that_rises_with_the_wear_is_the_time():
    rows = [(k, V, t) for k, V in enumerate((80.0, 120, 180, 240)) for t in (2.0, 5, 9, 14)]
    table = pd.DataFrame(rows, columns=["edge", "V", "T"])
    runs = datasets.runs_from_frame(with_column(table, "VB", 1e-3, V=0.7, T=0.4))
    (law,), _ = fit.default_laws(runs)
    assert law.factors == ("V", "t")
    assert "'T' rises with VB along the edges: it is the cutting time t, not a tool life T" in runs.assumed


def test_lengths_of_single_passes_are_summed_where_they_are_the_clock():
    rows = [(k, V, 200.0) for k, V in enumerate((80.0, 120, 180, 240)) for _ in range(4)]
    table = pd.DataFrame(rows, columns=["edge", "V", "cut length (mm)"])
    total = table.groupby("edge")["cut length (mm)"].cumsum()
    runs = datasets.runs_from_frame(table.assign(VB=1e-3 * table["V"] ** 0.7 * total**0.4))
    np.testing.assert_allclose(runs.values("lf"), total)
    (law,), _ = fit.default_laws(runs)
    assert law.params["lf"] == pytest.approx(0.4)


@pytest.mark.parametrize(("more", "role"), [({}, "Ff"), ({"thrust": "Fxz"}, "Fxz")])
def test_thrust_in_drilling_is_the_feed_force(more, role):
    levels = {"Drill diameter (mm)": (6.0, 10), "n": (600.0, 1200), "f": (0.1, 0.2)}
    table = with_column(frame(**levels), "thrust", 900, f=0.7).assign(M=1.0)
    runs = datasets.runs_from_frame(table, map={role: header for header, role in more.items()})
    assert (runs.process, runs.has(role)) == ("drilling", True)


def test_letters_of_a_plan_before_the_names_of_its_factors():
    table = frame(**{"A: Speed (m/min)": (100.0, 150), "B - Feed (mm/rev)": (0.1, 0.2), "C) DOC (mm)": (1.0, 2)})
    (law,) = laws_of(table.assign(Ra=25 * table["B - Feed (mm/rev)"] ** 1.5)).values()
    assert law.factors == ("V", "f", "d")


def test_the_current_of_one_cut_is_a_load_line_and_of_several_a_power_law():
    feeds = frame(**{"feed rate (mm/min)": (400.0, 600, 800), "VB": (0.05, 0.1, 0.2)})
    line = laws_of(feeds.assign(I=0.1 + 1e-4 * feeds["feed rate (mm/min)"] + 0.3 * feeds["VB"]))["I"]
    assert (line.form, line.factors) == ("load_line", ("fm", "VB"))
    teeth = frame(fz=(0.05, 0.1, 0.2), VB=(0.05, 0.1, 0.2))
    assert laws_of(teeth.assign(I=0.1 + 2 * teeth["fz"] + 0.3 * teeth["VB"]))["I"].factors == ("fz", "VB")
    depths = with_column(frame(f=(0.25, 0.5), d=(0.75, 1.5), VB=(0.05, 0.1, 0.2)), "I", 6, f=0.4, d=0.5, VB=0.3)
    law = laws_of(depths)["I"]
    assert (law.form, law.factors) == ("power", ("f", "d", "VB"))
    np.testing.assert_allclose(law.params.to_numpy(), [6, 0.4, 0.5, 0.3], rtol=EXACT)


def test_roughness_of_force_alone_is_the_exponential_of_the_paper():
    assert [law.form for law in asked_laws({"F", "f", "Ra"}.__contains__)] == ["power", "exponential"]
    with_speed = asked_laws({"V", "F", "f", "Ra"}.__contains__)[-1]
    assert (with_speed.form, with_speed.factors) == ("power", ("V", "f"))


def test_a_header_that_is_another_symbol_is_no_column_of_that_symbol():
    """F in mm/min is the feed rate fm, so that there is no force F."""
    table = frame(**{"F (mm/min)": (300.0, 600), "ae": (2.0, 4.0), "VB": (0.1, 0.2)})
    runs = datasets.runs_from_frame(table.assign(Ra=1.0 + table["ae"] / 10))
    laws, refused = fit.default_laws(runs)
    assert {law.response for law in laws} | {one.response for one in refused} == {"VB", "Ra"}


def test_repeated_readings_of_a_row_are_averaged():
    table = with_column(frame(V=(100.0, 150), f=(0.1, 0.2)), "Ra", 25, f=1.5)
    read = table[["V", "f"]].assign(**{"Ra1 (um)": table["Ra"] * 0.9, "Ra2 (um)": table["Ra"] * 1.1})
    runs = datasets.runs_from_frame(read)
    np.testing.assert_allclose(runs.values("Ra"), table["Ra"])
    assert "Ra is the mean of the readings in columns 'Ra1 (um)' and 'Ra2 (um)' of each row" in runs.assumed
    with_mean = datasets.runs_from_frame(read.assign(**{"Mean Ra (um)": 2.0}))
    assert set(with_mean.values("Ra")) == {2.0}


def test_laws_in_words_replace_the_default_or_change_its_factors():
    runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    laws, _ = fit.default_laws(runs, laws=["P ~ Vc, feed + ap", "AW ~ - d", "Fxz ~ + P"])
    assert {law.response: law.factors for law in laws} == {
        "AW": ("V", "f", "t"), "Fxz": ("V", "f", "d", "t", "AW", "P"), "P": ("V", "f", "d"),
    }  # fmt: skip
    power = fit.power_law(runs, "P", ["V", "f", "d"])
    np.testing.assert_array_equal(laws[2].params, power.params)


def test_a_column_without_a_role_may_be_a_factor():
    table = frame(**TURNING, hardness=(150.0, 200, 250))
    law = laws_of(with_column(table, "Fc", 20, f=0.75, ap=1, hardness=0.5), laws=["Fc ~ + hardness"])["Fc"]
    assert law.params["hardness"] == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("Ra", "write it as"),
        ("Ra ~", "write it as"),
        ("~ V", "write it as"),
        ("Ra ~ V, , f", "a name is missing"),
        ("Ra ~ V, V", "V is named twice"),
        ("Ra ~ Ra, f", "Ra is the response and cannot be its own factor"),
        ("ln(Ra) ~ ln(V)", "takes the logarithms itself"),
        ("Ra ~ V*f", "without ln.., products or powers"),
        ("Ra ~ V^2", "without ln.., products or powers"),
        (3, "write it as"),
    ],
)
def test_a_text_that_is_no_law_is_refused(text, words):
    with pytest.raises(UsageError, match=words):
        parse_law(text)


def test_a_law_of_a_column_that_is_not_there_names_the_columns():
    runs = datasets.runs_from_frame(frame(**TURNING).assign(Ra=1.0))
    with pytest.raises(UsageError, match=r"law 'Ra ~ V, t': there is no column 't'; there are V, f, d, Ra"):
        fit.default_laws(runs, laws=["Ra ~ V, t"])
    with pytest.raises(UsageError, match="two laws of Ra are asked for"):
        fit.default_laws(runs, laws=["Ra ~ V", "roughness ~ f"])


def test_laws_of_an_analysis_are_recorded():
    table = with_column(frame(**TURNING), "Ra", 25, f=1.5, V=-0.1)
    rng = np.random.default_rng(2)
    table["Ra"] *= np.exp(rng.normal(0, 0.05, len(table)))
    found = analyse(table, laws=["Ra ~ V, f"], draws=1000)
    assert found.laws[0].factors == ("V", "f")
    assert found.parameters.provenance.options["law"] == ["Ra ~ V, f"]
    with pytest.raises(UsageError, match="give a list of texts"):
        analyse(table, laws="Ra ~ V")


def test_torque_at_one_cutting_speed_is_of_the_diameter_not_of_the_speed_that_follows_it():
    table = frame(V=(25.0,), **{"Drill diameter (mm)": (6.0, 8, 10), "f (mm/rev)": (0.1, 0.2, 0.3)})
    table["M (Nm)"] = 0.44 * table["f (mm/rev)"] ** 0.8 * table["Drill diameter (mm)"] ** 1.9
    law = laws_of(table)["M"]
    assert set(law.factors) == {"f", "Dc"}
    assert law.params["Dc"] == pytest.approx(1.9)


def test_lives_at_one_speed_are_refused_by_the_speed():
    _, refused = fit.default_laws(datasets.runs_from_frame(pd.DataFrame({"V": [200.0] * 4, "T": [12.0, 14, 13, 17]})))
    assert "V is left out: constant (200 in all 4 rows). Vary at least one condition" in refused[0].reason
