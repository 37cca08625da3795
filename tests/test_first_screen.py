"""The first screen: its text at several widths, its lines, its commands, colours, and pipes that close early."""

import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from fitmodels import cards, parameters
from fitmodels.cards.first_screen import FirstScreen
from fitmodels.cards.reading_terminal import shortened
from fitmodels.cli import main
from fitmodels.core.verdict import LEVELS
from fitmodels.datasets import bundled, read_runs
from fitmodels.pipeline import FitOptions
from fitmodels.pipeline.analysis import analysis_stages

HERE = Path(__file__).parent / "screens"
GC435 = bundled("gc435_709m40")
FOLDER = "data-fit/GC435_709M40-En-19"
LINES = 25
WIDTHS = (60, 80, 120)
# Base colours of a terminal, bold and dim: every theme, light or dark, chooses them to be legible on its background.
# No background, no white, no black, no colour of 256 or of 16 million; 39 is the default of the theme.
LEGIBLE = {"0", "1", "2", "31", "32", "33", "1;31", "1;33", "1;32", "39"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The bundled set and its result."""
    root = tmp_path_factory.mktemp("screen")
    (root / "data.csv").write_bytes(GC435.read_bytes())
    here = Path.cwd()
    os.chdir(root)
    try:
        assert main(["data.csv", "--quiet", "--draws", "1000"]) == 0
    finally:
        os.chdir(here)
    return root


@pytest.fixture
def shown(folder, monkeypatch, capsys):
    """The screen of a command in the folder of the result, which is unchanged."""
    monkeypatch.chdir(folder)
    for name in ("FORCE_COLOR", "NO_COLOR", "COLORTERM", "TTY_COMPATIBLE"):
        monkeypatch.delenv(name, raising=False)

    def call(*arguments, width=100, **environment):
        monkeypatch.setenv("COLUMNS", str(width))
        for name, value in environment.items():
            monkeypatch.setenv(name, value)
        capsys.readouterr()
        code = main(list(arguments) or ["data.csv", "--draws", "1000"])
        return code, *capsys.readouterr()

    return call


def commands(screen):
    """The commands of a screen as a user copies them: lines ended by a backslash are joined, comments left out."""
    joined = re.sub(r" \\\n +", " ", screen)
    return [line.strip().split("  #")[0] for line in joined.split("\n") if line.startswith("  fitmodels ")]


def write(path, frame):
    frame.to_csv(path, index=False)
    return str(path)


def wear_tests(rng, edges):
    """Wear tests of a known law with scatter between edges and rows, five readings of each edge."""
    scatter, exponent = 0.05, 0.3
    V, f = rng.choice([80.0, 120.0, 180.0], edges), rng.choice([0.1, 0.2, 0.3], edges)
    level = 0.01 * V**0.5 * f**0.2 * np.exp(rng.normal(0, scatter, edges))
    t = np.arange(1, 6) * 4.0
    rows = [
        (f"E{i}", V[i], f[i], x, level[i] * x**exponent * np.exp(rng.normal(0, scatter)))
        for i in range(edges)
        for x in t
    ]
    return pd.DataFrame(rows, columns=["edge", "V [m/min]", "f [mm/rev]", "t [min]", "VB [mm]"])


@pytest.mark.parametrize("width", WIDTHS)
def test_the_screen_as_text(shown, width):
    code, out, err = shown(width=width)
    assert (code, err) == (0, "")
    expected = HERE / f"gc435_{width}.txt"
    if os.environ.get("FITMODELS_WRITE_SCREENS"):
        expected.write_text(out, "utf-8")
    assert out == expected.read_text("utf-8")


def test_a_command_longer_than_a_line_is_not_broken_inside_a_word(shown, folder):
    name = "a long name, it's one of a customer, " * 3
    (folder / f"{name}.csv").write_bytes(GC435.read_bytes())
    code, out, _ = shown(f"{name}.csv", "--draws", "1000", width=60)
    assert code == 0
    assert shlex.split(commands(out)[0])[2] == f"{name}-fit/GC435_709M40-En-19/params.json"


def test_the_card_names_files_without_their_folders(shown, tmp_path):
    """Folders of the computer stay on the terminal and in params.json."""
    secret = tmp_path / "customer X"
    secret.mkdir()
    (secret / "data.csv").write_bytes(GC435.read_bytes())
    _, out, _ = shown(str(secret / "data.csv"), "--draws", "1000", "--out", str(secret / "out"), width=120)
    assert "customer X/data.csv" in out
    pair = secret / "out" / "GC435_709M40-En-19"
    for name in ("card.html", "README.md", "card.json"):
        text = (pair / name).read_text("utf-8")
        assert "customer X" not in text, name
        assert "data.csv" in text


def test_the_tool_life_is_that_of_its_command(shown, folder):
    card = json.loads((folder / FOLDER / "card.json").read_text("utf-8"))["tool_life"]
    _, out, _ = shown(*shlex.split(card["command"].replace("params.json", f"{FOLDER}/params.json"))[1:])
    assert "V=100 f=0.19 d=2.12" in card["command"]
    assert float(re.search(r"T ([\d.]+) min", out)[1]) == pytest.approx(card["typical"]["value"], rel=0.005)
    assert f"{card['edge_low']['text']} to {card['edge_high']['text']} min" in " ".join(out.split())


@pytest.mark.parametrize("width", range(60, 130, 7))
def test_no_width_needs_more_than_25_lines(shown, width):
    _, out, _ = shown(width=width)
    assert out.count("\n") <= LINES
    assert max(map(len, out.split("\n"))) <= width
    for words in ("usable inside", "EXTRAPOLATED", "tool life", "NOT MEASURED", "fitmodels predict", "Next"):
        assert words in out


def test_colours_are_those_of_the_terminal_and_never_stand_alone(shown):
    _, out, _ = shown(width=80, FORCE_COLOR="1", TERM="xterm-256color", COLORTERM="truecolor")
    visible = out.replace("\x1b", "\\e")
    expected = HERE / "gc435_80_colour.txt"
    if os.environ.get("FITMODELS_WRITE_SCREENS"):
        expected.write_text(visible, "utf-8")
    assert visible == expected.read_text("utf-8")
    assert set(re.findall(r"\x1b\[([\d;]*)m", out)) <= LEGIBLE
    _, sixteen, _ = shown(width=80, TERM="xterm", COLORTERM="")
    assert sixteen == out
    plain = re.sub(r"\x1b\[[\d;]*m", "", out)
    assert plain == (HERE / "gc435_80.txt").read_text("utf-8")
    for line, words in re.findall(r"\x1b\[(?:32|33|1;31)m([✓!✗]) \w+ +([^\x1b]*)\x1b", out):
        assert line in "✓!✗"
        assert words.startswith((*LEVELS, "MEASURED", "reservation"))


def test_a_pipe_and_no_color_are_plain(shown):
    plain = (HERE / "gc435_80.txt").read_text("utf-8")
    assert shown(width=80)[1] == plain
    coloured = shown(width=80, FORCE_COLOR="1", NO_COLOR="1", TERM="xterm-256color")[1]
    assert not re.search(r"\x1b\[[\d;]*3\dm", coloured)
    assert re.sub(r"\x1b\[[\d;]*m", "", coloured) == plain


def test_an_encoding_without_the_icons_has_others():
    assert [FirstScreen(80, ascii=True).icon(level) for level in (0, 1, 2, None)] == ["+", "!", "x", "?"]


def test_each_command_of_the_screen_runs(folder, shown):
    _, screen, _ = shown(width=60)
    wide = shown(width=120)[1]
    found = dict.fromkeys([*commands(screen), *commands(wide)])
    assert {command.split()[1] for command in found} == {"predict", "next", "limits", "replay", "export"}
    for command in found:
        words = shlex.split(command)[1:]
        if words[0] != "replay":  # takes seconds: below
            code, _, err = shown(*words)
            assert (code, err) == (0, ""), command


@pytest.mark.slow
def test_the_replay_of_the_screen_runs_after_its_limits(folder, shown):
    found = {command.split()[1]: shlex.split(command)[1:] for command in commands(shown(width=120)[1])}
    assert shown(*found["limits"])[0] == 0
    assert shown(*found["replay"], "--out", "figures")[0] == 0


def test_the_prediction_is_that_of_its_command(shown):
    _, screen, _ = shown(width=120)
    (command,) = [one for one in commands(screen) if one.startswith("fitmodels predict") and " AW " in one]
    _, out, _ = shown(*shlex.split(command)[1:], "--json")
    import json

    (one,) = json.loads(out)["predictions"]
    value, low, high = re.search(r"AW (\S+) mm; 95 % prediction interval (\S+) to (\S+) mm", screen).groups()
    assert [float(value), float(low), float(high)] == pytest.approx([one["value"], one["low"], one["high"]], abs=6e-4)
    assert one["inside"]


def test_a_closed_pipe_leaves_the_folder_complete(folder, tmp_path):
    command = (
        f"{sys.executable} -m fitmodels data.csv --draws 1000 --out {tmp_path}/out | head -1; exit ${{PIPESTATUS[0]}}"
    )
    done = subprocess.run(["bash", "-c", command], cwd=folder, capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stderr, done.stdout.count("\n")) == (0, "", 1)
    (made,) = (tmp_path / "out").iterdir()
    pf = parameters.read(made / "params.json")
    assert all((made / file).is_file() for file in cards.files(pf))


def test_quiet_prints_the_folder_alone_and_json_nothing_else(shown, tmp_path):
    assert shown("data.csv", "--draws", "1000", "--quiet")[1] == f"{FOLDER}\n"
    assert shown("data.csv", "--draws", "1000", "--json", "--out", str(tmp_path))[1].startswith("{")


def test_what_must_not_be_used_is_red_and_has_no_prediction(shown, tmp_path):
    rng = np.random.default_rng(1)
    frame = wear_tests(rng, 8)
    frame["VB [mm]"] = rng.uniform(0.05, 0.4, len(frame)).round(3)
    code, out, _ = shown(
        write(tmp_path / "noise.csv", frame), "--out", str(tmp_path / "fit"), FORCE_COLOR="1", TERM="xterm"
    )
    assert code == 0
    assert re.search(r"\x1b\[1;31m✗ VB +do not use for control", out)
    assert re.search(r"\x1b\[1;31m✗ Do not use", out)
    assert "✓" not in out
    assert "fitmodels predict" not in out
    assert "export" not in out


def test_doubts_stand_in_red_with_the_command_that_removes_them(shown, tmp_path):
    frame = wear_tests(np.random.default_rng(2), 8).rename(columns={"VB [mm]": "VB"})
    frame["VB"] = (1000 * frame["VB"]).round(0)
    path = write(tmp_path / "um.csv", frame)
    code, out, _ = shown(path, "--out", str(tmp_path / "fit"), FORCE_COLOR="1", TERM="xterm")
    assert code == 0
    assert re.search(r"\x1b\[1;31m! 1 doubt about the data: VB \d+ to \d+ has no unit", out)
    assert "--unit VB=um" in "".join(commands(re.sub(r"\x1b\[[\d;]*m", "", out)))


def test_a_unit_given_against_the_header_is_on_the_screen_and_in_the_file(shown, tmp_path):
    frame = wear_tests(np.random.default_rng(2), 8)
    frame["VB [mm]"] = (1000 * frame["VB [mm]"]).round(0)
    path = write(tmp_path / "um.csv", frame)
    code, out, _ = shown(path, "--unit", "VB=um", "--out", str(tmp_path / "fit"))
    assert code == 0
    assert "VB, the header says mm, --unit VB=um is used" in " ".join(out.split())
    assert "--unit VB=um is used" in next((tmp_path / "fit").rglob("params.json")).read_text("utf-8")


def test_a_table_pasted_again_is_on_the_screen(shown, tmp_path):
    frame = wear_tests(np.random.default_rng(2), 8)
    path = write(tmp_path / "twice.csv", pd.concat([frame, frame], ignore_index=True))
    code, out, _ = shown(path, "--out", str(tmp_path / "fit"))
    assert code == 0
    assert "repeat the " in " ".join(out.split())
    assert "others in every cell, and each measurement is counted once" in " ".join(out.split())


@pytest.mark.parametrize("pairs", [2, 5])
def test_several_pairs_share_the_screen(shown, tmp_path, pairs):
    rng = np.random.default_rng(3)
    frame = pd.concat([wear_tests(rng, 5).assign(tool="T1", work=f"steel {i}") for i in range(pairs)])
    code, out, _ = shown(write(tmp_path / "many.csv", frame), "--draws", "1000", "--out", f"many{pairs}", width=60)
    assert code == 0
    assert out.count("\n") <= LINES
    assert max(map(len, out.split("\n"))) <= 60
    assert f"{25 * pairs} rows of {5 * pairs} edges; {pairs} pairs" in out
    assert out.count("T1 on steel 0") == 1
    assert len(list(Path(f"many{pairs}").iterdir())) == pairs


def test_of_many_pairs_the_first_are_a_line_each(folder):
    pf, runs = parameters.read(folder / FOLDER / "params.json"), read_runs(GC435)
    screen = FirstScreen(60, pairs=40)
    lines = [line.plain for _ in range(40) for line in screen.pair_lines(pf, runs, (), "params.json")]
    assert len(lines) == screen.height
    assert screen.used == 40
    assert lines[0].split() == ["GC435", "on", "709M40", "...", "✓", "AW", "✓", "Fxz", "✓", "P", "!", "tool", "life"]


def test_every_reservation_has_a_remedy_of_its_own(shown, tmp_path):
    from fitmodels.cards.content.verdicts import verdicts_of

    shown("data.csv", "--draws", "1000")
    (life,) = [one for one in verdicts_of(parameters.read(f"{FOLDER}/params.json")) if one.reasons]
    assert len(life.remedies) == len(life.reasons)
    assert life.remedies[0].command == "fitmodels next data.csv"


def test_laws_come_before_chains():
    runs = read_runs(GC435)
    stages = analysis_stages(runs, FitOptions(draws=1000, student=True, laws=("AW ~ V, f, d, t",)))
    first, complete = next(stages)
    stages.close()
    assert not complete
    assert not first.posteriors
    assert {law.verdict.level for law in first.parameters.laws.values()} <= set(LEVELS)


@pytest.mark.parametrize("width", [60, 75, 100])
def test_all_tables_keep_estimate_error_t_p_and_interval(shown, width):
    _, out, _ = shown("data.csv", "--draws", "1000", "--full", width=width)
    assert max(map(len, out.split("\n"))) <= width
    (heading,) = {" ".join(line.split()[:8]) for line in out.split("\n") if line.split()[:1] == ["estimate"]}
    assert heading.startswith("estimate SE t p 95 % interval")
    row = next(line for line in out.split("\n") if re.match(r"  V +0\.533", line))
    assert row.split()[:8] == ["V", "0.533", "0.057", "9.387", "<0.001", "0.416", "…", "0.651"]
    assert len(re.findall(r"✓ passed", out)) == 28 + 27 + 27


@pytest.mark.parametrize("width", WIDTHS)
def test_lives_and_run_outs_stand_on_the_first_line(shown, tmp_path, width):
    path = tmp_path / "lives.csv"
    lives = [">60", ">60", ">60", 41, 38, 22.5, 21, 11.8, 10.9, 7.2, 7.4, 4.1]
    rows = [f"{120 + 30 * (i // 2)},{0.2 * (1 + i % 2):.1f},{life}" for i, life in enumerate(lives)]
    path.write_text("\n".join(["vc [m/min],f [mm/rev],T [min]", *rows]))
    code, out, _ = shown(str(path), "--out", f"lives{width}", width=width)
    assert code == 0
    assert "12 lives: 9 ended (4.1 to 41 min), 3 run-outs (>60)" in " ".join(out.split())
    assert out.count("\n") <= LINES


def forces(rng):
    """54 rows of three measured forces with a column that numbers six tools."""
    V, f, d = (np.tile(np.repeat(levels, n), 54 // (3 * n)) for levels, n in (
        ([300.0, 350.0, 400.0], 1), ([0.07, 0.1, 0.13], 3), ([0.25, 0.5, 0.8], 9)))  # fmt: skip
    each = {name: c * f**0.7 * d**0.9 * np.exp(rng.normal(0, 0.05, 54)) for name, c in
            (("Fx", 1900.0), ("Fy", 1500.0), ("Fz", 500.0))}  # fmt: skip
    return pd.DataFrame({"vc": V, "f": f, "ap": d, **each, "Tool_ID": np.repeat(range(6), 9)})


@pytest.mark.parametrize("width", WIDTHS)
def test_forces_name_the_column_of_the_tools_and_lead_with_a_measured_one(shown, tmp_path, width):
    _, out, _ = shown(write(tmp_path / "forces.csv", forces(np.random.default_rng(4))), "--out", f"f{width}",
                      width=width)  # fmt: skip
    joined = " ".join(out.split())
    assert "column Tool_ID (6 values) is not used: --edge Tool_ID" in joined
    assert "no edges named" not in joined
    assert "it is the thrust only where Fy is the cutting force" in joined
    assert "here" in joined
    assert out.index("Fx   usable") < out.index("Fxz  usable")
    assert " Fx = " in joined
    assert re.search(r"params.json Fx \\?", joined)
    assert len(re.findall(r"\n! F\w+ +usable with reservations; (?!one row|thrust|force|\d)", out)) == 4
    assert out.count("\n") <= LINES


def test_edges_that_are_named_are_not_said_to_lack_names(shown, tmp_path):
    """Five edges, of which one alone has the second depth of cut."""
    settings = [(150, 0.2, 1.6), (120, 0.2, 1.6), (200, 0.2, 1.6), (150, 0.2, 2.5), (150, 0.3, 1.6)]
    rng = np.random.default_rng(5)
    lines = [
        f"E{n},{V},{f},{d},{t},{0.001 * V * f**0.2 * d**0.1 * t**0.5 * np.exp(rng.normal(0, 0.03)):.3f}"
        for n, (V, f, d) in enumerate(settings, 1)
        for t in (2, 4, 8, 12)
    ]
    (tmp_path / "five.csv").write_text("\n".join(["edge,V [m/min],f [mm/rev],d [mm],t [min],VB [mm]", *lines]))
    _, text, _ = shown(str(tmp_path / "five.csv"), "--draws", "1000", "--out", str(tmp_path / "out"))
    assert "no inference by edge" in text
    assert "edges not named" not in text


def test_rows_that_are_not_used_and_numbered_materials_are_named(shown, tmp_path):
    rng = np.random.default_rng(5)
    frame = pd.concat([wear_tests(rng, 5).assign(material=i) for i in (1, 2)])
    frame["edge"] = [f"{edge}-{material}" for edge, material in zip(frame["edge"], frame["material"], strict=True)]
    frame.iloc[[3, 30], 4] = np.nan
    frame.iloc[[0], 4] = 0.0
    _, out, _ = shown(write(tmp_path / "two.csv", frame), "--out", str(tmp_path / "fit"), width=60)
    assert "3 rows not used: VB empty 2, VB 0 1" in out
    assert "unnamed-tool on material 1\n" in out
    assert out.count("       VB = ") == 2
    assert " ".join(out.split()).count(" at V ") == 4


def test_a_sentence_is_not_cut_within_a_word():
    text = "a common time exponent is rejected: exponents range from 0.53 to 1.12"
    for width in range(10, 69):
        assert text.startswith(cut := shortened(text, width).removesuffix(" ..."))
        assert text[len(cut) :][:1] in ("", " ")


def test_each_printed_command_runs_twice_with_two_files_in_one_folder(shown, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(6)
    first = shown(write(Path("a.csv"), wear_tests(rng, 8)), width=120)[1]
    second = shown(write(Path("b.csv"), forces(rng)), width=120)[1]
    Path("params.ini").write_text("of another program")
    kept = shown("compare", "b.csv")[1]
    (keep,) = [line.strip() for line in kept.split("\n") if "--form" in line and line.startswith("  fitmodels")]
    found = [*commands(first), *commands(second), keep.replace("--form FORM", "--form power")]
    assert {"predict", "next", "limits", "export"} <= {command.split()[1] for command in found}
    fits = [one for one in found if one.split()[1].endswith(".csv")]  # refused once limits were added, which they drop
    others = [one for one in found if one not in fits and one.split()[1] != "replay"]
    again = [f"{one} --force" if one.split()[1] == "export" else one for one in others]  # a file is never overwritten
    for command in [*(one for one in fits for _ in range(2)), *others, *again]:
        code, _, err = shown(*shlex.split(command)[1:])
        assert (code, err) == (0, ""), command


def test_a_corrected_value_shows_the_screen_before_the_refusal(shown, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    frame = wear_tests(np.random.default_rng(7), 6)
    assert shown(write(Path("a.csv"), frame))[0] == 0
    (before,) = Path("a-fit").glob("*/params.json")
    held = before.read_bytes()
    frame.iloc[3, 4] *= 1.05
    code, out, err = shown(write(Path("a.csv"), frame))
    assert code == 2
    assert out.startswith("a.csv: 30 rows of 6 edges")
    assert "VB = " in out
    assert "nothing was written" in err
    assert err.endswith("\n  fitmodels a.csv --force\n")
    assert before.read_bytes() == held
    assert shown(*shlex.split(err.split("\n")[-2])[1:])[0] == 0
    assert before.read_bytes() != held


def test_a_word_of_a_megabyte_is_cut_without_a_wait():
    """A loop over its letters took the square of their number: a fit with a header of 32 kB took minutes."""
    assert shortened("7" * 1_000_000, 80) == f"{'7' * 76} ..."
    assert shortened("ab " * 300_000, 20) == "ab ab ab ab ab ..."
