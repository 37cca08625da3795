"""What a route to draws returns, whatever the model."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ...core.display import Displayable

Array = NDArray[np.float64]
Method = Literal["exact", "importance", "emcee"]


@dataclass(frozen=True, slots=True, repr=False)
class Sample(Displayable):
    """Draws on the scale of a density's ``phi``, all of one weight.

    Attributes
    ----------
    phi : ndarray, shape (S, p)
        Chain after chain.
    chains : int
        How many chains of S / chains draws; 1 where draws are independent.
    method : {"exact", "importance", "emcee"}
    words : str
        How they were drawn, in one sentence.
    k_hat : float or None
        Pareto shape of the importance weights.
    ess : float or None
        Effective number of draws by the weights, or by the autocorrelation time: what their own route knows of
        them, beside the diagnostics of the draws.
    tau : ndarray, shape (p,), or None
        Autocorrelation time in draws of one chain.
    interrupted : bool
        Whether somebody stopped it before the gate opened.
    """

    phi: Array
    chains: int
    method: Method
    words: str
    k_hat: float | None = None
    ess: float | None = None
    tau: Array | None = None
    interrupted: bool = False
