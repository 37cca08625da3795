"""Recorded runs as loggers write them: read with what was presumed said, or refused in a sentence."""

import sys
from importlib.util import find_spec

import numpy as np
import openpyxl
import pytest
from fitmodels import datasets
from fitmodels.core.errors import DataError, UsageError
from fitmodels.datasets import read_record
from fitmodels.datasets.records.columns import clock_seconds
from fitmodels.datasets.records.formats import looks_like_record
from fitmodels.datasets.records.sampling import time_axis
from hypothesis import given, settings
from hypothesis import strategies as st

N, STEP = 200, 0.02
U = np.random.default_rng(435).normal(size=N).round(4)
Y = np.convolve(U, [0.0, 0.5, 0.25])[:N].round(4)
TIME = np.arange(N) * STEP


def text(times=TIME, u=U, y=Y, header="t [s];u [V];y [mm]", form="{:.6g}", more=()):
    def cell(x):
        return x if isinstance(x, str) else "" if np.isnan(x) else form.format(x)

    rows = zip(times, u, y, *more, strict=True)
    return "\n".join(filter(None, [header, *(";".join(map(cell, row)) for row in rows)])) + "\n"


@pytest.fixture
def read(tmp_path):
    def reader(content, *args, name="run.csv", **options):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return read_record(path, *args, **options)

    return reader


def reported(record):
    return " | ".join(record.notes)


# Files that are read


GERMAN = text(TIME * 1000, header="Zeit;Spindelstrom;Lage\nms;mA;µm").replace(".", ",").encode("cp1252")
CLOCK = [f"12:59:{59 + k * STEP:06.3f}" if k < 50 else f"13:00:{(k - 50) * STEP:06.3f}" for k in range(N)]


@pytest.mark.parametrize(
    ("content", "options", "u", "y", "units"),
    [
        pytest.param(text(), {}, U, Y, ("V", "mm"), id="seconds with a header"),
        pytest.param(GERMAN, {}, U / 1000, Y / 1000, ("A", "mm"), id="German, decimal comma, a row of units, ms"),
        pytest.param(text(TIME / 60, header="time in min;u;y", form="{:.12g}"), {}, U, Y, ("", ""), id="minutes"),
        pytest.param(text(TIME * 1e6, header="t [µs];u;y"), {}, U, Y, ("", ""), id="microseconds"),
        pytest.param(text(header=""), {}, U, Y, ("", ""), id="no header: the column that rises evenly is the time"),
        pytest.param(
            text(TIME * 1000, header=""), {"units": {"time": "ms"}}, U, Y, ("", ""), id="no header, ms by --unit"
        ),
        pytest.param(text(TIME * 1000, header=""), {"rate": 50}, U, Y, ("", ""), id="no header, ms told by the rate"),
        pytest.param(text(np.arange(N), header="k;u;y"), {"rate": 50}, U, Y, ("", ""), id="a count of samples"),
        pytest.param(text(CLOCK, header="Uhrzeit;u;y"), {}, U, Y, ("", ""), id="times of day"),
        pytest.param(text(TIME + 1.7e9, form="{:.13g}"), {}, U, Y, ("V", "mm"), id="seconds since 1970"),
        pytest.param(
            text(u=Y, y=U, header="t;Kraft Fx [kN];u [rad/s]"), {"input": "u", "output": "Fx"}, U, Y * 1000,
            ("rad/s", "N"), id="output first, chosen by role; a unit that is not listed stays",
        ),
        pytest.param(text(header="t;u;y"), {"units": {"input": "mA", "y": "m"}}, U / 1e3, Y * 1e3, ("A", "mm"),
                     id="units given, by role and by name"),
        pytest.param(text(), {"offsets": (1.0, 2.0)}, U - 1, Y - 2, ("V", "mm"), id="an operating point taken off"),
    ],
)  # fmt: skip
def test_one_run_however_it_is_written(read, content, options, u, y, units):
    rec = read(content, **options)
    assert rec.sample_time == pytest.approx(STEP, rel=1e-9)
    assert rec.starts == (0,)
    assert rec.u == pytest.approx(u, rel=1e-9)
    assert rec.y == pytest.approx(y, rel=1e-9)
    assert (rec.unit_u, rec.unit_y) == units
    assert rec.source == "run.csv"


def test_what_was_presumed_stands_in_the_notes(read):
    notes = reported(read(text(header="t;u;y")))
    assert "input u and output y are assumed from their names" in notes
    assert "seconds are assumed" in notes
    assert "sampled every 0.02 s (50 Hz), uniformly" in notes
    assert "assumed from" not in reported(read(text(), "u", "y"))


@pytest.mark.parametrize("rate", [120.0, 48.0, 300.0, 400.0])
def test_times_rounded_to_a_millisecond_still_tell_the_rate(read, rate):
    """The median step of 120 Hz in whole milliseconds is 8 ms, which would be 125 Hz."""
    times = np.round(np.arange(N) / rate, 3)
    rec = read(text(times, form="{:.12g}"))
    assert rec.rate == pytest.approx(rate, rel=1e-4)
    assert rec.starts == (0,)
    assert "uniform within the 0.001 s resolution of the times" in reported(rec)


def test_jitter_is_measured_and_reported(read):
    jitter = np.zeros(N)
    jitter[77] = 0.004 * STEP
    rec = read(text(TIME + jitter, form="{:.12g}"))
    assert rec.sample_time == pytest.approx(STEP, rel=1e-6)
    assert "differ from that by 0.4 % at most" in reported(rec)


@given(step=st.sampled_from([1e-4, 0.001, 0.0125, 1 / 120, 0.08, 2.5]), lost=st.sets(st.integers(1, 198), max_size=8))
@settings(max_examples=60, deadline=None)
def test_lost_samples_break_the_record_where_they_are_missing(step, lost):
    rows = np.array([k for k in range(200) if k not in lost])
    axis = time_axis(rows * step, 1.0, "t", rows, np.array([], dtype=np.intp))
    assert axis.sample_time == pytest.approx(step, rel=1e-9)
    assert axis.missing == len(lost)
    assert axis.starts.tolist() == [0, *(np.flatnonzero(np.diff(rows) > 1) + 1)]


@pytest.mark.parametrize("options", [{}, {"sample_time": STEP}])
def test_empty_cells_and_nan_are_gaps(read, options):
    u, y = U.copy(), Y.copy()
    u[40:43], y[100] = np.nan, np.nan
    rec = read(text(u=u, y=y), **options)
    assert rec.starts == (0, 40, 97)
    assert len(rec) == N - 4
    assert "4 rows lack a number, the first in line 42" in reported(rec)
    bare = read("\n".join(line.split(";", 1)[1] for line in text(u=u, y=y).splitlines()), sample_time=STEP)
    assert bare.starts == (0, 40, 97)


def test_lost_samples_are_counted_and_their_line_reported(read):
    keep = np.delete(np.arange(N), [50, 51, 120])
    rec = read(text(TIME[keep], U[keep], Y[keep]))
    assert rec.starts == (0, 50, 118)
    assert "3 samples are missing, in 2 places (line 52, 120)" in reported(rec)


def test_a_pause_that_is_no_whole_number_of_samples_breaks_too(read):
    times = TIME + np.where(np.arange(N) >= 60, 7.3 * STEP, 0)
    rec = read(text(times, form="{:.12g}"))
    assert rec.starts == (0, 60)
    assert "not a whole number of samples" in reported(rec)


def test_times_that_start_again_and_labels_begin_runs(read):
    again = np.concatenate([TIME[:120], TIME[:80]])
    rec = read(text(again))
    assert rec.starts == (0, 120)
    assert "starts again 1 time" in reported(rec)
    labels = ["A"] * 70 + ["B"] * 130
    rec = read(text(header="t;u;y;run", more=[labels]))
    assert rec.starts == (0, 70)
    assert (rec.input, rec.output) == ("u", "y")


def test_rows_that_stand_twice_are_kept_once(read):
    twice = np.sort(np.append(np.arange(N), [30, 31]))
    rec = read(text(TIME[twice], U[twice], Y[twice]))
    assert len(rec) == N
    assert rec.starts == (0,)
    assert "2 rows are duplicates" in reported(rec)


def test_several_files_are_several_runs(tmp_path):
    for name in ("a.csv", "b.csv"):
        (tmp_path / name).write_text(text())
    rec = read_record([tmp_path / "a.csv", tmp_path / "b.csv"], "u", "y")
    assert rec.starts == (0, N)
    assert rec.source == "a.csv + b.csv"
    (tmp_path / "b.csv").write_text(text(header="t [s];p [V];q [mm]"))
    with pytest.raises(DataError, match=r"b\.csv gives p and q"):
        read_record([tmp_path / "a.csv", tmp_path / "b.csv"])


def test_a_workbook_and_a_table_read_before_are_read_alike(tmp_path):
    book = openpyxl.Workbook()
    book.active.append(["t [s]", "u", "y"])
    for row in zip(TIME.tolist(), U.tolist(), Y.tolist(), strict=True):
        book.active.append(row)
    book.save(tmp_path / "run.xlsx")
    rec = read_record(tmp_path / "run.xlsx")
    assert rec.u == pytest.approx(U)
    assert read_record(datasets.read_table(tmp_path / "run.xlsx")).sha256 == rec.sha256


# Uneven sampling


def uneven(seed=0, n=3000):
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.uniform(0.008, 0.012, n))
    return times, np.sin(2 * np.pi * times), np.cos(2 * np.pi * times)


def test_uneven_sampling_is_refused_unless_resampling_is_asked_for(read):
    content = text(*uneven(), form="{:.10g}")
    with pytest.raises(DataError, match=r"is not uniform: its steps range from 0\.008.* to 0\.0119.*--resample"):
        read(content)


@pytest.mark.parametrize("rate", [20.0, 100.0, 200.0])
def test_uneven_samples_of_a_tone_become_even_ones(read, rate):
    times, u, y = uneven()
    rec = read(text(times, u, y, form="{:.10g}"), resample=rate)
    assert rec.rate == pytest.approx(rate)
    at = times[0] + np.arange(len(rec)) / rate
    # A line over 12 ms misses a 1 Hz sine by (2 pi 0.012)^2 / 8 = 7e-4 at most (midpoint of a chord).
    assert rec.u[30:-30] == pytest.approx(np.sin(2 * np.pi * at)[30:-30], abs=3e-3)
    assert rec.y[30:-30] == pytest.approx(np.cos(2 * np.pi * at)[30:-30], abs=3e-3)
    assert "samples are interpolated linearly" in reported(rec)
    assert ("the delay is uncertain by 0.005 s" in reported(rec)) == (rate > 20.0)


def test_no_line_is_drawn_over_a_gap(read):
    times, u, y = uneven()
    times[1000:] += 5.0
    rec = read(text(times, u, y, form="{:.10g}"), resample=100.0)
    assert len(rec.starts) == 2
    assert "1 gap" in reported(rec)


def test_even_samples_are_brought_to_another_rate_when_asked(read):
    rec = read(text(), resample=25.0)
    assert rec.rate == pytest.approx(25.0)
    assert len(rec) == N // 2
    assert "resampled from 50 to 25 Hz" in reported(rec)


def test_a_given_rate_stands_in_for_times_that_are_too_coarse(read):
    coarse = text(np.floor(TIME * 10) / 10)
    with pytest.raises(DataError, match="written too coarsely"):
        read(coarse)
    rec = read(coarse, rate=50)
    assert rec.sample_time == STEP
    assert rec.starts == (0,)
    assert "is not used, the rate given is" in reported(rec)


def test_a_rate_distinguishes_lost_samples_from_coarse_times(read):
    keep = np.delete(np.arange(N), np.arange(10, 190, 9))
    content = text((TIME / 2)[keep], U[keep], Y[keep])
    with pytest.raises(DataError, match="whether some are lost cannot be determined"):
        read(content)
    assert len(read(content, rate=100).starts) == 21


# What is odd about the numbers


@pytest.mark.parametrize("line", ["# Deviations from a cut at 0.24 A", "# Abweichungen vom Schnitt"])
def test_a_comment_that_states_deviations_is_kept_as_a_note(read, line):
    """A check that asks whether a record about zero holds deviations is answered by it."""
    stated = read(f"{line}\n# clamp 3\n{text()}")
    assert [note for note in stated.notes if note.startswith("from the file")] == [f"from the file: {line[2:]}"]


def test_an_input_that_does_not_move_is_reported(read):
    assert "u is constant at 2 V: without variation" in reported(read(text(u=np.full(N, 2.0))))


@pytest.mark.parametrize("header", ["t [s];y [mm];u [V]", "t [s];measured [mm];drive [V]", "t;Kraft;command"])
def test_names_of_input_and_output_count_more_than_their_order(read, header):
    record = read(text(u=Y, y=U, header=header))
    assert "assumed from their names" in reported(record)
    np.testing.assert_allclose(record.u, U, atol=1e-5)


@pytest.mark.parametrize(("digits", "found"), [(12, True), (3, True), (1, False)])
def test_an_output_that_stands_while_the_input_moves_is_reported(read, digits, found):
    """Equal neighbours are usual where readings are coarse."""
    t, u = chirp()
    y = np.roll(u, 5)
    assert "successive samples" not in reported(read(text(t, u, y.round(digits), form="{:.12g}")))
    y[1500:1530] = y[1500]
    said = reported(read(text(t, u, y.round(digits), form="{:.12g}")))
    assert ("30 successive samples from line 1502 on" in said) == found


def test_an_output_that_settles_between_steps_is_not_called_standing(read):
    u = np.repeat([0.0, 1, 0, 2, 0, 1, 3, 0], 100)
    y = np.zeros(len(u))
    for k in range(1, len(u)):
        y[k] = 0.7 * y[k - 1] + 0.3 * u[k - 1]
    assert "successive" not in reported(read(text(np.arange(len(u)) / 50, u, y.round(4))))


def chirp(n=3000, rate=100.0):
    t = np.arange(n) / rate
    return t, 2.5 * np.sin(2 * np.pi * (0.1 * t + 0.03 * t**2))


@pytest.mark.parametrize("digits", [2, 4, 12])
def test_a_clipped_signal_is_reported_and_its_crests_are_not(read, digits):
    t, u = chirp()
    y = np.roll(u, 5)
    fair = reported(read(text(t, u.round(digits), y.round(digits), form="{:.12g}")))
    assert "clipped" not in fair
    cut = reported(read(text(t, u, np.clip(y, -2.0, 1.9).round(digits), form="{:.12g}")))
    assert "y looks clipped" in cut
    assert "largest value 1.9 mm" in cut
    assert "smallest value -2 mm" in cut


@pytest.mark.parametrize(
    "u",
    [
        pytest.param(np.sign(U), id="two levels"),
        pytest.param(np.repeat(U[:20], 10), id="levels held for ten samples"),
        pytest.param(np.round(1 - np.exp(-np.arange(N) / 5), 2), id="settling at the end"),
    ],
)
def test_an_input_that_stands_by_intent_is_not_called_clipped(read, u):
    assert "clipped" not in reported(read(text(u=u)))


# What is refused


@pytest.mark.parametrize(
    ("content", "options", "error", "words"),
    [
        pytest.param(text(header="t;u;y;z", more=[U]), {}, UsageError,
                     r"3 columns are possible: 2 'u', 3 'y', 4 'z'. Give --input and --output", id="three signals"),
        pytest.param(text(header="t;u;y;z", more=[U]), {"input": "u"}, UsageError, "2 columns.*Give --output",
                     id="an output that could be two"),
        pytest.param(text(), {"input": "Spindelstrom"}, UsageError, "no such column; there are 1 't", id="no column"),
        pytest.param(text(header="t;force;y"), {"input": "forse"}, UsageError, "did you mean 'force'", id="a slip"),
        pytest.param(text(header="t;u;u"), {"input": "u"}, UsageError, "col2 or col3", id="one name, two columns"),
        pytest.param(text(), {"input": "u", "output": 2}, UsageError, "both mean column", id="one column twice"),
        pytest.param(text(), {"units": {"inptu": "A"}}, UsageError, "did you mean input", id="a unit of nothing"),
        pytest.param(text(), {"units": {"time": "mm"}}, UsageError, "not a unit of time", id="a time in mm"),
        pytest.param(text(), {"rate": 100}, DataError, r"gives 0\.02 s between samples.*--rate gives 0\.01 s",
                     id="a rate that the times gainsay"),
        pytest.param(text(), {"rate": 50, "sample_time": 0.1}, UsageError, "do not agree", id="two sample times"),
        pytest.param(text(), {"rate": -50}, UsageError, "above zero", id="a rate below zero"),
        pytest.param(text(TIME * 1000, header="t;u;y"), {}, UsageError, "20 s or 20 ms", id="a step of 20, no unit"),
        pytest.param(text(np.arange(N), header="k;u;y"), {}, UsageError, "no column of times", id="a count, no rate"),
        pytest.param(text(times=U, header="x;u;y"), {"input": "u", "output": "y"}, UsageError, "--rate",
                     id="no time at all"),
        pytest.param(text(TIME[::-1]), {}, DataError, "newest sample is first", id="times falling"),
        pytest.param(text(np.r_[TIME[:50], TIME[30:180]]), {}, DataError, "falls from 0.98 to 0.6 in line 52",
                     id="times stepping back"),
        pytest.param(text(np.r_[TIME[:50], TIME[49:-1]]), {}, DataError, "is the same in lines 51 and 52",
                     id="one time, two values"),
        pytest.param(text(TIME[:3], U[:3], Y[:3]), {}, DataError, "3 full rows", id="three rows"),
        pytest.param(text(np.repeat(TIME[:20], 10)), {}, DataError, "too coarsely", id="times standing still"),
        pytest.param(text(u=[*U[:9].astype(str), "overload", *U[10:].astype(str)]), {}, DataError,
                     "line 11: 'overload'", id="text among numbers"),
        pytest.param(text(header="t;u;y;run", more=[[str(k % 2) for k in range(N)]]), {"input": "u", "output": "y"},
                     DataError, "every row is a separate run", id="a label that changes in each row"),
        pytest.param(text(), {"resample": 0.0}, UsageError, "above zero", id="a rate of nothing"),
        pytest.param(text(*uneven()), {"resample": -5.0}, UsageError, "above zero", id="a negative rate"),
        pytest.param(text(header="t;u;y").replace("0.4;", "soon;"), {}, DataError, "'soon'", id="a time in words"),
    ],
)  # fmt: skip
def test_what_cannot_be_read_is_refused_in_a_sentence(read, content, options, error, words):
    with pytest.raises(error, match=words) as caught:
        read(content, **options)
    assert "\n" not in str(caught.value)


def test_dates_count_by_their_change():
    german = clock_seconds(["31.12.2024 23:59:59,98", "31.12.2024 23:59:59,99", "01.01.2025 00:00:00,00"])
    iso = clock_seconds(["2024-12-31T23:59:59.98Z", "2024-12-31T23:59:59.99Z", "2025-01-01T00:00:00.00Z"])
    assert np.diff(german) == pytest.approx([0.01, 0.01], abs=1e-9)
    assert np.array_equal(german, iso)
    assert clock_seconds(["12:00:00", "noon"]) is None


# Record or table of tests


@pytest.mark.parametrize(
    ("content", "kind"),
    [
        pytest.param(text(), "record", id="even times and two signals"),
        pytest.param(text(np.r_[TIME[:120], TIME[:80]]), "record", id="two runs, one after the other"),
        pytest.param(text(CLOCK, header="time;u;y"), "record", id="times of day"),
        pytest.param(text(header="t;V;y"), "either", id="a voltage that reads as a cutting speed"),
        pytest.param(text(TIME[:12], U[:12], Y[:12], "t [min];F;P"), "either", id="twelve rows, minutes"),
        pytest.param(text(header="t;VB;F"), "table", id="a column of wear"),
        pytest.param(text(times=U), "table", id="times that do not rise"),
        pytest.param(text(*uneven()), "table", id="uneven times"),
        pytest.param("t;u\n" + "\n".join(f"{k / 50};{k % 3}" for k in range(100)), "table", id="one signal"),
        pytest.param(text(u=["x"] * N), "table", id="text beside one signal"),
    ],
)
def test_a_record_is_distinguished_from_a_table_of_tests(tmp_path, content, kind):
    path = tmp_path / "data.csv"
    path.write_text(content)
    look = looks_like_record(path)
    assert look.kind == kind, look.reason
    assert bool(look) == (kind == "record")


def test_no_bundled_set_of_tests_looks_like_a_record():
    assert {looks_like_record(datasets.bundled(name)).kind for name in datasets.bundled_names()} == {"table"}


# Other formats


def test_a_format_whose_package_is_absent_says_what_to_install(read, monkeypatch):
    monkeypatch.setitem(sys.modules, "nptdms", None)
    with pytest.raises(UsageError, match=r"pip install 'fitmodels\[tdms\]'"):
        read(b"TDSm" + bytes(100), name="run.tdms")
    monkeypatch.setitem(sys.modules, "lvm_read", None)
    with pytest.raises(UsageError, match=r"pip install 'fitmodels\[lvm\]'"):
        read("LabVIEW Measurement\t\n", name="run.lvm")


LVM_HEAD = """LabVIEW Measurement\t
Writer_Version\t2
Reader_Version\t2
Separator\tTab
Decimal_Separator\t,
Multi_Headings\tYes
X_Columns\t{columns}
Time_Pref\tRelative
***End_of_Header***\t
"""
LVM_SEGMENT = """\t
Channels\t2\t\t
Samples\t{n}\t{n}\t
Y_Unit_Label\tVolts\tmm\t
X_Dimension\tTime\tTime\t
X0\t0,0\t0,0\t
Delta_X\t0,020000\t0,020000\t
***End_of_Header***\t\t\t
X_Value\tVoltage\tPosition\tComment
{rows}
"""
has_lvm = pytest.mark.skipif(find_spec("lvm_read") is None, reason="lvm_read is not installed")
has_tdms = pytest.mark.skipif(find_spec("nptdms") is None, reason="npTDMS is not installed")


@has_lvm
@pytest.mark.parametrize("columns", ["One", "No"])
def test_segments_of_a_labview_file_are_runs(read, tmp_path, columns):
    """Layout of NI's own description of the format, "Specification for the LabVIEW Measurement File (.lvm)"."""
    first = TIME if columns == "One" else [""] * N
    rows = text(first, header="").replace(";", "\t").replace(".", ",").strip("\n")
    segment = LVM_SEGMENT.format(n=N, rows=rows)
    (tmp_path / "run.lvm.pkl").write_bytes(b"not to be opened")
    rec = read(LVM_HEAD.format(columns=columns) + segment + segment, name="run.lvm")
    assert (rec.input, rec.output, rec.unit_u, rec.unit_y) == ("Voltage", "Position", "V", "mm")
    assert rec.sample_time == pytest.approx(STEP)
    assert rec.starts == (0, N)
    assert rec.y[:N] == pytest.approx(Y)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["run.lvm", "run.lvm.pkl"]
    assert (tmp_path / "run.lvm.pkl").read_bytes() == b"not to be opened"


@has_lvm
def test_a_labview_file_without_data_is_refused(read):
    with pytest.raises(DataError, match=r"damaged LabVIEW|no columns"):
        read(LVM_HEAD.format(columns="One"), name="run.lvm")


def test_a_labview_file_without_its_head_is_a_table(read):
    assert len(read(text().replace(";", "\t"), name="run.lvm")) == N


@has_tdms
def test_groups_of_a_tdms_file_are_runs(tmp_path):
    import nptdms

    def channels(group, sign=1.0, names=("u", "y")):
        wave = {"wf_increment": STEP, "wf_start_offset": 0.0}
        return [
            nptdms.ChannelObject(group, name, sign * values, {**wave, "unit_string": unit})
            for name, values, unit in zip(names, (U, Y), ("A", "um"), strict=True)
        ]

    path = tmp_path / "run.tdms"
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment([*channels("first"), *channels("second", -1.0)])
    rec = read_record(path)
    assert rec.starts == (0, N)
    assert rec.sample_time == STEP
    assert (rec.unit_u, rec.unit_y) == ("A", "mm")
    assert rec.u == pytest.approx(np.r_[U, -U])
    assert read_record(path, sheet="second").u == pytest.approx(-U)
    assert looks_like_record(path)
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment([*channels("first"), *channels("other", names=("a", "b"))])
    with pytest.raises(UsageError, match="groups of different channels"):
        read_record(path)
    with pytest.raises(UsageError, match="leave out --decimal"):
        read_record(path, decimal="comma")


@has_tdms
def test_a_damaged_tdms_file_is_refused(read):
    with pytest.raises(DataError, match=r"damaged TDMS|no columns of numbers"):
        read(b"TDSm" + bytes(range(200)), name="run.tdms")


def test_vectors_of_a_matlab_file_are_columns(tmp_path):
    from scipy.io import savemat

    path = tmp_path / "run.mat"
    savemat(path, {"u": U, "y": Y[:, None], "Ts": STEP, "gains": [1.0, 2.0, 3.0], "name": "axis"})
    rec = read_record(path)
    assert (rec.input, rec.output, rec.sample_time) == ("u", "y", STEP)
    assert rec.y == pytest.approx(Y)
    assert "the sample time 0.02 s is taken from Ts" in reported(rec)
    assert "not read, of another kind or length: gains, name" in reported(rec)
    savemat(path, {"data": np.column_stack([TIME, U, Y]), "fs": 50})
    assert read_record(path, "data_2", "data_3").u == pytest.approx(U)


def test_matlab_files_of_another_age_or_damaged_are_refused(read):
    with pytest.raises(DataError, match=r"MATLAB 7\.3 file.*-v7"):
        read(b"MATLAB 7.3 MAT-file" + bytes(600), name="run.mat")
    with pytest.raises(DataError, match="damaged MATLAB"):
        read(b"MATLAB 5.0 MAT-file" + b"\xff" * 600, name="run.mat")


# Real measurements


@pytest.mark.parametrize(
    ("file", "rows"),
    [("LinA__pp-sine-sweep-10mm-0.5Hz.txt", 3001), ("LinA__no-pp-square-wave-10mm-1Hz.txt", 1001)],
)
def test_the_servo_axis_is_read_by_column_number(measurements, file, rows):
    path = measurements / "servo_sweep" / file
    rec = read_record(path, input="col3", output="col4", units={"time": "ms", "input": "mm", "output": "mm"})
    assert (len(rec), rec.sample_time, rec.starts) == (rows, 0.01, (0,))
    assert (rec.input, rec.output, rec.unit_y) == ("col3", "col4", "mm")
    assert np.array_equal(rec.u, np.loadtxt(path)[:, 2])
    assert "clipped" not in reported(rec)
    with pytest.raises(UsageError, match="5 columns are possible"):
        read_record(path)
    assert looks_like_record(path)


@pytest.mark.parametrize(("file", "rows"), [("dryer.dat", 1000), ("robot_arm.dat", 1024)])
def test_daisy_files_are_read_with_a_sample_time(measurements, file, rows):
    path = measurements / "daisy" / file
    rec = read_record(path, sample_time=0.08)
    assert (len(rec), rec.sample_time, rec.input, rec.output) == (rows, 0.08, "col1", "col2")
    assert np.array_equal(rec.y, np.loadtxt(path)[:, 1])
    with pytest.raises(UsageError, match="no column of times"):
        read_record(path)


@pytest.mark.parametrize("file", ["data_emps.csv", "data_emps_pulses.csv"])
def test_the_emps_drive_is_read_at_one_kilohertz(measurements, file):
    path = measurements / "emps" / file
    rec = read_record(path, "vir", "qm", units={"input": "V", "output": "m"})
    assert (len(rec), rec.sample_time, rec.starts) == (24841, 0.001, (0,))
    assert (rec.unit_u, rec.unit_y) == ("V", "mm")
    assert rec.y == pytest.approx(1000 * np.loadtxt(path, delimiter=",", skiprows=1)[:, 2])
    assert "differ from that by 0.00" in reported(rec)
    slow = rec.decimated(10)
    assert (len(slow), slow.sample_time) == (2485, pytest.approx(0.01))
    assert slow.y == pytest.approx(rec.y[::10], abs=0.01)  # mm: a slide has nothing to say above 40 Hz
    assert looks_like_record(path)
