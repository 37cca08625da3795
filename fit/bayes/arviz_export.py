"""A posterior as ArviZ stores it: InferenceData of version 0.23, a DataTree of versions from 1.0 on.

The likelihood is that of whole edges: rows of an edge share its level, and only edges can be left out. Where rows are
independent it is that of rows.
"""

import json
import warnings
from collections.abc import Mapping
from dataclasses import asdict
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import UsageError
from ...core.version import __version__

if TYPE_CHECKING:
    from .posterior import Posterior

Variable = tuple[tuple[str, ...], NDArray[Any], dict[str, str]]  # dimensions, values, attributes

MOST = 100_000_000  # log likelihoods: 800 MB
INSTALL = "pip install 'fitmodels[arviz]'"


def to_arviz(posterior: "Posterior") -> Any:  # noqa: ANN401
    """Convert a posterior to the classes of ArviZ.

    Parameters
    ----------
    posterior : Posterior
        Independent draws are cut into as many chains as the diagnostics took, four.

    Returns
    -------
    InferenceData (ArviZ 0.23) or DataTree (ArviZ 1), with the groups

    posterior
        Each parameter, dimensions ``chain, draw``.
    log_likelihood
        The response, dimensions ``chain, draw, edge``, or ``row`` where rows are independent; left out where
        draws times rows exceed 100 million.
    observed_data
        The response and each factor of every row, dimension ``row``, with the line of the file and the edge.

    and attributes ``method``, ``seed``, ``priors`` (JSON), ``errors``, ``notes`` and the version of fitmodels.

    Raises
    ------
    UsageError
        ArviZ is not installed.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> post = fit.posterior(law)
    >>> dict(to_arviz(post)["log_likelihood"].sizes)  # doctest: +SKIP
    {'chain': 4, 'draw': 1000, 'edge': 24}
    """
    arviz = _installed()
    xarray = import_module("xarray")
    attrs = _attributes(posterior)
    made = {"posterior": _draws(posterior), "observed_data": _observed(posterior)}
    if len(posterior.sample.phi) * len(posterior.density.units) <= MOST:
        made["log_likelihood"] = _log_likelihood(posterior)
    groups = {name: xarray.Dataset(*parts, attrs) for name, parts in made.items()}
    if arviz.__version__.startswith("0."):
        return arviz.InferenceData(attrs=attrs, **groups)
    return xarray.DataTree.from_dict({"/": xarray.Dataset(attrs=attrs), **groups})


def _installed() -> Any:  # noqa: ANN401
    """ArviZ, of either line; 0.23 announces the next one with a warning once a day."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", FutureWarning)
            return import_module("arviz")
    except ImportError as error:
        raise UsageError(f"ArviZ cannot be imported ({error}): install it by {INSTALL}.") from None


def _draws(posterior: "Posterior") -> tuple[dict[str, Variable], Mapping[str, Any]]:
    chains, length = _shape(posterior)
    draws = posterior.draws[: chains * length].reshape(chains, length, -1)
    variables: dict[str, Variable] = {
        name: (("chain", "draw"), draws[:, :, j], {}) for j, name in enumerate(posterior.names)
    }
    return variables, {"chain": np.arange(chains), "draw": np.arange(length)}


def _log_likelihood(posterior: "Posterior") -> tuple[dict[str, Variable], Mapping[str, Any]]:
    chains, length = _shape(posterior)
    density = posterior.density
    values = density.by_unit(posterior.sample.phi[: chains * length]).reshape(chains, length, -1)
    unit = "edge" if density.edges else "row"
    variables: dict[str, Variable] = {posterior.response: (("chain", "draw", unit), values, {})}
    return variables, {"chain": np.arange(chains), "draw": np.arange(length), unit: np.array(density.units)}


def _shape(posterior: "Posterior") -> tuple[int, int]:
    """Chains and draws of each, as the diagnostics took them."""
    return posterior.diagnostics.chains, posterior.diagnostics.length


def _observed(posterior: "Posterior") -> tuple[dict[str, Variable], Mapping[str, Any]]:
    law = posterior.law
    columns = {law.response: law.observed, **dict(zip(law.factors, law.X.T, strict=True))}
    variables: dict[str, Variable] = {
        name: (("row",), values, {"units": law.units.get(name, "")}) for name, values in columns.items()
    }
    coordinates: dict[str, Any] = {"row": np.array([f"line {line}" for line in law.lines])}
    if law.edge is not None:
        coordinates["edge"] = (("row",), law.edge.astype(str))
    return variables, coordinates


def _attributes(posterior: "Posterior") -> dict[str, Any]:
    """Attributes of every group: text and numbers, which can be written to a file."""
    priors = posterior.priors
    described = {
        name: {"distribution": prior.name, **asdict(prior), "unit": priors.units.get(name, "")}
        for name, prior in priors.of.items()
    }
    return {
        "inference_library": "fitmodels",
        "inference_library_version": __version__,
        "method": posterior.method,
        "words": posterior.sample.words,
        "seed": posterior.seed,
        "errors": posterior.errors,
        "priors": json.dumps({"name": priors.name, **described}),
        "notes": "\n".join(posterior.notes),
    }
