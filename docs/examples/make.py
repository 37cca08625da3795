"""Write the example files of the documentation: ``python docs/examples/make.py``.

Every file is simulated and states this in its first line. The tests compare the files with the output of this script.
"""

import csv
from functools import partial
from io import StringIO
from pathlib import Path

import numpy as np
from fitmodels import datasets, ident
from fitmodels.controllers.adaptive_force.plant import DriveAndCut
from fitmodels.parameters.published import published

HERE = Path(__file__).parent
HEADERS = (
    *("Schneide", "Schnittgeschwindigkeit vc", "Vorschub f", "Schnitttiefe ap"),
    *("Zeit", "VB", "Leistung", "Bemerkung"),
)
TIMES = (4, 8, 12, 16, 20)  # min, the sub-tests in the workshop file
SENSOR_SD = 0.002  # A, of the current clamp


def workshop() -> list[list[str]]:
    """The bundled simulated tests in the layout of a German workshop."""
    runs = datasets.read_runs(datasets.bundled("gc435_709m40")).data
    rows = [
        ["# simuliert (simulated): keine Messung; aus den Gesetzen von Alaskari & Oraby 2016"],
        ["# Werkzeug: GC435"],
        ["# Werkstoff: 709M40"],
        list(HEADERS),
        ["", "m/min", "mm/U", "mm", "min", "µm", "kW", ""],
    ]  # fmt: skip
    for row in runs[runs["t"].isin(TIMES)].itertuples():
        numbers = (row.V, row.f, row.d, row.t, 1000 * row.AW, row.P)
        digits = (f"{value:.4g}".replace(".", ",") for value in numbers)
        rows.append([row.edge, *digits, "Span lang" if row.f < 0.1 and row.t == TIMES[0] else ""])
    return rows


def further() -> list[list[str]]:
    """Six more rows on two edges, drawn from the published law of wear with its scatter of 10 %."""
    rows = [
        ["# simuliert (simulated): keine Messung"],
        ["Schneide", "vc [m/min]", "f [mm/U]", "ap [mm]", "t [min]", "VB [µm]"],
    ]
    noise = np.random.default_rng(24)
    for edge, V, f, d in (("N01", 80, 0.25, 2.0), ("N02", 160, 0.15, 2.5)):
        for t in (5, 10, 15):
            wear = 7.62 * V**0.577 * f**0.168 * d**0.248 * t**0.245 * np.exp(0.1 * noise.standard_normal())
            rows.append([edge, str(V), f"{f}".replace(".", ","), f"{d}".replace(".", ","), str(t), f"{wear:.0f}"])
    return rows


def inches() -> list[list[str]]:
    """A part of the tests in sfm, ipr and inches, without an edge column."""
    runs = datasets.read_runs(datasets.bundled("gc435_709m40")).data
    rows = [["# simulated: no measurement"], ["SFM", "feed (ipr)", "DOC (in)", "time (min)", "VB (in)", "power (hp)"]]
    for row in runs[runs["t"].isin((10, 20))].itertuples():
        values = (row.V / 0.3048, row.f / 25.4, row.d / 25.4, row.t, row.AW / 25.4, row.P / 0.745700)
        rows.append([f"{value:.4g}" for value in values])
    return rows


def drive(seed: int) -> list[list[str]]:
    """A chirp of 15 s on the published drive (Tai, Tsai & Li 2023, eq. 17 and 18) with sensor noise."""
    plant = published("CLM-2023").dynamics
    u = np.round(ident.chirp(amplitude=2.5, f0=0.1, f1=2.0, duration=15, rate=50), 4)
    y = np.asarray(plant.simulate(u)) + SENSOR_SD * np.random.default_rng(seed).standard_normal(u.size)
    rows = [["# simulated: no measurement; Tai, Tsai & Li 2023, doi 10.1109/ACCESS.2023.3330587, eq. 17 and 18"]]
    rows.append(["time [s]", "command [V]", "current [A]"])
    rows += [[f"{0.02 * k:.2f}", f"{a:.4f}", f"{b:.4f}"] for k, (a, b) in enumerate(zip(u, y, strict=True))]
    return rows


def milling() -> list[list[str]]:
    """Spindle current over feed and wear as in end milling at constant load (the same paper, eq. 14)."""
    law = published("CLM-2023").laws["I"]
    noise = np.random.default_rng(14)
    rows = [["# simulated: no measurement; Tai, Tsai & Li 2023, doi 10.1109/ACCESS.2023.3330587, eq. 14"]]
    rows += [["# tool: AA238M-0200-D4-ML-10"], ["# work: S45C"], ["feed rate [mm/min]", "VB [um]", "I [A]"]]
    for wear in (20, 80, 140, 200):
        for feed in (500, 700, 900, 1100):
            current = float(law.values(fm=feed, VB=wear)) + 0.003 * noise.standard_normal()
            rows.append([str(feed), str(wear), f"{current:.3f}"])
    return rows


def workshop_milling() -> list[list[str]]:
    """The same milling tests in the layout of a German workshop: a tool column, an empty column, a row of units."""
    rows = [
        ["# simuliert (simulated): keine Messung; Tai, Tsai & Li 2023, doi 10.1109/ACCESS.2023.3330587, eq. 14"],
        ["Werkzeug", "Werkstoff", "Vorschubgeschwindigkeit", "Verschleißmarkenbreite VB", "Spindelstrom", ""],
        ["", "", "mm/min", "µm", "A", ""],
    ]
    for feed, wear, current in milling()[4:]:
        rows.append(["AA238M", "S45C", feed, wear, current.replace(".", ","), ""])
    return rows


SHOP = {  # tool -> work, edges, exponents of V, f and t
    "GC435": [("709M40", 12, 0.55, 0.19, 0.26), ("34CrNiMo6", 10, 0.61, 0.22, 0.24), ("C45", 12, 0.49, 0.17, 0.25)],
    "GC4225": [("C45", 10, 0.52, 0.21, 0.29), ("42CrMo4", 12, 0.57, 0.18, 0.23)],
    "K10": [("GG25", 12, 0.38, 0.25, 0.33), ("GGG40", 4, 0.44, 0.24, 0.31), ("GGG60", 10, 0.42, 0.21, 0.32)],
    "GC2025": [("316L", 12, 0.78, 0.30, 0.27), ("X5CrNi18-10", 10, 0.83, 0.33, 0.25)],
}


def of_a_shop(tool: str) -> list[list[str]]:
    """Wear of a tool on several materials, from assumed laws; with one file per tool."""
    noise = np.random.default_rng(sum(tool.encode()))
    metric = tool != "GC2025"
    speed, feed, wear = ("vc [m/min]", "f [mm/rev]", "VB [mm]") if metric else ("V (sfm)", "feed (ipr)", "VB (in)")
    rows = [["# simulated: no measurement"], ["tool", "material", "edge", speed, feed, "time [min]", wear]]
    for work, edges, *b in SHOP[tool]:
        for edge in range(1, edges + 1):
            V, f = 60 * 3.5 ** noise.random(), 0.1 * 4 ** noise.random()
            level = 0.05 * noise.standard_normal()
            for t in (4, 8, 14):
                scatter = np.exp(level + 0.06 * noise.standard_normal())
                VB = 0.16 * (V / 110) ** b[0] * (f / 0.2) ** b[1] * (t / 8) ** b[2] * scatter
                numbers = (V, f, t, VB) if metric else (V / 0.3048, f / 25.4, t, VB / 25.4)
                texts = (f"{value:.3g}" for value in numbers)
                rows.append([tool, work, str(edge), *(n.replace(".", ",") if tool == "GC435" else n for n in texts)])
    return rows


def pairs() -> list[list[str]]:
    """Material group and coolant of the materials of the shop."""
    steel, cast, stainless = (
        ("709M40", "34CrNiMo6", "C45", "42CrMo4"),
        ("GG25", "GGG40", "GGG60"),
        ("316L", "X5CrNi18-10"),
    )
    rows = [["work", "iso513", "coolant"]]
    rows += [[work, "P20", "dry" if work == "C45" else "emulsion"] for work in steel]
    rows += [[work, "K20", "dry"] for work in cast]
    return rows + [[work, "M20", "emulsion"] for work in stainless]


def step_record() -> list[list[str]]:
    """Steps of a servo with a lag of 0.12 s and a delay of 0.034 s at 50 Hz: command, speed, noise of the sensor."""
    t = np.arange(400) / 50
    u = np.where(t % 4 < 1, 0.0, np.where(t % 4 < 2.5, 2.0, 1.0))
    y = np.zeros_like(t)
    for at, size in zip(t[1:], np.diff(u), strict=True):
        y += 30 * size * -np.expm1(-np.maximum(t - at - 0.034, 0) / 0.12)
    y += 0.4 * np.random.default_rng(21).standard_normal(t.size)
    rows = [["# simulated: no measurement"], ["time [s]", "command [V]", "feed rate [mm/s]"]]
    return rows + [[f"{a:.2f}", f"{b:.1f}", f"{c:.2f}"] for a, b, c in zip(t, u, y, strict=True)]


def force_chirp() -> list[list[str]]:
    """A cut 2 mm deep at 3000 1/min under a chirp of the feed at 250 Hz: assumed drive and cut, ripple, noise."""
    u = np.round(250 + ident.chirp(amplitude=100, f0=0.1, f1=5, duration=10, rate=250), 1)
    plant, noise = DriveAndCut(depth=2.0, ripple=0.3, noise=2.0), np.random.default_rng(7)
    plant.force, plant.speed = 200.0, 250.0
    rows = [["# simulated: no measurement; drive and cut as assumed in fitmodels.controllers.adaptive_force.plant"]]
    rows.append(["time [s]", "feed rate [mm/min]", "force [N]"])
    F = [200.0, *(plant.step(float(command), 0.004, noise) for command in u[:-1])]
    return rows + [[f"{0.004 * k:.3f}", f"{a:.1f}", f"{b:.1f}"] for k, (a, b) in enumerate(zip(u, F, strict=True))]


CUTS = {"E01": (120, 0.2, (512.0, 534.0, 561.0)), "E02": (160, 0.3, (704.0, 741.0, 795.0))}  # V, f, forces in N


def force_record(edge: str) -> list[list[str]]:
    """A record of three cuts at 50 Hz: a drifting zero, ramps and a peak at the entry, noise."""
    noise = np.random.default_rng(int(edge[1:]))
    t = np.arange(1150) / 50
    force = 12 * t / t[-1] + 6 * noise.standard_normal(t.size)
    for k, mean in enumerate(CUTS[edge][2]):
        since = t - 2 - 7 * k
        shape = np.clip(since / 0.2, 0, 1) * np.clip((5 - since) / 0.2, 0, 1)
        force += mean * shape * (1 + 0.4 * np.exp(-(((since - 0.2) / 0.06) ** 2)))
    rows = [["# simulated: no measurement"], ["time [s]", "Fc [N]"]]
    return rows + [[f"{a:.2f}", f"{b:.1f}"] for a, b in zip(t, force, strict=True)]


def plan_of_records() -> list[list[str]]:
    """The table of tests that belongs to the records of forces."""
    rows = [["# simulated: no measurement"], ["edge", "V [m/min]", "f [mm/rev]", "d [mm]", "t [min]", "VB [mm]"]]
    for edge, (V, f, _) in CUTS.items():
        rows += [[edge, str(V), str(f), "2", str(t), f"{0.05 * (V / 120) * t**0.4:.3f}"] for t in (4, 8, 12)]
    return rows


def recorded_run() -> list[list[str]]:
    """Power at 1 Hz in ten cuts of 90 s by one edge, whose wear is 4 % and whose power 3 % above the published laws."""
    rows = [["# simulated: no measurement"], ["time [s]", "P [kW]", "V [m/min]", "f [mm/rev]", "state"]]
    noise, V, f, d, contact = np.random.default_rng(26), 200.0, 0.3, 2.0, 0.0
    for k in range(10 * 110 + 20):
        cutting, power = k % 110 >= 20 and k < 1100, 0.9
        if cutting:
            contact += 1 / 60
            wear = 1.04 * 0.00762 * V**0.577 * f**0.168 * d**0.248 * contact**0.245
            power += 1.03 * 0.14 * V**0.82 * f**0.627 * d**0.844 * contact**-0.049 * wear**0.342
        power *= np.exp(0.015 * noise.standard_normal())
        rows.append([str(k), f"{power:.3f}", f"{V:g}", f"{f:g}", "feed" if cutting else "idle"])
    return rows


FILES = {
    "edge-run.csv": (recorded_run, ","),
    **{f"records/{edge}.csv": (partial(force_record, edge), ",") for edge in CUTS},
    "records-plan.csv": (plan_of_records, ","),
    **{f"shop/{tool}.csv": (partial(of_a_shop, tool), ";" if tool == "GC435" else ",") for tool in SHOP},
    "shop-pairs.csv": (pairs, ","),
    "verschleiss.csv": (workshop, ";"),
    "neu.csv": (further, ";"),
    "inch.csv": (inches, ","),
    "drive.csv": (lambda: drive(18), ","),
    "drive-again.csv": (lambda: drive(19), ","),
    "force-chirp.csv": (force_chirp, ","),
    "servo-steps.csv": (step_record, ","),
    "milling.csv": (milling, ","),
    "fraesen.csv": (workshop_milling, ";"),
}


def text(name: str) -> str:
    """The text of an example file."""
    made, mark = FILES[name]
    out = StringIO()
    for row in made():
        out.write(row[0] + "\n") if len(row) == 1 else csv.writer(out, delimiter=mark, lineterminator="\n").writerow(
            row
        )
    return out.getvalue()


if __name__ == "__main__":
    for name in FILES:
        (HERE / name).parent.mkdir(exist_ok=True)
        (HERE / name).write_text(text(name), encoding="utf-8")
