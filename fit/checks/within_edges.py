"""Lack of fit of factors that change within edges, against rows of one setting, each edge with a level of its own.

Speed and feed changed on one tool are compared on that tool: the edge's own level drops out, so that the pure error is
that of rows, not of edges. Settings may be repeated on the same edge or on another one.
"""

import numpy as np

from ...core.arrays import Array, Ints
from ..available import NotAvailable
from ..lawfit import LawFit
from .model_checks import LackOfFit, lack_of_fit_test, settings_of
from .strata import has_repeated_edges, no_scatter, orthonormal, without_levels

ACCUMULATED = ("t", "L", "AW", "VB")  # change within every edge without being set
MOST_SETTINGS = 1000


def lack_of_fit_within(law: LawFit) -> LackOfFit | NotAvailable | None:
    """Lack of fit within edges; None where no condition is changed within them.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> lack_of_fit_within(law) is None
    True
    """
    if no_scatter(law) is not None or law.edge is None or not has_repeated_edges(law):
        return None
    edge: Ints = np.unique(law.edge, return_inverse=True)[1]
    changed = [name for j, name in enumerate(law.factors) if _changes(law.X[:, j], edge)]
    if not set(changed) - set(ACCUMULATED):
        return None
    setting = settings_of(law.design)
    S = int(setting.max()) + 1
    if law.nobs in (S, S + 1) or S > MOST_SETTINGS:
        return NotAvailable(
            f"{', '.join(changed)} change within edges and {S} settings of {law.nobs} rows are hardly repeated: repeat "
            "settings on the same edge or on another one"
        )
    own, law_rank = _left(law.design, law.residuals, edge)
    pure, rank = _left(np.eye(S)[setting], law.residuals, edge)
    left = law.nobs - int(edge.max()) - 1 - rank
    if left < 1:
        return NotAvailable("settings repeated on edges leave no degrees of freedom for pure error within edges")
    return lack_of_fit_test("rows (levels of edges removed)", own, pure, (rank - law_rank, left), setting)


def _changes(column: Array, edge: Ints) -> bool:
    """Whether a factor has several values on an edge."""
    middle = np.bincount(edge, column) / np.bincount(edge)
    return bool((np.abs(column - middle[edge]) > 1e-9 * np.abs(column).max()).any())


def _left(A: Array, b: Array, edge: Ints) -> tuple[float, int]:
    """Sum of squares of b outside the levels of edges and the columns of A, and the rank of A beyond the levels."""
    one, G = np.ones(len(b)), int(edge.max()) + 1
    within = without_levels(np.column_stack([A, b]), one, edge, G)[1]
    size = np.sqrt((A**2).sum(axis=0))
    Q = orthonormal(within[:, :-1] / np.where(size > 0, size, 1.0))
    left = within[:, -1] - Q @ (Q.T @ within[:, -1])
    return float(left @ left), Q.shape[1]
