"""Continuous and discrete forms of one machine: textbook pairs, scipy, python-control, and the way there and back."""

import numpy as np
import pytest
from fitmodels.core.errors import IdentError
from fitmodels.ident.continuous import ContinuousModel, NoContinuousForm, sampled, to_continuous
from fitmodels.ident.model import Model
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import cont2discrete

ROUND_TRIP = 1e-9  # poles up to 2.5 rad a sample and four of them: 3000 random plants came back within 4e-12

# Tai, Tsai & Li 2023, doi 10.1109/ACCESS.2023.3330587, eq. 18
PUBLISHED = Model(b=[0.0, 0.0611, -0.1338, 0.0752], a=[1.0, -2.0311, 1.2104, -0.1655], nk=1, sample_time=0.02)


@st.composite
def plants(draw):
    """Num, den, sample time: one to four stable poles, slower than the sampling can fold."""
    dt = draw(st.sampled_from([1e-3, 0.02, 0.5, 10.0]))
    poles = []
    for _ in range(draw(st.integers(1, 2))):
        re, im = draw(st.floats(0.05, 2.0)), draw(st.floats(0.05, 2.5))
        poles += [-re + 1j * im, -re - 1j * im] if draw(st.booleans()) else [-re]
    den = np.real(np.poly(np.array(poles) / dt))
    n = len(poles)
    m = draw(st.integers(0, n))
    coefficients = draw(st.lists(st.floats(0.1, 1.0), min_size=m + 1, max_size=m + 1))
    return np.array(coefficients) * dt ** -np.arange(n - m, n + 1.0), den, dt


def longer(p, n):
    return np.pad(p, (0, n - len(p)))


@pytest.mark.parametrize(
    ("num", "den", "b", "a"),
    [
        # Franklin, Powell & Workman 1998, Digital Control of Dynamic Systems, table of z-transforms behind a hold
        ([3.0], [1.0, 3.0], [0, 1 - np.exp(-0.6)], [1, -np.exp(-0.6)]),
        ([1.0], [1.0, 0.0], [0, 0.2], [1, -1]),
        ([1.0], [1.0, 0.0, 0.0], [0, 0.02, 0.02], [1, -2, 1]),
    ],
    ids=["a / (s + a)", "1 / s", "1 / s^2"],
)
def test_textbook_pairs(num, den, b, a):
    model = sampled(num, den, 0.2)
    np.testing.assert_allclose(model.b, b, atol=1e-14)
    np.testing.assert_allclose(model.a, a, atol=1e-14)
    back = to_continuous(model)
    np.testing.assert_allclose(np.r_[back.num, back.den], np.r_[num, den], atol=1e-9)


@settings(max_examples=100, deadline=None)
@given(plants())
def test_agrees_with_scipy(plant):
    num, den, dt = plant
    b, a, _ = cont2discrete((num, den), dt)
    model = sampled(num, den, dt)
    np.testing.assert_allclose(longer(model.b, len(a)), b.ravel(), atol=ROUND_TRIP * np.abs(b).max())
    np.testing.assert_allclose(model.a, a, atol=ROUND_TRIP)


@settings(max_examples=100, deadline=None)
@given(plants(), st.integers(0, 5))
def test_there_and_back(plant, late):
    num, den, dt = plant
    model = sampled(num, den, dt, delay=late * dt)
    form = to_continuous(model)
    if len(num) == len(den) and late:  # a direct path behind a delay: its numerator is one longer than a hold gives
        assert "z = 0" in str(form)
        return
    f = np.linspace(0, 0.5 / dt, 40)
    truth = ContinuousModel(num, den, late * dt).response(f)
    np.testing.assert_allclose(form.response(f), truth, atol=ROUND_TRIP * np.abs(truth).max())
    assert form.delay == pytest.approx(late * dt)
    again = form.sampled(dt)
    np.testing.assert_allclose(again.b, model.b, atol=ROUND_TRIP * np.abs(model.b).max())
    np.testing.assert_allclose(again.a, model.a, atol=ROUND_TRIP)


def test_published_plant_there_and_back():
    again = to_continuous(PUBLISHED).sampled(0.02)
    np.testing.assert_allclose(again.b, PUBLISHED.b, atol=1e-11)
    np.testing.assert_allclose(again.a, PUBLISHED.a, atol=1e-11)


def test_agrees_with_python_control():
    control = pytest.importorskip("control")
    plant = ContinuousModel([2.0, 5.0], [1.0, 2.0, 10.0])
    theirs = control.c2d(plant.to_control(), 0.05, method="zoh")
    ours = plant.sampled(0.05)
    np.testing.assert_allclose(ours.b[1:], theirs.num[0][0], atol=1e-12)
    np.testing.assert_allclose(ours.a, theirs.den[0][0], atol=1e-12)
    f = np.array([0.1, 1.0, 4.0])
    np.testing.assert_allclose(plant.response(f), plant.to_control()(2j * np.pi * f), rtol=1e-12)


@pytest.mark.parametrize("quarters", range(9))
@pytest.mark.parametrize("num", [[3.0], [2.0, 1.0], [1.0, 2.0, 1.0]], ids=["gain", "zero", "direct path"])
def test_delay_of_part_of_a_sample_is_what_four_times_the_rate_shows(quarters, num):
    """At a quarter of the sample time the delay is whole; scipy samples the plant there."""
    den, dt = [1.0, 1.2, 9.0], 0.2
    u = np.random.default_rng(3).standard_normal(60)
    b, a, _ = cont2discrete((num, den), dt / 4)
    fine = Model(b=np.r_[np.zeros(quarters), np.trim_zeros(b.ravel(), "b")], a=a, nk=quarters, sample_time=dt / 4)
    expected = fine.simulate(np.repeat(u, 4))[::4]
    np.testing.assert_allclose(sampled(num, den, dt, quarters * dt / 4).simulate(u), expected, atol=1e-12)


@pytest.mark.parametrize(
    ("b", "a", "nk", "says"),
    [
        ([0, 1.0], [1, 0.5], 1, "z = -0.5 alternates at every sample"),
        ([0, 1.0, 0.5], [1, -1.1, 0.3, 0.0, 0.0], 1, None),
        ([0, 1.0, 0.5], [1, -0.5], 1, "1 pole at z = 0"),
        ([0, 0, 1.0, 0.5, 0.1], [1.0], 2, "finite impulse response"),
        ([0, 1.0], [1, -0.5, 1e-9], 1, "decays within one sample"),
    ],
    ids=["negative pole", "zeros behind a are nothing", "b too long", "finite tail", "pole near zero"],
)
def test_where_there_is_no_continuous_form_it_says_why(b, a, nk, says):
    form = to_continuous(Model(b=b, a=a, nk=nk, sample_time=0.1))
    if says is None:
        assert isinstance(form, ContinuousModel)
    else:
        assert isinstance(form, NoContinuousForm)
        assert not form
        assert says in str(form)


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: sampled([1.0, 0.0, 0.0], [1.0, 1.0], 0.1), "degree 2, the denominator 1"),
        (lambda: sampled([1.0], [0.0], 0.1), "denominator that is not zero"),
        (lambda: sampled([1.0], [1.0, 1.0], 0.0), "sample time 0.0 s"),
        (lambda: sampled([1.0], [1.0, 1.0], 0.1, delay=-1.0), "delay -1.0 s"),
        (lambda: sampled([np.nan], [1.0, 1.0], 0.1), "finite coefficients"),
        (lambda: ContinuousModel([1.0], [1.0, 1.0], delay=0.3).to_control(), "delay 0.3 s"),
    ],
    ids=["improper", "no denominator", "no time", "negative delay", "nan", "delay to control"],
)
def test_refusals(call, says):
    with pytest.raises(IdentError) as error:
        call()
    assert says in str(error.value)


def test_gains_and_delays_alone():
    model = sampled([4.0], [2.0], 0.1, delay=0.25)
    assert (model.nk, model.b.tolist(), model.a.tolist()) == (3, [0, 0, 0, 2.0], [1.0])
    assert to_continuous(Model(b=[2.0], a=[1.0], nk=0, sample_time=0.1)).num.tolist() == [2.0]
    late = to_continuous(Model(b=[0, 0, 2.0], a=[1.0], nk=2, sample_time=0.1))
    assert "at z = 0" in str(late)  # a sample of delay counts as the hold's own: the rest is a tail
    assert ContinuousModel([1.0], [1.0, 0.0]).dc_gain == np.inf
