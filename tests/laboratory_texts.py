"""Laboratories' text files of known truth: headers, units, marks, layouts of a row, edges, derived quantities."""

import numpy as np
import pandas as pd
from laboratory_truth import BASE, DOUBTED, READ, REFUSED, cells, frame_text, headed, registry, show, table, text

VB = {"AW": "VB"}
OF_VB = ("edge", "V", "f", "d", "t", "VB")
INCH = 25.4
CASES = []
add = registry(CASES)


def of_vb(w):
    """Truth of a file whose wear is VB."""
    return w.rename(columns=VB)[list(OF_VB)]


def plain(w):
    """The clean table."""
    return table(w[list(BASE)])


def scaled(w, **factors):
    """Columns times factors."""
    return w.assign(**{name: w[name] * factor for name, factor in factors.items()})


def changed(w, rows, column, new):
    """One column changed in some rows, by a factor or a function."""
    w = w.copy()
    w.loc[rows, column] = new(w.loc[rows, column]) if callable(new) else w.loc[rows, column] * new
    return w


def of_edges(w, numbers):
    """Rows of some edges, by number."""
    return w["edge"].isin([f"E{number:02d}" for number in numbers])


def decimal_comma(content):
    """Decimal commas instead of points in the cells of a table with semicolons."""
    head, rows = content.split("\n", 1)
    return head + "\n" + rows.replace(".", ",")


# Units


@add("VB in um, no unit named", READ, REFUSED, quiet=False)
def _(w):
    return table(scaled(of_vb(w), VB=1000), VB="VB"), of_vb(w)


@add("VB in um under a header in mm", REFUSED, names="VB")
def _(w):
    return table(scaled(of_vb(w), VB=1000)), of_vb(w)


@add("VB in um, said in a note", READ, REFUSED, quiet=False)
def _(w):
    return table(scaled(of_vb(w), VB=1000), above=["# wear values in µm"], VB="VB"), of_vb(w)


@add("inch file: SFM, IPR, DOC, Wear", READ, REFUSED, names="d|DOC", quiet=False)
def _(w):
    w = w[["edge", "V", "f", "d", "t", "AW"]]
    inch = scaled(w, V=1 / 0.3048, f=1 / INCH, d=1 / INCH, AW=1 / INCH)
    return table(inch, V="SFM", f="IPR", d="DOC", AW="Wear [in]"), w


@add("inch file: SFM, IPR, DOC, Wear, none with a unit", READ, REFUSED, names="d|DOC|AW|Wear", quiet=False)
def _(w):
    w = w[["edge", "V", "f", "d", "t", "AW"]]
    inch = scaled(w, V=1 / 0.3048, f=1 / INCH, d=1 / INCH, AW=1 / INCH)
    return table(inch, V="SFM", f="IPR", d="DOC", t="TIME", AW="WEAR"), w


@add("inch file with one metric column that names no unit", READ, REFUSED, DOUBTED, names="d", quiet=False)
def _(w):
    inch = scaled(w[list(BASE)], V=1 / 0.3048, f=1 / INCH, AW=1 / INCH)
    return table(inch, V="speed [sfm]", f="feed [ipr]", d="depth of cut", AW="wear [in]")


@add("wear in thousandths of an inch, no unit named", READ, REFUSED, DOUBTED, names="VB", quiet=False)
def _(w):
    return table(scaled(of_vb(w), VB=1000 / INCH), VB="VB"), of_vb(w)


@add("V in m/s, no unit named", READ, REFUSED, DOUBTED, names="V", quiet=False)
def _(w):
    return table(scaled(w[list(BASE)], V=1 / 60), V="V")


@add("V in sfm, no unit named, beside P and Fc", READ, REFUSED, DOUBTED, names="V")
def _(w):  # 262 to 591 are metric speeds too: P / (Fc V) shows it
    return table(scaled(w, V=1 / 0.3048), V="V"), w


@add("t in s, no unit named", READ, REFUSED, DOUBTED, names="t", quiet=False)
def _(w):
    return table(scaled(w[list(BASE)], t=60), t="t")


@add("t in s under a header in min", REFUSED, DOUBTED, names="t")
def _(w):
    return table(scaled(w[list(BASE)], t=60))


@add("t in h", READ)
def _(w):
    return table(scaled(w[list(BASE)], t=1 / 60), t="t [h]")


@add("d in cm under a header in mm", REFUSED, DOUBTED, names="d|Fc")
def _(w):  # .1 to .25 are depths in mm too: Fc / (f d) shows it
    return table(scaled(w[list(BASE)], d=0.1))


@add("f in um/rev under a header in mm/rev", REFUSED, names="f")
def _(w):
    return table(scaled(w[list(BASE)], f=1000))


@add("power in W", READ)
def _(w):
    w = w.drop(columns="Fc")
    return table(scaled(w, P=1000), P="P [W]"), w


@add("power in W, no unit named", READ, REFUSED, names="P", quiet=False)
def _(w):
    w = w.drop(columns="Fc")
    return table(scaled(w, P=1000), P="power"), w


@add("power in W under a header in kW", REFUSED, names="P")
def _(w):
    w = w.drop(columns="Fc")
    return table(scaled(w, P=1000)), w


@add("force in kN", READ)
def _(w):
    return table(scaled(w[list(BASE)], Fc=0.001), Fc="Fc [kN]")


@add("force in kN, no unit named", READ, REFUSED, DOUBTED, names="Fc", quiet=False)
def _(w):
    return table(scaled(w[list(BASE)], Fc=0.001), Fc="Fc")


@add("force in lbf", READ)
def _(w):
    return table(scaled(w[list(BASE)], Fc=1 / 4.4482216152605), Fc="Cutting force (lbf)")


@add("feed in mm/min under a header f, with n", READ, REFUSED, names="f")
def _(w):
    n = 1000 * w["V"] / (np.pi * 80)
    return table(w[list(BASE)].assign(f=w["f"] * n, n=n), f="f", n="n [1/min]")


@add("feed in mm/min under a header f, without n", REFUSED, names="f", check=lambda seen: False)
def _(w):
    return table(scaled(w[list(BASE)], f=400), f="f")


# Headers


@add("the clean table", READ)
def _(w):
    return plain(w)


@add("columns in another order", READ)
def _(w):
    return table(w[["AW", "t", "edge", "Fc", "d", "V", "f"]])


@add("headers of V and t exchanged", DOUBTED, REFUSED, names="V|t", check=lambda seen: False)
def _(w):
    return table(w[list(BASE)].rename(columns={"V": "t", "t": "V"}))


@add("headers of f and d exchanged", DOUBTED, REFUSED, names="f|d", check=lambda seen: False)
def _(w):
    return table(w[list(BASE)].rename(columns={"f": "d", "d": "f"}))


@add("headers of AW and f exchanged", DOUBTED, REFUSED, names="f|AW", check=lambda seen: False)
def _(w):
    return table(w[list(BASE)].rename(columns={"f": "AW", "AW": "f"}))


@add("a header with one cell more than every row", REFUSED, corrected=plain)
def _(w):
    lines = plain(w).split("\n")
    return "\n".join(["no," + lines[0], *lines[1:]])


@add("a header with one cell less than every row", REFUSED, corrected=plain)
def _(w):
    lines = plain(w).split("\n")
    return "\n".join([lines[0], *(f"{line},1" if line else "" for line in lines[1:])])


@add("a zero-width character in a header", READ)
def _(w):
    return table(w[list(BASE)], f="f\u200b [mm/rev]", V="\u2060V [m/min]", AW="AW [mm]\u200c")


@add("soft hyphen, bidi mark and two blanks in headers", READ)
def _(w):
    return table(w[list(BASE)], f="Feed\u00ad [mm/rev]", V="\u200eV  [m/min]", d="d\u00a0[mm]")


@add("a header with a look-alike Cyrillic letter", READ, DOUBTED, REFUSED, names="V|Vс|АW|AW")
def _(w):
    return table(w[list(BASE)], V="Vс [m/min]", AW="АW [mm]")


@add("a factor under a name nobody knows", DOUBTED, names="Zustellung_x|d=Zustellung_x")
def _(w):
    return table(w[list(BASE)], d="Zustellung_x")


@add("a factor under a code", DOUBTED, names="Par_3|V=Par_3")
def _(w):
    return table(w[list(BASE)], V="Par_3")


@add("German headers in Latin-1", READ, encoding="latin-1", file="versuch.csv")
def _(w):
    names = {"edge": "Schneide", "V": "Schnittgeschwindigkeit vc in m/min", "f": "Vorschub in mm/U",
             "d": "Schnitttiefe ap (mm)", "t": "Eingriffszeit (min)", "AW": "mittlerer Verschleiß (mm)",
             "Fc": "Schnittkraft [N]"}  # fmt: skip
    return decimal_comma(table(w[list(BASE)], ";", **names))


@add("French headers", READ)
def _(w):
    names = {"edge": "arête", "V": "Vitesse de coupe (m/min)", "f": "Avance par tour (mm/tr)",
             "d": "Profondeur de passe (mm)", "t": "Temps (min)", "AW": "Usure moyenne (mm)",
             "Fc": "Effort de coupe (N)"}  # fmt: skip
    return decimal_comma(table(w[list(BASE)], ";", **names))


@add("Spanish headers", READ)
def _(w):
    names = {"edge": "filo", "V": "Velocidad de corte [m/min]", "f": "Avance [mm/rev]",
             "d": "Profundidad de corte [mm]", "t": "Tiempo de corte [min]", "AW": "Desgaste medio [mm]",
             "Fc": "Fuerza de corte [N]"}  # fmt: skip
    return table(w[list(BASE)], **names)


@add("headers of a parameter list, with remarks", READ)
def _(w):
    return table(w[list(BASE)], V="Cutting speed Vc (m/min)", f="Feed rate f (mm/rev)", d="Depth of cut ap (mm)",
                 t="Machining time (min)", AW='"Average wear, 3 lands (mm)"', Fc="Main cutting force (N)")  # fmt: skip


@add("a units row", READ)
def _(w):
    names = list(BASE)
    return text(names, [["", "m/min", "mm/rev", "mm", "min", "mm", "N"], *cells(w[names])])


@add("a units row in inches", READ)
def _(w):
    names = list(BASE)
    inch = scaled(w[names], V=1 / 0.3048, f=1 / INCH, d=1 / INCH)
    return text(names, [["-", "ft/min", "in/rev", "in", "min", "mm", "N"], *cells(inch)])


@add("notes above and below", READ)
def _(w):
    above = ["Wear tests, lathe 3;;;", "Operator: N.N., 2024-05-03", "", "Insert: CNMG 120408 GC435", ""]
    return table(
        w[list(BASE)], above=above, below=["", "measured with the toolmaker's microscope", "n.b. edge 7 chipped"]
    )


@add("comment lines among the rows", READ)
def _(w):
    lines = plain(w).split("\n")
    return "\n".join(["# lab 3", *lines[:20], "# second day", *lines[20:60], "# new bar", *lines[60:]])


@add("the header repeated on every page", READ, DOUBTED, names="header|line", quiet=False)
def _(w):
    lines = plain(w).rstrip("\n").split("\n")
    return "\n".join([*lines[:51], lines[0], *lines[51:101], lines[0], *lines[101:]]) + "\n"


@add("coded levels", REFUSED, typed="--range V=80:120:180 --range f=0.1:0.2:0.4")
def _(w):
    codes = {"V": {80: -1, 120: 0, 180: 1}, "f": {0.1: -1, 0.2: 0, 0.4: 1}}
    coded = w[list(BASE)].assign(**{name: w[name].map(code) for name, code in codes.items()})
    return table(coded, V="V", f="f")


@add("spindle load in per cent beside it", READ)
def _(w):
    return table(w[list(BASE)].assign(load=(w["P"] / 0.1).round(1)), load="Load [%]")


# Marks and dialects


@add("semicolons and decimal commas", READ)
def _(w):
    return decimal_comma(table(w[list(BASE)], ";"))


@add("commas are both delimiter and decimal mark", REFUSED, corrected=plain)
def _(w):
    return table(w[list(BASE)]).replace(".", ",")


@add(
    "a column with another decimal mark",
    REFUSED,
    READ,
    names="f",
    corrected=lambda w: decimal_comma(table(w[list(BASE)], ";")),
)
def _(w):
    rows = [[cell if i == 2 else cell.replace(".", ",") for i, cell in enumerate(row)] for row in cells(w[list(BASE)])]
    return text(headed(w[list(BASE)]), rows, ";")


@add("a few cells with another decimal mark", REFUSED, READ, DOUBTED, names="AW", quiet=False, corrected=plain)
def _(w):
    rows = cells(w[list(BASE)])
    for i in (3, 40, 77):
        rows[i][5] = rows[i][5].replace(".", ",")
    return text(headed(w[list(BASE)]), rows, "\t")


@add("thousands marks in quoted cells", READ)
def _(w):
    rows = [[*row[:6], f'"{float(row[6]):,.1f}"'] for row in cells(w[list(BASE)])]
    return text(headed(w[list(BASE)]), rows)


@add("points as thousands marks, decimal commas", READ)
def _(w):
    def german(value):
        return f"{value:,.1f}".replace(",", " ").replace(".", ",").replace(" ", ".")

    rows = [[*(c.replace(".", ",") for c in row[:6]), german(float(row[6]))] for row in cells(w[list(BASE)])]
    return text(headed(w[list(BASE)]), rows, ";")


@add("points as thousands marks in whole newtons", READ)
def _(w):
    w["Fc"] = w["Fc"].round()
    rows = [[*(c.replace(".", ",") for c in row[:6]), f"{int(float(row[6])):,}".replace(",", ".")]
            for row in cells(w[list(BASE)])]  # fmt: skip
    return text(headed(w[list(BASE)]), rows, ";"), w[list(BASE)]


@add("narrow and no-break spaces as thousands marks", READ)
def _(w):
    def force(value, mark):
        return f"{float(value):,.1f}".replace(",", mark).replace(".", ",")

    rows = [
        [*(c.replace(".", ",") for c in row[:6]), force(row[6], "\u202f\xa0"[i % 2])]
        for i, row in enumerate(cells(w[list(BASE)]))
    ]
    return text(headed(w[list(BASE)]), rows, ";")


@add("tabs", READ, file="data.tsv")
def _(w):
    return table(w[list(BASE)], "\t")


@add("aligned columns of blanks", READ, file="data.txt")
def _(w):
    frame = w[list(BASE)]
    rows = [list(BASE), *cells(frame)]
    return "\n".join("  ".join(cell.rjust(8) for cell in row) for row in rows) + "\n"


@add("trailing delimiters everywhere", READ)
def _(w):
    return plain(w).replace("\n", ",,\n")


@add("trailing delimiters in the rows only", READ)
def _(w):
    head, rows = plain(w).split("\n", 1)
    return head + "\n" + rows.replace("\n", ",\n")


@add("an index column of pandas", READ)
def _(w):
    return frame_text(w[list(BASE)].set_axis(headed(w[list(BASE)]), axis=1))


@add("row names of R's write.table", READ, file="data.txt")
def _(w):
    rows = [[f'"{i + 1}"', f'"{row[0]}"', *row[1:]] for i, row in enumerate(cells(w[list(BASE)]))]
    return text([f'"{name}"' for name in BASE], rows, " ")


@add("every cell quoted", READ)
def _(w):
    rows = [[f'"{cell}"' for cell in row] for row in cells(w[list(BASE)])]
    return text([f'"{name}"' for name in headed(w[list(BASE)])], rows)


@add("UTF-16 with tabs", READ, file="data.txt", encoding="utf-16")
def _(w):
    return table(w[list(BASE)], "\t")


@add("UTF-8 with a byte order mark and CRLF", READ)
def _(w):
    return "\ufeff" + plain(w).replace("\n", "\r\n")


@add("blank lines between the edges", READ)
def _(w):
    rows = []
    for _, part in w[list(BASE)].groupby("edge", sort=False):
        rows += [*cells(part), [""] * len(BASE)]
    return text(headed(w[list(BASE)]), rows)


@add("quoted remarks with commas and line breaks", READ)
def _(w):
    rows = [[*row, '"good, but\nslightly chipped"' if i % 7 == 0 else ""] for i, row in enumerate(cells(w[list(BASE)]))]
    return text([*headed(w[list(BASE)]), "remark"], rows)


@add("the unit in every cell", READ, REFUSED, corrected=plain)
def _(w):
    rows = [[*row[:5], f"{row[5]} mm", row[6]] for row in cells(w[list(BASE)])]
    return text(headed(w[list(BASE)]), rows)


# Values that are missing, censored, means


@add("missing values as -, NA, n/a and blank", READ)
def _(w):
    rows = cells(w[list(BASE)])
    gone = {5: "-", 30: "NA", 61: "n/a", 90: ""}
    for row, mark in gone.items():
        rows[row][5] = rows[row][6] = mark
    return text(headed(w[list(BASE)]), rows), w[list(BASE)].drop(index=list(gone))


@add("missing wear as 0", READ, DOUBTED, names="AW", quiet=False)
def _(w):
    gone = [5, 30, 61]
    return table(changed(w[list(BASE)], gone, "AW", 0)), w[list(BASE)].drop(index=gone)


@add("missing wear as 999", DOUBTED, REFUSED, names="AW", check=lambda seen: False)
def _(w):
    return table(changed(w[list(BASE)], [5, 30, 61], "AW", lambda x: 999.0))


def censored(mark):
    """A file whose smallest or largest wear values are known by a bound."""

    def make(w):
        rows, names = cells(w[list(BASE)]), list(BASE)
        gone = w.index[w["AW"] < 0.09] if mark == "<" else w.index[w["AW"] > w["AW"].quantile(0.97)]
        for i in gone:
            rows[i][5] = {"<": "<0.09", ">": f">{rows[i][5]}", "*": f"{rows[i][5]}*"}[mark]
        return text(headed(w[names]), rows), w[names].drop(index=gone)

    return make


add("wear below the gauge: <0.09", READ, quiet=False)(censored("<"))
add("wear above the scale: >0.3", READ, quiet=False)(censored(">"))
add("wear with a mark: 0.24*", READ, quiet=False)(censored("*"))


@add("a mean and a deviation below the table", READ)
def _(w):
    mean = ["Mean", *(show(w[name].mean()) for name in BASE[1:])]
    sd = ["Std. dev.", *(show(w[name].std()) for name in BASE[1:])]
    return text(headed(w[list(BASE)]), [*cells(w[list(BASE)]), mean, sd])


def averages(label):
    """A file with a row of averages after each edge."""

    def make(w):
        rows = []
        for edge, part in w[list(BASE)].groupby("edge", sort=False):
            mean = [show(part[name].mean()) for name in ("t", "AW", "Fc")]
            rows += [*cells(part), [label or edge, *cells(part)[0][1:4], *mean]]
        return text(headed(w[list(BASE)]), rows)

    return make


add("averages among the rows, by label", READ, quiet=False)(averages("Mean"))
add("averages among the rows, without a label", READ, DOUBTED, names="average|averages|mean|means|t", quiet=False)(
    averages("")
)


# Times


@add("times as min:s", READ)
def _(w):
    w = w[list(BASE)]
    clock = [f"{int(t)}:{round(60 * (t % 1)):02d}" for t in w["t"] + 0.5]
    return text(headed(w, t="t"), [[*r[:4], c, *r[5:]] for r, c in zip(cells(w), clock, strict=True)]), w.assign(
        t=w["t"] + 0.5
    )


@add("times as h:min:s", READ)
def _(w):
    w = w[list(BASE)]
    clock = [f"0:{int(t):02d}:30" for t in w["t"]]
    return text(
        headed(w, t="cutting time"), [[*r[:4], c, *r[5:]] for r, c in zip(cells(w), clock, strict=True)]
    ), w.assign(t=w["t"] + 0.5)


@add("time running through all edges", DOUBTED, REFUSED, READ, names="t", quiet=False)
def _(w):
    return table(w[list(BASE)].assign(t=w["t"] + np.repeat(np.arange(24) * 20.0, 6)))


@add("time of each sub-test instead of the time on the edge", DOUBTED, REFUSED, READ, names="t|edge", quiet=False)
def _(w):
    return table(w[list(BASE)].assign(t=np.tile((2.0, 2.0, 3.0, 3.0, 4.0, 4.0), 24)))


# Edges


@add("Insert: 24 values are edges", READ)
def _(w):
    w = w[list(BASE)]
    number = w["edge"].str[1:].astype(int).astype(str)
    return table(w.assign(edge=number), edge="Insert")


@add("Insert: 13 values are edges", READ, test={"edges": 13})
def _(w):
    w = w[list(BASE)]
    return table(w.assign(edge="I" + w["edge"].str[1:]), edge="Insert no."), w


@add("Platte: the edges of a German table", READ)
def _(w):
    w = w[list(BASE)]
    number = w["edge"].str[1:].astype(int).astype(str)
    return decimal_comma(table(w.assign(edge=number), ";", edge="Platte"))


@add("Insert: two makers beside an edge column", READ)
def _(w):
    tool = np.where(np.arange(len(w)) < 72, "CNMG-KC5010", "CNMG-GC435")
    return table(w[list(BASE)].assign(tool=tool), tool="Insert"), w[list(BASE)].assign(tool=tool)


@add("plate and corner together are the edge", READ, DOUBTED, names="edge")
def _(w):
    number = w["edge"].str[1:].astype(int) - 1
    frame = w[list(BASE)].assign(edge=(number // 4 + 1).astype(str))
    frame.insert(1, "corner", (number % 4 + 1).astype(str))
    return table(frame, edge="Insert no", corner="Corner")


@add("two tools, two works", READ)
def _(w):
    frame = w[list(BASE)].assign(
        tool=np.where(np.arange(144) < 72, "K10", "P25"), work=np.where(np.arange(144) % 72 < 36, "C45", "42CrMo4")
    )
    return table(frame, tool="Tool", work="Work material"), frame


@add("blank edge cells below the first", READ, quiet=False)
def _(w):
    frame = w[list(BASE)]
    return table(frame.assign(edge=frame["edge"].where(~frame["edge"].duplicated(), "")))


@add("blank cells of edge and conditions below the first", READ, quiet=False)
def _(w):
    frame = w[list(BASE)].copy()
    again = frame["edge"].duplicated()
    rows = [["", "", "", "", *row[4:]] if twice else row for row, twice in zip(cells(frame), again, strict=True)]
    return text(headed(frame), rows)


@add("no edge column, in file order", READ, quiet=False)
def _(w):
    return table(w[list(BASE)[1:]])


@add(
    "no edge column, random conditions, two edges alike",
    READ,
    DOUBTED,
    names="edge",
    quiet=False,
    test={"levels": False},
)
def _(w):
    alike = w.copy()
    alike.loc[of_edges(w, [2]), ["V", "f", "d"]] = w.loc[of_edges(w, [1]), ["V", "f", "d"]].to_numpy()
    return table(alike[list(BASE)[1:]]), alike[list(BASE)]


@add("no edge column, shuffled", READ, DOUBTED, names="edge", quiet=False)
def _(w):
    return table(w[list(BASE)[1:]].sample(frac=1, random_state=1))


@add("an edge column, shuffled", READ)
def _(w):
    return table(w[list(BASE)].sample(frac=1, random_state=2))


@add("an edge column that numbers every row", READ, DOUBTED, names="edge|Test no", quiet=False)
def _(w):
    return table(w[list(BASE)].assign(edge=[str(i + 1) for i in range(144)]), edge="Test no")


@add("an edge name in three spellings", READ, DOUBTED, names="edge")
def _(w):
    edge = w["edge"].copy()
    edge[[7, 20]] = ["e02", "E 04"]
    edge[33] = "E06 "
    return table(w[list(BASE)].assign(edge=edge))


@add("an edge name misspelled in a row", DOUBTED, names="edge|E07|E70")
def _(w):
    return table(changed(w[list(BASE)], [38], "edge", lambda x: "E70"))


@add("rows copied twice", DOUBTED, names="edge|t|AW|duplicate|duplicates|identical|repeated")
def _(w):
    frame = w[list(BASE)]
    return table(pd.concat([frame.iloc[:40], frame.iloc[34:40], frame.iloc[40:]]))


@add("a small table: 6 edges x 2", READ, test={"edges": 6, "times": (3.0, 12.0)})
def _(w):
    return plain(w)


# Derived quantities


@add("n, D and vf instead of V and f", READ, quiet=False)
def _(w):
    D = np.repeat(np.linspace(90, 70, 24).round(1), 6)
    n = (1000 * w["V"] / (np.pi * D)).round(0)
    vf = (w["f"] * n).round(1)
    frame = pd.DataFrame({"edge": w["edge"], "n": n, "D": D, "vf": vf, "d": w["d"], "t": w["t"], "VB": w["AW"]})
    truth = pd.DataFrame(
        {"edge": w["edge"], "V": np.pi * D * n / 1000, "f": vf / n, "d": w["d"], "t": w["t"], "VB": w["AW"]}
    )
    return table(frame, edge="test", n="n [1/min]", D="D [mm]", vf="vf [mm/min]", d="ap [mm]"), truth


@add("n and f, the diameter in a note", READ, REFUSED, DOUBTED, names="V", quiet=False)
def _(w):
    n = (1000 * w["V"] / (np.pi * 80)).round(0)
    frame = w[list(BASE)].assign(V=n)
    return table(frame, above=["# bar diameter D = 80 mm"], V="n [rpm]"), frame.assign(V=np.pi * 80 * n / 1000)


@add("n and f, no diameter", DOUBTED, REFUSED, names="V|n|D", check=lambda seen: False)
def _(w):
    n = np.repeat(np.random.default_rng(1).permutation(np.arange(24)), 6) * 20.0 + 300
    return table(w[list(BASE)].assign(V=n), V="n [rpm]")


@add("milling: n, vf, z, D", READ, REFUSED, names="fz|f|V", quiet=False)
def _(w):
    n = (1000 * w["V"] / (np.pi * 63)).round(0)
    vf = (w["f"] * n).round(1)
    frame = pd.DataFrame(
        {"edge": w["edge"], "n": n, "vf": vf, "z": 4.0, "D": 63.0, "d": w["d"], "t": w["t"], "VB": w["AW"]}
    )
    truth = pd.DataFrame(
        {"edge": w["edge"], "V": np.pi * 63 * n / 1000, "f": vf / n, "d": w["d"], "t": w["t"], "VB": w["AW"]}
    )
    return table(frame, n="n [1/min]", vf="vf [mm/min]", D="D [mm]", d="ap [mm]"), truth


@add("milling: fz and z", READ, REFUSED, names="fz|f", quiet=False)
def _(w):
    frame = of_vb(w).assign(fz=w["f"] / 4, z=4.0).drop(columns="f")
    return table(frame, fz="fz [mm/tooth]", d="ap [mm]"), of_vb(w)


@add("nose, flank and notch wear", READ, quiet=False)
def _(w):
    frame = w[["edge", "V", "f", "d", "t"]].assign(a=w["AW"] * 1.2, b=w["AW"] * 0.8, c=w["AW"])
    return table(frame, a="nose wear [mm]", b="flank wear [mm]", c="notch wear [mm]"), w[
        ["edge", "V", "f", "d", "t", "AW"]
    ]


@add(
    "three readings of the land", READ, REFUSED, DOUBTED, names="VB|VB1|VB2|VB3", quiet=False, check=lambda seen: False
)
def _(w):
    frame = w[["edge", "V", "f", "d", "t"]].assign(a=w["AW"] * 1.1, b=w["AW"] * 0.9, c=w["AW"])
    return table(frame, a="VB1 [mm]", b="VB2 [mm]", c="VB3 [mm]")


@add("mean and largest land", REFUSED, READ, names="VB|AW", quiet=False)
def _(w):
    frame = of_vb(w).assign(m=w["AW"] * 1.3)
    return table(frame, VB="VB [mm]", m="VBmax [mm]"), of_vb(w)


@add("cutting length and vf instead of time", READ, REFUSED, names="t", quiet=False)
def _(w):
    D = 80.0
    n = 1000 * w["V"] / (np.pi * D)
    frame = w[["edge", "V", "f", "d"]].assign(L=(w["t"] * w["f"] * n).round(1), n=n, AW=w["AW"])
    return table(frame, L="cut length [mm]", n="n [1/min]"), w[["edge", "V", "f", "d", "t", "AW"]]


# Cells


@add("one cell of wear x10", DOUBTED, names="AW")
def _(w):
    return table(changed(w[list(BASE)], [31], "AW", 10))


@add("one cell of wear x1000", DOUBTED, names="AW")
def _(w):
    return table(changed(w[list(BASE)], [52], "AW", 1000))


@add("one cell of wear x25.4", DOUBTED, names="AW")
def _(w):
    return table(changed(w[list(BASE)], [99], "AW", INCH))


@add("one cell of wear without its decimal mark", DOUBTED, names="AW")
def _(w):
    return table(changed(w[list(BASE)], [99], "AW", 10_000))


@add("one negative cell of wear", DOUBTED, READ, names="AW", quiet=False)
def _(w):
    return table(changed(w[list(BASE)], [70], "AW", -1)), w[list(BASE)].drop(index=70)


@add("one digit swapped in V", DOUBTED, names="V")
def _(w):
    row = w.index[w["V"] == 120][8]
    return table(changed(w[list(BASE)], [row], "V", lambda x: 210.0))


@add("one cell of f x10", DOUBTED, names="f")
def _(w):
    return table(changed(w[list(BASE)], [14], "f", 10))


@add("three rows of wear in inches", DOUBTED, names="AW")
def _(w):
    return table(changed(w[list(BASE)], [10, 65, 130], "AW", 1 / INCH))


@add("f in inches on 4 edges", DOUBTED, names="f")
def _(w):
    return table(changed(w[list(BASE)], of_edges(w, [3, 9, 15, 22]), "f", 1 / INCH))


@add("V in sfm on 4 edges", DOUBTED, names="V")
def _(w):
    return table(changed(w[list(BASE)], of_edges(w, [4, 11, 12, 20]), "V", 3.2808))


@add("t in seconds on 3 edges", DOUBTED, names="t")
def _(w):
    return table(changed(w[list(BASE)], of_edges(w, [1, 8, 19]), "t", 60))


@add("wear in um on 2 edges", DOUBTED, REFUSED, names="AW", check=lambda seen: False)
def _(w):
    return table(changed(w[list(BASE)], of_edges(w, [5, 6]), "AW", 1000))


@add("a row shifted by one cell", DOUBTED, REFUSED, names="V|f|d|t|AW|line", corrected=plain)
def _(w):
    rows = cells(w[list(BASE)])
    rows[44] = [rows[44][0], "", *rows[44][1:-1]]
    return text(headed(w[list(BASE)]), rows)


@add("a row shifted by one cell at its end", REFUSED, DOUBTED, names="line", corrected=plain)
def _(w):
    rows = cells(w[list(BASE)])
    rows[44] = [rows[44][0], "", *rows[44][1:]]
    return text(headed(w[list(BASE)]), rows)


@add("the wear column shifted by a row", DOUBTED, names="AW|t")
def _(w):
    return table(w[list(BASE)].assign(AW=np.roll(w["AW"], 1)))


@add("the wear column sorted", DOUBTED, READ, names="AW", check=lambda seen: True)
def _(w):  # nothing in the file shows it but the scatter: the checks of the fit judge it
    return table(w[list(BASE)].assign(AW=np.sort(w["AW"])))


# Other tables


def life(w):
    """Lives to 0.3 mm of each edge."""
    one = w.drop_duplicates("edge")
    rng = np.random.default_rng(1)
    T = 3000 * one["V"] ** -1.6 * one["f"] ** -0.7 * one["d"] ** -0.5 * np.exp(rng.normal(0, 0.1, len(one)))
    return pd.DataFrame({"edge": one["edge"], "V": one["V"], "f": one["f"], "d": one["d"], "T": T.round(2)})


def has_lives(seen):
    """Whether lives, speeds, feeds and depths were read."""
    return seen.runs is not None and all(seen.runs.has(name) for name in "VfdT") and len(seen.runs) == 24


@add("a tool-life table", READ, check=has_lives)
def _(w):
    return table(life(w))


@add("a tool-life table with run-outs", READ, check=has_lives, quiet=False)
def _(w):
    frame = life(w)
    rows = [[*row[:4], "2.0+" if float(row[4]) > 2 else row[4]] for row in cells(frame)]
    return text(headed(frame), rows)


@add("three forces at 1 kHz", REFUSED, names="fitmodels reduce", check=lambda seen: False)
def _(w):
    rng = np.random.default_rng(3)
    t = np.arange(8000) / 1000
    cut = ((t > 1.5) & (t < 6.5)).astype(float)
    frame = pd.DataFrame({"t": t, **{n: (cut * F + rng.normal(0, 5, len(t))).round(2)
                                     for n, F in (("Fx", 320.0), ("Fy", 610.0), ("Fz", 240.0))}})  # fmt: skip
    return table(frame, t="Time (s)", Fx="Fx (N)", Fy="Fy (N)", Fz="Fz (N)")


@add("a record of spindle current", REFUSED, names="fitmodels ident|fitmodels reduce", check=lambda seen: False)
def _(w):
    rng = np.random.default_rng(4)
    t = np.arange(3000) / 10
    frame = pd.DataFrame({"t": t, "I": (2 + rng.normal(0, 0.05, len(t))).round(3)})
    return table(frame, t="time [s]", I="current [A]")


@add("wide: a column of wear for each edge", READ, REFUSED, names="edge|shape|row|rows", quiet=False, remedy=False)
def _(w):
    one = w.drop_duplicates("edge")
    wear = w.pivot_table(index="t", columns="edge", values="AW", sort=False)
    rows = [["V [m/min]", *map(show, one["V"])], ["f [mm/rev]", *map(show, one["f"])], ["d [mm]", *map(show, one["d"])]]
    rows += [[show(t), *map(show, row)] for t, row in zip(wear.index, wear.to_numpy(), strict=True)]
    return text(["edge", *one["edge"]], rows), w[["edge", "V", "f", "d", "t", "AW"]]


@add("wide: a column of wear for each time", READ, REFUSED, names="t|time|shape|row|rows", quiet=False, remedy=False)
def _(w):
    one = w.drop_duplicates("edge")[["edge", "V", "f", "d"]]
    wear = w["AW"].to_numpy().reshape(24, 6)
    rows = [[*row, *map(show, land)] for row, land in zip(cells(one), wear, strict=True)]
    names = [f"VB [mm] at {t:g} min" for t in w["t"][:6]]
    return text(["edge", "V [m/min]", "f [mm/rev]", "ap [mm]", *names], rows), of_vb(w)


@add("wide: times as headers below a title", READ, REFUSED, names="t|time|shape|row|rows", quiet=False, remedy=False)
def _(w):
    one = w.drop_duplicates("edge")[["edge", "V", "f", "d"]]
    wear = w["AW"].to_numpy().reshape(24, 6)
    rows = [[*row, *map(show, land)] for row, land in zip(cells(one), wear, strict=True)]
    return text(["edge", "V [m/min]", "f [mm/rev]", "d [mm]", *(show(t) for t in w["t"][:6])], rows,
                above=[",,,,VB [mm] after t [min]"]), of_vb(w)  # fmt: skip


@add(
    "blocks: a heading row for each test",
    READ,
    REFUSED,
    names="test|block|blocks|shape|row|rows|heading",
    quiet=False,
    remedy=False,
)
def _(w):
    lines = []
    for number, (_, part) in enumerate(w.groupby("edge", sort=False), start=1):
        V, f, d = part.iloc[0][["V", "f", "d"]]
        lines += [f"Test {number}: V = {V:g} m/min; f = {f:g} mm/rev; ap = {d:g} mm", "t [min],VB [mm]"]
        lines += [f"{show(t)},{show(AW)}" for t, AW in zip(part["t"], part["AW"], strict=True)] + [""]
    return "\n".join(lines) + "\n", of_vb(w)
