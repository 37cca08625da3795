"""Time to publish a site of a thousand cards, with one process and with two, and again after a few pairs changed.

    python benchmarks/site.py [CARDS]

The pairs are simulated: the bundled turning set is fitted once, and its coefficients are varied for every pair of
25 tools and 40 work materials of the six ISO 513 groups. Aim: a thousand cards in under 60 s on two cores, and an
unchanged site in a tenth of that.
"""

import hashlib
import os
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from fitmodels import datasets, fit, parameters
from fitmodels.cards import publishing
from fitmodels.core.threads import cores

TOOLS, GROUPS = 25, "PMKNSH"
TOML = """license = "CC-BY-4.0"
authors = ["Doe, Jane"]
contact = "jane.doe@example.org"
machine = "none, simulated"
setup = "none, simulated"
no_sensors = "simulated"
iso513 = "{group}"
"""


def fitted():
    runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    laws = [
        fit.power_law(runs, response, factors)
        for response, factors in {"AW": "V f d t", "P": "V f d t AW", "Fxz": "V f d t AW"}.items()
        for factors in [factors.split()]
    ]
    return parameters.collect(tool="x", work="x", laws=laws, simulated=True, data_sha256="0" * 64)


def write_pairs(folder, count, base):
    """Write pairs into a folder."""
    rng = np.random.default_rng(9)
    data = base.model_dump()
    for k in range(count):
        tool, work = f"insert {k % TOOLS + 1:02d}", f"work {GROUPS[k // TOOLS % 6]}{k // TOOLS + 1:02d}"
        moved = {name: one_law(law, rng) for name, law in data["laws"].items()}
        identity = {**data["identity"], "tool": tool, "work": work}
        place = folder / f"pair-{k:04d}"
        place.mkdir()
        pf = parameters.ParameterFile.model_validate({**data, "identity": identity, "laws": moved})
        parameters.write(pf, place / "params.json")
        (place / "card.toml").write_text(TOML.format(group=GROUPS[k // TOOLS % 6]))


def one_law(law, rng):
    """The law with randomly changed coefficients."""
    moved = {k: v * float(np.exp(rng.normal(0, 0.3))) for k, v in law["coefficients"].items()}
    equation = law["equation"]
    for name, value in law["coefficients"].items():
        equation = equation.replace(f"{value:.6g}", f"{moved[name]:.6g}")
    return {**law, "coefficients": moved, "equation": equation}


def published(pairs, out, jobs):
    """Seconds and seconds of CPU to publish pairs."""
    start, busy = time.perf_counter(), sum(os.times()[:4])
    report = publishing.publish(pairs, out, jobs=jobs, force=True)
    if not report.ok:
        sys.exit(report.problems[0].words)
    return time.perf_counter() - start, sum(os.times()[:4]) - busy


def content(top):
    """Path of each file -> its checksum and size."""
    files = sorted(p for p in top.rglob("*") if p.is_file())
    return {p.relative_to(top).as_posix(): (hashlib.sha256(p.read_bytes()).digest(), p.stat().st_size) for p in files}


def main():
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    print(f"Python {sys.version.split()[0]}, {cores()} cores, load {os.getloadavg()[0]:.1f}")
    seen = []
    with tempfile.TemporaryDirectory() as place:
        pairs = Path(place) / "pairs"
        pairs.mkdir()
        write_pairs(pairs, count, fitted())
        for jobs in (1, 2):
            out = Path(place) / f"site-{jobs}"
            seconds, busy = published(pairs, out, jobs)
            held = content(out)
            seen.append(held)
            size = sum(size for _, size in held.values())
            pages = ", ".join(f"{n} {(out / n).stat().st_size / 1e3:.0f} kB" for n in ("index.html", "compare.html"))
            print(
                f"{count} cards, jobs {jobs}: {seconds:6.1f} s   {count / seconds:5.1f} cards/s"
                f"   {busy:6.1f} s of CPU   {len(held)} files, {size / 1e6:.1f} MB   {pages}"
            )
        changed = max(1, count // 100)
        print(f"again: {published(pairs, out, 1)[1]:.1f} s of CPU; ", end="")
        for home in sorted(pairs.iterdir())[:changed]:
            toml = home / "card.toml"
            toml.write_text(toml.read_text().replace("none, simulated", "simulated"))
        print(f"{changed} pairs changed: {published(pairs, out, 1)[1]:.1f} s of CPU")
    odd = [name for name in seen[0] | seen[1] if seen[0].get(name) != seen[1].get(name)]
    same = "the same bytes" if not odd else f"DIFFERENT BYTES in {len(odd)} files, such as {odd[0]},"
    print(f"{same} with one job and with two; aim < 60 s on 2 cores")


if __name__ == "__main__":
    main()
