"""Gains from a specification: they meet it, they are the best there are, and what cannot be met is refused in words."""

from dataclasses import replace

import numpy as np
import pytest
from fitmodels.core.errors import IdentError, UsageError
from fitmodels.ident.model import Model
from fitmodels.ident.pi.controller import simulate_loop
from fitmodels.ident.pi.feasible_region import evaluate, feasible_map
from fitmodels.ident.pi.gains import PiGains
from fitmodels.ident.pi.loop import load_step, loop_of
from fitmodels.ident.pi.specification import Specification
from fitmodels.ident.pi.stability_region import gain_range
from fitmodels.ident.pi.tuning import tune_pi
from hypothesis import given, settings
from hypothesis import strategies as st

pytestmark = pytest.mark.slow

# eq. 18 of Tai, Tsai & Li 2023, doi 10.1109/ACCESS.2023.3330587
PUBLISHED = Model(b=[0.0, 0.0611, -0.1338, 0.0752], a=[1.0, -2.0311, 1.2104, -0.1655], nk=1, sample_time=0.02)
INTEGRATOR = Model(b=[0.0, 0.02], a=[1.0, -1.0], nk=1, sample_time=0.02)
FALLING = Model(b=[0.0, -0.02], a=[1.0, -1.0], nk=1, sample_time=0.02)
DELAYED = Model(b=[0.0] * 20 + [0.02], a=[1.0, -0.98], nk=20, sample_time=0.02)
UNSTABLE = Model(b=[0.0, 0.02], a=[1.0, -1.01], nk=1, sample_time=0.02)
PLANTS = {
    "published": PUBLISHED,
    "integrating": INTEGRATOR,
    "falling": FALLING,
    "delayed": DELAYED,
    "unstable": UNSTABLE,
}
SMALL = 40  # gains a side: the answer is refined off the map


@pytest.fixture(scope="module")
def published():
    return tune_pi(PUBLISHED, rise_time=2.0, settling_time=4.0)


def test_the_published_plant_gets_what_the_paper_asks_for(published):
    f = published.figures
    assert published.feasible
    assert f.rise_time <= 2.0
    assert f.settling_time <= 4.0
    assert f.overshoot <= 0.02
    assert f.ms <= 1.3
    assert abs(f.steady_error) < 1e-9
    assert any("overshoot" in reported for reported in published.assumed)


def test_python_control_gives_the_same_margins_and_the_same_step(published):
    control = pytest.importorskip("control")
    num, den = published.gains.transfer_function
    size = max(len(num), len(den))
    c = control.tf(np.pad(num, (0, size - len(num))), np.pad(den, (0, size - len(den))), 0.02)
    loop = PUBLISHED.to_control() * c
    gm, pm, sm, _, wp, _ = control.stability_margins(loop)
    f = published.figures
    assert gm == pytest.approx(f.gain_margin, rel=1e-6)
    assert pm == pytest.approx(f.phase_margin, rel=1e-6)
    assert wp == pytest.approx(f.crossover, rel=1e-6)
    assert 1 / sm == pytest.approx(f.ms, rel=1e-6)
    there = loop(np.exp(0.02j * f.crossover))  # control's own roots leave 1e-6 degrees open, its response does not
    assert abs(there) == pytest.approx(1, abs=1e-9)
    assert np.degrees(np.angle(-there)) == pytest.approx(f.phase_margin, abs=1e-8)
    t, y = control.step_response(control.feedback(loop, 1), T=np.arange(600) * 0.02)
    first = [int(np.argmax(y >= level)) for level in (0.1, 0.9)]
    up = [t[k - 1] + 0.02 * (v - y[k - 1]) / (y[k] - y[k - 1]) for k, v in zip(first, (0.1, 0.9), strict=True)]
    assert up[1] - up[0] == pytest.approx(f.rise_time, abs=1e-6)


def test_no_gains_of_a_fine_map_have_a_smaller_ms(published):
    ms = np.where(published.map.feasible, published.map.figures["ms"], np.inf)
    assert published.map.feasible.sum() > 1000
    assert published.figures.ms <= ms.min() * (1 + 1e-6)


@pytest.mark.parametrize("plant", PLANTS.values(), ids=PLANTS)
def test_every_kind_of_plant_gets_a_right_answer(plant):
    pi = tune_pi(plant, rise_time=2.0, settling_time=5.0, n=SMALL)
    assert pi.feasible, pi.verdict
    num, den = pi.gains.transfer_function
    closed = np.polyadd(
        np.convolve(*(np.pad(p, (0, 30 - len(p))) for p in (plant.b, num))),
        np.convolve(*(np.pad(p, (0, 30 - len(p))) for p in (plant.a, den))),
    )
    assert np.abs(np.roots(np.trim_zeros(closed, "b"))).max() < 1
    assert np.sign(pi.ki) == (-1 if plant is FALLING else 1)


@pytest.mark.parametrize(
    ("plant", "words"),
    [
        (Model(b=[0.0, 2e-4, 2e-4], a=[1.0, -2.0, 1.0], nk=1, sample_time=0.02), "2 of its poles"),
        (Model(b=[0.0] * 60 + [0.02], a=[1.0, -1.05], nk=60, sample_time=0.02), "largest 1.05"),
        (Model(b=[0.0, 1.0, -1.0], a=[1.0, -0.5], nk=1, sample_time=0.02), "static gain of zero"),
        (replace(PUBLISHED, b=[1.0, 0.1], nk=0), "algebraic"),
    ],
    ids=["a double integrator", "unstable behind a delay", "nothing at rest", "an answer within the sample"],
)
def test_a_plant_that_no_pi_can_hold_is_refused(plant, words):
    with pytest.raises(IdentError, match=words):
        tune_pi(plant, rise_time=2.0, n=SMALL)


def test_what_cannot_be_met_gets_the_nearest_gains_and_the_limit_that_fails():
    pi = tune_pi(PUBLISHED, rise_time=0.2, settling_time=4.0, ms=1.2, n=SMALL)
    assert not pi.feasible
    assert not pi.map.any
    assert any("rise time" in reported for reported in pi.misses)
    assert any("Ms" in reported for reported in pi.misses)
    assert pi.figures.stable
    nearest = float(pi.specification.worst({**figures_of(pi), "integral_time": pi.gains.ti}))
    grid = np.linspace(0, 7, 60), np.linspace(0.1, 25, 60)
    worst = evaluate(PUBLISHED, pi.specification, PiGains(0.0, 0.0, 0.02), *grid, 12.0)[1]
    assert nearest <= worst.min() * (1 + 1e-3)


def figures_of(pi):
    return {name: getattr(pi.figures, name) for name in pi.figures.__dataclass_fields__}


@pytest.mark.parametrize("aim", ["iae", "largest_ki", "disturbance_iae", "settling_time", "noise_gain", "travel"])
def test_an_aim_is_the_best_of_the_map(aim):
    pi = tune_pi(PUBLISHED, rise_time=2.0, settling_time=4.0, aim=aim, n=SMALL)
    values = -np.broadcast_to(pi.map.ki, pi.map.feasible.shape) if aim == "largest_ki" else pi.map.figures[aim]
    best = -pi.ki if aim == "largest_ki" else getattr(pi.figures, aim)
    assert pi.feasible, pi.verdict
    if aim not in ("iae", "disturbance_iae", "travel"):  # sums over the step: the final figures run for longer
        assert best <= values[pi.map.feasible].min() + 1e-9
    assert ("Ms" in " ".join(pi.assumed)) == (aim in ("iae", "largest_ki", "disturbance_iae", "settling_time"))


@given(factor=st.floats(0.01, 100))
@settings(deadline=None, max_examples=6)
def test_gains_scale_with_the_unit_of_the_command(factor):
    asked = Specification(rise_time=2.0, settling_time=4.0, overshoot=0.02)
    one = feasible_map(PUBLISHED, asked, n=25)
    other = feasible_map(replace(PUBLISHED, b=PUBLISHED.b / factor), asked, n=25)
    np.testing.assert_allclose(other.kp, factor * one.kp, rtol=1e-6, atol=1e-9 * factor)
    np.testing.assert_allclose(other.ki, factor * one.ki, rtol=1e-6)
    np.testing.assert_array_equal(other.feasible, one.feasible)


def test_the_range_of_gains_ends_at_the_ultimate_gain():
    # at 50 Hz a gain above 7.868 V/A makes the published plant unstable
    assert gain_range(PUBLISHED, PiGains(0.0, 0.0, 0.02)).kp == pytest.approx(7.868, rel=0.02)


LAGS = Model(b=np.array([0.0, 0.0003, 0.0003]), a=np.array([1.0, -1.88, 0.8826]), nk=1, sample_time=0.002)


@pytest.mark.parametrize("average", [2, 10, 20])
def test_an_average_over_an_even_number_of_samples_does_not_hide_the_proportional_gain(average):
    """Its notch at half the sample rate asks for an infinite gain there, beside which all others look like rounding."""
    even, odd = (gain_range(LAGS, PiGains(0.0, 0.0, 0.002, average=n)) for n in (average, average + 1))
    assert even.kp > odd.kp > 0.5 * even.kp


@pytest.mark.parametrize(
    "controller",
    [
        {"form": "incremental", "delay": 2},
        {"integration": "trapezoidal", "filter_time": 0.1},
        {"average": 8, "average_of": "command"},
        {"integration": "forward", "average": 5},
    ],
    ids=lambda c: ", ".join(c),
)
def test_the_controller_as_it_runs_is_what_is_tuned(controller):
    pi = tune_pi(PUBLISHED, rise_time=2.0, settling_time=4.0, n=SMALL, **controller)
    assert pi.feasible, pi.verdict
    for name, value in controller.items():
        assert getattr(pi.gains, name) == value
    assert loop_of(PUBLISHED, pi.gains).figures() == pi.figures


WEIGHTED = [
    {"setpoint_weight": 0.5},
    {"setpoint_weight": 0.0, "integration": "forward", "delay": 2},
    {"setpoint_weight": 0.3, "integration": "trapezoidal", "filter_time": 0.1, "form": "incremental"},
    {"setpoint_weight": 0.7, "average": 4},
    {"setpoint_weight": 0.4, "average": 4, "average_of": "command", "delay": 1},
]


@pytest.mark.parametrize("options", WEIGHTED, ids=lambda o: ", ".join(map(str, o.values())))
def test_figures_with_a_setpoint_weight_are_those_of_the_controller_that_runs(options):
    """The step simulated sample by sample; the loop itself and its response to load are those of weight 1."""
    gains = PiGains(1.2, 5.0, 0.02, **options)
    loop, plain = loop_of(PUBLISHED, gains), loop_of(PUBLISHED, replace(gains, setpoint_weight=1.0))
    run = simulate_loop(PUBLISHED, replace(gains, anti_windup="none"), np.ones(900))
    np.testing.assert_allclose(run.output, loop.step(900), atol=1e-9)
    figures, same = loop.figures(), plain.figures()
    sent = np.r_[np.zeros(gains.delay), run.command][:900]
    assert figures.travel == pytest.approx(np.abs(np.diff(sent, prepend=0.0)).sum(), rel=1e-6)
    assert figures.peak_u == pytest.approx(np.abs(sent).max(), rel=1e-6)
    assert figures.overshoot == pytest.approx(max(run.output.max() - 1, 0), abs=1e-6)
    assert figures.iae == pytest.approx(0.02 * np.abs(1 - run.output).sum(), rel=1e-6)
    assert loop.figures(2.0).iae == pytest.approx(figures.iae, rel=0.05)  # the remainder is added
    assert figures.peak_u < same.peak_u or figures.overshoot < same.overshoot
    for name in ("ms", "phase_margin", "gain_margin", "noise_gain", "disturbance_peak", "disturbance_iae"):
        assert getattr(figures, name) == getattr(same, name)


def test_python_control_gives_the_same_step_with_a_setpoint_weight():
    control = pytest.importorskip("control")
    gains = PiGains(2.0, 6.0, 0.02, setpoint_weight=0.4)
    z = control.tf("z")
    integral = 6.0 * 0.02 * z / (z - 1)
    integral.dt = 0.02
    c, f = 2.0 + integral, 0.4 * 2.0 + integral
    g = PUBLISHED.to_control()
    _, y = control.step_response(control.minreal(f * g / (1 + c * g), verbose=False), T=np.arange(300) * 0.02)
    np.testing.assert_allclose(loop_of(PUBLISHED, gains).step(300), y, atol=1e-6)


def test_a_setpoint_weight_takes_overshoot_from_gains_that_are_as_robust():
    asked = {"settling_time": 3.0, "overshoot": 0.02, "ms": 2.0, "n": SMALL, "aim": "disturbance_iae"}
    one, weighted = (tune_pi(INTEGRATOR, setpoint_weight=w, **asked) for w in (1.0, 0.0))
    assert weighted.feasible
    assert weighted.figures.overshoot <= 0.02
    assert weighted.figures.disturbance_iae < 0.8 * one.figures.disturbance_iae


def test_the_step_of_load_is_that_of_the_controller_that_runs():
    gains = PiGains(0.8, 3.0, 0.02, delay=1, filter_time=0.05)
    found = load_step(loop_of(PUBLISHED, gains), 18.0)
    assert found.size == pytest.approx(1 / PUBLISHED.dc_gain)
    run = simulate_loop(PUBLISHED, gains, np.zeros(901), load=found.size, load_at="input")
    np.testing.assert_allclose(found.output, run.output, atol=1e-9)
    np.testing.assert_allclose(found.command[1:], run.command[:-1], atol=1e-9)
    assert np.abs(run.output[round(found.recovery / 0.02) :]).max() <= 0.05 * found.peak + 1e-9


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"setpoint_weight": 1.5}, "from 0 to 1"),
        ({"setpoint_weight": 0.5, "form": "incremental_sum"}, "would not reach the reference"),
    ],
)
def test_a_setpoint_weight_that_cannot_be_is_refused(options, words):
    with pytest.raises(UsageError, match=words):
        PiGains(1.0, 1.0, 0.02, **options)


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        (lambda: tune_pi(PUBLISHED), IdentError, "no limit on speed"),
        (lambda: tune_pi(PUBLISHED, 2.0, filter=0.1), UsageError, "filter_time"),
        (lambda: tune_pi(PUBLISHED, 2.0, aim="best"), UsageError, "largest_ki"),
        (lambda: tune_pi(PUBLISHED, 2.0, probability=0.9, n=SMALL), IdentError, "no covariance"),
    ],
)
def test_what_was_not_said_or_cannot_be_is_refused(call, error, words):
    with pytest.raises(error, match=words):
        call()


def test_the_map_is_drawn_with_its_limits(published):
    ax = published.plot()
    reported = [text.get_text() for text in ax.get_legend().get_texts()]
    assert any("rise time" in t for t in reported)
    assert any(f"Kp {published.kp:.4g}" in t for t in reported)
