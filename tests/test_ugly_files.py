"""Files as laboratories keep them: the bad ones are refused in a sentence, the odd ones are read."""

import ast
import contextlib
import datetime
import gzip
import importlib
import io
import json
import random
import re
import time
import zipfile
from pathlib import Path
from re import _constants as sre
from re import _parser as sre_parse
from re._compiler import compile as compile_parsed
from types import SimpleNamespace

import fitmodels
import numpy as np
import openpyxl
import pytest
from fitmodels import datasets
from fitmodels.cli import main
from fitmodels.core import errors
from fitmodels.core.formula import FORMS, Formula, _pattern, second_order_terms
from fitmodels.datasets.units import convert

SAME = 1e-9  # the same numbers in another dialect or unit
HEADER = ("V", "f", "d", "t", "AW")
SYMBOLS = ("V", "f", "t")


def measured(n=12, seed=0):
    """Rows (V m/min, f mm/rev, d mm, t min, AW mm) about the wear law of Alaskari & Oraby, 5 % scatter."""
    rng = np.random.default_rng(seed)
    V, f, d = (
        rng.uniform(50, 200, n).round(1),
        rng.uniform(0.06, 0.6, n).round(3),
        rng.uniform(1, 3, n).round(2),
    )
    t = rng.uniform(1, 20, n).round(1)
    AW = 0.00762 * V**0.577 * f**0.168 * d**0.248 * t**0.245 * np.exp(0.05 * rng.normal(size=n))
    return [tuple(row) for row in np.column_stack([V, f, d, t, AW.round(4)]).tolist()]


ROWS = measured()
UNITS = ("m/min", "mm/rev", "mm", "min", "mm")


def table(rows=ROWS, header=HEADER, mark=",", end="\n"):
    return end.join(mark.join(map(str, row)) for row in (header, *rows)) + end


def with_cell(row, column, text):
    """The rows, with one cell changed."""
    rows = [list(r) for r in ROWS]
    rows[row][column] = text
    return rows


def with_column(make, name=None):
    """The rows with AW replaced, or with a further column, made from (number, row)."""
    if name is None:
        return table([(*row[:4], make(i, row)) for i, row in enumerate(ROWS)])
    return table([(*row, make(i, row)) for i, row in enumerate(ROWS)], (*HEADER, name))


def with_time(make):
    return table([(*row[:3], make(i), row[4]) for i, row in enumerate(ROWS)])


def workbook(**sheets):
    book = openpyxl.Workbook()
    book.remove(book.active)
    for title, rows in sheets.items():
        page = book.create_sheet(title)
        for row in rows:
            page.append(row)
    buffer = io.BytesIO()
    book.save(buffer)
    return buffer.getvalue()


def zipped(name, text):
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr(name, text)
    return buffer.getvalue()


def run(path, *arguments):
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main([str(path), *map(str, arguments)])
    return SimpleNamespace(code=code, out=out.getvalue(), err=err.getvalue())


NOISE = random.Random(1).randbytes(4000)  # noqa: S311

# name of the case: (file name, content, exit code, what the sentence must hold)
BAD = {
    # nothing there
    "0 bytes": ("a.csv", b"", 3, ["a.csv is empty", "export it again"]),
    "blanks only": ("a.csv", "\n  \n\n", 3, ["a.csv holds only blanks"]),
    "header only": ("a.csv", "V,f,d,t,AW\n", 3, ["header only", "lines: 1", "Export the data rows"]),
    "header and units only": ("a.csv", "V;AW\nm/min;mm\n", 3, ["header only"]),
    "an empty workbook": ("a.xlsx", workbook(Data=[]), 3, ["sheet 'Data' holds no filled cell"]),
    # no table
    "a PNG": ("a.csv", b"\x89PNG\r\n\x1a\n" + bytes(range(256)), 3, ["a PNG image", "Export the table"]),
    "a zip": ("a.csv", zipped("a.csv", table()), 3, ["a zip archive"]),
    "a zip called .xlsx": ("a.xlsx", zipped("a.csv", table()), 3, ["damaged Excel workbook", "save it again"]),
    "a gzip": ("a.csv", gzip.compress(table().encode()), 3, ["a gzip archive"]),
    "random bytes": ("a.csv", NOISE, 3, ["is not text, and no workbook either"]),
    "random bytes called .xlsx": ("a.xlsx", NOISE, 3, ["no workbook either"]),
    "NUL bytes": ("a.csv", table().encode() + b"100,\x00\x00\x00\n", 3, ["the control byte 0x00 at byte"]),
    "a web page": ("a.csv", "<!DOCTYPE html><table><tr><td>V</td></tr></table>", 3, ["a web page"]),
    "prose": ("a.txt", "Dear colleague,\nthe tests are in the other file.\n", 3, ["holds a header only"]),
    "a very long cell": ("a.csv", with_column(lambda i, r: "y" * 200_000, "note"), 3,
                         ["line 2", "a cell of more than 131072 characters", "Delete"]),
    "an open quote": ("a.csv", table(with_cell(4, 4, '"0.25')), 3, ["line 6", "no quote closes it"]),
    # cells
    "text among numbers": ("a.csv", table(with_cell(3, 1, "worn")),
                           3, ["'f' (feed f)", "line 5: 'worn'", "Write a number"]),
    "inf": ("a.csv", table(with_cell(2, 4, "inf")), 3, ["'AW'", "line 4: 'inf'"]),
    "a unit in one cell": ("a.csv", table(with_cell(4, 4, "0.25 mm")),
                           3, ["line 6: '0.25 mm'", "number alone", "AW [mm]"]),
    "two units in the cells": ("a.csv", with_column(lambda i, r: f"{r[4]} mm" if i else "285.3 µm"),
                               3, ["line 2: '285.3 µm'", "number alone", "AW [mm]", "--leave-out 'lines 2'"]),
    "fractions of no inch": ("a.csv", table([(*r[:2], f"{i % 3 + 1}/32", *r[3:]) for i, r in enumerate(ROWS)]),
                             3, ["'d'", "Write 0.03125 for 1/32", "d [in]"]),
    "another unit in every cell": ("a.csv", with_column(lambda i, r: f"{r[4]} mm").replace("AW", "AW [in]"),
                                   3, ["mm'", "number alone"]),
    "per cent in every cell": ("a.csv", with_column(lambda i, r: f"{100 * r[4]:.1f} %"),
                               3, ["'AW'", "its unit is %"]),
    "yes and no": ("a.csv", with_column(lambda i, r: "yes" if i % 2 else "no"),
                   3, ["'AW'", "holds text", "--map AW=none"]),
    "dates as time": ("a.csv", with_time(lambda i: f"2024-03-{i + 1:02d}"), 3,
                      ["'t'", "'2024-03-01'", "a number of min", "not as a date"]),
    "clock times": ("a.csv", with_time(lambda i: f"10:{i + 1:02d}"), 3, ["'t'", "times of day", "since the start"]),
    "dates of a workbook": (
        "a.xlsx",
        workbook(D=[HEADER, *((*r[:3], datetime.date(2024, 3, 1 + i), r[4]) for i, r in enumerate(ROWS))]),
        3, ["'t'", "2024-03-01", "a number of min"],
    ),
    "1e300": ("a.csv", with_column(lambda i, r: r[4] * 1e300),
              3, ["'AW'", "row 1 of the data", "not a plausible measurement"]),
    "1e-300": ("a.csv", with_column(lambda i, r: r[4] * 1e-300),
               3, ["'AW'", "not a plausible measurement", "leave the cell"]),
    "1e308": ("a.csv", with_column(lambda i, r: f"{r[4]:.3f}e308"), 3, ["not a plausible measurement"]),
    "1e400": ("a.csv", with_column(lambda i, r: f"{r[4]:.3f}e400"), 3, ["'AW'", "e400'"]),
    # marks
    "1.234 alone": ("a.csv", "V;AW\n1.234;5.678\n2.345;6.789\n", 3,
                    ["line 2", "'1.234' is 1.234 with a decimal point and 1234", "--decimal point"]),
    "decimal commas between commas": ("a.csv", "V,f,AW\n100,0,2,0,15\n150,0,3,0,18\n", 3,
                                      ["every row has 5 cells", "has 3 names", "export with semicolons"]),
    "both decimal marks": ("a.csv", "V;f;AW\n100,5;0.2;0,15\n150,5;0.3;0,18\n200,5;0.4;0,25\n", 3,
                           ["'f'", "'0.2'", "another decimal mark"]),
    "a row too wide": ("a.csv", table() + "100,0.2,1,2,0.2,9,9\n",
                       3, ["line 14 has 7 cells", "line 1 has 5"]),
    # headers and units
    "no header": ("a.csv", table().split("\n", 1)[1], 3, ["no row of column names", "--map"]),
    "no known column": ("a.csv", table(header=("a", "b", "c", "g", "e")), 3, ["'a', 'b'", "--map"]),
    "logarithms": ("a.csv", table([np.log(r).round(4).tolist() for r in ROWS], [f"ln {name}" for name in HEADER]), 3,
                   ["'ln V'", "'ln AW'", "write the values, not their logarithms"]),
    "the same column twice": ("a.csv", with_column(lambda i, r: r[4], "AW"), 3,
                              ["columns 5 ('AW') and 6 ('AW')", "--map AW=col5 or --map AW=col6"]),
    "two names of one role": ("a.csv", with_column(lambda i, r: r[0], "Vc"),
                              3, ["1 ('V') and 6 ('Vc')", "--map V=col1"]),
    "a unit of another kind": ("a.csv", table(header=("V [N]", *HEADER[1:])), 3,
                               ["'V [N]'", "cutting speed", "its unit is N", "--unit V=m/min"]),
    "a unit nobody lists": ("a.csv", table(header=("V [furlong/min]", *HEADER[1:])), 3,
                            ["'furlong/min' is not in the table of units", "--unit V=m/min"]),
    "a units row with one nobody lists": (
        "a.csv", table([("m/min", "mm/rev", "mm", "fortnight", "mm"), *ROWS]), 3,
        ["'t'", "'fortnight' is not in the table", "--unit t=min"],
    ),
    "coded levels": ("a.csv", table([((-1, 0, 1)[i % 3], *r[1:]) for i, r in enumerate(ROWS)]), 3,
                     ["V holds coded levels (-1, 0, 1)", "--range V=50:200"]),
    # read, but no law can be fitted
    "one row": ("a.csv", table(ROWS[:1]), 4, ["AW is not fitted", "Measure at least 5 more", "--map t=none"]),
    "two rows": ("a.csv", table(ROWS[:2]), 4, ["2 usable rows for 5 parameters (c0, V, f, d, t)", "4 more"]),
    "one row less than parameters": ("a.csv", table(ROWS[:4]), 4, ["4 usable rows", "at least 2 more"]),
    "all rows alike": ("a.csv", table([ROWS[0]] * 12),
                       4, ["AW is 0.2853 in all 12 rows", "nothing to explain"]),
    "every factor constant": ("a.csv", table([(100, 0.2, 2, 10, r[4]) for r in ROWS]), 4,
                              ["V is left out: constant (100", "t is left out", "Vary at least one"]),
    "a constant response": ("a.csv", with_column(lambda i, r: 0.2), 4, ["AW is 0.2 in all 12 rows"]),
    "an empty response": ("a.csv", with_column(lambda i, r: ""),
                          4, ["12 rows left out: AW missing (lines 2, 3"]),
    "zeros nearly everywhere": ("a.csv", with_column(lambda i, r: 0 if i < 10 else r[4]), 4,
                                ["10 rows left out: AW zero or negative (lines 2, 3, 4,", "Correct"]),
    "negative times": ("a.csv", with_time(lambda i: -1.5 - i), 3, ["t is negative in all", "--correct 'all:t*-1'"]),
    "wear alone": ("a.csv", "AW\n" + "\n".join(str(r[4]) for r in ROWS),
                   4, ["at least one condition that varies", "--map"]),
    "edges and wear alone": ("a.csv", "edge,AW\n" + "\n".join(f"{i},{r[4]}" for i, r in enumerate(ROWS)), 4,
                             ["no law can be fitted to these columns"]),
    "conditions alone": ("a.csv", table([r[:4] for r in ROWS], HEADER[:4]), 4,
                         ["A law needs a response (wear AW or VB"]),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_a_bad_file_is_refused_in_a_sentence(tmp_path, case):
    name, content, code, words = BAD[case]
    path = tmp_path / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    result = run(path, "--out", tmp_path / "out")
    assert result.code == code
    assert result.err.startswith("fitmodels: ")
    sentence, *rows = result.err.splitlines()
    assert sentence.endswith((".", ".)", ":" if rows else "."))
    assert all(row.startswith("  ") for row in rows)  # rows of the file, where the sentence shows them
    for word in words:
        assert word in result.err
    assert "Traceback" not in result.err
    assert bool(result.out) == (code == 4)  # what was understood is printed once the file is read
    assert [entry.name for entry in tmp_path.iterdir()] == [name]


def test_logarithms_are_no_values_of_a_role(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(table([np.log(r).round(4).tolist() for r in ROWS], [f"log10({name})" for name in HEADER]), "utf-8")
    with pytest.raises(errors.DataError, match="write the values, not their logarithms"):
        datasets.read_runs(path, map={"AW": "log10(AW)"})


def test_there_are_enough_of_them():
    assert len(BAD) >= 20


def test_a_missing_file_is_guessed_and_a_folder_without_tables_refused(tmp_path):
    (tmp_path / "wear_2024.csv").write_text(table())
    result = run(tmp_path / "wear-2024.csv")
    assert (result.code, result.out) == (3, "")
    assert "does not exist. Did you mean wear_2024.csv?" in result.err
    (tmp_path / "empty").mkdir()
    result = run(tmp_path / "empty")
    assert (result.code, result.out) == (3, "")
    assert "holds no table: none of its files ends in .csv" in result.err


# Odd files that are read


def facts(folder, content, *arguments, name="a.csv"):
    """What was understood, and the one pair, of a file that must work."""
    path = folder / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    result = run(path, "--json", *arguments)
    assert (result.code, result.err) == (0, "")
    report = json.loads(result.out)
    (pair,) = report["pairs"]
    return report["understood"], pair


def wear_law(pair, response="AW"):
    return pair["parameters"]["laws"][response]


@pytest.fixture
def usual(tmp_path):
    """Coefficients of the rows in a plain file."""
    return wear_law(facts(tmp_path, table(), name="usual.csv")[1])["coefficients"]


ODD = {
    "UTF-16": ("a.csv", table().encode("utf-16")),
    "a workbook called .csv": ("a.csv", workbook(Data=[HEADER, *ROWS])),
    "a CSV called .xlsx": ("a.xlsx", table().encode()),
    "a workbook of two sheets": ("a.xlsx", workbook(Info=[["Tool", "X"]], Data=[HEADER, *ROWS])),
    "300 columns": (
        "a.csv",
        table([(*r, *range(295)) for r in ROWS], (*HEADER, *(f"x{i}" for i in range(295)))),
    ),
    "long lines": ("a.csv", with_column(lambda i, r: "y" * 50_000, "remark")),
    "a column of yes and no": ("a.csv", with_column(lambda i, r: "yes" if i % 2 else "no", "coolant")),
    "a footer": ("a.csv", table() + "Mean,,,,0.2\nStd,,,,0.05\n"),
    "a remark below": ("a.csv", table() + "\nmeasured by N.N.\n"),
    "blank lines": ("a.csv", table().replace("\n", "\n\n")),
    "a title above": ("a.csv", "Wear tests 2024\n\n" + table()),
    "a commented header": ("a.csv", "# " + table()),
    "a row cut short": ("a.csv", table() + "100,0.2"),
    "a row without wear": ("a.csv", table() + "100,0.2,1,2,\n"),
    "NaN": ("a.csv", table() + "100,0.2,1,2,NaN\n"),
    "zero wear": ("a.csv", table() + "100,0.2,1,2,0\n"),
    "negative wear": ("a.csv", table() + "100,0.2,1,2,-0.01\n"),
    "one edge": ("a.csv", table([("E1", *r) for r in ROWS], ("edge", *HEADER))),
    "a column of dates": ("a.csv", with_column(lambda i, r: f"2024-03-{i + 1:02d}", "date")),
    "old line ends": ("a.csv", table(end="\r")),
    "a unit in every cell": ("a.csv", with_column(lambda i, r: f"{1000 * r[4]:g} µm")),
    "a unit in every cell of every column": (
        "a.csv",
        table([tuple(map(" ".join, zip(map(str, r), UNITS, strict=True))) for r in ROWS]),
    ),
    "a spread beside the number": ("a.csv", with_column(lambda i, r: f"{r[4]} ± 0.01")),
    "a spread in plain letters": ("a.csv", with_column(lambda i, r: f"{r[4]} +/- 3 %")),
    "a spread in a German file": (
        "a.csv",
        table([(*map(str, r[:4]), f"{r[4]}±0.02") for r in ROWS], mark=";").replace(".", ","),
    ),
    "a sep line": ("a.csv", "sep=;\n" + table(mark=";")),
}


@pytest.mark.parametrize("case", ODD)
def test_an_odd_file_is_read_as_the_plain_one(tmp_path, usual, case):
    name, content = ODD[case]
    _, pair = facts(tmp_path, content, name=name)
    assert wear_law(pair)["coefficients"] == pytest.approx(usual, rel=SAME)
    assert wear_law(pair)["n"] == 12


@pytest.mark.parametrize(
    ("cell", "reason"),
    [("NaN", "AW missing"), ("0", "AW zero or negative"), ("-0.01", "AW zero or negative")],
)
def test_rows_left_out_are_counted_and_named(tmp_path, cell, reason):
    _, pair = facts(tmp_path, table() + f"100,0.2,1,2,{cell}\n")
    assert wear_law(pair)["dropped_rows"] == [{"reason": reason, "count": 1, "lines": [14]}]


def test_fractions_of_an_inch_are_read(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("f,DOC (in)\n0.1,1/32\n0.2,1 1/2\n0.3,0.125\n0.3,1/16\n", encoding="utf-8")
    found = datasets.read_table(path)
    assert found.column("DOC (in)").values.tolist() == [0.03125, 1.5, 0.125, 0.0625]
    assert found.assumed == ("DOC (in): fractions of an inch are read as decimals ('1/32' and 2 more)",)


def test_a_spread_that_is_not_used_is_said(tmp_path):
    understood, _ = facts(tmp_path, with_column(lambda i, r: f"{r[4]} ± 0.01"))
    said = "AW: the number before ± is read, and the spread after it is not used ('0.2853 ± 0.01' and 11 more)"
    assert said in understood["assumed"]


def test_a_spread_is_the_only_number_with_a_decimal_mark(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("V;AW\n100;0,21 ± 0,01\n200;0,34 ± 0,02\n", encoding="utf-8")
    assert datasets.read_table(path).column("AW").values.tolist() == [0.21, 0.34]


def test_what_was_mended_is_said(tmp_path):
    understood, _ = facts(tmp_path, table() + "100,0.2\nMean,,,,0.2\n")
    assert any("line 14" in sentence for sentence in understood["warnings"])
    assert any("Footer rows are left out: line 15 'Mean'" in sentence for sentence in understood["warnings"])


def test_sheets_that_are_not_read_are_named(tmp_path):
    content = workbook(A=[HEADER, *ROWS], B=[HEADER, *ROWS[:3]])
    understood, pair = facts(tmp_path, content, name="a.xlsx")
    assert understood["notes"] == ["Sheet 'A' is read; not read: 'B'."]
    assert wear_law(pair)["n"] == 12
    assert run(tmp_path / "a.xlsx", "--sheet", "B", "--json").code == 4  # three rows are too few


def test_as_many_rows_as_parameters_are_solved_without_an_interval(tmp_path):
    _, pair = facts(tmp_path, table(ROWS[:5]))
    law = wear_law(pair)
    assert (law["n"], law["df"], law["residual_se"], law["standard_errors"]) == (5, 0, None, {})
    assert "no interval: 5 observations fix 5 parameters exactly" in law["uncertainty"]["reason"]
    result = run(tmp_path / "a.csv", "--full", "--out", tmp_path / "out")
    assert result.code == 0
    assert "no interval" in result.out.lower()


def test_a_law_without_scatter_comes_back(tmp_path):
    exact = with_column(lambda i, r: repr(0.0076 * r[0] ** 0.577 * r[1] ** 0.168 * r[2] ** 0.248 * r[3] ** 0.245))
    _, pair = facts(tmp_path, exact)
    assert wear_law(pair)["coefficients"] == pytest.approx(
        {"c0": 0.0076, "V": 0.577, "f": 0.168, "d": 0.248, "t": 0.245}, rel=1e-9
    )
    assert run(tmp_path / "a.csv", "--out", tmp_path / "out").code == 0


def test_a_constant_factor_is_left_out_by_name(tmp_path):
    _, pair = facts(tmp_path, table([(100, *r[1:]) for r in ROWS]))
    law = wear_law(pair)
    assert list(law["coefficients"]) == ["c0", "f", "d", "t"]
    assert law["left_out"] == [{"factor": "V", "reason": "constant (100 in all 12 rows)"}]


@pytest.mark.parametrize(("step", "ends"), [(1e-5, "100"), (0.01, "100 to 100.11")])
def test_a_speed_that_hardly_moves_is_left_out_by_name(tmp_path, step, ends):
    """As where the speed is computed from rounded spindle speeds: its exponent would be that of the rounding."""
    _, pair = facts(tmp_path, table([(100 + step * i, *r[1:]) for i, r in enumerate(ROWS)]))
    assert wear_law(pair)["left_out"] == [{"factor": "V", "reason": f"constant ({ends} in all 12 rows)"}]


def test_a_speed_that_moves_little_is_fitted_with_a_wide_interval(tmp_path):
    _, pair = facts(tmp_path, table([(100 + 0.15 * i, *r[1:]) for i, r in enumerate(ROWS)]))
    assert wear_law(pair)["standard_errors"]["V"] > 1
    assert run(tmp_path / "a.csv", "--out", tmp_path / "out").code == 0


def test_a_formula_as_a_header_is_text_on_the_card(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(with_column(lambda i, r: i, "=cmd|' /C calc'!A0"))
    assert run(path, "--out", tmp_path / "out").code == 0
    (card,) = (tmp_path / "out").rglob("README.md")
    assert r"=cmd\|' /C calc'!A0" in card.read_text("utf-8")


# Nice files, which need no flag

NICE = measured(20, seed=3)
FORCES = [
    (round(900 * (f / 0.2) ** 0.7 * d, 1), round(1.1 * (V / 100) * (f / 0.2) ** 0.6 * d, 3)) for V, f, d, _, _ in NICE
]
LAWS = ("VB", "Fc", "P")


@pytest.fixture(scope="module")
def metric(tmp_path_factory):
    """The laws of the nice rows in a plain metric file."""
    header = ("V [m/min]", "f [mm/rev]", "d [mm]", "t [min]", "VB [mm]", "Fc [N]", "P [kW]")
    rows = [(*row, *forces) for row, forces in zip(NICE, FORCES, strict=True)]
    _, pair = facts(tmp_path_factory.mktemp("metric"), table(rows, header))
    return {name: wear_law(pair, name)["coefficients"] for name in LAWS}


def same_laws(pair, metric):
    for name in LAWS:
        assert wear_law(pair, name)["coefficients"] == pytest.approx(metric[name], rel=SAME), name


def sheet(header, units, decimal, mark, top=(), foot=()):
    rows = [(*row, *forces) for row, forces in zip(NICE, FORCES, strict=True)]
    lines = [mark.join(header), *([mark.join(units)] if units else [])]
    lines += [mark.join(f"{value!r}".replace(".", decimal) for value in row) for row in rows]
    return "\r\n".join([*top, *lines, *foot]) + "\r\n"


def test_a_german_export(tmp_path, metric):
    text = sheet(
        ("Schnittgeschwindigkeit vc", "Vorschub f", "Schnitttiefe ap", "Schnittzeit",
         "Verschleißmarkenbreite VB", "Schnittkraft Fc", "Leistung Pc"),
        ("m/min", "mm/U", "mm", "min", "mm", "N", "kW"), ",", ";",
        top=("Prüfer: Müller;;;;;;", "Werkzeug: GC4325;;;;;;", "Werkstoff: 42CrMo4;;;;;;", ""),
        foot=("Mittelwert;;;;0,19;;",),
    )  # fmt: skip
    understood, pair = facts(tmp_path, text.encode("cp1252"))
    same_laws(pair, metric)
    assert (pair["tool"], pair["work"]) == ("GC4325", "42CrMo4")
    assert understood["source"]["dialect"] == "Windows-1252, semicolons, decimal comma"
    assert any("Mittelwert" in sentence for sentence in understood["warnings"])
    assert understood["assumed"] == []
    assert all(use["role"] for use in understood["columns"])


def test_a_german_export_with_units_in_the_header(tmp_path, metric):
    text = sheet(
        ("Schnittgeschwindigkeit vc [m/min]", "Vorschub f [mm/U]", "Schnitttiefe ap [mm]",
         "Eingriffszeit [min]", "Verschleißmarkenbreite VB [mm]", "Fc [N]", "Pc [kW]"), (), ",", ";",
    )  # fmt: skip
    same_laws(facts(tmp_path, text.encode("cp1252"))[1], metric)


def test_a_french_export(tmp_path, metric):
    text = sheet(
        ("Vitesse de coupe Vc (m/min)", "Avance f (mm/tr)", "Profondeur de passe ap (mm)",
         "Temps de coupe (min)", "Usure en dépouille VB (mm)", "Effort de coupe Fc (N)", "Puissance (kW)"),
        (), ",", "\t",
        top=("Outil : P25", "Matière : 42CD4"), foot=("Moyenne\t\t\t\t0,19",),
    )  # fmt: skip
    _, pair = facts(tmp_path, text.encode("utf-8-sig"), name="essais.txt")
    same_laws(pair, metric)
    assert (pair["tool"], pair["work"]) == ("P25", "42CD4")


def test_a_spanish_export(tmp_path, metric):
    text = sheet(
        ("Velocidad de corte", "Avance por vuelta", "Profundidad de corte", "Tiempo de corte",
         "Desgaste de flanco", "Fuerza de corte", "Potencia"),
        ("m/min", "mm/rev", "mm", "min", "mm", "N", "kW"), ",", ";",
        top=("Herramienta: P25", "Material de la pieza: F1252"), foot=("Promedio;;;;0,19;;",),
    )  # fmt: skip
    _, pair = facts(tmp_path, text)
    same_laws(pair, metric)
    assert (pair["tool"], pair["work"]) == ("P25", "F1252")


def test_an_inch_file_gives_the_laws_of_the_metric_one(tmp_path, metric):
    """Exponents do not know units; c0 is reported in metric units, so it comes back equal too."""
    units = ("sfm", "in/rev", "in", "s", "in", "lbf", "hp")
    written = ("sfm", "ipr", "in", "s", "in", "lbf", "hp")
    columns = np.array([(*row, *forces) for row, forces in zip(NICE, FORCES, strict=True)]).T
    canonical = ("m/min", "mm/rev", "mm", "min", "mm", "N", "kW")
    inches = [convert(c, a, b) for c, a, b in zip(columns, canonical, units, strict=True)]
    header = [
        f"{n} ({u})" for n, u in zip(("speed", "feed", "DOC", "time", "flank wear", "Fc", "P"), written, strict=True)
    ]
    understood, pair = facts(tmp_path, table(zip(*(c.tolist() for c in inches), strict=True), header))
    same_laws(pair, metric)
    assert [use["converted"] for use in understood["columns"]] == [True] * 7
    shown = " ".join(run(tmp_path / "a.csv", "--full", "--out", tmp_path / "out").out.split())
    assert all(f"converted from {unit}" in shown for unit in units)


def test_a_workbook_with_a_units_row(tmp_path, metric):
    rows = [(*row, *forces) for row, forces in zip(NICE, FORCES, strict=True)]
    head = [
        ("Tool: GC435",),
        (),
        ("vc", "f", "ap", "t", "VB", "Fc", "P"),
        ("m/min", "mm", "mm", "min", "mm", "N", "kW"),
    ]
    understood, pair = facts(tmp_path, workbook(Tests=[*head, *rows]), name="a.xlsx")
    same_laws(pair, metric)
    assert pair["tool"] == "GC435"
    assert "f: mm is taken as mm/rev" in understood["assumed"]


def test_columns_between_blanks(tmp_path, metric):
    rows = [(*row, *forces) for row, forces in zip(NICE, FORCES, strict=True)]
    header = ("V_m_per_min", "f", "d", "t", "VB_mm", "Fc_N", "P_kW")
    text = "\n".join("  ".join(f"{cell!s:>12}" for cell in row) for row in (header, *rows))
    same_laws(facts(tmp_path, text, name="a.txt")[1], metric)


def test_micrometres_and_daN(tmp_path, metric):
    rows = [(*row[:4], 1000 * row[4], Fc / 10, 1000 * P) for row, (Fc, P) in zip(NICE, FORCES, strict=True)]
    header = ("Vc/(m/min)", "fn, mm/rev", "ap in mm", "tc [min]", "VB [µm]", "Fc [daN]", "P [W]")
    same_laws(facts(tmp_path, table(rows, header, mark="\t"))[1], metric)


def test_any_number_of_comments_may_stand_above_a_table(tmp_path):
    (tmp_path / "a.csv").write_text("# insert turned\n" * 4000 + table(mark=";"), "utf-8")
    assert len(fitmodels.datasets.read_runs(tmp_path / "a.csv")) == len(ROWS)


# --- every regular expression of the package takes time in proportion to its text

USES = ("search", "match", "fullmatch", "findall", "finditer", "sub", "split")
REPEATS = (sre.MAX_REPEAT, sre.MIN_REPEAT, sre.POSSESSIVE_REPEAT)
CHARACTERS = " \t\n1a0A.,:;-_=()[]<>+*/\"'#%xé°(→|"
LENGTHS = (500, 2000)  # characters
MOST_CPU = 1.5e-3  # s, above which the growth is looked at: a square takes 4 ms on a fast machine
MOST_GROWTH = 8.0  # of the time for four times the characters: 4 where it is linear, 16 where it is the square


def modules():
    """Name, syntax tree and object of each module of the package."""
    root = Path(fitmodels.__file__).resolve().parent
    for path in sorted(root.rglob("*.py")):
        parts = path.relative_to(root).with_suffix("").parts
        if parts[0] not in ("tests", "docs", "benchmarks", "notebooks", "build", "__main__") and parts[0][0] != ".":
            name = ".".join(("fitmodels", *(part for part in parts if part != "__init__")))
            yield name, ast.parse(path.read_text("utf-8")), importlib.import_module(name)


def text_of(node, space):
    """Text of a pattern, with x for what is known only when it runs; None where that is all of it."""
    if isinstance(node, ast.JoinedStr):
        parts = (one.value if isinstance(one, ast.Constant) else text_of(one.value, space) for one in node.values)
        return "".join("x" if part is None else str(part) for part in parts)
    with contextlib.suppress(NameError, AttributeError, TypeError):
        found = eval(compile(ast.Expression(node), "", "eval"), space)  # noqa: S307  a node of our own source
        return found if isinstance(found, str | bytes) else None
    return None


def looped(node, tree, space):
    """Texts of a pattern that a loop takes from a table of the module: a name of the loop, or an attribute of one."""
    name, _, field = ast.unparse(node).partition(".")
    for loop in (one for one in ast.walk(tree) if isinstance(one, ast.For | ast.comprehension)):
        names = [ast.unparse(one) for one in getattr(loop.target, "elts", [loop.target])]
        if name in names:
            with contextlib.suppress(NameError, AttributeError, TypeError):
                items = list(eval(ast.unparse(loop.iter), space))  # noqa: S307  a node of our own source
                found = [item[names.index(name)] if len(names) > 1 else item for item in items]
                yield from (getattr(one, field) if field else one for one in found)


def names_in(module, tree):
    """Namespace of a module with what its functions import from modules beside it."""
    space = dict(vars(module))
    for node in (one for one in ast.walk(tree) if isinstance(one, ast.ImportFrom) and one.level and one.module):
        beside = importlib.import_module("." * node.level + node.module, space["__package__"])
        space |= {one.asname or one.name: getattr(beside, one.name) for one in node.names if hasattr(beside, one.name)}
    return space


def equation_patterns():
    """The patterns of equations of every form, which are made for a law."""
    for name, form in FORMS.items():
        symbols = SYMBOLS[: form.n_factors]
        second = (second_order_terms(symbols), (1.0,) * len(symbols)) if form.second_order else ()
        yield _pattern(Formula(name, "y", symbols, *second))


MADE = {"_pattern(self)": [*equation_patterns()]}


def patterns():
    """Each pattern of the package once: module, text, flags, how it is used."""
    found = []
    for name, tree, module in modules():
        space, used = vars(module), {}
        for node in (one for one in ast.walk(tree) if isinstance(one, ast.Attribute) and one.attr in USES):
            used.setdefault(ast.unparse(node.value).rpartition(".")[2].partition("(")[0], set()).add(node.attr)
        named = {id(one.value): ast.unparse(one.targets[0]) for one in ast.walk(tree) if isinstance(one, ast.Assign)}
        for node in (one for one in ast.walk(tree) if isinstance(one, ast.Call) and one.args):
            kind, _, use = ast.unparse(node.func).partition(".")
            if kind != "re" or use not in (*USES, "compile"):
                continue
            text = text_of(node.args[0], space)
            if text is None:
                space = names_in(module, tree)
                text = text_of(node.args[0], space)
            texts = [text] if text is not None else [*looped(node.args[0], tree, space)]
            texts = texts or MADE.get(ast.unparse(node.args[0]), [])
            assert texts, f"{name}, line {node.lineno}: the pattern is not found"
            place = {"compile": 1, "sub": 4, "split": 3}.get(use, 2)
            flags = [*node.args[place:], *(one.value for one in node.keywords if one.arg == "flags")]
            flag = int(eval(ast.unparse(flags[0]), space)) if flags else 0  # noqa: S307
            uses = used.get(named.get(id(node), ""), {"fullmatch"}) if use == "compile" else {use}
            found += ((name, text, flag, one) for one in sorted(uses) for text in texts)
    return sorted(set(found), key=str)


def sample(tree, state, k=0):
    """A text that a parsed pattern matches."""
    return "".join(one_of(op, given, state, k) for op, given in tree)


def one_of(op, given, state, k):
    if op is sre.LITERAL:
        return chr(given)
    if op in (sre.IN, sre.NOT_LITERAL, sre.ANY):
        test = compile_parsed(sre_parse.SubPattern(state, [(op, given)]))
        fits = [c for c in CHARACTERS if test.fullmatch(c.encode("latin-1", "replace") if state.bytes else c)]
        return fits[k % len(fits)] if fits else next((chr(a) for o, a in given if o is sre.LITERAL), "?")
    if op in REPEATS:
        return sample(given[2], state, k) * max(given[0], 1)
    inner = inside(op, given)
    return sample(inner[k % len(inner)], state, k) if inner and op not in (sre.ASSERT, sre.ASSERT_NOT) else ""


def inside(op, given):
    """Patterns within an element of a pattern."""
    if op in REPEATS:
        return [given[2]]
    if op is sre.SUBPATTERN:
        return [given[3]]
    if op is sre.BRANCH:
        return given[1]
    return [given] if op is sre.ATOMIC_GROUP else [given[1]] if op in (sre.ASSERT, sre.ASSERT_NOT) else []


def repeated(tree, state, before=""):
    """Text before each long repeat of a pattern, and the text that it repeats."""
    for op, given in tree:
        if op in REPEATS and given[1] > 100:
            yield from ((before, sample(given[2], state, k)) for k in range(3))
        for one in inside(op, given):
            yield from repeated(one, state, before)
        before += one_of(op, given, state, 0)


def hard_texts(text, flags, length):
    """Texts on which a pattern of this kind goes back most: repeats that nearly match."""
    tree = sre_parse.parse(text, flags)
    tree.state.bytes = isinstance(text, bytes)
    cases = {("", word) for word in (*CHARACTERS, "a1", "1 ", "1,", "a ", "a\n", "(a) ", sample(tree, tree.state))}
    for before, body in repeated(tree, tree.state):
        cases |= {(before, body), (before, " "), (before, "1"), ("", before), ("", before + body)}
    for before, word in sorted(cases):
        for end in ("", "\n\x01") if word else ():
            yield before + word * (length // len(word)) + end


def cpu_of(pattern, use, text, most=3):
    """CPU time of one use of a pattern; the least of ``most`` where it is long, but not very long."""
    apply = getattr(pattern, use)
    times = []
    while not times or ((MOST_CPU < times[-1] < 0.1 or most > 3) and len(times) < most):
        start = time.thread_time()
        found = apply("" if isinstance(text, str) else b"", text) if use == "sub" else apply(text)
        _ = list(found) if use == "finditer" else found
        times.append(time.thread_time() - start)
    return min(times)


def superlinear(text, flags, use):
    """The text on which a pattern takes too long, None where there is none."""
    pattern = re.compile(text, flags)
    pairs = zip(*(hard_texts(text, flags, length) for length in LENGTHS), strict=True)
    for short, hard in dict.fromkeys(pairs):
        given = (short.encode(), hard.encode()) if isinstance(text, bytes) else (short, hard)
        long = cpu_of(pattern, use, given[1])
        if long > MOST_CPU and long > MOST_GROWTH * cpu_of(pattern, use, given[0], most=9):
            return hard[:20]
    return None


@pytest.mark.parametrize("text", [r"\s*[\[(][^\])]*[\])]\s*$", r"\d+\.?\d*e", r"a\s*:?\s*b", r"(.+?)[_ ]*\d"])
def test_patterns_that_go_back_are_found(text):
    assert superlinear(text, 0, "search")


def test_every_pattern_takes_linear_time():
    found = patterns()
    assert len(found) > 150
    slow = [(name, text, hard) for name, text, flags, use in found if (hard := superlinear(text, flags, use))]
    assert not slow


def test_symbols_and_units_below_the_names_are_to_be_left_out_alone(tmp_path):
    rows = [
        f"E{k};{V};0,2;{t};{0.01 * V**0.5 * t**0.4:.3f}".replace(".", ",")
        for k, V in enumerate((100, 150, 200))
        for t in (2, 4, 8)
    ]
    text = "\n".join(["Schneide;Schnittgeschwindigkeit;Vorschub;Zeit;VB", "-;vc;f;t;VB", "-;m/min;mm;min;mm", *rows])
    (tmp_path / "t.csv").write_text(text, encoding="utf-8")
    with pytest.raises(errors.DataError, match='--leave-out "lines 2-3"'):
        datasets.read_runs(tmp_path / "t.csv")
    assert datasets.read_runs(tmp_path / "t.csv", leave_out=["lines 2-3"]).values("V")[-1] == 200
