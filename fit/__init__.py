"""Static laws: power, exponential and load laws, their inference by edge, checks, posteriors and predictions.

    laws         forms of the laws: formula, gradient, first guess, text
    rows         selection of rows and factors; regression: the fits of rows in memory -> `LawFit`
    edges        inference by edge; edge_sums and streaming: the same from sums, for any number of rows
    many/        laws of thousands of pairs at once, and pooling over families of pairs
    region, prediction, confirmation, next_tests, life: what follows from a law
    checks/      tests of one law; bayes/: posteriors of its parameters
    surface/     response surfaces of second order: tests of terms, selection of terms, canonical analysis

``PowerLawRegressor`` needs scikit-learn and is imported on first use; it is not in ``__all__``.
"""

from ..core.errors import UsageError
from ..core.lazy import lazy_names

_public, __dir__, __all__ = lazy_names(__name__, __file__)


def __getattr__(name: str) -> object:
    if name != "PowerLawRegressor":
        return _public(name)
    try:
        from .estimator import PowerLawRegressor
    except ModuleNotFoundError as error:
        if error.name is None or not error.name.startswith("sklearn"):
            raise
        raise UsageError("scikit-learn is not installed: pip install 'fitmodels[sklearn]'.") from None
    return PowerLawRegressor
