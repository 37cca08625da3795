"""Sums of the rows of a law by edge, from which it is fitted again with further edges, and the versions of a file."""

from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from ...core.arrays import Array
from ..messages import short
from .base import Count, IsoDate, NotNegative, Number, Section, Sha256, Text
from .origin import OneOrMore


class EdgeSumsSection(Section):
    """Gram matrix of the rows of one edge: their number, means, and the triangle of its sums about the means.

    ``mean`` has a value for each of the ``columns`` of `LawSums`. ``moves`` are the numbers of the columns that change
    within the edge, counted from 0, and ``root`` the rows of an upper triangle R of these, from the diagonal on:
    ``R'R`` are their sums of products about the means. ``edge`` is empty for all rows of data that name no edges,
    ``batch`` for the edges of the first fit.

    Examples
    --------
    >>> EdgeSumsSection(edge="E01", rows=3, mean=[4.6, 1.2, -1.9], moves=[1, 2], root=[[0.9, 0.3], [0.02]]).rows
    3
    """

    edge: str
    batch: str = ""
    rows: OneOrMore
    mean: tuple[Number, ...]
    moves: tuple[Count, ...] = ()
    root: tuple[tuple[Number, ...], ...] = ()

    @model_validator(mode="after")
    def _a_triangle(self) -> Self:
        m, q = len(self.moves), len(self.mean)
        if len(set(self.moves)) < m or any(j >= q for j in self.moves):
            raise ValueError(
                f"the sums of edge {short(self.edge)} name {q} columns, and others or one twice in 'moves'"
            )
        if len(self.root) > min(m, self.rows - 1) or any(len(row) != m - i for i, row in enumerate(self.root)):
            raise ValueError(f"the root of edge {short(self.edge)} must be an upper triangle of {m} columns")
        return self


class LawSums(Section):
    """Sums of a law by edge, or the reason why there are none.

    ``columns`` are the terms of the law but the constant, as they enter it (the logarithms of the factors of a power
    law), and last the response on the scale of the errors. The coefficients, their covariance by edge, the variance
    components and the posterior follow from these sums as from all rows.

    Examples
    --------
    >>> LawSums(reason="a law of a stream keeps no rows").edges
    ()
    """

    reason: str | None = None
    columns: tuple[Text, ...] = ()
    edges: tuple[EdgeSumsSection, ...] = ()

    @model_validator(mode="after")
    def _of_these_columns(self) -> Self:
        if bool(self.edges) == (self.reason is not None):
            raise ValueError("a law has either sums of edges or the reason why there are none")
        if odd := next((one for one in self.edges if len(one.mean) != len(self.columns)), None):
            raise ValueError(f"edge {short(odd.edge)} has {len(odd.mean)} means for {len(self.columns)} columns")
        names = [one.edge for one in self.edges]
        if len(set(names)) < len(names):
            raise ValueError("the sums of an edge are there twice")
        return self

    def squares(self, c: Array) -> float:
        """Sum over all rows of the square of ``c[0]`` plus the columns times ``c[1:]``, shape (1 + columns,).

        >>> one = {"edge": "", "rows": 2, "mean": [1.0, 3.0], "moves": [0, 1], "root": [[1.0, 1.0]]}
        >>> LawSums(columns=["V", "AW"], edges=[one]).squares(np.array([-1.0, -2.0, 1.0]))
        1.0
        """
        total = 0.0
        for edge in self.edges:
            level, within = float(c[0] + c[1:] @ np.array(edge.mean)), c[1:][list(edge.moves)]
            moves = [float(np.array(row) @ within[k:]) for k, row in enumerate(edge.root)]
            total += edge.rows * level**2 + sum(value**2 for value in moves)
        return total


class LevelShift(Section):
    """Distance of the edges of one version from the law before, on the scale of its errors, and its standard error."""

    shift: Number
    se: NotNegative
    edges: OneOrMore


class VersionSection(Section):
    """A version of the file with further edges.

    Attributes
    ----------
    version : int
        2 for the first after the fit.
    former_sha256 : str or None
        ``content_sha256`` of the version before.
    created : str or None
        ISO date.
    batch : str
        Name of the delivery of tools or work that the edges belong to.
    edges : tuple of str
        Edges that were added.
    rows : dict of int
        Rows that each law was given.
    shifts : dict of LevelShift
        By response.
    command : str or None
    notes : tuple of str
        What was assumed, and what was left out.

    Examples
    --------
    >>> VersionSection(version=2, edges=["2024-05-01 E1"], rows={"AW": 1}).batch
    ''
    """

    version: Annotated[int, Field(strict=True, ge=2, lt=2**63)]
    former_sha256: Sha256 | None = None
    created: IsoDate | None = None
    batch: str = ""
    edges: tuple[Text, ...]
    rows: dict[str, Count] = Field(default_factory=dict)
    shifts: dict[str, LevelShift] = Field(default_factory=dict)
    command: str | None = None
    notes: tuple[str, ...] = ()
