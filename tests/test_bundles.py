"""Bundled sets: transcriptions against the laws, the simulated set byte for byte, README against data.

Sources: Alaskari & Oraby, Kuwait J. Sci. (accepted June 2017) and doi 10.15242/IIE.E1216006;
Tai, Tsai & Li 2023, doi 10.1109/ACCESS.2023.3330587; the Ck 45 roughness paper, Table 1 and eq. 5.
"""

import re

import numpy as np
import pandas as pd
import pytest
from fitmodels import fit
from fitmodels.core.errors import UsageError
from fitmodels.datasets import gc435, read_runs
from fitmodels.datasets.sets import bundled, bundled_names

EVERY = (
    "ac2017_table1",
    "ac2017_table2",
    "clm2023_end_milling",
    "clm2023_slot_milling",
    "cnc_mill_current",
    "gc435_709m40",
    "surf_table1",
)
DEPTH = 2.5


def text_of(name):
    """Cells as printed, columns without their units."""
    table = pd.read_csv(bundled(name), comment="#", dtype=str)
    return table.rename(columns=lambda c: c.split(" [")[0])


def numbers(name):
    words = ["source", "edge", "point", "tool condition"]
    return text_of(name).drop(columns=words, errors="ignore").astype(float)


def notes(name):
    return [line for line in bundled(name).read_text(encoding="utf-8").splitlines() if line.startswith("#")]


def units_in_last_digit(printed, value):
    """How far a value stands from a printed number, in units of its last printed decimal."""
    decimals = len(printed.partition(".")[2])
    return abs(float(printed) - value) * 10**decimals


def published(table):
    """AW at t, and P and Fxz at the AW given, without the time factors that the tables leave out."""
    v, f = table["V"], table["f"]
    wear = lambda t: 7.62e-3 * v**0.577 * f**0.168 * DEPTH**0.248 * t**0.245  # noqa: E731
    power = lambda aw: 0.14 * v**0.82 * f**0.627 * DEPTH**0.844 * aw**0.342  # noqa: E731
    force = lambda aw: 55354 * v**-0.484 * f**0.236 * DEPTH**0.715 * aw**1.1  # noqa: E731
    return wear, power, force


def test_names_are_the_sets_on_disk():
    assert bundled_names() == EVERY
    assert all(bundled(name).is_file() and bundled(name).with_name("README.md").is_file() for name in EVERY)


def test_an_unknown_name_is_answered_with_the_nearest():
    with pytest.raises(UsageError, match="Did you mean 'ac2017_table1'"):
        bundled("ac2017_tabel1")
    with pytest.raises(UsageError, match="There are ac2017_table1"):
        bundled("../../etc")


@pytest.mark.parametrize("name", EVERY)
def test_readme_lists_exactly_the_columns_and_units_of_the_file(name):
    header = next(line for line in bundled(name).read_text(encoding="utf-8").splitlines() if not line.startswith("#"))
    readme = bundled(name).with_name("README.md").read_text(encoding="utf-8")
    section = readme.split("## Columns")[1].split("##")[0]
    rows = re.findall(r"^\| `([^`]+)` \| ([^|]*)\|", section, flags=re.MULTILINE)
    listed = [f"{column} [{unit.strip()}]" if unit.strip() else column for column, unit in rows]
    assert listed == header.split(",")


@pytest.mark.parametrize("name", EVERY)
def test_every_file_names_its_work_material_and_says_what_it_is(name):
    lines = notes(name)
    assert any(line.startswith("# work: ") for line in lines)
    assert any(line.startswith(("# source: ", "# simulated: ")) for line in lines)
    if name == "cnc_mill_current":
        assert any("measured" in line and "CC0 1.0" in line for line in lines)
    elif not name.startswith("clm2023"):
        assert any("no measurement" in line or "no real measurement" in line for line in lines)


def test_table_1_follows_from_the_published_laws_to_every_printed_digit():
    printed, table = text_of("ac2017_table1"), numbers("ac2017_table1")
    wear, power, force = published(table)
    aw = wear(table["t"])
    for column, values in {
        "AW": aw,
        "P": power(aw),
        "Fxz": force(aw),
        "MRR": 1000 * table["V"] * table["f"] * DEPTH,
    }.items():
        off = [units_in_last_digit(p, v) for p, v in zip(printed[column], values, strict=True)]
        assert max(off) <= 0.5 + 1e-6, column
    assert len(table) == 16


def test_the_constants_of_the_package_are_those_of_table_1():
    table = numbers("ac2017_table1").assign(d=DEPTH)
    for law in gc435.LAWS:
        assert law.median(table) == pytest.approx(table[law.response].to_numpy(), rel=1e-5), law.response


def test_table_2_follows_from_the_laws_to_one_unit_but_for_one_misprint():
    printed, table = text_of("ac2017_table2"), numbers("ac2017_table2")
    wear, power, force = published(table)
    past = numbers("ac2017_table1").loc[10, "AW"]
    assert (table["AW_past"] == past).all()
    increase = wear(2.0) - wear(1.0)
    total = past + increase
    expected = {
        "Wo_i": wear(2.0),
        "Wo_i-1": wear(1.0),
        "dAW": increase,
        "AW": total,
        "P": power(total),
        "Fxz": force(total),
        "MRR": 2500 * table["V"] * table["f"],
    }
    wrong = [
        (column, row)
        for column, values in expected.items()
        for row, (p, v) in enumerate(zip(printed[column], values, strict=True))
        if units_in_last_digit(p, v) > 1 + 1e-6
    ]
    assert wrong == [("dAW", 0)]
    assert printed.loc[0, "dAW"] == "0.01255"
    assert increase[0] == pytest.approx(0.01250, abs=5e-6)


def test_table_2_warns_that_its_wear_is_no_power_law():
    assert any("no power law" in line for line in notes("ac2017_table2"))
    table = numbers("ac2017_table2")
    wear, _, _ = published(table)
    assert (table["AW"] / wear(2.0)).max() > 2  # the column is far from the law at 50 m/min


def test_end_milling_points_fix_the_load_line():
    first = numbers("clm2023_end_milling").iloc[:3]
    x = np.column_stack([np.ones(3), first["fm"], first["VB"]])
    a, b, k1 = np.linalg.solve(x, first["I"])
    assert (round(a, 4), round(b, 8), round(k1, 7)) == (0.1158, 1.2416e-4, 2.226e-4)


def test_end_milling_at_constant_current_gives_the_slope_of_equation_15():
    held = numbers("clm2023_end_milling").query("I == 0.24")
    fall, wear = 1000 - held["fm"], held["VB"]
    assert (fall * wear).sum() / (wear**2).sum() == pytest.approx(1.99, abs=0.005)
    assert held["VB"].iloc[2:].mean() == pytest.approx(197.26, abs=0.005)  # the average of Table 1


def test_slot_milling_keeps_the_current_and_the_mean_of_table_2():
    slot = numbers("clm2023_slot_milling")
    assert slot["I"].unique().tolist() == [0.24]
    assert slot["VB"].iloc[2:].mean() == pytest.approx(189.70, abs=0.005)
    assert (slot["fm"].iloc[0] - slot["fm"].iloc[1]) / slot["VB"].iloc[1] == pytest.approx(0.54, abs=0.005)


def test_roughness_table_stands_to_equation_5_as_the_readme_says():
    table = numbers("surf_table1")
    ratio = 0.2401 * np.exp(0.0034 * table["F"]) / table["Ra"] - 1
    assert ratio.round(3).tolist()[:3] == [0.16, 0.11, 0.093]
    assert table.loc[4, "Ra_ref"] == 2.2
    assert ratio[4] == pytest.approx(0.002, abs=5e-4)


def test_equation_5_is_the_regression_of_desired_roughness_on_uncontrolled_force():
    table = numbers("surf_table1")
    fits = {(y, x): np.polyfit(table[x], np.log(table[y]), 1) for y in ("Ra", "Ra_ref") for x in ("F", "F_without")}
    matches = [pair for pair, (b, a) in fits.items() if (round(np.exp(a), 4), round(b, 4)) == (0.2401, 0.0034)]
    assert matches == [("Ra_ref", "F_without")]


def test_roughness_table_is_not_one_linear_plant():
    table = numbers("surf_table1")
    assert [round((table["F_without"] / table["f_without"]).agg(g)) for g in ("min", "max")] == [2586, 2781]
    assert [round((table["F"] / table["f"]).agg(g)) for g in ("min", "max")] == [2679, 3076]


def test_the_measured_currents_are_those_of_the_records_and_give_the_printed_lines():
    """README of the set; the law of the main job is numpy's straight line with the feed in mm/min."""
    table = numbers("cnc_mill_current")
    readme = bundled("cnc_mill_current").with_name("README.md").read_text(encoding="utf-8")
    for column, digits in (("spindle current", (2, 4)), ("X drive", (3, 4)), ("spindle power", (4, 5))):
        slope, level = np.polyfit(table["feed"], table[column], 1)
        share = np.corrcoef(table["feed"], table[column])[0, 1] ** 2
        line = f"| {level:.{digits[0]}f} + {slope:.{digits[1]}f} feed | {share:.3f} |".replace("feed | 0.", "feed | .")
        assert line in readme
    law = next(law for law in fit.default_laws(read_runs(bundled("cnc_mill_current")))[0] if law.response == "I")
    assert law.params.tolist() == pytest.approx(np.polyfit(60 * table["feed"], table["spindle current"], 1)[::-1])


def test_the_simulated_test_is_regenerated_byte_for_byte(tmp_path):
    path = tmp_path / "data.csv"
    assert gc435.main([str(path)]) == 0
    assert path.read_bytes() == bundled("gc435_709m40").read_bytes()


def test_the_simulated_test_goes_to_standard_output_without_a_file(capsys):
    assert gc435.main([]) == 0
    assert capsys.readouterr().out == bundled("gc435_709m40").read_text(encoding="utf-8")


@pytest.mark.parametrize("arguments", [["a.csv", "b.csv"], ["--help"], ["no/such/folder/data.csv"]])
def test_the_command_answers_what_it_cannot_do_with_one_line_and_code_2(arguments, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert gc435.main(arguments) == 2
    reported = capsys.readouterr()
    assert reported.out == ""
    assert len(reported.err.splitlines()) == 1


def test_the_published_variance_is_split_in_half():
    for law in gc435.LAWS:
        assert law.sd_edge == pytest.approx(law.sd_row)
        assert np.hypot(law.sd_edge, law.sd_row) == pytest.approx(gc435.STANDARD_ERROR[law.response])


def test_what_the_readme_counts_in_the_simulated_test_is_so():
    rows = text_of("gc435_709m40").astype({"AW": float})
    by_edge = rows.groupby("edge")["AW"]
    readme = bundled("gc435_709m40").with_name("README.md").read_text(encoding="utf-8")
    assert f"{len(rows)} rows" in readme
    assert f"in {(by_edge.diff() < 0).sum()} places" in readme
    assert (by_edge.last() >= 0.3).sum() == 1
    assert by_edge.ngroups == 24
