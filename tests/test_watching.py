"""The loop of a watch under the worst things: lost signal, jumping clock, another tool, a changed file, a full disk."""

import errno
import json
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from fitmodels.core.errors import FitmodelsError, UsageError
from fitmodels.live import watch_journal
from fitmodels.live.advice import Bounds
from fitmodels.live.cuts import Cuts
from fitmodels.live.monitor import Monitor
from fitmodels.live.samples import Notice
from fitmodels.live.watch_edge import WatchSettings
from fitmodels.live.watch_journal import WatchJournal, leave_request, read_journal, read_newest, replay
from fitmodels.live.watching import Watch, open_journal, request_record, take_requests

sys.path.insert(0, str(Path(__file__).parent))

from watched_edge import CONDITIONS, IDENTITY, laws, monitor, records, samples

sys.path.remove(str(Path(__file__).parent))


class Said:
    """An outlet that keeps what was said."""

    def __init__(self):
        self.sentences, self.facts = [], None

    def show(self, facts):
        self.facts = json.loads(json.dumps(facts, allow_nan=False))

    def report(self, facts, sentences, time):
        self.sentences += sentences

    def close(self):
        pass


def watched(items, folder=None, source="run.csv", **kept):
    """A watch after its source has ended."""
    of, journal, said = monitor(), None, Said()
    if folder is not None:
        journal, _ = open_journal(folder, of, source)
    watch = Watch(of, Cuts(), source, journal=journal, outlets=[said], **kept)
    watch.run(items)
    watch.said = said
    return watch


def test_a_run_is_watched_and_its_journal_replays_to_the_same_state(tmp_path):
    watch = watched(samples(), tmp_path)
    assert watch.monitor.cuts == [pytest.approx(1.0, abs=0.03)] * 3
    assert watch.monitor.edge.minutes == pytest.approx(3.0, abs=0.05)
    assert watch.monitor.estimate.windows >= 15
    other = monitor()
    replay(read_newest(tmp_path).records, other)
    assert other.as_json() == watch.monitor.as_json()
    assert watch.said.facts["state"] == "stopped"
    assert watch.said.facts["probability_past"] < 0.01


@pytest.mark.parametrize("place", [150, 700, 1000, 1999])
def test_a_process_that_ends_anywhere_goes_on_with_no_cutting_time_lost(tmp_path, place):
    whole = watched(samples()).monitor
    items = list(samples())
    first = Watch(found := monitor(), Cuts(), "run.csv", journal=open_journal(tmp_path, found, "run.csv")[0])
    for item in items[:place]:
        first.take(item)
    first.journal.synchronise()  # and no more: the process is killed here
    again = monitor()
    journal, after = open_journal(tmp_path, again, "run.csv")
    assert after is None or after <= items[place].time
    cuts = Cuts()
    if again.air is not None:
        cuts.resume(again.air)
    second = Watch(again, cuts, "run.csv", journal=journal)
    second.run(item for item in items if after is None or item.time > after)
    assert again.edge.minutes == pytest.approx(whole.edge.minutes, abs=0.15)
    assert again.edge.minutes > whole.edge.minutes - 0.03
    assert again.estimate.wear().median == pytest.approx(whole.estimate.wear().median, rel=0.03)


def test_a_signal_lost_in_mid_cut_latches_an_alarm_and_its_time_counts_as_cutting():
    items = list(samples(cuts=2))
    place = 1100  # in the second cut
    lost = Notice(items[place].time, "lost", "the server has closed the connection")
    back = Notice(items[place + 200].time, "connected", "")
    watch = watched([*items[:place], lost, *[Notice(0.0, "idle")] * 5, back, *items[place + 200 :]])
    whole = watched(items).monitor
    assert watch.monitor.edge.minutes == pytest.approx(whole.edge.minutes, abs=0.03)
    assert [alarm["kind"] for alarm in watch.monitor.alarms] == ["lost"]
    assert any("counted as cutting" in text for text in watch.said.sentences)


def test_a_clock_that_jumps_changes_no_estimate():
    items = list(samples(cuts=2))
    whole = watched(items).monitor
    for jump in (-3600.0, 86400.0):
        late = [replace(item, time=item.time + jump) for item in items[1100:]]
        notice = Notice(0.0, "clock", f"times jumped by {jump:g} s")
        found = watched([*items[:1100], notice, *late]).monitor
        assert found.edge.minutes == pytest.approx(whole.edge.minutes, abs=0.05)
        assert found.estimate.wear().median == pytest.approx(whole.estimate.wear().median, rel=0.02)
        assert any("clock" in note["text"] for note in found.notes)


def test_cuts_of_another_tool_are_not_those_of_the_edge():
    own = list(samples(cuts=1, tool="T1"))
    other = list(samples(cuts=2, tool="T7", start=own[-1].time + 0.1, scale=3.0))
    back = list(samples(cuts=1, tool="T1", start=other[-1].time + 0.1))
    watch = watched([*own, *other, *back])
    assert watch.monitor.edge.minutes == pytest.approx(2.0, abs=0.05)
    assert watch.monitor.edge.tool == "T1"
    assert [text for text in watch.said.sentences if "T7" in text or "is back" in text] != []


def test_a_parameter_file_that_is_replaced_or_removed_is_said_and_the_laws_stay(tmp_path):
    path = tmp_path / "params.json"
    path.write_text("{}")
    watch = Watch(monitor(), Cuts(), "run.csv", outlets=[said := Said()], params=path)
    path.write_text('{"another": 1}')
    watch.look_around()
    watch.look_around()
    path.unlink()
    watch.look_around()
    assert ["replaced" in text or "removed" in text for text in said.sentences] == [True, True]


def test_a_journal_of_another_tool_or_parameter_file_is_refused_and_stays_as_it_was(tmp_path):
    watched(samples(cuts=1), tmp_path)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    for name in ("tool", "content"):
        other = Monitor(laws(), WatchSettings(criterion=0.3), {**IDENTITY, name: "other"})
        with pytest.raises(UsageError, match="other"):
            open_journal(tmp_path, other, "run.csv")
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_a_full_disk_is_an_alarm_and_watching_goes_on(tmp_path, monkeypatch):
    items, write = list(samples()), watch_journal.os.write
    monkeypatch.setattr(watch_journal, "RETRY", 0.0)
    found = monitor()
    watch = Watch(found, Cuts(), "run.csv", journal=open_journal(tmp_path, found, "run.csv")[0])

    def refuse(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    for k, item in enumerate(items):
        if k == 500:
            monkeypatch.setattr(watch_journal.os, "write", refuse)
        if k == 1500:
            assert [alarm["kind"] for alarm in found.alarms] == ["journal"]
            monkeypatch.setattr(watch_journal.os, "write", write)
        watch.take(item)
    watch.run([])
    assert found.edge.minutes == pytest.approx(3.0, abs=0.05)
    other = monitor()
    replay(read_newest(tmp_path).records, other)
    assert other.as_json() == found.as_json()


def test_contact_of_the_old_edge_that_the_disk_refused_is_not_counted_on_a_new_edge(tmp_path, monkeypatch):
    found, other = monitor(), monitor()
    watch = Watch(found, Cuts(), "run.csv", journal=open_journal(tmp_path, found, "run.csv")[0])

    def refuse(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as full:
        full.setattr(watch_journal.os, "write", refuse)
        for record in records(12):
            watch.record(**record)
    assert found.edge.minutes > 2
    watch.record("edge", time=999.0)  # the disk is not full any more; nothing was tried meanwhile
    watch.journal.close()
    replay(read_newest(tmp_path).records, other)
    assert (other.edge.number, other.edge.minutes) == (2, 0.0)
    assert read_newest(tmp_path).missing == 0


def test_records_that_are_missing_are_said_by_each_command_and_a_new_file_begins(tmp_path):
    watched(samples(), tmp_path)
    path = read_newest(tmp_path).path
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join([*lines[:10], b"\x00garbage\n", *lines[11:]]))
    asked, again = monitor(), monitor()
    take_requests(tmp_path, asked)
    text = "1 record of the journal cannot be read: contact may be missing. Gauge the edge."
    assert asked.take_messages() == [f"ALARM {text}"]
    assert asked.edge.summary.gaps == 1
    journal, _ = open_journal(tmp_path, again, "run.csv")
    journal.close()
    assert read_newest(tmp_path).missing == 0
    assert [alarm["text"] for alarm in again.alarms if alarm["kind"] == "journal"] == [text]


def test_requests_are_taken_by_the_process_that_watches_and_by_a_later_command(tmp_path):
    items = list(samples(cuts=2))
    found = monitor()
    watch = Watch(found, Cuts(), "run.csv", journal=open_journal(tmp_path, found, "run.csv")[0])
    for item in items[:900]:
        watch.take(item)
    leave_request(tmp_path, {"kind": "gauge", "wear": found.estimate.wear().median, "sd_ln": 0.02})
    leave_request(tmp_path, {"kind": "gauge", "wear": -1.0, "sd_ln": 0.02})
    leave_request(tmp_path, {"kind": "shell", "command": "x"})
    watch.look_around()
    watch.run(items[900:])
    assert found.edge.gauges == 1
    assert not list(tmp_path.glob("request-*"))
    leave_request(tmp_path, {"kind": "edge"})
    take_requests(tmp_path, later := monitor())
    assert later.edge.number == 2
    assert [record["kind"] for record in read_journal(tmp_path)][-2:] == ["edge", "snapshot"]
    assert later.finished[-1]["gauges"] == 1


def test_a_new_edge_may_have_new_laws_and_one_that_has_cut_may_not(tmp_path):
    watched(samples(cuts=1), tmp_path)
    leave_request(tmp_path, {"kind": "edge"})
    take_requests(tmp_path, monitor())
    learned = Monitor(laws(), WatchSettings(criterion=0.3), {**IDENTITY, "content": "version 2"})
    journal, _ = open_journal(tmp_path, learned, "run.csv")
    assert learned.edge.number == 2
    Watch(learned, Cuts(), "run.csv", journal=journal).run(samples(cuts=1))
    with pytest.raises(UsageError, match="parameter file"):
        open_journal(tmp_path, monitor(), "run.csv")


def test_rotation_in_a_run_leaves_bounded_files_that_replay(tmp_path, monkeypatch):
    found = monitor()
    watch = Watch(found, Cuts(), "run.csv", journal=open_journal(tmp_path, found, "run.csv")[0])
    watch.journal.rotate_at, watch.journal.kept = 3000, 2
    watch.run(samples())
    assert len(list(tmp_path.glob("*.jsonl"))) == 2
    other = monitor()
    replay(read_newest(tmp_path).records, other)
    assert other.as_json() == found.as_json()


def test_an_outlet_that_fails_is_left_out_and_the_watch_goes_on():
    class Broken(Said):
        def show(self, facts):
            raise OSError(errno.EPIPE, "Broken pipe")

    watch = Watch(monitor(), Cuts(), "run.csv", outlets=[Broken(), kept := Said()])
    watch.run(samples(cuts=1))
    assert watch.outlets == [kept]
    assert kept.facts["cut_minutes"] == pytest.approx(1.0, abs=0.03)


def test_loads_that_are_missing_throughout_leave_the_time_of_contact_unknown_and_say_so():
    items = [replace(item, loads={}, conditions=CONDITIONS) for item in samples(cuts=1)]
    watch = watched(items)
    assert watch.said.facts["loads"]["P"]["value"] is None


def test_the_journal_class_is_closed_when_the_source_fails(tmp_path):
    def broken():
        yield from list(samples(cuts=1))[:300]
        raise UsageError("the source ended with an error")

    found = monitor()
    journal = open_journal(tmp_path, found, "run.csv")[0]
    with pytest.raises(UsageError):
        Watch(found, Cuts(), "run.csv", journal=journal).run(broken())
    assert isinstance(journal, WatchJournal)
    assert read_newest(tmp_path).torn is False


def test_loads_in_another_unit_are_an_alarm_and_the_wear_follows_from_time_alone():
    items = [replace(item, loads={"P": item.loads["P"] / 1000}) for item in samples(cuts=8)]
    watch = watched(items)
    assert [alarm["kind"] for alarm in watch.monitor.alarms] == ["tool"]
    alone = monitor()
    alone.estimate.advance(watch.monitor.edge.minutes, CONDITIONS)
    assert watch.monitor.estimate.wear().median == pytest.approx(alone.estimate.wear().median, rel=0.01)
    assert any("time alone" in text for text in watch.said.sentences)


def test_contact_at_unknown_conditions_is_an_alarm_and_the_wear_is_not_shown():
    watch = watched(replace(item, conditions={"f": 0.2, "d": 2.0}) for item in samples(cuts=2))
    assert {alarm["kind"] for alarm in watch.monitor.alarms} == {"conditions"}
    wear = watch.said.facts["wear"]
    assert wear["median"] is None
    assert "2 min were cut at unknown conditions" in wear["reason"]
    json.dumps(watch.said.facts)


@pytest.mark.parametrize(("until", "kinds"), [(3.0, set()), (1e9, {"conditions"})])
def test_a_condition_that_cannot_be_read_for_a_time_is_an_alarm_and_no_go_on(until, kinds):
    """NaN from the second cut on, for 3 s or for good; the contact counts at the last value, without the loads."""
    lost = [
        replace(item, conditions={**CONDITIONS, "V": float("nan")}) if 0 < item.time - 90.0 < until else item
        for item in samples(cuts=3)
    ]
    watch, whole = watched(lost), watched(samples(cuts=3))
    assert {alarm["kind"] for alarm in watch.monitor.alarms} == kinds
    assert watch.monitor.edge.minutes == pytest.approx(whole.monitor.edge.minutes, abs=0.02)
    assert watch.monitor.decisions[-1]["kind"] == ("not known" if kinds else "go on")
    assert (watch.said.facts["wear"]["median"] is None) == bool(kinds)
    assert (watch.said.facts["life"] is None) == bool(kinds)
    assert any("V was not read for a time" in note for note in watch.said.facts["notes"]) == bool(kinds)
    if kinds:
        watch.record("gauge", time=500.0, wear=watch.monitor.estimate.wear().median, sd_ln=0.02)
        watch.record("acknowledge", time=500.0)
        assert watch.monitor.decisions[-1]["kind"] == "go on"


def test_a_condition_that_is_given_only_where_it_changes_is_not_lost():
    first, *others = samples(cuts=2)
    watch = watched([first, *(replace(item, conditions={}) for item in others)])
    assert watch.monitor.alarms == []
    assert watch.monitor.decisions[-1]["kind"] == "go on"


def test_a_change_of_tool_ends_the_cut_and_the_time_of_the_other_tool_does_not_count():
    own = [item for item in samples(cuts=1, tool="T1") if item.time < 68.0]  # ends in mid-cut
    other = [replace(item, time=item.time + 68.0) for item in samples(cuts=2, tool="T7")]
    unnamed = [replace(item, tool="", time=item.time + 300.0) for item in samples(cuts=1)]
    back = [replace(item, time=item.time + 400.0) for item in samples(cuts=1, tool="T1")]
    watch = watched([*own, *other, *unnamed, *back])
    assert watch.monitor.edge.minutes == pytest.approx(2.0, abs=0.05)
    assert watch.monitor.edge.summary.gaps == 0
    assert any("of tool T1" in sentence for sentence in watch.said.sentences)


@pytest.mark.parametrize(
    "change",
    [
        lambda lines: [*lines[:5], '{"n":7,"kind":"window","time":5}', *lines[5:]],
        lambda lines: [*lines[:5], '{"n":7,"kind":"gap","time":"x","minutes":"y"}', *lines[5:]],
        lambda lines: [lines[0].replace('"detection"', '"detektion"'), *lines[1:]],
        lambda lines: [lines[0].replace('"estimate":{', '"estimate":[],"other":{'), *lines[1:]],
    ],
)
def test_a_journal_that_was_changed_by_hand_is_refused_with_the_number_of_the_record(tmp_path, change):
    watched(samples(cuts=1), tmp_path)
    path = sorted(tmp_path.glob("watch-*.jsonl"))[-1]
    path.write_text("\n".join(change(path.read_text().splitlines())) + "\n")
    with pytest.raises(FitmodelsError, match=r"record|snapshot"):
        open_journal(tmp_path, monitor(), "run.csv")


@pytest.mark.parametrize(
    "asked",
    [
        {"kind": "used", "minutes": 8.0, "conditions": [1]},
        {"kind": "used", "minutes": 8.0, "conditions": {"V": "x"}},
        {"kind": "used", "minutes": -8.0},
        {"kind": "tool"},
        {"kind": "tool", "tool": 5},
        {"kind": "gauge", "wear": 0.2, "sd_ln": None},
    ],
)
def test_a_request_that_is_not_known_is_a_notice(asked):
    assert request_record(asked, 1.0)["kind"] == "notice"


def dying(become, state=True, cuts=6):
    """Samples whose power becomes ``become(power, k)`` in the middle of the third cut of a minute."""
    for k, sample in enumerate(samples(cuts=cuts, state=state)):
        dead = sample.time >= 2 * 68 + 40
        power = become(sample.loads["P"], k)
        yield replace(sample, loads={} if power is None else {"P": power}) if dead else sample


@pytest.mark.parametrize(
    "become", [lambda _, k: 0.0, lambda _, k: 0.01 * (-1) ** k, lambda _, k: 0.8 + 0.008 * (-1) ** (k // 7)]
)
def test_feed_counts_as_cutting_when_the_load_reads_air_or_less(become):
    """Power that dies to zero, to noise around it, or freezes at its idle level."""
    whole, watch = watched(samples(cuts=6)), watched(dying(become))
    assert watch.monitor.edge.minutes == pytest.approx(whole.monitor.edge.minutes, abs=0.1)
    assert [alarm["kind"] for alarm in watch.monitor.alarms if alarm["kind"] != "lost"] == ["load"]
    assert watch.monitor.decisions[-1]["kind"] != "go on"
    assert not any(alarm["kind"] == "load" for alarm in whole.monitor.alarms)
    assert whole.monitor.decisions[-1]["kind"] == "go on"


def test_a_load_that_is_lost_while_idle_is_an_alarm_once_the_machine_feeds():
    lost = [replace(item, loads={}) if item.time > 2 * 68 + 4 else item for item in samples(cuts=4)]
    whole, watch = watched(samples(cuts=4)), watched(lost)
    (alarm,) = watch.monitor.alarms
    assert alarm["kind"] == "load"
    assert "no load was read for 5 s of feed" in alarm["text"]
    assert alarm["time"] == pytest.approx(2 * 68 + 8 + 5, abs=0.5)
    assert watch.monitor.decisions[-1]["kind"] == "not known"
    assert watch.monitor.edge.minutes == pytest.approx(whole.monitor.edge.minutes, abs=0.1)


def test_a_load_that_falls_below_idle_at_once_is_lost_where_the_machine_says_nothing():
    watch = watched(dying(lambda _, k: 0.0, state=False))
    (alarm,) = (alarm for alarm in watch.monitor.alarms if alarm["kind"] == "load")
    assert "P fell from the cut to 0 at once, below idle (0.799" in alarm["text"]
    assert watch.monitor.lost is not None
    assert watch.monitor.decisions[-1]["kind"] == "not known"
    watch = watched(dying(lambda _, k: None, state=False))
    assert "no load was read for 5 s in mid-cut" in watch.monitor.alarms[-1]["text"]
    assert watch.monitor.decisions[-1]["kind"] == "not known"


def test_no_more_feed_is_advised_while_a_load_is_lost():
    bounds = Bounds({"V": (50.0, 250.0), "f": (0.05, 0.6)})
    feeds = {}
    for lost in (False, True):
        of = monitor()
        watch = Watch(of, Cuts(), "run.csv")
        watch.bounds = bounds
        watch.run(dying(lambda _, k: 0.0) if lost else samples(cuts=6))
        feeds[lost] = [one["settings"][name] / CONDITIONS[name] for one in watch.now.advice for name in one["settings"]]
    assert max(feeds[False]) > 1.2
    assert max(feeds[True], default=0.0) <= 1.0 + 1e-9


def test_a_lost_load_that_reads_contact_again_is_used_again():
    def back(power, k):
        return 0.0 if k < 2 * 680 + 500 else power

    watch = watched(dying(back))
    assert watch.monitor.edge.minutes == pytest.approx(6.0, abs=0.1)
    assert watch.cuts.lost.floors == {}
    assert watch.monitor.measured["P"] > 0
    watch.record("acknowledge", time=watch.monitor.time)
    assert watch.monitor.decisions[-1]["kind"] == "go on"
