"""How every pair is fitted, and what is made of it."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from math import inf
from typing import Any, Literal, TypeAlias, get_args

from ..core.display import Displayable
from ..core.errors import UsageError
from .plan import Reading

Error: TypeAlias = Literal["multiplicative", "additive"]


@dataclass(frozen=True, slots=True, repr=False)
class How(Displayable):
    """Options of the fits, with the names and the defaults of ``fitmodels FILE``.

    Attributes
    ----------
    files : bool
        A parameter file for each pair, with checks and posterior, besides its row in the table.
    draws_kept : bool
        The draws of each posterior beside its parameter file too (about half a megabyte a law).
    error : str
    criterion, gauge_sd : float or None
        In mm.
    seed, draws : int
        Every pair is drawn with the same seed, as it would be by itself.
    priors : str or mapping
        ``weak``, ``reference`` or what a TOML file of priors holds.
    student : bool
    command : str
        Goes into the provenance of each file.
    """

    files: bool = True
    draws_kept: bool = False
    error: Error = "multiplicative"
    criterion: float | None = None
    gauge_sd: float | None = None
    seed: int = 1
    draws: int = 4000
    priors: str | Mapping[str, object] = "weak"
    student: bool = False
    command: str = ""

    def check(self) -> None:
        """Refuse what no pair could be fitted with.

        Raises
        ------
        UsageError

        Examples
        --------
        >>> How(draws=3).check()
        Traceback (most recent call last):
        fitmodels.core.errors.UsageError: 3 draws: at least 1000, below which no gate opens, and at most 1000000.
        """
        from ..fit.bayes.draw_posterior import FEWEST, MOST

        if self.error not in get_args(Error):
            raise UsageError(f"error={self.error!r}: it is one of {', '.join(get_args(Error))}.")
        if self.criterion is not None and not 0 < self.criterion < inf:
            raise UsageError(f"criterion {self.criterion:g}: wear of a worn edge lies above zero, for instance 0.3.")
        if self.gauge_sd is not None and not 0 <= self.gauge_sd < inf:
            raise UsageError(f"gauge_sd {self.gauge_sd:g}: a standard deviation is not below zero, for instance 0.01.")
        if not 0 <= self.seed < 2**32:
            raise UsageError(f"seed {self.seed}: it lies between 0 and {2**32 - 1}.")
        if not FEWEST <= self.draws <= MOST:
            raise UsageError(f"{self.draws} draws: at least {FEWEST}, below which no gate opens, and at most {MOST}.")

    def facts(self, reading: Reading) -> dict[str, Any]:
        """All that the numbers of a pair depend on besides its rows, for a key that tells whether they changed."""
        facts = asdict(self) | {"reading": asdict(reading)}
        return {name: value for name, value in facts.items() if name != "command"}
