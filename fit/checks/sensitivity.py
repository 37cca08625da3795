"""What a law's coefficients do over assumed gauge errors of its wear."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from ..available import NotAvailable
from ..lawfit import LawFit
from .gauge import gauge_corrected


def sensitivity(law: LawFit, sds: Sequence[float], wear: str = "AW", unit: str = "ln") -> pd.DataFrame:
    """Coefficients of a law over assumed gauge errors.

    Returns
    -------
    DataFrame, indexed by ``gauge_sd``: a column for each of ``law.names``, the standard error of the wear's as
    ``se``, and ``reliability``. A gauge error that leaves nothing to fit has no row: ``attrs["left_out"]`` says why.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    >>> curve = sensitivity(fit.power_law(runs, "P", ["V", "f", "d", "t", "AW"]), [0, 0.02, 0.04])
    >>> bool(curve["AW"].is_monotonic_increasing)
    True
    """
    rows, at, left_out = [], [], {}
    for sd in sds:
        found = gauge_corrected(law, sd, wear, unit)
        if isinstance(found, NotAvailable):
            left_out[sd] = found.reason
            continue
        rows.append([*found.params, found.bse.iloc[1 + law.factors.index(wear)], found.reliability])
        at.append(sd)
    index = pd.Index(at, name="gauge_sd", dtype=float)
    curve = pd.DataFrame(np.array(rows).reshape(len(at), -1) if rows else None, index=index)
    curve = curve.set_axis([*law.names, "se", "reliability"], axis=1) if rows else curve
    curve.attrs["left_out"] = left_out
    return curve
