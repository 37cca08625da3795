"""Rows of a fitted law, and their source."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ..core.arrays import Array, Ints, Texts
from ..core.display import Plottable
from ..core.errors import FitError
from ..datasets import Runs

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, slots=True)
class LawSource:
    """Source of the rows of a law.

    Attributes
    ----------
    file, sha256 : str
        Name of the data file and SHA-256 of its bytes; empty for rows in memory.
    tool, work : str
        Tool and work material, empty where unknown.
    simulated : bool or None
        True where the file states that its rows are simulated or computed; None where it is not known.
    note : str
        The sentences in which it does.
    n_rows : int or None
        Rows of the pair in the file.
    """

    file: str = ""
    sha256: str = ""
    tool: str = ""
    work: str = ""
    simulated: bool | None = None
    note: str = ""
    n_rows: int | None = None

    @classmethod
    def of_runs(cls, runs: Runs) -> Self:
        """The source of runs."""
        file = runs.source.name if runs.source.sha256 else ""
        note = ". ".join(runs.disclaimers)
        return cls(file, runs.source.sha256, runs.tool, runs.work, runs.simulated, note, len(runs))


@dataclass(frozen=True, slots=True)
class FittedRows:
    """Rows of a fitted law.

    Attributes
    ----------
    X, shifts : ndarray, shape (n, k) and (n, s)
        Factors in their units, and indicator columns of the category.
    observed, fitted, residuals : ndarray, shape (n,)
        Response, prediction, and residuals on the scale of the errors.
    lines : ndarray of int, shape (n,)
        Line of each row in the file.
    edge : ndarray of str, shape (n,), or None
        Cutting edge of each row.
    side : ndarray of int, shape (n,), or None
        Of a law of tool lives: 0 the life ended, 1 it is longer (run-out), -1 it is shorter than observed.
    """

    X: Array
    shifts: Array
    observed: Array
    fitted: Array
    residuals: Array
    lines: Ints
    edge: Texts | None
    side: NDArray[np.int8] | None = None

    def __len__(self) -> int:
        return len(self.observed)

    @property
    def n_edges(self) -> int | None:
        """Number of cutting edges, None where the file names none."""
        return None if self.edge is None else len(set(self.edge))

    @property
    def edge_numbers(self) -> Ints:
        """Number of the edge of each row, in the order of their names; one edge where the file names none."""
        if self.edge is None:
            return np.zeros(len(self), dtype=np.intp)
        return np.asarray(pd.factorize(self.edge, sort=True)[0], dtype=np.intp)

    def part(self, rows: NDArray[Any] | slice) -> Self:
        """These rows only, by their positions or by a mask."""
        return replace(self, **{name: v[rows] for name in self.__slots__ if (v := getattr(self, name)) is not None})

    def extent(self, factors: Sequence[str]) -> dict[str, Any]:
        """The fields of `LawFit` that are the number of rows and edges, and the ranges of factors and response."""
        low, high = self.X.min(axis=0), self.X.max(axis=0)
        return {
            "nobs": len(self),
            "n_edges": self.n_edges,
            "domain": {name: (float(low[j]), float(high[j])) for j, name in enumerate(factors)},
            "response_range": (float(self.observed.min()), float(self.observed.max())),
        }


class RowAccess:
    """Base of a law: its rows by name, where it keeps them."""

    __slots__ = ()

    rows: FittedRows | None

    @property
    def _in_memory(self) -> FittedRows:
        if self.rows is None:
            raise FitError("a law of a stream keeps no rows, and this needs them: fit a sample of them in memory.")
        return self.rows

    @property
    def X(self) -> Array:
        """Factors in their units, shape (n, k)."""
        return self._in_memory.X

    @property
    def shifts(self) -> Array:
        """Indicator columns of the category, shape (n, s)."""
        return self._in_memory.shifts

    @property
    def observed(self) -> Array:
        """Response, shape (n,)."""
        return self._in_memory.observed

    @property
    def fitted(self) -> Array:
        """Prediction for each row, shape (n,)."""
        return self._in_memory.fitted

    @property
    def residuals(self) -> Array:
        """Residuals on the scale of ``error``, shape (n,)."""
        return self._in_memory.residuals

    @property
    def lines(self) -> Ints:
        """Line of each row in the file, shape (n,)."""
        return self._in_memory.lines

    @property
    def edge(self) -> Texts | None:
        """Cutting edge of each row, shape (n,), None where the file names none."""
        return self._in_memory.edge


Figure = Literal[
    "observed", "residuals", "edges", "quantiles", "profile", "contours", "interactions", "coefficients", "influence",
    "checks", "canonical",
]  # fmt: skip


class LawFigures(Plottable):
    """Base of a law and of a response surface: their figures."""

    __slots__ = ()

    def plot(self, kind: "Figure | Axes | None" = None, ax: "Axes | None" = None, **options: Any) -> Any:  # noqa: ANN401
        """Draw a figure of the law; its axes are returned, an array of them where there are several.

        Parameters
        ----------
        kind : str, optional
            - ``observed``: observed values against predicted ones; the default of a law.
            - ``residuals``: over the prediction, on the scale of the fit.
            - ``edges``: residuals of each edge.
            - ``quantiles``: ordered residuals over normal quantiles.
            - ``profile``: over each factor with intervals; ``factor="V"`` draws one, ``at={"V": 120}`` holds factors.
            - ``contours``: over two factors inside the tested region; ``over=("V", "f")``. The default of a surface.
            - ``interactions``: over one factor at tested values of another; ``over``, ``at``.
            - ``coefficients``: each with two standard errors.
            - ``influence``: change of each parameter without one edge.
            - ``checks``: each check at its level.
            - ``canonical``: ridge paths, of a response surface alone.
        ax : Axes, optional
            For figures of one panel; without it the figure is new and known to pyplot.
        **options
            Those named above.

        Raises
        ------
        UsageError
            No such kind, option or factor, or several panels for one ``ax``; the message names what there is.

        Examples
        --------
        >>> from fitmodels import datasets, fit
        >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
        >>> law.plot("profile", factor="V").get_xlabel(), law.plot("contours", over=("V", "t")).get_ylabel()
        ('V [m/min]', 't [min]')
        """
        return Plottable.plot(self, kind, ax, **options)
