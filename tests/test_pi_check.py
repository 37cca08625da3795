"""The readings of Kp 160 and Ki 0.006 of Tai, Tsai & Li 2023 on its plant, eq. 18, doi 10.1109/ACCESS.2023.3330587."""

from dataclasses import replace

import numpy as np
import pytest
from fitmodels.core.errors import IdentError, UsageError
from fitmodels.ident.model import Model
from fitmodels.ident.pi.published_gains import check_pi
from fitmodels.ident.pi.specification import Specification

PUBLISHED = Model(
    b=[0.0, 0.0611, -0.1338, 0.0752], a=[1.0, -2.0311, 1.2104, -0.1655], nk=1, sample_time=0.02, unit_u="V", unit_y="A"
)
# The intervals were computed apart from this package, settling counted in whole samples (0.02 s of 4 s): 1 % of an end.
WITHIN = 0.01


@pytest.fixture(scope="module")
def check():
    return check_pi(PUBLISHED, 160.0, 0.006, rise_time=2.0, settling_time=4.0)


def find(check, *words):
    found = [r for r in check.interpretations if all(w in r.words for w in words)]
    assert len(found) == 1, [r.words for r in found]
    return found[0]


@pytest.mark.parametrize("words", [("per second",), ("per sample",)])
def test_position_form_in_feed_never_meets_it(check, words):
    reading = find(check, "position", "mm/min", *words)
    assert reading.meets == ()
    assert reading.stable[0][0] == pytest.approx(160 / 7.868, rel=1e-3)  # above 7.868 V/A the plant is unstable


@pytest.mark.parametrize(
    ("words", "low", "high"),
    [
        (("incremental", "per sample"), 540, 1835),
        (("integral time 0.006 min",), 39, 68),
        (("integral time 0.006 s",), 1780, 6050),
    ],
)
def test_a_reading_meets_it_between_two_scalings(check, words, low, high):
    reading = find(check, "mm/min", *words)
    assert len(reading.meets) == 1
    assert reading.meets[0] == pytest.approx((low, high), rel=WITHIN)
    assert reading.stable[0][0] < reading.meets[0][0]


def test_in_volts_per_ampere_no_reading_is_stable(check):
    for reading in (r for r in check.interpretations if not r.scaled):
        assert (reading.stable, reading.meets) == ((), ())
    assert len([r for r in check.interpretations if not r.scaled]) == 6


def test_the_ends_of_an_interval_are_where_the_loop_ceases_to_meet_it(check):
    reading = find(check, "mm/min", "incremental", "per sample")
    asked = Specification(rise_time=2.0, settling_time=4.0)
    for end, other in zip(reading.meets[0], (0.999, 1.001), strict=True):
        inside, outside = (check_pi_at(reading.gains, end * f) for f in (1 / other, other))
        assert asked.worst(inside) == 0
        assert asked.worst(outside) > 0


def check_pi_at(gains, scaling):
    from fitmodels.ident.pi.loop import loop_of

    return loop_of(PUBLISHED, gains.in_units("V", 1 / scaling)).figures(duration=40.0)


def test_the_table_and_the_sentence_tell_it(check):
    assert list(check.table.columns)[1:] == ["stable (mm/min per V)", "meets the specification (mm/min per V)"]
    assert len(check.table) == 12
    assert "incremental" in check.verdict
    assert "4 can meet" in check.verdict


def test_another_unit_of_the_command_scales_the_intervals():
    one, ten = (
        check_pi(replace(PUBLISHED, b=PUBLISHED.b / k), 160.0, 0.006, settling_time=4.0).interpretations[-1]
        for k in (1.0, 10.0)
    )
    np.testing.assert_allclose(np.array(one.meets) / 10, ten.meets, rtol=1e-6)


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        (lambda: check_pi(PUBLISHED, 160.0, 0.006), IdentError, "no limits"),
        (lambda: check_pi(PUBLISHED, -160.0, 0.006, 2.0), IdentError, "above zero"),
        (
            lambda: check_pi(PUBLISHED, 1.0, 1.0, 2.0, specification=Specification(ms=1.3)),
            UsageError,
            "include them in it",
        ),
    ],
)
def test_what_cannot_be_checked_is_refused(call, error, words):
    with pytest.raises(error, match=words):
        call()
