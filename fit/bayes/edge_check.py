"""Are the draws too sure: the jackknife by edge of the estimate that they stand about.

Draws take rows of an edge as alike but for a level of the edge. Where rows hang together in other ways (wear goes
on from row to row, edges wear at their own pace), the same estimate moves more, as single edges are left out, than
the draws say. Source: Bell & McCaffrey 2002, Survey Methodology 28, 169, on rows whitened for the level.
"""

import numpy as np
import pandas as pd

from ..jackknife import left_out_moves
from .density import Array
from .law_density import LawDensity


def jackknife_of_level_model(density: LawDensity, phi: Array) -> "pd.Series[float] | None":
    """Standard errors by edge of the coefficients about which ``phi`` (S, p) is drawn, by the names of the law.

    None where edges have no levels, or where one edge alone holds a coefficient.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> post = fit.posterior(law)
    >>> se = jackknife_of_level_model(post.density, post.sample.phi)
    >>> bool(0.7 < se["V"] / post.draws[:, 1].std() < 1.4)
    True
    """
    if not density.edges:
        return None
    middle = np.median(phi, axis=0)
    slopes = density.gradient(middle)
    k = np.exp(middle[density.p + 1])
    edge = np.repeat(np.arange(len(density.starts)), density.sizes.astype(int))
    rows = np.column_stack([slopes, density.residuals(middle[None])[0]])
    means = np.add.reduceat(rows, density.starts) / density.sizes[:, None]
    white = rows - ((1 - 1 / np.sqrt(1 + density.sizes * k))[:, None] * means)[edge]
    W, r = white[:, :-1], white[:, -1]
    moved = left_out_moves(W, r, np.linalg.inv(W.T @ W), edge, len(density.starts))
    if isinstance(moved, int):
        return None
    to_constant = np.eye(density.p)
    to_constant[0, 1:] = -density.centre[1:]
    G = len(density.starts)
    se = np.sqrt((G - 1) / G * np.sum((moved @ to_constant.T) ** 2, axis=0))
    return pd.Series(se, index=list(density.theta_names))
