"""The command as a user meets it: exit codes, streams, folders, cards, and names that mean no good."""

import contextlib
import csv
import errno
import io
import json
import math
import os
import re
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import fitmodels.cards.figures
import fitmodels.cards.folder
import fitmodels.cli.output
import fitmodels.fit
import numpy as np
import pytest
from fitmodels import cards, datasets, parameters
from fitmodels.cli import main
from fitmodels.core.version import __version__
from fitmodels.datasets import bundled, read_runs
from markdown_it import MarkdownIt
from scipy.special import stdtrit

GC435 = bundled("gc435_709m40")
FOLDER = "GC435_709M40-En-19"
ROUNDED = 0.051  # a number reported to two digits of its standard error is off by a twentieth of it at most
ESCAPE = "\x1b"

# Wear of twelve rows, V 60 to 180, exactly AW = 0.01 V^0.5 f^0.2 t^0.3 with 1 % scatter written down by hand.
SCATTER = (1.01, 0.99, 1.0, 1.005, 0.995, 1.01, 0.99, 1.0, 0.998, 1.003, 1.0, 0.997)
CONDITIONS = [
    (V, f, t)
    for V, f, t in zip(
        (60, 90, 120, 180, 60, 90, 120, 180, 60, 90, 120, 180),
        (0.1, 0.2, 0.3, 0.1, 0.3, 0.1, 0.2, 0.3, 0.2, 0.3, 0.1, 0.2),
        (2, 5, 9, 14, 5, 9, 14, 2, 14, 2, 5, 9),
        strict=True,
    )
]
WEAR = [
    (V, f, t, round(0.01 * V**0.5 * f**0.2 * t**0.3 * e, 5)) for (V, f, t), e in zip(CONDITIONS, SCATTER, strict=True)
]
NAMES = (
    "../../x", "<script>alert(1)</script>", '"; M30 (', "a`b|c", "con", "n" * 300, "漢" * 100, "", "...",
    "E/1", "e:1", "new\nline", "*bold* [link](http://x)", "..", "/etc/passwd",
)  # fmt: skip


def write(path, rows=WEAR, header=("V", "f", "t", "AW")):
    with Path(path).open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([header, *rows])
    return str(path)


def run(*arguments):
    """The command in this process: exit code, standard output, standard error."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main([str(argument) for argument in arguments])
    return SimpleNamespace(code=code, out=out.getvalue(), err=err.getvalue())


def refused(result, code, *words):
    """One sentence on standard error, nothing on standard output."""
    assert (result.code, result.out) == (code, "")
    assert result.err.startswith("fitmodels")
    assert result.err.endswith(".\n")
    assert result.err.count("\n") == 1
    for word in words:
        assert word in result.err


def strict(text):
    """JSON whose every number is finite."""

    def no_constant(literal):
        raise AssertionError(f"{literal} in JSON")

    return json.loads(text, parse_constant=no_constant)


def snapshot(folder):
    return {path: (path.stat().st_mtime_ns, path.read_bytes()) for path in folder.rglob("*") if path.is_file()}


def hidden(folder):
    return [path for path in folder.rglob("*") if path.name.startswith(".")]


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """The bundled set, fitted once."""
    root = tmp_path_factory.mktemp("fitted")
    result = run(GC435, "--full", "--out", root / "out")
    result.root, result.folder = root / "out", root / "out" / FOLDER
    result.card = (result.folder / "README.md").read_text("utf-8")
    result.pf = parameters.read(result.folder / "params.json")
    return result


@pytest.fixture
def wear(tmp_path):
    return write(tmp_path / "wear.csv")


# What a run gives


def test_a_run_prints_results_and_writes_one_folder(fitted):
    assert (fitted.code, fitted.err) == (0, "")
    assert fitted.out.index("Input") < fitted.out.index("AW  average wear, mm")
    for law in fitted.pf.laws.values():
        assert law.equation in fitted.out
    assert "Written:" in fitted.out
    assert [path.name for path in fitted.root.iterdir()] == [FOLDER]
    files = {path.relative_to(fitted.folder).as_posix() for path in fitted.folder.rglob("*") if path.is_file()}
    assert files == set(cards.files(fitted.pf))
    assert "draws.npz" in files


def test_the_three_figures_are_pictures(fitted):
    for name in (name for name in fitmodels.cards.folder.FILES if name.endswith(".png")):
        picture = (fitted.folder / name).read_bytes()
        assert picture.startswith(b"\x89PNG\r\n\x1a\n")
        assert len(picture) > 10_000


def test_what_is_written_has_the_users_own_permissions(fitted, tmp_path):
    (tmp_path / "usual").mkdir()
    (tmp_path / "usual.txt").touch()
    assert fitted.folder.stat().st_mode == (tmp_path / "usual").stat().st_mode
    assert (fitted.folder / "params.json").stat().st_mode == (tmp_path / "usual.txt").stat().st_mode


def test_the_json_report_holds_the_numbers_of_the_parameter_file(fitted):
    result = run(GC435, "--json")
    assert (result.code, result.err) == (0, "")
    report = strict(result.out)
    assert report["schema"] == "fitmodels.report/5"
    assert report["understood"]["source"]["rows"] == 239
    (pair,) = report["pairs"]
    assert (pair["tool"], pair["folder"], pair["refused"]) == ("GC435", None, [])
    written = strict((fitted.folder / "params.json").read_text("utf-8"))
    for pf in (written, pair["parameters"]):
        pf.pop("content_sha256"), pf["provenance"].pop("command")  # each as it was typed
    assert pair["parameters"] == written


def test_json_writes_nothing_unless_requested_where(wear, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run("wear.csv", "--json").code == 0
    assert [path.name for path in tmp_path.iterdir()] == ["wear.csv"]
    result = run("wear.csv", "--json", "--out", "there")
    (pair,) = strict(result.out)["pairs"]
    assert (Path(pair["folder"]) / "params.json").is_file()


def test_without_out_the_folder_is_named_after_the_file(wear, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run("wear.csv").code == 0
    assert (tmp_path / "wear-fit" / "unnamed-tool_unnamed-work" / "params.json").is_file()


# The card


def tables(card):
    """Tables of a Markdown text, each a list of rows of cells."""
    found, rows = [], []
    for line in [*card.splitlines(), ""]:
        if line.startswith("|"):
            rows.append([cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]])
        elif rows:
            found.append(rows)
            rows = []
    return found


def test_the_tables_of_the_card_are_well_formed(fitted):
    found = tables(fitted.card)
    heads = [rows[0][0] for rows in found]
    assert heads[:9] == ["coefficient", "check", "parameter"] * len(fitted.pf.laws)  # each law, its checks, its draws
    budgets = ["source"] * len(fitted.pf.laws)
    assert heads[9:] == ["factor", "count", "quantity", *budgets]  # ranges, rows, tool life, budgets
    for head, rule, *rows in found:
        assert all(len(row) == len(head) == len(rule) for row in rows)
        assert all(re.fullmatch(r"-+:?", cell) for cell in rule)


def test_the_card_holds_no_number_that_is_none(fitted):
    assert not re.search(r"\b(nan|inf|null)\b", fitted.card, flags=re.IGNORECASE)
    assert "None" not in fitted.card


def test_every_number_in_the_cards_tables_is_that_of_the_parameter_file(fitted):
    found = [rows for rows in tables(fitted.card) if rows[0][0] == "coefficient"]
    for law, (head, _, *rows) in zip(fitted.pf.laws.values(), found, strict=True):
        spread = np.sqrt(np.diag(law.uncertainty.matrix)) * stdtrit(law.uncertainty.df, 0.975)
        half = dict(zip(law.uncertainty.of, spread, strict=True))
        assert [row[0] for row in rows] == list(law.coefficients)
        for cells in rows:
            reported = dict(zip(head, cells, strict=True))
            name = reported["coefficient"]
            value, se = law.coefficients[name], law.standard_errors[name]
            near = pytest.approx
            assert float(reported["estimate"]) == near(value, abs=ROUNDED * se)
            assert float(reported["SE"]) == near(se, rel=ROUNDED)
            assert float(reported["SE, rows independent"]) == near(law.row_standard_errors[name], rel=ROUNDED)
            ends = (
                [value * math.exp(-half["ln c0"]), value * math.exp(half["ln c0"])]
                if name == "c0"
                else [value - half[name], value + half[name]]
            )
            assert [float(end) for end in reported["95 % interval"].split(" … ")] == near(ends, abs=ROUNDED * se)
            assert float(reported["additive error (original scale)"]) == near(
                law.alternative.coefficients[name], abs=ROUNDED * se
            )
            assert float(reported["published value"]) == near(law.published.coefficients[name], rel=1e-5)
            if name != "c0":
                assert float(reported["t"]) == near(value / se, rel=1e-3)


def test_the_equation_of_the_card_computes_what_the_file_computes(fitted):
    law = fitted.pf.laws["AW"]
    at = {"V": 120.0, "f": 0.3, "d": 2.0, "t": 10.0}
    _, _, right = law.equation.partition(" = ")
    constant, *powers = right.split()
    value = float(constant) * math.prod(at[x] ** float(b) for x, b in (word.split("^") for word in powers))
    assert value == pytest.approx(law.values(**at), rel=1e-4)
    assert f"\n    {law.equation}\n" in fitted.card


def test_the_card_of_a_simulation_says_so(fitted):
    assert "simulated: true" in fitted.card
    assert "> **Not measured.**" in fitted.card
    assert "not measured: simulated" in fitted.out
    assert fitted.pf.identity.simulated


def test_the_card_of_a_measurement_does_not(wear, tmp_path):
    run(wear, "--out", tmp_path / "out")
    (card,) = (tmp_path / "out").rglob("README.md")
    text = card.read_text("utf-8")
    assert "simulated: false" in text
    assert "Not measured" not in text


def test_the_python_on_the_card_runs(fitted, tmp_path, monkeypatch):
    by = [(*row, "ab"[i % 2]) for i, row in enumerate(WEAR)]
    run(write(tmp_path / "by.csv", by, ("V", "f", "t", "AW", "lot")), "--by", "lot", "--out", tmp_path / "by")
    for folder in (fitted.folder, *(tmp_path / "by").iterdir()):
        (code,) = re.findall(r"```python\n(.*?)```", (folder / "README.md").read_text("utf-8"), flags=re.S)
        monkeypatch.chdir(folder)
        exec(compile(code, "README.md", "exec"), {})  # noqa: S102


def test_figures_of_a_simulation_carry_the_words(fitted, monkeypatch, tmp_path):
    said = []
    monkeypatch.setattr(
        fitmodels.cards.figures,
        "draw_figures",
        lambda laws, folder, banner, limits: said.append((banner, limits)) or folder.mkdir(),
    )
    run(GC435, "--out", tmp_path)
    assert said == [("not measured", {"AW": (0.3, "criterion 0.3 mm")})]


# The folder a second time


def test_the_same_again_is_unchanged(fitted):
    before = snapshot(fitted.root)
    again = run(GC435, "--out", fitted.root)
    assert (again.code, again.err) == (0, "")
    assert "unchanged" in again.out
    assert snapshot(fitted.root) == before


def test_another_fit_in_its_place_needs_force(wear, tmp_path):
    out = tmp_path / "out"
    run(wear, "--out", out)
    before = snapshot(out)
    result = run(wear, "--out", out, "--error", "additive")  # the screen, then the refusal
    assert result.code == 2
    assert result.err.startswith("fitmodels: nothing was written: ")
    assert all(word in result.err for word in ("unnamed-tool_unnamed-work", "--force", "--out"))
    assert snapshot(out) == before
    (folder,) = out.iterdir()
    (folder / "mine.txt").write_text("calibrated on Monday")
    assert run(wear, "--out", out, "--error", "additive", "--force").code == 0
    assert (folder / "mine.txt").read_text() == "calibrated on Monday"
    assert parameters.read(folder / "params.json").laws["AW"].error == "additive"
    assert not hidden(out)


def test_a_result_that_was_changed_is_not_unchanged(wear, tmp_path):
    """A coefficient that somebody changed in a parameter file is not taken for the fit of the same data."""
    out = tmp_path / "out"
    run(wear, "--out", out)
    (file,) = out.glob("*/params.json")
    content = file.read_text("utf-8")
    file.write_text(content.replace('"n": 12', '"n": 13', 1), "utf-8")
    result = run(wear, "--out", out)
    assert result.code == 2
    assert "params.json: its content was changed after it was written" in result.err
    file.write_text(content, "utf-8")
    for draws in file.parent.glob("*.npz"):
        draws.write_bytes(draws.read_bytes()[:-1])
        assert "not the draws that the parameter file was written with" in run(wear, "--out", out).err


def test_a_folder_that_holds_something_else_needs_force(wear, tmp_path):
    folder = tmp_path / "out" / "unnamed-tool_unnamed-work"
    folder.mkdir(parents=True)
    (folder / "params.json").write_text("{}")
    result = run(wear, "--out", tmp_path / "out")
    assert result.code == 2
    assert "--force" in result.err
    assert (folder / "params.json").read_text() == "{}"


def test_a_folder_where_a_file_goes_is_named_before_anything_moves(wear, tmp_path):
    folder = tmp_path / "out" / "unnamed-tool_unnamed-work"
    (folder / "params.json" / "kept").mkdir(parents=True)
    result = run(wear, "--out", tmp_path / "out", "--force")
    assert result.code == 2
    assert "params.json has the name of something that fitmodels writes" in result.err
    assert [path.name for path in folder.iterdir()] == ["params.json"]
    assert not hidden(tmp_path)


def test_out_that_cannot_be_a_folder(wear, tmp_path):
    file = tmp_path / "file"
    file.write_text("mine")
    refused(run(wear, "--out", file), 2, "is a file; choose a folder with --out")
    result = run(wear, "--out", file / "below")
    assert result.code == 2
    assert "cannot be written" in result.err
    assert "--out" in result.err
    assert file.read_text() == "mine"


def test_a_full_disk_leaves_nothing(wear, tmp_path, monkeypatch):
    def full(*_, **__):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(fitmodels.cards.figures, "draw_figures", full)
    result = run(wear, "--out", tmp_path / "a" / "b")
    assert result.code == 2
    assert "no space left on device" in result.err
    assert [path.name for path in tmp_path.iterdir()] == ["wear.csv"]


def interrupted(*_, **__):
    raise KeyboardInterrupt


@pytest.mark.parametrize(
    ("module", "name"), [(fitmodels.fit, "default_laws"), (fitmodels.cards.figures, "draw_figures")]
)
def test_an_interrupt_leaves_nothing_half_written(wear, tmp_path, monkeypatch, module, name):
    monkeypatch.setattr(module, name, interrupted)
    result = run(wear, "--out", tmp_path / "out")
    assert result.code == 130
    assert result.err == "fitmodels: interrupted; no file is incomplete.\n"
    assert [path.name for path in tmp_path.iterdir()] == ["wear.csv"]


def test_an_interrupt_leaves_the_earlier_result(wear, tmp_path, monkeypatch):
    run(wear, "--out", tmp_path / "out")
    before = snapshot(tmp_path)
    monkeypatch.setattr(fitmodels.cards.figures, "draw_figures", interrupted)
    assert run(wear, "--out", tmp_path / "out", "--error", "additive", "--force").code == 130
    assert snapshot(tmp_path) == before


def test_a_defect_says_that_it_is_one(wear, monkeypatch):
    def broken(*_, **__):
        raise RuntimeError("boom")

    monkeypatch.setattr(fitmodels.fit, "default_laws", broken)
    result = run(wear, "--json")
    assert result.code == 70
    assert "internal error of fitmodels, not of your data: RuntimeError: boom" in result.err
    monkeypatch.setenv("FITMODELS_TRACEBACK", "1")
    with pytest.raises(RuntimeError, match="boom"):
        run(wear, "--json")


def test_a_lack_of_memory_is_no_defect(wear, monkeypatch):
    def large(*_, **__):
        raise MemoryError

    monkeypatch.setattr(fitmodels.fit, "default_laws", large)
    result = run(wear, "--json")
    assert result.code == 3
    assert result.err.startswith("fitmodels: not enough memory for these data; leave rows out")


def test_two_forms_for_all_laws_are_named(wear):
    result = run(wear, "--form", "power", "--form", "linear")
    assert result.code == 2
    assert "a form for all laws is given twice, power and linear: keep one, or name the law, as Ra=linear" in result.err


# Options


@pytest.mark.parametrize(
    ("typed", "meant"),
    [
        (["data.csv", "--fore"], "--force"),
        (["data.csv", "--jsno"], "--json"),
        (["data.csv", "--maps", "V=v"], "--map"),
        (["plan", "--rang", "V=1:2"], "--range"),
        (["simulate", "p.json", "--sead", "3"], "--seed"),
    ],
)
def test_a_mistyped_option_is_guessed(typed, meant):
    refused(run(*typed), 2, f"did you mean {meant}?")


def test_an_option_without_its_value_is_not_guessed():
    refused(run("data.csv", "--map"), 2, "argument --map: expected one argument; see 'fitmodels FILE -h'")


@pytest.mark.parametrize("arguments", [["--version"], ["-V"], ["data.csv", "--version"]])
def test_version(arguments):
    result = run(*arguments)
    assert (result.code, result.out, result.err) == (0, f"fitmodels {__version__}\n", "")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--map", "VB"], ["--map VB", "VB=col7"]),
        (["--map", "XY=V"], ["'XY' is no role", "V, f"]),
        (["--map", "VB=wera"], ["'wera'", "the file does not have"]),
        (["--map", "VB=V", "--map", "VB=f"], ["VB is given twice"]),
        (["--map", "VB=V", "--map", "AW=V"], ["one column to two roles"]),
        (["--unit", "Fx=N"], ["--unit Fx=N", "no column has the role Fx"]),
        (["--range", "V=60"], ["--range V=60", "low:high"]),
        (["--range", "V=50,5:200"], ["--range V=50,5:200", "decimal points"]),
        (["--range", "V=60:180"], ["no coded levels", "leave the range out"]),
        (["--by", "lot"], ["no column 'lot'", "AW"]),
        (["--criterion", "-1"], ["criterion -1", "above zero"]),
        (["--criterion", "nan"], ["criterion nan", "above zero"]),
        (["--sheet", "A"], ["no sheets"]),
        (["--delimiter", "two"], ["--delimiter 'two'", "semicolon"]),
        (["--decimal", "dot"], ["invalid choice: 'dot'", "comma"]),
        (["--error", "none"], ["invalid choice: 'none'", "additive"]),
        (["more.csv"], ["unrecognized arguments: more.csv"]),
    ],
)
def test_what_cannot_be_asked_is_a_usage_error(wear, arguments, words):
    result = run(wear, "--json", *arguments)
    assert result.code == 2
    assert result.out == ""
    for word in words:
        assert word in result.err


def pairs(*arguments):
    result = run(*arguments, "--json")
    assert (result.code, result.err) == (0, "")
    report = strict(result.out)
    return report, report["pairs"]


def test_map_says_which_column_is_which(tmp_path):
    path = write(tmp_path / "a.csv", header=("speed", "f", "t", "gauge reading"))
    result = run(path, "--json")
    assert result.code == 4
    assert "A law needs a response (wear AW or VB" in result.err
    assert "--map" in result.err
    for said in ("VB=gauge reading", "VB=col4"):
        report, (pair,) = pairs(path, "--map", said)
        assert list(pair["parameters"]["laws"]) == ["VB"]
        assert pair["parameters"]["provenance"]["options"] == {"map": [said], "error": "multiplicative"}
        assert report["understood"]["columns"][3]["role"] == "VB"


def test_map_to_none_leaves_a_factor_out(wear):
    _, (pair,) = pairs(wear, "--map", "t=none")
    assert list(pair["parameters"]["laws"]["AW"]["coefficients"]) == ["c0", "V", "f"]


def test_unit_converts(tmp_path):
    minutes = pairs(write(tmp_path / "a.csv"))[1][0]["parameters"]["laws"]["AW"]["coefficients"]
    rows = [(V, f, 60 * t, AW) for V, f, t, AW in WEAR]
    report, (pair,) = pairs(write(tmp_path / "s.csv", rows), "--unit", "t=s")
    assert pair["parameters"]["laws"]["AW"]["coefficients"] == pytest.approx(minutes, rel=1e-9)
    assert [use["role"] for use in report["understood"]["columns"] if use["converted"]] == ["t"]


def test_range_decodes_levels(tmp_path):
    rows = [(*(-1 if V < 100 else 1,), f, t, AW) for V, f, t, AW in WEAR]
    path = write(tmp_path / "a.csv", rows)
    refused(run(path, "--json"), 3, "V holds coded levels (-1, 1)", "--range V=50:200")
    report, (pair,) = pairs(path, "--range", "V=60:180")
    (factor,) = [f for f in pair["parameters"]["laws"]["AW"]["factors"] if f["symbol"] == "V"]
    assert (factor["low"], factor["high"]) == pytest.approx((60, 180))
    assert any("-1 is 60" in sentence for sentence in report["understood"]["assumed"])


def test_by_shifts_one_law(tmp_path):
    rows = [(V, f, t, AW * (2 if i % 2 else 1), "ab"[i % 2]) for i, (V, f, t, AW) in enumerate(WEAR)]
    path = write(tmp_path / "a.csv", rows, ("V", "f", "t", "AW", "lot"))
    _, (pair,) = pairs(path, "--by", "lot")
    law = pair["parameters"]["laws"]["AW"]
    assert law["by"]["column"] == "lot"
    assert law["by"]["shifts"] == pytest.approx({"b": math.log(2)}, abs=0.02)


def test_tool_and_work_name_the_pair(wear, tmp_path):
    run(wear, "--tool", "GC4325", "--work", "42CrMo4 (1.7225)", "--out", tmp_path / "out")
    (folder,) = (tmp_path / "out").iterdir()
    assert folder.name == "GC4325_42CrMo4-1.7225"
    assert parameters.read(folder / "params.json").identity.work == "42CrMo4 (1.7225)"


def test_criterion_is_solved_for(wear):
    _, (pair,) = pairs(wear, "--criterion", "0.25")
    life = pair["parameters"]["tool_life"]
    law = pair["parameters"]["laws"]["AW"]["coefficients"]
    T = life["coefficients"]["c0"] * 100 ** life["coefficients"]["V"] * 0.2 ** life["coefficients"]["f"]
    assert law["c0"] * 100 ** law["V"] * 0.2 ** law["f"] * T ** law["t"] == pytest.approx(0.25, rel=1e-9)
    assert life["criterion"] == 0.25


def test_criterion_without_a_wear_law_is_a_sentence(wear):
    refused(run(wear, "--json", "--map", "t=none", "--criterion", "0.3"), 4, "criterion 0.3", "no wear law on time")


def test_error_additive_keeps_a_zero(tmp_path):
    path = write(tmp_path / "a.csv", [*WEAR, (60, 0.1, 1, 0)])
    _, (pair,) = pairs(path, "--error", "additive")
    law = pair["parameters"]["laws"]["AW"]
    assert (law["error"], law["n"], law["residual_scale"]) == ("additive", 13, "mm")
    _, (pair,) = pairs(path)
    law = pair["parameters"]["laws"]["AW"]
    assert (law["n"], law["alternative"]["error"]) == (12, "additive")
    assert law["dropped_rows"] == [{"reason": "AW zero or negative", "count": 1, "lines": [14]}]


def test_a_condition_that_no_law_takes_is_said(tmp_path):
    path = write(tmp_path / "a.csv", header=("V", "n", "t", "AW"))
    result = run(path, "--out", tmp_path / "out")
    assert result.code == 0
    assert "n, spindle speed, varies but is in no law" in " ".join(result.out.split())
    (card,) = (tmp_path / "out").rglob("README.md")
    assert "is in no law" in card.read_text("utf-8")


def test_a_speed_proportional_to_that_of_the_laws_is_not_proposed(tmp_path):
    rows = [(V, round(318.31 * V / 58, 0), f, 900 * f**0.7) for V in (100, 160, 220) for f in (0.1, 0.2, 0.3)]
    path = write(tmp_path / "a.csv", [(*row[:3], row[3] * (1 + 0.01 * (i % 3))) for i, row in enumerate(rows)],
                 header=("V", "n", "f", "Fc"))  # fmt: skip
    result = run(path, "--out", tmp_path / "out")
    assert result.code == 0
    assert "is in no law" not in result.out


# Several pairs, and names


def test_each_pair_has_a_folder(tmp_path):
    rows = [(tool, *row) for tool in ("A", "B") for row in WEAR]
    rows += [("C", 60, 0.1, t, 0.2) for t in (1, 2)]  # too few for a law
    result = run(write(tmp_path / "a.csv", rows, ("tool", "V", "f", "t", "AW")), "--out", tmp_path / "out")
    assert result.code == 4
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"A_unnamed-work", "B_unnamed-work"}
    assert result.err.startswith("fitmodels: C on unnamed-work: AW is not fitted: ")
    assert result.err.count("\n") == 1


def test_names_stay_names_and_folders_stay_inside(tmp_path, monkeypatch):
    """Figures cost most of a second a pair and do not depend on the name."""
    monkeypatch.setattr(fitmodels.cards.figures, "draw_figures", lambda laws, folder, *rest: folder.mkdir())
    rows = [(name, *row) for name in NAMES for row in WEAR]
    path = write(tmp_path / "a.csv", rows, ("tool", "V", "f", "t", "AW"))
    out = tmp_path / "deep" / "down" / "out"
    assert run(path, "--out", out, "--work", "漢" * 100).code == 0
    assert {entry.name for entry in tmp_path.rglob("*") if out not in (entry, *entry.parents)} == {
        "a.csv", "deep", "down",
    }  # fmt: skip
    folders = list(out.iterdir())
    assert len(folders) == len(NAMES)
    assert len({folder.name.lower() for folder in folders}) == len(NAMES)
    reported = {}
    for folder in folders:
        assert re.fullmatch(r"\w[\w.-]*", folder.name)
        assert len(folder.name.encode()) <= 200
        card = (folder / "README.md").read_text("utf-8")
        reported[parameters.read(folder / "params.json").identity.tool] = card
        assert "<script" not in MarkdownIt("commonmark", {"html": True}).render(card)  # in a code span it is literal
        assert [len(row) for (head, *body) in tables(card) for row in body if len(row) != len(head)] == []
        (title,) = [line for line in card.splitlines() if line.startswith("# ")]
        assert not re.search(r"(?<!\\)[`*|\[]", title)
    assert set(reported) == {name or "unnamed-tool" for name in NAMES}
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in reported["<script>alert(1)</script>"]
    assert r"# a\`b\|c on" in reported["a`b|c"]
    assert "# new line on" in reported["new\nline"]


# plan and simulate

RANGES = ("--range", "V=50:200", "--range", "f=0.06:0.6", "--range", "d=1.5:3")


def test_a_plan_reads_back(tmp_path):
    path = tmp_path / "plan.csv"
    result = run("plan", *RANGES, "--out", path)
    assert (result.code, result.err) == (0, "")
    assert run("plan", *RANGES).out == path.read_text("utf-8")
    notes = re.findall(r"^# (.*)", path.read_text("utf-8"), flags=re.M)
    assert " ".join(result.out.split()) == " ".join(" ".join([*notes, f"Written: {path}"]).split())
    assert [entry.name for entry in tmp_path.iterdir()] == ["plan.csv"]
    runs = read_runs(path)
    assert len(runs) == 24 == len(set(runs.labels("edge")))
    assert sorted(map(int, runs.labels("run"))) == list(range(1, 25))
    for name, ends in {"V": (50, 200), "f": (0.06, 0.6), "d": (1.5, 3)}.items():
        assert (runs.values(name).min(), runs.values(name).max()) == ends
    assert runs.units == {"V": "m/min", "f": "mm/rev", "d": "mm"}
    assert not runs.simulated
    assert not re.search(r"(^|,)-0(,|$)", path.read_text("utf-8"), flags=re.M)


def test_a_plan_there_already_needs_force(tmp_path):
    path = tmp_path / "plan.csv"
    path.write_text("mine")
    refused(run("plan", *RANGES, "--out", path), 2, "--force")
    assert path.read_text() == "mine"
    assert run("plan", *RANGES, "--out", path, "--force").code == 0
    assert len(read_runs(path)) == 24


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ([], "--range V=50:200"),
        (["--range", "V=50"], "low:high"),
        (["--range", "V=200:50"], "the lower end must be below"),
        (["--range", "V=0:50"], "above 0"),
        (["--range", "V=1:2", "--seed", "-1"], "-1 is not a seed"),
        (["--range", "V=1:2", "--alpha", "0.5"], "alpha 0.5"),
        (["--range", "V=1:2", "--centre", "100000000"], "give fewer"),
        (["--range", "V=1:2", "--out", "no/such/place.csv"], "a folder that exists"),
    ],
)
def test_what_cannot_be_planned_is_a_usage_error(arguments, word):
    refused(run("plan", *arguments), 2, word)


def test_what_is_simulated_fits_back(fitted, tmp_path):
    """With all scatter between rows the standard errors hold: each exponent within four of them."""
    path = tmp_path / "simulated.csv"
    params = fitted.folder / "params.json"
    assert run("simulate", params, "--icc", "0", "--seed", "7", "--out", path).code == 0
    runs = read_runs(path)
    assert runs.simulated
    assert runs.notes[0].startswith(f"simulated: no real measurement; drawn by fitmodels {__version__}")
    assert str(fitted.root) not in path.read_text("utf-8")
    result = run(path, "--out", tmp_path / "out")
    assert result.code == 0
    folder = tmp_path / "out" / FOLDER
    assert "> **Not measured.** The numbers of this card come from a simulation." in (folder / "README.md").read_text(
        "utf-8"
    )
    again = parameters.read(folder / "params.json")
    for name, law in fitted.pf.laws.items():
        for factor, exponent in list(law.coefficients.items())[1:]:
            se = again.laws[name].standard_errors[factor]
            assert again.laws[name].coefficients[factor] == pytest.approx(exponent, abs=4 * se), (
                name,
                factor,
            )


def test_simulate_follows_a_plan(fitted, tmp_path):
    run("plan", *RANGES, "--centre", "0", "--axial", "1", "--out", tmp_path / "plan.csv")
    result = run("simulate", fitted.folder / "params.json", "--plan", tmp_path / "plan.csv", "--t-max", "4")
    assert (result.code, result.err) == (0, "")
    rows = [line.split(",") for line in result.out.splitlines() if not line.startswith("#")]
    assert rows[0][-4:] == ["t [min]", "AW [mm]", "Fxz [N]", "P [kW]"]
    assert len({row[0] for row in rows[1:]}) == 14
    assert (
        result.out
        == run("simulate", fitted.folder / "params.json", "--plan", tmp_path / "plan.csv", "--t-max", "4").out
    )


@pytest.mark.parametrize(
    ("arguments", "code", "word"),
    [
        (["nowhere.json"], 3, "the file does not exist"),
        ([GC435], 3, "is a table, not a parameter file: fit it first"),
        (["PARAMS", "--icc", "2"], 2, "--icc 2"),
        (["PARAMS", "--interval", "0"], 2, "interval 0 min"),
        (["PARAMS", "--interval", "1e-9"], 2, "longer interval"),
        (["PARAMS", "--seed", "1.5"], 2, "1.5 is not a seed"),
        (["PARAMS", "--plan", "nowhere.csv"], 3, "does not exist"),
    ],
)
def test_what_cannot_be_simulated_is_a_sentence(fitted, arguments, code, word):
    given = [fitted.folder / "params.json" if a == "PARAMS" else a for a in arguments]
    refused(run("simulate", *given), code, word)


# As a process


def process(*arguments, **options):
    environment = {k: v for k, v in os.environ.items() if k not in ("FORCE_COLOR", "FITMODELS_TRACEBACK")}
    environment.update(options.pop("env", {}))
    command = [sys.executable, "-m", "fitmodels", *map(str, arguments)]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment, encoding="utf-8", **options
    )


def test_a_pipe_gets_plain_text(wear, tmp_path):
    """An ASCII one too, in which ± and … are question marks."""
    job = process(wear, "--out", tmp_path / "out", env={"NO_COLOR": "1", "PYTHONIOENCODING": "ascii"})
    out, err = job.communicate(timeout=60)
    assert (job.returncode, err) == (0, "")
    assert ESCAPE not in out
    assert "Written:" in out
    assert out.isascii()
    assert not [line for line in out.splitlines() if line != line.rstrip()]


def test_a_reader_that_has_seen_enough_is_no_error(wear):
    job = process(wear, "--json")
    job.stdout.close()
    err = job.stderr.read()
    job.stderr.close()
    assert (job.wait(timeout=60), err) == (0, "")


def test_a_process_ends_with_the_exit_code(tmp_path):
    job = process(tmp_path / "absent.csv")
    out, err = job.communicate(timeout=60)
    assert (job.returncode, out) == (3, "")
    assert "absent.csv does not exist" in err
    assert "Traceback" not in err


@pytest.mark.parametrize("patience", [0.0, 60.0])
def test_progress_is_shown_only_to_a_terminal_that_waits(monkeypatch, patience):
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    screen = Terminal()
    monkeypatch.setattr(fitmodels.core.progress, "PATIENCE", patience)
    monkeypatch.setattr(sys, "stderr", screen)
    with fitmodels.core.progress.progress_bar() as step:
        step.say("fitting")
        if patience == 0:
            for _ in range(500):
                if "fitting" in screen.getvalue():
                    break
                time.sleep(0.01)
    assert ("fitting" in screen.getvalue()) == (patience == 0)


# --- next runs and confirmation -----------------------------------------------------------------------


BUNDLED = str(datasets.bundled("gc435_709m40"))


def test_next_plans_runs_that_read_back(tmp_path, capsys):
    plan = tmp_path / "next.csv"
    assert main(["next", BUNDLED, "--runs", "3", "--out", str(plan)]) == 0
    runs = datasets.read_runs(plan)
    assert len(runs) == 3
    assert {"V", "f", "d"} <= set(runs.units)
    assert any("Tool life is extrapolated" in note for note in runs.notes)
    assert main(["next", BUNDLED, "--law", "P"]) == 0
    assert "D-optimal" in capsys.readouterr().out
    assert main(["next", BUNDLED, "--law", "Ra"]) == 2
    assert "there are laws of AW, Fxz, P" in capsys.readouterr().err


def test_confirm_distinguishes_runs_of_the_same_laws_from_others(tmp_path, capsys):
    assert main([BUNDLED, "--out", str(tmp_path / "fit")]) == 0
    (params,) = (tmp_path / "fit").rglob("params.json")
    same, other = tmp_path / "same.csv", tmp_path / "other.csv"
    assert main(["simulate", str(params), "--seed", "5", "--out", str(same)]) == 0
    capsys.readouterr()
    assert main(["confirm", str(same), "--data", BUNDLED]) == 0
    assert capsys.readouterr().out.count("the law holds") == 3
    frame = datasets.read_runs(same).data.drop(columns="point")
    frame["AW"] *= 1.6  # another work material, say
    frame.drop(columns=["P", "Fxz"]).to_csv(other, index=False)
    assert main(["confirm", str(other), "--data", BUNDLED]) == 5
    reported = " ".join(capsys.readouterr().out.split())
    assert "AW: " in reported
    assert "does not hold" in reported
    assert "P is not tested" in reported


def test_each_law_has_at_most_six_verdicts_and_every_concern_is_printed(fitted):
    out = " ".join(fitted.out.split())
    for law in fitted.pf.laws.values():
        assert 1 <= len(law.verdicts) <= 6
        concerns = [check.verdict for check in law.checks.values() if check.concern]
        assert all(" ".join(sentence.split()) in out for sentence in concerns)
        passed = [check for check in law.checks.values() if check.reason is None and not check.concern]
        assert f"{len(passed)} of {len(law.checks)} checks passed" in out
        assert {"form", "competing forms", "error structure"} <= set(law.checks)


def test_a_gauge_that_is_coarse_is_reported(tmp_path, capsys):
    assert main([BUNDLED, "--gauge-sd", "0.005", "--out", str(tmp_path / "fit")]) == 0
    (params,) = (tmp_path / "fit").rglob("params.json")
    laws = parameters.read(params).laws
    assert "gauge error" in laws["P"].checks
    assert "gauge error" not in laws["AW"].checks
    assert main([BUNDLED, "--gauge-sd", "-1"]) == 2
    assert "a standard deviation is not below zero" in capsys.readouterr().err


def test_units_are_taken_in_value_and_criterion(tmp_path, capsys):
    from fitmodels.cli.numbers import constants, criterion

    assert constants(["d=1.5mm", "V=2 m/s"]) == {"d": 1.5, "V": 120.0}
    assert [criterion(text) for text in ("0.2mm", "VB=200um", "VB=0.2")] == [0.2, 0.2, 0.2]
    data = tmp_path / "data.csv"
    data.write_text("V,T\n1,2\n")
    assert main([str(data), "--criterion", "VB=2kg"]) == 2
    assert "give the wear in mm, for instance 0.2, or with its unit: 200um" in capsys.readouterr().err
    assert main([str(data), "--value", "d=1.5kg"]) == 2
    assert "d=1.5kg" in capsys.readouterr().err
