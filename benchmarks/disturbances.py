"""Detection and false-alarm rates of the disturbances that `ident.identify` names, over the bank of plants.

    python benchmarks/disturbances.py run RESULTS.jsonl [--draws N] [--plain N] [--seed N] [--plants ...]
    python benchmarks/disturbances.py table RESULTS.jsonl

Records are 15 s at 50 Hz, input a chirp of 0.1 to 2 Hz with an amplitude of 2.5; the plain bank has PRBS and steps too.
``run`` appends one JSON line per record to its file and continues where an interrupted run ended.

    plain        no disturbance: anything named is a false alarm (aim: at most 2 % of the records)
    spikes       4 single samples, of the size times the rms of the output
    line         100 Hz less a random 3 to 24 Hz, seen as its alias; amplitude relative to the rms of the output
    drift        straight line; its range relative to the rms of the output
    dead zone    of the size times the amplitude of the input, to both sides of zero
    backlash     half its width, relative to the amplitude of the input
    held output  a reading that is repeated for so many samples
    saturation   of the input beyond this share of its amplitude, to both sides; override: above it only

A spike, a line, a drift is found where it is named at its place (a sample, .1 Hz). A nonlinearity is found where one is
named; ``kind`` is the share with the right name, and ``named`` the share with any nonlinearity. What the plant removes
from the output cannot be found: rates are also printed by plant.
"""

import argparse
import json
import time
import zlib
from collections import defaultdict
from pathlib import Path

import numpy as np
from fitmodels.datasets import Record
from fitmodels.ident import identify
from fitmodels.ident.record_disturbances import disturbances
from structure_bank import INPUTS, PLANTS, T, noise_of, plant_of, play

NOISES = ("white 40 dB", "white 30 dB", "white 20 dB", "AR(.8)", "equation")
AMPLITUDE = 2.5
SIZES = {
    "spikes": (0.1, 0.2, 0.5, 1.0),
    "line": (0.01, 0.02, 0.05, 0.1),
    "drift": (0.1, 0.2, 0.5),
    "dead zone": (0.05, 0.1, 0.2, 0.3),
    "backlash": (0.05, 0.1, 0.2, 0.3),
    "saturation": (0.9, 0.8, 0.7, 0.5),
    "override": (0.9, 0.8, 0.7, 0.5),
    "held output": (4, 10),
}
STATIC = ("dead zone", "backlash", "saturation", "curvature")
REQUIRED = {"spikes": 0.95, "line": 0.95, "dead zone": 0.8, "saturation": 0.8, "override": 0.8, "held output": 0.95}


def acting(kind, size, u):
    """Input that acts on the plant."""
    if kind == "dead zone":
        return u - np.clip(u, -size * AMPLITUDE, size * AMPLITUDE)
    if kind == "backlash":
        return play(u, 2 * size * AMPLITUDE)
    if kind == "saturation":
        return np.clip(u, -size * AMPLITUDE, size * AMPLITUDE)
    return np.minimum(u, size * AMPLITUDE) if kind == "override" else u


def added(kind, size, n, rng):
    """Disturbance of the output in its rms (n,), and its place."""
    if kind == "spikes":
        at = rng.choice(np.arange(5, n - 5), 4, replace=False)
        out = np.zeros(n)
        out[at] = size * rng.choice([-1.0, 1.0], 4)
        return out, sorted(at.tolist())
    if kind == "line":
        f = rng.uniform(3, 24)
        return size * np.sin(2 * np.pi * ((100 - f) * T * np.arange(n) + rng.uniform())), f
    return (size * np.linspace(-0.5, 0.5, n) if kind == "drift" else np.zeros(n)), None


def drawn(cell, seed, draw):
    """Record of a cell and the place of its disturbance."""
    name, noise, signal, kind, size = cell
    rng = np.random.default_rng([seed, zlib.crc32("/".join(map(str, cell)).encode()), draw])
    plant, u = plant_of(name), INPUTS[signal]()
    x = plant.simulate(acting(kind, size, play(u, 0.25) if name == "lag with backlash" else u))
    extra, place = added(kind, size, len(x), rng)
    y = x + noise_of(noise, plant, x, rng) + np.std(x) * extra
    if kind == "held output":
        first = int(rng.integers(20, len(y) - 40))
        y[first : first + size] = y[first]
    return Record(u=u, y=y, sample_time=T), place


def line_of(cell, seed, draw):
    """What was named in one record."""
    rec, place = drawn(cell, seed, draw)
    start = time.process_time()
    found = disturbances(rec.centred())
    spent = time.process_time() - start
    if found.drift and cell[3] == "plain":  # identification leaves out a drift that the plant explains
        found = identify(rec).disturbances
    kinds = [item.kind for item in found.found]
    kind = cell[3]
    if kind == "spikes":
        hit = set(place) <= set(found.replaced.tolist())
    elif kind == "line":
        hit = any(abs(f - place) < 0.1 for f in found.lines)
    else:
        hit = {"override": "saturation"}.get(kind, kind) in kinds
    return {"cell": cell, "draw": draw, "kinds": kinds, "hit": hit, "cpu": spent}


def run(args):
    path = Path(args.results)
    done = (
        {(tuple(x["cell"]), x["draw"]) for x in map(json.loads, path.read_text().splitlines())}
        if path.exists()
        else set()
    )
    plants = args.plants or list(PLANTS)
    plain = [(p, n, s, "plain", 0.0) for s in INPUTS for p in plants for n in NOISES]
    sized = [(p, n, "chirp", k, x) for k, sizes in SIZES.items() for x in sizes for p in plants for n in NOISES]
    tasks = [(c, d) for cells, draws in ((plain, args.plain), (sized, args.draws)) for d in range(draws) for c in cells]
    with path.open("a") as out:
        for k, (cell, draw) in enumerate(tasks):
            if (cell, draw) not in done:
                out.write(json.dumps(line_of(cell, args.seed, draw)) + "\n")
            if k % 500 == 0:
                out.flush()
                print(f"{k} of {len(tasks)}", flush=True)


def rate(lines, test):
    return sum(map(test, lines)) / max(len(lines), 1)


def is_static(x):
    return any(kind in STATIC for kind in x["kinds"])


def table(args):
    lines = [json.loads(line) for line in Path(args.results).read_text().splitlines()]
    print(f"processor time of a record: median {1e3 * np.median([x['cpu'] for x in lines]):.1f} ms")
    plain = [x for x in lines if x["cell"][3] == "plain" and x["cell"][0] != "lag with backlash"]
    print(f"\nfalse alarms: {rate(plain, lambda x: bool(x['kinds'])):.2%} of {len(plain)} records (aim: at most 2 %)")
    for column, what in ((0, "plant"), (1, "noise"), (2, "input")):
        groups = defaultdict(list)
        for x in plain:
            groups[x["cell"][column]].append(x)
        print(f"  by {what}: " + ", ".join(f"{k} {rate(v, lambda x: bool(x['kinds'])):.1%}" for k, v in groups.items()))
    names = list(dict.fromkeys(x["cell"][0] for x in lines))
    for kind, sizes in SIZES.items():
        print(
            f"\n{kind}: share found (nonlinearity: of any name; in brackets, of the right name) over all, then by plant"
        )
        for size in sizes:
            own = [x for x in lines if x["cell"][3] == kind and x["cell"][4] == size]
            test = is_static if kind in ("dead zone", "backlash", "saturation", "override") else (lambda x: x["hit"])
            right = f" ({rate(own, lambda x: x['hit']):.2f})" if test is is_static else ""
            by = (f"{rate([x for x in own if x['cell'][0] == n], test):.2f}" for n in names)
            aim = f"  aim {REQUIRED[kind]:.2f}" if kind in REQUIRED else ""
            print(f"  {size:5.2f}  {rate(own, test):.2f}{right}   {'  '.join(by)}{aim}")
    print("\nplants, in this order: " + "; ".join(names))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(required=True)
    one = commands.add_parser("run")
    one.add_argument("results")
    one.add_argument("--draws", type=int, default=100)
    one.add_argument("--plain", type=int, default=100)
    one.add_argument("--seed", type=int, default=2027)
    one.add_argument("--plants", nargs="*")
    one.set_defaults(function=run)
    other = commands.add_parser("table")
    other.add_argument("results")
    other.set_defaults(function=table)
    given = parser.parse_args()
    given.function(given)
