"""The posterior section: priors, summaries of the draws, and the file that holds the draws."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from .base import Count, NotNegative, Number, Section, Text

NUMBERS = {
    "normal": ("mean", "sd"),
    "half-t": ("df", "scale"),
    "beta": ("a", "b"),
    "gamma": ("shape", "rate"),
    "flat": (),
}


class Prior(Section):
    """Prior distribution of one parameter, and its source.

    Examples
    --------
    >>> Prior(distribution="normal", numbers={"mean": 0.0, "sd": 2.0}, unit="1").numbers["sd"]
    2.0
    """

    distribution: Literal["normal", "half-t", "beta", "gamma", "flat"]
    numbers: dict[str, Number] = Field(default_factory=dict)
    unit: str = ""
    source: str = ""

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if missing := [name for name in NUMBERS[self.distribution] if name not in self.numbers]:
            raise ValueError(f"the {self.distribution} prior has no {missing[0]}")
        return self


class PosteriorSummary(Section):
    """Mean, standard deviation, median and equal-tailed interval of the draws of one parameter.

    Examples
    --------
    >>> PosteriorSummary(mean=0.53, sd=0.05, median=0.53, low=0.44, high=0.63).high
    0.63
    """

    mean: Number
    sd: NotNegative
    median: Number
    low: Number
    high: Number


class Sensitivity(Section):
    """Prior sensitivity: shift of a posterior mean in posterior SD with priors of half and double width."""

    halved: Number
    doubled: Number


class LawPosterior(Section):
    """Posterior of one law, whose draws passed the convergence checks.

    Attributes
    ----------
    method : str
        ``exact``, ``importance`` or ``emcee``; ``words`` describe it in a sentence.
    errors : str
        ``normal`` or ``student``.
    draws, level
        Number of draws, and level of the intervals.
    parameters : dict of PosteriorSummary
        As the draws name them: ``ln c0``, exponents, ``sd``, ``icc``.
    priors : dict of Prior
        ``level`` is that of the linear form at the middle of the tests, ``level_at`` gives the factors there.
    prior_set : str
        ``weak``, ``reference`` or the name of a file.
    r_hat, ess : float
        The largest and the smallest of any parameter; ``k_hat`` where draws were weighted.
    verified : str or None
        Result of an independent run of chains, where requested.
    jackknife : dict of float
        Standard errors by edge of the same parameters: much above the posterior sd, the posterior is too narrow.
    elpd, elpd_se
        Expected log density of a left-out edge (row), summed, and its standard error.
    reason : str or None
        Set where there is no posterior.

    Examples
    --------
    >>> LawPosterior(reason="the law meets every row exactly").method is None
    True
    """

    reason: str | None = None
    method: Literal["exact", "importance", "emcee"] | None = None
    words: str | None = None
    errors: Literal["normal", "student"] | None = None
    draws: Count | None = None
    level: Annotated[float, Field(strict=True, gt=0, lt=1)] = 0.95
    parameters: dict[str, PosteriorSummary] = Field(default_factory=dict)
    priors: dict[str, Prior] = Field(default_factory=dict)
    prior_set: str | None = None
    level_at: dict[str, Number] = Field(default_factory=dict)
    r_hat: NotNegative | None = None
    ess: NotNegative | None = None
    k_hat: Number | None = None
    verified: str | None = None
    sensitivity: dict[str, Sensitivity] = Field(default_factory=dict)
    jackknife: dict[str, NotNegative] = Field(default_factory=dict)
    elpd: Number | None = None
    elpd_se: NotNegative | None = None
    notes: tuple[str, ...] = ()


class PosteriorSection(Section):
    """Posteriors of the laws, by response, and the file that holds their draws.

    ``draws_file`` is in the folder of the parameter file, ``draws_sha256`` is of its bytes; both are None where there
    are no draws. ``seed`` reproduces them.

    Examples
    --------
    >>> PosteriorSection(seed=1, laws={"AW": {"reason": "the law meets every row exactly"}}).draws_file is None
    True
    """

    seed: Count
    draws_file: Annotated[str, Field(pattern=r"^[A-Za-z0-9][\w.-]*\.npz$", max_length=100)] | None = None
    draws_sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")] | None = None
    laws: dict[Text, LawPosterior] = Field(default_factory=dict)
