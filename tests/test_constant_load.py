"""The constant-load controller by itself: what it promises of its command, whatever it is told.

Its arithmetic in position form is LinuxCNC's; test_export_hal.py proves that against LinuxCNC. In the form of eq. 16 of
Tai, Tsai & Li 2023 (doi 10.1109/ACCESS.2023.3330587) it is held against that equation and against the tuner's loop.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from fitmodels import controllers, parameters
from fitmodels.controllers.constant_load_milling.plant import MillingCut
from fitmodels.controllers.faults import FAULTS, FaultyPlant, saturated
from fitmodels.core.errors import GateError, UsageError
from fitmodels.parameters.exports.view import export_view
from fitmodels.parameters.published import published
from hypothesis import given, settings
from hypothesis import strategies as st

B18, A18 = [0.0, 0.0611, -0.1338, 0.0752], [1.0, -2.0311, 1.2104, -0.1655]
GAIN = 1.2416e-4 * 1000 / (sum(B18) / sum(A18))  # A per override, at rest: CLM-2023's three points, 1000 mm/min


@pytest.fixture
def plant(linear_cut):
    return lambda **more: linear_cut(**{"b": [GAIN * b for b in B18], "a": A18, "offset": 0.1158, **more})


@pytest.fixture
def controller(constant_load_file):
    def make(**more):
        return controllers.ConstantLoad.from_parameters(constant_load_file(**more))

    return make


def test_a_file_alone_makes_it_and_a_file_read_back_makes_the_same(constant_load_file, tmp_path):
    pf = constant_load_file()
    again = parameters.read(parameters.write(pf, tmp_path / "params.json"))
    assert controllers.ConstantLoad.from_parameters(again).loop == controllers.ConstantLoad.from_parameters(pf).loop


def test_it_settles_at_the_reference_within_four_seconds(controller, plant):
    trace = controllers.replay(controller(), plant(), duration=20, dt=0.02)
    late = trace.time > 4 + 5  # 5 s: the limiter's ramp from 0
    assert np.abs(trace.measurement[late] - 0.22).max() < 0.01 * 0.22  # CLM-2023: within 1 % of the reference


def test_the_same_seed_gives_the_same_trace(controller, plant):
    traces = [controllers.replay(controller(), plant(noise=0.01), duration=4, dt=0.02, seed=seed) for seed in (1, 1, 2)]
    assert (traces[0].command == traces[1].command).all()
    assert (traces[0].command != traces[2].command).any()


readings = st.lists(st.floats(), min_size=1, max_size=300)  # NaN and infinity too


@settings(deadline=None, max_examples=50)
@given(readings)
def test_whatever_it_reads_the_command_is_finite_bounded_and_slow(loaded, readings):
    c = controllers.ConstantLoad(loaded, command=1.0)
    last = c.command
    for reading in readings:
        command = c.step(reading, loaded.sample_time)
        assert loaded.low <= command <= 1.0
        assert -loaded.back_off * loaded.sample_time - 1e-12 <= command - last
        assert command - last <= loaded.recover * loaded.sample_time + 1e-12
        last = command


@pytest.fixture(scope="module")
def loaded(constant_load_file):
    return controllers.ConstantLoad.from_parameters(constant_load_file()).loop


@pytest.mark.parametrize(
    ("reading", "said"),
    [(math.nan, "load unknown"), (math.inf, "load unknown"), (-5.0, "load unknown"), (50.0, "load unknown"),
     (0.0, "air")],
)  # fmt: skip
def test_a_load_that_is_unknown_or_gone_gives_the_feed_back(loaded, reading, said):
    c, news = controllers.ConstantLoad(loaded, command=1.0), []
    for k in range(600):
        c.step(0.3 if k < 300 else reading, loaded.sample_time)
        news += c.news
        if k == 299:
            assert c.command == pytest.approx(loaded.low)
    assert c.command == 1.0
    assert news[0] == "cut"
    assert said in news


def test_the_sum_does_not_wind_up_at_a_limit(loaded):
    """A long overload is forgotten as fast as a short one."""

    def recovery(overloaded):
        c = controllers.ConstantLoad(loaded, command=1.0)
        commands = [c.step(0.3 if k < overloaded else 0.2, loaded.sample_time) for k in range(overloaded + 200)]
        return commands[overloaded:]

    assert recovery(300) == pytest.approx(recovery(3000), abs=1e-12)


def test_switched_off_it_does_nothing(loaded):
    c = controllers.ConstantLoad(loaded, enabled=False, command=1.0)
    assert {c.step(0.3, loaded.sample_time) for _ in range(300)} == {1.0}


def test_another_period_is_refused(loaded):
    with pytest.raises(UsageError, match=r"made for 0\.02 s"):
        controllers.ConstantLoad(loaded).step(0.2, 0.001)


@pytest.mark.parametrize("average_of", ["measurement", "command"])
def test_a_moving_average_lags_by_half_its_length(constant_load_file, average_of):
    """Impulse response of the average alone, through a loop without integral."""
    loop = controllers.ConstantLoad.from_parameters(constant_load_file()).loop
    plain = replace(loop, filter_time=0.0, ki=0.0, kp=-1e-3, back_off=1e9, recover=1e9, engage_after=0.0)
    traces = []
    for n in (1, 5):
        c = controllers.ConstantLoad(replace(plain, average=n, average_of=average_of), command=1.0)
        traces.append([c.step(0.23 + 0.01 * (k == 50), 0.02) for k in range(100)])
    one, five = (np.array(t)[40:] - t[40] for t in traces)
    assert five == pytest.approx(np.convolve(one, np.full(5, 0.2))[: len(one)], abs=1e-12)


@pytest.mark.parametrize(
    ("form", "integration", "shift"),
    [("position", "backward", 0.0), ("position", "forward", 1.0), ("position", "trapezoidal", 0.5),
     ("incremental", "backward", 0.0)],
)  # fmt: skip
def test_every_form_of_pi_becomes_the_same_controller_in_position_form(constant_load_file, form, integration, shift):
    """Against the tuner's own transfer function: (b0 + b1 z^-1) / (1 - z^-1), b0 = kp + ki T of the backward rule."""
    from fitmodels.ident.pi.gains import PiGains

    pf = constant_load_file(pi={"form": form, "integration": integration, "filter_time": 0.0})
    loop = controllers.ConstantLoad.from_parameters(pf).loop
    num, den = PiGains(pf.pi.kp, pf.pi.ki, 0.02, form=form, integration=integration).transfer_function
    T = loop.sample_time
    assert num == pytest.approx(np.array([loop.kp + loop.ki * T, -loop.kp]))
    assert den == pytest.approx(np.array([1.0, -1.0]))
    assert loop.kp == pytest.approx(pf.pi.kp - shift * pf.pi.ki * T)


def test_the_incremental_sum_of_eq_16_without_its_ki_is_an_integral(constant_load_file):
    pf = constant_load_file(pi={"form": "incremental_sum", "kp": 160.0, "ki": 0.0})
    loop = controllers.ConstantLoad.from_parameters(pf).loop
    assert (loop.kp, loop.ki) == (0.0, 160.0 / 0.02)


@pytest.mark.parametrize(
    ("more", "words"),
    [({"pi": None}, "no PI gains"),
     ({"load_line": None}, "no reference load"),
     ({"pi": {"ki": 8.0e6}}, "not stable"),
     ({"pi": {"ki": -8000.0}}, "not stable"),
     ({"pi": {"specification": {"rise_time": 0.001}}}, "miss rise time"),
     ({"pi": {"unit_u": "V", "scaling_u": 1.0, "kp": 0.2, "ki": 5.0}}, "feed limits in"),
     ({"limits": {"feed_rate": {"low": 1100.0, "high": 2000.0, "unit": "mm/min"}}}, "feed limit")],
)  # fmt: skip
def test_what_cannot_run_is_refused_with_exit_code_5(constant_load_file, more, words):
    with pytest.raises(GateError, match=words) as error:
        controllers.ConstantLoad.from_parameters(constant_load_file(**more))
    assert error.value.exit_code == 5


def test_what_the_file_leaves_open_is_assumed_and_said(constant_load_file):
    from fitmodels.parameters.exports.loop import loop_settings

    found = loop_settings(constant_load_file(load_line={"engagement": None}))
    assert found.loop.back_off > found.loop.recover > 0
    assert 0 < found.loop.engage_at < found.loop.reference
    assert len(found.assumed) == 8


def test_a_lower_limit_of_the_gains_and_the_machine_narrows_the_range(constant_load_file):
    limits = {"feed_rate": {"low": 10.0, "high": 1200.0, "unit": "mm/min"}}
    pf = constant_load_file(pi={"low": 650.0, "high": 950.0}, limits=limits)
    loop = controllers.ConstantLoad.from_parameters(pf).loop
    assert (loop.feed_low, loop.feed_high, loop.high) == (650.0, 950.0, 0.95)


def test_feed_stays_above_zero_where_a_file_says_next_to_nothing(constant_load_file):
    exact = {"kind": "none", "reason": "given"}
    pf = constant_load_file(load_line={"lower": {"value": 0.001, "wear": 0.2, "interval": exact}})
    assert controllers.ConstantLoad.from_parameters(pf).loop.low == 0.05


@pytest.mark.parametrize(("duration", "dt"), [(0, 0.02), (1, 0), (-1, 0.02), (1e9, 1e-9), (math.nan, 0.02)])
def test_a_replay_of_no_length_or_no_step_is_refused(controller, duration, dt, plant):
    with pytest.raises(UsageError, match="give both above zero"):
        controllers.replay(controller(), plant(), duration=duration, dt=dt)


def test_the_plant_is_the_difference_equation_of_the_file(constant_load_file, linear_cut):
    model = constant_load_file().dynamics
    rng = np.random.default_rng(3)
    u = rng.standard_normal(200)
    cut = linear_cut(b=model.b, a=model.a)
    ours = [cut.step(0.0, 0.02, rng), *(cut.step(value, 0.02, rng) for value in u[:-1])]  # each answers the one before
    assert ours == pytest.approx(model.simulate(u), abs=1e-12)


# ---- eq. 16 as it is worded


@pytest.fixture(scope="module", params=["CLM-2023", "CLM-2023-slot"])
def paper(request):
    return published(request.param)


def in_cut(pf, average=1, **more):
    """Its loop with the threshold met, so that every further step is eq. 16."""
    loop = replace(controllers.ConstantLoad.from_parameters(pf).loop, average=average, **more)
    c = controllers.ConstantLoad(loop, command=loop.high)
    for _ in range(loop.engage_samples):
        c.step(loop.reference, loop.sample_time)
    assert c.cutting
    return c


def test_the_paper_s_gains_run_here_and_are_refused_for_export(paper):
    loop = controllers.ConstantLoad.from_parameters(paper).loop
    assert (loop.form, loop.kp, loop.ki * loop.sample_time) == ("incremental_sum", 160.0, pytest.approx(0.006))
    with pytest.raises(GateError, match="integrator of an integrator"):
        export_view(paper, accept_verdict=True).needed_loop()


def test_it_is_equation_16_term_by_term(paper):
    """U = U0 + Kp e + Ki sum e, U0 the last control signal; mm/min, per sample."""
    c = in_cut(paper, back_off=1e9, recover=1e9)
    loads = 0.24 + 0.004 * np.sin(np.arange(200) / 7) + 0.001
    u, total, feeds = c.loop.feed_high, 0.0, []
    for load in loads:
        total += 0.24 - load
        u += 160.0 * (0.24 - load) + 0.006 * total
        feeds.append(u)
    assert max(feeds) < c.loop.feed_high
    assert min(feeds) > c.loop.feed_low
    ours = [c.step(load, 0.02) * c.loop.feed_programmed for load in loads]
    assert ours == pytest.approx(feeds, rel=1e-12)


def test_its_average_is_the_mean_of_the_last_ten_feeds(paper):
    loads = 0.24 + 0.01 * np.random.default_rng(2).random(150)
    plain, mean = ([c.step(load, 0.02) for load in loads] for c in (in_cut(paper), in_cut(paper, average=10)))
    filled = np.r_[np.full(9, controllers.ConstantLoad.from_parameters(paper).loop.high), plain]
    assert mean == pytest.approx(np.convolve(filled, np.full(10, 0.1), "valid"), abs=1e-12)


def test_it_is_the_tuner_s_own_controller_limits_and_average_included(paper):
    """ident simulates the same gains in code of its own; loads so far off that both limits hold at times."""
    from fitmodels.ident.pi.controller import PiController
    from fitmodels.ident.pi.gains import PiGains

    c = in_cut(paper, average=10, back_off=1e9, recover=1e9)
    loop = c.loop
    theirs = PiController(
        PiGains(160.0, 0.3, 0.02, "incremental_sum", average=10, average_of="command", low=loop.feed_low,
                high=loop.feed_high), last=loop.feed_high,
    )  # fmt: skip
    noise = 0.005 * np.random.default_rng(3).standard_normal(3000)
    loads = (0.24 + 0.03 * np.sin(np.arange(3000) / 60) + noise).tolist()
    ours = [c.step(load, 0.02) * loop.feed_programmed for load in loads]
    assert ours == pytest.approx([theirs.step(0.24, load) for load in loads], rel=1e-9)
    assert min(ours) == pytest.approx(loop.feed_low)
    assert max(ours) == pytest.approx(loop.feed_high)


@settings(deadline=None, max_examples=20)
@given(readings)
def test_whatever_it_reads_in_its_own_form_the_feed_stays_within_its_limits(readings):
    c = controllers.ConstantLoad.from_parameters(OWN)
    for reading in readings:
        assert c.loop.low <= c.step(reading, 0.02) <= c.loop.high


OWN = published("CLM-2023-slot")


def test_out_of_the_cut_it_keeps_its_last_feed(paper):
    c = in_cut(paper)
    for _ in range(50):
        c.step(0.25, 0.02)
    last = c.command
    assert {c.step(0.1158, 0.02) for _ in range(500)} == {last}
    assert not c.cutting


@pytest.mark.parametrize("reading", [math.nan, math.inf, -0.24, 2.4])
def test_with_a_load_that_is_unknown_it_goes_to_the_lower_limit_and_says_so(paper, reading):
    c = in_cut(paper)
    c.step(reading, 0.02)
    assert "load unknown" in c.news
    for _ in range(50):  # half a second for the range
        c.step(reading, 0.02)
    assert c.command == pytest.approx(c.loop.low, abs=1e-12)
    c.step(0.2, 0.02)
    assert "load known" in c.news


def test_a_reading_that_stands_still_is_told_and_not_followed(paper):
    c, news = in_cut(paper), []
    for _ in range(50):
        c.step(0.25, 0.02)
    c.news = ()
    for _ in range(300):
        c.step(0.23, 0.02)  # too low for ever: it would rise to its upper limit
        news += c.news
    assert "load stuck" in news
    assert c.command == pytest.approx(c.loop.low, abs=1e-12)


def test_in_position_form_a_stuck_reading_is_told_and_answered_as_linuxcnc_does(loaded):
    c, news = controllers.ConstantLoad(loaded, command=1.0), []
    for _ in range(300):
        c.step(0.3, loaded.sample_time)
        news += c.news
    assert "load stuck" in news
    assert c.command == pytest.approx(loaded.low)


def test_a_command_that_rests_on_its_limit_for_the_dwell_asks_for_another_tool(paper):
    rng, news = np.random.default_rng(4), []
    c = in_cut(paper, average=10)
    for _ in range(700):
        c.step(0.27 + 0.002 * rng.standard_normal(), 0.02)
        news.append(c.news)
    told = [k for k, what in enumerate(news) if "change tool" in what]
    low = next(k for k, what in enumerate(news) if "at low" in what)
    assert len(told) == 1
    assert told[0] - low == pytest.approx(paper.load_line.dwell / 0.02, abs=12)  # the average comes ten samples later
    assert c.worn


@pytest.mark.parametrize(("rests", "asks"), [(190, False), (230, True)])
def test_a_rest_shorter_than_the_dwell_is_no_worn_tool_and_air_does_not_count(paper, rests, asks):
    c, rng = in_cut(paper), np.random.default_rng(5)

    def cut(load, samples):
        for _ in range(samples):
            c.step(load + 1e-4 * rng.standard_normal(), 0.02)

    cut(0.40, 25)  # to the lower limit
    cut(0.27, rests // 2)
    cut(0.1158, 500)
    cut(0.27, rests // 2)
    cut(0.20, 10)
    cut(0.27, 20)
    assert c.worn is asks


@pytest.mark.parametrize("fault", [*FAULTS, "saturated"])
def test_a_fault_in_the_loop_is_told_and_leaves_the_feed_within_its_limits(paper, fault):
    off = {
        "stuck": lambda reading, told: 0.235
    }  # at the reference itself the command stands still, and nobody can tell
    fails = {**FAULTS, **off, "saturated": saturated(0.21)}[fault]
    mill = FaultyPlant(MillingCut.from_parameters(paper, noise=0.003), fails, start=25.0, end=40.0)
    c = controllers.ConstantLoad.from_parameters(paper)
    trace = controllers.replay(c, mill, duration=60, dt=0.02)
    assert c.loop.low <= trace.command.min() <= trace.command.max() <= c.loop.high
    known = {"dropout": "air"}.get(fault, "load stuck" if fault in ("stuck", "saturated") else "load unknown")
    assert next(e.time for e in trace.events if e.what == known and e.time >= 25) < 30
    after = trace.measurement[(trace.time > 50) & (trace.measurement > 0.2)]
    assert after.mean() == pytest.approx(0.24, rel=0.01)  # and the loop takes over again


@pytest.mark.parametrize("fault", list(FAULTS))
def test_a_fault_in_a_loop_in_position_form_leaves_its_feed_between_its_limits_and_the_programme_s(
    controller, fault, plant
):
    c = controller()
    mill = FaultyPlant(plant(noise=0.002), FAULTS[fault], start=8.0)
    trace = controllers.replay(c, mill, duration=20, dt=0.02, command=1.0)
    late = trace.time > 2
    assert c.loop.low <= trace.command[late].min() <= trace.command.max() <= 1.0
    assert any(e.time >= 8 for e in trace.events)
