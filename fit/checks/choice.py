"""Which rows of a very large law are checked: an even choice, which tells all that is to be told but their order."""

from ...core.errors import FitError
from ..lawfit import LawFit
from ..regression import refitted

MOST_ROWS = 5_000


def even_choice(law: LawFit, most: int = MOST_ROWS) -> LawFit:
    """The same law fitted to at most ``most`` of its rows, evenly chosen; the law itself where it has no more.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> even_choice(law).nobs, even_choice(law, 100).nobs
    (239, 80)
    """
    if law.nobs <= most:
        return law
    try:
        return refitted(law, law.error, slice(None, None, -(-law.nobs // most)))
    except FitError:  # a level or setting that the choice has missed
        return law
