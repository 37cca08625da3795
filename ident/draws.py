"""Draws of models: the coefficients of a model and of its alternatives from their normal distributions.

    p(theta) = sum_k w_k N(theta_k, P_k)

k are the structures (orders and delay) that the record supports and w_k their weights, so that draws, bands and
probabilities include the uncertainty of the orders. Draws that are unstable where their model is stable are left out:
the machine was stable while it was recorded. Source: Hoeting, Madigan, Raftery & Volinsky 1999, Stat. Sci. 14, 382.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..core.arrays import Array
from ..core.errors import IdentError, UsageError
from .model import Model
from .pi.loops import stable_columns

FEWEST = 0.5  # share of draws that must be stable
HALVINGS = 60  # of an interval in the search of a quantile


@dataclass(frozen=True, slots=True)
class Plants:
    """Plants compatible with the data.

    Attributes
    ----------
    models : tuple of Model
    left_out : int
        Number of unstable draws omitted.
    given : bool
        Given by the caller, not drawn: their share is counted, not estimated.
    structures : int
        Number of structures (orders and delay) that were drawn.
    """

    models: tuple[Model, ...]
    left_out: int = 0
    given: bool = False
    structures: int = 1


def components(model: Model) -> tuple[tuple[float, Model], ...]:
    """Structures of a model with their weights, its own first; an unstable alternative of a stable model is omitted.

    >>> model = Model(b=[0.0, 0.5], a=[1.0, -0.5], nk=1, sample_time=0.1)
    >>> [weight for weight, _ in components(model)]
    [1.0]
    """
    own = 1 - sum(weight for weight, _ in model.alternatives)
    usable = [(own, model), *((w, m) for w, m in model.alternatives if bounded(m) or not bounded(model))]
    total = sum(weight for weight, _ in usable)
    return tuple((weight / total, one) for weight, one in usable)


def bounded(model: Model) -> bool:
    """Whether every pole lies inside the unit circle, but for one at exactly 1 (an integrator).

    >>> [bounded(Model(b=[0.0, 1.0], a=[1.0, a], nk=1, sample_time=0.1)) for a in (-0.9, -1.0, -1.1)]
    [True, True, False]
    """
    return model.stable or model.integrating


def with_theta(model: Model, theta: Array) -> Model:
    """The model with other coefficients."""
    b, a = np.r_[np.zeros(model.nk), theta[model.na :]], np.r_[1.0, theta[: model.na]]
    return Model(b=b, a=a, nk=model.nk, sample_time=model.sample_time)


def drawn_models(model: Model, count: int = 500, seed: int | Sequence[int] = 1, least: float = FEWEST) -> Plants:
    """Draws of the structures and coefficients of a model.

    Parameters
    ----------
    model : Model
        With covariance; an alternative without one is drawn at its estimate.
    count : int
        Each structure has its share of them by weight, in random order.
    seed : int or sequence of int
    least : float
        Share of the draws that must be stable.

    Raises
    ------
    IdentError
        No covariance; fewer stable draws than required, where the model is stable.

    Examples
    --------
    >>> cov = np.diag([1e-4, 1e-4])
    >>> other = Model(b=[0.0, 0.0, 0.6], a=[1.0, -0.4], nk=2, sample_time=0.1, cov_params=cov)
    >>> model = Model([0.0, 0.5], [1.0, -0.5], 1, 0.1, cov_params=cov, alternatives=((0.25, other),))
    >>> sum(one.nk == 2 for one in drawn_models(model, 100).models)
    25
    """
    if model.cov_params is None:
        raise IdentError(
            f"model of structure {model.structure!r} has no covariance: its uncertainty is unknown. Identify it "
            "from a record, or give several models."
        )
    if count < 10:
        raise UsageError(f"draws {count!r}: 10 or more, usually 500.")
    rng, kept = np.random.default_rng(seed), []
    parts = components(model)
    for number, (_, one) in zip(allotted([weight for weight, _ in parts], count), parts, strict=True):
        kept += _drawn(one, number, rng)
    if len(kept) < max(least * count, 1):
        raise IdentError(
            f"{1 - len(kept) / count:.0%} of the draws of the model are unstable: its uncertainty is too large "
            "to tune on. Record longer, excite lower frequencies, or lower the orders."
        )
    order = rng.permutation(len(kept)) if len(parts) > 1 else range(len(kept))
    return Plants(tuple(kept[k] for k in order), count - len(kept), structures=len(parts))


def allotted(weights: Sequence[float], count: int) -> list[int]:
    """Whole numbers that sum to ``count``, in proportion to weights (largest remainders).

    >>> allotted([0.5, 0.3, 0.2], 9)
    [4, 3, 2]
    """
    shares = count * np.asarray(weights)
    numbers = np.floor(shares + 1e-9).astype(int)
    missing = count - int(numbers.sum())
    numbers[np.argsort(numbers - shares, kind="stable")[:missing]] += 1
    return [int(number) for number in numbers]


def _drawn(model: Model, count: int, rng: np.random.Generator) -> list[Model]:
    """Draws of one structure, without those unstable where it is stable."""
    if model.cov_params is None:
        return [model] * count
    thetas = model.theta + rng.standard_normal((count, len(model.theta))) @ root_of(model.cov_params).T
    if not bounded(model):
        return [with_theta(model, theta) for theta in thetas]
    a = np.vstack([np.ones(count), thetas[:, : model.na].T])
    if model.integrating:  # the covariance holds the pole at 1 only up to rounding: divide by 1 - z^-1, multiply by it
        a = np.cumsum(a, axis=0)[:-1]
        thetas[:, : model.na] = np.diff(a, axis=0, append=0.0).T
    return [with_theta(model, theta) for theta in thetas[stable_columns(a)]]


def root_of(cov: Array) -> Array:
    """Root R of a covariance, P = R R', by the eigenvalues of its correlations; P may be singular.

    >>> cov = np.array([[4.0, 1.0], [1.0, 0.25]])
    >>> bool(np.allclose(root_of(cov) @ root_of(cov).T, cov))
    True
    """
    deviation = np.sqrt(np.maximum(np.diag(cov), 0.0))
    scale = np.where(deviation > 0, deviation, 1.0)
    values, vectors = np.linalg.eigh(cov / np.outer(scale, scale))
    return np.asarray(deviation[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)), dtype=np.float64)


def mixture_quantile(share: float, weights: Array, means: Array, errors: Array) -> Array:
    """Quantile of mixtures of normal distributions, by bisection of their distribution function.

    Parameters
    ----------
    share : float
        Between 0 and 1.
    weights : ndarray, shape (k,)
    means, errors : ndarray, shape (k, ...)
        Of each part.

    Returns
    -------
    ndarray, shape (...)

    Examples
    --------
    >>> two = np.array([0.5, 0.5])
    >>> [round(float(mixture_quantile(q, two, np.array([-1.0, 1.0]), np.array([0.1, 0.1]))), 3) for q in (0.25, 0.75)]
    [-1.0, 1.0]
    """
    from scipy.special import ndtr, ndtri

    if len(weights) == 1:
        return np.asarray(means[0] + ndtri(share) * errors[0], dtype=np.float64)
    ends = means + ndtri(share) * errors  # the quantile of the mixture lies between those of its parts
    low, high = ends.min(axis=0), ends.max(axis=0)
    spread = np.maximum(errors, np.finfo(np.float64).tiny)
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        with np.errstate(over="ignore"):  # a part without error is below with probability 0 or 1
            z = (middle - means) / spread
        below = np.tensordot(weights, ndtr(z), axes=1) < share
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return np.asarray((low + high) / 2, dtype=np.float64)
