"""Comparison of a law with the published law of the same tool and work."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..core.display import Plottable
from ..datasets.published_laws import published_law
from .lawfit import LawFit


@dataclass(frozen=True, slots=True, repr=False)
class PublishedComparison(Plottable):
    """The published law and the deviations of the measured rows from it.

    Attributes
    ----------
    source : str
    coefficients : mapping
        As printed.
    standard_error : float or None
        Residual standard error as printed.
    rms_percent, worst_percent : float or None
        Root mean square of, and largest, ``100 (observed / printed law - 1)``; None where the file lacks a
        factor of the printed law.
    worst_line : int or None
        Line of the file with the largest.
    """

    source: str
    coefficients: Mapping[str, float]
    standard_error: float | None
    rms_percent: float | None
    worst_percent: float | None
    worst_line: int | None


def compare_published(law: LawFit, tool: str, work: str) -> PublishedComparison | None:
    """Comparison with the published law of this response, tool and work; None where none is known.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> from fitmodels.fit.published import compare_published
    >>> law = fit.exponential_law(datasets.read_runs(datasets.bundled("surf_table1")))
    >>> found = compare_published(law, "", "Ck 45")
    >>> round(found.worst_percent)
    -14
    """
    known = published_law(tool, work, law.response, law.form)
    if known is None:
        return None
    factors = {name: law.X[:, j] for j, name in enumerate(law.factors)}
    at = known.predict(factors)
    if at is None or law.by is not None:
        return PublishedComparison(known.source, known.coefficients, known.standard_error, None, None, None)
    percent = 100 * (law.observed / at - 1)
    worst = int(np.argmax(np.abs(percent)))
    return PublishedComparison(
        known.source,
        known.coefficients,
        known.standard_error,
        float(np.sqrt(np.mean(percent**2))),
        float(percent[worst]),
        int(law.lines[worst]),
    )
