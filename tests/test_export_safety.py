"""Names from the data are text in every export, and a file is written whole, once, where it was asked for."""

import re
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from zipfile import ZipFile

import pytest
from fitmodels import parameters
from fitmodels.cli import main
from fitmodels.controllers.exports import CONTROLS, FORMATS, export, export_format, rendered
from fitmodels.controllers.gate import GatedControl, gated_control
from fitmodels.core.errors import GateError, ParameterError, UsageError
from fitmodels.parameters.exports import VALUES
from fitmodels.parameters.exports.names import plain, plain_unit, safe_name
from fitmodels.parameters.exports.view import NO_SAFETY, NOT_DETECTED, export_view
from fitmodels.parameters.file import sealed
from fitmodels.parameters.published import published
from hypothesis import given
from hypothesis import strategies as st
from scipy.io import loadmat

KINDS = [*CONTROLS, *VALUES]  # of the file with a loop

NASTY = [
    "../../x", "<script>alert(1)</script>", '"; M30 (', "=cmd|' /C calc'!A0", "x\nsetp motion.adaptive-feed 5",
    "x)\nM30\n(", "*/ int main(void) {} /*", "*) END_FUNCTION_BLOCK (*", "]]> &xxe; %s %n", "$HOME [HAL]FILE `id`",
    "*/ #include </etc/passwd>", "[values]\nkp = 1", "%(tool)s", '"/><ssv:Real value="1',
    "x\u2028y\x00\x1b[2J", "\u202egnp.exe", "-rf --force", "GC 435", "ü" * 300,
]  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("text", NASTY)
def test_a_nasty_name_changes_no_line_but_its_own_comment(constant_load_file, kind, text):
    """The export with a nasty name has as many lines as with a plain one, and nothing of it that could act."""
    name = text.replace("\x00", "")
    nasty = constant_load_file(identity={"tool": name, "work": name, "machine": name, "note": name})
    plain_one = constant_load_file(identity={"tool": "A", "work": "B", "machine": "C"})
    ours, other = (rendered(pf, kind) for pf in (nasty, plain_one))
    if isinstance(ours, bytes):
        assert name.encode() not in ours or name == plain(name)
        return
    assert ours.isascii()
    assert ours.count("\n") == other.count("\n")
    for piece in ("<script", "M30 (", "cmd|", "*/ int", "*) END", "]]>", "`id`", "$HOME", "../", "%n",
                  "%(tool)", "#include <", "[values]", '"/><'):  # fmt: skip
        assert ours.count(piece) == other.count(piece), piece
    for line in ours.splitlines():
        assert not re.match(r"\s*(setp motion|M30)", line)


@pytest.mark.parametrize("kind", KINDS)
def test_a_nasty_unit_or_symbol_is_text_too(constant_load_file, kind):
    nasty = 'A*/ "; M30 ('
    pf = constant_load_file(
        laws=None, load_line={"unit_wear": "mm"},
        limits={"force": {"value": 1.0, "unit": "N", "of": nasty}},
        roughness={"law": nasty, "roughness": 1.0, "force": 400.0, "threshold": 100.0, "override_high": 1.5},
    )  # fmt: skip
    out = rendered(pf, kind, accept_verdict=True)  # a file without a load law
    assert nasty not in (out.decode("latin-1") if isinstance(out, bytes) else out)


@pytest.mark.parametrize("text", NASTY)
def test_a_nasty_name_is_plain_text_in_the_struct_of_matlab(constant_load_file, text):
    name = text.replace("\x00", "")
    pf = constant_load_file(identity={"tool": name, "work": name, "machine": name})
    about = loadmat(BytesIO(rendered(pf, "mat")), simplify_cells=True)["fitmodels"]["about"]
    assert about["tool"] == about["work"] == about["machine"] == plain(name)


@pytest.mark.parametrize("kind", KINDS)
def test_the_same_file_gives_the_same_bytes_read_back_too(constant_load_file, kind, tmp_path):
    pf = constant_load_file()
    again = parameters.read(parameters.write(pf, tmp_path / "params.json"))
    first, second = (export(file, kind, tmp_path / name).read_bytes() for file, name in ((pf, "a"), (again, "b")))
    assert first == second


@pytest.mark.parametrize("kind", KINDS)
def test_the_command_writes_every_kind(constant_load_file, kind, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    parameters.write(constant_load_file(), "params.json")
    assert main(["export", "params.json", "--to", kind]) == 0
    name = getattr(FORMATS[kind], "file_name", "") or f"params{FORMATS[kind].suffix}"
    assert f"wrote {name}" in capsys.readouterr().out
    assert Path(name).stat().st_size > 0


@given(st.text())
def test_names_are_identifiers_and_texts_are_one_plain_line(text):
    assert re.fullmatch(r"[a-z][a-z0-9_]{0,39}", safe_name(text))
    assert re.fullmatch(r"[A-Za-z0-9 ._+-]{1,80}", plain(text))
    assert not plain(text).startswith(("+", "-", "="))
    assert "*" not in plain_unit(text)
    assert re.fullmatch(r"[A-Za-z0-9 ./()^%+_-]{1,40}", plain_unit(text))
    assert safe_name(safe_name(text)) == safe_name(text)
    assert plain(plain(text)) == plain(text)


@pytest.mark.parametrize("kind", KINDS)
def test_a_file_that_is_there_is_kept_unless_forced(constant_load_file, kind, tmp_path):
    pf, path = constant_load_file(), tmp_path / "out"
    path.write_text("mine")
    with pytest.raises(ParameterError, match="the file exists"):
        export(pf, kind, path)
    assert path.read_text() == "mine"
    assert export(pf, kind, path, force=True) == path
    assert path.read_bytes() != b"mine"
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


@pytest.mark.parametrize("kind", KINDS)
def test_gains_that_fail_the_check_reach_no_file(constant_load_file, kind, tmp_path):
    with pytest.raises(GateError, match="not stable"):
        export(constant_load_file(pi={"ki": 8.0e6}), kind, tmp_path / "out", force=True)
    assert not list(tmp_path.iterdir())


NOT = {
    "level": "do not use for control",
    "reasons": ["R2 is .02 and the predictions are worse than the mean of the rows that the law was fitted to."],
}


def with_law(constant_load_file, **verdicts):
    """The file with a load law ``I``, on which the loop rests, and a wear law ``AW`` that the loop does not use."""
    usable = {"level": "usable inside the tested region"}
    law = {
        "quantity": "", "error": "additive", "residual_scale": "A", "n": 20, "df": 17,
        "uncertainty": {"kind": "none", "reason": "given"},
    }  # fmt: skip
    line = {
        **law, "form": "load_line", "response": "I", "unit": "A", "equation": "", "verdict": verdicts.get("I", usable),
        "coefficients": {"A": 0.09584, "B": 1.2416e-4, "k1": 0.24832},
        "factors": [
            {"symbol": "fm", "quantity": "", "unit": "mm/min", "low": 600.0, "high": 1000.0},
            {"symbol": "VB", "quantity": "", "unit": "mm", "low": 0.0, "high": 0.2},
        ],
    }  # fmt: skip
    wear = {
        **law, "form": "power", "response": "AW", "unit": "mm", "equation": "", "verdict": verdicts.get("AW", usable),
        "coefficients": {"c0": 0.01, "t": 0.5},
        "factors": [{"symbol": "t", "quantity": "", "unit": "min", "low": 1.0, "high": 20.0}],
    }  # fmt: skip
    dynamics = {"verdict": verdicts["dynamics"]} if "dynamics" in verdicts else {}
    return constant_load_file(laws={"I": line, "AW": wear}, dynamics=dynamics)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("part", ["I", "AW", "dynamics"])
@pytest.mark.parametrize("verdict", [NOT, None], ids=["do not use", "no verdict"])
def test_what_must_not_be_used_is_refused_unless_accepted(constant_load_file, kind, part, verdict, tmp_path):
    """A loop does not use the wear law; everything else is carried or used by every format."""
    pf, path = with_law(constant_load_file, **{part: verdict}), tmp_path / "out"
    if part == "AW" and kind in CONTROLS:
        assert export(pf, kind, path) == path
        return
    where = part if part == "dynamics" else f"laws.{part}"
    words = "do not use for control. R2 is .02" if verdict else "has no verdict"
    with pytest.raises(GateError, match=rf"not exported: {where}.*{words}.*--accept-verdict"):
        export(pf, kind, path, force=True)
    assert not path.exists()
    content = export(pf, kind, path, accept_verdict=True).read_bytes().decode("latin-1")
    assert f"VERDICT ACCEPTED - {where} - {'do not use for control' if verdict else 'no verdict'}" in content
    assert verdict is None or all(word in content for word in ("predictions", "worse", "fitted to."))  # in full


@pytest.mark.parametrize("kind", KINDS)
def test_reservations_are_exported_with_their_reasons(constant_load_file, kind, tmp_path):
    verdict = {"level": "usable with reservations", "reasons": ["Four edges."]}
    pf = with_law(constant_load_file, I=verdict)
    content = export(pf, kind, tmp_path / "out").read_bytes().decode("latin-1")
    assert "laws.I - usable with reservations" in content
    assert "Four edges." in content
    assert "ACCEPTED" not in content


def test_feed_limits_of_an_unknown_law_are_assumed_to_be_right(constant_load_file):
    """The settings name a law that the file does not hold: its verdict cannot be known."""
    words = "the feed limits are right: the law that they come from is not in the file"
    assert words in export_view(constant_load_file(laws=None)).assumed
    assert words not in export_view(with_law(constant_load_file)).assumed
    assert words not in export_view(constant_load_file(load_line=None, pi=None)).assumed


def test_the_check_still_refuses_gains_where_the_verdict_is_accepted(constant_load_file, tmp_path):
    with pytest.raises(GateError, match="not stable"):
        export(constant_load_file(pi={"ki": 8.0e6}), "hal", tmp_path / "out", accept_verdict=True)


@pytest.mark.parametrize("kind", ["c", "st", "ini"])
def test_the_interface_too_refuses_a_coefficient_that_is_not_that_of_its_equation(tmp_path, kind):
    data = published("AC-2016").model_dump()
    data["laws"]["P"]["coefficients"]["V"] = -0.82
    pf = sealed(parameters.ParameterFile.model_validate(data))
    with pytest.raises(GateError, match=r"fails the check: laws\.P: the equation, .* lacks its coefficient V = -0\.82"):
        export(pf, kind, tmp_path / "out", system=None if kind == "ini" else "region", accept_verdict=True)
    assert not list(tmp_path.iterdir())


def test_the_command_accepts_a_verdict_by_name(constant_load_file, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    parameters.write(with_law(constant_load_file, dynamics=NOT), "params.json")
    assert main(["export", "params.json", "--to", "hal"]) == 5
    assert "dynamics: do not use for control. R2 is .02" in capsys.readouterr().err
    assert main(["export", "params.json", "--to", "hal", "--accept-verdict"]) == 0
    assert "VERDICT ACCEPTED - dynamics - do not use for control" in capsys.readouterr().out


@pytest.mark.parametrize("kind", list(FORMATS))
def test_each_says_what_it_cannot_carry(kind):
    assert export_format(kind).not_carried
    assert all(isinstance(words, str) and words for words in export_format(kind).not_carried)


def test_names_of_quantities_are_unlike_each_other(constant_load_file):
    names = [quantity.name for quantity in export_view(constant_load_file()).quantities]
    assert len(set(names)) == len(names)
    assert all(re.fullmatch(r"[a-z][a-z0-9_]*", name) for name in names)


def test_an_unknown_kind_is_met_with_the_nearest(constant_load_file, tmp_path):
    with pytest.raises(UsageError, match="Did you mean 'hal'"):
        export(constant_load_file(), "HAL", tmp_path / "x")


def test_the_command_writes_says_and_refuses(constant_load_file, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    parameters.write(constant_load_file(), "params.json")
    assert main(["export", "params.json", "--to", "hal"]) == 0
    said = capsys.readouterr().out
    assert "wrote params.hal" in said
    assert "not included: units" in said
    assert main(["export", "params.json", "--to", "hal"]) == 3
    assert main(["export", "params.json", "--to", "hal", "--force"]) == 0
    assert main(["export", "params.json", "--to", "hla"]) == 2
    assert main(["export", "params.json", "--to", "hal", "--out", "."]) == 2
    parameters.write(constant_load_file(pi={"ki": 8.0e6}), "bad.json")
    assert main(["export", "bad.json", "--to", "hal"]) == 5
    assert not Path("bad.hal").exists()


@pytest.mark.parametrize("kind", ["hal", "st", "c", "comp", "fmu"])
def test_the_writer_of_values_refuses_a_running_control_and_names_the_function_to_use(
    constant_load_file, kind, tmp_path
):
    with pytest.raises(UsageError, match=rf"{kind} is a running control.*fitmodels\.controllers\.export"):
        parameters.export(constant_load_file(), kind, tmp_path / "out")


@pytest.mark.parametrize("kind", VALUES)
def test_values_of_a_file_with_a_loop_are_refused_where_nothing_simulates_it(constant_load_file, kind, tmp_path):
    with pytest.raises(GateError, match="holds a control loop, which is simulated before its values are written"):
        parameters.export(constant_load_file(), kind, tmp_path / "out")
    assert parameters.export(constant_load_file(pi=None), kind, tmp_path / "out").exists()
    assert not [p for p in tmp_path.iterdir() if p.name != "out"]


def test_a_gated_control_is_made_by_the_gate_alone_and_does_not_change(constant_load_file):
    """The writers of running controls take nothing else, so nothing that was not checked is written."""
    pf = constant_load_file()
    with pytest.raises(TypeError, match="made by gated_control"):
        GatedControl(export_view(pf))
    control = gated_control(pf)
    with pytest.raises(AttributeError):
        control.loop = control.loop
    with pytest.raises(TypeError):
        replace(control, view=export_view(pf))


@pytest.mark.parametrize("kind", KINDS)
def test_each_export_states_its_limits_of_use(constant_load_file, kind):
    """It is no safety function, and what a control cannot detect; the values of a file with gains say so too."""
    content = rendered(constant_load_file(), kind)
    if kind == "fmu":
        with ZipFile(BytesIO(content)) as archive:
            content = b"".join(map(archive.read, archive.namelist()))
    text = content if isinstance(content, str) else content.decode("latin-1")
    words = " ".join(re.sub(r"^#|[()*/]", " ", text, flags=re.MULTILINE).lower().split())
    for line in (*NO_SAFETY, *NOT_DETECTED):
        assert line.lower() in words
