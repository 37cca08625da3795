"""Values and turning plan in G-code, run by LinuxCNC's own interpreter (`rs274 -g`); ini, read by configparser."""

import csv
import io
import math
import re
import subprocess
from configparser import ConfigParser, DuplicateOptionError, Error, RawConfigParser
from dataclasses import replace
from decimal import Decimal
from itertools import pairwise, product

import numpy as np
import pytest
from fitmodels import parameters
from fitmodels.cli import main
from fitmodels.controllers.exports import ExportJob, exported
from fitmodels.controllers.exports.turning_job import FOOT, INCH, Stretch, TurningJob
from fitmodels.controllers.exports.turning_plan import SETTLE
from fitmodels.controllers.exports.turning_program import TurningRequest, csv_table, nc_program, turning_export
from fitmodels.controllers.recursion.from_file import life_laws
from fitmodels.controllers.recursion.laws import response_at_end
from fitmodels.controllers.recursion.plan import PlanOptions, plan_of
from fitmodels.core.errors import GateError, UsageError
from fitmodels.datasets.units import canonical
from fitmodels.parameters.exports import export_format
from fitmodels.parameters.exports.quantities import Quantity
from fitmodels.parameters.exports.text_formats import fixed
from fitmodels.parameters.exports.view import export_view
from fitmodels.parameters.file import sealed
from fitmodels.parameters.published import published
from hypothesis import given
from hypothesis import strategies as st

INSTALL = "apt-get install linuxcnc-uspace"
PRINTED = 6  # decimals of rs274


def ngc_of(pf) -> str:
    return export_format("ngc").render(export_view(pf))


@pytest.fixture
def rs274(consumer, tmp_path):
    program = consumer("rs274", INSTALL)

    def run(text: str) -> subprocess.CompletedProcess[str]:
        (tmp_path / "test.ngc").write_text(text)
        return subprocess.run([program, "-g", "test.ngc"], cwd=tmp_path, capture_output=True, text=True, timeout=60)

    return run


def scale(value: float) -> int:
    """Power of ten that leaves a value of 1 to 10 for the six decimals that are printed."""
    return math.floor(math.log10(abs(value))) if value else 0


@pytest.mark.consumer
def test_every_value_arrives_under_its_name_and_its_number(rs274, constant_load_file):
    pf = constant_load_file()
    quantities = export_view(pf).quantities
    asked = "".join(
        f"(DEBUG,{q.name} #{9 + 2 * k})\n(DEBUG,{q.name} #{10 + 2 * k})\n" for k, q in enumerate(quantities)
    )
    copies = "".join(
        f"#{9 + 2 * k}=[#<_fm_{q.name}>/{fixed(float(Decimal(10) ** scale(q.value)))}]\n"
        f"#{10 + 2 * k}=[#{500 + k}/{fixed(float(Decimal(10) ** scale(q.value)))}]\n"
        for k, q in enumerate(quantities)
    )
    text = ngc_of(pf).removesuffix("%\n") + copies + asked + "%\n"
    said = rs274(text)
    assert said.returncode == 0, said.stderr
    printed = re.findall(r'MESSAGE\("(\w+) (-?[\d.]+)"\)', said.stdout)
    expected = [(q.name, f"{q.value / 10.0 ** scale(q.value):.{PRINTED}f}") for q in quantities for _ in (1, 2)]
    assert [name for name, _ in printed] == [name for name, _ in expected]
    for (name, ours), (_, theirs) in zip(expected, printed, strict=True):
        assert float(theirs) == pytest.approx(float(ours), abs=2 * 10.0**-PRINTED), name
    assert "ENABLE_ADAPTIVE_FEED()" in said.stdout


@pytest.mark.consumer
@pytest.mark.parametrize(
    ("broken", "by"),
    [("#<_fm_kp>=300", "#<_fm_kp>=3e2"), ("(fm - ", "(fm ("), ("\nM52 P1", "\nM52 P"), ("#<_fm_ki>=", "#<_fm_ki=")],
)
def test_a_broken_file_does_not_run(rs274, constant_load_file, broken, by):
    text = ngc_of(constant_load_file())
    assert broken in text
    assert rs274(text).returncode == 0
    assert rs274(text.replace(broken, by, 1)).returncode != 0


@pytest.mark.consumer
def test_rapids_run_without_adaptive_feed_and_cuts_with_it(rs274, constant_load_file):
    """The program of the exported pattern: a move written where its lines say so."""
    text = (
        ngc_of(constant_load_file())
        .replace("(fm - write G0 here)", "G0 X1")
        .replace("(fm - write G1 here", "G1 X2 F1000 (")
    )
    order = re.findall(
        r"DISABLE_ADAPTIVE_FEED|ENABLE_ADAPTIVE_FEED|STRAIGHT_TRAVERSE|STRAIGHT_FEED", rs274(text).stdout
    )
    moves = ["DISABLE_ADAPTIVE_FEED", "STRAIGHT_TRAVERSE", "ENABLE_ADAPTIVE_FEED", "STRAIGHT_FEED"]
    assert order[: len(moves)] == moves


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_a_number_has_no_exponent_and_reads_back_to_the_same_float(value):
    text = fixed(value)
    assert re.fullmatch(r"-?\d+(\.\d+)?", text)
    assert float(text) == value


def test_no_line_is_longer_than_linuxcnc_reads(constant_load_file):
    pf = constant_load_file(identity={"tool": "x" * 500, "work": "y" * 500})
    assert max(len(line) for line in ngc_of(pf).splitlines()) < 255


# The ini export


def ini_of(pf) -> str:
    return export_format("ini").render(export_view(pf))


@pytest.mark.parametrize("reader", [ConfigParser, RawConfigParser])
def test_every_value_reads_back_exactly_with_its_unit_and_words(constant_load_file, reader):
    pf = constant_load_file()
    ini = reader()
    ini.read_string(ini_of(pf))
    quantities = export_view(pf).quantities
    assert [(k, float(v)) for k, v in ini["values"].items()] == [(q.name, q.value) for q in quantities]
    assert dict(ini["units"]) == {q.name: q.unit for q in quantities}
    assert dict(ini["words"]) == {q.name: q.words for q in quantities}
    assert ini["about"]["tool"] == "GC435"
    assert ini.getboolean("about", "simulated")


def test_a_file_written_as_json_and_read_again_gives_the_same_text(constant_load_file, tmp_path):
    pf = constant_load_file()
    again = parameters.read(parameters.write(pf, tmp_path / "params.json"))
    assert ini_of(again) == ini_of(pf)


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_any_number_reads_back_to_the_same_float(seen, value):
    ini = ConfigParser()
    ini.read_string(export_format("ini").render(replace(seen, quantities=(Quantity("x", value, "%", "drawn"),))))
    assert float(ini["values"]["x"]) == value
    assert canonical(ini["units"]["x"]) == "%"


@pytest.fixture(scope="module")
def seen(constant_load_file):
    return export_view(constant_load_file())


@pytest.mark.parametrize(
    ("broken", "by"), [("[about]\n", ""), ("\nki = ", "\nkp = "), ("[units]", "[values]"), ("kp = 300.0", "kp")]
)
def test_a_broken_one_is_refused(constant_load_file, broken, by):
    text = ini_of(constant_load_file())
    assert broken in text
    with pytest.raises(Error):
        ConfigParser().read_string(text.replace(broken, by, 1))


def test_no_key_stands_twice_though_keys_have_no_case(constant_load_file):
    doubled = ini_of(constant_load_file()) + "KP = 1\nkp = 2\n"
    with pytest.raises(DuplicateOptionError):
        ConfigParser().read_string(doubled)


# The turning plan

PASSES = ((Stretch(80.0, 200.0),), (Stretch(75.0, 200.0),))
CHOICES = list(product(("linuxcnc", "fanuc"), (False, True), ("G96", "G97"), ("G95", "G94")))


@pytest.fixture(scope="module")
def turned():
    """The plan of AC-2017 on a job, by choices of the job and of the plan."""
    pf = published("AC-2017")

    def make(file=pf, options=None, **choices):
        job = TurningJob(**{"passes": PASSES, "max_rpm": 2500.0, "parts": 11, **choices})
        return turning_export(file, TurningRequest(options or PlanOptions(), job))

    return make


def for_rs274(program: str) -> tuple[str, list[str]]:
    """A program in words of LinuxCNC, and the lines with the cap of a Fanuc program, for which RS274 has no word."""
    if "O0001" not in program:
        return program, []
    caps = re.findall(r"^G50 S(\d+)$", program, re.M)
    words = {
        r"^O0001$": "G7 G90", r"^G50 S\d+$": "", r"^T(\d\d)\1$": r"T\1 M6", r"^G98 G4 U2\.$": "G4 P2", r"^G98 ": "G94 ",
        r"^G99 ": "G95 ",
    }  # fmt: skip
    for fanuc, linuxcnc in words.items():
        program = re.sub(fanuc, linuxcnc, program, flags=re.M)
    return program, caps


def cuts_of(said: str) -> list[dict[str, float]]:
    """Position, S, F, modes and cap of every feed move that rs274 printed."""
    state, cuts = {"cap": 0.0}, []
    for name, text in re.findall(r"(\w+)\(([^()]*)\)", said):
        numbers = [float(number) for number in re.findall(r"-?\d+\.?\d*", text)]
        if name == "SET_SPINDLE_MODE":
            state["cap"] = numbers[1]
        elif name == "SET_SPINDLE_SPEED":
            state["S"] = numbers[1]
        elif name == "SET_FEED_RATE":
            state["F"] = numbers[0]
        elif name == "SET_FEED_MODE":
            state["per_rev"] = numbers[1]
        elif name == "STRAIGHT_FEED":
            cuts.append({**state, "X": 2 * numbers[0], "Z": numbers[2]})
    return cuts


@pytest.mark.consumer
@pytest.mark.parametrize(("dialect", "inch", "speed", "feed"), CHOICES)
def test_every_S_F_and_Z_arrives_as_planned(rs274, turned, dialect, inch, speed, feed):
    made = turned(dialect=dialect, inch=inch, speed=speed, feed=feed, tool=1, max_rpm=2499.7)
    program, caps = for_rs274(nc_program(made))
    said = rs274(program)
    assert said.returncode == 0, said.stderr
    found, moves = cuts_of(said.stdout), made.part.moves
    assert len(found) == len(moves) >= 37
    for name, digits in (("S", 4), ("F", 4), ("Z", 4), ("X", 4)):
        got, planned = ([round(each, digits) for each in values] for values in (
            [cut[name] for cut in found], [getattr(move, name) for move in moves],
        ))  # fmt: skip
        assert np.abs(np.subtract(got, planned)).max() <= (2e-4 if name == "X" else 1e-4)
    assert {cut.get("per_rev", 0.0) for cut in found} == {1.0 if feed == "G95" else 0.0}
    cap = 2499.0 if speed == "G96" else 0.0
    assert {cut["cap"] for cut in found} == {cap if dialect == "linuxcnc" else cap and found[0]["cap"]}
    assert caps == (["2499"] if dialect == "fanuc" else [])
    assert said.stdout.count("PROGRAM_STOP") == 10  # before parts 2 to 11, one of them with a change of the edge


@pytest.mark.consumer
@pytest.mark.parametrize(
    ("broken", "by"), [("G96 D2500 S", "G96 D2500 M3 R"), ("(fm - edge 1, ", "(fm - (edge 1, "), ("F0.58", "F")]
)
def test_a_broken_turning_program_does_not_run(rs274, turned, broken, by):
    program = nc_program(turned())
    assert rs274(program).returncode == 0
    assert rs274(program.replace(broken, by, 1)).returncode != 0


@pytest.mark.parametrize(("dialect", "inch", "speed", "feed"), CHOICES)
def test_no_speed_and_no_feed_exceeds_the_plan_and_every_pass_is_cut_whole(turned, dialect, inch, speed, feed):
    made = turned(dialect=dialect, inch=inch, speed=speed, feed=feed)
    rows = dict(enumerate(made.plan.rows, 1))
    ends: dict[tuple[int, int], float] = {}
    for move in made.part.moves:
        row = rows[move.row]
        assert row.start - 1e-9 <= move.start < move.end <= row.end + 1e-9
        assert (move.V, move.f, move.depth) == (row.V, row.f, row.d)
        assert 0.985 * row.V < move.speed <= row.V * (1 + 5e-5 * inch)
        assert move.feed(made.part.job) <= row.f * (1 + 1e-12)
        assert move.settling or move.feed(made.part.job) > 0.997 * row.f
        ends[move.part, move.number] = min(move.Z, ends.get((move.part, move.number), 0.0))
    assert set(ends.values()) == {round(-200.0 / (INCH if inch else 1.0), 4)}
    assert set(ends) == set(product(range(1, 12), (1, 2)))


def lagging(before: float, after: float, minutes: float) -> float:
    """Speed of a spindle that reaches a new speed in `SETTLE` s, at a time after the change."""
    return before + (after - before) * min(60.0 * minutes / SETTLE, 1.0)


@pytest.mark.parametrize(("speed", "feed"), list(product(("G96", "G97"), ("G95", "G94"))))
def test_a_spindle_that_needs_its_time_never_cuts_thicker_or_harder_than_the_plan(turned, speed, feed):
    """F of the new row in G94 while the spindle still ran at the old speed cut up to a tenth thicker."""
    part, laws = turned(speed=speed, feed=feed).part, life_laws(published("AC-2017"))
    for old, new in pairwise(part.moves):
        if (old.part, old.number) != (new.part, new.number) or old.n == new.n:
            continue
        lasts = min(new.end - new.start, SETTLE / 60.0)
        for minutes in np.linspace(0.0, lasts, 9):
            n = lagging(old.n, new.n, minutes)
            f = new.F if feed == "G95" else new.F / n
            assert f <= max(old.f, new.f) * (1 + 1e-9)
            V = np.pi * new.diameter * n / 1000.0
            wear = old.wear + (new.wear - old.wear) * minutes / (new.end - new.start)
            power = response_at_end(laws.power, part.edge.rules, V, f, new.start + minutes, wear)
            assert power <= 7.0 * 1.002  # wear grows in the 2 s in which the spindle slows down


def test_an_edge_is_changed_before_the_pass_that_it_does_not_finish(turned):
    part = turned().part
    lives = {move.edge: move for move in part.moves}
    assert sorted(lives) == [1, 2]
    assert lives[1].end == pytest.approx(13.7853, abs=1e-4)
    assert (lives[1].part, lives[1].number) == (9, 2)
    assert max(move.wear for move in part.moves) <= 0.3
    program = nc_program(turned(tool=3))
    assert program.count("T3 M6") == 2
    assert "(fm - edge 1 ends after 13.79 min - change the edge)\nM0\nT3 M6\nG43" in program
    assert turned(parts=None).part.moves[-1].part == 9
    with pytest.raises(UsageError, match="pass 1 outlasts a new edge, whose plan ends after 14 min"):
        turned(passes=((Stretch(80.0, 6000.0),),))


def test_a_program_goes_on_where_the_last_one_ended(turned):
    whole = turned(parts=9).part.moves
    first = turned(parts=4).part.moves
    second = turned(parts=5, start=first[-1].end).part.moves
    assert len(first) + len(second) == len(whole)
    for ours, theirs in zip([*first, *second], whole, strict=True):
        assert (ours.S, ours.F, ours.Z) == (theirs.S, theirs.F, theirs.Z)
        assert ours.wear == pytest.approx(theirs.wear, rel=1e-12)
    with pytest.raises(UsageError, match="worn out after 14 min"):
        turned(start=14.0)


def test_a_program_begins_with_the_change_of_an_edge_that_no_pass_is_left_for(turned):
    program = nc_program(turned(parts=1, start=13.9, tool=3))
    stop = program.index("(fm - edge 1 ends after 13.90 min - change the edge)\nM0\nT3 M6\nG43")
    assert stop < program.index("G0 X") < program.index("G1 Z")
    assert "(fm - edge 2, part 1, pass 1, minutes 0.00" in program


def test_part_and_edge_are_changed_at_one_stop(turned):
    program = nc_program(turned(parts=10, tool=None))
    assert "(fm - part 9 is finished - load the next part)\n(fm - edge 1 ends after 13.79 min" in program


@pytest.mark.parametrize(("inch", "place"), [(False, "G0 Z150.000\nG0 X200.000"), (True, "G0 Z5.9055\nG0 X7.8740")])
def test_the_tool_stands_clear_of_the_work_at_each_stop(turned, inch, place):
    made = turned(parts=2, inch=inch, retract=(200.0, 150.0))
    program = nc_program(made)
    assert program.count(place) == program.count("M5\n") == 2
    assert "at each M0 and at the end the tool stands at X" in program
    assert any("too near for hands: --retract" in words for words in turned(parts=2).notes)
    with pytest.raises(UsageError, match="not clear of the work: give a diameter of at least 84 mm"):
        turned(retract=(80.0, 150.0))


def refused_and_named(pf, to, symbol, words):
    """The export is refused with these words, and names the limit where it is accepted."""
    job = ExportJob(diameter=(80.0, 80.0), turning=TurningRequest(job=TurningJob(PASSES, 2500.0, parts=1)))
    with pytest.raises(GateError, match=words):
        exported(pf, to, system="recursion", job=job)
    made = exported(pf, to, system="recursion", job=replace(job, accept_verdict=True))
    assert "NOT CHECKED by the plan" in made.content
    assert any(note.startswith(f"NOT CHECKED by the plan: the limit of {symbol}") for note in made.notes)


@pytest.mark.parametrize("to", ["nc", "csv", "c", "st"])
def test_a_limit_that_the_plan_does_not_apply_is_refused_or_named(to):
    pf = published("AC-2017")
    limits = {**pf.limits.model_dump(), "responses": {"T": {"low": 15.0, "high": None, "unit": "min"}}}
    words = r"limits T at least 15 min, and the plan does not .*`fitmodels optimum`"
    refused_and_named(sealed(pf, limits=limits), to, "T", words)


@pytest.mark.parametrize("to", ["nc", "csv", "c", "st"])
def test_a_limit_of_force_without_a_law_is_refused_or_named(to):
    pf = published("AC-2017")
    pf = sealed(pf, laws={name: law for name, law in pf.model_dump()["laws"].items() if name != "Fxz"})
    refused_and_named(pf, to, "Fxz", r"limits Fxz at most 1500 N.* no law of Fxz: fit one")


def test_the_smaller_of_two_spindle_limits_counts_and_is_rounded_down(turned):
    pf = published("AC-2017")
    limits = {**pf.limits.model_dump(), "spindle_speed": {"low": 50.0, "high": 700.7, "unit": "1/min"}}
    slow = sealed(pf, limits=limits)
    made = turned(slow, max_rpm=2500.0, parts=None)
    assert "G96 D700 " in nc_program(made)
    assert max(move.n for move in made.part.moves) <= 700.0
    laws = life_laws(pf)
    lowered = [move for move in made.part.moves if move.lowered]
    assert lowered
    for move in lowered:  # force rises as the speed falls, so the feed is lowered too
        force = response_at_end(
            laws.force, made.part.edge.rules, move.speed, move.feed(made.part.job), move.end, move.wear
        )
        assert force <= 1500.0 * (1 + 1e-6)
    assert "highest spindle speed 2499 1/min" in nc_program(turned(max_rpm=2499.7))
    with pytest.raises(UsageError, match="give --max-rpm"):
        turned(max_rpm=0.0)
    with pytest.raises(UsageError, match="no feed keeps the limits"):
        turned(max_rpm=300.0)


def test_a_change_of_depth_along_the_part_takes_the_pair_of_that_depth_in_time(turned):
    pf = published("AC-2017")
    stated = turned(passes=((Stretch(80.0, 200.0, 2.5),),), parts=None).part
    assert not stated.edge.others
    assert [(m.S, m.F, m.Z) for m in stated.moves] == [
        (m.S, m.F, m.Z) for m in turned(passes=((Stretch(80.0, 200.0),),), parts=None).part.moves
    ]
    part = turned(passes=((Stretch(78.0, 120.0, 1.5), Stretch(80.0, 80.0)),), parts=3).part
    one = [move for move in part.moves if (move.part, move.edge) == (1, 1)]
    laws = {d: life_laws(pf, d=d) for d in (1.5, 2.5)}
    assert one[0].depth == 1.5
    before = [move for move in one if move.depth == 2.5 and move.Z >= -120.0]
    assert before, "the pair of the larger depth is taken before it begins"
    assert sum(move.end - move.start for move in before) * 60.0 >= SETTLE
    for move in part.moves:
        power = response_at_end(
            laws[move.depth].power, part.edge.rules, move.speed, move.feed(part.job), move.end, move.wear
        )
        assert power <= 7.0
    with pytest.raises(UsageError, match="plunge into the work"):
        turned(passes=((Stretch(80.0, 120.0, 1.5), Stretch(80.0, 80.0)),))
    with pytest.raises(UsageError, match="use --objective removal"):
        turned(
            passes=((Stretch(78.0, 120.0, 1.5), Stretch(80.0, 80.0)),), options=PlanOptions(objective="time", time=5.0)
        )


def test_a_pass_begins_at_the_diameter_that_the_last_one_leaves(turned):
    """Pass 2 at 70 mm where pass 1 leaves 75 was cut 5 mm deep by a plan of 2.5 mm."""
    for wrong in (70.0, 80.0):
        with pytest.raises(UsageError, match=rf"pass 2 begins at a diameter of {wrong:g} mm .* leaves 75 mm"):
            turned(passes=((Stretch(80.0, 200.0),), (Stretch(wrong, 100.0),)))
    steps = ((Stretch(80.0, 100.0), Stretch(85.0, 50.0)), (Stretch(75.0, 100.0),), (Stretch(80.0, 150.0),))
    with pytest.raises(UsageError, match="pass 3 begins at a diameter of 80 mm where an earlier pass leaves 70 mm"):
        turned(passes=steps)
    assert turned(passes=(*steps[:2], (Stretch(70.0, 100.0), Stretch(80.0, 50.0))), parts=1).part.moves


def test_what_is_outside_the_tests_is_marked_alike_in_every_format(turned):
    deep = PlanOptions(depth=4.0)
    said = plan_of(published("AC-2017"), None, deep).extrapolated
    assert said == ("EXTRAPOLATED: d 4 mm, tested 1.5 to 3 mm (AW, P, Fxz).",)
    made = turned(options=deep, parts=1, passes=((Stretch(80.0, 200.0),), (Stretch(72.0, 200.0),)))
    assert "(fm - EXTRAPOLATED - d 4 mm, tested 1.5 to 3 mm [AW, P, Fxz].)" in nc_program(made)
    running = ExportJob(turning=TurningRequest(deep), diameter=(80.0, 80.0), max_rpm=2500.0)
    assert all(line.removesuffix(".") in exported(published("AC-2017"), "c", system="recursion", job=running).content
               for line in said)  # fmt: skip
    plain = turning_export(published("AC-2017"), TurningRequest(deep))
    for table in (csv_table(made), csv_table(plain)):
        assert {row["marks"] for row in csv.DictReader(io.StringIO(table))} == {"EXTRAPOLATED"}
    assert "EXTRAPOLATED" not in nc_program(turned(parts=1)) + csv_table(turned(parts=1))


@pytest.mark.parametrize("to", ["nc", "csv", "c", "st"])
def test_a_depth_far_beyond_the_tests_needs_a_reason(to):
    pf, cut = published("AC-2017"), TurningJob(PASSES[:1], 2500.0, parts=1)

    def made(depth, reason=""):
        request = TurningRequest(PlanOptions(depth=depth), None if to == "csv" else cut, beyond_tests=reason)
        return exported(pf, to, system="recursion", job=ExportJob(diameter=(80.0, 80.0), turning=request))

    assert "BEYOND TESTS" not in made(1.1).content  # tested 1.5 to 3 mm
    with pytest.raises(GateError, match=r"d 1 mm lies 1.5-fold outside the tested 1.5 to 3 mm, .* --beyond-tests"):
        made(1.0)
    done = made(1.0, "trial on scrap")
    assert "BEYOND TESTS" in done.content
    assert "trial on scrap" in done.content
    assert any(words.startswith("BEYOND TESTS: d 1 mm") for words in done.notes)


@pytest.mark.parametrize(
    ("limits", "says"),
    [
        ({"wear": {"value": 3.0, "unit": "mm", "of": "AW"}}, r"t \d+ min lies [\d.]+-fold outside the tested 2 to 15"),
        ({"feed": {"low": 0.1, "high": 4.0, "unit": "mm/rev"}}, r"f [\d.]+ mm/rev lies [\d.]+-fold outside the"),
        ({"speed": {"low": 301.0, "high": 400.0, "unit": "m/min"}}, r"V [\d.]+ m/min lies [\d.]+-fold outside the"),
    ],
)
@pytest.mark.parametrize("to", ["csv", "c"])
def test_a_time_feed_or_speed_far_beyond_the_tests_needs_a_reason(to, limits, says):
    pf = published("AC-2017")
    free = {"power": None, "force": None} if "speed" in limits else {}
    wrong = sealed(pf, limits={**pf.limits.model_dump(), **free, **limits})

    def made(reason=""):
        turning = TurningRequest(PlanOptions(), beyond_tests=reason)
        return exported(wrong, to, system="recursion", job=ExportJob(diameter=(80.0, 80.0), turning=turning))

    with pytest.raises(GateError, match=rf"not exported: .*{says}.* --beyond-tests"):
        made()
    assert "trial on scrap" in made("trial on scrap").content


def test_a_part_that_ends_near_the_longest_test_is_cut_whatever_the_plan_lasts():
    pf = published("AC-2017")
    worn = {"power": None, "force": None, "wear": {"value": 3.0, "unit": "mm", "of": "AW"}}
    long = sealed(pf, limits={**pf.limits.model_dump(), **worn})
    one = TurningRequest(PlanOptions(), TurningJob(PASSES[:1], 2500.0, parts=1))
    assert "BEYOND TESTS" not in nc_program(turning_export(long, one))
    with pytest.raises(GateError, match="--beyond-tests"):
        turning_export(long, replace(one, job=replace(one.job, parts=None)))


@pytest.mark.parametrize("to", ["nc", "c"])
def test_a_plan_without_a_pair_names_the_limit_that_stops_the_slowest(to):
    job = ExportJob(diameter=(80.0, 80.0), turning=TurningRequest(PlanOptions(depth=20.0)))
    says = (
        r"at the slowest pair, .* d 20 mm, Fxz [\d.]+ N exceeds 1500 N after 1 min\. "
        r"EXTRAPOLATED: d 20 mm, tested 1.5 to 3 mm"
    )
    with pytest.raises(GateError, match=says):
        exported(published("AC-2017"), to, system="recursion", job=job)


def test_a_law_that_must_not_be_used_is_refused_and_simulated_data_are_marked(turned):
    pf = published("AC-2017")
    bad = {"level": "do not use for control", "reasons": ["The edges are not named."]}
    wear = {**pf.laws["AW"].model_dump(), "verdict": bad}
    laws = {**{name: law.model_dump() for name, law in pf.laws.items()}, "AW": wear}
    refused = sealed(pf, laws=laws, identity={**pf.identity.model_dump(), "simulated": True})
    with pytest.raises(GateError, match=r"not exported: laws\.AW: do not use for control"):
        turned(refused)
    job = ExportJob(accept_verdict=True, turning=TurningRequest(job=TurningJob(PASSES, 2500.0, parts=1)))
    program = exported(refused, "nc", job=job).content
    assert "(fm - SIMULATED data, not measured)" in program
    assert "(fm - VERDICT ACCEPTED - laws.AW - do not use for control)" in program
    for row in csv.DictReader(io.StringIO(exported(refused, "csv", job=job).content)):
        assert row["marks"] == "SIMULATED data, not measured - VERDICT ACCEPTED - laws.AW - do not use for control"


@pytest.mark.parametrize("dialect", ["linuxcnc", "fanuc"])
@pytest.mark.parametrize(
    "text", ["x)\nM30\n(", "(MSG, hi)", "%\nO9999", "=cmd|' /C calc'!A0", "T1 M6 ; G0 X0", "ü(" * 200]
)
def test_a_nasty_name_stays_in_its_comment(turned, dialect, text):
    pf = published("AC-2017")
    nasty = sealed(pf, identity={**pf.identity.model_dump(), "tool": text, "work": text, "machine": text})
    ours, other = (nc_program(turned(file, dialect=dialect, parts=1)) for file in (nasty, pf))
    blocks = [[line for line in program.splitlines() if not line.startswith("(")] for program in (ours, other)]
    assert blocks[0] == blocks[1]
    for line in ours.splitlines():
        assert line.isascii()
        assert len(line) < 255
        assert not line.startswith("(") or (line.endswith(")") and line.count("(") == line.count(")") == 1)
    assert dialect == "linuxcnc" or ours == ours.upper()


def test_the_table_holds_the_moves_in_its_units(turned):
    for inch, foot in ((False, 1.0), (True, FOOT)):
        made = turned(inch=inch, parts=2)
        rows = list(csv.DictReader(io.StringIO(csv_table(made))))
        names = ("S [ft/min]", "Z [in]", "V [ft/min]") if inch else ("S [m/min]", "Z [mm]", "V [m/min]")
        assert [tuple(float(row[name]) for name in names) for row in rows] == [
            (move.S, move.Z, pytest.approx(move.V / foot, rel=1e-5)) for move in made.part.moves
        ]
    table = csv_table(turning_export(published("AC-2017"), TurningRequest()))
    rows = list(csv.DictReader(io.StringIO(table)))
    assert [(float(row["V [m/min]"]), float(row["f [mm/rev]"])) for row in rows[:2]] == [(150.0, 0.58), (140.0, 0.58)]
    assert len(rows) == 14


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ([], "an NC program needs the part"),
        (["--diameter", "80"], "--diameter belongs to a part: give --diameter 80mm --length 200mm too"),
        (["--diameter", "80", "--length", "200"], "the highest spindle speed is not known: give --max-rpm 2500"),
        (["--diameter", "80N", "--length", "200"], "--diameter 80N: give a number in mm"),
        (["--pass", "80:200:2:1"], "--pass 80:200:2:1: give diameter:length"),
        (["--pass", "80:200", "--length", "20"], "--pass gives diameters and lengths itself"),
        (
            ["--diameter", "8", "--length", "20", "--passes", "2", "--max-rpm", "9e3"],
            "leaves nothing of a diameter of 3 mm",
        ),
        (["--pass", "80:200", "--max-rpm", "2500", "--from", "20"], "worn out after 14 min"),
        (["--pass", "80:200", "--max-rpm", "2500", "--tool", "0"], "--tool 0: give 1 to 99"),
    ],
)
def test_the_command_refuses_in_one_sentence_and_writes_nothing(tmp_path, monkeypatch, capsys, options, words):
    monkeypatch.chdir(tmp_path)
    parameters.write(published("AC-2017"), "params.json")
    assert main(["export", "params.json", "--to", "nc", *options]) in (2, 5)
    said = capsys.readouterr()
    assert words in said.err
    assert said.err.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["params.json"]


def test_the_command_writes_program_and_table_of_the_same_moves(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    parameters.write(published("AC-2017"), "params.json")
    part = ["--diameter", "3.15in", "--length", "200", "--passes", "2", "--max-rpm", "2500", "--parts", "2", "--mm"]
    for kind in ("nc", "csv"):
        assert main(["export", "params.json", "--to", kind, *part, "--feed-mode", "G94"]) == 0
    assert "2 parts, 1 edge" in capsys.readouterr().out
    blocks = re.findall(r"G1 Z(-\S+) F(\S+)", (tmp_path / "params.nc").read_text())
    rows = list(csv.DictReader(io.StringIO((tmp_path / "params.csv").read_text())))
    assert [(float(Z), float(F)) for Z, F in blocks] == [
        (float(row["Z [mm]"]), float(row["F [mm/min]"])) for row in rows
    ]
    assert main(["export", "params.json", "--to", "hal", "--tool", "3"]) == 2
    assert "--tool belongs to --to nc and --to csv" in capsys.readouterr().err
