"""Import time of each package, of two installed versions in turn.

    python benchmarks/imports.py OLD/bin/python NEW/bin/python

Each import runs as a process of its own, old and new in turn, so that a busy machine slows both; the ratio is that
of the medians of the CPU times. `benchmarks/speed.py` has the commands.
"""

import resource
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

PACKAGES = ("", ".datasets", ".fit", ".ident", ".parameters", ".controllers", ".cards", ".batch", ".cli")
REPETITIONS = 9


def cpu_seconds(words, folder):
    """CPU time of a process and its children, in s."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(words, cwd=folder, check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def medians(jobs, folder):
    """Median CPU time of each job, the jobs in turn; a first round is not counted."""
    times = [[cpu_seconds(job, folder) for job in jobs] for _ in range(REPETITIONS + 1)][1:]
    return [statistics.median(column) for column in zip(*times, strict=True)]


def main():
    """Print a line a package."""
    pythons = [str(Path(word).absolute()) for word in sys.argv[1:3]]
    with tempfile.TemporaryDirectory() as folder:
        empty = medians([[python, "-c", ""] for python in pythons], folder)
        print(f"{'':44}{'old, ms':>9}{'new, ms':>9}{'ratio':>8}")
        for package in PACKAGES:
            old, new = medians([[python, "-c", f"import fitmodels{package}"] for python in pythons], folder)
            old, new = old - empty[0], new - empty[1]
            print(f"import fitmodels{package:28}{1e3 * old:>9.0f}{1e3 * new:>9.0f}{new / old:>8.2f}")


if __name__ == "__main__":
    main()
