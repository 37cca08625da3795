"""Units and values of a file of tests are judged by what cutting allows: sound files stay silent, mistakes are named.

Ranges: criteria of wear in use (ISO 3685: VB .3 mm mean, .6 mm largest) and machines; unit ratios of NIST SP 811.
"""

import re
import shlex

import numpy as np
import pandas as pd
import pytest
from fitmodels import analyse, datasets, fit
from fitmodels.core import errors
from fitmodels.datasets.plausibility.quantities import unit_factor
from fitmodels.datasets.plausibility.ranges import candidate_units, plausible, process_of
from fitmodels.datasets.vocabulary import ROLES, role_of
from fitmodels.fit.checks.usefulness import doubts_of_reading
from fitmodels.fit.checks.wrong_rows import outlying_rows
from fitmodels.parameters.checks.report import require_verdicts
from hypothesis import given, settings
from hypothesis import strategies as st

SAME = 1e-8  # numbers are written to ten digits
RANGED = [role for role in ROLES if plausible(role, None) is not None]


def rows(n=24, seed=3):
    """Tests about the wear law of Alaskari & Oraby 2016: V m/min, f mm/rev, d mm, t min, VB mm, P kW."""
    rng = np.random.default_rng(seed)
    V, f, d = rng.choice([80.0, 120, 180], n), rng.choice([0.1, 0.2, 0.4], n), rng.choice([1.0, 1.6, 2.5], n)
    t = rng.choice([2.0, 5, 10, 18], n)
    VB = 0.00762 * V**0.577 * f**0.168 * d**0.248 * t**0.245 * np.exp(0.05 * rng.normal(size=n))
    P = 2.4e3 * V * f**0.8 * d / 60000
    return {"V": V, "f": f, "d": d, "t": t, "VB": VB.round(4), "P": P.round(3)}


def text(columns, headers=None):
    names = [(headers or {}).get(name, name) for name in columns]
    body = "\n".join(",".join(f"{v:.10g}" for v in row) for row in zip(*columns.values(), strict=True))
    return f"{','.join(names)}\n{body}\n"


@pytest.fixture
def read(tmp_path):
    def reads(content, **options):
        path = tmp_path / "tests.csv"
        path.write_text(content, "utf-8")
        return datasets.read_runs(path, **options)

    return reads


def typed(remedy):
    """The options of a remedy as keywords of `read_runs`."""
    words = shlex.split(remedy)
    found = {"map": {}, "units": {}}
    for flag, value in zip(words[::2], words[1::2], strict=True):
        symbol, _, given_value = value.partition("=")
        found[{"--map": "map", "--unit": "units"}[flag]][symbol] = given_value
    return found


def outcome(read, content):
    """The refusal of a file, "" where it is read, and its doubts."""
    try:
        return "", read(content).doubts
    except errors.DataError as refusal:
        return str(refusal), ()


def said(runs):
    return [str(doubt) for doubt in runs.doubts]


@pytest.mark.parametrize("name", datasets.bundled_names())
def test_bundled_sets_are_silent(name):
    assert said(datasets.read_runs(datasets.bundled(name))) == []


def test_a_sound_file_is_silent_with_and_without_units(read):
    units = {name: f"{name} [{ROLES[name].unit}]" for name in rows()}
    assert said(read(text(rows(), units))) == []
    assert said(read(text(rows()))) == []


@pytest.mark.parametrize("role", RANGED)
@settings(max_examples=20, deadline=None)
@given(data=st.data())
def test_usual_values_pass_in_the_default_unit(role, data):
    low, high = plausible(role, process_of((role,), ())).usual
    high = min(high, 600) if role == "V" else high  # speeds above may be those of the spindle
    values = data.draw(st.lists(st.floats(low, high), min_size=6, max_size=6))
    frame = {role: values, "x": [1.0, 2, 3, 4, 5, 6]}
    runs = datasets.runs_from_frame(pd.DataFrame(frame))
    assert [doubt for doubt in said(runs) if "unit" in doubt or "usual" in doubt] == []
    assert runs.values(role).tolist() == values


@pytest.mark.parametrize(
    ("role", "unit"), [(role, unit) for role in RANGED for unit in candidate_units(role)[1:]]
)  # fmt: skip
def test_a_unit_mistake_of_a_whole_column_is_reinterpreted_asked_or_harmless(read, role, unit):
    """A column in another unit that leaves the plausible range is converted with a doubt, or refused with the unit."""
    low, high = plausible(role, None).usual
    truth = np.geomspace(max(low, high / 20), high, 12)
    written = truth / unit_factor(unit, role)
    content = text({role: written, "x": np.arange(12.0)})
    limits = plausible(role, None).unusual
    silent = limits[0] <= written[2] and written[-3] <= limits[1]  # of 12 values
    refusal, doubts = outcome(read, content)
    assert silent or doubts or f"--unit {role}={unit}" in refusal or "as feed rate, --map fm" in refusal
    if refusal or any(typed(doubt.remedy)["units"].get(role) == unit for doubt in doubts):
        assert read(content, units={role: unit}).values(role) == pytest.approx(truth, rel=SAME)


@pytest.mark.parametrize(
    ("role", "factor", "unit"),
    [("VB", 1000, "um"), ("V", 1 / 60, "m/s"), ("t", 60, "s"), ("P", 1000, "W"), ("f", 1 / 25.4, "in/rev")],
)
def test_the_only_plausible_unit_is_taken_and_said(read, role, factor, unit):
    columns = rows()
    columns[role] = columns[role] * factor
    named = {name: f"{name} [{ROLES[name].unit}]" for name in columns if name != role}
    named |= {"f": "f"} if role == "f" else {}
    if role == "f":
        named = {}
        columns = {name: columns[name] for name in ("f", "t")}
    runs = read(text(columns, named))
    assert runs.values(role) == pytest.approx(rows()[role], rel=1e-6)
    (doubt,) = (one for one in runs.doubts if one.columns == (role,) and "unit" in one.sentence)
    assert f"is taken as {unit}" in doubt.sentence
    assert doubt.remedy == f"--unit {role}={unit}"
    assert "unit" not in str(said(read(text(columns, named), **typed(doubt.remedy))))


def test_small_wear_in_a_metric_file_stays_in_mm_with_a_doubt(read):
    columns = {name: rows()[name] for name in ("V", "t", "VB")} | {"VB": rows()["VB"] / 25.4}
    runs = read(text(columns, {"V": "V [m/min]"}))
    assert runs.values("VB").max() < 0.02
    assert [doubt.remedy for doubt in runs.doubts if "VB" in doubt.columns] == ["--unit VB=mm"]
    assert read(text(columns)).values("VB").max() > 0.2


@pytest.mark.parametrize(
    ("factor", "header"), [(1 / 25.4, "VB [mm]"), (40.0, "VB [mm]"), (1 / 25.4, "VB"), (40.0, "VB")]
)
def test_no_inch_unit_is_proposed_for_the_wear_of_a_metric_file(read, factor, header):
    columns = rows() | {"VB": rows()["VB"] * factor}
    try:
        words = " ".join(map(str, read(text(columns, {"V": "V [m/min]", "VB": header})).doubts))
    except errors.DataError as refusal:
        words = str(refusal)
    assert "VB" in words
    assert not re.search(r"\bmil\b|\bin\b(?! mm)|=in\b", words)


def test_wear_in_um_under_a_header_in_mm_is_refused_with_the_unit(read):
    columns = rows() | {"VB": rows()["VB"] * 1000}
    with pytest.raises(errors.DataError, match=r"VB .* mm cannot be .* um can: --unit VB=um"):
        read(text(columns, {"VB": "VB [mm]"}))
    assert read(text(columns, {"VB": "VB [mm]"}), units={"VB": "um"}).values("VB") == pytest.approx(rows()["VB"])


def test_a_unit_of_the_user_is_doubted_and_never_changed(read):
    runs = read(text({name: rows()[name] for name in ("t", "VB")}), units={"VB": "mil"})
    assert runs.values("VB") == pytest.approx(rows()["VB"] * 0.0254)
    assert any("VB" in doubt.columns and "unusual" in doubt.sentence for doubt in runs.doubts)


def test_a_unit_given_against_a_usual_one_of_the_header_is_stated_and_doubted(read):
    columns = {name: values for name, values in rows().items() if name != "P"}
    headers = {"V": "vc [m/min]", "f": "f [mm/rev]", "d": "d [mm]", "VB": "VB [mm]"}
    runs = read(text(columns, headers), units={"V": "sfm", "d": "mm"})
    assert [x for x in runs.assumed if "header" in x] == [
        "units given against the file: V, the header says m/min, --unit V=sfm is used"
    ]
    (doubt,) = runs.doubts
    assert (doubt.columns, doubt.remedy, doubt.unsettled) == (("V",), "--unit V=m/min", False)
    assert "V 80 to 180 m/min, as the header names it, is usual" in doubt.sentence


@pytest.mark.parametrize(
    ("role", "factor", "header", "unit"),
    [("VB", 1000, "VB [mm]", "um"), ("t", 60, "t [min]", "s"), ("Fc", 0.1, "Fc [N]", "daN"),
     ("d", 1 / 25.4, "d [mm]", "in")],
)  # fmt: skip
def test_a_unit_given_as_a_check_proposes_it_is_stated_alone(read, role, factor, header, unit):
    columns = rows()
    columns["Fc"] = 2000 * columns["f"] ** 0.75 * columns["d"]
    columns[role] = columns[role] * factor
    headers = {"V": "V [sfm]", "f": "f [ipr]"} if unit == "in" else {"V": "V [m/min]", "f": "f [mm/rev]"}
    if unit == "in":
        columns |= {"V": columns["V"] * 3.28, "f": columns["f"] / 25.4}
    runs = read(text(columns, headers | {"P": "P [kW]", "VB": "VB [mm]", "Fc": "Fc [N]", role: header}),
                units={role: unit})  # fmt: skip
    assert any(f"--unit {role}={unit} is used" in x for x in runs.assumed)
    assert runs.doubts == ()


@pytest.mark.parametrize("units", [False, True])
@pytest.mark.parametrize("pair", [("V", "f"), ("f", "d"), ("VB", "d"), ("V", "d")])
def test_exchanged_headers_are_named_with_the_options_that_exchange_them(read, pair, units):
    a, b = pair
    named = {name: f"{name} [{ROLES[name].unit}]" if units else name for name in rows()}
    swapped = named | {a: named[b], b: named[a]}
    refusal, doubts = outcome(read, text(rows(), swapped))
    message = refusal + " ".join(map(str, doubts))
    assert "exchange" in message
    assert {a, b} <= set(re.findall(r"columns (\w+) and (\w+)", message)[0])
    remedy = re.search(r'--map "\w+=col\d" --map "\w+=col\d"(?: --unit "?[\w/=]+"?)*', message)[0]
    runs = read(text(rows(), swapped), **typed(remedy))
    assert runs.values(a) == pytest.approx(rows()[a])
    assert said(runs) == []


def test_speed_and_feed_without_edges_exchanged_with_wear_are_seen_within_edges(read):
    columns = {"edge": np.repeat(np.arange(1.0, 7), 4)}
    columns |= {"f": np.repeat([0.1, 0.2, 0.4, 0.1, 0.2, 0.4], 4), "t": np.tile([2.0, 5, 10, 18], 6)}
    columns["VB"] = 0.1 * columns["f"] ** 0.2 * columns["t"] ** 0.3
    runs = read(text(columns, {"f": "VB", "VB": "f"}))
    assert any("f varies within the edges and VB is constant in each" in doubt for doubt in said(runs))
    exchanged = next(doubt for doubt in runs.doubts if "constant in each" in doubt.sentence)
    assert said(read(text(columns, {"f": "VB", "VB": "f"}), **typed(exchanged.remedy))) == []


def test_headers_that_are_units_name_their_column(read):
    runs = read("SFM,IPR,RPM,IPM,t [min],VB [mm]\n300,.01,400,4,2,.1\n400,.012,500,6,4,.15\n")
    assert [use.role for use in runs.columns] == ["V", "f", "n", "fm", "t", "VB"]
    assert runs.values("V") == pytest.approx([91.44, 121.92])
    assert runs.values("f") == pytest.approx([0.254, 0.3048])
    assert read("V,SFM,AW\n100,328,0.1\n200,656,0.2\n").values("V").tolist() == [100, 200]


def test_a_column_without_a_unit_in_an_inch_file_is_asked_about(read):
    columns = rows()
    columns = {"V": columns["V"] * 3.28, "f": columns["f"] / 25.4, "d": columns["d"] / 25.4, "VB": columns["VB"]}
    content = text(columns, {"V": "V [sfm]", "f": "f [ipr]", "VB": "VB [mm]"})
    with pytest.raises(errors.DataError, match=r"--unit d=in or --unit d=mm"):
        read(content)
    assert read(content, units={"d": "in"}).values("d") == pytest.approx(rows()["d"])


def test_wear_without_a_unit_in_an_inch_file_is_settled_where_one_unit_is_plausible(read):
    columns = rows()
    columns = {"V": columns["V"] * 3.28, "f": columns["f"] / 25.4, "VB": columns["VB"]}
    assert read(text(columns, {"V": "SFM", "f": "IPR"})).values("VB") == pytest.approx(rows()["VB"])


def test_two_systems_in_one_file_are_doubted(read):
    columns = rows()
    columns = {"V": columns["V"] * 3.28, "f": columns["f"] / 25.4, "d": columns["d"], "VB": columns["VB"]}
    runs = read(text(columns, {"V": "V [sfm]", "f": "f [ipr]", "d": "d [mm]", "VB": "VB [mm]"}))
    (doubt,) = runs.doubts
    assert "units of both systems in one file" in doubt.sentence
    assert read(text(columns, {"V": "V [sfm]", "f": "f [ipr]", "VB": "VB [mm]"}), units={"d": "mm"}).doubts == ()


@pytest.mark.parametrize(("role", "row", "factor"), [("V", 4, 10), ("VB", 7, 1000), ("VB", 7, 25.4), ("P", 2, 10)])
def test_a_single_cell_far_from_the_others_is_named_with_its_line(read, role, row, factor):
    columns = rows()
    columns[role] = columns[role].copy()
    columns[role][row] *= factor
    runs = read(text(columns))
    assert any(f"line {row + 2}:" in doubt and role in doubt for doubt in said(runs))
    if role == "VB":
        assert np.isnan(runs.values("VB")[row]) == (columns["VB"][row] > 5)


@pytest.mark.parametrize(("role", "factor"), [("f", 1 / 25.4), ("V", 3.2808), ("t", 60), ("VB", 1000), ("d", 1 / 25.4)])
def test_rows_in_another_unit_are_named(read, role, factor):
    columns = rows(72)
    columns[role] = columns[role].copy()
    columns[role][10:14] = (columns[role][10:14] * factor).round(6)
    assert any("lines 12, 13, 14, 15" in doubt and role in doubt for doubt in said(read(text(columns))))


def test_a_level_that_occurs_once_is_named(read):
    columns = rows()
    columns["V"] = columns["V"].copy()
    columns["V"][5] = 210
    assert any("line 7: V 210 m/min occurs once" in doubt for doubt in said(read(text(columns))))


def test_a_plan_over_a_decade_is_no_mistake(read):
    columns = rows(90)
    columns["f"] = np.tile([0.06, 0.1067, 0.1897, 0.3374, 0.6], 18)
    columns.pop("P")
    assert said(read(text(columns))) == []


def test_specific_cutting_force_out_of_range_names_its_columns(read):
    columns = rows()
    columns.pop("P")
    Fc = 2400 * columns["f"] * columns["d"]
    assert said(read(text(columns | {"Fc": Fc}))) == []
    (doubt,) = read(text(columns | {"Fc": Fc / 20})).doubts
    assert doubt.columns == ("Fc", "f", "d")
    assert "kc = Fc/(f d) is 120 N/mm2 (usual 500 to 6000)" in doubt.sentence


def test_roughness_heights_that_contradict_each_other(read):
    columns = {"f": rows()["f"], "Ra [um]": rows()["f"] * 8, "Rz [um]": rows()["f"] * 8}
    (doubt,) = read(text(columns)).doubts
    assert doubt.columns == ("Rz", "Ra")


def test_an_unused_column_that_resembles_a_condition_is_named_with_its_map(read):
    columns = rows() | {"VB": rows()["VB"]}
    for header in ("Schnittgeschwindikeit", "x1", "X1 [m/min]", "V_set"):
        content = text(columns, {"V": header})
        (doubt,) = (one for one in read(content).doubts if one.columns == (header,))
        assert doubt.remedy == '--map "V=col1"'
        assert said(read(content, **typed(doubt.remedy))) == []


def test_an_unused_column_in_inches_is_compared_in_the_unit_of_the_role(read):
    columns = {"V [sfm]": rows()["V"] * 3.28, "f [ipr]": rows()["f"] / 25.4, "X1 [in]": rows()["d"] / 25.4}
    (doubt,) = read(text(columns | {"VB [in]": rows()["VB"] / 25.4})).doubts
    assert doubt.remedy == '--map "d=col3"'


@pytest.mark.parametrize(("role", "header", "expected"), [("VB", "Par_5 [mm]", "AW"), ("P", "Par_6 [kW]", "P")])
def test_an_unused_result_is_named_with_its_map(read, role, header, expected):
    columns = {"edge": np.repeat(np.arange(1.0, 7), 4), "f": np.repeat([0.1, 0.2, 0.4, 0.1, 0.2, 0.4], 4)}
    columns |= {"t": np.tile([2.0, 5, 10, 18], 6)}
    columns[role] = {"VB": 0.1, "P": 3}[role] * columns["f"] ** 0.2 * columns["t"] ** 0.3
    (doubt,) = read(text(columns, {role: header})).doubts
    assert doubt.remedy == f'--map "{expected}=col4"'
    assert said(read(text(columns, {role: header}), **typed(doubt.remedy))) == []


def test_a_column_without_a_name_is_named_unless_it_numbers_the_rows():
    with_loads = datasets.runs_from_frame(pd.DataFrame(rows() | {"": rows()["V"] ** 2}))
    assert any("column 7 '' is not used" in doubt for doubt in said(with_loads))
    assert said(datasets.runs_from_frame(pd.DataFrame({"": np.arange(24.0)} | rows()))) == []


def test_a_remark_after_the_name_leaves_its_role(read):
    assert read('V,"average wear, 3 lands (mm)"\n100,.1\n200,.2\n').values("AW").tolist() == [0.1, 0.2]
    assert not read('V,P,"VB, left","VB, right"\n100,2,.1,.2\n200,3,.2,.3\n').has("VB")


def test_other_columns_stay_unmentioned(read):
    n = len(rows()["V"])
    rng = np.random.default_rng(1)
    others = {
        "No.": np.arange(1.0, n + 1), "temperature": rng.uniform(200, 900, n), "coolant": rng.choice([0.0, 1], n),
        "remark": rng.choice([3.0, 7], n), "date": np.full(n, 20240105.0),
    }  # fmt: skip
    assert said(read(text(rows() | others))) == []


def test_process_is_found_from_roles_and_notes():
    assert process_of(("V", "fz"), ()) == "milling"
    assert process_of(("V", "f"), ("Drehzahl 600",)) is None
    assert process_of(("V", "f"), ("turning on a lathe",)) == "turning"


def test_a_grinding_speed_needs_its_process(read):
    columns = {"V [m/s]": np.tile([25.0, 30, 35], 4), "P [kW]": np.tile([2.0, 2.5, 3.0], 4)}
    assert said(read(text(columns), process="grinding")) == []
    assert said(read(text(columns), process="turning"))


@pytest.mark.parametrize("name", ["r_eps [mm]", "re [mm]", "nose radius [mm]", "corner_mm"])
def test_a_nose_radius_is_not_taken_for_the_missing_depth(read, name):
    columns = {"V [m/min]": np.tile([150.0, 200], 9), "f [mm/rev]": np.repeat([0.1, 0.2, 0.3], 6)}
    columns |= {name: np.tile(np.repeat([0.4, 0.8, 1.2], 2), 3), "Fc [N]": 700 + 13.0 * np.arange(18)}
    assert not [one for one in said(read(text(columns))) if "depth of cut" in one]


def test_names_of_several_words_are_proposed_with_the_whole_command(read):
    header = {"V": "Speed_set", "f": "FeedSet", "d": "DepthSet", "t": "Minutes", "VB": "Flank (mean)"}
    columns = {name: rows()[name] for name in header}
    says = r'--map "V=Speed_set" --map "f=FeedSet" --map "d=DepthSet" --map "t=Minutes" --map "VB=Flank \(mean\)"'
    with pytest.raises(errors.DataError, match=says):
        read(text(columns, header))


def test_a_name_that_is_missing_above_a_row_of_units_is_said(tmp_path):
    """The header row lacks its last cell; the name before it does not stand for that column."""
    path = tmp_path / "data.csv"
    rows = [
        f"E{k // 4},{100 + 50 * (k // 8)},0.{1 + k // 4 % 2},1,{2 + 2 * (k % 4)},0.{10 + 3 * (k % 4)}"
        for k in range(16)
    ]
    cells = [f"{row},{300 + 17 * k * k % 101}" for k, row in enumerate(rows)]
    path.write_text("\n".join(["edge,V,f,d,t,AW", ",m/min,mm/rev,mm,min,mm,N", *cells]) + "\n")
    runs = datasets.read_runs(path)
    assert runs.values("AW")[0] == 0.1
    found = [doubt for doubt in runs.doubts if "it may be the resultant force F" in doubt.sentence]
    assert [doubt.remedy for doubt in found] == ['--map "F=col7"']
    assert runs.columns[-1].name == "N"


@pytest.mark.parametrize(
    ("edges", "factor", "symbol"),
    [(("E03", "E07", "E11", "E12"), 1 / 25.4, "f"), (("E05",), 3.280839895, "V"), (("E02", "E09", "E10"), 60, "t")],
)
def test_whole_edges_in_another_unit_are_named_with_the_option_that_corrects_them(edges, factor, symbol):
    frame = datasets.read_runs(datasets.bundled("gc435_709m40")).to_frame()[["edge", "V", "f", "d", "t", "AW"]].dropna()
    off = frame.assign(**{symbol: (frame[symbol] * np.where(frame["edge"].isin(edges), factor, 1)).round(5)})
    remedies = [doubt.remedy for doubt in datasets.runs_from_frame(off).doubts if symbol in doubt.columns]
    sign = f"*{1 / factor:.10g}" if factor < 1 else f"/{factor:.10g}"
    assert f'--correct "{",".join(edges)}:{symbol}{sign}"' in remedies
    corrected = datasets.runs_from_frame(off, correct=(f"{','.join(edges)}:{symbol}{sign}",))
    np.testing.assert_allclose(corrected.values(symbol), frame[symbol], rtol=1e-3)


VS = (100, 120, 150, 200, 250)


@pytest.mark.parametrize("column", ["AW [mm]", "d [mm]"])
def test_a_column_of_reversed_sign_that_laws_need_is_refused_by_its_name(read, column):
    frame = pd.read_csv(datasets.bundled("gc435_709m40"), comment="#").dropna()
    negative = frame.assign(**{column: -frame[column]}).to_csv(index=False)
    symbol = column.split()[0]
    with pytest.raises(
        errors.DataError, match=rf"column '{re.escape(column)}': {symbol} is negative in all rows .*reversed sign"
    ):
        read(negative)
    runs = read(negative, correct=(f"all:{symbol}*-1",))
    np.testing.assert_allclose(runs.values(symbol), frame[column])


@pytest.mark.parametrize("column", ["Fxz [N]", "P [kW]"])
def test_a_load_of_reversed_sign_costs_its_own_law_only(read, column):
    frame = pd.read_csv(datasets.bundled("gc435_709m40"), comment="#").dropna()
    negative = frame.assign(**{column: -frame[column]})
    symbol = column.split()[0]
    runs = read(negative.to_csv(index=False))
    (doubt,) = runs.doubts
    assert doubt.columns == (column,)
    assert f"{symbol} is negative in all rows" in doubt.sentence
    assert doubt.sentence.endswith(f"reversed sign, so that no law of {symbol} is fitted")
    assert doubt.remedy == f"--correct all:{symbol}*-1"
    assert symbol not in runs.data
    corrected = read(negative.to_csv(index=False), correct=(f"all:{symbol}*-1",))
    np.testing.assert_allclose(corrected.values(symbol), frame[column])
    assert not corrected.doubts
    with pytest.raises(errors.DataError, match=rf"{symbol} is negative in all rows .*reversed sign; read it with"):
        read(negative[["edge", "V [m/min]", "f [mm/rev]", "d [mm]", "t [min]", column]].to_csv(index=False))


def test_lives_that_may_be_in_seconds_are_not_to_be_used_before_the_unit_is_confirmed(read):
    lives = "\n".join(f"{V},{f},{60 * 4 * (250 / V) ** 3.3 * (0.15 / f) ** 0.8:.0f}" for V in VS for f in (0.1, 0.2))
    runs = read(f"V,f,life\n{lives}")
    (doubt,) = runs.doubts
    assert doubt.unsettled
    assert doubt.remedy == "--unit T=s"
    assert doubt.sentence.endswith("s would be usual; if the values are in min, confirm it with --unit T=min")
    check = doubts_of_reading(fit.power_law(runs, "T", ["V", "f"]), runs)
    assert check.concern == 2
    for unit in ("s", "min"):
        assert not read(f"V,f,life\n{lives}", units={"T": unit}).doubts


@pytest.mark.parametrize("wrong", [False, True])
def test_long_lives_are_taken_for_seconds_only_where_the_law_of_the_others_says_so(read, wrong):
    """Lives of a sound plan span a factor of 100: two at the lowest speed and feed were to be divided by 60."""
    plan = np.array([(V, f, d) for V in (120, 170, 250) for f in (0.1, 0.2, 0.4) for d in (1, 2)])
    V, f, d = plan.T
    in_reading = 0
    for seed in range(12):
        scatter = np.exp(0.2 * np.random.default_rng(seed).normal(size=18))
        lives = 20 * (180 / V) ** (3 if wrong else 5) * (0.2 / f) ** 1.4 * (1.5 / d) ** 0.5 * scatter
        lives[12:14] *= 60 if wrong else 1
        body = "\n".join(f"{V},{f},{d},{T:.3g}" for (V, f, d), T in zip(plan, lives, strict=True))
        runs = read(f"V [m/min],f [mm/rev],d [mm],T [min]\n{body}")
        remedies = [one.remedy for one in runs.doubts if "T" in one.columns]
        assert remedies in ([], ['--correct "lines 14-15:T/60"'] * wrong)
        by_law = outlying_rows(fit.life_law(runs, ["V", "f", "d"]), runs)
        assert not wrong or {line for one in by_law.suspects for line in one.lines} == {14, 15}
        in_reading += bool(remedies)
    assert in_reading >= 4 * wrong


MISLABELLED = {  # column, divisor of its values, unit that the header still names, symbols of laws that are refused
    "thrust in kN": ("Fxz [N]", 1000, {"Fxz"}),
    "thrust in kN, process not named": ("Fxz [N]", 1000, {"Fxz", "AW", "P"}),
    "wear converted twice": ("AW [mm]", 1000, {"AW", "P", "Fxz"}),
    "seconds": ("t [min]", 1 / 60, {"AW", "P", "Fxz"}),
    "feed in inches": ("f [mm/rev]", 25.4, {"AW", "P", "Fxz"}),
    "speed in m/s": ("V [m/min]", 60, {"AW", "P", "Fxz"}),
    "depth in inches, by the specific force alone": ("d [mm]", 25.4, {"AW", "P", "Fxz"}),
}
FACTORS = {"AW": ("V", "f", "d", "t"), "P": ("V", "f", "d", "t", "AW"), "Fxz": ("V", "f", "d", "t", "AW")}


def mislabelled(name):
    """The bundled tests with one column in another unit than its header names."""
    column, divisor, refused = MISLABELLED[name]
    lines = datasets.bundled("gc435_709m40").read_text("utf-8").splitlines(keepends=True)
    notes = "" if "not named" in name else "".join(line for line in lines if line.startswith("#"))
    frame = pd.read_csv(datasets.bundled("gc435_709m40"), comment="#").dropna()
    return column, refused, notes + frame.assign(**{column: frame[column] / divisor}).to_csv(index=False)


@pytest.mark.parametrize("name", MISLABELLED)
def test_a_law_of_a_column_in_an_impossible_unit_is_not_to_be_used_before_the_unit_is_confirmed(read, name):
    column, refused, content = mislabelled(name)
    role, unit = column.rstrip("]").split(" [")
    runs = read(content)
    laws = {response: fit.power_law(runs, response, factors) for response, factors in FACTORS.items()}
    (doubt,) = (one for one in runs.doubts if one.unsettled)
    assert role in doubt.columns
    assert f"--unit {role}={unit}" in doubt.sentence
    assert {response for response, law in laws.items() if doubts_of_reading(law, runs).concern == 2} == refused
    units = {use.role: use.unit for use in runs.columns if use.role and use.unit}
    confirmed = read(content, units=units)
    assert all(doubts_of_reading(law, confirmed).concern < 2 for law in laws.values())


def test_merely_unusual_values_are_a_reservation(read):
    """A feed of 5 to 12 mm/rev (rolling tools) and wear of 0.003 to 0.013 mm (micro tools) fit no other unit."""
    for column, factor in (("f [mm/rev]", 12.0), ("AW [mm]", 1 / 25.4)):
        frame = pd.read_csv(datasets.bundled("gc435_709m40"), comment="#").dropna()[
            ["edge", "V [m/min]", "f [mm/rev]", "t [min]", "AW [mm]"]
        ]
        runs = read(frame.assign(**{column: frame[column] * factor}).to_csv(index=False))
        assert "is unusual" in str(runs.doubts[0])
        assert doubts_of_reading(fit.power_law(runs, "AW", ["V", "f", "t"]), runs).concern == 1


def test_long_times_that_would_be_usual_in_seconds_are_a_reservation(read):
    frame = pd.read_csv(datasets.bundled("gc435_709m40"), comment="#").dropna()
    content = frame.assign(**{"t [min]": frame["t [min]"] * 29}).to_csv(index=False)  # 58 to 580
    (doubt,) = read(content).doubts
    assert str(doubt) == "t 58 to 580 min is long (usual 0.2 to 120 min); 58 to 580 s would be usual: --unit t=s"
    assert not doubt.unsettled
    assert not read(content, units={"t": "min"}).doubts


def test_no_plan_is_exported_whose_wear_law_gives_a_life_that_cannot_be(tmp_path):
    """Wear in inches under a header in mm fits no other unit of a metric file: the limit of wear has no effect."""
    frame = pd.read_csv(datasets.bundled("gc435_709m40"), comment="#").dropna()
    path = tmp_path / "tests.csv"
    frame.assign(**{"AW [mm]": frame["AW [mm]"] / 25.4}).to_csv(path, index=False)
    pf = analyse(path, draws=1000).parameters
    assert pf.laws["AW"].verdict.level == "usable with reservations"
    with pytest.raises(errors.GateError, match=r"tool_life: do not use for control\. A life of .* cannot be"):
        require_verdicts(pf, False, only=("AW", "P"))
    assert "VERDICT ACCEPTED - tool_life - do not use for control" in require_verdicts(pf, True, only=("AW", "P"))
    assert not [line for line in require_verdicts(pf, False, only=("P",)) if "tool_life" in line]


def test_no_file_is_exported_whose_law_has_an_impossible_unit(tmp_path):
    path = tmp_path / "tests.csv"
    path.write_text(mislabelled("thrust in kN")[2], "utf-8")
    for options, refused in (({}, True), ({"units": {"Fxz": "N", "f": "mm/rev", "d": "mm"}}, False)):
        pf = analyse(path, draws=1000, **options).parameters
        assert (pf.laws["Fxz"].verdict.level == "do not use for control") == refused
        if refused:
            with pytest.raises(errors.GateError, match="confirm it with --unit Fxz=N"):
                require_verdicts(pf, False)
        else:
            require_verdicts(pf, False)
            assert "Fxz=N" in pf.provenance.options["unit"]


@pytest.mark.parametrize("sign", [1, -1])
def test_the_sign_of_an_axis_is_no_doubt_on_a_force_computed_from_squares(read, sign):
    rng = np.random.default_rng(5)
    V, f, d = np.array(np.meshgrid([100, 150, 200], [0.1, 0.2, 0.3], [1, 2])).reshape(3, -1)
    forces = {axis: c * f**0.7 * d * np.exp(0.02 * rng.standard_normal(V.size))
              for axis, c in {"Fx": sign * 700, "Fy": sign * 500, "Fz": 1800}.items()}  # fmt: skip
    frame = pd.DataFrame({"vc (m/min)": V, "f (mm/rev)": f, "ap (mm)": d, **{f"{a} (N)": x for a, x in forces.items()}})
    runs = read(frame.to_csv(index=False))
    found = doubts_of_reading(fit.power_law(runs, "Fxz", ["V", "f", "d"]), runs)
    assert [doubt.columns for doubt in runs.doubts] == [("Fx",), ("Fy",)] * (sign < 0)
    assert found.concern == 0


def test_a_force_of_reversed_sign_is_named_itself_and_not_the_power_that_follows(read):
    frame = pd.read_csv(datasets.bundled("gc435_709m40"), comment="#").dropna().drop(columns=["P [kW]", "Fxz [N]"])
    negative = frame.assign(**{"Fc [N]": -2000 * frame["f [mm/rev]"] * frame["d [mm]"]}).to_csv(index=False)
    (doubt,) = read(negative).doubts
    assert doubt.sentence.startswith("Fc is negative in all rows (-2545 to -254.5 N): reversed sign")
    runs = read(negative, correct=("all:Fc*-1",))  # as the message asks, though P of the file as it stands is refused
    np.testing.assert_allclose(runs.values("P"), frame["V [m/min]"] * runs.values("Fc") / 60000)
    assert (runs.values("Fc") > 0).all()


def test_a_component_of_reversed_sign_is_doubted_and_its_resultant_is_read(read):
    frame = pd.read_csv(datasets.bundled("gc435_709m40"), comment="#").dropna().drop(columns="Fxz [N]")
    force = 600 * frame["f [mm/rev]"] * frame["d [mm]"]
    runs = read(frame.assign(**{"Fx [N]": -force, "Fz [N]": force}).to_csv(index=False))
    assert [doubt.remedy for doubt in runs.doubts if doubt.columns == ("Fx",)] == ["--correct all:Fx*-1"]
    np.testing.assert_allclose(runs.values("Fxz"), np.sqrt(2) * force)


def drilled(depth, **columns):
    n = 12
    made = {
        "V": np.resize([60.0, 80, 100], n),
        "f": np.resize([0.1, 0.2], n),
        "d": np.full(n, depth),
        "t": np.arange(n) + 2.0,
    }
    return text(made | {"VB": 0.05 + 0.01 * np.arange(n)} | columns)


def test_a_depth_of_cut_beyond_the_radius_of_the_drill_is_refused(read):
    with pytest.raises(
        errors.DataError, match=r"d 20 mm exceeds the radius of the tool, 5 mm, in 12 of 12 rows.*hole.*--map d=none"
    ):
        read(drilled(20.0), process="drilling", constants={"D": 10})
    assert not [
        doubt for doubt in read(drilled(5.0), process="drilling", constants={"D": 10}).doubts if "radius" in str(doubt)
    ]
    depths = np.where(np.arange(12) == 4, 50.0, 5.0)
    said_of = [str(doubt) for doubt in read(drilled(depths), process="drilling", constants={"D": 10}).doubts]
    assert any(one.startswith("line 6: d 50 mm exceeds the radius of the tool, 5 mm") for one in said_of)


def test_a_width_of_cut_beyond_the_mill_is_refused(read):
    columns = {"Dc": np.full(12, 8.0), "ae": np.full(12, 40.0)}
    with pytest.raises(errors.DataError, match="ae 40 mm exceeds the diameter of the tool, 8 mm"):
        read(drilled(2.0, **columns), process="milling")
    read(drilled(2.0, **columns | {"ae": np.full(12, 8.0)}), process="milling")


def test_the_cause_is_doubted_first_and_not_what_follows_from_it():
    frame = datasets.read_runs(datasets.bundled("gc435_709m40")).to_frame()
    frame = frame[["edge", "V", "f", "d", "t", "AW", "P", "Fxz"]].dropna()
    off = frame["edge"].isin(["E07", "E11", "E15"])
    (doubt,) = datasets.runs_from_frame(frame.assign(f=frame["f"].where(~off, frame["f"] / 25.4))).doubts
    assert doubt.remedy == '--correct "E07,E11,E15:f*25.4"'


def planned(**columns):
    """A plan of 27 single tests in levels."""
    V, f, d = (np.ravel(one) for one in np.meshgrid((80, 120, 180), (0.1, 0.2, 0.35), (1, 1.5, 2.5), indexing="ij"))
    Fc = (1700 * f**0.74 * d * (1 + 0.01 * np.arange(27))).round()
    made = {"V [m/min]": V.astype(float), "f [mm/rev]": f, "d [mm]": d, "Fc [N]": Fc, "Ff [N]": (0.4 * Fc).round()}
    return made | columns


def test_a_force_in_levels_next_to_a_speed_without_any_is_doubted(read):
    assert not [doubt for doubt in read(text(planned())).doubts if "exchanged" in doubt.sentence]
    plan = planned()
    plan["V [m/min]"], plan["Fc [N]"] = plan["Fc [N]"], plan["V [m/min]"]
    found = [doubt for doubt in read(text(plan)).doubts if "as if it were set" in doubt.sentence]
    assert [doubt.remedy for doubt in found] == ['--map "V=col4" --map "Fc=col1"']


def test_a_feed_force_above_the_cutting_force_is_doubted(read):
    plan = planned()
    plan["Ff [N]"], plan["Fc [N]"] = plan["Fc [N]"], plan["Ff [N]"]
    found = [doubt for doubt in read(text(plan)).doubts if "Ff exceeds Fc" in doubt.sentence]
    assert [doubt.remedy for doubt in found] == ['--map "Fc=col5" --map "Ff=col4"']
    assert found[0].sentence == "Ff exceeds Fc in 27 of 27 rows: the two columns may be exchanged"


FINISHING = {"Fc": (1650, 0.75, 1.0), "Ff": (700, 0.45, 1.03), "Fp": (480, 0.5, 0.73)}  # factor, exponents of f and d


@pytest.mark.parametrize(
    ("named", "remedy"),
    [
        ({}, None),
        ({"Fc": "Fp", "Fp": "Fc"}, '--map "Fc=col6" --map "Fp=col4"'),
        ({"Fc": "Ff", "Ff": "Fc"}, '--map "Fc=col5" --map "Ff=col4"'),
    ],
)
def test_the_cutting_force_is_told_from_the_other_two_by_its_exponents(read, named, remedy):
    plan, rng = planned(), np.random.default_rng(4)
    f, d = plan["f [mm/rev]"], plan["d [mm]"]
    force = {name: c * f**a * d**b * np.exp(rng.normal(0, 0.03, 27)) for name, (c, a, b) in FINISHING.items()}
    plan = {name: plan[name] for name in ("V [m/min]", "f [mm/rev]", "d [mm]")}
    plan |= {f"{name} [N]": force[named.get(name, name)].round(1) for name in FINISHING}
    found = [doubt for doubt in read(text(plan)).doubts if "exceeds Fc" in doubt.sentence]
    assert [doubt.remedy for doubt in found] == ([remedy] if remedy else [])


def test_a_passive_force_above_the_cutting_force_of_hard_turning_is_sound(read):
    V, f, d = (np.ravel(one) for one in np.meshgrid((100.0, 200), (0.05, 0.1, 0.15), (0.1, 0.2, 0.3), indexing="ij"))
    noise = np.random.default_rng(1).normal(1, 0.05, (2, len(V)))
    Fc, Fp = 2800 * f**0.7 * d * noise[0], 2800 * f**0.6 * d**0.7 * noise[1]
    doubts = read(text({"V [m/min]": V, "f [mm/rev]": f, "d [mm]": d, "Fc [N]": Fc, "Fp [N]": Fp})).doubts
    assert not [doubt for doubt in doubts if "exceeds Fc" in doubt.sentence]


@pytest.mark.parametrize(("value", "found"), [(0.25, True), (0.2, False)])
def test_a_level_that_one_row_has_is_doubted_where_the_others_have_three_and_more(read, value, found):
    V, f = np.repeat([90.0, 140, 200, 280], 4), np.tile([0.08, 0.12, 0.2, 0.3], 4)
    f[9] = value if found else f[9]
    said_of = said(read(text({"V": V, "f": f, "Ra": (40 * f**1.5).round(2) + 0.01 * np.arange(16)})))
    assert any("line 11: f 0.25 mm/rev occurs once" in one for one in said_of) == found


def test_a_wear_in_inches_whose_name_is_not_known_is_proposed(read):
    frame = pd.read_csv(datasets.bundled("gc435_709m40"), comment="#").dropna()
    frame = frame[["edge", "V [m/min]", "f [mm/rev]", "d [mm]", "t [min]", "P [kW]"]].assign(
        **{"AWAW [in]": (frame["AW [mm]"] / 25.4).round(5)}
    )
    found = [doubt for doubt in read(frame.to_csv(index=False)).doubts if "average wear" in doubt.sentence]
    assert [doubt.remedy for doubt in found] == ['--map "AW=col7"']


@pytest.mark.parametrize("header", ["Bemerkung", "remarks", "Remark", "Notes", "comment", "Kommentar", "observaciones"])
def test_remarks_beside_a_few_rows_are_named(read, header):
    said = np.array([""] * 24, dtype=object)
    said[[5, 11]] = "edge broken, do not use", "abgebrochen"
    content = text(rows()).splitlines()
    content = [f"{line},{word}" for line, word in zip(content, [header, *(f'"{one}"' for one in said)], strict=True)]
    found = [one for one in read("\n".join(content)).doubts if "remarks" in one.sentence]
    assert [one.remedy for one in found] == ['--leave-out "lines 7,13"']
    assert "2 rows carry remarks in column" in found[0].sentence
    assert "line 7 'edge broken, do not use'" in found[0].sentence
    assert {"VB", "P"} <= set(found[0].columns)


def test_only_laws_that_use_a_remarked_row_have_a_reservation(read):
    frame = pd.read_csv(datasets.bundled("gc435_709m40"), comment="#").assign(Remark="")
    rows = frame.index[frame["AW [mm]"].notna()][[7, 30]]
    frame.loc[rows, "Remark"] = "broken"
    for empty, refused in (("", {"AW", "P"}), ("AW [mm]", {"P"}), ("edge", set())):
        of = frame.copy()
        if empty == "edge":  # whole edges, of which nothing was measured
            of.loc[of["edge"].isin(of.loc[rows, "edge"]), ["AW [mm]", "P [kW]", "Remark"]] = [np.nan, np.nan, "broken"]
        elif empty:
            of.loc[rows, empty] = np.nan
        runs = read(of.to_csv(index=False))
        assert any("carry remarks" in doubt.sentence for doubt in runs.doubts)
        laws = [fit.power_law(runs, response, ["V", "f", "d", "t"]) for response in ("AW", "P")]
        assert {law.response for law in laws if "carry remarks" in doubts_of_reading(law, runs).verdict} == refused


@pytest.mark.parametrize("words", [["dry", "oil"], ["broken", "whole"], ["series A"], ["new bar", "", "", ""]])
def test_words_in_most_rows_and_those_without_a_finding_are_no_remarks(read, words):
    content = [
        f"{line},{word}" for line, word in zip(text(rows()).splitlines(), ["Remark", *(words * 24)[:24]], strict=True)
    ]
    assert not [one for one in read("\n".join(content)).doubts if "remark" in one.sentence]


def test_a_force_in_dan_under_n_is_doubted(read):
    columns = rows()
    force = {**{name: columns[name] for name in "Vfd"}, "Fc": (1600 * columns["f"] ** 0.75 * columns["d"]).round(2)}
    assert not read(text(force)).doubts
    (doubt,) = read(text({**force, "Fc": force["Fc"] / 10})).doubts
    assert doubt.remedy == "--unit Fc=daN"
    assert not read(text({**force, "Fc": force["Fc"] / 10}), units={"Fc": "daN"}).doubts
    assert not read(text({**force, "Fc": force["Fc"] / 4})).doubts  # aluminium, kc1.1 400 N/mm2


def test_a_torque_of_a_drill_is_compared_with_its_chip(read):
    f, D = np.array(np.meshgrid([0.1, 0.15, 0.2, 0.25], [6.0, 8, 10, 12])).reshape(2, -1)
    drill = {"V": np.tile([20.0, 30], 8), "f": f, "D": D, "M": 1600 * f**0.75 * D**2 / 8000}
    assert not read(text(drill)).doubts
    (doubt,) = read(text({**drill, "M": drill["M"] * 10})).doubts
    assert doubt.sentence.startswith("kc = 8000 M/(f D^2) is ")


@pytest.mark.parametrize("unit", ["1/100 mm", "0.01 mm"])
def test_hundredths_of_a_millimetre_are_a_unit(read, unit):
    columns = rows()
    VB = read(text({**columns, "VB": 100 * columns["VB"]}, {"VB": f"VB [{unit}]"})).values("VB")
    np.testing.assert_allclose(VB, columns["VB"], rtol=1e-9)


@pytest.mark.parametrize(("header", "largest"), [("VBmax", True), ("VB max", True), ("VBB max.", True), ("VB", False)])
def test_the_largest_width_of_the_land_names_its_criterion(read, header, largest):
    runs = read(text(rows(), {"VB": f"{header} [mm]"}))
    assert any("--criterion 0.6" in one for one in runs.assumed) == largest


def test_a_roughness_in_uin_under_um_is_not_used(read):
    columns = rows()
    Ra = (40 * 30 * columns["f"] ** 1.5).round(1)
    head = {"V": "V [m/min]", "f": "f [mm/rev]", "d": "d [mm]", "Ra": "Ra [um]"}
    named = {**{name: columns[name] for name in "Vfd"}, "Ra": Ra}
    (doubt,) = read(text(named, head)).doubts
    assert doubt.unsettled
    assert doubt.remedy == "--unit Ra=uin"


def test_a_decimal_mark_of_a_depth_is_corrected_and_not_the_force(read):
    V, f, d = np.array(np.meshgrid([100.0, 150, 200], [0.1, 0.2, 0.3], [1.0, 2], indexing="ij")).reshape(3, -1)
    rng = np.random.default_rng(10)
    Fc = (1700 * f**0.75 * d * np.exp(0.02 * rng.normal(size=18))).round()
    d[7] *= 10
    runs = read(text({"V": V, "f": f, "d": d, "Fc": Fc}))
    assert '--correct "lines 9:d/10"' in [one.remedy for one in runs.doubts]
    judged = fit.judge(fit.power_law(runs, "Fc", ["V", "f", "d"]), runs=runs)
    assert [one.correction for one in judged.suspects] == ["lines 9:d/10"]


@pytest.mark.parametrize(
    ("header", "speeds", "found"),
    [
        ("Speed", (500, 710, 1000), "in 1/min these are standard spindle speeds"),
        ("Speed", (355, 450, 560), "in 1/min these are standard spindle speeds"),
        ("Speed", (1100, 1562, 2200), "in 1/min these are usual spindle speeds"),
        ("vc", (637, 849, 1273), "in 1/min these are usual spindle speeds"),
        ("vc", (250, 355, 500), ""),
        ("Speed", (300, 400, 500), ""),
        ("Speed", (100, 160, 250), ""),
        ("vc [m/min]", (1000, 1600, 2500), ""),
    ],
)
def test_a_speed_without_a_unit_that_may_be_that_of_the_spindle_is_doubted(read, header, speeds, found):
    plan = {name: values for name, values in planned().items() if name not in ("V [m/min]", "Ff [N]")}
    content = text({header: np.repeat(np.array(speeds, dtype=float), 9)} | plan)
    doubts = [doubt for doubt in read(content).doubts if "in 1/min these are" in doubt.sentence]
    assert [doubt.remedy for doubt in doubts] == (["--map n=col1"] if found else [])
    assert all(found in doubt.sentence for doubt in doubts)
    if found:
        assert not [doubt for doubt in read(content, units={"V": "m/min"}).doubts if "1/min these" in doubt.sentence]
        assert not [doubt for doubt in read(content, work="AlSi7").doubts if "1/min these" in doubt.sentence]


@pytest.mark.parametrize(
    ("factor", "rows", "unit", "correct", "shown"),
    [
        (1000, slice(36, 72), "mm", "E07,E08,E09,E10,E11,E12:VB/1000", "um and mm, two units"),
        (1000, slice(36, 72), "um", "E01,E02,E03,E04,E05,E06:VB*1000", "um and mm, two units"),
        (1000, slice(40, 72), "mm", "lines 42-73:VB/1000", "um and mm, two units"),
        (1000, slice(60, 72), "mm", "E11,E12:VB/1000", "um and mm, two units"),
        (100, slice(42, 72), "mm", "E08,E09,E10,E11,E12:VB/100", "hundredths of mm"),
    ],
)
def test_a_wear_in_two_units_is_refused_with_the_rows_that_are_wrong(read, factor, rows, unit, correct, shown):
    rng, edge = np.random.default_rng(2), np.repeat(np.arange(12), 6)
    t, V = np.tile(np.arange(2.0, 13, 2), 12), np.tile([120.0, 160, 200], 4)[edge]
    VB = 0.001 * V**0.7 * t**0.45 * np.exp(rng.normal(0, 0.04, 72))
    VB[rows] *= factor
    columns = {"edge": [f"E{e + 1:02d}" for e in edge], "vc [m/min]": V, "t [min]": t, "VB [mm]": VB.round(4)}
    content = pd.DataFrame(columns).to_csv(index=False)
    options = {"units": {"VB": "um"}} if unit == "um" else {}
    with pytest.raises(errors.DataError) as caught:
        read(content, **options)
    assert f"{factor} times as large" in str(caught.value)
    assert shown in str(caught.value)
    assert f'--correct "{correct}"' in str(caught.value)
    assert said(read(content, correct=[correct], **options)) == []


def test_a_wear_of_new_edges_beside_worn_ones_is_in_one_unit(read):
    VB = np.tile([0.002, 0.002, 0.25, 0.28, 0.3, 0.33], 6)
    columns = {"edge": np.repeat([f"E{e}" for e in range(6)], 6), "t [min]": np.tile([0.1, 0.2, 8, 10, 12, 14], 6)}
    frame = pd.DataFrame(columns | {"vc [m/min]": np.repeat(np.linspace(90.0, 200, 6), 6), "VB [mm]": VB})
    doubts = read(frame.to_csv(index=False)).doubts
    assert not [doubt for doubt in doubts if "times as large" in doubt.sentence]


def finish(tmp_path, name, factor, low=0.12):
    """Roughness of turned tests as a multiple of the geometric one, with a scatter of 10 %, at two nose radii."""
    rng = np.random.default_rng(7)
    rows = [(V, f, re) for V in (120, 180) for f in (low, 2 * low, 2.5 * low) for re in (0.4, 0.8)]
    share = 32 if name == "Ra" else 8
    cells = [1000 * f**2 / (share * re) * factor * rng.lognormal(0, 0.1) for _, f, re in rows]
    path = tmp_path / "finish.csv"
    lines = [f"{V},{f},{re},{value:.3g}" for (V, f, re), value in zip(rows, cells, strict=True)]
    path.write_text("\n".join([f"V,f,re [mm],{name} [um]", *lines]) + "\n", "utf-8")
    return [doubt for doubt in datasets.read_runs(path).doubts if "1000 f^2" in doubt.sentence]


@pytest.mark.parametrize(
    ("name", "factor", "remedy"), [("Ra", 5.0, '--map "Rz=col4"'), ("Rz", 0.3, '--map "Ra=col4"'), ("Ra", 0.25, "")]
)
def test_a_roughness_is_compared_with_that_of_feed_and_nose_radius(tmp_path, name, factor, remedy):
    (doubt,) = finish(tmp_path, name, factor)
    assert doubt.remedy == remedy
    assert ("wiper" in doubt.sentence) == (factor < 1)


@pytest.mark.parametrize(("name", "factor", "low"), [("Ra", 1.4, 0.12), ("Ra", 2.4, 0.12), ("Rz", 1.2, 0.12)])
def test_sound_roughness_is_not_doubted(tmp_path, name, factor, low):
    assert not finish(tmp_path, name, factor, low)


def test_edge_build_up_at_small_feeds_is_not_doubted(tmp_path):
    assert not finish(tmp_path, "Ra", 6.0, low=0.03)


@pytest.mark.parametrize(
    ("digits", "copied", "found"),
    [
        (0, (0, 0), ""),
        (0, (5, 9), "lines 29, 30, 31 and 32"),
        (-2, (0, 0), ""),
    ],
)
def test_rows_pasted_again_in_a_table_without_edges_are_named(read, digits, copied, found):
    """Rows of single tests counted twice in silence; tests repeated at the centre have readings of their own."""
    plan, rng = planned(), np.random.default_rng(9)
    frame = pd.DataFrame({name: plan[name] for name in ("V [m/min]", "f [mm/rev]", "d [mm]")})
    frame = pd.concat([frame, frame.iloc[slice(*copied)], *[frame.iloc[[13]]] * 5], ignore_index=True)
    Fc = 1700 * frame["f [mm/rev]"] ** 0.74 * frame["d [mm]"] * np.exp(rng.normal(0, 0.03, len(frame)))
    frame["Fc [N]"] = Fc.round(digits)
    frame.loc[27 : 26 + copied[1] - copied[0], "Fc [N]"] = frame["Fc [N]"].to_numpy()[slice(*copied)]
    said = [doubt.sentence for doubt in read(frame.to_csv(index=False)).doubts if "count twice" in doubt.sentence]
    assert len(said) == bool(found)
    assert all(one.startswith(f"{found} repeat the settings and readings of earlier rows") for one in said)


def two_tools():
    rng = np.random.default_rng(5)
    V, f, t = (x.ravel() for x in np.meshgrid([100.0, 150.0, 200.0], [0.1, 0.2], [2.0, 4.0, 6.0, 8.0], indexing="ij"))
    edge = np.repeat(np.arange(6), 4)
    wear = 0.002 * V**0.6 * f**0.3 * t**0.6
    parts = [
        pd.DataFrame(
            {"tool": tool, "work": "C45", "edge": [f"{tool}{k}" for k in edge], "V [m/min]": V, "f [mm/rev]": f}
            | {"t [min]": t, "VB [mm]": wear * np.exp(rng.normal(0, 0.02, len(t)))}
        )
        for tool in "AB"
    ]
    return pd.concat(parts, ignore_index=True)


@pytest.mark.parametrize(
    ("column", "row", "value", "lines"),
    [("VB [mm]", 30, 3.0, {32}), ("t [min]", 27, 5.0, {28, 29}), ("V [m/min]", 33, 120.0, set(range(34, 38)))],
    ids=["slipped mark of wear", "time that falls", "speed that changes"],
)
def test_a_doubt_about_a_line_is_one_of_its_pair_alone(tmp_path, column, row, value, lines):
    table = two_tools()
    table.loc[row, column] = value
    table.to_csv(tmp_path / "two.csv", index=False)
    pairs = {pair.tool: pair for pair in datasets.read_runs(tmp_path / "two.csv").pairs()}
    of = {tool: [doubt for doubt in pair.doubts if doubt.lines] for tool, pair in pairs.items()}
    assert (of["A"], {line for doubt in of["B"] for line in doubt.lines}) == ([], lines)
    found = {tool: doubts_of_reading(fit.power_law(pair, "VB", ["V", "f", "t"]), pair) for tool, pair in pairs.items()}
    assert (found["A"].concern, found["B"].concern > 0) == (0, True)


def test_codes_of_missing_values_are_left_out_and_stated(tmp_path):
    table = two_tools().assign(
        **{"Fc [N]": lambda x: (1000 * x["f [mm/rev]"] ** 0.75 * x["V [m/min]"] ** -0.1).round(2)}
    )
    sound = table.copy()
    sound.loc[[3, 20], "Fc [N]"], sound.loc[[7, 30], "VB [mm]"] = np.nan, np.nan
    table.loc[[3, 20], "Fc [N]"], table.loc[[7, 30], "VB [mm]"] = -999, 9.999
    found = {}
    for name, each in (("codes", table), ("blank", sound)):
        each.to_csv(tmp_path / f"{name}.csv", index=False)
        found[name] = datasets.read_runs(tmp_path / f"{name}.csv")
    doubts = [(doubt.sentence, doubt.lines) for doubt in found["codes"].doubts]
    assert doubts == [("VB: 9.999 in 2 rows (lines 9, 32) is a code of a missing value, and is left out", (9, 32))]
    for column in ("Fc", "VB", "P"):
        np.testing.assert_array_equal(found["codes"].values(column), found["blank"].values(column))
    assert "Fc: -999 in 2 rows (lines 5, 22) is a code of a missing value" in found["codes"].assumed


def test_an_ordinary_value_of_nines_is_no_code(tmp_path):
    table = two_tools()
    table["Fc [N]"] = np.linspace(600, 1400, len(table)).round()
    table.loc[[3, 20], "Fc [N]"] = 999
    table.to_csv(tmp_path / "t.csv", index=False)
    assert np.count_nonzero(datasets.read_runs(tmp_path / "t.csv").values("Fc") == 999) == 2


def test_the_mean_wear_is_read_before_the_largest(tmp_path):
    table = two_tools().rename(columns={"VB [mm]": "VB mean (mm)"})
    table["VB max (mm)"] = table["VB mean (mm)"] * 1.6
    table.to_csv(tmp_path / "t.csv", index=False)
    of = {
        name: datasets.read_runs(tmp_path / "t.csv", map=given)
        for name, given in (("mean", {}), ("max", {"VB": "VB max (mm)"}))
    }
    assert (of["mean"].values("VB") == table["VB mean (mm)"]).all()
    assert (of["max"].values("VB") == table["VB max (mm)"]).all()


@pytest.mark.parametrize(("milling", "role"), [(True, "lf"), (False, "lc")])
def test_a_length_in_metres_is_of_the_feed_in_milling(tmp_path, milling, role):
    table = two_tools().rename(columns={"t [min]": "Distance (m)"})
    table.loc[:, "Distance (m)"] *= 5.0
    if milling:
        table["z"], table["ae [mm]"] = 4, 5.0
    table.to_csv(tmp_path / "t.csv", index=False)
    assert f'--map "{role}=Distance (m)"' in [doubt.remedy for doubt in datasets.read_runs(tmp_path / "t.csv").doubts]


def test_a_calculated_column_is_not_offered_for_the_measured_one(tmp_path):
    table = two_tools().drop(columns="VB [mm]").drop(columns=["edge", "t [min]"])
    force = (2000 * table["f [mm/rev]"] ** 0.75).round(1)
    for names, read in ((("Fc predicted (N)", "Fc measured (N)"), True), (("Fc FEM (N)", "Ra [um]"), False)):
        frame = table.assign(
            **{names[0]: force, names[1]: (force * np.linspace(0.95, 1.05, len(force))).round(1) / (1 if read else 500)}
        )
        frame.to_csv(tmp_path / "t.csv", index=False)
        runs = datasets.read_runs(tmp_path / "t.csv")
        assert ("Fc" in runs.data) == read
        assert not any("Fc" in doubt.remedy for doubt in runs.doubts)


def test_set_values_are_not_offered_before_those_that_were_measured(tmp_path):
    table = two_tools().rename(columns={"V [m/min]": "vc soll [m/min]"})
    table["vc ist [m/min]"] = (table["vc soll [m/min]"] * np.linspace(0.97, 1.02, len(table))).round(1)
    table.to_csv(tmp_path / "t.csv", index=False)
    assert '--map "V=col8"' in [doubt.remedy for doubt in datasets.read_runs(tmp_path / "t.csv").doubts]


@pytest.mark.parametrize(("header", "read"), [("Fn (N)", None), ("ae (%)", None), ("f (mm)", "f"), ("ae (mm)", "ae")])
def test_a_unit_of_another_kind_gives_no_role(header, read):
    name, _, unit = header.rstrip(")").partition(" (")
    assert role_of(name, unit) == read


def test_a_clock_that_runs_over_all_edges_is_no_time_of_a_law(tmp_path):
    table = two_tools()[lambda x: x["tool"] == "A"]
    table["t [min]"] += 10.0 * np.repeat(np.arange(6), 4)
    table.to_csv(tmp_path / "t.csv", index=False)
    runs = datasets.read_runs(tmp_path / "t.csv")
    assert doubts_of_reading(fit.power_law(runs, "VB", ["V", "f", "t"]), runs).concern == 2


def test_a_factor_that_a_law_has_is_not_doubted_as_unused(tmp_path):
    table = two_tools().drop(columns=["V [m/min]"])
    table["Rake"] = np.tile(np.repeat([100.0, 150.0, 200.0], 8), 2)
    table.to_csv(tmp_path / "t.csv", index=False)
    runs = datasets.read_runs(tmp_path / "t.csv")
    assert any("Rake" in doubt.columns for doubt in runs.doubts)
    assert doubts_of_reading(fit.power_law(runs, "VB", ["Rake", "f", "t"]), runs).concern == 0


def test_an_empty_speed_beside_forces_gives_no_warning(tmp_path):
    f, d = (x.ravel() for x in np.meshgrid([0.1, 0.2, 0.3], [1.0, 1.5, 2.0], indexing="ij"))
    frame = pd.DataFrame({"V [m/min]": np.full(9, np.nan), "f [mm/rev]": f, "d [mm]": d, "Fc [N]": 2000 * f**0.75 * d})
    frame.assign(**{"Fp [N]": 900 * f**0.6 * d}).to_csv(tmp_path / "t.csv", index=False)
    assert "Fc" in datasets.read_runs(tmp_path / "t.csv").data
