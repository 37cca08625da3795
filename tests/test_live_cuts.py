"""Cuts and windows of a running machine against signals of known truth."""

import json
from math import exp

import numpy as np
import pytest
from fitmodels.live.cuts import Cuts
from fitmodels.live.samples import CutEnd, Notice, Sample, Window

AT = {"V": 120.0, "f": 0.2, "d": 2.0}


def signal(parts, rate=50.0, noise=0.01, seed=1):
    """Times and values of levels held for some seconds, [(seconds, level), ...]; cuts above 1 are less quiet."""
    rng = np.random.default_rng(seed)
    values = np.concatenate([np.full(round(s * rate), level) for s, level in parts])
    return np.arange(len(values)) / rate, values + rng.normal(0, noise, len(values)) * np.where(
        np.abs(values) > 1, 3, 1
    )


def watch(cuts, times, name="P", **others):
    """What is found in samples of one load; ``others``: arrays or values of state, conditions, bad."""
    found = []
    for k, t in enumerate(times[0]):
        given = {key: value[k] if isinstance(value, list) else value for key, value in others.items()}
        found += cuts.add(Sample(float(t), {name: float(times[1][k])}, **{"conditions": AT, **given}))
    return found + cuts.close()


def windows(found):
    return [item for item in found if isinstance(item, Window)]


def ends(found):
    return [item for item in found if isinstance(item, CutEnd)]


def texts(found):
    return [item.text for item in found if isinstance(item, Notice)]


def contact(found):
    return 60 * sum(item.contact for item in found if isinstance(item, (Window, CutEnd)))


def test_windows_hold_the_mean_above_idle_and_all_of_the_time():
    found = watch(Cuts(), signal([(6, 0.8), (40, 1.8), (6, 0.8), (15, 1.3), (5, 0.8)], noise=0.03))
    assert [end.cut for end in ends(found)] == [1, 2]
    assert [round(exp(w.loads["P"].ln), 1) for w in windows(found)] == [1.0] * 4 + [0.5] * 2
    assert all(0.0005 < w.loads["P"].se < 0.02 for w in windows(found))
    assert contact(found) == pytest.approx(55, abs=0.5)
    assert windows(found)[0].conditions == pytest.approx(AT)


@pytest.mark.parametrize(("level", "noise"), [(2.0, 0.0), (160.0, 0.0), (0.8, 0.01)])
def test_a_run_without_a_cut_says_what_was_read(level, noise):
    """A stuck sensor, or the column of another quantity."""
    found = watch(Cuts(), signal([(300, level)], rate=2.0, noise=noise))
    (text,) = texts(found)
    assert text.startswith("no cut was found in 4.9")
    assert "Check which column" in text


def test_outliers_and_short_peaks_count_little():
    t, load = signal([(6, 0.8), (30, 1.8), (6, 0.8)])
    load[20::37] += 40.0
    load[200:220] = 5.0  # s 4.0 to 4.4: no cut
    found = watch(Cuts(), (t, load))
    assert len(ends(found)) == 1
    assert [exp(w.loads["P"].ln) for w in windows(found)] == pytest.approx([1.0] * 3, abs=0.02)


def test_another_feed_begins_another_window():
    t, load = signal([(6, 0.8), (20, 1.8), (20, 2.3), (6, 0.8)])
    feeds = [{"f": 0.2 if x < 26 else 0.3, "V": 120.0} for x in t]
    found = watch(Cuts(seconds=15.0), (t, load), conditions=feeds)
    assert [round(w.conditions["f"], 2) for w in windows(found)] == [0.2, 0.2, 0.3, 0.3]
    assert [exp(w.loads["P"].ln) for w in windows(found)] == pytest.approx([1.0, 1.0, 1.5, 1.5], abs=0.01)


def test_speed_and_feed_follow_from_spindle_and_feed_rate():
    given = {"n": 1000.0, "D": 50.0, "fm": 150.0}
    found = watch(Cuts(constants={"d": 2.0}), signal([(6, 0.8), (12, 1.8), (6, 0.8)]), conditions=given)
    assert windows(found)[0].conditions["V"] == pytest.approx(157.08, abs=0.01)
    assert windows(found)[0].conditions["f"] == pytest.approx(0.15)
    assert windows(found)[0].conditions["d"] == 2.0


def test_feeding_in_the_air_is_no_cut():
    found = watch(Cuts(), signal([(30, 0.8)]), state="feed")
    assert found == []


def test_what_the_machine_says_is_certain():
    t, load = signal([(6, 0.8), (20, 1.8), (4, 1.5), (5, 0.8)])
    said = ["idle" if x < 6 or x >= 26 else "feed" for x in t]  # a load that rose although the feed stands
    found = watch(Cuts(), (t, load), state=said)
    assert [round(end.time) for end in ends(found)] == [26]
    assert contact(found) == pytest.approx(20, abs=0.3)


def test_a_signal_lost_in_mid_cut_ends_it_as_lost():
    cuts = Cuts()
    t, load = signal([(6, 0.8), (15.5, 1.8)])
    found = []
    for time, value in zip(t, load, strict=True):
        found += cuts.add(Sample(time, {"P": value}, AT))
    found += cuts.add(Notice(21.5, "lost", "the server does not answer"))
    assert [end.lost for end in ends(found)] == [True]
    assert contact(found) == pytest.approx(15.5, abs=0.3)
    t, load = signal([(8, 1.8), (5, 0.8)], seed=2)
    for time, value in zip(t, load, strict=True):  # 40 s later: still in the cut
        found += cuts.add(Sample(60 + time, {"P": value}, AT))
    assert len(ends(found)) == 2
    assert contact(found) == pytest.approx(23.5, abs=0.6)
    assert exp(windows(found)[-1].loads["P"].ln) == pytest.approx(1.0, abs=0.02)


def test_readings_that_stop_or_are_bad_end_a_cut_as_lost():
    t, load = signal([(6, 0.8), (20, 1.8)])
    bad = ["" if x < 20 else "BadSensorFailure" for x in t]
    found = watch(Cuts(), (t, load), bad=bad)
    assert [end.lost for end in ends(found)] == [True]
    assert ends(found)[0].time == pytest.approx(21, abs=0.6)


@pytest.mark.parametrize("jump", [-3600.0, 3600.0])
def test_a_jump_of_the_clock_adds_no_time(jump):
    t, load = signal([(6, 0.8), (30, 1.8), (6, 0.8)])
    found = watch(Cuts(), (np.where(t < 20, t, t + jump), load))
    assert contact(found) == pytest.approx(30, abs=0.6)
    assert [end.lost for end in ends(found)] == [True, False]
    assert all(w.contact >= 0 and w.end > w.start for w in windows(found))


def test_a_short_gap_within_a_cut_counts_as_cutting():
    t, load = signal([(6, 0.8), (30, 1.8), (6, 0.8)])
    kept = (t < 15) | (t > 18)
    found = watch(Cuts(), (t[kept], load[kept]))
    assert [end.lost for end in ends(found)] == [False]
    assert contact(found) == pytest.approx(30, abs=0.5)


def test_a_watch_that_begins_in_a_cut_counts_its_time_and_not_its_load():
    found = watch(Cuts(), signal([(20, 1.8), (6, 0.8), (20, 1.6), (6, 0.8)], noise=0.03))
    assert contact(found) == pytest.approx(40, abs=1.5)
    assert "the 20 s before are counted" in texts(found)[0]
    assert "Connect while the machine idles" in texts(found)[0]
    assert [round(exp(w.loads["P"].ln), 1) for w in windows(found) if w.loads] == [0.8, 0.8]


def test_a_load_below_idle_in_the_cut_is_refused():
    t, load = signal([(6, 0.8), (20, 0.5), (6, 0.8)])
    said = ["feed" if 6 <= x < 26 else "idle" for x in t]
    found = watch(Cuts(), (t, load), state=said)
    assert not any(w.loads for w in windows(found))
    found = watch(Cuts(), signal([(6, 0.5), (20, -300.0), (6, 0.5)], noise=1.0), name="Fc")
    assert not any(w.loads for w in windows(found))
    assert contact(found) == pytest.approx(20, abs=0.5)
    assert "a cut must exceed idle. Reverse its sign" in texts(found)[-1]


@pytest.mark.parametrize("first", [8, 0])
def test_a_reversed_sign_is_never_taken_for_idle(first):
    parts = [(60, -2.5), (8, 0.8), (60, -2.6), (8, 0.8)]
    found = watch(Cuts(), signal([(first, 0.8), *parts] if first else parts))
    assert not any(w.loads for w in windows(found))
    assert contact(found) == pytest.approx(120, abs=2)
    assert "Reverse its sign" in texts(found)[-1]


def test_off_idle_and_cut_of_a_drive_are_three_states():
    cuts = Cuts()
    spindle = [
        (6, 0.01),
        (1.5, 3.0),
        (6, 0.8),
        (20, 1.8),
        (6, 0.8),
        (8, 0.01),
        (1.5, 3.0),
        (6, 0.8),
        (20, 2.3),
        (6, 0.8),
    ]
    found = watch(cuts, signal([*spindle, (6, 0.01)]), conditions={})
    used = [round(exp(w.loads["P"].ln), 1) for w in windows(found) if w.loads]
    assert used[-2:] == [1.5, 1.5]
    assert set(used) == {1.0, 1.5}
    assert contact(found) == pytest.approx(40, abs=1.0)
    assert cuts.idle["P"].level == pytest.approx(0.8, abs=0.02)


@pytest.mark.parametrize("air", [5, 20])
@pytest.mark.parametrize("rate", [1.0, 2.0, 50.0])
def test_a_run_from_a_small_idle_load_has_all_its_cuts(air, rate):
    """Power 0.15 kW when idle, about 4 kW in the cut, V given; in W."""
    scale = 1000.0
    t, load = signal([(air, 0.15), (120, 4.0)] * 3 + [(air, 0.15)], rate=rate)
    found = watch(Cuts(), (t, scale * load))
    assert texts(found) == []
    assert len(ends(found)) == 3
    assert contact(found) == pytest.approx(360, abs=6)
    assert [exp(w.loads["P"].ln) / scale for w in windows(found) if w.loads] == pytest.approx(
        [3.85] * len([w for w in windows(found) if w.loads]), rel=0.02
    )
    assert len([w for w in windows(found) if w.loads]) >= 30


def test_a_load_near_zero_at_rest_without_speed_is_learned_from_the_first_cut():
    t, load = signal([(10, 0.01), (60, 2.0)] * 3 + [(10, 0.01)])
    found = watch(Cuts(), (t, load), conditions={"f": 0.2})
    assert contact(found) == pytest.approx(180, abs=3)
    assert [exp(w.loads["P"].ln) for w in windows(found) if w.loads] == pytest.approx([1.99] * 12, abs=0.02)
    assert "are counted as cutting, without their loads" in texts(found)[0]


def test_a_spindle_that_stands_by_its_speed_is_off():
    cuts = Cuts()
    t, load = signal([(10, 0.01), (8, 0.8), (12, 1.8), (6, 0.8)])
    speeds = [{"n": 0.0 if x < 10 else 800.0, "D": 50.0} for x in t]
    assert cuts.state == "starting"
    found = watch(cuts, (t, load), conditions=speeds)
    assert exp(windows(found)[0].loads["P"].ln) == pytest.approx(1.0, abs=0.02)
    assert len(ends(found)) == 1


def test_one_sample_a_second_is_enough():
    found = watch(Cuts(), signal([(20, 0.8), (60, 1.8), (20, 0.8)], rate=1.0))
    assert contact(found) == pytest.approx(60, abs=2)
    assert exp(windows(found)[1].loads["P"].ln) == pytest.approx(1.0, abs=0.02)


def test_a_law_of_the_whole_load_keeps_the_idle_level():
    found = watch(Cuts(whole=["P"]), signal([(6, 0.8), (20, 1.8), (6, 0.8)]))
    assert exp(windows(found)[0].loads["P"].ln) == pytest.approx(1.8, abs=0.01)


def test_the_standard_error_covers_correlated_noise_and_a_drifting_idle_level():
    """At least .85 of nominal 95 % are asked for."""
    rng = np.random.default_rng(3)
    t, load = signal([(8, 0.8)] + [(30, 1.8), (8, 0.8)] * 20, noise=0.0)
    slow = np.zeros(len(t))
    for k in range(1, len(t)):
        slow[k] = 0.98 * slow[k - 1] + rng.normal(0, 0.01)
    drift = np.cumsum(rng.normal(0, 0.0006, len(t)))
    found = watch(Cuts(), (t, load + slow * (load > 1) + drift + rng.normal(0, 0.02, len(t))))
    errors = np.array([(w.loads["P"].ln, w.loads["P"].se) for w in windows(found) if w.loads])
    assert len(errors) > 55
    assert np.mean(np.abs(errors[:, 0]) < 1.96 * errors[:, 1]) >= 0.85
    assert np.median(errors[:, 1]) < 0.04


def test_a_state_that_a_load_contradicts_is_reported_and_no_longer_believed():
    t, load = signal([(6, 0.8), (40, 1.8), (6, 0.8)])
    found = watch(Cuts(), (t, load), conditions={"V": 120.0, "f": 0.0})  # a dead column of feed
    assert contact(found) == pytest.approx(40, abs=1)
    assert "the machine says idle: from here cuts follow from the load alone" in texts(found)[0]


def test_idle_levels_pass_through_json_and_serve_after_a_restart():
    cuts = Cuts()
    watch(cuts, signal([(6, 0.8), (30, 1.8), (6, 0.8)]))
    resumed = Cuts()
    resumed.resume(json.loads(json.dumps(cuts.as_json())))
    assert resumed.as_json() == cuts.as_json()
    t, load = signal([(20, 1.8), (5, 0.8)])
    found = watch(resumed, (t + 60, load))
    assert exp(windows(found)[0].loads["P"].ln) == pytest.approx(1.0, abs=0.02)
    assert windows(found)[0].cut == 2


def test_another_spindle_speed_moves_the_idle_level():
    t, load = signal([(6, 0.8), (12, 1.8), (6, 0.8), (6, 1.2), (12, 2.2), (6, 1.2)])
    speeds = [{"n": 800.0 if x < 24 else 1200.0, "D": 50.0, "f": 0.2} for x in t]
    found = watch(Cuts(), (t, load), conditions=speeds)
    assert contact(found) == pytest.approx(24, abs=1)
    assert [exp(w.loads["P"].ln) for w in windows(found) if w.loads] == pytest.approx([1.0] * 4, abs=0.03)


def test_equal_times_and_conditions_given_once_are_kept():
    t, load = signal([(6, 0.8), (12, 1.8), (6, 0.8)])
    given = [AT if k == 0 else {} for k in range(len(t))]
    found = watch(Cuts(), (np.floor(t * 25) / 25, load), conditions=given)
    assert windows(found)[0].conditions == pytest.approx(AT)
    assert [end.lost for end in ends(found)] == [False]


def test_without_any_load_the_feed_of_the_machine_counts():
    t = np.arange(0, 60, 0.1)
    found, cuts = [], Cuts()
    for x in t:
        found += cuts.add(Sample(float(x), {}, AT, "feed" if 10 <= x < 45 else "idle"))
    found += cuts.close()
    assert contact(found) == pytest.approx(35, abs=0.5)
    assert windows(found)[0].conditions == pytest.approx(AT)
    assert windows(found)[0].loads == {}


def test_a_load_that_is_stuck_is_refused():
    t, load = signal([(6, 0.8), (12, 1.8), (6, 0.8), (20, 1.8), (6, 0.8)])
    load[(t > 26) & (t < 44)] = 1.8123
    found = watch(Cuts(seconds=5.0), (t, load))
    stuck = [w for w in windows(found) if w.start > 31 and w.end < 44]
    assert stuck
    assert not any(w.loads for w in stuck)
    assert "P stands still at 1.812 in the cut" in texts(found)[0]
    assert contact(found) == pytest.approx(32, abs=1)


def test_conditions_that_never_stand_still_give_windows_without_loads():
    t, load = signal([(6, 0.8), (120, 1.8), (6, 0.8)])
    feeds = [{"V": 120.0, "f": 0.2 if int(x) % 2 else 0.4} for x in t]
    found = watch(Cuts(), (t, load), conditions=feeds)
    assert len(windows(found)) > 4
    assert contact(found) == pytest.approx(120, abs=1)
    assert np.average([w.conditions["f"] for w in windows(found)], weights=[w.contact for w in windows(found)]) == (
        pytest.approx(0.3, abs=0.03)
    )


def test_a_feed_without_readings_counts_until_they_are_back():
    t, load = signal([(6, 0.8), (40, 1.8), (6, 0.8)])
    said = ["idle" if x < 6 or x >= 46 else "feed" for x in t]
    bad = ["BadSensorFailure" if 20 <= x < 35 else "" for x in t]
    found = watch(Cuts(), (t, load), state=said, bad=bad)
    assert contact(found) == pytest.approx(40, abs=2.5)
    assert [end.lost for end in ends(found)] == [True, False, False]


def test_an_interrupted_cut_is_found_with_the_spindle_speed_and_named_without():
    t, load = signal([(12, 0.8), (40, 1.8), (12, 0.8)])
    load = np.where((t % 1 < 0.6) & (load > 1), 0.8, load)  # 60 revolutions a minute, in the work for .4 of each
    assert "leaves idle again and again" in texts(watch(Cuts(), (t, load)))[0]
    found = watch(Cuts(constants={"n": 60.0}), (t, load))
    assert contact(found) == pytest.approx(40, abs=2)
    assert [exp(w.loads["P"].ln) for w in windows(found) if w.loads] == pytest.approx([0.4] * 4, abs=0.03)


def with_states(parts, **other):
    """Times and values of levels, (seconds, level, state), and the state of each sample."""
    times = signal([(seconds, level) for seconds, level, _ in parts], **other)
    return times, [state for seconds, _, state in parts for _ in range(round(seconds * other.get("rate", 50.0)))]


IN_CUT = [(60, 2.0, "feed"), (15, 0.5, "idle"), (60, 2.0, "feed"), (10, 0.5, "idle")]


def test_a_source_that_begins_in_a_cut_counts_it_without_its_loads():
    """It was left out in silence where the machine says that it feeds."""
    times, states = with_states(IN_CUT)
    for found in (watch(Cuts(), times, state=states), watch(Cuts(), times)):
        first, *others = windows(found)
        assert first.contact == pytest.approx(1.0, abs=0.03)
        assert first.loads == {}
        assert [(end.lost, end.unseen) for end in ends(found)] == [(False, True), (False, False)]
        assert [exp(window.loads["P"].ln) for window in others] == pytest.approx([1.5] * len(others), rel=0.02)


def test_a_feed_in_the_air_before_the_first_idle_is_no_cut():
    times, states = with_states([(6, 0.5, "feed"), (15, 0.5, "idle"), (60, 2.0, "feed"), (10, 0.5, "idle")])
    found = watch(Cuts(), times, state=states)
    assert [end.unseen for end in ends(found)] == [False]
    assert sum(each.contact for each in windows(found)) == pytest.approx(1.0, abs=0.03)


def test_a_first_cut_that_a_loss_of_the_signal_divides_counts_and_one_that_never_ends_is_said():
    (times, values), states = with_states(IN_CUT)
    seen = (times < 20) | (times > 30)
    found = watch(Cuts(), (times[seen], values[seen]), state=[s for s, kept in zip(states, seen, strict=True) if kept])
    assert windows(found)[0].contact == pytest.approx(50 / 60, abs=0.05)
    times, states = with_states([(90, 2.0, "feed")])
    assert ["--used 1.49min" in text for text in texts(watch(Cuts(), times, state=states))] == [True]


def test_a_load_that_stands_still_does_not_contradict_the_machine():
    (times, values), states = with_states([(15, 0.5, "idle"), (60, 2.0, "feed")] * 3 + [(10, 0.5, "idle")])
    values[times > 40] = 6.1
    found = watch(Cuts(), (times, values), state=states)
    assert len(ends(found)) == 3
    assert sum(each.contact for each in windows(found)) == pytest.approx(3.0, abs=0.05)
    assert any("stands still at 6.1" in text for text in texts(found))
    assert not any("the machine says" in text for text in texts(found))


@pytest.mark.parametrize(("rate", "approach"), [(1.0, 1), (1.0, 3), (50.0, 1), (50.0, 3)])
def test_a_spindle_that_stops_between_cuts_and_idles_only_briefly_loses_no_cut(rate, approach):
    """Its load was taken as idle from the second cut on, in silence, or no cut was found at all."""
    part = [(20, 0.02, "off"), (approach, 0.9, "idle"), (60, 5.0, "feed"), (1, 0.9, "idle")]
    times, states = with_states([*part * 4, (20, 0.02, "off")], rate=rate, noise=0.02)
    found = watch(Cuts(), times, state=states)
    assert sum(each.contact for each in (*windows(found), *ends(found))) == pytest.approx(4.0, abs=0.15)


@pytest.mark.parametrize(("seconds", "lost"), [(30, False), (60, True)])
def test_feed_in_the_air_is_lost_contact_from_three_times_the_longest_before(seconds, lost):
    """12 s of approach before each of four cuts; then 30 s of it are usual, and 60 s are not."""
    usual = [(4, 0.8, "idle"), (12, 0.8, "feed"), (10, 1.8, "feed")]
    times, said = with_states([*usual * 4, (4, 0.8, "idle"), (seconds, 0.8, "feed"), (4, 0.8, "idle")], rate=10.0)
    found = watch(Cuts(), times, state=said)
    assert [item.kind for item in found if isinstance(item, Notice)] == ["load"] * lost


def test_a_load_that_falls_in_the_cut_and_one_whose_idle_level_is_uncertain_are_distinguished():
    reversed_sign = [(15, -0.5, "idle"), (30, -2.0, "feed"), (15, -0.5, "idle")]
    times, states = with_states(reversed_sign)
    assert any("--scale P=-1" in text for text in texts(watch(Cuts(), times, state=states)))
