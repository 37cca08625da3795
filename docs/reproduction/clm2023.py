"""CLM-2023 in the ledger: Tai, Tsai & Li 2023, IEEE Access, doi 10.1109/ACCESS.2023.3330587."""

import numpy as np
from entry import Entry
from fitmodels.controllers.constant_load_milling.cut_model import CutModel
from fitmodels.controllers.constant_load_milling.mixed_path import mixed_run
from fitmodels.controllers.constant_load_milling.plant import MillingCut
from fitmodels.controllers.constant_load_milling.runs import ToolRun, constant_feed_run, constant_load_run
from fitmodels.parameters import ParameterFile
from fitmodels.parameters.checks.loop_figures import closed_loop, figures
from fitmodels.parameters.published import milling
from scipy.integrate import quad
from scipy.stats import norm

TABLE_1 = ("214.30", "175.29", "192.34", "198.59", "205.80")
TABLE_2 = ("194.53", "178.89", "195.69")
ON_LINE = (
    "load line of the file: A by three printed points, k1/B by the points held at 0.24 A, those of the tables included"
)
WEAR = "VB = r t with r from the printed life at constant feed and an assumed criterion"


def entries() -> list[Entry]:
    """Every number of the paper that can be computed, and those that cannot."""
    end, slot = milling.end_milling(), milling.slot_milling()
    runs = {pf.identity.setup: (constant_load_run(pf), constant_feed_run(pf)) for pf in (end, slot)}
    of_end, of_slot = runs[end.identity.setup], runs[slot.identity.setup]
    return [
        *_settings(end, slot),
        *_points(end, slot),
        *_gains(end, slot),
        *_held("Section III.B.1 and Fig. 9, end milling", end, of_end[0], "0.239", "7.6"),
        *_held("Section III.B.2 and Fig. 12, slot milling", slot, of_slot[0], "0.240", "7.5"),
        *_reached(of_end[0], of_slot[0]),
        *_tables(of_end[0], of_slot[0]),
        *_end_gain(*of_end),
        *_slot_gain(*of_slot),
        *_conclusion(*of_end, *of_slot),
        *_mixed(slot),
    ]


def _settings(end: ParameterFile, slot: ParameterFile) -> list[Entry]:
    line, of_end, of_slot = end.load_line, CutModel.from_parameters(end), CutModel.from_parameters(slot)
    product = line.safety_factor * line.worn
    return [
        Entry("Section III.A.1", "reference current, 0.85 x 0.28 A", "0.24", round(product, 2), "A", "reproduced",
              f"the product is {product:.3f} A, rounded", "identity"),
        Entry("Section III.A.1", "safety factor, 1/0.85", "1.17", 1 / line.safety_factor, "", "reproduced",
              "truncated after two decimals", "identity"),
        Entry("Section III.A.1", "upper limit, feed of a sharp tool at 0.24 A, end", "1000", _feed(of_end, 0.0),
              "mm/min", "reconstructed", "the line goes through this point", "identity"),
        Entry("Section III.A.2", "feed of a sharp tool at 0.24 A, slot", "600", _feed(of_slot, 0.0), "mm/min",
              "reconstructed", "the line goes through this point; the limit was raised to 700", "identity"),
        Entry("Section III.A.1", "lower limit, feed at 0.24 A and VB 200 um, the middle of the window, end", "600",
              _feed(of_end, 200.0), "mm/min", "reconstructed", ON_LINE, "identity"),
        Entry("Section III.A.2", "lower limit, feed at 0.24 A and VB 185 um, slot", "500", _feed(of_slot, 185.0),
              "mm/min", "reconstructed", ON_LINE, "identity"),
    ]  # fmt: skip


def _points(end: ParameterFile, slot: ParameterFile) -> list[Entry]:
    of_end, of_slot = CutModel.from_parameters(end), CutModel.from_parameters(slot)
    chipped = (0.298 - of_end.A - 1000 * of_end.B) / of_end.k1
    odd = (0.282 - of_slot.A - 800 * of_slot.B) / of_slot.k1
    return [
        Entry("Section III.A.1", "VB at 700 mm/min and 0.24 A, end", "167.3", _wear(of_end, 0.24, 700), "um",
              "reconstructed", ON_LINE + "; no line goes through all of them", "identity"),
        Entry("Section III.A.1", "current at 600 mm/min and VB 205.1 um, end", "0.236",
              of_end.A + 600 * of_end.B + 205.1 * of_end.k1, "A", "reconstructed",
              "the same tool wear was held at 0.24 A in Table 1 (198.59 and 205.80 um): the points scatter by 2 %",
              "identity"),
        Entry("Section III.A.2", "VB at 500 mm/min and 0.24 A, slot", "180~190", _wear(of_slot, 0.24, 500), "um",
              "reconstructed", ON_LINE, "identity"),
        Entry("Fig. 6", "VB on chipping at 1000 mm/min and 0.298 A, end", "220-230", chipped, "um", "derived",
              "by the line, which this point did not enter; the range is that of section II.G"),
        Entry("Section III.A.2", "VB on chipping at 800 mm/min and 0.282 A, slot", "not printed", odd, "um", "derived",
              "by the line a sharp tool: the idle current of end milling, assumed for slot milling, is too low for "
              "this point", "assumption"),
        Entry("Section II.G", "wear window", "180-220", None, "um", "not computable", "chosen from photographs"),
    ]  # fmt: skip


def _gains(end: ParameterFile, slot: ParameterFile) -> list[Entry]:
    why = (
        "Kp 160 and Ki 0.006 without units, read as eq. 16 is worded, in mm/min and per sample, with a moving average "
        "of 10 samples (assumed) and the scaling G(1)/B"
    )
    found = []
    for name, pf in (("end", end), ("slot", slot)):
        metrics = figures(closed_loop(pf.dynamics, pf.pi))
        place = f"Section III.B, {name} milling, {pf.pi.scaling_u:.0f} (mm/min)/V"
        found += [
            Entry(place, "rise time", "at most 2", metrics["rise_time"], "s", "reconstructed", why + "; it is met"),
            Entry(
                place, "settling time", "at most 4", metrics["settling_time"], "s", "reconstructed", why + "; it is met"
            ),
            Entry(place, "steady error", "0", metrics["steady_error"], "", "reconstructed", why),
        ]
    unit = {"kp": 1.0, "ki": 0.0, "form": "position", "average": 1, "scaling_u": 1.0}
    bare = figures(closed_loop(end.dynamics, end.pi.model_copy(update=unit)))["gain_margin"]
    hint = closed_loop(end.dynamics, end.pi.model_copy(update={"scaling_u": 100.0})).radius
    found += [
        Entry("Section III.B", "Kp, taken in V/A", "160", None, "", "not computable",
              f"eq. 18 is unstable with a proportional gain above {bare:.3f} V/A: 160 has another unit, not printed"),
        Entry("Section II.H", "feed of the chirp of 2.5 V", "250-750", None, "mm/min", "not computable",
              "it would make 1 V 100 mm/min; the load line and G(1) make it "
              f"{CutModel.from_parameters(end).scaling:.0f}, and at 100 the loop is "
              f"{'stable' if hint < 1 else 'not stable'}: G and load line do not agree in gain"),
        Entry("Eq. 18", "gain of G at rest (4 decimals allow 0.1685-0.1941)", "not printed",
              end.dynamics.dc_gain, "A/V", "reconstructed",
              "by the printed coefficients; 2.5 V would be more current than any in the paper"),
    ]  # fmt: skip
    return found


def _held(place: str, pf: ParameterFile, run: ToolRun, mean: str, spread: str) -> list[Entry]:
    one, ref = run.passes[1], run.reference
    n = round(one.time / float(run.trace.time[1]))
    noise = float(spread) / 100 * ref / mean_range(n)
    noisy = constant_load_run(pf, plant=MillingCut.from_parameters(pf, noise=noise)).passes[1]
    return [
        Entry(place, "mean current from 150 to 300 mm", mean, one.mean_load, "A", "reconstructed",
              "within 1 % of the reference in both; ours lies above it by the lag behind the wear"),
        Entry(place, "standard deviation of the current's noise", "not printed", 1000 * noise, "mA", "derived",
              f"{spread} % of {ref:g} A is the range of {n} readings at 50 Hz, which is {mean_range(n):.2f} standard "
              "deviations of white, normal noise on average: both assumed", "assumption"),
        Entry(place, "largest less smallest current of that pass", spread, 100 * noisy.spread / ref, "%",
              "reconstructed", f"replayed with that noise, one seed; without noise it is "
              f"{100 * one.spread / ref:.4f} %", "identity"),
        Entry(place, "largest deviation of a pass's mean until the lower limit, after 4 s", "within 1",
              100 * abs(run.worst_mean), "%", "reproduced", "printed as a bound, and kept by the replay without noise",
              "assumption"),
    ]  # fmt: skip


def _reached(end: ToolRun, slot: ToolRun) -> list[Entry]:
    return [
        Entry(place, "cutting length at which the feed comes to the lower limit", printed, _limit_at(run), "mm",
              "reconstructed", f"inside the printed stretch; {WEAR}")
        for place, printed, run in (
            ("Fig. 10, end milling", "2000~2400", end), ("Fig. 13, slot milling", "1500~2000", slot),
        )
    ]  # fmt: skip


def _tables(end: ToolRun, slot: ToolRun) -> list[Entry]:
    found = []
    for table, rows, mean, below, run in (
        ("Table 1", TABLE_1, "197.26", "4.71", end), ("Table 2", TABLE_2, "189.70", "1.11", slot),
    ):  # fmt: skip
        values = [float(row) for row in rows]
        sd = float(np.std(values, ddof=1))
        outside = 1 - float(norm.cdf(220, np.mean(values), sd) - norm.cdf(180, np.mean(values), sd))
        found += [
            Entry(f"{table}, test {i}", "VB at the lower limit", row, run.wear, "um", "reconstructed",
                  f"replayed; the tool is {(float(row) - run.wear) / sd:+.1f} standard deviations of tools from it; "
                  f"{ON_LINE}", "identity") for i, row in enumerate(rows, 1)
        ]  # fmt: skip
        found += [
            Entry(table, "standard deviation of VB at the tool changes", "not printed", sd, "um", "derived",
                  f"of {len(rows)} tools, {len(rows) - 1} degrees of freedom"),
            Entry(table, "share of tools outside the window of 180 to 220 um", "not printed", 100 * outside, "%",
                  "derived", f"of a normal distribution with the mean and standard deviation of the tools; 1 of "
                  f"{len(rows)} was outside", "assumption"),
        ]  # fmt: skip
        found += [
            Entry(table, "average of the tests", mean, sum(values) / len(values), "um", "reproduced", kind="identity"),
            Entry(table, "test 2 below the window", below, 180.0 - values[1], "um", "reproduced", kind="identity"),
            Entry(table, "VB at the tool change, replayed", mean, run.wear, "um", "reconstructed",
                  f"{ON_LINE}; the command rests 4 s on the limit (assumed)", "identity"),
        ]  # fmt: skip
    return found


def _end_gain(run: ToolRun, fixed: ToolRun) -> list[Entry]:
    place = "Section III.D.1"
    return [
        Entry(place, "life at constant load", "2250", run.length, "mm", "reconstructed", f"{WEAR} of 200 um"),
        Entry(place, "life at 700 mm/min", "1800", fixed.length, "mm", "reconstructed", "it fixed r", "identity"),
        Entry(place, "gain of life, 2250/1800", "25", 100 * (2250 / 1800 - 1), "%", "reproduced", kind="identity"),
        Entry(place, "gain of life, replayed", "25", _gain(run.length, fixed.length), "%", "reconstructed",
              f"{WEAR}: with wear by time alone life and removal gain alike, and the mean feed is "
              f"{run.mean_feed:.0f} mm/min; the paper's 2250 mm would need slower wear at constant load"),
        Entry(place, "MRR at constant load", "3.79", run.rate, "mm3/s", "reconstructed",
              f"3.79 is a mean feed of {3.79 * 60 / 0.28:.0f} mm/min; the line gives {run.mean_feed:.0f}"),
        Entry(place, "MRR at 700 mm/min, ae 1.4, ap 0.2", "3.26", fixed.rate, "mm3/s", "reproduced",
              "700 x 1.4 x 0.2 / 60; truncated after two decimals", "identity"),
        Entry(place, "gain of MRR, 3.79/3.26", "16", _gain(3.79, 3.26), "%", "reproduced", kind="identity"),
        Entry(place, "gain of MRR, replayed", "16", _gain(run.rate, fixed.rate), "%", "reconstructed", ON_LINE),
    ]  # fmt: skip


def _slot_gain(run: ToolRun, fixed: ToolRun) -> list[Entry]:
    place = "Section III.D.2"
    return [
        Entry(place, "life at constant load", "1950", run.length, "mm", "reconstructed", f"{WEAR} of 185 um"),
        Entry(place, "life at 400 mm/min", "1350", fixed.length, "mm", "reconstructed", "it fixed r", "identity"),
        Entry(place, "gain of life, 1950/1350", "44", 100 * (1950 / 1350 - 1), "%", "reproduced", kind="identity"),
        Entry(place, "gain of life, replayed", "44", _gain(run.length, fixed.length), "%", "reconstructed", WEAR),
        Entry(place, "MRR at constant load", "3.93", run.rate, "mm3/s", "reconstructed",
              f"3.93 is a mean feed of {3.93 * 60 / 0.4:.0f} mm/min, above the {run.mean_feed:.0f} of a tool that goes "
              "from 600 to 500; test 1 cut less deep and faster, as the paper states"),
        Entry(place, "MRR at 400 mm/min, full width of 2 mm, ap 0.2", "2.53", fixed.rate, "mm3/s",
              "corrected with proof", "400 x 2.0 x 0.2 / 60"),
        Entry(place, "gain of MRR, 3.93/2.53", "55", _gain(3.93, 2.53), "%", "reproduced", "of the misprinted 2.53",
              "identity"),
        Entry(place, "gain of MRR, 3.93 over the removal at 400 mm/min", "55", _gain(3.93, fixed.rate), "%",
              "corrected with proof", "with the misprint corrected"),
        Entry(place, "gain of MRR, replayed", "55", _gain(run.rate, fixed.rate), "%", "reconstructed", ON_LINE),
    ]  # fmt: skip


def _conclusion(end: ToolRun, end_fixed: ToolRun, slot: ToolRun, slot_fixed: ToolRun) -> list[Entry]:
    return [
        Entry("Conclusion", "gain of life, end", "23", 100 * (2250 / 1800 - 1), "%", "corrected with proof",
              f"the body's 2250 and 1800 mm; replayed {_gain(end.length, end_fixed.length):.0f} %"),
        Entry("Conclusion", "gain of MRR, end", "16", _gain(3.79, end_fixed.rate), "%", "reproduced",
              f"the body's 3.79 over 700 mm/min; replayed {_gain(end.rate, end_fixed.rate):.0f} %", "identity"),
        Entry("Conclusion", "gain of MRR, slot", "51", _gain(3.93, slot_fixed.rate), "%", "corrected with proof",
              f"the body's 3.93 over 400 mm/min; replayed {_gain(slot.rate, slot_fixed.rate):.0f} %"),
        Entry("Conclusion", "gain of life, slot", "30", 100 * (1950 / 1350 - 1), "%", "corrected with proof",
              f"the body's 1950 and 1350 mm; replayed {_gain(slot.length, slot_fixed.length):.0f} %"),
    ]  # fmt: skip


def _mixed(slot: ParameterFile) -> list[Entry]:
    run = mixed_run([slot, milling.end_milling(upper=1100.0)])
    why = (
        "slot and end passes of 150 mm in turn (the path's lengths are not printed), each wearing as by itself; slot "
        "milling comes to its limit first"
    )
    sd = _pooled_sd()
    return [
        Entry(f"Section III.E, Table 3, workpiece {number}", "VB at the lower limit, mixed path", printed, run.wear,
              "um", "reconstructed", f"{why}; {(float(printed) - run.wear) / sd:+.1f} standard deviations of the tools "
              f"of Tables 1 and 2 ({sd:.1f} um, pooled) from it")
        for number, printed in ((1, "179.48"), (2, "199.63"))
    ]  # fmt: skip


def _pooled_sd() -> float:
    """Standard deviation of one tool's VB at the tool change, um: both tables, each about its own mean."""
    values = [np.array([float(row) for row in rows]) for rows in (TABLE_1, TABLE_2)]
    squares = sum(float(((one - one.mean()) ** 2).sum()) for one in values)
    return float(np.sqrt(squares / sum(len(one) - 1 for one in values)))


def mean_range(n: int) -> float:
    """Mean range of n independent readings of a normal distribution, in standard deviations (d2 of control charts).

    >>> round(mean_range(2), 3), round(mean_range(25), 3)
    (1.128, 3.931)
    """
    return float(quad(lambda x: 1 - norm.cdf(x) ** n - norm.sf(x) ** n, -12, 12, limit=400)[0])


def _feed(cut: CutModel, wear: float) -> float:
    return (0.24 - cut.A - cut.k1 * wear) / cut.B


def _wear(cut: CutModel, load: float, feed: float) -> float:
    return (load - cut.A - cut.B * feed) / cut.k1


def _gain(ours: float | None, theirs: float | None) -> float:
    return 100 * (ours / theirs - 1)


def _limit_at(run: ToolRun) -> float:
    """Cutting length in mm at which the command first came to its lower limit."""
    first = next(p for p in run.passes if p.limited)
    rows = (run.trace.recorded["number"] == first.number) & (run.trace.recorded["in_cut"] > 0)
    low = run.trace.command[rows].min()
    at = (run.trace.command[rows] <= low + 1e-9).argmax()
    return float(run.trace.recorded["length"][rows][at])
