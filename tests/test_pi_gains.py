"""PI gains: every form and unit is one controller, and what comes back is what went in."""

from dataclasses import replace

import numpy as np
import pytest
from fitmodels.core.errors import UsageError
from fitmodels.ident.pi.gains import PiGains
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter

ROUNDING = 4e-16  # two multiplications and back: a few units of the last digit
gain = st.floats(1e-6, 1e6) | st.floats(-1e6, -1e-6)
positive = st.floats(1e-4, 1e4)
E = np.random.default_rng(1).standard_normal(60)


def answer(gains, e):
    """What a controller sends on errors e, no filter in the measurement."""
    return lfilter(*gains.forward, e)


@given(gain, positive, positive, st.sampled_from(["s", "min"]))
def test_standard_gains_give_back_their_integral_time(kp, ti, T, unit):
    gains = PiGains.standard(kp, ti, T, time_unit=unit)
    assert (gains.ti if unit == "s" else gains.ti_minutes) == pytest.approx(ti, rel=ROUNDING)
    assert gains.kp == kp


@given(gain, gain, positive)
def test_per_sample_and_per_minute_come_back(kp, ki, T):
    assert PiGains.from_per_sample(kp, ki, T).ki_per_sample == pytest.approx(ki, rel=ROUNDING)
    assert PiGains.from_per_minute(kp, ki, T).ki_per_minute == pytest.approx(ki, rel=ROUNDING)


@given(gain, gain, positive, positive)
def test_other_units_and_back_are_the_same_gains(kp, ki, factor, factor_y):
    gains = PiGains(kp, ki, 0.02, low=-3.0, high=7.0, rate=2.0, unit_u="V", unit_y="A")
    back = gains.in_units("mm/min", factor, "N", factor_y).in_units("V", 1 / factor, "A", 1 / factor_y)
    for name in ("kp", "ki", "low", "high", "rate"):
        assert getattr(back, name) == pytest.approx(getattr(gains, name), rel=3 * ROUNDING)
    assert (back.unit_u, back.unit_y) == ("V", "A")


def test_volts_through_the_stated_scaling_are_feeds():
    fed = PiGains(0.8, 1.6, 0.02, high=10.0, rate=1.0, unit_u="V", unit_y="A").in_units("mm/min", 1459.0)
    assert (fed.kp, fed.ki, fed.high, fed.rate) == (0.8 * 1459, 1.6 * 1459, 14590.0, 1459.0)
    assert fed.ti == 0.5
    assert (fed.unit_u, fed.unit_y) == ("mm/min", "A")


@given(gain, gain, positive)
def test_a_command_in_other_units_is_the_same_command_scaled(kp, ki, factor):
    gains = PiGains(kp, ki, 0.02, average=3, average_of="command", delay=2)
    np.testing.assert_allclose(
        answer(gains.in_units("x", factor), E), factor * answer(gains, E), rtol=1e-9, atol=1e-9 * factor * abs(kp)
    )


def sums(e, T, rule):
    """Running integral of e by each rule, written out."""
    before = np.r_[0.0, e[:-1]]
    return T * np.cumsum({"backward": e, "forward": before, "trapezoidal": (e + before) / 2}[rule])


@pytest.mark.parametrize("rule", ["backward", "forward", "trapezoidal"])
def test_each_form_answers_as_its_equation_reads(rule):
    kp, ki, T = 1.3, 4.0, 0.05
    S = sums(E, T, rule)
    position = answer(PiGains(kp, ki, T, integration=rule), E)
    np.testing.assert_allclose(position, kp * E + ki * S, atol=1e-12)
    incremental = answer(PiGains(kp, ki, T, "incremental", rule), E)
    np.testing.assert_allclose(
        incremental, np.cumsum(kp * np.diff(E, prepend=0) + ki * np.diff(S, prepend=0)), atol=1e-12
    )
    np.testing.assert_allclose(incremental, position, atol=1e-12)
    summed = answer(PiGains(kp, ki, T, "incremental_sum", rule), E)
    np.testing.assert_allclose(summed, np.cumsum(kp * E + ki * S), atol=1e-11)


def test_equation_16_as_worded_adds_to_the_last_command_at_every_sample():
    # CLM-2023 eq. 16, doi 10.1109/ACCESS.2023.3330587: U = U0 + Kp e + Ki sum of e, U0 the last control signal
    gains, u, total, out = PiGains.from_per_sample(160.0, 0.006, 0.02, form="incremental_sum"), 0.0, 0.0, []
    for e in E:
        total += e
        u = u + 160.0 * e + 0.006 * total
        out.append(u)
    np.testing.assert_allclose(answer(gains, E), out, rtol=1e-9, atol=1e-9)


def test_the_whole_controller_is_form_average_delay_and_low_pass():
    gains = PiGains(2.0, 3.0, 0.1, delay=2, filter_time=0.3, average=4)
    num, den = gains.transfer_function
    keep = np.exp(-0.1 / 0.3)
    seen = lfilter([1 - keep], [1, -keep], np.convolve(E, np.full(4, 0.25))[: len(E)])
    np.testing.assert_allclose(
        lfilter(num, den, E), np.r_[0, 0, (2 * seen + 3 * sums(seen, 0.1, "backward"))[:-2]], atol=1e-12
    )


def test_without_integral_action_nothing_integrates():
    gains = PiGains(2.0, 0.0, 0.1)
    assert [p.tolist() for p in gains.transfer_function] == [[2.0], [1.0]]
    assert gains.ti == np.inf
    assert PiGains.standard(2.0, np.inf, 0.1) == gains


@pytest.mark.parametrize(
    ("change", "reported"),
    [
        ({"kp": np.nan}, "kp nan"),
        ({"ki": np.inf}, "ki inf"),
        ({"sample_time": 0.0}, "sample_time 0.0"),
        ({"rate": -1.0}, "rate -1.0"),
        ({"tracking_time": 0.0}, "tracking_time 0.0"),
        ({"filter_time": -0.1}, "filter_time -0.1"),
        ({"delay": 1.5}, "delay 1.5"),
        ({"delay": True}, "delay True"),
        ({"average": 0}, "average 0"),
        ({"form": "velocity"}, "position, incremental, incremental_sum"),
        ({"integration": "euler"}, "backward, forward, trapezoidal"),
        ({"anti_windup": "clamp"}, "clamping, back_calculation, none"),
        ({"average_of": "error"}, "measurement, command"),
        ({"low": 2.0, "high": 1.0}, "low lies below high"),
        ({"high": np.inf}, "None for no limit"),
    ],
)
def test_what_cannot_run_is_refused_with_what_was_given(change, reported):
    with pytest.raises(UsageError, match=reported):
        replace(PiGains(1.0, 1.0, 0.02), **change)


@pytest.mark.parametrize(
    "call",
    [
        lambda: PiGains.standard(1.0, 0.0, 0.02),
        lambda: PiGains.standard(1.0, 1.0, 0.02, time_unit="h"),
        lambda: PiGains(1.0, 1.0, 0.02).in_units("V", 0.0),
        lambda: PiGains(1.0, 1.0, 0.02).in_units("V", 1.0, "A", np.nan),
        lambda: PiGains.from_per_sample(1.0, 1.0, 0.0),
        lambda: PiGains.standard(1.0, 1.0, "0.02"),
    ],
)
def test_a_conversion_that_has_no_meaning_is_refused(call):
    with pytest.raises(UsageError):
        call()
