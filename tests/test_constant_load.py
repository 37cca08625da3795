"""The constant-load controller by itself: what it promises of its command, whatever it is told.

Its arithmetic is LinuxCNC's; test_export_hal.py proves that against LinuxCNC.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from fitmodels import controllers, parameters
from fitmodels.datasets.errors import UsageError
from fitmodels.parameters import GateError
from hypothesis import given, settings
from hypothesis import strategies as st

B18, A18 = [0.0, 0.0611, -0.1338, 0.0752], [1.0, -2.0311, 1.2104, -0.1655]
GAIN = 1.2416e-4 * 1000 / (sum(B18) / sum(A18))  # A per override, at rest: CLM-2023's three points, 1000 mm/min


def plant(**more) -> controllers.Cut:
    return controllers.Cut(**{"b": [GAIN * b for b in B18], "a": A18, "offset": 0.1158, **more})


@pytest.fixture
def controller(constant_load_file):
    def make(**more):
        return controllers.ConstantLoad.from_parameters(constant_load_file(**more))

    return make


def test_a_file_alone_makes_it_and_a_file_read_back_makes_the_same(constant_load_file, tmp_path):
    pf = constant_load_file()
    again = parameters.read(parameters.write(pf, tmp_path / "params.json"))
    assert controllers.ConstantLoad.from_parameters(again).loop == controllers.ConstantLoad.from_parameters(pf).loop


def test_it_settles_at_the_reference_within_four_seconds(controller):
    trace = controllers.replay(controller(), plant(), duration=20, dt=0.02)
    late = trace.time > 4 + 5  # 5 s: the limiter's ramp from 0
    assert np.abs(trace.measurement[late] - 0.22).max() < 0.01 * 0.22  # CLM-2023: within 1 % of the reference


def test_the_same_seed_gives_the_same_trace(controller):
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
     ({"pi": {"form": "incremental_sum", "ki": 0.006, "kp": 160.0}}, "integrator of an integrator"),
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
    from fitmodels.parameters.export.settings import settings

    found = settings(constant_load_file(load_line={"engagement": None}))
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
def test_a_replay_of_no_length_or_no_step_is_refused(controller, duration, dt):
    with pytest.raises(UsageError, match="both lie above zero"):
        controllers.replay(controller(), plant(), duration=duration, dt=dt)


def test_the_plant_is_the_difference_equation_of_the_file(constant_load_file):
    model = constant_load_file().dynamics
    rng = np.random.default_rng(3)
    u = rng.standard_normal(200)
    cut = controllers.Cut(b=model.b, a=model.a)
    ours = [cut.step(0.0, 0.02, rng), *(cut.step(value, 0.02, rng) for value in u[:-1])]  # each answers the one before
    assert ours == pytest.approx(model.simulate(u), abs=1e-12)
