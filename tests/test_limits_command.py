"""``fitmodels limits``: what the machine allows goes into the file, or one sentence says why not."""

import json

import pytest
from fitmodels import parameters
from fitmodels.cli import main
from fitmodels.parameters.file import sealed
from fitmodels.parameters.published import published


@pytest.fixture
def file(tmp_path):
    bare = sealed(published("AC-2017"), limits=None)
    return str(parameters.write(bare, tmp_path / "params.json"))


def test_limits_are_written_with_their_units_and_what_they_are_of(file):
    assert main(["limits", file, "P=7kW", "Fxz=1500", "AW=300um", "V=50:200m/min", "f=0.06:0.6"]) == 0
    pf = parameters.read(file)
    assert (pf.limits.power.value, pf.limits.power.unit) == (7.0, "kW")
    assert (pf.limits.force.value, pf.limits.force.unit, pf.limits.force.of) == (1500.0, "N", "Fxz")
    assert (pf.limits.wear.value, pf.limits.wear.unit) == (300.0, "um")
    assert (pf.limits.feed.low, pf.limits.feed.high, pf.limits.feed.unit) == (0.06, 0.6, "mm/rev")
    assert parameters.check(pf).ok


@pytest.fixture
def computed(tmp_path):
    """The paper's file with a power that was computed from the force."""
    pf = published("AC-2017")
    note = "P is computed, not measured: P = Fc V/60000; its law is that of Fc with this equation"
    laws = {**pf.laws, "P": pf.laws["P"].model_copy(update={"notes": (*pf.laws["P"].notes, note)})}
    return str(parameters.write(sealed(pf, laws=laws), tmp_path / "computed.json"))


OF_CUT = "P is the power of the cut, without the losses of the drive, computed by P = Fc V/60000"
RATING = f"{OF_CUT}: the limit 7 kW must be the rating of the motor times the efficiency of the drive."


def test_a_limit_of_power_says_whether_it_is_compared_with_the_power_of_the_cut(computed, file, capsys):
    def said(*words):
        assert main([*words]) == 0
        return " ".join(capsys.readouterr().out.split())

    assert RATING in said("limits", computed, "P=7kW")
    assert RATING in said("check", computed)
    assert said("replay", computed, "--system", "region").count(RATING) == 1
    measured = said("limits", file, "P=7kW")
    assert "P is as the tests state it: if that is at the motor, its limit is the rating of the motor" in measured
    assert "the power of the cut" not in said("check", file)


def test_exports_and_optimum_state_that_the_limit_is_of_the_power_of_the_cut(computed, tmp_path, capsys):
    def text(*words):
        target = tmp_path / "made"
        words = ["export", computed, *words, "--out", str(target), "--force", "--accept-verdict", "--diameter", "60mm"]
        assert main(words) == 0, capsys.readouterr().err
        return target.read_text()

    def flat(lines, mark):
        return " ".join(lines.replace(mark, " ").split())

    assert RATING in flat(text("--to", "c", "--system", "region"), "\n * ")
    assert RATING in flat(text("--to", "c", "--system", "recursion"), "\n * ")
    program = text("--to", "nc", "--length", "200mm", "--max-rpm", "2500")
    assert "the rating of the motor times the efficiency of the drive" in flat(program.replace(")\n(fm -", " "), "(fm")
    assert main(["costs", computed, "machine=60/h", "edge=8", "change=1.5min", "currency=EUR", "efficiency=0.8"]) == 0
    capsys.readouterr()
    assert main(["optimum", computed, "--accept-verdict"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert f"{RATING} The efficiency 0.8 of the costs is not applied to it." in out


def test_what_is_not_named_stays_and_what_stands_needs_force(file, capsys):
    assert main(["limits", file, "P=7kW"]) == 0
    assert main(["limits", file, "AW=0.3mm"]) == 0
    assert main(["limits", file, "P=8kW"]) == 2
    assert "--force" in capsys.readouterr().err
    assert main(["limits", file, "P=8kW", "--force"]) == 0
    limits = parameters.read(file).limits
    assert (limits.power.value, limits.wear.value) == (8.0, 0.3)


def test_the_json_is_what_was_written(file, capsys):
    assert main(["limits", file, "P=7kW", "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["schema"] == "fitmodels.limits/3"
    assert facts["limits"]["power"] == {"value": 7.0, "unit": "kW", "of": "P"}


def test_the_verdict_of_the_laws_that_a_limit_is_of_is_printed(file, capsys):
    assert main(["limits", file, "P=7kW", "V=50:200m/min"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert out.count("Verdict on the law of") == 1
    assert "Verdict on the law of P: usable with reservations. Assumed, not printed: the range of t and AW." in out
    assert main(["limits", file, "f=0.06:0.6"]) == 0
    assert "Verdict" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("word", "says"),
    [
        ("Q=3", "there is no such limit"),
        ("P=7mm", "not a unit of P"),
        ("P=5:7kW", "one number"),
        ("V=200m/min", "low:high"),
        ("V=200:50m/min", "below high"),
        ("P=0kW", "above zero"),
        ("P=-7kW", "above zero"),
        ("Fc=900N", "has laws of AW"),
        ("P", "write it as"),
        ("P=seven", "one number"),
        ("P=0,28kW", "with decimal points"),
        ("n=2000:40001/min", "number and unit /min cannot be separated for sure; write rpm, or no unit"),
    ],
)
def test_a_limit_that_cannot_be_is_one_sentence_and_the_file_stays(file, word, says, capsys):
    before = parameters.read(file)
    assert main(["limits", file, word]) == 2
    said = capsys.readouterr().err
    assert says in said
    assert said.count("\n") == 1
    assert parameters.read(file) == before


def test_two_limits_of_one_kind_are_refused(file, capsys):
    assert main(["limits", file, "V=50:200m/min", "P=7kW", "P=8kW"]) == 2
    assert "twice" in capsys.readouterr().err


def test_the_file_remembers_which_commands_made_it(file):
    assert main(["limits", file, "P=7kW"]) == 0
    assert main(["limits", file, "AW=0.3mm", "P=8kW", "--force"]) == 0
    assert parameters.read(file).provenance.then == (
        f"fitmodels limits {file} P=7kW",
        f"fitmodels limits {file} AW=0.3mm P=8kW --force",
    )


def test_any_response_with_a_law_is_limited_and_life_from_below(file, capsys):
    pf = parameters.read(file)
    wear = pf.laws["AW"].model_dump()
    others = {
        symbol: {**wear, "response": symbol, "unit": unit, "edges": None}
        for symbol, unit in (("Ra", "um"), ("T", "min"))
    }
    parameters.write(sealed(pf, laws={**pf.model_dump()["laws"], **others}), file, replaces=pf)
    assert main(["limits", file, "Ra=3.2um", "T=15min"]) == 0
    said = capsys.readouterr().out
    assert "Ra at most 3.2 um." in said
    assert "T at least 15 min." in said
    assert main(["limits", file, "Ra=0.4:1.6um"]) == 2
    assert "limit of Ra; replace it with --force" in capsys.readouterr().err
    assert main(["limits", file, "Ra=0.4:1.6um", "P=7kW", "--force"]) == 0
    found = parameters.read(file).limits
    assert (found.responses["Ra"].low, found.responses["Ra"].high, found.responses["T"].low) == (0.4, 1.6, 15.0)
    assert found.power.value == 7.0
    assert main(["limits", file, "Ra=3.2mm/rev"]) == 2
    assert main(["limits", file, "Rz=3.2"]) == 2


def test_limits_of_a_later_version_are_kept_and_not_named(file, capsys):
    pf = parameters.read(file)
    parameters.write(sealed(pf, limits={"torque": 3, "reason": "unknown"}), file, force=True)
    assert main(["limits", file, "P=7kW"]) == 0
    assert "torque" not in capsys.readouterr().out.lower()
    assert parameters.read(file).limits.torque == 3


@pytest.mark.parametrize("paper", ["LYAP", "SURF"])
def test_a_limit_of_force_is_taken_where_a_control_uses_it(paper, tmp_path, capsys):
    """It was refused: "the limit would have no effect", although the section makes it the overload."""
    path = str(tmp_path / "params.json")
    pf = sealed(published(paper), limits=None)
    laws = {name: law for name, law in pf.model_dump()["laws"].items() if name != "F"}
    parameters.write(sealed(pf, laws=laws), path)
    assert main(["limits", path, "F=900N"]) == 0
    limit = parameters.read(path).limits.force
    assert (limit.value, limit.unit, limit.of) == (900.0, "N", "F")
    assert main(["limits", path, "P=7kW"]) == 2
    assert "so the limit would have no effect" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("word", "words"),
    [
        ("AW=30mm", "limits.wear: AW up to 30 mm is impossible, beyond 5 mm"),
        ("P=7000kW", "limits.power: P up to 7000 kW is impossible, beyond 2000 kW"),
        ("P=1e300kW", "impossible, beyond 2000 kW"),
        ("V=50:20000m/min", "limits.speed: V up to 20000 m/min is impossible, beyond 12000 m/min"),
    ],
)
def test_an_impossible_limit_is_refused_and_fails_the_check(file, word, words, capsys):
    """30 mm of wear, typed for 0.30, went through to a running control."""
    assert main(["limits", file, word]) == 2
    assert words in capsys.readouterr().err
    pf = parameters.read(file)
    assert pf.limits is None
    kind = {"A": "wear", "P": "power", "V": "speed"}[word[0]]
    stated = {"wear": {"value": 30.0, "unit": "mm", "of": "AW"}, "power": {"value": 7e3, "unit": "kW", "of": "P"},
              "speed": {"low": 50.0, "high": 2e4, "unit": "m/min"}}  # fmt: skip
    failed = parameters.check(sealed(pf, limits={kind: stated[kind]})).failed
    assert any("is impossible" in finding.words for finding in failed)


@pytest.mark.parametrize(
    ("word", "words"),
    [
        ("P=700kW", "limits.power: P up to 700 kW is unusual, beyond 100 kW: check its unit."),
        ("AW=3mm", "limits.wear: AW up to 3 mm is unusual, beyond 1 mm: check its unit."),
        ("P=7kW", ""),
        ("AW=0.3mm", ""),
        ("V=50:200m/min", ""),
        ("n=50:2500rev/min", ""),
    ],
)
def test_an_unusual_limit_is_doubted_and_an_ordinary_one_is_not(file, word, words, capsys):
    assert main(["limits", file, word]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert (f"! {words}" in said) if words else ("!" not in said)
    doubts = [f.words for f in parameters.check(parameters.read(file)).findings if f.name == "doubt"]
    assert (words in doubts) if words else not doubts


def test_a_wear_limit_other_than_the_criterion_of_the_tool_life_is_doubted(file):
    """`merge` calls the two a conflict; in one file nothing was said."""
    life = {
        "wear": "AW", "criterion": 0.3, "unit_of_wear": "mm", "unit": "min", "coefficients": {"c0": 1e6, "V": -2.4},
        "t_observed": 20.0, "wear_observed": 0.1, "typical": 16.0, "typical_at": {"V": 100.0},
    }  # fmt: skip
    limit = {"unit": "mm", "of": "AW"}
    pf = parameters.read(file)
    pf = sealed(pf, tool_life=life, laws={"AW": pf.laws["AW"].model_dump()})

    def doubts(value):
        found = parameters.check(sealed(pf, limits={"wear": {"value": value, **limit}})).findings
        return " ".join(f.words for f in found if f.name == "doubt")

    assert doubts(0.3) == ""
    assert "limits.wear is 0.2 mm, and the tool life of the file is at 0.3" in doubts(0.2)
    assert "5 times the largest tested, 0.1 mm" in doubts(0.5)
