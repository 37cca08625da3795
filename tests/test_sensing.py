"""Whether a reading can be believed: range, and a sensor that stands still while the feed moves."""

import pytest
from fitmodels.controllers.sensor_check import CREEP, SensorCheck
from hypothesis import given
from hypothesis import strategies as st


def states(readings, commands, **more):
    sensing = SensorCheck(**{"low": -1.0, "high": 10.0, "least_move": 0.02, **more})
    for reading, command in zip(readings, commands, strict=True):
        sensing.valid(reading, command)
        yield sensing.state


@pytest.mark.parametrize("reading", [float("nan"), float("inf"), -1.0, 10.0, 11.0])
def test_a_reading_outside_its_range_is_none(reading):
    assert list(states([0.2, reading, 0.3], [1.0] * 3)) == ["known", "unknown", "known"]


def test_a_fast_move_on_one_reading_is_a_stuck_sensor_until_the_reading_changes():
    commands = [1.0 + 0.002 * k for k in range(40)]
    seen = list(states([0.2] * 39 + [0.21], commands))
    assert seen[24] == "known"
    assert set(seen[26:39]) == {"stuck"}
    assert seen[39] == "known"


def test_a_slow_creep_on_one_reading_is_told_in_the_end():
    step = 0.0002  # 0.005 in 25 samples: a quarter of the least move
    seen = list(states([0.2] * 2000, [1.0 + step * k for k in range(2000)]))
    assert seen.index("stuck") == pytest.approx(CREEP * 0.02 / step, abs=2)


def test_a_held_load_reads_the_same_for_ever_while_the_command_stands():
    assert set(states([0.24] * 5000, [0.8] * 5000)) == {"known"}


def test_a_coarse_sensor_that_changes_now_and_then_is_believed():
    readings = [0.24 + 0.01 * (k // 400 % 2) for k in range(4000)]
    assert set(states(readings, [1.0 - 0.0001 * k for k in range(4000)])) == {"known"}


@given(st.lists(st.floats(), max_size=60), st.floats(0, 1))
def test_what_is_believed_is_a_number_inside_the_range(readings, command):
    sensing = SensorCheck(low=-1.0, high=10.0, least_move=0.02)
    for reading in readings:
        if sensing.valid(reading, command):
            assert -1.0 < reading < 10.0
