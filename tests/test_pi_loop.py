"""The closed loop and its figures, against python-control, against long sums, and against what they claim."""

from dataclasses import fields, replace

import numpy as np
import pytest
from fitmodels.core.errors import IdentError, UsageError
from fitmodels.ident.model import Model
from fitmodels.ident.pi.figures_of_merit import figures_on_grid
from fitmodels.ident.pi.gains import PiGains
from fitmodels.ident.pi.loop import FiguresOfMerit, loop_of
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter

pytestmark = pytest.mark.slow

# CLM-2023 eq. 18, doi 10.1109/ACCESS.2023.3330587
PAPER = Model(b=[0, 0.0611, -0.1338, 0.0752], a=[1, -2.0311, 1.2104, -0.1655], nk=1, sample_time=0.02)
T = 0.02
PLANTS = {
    "paper": PAPER,
    "first order": Model(b=[0, 0.05], a=[1, -0.95], nk=1, sample_time=T),
    "delayed": Model(b=[0, 0, 0, 0, 0.05], a=[1, -0.95], nk=4, sample_time=T),
    "integrating": Model(b=[0, 0.02], a=[1, -1.0], nk=1, sample_time=T),
    "unstable": Model(b=[0, 0.1], a=[1, -1.02], nk=1, sample_time=T),
    "resonant": Model(b=[0, 0.02, 0.02], a=[1, -1.8, 0.95], nk=1, sample_time=T),
    "negative": Model(b=[0, -0.05], a=[1, -0.95], nk=1, sample_time=T),
    "at once": Model(b=[0.1, 0.02], a=[1, -0.9], nk=0, sample_time=T),
}
KINDS = {
    "position": PiGains(1.0, 1.0, T),
    "trapezoidal": PiGains(1.0, 1.0, T, integration="trapezoidal"),
    "forward": PiGains(1.0, 1.0, T, integration="forward"),
    "incremental": PiGains(1.0, 1.0, T, form="incremental"),
    "incremental_sum": PiGains(1.0, 1.0, T, form="incremental_sum"),
    "filtered": PiGains(1.0, 1.0, T, filter_time=0.1),
    "averaged, late": PiGains(1.0, 1.0, T, average=4, delay=2),
    "averaged command": PiGains(1.0, 1.0, T, average=4, average_of="command", filter_time=0.05),
    "averaged command, late": PiGains(1.0, 1.0, T, average=3, average_of="command", delay=2),
}
GAINS = {
    "paper": (0.4, 2.0), "first order": (2.0, 3.0), "delayed": (1.0, 2.0), "integrating": (2.0, 1.0),
    "unstable": (1.0, 0.5), "resonant": (0.02, 1.0), "negative": (-2.0, -3.0), "at once": (0.2, 1.0),
}  # fmt: skip
# two integrators in the controller and one in the plant, or a pole outside, are more than a PI's zero can hold
CASES = [(p, k) for p in PLANTS for k in KINDS if not (k == "incremental_sum" and p in ("integrating", "unstable"))]
MARGINS = 1e-6  # python-control finds its frequencies as roots of polynomials of twice the order


def case(plant, kind):
    kp, ki = GAINS[plant]
    if kind == "incremental_sum":  # its kp integrates
        kp, ki = ki * T, ki * T / 10
    delay = max(KINDS[kind].delay, int(plant == "at once"))
    return loop_of(PLANTS[plant], replace(KINDS[kind], kp=kp, ki=ki, delay=delay))


def fraction(num, den):
    """In powers of z for python-control."""
    from control import TransferFunction

    n = max(len(num), len(den))
    return TransferFunction(np.pad(num, (0, n - len(num))), np.pad(den, (0, n - len(den))), T)


def test_a_proportional_gain_above_7_868_makes_the_published_plant_unstable():
    assert loop_of(PAPER, PiGains(7.867, 0.0, T)).stable
    assert not loop_of(PAPER, PiGains(7.868, 0.0, T)).stable
    assert loop_of(PAPER, PiGains(1.0, 0.0, T)).figures().gain_margin == pytest.approx(7.8675, abs=5e-5)


@pytest.mark.parametrize("form", ["position", "incremental", "incremental_sum"])
def test_160_volts_an_ampere_are_never_stable(form):
    ki = np.r_[0.0, 0.006, np.geomspace(1e-6, 1e6, 300)]
    table = figures_on_grid(PAPER, np.full(len(ki), 160.0), ki, PiGains(1.0, 1.0, T, form), duration=5.0)
    assert not table["stable"].any()


def meets(scale, kind, kp, ki):
    table = figures_on_grid(PAPER, kp / scale, ki / scale, kind, duration=30.0)
    return scale[(table["rise_time"] <= 2) & (table["settling_time"] <= 4)]


@pytest.mark.parametrize(
    ("form", "ki", "low", "high", "digits"),
    [
        ("incremental_sum", 0.006 / T, 540, 1835, 5),  # per sample, as eq. 16 reads
        ("position", 160 / 0.36, 39, 68, 0.5),  # integral time 0.006 min
        ("position", 160 / 0.006, 1780, 6050, 10),  # integral time 0.006 s
    ],
)
def test_the_published_gains_meet_2_and_4_s_in_these_scalings(form, ki, low, high, digits):
    scale = np.geomspace(5.0, 2e4, 4000)
    ok = meets(scale, PiGains(1.0, 1.0, T, form), np.full(4000, 160.0), np.full(4000, ki))
    assert ok.min() == pytest.approx(low, abs=1.5 * digits)
    assert ok.max() == pytest.approx(high, abs=1.5 * digits)
    np.testing.assert_array_equal(ok, scale[(scale >= ok.min()) & (scale <= ok.max())])


@pytest.mark.parametrize("ki", [0.006, 0.006 / T])
def test_in_position_form_the_published_ki_meets_2_and_4_s_in_no_scaling(ki):
    assert meets(np.geomspace(0.1, 1e5, 3000), PiGains(1.0, 1.0, T), np.full(3000, 160.0), np.full(3000, ki)).size == 0


def assert_margins(found, theirs, plain):
    """python-control leaves out frequency zero and the Nyquist frequency: its margins can only be the larger ones."""
    gm, pm, distance, _, crossover, _ = theirs
    if found.gain_margin != pytest.approx(gm, rel=MARGINS):
        assert plain
        assert abs(np.log(found.gain_margin)) < abs(np.log(gm))
    assert found.phase_margin == pytest.approx(abs(pm), rel=MARGINS)
    if np.isfinite(pm):
        assert found.crossover == pytest.approx(crossover, rel=MARGINS)
    if np.isfinite(distance):
        assert found.ms == pytest.approx(1 / distance, rel=MARGINS)
    else:
        assert plain


@pytest.mark.parametrize(("plant", "kind"), CASES[::2])
def test_margins_are_those_of_python_control_from_the_frequency_response(plant, kind):
    from control import frd, stability_margins

    loop = case(plant, kind)
    omega = np.r_[
        np.geomspace(2e-3, 12, 600)[:-1], np.linspace(12, 30, 600)[:-1], np.linspace(30, np.pi / T * (1 - 1e-9), 400)
    ]
    theirs = stability_margins(frd(fraction(*loop.open), omega, smooth=True))
    # first-order lags reach the negative real axis at the Nyquist frequency alone
    assert_margins(loop.figures(duration=1.0), theirs, plant not in ("paper", "delayed", "resonant"))


@pytest.mark.parametrize("kind", ["position", "trapezoidal", "forward", "incremental"])
@pytest.mark.parametrize("plant", ["paper", "delayed", "unstable"])
def test_margins_are_those_of_python_control_from_polynomials(plant, kind):
    from control import stability_margins

    loop = case(plant, kind)
    assert_margins(loop.figures(duration=1.0), stability_margins(fraction(*loop.open), method="poly"), False)


def test_the_published_plant_under_a_gain_for_2_and_4_s_agrees_with_python_control():
    from control import stability_margins

    for kp, ki in ((0.5, 6.0), (1.0, 8.0), (0.2, 5.0), (4.0, 10.0), (1.0, 0.0)):
        loop = loop_of(PAPER, PiGains(kp, ki, T))
        assert_margins(loop.figures(1.0), stability_margins(fraction(*loop.open), method="poly"), False)


def test_the_cases_are_stable_as_the_tests_here_take_them():
    assert all(case(*c).stable for c in CASES)


@pytest.mark.parametrize(("plant", "kind"), CASES)
def test_times_and_overshoot_are_those_of_python_control_within_a_sample(plant, kind):
    from control import step_info

    loop = case(plant, kind)
    n = 2000
    found = loop.figures(duration=n * T)
    info = step_info(loop.step(n + 1), T=np.arange(n + 1) * T, yfinal=1.0 if loop.gains.ki else None)
    assert found.settling_time <= info["SettlingTime"] + 1e-9
    assert found.settling_time > info["SettlingTime"] - T - 1e-9
    assert found.rise_time == pytest.approx(info["RiseTime"], abs=T + 1e-9)
    assert found.overshoot == pytest.approx(info["Overshoot"] / 100, abs=1e-8)
    assert found.undershoot == pytest.approx(info["Undershoot"] / 100, abs=1e-8)


@pytest.mark.parametrize(("plant", "kind"), CASES)
def test_sums_and_peaks_are_those_of_the_responses(plant, kind):
    loop = case(plant, kind)
    n, d = 700, loop.gains.delay
    found = loop.figures(duration=n * T)
    y, u, load = loop.step(n + 1), loop.command_step(n + 1 + d)[d:], loop.disturbance_step(n + 1)[0]
    near = {"rel": 1e-7, "abs": 1e-9}  # of direct polynomials with many roots near 1
    assert found.travel == pytest.approx(np.abs(np.diff(u, prepend=0)).sum(), **near)
    assert found.peak_u == pytest.approx(np.abs(u).max(), **near)
    late, late_load = (x[n + 1 :] for x in (1 - loop.step(30_000), loop.disturbance_step(30_000)[0]))
    assert found.iae == pytest.approx(T * (np.abs(1 - y).sum() + abs(late.sum())), rel=1e-6)
    assert found.disturbance_peak == pytest.approx(np.abs(load).max(), **near)
    assert found.disturbance_iae == pytest.approx(T * (np.abs(load).sum() + abs(late_load.sum())), rel=1e-6)
    assert found.steady_error == 0.0
    pulse = lfilter(*loop.noise_to_command, np.eye(1, 20_000)[0])
    assert found.noise_gain == pytest.approx(np.sqrt(pulse @ pulse), rel=1e-7)


@pytest.mark.parametrize(("plant", "kind"), CASES)
def test_peaks_of_sensitivity_are_the_highest_points_of_a_dense_sweep(plant, kind):
    loop = case(plant, kind)
    num, den = loop.open

    def highest(of):
        """Largest value on a sweep, and on a second one round its place."""
        theta = np.r_[np.geomspace(1e-7, 1, 20_000), np.linspace(1, np.pi, 20_000)]
        for _ in range(2):
            z = np.exp(-1j * theta)
            size = np.abs(of(np.polyval(num[::-1], z) / np.polyval(den[::-1], z)))
            at = np.clip(size.argmax(), 1, len(theta) - 2)
            theta = np.linspace(theta[at - 1], theta[at + 1], 1000)
        return size.max()

    found = loop.figures(duration=1.0)
    assert found.ms == pytest.approx(highest(lambda L: 1 / (1 + L)), rel=1e-6)
    assert found.mt == pytest.approx(highest(lambda L: L / (1 + L)), rel=1e-6)


@pytest.mark.parametrize(("plant", "kind"), CASES)
def test_the_margins_are_the_edge_of_stability(plant, kind):
    loop = case(plant, kind)
    found = loop.figures(duration=1.0)

    def held(factor=1.0, later=0):
        g = loop.gains
        return loop_of(loop.model, replace(g, kp=g.kp * factor, ki=g.ki * factor, delay=g.delay + later)).stable

    if np.isfinite(found.gain_margin):
        beyond = found.gain_margin ** np.array([0.999, 1.001])
        assert held(beyond[0])
        assert not held(beyond[1])
    if np.isfinite(found.delay_margin):
        whole = int(found.delay_margin / T)
        assert held(later=whole)
        assert not held(later=whole + 1)


@settings(max_examples=20, deadline=None)
@given(st.floats(0.05, 6), st.floats(0.05, 20), st.floats(1e-3, 1e3))
def test_a_scaled_plant_with_gains_scaled_back_is_the_same_loop(kp, ki, factor):
    first = loop_of(PAPER, PiGains(kp, ki, T))
    assume(first.radius < 0.9999)
    one = first.figures(6.0)
    two = loop_of(replace(PAPER, b=PAPER.b * factor), PiGains(kp / factor, ki / factor, T)).figures(6.0)
    power = {"travel": -1, "peak_u": -1, "noise_gain": -1, "disturbance_peak": 1, "disturbance_iae": 1}
    for f in fields(FiguresOfMerit):
        wanted = getattr(one, f.name) * factor ** power.get(f.name, 0)
        assert getattr(two, f.name) == pytest.approx(wanted, rel=1e-6, abs=1e-8), f.name


@pytest.mark.parametrize("kind", KINDS)
def test_the_grid_holds_what_each_pair_gives_alone(kind):
    rng = np.random.default_rng(3)
    kp, ki = np.exp(rng.uniform(-3, 3, 3000)), np.exp(rng.uniform(-3, 3, 3000))
    ki[::7] = 0.0
    kp[3], ki[3] = 0.0, 0.0
    if kind == "incremental_sum":
        kp, ki = kp * T, ki * T
    table = figures_on_grid(PAPER, kp, ki, KINDS[kind], duration=3.0)
    assert 0.2 < table["stable"].mean() < 1
    for k in np.r_[np.arange(10), rng.integers(0, 3000, 15), 2999]:
        alone = loop_of(PAPER, replace(KINDS[kind], kp=kp[k], ki=ki[k])).figures(3.0)
        for f in fields(FiguresOfMerit):
            assert table[f.name][k] == pytest.approx(getattr(alone, f.name), rel=1e-9, abs=1e-9), (f.name, kp[k], ki[k])


@pytest.mark.parametrize("kind", ["position", "averaged command, late", "filtered"])
def test_many_models_give_a_row_each(kind):
    models = [PLANTS[p] for p in ("paper", "first order", "delayed", "resonant", "unstable")]
    kp, ki = np.array([0.1, 0.5, 1.5, 8.0]), np.array([0.3, 2.0, 0.0, 9.0])
    rows = figures_on_grid(models, kp, ki, KINDS[kind], duration=4.0)
    for k, model in enumerate(models):
        alone = figures_on_grid(model, kp, ki, KINDS[kind], duration=4.0)
        for name, values in alone.items():
            assert rows[name].shape == (5, 4)
            np.testing.assert_allclose(rows[name][k], values, rtol=1e-7, atol=1e-9, err_msg=name)


def test_an_unstable_loop_has_infinite_errors_and_no_margin():
    found = loop_of(PAPER, PiGains(160.0, 0.3, T)).figures()
    assert (found.stable, found.gain_margin, found.phase_margin, found.delay_margin) == (False, 1.0, 0.0, 0.0)
    assert found.ms == found.settling_time == found.overshoot == found.noise_gain == np.inf


def test_without_integral_action_the_error_stays_and_is_reported():
    found = loop_of(PAPER, PiGains(2.0, 0.0, T)).figures()
    gain = 2 * PAPER.dc_gain
    assert found.steady_error == pytest.approx(1 / (1 + gain), rel=1e-12)
    assert found.settling_time < 10


def test_gains_of_zero_do_nothing():
    found = loop_of(PAPER, PiGains(0.0, 0.0, T)).figures()
    assert (found.steady_error, found.overshoot, found.travel, found.ms, found.crossover) == (1.0, 0.0, 0.0, 1.0, 0.0)
    assert found.rise_time == found.settling_time == found.gain_margin == found.phase_margin == np.inf


def test_what_does_not_happen_within_the_duration_is_infinite():
    loop = loop_of(PAPER, PiGains(0.1, 0.5, T))
    short, long = loop.figures(3.0), loop.figures()
    assert short.rise_time == short.settling_time == np.inf
    assert 10 < long.rise_time < long.settling_time < np.inf


def test_the_integral_of_the_error_after_a_load_is_one_over_ki():
    # Åström & Hägglund 2006, Advanced PID Control, section 4.4: integrated error is 1/ki; here the error has one sign
    assert loop_of(PAPER, PiGains(0.5, 2.0, T)).figures().disturbance_iae == pytest.approx(0.5, rel=2e-3)
    assert loop_of(PLANTS["first order"], PiGains(2.0, 3.0, T)).figures().disturbance_iae == pytest.approx(
        1 / 3, rel=1e-5
    )


def test_crossings_are_interpolated_between_samples():
    # y = 0, 0.2, 0.36, ...: 1 - 0.8^k under kp' chosen so that the loop is an integrator of gain 10 per second
    loop = loop_of(Model(b=[0, 1.0], a=[1, 0.0], nk=1, sample_time=T), PiGains(0.0, 10.0, T))
    y = 1 - 0.8 ** np.arange(60)
    np.testing.assert_allclose(loop.step(60), y, atol=1e-12)
    t = np.interp([0.1, 0.9, 0.98], y, np.arange(60) * T)
    found = loop.figures(1.2)
    assert found.rise_time == pytest.approx(t[1] - t[0], rel=1e-9)
    assert found.settling_time == pytest.approx(t[2], rel=1e-9)


def test_an_unstable_plant_is_followed_for_minutes_without_drift():
    loop = case("unstable", "position")
    assert loop.model.radius > 1.01
    assert loop.figures(150.0).iae == pytest.approx(loop.figures(75.0).iae, rel=1e-9)


def test_poles_and_transfer_functions_agree_with_python_control():
    from control import feedback, poles

    loop = loop_of(PAPER, PiGains(0.5, 3.0, T, delay=1, filter_time=0.1))
    (pn, pd), (hn, hd) = loop.gains.forward, loop.gains.feedback
    closed = feedback(fraction(pn, pd) * PAPER.to_control(), fraction(hn, hd))
    ours, theirs = (p[np.abs(p) > 1e-6] for p in (loop.poles, poles(closed)))
    z = np.exp(1j * np.geomspace(0.01, 3, 50))
    num, den = loop.closed
    np.testing.assert_allclose(np.polyval(num[::-1], 1 / z) / np.polyval(den[::-1], 1 / z), closed(z), rtol=1e-9)
    for p in ours:
        assert np.abs(theirs - p).min() < 1e-6
    assert loop.radius == pytest.approx(np.abs(theirs).max(), rel=1e-9)


@pytest.mark.parametrize(
    ("call", "error", "reported"),
    [
        (lambda: loop_of(PAPER, PiGains(1, 1, 0.01)), IdentError, "sample time"),
        (lambda: loop_of(PLANTS["at once"], PiGains(1, 1, T)), IdentError, "delay=1"),
        (lambda: loop_of(PAPER, PiGains(0.5, 3, T)).figures(0.0), UsageError, "duration 0.0 s"),
        (lambda: loop_of(PAPER, PiGains(0.5, 3, T)).figures(np.nan), UsageError, "duration nan s"),
        (lambda: figures_on_grid(PAPER, [1.0, 2.0], [1.0], KINDS["position"], 1.0), UsageError, "same length"),
        (lambda: figures_on_grid(PAPER, [np.nan], [1.0], KINDS["position"], 1.0), UsageError, "finite"),
        (lambda: figures_on_grid([], [1.0], [1.0], KINDS["position"], 1.0), UsageError, "no model"),
    ],
)
def test_what_cannot_be_judged_is_refused(call, error, reported):
    with pytest.raises(error, match=reported):
        call()
