"""Merging of parameter files: sections from the file that holds them, conflicts named, nothing lost or mixed."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from fitmodels import parameters
from fitmodels.cli import main
from fitmodels.controllers.constant_load_milling.cut_model import CutModel
from fitmodels.controllers.constant_load_milling.steady import drawn_life
from fitmodels.core.errors import ParameterError, UsageError
from fitmodels.parameters import read, read_draws, write
from fitmodels.parameters.checks import check
from fitmodels.parameters.conflicts import MergeInput
from fitmodels.parameters.draws import Draws
from fitmodels.parameters.file import sealed
from fitmodels.parameters.merging import merge
from fitmodels.parameters.messages import difference
from fitmodels.parameters.published import published

CLM = published("CLM-2023")
LOAD = sealed(CLM, laws={"I": CLM.laws["I"]}, tool_life=None)
WEAR = sealed(CLM, laws={"VB": CLM.laws["VB"]}, dynamics=None, pi=None, load_line=None)
LIMITED = sealed(published("AC-2016"), laws=published("AC-2016").laws)


def joined(*files, **options):
    """Merge of files named a.json, b.json ..."""
    return merge([MergeInput(f"{chr(97 + number)}.json", *_with_draws(each)) for number, each in enumerate(files)],
                 **options)  # fmt: skip


def _with_draws(each):
    return each if isinstance(each, tuple) else (each, {})


def changed(pf, section, **fields):
    return sealed(pf, **{section: {**getattr(pf, section).model_dump(), **fields}})


def limited(**limits):
    return sealed(LIMITED, limits=limits)


def test_the_parts_of_a_file_give_the_file_back():
    """A published file divided in two and merged equals itself but for its provenance."""
    for one, two in ((LOAD, WEAR), (WEAR, LOAD)):
        merged = joined(one, two).pf
        for name in ("tool_life", "dynamics", "pi", "load_line", "identity", "limits", "posterior"):
            assert getattr(merged, name) == getattr(CLM, name), name
        assert merged.laws == CLM.laws
        assert CutModel.from_parameters(merged) == CutModel.from_parameters(CLM)
        assert not check(merged).inconsistent


def test_provenance_names_the_other_files_and_the_commands_that_made_them():
    wear = changed(WEAR, "provenance", command="fitmodels wear.csv", data_file="wear.csv", data_sha256="ab" * 32)
    load = changed(LOAD, "provenance", command="fitmodels load.csv", then=["fitmodels settings a.json"])
    of = joined(load, wear).pf.provenance
    assert of.command == "fitmodels load.csv"
    assert of.then == ("fitmodels settings a.json", "fitmodels wear.csv")
    (other,) = of.merged
    assert (other.file, other.data_file, other.data_sha256) == ("b.json", "wear.csv", "ab" * 32)
    assert other.content_sha256 == wear.content_sha256
    assert other.sections == ("laws.VB", "tool_life")


@pytest.mark.parametrize(
    ("two", "words"),
    [
        (changed(WEAR, "identity", tool="other"), "of tool 'AA238M-0200-D4-ML-10' and b.json of 'other'"),
        (changed(WEAR, "identity", work="C45"), "of work 'S45C' and b.json of 'C45'"),
        (changed(WEAR, "identity", machine="other"), "identity.machine: 'five-axis mill"),
        (changed(LOAD, "dynamics", noise_variance=0.1), "dynamics: noise_variance null in a.json; noise_variance 0.1"),
        (changed(LOAD, "load_line", worn=0.29), "load_line: worn 0.28 in a.json; worn 0.29 in b.json"),
        (changed(LOAD, "pi", kp=150.0), "pi: kp 160 in a.json; kp 150 in b.json"),
        (sealed(LOAD, laws={"I": {**LOAD.laws["I"].model_dump(), "coefficients": {"A": 0.1, "B": 1e-4, "k1": 2e-4}}}),
         "laws.I: A 0.115"),
    ],
)  # fmt: skip
def test_other_contents_are_refused_and_named(two, words):
    with pytest.raises(ParameterError, match=r"a\.json") as found:
        joined(LOAD, two)
    assert words in str(found.value)


def fitted(near, edge):
    """The load file with a law as other columns names or another computer give it: rounding, names of edges."""
    law = LOAD.laws["I"].model_dump()
    check = {"null": "no edge", "symbol": "D", "statistic": 0.5 * (1 + 1e4 * near), "p": 0.5, "concern": 0,
             "verdict": f"The largest influence is that of edge {edge}."}  # fmt: skip
    coefficients = {name: value * (1 + near) for name, value in law["coefficients"].items()}
    return sealed(LOAD, laws={"I": {**law, "coefficients": coefficients, "checks": {"single edges": check},
                                    "sums": {"reason": f"edge {edge}"}}})  # fmt: skip


def test_laws_of_the_same_data_do_not_contradict_each_other():
    same = joined(fitted(0.0, "E01"), fitted(1e-13, "1")).pf
    assert same.laws == fitted(0.0, "E01").laws
    with pytest.raises(ParameterError, match=r"1 conflict: laws.I: A 0\.11584"):
        joined(fitted(0.0, "E01"), fitted(1e-7, "E01"))


def test_a_list_that_differs_is_named_by_its_first_entry_that_does():
    one, two = {"b": [0.1, 0.2], "m": [[1.0, 1e-18], [0.0, 2.0]]}, {"b": [0.1, 0.3], "m": [[1.0, 0.0], [0.0, 2.5]]}
    assert difference(one, two, "x", "y") == "b[1] 0.2, m[1][1] 2 in x; b[1] 0.3, m[1][1] 2.5 in y"
    assert difference({"b": [0.1]}, {"b": [0.1, 0.2]}, "x", "y") == "b 1 entry in x; b 2 entries in y"


def test_all_conflicts_are_named_at_once_and_decided_one_by_one_or_together():
    two = changed(changed(LOAD, "load_line", dwell=5.0), "pi", kp=150.0)
    with pytest.raises(ParameterError, match=r"2 conflicts: pi: .*load_line: .*--take SECTION=FILE, or all with"):
        joined(LOAD, two)
    with pytest.raises(ParameterError, match=r"1 conflict: load_line"):
        joined(LOAD, two, take={"pi": 1})
    merged = joined(LOAD, two, take={"pi": 1}, prefer=0)
    assert (merged.pf.pi.kp, merged.pf.load_line.dwell) == (150.0, CLM.load_line.dwell)
    assert any(note.startswith("pi is taken from b.json: kp 160 in a.json") for note in merged.notes)


def test_files_that_name_no_tool_are_joined_with_a_warning():
    pf = published("CLM-2023")
    unnamed = {**pf.identity.model_dump(), "tool": "unnamed-tool", "work": "unnamed-work"}
    one = sealed(pf, identity=unnamed, laws={"I": pf.laws["I"]}, tool_life=None)
    two = sealed(pf, identity=unnamed, laws={"VB": pf.laws["VB"]}, dynamics=None, pi=None, load_line=None)
    merged = merge([MergeInput("load.json", one), MergeInput("wear.json", two)])
    (said,) = (note for note in merged.notes if "names its tool and work material" in note)
    assert "nothing shows that load.json and wear.json are of the same" in said
    assert not any("No file names" in note for note in merge([MergeInput("a", pf), MergeInput("b", pf)]).notes)


def test_a_section_that_the_file_lacks_cannot_be_taken():
    with pytest.raises(UsageError, match=r"--take costs: b.json has no such section"):
        joined(LOAD, WEAR, take={"costs": 1})
    with pytest.raises(UsageError, match=r"did you mean|laws.VB"):
        joined(LOAD, WEAR, take={"laws.VV": 1})


def test_limits_of_two_files_are_united_and_the_tighter_one_of_each_is_named():
    power, force = {"value": 7.0, "unit": "kW"}, {"value": 1300.0, "unit": "N", "of": "Fxz"}
    both = joined(limited(power=power), limited(force=force)).pf.limits
    assert (both.power.value, both.force.value) == (7.0, 1300.0)
    same = joined(limited(power=power), limited(power={"value": 7000.0, "unit": "W"})).pf.limits
    assert (same.power.value, same.power.unit) == (7.0, "kW")
    with pytest.raises(ParameterError, match=r"at most 7 kW in a.json, at most 5000 W in b.json; the tighter one is "
                                             r"that of b.json"):  # fmt: skip
        joined(limited(power=power), limited(power={"value": 5000.0, "unit": "W"}))
    ranges = [limited(speed={"low": low, "high": 200.0, "unit": "m/min"}) for low in (50.0, 60.0)]
    with pytest.raises(ParameterError, match=r"the tighter one is that of b.json"):
        joined(*ranges)
    looser = joined(*ranges, take={"limits.speed": 0})
    assert looser.pf.limits.speed.low == 50.0
    assert any("the tighter one is that of b.json" in note for note in looser.notes)


def test_a_wear_limit_and_a_tool_life_at_another_criterion_are_a_conflict():
    limit = sealed(LOAD, limits={"wear": {"value": 0.18, "unit": "mm", "of": "VB"}})
    with pytest.raises(ParameterError, match=r"criterion: the wear limit of a.json is 0.18 mm, .* is at 200 um"):
        joined(limit, WEAR)
    assert joined(limit, WEAR, take={"criterion": 0}).pf.tool_life is None
    assert joined(limit, WEAR, take={"criterion": 1}).pf.limits is None
    agreed = sealed(LOAD, limits={"wear": {"value": 0.2, "unit": "mm", "of": "VB"}})
    assert joined(agreed, WEAR).pf.tool_life == CLM.tool_life


@pytest.mark.parametrize("marks", [(True, False), (False, True), (True, None), (None, False), (False, False)])
def test_the_result_is_simulated_where_any_file_is(marks):
    one, two = (changed(pf, "identity", simulated=mark) for pf, mark in zip((LOAD, WEAR), marks, strict=True))
    expected = True if True in marks else None if None in marks else False
    assert joined(one, two).pf.identity.simulated is expected


def test_gains_and_settings_do_not_meet_dynamics_and_laws_that_they_were_not_computed_from():
    model = {**CLM.dynamics.model_dump(), "b": [0.0, 0.05, -0.1, 0.06]}
    other = sealed(LOAD, dynamics=model, pi=None)
    merged = joined(LOAD, other, take={"dynamics": 1})
    assert merged.pf.pi is None
    assert any("pi of a.json is left out" in note and "fitmodels tune" in note for note in merged.notes)
    with pytest.raises(UsageError, match=r"--take pi: that of a.json was computed from its own dynamics"):
        joined(LOAD, other, take={"dynamics": 1, "pi": 0})
    with pytest.raises(ParameterError, match=r"pi of a.json was not computed from the dynamics of b.json"):
        joined(sealed(LOAD, dynamics=None), sealed(WEAR, dynamics=CLM.dynamics))
    law = {**LOAD.laws["I"].model_dump(), "coefficients": {"A": 0.1, "B": 1e-4, "k1": 2e-4}}
    refitted = sealed(LOAD, laws={"I": law}, load_line=None, pi=None, dynamics=None)
    merged = joined(LOAD, refitted, take={"laws": 1})
    assert merged.pf.load_line is None
    assert merged.pf.pi is None  # its scaling is that of the former load law


def test_a_tool_life_goes_with_its_wear_law_and_a_composite_too():
    law = {**WEAR.laws["VB"].model_dump(), "coefficients": {**WEAR.laws["VB"].coefficients, "c0": 60.0}}
    other = sealed(WEAR, laws={"VB": law}, tool_life=None)
    assert joined(WEAR, other, take={"laws.VB": 1}).pf.tool_life is None
    assert joined(WEAR, other, take={"laws.VB": 0}).pf.tool_life == WEAR.tool_life
    composite = {"wear": "VB", "coefficients": {"c0": 1.0}, "assumption": "independent"}
    of = sealed(WEAR, laws={"VB": WEAR.laws["VB"], "I": {**LOAD.laws["I"].model_dump(), "composite": composite}})
    assert joined(of, LIKE_ITSELF).pf.laws["I"].composite is not None
    assert joined(of, other, take={"laws.VB": 1}).pf.laws["I"].composite is None


LIKE_ITSELF = sealed(WEAR, laws={"VB": WEAR.laws["VB"]})


def test_symbols_of_other_quantities_are_refused_and_units_of_one_are_named():
    millimetres = in_mm(WEAR)
    assert any("VB is in um in a.json, mm in b.json" in note for note in joined(LOAD, millimetres).notes)
    law = {**WEAR.laws["VB"].model_dump(), "unit": "min"}
    with pytest.raises(ParameterError, match=r"VB is in um in a.json and in min in b.json: these are not one quantity"):
        joined(LOAD, sealed(WEAR, laws={"VB": law}, tool_life=None))


def in_mm(pf):
    """The wear law and tool life of a file in mm."""
    law, life = pf.laws["VB"].model_dump(), pf.tool_life.model_dump()
    law |= {"unit": "mm", "coefficients": {**law["coefficients"], "c0": law["coefficients"]["c0"] / 1000}}
    return sealed(pf, laws={"VB": law}, tool_life={**life, "criterion": 0.2, "unit_of_wear": "mm"})


def test_settings_in_um_and_a_wear_law_in_mm_give_the_cut_of_one_unit():
    merged = joined(LOAD, in_mm(WEAR)).pf
    one, two = CutModel.from_parameters(merged), CutModel.from_parameters(CLM)
    assert one.c0 == pytest.approx(two.c0, rel=1e-12)
    assert (one.unit_wear, one.n, one.area) == (two.unit_wear, two.n, two.area)
    names = ("ln c0", "t", "fm", "d", "ae")
    values = np.array([[np.log(merged.laws["VB"].coefficients["c0"]), 1.0, 0.0, 0.0, 0.0]])
    life, used = drawn_life(merged, {"VB": Draws(names, values)})
    published_life, _ = drawn_life(CLM, {"VB": Draws(names, values + np.array([np.log(1000), 0, 0, 0, 0]))})
    assert used == ("VB",)
    assert life.length == pytest.approx(published_life.length, rel=1e-9)


def test_doubts_of_all_files_are_kept_with_their_data_file_and_remedy():
    doubt = {"columns": ["VB"], "sentence": "VB 1.2 to 1.9 mm is unusual.", "remedy": "--unit VB=um"}
    wear = sealed(changed(WEAR, "provenance", data_file="wear.csv"), reading={"doubts": [doubt]})
    (unknown, other) = joined(LOAD, wear).pf.reading.doubts
    assert "not known whether a.json was read without doubts" in unknown.sentence
    assert other.sentence == "wear.csv: VB 1.2 to 1.9 mm is unusual. Remedy: fitmodels wear.csv --unit VB=um."


def test_a_law_keeps_its_verdict_notes_and_checks():
    merged = joined(LOAD, WEAR).pf
    assert merged.laws["VB"].verdict == CLM.laws["VB"].verdict
    assert merged.laws["VB"].notes == CLM.laws["VB"].notes


# Files: draws, names, interruptions


def drawn(pf, response, seed, folder, size=50):
    """A file with draws of one law, in a folder."""
    folder.mkdir()
    names = pf.laws[response].parameter_names
    values = np.random.default_rng(seed).standard_normal((len(names), size)).T
    section = {"seed": 1, "laws": {response: {"method": "exact", "draws": size, "r_hat": 1.0, "ess": 1000.0}}}
    merged = merge([MergeInput("a", sealed(pf, posterior=section), {response: Draws(names, values)}),
                    MergeInput("b", sealed(WEAR if response == "I" else LOAD, laws={}, tool_life=None, dynamics=None,
                                           pi=None, load_line=None))])  # fmt: skip
    (folder / merged.pf.posterior.draws_file).write_bytes(merged.draws)
    return write(merged.pf, folder / "params.json"), values


@pytest.fixture
def files(tmp_path):
    """Files of a load law and of a wear law with draws of one seed, as two fits give them."""
    load, _ = drawn(LOAD, "I", 1, tmp_path / "load")
    wear, _ = drawn(WEAR, "VB", 1, tmp_path / "wear")
    return str(load), str(wear)


def test_draws_go_along_with_their_laws_and_are_not_correlated_by_a_common_seed(files, tmp_path, capsys):
    assert main(["merge", *files, "--out", str(tmp_path / "both.json"), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["schema"] == "fitmodels.merge/1"
    assert report["sections"]["laws.VB"] == files[1]
    pf = read(tmp_path / "both.json")
    draws = read_draws(pf, tmp_path)
    originals = [read_draws(read(file), Path(file).parent) for file in files]
    assert np.array_equal(draws["I"].values, originals[0]["I"].values)
    assert sorted(map(tuple, draws["VB"].values)) == sorted(map(tuple, originals[1]["VB"].values))
    of = [each[name].values[:, 0] for each, name in ((originals[0], "I"), (originals[1], "VB"), (draws, "VB"))]
    assert np.corrcoef(of[0], of[1])[0, 1] == pytest.approx(1)  # one seed, equal random numbers
    assert abs(np.corrcoef(of[0], of[2])[0, 1]) < 0.4  # 50 draws: within 2.8 standard errors of 0
    assert not [finding for finding in check(pf, tmp_path).failed if finding.name in ("draws", "posterior", "checksum")]
    assert pf.provenance.then[-1].startswith("fitmodels merge ")


def test_the_file_is_never_one_of_its_own_inputs(files, tmp_path, capsys):
    before = [Path(file).read_bytes() for file in files]
    draws = Path(files[0]).parent / read(files[0]).posterior.draws_file
    os.link(files[1], tmp_path / "linked.json")
    for out in (files[0], str(Path(files[1]).parent / ".." / "wear" / "params.json"), str(draws),
                str(tmp_path / "linked.json")):  # fmt: skip
        assert main(["merge", *files, "--out", out, "--force"]) == 2
        assert "it would be lost" in capsys.readouterr().err
    assert [Path(file).read_bytes() for file in files] == before


@pytest.mark.parametrize(
    ("words", "code", "sentence"),
    [
        ("{0} --out x.json", 2, "nothing to be merged with"),
        ("{0} {0} --out x.json", 2, "given twice"),
        ("{0} {1} --out folder", 2, "is a folder"),
        ("{0} {1} --out nowhere/x.json", 2, "its folder does not exist"),
        ("{0} {1} --out there.json", 3, "replace it with --force"),
        ("{0} {1} --out x.json --take laws.VB=z.json", 2, "is none of the files to be merged"),
        ("{0} {1} --out x.json --take laws.VB", 2, "write it as laws.VB=b.json"),
        ("{0} missing.json --out x.json", 3, "does not exist"),
    ],
)
def test_wrong_arguments_are_refused_in_one_sentence(words, code, sentence, files, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("folder").mkdir()
    Path("there.json").write_text("{}")
    assert main(["merge", *words.format(*files).split()]) == code
    error = capsys.readouterr().err
    assert sentence in error
    assert error.count("\n") == 1
    assert not Path("x.json").exists()


def test_an_edited_input_is_refused(files, tmp_path, capsys):
    data = json.loads(Path(files[1]).read_text("utf-8"))
    data.pop("content_sha256")
    Path(files[1]).write_text(json.dumps(data), "utf-8")
    assert main(["merge", *files, "--out", str(tmp_path / "both.json")]) == 3
    assert "has no content_sha256" in capsys.readouterr().err


KILLED = """
import os, sys
from fitmodels.cli import main
from fitmodels.core import files
at, real = int(sys.argv[1]), os.replace
calls = []
def replaced(*words):
    calls.append(words)
    if len(calls) == at:
        os._exit(9)
    return real(*words)
os.replace = replaced
main(sys.argv[2:])
"""


def test_a_killed_merge_leaves_the_former_file_with_its_draws_and_the_next_one_cleans_up(files, tmp_path):
    out = tmp_path / "both.json"
    words = ["merge", *files, "--out", str(out), "--force"]
    assert main([*words, "--quiet"]) == 0
    former = out.read_bytes()
    wear, _ = drawn(WEAR, "VB", 2, tmp_path / "again")
    other = ["merge", files[0], str(wear), "--out", str(out), "--force"]
    env = {**os.environ, "PYTHONPATH": str(Path(parameters.__file__).parents[2])}
    for at in (1, 2, 3):  # before the journal, the file and the draws are in place
        done = subprocess.run([sys.executable, "-c", KILLED, str(at), *other], env=env, check=False)
        assert done.returncode == 9
        assert (out.read_bytes() == former) == (at < 3)
        assert sorted(read_draws(read(out), tmp_path)) == ["I", "VB"]
        assert (out.read_bytes() == former) == (at == 1)
    assert main([*other, "--quiet"]) == 0
    assert not list(tmp_path.glob(".fitmodels*"))
    assert [path.name for path in tmp_path.glob("both-draws-*.npz")] == [read(out).posterior.draws_file]
    assert sorted(read_draws(read(out), tmp_path)) == ["I", "VB"]
