"""Bank of plants, noises and inputs for the choice of delay and orders by `ident.identify`, beside another version.

    python benchmarks/structure_bank.py run RESULTS.jsonl [--draws 40] [--seed 2026] [--pi-draws N] [--plants ...]
    python benchmarks/structure_bank.py table RESULTS.jsonl [--base EARLIER.jsonl]

``run`` appends one JSON line per record to its file and continues where an interrupted run ended. ``table`` prints the
aims, and the figures of a file beside those of the version before. Records are 15 s at 50 Hz, input a chirp of 0.1 to
2 Hz; four of the plants with three noises also have a PRBS and a sequence of steps as input.

    error       largest | |G| / |G true| - 1 | at 40 frequencies of the excited band
    reference   the same of a model with the true orders and delay (output error; ARX for equation noise)
    wild        error above 50 %, and above 1.5 times the reference of the same record; a refusal is wild
    step        largest error of the step response over its settling time (at most 10 s), in largest values of it
    covered     share of 40 frequencies where the 95 % band of |G| holds the true one; also of 20 times of the step
    PI good     a PI tuned on the identification meets its specification on the true plant; a refusal fails

A cell is a plant with a noise and an input. Its 90 % error shall be at most half of the version before, its median at
most 1.3 times; either may instead be at most 1.5 times the reference of that cell, which no choice of orders undercuts.
Figures over all leave out the cells whose reference is wild itself; they are listed beside their reference.
Backlash: the true plant is its linear part; the true gain of the band is that of the best linear approximation at the
amplitude of the record, the plant times the describing function of the backlash. No linear model of low order has its
constant phase, so the bands, which hold for a linear plant, cover less; the coverage of records whose verdict has a
reservation about a nonlinearity of the input is printed apart. Records that do not say so count with the others.
Source: Pintelon & Schoukens 2012, System Identification, section 3.4 (best linear approximation).
"""

import argparse
import json
import sys
import time
import zlib
from collections import defaultdict
from pathlib import Path

import numpy as np
from fitmodels.core.errors import FitError, IdentError
from fitmodels.datasets import Record
from fitmodels.ident import Model, chirp, identify, prbs, steps, tune_pi
from fitmodels.ident.estimators.least_squares import arx
from fitmodels.ident.estimators.prediction_error import output_error
from fitmodels.ident.pi import gain_search, robust_design
from fitmodels.ident.pi.robust_design import Plants, figures_by_plant
from fitmodels.ident.responses.confidence_bands import response_band, step_band
from fitmodels.ident.responses.spectra import excited_band

T = 0.02
MAP, DRAWS = 12, 200  # gains per axis and draws that choose: coarser than by default, for time
gain_search.ENOUGH, gain_search.IDLE = 1e-3, 4
robust_design.STATED = 400
WILD, TRUE_ORDER = 0.5, 1.5
LONGEST = 10.0  # s of a step response


def sampled(num, den, delay=0.0):
    """b, a of num(s) / den(s) with a zero-order hold and a delay in samples, by two exact holds of a fraction each."""
    from scipy.linalg import expm
    from scipy.signal import tf2ss

    A, B, C, _ = tf2ss(num, den)
    n = len(A)
    whole = int(np.ceil(delay - 1e-9))
    rest = whole - delay  # part of a sample during which the newer value acts

    def hold(h):
        both = expm(np.block([[A, B], [np.zeros((1, n + 1))]]) * h)
        return both[:n, :n], both[:n, n:]

    F, _ = hold(T)
    early, new = hold(rest * T)
    _, old = hold((1 - rest) * T)
    # x(k+1) = F x + early old u(k-whole) + new u(k-whole+1): the numerator by the impulse response
    x = np.zeros((n, 1))
    h = [0.0] * whole
    for k in range(2 * n + 3):
        x = F @ x + (new if k == 0 else 0) + (early @ old if k == 1 else 0)
        h.append((C @ x).item())
    a = np.poly(F)
    b = np.convolve(h, a)[: whole + n + 2]
    b[np.abs(b) < 1e-9 * np.abs(b).max()] = 0.0
    return np.trim_zeros(b, "b"), a


def two_modes():
    """Sum of two modes, 0.6 Hz with damping .15 and 1.5 Hz with damping .08, static gains .6 and .4."""
    w, v = 2 * np.pi * 0.6, 2 * np.pi * 1.5
    slow, fast = [1.0, 0.3 * w, w * w], [1.0, 0.16 * v, v * v]
    num = np.polyadd(0.6 * w * w * np.array(fast), 0.4 * v * v * np.array(slow))
    return sampled(num, np.polymul(slow, fast))


# coefficients in z^-1, and the specification of a PI: rise time, settling time (s), overshoot
PLANTS = {
    "CLM-2023 eq. 18": (([0.0, 0.0611, -0.1338, 0.0752], [1.0, -2.0311, 1.2104, -0.1655]), (2.0, 4.0, 0.02)),
    "lag .3 s, delay 2.5": (sampled([1.0], [0.3, 1.0], 2.5), (0.5, 1.2, 0.02)),
    "(.6, -.2)/(1, -.5)": (([0.0, 0.0, 0.6, -0.2], [1.0, -0.5]), (0.4, 1.0, 0.02)),
    "damped drive": (([0.0, 0.07688094, 0.07484726], [1.0, -1.77138815, 0.92311635]), (1.2, 3.0, 0.02)),
    "1/s(s+1)": (sampled([1.0], [1.0, 1.0, 0.0]), (5.0, 15.0, 0.1)),
    "lag 1 s, delay 12": (sampled([1.0], [1.0, 1.0], 12), (1.2, 2.6, 0.02)),
    "non-minimum phase": (sampled([-0.2, 1.0], np.poly([-2.0, -5.0, -10.0]) / 100), (1.2, 3.0, 0.02)),
    "1/(s+1)^5": (sampled([1.0], np.poly([-1.0] * 5)), (8.0, 20.0, 0.02)),
    "1/(.2s+1)^5": (sampled([1.0], np.poly([-5.0] * 5) / 3125), (1.6, 4.0, 0.02)),
    "lag .5 s, delay 30": (sampled([1.0], [0.5, 1.0], 30), (1.2, 3.5, 0.02)),
    "two modes": (two_modes(), (2.5, 8.0, 0.02)),
    "1/s, delay 8": (sampled([1.0], [1.0, 0.0], 8), (1.0, 4.0, 0.1)),
    "lag with backlash": (sampled([1.0], [0.3, 1.0], 3), (0.5, 1.2, 0.02)),
}
BACKLASH, AMPLITUDE = 0.1, 2.5  # whole width in amplitudes of the input, and the amplitude of the chirp
NONLINEAR = ("dead zone", "backlash", "saturation", "curvature")  # disturbances that are a nonlinearity of the input
NOISES = ("white 40 dB", "white 30 dB", "white 20 dB", "AR(.8)", "equation", "drift", "spikes", "line")
FEWER_PLANTS = ("CLM-2023 eq. 18", "lag .3 s, delay 2.5", "damped drive", "lag .5 s, delay 30")
FEWER_NOISES = ("white 30 dB", "AR(.8)", "equation")
LEVELS = (0.0, 1.0, -1.0, 2.0, 0.0, -2.0, 1.0, 0.0, 1.5, -0.5)
INPUTS = {
    "chirp": lambda: chirp(),
    "prbs": lambda: prbs(2.5, 15.0, 50.0, hold=0.2),
    "steps": lambda: steps(LEVELS, 1.5),
}
CELLS = tuple((plant, noise, "chirp") for plant in PLANTS for noise in NOISES) + tuple(
    (plant, noise, kind) for kind in ("prbs", "steps") for plant in FEWER_PLANTS for noise in FEWER_NOISES
)


def plant_of(name):
    b, a = PLANTS[name][0]
    return Model(b=b, a=a, nk=int(np.flatnonzero(b)[0]), sample_time=T)


def play(u, width):
    """Output of a backlash (play) of a whole width."""
    out, at = np.empty_like(u), 0.0
    for k, value in enumerate(u):
        at = min(max(at, value - width / 2), value + width / 2)
        out[k] = at
    return out


def describing_function(width, amplitude):
    """Gain and phase of a backlash for a sine of an amplitude: its fundamental, by simulation of the second period."""
    t = np.linspace(0, 4 * np.pi, 20_001)[:-1]
    late = slice(len(t) // 2, None)
    out = play(amplitude * np.sin(t), width)[late]
    return 2j * np.mean(out * np.exp(-1j * t[late])) / amplitude


def linear_gain(name, plant, f):
    """Gain (F,) of the best linear approximation of a plant at the amplitude of the record."""
    lost = describing_function(BACKLASH * AMPLITUDE, AMPLITUDE) if name == "lag with backlash" else 1.0
    return np.abs(lost * plant.response(f))


def noise_of(kind, plant, x, rng):
    """Noise of one record (N,), relative to the standard deviation of the output x."""
    from scipy.signal import lfilter

    n, size, white = len(x), float(np.std(x)), rng.standard_normal(len(x))
    if kind.startswith("white"):
        return size * 10 ** (-float(kind.split()[1]) / 20) * white
    quiet = size * 10 ** (-30 / 20)
    if kind == "AR(.8)":
        return quiet * 0.6 * lfilter([1.0], [1.0, -0.8], rng.standard_normal(n + 100))[100:]
    if kind == "equation":
        h = lfilter([1.0], plant.a, np.eye(1, n)[0])
        return quiet * lfilter([1.0], plant.a, white) / np.sqrt(np.mean(np.cumsum(h**2)))
    more = np.zeros(n)
    if kind == "drift":  # random walk, 10 % of the output rms on average
        more = 0.1 * size * np.cumsum(rng.standard_normal(n)) / np.sqrt((n + 1) / 2)
    elif kind == "spikes":  # 1 % of the samples, half to one and a half output rms
        at = rng.choice(n, n // 100, replace=False)
        more[at] = size * rng.uniform(0.5, 1.5, len(at)) * rng.choice([-1.0, 1.0], len(at))
    elif kind == "line":  # 10 % of the output rms, at any frequency above the band
        more = 0.1 * size * np.sqrt(2) * np.sin(2 * np.pi * (rng.uniform(3, 24) * T * np.arange(n) + rng.uniform()))
    return quiet * white + more


def record_of(cell, seed, draw):
    """Record of a cell and draw; its random numbers depend on nothing else."""
    name, noise, kind = cell
    rng = np.random.default_rng([seed, zlib.crc32("/".join(cell).encode()), draw])
    plant, u = plant_of(name), INPUTS[kind]()
    x = plant.simulate(play(u, BACKLASH * AMPLITUDE) if name == "lag with backlash" else u)
    return Record(u=u, y=x + noise_of(noise, plant, x, rng), sample_time=T)


def largest_gain_error(model, plant, f):
    return float(np.max(np.abs(np.abs(model.response(f) / plant.response(f)) - 1)))


def reference(rec, plant, noise, f):
    """Error of a model of the true orders and delay."""
    na, nb, nk = plant.na, plant.nb, plant.nk
    try:
        if noise == "equation":
            return largest_gain_error(arx(rec.centred(), na, nb, nk), plant, f)
        return largest_gain_error(output_error(rec.centred(), nb, na, nk, initial="offset"), plant, f)
    except IdentError:
        return None


def of_step(model, plant):
    """Largest error of the step response relative to its largest value, and the coverage of its band."""
    n = int(LONGEST / T)
    true = plant.simulate(np.ones(n))
    late = np.flatnonzero(np.abs(true - true[-1]) > 0.02 * np.abs(true).max())
    n = max(int(late[-1]) + 2, 25) if plant.stable else n // 2
    true = true[:n]
    error = float(np.max(np.abs(model.simulate(np.ones(n)) - true)) / np.abs(true).max())
    try:
        band = step_band(model, n * T)
    except (IdentError, FitError, ValueError):
        return error, None
    at = np.unique(np.linspace(plant.nk, n - 1, 20).astype(int))
    return error, float(np.mean((band.low[at] <= true[at]) & (true[at] <= band.high[at])))


def of_pi(found, name, plant, seed):
    """1 if a PI tuned on the identification meets its specification on the true plant, and the stated probability."""
    rise, settling, overshoot = PLANTS[name][1]
    try:
        pi = tune_pi(found, rise, settling, overshoot, n=MAP, draws=DRAWS, seed=seed)
        table = figures_by_plant(Plants((plant,)), pi.gains, pi.specification, pi.map.duration)
        return int(float(pi.specification.worst(table)[0]) <= 0), pi.robustness and pi.robustness.probability, ""
    except (IdentError, ValueError) as error:
        return 0, None, str(error)[:200]


def judged(cell, seed, draw, with_pi):
    """Figures of one record."""
    name, noise, _ = cell
    plant, rec = plant_of(name), record_of(cell, seed, draw)
    low, high = excited_band(rec)
    f = np.geomspace(low, high, 40)
    row = {"cell": cell, "seed": seed, "draw": draw, "reference": reference(rec, plant, noise, f)}
    begin = time.process_time()
    try:
        found = identify(rec)
    except (IdentError, ValueError, np.linalg.LinAlgError) as error:
        return {**row, "error": None, "refused": str(error)[:200], "pi": 0 if with_pi else None}
    model = found.model
    row |= {"seconds": time.process_time() - begin, "orders": [model.na, model.nb, model.nk]}
    row |= {"error": largest_gain_error(model, plant, f), "structure": model.structure}
    row["nonlinear"] = any(item.kind in NONLINEAR and item.level for item in found.disturbances.found)
    row["others"] = [[round(w, 3), m.na, m.nb, m.nk] for w, m in getattr(model, "alternatives", ())]
    row["step"], row["step_covered"] = of_step(model, plant)
    try:
        band, true = response_band(model, f), linear_gain(name, plant, f)
        row["covered"] = float(np.mean((band.gain_low <= true) & (true <= band.gain_high)))
    except (IdentError, ValueError):
        row["covered"] = 0.0
    if with_pi:
        row["pi"], row["stated"], row["pi_refused"] = of_pi(found, name, plant, draw)
    return row


def results(path):
    """Rows of a file by cell, seed and draw; the last of each counts."""
    if not path.exists():
        return {}
    rows = [json.loads(line) for line in path.read_text().splitlines() if line.endswith("}")]
    return {(tuple(row["cell"]), row["seed"], row["draw"]): row for row in rows}


def run(given):
    """Judge every record that the file lacks, with a line of progress each minute."""
    known = results(given.file)
    asked = [c for c in CELLS if all(w in "/".join(c) for w in given.only)]
    tasks = [(c, given.seed, d) for d in range(given.first, given.draws) for c in asked]
    tasks = [task for i, task in enumerate(tasks) if task not in known and i % given.of == given.part]
    begin = shown = time.monotonic()
    with given.file.open("a") as file:
        for i, (cell, seed, draw) in enumerate(tasks, 1):
            file.write(json.dumps(judged(cell, seed, draw, draw < given.pi_draws)) + "\n")
            file.flush()
            if time.monotonic() - shown > 60:
                shown = time.monotonic()
                left = (shown - begin) / i * (len(tasks) - i)
                print(f"{i} of {len(tasks)} records, about {left / 60:.0f} min left", file=sys.stderr, flush=True)
    table(given)


def by_cell(rows):
    grouped = defaultdict(list)
    for (cell, _, _), row in sorted(rows.items()):
        grouped[cell].append(row)
    return grouped


def errors(rows, name="error"):
    """One figure of all records; a refusal is infinite."""
    return np.array([np.inf if row.get(name) is None else row[name] for row in rows])


def wild(rows):
    e, ref = errors(rows), errors(rows, "reference")
    return (e > WILD) & ~(e <= TRUE_ORDER * ref)


def quantiles(values):
    return [float(np.quantile(values, q, method="higher")) for q in (0.5, 0.9)]


def mean(rows, name):
    found = [row[name] for row in rows if row.get(name) is not None]
    return float(np.mean(found)) if found else np.nan


def cell_line(cell, rows, base):
    """Figures of a cell, and whether its aims are met beside the version before."""
    (mid, high), (ref_mid, ref_high) = quantiles(errors(rows)), quantiles(errors(rows, "reference"))
    words = f"{cell[0]:20} {cell[1]:11} {cell[2]:5} {len(rows):4d} {100 * mid:7.2f} {100 * high:8.2f}"
    words += f" {100 * ref_mid:7.2f} {100 * ref_high:8.2f} {100 * wild(rows).mean():5.0f}"
    words += f" {100 * quantiles(errors(rows, 'step'))[1]:8.2f} {mean(rows, 'covered'):5.2f}"
    words += f" {mean(rows, 'step_covered'):5.2f} {mean(rows, 'pi'):5.2f}"
    if not base:
        return words, True, True
    before_mid, before_high = quantiles(errors(base))
    good_mid = mid <= max(1.3 * before_mid, TRUE_ORDER * ref_mid)
    good_high = high <= max(0.5 * before_high, TRUE_ORDER * ref_high)
    ratios = f" | {100 * before_mid:7.2f} {100 * before_high:8.2f} {mid / before_mid:6.2f} {high / before_high:6.2f}"
    words += ratios + f" {mean(base, 'covered'):5.2f} {mean(base, 'pi'):5.2f}"
    return words + ("" if good_mid else " median") + ("" if good_high else " 90%"), good_mid, good_high


HEAD = (
    f"{'plant':20} {'noise':11} {'input':5} {'n':>4} {'median':>7} {'90 %':>8} {'ref.':>7} {'ref.90':>8} {'wild':>5} "
    f"{'step 90':>8} {'cov.':>5} {'step':>5} {'PI':>5}"
)
BEFORE = f" | {'before':>7} {'90 %':>8} {'ratio':>6} {'ratio':>6} {'cov.':>5} {'PI':>5}  missed (errors in %)"


def summary(label, found, left_out):
    rows = list(found.values())
    tame = [row for row in rows if tuple(row["cell"]) not in left_out]
    linear = [row for row in tame if not row.get("nonlinear")]
    normal = [row for row in linear if row["cell"][1] != "equation"]
    equation = [row for row in linear if row["cell"][1] == "equation"]
    reserved = [row for row in tame if row.get("nonlinear")]
    mid, high = quantiles(errors(tame))
    print(f"\n{label}: {len(rows)} records, {sum(row['error'] is None for row in rows)} refused")
    print(f"   figures of |G| without {len(rows) - len(tame)} records of cells where the true order itself is wild")
    print(f"   error of |G| in the band: median {100 * mid:.2f} %, 90 % {100 * high:.2f} %")
    print(
        f"   wild {100 * wild(rows).mean():.1f} % (aim 2 %), in these cells {100 * (errors(tame) > WILD).mean():.1f} %"
    )
    step_mid, step_high = quantiles(errors(rows, "step"))
    print(f"   step error: median {100 * step_mid:.2f} %, 90 % {100 * step_high:.2f} %")
    print(
        f"   coverage of |G| {100 * mean(normal, 'covered'):.1f} % (aim 92 to 97), equation noise "
        f"{100 * mean(equation, 'covered'):.1f} % (aim 88); of the step {100 * mean(rows, 'step_covered'):.1f} %"
    )
    if reserved:
        print(
            f"   apart: {len(reserved)} records with a reservation about a nonlinearity of the input, coverage "
            f"{100 * mean(reserved, 'covered'):.1f} %; with them {100 * mean(tame, 'covered'):.1f} %"
        )
    tuned = [row for row in rows if row.get("pi") is not None]
    if tuned:
        stated = [row for row in tuned if row.get("stated") is not None]
        gap = mean(stated, "stated") - mean(stated, "pi")
        print(
            f"   PI good {mean(tuned, 'pi'):.3f} of {len(tuned)}, in these cells {mean(tame, 'pi'):.3f} (aim .9); "
            f"stated minus true {100 * gap:+.1f} points; no gains in {sum(bool(r.get('pi_refused')) for r in tuned)}"
        )
    print(f"   median time of identify {np.median([r['seconds'] for r in rows if 'seconds' in r]):.2f} s")
    for kind in NOISES:
        some = [row for row in tame if row["cell"][1] == kind]
        if some:
            mid, high = quantiles(errors(some))
            print(
                f"   {kind:12} median {100 * mid:6.2f}, 90 % {100 * high:7.2f}, wild {100 * wild(some).mean():4.1f}, "
                f"coverage {100 * mean(some, 'covered'):4.1f}, PI {mean(some, 'pi'):.2f}"
            )


def table(given):
    """Print the figures by cell and over all, beside those of another version."""
    rows, base = results(given.file), results(given.base) if given.base else {}
    cells, before = by_cell(rows), by_cell(base)
    print(HEAD + (BEFORE if base else ""))
    met = []
    for cell in CELLS:
        if cell in cells:
            words, *good = cell_line(cell, cells[cell], before.get(cell))
            met.append(good)
            print(words)
    left_out = {cell for cell, some in cells.items() if quantiles(errors(some, "reference"))[1] > WILD}
    summary(str(given.file), rows, left_out)
    if base:
        summary(str(given.base), {key: row for key, row in base.items() if key[0] in cells}, left_out)
        held = np.mean(met, axis=0)
        print(f"\nshare of cells that meet the median aim {held[0]:.2f}, the aim of the 90 % error {held[1]:.2f}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(required=True)
    one = commands.add_parser("run")
    one.set_defaults(call=run)
    one.add_argument("file", type=Path)
    one.add_argument("--draws", type=int, default=40)
    one.add_argument("--first", type=int, default=0, help="first draw")
    one.add_argument("--pi-draws", type=int, default=40, help="draws below this number are tuned too")
    one.add_argument("--seed", type=int, default=2026)
    one.add_argument("--only", nargs="*", default=[], help="parts of the names of cells")
    one.add_argument("--part", type=int, default=0, help="this part of --of, for several processes with a file each")
    one.add_argument("--of", type=int, default=1)
    two = commands.add_parser("table")
    two.set_defaults(call=table)
    two.add_argument("file", type=Path)
    for each in (one, two):
        each.add_argument("--base", type=Path, help="results of the version before")
    given = parser.parse_args()
    given.call(given)


if __name__ == "__main__":
    main()
