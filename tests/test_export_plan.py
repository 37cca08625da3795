"""Plan and region as running controls: what the exported code commands is what the replay commands.

The laws are those of Alaskari & Oraby, AC-2017 (Kuwait J. Sci., accepted June 2017) and AC-2016 (doi
10.15242/IIE.E1216006). Plain tests interpret the structured text; the consumer tests compile C, component and FMU.
"""

import ctypes
import importlib
import os
import re
import subprocess
import sys
from dataclasses import replace
from math import pi
from pathlib import Path

import numpy as np
import pytest
from fitmodels import parameters
from fitmodels.controllers.exports import ExportJob, exported, rendered, system_of
from fitmodels.controllers.exports.plan_table import _variables as plan_variables
from fitmodels.controllers.exports.plan_table import plan_control
from fitmodels.controllers.exports.region_table import _variables as region_variables
from fitmodels.controllers.exports.region_table import region_control
from fitmodels.controllers.exports.turning_program import TurningRequest
from fitmodels.controllers.loop import replay
from fitmodels.controllers.recursion.controller import TurningRecursion, WearingEdge
from fitmodels.controllers.recursion.laws import response_at_end
from fitmodels.controllers.recursion.plan import PlanOptions
from fitmodels.controllers.region.visible import visible_region
from fitmodels.core.errors import GateError, UsageError
from fitmodels.parameters.published import published

sys.path.insert(0, str(Path(__file__).parent))

from load_control import STRICT
from st_evaluator import FunctionBlock
from test_export_control_run import fmpy, machine, started  # noqa: F401  fixtures

sys.path.remove(str(Path(__file__).parent))

INSTALL = "apt-get install gcc libc6-dev"
T = 0.1  # s
JOB = ExportJob(accept_verdict=True, diameter=(40.0, 80.0), sample_time=T)
FLOAT = ("-DPLAN_TABLE_REAL=float", "-DREGION_CHECK_REAL=float", "-Wdouble-promotion")


class Compiled:
    """A controller in C behind ctypes: `call` takes inputs by name and returns outputs by name."""

    def __init__(self, cc, source, folder, variables, prefix, init, step, *options):
        inputs = [v.name for v in variables if v.causality == "input"]
        self.inputs, self.outputs = ["period", *inputs], [v.name for v in variables if v.causality == "output"]
        casts = ["T_", *("T_" if v.kind == "Real" else "int" for v in variables if v.causality == "input")]
        takes = [
            f"    in.{name} = ({cast})v[{i}];\n" for i, (name, cast) in enumerate(zip(self.inputs, casts, strict=True))
        ]
        gives = [f"    w[{i}] = (double)out.{name};\n" for i, name in enumerate(self.outputs)]
        (folder / "controller.c").write_text(source)
        (folder / "driver.c").write_text(
            f'#include "controller.c"\ntypedef {prefix}Real T_;\nstatic {prefix}State x;\nint start(void);\n'
            "void one(const double *v, double *w);\n"
            f"int start(void) {{ return {init.replace(', x)', ', &x)')}; }}\n"
            f"void one(const double *v, double *w)\n{{\n    {prefix}Input in;\n    {prefix}Output out;\n"
            f"{''.join(takes)}    {step.replace('x, in, out', '&x, &in, &out')};\n{''.join(gives)}}}\n"
        )
        name = folder / f"driver{len(list(folder.glob('*.so')))}.so"
        subprocess.run([cc, "-shared", "-fPIC", "-O1", *options, folder / "driver.c", "-o", name, "-lm"], check=True)
        self.library, self.given = ctypes.CDLL(str(name)), dict.fromkeys(self.inputs, 0.0)
        self.wrong = self.library.start()
        self.out = (ctypes.c_double * len(self.outputs))()

    def call(self, **given):
        self.given.update({name: float(value) for name, value in given.items()})
        self.library.one((ctypes.c_double * len(self.inputs))(*self.given.values()), self.out)
        return dict(zip(self.outputs, self.out, strict=True))


class Block:
    """The structured text behind the same interface."""

    def __init__(self, text, variables):
        self.block, self.variables = FunctionBlock(text), variables
        self.given = {v.name: 0.0 if v.kind == "Real" else False for v in variables if v.causality == "input"}

    def call(self, **given):
        kinds = {v.name: v.kind for v in self.variables}
        for name, value in given.items():
            if name in kinds:
                self.given[name] = float(value) if kinds[name] == "Real" else bool(value)
        self.block.call(**{name.upper(): value for name, value in self.given.items()})
        return {v.name: float(self.block[v.name.upper()]) for v in self.variables if v.causality == "output"}


def plan_in_c(cc, folder, job=JOB, pf=None, *options):
    control = plan_control(pf or published("AC-2017"), job)
    text = rendered(pf or published("AC-2017"), "c", system="recursion", job=job)
    return Compiled(
        cc, text, folder, plan_variables(control), "Plan", "plan_table_init(&plan_settings, x)",
        "plan_table_step(&plan_settings, x, in, out)", *options,
    )  # fmt: skip


def plan_in_st(job=JOB, pf=None):
    pf = pf or published("AC-2017")
    return Block(rendered(pf, "st", system="recursion", job=job), plan_variables(plan_control(pf, job)))


def begun(code, **more):
    """The first outputs of a new edge."""
    code.call(period=T, diameter=60.0, **more)
    return code.call(new_edge=1)


def life_through(code, controller, gauge=False):
    """Pairs at the end of each interval, and the minutes until worn, of an edge cut by the exported code."""
    edge, noise = WearingEdge(controller.laws, controller.rules), np.random.default_rng(1)
    out, pairs = begun(code), []
    code.call(new_edge=0)
    step = round(60 * controller.rules.interval / T)
    for k in range(100 * step):
        if k % step == 0:
            pairs.append((out["cutting_speed"], out["feed"]))
        wear = edge.step((out["cutting_speed"], out["feed"]), T, noise)
        out = code.call(cutting=1, wear=wear if gauge else 0.0)
        if out["worn"]:
            return np.array(pairs), (k + 1) * T / 60, edge
    raise AssertionError("the edge never wears out")


def replayed(controller):
    dt = 60 * controller.rules.interval
    edge = WearingEdge(controller.laws, controller.rules)
    trace = replay(controller, edge, duration=1e5, dt=dt, until="worn out")
    return trace.command[:-1], trace.first("worn out") / 60, edge


@pytest.mark.parametrize(
    ("interval", "wear_state", "gauge"), [(1.0, False, False), (1.0, False, True), (2.0, True, True)]
)
def test_the_structured_text_cuts_the_edge_of_the_replay(interval, wear_state, gauge):
    job = replace(JOB, turning=TurningRequest(PlanOptions(interval=interval, wear_state=wear_state)))
    rule = "wear_state" if wear_state else "clock"
    controller = TurningRecursion.from_parameters(published("AC-2017"), interval=interval, wear=rule)
    pairs, minutes, edge = life_through(plan_in_st(job), controller, gauge)
    expected, life, other = replayed(controller)
    assert np.abs(pairs - expected).max() < 1e-9
    assert minutes == pytest.approx(life, abs=1e-9)
    assert edge.removed == pytest.approx(other.removed, rel=1e-9)


@pytest.mark.consumer
@pytest.mark.parametrize(("interval", "wear_state"), [(1.0, False), (2.0, True), (0.5, False)])
def test_the_c_cuts_the_edge_of_the_replay(consumer, tmp_path, interval, wear_state):
    cc, rule = consumer("cc", INSTALL), "wear_state" if wear_state else "clock"
    job = replace(JOB, turning=TurningRequest(PlanOptions(interval=interval, wear_state=wear_state)))
    controller = TurningRecursion.from_parameters(published("AC-2017"), interval=interval, wear=rule)
    expected, life, other = replayed(controller)
    for options, near in ((("-std=c90", *STRICT), 1e-12), (("-std=c99", *STRICT, *FLOAT), 1e-5)):
        for gauge in (False, True):
            pairs, minutes, edge = life_through(plan_in_c(cc, tmp_path, job, None, *options), controller, gauge)
            assert np.abs(pairs / expected - 1).max() < near
            assert minutes == pytest.approx(life, abs=1e-9)
            assert edge.removed == pytest.approx(other.removed, rel=max(near, 1e-9))


def codes(consumer, tmp_path):
    return plan_in_c(consumer("cc", INSTALL), tmp_path), plan_in_st()


def sequence(seed, samples=6000):
    """Inputs of a machine with edges, restarts of the time, resets, jumps of the diameter, wrong and measured wear."""
    rng, out = np.random.default_rng(seed), []
    diameter = 60.0
    while len(out) < samples:
        kind, n = int(rng.integers(0, 12)), int(rng.integers(5, 200))
        for k in range(n):
            cutting = kind > 2
            diameter = min(max(diameter + rng.normal(0, 0.02 if cutting else 5.0), 41.0), 79.0)
            row = {"period": T, "cutting": cutting, "diameter": diameter, "wear": 0.0, "elapsed": 0.0,
                   "new_edge": kind == 0 and k == 3, "set_elapsed": kind in (1, 5) and k == 3,
                   "reset": k == 1}  # fmt: skip
            if kind == 1:
                row["elapsed"] = float(rng.choice([2.5, 7.0, 13.9, -1.0, np.nan]))
            if kind == 3 and k == n // 2:
                row["diameter"] = float(rng.choice([2.36, np.nan, 78.0, -5.0]))
            if kind == 4 and k > n // 2:
                row["wear"] = float(rng.choice([0.05, 0.16, 0.2, 0.25, 0.299, 0.31, 5.0, np.nan]))
            if kind == 6 and k == n // 2:
                row["new_edge"] = True
            out.append(row)
    return out


@pytest.mark.consumer
@pytest.mark.parametrize("seed", range(4))
def test_c_and_structured_text_agree_on_every_input(consumer, tmp_path, seed):
    c, st = codes(consumer, tmp_path)
    reached = []
    for row in sequence(seed):
        one, other = c.call(**row), st.call(**row)
        reached.append([one["cause"], one["worn"], one["row"]])
        assert one == pytest.approx(other, rel=1e-9, abs=1e-9), row
    causes, worn, rows = map(set, zip(*reached, strict=True))
    assert {0.0, 1.0, 3.0, 5.0} <= causes
    assert {0.0, 1.0} == worn
    assert len(rows) > 1


def test_power_on_holds_the_slowest_row_until_the_time_is_set():
    st = plan_in_st()
    out = st.call(diameter=60.0, cutting=True)
    slowest = (200.0, 0.205)
    assert (out["cutting_speed"], out["feed"], out["fault"], out["cause"]) == (pytest.approx(200.0), 0.205, 1, 1)
    for k in range(620):  # an interval of the plan in the cut, then the feed stops; no reset renews it
        out = st.call(reset=k % 2 == 0)
        assert (round(out["cutting_speed"], 9), out["feed"]) == slowest
        assert (out["cause"], out["elapsed_min"]) == (1, -1)
        assert out["feed_inhibit"] == (k > 599) or abs(k - 599) <= 1
    out = st.call(cutting=False, reset=True)
    assert out["feed_inhibit"] == 1
    out = st.call(set_elapsed=True, elapsed=5.0)
    assert (out["row"], out["fault"], out["feed_inhibit"]) == (7, 0, 0)
    assert out["elapsed_min"] == pytest.approx(5.0 + 621 * T / 60)  # with what was cut since power on
    st.call(set_elapsed=False)
    assert st.call(set_elapsed=True, elapsed=1.0)["elapsed_min"] == out["elapsed_min"]  # a known time is not lowered


def kept_through_a_power_cut(code, cutting):
    """Minutes that firmware keeps which follows the documentation: 13.5 of 14 before the power cut."""
    kept = 13.5
    for k in range(50):
        out = code.call(period=T, diameter=60.0, elapsed=kept, set_elapsed=True, cutting=cutting and k < 45)
        kept = out["elapsed_min"] if out["elapsed_min"] >= 0 else kept
    return kept, out


@pytest.mark.parametrize("cutting", [False, True])
def test_minutes_kept_outlast_a_power_cut_in_the_cut(cutting):
    kept, out = kept_through_a_power_cut(plan_in_st(), cutting)
    assert kept == pytest.approx(13.5 + 45 * T / 60 * cutting)
    assert (out["fault"], out["row"]) == (0, 14)


@pytest.mark.consumer
def test_the_c_keeps_the_minutes_of_a_power_cut_in_the_cut(consumer, tmp_path):
    kept, out = kept_through_a_power_cut(plan_in_c(consumer("cc", INSTALL), tmp_path), True)
    assert kept == pytest.approx(13.5 + 45 * T / 60)
    assert (out["fault"], out["row"]) == (0, 14)


def test_minutes_kept_while_not_known_are_refused():
    st = plan_in_st()
    for _ in range(20):
        out = st.call(diameter=60.0, cutting=True)
    st.call(cutting=False)
    out = st.call(set_elapsed=True, elapsed=out["elapsed_min"])
    assert (out["fault"], out["elapsed_min"], out["cutting_speed"]) == (1, -1, pytest.approx(200.0))


def test_time_and_worn_stay_through_a_reset_and_only_a_new_edge_clears_them():
    st = plan_in_st()
    begun(st)
    st.call(new_edge=False, set_elapsed=True, elapsed=13.99)
    for _ in range(10):
        out = st.call(cutting=True)
    assert out["worn"] == 1
    for k in range(610):
        out = st.call(reset=k % 2 == 0)
    assert (out["worn"], out["feed_inhibit"], out["row"]) == (1, 1, 14)
    assert out["elapsed_min"] > 14
    out = st.call(cutting=False, new_edge=True)
    assert (out["worn"], out["feed_inhibit"], out["row"], out["elapsed_min"]) == (0, 0, 1, 0)


def test_a_new_edge_set_in_the_cut_is_a_fault_and_keeps_the_time():
    st = plan_in_st()
    begun(st)
    st.call(new_edge=False)
    for _ in range(700):
        st.call(cutting=True)
    out = st.call(new_edge=True)
    assert (out["fault"], out["cause"]) == (1, 5)
    assert out["elapsed_min"] > 1.16


@pytest.mark.parametrize("jump", [60 / 25.4, 79.0, float("nan"), 0.0])
def test_a_diameter_that_jumps_is_a_latched_fault_at_the_lowest_speed(jump):
    st = plan_in_st()
    begun(st)
    st.call(new_edge=False)
    before = st.call(cutting=True)
    assert before["spindle_speed"] == pytest.approx(1000 * 150 / (pi * 60))
    for _ in range(3):
        out = st.call(diameter=jump)
    assert (out["fault"], out["cause"]) == (1, 3)
    assert out["spindle_speed"] == pytest.approx(1000 * 200 / (pi * 80))
    out = st.call(diameter=60.0)
    assert out["fault"] == 1
    st.call(reset=True)
    assert st.call(reset=False)["fault"] == 0


@pytest.mark.parametrize("wear", [float("nan"), -0.2, 1e-9, 0.02, 0.24 / 25.4, float("inf")])
def test_a_wear_gauge_that_is_lost_is_a_latched_fault(wear):
    st = plan_in_st()
    begun(st)
    st.call(new_edge=False, set_elapsed=True, elapsed=8.0)
    before = st.call(cutting=True)
    assert (before["fault"], before["row"]) == (0, 9)
    out = st.call(wear=wear)
    assert (out["fault"], out["cause"], out["row"]) == (1, 4, 14)
    assert st.call(wear=0.24)["fault"] == 1
    st.call(wear=0.0, reset=True)
    assert st.call(reset=False)["fault"] == 0
    assert st.call()["elapsed_min"] == pytest.approx(8 + 6 * T / 60)


def test_a_gauge_that_is_lost_is_unknown_to_the_controller_and_a_fault_of_the_plan():
    """A share of the prediction is valid in both, or in none; an edge in its first interval is not judged."""
    for share in (1.0, 0.9, 0.61, 0.59, 0.1):
        controller, st = TurningRecursion.from_parameters(published("AC-2017")), plan_in_st()
        V, f = controller.step(0.0, 60.0)
        wear = share * float(controller.laws.wear(V, f, 1.0))
        controller.step(wear, 60.0)
        begun(st)
        st.call(new_edge=False)
        assert st.call(cutting=True, wear=0.01)["fault"] == 0
        st.call(wear=0.0)
        for _ in range(598):
            st.call()
        assert st.call(wear=wear)["fault"] == ("wear unknown" in controller.news)


@pytest.mark.parametrize("jump", [60 / 25.4, 79.0, float("nan")])
def test_in_a_fault_of_the_diameter_power_and_force_are_kept_at_every_diameter(jump):
    job = replace(JOB, diameter=(50.0, 80.0))
    plan, st = plan_control(published("AC-2017"), job).plan, plan_in_st(job)
    begun(st)
    st.call(new_edge=False, cutting=True)
    out = st.call(diameter=jump)
    assert (out["fault"], out["cause"], out["feed_inhibit"]) == (1, 3, 0)
    assert 0.06 < out["feed"] < 0.08  # 0.205 mm/rev at 50 mm would exceed the force by 25 %
    last, force = plan.rows[-1], []
    for diameter in (50.0, 65.0, 80.0):
        V = pi * diameter * out["spindle_speed"] / 1000
        for _, terms in plan.laws.limited:
            found = float(response_at_end(terms, plan.life.rules, V, out["feed"], last.end, last.wear))
            assert found <= terms.most * (1 + 1e-9)
            force.append(found / terms.most)
    assert max(force) == pytest.approx(1.0)  # and no slower than that
    st.call(diameter=60.0)
    st.call(reset=True)
    assert st.call(reset=False)["feed"] == 0.58


def test_the_feed_stops_in_a_fault_of_the_diameter_where_no_feed_keeps_the_force():
    job = replace(JOB, diameter=(10.0, 80.0))
    made, st = exported(published("AC-2017"), "c", system="recursion", job=job), plan_in_st(job)
    assert any("where no tested feed keeps the limits: the feed stops" in words for words in made.notes)
    begun(st)
    assert st.call(new_edge=False, cutting=True)["feed_inhibit"] == 0
    out = st.call(diameter=float("nan"))
    assert (out["cause"], out["feed_inhibit"], out["feed"], out["feed_override"], out["feed_rate"]) == (3, 1, 0, 0, 0)


def test_a_diameter_that_jumps_while_another_fault_is_latched_is_not_used():
    st = plan_in_st()
    begun(st)
    st.call(new_edge=False, wear=10.0)
    st.call(wear=0.0)
    for _ in range(3):
        out = st.call(diameter=41.0, cutting=True)
    assert out["cause"] == 4
    assert out["spindle_speed"] == pytest.approx(1000 * 200 / (pi * 80))
    st.call(reset=True)
    assert st.call(reset=False)["fault"] == 0


def test_measured_wear_is_compared_with_the_wear_of_this_moment():
    st = plan_in_st()
    begun(st)
    st.call(new_edge=False)
    for _ in range(300):  # half of the first minute
        out = st.call(cutting=True)
    law = TurningRecursion.from_parameters(published("AC-2017")).laws.wear
    assert out["wear_expected"] == pytest.approx(float(law(150.0, 0.58, (300 - 1) * T / 60 + T / 60)), rel=1e-3)
    assert st.call(wear=1.03 * out["wear_expected"])["elapsed_min"] == pytest.approx(301 * T / 60)
    later = st.call(wear=0.15)  # below the wear at the end of the row, but more than now
    assert later["elapsed_min"] == pytest.approx((0.15 / float(law(150.0, 0.58, 1.0))) ** (1 / law.t))
    assert st.call(wear=0.21)["row"] == 4
    assert st.call(wear=0.31)["worn"] == 1
    assert st.call(wear=0.12)["cause"] == 4  # an edge does not heal


def test_without_a_limit_of_the_spindle_its_cap_is_stated_and_held():
    made = exported(published("AC-2017"), "c", system="recursion", job=JOB)
    (line,) = [words for words in made.notes if "spindle speed at most" in words]
    assert "1591.55 1/min" in line
    assert "assumed" in line
    assert "1591.55 1/min" in made.content
    with pytest.raises(GateError, match="a larger smallest diameter"):
        rendered(published("AC-2017"), "c", system="recursion", job=replace(JOB, max_rpm=600.0, diameter=(20.0, 80.0)))
    with pytest.raises(UsageError, match="the diameter of the work is not known"):
        rendered(published("AC-2017"), "c", system="recursion", job=ExportJob(accept_verdict=True))


def test_the_feed_rate_waits_for_a_rising_spindle_and_falls_at_once():
    st = plan_in_st(replace(JOB, diameter=(10.0, 80.0)))
    begun(st)
    st.call(new_edge=False)
    for _ in range(100):
        out = st.call(diameter=60.0, cutting=True)
    assert out["feed_rate"] == pytest.approx(out["feed"] * out["spindle_speed"])
    rising = [st.call(diameter=60.0 - 0.3 * k) for k in range(1, 100)]
    assert all(one["feed_rate"] <= one["feed"] * one["spindle_speed"] * (1 + 1e-12) for one in rising)


def test_the_command_takes_diameter_period_and_settings_of_the_plan(tmp_path, monkeypatch, capsys):
    from fitmodels import parameters
    from fitmodels.cli import main

    monkeypatch.chdir(tmp_path)
    parameters.write(published("AC-2017"), "params.json")
    asked = ["export", "params.json", "--to", "c"]
    assert main([*asked, "--system", "recursion", "--diameter", "40mm:80mm", "--max-rpm", "2500", "--period", "10ms",
                 "--depth", "2mm", "--interval", "2min"]) == 0  # fmt: skip
    text = Path("params.c").read_text()
    assert "7 rows to 14 min" in text
    assert "spindle speed at most 2500 1/min" in text
    assert "(PlanReal)0.01, /* sample_time */" in text
    assert main([*asked, "--system", "region", "--out", "region.c"]) == 0
    capsys.readouterr()
    for more, words in (
        ([], "supports recursion and region; choose one with --system"),
        (["--system", "recursion"], "--diameter 40mm:80mm"),
        (["--system", "recursion", "--diameter", "40:60:80"], "give one, 60mm"),
        (["--system", "recursion", "--diameter", "80:40"], "the smaller first"),
        (["--system", "recursion", "--diameter", "60", "--period", "5s"], "at most 1 s"),
        (["--system", "recursion", "--diameter", "60", "--tool", "3"], "belongs to --to nc"),
        (["--system", "region", "--depth", "2mm"], "leave it out"),
        (["--system", "constant-load", "--diameter", "60mm"], "and constant-load is exported: name one of them"),
        (["--system", "constant-load", "--tool", "3"], "--tool belongs to --to nc and --to csv; leave it out of c"),
    ):
        assert main([*asked, *more, "--force"]) != 0
        assert words in " ".join(capsys.readouterr().err.split()), more
    parameters.write(published("CLM-2023"), "gains.json")
    assert main(["export", "gains.json", "--to", "c", "--diameter", "60mm"]) != 0
    assert "--diameter belongs to --to nc, --to csv, --system recursion and --system region" in capsys.readouterr().err


def test_the_default_system_is_named_where_several_are_possible():
    assert system_of(published("AC-2017"), "hal") == "constant-load"
    with pytest.raises(UsageError, match="there is no such system"):
        system_of(published("AC-2017"), "c", "recursoin")
    with pytest.raises(UsageError, match="is not exported as hal"):
        system_of(published("AC-2017"), "hal", "recursion")


def region_in_c(cc, folder, job=JOB, pf=None, *options):
    pf = pf or published("AC-2016")
    text = rendered(pf, "c", system="region", job=job)
    return Compiled(
        cc, text, folder, region_variables(region_control(pf, job)), "Region",
        "region_check_init(&region_settings, x)", "region_check_step(&region_settings, x, in, out)", *options,
    )  # fmt: skip


def region_in_st(job=JOB, pf=None):
    pf = pf or published("AC-2016")
    return Block(rendered(pf, "st", system="region", job=job), region_variables(region_control(pf, job)))


def limited_spindle(pf):
    """The file with limits of spindle speed, feed rate and wear too."""
    limits = pf.limits.model_dump() | {
        "spindle_speed": {"low": 30.0, "high": 900.0, "unit": "1/min"},
        "feed_rate": {"low": 0.0, "high": 250.0, "unit": "mm/min"},
        "wear": {"value": 0.3, "unit": "mm"},
    }
    return pf.model_copy(update={"limits": type(pf.limits).model_validate(limits), "content_sha256": None})


def settings(n):
    V, f = np.meshgrid(np.linspace(40.0, 250.0, n), np.linspace(0.05, 0.7, n))
    return np.column_stack([V.ravel(), f.ravel()])


def assert_is_the_region(code, pf, n, near, at=None):
    """n x n settings at three times, against the limits of the replay's region."""
    pairs = settings(n)
    for t in (2.0, 7.5, 15.0):
        region = visible_region(pf, d=2.2, t=t, at=at)
        x = np.log(pairs)
        over = np.stack([each.beyond(x) for each in region.limits])
        code.call(period=T, V=100.0, f=0.1, d=2.2, t=t, diameter=60.0)
        found = [code.call(V=V, f=f) for V, f in pairs.tolist()]
        assert np.abs(np.array([one["excess"] for one in found]) - over.max(axis=0)).max() < near
        apart = np.sort(over, axis=0)
        clear = (apart[-1] - apart[-2] > 10 * near) & (np.abs(apart[-1]) > 10 * near)
        binding = np.array([one["binding"] for one in found])
        assert (binding == over.argmax(axis=0) + 1)[clear].all()
        within = np.array([one["within"] for one in found]) > 0
        assert (within == region.contains(*pairs.T))[clear].all()
        for name, column in (("feed_override", 1), ("speed_override", 0)):
            factor = np.array([one[name] for one in found])
            moved = x.copy()
            moved[:, column] += np.log(np.where(factor > 0, factor, 1.0))
            kept = np.stack([each.beyond(moved) for each in region.limits]).max(axis=0)
            assert (kept[factor > 0] < 10 * near).all()
            lowered = (factor > 0) & (factor < 1 - 10 * near)
            assert np.abs(kept[lowered]).max() < 10 * near  # not lowered further than to the limit
            assert (over.max(axis=0)[factor == 1] < 10 * near).all()
        assert {0.0, 1.0} <= {one["feed_override"] for one in found}


def test_the_structured_text_is_the_region_of_the_replay():
    assert_is_the_region(region_in_st(), published("AC-2016"), 20, 1e-9)
    pf = limited_spindle(published("AC-2016"))
    assert_is_the_region(region_in_st(pf=pf), pf, 12, 1e-9, {"D": 60.0})


@pytest.mark.consumer
def test_the_c_is_the_region_of_the_replay_at_22500_settings_and_three_times(consumer, tmp_path):
    cc, pf = consumer("cc", INSTALL), limited_spindle(published("AC-2016"))
    assert_is_the_region(region_in_c(cc, tmp_path, JOB, pf, "-std=c90", *STRICT), pf, 150, 1e-9, {"D": 60.0})
    single = region_in_c(cc, tmp_path, JOB, None, "-std=c99", *STRICT, *FLOAT)
    assert_is_the_region(single, published("AC-2016"), 150, 3e-6)


@pytest.mark.consumer
def test_c_and_structured_text_of_the_region_agree_under_faults(consumer, tmp_path):
    pf, rng = limited_spindle(published("AC-2016")), np.random.default_rng(3)
    c, st = region_in_c(consumer("cc", INSTALL), tmp_path, JOB, pf), region_in_st(pf=pf)
    odd, causes, t = [np.nan, np.inf, 0.0, -1.0, 1e12, 2.36], set(), 0.0
    for _ in range(3000):
        t = t + rng.uniform(0, 0.5) if t < 25 and rng.random() < 0.9 else rng.uniform(0, 10)
        row = {"period": T, "V": rng.uniform(40, 250), "f": rng.uniform(0.05, 0.7), "d": rng.uniform(1, 4),
               "t": t, "wear": rng.choice([0.0, 0.1, 0.2, 0.29]), "diameter": rng.uniform(50, 70),
               "reset": rng.random() < 0.3}  # fmt: skip
        if rng.random() < 0.1:
            row[str(rng.choice(["V", "f", "d", "t", "wear", "diameter"]))] = float(rng.choice(odd))
        one, other = c.call(**row), st.call(**row)
        causes.add(one["cause"])
        assert one == pytest.approx(other, rel=1e-9, abs=1e-9), row
    assert causes == {0.0, 1.0, 2.0, 3.0, 4.0, 5.0}


def test_an_input_that_is_not_connected_makes_nothing_faster():
    plan, region = (rendered(SYSTEMS[system][0], "comp", system=system, job=JOB) for system in SYSTEMS)
    assert "pin in bit cutting = 1 " in plan
    assert "pin in float diameter = 0.0 " in plan
    assert "pin in float t = -1.0 " in region
    assert "pin in float d = 0.0 " in region
    code = region_in_st()
    assert code.call(V=120.0, f=0.3, d=2.0, t=-1.0)["cause"] == 2


def test_what_is_not_known_counts_as_the_worse_end_and_is_latched():
    st = region_in_st()
    row = {"V": 120.0, "f": 0.3, "d": 2.0, "t": 5.0}
    known = st.call(**row)
    assert known["fault"] == 0
    worst = max(st.call(**{**row, "d": 3.0, "t": t})["excess"] for t in (2.0, 15.0))
    assert st.call(**{**row, "t": float("nan")})["excess"] == pytest.approx(worst)
    latched = st.call(**row)
    assert (latched["cause"], latched["excess"]) == (2, pytest.approx(worst))
    st.call(reset=True)
    assert st.call(reset=False)["excess"] == pytest.approx(known["excess"])
    early, first = st.call(**{**row, "t": 0.0}), st.call(**{**row, "t": 2.0})
    assert early["excess"] >= first["excess"]
    assert (early["tested"], st.call(**{**row, "t": 20.0})["tested"], st.call(**{**row, "d": 4.0})["tested"]) == (
        1,
        0,
        0,
    )


def test_the_head_of_a_region_states_what_its_output_tested_does_not_check():
    for target in ("c", "st"):
        text = " ".join(rendered(published("AC-2016"), target, system="region", job=JOB).replace(" * ", " ").split())
        assert "tested is of each factor by itself: it does not check whether their combination or the wear" in text


def test_laws_without_time_need_none():
    pf = published("AC-2016")
    laws = {"Fz": pf.laws["AW"].model_copy(update={
        "response": "Fz", "unit": "N", "equation": "",
        "factors": tuple(f for f in pf.laws["AW"].factors if f.symbol != "t"),
        "coefficients": {k: v for k, v in pf.laws["AW"].coefficients.items() if k != "t"},
    })}  # fmt: skip
    limits = {"speed": {"low": 50.0, "high": 200.0, "unit": "m/min"},
              "feed": {"low": 0.06, "high": 0.6, "unit": "mm/rev"},
              "responses": {"Fz": {"high": 0.15, "unit": "N"}}}  # fmt: skip
    pf = pf.model_copy(update={"laws": laws, "limits": type(pf.limits).model_validate(limits), "content_sha256": None})
    st = region_in_st(pf=pf)
    out = st.call(V=150.0, f=0.3, d=2.0, t=0.0)
    assert (out["fault"], out["tested"]) == (0, 1)
    assert_is_the_region(region_in_st(pf=pf), pf, 10, 1e-9)


def test_measured_wear_above_its_law_counts():
    st, pf = region_in_st(), published("AC-2016")
    code = st.call(V=150.0, f=0.55, d=2.5, t=10.0, wear=0.29)
    over = visible_region(pf, d=2.5, t=10.0, at={"AW": 0.29})
    assert code["excess"] == pytest.approx(max(float(e.beyond(np.log([150.0, 0.55]))) for e in over.limits))


WORN_PAIR = {"V": 150.0, "f": 0.55, "d": 2.5}


@pytest.mark.parametrize("t", [10.0, 30.0])
@pytest.mark.parametrize("wear", [0.29 / 25.4, 0.001, np.nan, -0.2, 1e-9])
def test_a_wear_gauge_that_reads_low_releases_no_limit_and_is_reported(wear, t):
    by_law = region_in_st().call(**WORN_PAIR, t=t)
    st = region_in_st()
    st.call(**WORN_PAIR, t=t, wear=0.29)
    out = st.call(wear=wear)
    assert (out["fault"], out["cause"]) == (1, 5)
    assert out["excess"] >= by_law["excess"]
    assert out["within"] <= by_law["within"]
    assert out["feed_override"] <= by_law["feed_override"]
    st = region_in_st()  # a fault of another cause, and then the gauge
    st.call(**WORN_PAIR, t=float("nan"))
    fault = st.call(t=t)
    low = st.call(wear=wear)
    assert (fault["cause"], low["cause"]) == (2, 2)
    assert low["excess"] >= fault["excess"] >= by_law["excess"]
    assert low["feed_override"] <= fault["feed_override"]
    st.call(wear=0.0, reset=True)  # the gauge is taken off
    assert st.call(reset=False)["fault"] == 0


def test_no_measured_wear_raises_an_override():
    st, rng = region_in_st(pf=limited_spindle(published("AC-2016"))), np.random.default_rng(5)
    for _ in range(400):
        row = {"V": rng.uniform(40, 250), "f": rng.uniform(0.05, 0.7), "d": rng.uniform(1, 4), "t": rng.uniform(0, 30),
               "diameter": rng.uniform(41, 79)}  # fmt: skip
        st.call(**row, wear=0.0, reset=False)
        by_law = st.call(reset=True)
        assert by_law["fault"] == 0
        measured = st.call(wear=rng.choice([1e-6, 0.0138, 0.1, 0.2, 0.29, 1.0, np.nan]))
        assert measured["excess"] >= by_law["excess"] - 1e-12
        for name in ("feed_override", "speed_override"):
            assert measured[name] <= by_law[name] + 1e-12


@pytest.mark.parametrize("speeds", [(80.0, 190.0), (190.0, 80.0), (150.0, 150.0)])
def test_a_gauge_of_an_edge_whose_speed_changes_is_no_fault(speeds):
    """The edge wears by its law, or a third slower; a new edge begins with the time 0."""
    law = TurningRecursion.from_parameters(published("AC-2017")).laws.wear
    for share in (1.0, 0.67):
        st, wear = region_in_st(pf=published("AC-2017")), 0.0
        for k in range(1201):
            V, t = speeds[k >= 600], k / 60
            wear += share * float(law(V, 0.2)) * (t**law.t - max(t - 1 / 60, 0.0) ** law.t)
            out = st.call(V=V, f=0.2, d=2.5, t=t, wear=wear)
            assert out["fault"] == 0, (share, k)
        assert st.call(t=0.01, wear=0.02)["fault"] == 0


def test_a_limit_of_the_spindle_needs_the_diameter():
    with pytest.raises(UsageError, match="needs the diameter"):
        rendered(limited_spindle(published("AC-2016")), "c", system="region", job=ExportJob(accept_verdict=True))


GARBAGE = [0.0, -0.0, np.nan, np.inf, -np.inf, 1e300, -1e300, 5e-324, 1e9, 60.0, 0.2, 1e-12, 14.0, T]


@pytest.mark.consumer
def test_no_input_takes_the_c_beyond_its_limits(consumer, tmp_path):
    cc, rng = consumer("cc", INSTALL), np.random.default_rng(7)
    sanitize = ("-fsanitize=undefined,float-cast-overflow", "-fno-sanitize-recover=all")
    plan = plan_in_c(cc, tmp_path, JOB, None, *sanitize)
    region = region_in_c(cc, tmp_path, JOB, limited_spindle(published("AC-2016")), *sanitize)
    for code in (plan, region):
        for _ in range(20000):
            row = {name: rng.choice(GARBAGE) for name in ("period", "diameter", "wear")}
            if code is plan:
                row |= {"elapsed": rng.choice(GARBAGE), "cutting": rng.random() < 0.5}
                row |= {name: rng.random() < 0.2 for name in ("new_edge", "set_elapsed", "reset")}
            else:
                row |= {**{name: rng.choice(GARBAGE) for name in "Vfdt"}, "reset": rng.random() < 0.5}
            out = code.call(**row)
            assert 0 <= out["feed_override"] <= 1
            if code is plan:
                assert 0 < out["spindle_speed"] <= 1591.55
                assert 0 < out["cutting_speed"] <= 200.0001
                assert 0 < out["feed"] <= 0.58 or (out["feed"] == 0 and out["feed_inhibit"] and out["fault"])
                assert 0 <= out["feed_rate"] <= 955
                assert np.isfinite(out["elapsed_min"])


SYSTEMS = {
    "recursion": (published("AC-2017"), plan_in_st, plan_variables, plan_control),
    "region": (published("AC-2016"), region_in_st, region_variables, region_control),
}


def inputs_of(system, samples, period):
    """Inputs of a system by name, that a streamer can read."""
    if system == "recursion":
        rows = sequence(5, samples)[:samples]
        return [{**row, "period": period, **{k: np.nan_to_num(row[k]) for k in ("diameter", "wear", "elapsed")}}
                for row in rows]  # fmt: skip
    rng = np.random.default_rng(6)
    return [{"period": period, "V": rng.uniform(40, 250), "f": rng.uniform(0.05, 0.7), "d": rng.uniform(1, 4),
             "t": rng.uniform(-0.2, 30), "wear": rng.choice([0.0, 0.2]), "diameter": 60.0,
             "reset": rng.random() < 0.3} for _ in range(samples)]  # fmt: skip


@pytest.mark.consumer
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.parametrize("system", SYSTEMS)
def test_fmpy_validates_compiles_and_runs_the_fmu(consumer, fmpy, tmp_path, system):  # noqa: F811
    consumer("cmake", "apt-get install cmake gcc g++")
    pf, block, variables_of, control_of = SYSTEMS[system]
    variables = variables_of(control_of(pf, JOB))
    model = started(fmpy, rendered(pf, "fmu", system=system, job=JOB), tmp_path)
    st = block()
    for k, row in enumerate(inputs_of(system, 2000, T)):
        for kind, put in (("Real", model.setReal), ("Boolean", model.setBoolean)):
            given = [v for v in variables if v.causality == "input" and v.kind == kind]
            put([v.reference for v in given], [row[v.name] for v in given])
        model.doStep(k * T, T)
        found = {}
        for kind, get in (("Real", model.getReal), ("Integer", model.getInteger), ("Boolean", model.getBoolean)):
            asked = [v for v in variables if v.causality == "output" and v.kind == kind]
            found |= dict(zip([v.name for v in asked], get([v.reference for v in asked]), strict=True))
        assert found == pytest.approx(st.call(**row), rel=1e-9, abs=1e-9)
    model.terminate()
    model.freeInstance()


@pytest.mark.consumer
@pytest.mark.parametrize("system", SYSTEMS)
def test_linuxcnc_runs_the_component(machine, system):  # noqa: F811
    """Streamer gives the inputs, sampler takes the outputs, each by its pin."""
    pf, block, variables_of, control_of = SYSTEMS[system]
    job, samples = replace(JOB, sample_time=0.001), 2000
    variables, st = variables_of(control_of(pf, job)), block(job)
    inputs = [v for v in variables if v.causality == "input"]
    outputs = [v for v in variables if v.causality == "output"]
    rows = inputs_of(system, samples, 0.001)
    name = "fm-plan" if system == "recursion" else "fm-region"
    letters = {"Real": "f", "Boolean": "b", "Integer": "s"}

    def pins(variables, side):
        lines = (
            f"net x-{side}-{k} {name}.{v.name.replace('_', '-')} {side}.0.pin.{k}" for k, v in enumerate(variables)
        )
        return "\n".join(lines)

    text = "".join(
        " ".join(f"{float(row[v.name])!r}" if v.kind == "Real" else str(int(row[v.name])) for v in inputs) + "\n"
        for row in rows
    )
    (machine.folder / "inputs").write_text(text)
    component = rendered(pf, "comp", system=system, job=job)
    made = machine(
        component,
        f"""\
loadrt threads name1=t period1=1000000 fp1=1
loadrt streamer depth=4000 cfg={"".join(letters[v.kind] for v in inputs)}
loadrt sampler depth=4000 cfg={"".join(letters[v.kind] for v in outputs)}
loadrt {name.replace("-", "_")}
{pins(inputs, "streamer")}
{pins(outputs, "sampler")}
addf streamer.0 t
addf {name} t
addf sampler.0 t
loadusr -w halstreamer {machine.folder}/inputs
start
loadusr -w halsampler -t -n {samples} {machine.folder}/trace
""",
    )
    assert (machine.folder / "trace").exists(), made.stdout + made.stderr
    found = np.array([line.split()[1:] for line in (machine.folder / "trace").read_text().splitlines()], float)
    expected = np.array([list(st.call(**row).values()) for row in rows])
    assert found.shape == expected.shape, made.stderr
    assert np.abs(found - expected).max() <= 1e-6  # halsampler prints six decimals
    lines = "\n".join(line[4:] for line in component.splitlines() if line.startswith("//| "))
    assert set(re.findall(rf"{name}\.([\w-]+)", lines)) <= {v.name.replace("_", "-") for v in variables}


@pytest.mark.consumer
@pytest.mark.parametrize("system", SYSTEMS)
def test_blark_parses_the_structured_text(system):
    try:
        parse = importlib.import_module("blark.parse")
    except ImportError:
        missing = "blark is not installed: pip install blark"
        pytest.fail(missing) if os.environ.get("FITMODELS_REQUIRE_CONSUMERS") == "1" else pytest.skip(missing)
    text = rendered(SYSTEMS[system][0], "st", system=system, job=JOB)
    assert parse.parse_source_code(text).exception is None


@pytest.mark.parametrize("system", ["recursion", "region"])
def test_a_file_that_was_read_from_disk_is_exported_as_one_of_memory(tmp_path, system):
    pf, job = published("AC-2017"), ExportJob(diameter=(80.0, 80.0))
    read = parameters.read(parameters.write(pf, tmp_path / "params.json"))
    assert exported(read, "c", system=system, job=job).content == exported(pf, "c", system=system, job=job).content
