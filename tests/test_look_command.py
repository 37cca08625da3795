"""``fitmodels look`` and ``fitmodels -``: what is printed, the picture, and commands that do what they promise."""

import contextlib
import io
import json
import re
import shlex
import sys
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, parameters
from fitmodels.cli import main
from fitmodels.cli.corrections import corrected, remedies_in
from fitmodels.datasets.overview import overview_figure

GC435 = datasets.bundled("gc435_709m40")
HEADER = "edge,V [m/min],f [mm/rev],d [mm],t [min],{}"
FACTORS = [(V, f, d) for V in (80, 160) for f in (0.1, 0.2) for d in (1, 2)]


def table(name="VB", scale=1.0, times=(2, 5, 9), factors=FACTORS):
    """A made table: VB = .01 V^.5 f^.2 d^.2 t^.3 with 1 % scatter, eight edges."""
    rng = np.random.default_rng(18)
    rows = [
        f"E{i + 1},{V},{f},{d},{t},{scale * 0.01 * V**0.5 * f**0.2 * d**0.2 * t**0.3 * rng.lognormal(0, 0.01):.5g}"
        for i, (V, f, d) in enumerate(factors)
        for t in times
    ]
    return "\n".join([HEADER.format(name), *rows]) + "\n"


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(*arguments, stdin=None):
    """The command in this process: exit code, standard output, standard error."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), pytest.MonkeyPatch.context() as patch:
        if stdin is not None:
            patch.setattr(sys, "stdin", SimpleNamespace(buffer=io.BytesIO(stdin), closed=False, isatty=lambda: False))
        code = main([str(argument) for argument in arguments])
    return SimpleNamespace(code=code, out=out.getvalue(), err=err.getvalue())


def commands(text):
    """Commands that are printed to be copied, lines that end in a backslash joined."""
    joined = re.sub(r" \\\n\s+", " ", text)
    return [shlex.split(line) for line in map(str.strip, joined.splitlines()) if line.startswith("fitmodels ")]


# What look prints


def test_edges_of_one_name_on_two_materials_are_different(here):
    rows = table().splitlines()
    halves = [f"{work},{row}" for work, some in (("C45", rows[1:13]), ("42CrMo4", rows[13:])) for row in some]
    text = "\n".join([f"work,{rows[0]}", *halves, ""])
    for k in range(5, 9):
        text = text.replace(f",E{k},", f",E{k - 4},")
    (here / "data.csv").write_text(text)
    result = run("look", "data.csv")
    assert "Edges: 8" in result.out
    assert re.search(r"work\s+edge\s+rows", result.out)
    assert re.search(r"C45\s+E1\s+3 .*\n(.*\n){3}\s+42CrMo4\s+E1\s+3 ", result.out)
    runs = datasets.read_runs("data.csv")
    figure = overview_figure(runs)
    assert ", 8 edges" in figure.get_suptitle()
    assert len(figure.axes[-1].lines) == len(runs.plot().lines) == 8


def test_look_prints_the_reading_and_fits_nothing(here):
    (here / "data.csv").write_bytes(GC435.read_bytes())
    result = run("look", "data.csv")
    assert (result.code, result.err) == (0, "")
    assert "GC435 on 709M40 (En 19)   239     24  AW of V, f, d, t; Fxz of" in result.out
    assert "Edges: 24" in result.out
    assert re.search(r"E07\s+9\s+141.4\s+0.337", result.out)
    assert sorted(path.name for path in here.iterdir()) == ["data-look.png", "data.csv"]
    assert (here / "data-look.png").read_bytes().startswith(b"\x89PNG")
    assert "Picture: data-look.png" in result.out
    assert "doubts" not in result.out
    assert commands(result.out) == [["fitmodels", "data.csv"]]


def test_every_command_that_look_prints_can_be_typed(here):
    (here / "my data.csv").write_text(table("VB", 1000).replace(" [min]", "").replace(" [mm]", ""))
    result = run("look", "my data.csv", "--tool", "GC 435")
    found = commands(result.out)
    assert ["fitmodels", "my data.csv", "--tool", "GC 435"] in found
    assert any("VB=um" in words for words in found)
    for _, *words in found:
        again = run("look", *words)
        assert again.code == 0, again.err
        assert re.search(r"VB +flank wear .*: 0\.\d+ to 0\.\d+ mm", again.out)


def test_doubts_stand_first_with_the_command_that_corrects_them(here):
    (here / "a.csv").write_text(table("VB", 1000))
    for command in ("look", None):
        result = run(
            *([command] if command else []),
            "a.csv",
            "--seed" if not command else "--tool",
            "3",
            *([] if command else ["--full"]),
        )
        assert result.code == 0
        doubts = result.out.split("columns")[0]
        assert "1. VB" in doubts
        assert re.search(r"^ +fitmodels a.csv .*--unit VB=um$", doubts, flags=re.M)
    assert "1 doubt about the data (VB): see the beginning of this output." in result.out
    pf = parameters.read(next(here.rglob("params.json")))
    assert [doubt.columns for doubt in pf.reading.doubts] == [("VB",)]
    assert "Doubt about the data: VB" in pf.summary()
    assert run("a.csv", "--unit", "VB=um", "--out", "b").code == 0
    assert parameters.read(next((here / "b").rglob("params.json"))).reading.doubts == ()


def test_a_refused_file_is_shown_as_found(here):
    (here / "a.csv").write_text("alpha,beta,gamma\n1,2,x\n2,3,y\n")
    result = run("look", "a.csv")
    assert result.code == 3
    assert "no column is recognised" in result.err
    assert re.search(r"col2 +beta +2, 3", result.out)
    assert not list(here.glob("*.png"))
    nothing = run("look", "missing.csv")
    assert (nothing.code, nothing.out) == (3, "")


def test_a_file_without_a_law_is_not_proposed_to_be_fitted(here):
    (here / "a.csv").write_text("edge,V [m/min],f [mm/rev]\na,100,0.1\nb,200,0.2\n")
    result = run("look", "a.csv")
    assert "Fit it as read" not in result.out
    assert "No law can be fitted to these columns" in result.out


def test_roles_by_name_are_those_of_the_reading(here):
    rows = "\n".join(f"{V},0.01,0.1,{t},{0.001 * t}" for V in (300, 400) for t in (2, 5, 9))
    (here / "a.csv").write_text(f"SFM,IPR,DOC,t [min],VB\n{rows}\n")
    result = run("look", "a.csv", "--map", "V=speed")
    assert result.code == 2
    assert "The columns are SFM" in result.err
    assert re.search(r"col1 +SFM +SFM +V cutting speed +300, 300", result.out)
    assert re.search(r"col2 +IPR +IPR +f feed", result.out)


def test_a_refusal_with_a_remedy_gives_commands_that_work(here):
    (here / "a.csv").write_text(table("VB [mm]", 1000))
    result = run("look", "a.csv")
    assert result.code == 3
    assert "role by name" in result.out
    (words,) = commands(result.out)
    assert words == ["fitmodels", "a.csv", "--unit", "VB=um"]
    assert run("look", *words[1:]).code == 0


def test_look_as_json_has_the_commands_and_draws_nothing(here):
    result = run("look", GC435, "--json")
    found = json.loads(result.out)
    assert (found["schema"], found["doubts"], found["source"]["rows"]) == ("fitmodels.look/3", [], 239)
    assert found["commands"] == [{"purpose": "Fit it as read:", "command": f"fitmodels {GC435}"}]
    assert list(here.iterdir()) == []


def test_a_picture_of_another_program_is_kept(here):
    (here / "data-look.png").write_bytes(b"mine")
    result = run("look", GC435)
    assert (result.code, result.out) == (2, "")
    assert "--force" in result.err
    assert (here / "data-look.png").read_bytes() == b"mine"
    assert run("look", GC435, "--force").code == 0
    assert run("look", GC435).code == 0  # its own is replaced
    assert run("look", GC435, "--out", "a.svg").code == 0
    for wrong in ("a.csv", "none/a.png", "."):
        assert run("look", GC435, "--out", wrong).code == 2


def test_a_record_is_named_as_one(here):
    rows = "\n".join(f"{i * 0.001:.3f},{i % 7},{i % 11}" for i in range(500))
    (here / "run.csv").write_text(f"time [s],u,y\n{rows}\n")
    result = run("look", "run.csv")
    assert result.code == 3
    assert "fitmodels ident run.csv" in result.err


def test_other_commands_that_read_tests_print_doubts(here):
    (here / "a.csv").write_text(table("VB", 1000))
    result = run("next", "a.csv", "--runs", "2")
    assert re.search(r"^fitmodels: doubt about a.csv: VB .*--unit VB=um$", result.err, flags=re.M)
    assert "doubt" not in run("next", "a.csv", "--runs", "2", "--unit", "VB=um").err


# The picture


def test_the_picture_shows_units_levels_and_every_edge():
    figure = overview_figure(datasets.read_runs(GC435))
    labels = {ax.get_xlabel() for ax in figure.axes} | {ax.get_ylabel() for ax in figure.axes}
    assert {"V, cutting speed [m/min]", "AW, average wear [mm]", "t, cutting time [min]"} <= labels
    wear = next(ax for ax in figure.axes if ax.get_ylabel().startswith("AW"))
    assert len(wear.lines) == 24
    assert {text.get_text() for text in wear.texts} == {f"E{i:02d}" for i in range(1, 25)}
    assert (wear.get_xscale(), wear.get_yscale()) == ("log", "log")


@pytest.mark.parametrize(
    "frame",
    [
        {"V": [100.0], "VB": [0.1]},
        {"V": [100.0, 200.0], "f": [0.1, 0.1]},
        {"V": [100.0, np.nan, 200.0], "VB": [np.nan] * 3},
        {"t": [0.0, 1.0, 2.0], "VB": [0.0, 0.1, 0.2], "edge": ["a", "a", ""]},
        {"t": np.arange(1.0, 901.0), "VB": np.full(900, 0.1), "edge": [f"e{i // 2}" for i in range(900)]},
        {"t": np.arange(1.0, 61.0), "P": np.full(60, 2.0), "tool": ["a", "b", "c"] * 20, "edge": ["1", "2", "3"] * 20},
    ],
)
def test_odd_tables_have_a_picture(frame, tmp_path):
    overview_figure(datasets.runs_from_frame(pd.DataFrame(frame))).savefig(tmp_path / "a.png")


# Standard input


def test_standard_input_is_read(here):
    data = table().encode()
    (here / "a.csv").write_bytes(data)
    result = run("-", "--tool", "GC435", "--work", "steel", stdin=data)
    assert result.code == 0, result.err
    assert result.out.startswith("standard input: 24 rows of 8 edges; GC435 on steel")
    pf = parameters.read(here / "stdin-fit" / "GC435_steel" / "params.json")
    assert pf.provenance.data_file == "standard input"
    assert pf.provenance.data_sha256 == datasets.read_runs(here / "a.csv").source.sha256
    assert pf.provenance.command == "fitmodels - --tool GC435 --work steel"
    looked = run("look", "-", stdin=data)
    assert looked.code == 0
    assert commands(looked.out) == [["fitmodels", "-"], ["fitmodels", "-", "--unit", "VB=mm"]]
    assert (here / "stdin-look.png").is_file()


def test_a_workbook_on_standard_input_is_read(here):
    import openpyxl

    book = openpyxl.Workbook()
    for line in table().splitlines():
        cells = line.split(",")
        book.active.append([float(cell) if re.fullmatch(r"[\d.]+", cell) else cell for cell in cells])
    held = io.BytesIO()
    book.save(held)
    assert run("look", "-", stdin=held.getvalue()).code == 0


def test_an_empty_pipe_and_a_terminal_are_one_message(here, monkeypatch):
    for command in (["-"], ["look", "-"]):
        result = run(*command, stdin=b"")
        assert (result.code, result.out) == (3, "")
        remedy = "check the command before the pipe, or the file that is read"
        assert result.err == f"fitmodels: standard input is empty: {remedy}.\n"
        monkeypatch.setattr(sys, "stdin", SimpleNamespace(closed=False, isatty=lambda: True))
        result = run(*command)
        assert (result.code, result.out) == (2, "")
        assert "standard input is a terminal" in result.err
        assert "fitmodels - < data.csv" in result.err
    assert list(here.iterdir()) == []


def test_a_record_on_standard_input_is_identified(here):
    t = np.arange(600) * 0.02
    u = np.sign(np.sin(2 * np.pi * 0.3 * t * (1 + t / 12)))
    y = np.zeros_like(u)
    for k in range(1, len(u)):
        y[k] = 0.9 * y[k - 1] + 0.1 * u[k - 1]
    y += np.random.default_rng(1).normal(0, 0.005, len(u))
    rows = "\n".join(f"{a:.2f},{b:.1f},{c:.5f}" for a, b, c in zip(t, u, y, strict=True))
    data = f"time [s],command [V],current [A]\n{rows}\n".encode()
    looked = run("look", "-", stdin=data)
    assert looked.code == 3
    assert "identify it with fitmodels -, or" in looked.err
    result = run("-", stdin=data)
    assert result.code == 0, result.err
    (folder,) = (here / "stdin-fit").rglob("params.json")
    pf = parameters.read(folder)
    assert pf.provenance.data_file == "standard input"
    assert pf.dynamics is not None
    again = run("-", stdin=data)
    assert again.code == 2
    assert again.err.startswith("fitmodels: standard input is a record of a run: stdin-fit exists")


# Commands


def test_an_option_of_the_remedy_replaces_the_typed_one():
    words = ["a.csv", "--unit", "VB=mm", "--unit=t=s", "--edge", "col1", "--json", "--map", "V=a b"]
    assert corrected(words, "--unit VB=um --edge none") == (
        "fitmodels a.csv --unit=t=s --map 'V=a b' --unit VB=um --edge none"
    )
    assert corrected(["a.csv"], "--map 'V=") == "fitmodels a.csv --map 'V="


def test_alternatives_of_a_message_are_separate_commands():
    assert remedies_in('give --map "V=vc (m/min)" or --map V=col2') == ['--map "V=vc (m/min)"', "--map V=col2"]
    assert remedies_in("assign them, for instance --map V=col1") == []
    assert remedies_in("no remedy") == []


def test_a_column_of_forces_without_numbers_raises_no_warning(here):
    rows = "\n".join(f"{80 + 10 * k},0.2,1.5,,{100 + k}" for k in range(8))
    (here / "a.csv").write_text(f"V [m/min],f [mm/rev],d [mm],Fx [N],Ff [N]\n{rows}\n")
    assert run("look", "a.csv").code == 0


def test_next_plans_for_rows_that_have_times_but_no_edges(here):
    """Names of two columns were exchanged, so that no edges were found and the life was extrapolated."""
    V, t = [80, 120, 180, 80, 120, 180, 100, 150], [2, 4, 7, 10, 14, 18]
    wear = [[0.02 * v**0.3 * time**0.25 * (1 + 0.01 * (k + time) % 0.05) for time in t] for k, v in enumerate(V)]
    rows = "\n".join(
        f"{v},{0.2 + 0.01 * (k % 3)},{1 + 0.5 * (k % 2)},{time},{wear[k][j]:.4f}"
        for k, v in enumerate(V)
        for j, time in enumerate(t)
    )
    (here / "a.csv").write_text(f"V [m/min],f [mm/rev],d [mm],t [min],AW [mm]\n{rows}\n")
    result = run("next", "a.csv", "--edge", "none")
    assert result.code == 0, result.err


def test_the_columns_of_a_plan_that_are_empty_are_named(here):
    run("plan", "--range", "V=80:200", "--range", "f=0.1:0.4", "--measure", "VB,Fc", "--out", "plan.csv")
    printed = run("look", "plan.csv").out
    assert "No law can be fitted: columns 'VB [mm]' and 'Fc [N]' are empty. Filled in, the file is read by:" in printed
    assert "add columns" not in printed
