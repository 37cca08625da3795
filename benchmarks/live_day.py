"""24 hours of 50 Hz through `fitmodels watch` in accelerated replay: memory constant, journal bounded, state replayed.

    python benchmarks/live_day.py [--hours 24] [--rate 50]

A machine is simulated that cuts 60 s, idles 12 s and changes its edge each 20 min of contact; samples go through cuts,
estimate, monitor and journal as in the command, as fast as they can. Printed each hour: resident memory, bytes of the
journal, time of an hour; at the end whether the journal replays to the same state. Everything is simulated.
"""

import argparse
import os
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from fitmodels import datasets, fit, parameters
from fitmodels.live.cuts import Cuts
from fitmodels.live.live_laws import LiveLaws
from fitmodels.live.monitor import Monitor
from fitmodels.live.samples import Sample
from fitmodels.live.stream import JsonLines
from fitmodels.live.watch_edge import WatchSettings
from fitmodels.live.watch_journal import journal_files, read_newest, replay
from fitmodels.live.watching import Watch, open_journal

CUT, AIR, LIFE = 60.0, 12.0, 20.0  # s, s, min
IDLE, NOISE = 0.8, 0.03  # kW, relative
GROWTH, FILES = 1.15, 8  # of memory after the second hour; files of a journal


def memory():
    """Resident memory, MB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def samples(hours, rate, rng):
    """Samples of the machine, and None where an edge is changed."""
    conditions = [{"V": V, "f": f, "d": 2.0} for V, f in ((150.0, 0.2), (120.0, 0.25))]
    time_of, contact, cut = 0.0, 0.0, 0
    n_cut, n_air = round(CUT * rate), round(AIR * rate)
    while time_of < 3600 * hours:
        at = conditions[cut % 2]
        power = np.full(n_air + n_cut, IDLE)
        minutes = contact + np.arange(1, n_cut + 1) / rate / 60
        wear = 0.00762 * at["V"] ** 0.577 * at["f"] ** 0.168 * at["d"] ** 0.248 * minutes**0.245
        power[n_air:] += 0.14 * at["V"] ** 0.82 * at["f"] ** 0.627 * at["d"] ** 0.844 * minutes**-0.049 * wear**0.342
        power *= 1 + NOISE * rng.standard_normal(len(power))
        for k, value in enumerate(power.tolist()):
            yield Sample(time_of + k / rate, {"P": value}, at, "feed" if k >= n_air else "idle")
        time_of, contact, cut = time_of + CUT + AIR, contact + CUT / 60, cut + 1
        if contact >= LIFE:
            contact = 0.0
            yield None


def main():
    """Run the day and print its figures; exit code 1 where a limit is broken."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--hours", type=float, default=24.0)
    parser.add_argument("--rate", type=float, default=50.0, help="Hz")
    args = parser.parse_args()
    runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    factors = ["V", "f", "d", "t"]
    pf = parameters.collect(laws=[fit.power_law(runs, "AW", factors), fit.power_law(runs, "P", [*factors, "AW"])])
    laws, identity = LiveLaws.of(pf), {"tool": "GC435", "work": "709M40", "simulated": True}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        state = Monitor(laws, WatchSettings(criterion=0.35), identity)
        journal, _ = open_journal(folder, state, "simulated")
        written = []
        watch = Watch(
            state, Cuts(), "simulated", journal=journal, outlets=[JsonLines(lambda x: written.append(len(x)))]
        )
        begun = hour_begun = time.monotonic()
        count, peaks, hour = 0, [], 1
        for item in samples(args.hours, args.rate, np.random.default_rng(26)):
            if item is None:
                watch.record("edge", time=state.time)
                continue
            watch.take(item)
            count += 1
            if item.time >= 3600 * hour:
                peaks.append(memory())
                size = sum(path.stat().st_size for path in journal_files(folder))
                print(
                    f"hour {hour:2d}: {peaks[-1]:6.1f} MB resident, journal {size / 1e6:6.2f} MB in "
                    f"{len(journal_files(folder))} files, edge {state.edge.number}, "
                    f"{time.monotonic() - hour_begun:5.1f} s for the hour",
                    flush=True,
                )
                hour, hour_begun = hour + 1, time.monotonic()
                written.clear()
        watch.run([])
        seconds = time.monotonic() - begun
        other = Monitor(laws, WatchSettings(criterion=0.35), identity)
        replay(read_newest(folder).records, other)
        same = other.as_json() == state.as_json()
        files = journal_files(folder)
        print(f"{count} samples in {seconds:.0f} s: {args.hours * 3600 / seconds:.0f} times as fast as the machine")
        print(f"journal replays to the same state: {same}; {len(files)} files, {len(state.cuts)} lengths of cuts kept")
        growth = max(peaks[1:], default=0.0) / peaks[1] if len(peaks) > 1 else 1.0
        print(f"memory after the second hour: largest {growth:.3f} times that of the second (limit {GROWTH})")
    return 0 if same and growth <= GROWTH and len(files) <= FILES else 1


if __name__ == "__main__":
    sys.exit(main())
