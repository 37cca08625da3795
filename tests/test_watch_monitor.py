"""The state of a watch: it follows from its records alone, counts unseen cutting on the safe side, and is checked."""

import json
import sys
from pathlib import Path

import pytest
from fitmodels.core.errors import UsageError
from fitmodels.live.facts import Reading, facts_of
from fitmodels.live.monitor import Monitor
from fitmodels.live.watch_edge import WatchSettings

sys.path.insert(0, str(Path(__file__).parent))

from watched_edge import CONDITIONS, IDENTITY, laws, monitor, records

sys.path.remove(str(Path(__file__).parent))


def applied(found, of=None):
    of = of or monitor()
    for record in found:
        of.apply(record)
    return of


def test_the_same_records_give_the_same_state_also_through_json_and_a_snapshot_at_any_place():
    story = [
        *records(20),
        {"kind": "gauge", "time": 210.0, "wear": 0.15, "sd_ln": 0.02, "request": "0f"},
        {"kind": "alarm", "time": 220.0, "kind_of_alarm": "lost", "text": "lost", "latched": True},
        {"kind": "edge", "time": 230.0},
        *records(10, start=230.0),
        {"kind": "contact", "time": 340.0, "minutes": 0.1, "conditions": CONDITIONS},
    ]
    whole = applied(story).as_json()
    for place in (0, 7, 22, 25, len(story)):
        restored = monitor()
        restored.restore(json.loads(json.dumps(applied(story[:place]).as_json())))
        assert applied(json.loads(json.dumps(story[place:])), restored).as_json() == whole


def test_the_decision_to_change_comes_before_the_criterion_is_passed_and_stays():
    found = monitor(criterion=0.25, next_cut=1.0)
    for record in records(240):
        found.apply(record)
        if found.decisions and found.decisions[-1]["kind"] == "change":
            break
    assert found.estimate.probability_past() < 0.06
    applied([{"kind": "cutend", "time": 1.0, "contact": 0.0, "lost": False}], found)
    assert found.decisions[-1]["kind"] == "change"
    found.apply({"kind": "gauge", "time": 2.0, "wear": 0.2, "sd_ln": 0.02})
    assert found.decisions[-1]["kind"] == "go on"


def test_a_gauge_reading_narrows_the_wear_and_is_taken_once():
    found = applied(records(30))
    before = found.estimate.wear()
    request = {"kind": "gauge", "time": 301.0, "wear": before.median, "sd_ln": 0.02, "request": "a1"}
    once = applied([request], applied(records(30)))
    twice = applied([request, request], found)
    assert twice.as_json() == once.as_json()
    after = twice.estimate.wear()
    assert after.high / after.low < 0.9 * before.high / before.low


def test_a_signal_lost_in_mid_cut_counts_as_cutting_up_to_the_longest_cut():
    found = applied(records(12))
    assert found.cuts == [pytest.approx(1.02), pytest.approx(1.02)]
    windows = [record for record in records(14) if record["kind"] == "window"]
    applied([*windows[12:], {"kind": "cutend", "time": 140.0, "contact": 0.0, "lost": True}], found)
    assert found.lost["cut"] == pytest.approx(1 / 3)
    minutes, text = found.gap_minutes(140.0 + 30)
    assert minutes == pytest.approx(0.5)
    assert "all of it" in text
    minutes, text = found.gap_minutes(140.0 + 3600)
    assert minutes == pytest.approx(1.02 - 1 / 3)
    assert "longest cut" in text
    before, wear = found.edge.minutes, found.estimate.wear().median
    applied([{"kind": "gap", "time": 3740.0, "minutes": minutes, "text": text}], found)
    assert found.edge.minutes == pytest.approx(before + minutes)
    assert found.estimate.wear().median > wear
    assert found.lost is None


def test_a_clock_set_back_while_the_signal_was_lost_is_said_and_counts_the_rest_of_the_longest_cut():
    found = applied(
        [*records(6), *list(records(8))[7:], {"kind": "cutend", "time": 80.0, "contact": 0.0, "lost": True}]
    )
    minutes, text = found.gap_minutes(-5000.0)
    assert 0 < minutes < 1.02
    assert "set back" in text
    assert "Gauge" in text


def test_what_a_killed_process_had_seen_of_the_open_cut_is_counted_once():
    contact = {"kind": "contact", "time": 66.0, "minutes": 0.08, "conditions": CONDITIONS}
    found = applied([*list(records(6))[:6], contact])
    before = found.edge.minutes
    found.apply({"kind": "resumed", "time": 66.0, "since": 66.0, "text": "taken up again"})
    assert found.edge.minutes == pytest.approx(before + 0.08)
    assert found.lost["since"] == 66.0
    assert found.open is None


def test_a_window_without_a_condition_that_was_never_known_is_said_and_changes_nothing():
    record = {**next(iter(records(1))), "conditions": {"V": 150.0}}
    found = applied([record])
    assert found.edge.minutes == 0
    assert ["f is not known" in alarm["text"] for alarm in found.alarms] == [True]


def test_no_go_on_at_conditions_far_from_the_tests_and_the_unit_that_fits_is_named():
    """A speed in m/s under m/min; the laws were tested at 50 to 200 m/min."""
    near, far = ([{**one, "conditions": {**CONDITIONS, "V": V}} for one in records(6)] for V in (17.0, 2.5))
    assert applied(near).decisions[-1]["kind"] == "go on"
    found = applied(far)
    assert found.decisions[-1]["kind"] == "not known"
    assert (
        "V 2.5 m/min is far from the tested 50 to 200 (in m/s it would be 150 m/min: --unit V=m/s)"
        in (found.decisions[-1]["text"])
    )
    assert [alarm["kind"] for alarm in found.alarms] == ["conditions"]
    facts = facts_of(found, Reading())
    assert facts["wear"]["reason"] == "not known: V far from the tests"
    assert facts["life"] is None
    applied([{"kind": "acknowledge", "time": 100.0}, *near[-2:]], found)
    assert found.decisions[-1]["kind"] == "go on"


@pytest.mark.parametrize("name", ["tool", "work", "content"])
def test_a_journal_of_another_edge_or_file_is_refused(name):
    state = applied(records(3)).as_json()
    other = Monitor(laws(), WatchSettings(criterion=0.3), {**IDENTITY, name: "other"})
    with pytest.raises(UsageError, match="--journal"):
        other.restore(state)


def test_facts_are_json_before_anything_was_read_and_after():
    for found, now in ((monitor(), Reading()), (applied(records(12)), Reading(time=120.0, loads={"P": float(2)}))):
        facts = facts_of(found, now)
        json.dumps(facts, allow_nan=False)
        assert facts["wear"]["symbol"] == "AW"
    assert facts["probability_past_after_next_cut"] >= facts["probability_past"]
    assert facts["life"]["low"] < facts["life"]["median"]


def test_alarms_stay_until_they_are_acknowledged_or_an_edge_begins():
    alarm = {"kind": "alarm", "time": 1.0, "kind_of_alarm": "lost", "text": "lost: a", "latched": True}
    found = applied([alarm, alarm])
    assert [one["kind"] for one in found.alarms] == ["lost"]
    assert applied([{"kind": "acknowledge", "time": 2.0}], found).alarms == []
    assert applied([alarm, {"kind": "edge", "time": 3.0}]).alarms == []


def test_a_note_is_said_whatever_was_noted_before():
    found = monitor()
    for k in range(30):
        found.note(1.0 * k, f"note {k}")
        assert found.take_messages() == [f"note {k}"]
    assert len(found.notes) == 12


def test_a_gauge_reading_before_any_cut_is_refused_and_changes_nothing():
    found = monitor()
    before = found.estimate.as_json()
    found.apply({"kind": "gauge", "time": 1.0, "wear": 0.1, "sd_ln": 0.02})
    assert found.estimate.as_json() == before
    assert found.edge.gauges == 0
    assert "--used" in found.refused[0]


def test_a_right_reading_is_taken_after_a_wrong_one_when_it_is_certain():
    found = applied(records(60))
    right = found.estimate.wear().median
    found.apply({"kind": "gauge", "time": 700.0, "wear": 0.75 * right, "sd_ln": 0.02})
    found.apply({"kind": "gauge", "time": 701.0, "wear": right, "sd_ln": 0.02})
    assert "--certain" in found.refused[0]
    assert found.estimate.wear().median < 0.85 * right
    found.apply({"kind": "gauge", "time": 702.0, "wear": right, "sd_ln": 0.02, "certain": True})
    assert found.estimate.wear().median == pytest.approx(right, rel=0.01)
    assert [mark.wear for mark in found.edge.summary.marks] == [right]


def test_minutes_before_the_watch_count_once_and_make_the_edge_older():
    used, whole = monitor(), monitor()
    request = {"kind": "used", "time": None, "minutes": 8.0, "conditions": CONDITIONS}
    applied([request, request], used)
    whole.estimate.advance(8.0, CONDITIONS)
    assert used.edge.minutes == 8.0
    assert used.estimate.wear() == whole.estimate.wear()
    assert used.edge.summary.gaps == 1
    assert "already" in used.refused[0]
    unknown = applied([{"kind": "used", "time": None, "minutes": 8.0}])
    assert unknown.edge.minutes == 8.0


def test_the_wear_shown_holds_the_open_cut_and_is_unknown_where_its_conditions_are():
    found = monitor()
    now = Reading(time=5.0, state="cutting", open=0.5, conditions=CONDITIONS)
    shown = facts_of(found, now)
    found.estimate.advance(0.5, CONDITIONS)
    assert shown["wear"]["median"] == pytest.approx(found.estimate.wear().median, rel=1e-3)
    assert shown["life"]["median"] == pytest.approx(found.estimate.life().median, rel=0.01)
    unknown = facts_of(monitor(), Reading(time=5.0, state="cutting", open=0.5, conditions={"V": 150.0, "f": 0.2}))
    assert unknown["wear"]["median"] is None
    assert "d is not known" in unknown["wear"]["reason"]
