"""``fitmodels plan``: a central composite design for a user's own ranges, in run order, as CSV."""

import argparse
import sys
from pathlib import Path
from typing import TextIO

from .arguments import Parser, ranges, seed


def parser() -> Parser:
    """Arguments of ``fitmodels plan``."""
    p = Parser(
        "fitmodels plan",
        "fitmodels plan --range V=50:200 --range f=0.06:0.6 --range d=1.5:3 --out plan.csv",
        "Plan wear tests: a central composite design in the logarithms of the conditions, one edge per row,\n"
        "with the run order drawn at random. Without --out the plan is printed.",
    )
    p.add_argument("--range", action="append", metavar="V=50:200", help="a condition and its range; up to six")
    p.add_argument("--alpha", type=float, default=2.0, help="distance of the axial points, coded (default: 2)")
    p.add_argument("--centre", type=int, default=4, help="edges at the centre (default: 4)")
    p.add_argument("--axial", type=int, default=2, help="edges at each axial point (default: 2)")
    p.add_argument("--seed", type=seed, default=1, help="seed of the run order (default: 1)")
    p.add_argument("--out", metavar="FILE", help="file to write")
    p.add_argument("--force", action="store_true", help="replace an existing file")
    return p


def run(args: argparse.Namespace) -> int:
    """Write the plan, and return the exit code."""
    from ..core.errors import UsageError
    from ..datasets import central_composite, write_csv
    from ..datasets.vocabulary import ROLES

    given = ranges(args.range)
    if not given:
        raise UsageError("no range: give at least one, for instance --range V=50:200.")
    for name, ends in given.items():
        if len(ends) != 2:
            raise UsageError(f"--range {name}: a plan needs low:high, two numbers.")
    design = central_composite(
        {name: (ends[0], ends[1]) for name, ends in given.items()},
        alpha=args.alpha, centre=args.centre, axial_repeats=args.axial, seed=args.seed,
    )  # fmt: skip
    design = design.round({f"{name}_coded": 3 for name in given})
    design[[f"{name}_coded" for name in given]] += 0.0  # no minus before a zero
    units = {name: ROLES[name].unit for name in given if name in ROLES and ROLES[name].unit}
    notes = [
        f"plan: central composite design in logarithms, alpha {args.alpha:g}, {len(design)} edges, seed {args.seed}",
        "cut the edges in the order of run; measure wear, forces and power after each sub-test, a row each",
    ]
    write_csv(design, target(args.out, args.force), notes, units=units)
    return 0


def target(out: str | None, force: bool) -> Path | TextIO:
    """Standard output, or a file that may be written."""
    from ..core.errors import UsageError

    if out is None:
        return sys.stdout
    path = Path(out)
    if path.is_dir() or not path.parent.is_dir():
        raise UsageError(f"{out}: give the name of a file in a folder that exists.")
    if path.exists() and not force:
        raise UsageError(f"{out} exists; replace it with --force, or choose another name.")
    return path
