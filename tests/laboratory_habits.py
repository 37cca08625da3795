"""Habits of laboratories and of the programs that they export from, as files of known truth."""

import numpy as np
from laboratory_truth import BASE, DOUBTED, READ, REFUSED, cells, headed, registry, table, text

CASES = []
add = registry(CASES)
NAMES = list(BASE)


def plain(w):
    """The clean table."""
    return table(w[NAMES])


# Names of tools, works and edges


@add("a work material in two spellings", READ, DOUBTED, names="work|material", quiet=False)
def _(w):
    work = np.where(np.arange(144) % 5 == 0, "c45 ", "C45")
    return table(w[NAMES].assign(work=work), work="Material"), w[NAMES].assign(work="C45")


@add("Tool no: 24 numbers are edges", READ)
def _(w):
    return table(w[NAMES].assign(edge=w["edge"].str[1:].astype(int).astype(str)), edge="Tool no")


@add("an ISO code in Insert, the edges in Tool", READ)
def _(w):
    frame = w[NAMES].assign(edge=w["edge"].str[1:], insert="CNMG 120408-PM")
    return table(frame, edge="Tool", insert="Insert"), w[NAMES]


@add("edges numbered anew at each speed", READ, DOUBTED, names="edge", quiet=False)
def _(w):
    w = w.sort_values(["V", "edge", "t"], ignore_index=True)
    number = w.groupby("V")["edge"].transform(lambda of: of.factorize()[0] + 1)
    return table(w[NAMES].assign(edge=number.astype(str))), w[NAMES]


@add("an edge name used for two tests", READ, DOUBTED, names="edge|E03", quiet=False)
def _(w):
    return table(w[NAMES].assign(edge=w["edge"].where(w["edge"] != "E11", "E03")))


@add("edge numbers as 1, 1.0 and 01", READ, DOUBTED, names="edge", quiet=False)
def _(w):
    number = w["edge"].str[1:].astype(int)
    forms = [(f"{n}", f"{n}.0", f"{n:02d}")[i % 3] for i, n in enumerate(number)]
    return table(w[NAMES].assign(edge=forms))


@add("newest first, with an edge column", READ)
def _(w):
    return table(w[NAMES].iloc[::-1])


@add("newest first, without an edge column", READ, DOUBTED, names="edge", quiet=False)
def _(w):
    return table(w[NAMES[1:]].iloc[::-1])


@add("passes instead of time", DOUBTED, names="passes|t")
def _(w):
    return table(w[NAMES], t="passes")


@add("a new edge first: t 0, wear 0", READ, quiet=False)
def _(w):
    rows = []
    for _, part in w[NAMES].groupby("edge", sort=False):
        rows += [[*cells(part)[0][:4], "0", "0", ""], *cells(part)]
    return text(headed(w[NAMES]), rows)


# Cells


@add("ditto marks", READ, REFUSED, DOUBTED, names="V|f|d|edge", quiet=False, corrected=plain)
def _(w):
    again = w["edge"].duplicated()
    rows = [["''"] * 4 + row[4:] if twice else row for row, twice in zip(cells(w[NAMES]), again, strict=True)]
    return text(headed(w[NAMES]), rows)


@add("about: ~0.25", READ, REFUSED, DOUBTED, names="AW", quiet=False, corrected=plain)
def _(w):
    rows = cells(w[NAMES])
    for i in (8, 90):
        rows[i][5] = f"~{rows[i][5]}"
    return text(headed(w[NAMES]), rows)


@add("a value with its deviation: 0.25 ± 0.01", READ, REFUSED, corrected=plain)
def _(w):
    rows = [[*row[:5], f"{row[5]} ± 0.01", row[6]] for row in cells(w[NAMES])]
    return text(headed(w[NAMES]), rows)


@add("scientific notation", READ)
def _(w):
    rows = [[row[0], *(f"{float(cell):.6E}" for cell in row[1:])] for row in cells(w[NAMES])]
    return text(headed(w[NAMES]), rows)


@add("numbers after an apostrophe", READ, REFUSED, corrected=plain)
def _(w):
    rows = [[row[0], *(f"'{cell}" for cell in row[1:])] for row in cells(w[NAMES])]
    return text(headed(w[NAMES]), rows)


@add("forces of negative sign throughout", READ, DOUBTED, REFUSED, names="Fc", quiet=False, check=lambda seen: False)
def _(w):
    return table(w[NAMES].assign(Fc=-w["Fc"]))


@add("a file cut off in its last row", READ, DOUBTED, names="line", quiet=False)
def _(w):
    return plain(w)[:-12], w[NAMES].iloc[:-1]


@add("times as h:mm", READ, DOUBTED, REFUSED, names="t", quiet=False)
def _(w):
    rows = [[*row[:4], f"0:{int(float(row[4])):02d}", *row[5:]] for row in cells(w[NAMES])]
    return text(headed(w[NAMES], t="t [h:mm]"), rows)


@add("wear in hundredths: AW [1/100 mm]", READ, REFUSED, names="AW", corrected=plain)
def _(w):
    return table(w[NAMES].assign(AW=(w["AW"] * 100).round(2)), AW="AW [1/100 mm]")


# Headers and tables


@add("headers in capitals", READ)
def _(w):
    names = {"edge": "EDGE NO", "V": "CUTTING SPEED (M/MIN)", "f": "FEED (MM/REV)", "d": "DOC (MM)", "t": "TIME (MIN)",
             "AW": "AVERAGE WEAR (MM)", "Fc": "CUTTING FORCE (N)"}  # fmt: skip
    return table(w[NAMES], **names)


@add("headers in two languages", READ)
def _(w):
    names = {"V": "Cutting speed / Schnittgeschwindigkeit vc [m/min]", "f": "Feed / Vorschub f [mm/U]",
             "d": "Depth of cut / Schnitttiefe ap [mm]", "t": "Time / Zeit t [min]"}  # fmt: skip
    return table(w[NAMES], **names)


@add("headers with footnotes", READ, DOUBTED, REFUSED, names="AW|AW* [mm]|V|V¹ [m/min]", quiet=False)
def _(w):
    return table(w[NAMES], V="V¹ [m/min]", AW="AW* [mm]")


@add("headers over two lines of a cell", READ)
def _(w):
    return table(w[NAMES], V='"V\n[m/min]"', f='"Feed f\n[mm/rev]"', AW='"Average wear\n[mm]"')


@add("a micro sign in the wrong encoding", READ, REFUSED, names="VB", quiet=False)
def _(w):
    frame = w.rename(columns={"AW": "VB"})[["edge", "V", "f", "d", "t", "VB"]]
    return table(frame.assign(VB=frame["VB"] * 1000), VB="VB [Âµm]"), frame


@add("vf and V, no n and no D", DOUBTED, REFUSED, names="f|fm|vf|n|D", check=lambda seen: False)
def _(w):
    D = np.repeat(np.linspace(95, 60, 24), 6)
    vf = (w["f"] * 1000 * w["V"] / (np.pi * D)).round(1)
    return table(w[NAMES].assign(f=vf), f="vf [mm/min]")


@add("V nominal and V actual", REFUSED, READ, names="V", quiet=False)
def _(w):
    frame = w[NAMES].assign(actual=(w["V"] * 0.98).round(1))
    return table(frame, actual="Vc actual [m/min]")


@add("wear in mm and in um", REFUSED, READ, names="AW", quiet=False)
def _(w):
    return table(w[NAMES].assign(again=w["AW"] * 1000), again="wear [um]")


@add(
    "two exports below each other, columns in another order",
    READ,
    REFUSED,
    DOUBTED,
    names="line|header|V|f",
    quiet=False,
    corrected=plain,
)
def _(w):
    order = ["edge", "f", "V", "t", "d", "AW", "Fc"]
    return table(w[NAMES].iloc[:72]) + table(w[order].iloc[72:])


@add(
    "two exports below each other, the second in inches",
    READ,
    REFUSED,
    DOUBTED,
    names="line|header|f",
    quiet=False,
    corrected=plain,
)
def _(w):
    inch = w[NAMES].iloc[72:].assign(f=w["f"] / 25.4)
    return table(w[NAMES].iloc[:72]) + table(inch, f="f [in/rev]")


@add("two tables side by side", REFUSED, READ, names="V", quiet=False, remedy=False)
def _(w):
    left, right = cells(w[NAMES].iloc[:72]), cells(w[NAMES].iloc[72:])
    rows = [[*a, "", *b] for a, b in zip(left, right, strict=True)]
    return text([*headed(w[NAMES]), "", *headed(w[NAMES])], rows)


@add("a footer of notes in the columns", READ, quiet=False)
def _(w):
    return table(w[NAMES], below=["", "Notes:,,,,,,", "1) edge E03 chipped,,,,,,", "2) coolant: none,,,,,,"])


@add("one row a test, 24 tests", READ, test={"times": (10.0,)})
def _(w):
    return plain(w)


@add("one row a test, without edges, wear in um", READ, REFUSED, test={"times": (10.0,)}, edges=False, quiet=False)
def _(w):
    frame = w[NAMES[1:6]]
    return table(frame.assign(AW=frame["AW"] * 1000), AW="wear"), frame


@add("8 tests, f x10 in one", DOUBTED, names="f", test={"edges": 8})
def _(w):
    frame = w[NAMES].copy()
    frame.loc[frame["edge"] == "E05", "f"] *= 10
    return table(frame)


@add("8 tests, V in m/s in one", DOUBTED, names="V|P", test={"edges": 8, "levels": False})
def _(w):
    frame = w[NAMES].copy()
    frame.loc[frame["edge"] == "E05", "V"] /= 60
    return table(frame)


@add("random conditions, f in inches on 4 edges", DOUBTED, names="f|Fc", test={"levels": False})
def _(w):
    frame = w[NAMES].copy()
    frame.loc[frame["edge"].isin(["E02", "E09", "E15", "E20"]), "f"] /= 25.4
    return table(frame)


@add("random conditions, f in inches on 4 edges, no force", DOUBTED, names="f", test={"levels": False})
def _(w):
    frame = w[NAMES[:6]].copy()
    frame.loc[frame["edge"].isin(["E02", "E09", "E15", "E20"]), "f"] /= 25.4
    return table(frame), w[NAMES[:6]]


@add("random conditions, V in sfm on one edge, no force", DOUBTED, names="V", test={"levels": False})
def _(w):
    frame = w[NAMES[:6]].copy()
    frame.loc[frame["edge"] == "E07", "V"] /= 0.3048
    return table(frame), w[NAMES[:6]]


@add("random conditions, d in inches on 3 edges, no force", DOUBTED, names="d", test={"levels": False})
def _(w):
    frame = w[NAMES[:6]].copy()
    frame.loc[frame["edge"].isin(["E01", "E12", "E13"]), "d"] /= 25.4
    return table(frame), w[NAMES[:6]]


@add("d as a diameter on 3 edges, no force", DOUBTED, READ, names="d", check=lambda seen: True)
def _(w):  # x2 lands on plausible depths: within the scatter of edges nothing shows it
    frame = w[NAMES[:6]].copy()
    frame.loc[frame["edge"].isin(["E01", "E12", "E13"]), "d"] *= 2
    return table(frame)
