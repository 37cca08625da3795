"""Laboratories' workbooks, and tables of several files, of known truth."""

import datetime as dt

from laboratory_truth import BASE, DOUBTED, READ, REFUSED, cells, headed, registry, show, table
from laboratory_workbooks import ods, xls, xlsb, xlsx

CASES = []
add = registry(CASES, "data.xlsx")


def grid(w, *columns, **names):
    """Header and rows of a sheet: numbers as numbers."""
    frame = w[list(columns or BASE)]
    return [headed(frame, **names), *map(list, frame.itertuples(index=False))]


def of_vb(w):
    """Truth of a file whose wear is VB, without force."""
    return w.rename(columns={"AW": "VB"})[["edge", "V", "f", "d", "t", "VB"]]


@add("workbook: .xlsx", READ)
def _(w):
    return xlsx({"Data": grid(w)})


@add("workbook: .xls", READ, file="data.xls")
def _(w):
    return xls(grid(w))


@add("workbook: .ods", READ, file="data.ods")
def _(w):
    return ods(grid(w))


@add("workbook: .xlsb", READ, file="data.xlsb")
def _(w):
    return xlsb(grid(w))


@add("workbook: merged edge cells", READ, quiet=False)
def _(w):
    def merge(book):
        for first in range(2, 146, 6):
            book.active.merge_cells(start_row=first, end_row=first + 5, start_column=1, end_column=1)

    return xlsx({"Data": grid(w)}, merge)


@add("workbook: merged cells of edge and conditions", READ, quiet=False)
def _(w):
    def merge(book):
        for first in range(2, 146, 6):
            for column in (1, 2, 3, 4):
                book.active.merge_cells(start_row=first, end_row=first + 5, start_column=column, end_column=column)

    return xlsx({"Data": grid(w)}, merge)


@add("workbook: cover sheet, two header rows, units row, remarks", READ)
def _(w):
    cover = [
        ["Institute of Cutting"],
        ["Project", "A 17"],
        ["Date", dt.date(2024, 3, 7)],
        ["Insert", "GC435"],
        ["Operator", "N.N."],
    ]
    rows = [["Test", "Cutting conditions", None, None, None, "Results", None, None],
            ["", "Speed", "Feed", "Depth of cut", "Time", "Average wear", "Cutting force", "Remarks"],
            ["-", "m/min", "mm/rev", "mm", "min", "mm", "N", None]]  # fmt: skip
    rows += [[*row, "chipped" if i == 17 else "new bar" if i % 40 == 0 else None] for i, row in enumerate(grid(w)[1:])]

    def merge(book):
        book["Tests"].merge_cells("B1:E1")
        book["Tests"].merge_cells("F1:G1")

    return xlsx({"Cover": cover, "Tests": rows}, merge)


@add("workbook: title rows and a table that begins in C5", READ)
def _(w):
    rows = [["Wear tests"], [], ["2024"], []]
    rows += [[None, None, *row] for row in grid(w)]
    return xlsx({"Sheet1": rows})


@add("workbook: two tables of tests on two sheets", READ, REFUSED, DOUBTED, names="sheet|--sheet", quiet=False)
def _(w):
    return xlsx({"First": grid(w), "Second": grid(w.iloc[:60])})


@add("workbook: a summary sheet before the data", READ, quiet=False)
def _(w):
    one = w.groupby("edge", sort=False)[["V", "f", "d"]].first().reset_index()
    summary = [
        ["Test", "V [m/min]", "f [mm/rev]", "ap [mm]", "final VB [mm]"],
        *map(list, one.assign(x=0.3).itertuples(index=False)),
    ]
    return xlsx({"Summary": [["Summary of tests"], *summary[:1], *summary[1:]], "Data": grid(w)})


@add("workbook: hidden rows of bad measurements", READ, quiet=False)
def _(w):
    bad = [12, 47, 100]
    truth = w[list(BASE)].drop(index=bad)
    w.loc[bad, "AW"] *= 10

    def hide(book):
        for row in bad:
            book.active.row_dimensions[row + 2].hidden = True

    return xlsx({"Data": grid(w)}, hide), truth


@add("workbook: a filter hides half of the edges", READ, DOUBTED, names="hidden", quiet=False)
def _(w):
    def hide(book):
        for row in range(74, 146):
            book.active.row_dimensions[row].hidden = True

    return xlsx({"Data": grid(w)}, hide), w[list(BASE)].iloc[:72]


@add("workbook: a hidden column of an older measurement", READ, quiet=False)
def _(w):
    rows = [[*row[:5], "wear [mm]" if i == 0 else row[5] * 1.7, *row[5:]] for i, row in enumerate(grid(w))]

    def hide(book):
        book.active.column_dimensions["F"].hidden = True

    return xlsx({"Data": rows}, hide)


@add("workbook: formulas without stored values", DOUBTED, REFUSED, names="P|formula|formulas", check=lambda seen: False)
def _(w):
    rows = [[*row, "P [kW]" if i == 0 else f"=B{i + 1}*G{i + 1}/60000"] for i, row in enumerate(grid(w))]
    return xlsx({"Data": rows})


@add(
    "workbook: wear as formulas without stored values",
    REFUSED,
    DOUBTED,
    names="AW|formula|formulas",
    check=lambda seen: False,
)
def _(w):
    rows = [[*row[:5], row[5] if i == 0 else f"={row[5] * 1000}/1000", row[6]] for i, row in enumerate(grid(w))]
    return xlsx({"Data": rows})


@add("workbook: averages among the data", READ, quiet=False)
def _(w):
    rows = grid(w)[:1]
    for _, part in w[list(BASE)].groupby("edge", sort=False):
        rows += [
            *map(list, part.itertuples(index=False)),
            ["average", None, None, None, None, part["AW"].mean(), part["Fc"].mean()],
        ]
    return xlsx({"Data": rows})


@add("workbook: a column of dates", READ)
def _(w):
    day = dt.datetime(2024, 3, 4)
    rows = [["date", *row] if i == 0 else [day + dt.timedelta(days=i // 30), *row] for i, row in enumerate(grid(w))]
    return xlsx({"Data": rows})


@add("workbook: times as [mm]:ss", READ)
def _(w):
    rows = grid(w, t="t")
    for row in rows[1:]:
        row[4] = dt.timedelta(minutes=row[4])

    def form(book):
        for (cell,) in book.active.iter_rows(min_row=2, min_col=5, max_col=5):
            cell.number_format = "[mm]:ss"

    return xlsx({"Data": rows}, form)


@add("workbook: times as h:mm:ss", READ)
def _(w):
    rows = grid(w, t="time")
    for row in rows[1:]:
        row[4] = dt.time(0, int(row[4]), 30)
    return xlsx({"Data": rows}), w[list(BASE)].assign(t=w["t"] + 0.5)


@add("workbook: minutes typed as h:mm", DOUBTED, REFUSED, names="t", check=lambda seen: False)
def _(w):
    rows = grid(w)  # 14:00 for 14 min 0 s, which Excel keeps as 14 hours, under a header in min
    for row in rows[1:]:
        row[4] = dt.time(int(row[4]), 0)
    return xlsx({"Data": rows})


@add("workbook: a sheet for each test", READ, REFUSED, names="sheet|sheets|--sheet", quiet=False, remedy=False)
def _(w):
    sheets = {name: grid(part, "V", "f", "d", "t", "AW") for name, part in w.groupby("edge", sort=False)}
    return xlsx(sheets), w[["edge", "V", "f", "d", "t", "AW"]]


@add("workbook: feeds and depths turned into dates by Excel", REFUSED, DOUBTED, names="d", check=lambda seen: False)
def _(w):
    rows = grid(w)
    for row in rows[1:]:
        if row[3] == 1.5:
            row[3] = dt.datetime(2024, 5, 1)  # 1.5 typed with a decimal comma locale
    return xlsx({"Data": rows})


@add("workbook: numbers stored as text", READ)
def _(w):
    return xlsx({"Data": [headed(w[list(BASE)]), *cells(w[list(BASE)])]})


@add("workbook: numbers stored as text with decimal commas", READ)
def _(w):
    return xlsx(
        {"Data": [headed(w[list(BASE)]), *([c.replace(".", ",") for c in row] for row in cells(w[list(BASE)]))]}
    )


@add("workbook: error values in cells", READ, DOUBTED, REFUSED, names="AW", quiet=False)
def _(w):
    rows = grid(w)
    for row in (9, 80):
        rows[row][5] = "#DIV/0!"
    return xlsx({"Data": rows}), w[list(BASE)].drop(index=[8, 79])


@add("a folder: a file for each test", READ, quiet=False)
def _(w):
    columns = ["V", "f", "d", "t", "AW"]
    files = {f"{name}.csv": table(part[columns]).encode() for name, part in w.groupby("edge", sort=False)}
    return files, w[["edge", *columns]]


@add("a folder: the conditions in notes of each file", READ, REFUSED, names="V|f|d", quiet=False, remedy=False)
def _(w):
    files = {}
    for name, part in w.groupby("edge", sort=False):
        V, f, d = part.iloc[0][["V", "f", "d"]]
        above = [f"# V = {show(V)} m/min", f"# f = {show(f)} mm/rev", f"# ap = {show(d)} mm"]
        files[f"test_{name}.csv"] = table(part[["t", "AW"]], above=above).encode()
    return files, w[["edge", "V", "f", "d", "t", "AW"]]


@add("a folder: one file in other units", READ, quiet=False)
def _(w):
    columns = ["V", "f", "d", "t", "AW"]
    files = {}
    for name, part in w.groupby("edge", sort=False):
        inch = name == "E05"
        one = part[columns].assign(f=part["f"] / 25.4) if inch else part[columns]
        files[f"{name}.csv"] = table(one, **({"f": "f [in/rev]"} if inch else {})).encode()
    return files, w[["edge", *columns]]


@add("a folder: two files of the same edge numbers, two tools", READ, quiet=False)
def _(w):
    files = {}
    for tool, part in (("K10", w.iloc[:72]), ("P25", w.iloc[72:])):
        edge = [str(i) for i in range(1, 13) for _ in range(6)]
        files[f"{tool}.csv"] = table(part[list(BASE)].assign(edge=edge), above=[f"# tool: {tool}"]).encode()
    return files, w[list(BASE)].assign(tool=["K10"] * 72 + ["P25"] * 72)
