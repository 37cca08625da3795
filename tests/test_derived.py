"""Quantities computed from others: reference figures, chains of rules, comparison with measured columns, and laws."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit
from fitmodels.core import errors
from fitmodels.datasets.derived.rules import RULES
from fitmodels.datasets.notes import from_notes
from hypothesis import given
from hypothesis import strategies as st

ROWS = [(n, vf, d, t) for n in (1000, 1600, 2000) for vf in (400, 640) for d in (1, 2) for t in (2, 5, 9)]
NOISE = np.exp(np.random.default_rng(18).normal(0, 0.05, len(ROWS)))


def frame(notes=(), **columns):
    made = pd.DataFrame(columns)
    made.attrs["notes"] = notes
    return made


def read(notes=(), options=None, **columns):
    return datasets.runs_from_frame(frame(notes, **columns), **(options or {}))


def of(role, text):
    (rule,) = (rule for rule in RULES if rule.role == role and rule.formula == text)
    return rule.function


def milling(**columns):
    """Tests of a four-tooth cutter of 80 mm, wear by the law of V, f, d and t."""
    n, vf, d, t = (np.array(column, dtype=float) for column in zip(*ROWS, strict=True))
    V, f = np.pi * 80 * n / 1000, vf / n
    VB = 1e-3 * V**0.6 * f**0.3 * d**0.2 * t**0.5 * NOISE
    every = {"n": n, "vf [mm/min]": vf, "V": V, "f": f, "fz": f / 4, "ap": d, "t": t, "VB": VB}
    return {name: every[name] for name in columns.get("names", every)}


# Reference figures


def test_published_figures():
    """Formula pages of Sandvik Coromant (turning, milling, drilling) and Kyocera R27-R28; drill torque as 2 pi M n."""
    assert of("V", "pi D n/1000")(80, 1000) == pytest.approx(251.32741, abs=5e-6)
    assert of("n", "1000 V/(pi D)")(251.3274123, 80) == pytest.approx(1000)
    assert of("MRR", "1000 V f d")(150, 0.3, 2.5) == pytest.approx(112500)
    assert of("MRR", "ae d fm")(1.4, 0.2, 700) == pytest.approx(196)  # Tai, Tsai and Li 2023: 3.26 mm3/s
    n = of("n", "1000 V/(pi Dc)")(80, 12)
    assert n == pytest.approx(2122.066, abs=5e-4)
    assert of("MRR", "pi Dc^2/4 f n")(12, 0.25, n) == pytest.approx(60_000)  # 60.000 cm3/min
    assert of("P", "Fc V/60000")(1825.70, 150) == pytest.approx(4.56425)
    assert of("P", "M n/9549.2966")(14.316566, n) == pytest.approx(3.181459, rel=1e-6)
    assert of("P", "M n/9549.2966")(1, 9549.2966) == pytest.approx(1, rel=1e-8)


@given(st.floats(1, 1e3), st.floats(1, 1e5), st.floats(1e-3, 10), st.integers(1, 40))
def test_rules_of_one_relation_agree(D, n, f, z):
    """Each rule inverts the others of its relation."""
    V, fm, fz = of("V", "pi D n/1000")(D, n), of("fm", "f n")(f, n), of("fz", "f/z")(f, z)
    assert of("n", "1000 V/(pi D)")(V, D) == pytest.approx(n)
    assert of("f", "fm/n")(fm, n) == pytest.approx(f)
    assert of("f", "fz z")(fz, z) == pytest.approx(f)
    assert of("fz", "fm/(n z)")(fm, n, z) == pytest.approx(fz)


# Chains, constants and notes


def test_speed_and_feed_of_a_table_of_revolutions_and_feed_rate():
    """The fault: n, D and vf were recognised and not used."""
    runs = read(**{"n": [1000, 500], "D [mm]": [80, 60], "vf [mm/min]": [200, 150], "t": [1, 2], "VB": [0.1, 0.2]})
    assert runs.values("V") == pytest.approx([251.32741, 94.24778], rel=1e-7)
    assert runs.values("f") == pytest.approx([0.2, 0.3])
    assert (runs.units["V"], runs.units["f"]) == ("m/min", "mm/rev")
    assert runs.assumed[:2] == (
        "V = pi D n/1000, computed from columns 'D' and 'n'",
        "f = fm/n, computed from columns 'vf' and 'n'",
    )
    assert not runs.doubts


@pytest.mark.parametrize(
    ("note", "role", "value"),
    [
        ("Werkstückdurchmesser: 80 mm", "D", 80),
        ("turning, diameter 80 mm", "D", 80),
        ("workpiece diameter D = 80 mm", "D", 80),
        ("D = 3.15 in", "D", 80.01),
        ("Durchmesser: 12,5", "D", 12.5),
        ("diamètre de la pièce : 60 mm", "D", 60),
        ("cutter diameter: 63 mm", "Dc", 63),
        ("Fräserdurchmesser = 20 mm", "Dc", 20),
        ("face mill; z = 4", "z", 4),
        ("end mill with 4 flutes", "z", 4),
        ("Fräser, 6 Zähne", "z", 6),
        ("number of teeth: 5", "z", 5),
        ("n = 826 rpm", "n", 826),
        ("Drehzahl: 1200 1/min", "n", 1200),
    ],
)
def test_constants_in_notes(note, role, value):
    assert from_notes([note])[role].value == pytest.approx(value)


@pytest.mark.parametrize(
    "note",
    [
        "diameter 80 to 60 mm",
        "nozzle diameter 2 mm",
        "inscribed circle diameter 12.7 mm",
        "D = 80 mm, later D = 60 mm",
        "z = 4 mm above the table",
        "ISO: CNMG 120408",
        "AA238M-0200-D4-ML-10",
        "fixed: n 610 rpm; d 1 mm",
        "end milling (down), ap 0.2 mm, ae 1.4 mm, 10000 rpm",
        "overhang L/D = 3",
        "d = 2.5 mm",
        "n = 3 repeats; V = 12",
    ],
)
def test_notes_that_state_no_constant(note):
    assert from_notes([note]) == {}


def test_constants_of_notes_and_options():
    notes = ("workpiece diameter: 80 mm",)
    columns = {"n": [1000, 500], "f": [0.2, 0.3], "VB": [0.1, 0.2]}
    runs = read(notes, **columns)
    assert "V = pi D n/1000, computed from column 'n' and D = 80 mm (notes)" in runs.assumed
    given_value = read(notes, {"constants": {"D": 40}}, **columns)
    assert given_value.values("V") == pytest.approx(runs.values("V") / 2)
    assert "V = pi D n/1000, computed from column 'n' and D = 40 mm (--value)" in given_value.assumed


@pytest.mark.parametrize(
    ("constants", "says"),
    [
        ({"q": 3}, "--value q=3: q is no quantity"),
        ({"tool": 3}, "tool is no quantity"),
        ({"D": -80}, "give a number above zero, in mm"),
        ({"n": 100}, "--value n=100: column 'n' holds n already.*--map n=none"),
    ],
)
def test_constants_that_cannot_be_used_are_refused(constants, says):
    with pytest.raises(errors.UsageError, match=says):
        read((), {"constants": constants}, n=[1000, 500], VB=[0.1, 0.2])


def test_a_constant_that_gives_nothing_is_said():
    runs = read((), {"constants": {"z": 4}}, V=[100, 200], f=[0.2, 0.2], VB=[0.1, 0.2], process=[1, 1])
    assert not [text for text in runs.warnings if "z = 4" in text]  # fz = f/z
    runs = read((), {"constants": {"z": 4}}, V=[100, 200], d=[1, 2], VB=[0.1, 0.2])
    assert any("z = 4 (--value) is not used" in text for text in runs.warnings)


def test_none_prevents_a_computation():
    columns = {"n": [1000, 500], "D": [80, 80], "f": [0.2, 0.3], "VB": [0.1, 0.2]}
    assert read(**columns).has("V")
    assert not read((), {"map": {"V": "none"}}, **columns).has("V")


def test_a_coordinate_is_no_number_of_teeth():
    assert not read(fz=[0.1, 0.2], z=[1.5, -2.0], VB=[0.1, 0.2]).has("f")
    runs = read(**{"fz": [0.1, 0.2], "Z [mm]": [4.0, 4.0], "VB": [0.1, 0.2]})
    assert not runs.has("f")
    assert runs.columns[1].role is None
    assert read(fz=[0.1, 0.2], Zähnezahl=[4, 6], VB=[0.1, 0.2]).values("f") == pytest.approx([0.4, 1.2])


def test_the_tool_turns_in_milling_and_the_workpiece_in_turning():
    columns = {"n": [1000, 500], "D": [80, 80], "tool diameter [mm]": [20, 20], "f": [0.2, 0.2], "VB": [0.1, 0.2]}
    for process, diameter in (("milling", 20), ("drilling", 20), ("turning", 80)):
        V = read((), {"process": process}, **columns).values("V")
        assert V[0] == pytest.approx(np.pi * diameter)


# Wear, power, removal rate, time


def test_average_wear_of_three_lands():
    """Alaskari and Oraby: AW of nose, flank and notch wear; each is kept."""
    runs = read(V=[100, 200], t=[2, 4], nose=[0.1, 0.2], flank=[0.2, 0.3], notch=[0.3, 0.7])
    assert runs.values("AW") == pytest.approx([0.2, 0.4])
    assert runs.values("VBC").tolist() == [0.1, 0.2]
    assert runs.values("VB").tolist() == [0.2, 0.3]
    assert runs.values("VBN").tolist() == [0.3, 0.7]
    German = {"Eckenverschleiß [um]": [90], "Freiflächenverschleiß [um]": [100], "Kerbverschleiß [um]": [110]}
    assert read(V=[100], **German).values("AW") == pytest.approx([0.1])


def test_power_of_force_and_speed():
    runs = read(V=[150.0, 100.0], f=[0.3, 0.2], Fc=[1825.70, 1000])
    assert runs.values("P") == pytest.approx([4.56425, 1.66667], rel=1e-5)
    torque = read(n=[2000.0, 1000.0], f=[0.3, 0.2], M=[10.0, 5.0])
    assert torque.values("P") == pytest.approx([2.094395, 0.5235988])


def test_power_of_the_papers_vertical_force():
    """Fx feed, Fy power, Fz radial in Alaskari and Oraby; elsewhere Fy may be any component."""
    forces = {"V": [100.0, 150.0], "f": [0.3, 0.2], "d": [2.5, 2.0], "Fx": [600, 400], "Fz": [500, 300]}
    papers = read(**forces, Fy=[1800, 1000])
    assert papers.values("P") == pytest.approx([3.0, 2.5])
    assert any("Fy is taken as the cutting force" in text for text in papers.assumed)
    assert not read(**forces, Fy=[200, 100]).has("P")
    assert not read(**forces, Fy=[1800, 1000], ae=[1, 2]).has("P")


def test_removal_rate_where_the_process_is_known():
    turning = {"V": [150.0], "f": [0.3], "d": [2.5], "VB": [0.1]}
    assert not read(**turning).has("MRR")
    assert read((), {"process": "turning"}, **turning).values("MRR") == pytest.approx([112500])
    milling_columns = {"ae": [1.4], "ap": [0.2], "vf [mm/min]": [700], "n": [10000], "VB": [0.1]}
    assert read(**milling_columns).values("MRR") == pytest.approx([196])
    drilling = {"V": [80.0], "f": [0.25], "Dc": [12.0], "M": [14.3]}
    assert read((), {"process": "drilling"}, **drilling).values("MRR") == pytest.approx([60_000])


def test_time_from_the_length_of_cut():
    columns = {"edge": [1, 1, 2, 2], "n": [1000] * 4, "VB": [0.1, 0.2, 0.1, 0.3]}
    rising = read(**columns, **{"vf [mm/min]": [200, 200, 400, 400], "length of cut [m]": [1, 2, 1, 2]})
    assert rising.values("t") == pytest.approx([5, 10, 2.5, 5])
    passes = read(**columns, **{"vf [mm/min]": [200, 200, 400, 400], "Schnittlänge [mm]": [1000] * 4})
    assert passes.values("t") == pytest.approx([5, 10, 2.5, 5])
    assert any("each row is one pass" in text for text in passes.assumed)
    moved = read(**columns, **{"vf [mm/min]": [200, 400, 200, 400], "length of cut [mm]": [1000, 2000, 1000, 2000]})
    assert moved.values("t") == pytest.approx([5, 7.5, 5, 7.5])
    falls = read(**columns, **{"vf [mm/min]": [200] * 4, "length of cut [mm]": [1000, 2000, 2000, 1000]})
    assert any("50 % of the steps" in str(doubt) for doubt in falls.doubts)


def test_time_from_a_length_along_the_cut():
    runs = read(**{"V": [100, 200], "f": [0.2, 0.2], "cutting distance [m]": [1000, 1000], "VB": [0.1, 0.2]})
    assert runs.values("t") == pytest.approx([10, 5])
    spiral = read(**{"V": [100, 200], "f": [0.2, 0.2], "cutting length [m]": [1000, 3000], "VB": [0.1, 0.2]})
    assert spiral.values("t") == pytest.approx([10, 15])


# Measured and computed


def doubted(**columns):
    runs = read(**columns)
    return [str(doubt) for doubt in runs.doubts if "agree" in doubt.sentence or " times " in doubt.sentence]


def test_columns_that_agree_raise_no_doubt():
    n = np.array([1000.0, 1600, 2000])
    V = np.round(np.pi * 80 * n / 1000)
    agreeing = {"n": n, "D": [80.0] * 3, "V": V, "f": [0.2] * 3, "vf [mm/min]": 0.2 * n, "z": [4] * 3, "fz": [0.05] * 3}
    assert doubted(**agreeing, VB=[0.1, 0.2, 0.3]) == []
    assert doubted(V=V, Fc=[900.0, 950, 1000], P=1.3 * V * [900, 950, 1000] / 60000) == []


@pytest.mark.parametrize(
    ("changed", "says", "remedy"),
    [
        ({"V": 3.28084}, "ratio is 3.28 in all rows", "--unit V=sfm"),
        ({"V": 1 / 60}, "ratio is 0.0167 in all rows", "--unit V=m/s"),
        ({"D": 1 / 25.4}, "ratio is 25.4 in all rows", "--unit D=in"),
        ({"f": 1 / 25.4}, "ratio is 0.0394 in all rows", "--unit f=in/rev"),
        ({"D": 0.5}, "a radius is taken as a diameter", ""),
        ({"D": 0.8}, "D is not the diameter at the cut", ""),
        ({"fz": 4}, "the ratio is z: fz is probably another feed", "--map fz=none"),
        ({"Fc": 1 / 9.80665}, "one of these would agree: --unit Fc=", ""),
        ({"P": 8}, "ratio is 8.8 in all rows", ""),
        ({"MRR": 0.001}, "ratio is 0.001 in all rows", "--unit MRR=cm3/min"),
    ],
)
def test_a_ratio_names_its_cause(changed, says, remedy):
    n = np.array([1000.0, 1600, 2000])
    V, f = np.pi * 80 * n / 1000, np.array([0.2, 0.3, 0.4])
    columns = {
        "n": n, "D": np.full(3, 80.0), "V": V, "f": f, "vf [mm/min]": f * n, "z": np.full(3, 4.0), "fz": f / 4,
        "d": np.full(3, 2.0), "Fc": np.full(3, 900.0), "P": 1.1 * 900 * V / 60000, "MRR": 1000 * V * f * 2,
        "VB": np.array([0.1, 0.2, 0.3]),
    }  # fmt: skip
    if changed.keys() & {"MRR"}:
        columns = {name: values for name, values in columns.items() if name not in ("fz", "z")}
    if changed.keys() & {"V", "D", "f"}:
        columns = {name: values for name, values in columns.items() if name not in ("Fc", "P", "MRR", "fz", "z")}
    for name, factor in changed.items():
        columns[name] = columns[name] * factor
    units = {"D": "mm", "V": "m/min", "f": "mm/rev", "fz": "mm/tooth", "d": "mm", "Fc": "N", "P": "kW", "VB": "mm"}
    columns = {f"{name} [{units[name]}]" if name in units.keys() - changed else name: columns[name] for name in columns}
    found = doubted(**columns)
    assert (found != []) == (says != "")
    if says:
        assert says in " ".join(found)
        assert remedy in " ".join(found)
    if remedy:
        option, (role, value) = remedy.split()[0], remedy.split()[1].split("=")
        options = {"units": {role: value}} if option == "--unit" else {"map": {role: value}}
        assert not [doubt for doubt in read((), options, **columns).doubts if "agree" in doubt.sentence]


def test_a_row_that_contradicts_its_columns_is_named():
    n = np.array([1000.0, 1600, 2000, 1000])
    V = np.pi * 80 * n / 1000
    V[2] *= 10
    (found,) = doubted(n=n, D=[80.0] * 4, V=V, VB=[0.1, 0.2, 0.3, 0.1])
    assert "V is 10 times pi D n/1000 from D and n in 1 row (line 2)" in found


# Laws


@pytest.mark.parametrize(
    ("names", "options", "factors"),
    [
        (("V", "f", "ap", "t", "VB"), {}, ("V", "f", "d", "t")),
        (("n", "vf [mm/min]", "ap", "t", "VB"), {"constants": {"D": 80, "z": 4}}, ("V", "f", "d", "t")),
        (("V", "vf [mm/min]", "ap", "t", "VB"), {"constants": {"D": 80}}, ("V", "f", "d", "t")),
        (("n", "fz", "ap", "t", "VB"), {}, ("n", "fz", "d", "t")),
        (("V", "fz", "ap", "t", "VB"), {}, ("V", "fz", "d", "t")),
        (("n", "vf [mm/min]", "ap", "t", "VB"), {}, ("n", "f", "d", "t")),
    ],
)
def test_the_laws_of_a_milling_table_have_the_same_exponents(names, options, factors):
    exact = fit.default_laws(read(**milling()))[0][0]
    (law,), _ = fit.default_laws(read((), options, **milling(names=names)))
    assert law.factors == factors
    assert law.params.to_numpy()[1:] == pytest.approx(exact.params.to_numpy()[1:], rel=1e-6)


def test_a_feed_rate_alone_is_a_factor_and_a_doubt():
    runs = read(**milling(names=("V", "vf [mm/min]", "ap", "t", "VB")))
    (law,), _ = fit.default_laws(runs)
    assert law.factors == ("V", "fm", "d", "t")
    assert any("not at constant feed per revolution" in str(doubt) for doubt in runs.doubts)


def test_the_width_of_cut_is_a_factor():
    rng = np.random.default_rng(3)
    V, ae, t = rng.uniform(50, 200, 30), rng.uniform(2, 20, 30), rng.uniform(1, 20, 30)
    (law,), _ = fit.default_laws(read(V=V, ae=ae, t=t, VB=1e-3 * V**0.5 * ae**0.3 * t**0.4))
    assert law.params[["V", "ae", "t"]].tolist() == pytest.approx([0.5, 0.3, 0.4])


def test_a_constant_is_read_by_the_batch_too(tmp_path):
    pytest.importorskip("pyarrow")
    from fitmodels.batch.plan import Reading
    from fitmodels.batch.source.parquet_blocks import parquet_plan
    from fitmodels.batch.source.parquet_reading import parquet_rows

    path = Path(tmp_path, "tests.parquet")
    table = pd.DataFrame({"tool": "A", "work": "B", **milling(names=("n", "vf [mm/min]", "ap", "t", "VB"))})
    table.to_parquet(path)
    reading = Reading(constants={"D": 80.0})
    plan = parquet_plan(path, reading, most_rows=100, most_pairs=10, work=Path(tmp_path), report=print)
    (rows,), _ = parquet_rows(plan.blocks[0], plan)
    runs = datasets.runs_from_frame(table, constants={"D": 80.0})
    for role in ("V", "f"):
        np.testing.assert_array_equal(rows.frame[role], runs.values(role))
    assert [one.equation for one in plan.derived] == ["V = pi D n/1000", "f = fm/n"]
    assert set(runs.assumed[:2]) <= set(plan.assumed)


@pytest.mark.parametrize(("names", "symbol", "remedy"), [(("V", "fz"), "fz", "--value z=4"), (("n", "f"), "n", "D=80")])
def test_a_region_refuses_a_law_on_another_speed_or_feed(names, symbol, remedy):
    """Wear and power would stay the same while the removal rate grows with the feed."""
    from fitmodels import controllers, parameters

    runs = read(**milling(names=(*names, "ap", "t", "VB")))
    laws, _ = fit.default_laws(runs)
    limits = {"speed": {"low": 80, "high": 200, "unit": "m/min"}, "feed": {"low": 0.1, "high": 0.4, "unit": "mm/rev"},
              "wear": {"value": 0.3, "unit": "mm", "of": "VB"}}  # fmt: skip
    pf = parameters.collect(design=runs, laws=laws, limits=limits, draws_kept=False)
    with pytest.raises(errors.UsageError, match=f"is on {symbol} .*{remedy}"):
        controllers.visible_region(pf, d=2, t=5, at={symbol: 0.05})


def test_a_batch_refuses_sums_along_edges(tmp_path):
    pytest.importorskip("pyarrow")
    from fitmodels.batch.plan import Reading
    from fitmodels.batch.source.parquet_blocks import parquet_plan

    path = Path(tmp_path, "tests.parquet")
    rows = {"tool": "A", "work": "B", "edge": ["1", "1", "2", "2"], "n": 1000.0, "vf [mm/min]": 200.0,
            "length of cut [mm]": 1000.0, "VB": [0.1, 0.2, 0.1, 0.3]}  # fmt: skip
    pd.DataFrame(rows).to_parquet(path)
    options = {"most_rows": 100, "most_pairs": 10, "work": Path(tmp_path), "report": print}
    with pytest.raises(errors.DataError, match=r"not summed.*--map lf=none"):
        parquet_plan(path, Reading(), **options)
    assert parquet_plan(path, Reading(map={"lf": "none"}), **options).rows == 4


def test_a_length_that_is_no_cut_length_is_no_doubt():
    n = np.array([1000.0, 1600, 2000])
    assert doubted(n=n, f=[0.2, 0.3, 0.4], L=[120, 120, 120], t=[2, 4, 6], VB=[0.1, 0.2, 0.3]) == []


def test_the_thrust_of_other_axes_is_remarked():
    forces = {"V": [100.0, 150.0], "Fx": [1800, 1000], "Fy": [600, 400], "Fz": [500, 300]}
    assert any("Fx is the largest of the three here" in text for text in read(**forces).assumed)


@pytest.mark.parametrize(
    ("header", "cells"),
    [
        ("z", [0, 5, 5]),
        ("Z", ["a", "b", "b"]),
        ("z", [1.5, 2, 3]),
        ("L", ["long", "short", ""]),
        ("notch", ["y", "n", "n"]),
    ],
)
def test_names_with_other_meanings_are_decided_by_their_cells(header, cells):
    runs = read(V=[100, 150, 200], AW=[0.1, 0.2, 0.3], **{header: cells})
    assert runs.columns[2].role is None
    assert runs.data.iloc[:, 2].tolist() == cells


def test_notch_wear_alone_has_a_law():
    V = np.array([80, 100, 120, 150, 200.0])
    (law,), _ = fit.default_laws(read(V=V, **{"notch wear [mm]": 1e-3 * V**0.9 * [1, 1.01, 1, 0.99, 1]}))
    assert law.response == "VBN"


def test_an_empty_column_gives_nothing():
    runs = read(n=[1000.0, 500], D=[np.nan, np.nan], VB=[0.1, 0.2])
    assert not runs.has("V")


def test_unusual_computed_values_are_doubts():
    n = np.array([1000.0, 1200, 1600, 2000, 1000])
    columns = {"D [mm]": [80.0] * 5, "f [mm/rev]": [0.2] * 5, "VB [mm]": [0.1] * 5}
    assert not read(**columns, **{"n [1/min]": n}).doubts
    some = read(**columns, **{"n [1/min]": n * [1, 1, 1, 25.4, 1]}).doubts
    assert any("V = pi D n/1000 is 12800 m/min in 1 of 5 rows (line 3)" in str(doubt) for doubt in some)
    small = columns | {"D [mm]": [0.8] * 5}
    (every,) = [doubt for doubt in read(**small, **{"n [1/min]": n}).doubts if "V" in doubt.columns]
    assert "usual with --unit D=in or --unit n=rev/s" in every.sentence
    with pytest.raises(errors.DataError, match=r"V = pi D n/1000 is .* cannot be"):
        read(**columns, **{"n [1/min]": n * 200})


def test_lands_in_um_without_a_unit_are_taken_as_such():
    lands = {"nose": [66.0, 120, 200], "flank": [90.0, 150, 220], "notch": [110.0, 210, 387]}
    runs = read(**{"V [m/min]": [100.0, 150, 200]}, **lands)
    assert runs.values("AW") == pytest.approx([0.0886667, 0.16, 0.269], rel=1e-5)
    assert {str(doubt.remedy) for doubt in runs.doubts} >= {"--unit VBC=um", "--unit VB=um", "--unit VBN=um"}


def test_a_face_mill_has_a_large_feed_per_revolution():
    rows = {
        "n [1/min]": [500.0, 600, 800],
        "vf [mm/min]": [1200.0, 1500, 2000],
        "D [mm]": [100.0] * 3,
        "VB [mm]": [0.1] * 3,
    }
    assert read(**rows).doubts == ()
    assert read((), {"process": "turning"}, **rows).doubts != ()


def test_the_law_of_a_computed_power_is_that_of_the_force_and_is_named_so():
    """P = Fc V/60000: one exponent of V more, the same residuals, and R2 contains V."""
    rng = np.random.default_rng(7)
    V, f = map(np.ravel, np.meshgrid([80.0, 120, 180], [0.1, 0.2, 0.3]))
    runs = read(V=V, f=f, Fc=1800 * f**0.75 * np.exp(rng.normal(0, 0.03, 9)))
    laws = {law.response: law for law in fit.default_laws(runs)[0]}
    force, power = laws["Fc"], laws["P"]
    assert power.params["V"] == pytest.approx(force.params["V"] + 1)
    np.testing.assert_allclose(power.rows.residuals, force.rows.residuals, atol=1e-12)
    assert power.notes[-1].startswith("P is computed, not measured: P = Fc V/60000; its law is that of Fc")
    assert power.notes[-1].endswith("without the losses of the drive")
    assert not any("computed" in note for note in force.notes)
    measured = read(V=V, f=f, P=rng.uniform(1, 2, 9))
    assert not any("computed" in note for law in fit.default_laws(measured)[0] for note in law.notes)


def test_a_force_that_is_negative_in_some_rows_alone_has_a_reversed_sign(tmp_path):
    rows = [(V, f, d, 2000 * f**0.75 * d * (-1 if V == 220 else 1)) for V in (100, 160, 220) for f in (0.1, 0.2, 0.35)
            for d in (1, 2)]  # fmt: skip
    path = tmp_path / "signs.csv"
    path.write_text("vc [m/min],f [mm/rev],ap [mm],Fc [N]\n" + "".join(f"{V},{f},{d},{F:.1f}\n" for V, f, d, F in rows))
    (doubt,) = datasets.read_runs(path).doubts
    assert doubt.sentence.endswith("Fc is negative there: a reversed sign")
    assert doubt.remedy == '--correct "lines 14-19:Fc*-1"'
    turned = datasets.read_runs(path, correct=("lines 14-19:Fc*-1",))
    assert not turned.doubts
    assert (turned.values("Fc") > 0).all()


def test_the_sign_of_an_axis_does_not_make_another_force_the_cutting_force():
    V, f, d = np.array(np.meshgrid([100.0, 200], [0.1, 0.3], [1.0, 2])).reshape(3, -1)
    Fz = -2100 * f**0.75 * d
    frame = pd.DataFrame(
        {"vc [m/min]": V, "f [mm/rev]": f, "ap [mm]": d, "Fx [N]": Fz / 2, "Fy [N]": -Fz / 3, "Fz [N]": Fz}
    )
    assert not datasets.runs_from_frame(frame).has("P")
    right = frame.rename(columns={"Fz [N]": "Fy [N]", "Fy [N]": "Fz [N]"}).assign(**{"Fy [N]": -Fz})
    assert datasets.runs_from_frame(right).has("P")


@pytest.mark.parametrize("header", ["f (mm)", "f [mm/rev]"])
def test_a_feed_per_tooth_under_the_name_of_f_is_read_so(header):
    n, f, d = np.array(np.meshgrid([1000.0, 1500, 2000], [0.04, 0.08, 0.12], [1.0, 2])).reshape(3, -1)
    frame = pd.DataFrame({"n [1/min]": n, "D [mm]": 20.0, "z": 4, header: f, "ap [mm]": d, "vf [mm/min]": 4 * n * f})
    frame["Fc [N]"] = 900 * f**0.7 * d
    (doubt,) = datasets.runs_from_frame(frame).doubts
    assert "the ratio is 1/z, z 4: f is probably the feed per tooth" in doubt.sentence
    assert doubt.remedy.startswith("--map fz=f")
    units = {"fz": "mm/tooth"} if "--unit" in doubt.remedy else {}
    runs = datasets.runs_from_frame(frame, map={"fz": "f"}, units=units)
    assert not runs.doubts
    np.testing.assert_allclose(runs.values("fz"), f)


def peaks(names, scale=1):
    """A milling file with loads of these names, of levels that stand in each row."""
    rows = [(V, f, round(V * f)) for V in (100, 150, 200) for f in (0.1, 0.2, 0.3)] * 2
    numbers = "".join(f"{V},{f},{','.join(str(scale * (k * load + 100)) for k in (3, 2, 5))}\n" for V, f, load in rows)
    return f"V,f,{','.join(names)}\n{numbers}"


@pytest.mark.parametrize("form", ["{} max (N)", "{}_max", "{}max", "{} peak", "{}_rms [N]", "max {}", "{} Spitze [N]"])
def test_peak_loads_are_read_and_nothing_follows_from_them(tmp_path, form):
    path = tmp_path / "peaks.csv"
    path.write_text(peaks([form.format(axis) for axis in ("Fx", "Fz", "Fc")]), "utf-8")
    runs = datasets.read_runs(path)
    assert {"Fx", "Fz", "Fc"} <= set(runs.units)
    assert not {"Fxz", "P"} & set(runs.units)
    assert any("a peak or effective value, not a mean" in text for text in runs.assumed)


def test_a_mean_load_counts_before_its_peak(tmp_path):
    path = tmp_path / "both.csv"
    path.write_text(peaks(["Fx max [N]", "Fx mean [N]", "Fz [N]"]), "utf-8")
    assert next(use.header for use in datasets.read_runs(path).columns if use.role == "Fx") == "Fx mean [N]"


def test_loads_under_other_names_are_proposed(tmp_path):
    path = tmp_path / "loads.csv"
    path.write_text(peaks(["P total [kW]", "P idle [kW]", "Spindle load [%]"], scale=0.01), "utf-8")
    doubts = datasets.read_runs(path).doubts
    assert [doubt.remedy for doubt in doubts] == ['--map "P=col3"', ""]
    assert "share of a rated value" in doubts[1].sentence


def test_german_names_of_force_and_depth(tmp_path):
    path = tmp_path / "de.csv"
    path.write_text(peaks(["Spantiefe", "Hauptschnittkraft", "Rz"], scale=0.01), "utf-8")
    roles = {use.header: use.role for use in datasets.read_runs(path, units={"Fc": "kN"}).columns}
    assert (roles["Spantiefe"], roles["Hauptschnittkraft"]) == ("d", "Fc")


@pytest.mark.parametrize("D", [[80.0] * 4, [80.0, 76, 72, 68]])
def test_speed_and_spindle_speed_exchanged_are_named_with_the_options_that_exchange_them(D):
    n = np.array([480.0, 640, 800, 990])
    V = np.pi * np.array(D) * n / 1000
    table = {"V [m/min]": n, "n [1/min]": V, "D [mm]": D, "f [mm/rev]": [0.2] * 4, "VB [mm]": [0.1, 0.15, 0.2, 0.25]}
    (doubt,) = read(**table).doubts
    assert "V and n may be exchanged" in doubt.sentence
    assert doubt.unsettled
    assert doubt.remedy == '--map "V=col2" --map "n=col1" --unit "V=m/min" --unit "n=1/min"'
    mended = read((), {"map": {"V": "col2", "n": "col1"}, "units": {"V": "m/min", "n": "1/min"}}, **table)
    assert mended.values("V") == pytest.approx(V)
    assert mended.doubts == ()


def test_a_diameter_that_is_not_that_of_the_cut_is_no_exchange():
    """D 300 mm in place of 270 mm: V and n are nearly equal there, and the ratio is that of their exchange."""
    n = np.array([100.0, 150, 200, 250])
    (doubt,) = doubted(V=np.pi * 270 * n / 1000, n=n, D=[300.0] * 4, f=[0.2] * 4, VB=[0.1, 0.15, 0.2, 0.25])
    assert "D is not the diameter at the cut" in doubt


@pytest.mark.parametrize("name", ["Max temperature [degC]", "Temperature [degC]"])
def test_a_peak_of_another_quantity_does_not_change_what_is_computed(tmp_path, name):
    V, f, d = (x.ravel() for x in np.meshgrid([100.0, 150.0, 220.0], [0.1, 0.2, 0.3], [1.0, 2.0], indexing="ij"))
    force = 2000 * f**0.75 * d
    columns = {"vc [m/min]": V, "f [mm/rev]": f, "ap [mm]": d, "Fx [N]": 0.4 * force, "Fy [N]": 0.3 * force}
    pd.DataFrame(columns | {"Fz [N]": force, name: 200 * V**0.3}).round(3).to_csv(tmp_path / "t.csv", index=False)
    assert [one.role for one in datasets.read_runs(tmp_path / "t.csv").derived] == ["Fxz"]


@pytest.mark.parametrize(("name", "expected"), [("Fx max [N]", "lf/fm"), ("Fx [N]", "lf/fm")])
def test_the_time_of_milling_follows_from_the_feed_rate_beside_a_peak_force(tmp_path, name, expected):
    frame = pd.DataFrame({"edge": np.repeat(["E1", "E2", "E3"], 4), "vc [m/min]": np.repeat([100, 150, 220], 4)})
    frame["vf [mm/min]"], frame["ae [mm]"] = np.repeat([300, 450, 660], 4), 5.0
    frame["Length of cut [mm]"] = np.tile([1500, 3000, 4500, 6000], 3)
    frame["VB [mm]"], frame[name] = np.tile([0.1, 0.14, 0.17, 0.2], 3), np.linspace(200, 240, 12)
    frame.to_csv(tmp_path / "t.csv", index=False)
    found = next(one for one in datasets.read_runs(tmp_path / "t.csv").derived if one.role == "t")
    assert expected in found.equation
