"""Draws of laws of wear and loads together, and what they say of the true wear."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ...core.display import Plottable
from ...core.errors import UsageError
from ..available import NotAvailable
from ..checks.gauge import GaugeFit
from .diagnostics import Diagnostics
from .gate import Gate, gate
from .latent_density import LatentDensity
from .priors import Priors
from .sample import Sample

if TYPE_CHECKING:
    from ..lawfit import LawFit

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, repr=False)
class JointPosterior(Plottable):
    """Draws of the parameters of a law of wear and of laws of loads that act on the true wear.

    Attributes
    ----------
    wear_law, load_laws : LawFit, tuple of LawFit
        As fitted, the wear taken as exact.
    density : LatentDensity
    sample : Sample
    draws : ndarray, shape (S, q)
        Draws of ``names``: ``AW: V`` .. ``P: AW``, ``P: sd``, ``P: icc``, ``gauge sd`` where that is unknown.
    diagnostics : Diagnostics
    closed_form : tuple of GaugeFit or NotAvailable
        The correction of each load law by itself, without priors, or why it cannot be had.
    unit : str
        Of the gauge error: ``ln`` or the unit of the wear.
    left_out, coarse : int
        Rows that some law lacks; rows in which the gauge error is more than 0.3 of the wear.
    notes : tuple of str
    """

    wear_law: "LawFit"
    load_laws: "tuple[LawFit, ...]"
    density: LatentDensity
    sample: Sample
    draws: Array
    diagnostics: Diagnostics
    closed_form: tuple[GaugeFit | NotAvailable, ...]
    unit: str
    left_out: int
    coarse: int
    seed: int
    notes: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Parameters, each with the response of its law."""
        return self.density.told_names

    @property
    def gauge_sd(self) -> float:
        """Standard deviation of a reading as it was given."""
        return self.density.gauge_sd

    @property
    def method(self) -> str:
        """``importance`` or ``emcee``."""
        return self.sample.method

    @property
    def priors(self) -> dict[str, Priors]:
        """What was taken to be likely before the tests, by response."""
        return {law.law.response: law.priors for law in self.density.laws}

    @property
    def gate(self) -> Gate:
        """Whether the draws may be used."""
        return gate(self.diagnostics, None, self.sample.interrupted)

    def table(self, level: float = 0.95) -> pd.DataFrame:
        """Mean, sd, median and equal-tailed interval of each parameter, with its diagnostics."""
        if not 0 < level < 1:
            raise UsageError(f"level {level:g} of an interval: it lies between 0 and 1, for instance 0.95.")
        low, median, high = np.quantile(self.draws, [(1 - level) / 2, 0.5, (1 + level) / 2], axis=0)
        told = self.diagnostics
        columns = {"mean": self.draws.mean(axis=0), "sd": self.draws.std(axis=0, ddof=1), "median": median}
        columns |= {"low": low, "high": high, "r_hat": told.r_hat, "ess_bulk": told.ess_bulk, "ess_tail": told.ess_tail}
        return pd.DataFrame(columns, index=list(self.names))

    def for_law(self, response: str, level: float = 0.95) -> pd.DataFrame:
        """The rows of ``table`` of one law, named as that law names its parameters."""
        known = [law.law.response for law in self.density.laws]
        if response not in known:
            raise UsageError(f"no law of {response} here: there are {', '.join(known)}.")
        table = self.table(level)
        return table[table.index.str.startswith(f"{response}: ")].rename(lambda name: name.split(": ", 1)[1])

    @property
    def words(self) -> str:
        """One sentence: the exponent of the true wear beside that of the wear as it was read."""
        wear, table = self.wear_law.response, self.table()
        told = []
        for law in self.load_laws:
            true, plain = table.loc[f"{law.response}: {wear}"], law.conf_int().loc[wear]
            told.append(
                f"{law.response} goes with the true {wear} to the power {true['mean']:.2f} ({true['low']:.2f} to "
                f"{true['high']:.2f}), as read {law.params[wear]:.2f} ({plain['low']:.2f} to {plain['high']:.2f})"
            )
        return f"With a gauge error of {self.gauge_sd:g} {self.unit}, {'; '.join(told)}."

    def to_frame(self) -> pd.DataFrame:
        """The draws, a column a parameter."""
        return pd.DataFrame(self.draws, columns=list(self.names))
