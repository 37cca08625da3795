"""The model of a parameter file's dynamics, for the commands that work on it."""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ..ident import Model
    from ..parameters.sections.dynamics import DynamicsSection


def model_of(d: "DynamicsSection") -> "Model":
    """A dynamics section as a model, with its covariance where it has one."""
    from ..ident import Model
    from ..parameters.sections.base import ModelCovariance

    model = Model(
        b=np.array(d.b), a=np.array(d.a), nk=d.nk, sample_time=d.sample_time, input=d.input, output=d.output,
        unit_u=d.unit_u, unit_y=d.unit_y, band=d.band,
    )  # fmt: skip
    if not isinstance(d.uncertainty, ModelCovariance):
        return model
    order = [d.uncertainty.of.index(name) for name in model.names]
    return replace(model, cov_params=np.array(d.uncertainty.matrix)[np.ix_(order, order)])
