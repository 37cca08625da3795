"""AC-2017, number by number: Alaskari and Oraby, Kuwait J. Sci. (accepted June 2017).

A column of a table is one entry, that of its worst row; numbers quoted in the text have their own entries.
"""

import csv

import numpy as np
from entry import Entry
from fitmodels import datasets
from fitmodels.controllers.loop import replay
from fitmodels.controllers.recursion.controller import TurningRecursion, WearingEdge
from fitmodels.controllers.recursion.from_file import life_laws
from fitmodels.controllers.recursion.laws import LifeLaws, Rules
from fitmodels.controllers.recursion.life import BySpeed, Life, by_speed, fixed_life, life_ratios, whole_life
from fitmodels.parameters.published import published

UNIT = {"V": "m/min", "f": "mm/rev", "P": "kW", "Fxz": "N", "MRR": "mm3/min"}  # the others are wear, mm
NO_PAIR = "The pair of the test is in a figure only; the text gives its speed and the ranges of feed and depth."
MEASURED = "Measured in the paper's own wear-time tests, whose rows and pairs are not printed."


def entries() -> list[Entry]:
    """Every number of the paper that can be computed, and those that cannot, with the reason."""
    laws = life_laws(published("AC-2017"))
    life = whole_life(laws, Rules(times="published"))
    return [
        *_equations(laws),
        *_search(life),
        *_table(life, 0, "ac2017_table1", "Table 1"),
        *_table(life, 1, "ac2017_table2", "Table 2"),
        *_sequence(life),
        *_verification(laws, life),
    ]


def _equations(laws: LifeLaws) -> list[Entry]:
    off = float(laws.wear(150.0, 0.58)) * 150**0.3  # with the printed exponent
    constants = [
        ("Eq. 5", "constant of AW at d 2.5 mm", "9.5641e-3", laws.wear),
        ("Eq. 6", "constant of P at d 2.5 mm", "0.30338", laws.power),
        ("Eq. 7", "constant of Fxz at d 2.5 mm", "106580", laws.force),
    ]
    rounded = "Rounded in print: Tables 1 and 2 need the unrounded constant."
    return [
        Entry("Eq. 1", "exponent of V in AW", "0.877", laws.wear.V, "", "corrected with proof",
              f"Misprint for 0.577, which eq. 5, every value of Tables 1 and 2 and AC-2016 have; by 0.877 the wear of "
              f"Table 1, row 11, would be {off:.3f} mm for 0.157219."),
        Entry("Eq. 1-3", "R2, SE and F of the three laws (9 numbers)", "0.84, 0.1, 831 ...", None, "", "not computable",
              "They need the measured rows, which are not printed."),
        *(Entry(place, words, shown, float(np.exp(terms.ln_c)), "", "reproduced", rounded)
          for place, words, shown, terms in constants if terms is not None),
        Entry("Eq. 8", "MRR over V f at d 2.5 mm", "2500", float(laws.mrr(1.0, 1.0)), "mm2 x 1000", "reproduced"),
        _left_out(laws, "Eq. 6", "P", "kW"),
        _left_out(laws, "Eq. 7", "Fxz", "N"),
    ]  # fmt: skip


def _left_out(laws: LifeLaws, place: str, name: str, unit: str) -> Entry:
    """Effect at Table 2, row 10, of the times omitted in eq. 6 and 7."""
    row = _rows("ac2017_table2")[9]
    terms = laws.power if name == "P" else laws.force
    assert terms is not None  # noqa: S101 - the paper's file has both
    ours = float(terms(float(row["V"]), float(row["f"]), 2.0, float(row["AW"])))
    return Entry(place, f"{name} at Table 2, row 10, with t^{terms.t:g} of its own law", row[name], ours, unit,
                 "corrected with proof", f"{place} omits t^{terms.t:g} of its own law; so do the "
                 "tables. 'published' computes as printed, 'full' with it.")  # fmt: skip


def _search(life: Life) -> list[Entry]:
    tried = life.surfaces(0).MRR.shape
    return [
        Entry("Results", "pairs tried in each interval", "1744", float(tried[0] * tried[1]), "", "reproduced"),
        Entry("Results", "speeds tried", "16", float(tried[0]), "", "reproduced"),
        Entry("Results", "feeds tried at each speed", "109", float(tried[1]), "", "reproduced"),
    ]


def _rows(name: str) -> list[dict[str, str]]:
    lines = [line for line in datasets.bundled(name).read_text("utf-8").splitlines() if not line.startswith("#")]
    return [{key.split(" [")[0]: cell for key, cell in row.items()} for row in csv.DictReader(lines)]


def _columns(table: BySpeed) -> dict[str, np.ndarray]:
    assert table.P is not None  # noqa: S101 - the paper's file limits both
    assert table.Fxz is not None  # noqa: S101
    return {
        "V": table.V, "f": table.f, "AW_past": np.full(len(table.V), table.before), "Wo_i": table.fresh_end,
        "Wo_i-1": table.fresh_start, "dAW": table.fresh_end - table.fresh_start, "AW": table.AW, "P": table.P,
        "Fxz": table.Fxz, "MRR": table.MRR,
    }  # fmt: skip


def _table(life: Life, k: int, name: str, place: str) -> list[Entry]:
    """An entry for each column: its row with the largest difference in units of the last digit."""
    rows, columns = _rows(name), _columns(by_speed(life, k))
    out = []
    for column in (column for column in columns if column in rows[0]):
        cells, ours = [row[column] for row in rows], columns[column]
        misprint = place == "Table 2" and column == "dAW"
        off = [abs(float(cell) - value) * 10 ** len(cell.partition(".")[2])
               for cell, value in zip(cells, ours, strict=True)]  # fmt: skip
        if misprint:
            out.append(_misprint(rows[0], float(ours[0])))
            off[0] = 0.0
        i = int(np.argmax(off))
        if off[i] > 1.0:
            raise SystemExit(f"{place}, {column}, row {i + 1}: printed {cells[i]}, computed {ours[i]:.9g}")
        why = f"Worst of {len(rows) - misprint} rows: {off[i]:.2f} units of the last digit."
        out.append(Entry(f"{place}, row {i + 1}", f"{column}, row of the largest difference", cells[i], float(ours[i]),
                         UNIT.get(column, "mm"), "reproduced", why))  # fmt: skip
    return out


def _misprint(row: dict[str, str], ours: float) -> Entry:
    difference = float(row["Wo_i"]) - float(row["Wo_i-1"])
    why = f"The two columns that it is the difference of give {difference:.5f}, and AW of the row agrees with that."
    return Entry("Table 2, row 1", "dAW", row["dAW"], ours, "mm", "corrected with proof", why)


def _sequence(life: Life) -> list[Entry]:
    """The pairs of minutes 1, 2 and 14 and the end, from a replay of the controller on an edge."""
    controller = TurningRecursion.from_parameters(published("AC-2017"))
    trace = replay(controller, WearingEdge(controller.laws), duration=7200, dt=60, until="worn out")
    V, f = trace.command[:-1].T
    end = (trace.first("worn out") or 0.0) / 60 + 1
    last = life.surfaces(13)
    without = life.grid.V[~last.allowed.any(axis=1)].max()
    first = by_speed(life, 0)
    out = [
        Entry("Table 1", "row of the pair that is chosen", "11", float(first.MRR.argmax() + 1), "", "reproduced"),
        Entry("Text, minute 1", "MRR of the pair chosen", "217500", float(life.MRR[0]), "mm3/min", "reproduced"),
        Entry("Text, minute 1", "AW of the pair chosen", "0.157219", float(life.AW[0]), "mm", "reproduced"),
        Entry("Text, minute 2", "MRR of the pair chosen", "203000", float(life.MRR[1]), "mm3/min", "reproduced"),
        Entry("Text, minute 14", "speed up to which no feed keeps the force limit", "100", float(without), "m/min",
              "reproduced"),
        Entry("Text, end of life", "interval in which every pair passes AW 0.3 mm", "15", end, "min", "reproduced"),
    ]  # fmt: skip
    for minute, speed, feed in ((1, "150", "0.58"), (2, "140", "0.58"), (14, "200", "0.205")):
        place = f"Text, minute {minute}"
        out.append(Entry(place, "V of the pair chosen", speed, float(V[minute - 1]), "m/min", "reproduced"))
        out.append(Entry(place, "f of the pair chosen", feed, float(f[minute - 1]), "mm/rev", "reproduced"))
    ends = (("lowest", "140", "0.205", np.min), ("highest", "200", "0.58", np.max))
    for word, speed, feed, end_of in ends:
        out.append(Entry("Discussion", f"{word} V of the life", speed, float(end_of(V)), "m/min", "reproduced"))
        out.append(Entry("Discussion", f"{word} f of the life", feed, float(end_of(f)), "mm/rev", "reproduced"))
    return out


def _verification(laws: LifeLaws, life: Life) -> list[Entry]:
    """The comparison with fixed pairs T1 to T9."""
    per_minute = {name: life_ratios(life, fixed_life(laws, V, f)).per_minute
                  for name, V, f in (("T1", 100.0, 0.06), ("T4", 100.0, 0.6), ("T8", 145.0, 0.6))}  # fmt: skip
    assumed = "Assumed pair: V {} m/min, f {} mm/rev, an end of the printed range, d 2.5 mm; the text gives V alone."
    fifteen = "counted with 15 minutes of the recursion, though its minute 15 finds no pair and is not cut"
    place = "Verification"
    more = "AC over {} per minute"
    unknown = [
        ("T2", "4.79", more), ("T3", "3.19", more), ("T5", "0.58", "{} over AC per minute"), ("T9", "1.61", more),
    ]  # fmt: skip
    return [
        Entry(place, more.format("T1"), "10.6", per_minute["T1"], "", "reconstructed", assumed.format(100, 0.06)),
        Entry(place, more.format("T4"), "1.06", per_minute["T4"], "", "reconstructed", assumed.format(100, 0.6)),
        Entry(place, "T8 over AC per minute", "0.73", None, "", "not computable",
              f"{NO_PAIR} Were it f 0.6 and d 2.5, AC over T8 would be {per_minute['T8']:.2f}: the other way round."),
        *(Entry(place, words.format(test), shown, None, "", "not computable", NO_PAIR)
          for test, shown, words in unknown),
        Entry(place, "AC over T4 in the whole life", "1.45", None, "", "not computable",
              f"{NO_PAIR} 1.06 x 15/11 is {1.06 * 15 / 11:.2f}: {fifteen}; with 14 it is {1.06 * 14 / 11:.2f}."),
        Entry(place, "AC over T8 in the whole life", "2.94", None, "", "not computable",
              f"{NO_PAIR} With a life of 7 min, almost half, 15/7 over 0.73 is {15 / 7 / 0.73:.2f}: also {fifteen}."),
        Entry(place, "AC over T9 in the whole life", "4.83", None, "", "not computable",
              f"{NO_PAIR} It is 1.61 x 3, while the lives in print, 15 and 6.25 min, make {1.61 * 15 / 6.25:.2f}."),
        Entry(place, "Fxz of T9 as the edge failed", "2690", None, "N", "not computable", MEASURED),
        Entry(place, "life of T4", "11", None, "min", "not computable", MEASURED),
        Entry(place, "life of T5", "15", None, "min", "not computable", MEASURED),
        Entry(place, "life of T9, which failed", "6.25", None, "min", "not computable", MEASURED),
    ]  # fmt: skip
