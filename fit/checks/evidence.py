"""What a law leaves to judge it by: scatter at all, and what counts as one observation, an edge or a row."""

import numpy as np
from numpy.typing import NDArray

from ..jackknife import meets_exactly
from ..lawfit import LawFit


def no_scatter(law: LawFit) -> str | None:
    """Why a law without scatter cannot be tested, or None where it leaves some.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("ac2017_table1")), "AW", ["V", "f"])
    >>> no_scatter(law) is None
    True
    """
    if law.df_resid <= 0:
        return f"{law.nobs} observations fix {len(law.theta)} parameters exactly: nothing is left to judge the law by"
    return "the law meets every row exactly: there is no scatter to judge it by" if meets_exactly(law) else None


def has_repeated_edges(law: LawFit) -> bool:
    """Whether some edge gave more than one row."""
    return law.n_edges is not None and law.n_edges < law.nobs


def units_of(law: LawFit) -> tuple[str, NDArray[np.intp]]:
    """What counts as one observation, ``edge`` or ``row``, and the number of each row's unit, shape (n,)."""
    if law.edge is None:
        return "row", np.arange(law.nobs)
    return "edge", np.unique(law.edge, return_inverse=True)[1]
