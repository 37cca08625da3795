"""What every command has in common: help, examples that run, refusals, --quiet, --json, and completion in a shell."""

import contextlib
import io
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from fitmodels import datasets, fit, ident, parameters
from fitmodels.cli import COMMANDS, main, module_name
from fitmodels.cli.help import GROUPS, MAIN
from fitmodels.cli.output import as_options
from fitmodels.ident import Model
from fitmodels.parameters.file import sealed
from fitmodels.parameters.published import published

EVERY = ("wear", *COMMANDS)
DOCS = Path(__file__).resolve().parent.parent / "docs" / "examples"
FITTED = "data-fit/GC435_709M40-En-19/params.json"
ON_DATA = ("wear", "look", "compare", "next")  # read a table of tests
ON_PARAMS = (
    "adaptive-force",
    "costs",
    "optimum",
    "predict",
    "check",
    "limits",
    "roughness",
    "settings",
    "simulate",
    "export",
    "card",
    "tune",
    "replay",
    "watch",
)
PYTHON = re.compile(r"\b[a-z_]{2,}=(?:['\"{\[(]|None|True)|\b[a-z_]+\([^)]*=|\bNone\b")  # an argument or a call


def parser(name):
    return import_module(f"fitmodels.cli.{module_name(name)}").parser()


def run(*arguments):
    """The command in this process: exit code, standard output, standard error."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main([str(argument) for argument in arguments])
    return SimpleNamespace(code=code, out=out.getvalue(), err=err.getvalue())


def sentence(result, code):
    """One sentence on standard error, in terms of the command, and nothing on standard output."""
    assert (result.code, result.out) == (code, "")
    assert result.err.startswith("fitmodels")
    assert result.err.count("\n") == 1
    assert result.err.endswith((".\n", "?\n"))
    assert not PYTHON.search(result.err), result.err
    return result.err


# --- help


@pytest.mark.parametrize("name", EVERY)
def test_help_is_short_and_begins_with_its_example(name, monkeypatch):
    monkeypatch.setenv("COLUMNS", "100")
    words = [MAIN] if name == "wear" else [name]
    result = run(*words, "-h")
    assert (result.code, result.err) == (0, "")
    assert run("help", *words).out == result.out == parser(name).format_help()
    lines = result.out.splitlines()
    assert len(lines) <= 40
    assert lines[0].startswith("example: fitmodels")
    assert any(line.startswith("usage: fitmodels") for line in lines)


@pytest.mark.parametrize("columns", [60, 100, 200])
@pytest.mark.parametrize("name", EVERY)
def test_help_is_as_wide_as_the_terminal_and_at_most_120(name, columns, monkeypatch):
    monkeypatch.setenv("COLUMNS", str(columns))
    for text in (parser(name).format_help(), parser(name).format_all()):
        unbroken = [line for line in text.splitlines()[1:] if len(line) > min(columns, 120) and " " in line.strip()]
        assert unbroken == []


@pytest.mark.parametrize("name", EVERY)
def test_every_option_is_explained_with_its_default(name):
    of, text = parser(name), run(*([MAIN] if name == "wear" else [name]), "--help-all").out
    helps = of._get_formatter()._get_help_string
    options = [action for action in of._actions if action.option_strings and action.dest not in ("help", "help_all")]
    for action in options:
        assert re.search(rf"^ +{action.option_strings[0]}\b", text, flags=re.M)
        assert action.nargs == 0 or action.required or "default" in helps(action), action.option_strings
    short = of.format_help()
    assert all(action.option_strings[0] in short for action in options)


def test_the_overview_lists_every_command_once():
    names = [name for group in GROUPS.values() for name in group]
    assert sorted(names) == sorted([MAIN, *COMMANDS])
    alone, asked = run(), run("help")
    assert (alone.code, asked.code, run("-h").code) == (2, 0, 0)  # nothing was asked for: a script notices
    assert alone.out == asked.out == run("--help").out
    assert len(asked.out.splitlines()) <= 41
    assert all(re.search(rf"^  {name} ", asked.out, flags=re.M) for name in names)
    assert "--value" in run("help", "FILE", "--all").out


# --- words that are no command, file or option


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["pedict", "params.json", "V=1"], "did you mean 'fitmodels predict'?"),
        (["Limits"], "did you mean 'fitmodels limits'?"),
        (["fit", "data.csv"], "did you mean 'fitmodels data.csv'?"),
        (["identify", "run.csv"], "did you mean 'fitmodels ident'?"),
        (["--json", "predict", "params.json"], "the command comes first: fitmodels predict --json"),
        (["plot", "."], "there is no such file or command; 'fitmodels help' lists"),
        (["help", "pedict"], "did you mean 'fitmodels help predict'?"),
        (["help", "nonsense"], "'fitmodels help' lists the commands"),
    ],
)
def test_a_misspelt_command_is_guessed(words, says, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert says in sentence(run(*words), 2)


@pytest.mark.parametrize("name", [f"{'x' * 300}.csv", "a\0b.csv"])
def test_a_name_that_no_file_can_have_is_one_sentence(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = run(name)
    assert done.code in (2, 3)
    assert "cannot be read" in sentence(done, done.code)


@pytest.mark.parametrize("name", [name for name in EVERY if name not in ("help", "completion", "app")])
def test_an_unknown_option_is_one_sentence(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = ["data.csv"] if name == "wear" else [name]
    words += {"reduce": ["x", "--plan", "p", "--out", "o"], "confirm": ["x", "--data", "y"]}.get(name, ["x"])[
        name == "wear" :
    ]
    words += {"settings": ["--worn", "1"], "export": ["--to", "c"], "limits": ["P=1"], "costs": ["machine=60/h"],
              "roughness": ["Ra=1um"], "merge": ["--out", "o"]}.get(name, [])  # fmt: skip
    said = sentence(run(*words, "--jsno"), 2)
    assert "--jsno" in said
    assert "did you mean --json?" in said


@pytest.mark.parametrize("more", [[], ["--json"], ["--quiet"]])
@pytest.mark.parametrize("name", [*ON_DATA, *ON_PARAMS, "ident", "confirm", "reduce", "batch"])
def test_a_missing_file_is_one_sentence_that_names_the_nearest(name, more, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("wear.csv").write_text("V\n1\n")
    Path("params.json").write_text("{}")
    file = "parms.json" if name in ON_PARAMS else "waer.csv"
    words = [file] if name == "wear" else [name, file]
    words += {"reduce": ["--plan", "p", "--out", "o"], "confirm": ["--data", "waer.csv"], "settings": ["--worn", "1"],
              "export": ["--to", "c"], "limits": ["P=1"], "costs": ["edge=1"],
              "roughness": ["Ra=1um"], "predict": ["V=1"]}.get(name, [])  # fmt: skip
    result = run(*words, *more)
    assert file in sentence(result, result.code)
    assert result.code in (2, 3)
    if name not in ("reduce", "batch"):
        assert re.search(r"[Dd]id you mean (wear\.csv|params\.json)\?", result.err)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["params.json", "wear.csv"]


@pytest.mark.parametrize(
    ("python", "command"),
    [
        ("by='lot': the usable rows hold one level only (a). Fit without by.", "--by lot"),
        ("fit with error='multiplicative', or restrict the range", "--error multiplicative"),
        ("Give rise_time or settling_time, or aim='iae'.", "--rise or --settle, or --aim iae"),
        ("the loop is algebraic. Give the controller delay=1, or identify with nk=1.", "--delay 1"),
    ],
)
def test_advice_in_terms_of_python_becomes_options(python, command):
    assert command in as_options(python)
    assert not PYTHON.search(as_options(python))


@pytest.mark.parametrize(
    "file", ["seed=1/data.csv", "law 3.csv", "draws 2.csv", "runs/edge=8.csv", "form 1/level=3.csv", "error='a'.csv"]
)
def test_names_of_files_and_columns_are_not_taken_for_arguments(file, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert as_options(f"columns V, level=3 and edge=8 of {file}") == f"columns V, level=3 and edge=8 of {file}"
    assert run(file).err.startswith(f"fitmodels: {file} does not exist")
    Path(file).parent.mkdir(exist_ok=True)
    Path(file).write_text("V,f\n")
    assert run(file).err.startswith(f"fitmodels: {Path(file).name} holds a header only")


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--gauge-sd", "-1"], "--gauge-sd -1"),
        (["--criterion", "0"], "--criterion 0"),
        (["--draws", "7"], "--draws 7"),
        (["--seed", "-3"], "--seed"),
        (["--form", "cubic"], "--form 'cubic'"),
        (["--form", "Q=linear"], "Q"),
        (["--priors", "nowhere.toml"], "nowhere.toml"),
        (["--by", "lot"], "lot"),
        (["--map", "V=col99"], "--map"),
        (["--law", "Ra"], "--law"),
        (["--law", "AW ~ log(V)"], "log(V)"),
        (["--unit", "V=parsec"], "'parsec'"),
        (["--range", "V=1"], "--range V=1"),
        (["--value", "D=x"], "--value D=x"),
        (["--correct", "E01"], "--correct E01"),
        (["--leave-out", "E99"], "--leave-out"),
        (["--edge", "nothing"], "--edge"),
        (["--sheet", "2"], "sheet"),
    ],
)
def test_errors_of_options_name_the_option(words, says, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("data.csv").write_text(table())
    assert says in run("data.csv", "--json", *words).err
    for command in (["data.csv"], ["compare", "data.csv"], ["next", "data.csv"]):
        result = run(*command, "--json", *words)
        assert result.code in (0, 2, 3, 4)
        assert not PYTHON.search(result.err), result.err
        assert "internal error" not in result.err


# --- the examples of the help


def table(scale=1.0, seed=18, head=""):
    """Twelve edges of known laws: wear and power, 2 % scatter."""
    rng = np.random.default_rng(seed)
    lines = [f"{head}edge,V [m/min],f [mm/rev],d [mm],t [min],AW [mm],P [kW]"]
    factors = [(V, f, d) for V in (80, 160) for f in (0.1, 0.3) for d in (1, 2)] + [(113, 0.17, 1.4)] * 4
    for k, (V, f, d) in enumerate(factors, 1):
        for t in (2, 5, 10, 20):
            AW = scale * 0.01 * V**0.5 * f**0.2 * d**0.2 * t**0.35 * rng.lognormal(0, 0.02)
            P = 0.05 * V**0.9 * f**0.7 * d**0.9 * AW**0.3 * rng.lognormal(0, 0.02)
            lines.append(f"E{k:02d},{V},{f},{d},{t},{AW:.5g},{P:.5g}")
    return "\n".join(lines) + "\n"


def without_power(text):
    """The table of one law, which is twice as fast."""
    return "".join(f"{line.rpartition(',')[0]}\n" for line in text.splitlines())


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """A folder with data.csv, and the result of the first example: fitmodels data.csv."""
    place = tmp_path_factory.mktemp("examples")
    (place / "data.csv").write_text(table(head="# tool: GC435\n# work: 709M40 (En 19)\n"))
    with contextlib.chdir(place):
        result = run(*shlex.split(parser("wear").example)[1:])
    assert (result.code, result.err) == (0, "")
    assert (place / FITTED).is_file()
    return place


def _params(pf):
    parameters.write(pf, Path("params.json"), force=True)


def _plant():
    return Model(
        b=[0, 0.0611, -0.1338, 0.0752], a=[1, -2.0311, 1.2104, -0.1655], nk=1, sample_time=0.02, unit_u="V", unit_y="A"
    )


def _record():
    u = ident.chirp(2.5, 0.1, 2.0, duration=15, rate=50)
    y = _plant().simulate(u) + np.random.default_rng(1).normal(0, 0.01, len(u))
    rows = [f"{k / 50:g},{a:.6g},{b:.6g}" for k, (a, b) in enumerate(zip(u, y, strict=True))]
    Path("run.csv").write_text("\n".join(["t [s],u [V],y [A]", *rows]) + "\n")


def _shop():
    Path("measurements").mkdir()
    Path("measurements/a.csv").write_text("# tool: A\n# work: 42CrMo4\n" + without_power(table()))
    Path("pairs.csv").write_text("tool,work,grade\nA,42CrMo4,P\n")


def _records():
    Path("data.csv").unlink()
    shutil.copytree(DOCS / "records", "records")
    shutil.copy(DOCS / "records-plan.csv", "tests.csv")


def _watched():
    """The fitted file, and a recorded run of one cut."""
    for path in Path(FITTED).parent.glob("*.[jn][sp]*"):
        shutil.copy(path, path.name)
    rows = [f"{k / 5:.1f},{2.5 if 20 <= k < 60 else 0.8 + 0.01 * (k % 3)},150,0.2,2" for k in range(80)]
    Path("run.csv").write_text("time [s],P [kW],V [m/min],f [mm/rev],d [mm]\n" + "\n".join(rows) + "\n")


def _divided():
    """A file of a load law and one of a wear law."""
    whole = published("CLM-2023")
    laws = {"load-fit": "I", "wear-fit": "VB"}
    for folder, name in laws.items():
        Path(folder).mkdir()
        pf = sealed(whole, laws={name: whole.laws[name]}, **({"tool_life": None} if name == "I" else {"pi": None}))
        parameters.write(pf, f"{folder}/params.json")


def _turning():
    table = datasets.bundled("surf_table1")
    return parameters.collect(laws=[fit.exponential_law(table, "Ra", "F"), fit.power_law(table, "F", ["f"])])


def _estimates():
    """The estimates of LYAP, their run and the tested ranges alone."""
    held = published("LYAP").adaptive_force.model_dump()
    tested = "command 100 to 400 mm/min, force 80 to 320 N: smallest and largest values of run.csv"
    kept = ("m", "alpha", "beta", "uncertainty", "unit_u", "depth", "verdict")
    return {**{name: held[name] for name in kept}, "spindle_speed": 3000.0, "sources": {"tested": tested}}


COSTS = {"currency": "EUR", "machine": 60.0, "edge": 8.0, "change": 1.5}
PREPARED = {  # what the example of a command needs besides data.csv and its result
    "adaptive-force": lambda: _params(sealed(published("LYAP"), adaptive_force=_estimates())),
    "batch": _shop,
    "compare": lambda: Path("data.csv").write_text(without_power(table())),
    "confirm": lambda: Path("new.csv").write_text(table(seed=4)),
    "ident": _record,
    "optimum": lambda: _params(sealed(published("AC-2017"), costs=COSTS)),
    "limits": lambda: _params(sealed(published("AC-2017"), limits=None)),
    "merge": _divided,
    "publish": lambda: shutil.copytree("data-fit", "results"),
    "reduce": _records,
    "roughness": lambda: _params(_turning()),
    "settings": lambda: _params(sealed(published("CLM-2023"), load_line=None)),
    "watch": _watched,
    "tune": lambda: _params(parameters.collect(tool="end mill", work="S45C", dynamics=_plant(), simulated=True)),
}


@pytest.fixture
def place(fitted, tmp_path, monkeypatch, constant_load_file):
    """A folder of its own for one example, with what the example needs."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")
    shutil.copytree(fitted, tmp_path, dirs_exist_ok=True)
    _params(constant_load_file())
    return tmp_path


ENDLESS = ("app",)  # serves until it is interrupted; see test_app.py


@pytest.mark.parametrize("name", [name for name in COMMANDS if name not in ENDLESS])
def test_the_example_of_the_help_runs(name, place):
    PREPARED.get(name, lambda: None)()
    words = shlex.split(parser(name).example)
    assert words[:2] == ["fitmodels", name]
    result = run(*words[1:])
    if name == "completion" and "argcomplete" in result.err:
        pytest.skip("pip install argcomplete")
    assert result.code == 0, result.err
    assert "fitmodels:" not in result.err  # progress of long work only
    assert result.out


SLOW = ("batch", "compare", "ident", "look", "next", "publish", "reduce", "replay", "tune")  # run once, not three times
TWICE = [name for name in COMMANDS if name not in (*SLOW, *ENDLESS, "help", "completion")]


@pytest.mark.parametrize("name", TWICE)
def test_quiet_prints_paths_and_json_prints_json(name, place):
    PREPARED.get(name, lambda: None)()
    words = shlex.split(parser(name).example)[1:]
    force = ["--force"] if name in ("card", "limits", "merge", "roughness", "settings", "optimum") else []
    result = run(*words, "--quiet", *force)
    assert (result.code, result.err) == (0, "")
    assert [line for line in result.out.splitlines() if not Path(line).exists()] == []
    again = run(*words, "--json", *({"--force"} & {*parser(name)._option_string_actions}))
    assert (again.code, again.err) == (0, "")
    assert json.loads(again.out)["schema"] in parser(name).format_all()


# --- completion


COMPLETE = {
    "bash": """eval "$(fitmodels completion bash)"
for line in "$@"; do
  COMP_LINE=$line COMP_POINT=${#line} COMP_TYPE=9 COMPREPLY=()
  read -ra COMP_WORDS <<<"$line"; [[ $line == *" " ]] && COMP_WORDS+=("")
  COMP_CWORD=$((${#COMP_WORDS[@]} - 1)); _python_argcomplete fitmodels "${COMP_WORDS[COMP_CWORD]}" ""
  echo "${COMPREPLY[@]}"
done""",
    "fish": """fitmodels completion fish | source
for line in $argv; complete -C $line | cut -f1 | string join ' '; echo; end""",
}


@pytest.mark.parametrize("shell", ["bash", pytest.param("fish", marks=pytest.mark.consumer)])
def test_a_shell_completes_commands_options_values_and_files(shell, place, consumer):
    pytest.importorskip("argcomplete", reason="pip install argcomplete")
    consumer(shell, f"apt-get install {shell}")
    (place / "bin").mkdir()
    (place / "bin" / "fitmodels").write_text(f'#!/bin/sh\nexec "{sys.executable}" -m fitmodels "$@"\n')
    (place / "bin" / "fitmodels").chmod(0o755)
    lines = ["fitmodels pred", "fitmodels predict data-fit/GC435_709M40-En-19/par", "fitmodels predict x --interval m",
             f"fitmodels predict {FITTED} ", "fitmodels data.csv --quie", "fitmodels help se"]  # fmt: skip
    environment = {**os.environ, "PATH": f"{place / 'bin'}:{os.environ['PATH']}", "HOME": str(place)}
    job = subprocess.run(
        [shell, "-c", COMPLETE[shell], *(["bash"] if shell == "bash" else []), *lines],
        env=environment, capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    found = [line.split() for line in job.stdout.splitlines() if line.strip()]
    assert found[0] == ["predict"], job.stderr
    assert [word.rsplit("/", 1)[-1] for word in found[1]] == ["params.json"]
    assert found[2] == ["mean"]
    assert {"V=", "f=", "d=", "t=", "T"} <= {*found[3]}
    assert found[4:] == [["--quiet"], ["settings"]]
