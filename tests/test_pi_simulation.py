"""A loop run in time: linear to rounding, and right at its limits and at the edges of the cut."""

from dataclasses import replace

import numpy as np
import pytest
from fitmodels.core.errors import IdentError, UsageError
from fitmodels.ident.model import Model
from fitmodels.ident.pi.controller import PiController, simulate_loop
from fitmodels.ident.pi.gains import PiGains
from fitmodels.ident.pi.loop import loop_of

# CLM-2023 eq. 18, doi 10.1109/ACCESS.2023.3330587
PAPER = Model(b=[0, 0.0611, -0.1338, 0.0752], a=[1, -2.0311, 1.2104, -0.1655], nk=1, sample_time=0.02)
AT_ONCE = Model(b=[0.3, 0.1], a=[1, -0.6], nk=0, sample_time=0.02)
ROUNDING = 1e-12
N = 600
STEP = np.ones(N)
KINDS = {
    "position": PiGains(0.5, 3.0, 0.02),
    "forward": PiGains(0.5, 3.0, 0.02, integration="forward"),
    "trapezoidal": PiGains(0.5, 3.0, 0.02, integration="trapezoidal"),
    "incremental": PiGains(0.5, 3.0, 0.02, form="incremental", integration="trapezoidal"),
    "incremental_sum": PiGains(0.05, 0.02, 0.02, form="incremental_sum"),
    "no integral": PiGains(2.0, 0.0, 0.02),
    "all around it": PiGains(0.3, 2.0, 0.02, delay=3, filter_time=0.08, average=5),
    "averaged command": PiGains(0.3, 2.0, 0.02, delay=1, average=5, average_of="command"),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("model", [PAPER, AT_ONCE], ids=["paper", "nk 0"])
def test_with_nothing_in_its_way_the_run_is_the_linear_step(kind, model):
    gains = replace(KINDS[kind], delay=max(KINDS[kind].delay, 1 - model.nk))
    loop = loop_of(model, gains)
    assert loop.stable
    trace = simulate_loop(model, gains, STEP)
    np.testing.assert_allclose(trace.output, loop.step(N), atol=ROUNDING)
    np.testing.assert_allclose(
        trace.command[: N - gains.delay], loop.command_step(N)[gains.delay :], atol=10 * ROUNDING
    )
    # a double integrator puts more poles near 1, where polynomial coefficients of the linear step lose digits
    tolerance = 1e-8 if kind == "incremental_sum" else ROUNDING
    under, over = (simulate_loop(model, gains, 0 * STEP, load=1.0, load_at=at).output for at in ("input", "output"))
    at_input, at_output = loop.disturbance_step(N)
    np.testing.assert_allclose(under, at_input, atol=tolerance)
    np.testing.assert_allclose(over, at_output, atol=tolerance)
    assert not trace.saturated.any()


def test_noise_reaches_the_command_by_the_noise_gain():
    gains, n = PiGains(0.5, 3.0, 0.02), 40_000
    trace = simulate_loop(PAPER, gains, np.zeros(n), noise=0.01, rng=3)
    wanted = 0.01 * loop_of(PAPER, gains).figures().noise_gain
    assert trace.command[2000:].std() == pytest.approx(wanted, rel=0.03)  # 38 000 samples, some of them alike
    assert (trace.measurement - trace.output).std() == pytest.approx(0.01, rel=0.02)


def test_the_same_seed_gives_the_same_run():
    a, b, c = (simulate_loop(PAPER, KINDS["position"], STEP, noise=0.1, rng=s).command for s in (1, 1, 2))
    assert (a == b).all()
    assert (a != c).any()


@pytest.mark.parametrize("form", ["position", "incremental"])
@pytest.mark.parametrize("anti_windup", ["clamping", "back_calculation", "none"])
def test_limits_and_rate_hold_whatever_the_form(form, anti_windup):
    gains = PiGains(
        2.0, 3.0, 0.02, form, low=-1.0, high=4.0, rate=20.0, anti_windup=anti_windup, average=3, average_of="command"
    )
    reference = np.where(np.arange(N) // 100 % 2, -1.0, 1.5)
    u = simulate_loop(PAPER, gains, reference, noise=0.05, rng=1).command
    assert u.min() >= -1.0
    assert u.max() <= 4.0
    assert np.abs(np.diff(u, prepend=0)).max() <= 20.0 * 0.02 * (1 + 1e-12)


def windup(anti_windup, form="position"):
    """How far the output stays beyond a reference that falls from out of reach to within reach, unit_y s."""
    gains = PiGains(0.5, 3.0, 0.02, form, high=4.0, low=-4.0, anti_windup=anti_windup)
    reference = np.r_[np.full(1000, 2.0), np.full(1000, 0.3)]  # 4 V reaches 0.73 A
    trace = simulate_loop(PAPER, gains, reference)
    assert trace.saturated[900]
    return float(0.02 * np.maximum(trace.output[1000:] - 0.3, 0).sum())


def test_anti_windup_shortens_the_way_back_from_a_limit():
    none, clamping, tracking = (windup(a) for a in ("none", "clamping", "back_calculation"))
    assert none > 5 * clamping
    assert none > 5 * tracking


def test_under_limits_the_incremental_form_goes_on_from_what_was_sent_and_none_from_what_was_asked():
    assert windup("none", "incremental") == pytest.approx(windup("none"), rel=1e-6)
    assert windup("clamping", "incremental") < windup("none") / 5


def test_clamping_holds_the_sum_one_sample_after_the_limit_as_linuxcncs_pid_does():
    # pid.c of LinuxCNC 2.9: the sum stands while the limit that the last output met and the error point one way
    pi = PiController(PiGains(2.0, 10.0, 0.1, high=3.0))
    sent = [pi.step(1.0, y) for y in (0.0, 0.0, 0.0, 0.0, 1.0, 1.5)]
    total, state, wanted = 0.0, 0, []
    for e in (1.0, 1.0, 1.0, 1.0, 0.0, -0.5):
        total += e * 0.1 if e * state <= 0 else 0.0
        u = 2 * e + 10 * total
        state = int(u > 3)
        wanted.append(min(u, 3.0))
    assert sent == pytest.approx(wanted, abs=ROUNDING)


def test_saturation_is_reported_with_its_side():
    gains = PiGains(0.5, 3.0, 0.02, high=2.0, low=-2.0)
    trace = simulate_loop(PAPER, gains, np.r_[np.full(300, 3.0), np.full(300, -3.0)])
    assert trace.limited[200] == 1
    assert trace.limited[500] == -1
    assert trace.command[200] == 2.0


@pytest.mark.parametrize("kind", KINDS)
def test_entry_into_and_exit_from_the_cut_make_no_bump(kind):
    gains = replace(KINDS[kind], rate=50.0)
    cut = (np.arange(N) >= 100) & (np.arange(N) < 400)
    trace = simulate_loop(PAPER, gains, 0.3 * STEP, engaged=cut, idle=2.5)
    assert (trace.command[:100] == 2.5).all()
    assert trace.command[100] == pytest.approx(2.5, abs=ROUNDING)
    assert np.abs(np.diff(trace.command)).max() <= 50.0 * 0.02 + ROUNDING
    assert (trace.output[:100] == 0).all()
    assert trace.command[-1] == 2.5
    assert abs(trace.output[-1]) < 1e-3  # out of the cut nothing is cut


def test_in_the_cut_the_loop_settles_on_its_reference_and_does_so_at_each_entry():
    n = 2400
    cut = np.arange(n) // 600 % 2 == 0
    trace = simulate_loop(PAPER, PiGains(0.5, 3.0, 0.02), np.full(n, 0.3), engaged=cut, idle=1.0)
    assert trace.output[[599, 1799]] == pytest.approx([0.3, 0.3], abs=0.002)
    assert trace.command[1200] == pytest.approx(1.0, abs=ROUNDING)


def test_outside_the_cut_the_sum_does_not_grow():
    short, long = (
        simulate_loop(
            PAPER, PiGains(0.5, 3.0, 0.02), np.full(wait + 300, 0.3), engaged=np.arange(wait + 300) >= wait
        ).output
        for wait in (50, 500)
    )
    np.testing.assert_allclose(short[50:], long[500:], atol=ROUNDING)


def test_a_rounded_command_is_whole_steps_and_nearly_the_same_run():
    gains = PiGains(0.5, 3.0, 0.02)
    free, stepped = simulate_loop(PAPER, gains, STEP), simulate_loop(PAPER, gains, STEP, quantum=0.05)
    assert stepped.command / 0.05 == pytest.approx(np.round(stepped.command / 0.05), abs=1e-9)
    assert np.abs(stepped.output - free.output).max() < 0.05 * 0.1812 * 3


def test_the_callers_arrays_stay_as_they_were():
    reference, load, cut = STEP.copy(), STEP.copy(), np.ones(N, dtype=bool)
    simulate_loop(PAPER, PiGains(0.5, 3.0, 0.02), reference, load=load, engaged=cut)
    assert (reference == STEP).all()
    assert (load == STEP).all()
    assert cut.all()


def test_the_picture_shows_reference_output_command_and_limits():
    trace = simulate_loop(
        PAPER,
        PiGains(0.5, 3.0, 0.02, high=3.0, unit_u="V", unit_y="A"),
        STEP,
        noise=0.01,
        rng=1,
        engaged=np.arange(N) > 50,
    )
    ax = trace.plot()
    reported = [text.get_text() for text in ax.get_legend().get_texts()]
    assert reported == ["measurement", "reference", "output", "command", "at a limit"]
    assert ax.get_ylabel() == "output [A]"


@pytest.mark.parametrize(
    ("more", "reported"),
    [
        ({"reference": np.ones((2, 2))}, "reference of shape"),
        ({"load": np.ones(3)}, "load of shape"),
        ({"load": np.nan}, "load of shape"),
        ({"load_at": "spindle"}, "output or input"),
        ({"engaged": np.ones(N)}, "True or False"),
        ({"noise": -1.0}, "noise -1.0"),
        ({"quantum": np.nan}, "quantum nan"),
        ({"noise": 0.1}, "give a seed"),
        ({"idle": np.inf}, "idle inf"),
    ],
)
def test_what_does_not_fit_is_refused(more, reported):
    with pytest.raises(UsageError, match=reported):
        simulate_loop(PAPER, PiGains(0.5, 3.0, 0.02), **({"reference": STEP} | more))


def test_another_sample_time_and_a_loop_without_delay_are_refused():
    with pytest.raises(IdentError, match=r"gains at 0\.01 s, model at 0\.02 s"):
        simulate_loop(PAPER, PiGains(0.5, 3.0, 0.01), STEP)
    with pytest.raises(IdentError, match="delay=1"):
        simulate_loop(AT_ONCE, PiGains(0.5, 3.0, 0.02), STEP)
