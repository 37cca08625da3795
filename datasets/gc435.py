"""GC435 on 709M40 (En 19): the published laws, and the simulated test that is bundled with the package.

The laws are those of A. M. Alaskari and S. E. Oraby, ICAESAM'2016 (doi 10.15242/IIE.E1216006), eq. 4 to 6,
and of the same authors, "Adaptive control simulation to optimize metal removal for rough turning",
Kuwait J. Sci. (accepted June 2017), eq. 1 to 3; R2, SE and F as printed there:

    AW  = 7.62e-3 V^0.577 f^0.168 d^0.248 t^0.245             mm   R2 0.84  SE 0.1    F 831
    P   = 0.140   V^0.82  f^0.627 d^0.844 t^-0.049 AW^0.342   kW   R2 0.97  SE 0.062  F 4156
    Fxz = 55354   V^-0.484 f^0.236 d^0.715 t^-0.173 AW^1.1    N    R2 0.83  SE 0.12   F 670

The paper of 2017 prints V^0.877 in eq. 1; its tables and eq. 5 use 0.577. Neither paper prints the measured
rows. Assumed here: SE is the residual standard error of the natural log, and half of its variance lies
between edges (intraclass correlation 0.5). Dry turning on a Colchester Mascot centre lathe.

`python -m fitmodels.datasets.gc435 [FILE]` writes the bundled data.csv anew, to FILE or to standard output.
"""

import sys
from collections.abc import Mapping, Sequence
from math import sqrt
from types import MappingProxyType

import pandas as pd

from ..core.errors import UsageError
from .design import central_composite
from .published_laws import PUBLISHED
from .simulation import SimulatedLaw, simulate, write_csv

DOMAIN: Mapping[str, tuple[float, float]] = MappingProxyType({"V": (50.0, 200.0), "f": (0.06, 0.6), "d": (1.5, 3.0)})
ICC = 0.5
SEED = 435
_UNITS = {"AW": "mm", "P": "kW", "Fxz": "N"}
_PRINTED = {law.response: law for law in PUBLISHED if law.tool == "GC435"}
STANDARD_ERROR: Mapping[str, float] = MappingProxyType(
    {response: law.standard_error for response, law in _PRINTED.items() if law.standard_error is not None}
)


def _law(response: str, unit: str) -> SimulatedLaw:
    """Split the published residual variance between edges and rows; the laboratory records three digits."""
    exponents = dict(_PRINTED[response].coefficients)
    c0, sd = exponents.pop("c0"), STANDARD_ERROR[response]
    sd_edge, sd_row = sd * sqrt(ICC), sd * sqrt(1 - ICC)
    return SimulatedLaw(response, unit, c0, MappingProxyType(exponents), sd_edge, sd_row, digits=3)


LAWS = tuple(_law(response, unit) for response, unit in _UNITS.items())

NOTES = (
    "simulated: no real measurement; drawn from the published laws of Alaskari and Oraby, "
    "doi 10.15242/IIE.E1216006, eq. 4 to 6",
    f"simulated: seed {SEED}; standard error "
    + ", ".join(f"of ln {response} {error:g}" for response, error in STANDARD_ERROR.items()),
    f"simulated: assumed intraclass correlation of the edges {ICC:g} (half of each variance between edges)",
    "simulated: central composite design of 24 edges; sub-tests of 2 min to AW 0.3 mm or 20 min",
    "tool: GC435",
    "work: 709M40 (En 19)",
    "machine: Colchester Mascot centre lathe, dry turning",
)


def gc435_rows(seed: int = SEED) -> pd.DataFrame:
    """Simulate the 24 edges: one row per sub-test of 2 minutes, to AW 0.3 mm or 20 minutes.

    Parameters
    ----------
    seed : int
        seed of the run order and of all deviations; the bundled file has the default

    Returns
    -------
    DataFrame with columns edge, point, V (m/min), f (mm/rev), d (mm), t (min), AW (mm), P (kW), Fxz (N)

    Examples
    --------
    >>> rows = gc435_rows()
    >>> int(rows["edge"].nunique()), bool(rows["AW"].max() < 0.4)
    (24, True)

    """
    plan = central_composite(DOMAIN, seed=seed)
    return simulate(plan, LAWS, seed=seed)


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the simulated test to the file named, or to standard output; return the exit code.

    >>> main(["one.csv", "two.csv"])
    2
    """
    files = list(sys.argv[1:] if arguments is None else arguments)
    try:
        if len(files) > 1 or any(name.startswith("-") for name in files):
            raise UsageError(f"arguments {' '.join(files)}: give one file name, or none for standard output.")
        write_csv(gc435_rows(), files[0] if files else sys.stdout, NOTES)
    except (UsageError, OSError) as error:
        sys.stderr.write(f"{error}\n")
        return 2
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
