"""The published schema, versions of it, and the checksum: judged by an independent validator and another reader."""

import copy
import hashlib
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from fitmodels import datasets, fit, parameters
from fitmodels.core.errors import ParameterError
from fitmodels.ident.model import Model
from fitmodels.parameters import check, collect, read, write
from fitmodels.parameters.file import sealed
from fitmodels.parameters.file_format import canonical_bytes, content_sha256, migrated
from fitmodels.parameters.gather.control import dynamics_section, model_of
from fitmodels.parameters.json_schema import DIALECT, build_schema, schema_text
from hypothesis import given
from hypothesis import strategies as st

SCHEMA = Path(parameters.__file__).parent / "schema" / "parameters-10.json"


def published():
    """The schema shipped with the package."""
    return json.loads(SCHEMA.read_text("utf-8"))


def validate(data):
    """Raise where the data break the shipped schema, which one test below checks by itself."""
    jsonschema.Draft202012Validator(published()).validate(data)


def whole():
    """A file with a fitted law, dynamics, gains and settings."""
    runs = datasets.read_runs(datasets.bundled("clm2023_end_milling"))
    model = Model(b=[0, 0.1, 0.08], a=[1, -0.8], nk=1, sample_time=0.02, cov_params=np.diag([1e-4] * 3), n=500)
    gains = {"kp": 0.4, "ki": 0.5, "sample_time": 0.02, "unit_u": "V", "unit_y": "A"}
    pf = collect(tool="end mill", work="S45C", laws=[fit.load_law(runs)], dynamics=model, pi=gains, limits={"power": 7})
    return sealed(pf, load_line=parameters.settings(pf, 0.28))


@pytest.fixture(scope="module")
def pf():
    return whole()


@pytest.fixture
def data(pf):
    return json.loads(json.dumps(pf.model_dump()))


# --- the schema ---------------------------------------------------------------------------------------


def test_the_published_schema_is_that_of_the_code():
    """Made again by `python -m fitmodels.parameters.json_schema`."""
    assert SCHEMA.read_text("utf-8") == schema_text()
    assert published() == build_schema()


def test_the_schema_is_one_by_its_dialect():
    assert published()["$schema"] == DIALECT
    jsonschema.Draft202012Validator.check_schema(published())


def test_a_written_file_is_valid_to_an_independent_validator(pf, tmp_path):
    validate(json.loads(write(pf, tmp_path / "params.json").read_text()))


@pytest.mark.parametrize(
    "change",
    [
        lambda d: d.pop("identity"),
        lambda d: d.pop("schema_version"),
        lambda d: d.update(schema_version="fitmodels.parameters/11"),
        lambda d: d["identity"].update(simulated="no"),
        lambda d: d["identity"].update(tool=""),
        lambda d: d["dynamics"].update(sample_time=0.0),
        lambda d: d["dynamics"].update(b=["0.1"]),
        lambda d: d["dynamics"].update(b=[0.0] * 101),
        lambda d: d["dynamics"]["uncertainty"].update(kind="guess"),
        lambda d: d["pi"].update(form="ideal"),
        lambda d: d["load_line"]["lower"].pop("interval"),
        lambda d: d["limits"]["power"].update(value=-1.0),
        lambda d: d["load_line"].update(engagement={"idle": 0.0}),
        lambda d: d["load_line"].update(engagement={"lost_after": 0.0}),
        lambda d: d["load_line"].update(engagement={"on_fault": "ignore"}),
        lambda d: d["load_line"].update(engagement={"feed_forward": 1.5}),
        lambda d: d["pi"].update(setpoint_weight=-0.1),
        lambda d: d.update(content_sha256="x"),
    ],
)
def test_schema_and_reader_refuse_the_same(data, change, tmp_path):
    change(data)
    with pytest.raises(jsonschema.ValidationError):
        validate(data)
    (tmp_path / "params.json").write_text(json.dumps(data))
    with pytest.raises(ParameterError):
        read(tmp_path / "params.json")


def test_unknown_fields_and_sections_are_allowed_and_kept(data, tmp_path):
    later = {"deep": [1, -0.0, {"µ": None}]}
    data |= {"later": later}
    for place in (data["dynamics"], data["pi"], data["load_line"]["lower"], data["limits"], data["identity"]):
        place["x-later"] = later
    validate(data)
    (tmp_path / "params.json").write_text(json.dumps(data))
    again = json.loads(write(read(tmp_path / "params.json"), tmp_path / "again.json").read_text())
    assert {**again, "content_sha256": None} == {**data, "content_sha256": None}


# --- versions -----------------------------------------------------------------------------------------


def moved(data):
    """An example of a step: version 1 kept the tool at the top, version 2 keeps it in the identity."""
    return {**{k: v for k, v in data.items() if k != "tool"}, "identity": {"tool": data["tool"]}}


STEPS = {1: moved, 2: lambda data: {**data, "third": True}}


def test_an_older_file_is_brought_up_step_by_step():
    old = {"schema_version": "fitmodels.parameters/1", "tool": "GC435", "x-later": [1]}
    before = copy.deepcopy(old)
    new = migrated(old, "params.json", STEPS, current=3)
    assert new == {
        "schema_version": "fitmodels.parameters/3", "identity": {"tool": "GC435"}, "x-later": [1], "third": True,
    }  # fmt: skip
    assert old == before


@pytest.mark.parametrize("held", [True, False])
def test_a_step_keeps_a_checksum_as_true_or_as_false_as_it_was(held):
    old = {"schema_version": "fitmodels.parameters/1", "tool": "GC435"}
    old["content_sha256"] = content_sha256(old) if held else "0" * 64
    new = migrated(old, "params.json", STEPS, current=3)
    assert (new["content_sha256"] == content_sha256(new)) is held


@pytest.mark.parametrize(
    ("version", "words"),
    [
        (
            "fitmodels.parameters/11",
            "newer schema 'fitmodels.parameters/11'; this version reads fitmodels.parameters/10",
        ),
        ("fitmodels.parameters/0", "older schema fitmodels.parameters/0, which this version cannot bring"),
        ("fitmodels.parameters/1", "breaks the older schema fitmodels.parameters/1 .KeyError"),
        ("fitmodels.card/1", "is it a parameter file"),
        ("fitmodels.parameters/one", "is it a parameter file"),
        ("fitmodels.parameters/²", "is it a parameter file"),
        (3, "schema_version is 3"),
    ],
)
def test_versions_that_cannot_be_read(version, words):
    with pytest.raises(ParameterError, match=words) as raised:
        migrated({"schema_version": version}, "params.json", STEPS, current=10)
    assert "\n" not in str(raised.value)


def test_a_file_of_version_1_is_read_with_unknown_doubts(data, tmp_path):
    """Version 1 had no section ``reading``; exports, card and check take the file, and its checksum stays valid."""
    old = {k: v for k, v in data.items() if k != "reading"} | {"schema_version": "fitmodels.parameters/1"}
    old["content_sha256"] = content_sha256(old)
    (tmp_path / "params.json").write_text(json.dumps(old))
    pf = read(tmp_path / "params.json")
    assert (pf.schema_version, pf.reading) == ("fitmodels.parameters/10", None)
    assert pf.content_sha256 == content_sha256(pf.model_dump(exclude_unset=True))
    assert not {finding.name for finding in check(pf).findings} & {"doubt"}
    again = read(write(pf, tmp_path / "again.json"))
    assert again == pf


def test_a_file_of_version_2_is_read_without_verdicts(data, tmp_path):
    """Version 2 had no verdicts; a field of that name was unknown and is no verdict of version 3."""
    usable = {"level": "usable inside the tested region"}
    old = copy.deepcopy(data) | {"schema_version": "fitmodels.parameters/2"}
    for part in (*old["laws"].values(), old["dynamics"]):
        part["verdict"] = usable
    old["content_sha256"] = content_sha256(old)
    (tmp_path / "params.json").write_text(json.dumps(old))
    pf = read(tmp_path / "params.json")
    assert [law.verdict for law in pf.laws.values()] == [None] * len(pf.laws)
    assert (pf.dynamics.verdict, pf.tool_life) == (None, None)
    assert check(pf).findings[0].passed is True
    assert read(write(pf, tmp_path / "again.json")) == pf


def of_version_3(data, engagement):
    """A file as version 3 wrote it, with foreign fields of names that version 4 gave a meaning."""
    old = copy.deepcopy(data) | {"schema_version": "fitmodels.parameters/3"}
    old["pi"] |= {"setpoint_weight": "foreign"}
    old["load_line"]["engagement"] = engagement
    old["content_sha256"] = content_sha256(old)
    return old


def test_a_file_of_version_3_has_the_monitoring_of_the_load_left_open(data, tmp_path):
    """Its ``load_low`` lay below zero and took a lost sensor for air; its loop disengaged after a delay."""
    engagement = {
        "feed_programmed": 1000.0, "engage_at": 0.15, "hysteresis": 0.02, "engage_after": 0.1, "disengage_after": 0.3,
        "back_off": 1.0, "recover": 0.2, "load_low": -1.0, "load_high": 3.0, "idle": "foreign", "on_fault": 7,
    }  # fmt: skip
    (tmp_path / "params.json").write_text(json.dumps(of_version_3(data, engagement)))
    pf = read(tmp_path / "params.json")
    assert pf.schema_version == "fitmodels.parameters/10"
    kept = {name: value for name, value in pf.load_line.engagement.model_dump().items() if value is not None}
    assert kept == {
        "feed_programmed": 1000.0, "engage_at": 0.15, "hysteresis": 0.02, "engage_after": 0.1, "back_off": 1.0,
        "recover": 0.2, "load_high": 3.0,
    }  # fmt: skip
    assert pf.pi.setpoint_weight == 1.0
    assert check(pf).findings[0].passed is True
    assert read(write(pf, tmp_path / "again.json")) == pf
    validate(json.loads((tmp_path / "again.json").read_text()))


@pytest.mark.parametrize(("before", "after"), [(-1.0, None), (0, None), (0.02, 0.02), (None, None)])
def test_a_least_reading_of_version_3_stays_where_it_is_above_zero(data, tmp_path, before, after):
    (tmp_path / "params.json").write_text(json.dumps(of_version_3(data, {"load_low": before})))
    assert read(tmp_path / "params.json").load_line.engagement.load_low == after


def test_a_file_of_version_3_without_engagement_or_gains_is_read(data, tmp_path):
    for missing in ("pi", "load_line"):
        old = {name: part for name, part in of_version_3(data, None).items() if name != missing}
        (tmp_path / "params.json").write_text(json.dumps(old))
        assert getattr(read(tmp_path / "params.json"), missing) is None


def test_a_file_of_version_5_is_read_with_laws_of_first_order(data, tmp_path):
    """Version 5 had no terms, centres and fixed exponents; fields of those names were unknown to it."""
    old = copy.deepcopy(data) | {"schema_version": "fitmodels.parameters/5"}
    for law in old["laws"].values():
        law |= {"terms": "foreign", "centres": {"foreign": 1}, "fixed": 3}
    old["content_sha256"] = content_sha256(old)
    (tmp_path / "params.json").write_text(json.dumps(old))
    pf = read(tmp_path / "params.json")
    assert {(law.terms, *law.centres, *law.fixed) for law in pf.laws.values()} == {((),)}
    assert read(write(pf, tmp_path / "again.json")) == pf


def test_a_file_of_version_6_is_read_without_costs(data, tmp_path):
    """Version 6 had no costs; a section of that name was unknown to it."""
    old = copy.deepcopy(data) | {"schema_version": "fitmodels.parameters/6", "costs": {"per part": 3}}
    old["content_sha256"] = content_sha256(old)
    (tmp_path / "params.json").write_text(json.dumps(old))
    pf = read(tmp_path / "params.json")
    assert pf.costs is None
    assert read(write(pf, tmp_path / "again.json")) == pf


def test_a_file_of_version_7_is_read_without_sources_and_merged_files(data, tmp_path):
    """Version 7 did not store where settings come from; fields of those names were unknown to it."""
    old = copy.deepcopy(data) | {"schema_version": "fitmodels.parameters/7"}
    old["provenance"] |= {"merged": "foreign"}
    old["roughness"] = {
        "law": "Ra", "roughness": 1.0, "force": 420.0, "threshold": 100.0, "override_high": 1.5, "sources": 3
    }  # fmt: skip
    old["content_sha256"] = content_sha256(old)
    (tmp_path / "params.json").write_text(json.dumps(old))
    pf = read(tmp_path / "params.json")
    assert (pf.provenance.merged, pf.roughness.sources, pf.roughness.spindle_speed) == ((), {}, None)
    assert read(write(pf, tmp_path / "again.json")) == pf


def test_a_file_of_version_8_is_read_without_sums_and_history(data, tmp_path):
    """Version 8 kept no sums by edge and no versions; fields of those names were unknown to it."""
    old = copy.deepcopy(data) | {"schema_version": "fitmodels.parameters/8", "history": "foreign"}
    for law in old["laws"].values():
        law["sums"] = {"foreign": 1}
    old["content_sha256"] = content_sha256(old)
    (tmp_path / "params.json").write_text(json.dumps(old))
    pf = read(tmp_path / "params.json")
    assert (pf.history, {law.sums for law in pf.laws.values()}) == ((), {None})
    assert read(write(pf, tmp_path / "again.json")) == pf


def test_a_file_of_version_9_is_read_with_competing_forms(data, tmp_path):
    """Version 9 had another name for the check of competing forms."""
    old = copy.deepcopy(data) | {"schema_version": "fitmodels.parameters/9"}
    for law in old["laws"].values():
        law["checks"] = {"rival forms": law["checks"]["form"]} | law["checks"]
    old["content_sha256"] = content_sha256(old)
    (tmp_path / "params.json").write_text(json.dumps(old))
    pf = read(tmp_path / "params.json")
    for law in pf.laws.values():
        assert next(iter(law.checks)) == "competing forms"
        assert "rival forms" not in law.checks
    assert check(pf).findings[0].passed is True
    assert read(write(pf, tmp_path / "again.json")) == pf


def test_a_file_of_version_4_is_read_with_dynamics_of_one_structure(data, tmp_path):
    """Version 4 had no noise denominator and no alternatives; fields of those names were unknown to it."""
    old = copy.deepcopy(data) | {"schema_version": "fitmodels.parameters/4"}
    old["dynamics"] |= {"d": "foreign", "alternatives": {"foreign": 1}}
    old["content_sha256"] = content_sha256(old)
    (tmp_path / "params.json").write_text(json.dumps(old))
    pf = read(tmp_path / "params.json")
    assert (pf.schema_version, pf.dynamics.d, pf.dynamics.alternatives) == ("fitmodels.parameters/10", (1.0,), ())
    assert check(pf).findings[0].passed is True
    assert read(write(pf, tmp_path / "again.json")) == pf


def test_a_model_keeps_its_noise_and_its_alternatives_in_the_file(pf, tmp_path):
    other = Model(b=[0, 0, 0.2, 0.1], a=[1, -0.7], nk=2, sample_time=0.02, cov_params=np.diag([1e-4, 4e-4, 9e-4]))
    model = Model(
        b=[0, 0.1, 0.08], a=[1, -0.8], nk=1, sample_time=0.02, cov_params=np.diag([1e-4] * 3), n=500,
        structure="box_jenkins", d=[1.0, -0.6], alternatives=((0.25, other), (0.1, replace(other, cov_params=None))),
    )  # fmt: skip
    changed = sealed(pf, dynamics=dynamics_section(model))
    held = read(write(changed, tmp_path / "params.json")).dynamics
    assert (held.structure, held.d) == ("box_jenkins", (1.0, -0.6))
    again = model_of(held)
    assert [weight for weight, _ in again.alternatives] == [0.25, 0.1]
    first, second = (one for _, one in again.alternatives)
    assert first.theta.tolist() == other.theta.tolist()
    assert first.cov_params.tolist() == other.cov_params.tolist()
    assert second.cov_params is None
    assert again.cov_params.tolist() == model.cov_params.tolist()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"weight": 1.0}, "weight should be less than 1"),
        ({"weight": 0.0}, "weight should be greater than 0"),
        ({"nk": 2}, "b with nk 2 begins with 2 zeros"),
        ({"a": [2.0, -0.5]}, "a starts with 1, not with 2"),
        ({"uncertainty": {"kind": "covariance", "of": ["a1"], "matrix": [[1.0]]}}, "must be of a1, b1"),
        ({"weight": 0.6}, "sum to 1 or more"),
    ],
)
def test_an_alternative_that_is_no_model_is_refused(data, change, words, tmp_path):
    none = {"kind": "none", "reason": "given"}
    given = {"weight": 0.5, "b": [0.0, 0.1], "a": [1.0, -0.5], "nk": 1, "uncertainty": none}
    data["dynamics"]["alternatives"] = [given, {**given, "weight": 0.4}]
    data["dynamics"]["alternatives"][0] = {**given, **change}
    (tmp_path / "params.json").write_text(json.dumps(data))
    with pytest.raises(ParameterError, match=words):
        read(tmp_path / "params.json")


@pytest.mark.parametrize(
    ("verdict", "words"),
    [
        ({"level": "good"}, "level should be"),
        ({"level": "do not use for control"}, "has 0 reasons"),
        ({"level": "usable inside the tested region", "reasons": ["R2 is .02."]}, "has 1 reasons"),
        ({"level": "usable with reservations", "reasons": [""]}, "should not be empty"),
    ],
)
def test_a_verdict_has_a_known_level_and_its_reasons(data, verdict, words, tmp_path):
    data["dynamics"]["verdict"] = verdict
    (tmp_path / "params.json").write_text(json.dumps(data))
    with pytest.raises(ParameterError, match=words):
        read(tmp_path / "params.json")


def test_doubts_of_the_reading_are_kept(data, tmp_path):
    doubts = [{"columns": ["VB"], "sentence": "VB 1.2 to 1.9 mm is unusual", "remedy": "--unit VB=um"}]
    data |= {"reading": {"doubts": doubts}}
    validate(data)
    (tmp_path / "params.json").write_text(json.dumps(data))
    pf = read(tmp_path / "params.json")
    assert pf.reading.doubts[0].remedy == "--unit VB=um"
    (found,) = [finding for finding in check(pf).findings if finding.name == "doubt"]
    assert found.passed is None
    assert found.words.startswith("VB 1.2 to 1.9 mm is unusual. Remedy: fitmodels ")
    assert found.words.endswith(" --unit VB=um")


def test_the_current_version_is_left_alone(data):
    assert migrated(data, "params.json") is data


# --- the checksum -------------------------------------------------------------------------------------


def test_the_checksum_can_be_had_without_fitmodels(pf, tmp_path):
    """Python's own json, sorted keys, no blanks; whole numbers as a reader in JavaScript would write them."""
    data = json.loads(write(pf, tmp_path / "params.json").read_text(), parse_float=as_number)
    stated = data.pop("content_sha256")
    plain = json.dumps(data, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    assert hashlib.sha256(plain.encode()).hexdigest() == stated == pf.content_sha256


def as_number(text_):
    value = float(text_)
    return int(value) if value.is_integer() and abs(value) < 2**53 and not text_.startswith("-0") else value


def test_order_and_layout_do_not_count_and_every_value_does(data):
    before = content_sha256(data)
    assert content_sha256(dict(reversed(data.items()))) == before
    assert content_sha256({**data, "x": None}) != before
    data["dynamics"]["a"][1] = np.nextafter(data["dynamics"]["a"][1], 1)
    assert content_sha256(data) != before


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_floats_are_distinguished_bit_for_bit(x):
    """A text that reads back to the same bits, whether or not it keeps its point."""
    back = json.loads(canonical_bytes({"x": x}))["x"]
    assert float(back).hex() == x.hex()


@pytest.mark.parametrize(("x", "as_text"), [(50.0, "50"), (-0.0, "-0.0"), (0.0, "0"), (1e300, "1e+300"), (0.1, "0.1")])
def test_numbers_in_canonical_form(x, as_text):
    assert canonical_bytes({"x": x}).decode() == f'{{"x":{as_text}}}'


def test_reading_and_writing_by_another_program_keeps_the_checksum(pf, tmp_path):
    path = write(pf, tmp_path / "params.json")
    data = json.loads(path.read_text(), parse_float=as_number)  # 50.0 becomes 50
    path.write_text(json.dumps(data, sort_keys=True))
    report = parameters.check(read(path))
    assert report.findings[0].passed is True


def test_writing_renews_the_checksum(pf, tmp_path):
    changed = pf.model_copy(update={"identity": pf.identity.model_copy(update={"tool": "other"})})
    assert parameters.check(changed).findings[0].passed is False
    assert parameters.check(read(write(changed, tmp_path / "params.json"))).findings[0].passed is True


# --- written whole or not at all ----------------------------------------------------------------------

VICTIM = """
import os, signal, sys
from fitmodels.parameters import ParameterFile, write
def made(tool):
    return ParameterFile(identity={"tool": tool, "work": "b" * 400, "simulated": False}, provenance={"fitmodels": "1"})
stage, path = sys.argv[1:]
die = lambda *a, **k: os.kill(os.getpid(), signal.SIGKILL)
if stage == "at random":
    print("ready", flush=True)
    while True:
        for tool in ("old", "new"):
            write(made(tool), path, force=True)
real = getattr(os, stage.split()[-1])
def hooked(*a):
    if stage.startswith("after"):
        real(*a)
    die()
setattr(os, stage.split()[-1], hooked)
write(made("new"), path, force=True)
"""


def victim(stage, path):
    env = {"PYTHONPATH": str(Path(parameters.__file__).parents[2])}
    return subprocess.Popen([sys.executable, "-c", VICTIM, stage, str(path)], env=env, stdout=subprocess.PIPE)


def made(tool):
    identity = {"tool": tool, "work": "b" * 400, "simulated": False}
    return parameters.ParameterFile(identity=identity, provenance={"fitmodels": "1"})


@pytest.mark.skipif(sys.platform == "win32", reason="no kill -9 there")
@pytest.mark.parametrize(
    ("stage", "left"), [("before fsync", "old"), ("before replace", "old"), ("after replace", "new")]
)
def test_kill_9_at_each_step_of_a_write(tmp_path, stage, left):
    path = write(made("old"), tmp_path / "params.json")
    with victim(stage, path) as process:
        assert process.wait(60) == -9
    pf = read(path)
    assert pf.identity.tool == left
    assert parameters.check(pf).ok


@pytest.mark.skipif(sys.platform == "win32", reason="no kill -9 there")
def test_kill_9_at_any_moment_leaves_the_old_file_or_the_new_one(tmp_path):
    path = write(made("old"), tmp_path / "params.json")
    for wait in (0.003, 0.011, 0.037):
        with victim("at random", path) as process:
            process.stdout.readline()
            with pytest.raises(subprocess.TimeoutExpired):
                process.wait(wait)
            process.kill()
        pf = read(path)
        assert pf.identity.tool in ("old", "new")
        assert parameters.check(pf).ok
