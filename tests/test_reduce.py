"""``fitmodels reduce``: records with known means, faults and ways to join, each with what is said about it."""

import json
import sys
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets
from fitmodels.cli import main
from fitmodels.core.errors import DataError, UsageError
from fitmodels.datasets.records.formats import looks_like_record
from fitmodels.datasets.signals.cuts import find_cuts
from fitmodels.datasets.signals.faults import _piled_up
from fitmodels.datasets.signals.joining import read_plan
from fitmodels.datasets.signals.options import ReduceOptions
from fitmodels.datasets.signals.recording import Recording, read_recordings
from fitmodels.datasets.signals.reduction import _notes

sys.path.insert(0, str(Path(__file__).parent))
simulated = import_module("force_records")
sys.path.pop(0)

MEANS = [520.0, 640.0, 580.0]
WITHIN = 0.01  # of the true mean, as the issue asks


@pytest.fixture
def lab(tmp_path):
    """A folder of records and a plan; ``run`` reduces them and returns the table that the main job reads."""
    (tmp_path / "records").mkdir()

    class Lab:
        folder = tmp_path / "records"
        plan = tmp_path / "tests.csv"
        out = tmp_path / "data.csv"
        kept = tmp_path / "data-records"

        def rows(self, n=3, edges=("E1",), **columns):
            t = [2.0 * (k + 1) for _ in edges for k in range(n)]
            frame = pd.DataFrame(
                {"edge": np.repeat(edges, n), "V [m/min]": 120, "f [mm/rev]": 0.2, "t [min]": t, **columns}
            )
            frame.to_csv(self.plan, index=False)

        def record(self, name="E1.csv", means=MEANS, rate=200, seed=1, sign=1, **options):
            t, load, *_ = simulated.cut_signal(means, rate, np.random.default_rng(seed), **{"seconds": 5.0} | options)
            simulated.write_table(self.folder / name, t, {"Fc [N]": sign * load})

        def run(self, *options, code=0):
            assert main(["reduce", *map(str, (self.folder, "--plan", self.plan, "--out", self.out)), *options]) == code
            return datasets.read_runs(self.out) if code == 0 else None

    return Lab()


def recording(values, rate, name="Fc"):
    return Recording("run.csv", 1 / rate, {name: np.asarray(values, dtype=float)}, None, ())


# Means


@pytest.mark.parametrize(
    ("rate", "options"),
    [(10, {"noise": 0.03}), (200, {}), (1000, {"ripple": 0.05}), (200, {"drift": 0.15}), (200, {"noise": 0.1}),
     (1000, {"ramp": 1.0}), (200, {"drift": -0.1, "air_cut": 0.03})],
)  # fmt: skip
def test_means_within_one_percent_of_the_truth(lab, rate, options):
    lab.rows()
    lab.record(rate=rate, **options)
    runs = lab.run("--value", "n=600")
    assert runs.values("Fc") == pytest.approx(MEANS, rel=WITHIN)
    assert runs.values("t") == pytest.approx([2, 4, 6])
    remarks = runs.data.get("remarks", [])
    assert all("the zero drifts" in text or "ripple" in text for text in remarks if text)


def test_fifty_kilohertz():
    t, load, *_ = simulated.cut_signal([300.0], 50_000, np.random.default_rng(2), seconds=3.0)
    found = find_cuts(recording(load, 50_000), ReduceOptions())
    first, end = found.cuts[0].window
    assert len(found.cuts) == 1
    assert 0.7 * 3 < t[end] - t[first] < 2.8


def test_peak_is_the_mean_of_the_largest_values_of_the_revolutions(lab):
    lab.rows()
    lab.record(rate=1000, noise=0.0, ripple=0.0, drift=0.0, teeth=0.25)
    assert lab.run("--value", "n=600").data["Fc peak [N]"].to_numpy() == pytest.approx(
        1.25 * np.array(MEANS), rel=WITHIN
    )
    assert "revolution" in lab.out.read_text()
    lab.run("--force")
    assert "window of 0.1 s" in lab.out.read_text()


def test_a_plan_keeps_names_that_look_like_numbers_and_its_order(tmp_path):
    path = tmp_path / "tests.csv"
    path.write_text("run,edge,n\n03,1E1,600\n01,10,600\n02,007,600\n")
    plan = read_plan(path, ReduceOptions())
    assert (plan.edges, plan.order) == (("1E1", "10", "007"), (1, 2, 0))


def test_notes_on_the_air_explain_a_count_and_others_do_not():
    record = SimpleNamespace(name="E1.csv", notes=("cut in air", "repair of the spindle", "1 cut left out"))
    assert _notes([record]) == ["E1.csv: cut in air", "E1.csv: 1 cut left out"]


def test_a_drive_has_three_states(lab):
    """Off, idle and cut: the start of the spindle is no cut, and the idle power is no load."""
    rng = np.random.default_rng(3)
    t, load, *_ = simulated.cut_signal([2.0, 3.0], 100, rng, seconds=5.0, drift=0, ripple=0)
    power = np.concatenate([np.zeros(300), 0.8 + load, np.zeros(300)]) + 0.002 * rng.standard_normal(len(t) + 600)
    power[300:340] += np.linspace(3, 0, 40)  # the spindle accelerates
    found = find_cuts(recording(power, 100, "P"), ReduceOptions())
    assert len(found.cuts) == 2
    assert found.levels["off"] == pytest.approx(0, abs=0.01)
    assert found.levels["idle"] == pytest.approx(0.8, abs=0.05)
    lab.rows(2)
    simulated.write_table(lab.folder / "E1.csv", 0.01 * np.arange(len(power)), {"P [kW]": power})
    runs = lab.run()
    assert runs.values("P") == pytest.approx([2, 3], rel=0.02)
    assert runs.data["P idle [kW]"].to_numpy() == pytest.approx(0.8, rel=0.05)


def test_a_spindle_that_only_idles_is_no_cut(lab, capsys):
    rng = np.random.default_rng(3)
    _, load, *_ = simulated.cut_signal([2.0], 100, rng, seconds=5.0, drift=0, ripple=0)
    for name, inner in (("E1.csv", 0.8 + load), ("E2.csv", np.full(800, 0.8) + 0.02 * rng.standard_normal(800))):
        power = np.concatenate([np.zeros(300), inner, np.zeros(300)]) + 0.002 * rng.standard_normal(len(inner) + 600)
        simulated.write_table(lab.folder / name, 0.01 * np.arange(len(power)), {"P [kW]": power})
    lab.rows(1, edges=("E1", "E2"))
    lab.run(code=3)
    assert "E2.csv contains no cut" in capsys.readouterr().err


def test_an_interrupted_cut_is_found_on_its_scatter():
    rng = np.random.default_rng(4)
    load = 2 * rng.standard_normal(20_000)
    load[5000:14_000] += 300 * np.sin(2 * np.pi * 40 * np.arange(9000) / 1000)
    found = find_cuts(recording(load, 1000, "Fx"), ReduceOptions())
    assert found.signal == "standard deviation of Fx"
    assert len(found.cuts) == 1


# Formats


@pytest.mark.parametrize("kind", ["tdms", "lvm", "mat", "mat73", "german"])
def test_every_format_gives_the_same_means(lab, kind):
    t, load, *_ = simulated.cut_signal(MEANS, 200, np.random.default_rng(1), seconds=5.0)
    channels = {"Fc [N]": load, "Fz [N]": 0.5 * load}
    if kind == "tdms":
        simulated.write_tdms(lab.folder / "E1.tdms", 200, channels)
    elif kind == "lvm":
        pytest.importorskip("lvm_read")
        simulated.write_lvm(lab.folder / "E1.lvm", 200, channels)
    elif kind == "german":
        simulated.write_table(
            lab.folder / "E1.txt", 1000 * t, channels, header=["Zeit [ms]", "Schnittkraft [N]", "Fz [N]"], mark=";"
        )
        path = lab.folder / "E1.txt"
        path.write_text(path.read_text().replace(".", ","))
    else:
        if kind == "mat73":
            pytest.importorskip("h5py")
        simulated.write_mat(lab.folder / "E1.mat", 200, channels, hdf=kind == "mat73")
    lab.rows()
    runs = lab.run()
    assert runs.values("Fc") == pytest.approx(MEANS, rel=WITHIN)
    assert runs.values("Fz") == pytest.approx(0.5 * np.array(MEANS), rel=WITHIN)


def test_volts_need_a_sensitivity(lab, capsys):
    t, load, *_ = simulated.cut_signal(MEANS, 200, np.random.default_rng(1), seconds=5.0)
    simulated.write_table(lab.folder / "E1.csv", t, {"Fc [V]": load / 200})
    lab.rows()
    lab.run(code=3)
    assert "--scale Fc=200" in capsys.readouterr().err
    assert lab.run("--scale", "Fc=200").values("Fc") == pytest.approx(MEANS, rel=WITHIN)


def test_a_record_without_times_needs_the_rate(lab, capsys):
    _, load, *_ = simulated.cut_signal(MEANS, 200, np.random.default_rng(1), seconds=5.0)
    (lab.folder / "E1.csv").write_text("Fc [N],Fz [N]\n" + "".join(f"{v:.2f},{v / 2:.2f}\n" for v in load))
    lab.rows()
    lab.run(code=2)
    assert "--rate" in capsys.readouterr().err
    assert lab.run("--rate", "200").values("Fc") == pytest.approx(MEANS, rel=WITHIN)


def test_uneven_sampling_is_interpolated_and_said(lab):
    t, load, *_ = simulated.cut_signal(MEANS, 10, np.random.default_rng(1), seconds=8.0)
    jitter = t + np.random.default_rng(2).uniform(-0.03, 0.03, t.size)
    simulated.write_table(lab.folder / "E1.csv", jitter, {"Fc [N]": load})
    lab.rows()
    assert lab.run().values("Fc") == pytest.approx(MEANS, rel=2 * WITHIN)
    (held,) = json.loads((lab.kept / "E1.csv.json").read_text())["records"]
    assert any("not uniform" in note for note in held["notes"])


def test_the_report_as_json(lab, capsys):
    """Of a record that begins in a cut: what is not known is null."""
    t, load, *_ = simulated.cut_signal(MEANS, 200, np.random.default_rng(1), seconds=5.0)
    simulated.write_table(lab.folder / "E1.csv", t[t > 3.5], {"Fc [N]": load[t > 3.5]})
    lab.rows()
    lab.run("--json")
    report = json.loads(capsys.readouterr().out, parse_constant=pytest.fail)
    assert report["schema"] == "fitmodels.reduction/1"
    assert report["rows"] == [0, 1, 2]
    first = report["records"][0]["cuts"][0]
    assert first["figures"]["Fc"]["mean"] == pytest.approx(MEANS[0], rel=0.02)
    assert first["figures"]["Fc"]["drift"] is None


# Faults, each named


def faulty(change, rate=1000, unit="N", **options):
    """Remarks on the only cut of a record with a fault."""
    t, load, *_ = simulated.cut_signal([500.0], rate, np.random.default_rng(5), seconds=8.0, **options)
    return t, change(t, load.copy())


def _lose(values, part, to=np.nan):
    values[part] = to
    return values


FAULTS = {
    "saturated": (lambda t, F: np.minimum(F, 520.0), "is saturated"),
    "peaks of teeth saturated": (
        lambda t, F: np.minimum(F * (1 + 0.5 * np.sin(2 * np.pi * 231.7 * t)), 600.0),
        "is saturated: ",
    ),
    "wholly saturated": (lambda t, F: np.minimum(F, 300.0), "saturated"),
    "signal lost": (lambda t, F: _lose(F, (t > 5) & (t < 7), 431.7), "signal lost?"),
    "gap": (lambda t, F: _lose(F, (t > 5) & (t < 6)), "without a value"),
    "drift": (lambda t, F: F + 80 * t / t[-1], "the zero drifts"),
    "mains": (lambda t, F: F + 60 * np.sin(2 * np.pi * 60 * t), "ripple of 60 Hz"),
    "no air before": (lambda t, F: _lose(F, t < 3.5), "no air before"),
    "tool breaks": (lambda t, F: np.where((t > 6) & (t < 11), 1.6 * F, F), "changes from"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_remarked(lab, name):
    change, words = FAULTS[name]
    t, load = faulty(change)
    keep = np.arange(len(t)) >= (np.flatnonzero(np.isfinite(load))[0] if name == "no air before" else 0)
    simulated.write_table(lab.folder / "E1.csv", t[keep], {"Fc [N]": load[keep]})
    path = lab.folder / "E1.csv"
    path.write_text(path.read_text().replace("nan", ""))
    lab.rows(1)
    runs = lab.run("--value", "n=600")
    assert words in runs.data["remarks"].iloc[0]
    (doubt,) = [
        doubt for doubt in runs.doubts if "the reduction of the records has remarks on 1 of 1 rows" in str(doubt)
    ]
    assert words in doubt.sentence
    assert doubt.columns == ("Fc",)


def test_teeth_in_equal_steps_of_a_converter_are_not_saturated():
    """The outermost step of a sine holds 2.4 times the samples of the next, of which runs are short at this rate."""
    t = np.arange(0, 10, 0.001)
    teeth = 1700 * (1 + 0.5 * np.sin(2 * np.pi * 231.7 * t))
    for step in (0.488, 5.0, 40.0):
        coarse = np.round(teeth / step) * step
        assert _piled_up(coarse, coarse.max()) == _piled_up(coarse, coarse.min()) == 0
    assert _piled_up(np.minimum(teeth, 2000.0), 2000.0) == np.count_nonzero(teeth >= 2000)


def test_a_sound_record_gets_no_remark(lab):
    lab.rows()
    lab.record(rate=1000)
    assert "remarks" not in lab.run("--value", "n=600").data


def test_a_reversed_sign_is_set_right_and_said(lab):
    lab.rows()
    lab.record(sign=-1)
    assert lab.run().values("Fc") == pytest.approx(MEANS, rel=WITHIN)
    assert "Fc is negative in every cut: its sign is reversed" in lab.out.read_text()


@pytest.mark.parametrize(
    ("means", "rows", "words"),
    [(MEANS, 4, "E1.csv: 3 cuts, 4 rows"), (MEANS, 2, "E1.csv: 3 cuts, 2 rows"), ([1e-9, 1e-9], 2, "no cut")],
)
def test_cuts_that_do_not_match_the_plan_are_refused(lab, capsys, means, rows, words):
    lab.rows(rows)
    if means is MEANS:
        lab.record()
    else:
        t = 0.005 * np.arange(4000)
        simulated.write_table(lab.folder / "E1.csv", t, {"Fc [N]": np.random.default_rng(1).standard_normal(t.size)})
    lab.run(code=3)
    assert words in capsys.readouterr().err
    assert not lab.out.exists()
    assert (lab.kept / "E1.csv.png").is_file()


def test_a_record_all_in_the_cut_is_refused(lab, capsys):
    t, load, *_ = simulated.cut_signal([500.0], 1000, np.random.default_rng(1), seconds=8.0)
    inside = (t > 4) & (t < 10)
    simulated.write_table(lab.folder / "E1.csv", t[inside], {"Fc [N]": load[inside]})
    lab.rows(1)
    lab.run(code=3)
    assert "contains no cut" in capsys.readouterr().err


def test_an_offset_of_the_amplifier_is_removed_and_said(lab):
    t, load, *_ = simulated.cut_signal(MEANS, 200, np.random.default_rng(1), seconds=5.0)
    simulated.write_table(lab.folder / "E1.csv", t, {"Fc [N]": load - 3000})
    lab.rows()
    runs = lab.run()
    assert runs.values("Fc") == pytest.approx(MEANS, rel=WITHIN)
    assert "offset of the amplifier" in runs.data["remarks"].iloc[0]


def test_a_dead_channel_is_left_out_of_its_row(lab):
    t, load, *_ = simulated.cut_signal(MEANS, 200, np.random.default_rng(1), seconds=5.0)
    simulated.write_table(lab.folder / "E1.csv", t, {"Fc [N]": load, "Fz [N]": np.where(t > 20, 0.0, 0.5 * load)})
    lab.rows()
    runs = lab.run()
    assert np.isnan(runs.values("Fz")).tolist() == [False, False, True]
    assert "signal lost, left out" in runs.data["remarks"].iloc[2]


def test_short_touches_are_no_cuts_and_said(lab, capsys):
    t, load, *_ = simulated.cut_signal(MEANS, 200, np.random.default_rng(1), seconds=5.0)
    load[(t > 1) & (t < 1.4)] += 400
    simulated.write_table(lab.folder / "E1.csv", t, {"Fc [N]": load})
    lab.rows()
    lab.run()
    assert "shorter than 1 s and left out" in capsys.readouterr().out


# Joining


def test_by_edge_in_the_name_and_in_natural_order(lab):
    lab.rows(2, edges=("E2", "E10"))
    for edge, base in (("E2", 300.0), ("E10", 700.0)):
        for k in (1, 2):
            lab.record(f"{edge.replace('E', 'E0')}_{k}.csv", means=[base + 50 * k], seed=k)
    runs = lab.run()
    assert runs.values("Fc") == pytest.approx([350, 400, 750, 800], rel=WITHIN)
    assert runs.data["record"].tolist() == ["E02_1.csv", "E02_2.csv", "E010_1.csv", "E010_2.csv"]


def test_by_a_column_of_the_plan(lab, capsys):
    lab.rows(2, record=["b.csv", "a"])
    lab.record("a.csv", means=[300.0])
    lab.record("b.csv", means=[400.0])
    assert lab.run().values("Fc") == pytest.approx([400, 300], rel=WITHIN)
    lab.record("c.csv", means=[400.0])
    lab.run("--force", code=3)
    assert "c.csv" in capsys.readouterr().err


def test_by_order(lab, capsys):
    lab.rows(3)
    lab.record("run2.csv", means=[400.0, 500.0])
    lab.record("run1.csv", means=[300.0])
    assert lab.run().values("Fc") == pytest.approx([300, 400, 500], rel=WITHIN)
    assert "by order" in capsys.readouterr().out
    lab.rows(4)
    lab.run("--force", code=3)
    err = capsys.readouterr().err
    assert "3 cuts" in err
    assert "4 rows" in err


def test_by_time_of_day(lab):
    lab.rows(2, start=["12:10:00", "12:00:00"])
    t, load, *_ = simulated.cut_signal([400.0], 50, np.random.default_rng(1), seconds=5.0)
    for name, minute in (("x.csv", 0), ("y.csv", 10)):
        clock = [f"12:{minute + int(s // 60):02d}:{s % 60:06.3f}" for s in t]
        rows = "".join(f"{a},{b + 100 * (minute > 0) * (b > 200):.3f}\n" for a, b in zip(clock, load, strict=True))
        (lab.folder / name).write_text("Uhrzeit,Fc [N]\n" + rows)
    assert lab.run().data["record"].tolist() == ["y.csv", "x.csv"]


def clocked(lab, name, begin, load):
    """A record with a time of day; ``begin`` in s since midnight."""
    t, force, *_ = simulated.cut_signal([load], 50, np.random.default_rng(1), seconds=5.0)
    clock = [f"{int(s // 3600) % 24:02d}:{int(s // 60) % 60:02d}:{s % 60:06.3f}" for s in begin + t]
    rows = "".join(f"{a},{b:.3f}\n" for a, b in zip(clock, force, strict=True))
    (lab.folder / name).write_text("Uhrzeit,Fc [N]\n" + rows)


def test_by_time_of_day_over_midnight(lab):
    lab.rows(2, start=["01.03.2026 23:58:30", "02.03.2026 00:00:30"])
    clocked(lab, "x.csv", 30.0, 500.0)
    clocked(lab, "y.csv", 86310.0, 400.0)
    assert lab.run().data["record"].tolist() == ["y.csv", "x.csv"]


@pytest.mark.parametrize(("begins", "doubted"), [((86310, 86370, 30), False), ((30, 86370, 86310), True)])
def test_records_that_were_not_recorded_in_the_order_of_their_names_are_doubted(lab, begins, doubted):
    lab.rows(3)
    for name, begin, load in zip("abc", begins, (300.0, 400.0, 500.0), strict=True):
        clocked(lab, f"{name}.csv", begin, load)
    lab.run()
    assert ("not recorded in the order of their names" in lab.out.read_text()) == doubted


def test_time_in_cut_is_summed_by_edge_where_the_plan_has_none(lab):
    pd.DataFrame({"edge": ["E1"] * 3, "V": 120.0}).to_csv(lab.plan, index=False)
    lab.record()
    assert lab.run().values("t") == pytest.approx(np.array([5, 10, 15]) / 60, rel=0.03)


def test_by_the_run_order_of_the_plan(lab, capsys):
    """A plan in standard order with the order of cutting in a column, as `fitmodels plan` writes it."""
    pd.DataFrame({"run": [3, 1, 2], "V": 120.0, "f": 0.2}).to_csv(lab.plan, index=False)
    lab.record("a.csv", means=[300.0, 400.0, 500.0])
    assert lab.run().values("Fc") == pytest.approx([500, 300, 400], rel=WITHIN)
    assert "by order (of column run of the plan)" in capsys.readouterr().out


def test_loads_that_do_not_follow_feed_and_depth_are_named(lab, capsys):
    f = np.array([0.1, 0.2, 0.3, 0.4, 0.15, 0.25, 0.35, 0.45])
    pd.DataFrame({"V": 120.0, "f": f, "d": 2.0}).to_csv(lab.plan, index=False)
    lab.record("a.csv", means=2000 * f, seconds=2.0)
    lab.run()
    assert "does not rise with feed and depth" not in capsys.readouterr().out
    lab.record("a.csv", means=2000 * f[::-1], seconds=2.0)
    lab.run("--force")
    assert "does not rise with feed and depth" in capsys.readouterr().out
    assert "does not rise with feed and depth" in lab.out.read_text()


def test_a_cut_that_is_shorter_than_its_time_is_remarked(lab):
    pd.DataFrame({"edge": "E1", "V": 120.0, "t": np.array([1, 2, 3, 4, 8]) * 5 / 60}).to_csv(lab.plan, index=False)
    lab.record(means=[500.0] * 5)
    remarks = lab.run().data["remarks"].tolist()
    assert [("the cut lasts" in text) for text in remarks] == [False] * 4 + [True]


def test_active_phases_of_a_real_servo_current(lab, measurements):
    """A square wave of 1 Hz for 10 s: 20 moves, each with a starting and a braking peak of eight times its current.

    After the ninth move the axis does not come to rest at once: its braking peak lies within the load, and is remarked.
    """
    source = measurements / "servo_sweep" / "LinA__no-pp-square-wave-10mm-1Hz.txt"
    (lab.folder / "square.txt").write_bytes(source.read_bytes())
    pd.DataFrame({"V": np.arange(1.0, 21.0)}).to_csv(lab.plan, index=False)
    columns = ["--map", "I=col6", "--unit", "I=mA", "--map", "time=col1", "--unit", "time=ms"]
    lab.run(*columns, "--shortest", "0.1")
    rows = pd.read_csv(lab.out, comment="#")
    assert np.sign(rows["I [A]"]).tolist() == [1, -1] * 10
    right = rows["I [A]"].abs().between(0.4, 0.75)
    assert np.flatnonzero(~right).tolist() == [8]
    assert "the zero drifts" in rows["remarks"][8]


# Files


def test_an_existing_file_is_kept_and_records_are_not_reduced_twice(lab, capsys):
    lab.rows(2, edges=("E1", "E2"))
    for edge in ("E1", "E2"):
        lab.record(f"{edge}.csv", means=[300.0, 400.0])
    lab.run()
    first = lab.out.read_bytes()
    lab.run(code=2)
    assert "--force" in capsys.readouterr().err
    stamps = {path: path.stat().st_mtime_ns for path in lab.kept.iterdir()}
    lab.run("--force")
    assert "2 files were reduced by an earlier run" in capsys.readouterr().out
    assert lab.out.read_bytes() == first
    assert stamps == {path: path.stat().st_mtime_ns for path in lab.kept.iterdir()}
    store = lab.kept / "E1.csv.json"
    held = store.read_text()
    for changed in (held.replace('"mean": ', '"mean": 1'), held[:200], "[" * 100_000, held.replace('"remarks"', '"x"')):
        store.write_text(changed)  # figures that are not those of the record are not taken
        lab.run("--force")
        assert lab.out.read_bytes() == first
    lab.record("E2.csv", means=[300.0, 450.0])
    assert lab.run("--force").values("Fc")[-1] == pytest.approx(450, rel=WITHIN)


def test_an_interrupted_run_continues(lab, monkeypatch, capsys):
    from fitmodels.datasets.signals import reduction

    lab.rows(1, edges=("E1", "E2"))
    for edge in ("E1", "E2"):
        lab.record(f"{edge}.csv", means=[300.0])
    read = reduction.read_recordings

    def stop(path, how):
        if path.name == "E2.csv":
            raise KeyboardInterrupt
        return read(path, how)

    monkeypatch.setattr(reduction, "read_recordings", stop)
    lab.run(code=130)
    assert "are kept in" in capsys.readouterr().err
    assert not lab.out.exists()
    monkeypatch.setattr(reduction, "read_recordings", read)
    lab.run()
    assert "1 file was reduced by an earlier run" in capsys.readouterr().out


def test_a_force_that_the_plan_has_already_is_refused(lab, capsys):
    lab.rows(**{"Fc [N]": 500.0})
    lab.record()
    lab.run(code=3)
    assert "--map Fc=none" in capsys.readouterr().err


def test_the_main_job_names_this_command(lab, capsys):
    lab.record(means=[300.0])
    path = lab.folder / "E1.csv"
    assert looks_like_record(path).loads == ("Fc",)
    assert main([str(path)]) == 3
    assert "fitmodels reduce FOLDER --plan" in capsys.readouterr().err


def test_options_are_checked():
    with pytest.raises(UsageError, match="no channel"):
        ReduceOptions(channel="Fq")
    with pytest.raises(UsageError, match="--guard"):
        ReduceOptions(guard=0.7)
    with pytest.raises(UsageError, match="n \\(1/min\\)"):
        ReduceOptions(constants={"z": 4})


def test_a_record_of_something_else_is_refused(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("t [s],temperature [degC]\n" + "".join(f"{k / 50},{k % 7}\n" for k in range(100)))
    with pytest.raises(DataError, match="--map Fc=col2"):
        read_recordings(path, ReduceOptions())
