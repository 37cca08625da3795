"""Priors: proper, weak, in the unit of what they are of, each with its source.

=========  ===========================================================================================
level      the response at the middle of the tests: lognormal about what is usual for the quantity
exponents  normal about 0 with sd 2: exponents printed in the field lie between -1 and 4
shifts     ln of the ratio between two levels: normal about 0 with sd 2
sd         scatter of rows, within an edge where there are edges: half Student-t with 4 degrees of freedom
icc        share of the variance between edges: uniform from 0 to 1
=========  ===========================================================================================

Lines, exponential laws and quantities that are not in the table get widths from the data (2.5 standard deviations of
the response, over that of the factor). ``reference`` is flat for level, exponents and sd, as many published
posteriors are: improper, and therefore only ever used as a whole.

Sources: Gelman 2006, Bayesian Analysis 1, 515 (half-t); Gelman et al. 2008, Ann. Appl. Stat. 2, 1360, and the
rstanarm manual (2.5 sd); Kienzle & Victor 1957 and ISO 3685 for the size of exponents and of wear.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import lgamma, log, pi
from typing import ClassVar

import numpy as np

from ...core.arrays import Array
from ...core.display import Displayable, Plottable
from ...core.errors import UsageError
from ...core.formula import Term
from ..lawfit import LawFit

EXPONENT_SD = 2.0
SCATTER = 0.3  # of the response: half of all laws scatter less than about this
DF = 4.0
DATA_WIDTH = 2.5

# Usual size of a quantity in its canonical unit, and the factor either way that is one standard deviation.
USUAL: Mapping[str, tuple[float, float, str]] = {
    "AW": (0.2, 10.0, "ISO 3685: an edge is worn out at 0.3 mm"),
    "VB": (0.2, 10.0, "ISO 3685: an edge is worn out at 0.3 mm"),
    "P": (3.0, 10.0, "spindles of machine tools: 0.3 to 30 kW"),
    "Ra": (1.6, 5.0, "ISO 1302 grades N5 to N9"),
    "Rz": (6.3, 5.0, "ISO 1302, about four times Ra"),
    "I": (5.0, 10.0, "spindle drives: 0.5 to 50 A"),
    "M": (20.0, 10.0, "spindles of machine tools: 2 to 200 Nm"),
    "T": (20.0, 10.0, "ISO 3685: tests of 5 to 60 min"),
    **dict.fromkeys(
        ("F", "Fx", "Fy", "Fz", "Fxz", "Fc", "Ff", "Fp"), (500.0, 10.0, "specific force 2000 N/mm2 on 0.25 mm2")
    ),
}  # fmt: skip


@dataclass(frozen=True, slots=True, repr=False)
class Normal(Displayable):
    """Normal about ``mean`` with standard deviation ``sd``."""

    mean: float
    sd: float
    name: ClassVar[str] = "normal"

    def log_density(self, x: Array) -> Array:
        """Log density at x."""
        return -0.5 * ((x - self.mean) / self.sd) ** 2 - log(self.sd) - 0.5 * log(2 * pi)

    def scaled(self, by: float) -> "Normal":
        """The prior with ``by`` times the width."""
        return replace(self, sd=self.sd * by)

    def draw(self, rng: np.random.Generator, n: int) -> Array:
        """Draw n values."""
        return rng.normal(self.mean, self.sd, n)


@dataclass(frozen=True, slots=True, repr=False)
class HalfT(Displayable):
    """Half Student-t above zero."""

    df: float
    scale: float
    name: ClassVar[str] = "half-t"

    def log_density(self, x: Array) -> Array:
        """Log density at x > 0."""
        v = self.df
        constant = log(2) + lgamma((v + 1) / 2) - lgamma(v / 2) - 0.5 * log(v * pi) - log(self.scale)
        return constant - (v + 1) / 2 * np.log1p((x / self.scale) ** 2 / v)

    def scaled(self, by: float) -> "HalfT":
        """The prior with ``by`` times the width."""
        return replace(self, scale=self.scale * by)

    def draw(self, rng: np.random.Generator, n: int) -> Array:
        """Draw n values."""
        return np.abs(rng.standard_t(self.df, n)) * self.scale


@dataclass(frozen=True, slots=True, repr=False)
class Beta(Displayable):
    """Beta from 0 to 1; ``Beta(1, 1)`` is uniform. It has no width: scaling does not change it."""

    a: float
    b: float
    name: ClassVar[str] = "beta"

    def log_density(self, x: Array) -> Array:
        """Log density at 0 < x < 1."""
        constant = lgamma(self.a + self.b) - lgamma(self.a) - lgamma(self.b)
        return constant + (self.a - 1) * np.log(x) + (self.b - 1) * np.log1p(-x)

    def scaled(self, by: float) -> "Beta":
        """The prior itself."""
        return self

    def draw(self, rng: np.random.Generator, n: int) -> Array:
        """Draw n values."""
        return rng.beta(self.a, self.b, n)


@dataclass(frozen=True, slots=True, repr=False)
class Flat(Displayable):
    """Flat, improper: no density, only a constant."""

    name: ClassVar[str] = "flat"

    def log_density(self, x: Array) -> Array:
        """Zero."""
        return np.zeros_like(x)

    def scaled(self, by: float) -> "Flat":
        """The prior itself."""
        return self

    def draw(self, rng: np.random.Generator, n: int) -> Array:
        """Refuse: a flat prior has no draws."""
        raise UsageError("a flat prior has no draws: give a proper one, for instance a normal.")


Prior = Normal | HalfT | Beta | Flat


@dataclass(frozen=True, slots=True, repr=False)
class Priors(Plottable):
    """Priors of a law's parameters.

    Attributes
    ----------
    of : mapping of str to Prior
        ``level`` (of the linear form at the middle of the tests: ln R, or R of a line), each exponent, coefficient
        or shift by its name, ``sd`` and, where there are edges, ``icc``.
    name : str
        ``weak``, ``reference`` or the file they come from.
    units, sources : mapping of str to str
        Of each prior, for display.
    """

    of: Mapping[str, Prior]
    name: str
    units: Mapping[str, str] = field(default_factory=dict)
    sources: Mapping[str, str] = field(default_factory=dict)

    @property
    def proper(self) -> bool:
        """Whether every one of them integrates to one."""
        return not any(isinstance(prior, Flat) for prior in self.of.values())

    def scaled(self, by: float) -> "Priors":
        """The priors with ``by`` times every width."""
        return replace(self, of={name: prior.scaled(by) for name, prior in self.of.items()})

    def with_(self, name: str, **changed: Prior) -> "Priors":
        """The priors with some of them replaced, under a new name."""
        return replace(self, of={**self.of, **changed}, name=name)


def weak(law: LawFit, edges: bool) -> Priors:
    """The default: proper and weak.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> weak(law, edges=True).of["V"]
    Normal: mean 0, sd 2
    """
    of: dict[str, Prior] = {}
    units = units_of_priors(law)
    sources = {}
    natural = law.error == "additive"
    if law.form == "power" and law.response in USUAL:
        usual, factor, source = USUAL[law.response]
        of["level"] = Normal(log(usual), log(factor))
        of |= {name: Normal(0.0, EXPONENT_SD) for name in law.theta_names[1:]}
        of["sd"] = HalfT(DF, SCATTER * (usual if natural else 1.0))
        sources = {
            "level": source,
            **dict.fromkeys(law.theta_names[1:], "exponents of published cutting laws range from -1 to 4"),
        }
        sources["sd"] = "scatter of cutting tests: 5 to 50 %"
    else:
        of, sources = _from_data(law)
    if edges:
        of["icc"] = Beta(1.0, 1.0)
        sources["icc"] = "uniform: no prior knowledge of the variance between edges"
    return Priors(of, "weak", units, sources)


def reference(law: LawFit, edges: bool) -> Priors:
    """Flat priors for all parameters but the share between edges; improper, only used as a whole."""
    of: dict[str, Prior] = {name: Flat() for name in ("level", *law.theta_names[1:], "sd")}
    if edges:
        of["icc"] = Beta(1.0, 1.0)
    return Priors(of, "reference", units_of_priors(law), dict.fromkeys(of, "flat, as in published posteriors"))


def units_of_priors(law: LawFit) -> dict[str, str]:
    """Unit of the parameter of each prior; ``ln mm`` for the logarithm of a length in mm."""
    response = law.units.get(law.response, "")
    level = f"ln {response}".strip() if law.formula.logarithmic else response
    top = "1" if law.formula.logarithmic else response
    units = dict.fromkeys(law.theta_names[1:], top)  # those of shifts
    for name, term in zip(law.formula.names[1:], law.formula.all_terms, strict=True):
        per = [f"{law.units.get(x, '')}^{d}" if d > 1 else law.units.get(x, "") for x, d in _unlogged(law, term)]
        units[name] = f"{top}/({' '.join(per)})" if per else top
    return {"level": level, **units, "sd": "ln" if law.error == "multiplicative" else response, "icc": "1"}


def _unlogged(law: LawFit, term: Term) -> list[tuple[str, int]]:
    """Factors of a term that enter as they are, each with its power."""
    each = zip(law.factors, law.formula.logs, term.degrees, strict=True)
    return [(name, degree) for name, log, degree in each if degree and not log]


def _from_data(law: LawFit) -> tuple[dict[str, Prior], dict[str, str]]:
    """Widths of 2.5 standard deviations of the data, for quantities without a usual size."""
    y = np.log(law.observed) if law.formula.logarithmic and (law.observed > 0).all() else law.observed
    if law.formula.logarithmic and not (law.observed > 0).all():
        y = np.log(np.maximum(law.fitted, np.abs(law.fitted).max() * 1e-3))
    width = float(y.std(ddof=1)) or max(abs(float(y.mean())), 1.0)
    Z = law.design[:, 1:]
    spread = Z.std(axis=0, ddof=1)
    of: dict[str, Prior] = {"level": Normal(float(y.mean()), DATA_WIDTH * width)}
    of |= {
        name: Normal(0.0, DATA_WIDTH * width / float(s or 1.0))
        for name, s in zip(law.theta_names[1:], spread, strict=True)
    }
    scatter = float(law.observed.std(ddof=1)) or abs(float(law.observed.mean())) or 1.0
    of["sd"] = HalfT(DF, scatter if law.error == "additive" else width)
    return of, dict.fromkeys(of, "2.5 standard deviations of the data (rstanarm's default)")
