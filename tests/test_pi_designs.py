"""Closed-form gains and the specification, against what others published."""

import numpy as np
import pytest
from fitmodels.core.errors import IdentError
from fitmodels.ident.model import Model
from fitmodels.ident.pi.designs import pi_by_margin
from fitmodels.ident.pi.lag_designs import half_rule, lag_and_delay, simc
from fitmodels.ident.pi.specification import Specification
from hypothesis import given, settings
from hypothesis import strategies as st

control = pytest.importorskip("control", reason="python-control tells the margins")
# eq. 18 of Tai, Tsai & Li 2023, doi 10.1109/ACCESS.2023.3330587
PUBLISHED = Model(b=[0.0, 0.0611, -0.1338, 0.0752], a=[1.0, -2.0311, 1.2104, -0.1655], nk=1, sample_time=0.02)
THREE_LAGS = ([1.0], [1.0, 3.0, 3.0, 1.0])
INTEGRATOR = Model(b=[0.0, 0.02], a=[1.0, -1.0], nk=1, sample_time=0.02)


def margin_of(loop):
    with np.errstate(all="ignore"):  # control divides by an integrator's zero frequency
        _, degrees, _, crossover = control.margin(loop)
    return degrees, crossover


@pytest.mark.parametrize(
    ("crossover", "kp", "ki", "margin"),
    [(0.5205, 1.14, 0.454, 60.0000), (1.0, 2.83, 0.0495, 43.9973)],
    ids=["a margin within reach", "a margin out of reach"],
)
def test_the_gains_a_vendor_publishes_come_back(crossover, kp, ki, margin):
    # mathworks.com/help/control/ug/pid-controller-design-at-the-command-line.html, plant 1/(s+1)^3, margin 60 degrees
    design = pi_by_margin(THREE_LAGS, crossover, 60)
    assert (float(f"{design.kp:.3g}"), float(f"{design.ki:.3g}")) == (kp, ki)
    assert round(design.phase_margin, 4) == margin
    assert bool(design.notes) == (margin < 60)


@given(crossover=st.floats(1.6, 6.0), margin=st.floats(35.0, 75.0))
@settings(deadline=None, max_examples=40)
def test_the_margin_that_is_told_is_the_margin_of_the_sampled_loop(crossover, margin):
    for rule, (late, early) in {"forward": (0, 1), "backward": (1, 0), "trapezoidal": (0.5, 0.5)}.items():
        try:
            d = pi_by_margin(PUBLISHED, crossover, margin, integration=rule)
        except IdentError:
            continue
        step = d.ki * 0.02
        loop = PUBLISHED.to_control() * control.tf([d.kp + late * step, early * step - d.kp], [1, -1], 0.02)
        assert abs(loop(np.exp(0.02j * crossover))) == pytest.approx(1, abs=1e-9)
        told = np.degrees(np.angle(-loop(np.exp(0.02j * crossover))))
        assert told == pytest.approx(d.phase_margin, abs=1e-8)


@pytest.mark.parametrize(
    ("plant", "sign"),
    [
        (INTEGRATOR, 1),
        (Model(b=[0.0, -0.02], a=[1.0, -1.0], nk=1, sample_time=0.02), -1),
        (Model(b=[0.0] * 20 + [0.02], a=[1.0, -0.98], nk=20, sample_time=0.02), 1),
        (Model(b=[0.0, 0.02], a=[1.0, -1.01], nk=1, sample_time=0.02), 1),
    ],
    ids=["integrating", "falling", "delayed", "unstable"],
)
def test_every_kind_of_plant_gets_a_stable_loop(plant, sign):
    d = pi_by_margin(plant, 1.5, 50)
    loop = plant.to_control() * control.tf([d.kp + d.ki * 0.02, -d.kp], [1, -1], 0.02)
    assert np.abs(control.feedback(loop, 1).poles()).max() < 1
    assert sign * d.kp >= 0
    assert sign * d.ki > 0
    assert margin_of(loop)[0] == pytest.approx(d.phase_margin, abs=1e-4)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: pi_by_margin(THREE_LAGS, 5.0), "lower crossover"),
        (lambda: pi_by_margin(PUBLISHED, 200.0), "half the sample rate"),
        (lambda: pi_by_margin(PUBLISHED, 2.0, -10), "between 0 and 180"),
        (lambda: simc(1.0, 1.0, 0.0), "above zero"),
        (lambda: lag_and_delay(INTEGRATOR), "stable model"),
    ],
    ids=["too fast", "above half the rate", "a negative margin", "no time at all", "an integrator"],
)
def test_what_cannot_be_designed_is_refused_with_the_cure(call, words):
    with pytest.raises(IdentError, match=words):
        call()


@pytest.mark.parametrize(
    ("lags", "delay", "inverse", "kp", "ti"),
    [([1, 0.2], 0.0, [], 5.5, 0.8), ([2, 1, 0.4, 0.2, 0.05, 0.05, 0.05], -0.08, [0.3], 0.85, 2.5)],
    ids=["1/((s+1)(0.2s+1))", "(-0.3s+1)(0.08s+1)/((2s+1)(s+1)(0.4s+1)(0.2s+1)(0.05s+1)^3)"],
)
def test_skogestads_examples_come_back(lags, delay, inverse, kp, ti):
    # Skogestad 2003, J. Process Control 13, 291, doi 10.1016/S0959-1524(02)00062-8, examples E1 and E2 of its table
    d = simc(1.0, *half_rule(lags, delay, inverse))
    assert d.kp == pytest.approx(kp, rel=2e-3)
    assert d.kp / d.ki == pytest.approx(ti, rel=2e-3)


def test_skogestads_integrating_example_comes_back():
    d = simc(1.0, np.inf, 1.69)  # the same table: k' = 1, theta = 1.69 give Kc 0.296 and tauI 13.5
    assert (round(d.kp, 3), round(d.kp / d.ki, 1)) == (0.296, 13.5)


def test_a_lag_and_a_delay_are_found_again():
    a = np.exp(-0.02 / 0.8)
    model = Model(b=[0.0] * 11 + [2 * (1 - a)], a=[1.0, -a], nk=11, sample_time=0.02)
    gain, lag, delay = lag_and_delay(model)
    assert gain == pytest.approx(2)
    assert lag == pytest.approx(0.8, rel=1e-3)
    assert delay == pytest.approx(0.2, abs=0.021)  # ten samples, and the hold


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        ({"overshoot": -0.1}, "0.02 is 2 %"),
        ({"rise_time": 0.0}, "above 0"),
        ({"ms": 0.9}, "above 1"),
        ({"rise_time": 4.0, "settling_time": 2.0}, "taken for each other"),
        ({"travel": float("nan")}, "leave it out"),
    ],
)
def test_a_limit_that_cannot_be_is_refused(limits, words):
    with pytest.raises(IdentError, match=words):
        Specification(**limits)
