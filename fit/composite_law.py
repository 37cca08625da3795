"""Composite law: a law that has wear among its factors, with the wear law substituted.

``P = c V^a f^b d^g t^h AW^k`` gives the power at a *known* wear. To plan, AW must itself come from V, f, d, t:
substituting the wear law gives the composite law, fitting P without AW the reduced one. Fitted to the same rows and
factors in logarithms the two are the same numbers. AC-2016 substitutes eq. 6 into 4 and 5; its eq. 8 prints 0.264
where that gives 0.0264 (eq. 10's 0.067 agrees), its eq. 9 d^1.243 where that gives d^0.9878 (eq. 11's 799.62 agrees).

Source: Alaskari & Oraby 2016, doi 10.15242/IIE.E1216006, eq. 4-11.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from ..core.arrays import Array
from ..core.display import Plottable
from ..core.errors import UsageError
from .available import NotAvailable
from .fitted_rows import FittedRows
from .lawfit import LawFit
from .laws import LawForm
from .least_squares import linear
from .regression import facts_of, law_of, linear_stage

HIGH = 5.0  # variance inflation factor above which an exponent is weakly identified


@dataclass(frozen=True, slots=True, repr=False)
class Composite(Plottable):
    """A law with its wear substituted, and the law fitted without it.

    Attributes
    ----------
    law, wear_law : LawFit
        The law with the wear among its factors, and the law of the wear.
    names : tuple of str
        ``ln c0``, factors, shifts.
    theta, cov_theta : ndarray, shape (p,) and (p, p)
        By the delta method: jackknife of both laws together, edge by edge, where they were fitted to the same rows;
        else with the errors of the two laws taken as independent.
    together : bool
        True for the former.
    """

    law: LawFit
    wear_law: LawFit
    names: tuple[str, ...]
    theta: Array
    cov_theta: Array
    together: bool

    @property
    def reduced(self) -> LawFit | NotAvailable:
        """The law fitted without the wear, when it is asked for."""
        return without(self.law, self.wear_law.response)

    @property
    def params(self) -> "pd.Series[float]":
        """``c0`` in the unit of the response, exponents and shifts."""
        values = self.law.formula.coefficients(self.theta)
        return pd.Series(values, index=["c0", *self.names[1:]], name=self.law.response)

    @property
    def bse(self) -> "pd.Series[float]":
        """Standard errors of ``theta``, by the delta method."""
        return pd.Series(np.sqrt(np.diag(self.cov_theta)), index=list(self.names), name="bse")

    @property
    def comparison(self) -> pd.DataFrame:
        """Composite and reduced ``theta`` with standard errors, indexed by ``names``; no reduced columns if none."""
        table = pd.DataFrame({"composite": pd.Series(self.theta, index=list(self.names)), "se": self.bse})
        if isinstance(self.reduced, LawFit):
            index = list(self.reduced.theta_names)
            table["reduced"] = pd.Series(self.reduced.theta, index=index)
            table["reduced se"] = pd.Series(np.sqrt(np.diag(self.reduced.covariance())), index=index)
        return table

    @property
    def vif(self) -> float:
        """Variance inflation of the wear, when it is asked for: 1 / (1 - R2) of its logarithm on the other columns."""
        return _vif(self.law, 1 + self.law.factors.index(self.wear_law.response))

    @property
    def concern(self) -> int:
        """0: none; 1: the wear is nearly a function of the other factors. Remedy: the composite or the reduced law."""
        return int(self.vif > HIGH)

    @property
    def verdict(self) -> str:
        """Whether the exponent of wear is identified, in one sentence."""
        wear, others = self.wear_law.response, ", ".join(self.law.formula.other_factors(self.wear_law.response))
        if self.concern:
            return (
                f"{self.law.response}: {wear} is nearly a function of {others} (VIF {self.vif:.1f}, above {HIGH:g}), "
                f"so that its exponent is weakly identified; use the law without {wear} to plan."
            )
        return f"{self.law.response}: the exponent of {wear} is identified apart from {others} (VIF {self.vif:.1f})."

    @property
    def assumption(self) -> str:
        """The assumption behind the standard errors."""
        if self.together:
            return "joint jackknife by edge of both laws, which allows for dependence between their errors"
        return (
            f"the errors of the laws of {self.law.response} and {self.wear_law.response} are assumed independent; "
            "errors of rows from the same edge may be correlated"
        )


def substituted(law: Mapping[str, float], wear_law: Mapping[str, float], wear: str) -> dict[str, float]:
    """Coefficients of a power law with ``wear`` replaced by its own power law; eq. 8-9 of AC-2016, exactly.

    Parameters
    ----------
    law, wear_law : mapping
        ``c0`` and exponents by factor.
    wear : str
        Factor of ``law`` that ``wear_law`` gives.

    Raises
    ------
    UsageError
        ``wear`` is no factor of ``law``, or a factor of its own law.

    Examples
    --------
    >>> out = substituted({"c0": 2.0, "V": 0.8, "AW": 0.5}, {"c0": 0.04, "V": 0.6, "t": 0.2}, "AW")
    >>> {name: round(value, 6) for name, value in out.items()}
    {'c0': 0.4, 'V': 1.1, 't': 0.1}
    """
    if wear not in law or wear in wear_law:
        raise UsageError(f"{wear} cannot be substituted: it must be a factor of the law and none of its own law.")
    k = law[wear]
    names = [name for name in dict.fromkeys([*law, *wear_law]) if name not in ("c0", wear)]
    exponents = {name: law.get(name, 0.0) + k * wear_law.get(name, 0.0) for name in names}
    return {"c0": law["c0"] * wear_law["c0"] ** k, **exponents}


def composite(law: LawFit, wear_law: LawFit) -> Composite:
    """Substitute a wear law into a law that has that wear among its factors.

    Parameters
    ----------
    law, wear_law : LawFit
        Power laws; the response of the second is a factor of the first, in the same unit.

    Raises
    ------
    UsageError
        A law is no power law, its wear is no factor, or units or reference materials differ.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    >>> wear = fit.power_law(runs, "AW", ["V", "f", "d", "t"])
    >>> composite(fit.power_law(runs, "P", ["V", "f", "d", "t", "AW"]), wear).params.round(2)["V"].item()
    1.04
    """
    _check(law, wear_law)
    wear = wear_law.response
    mine, theirs = list(law.theta_names[1:]), list(wear_law.theta_names[1:])
    factors = list(dict.fromkeys([*law.formula.other_factors(wear), *wear_law.factors]))
    shifts = [name for name in dict.fromkeys([*mine, *theirs]) if name not in factors and name != wear]
    names = ["ln c0", *factors, *shifts]
    own, drawn = _places(["ln c0", *mine], names), _places(["ln c0", *theirs], names)
    at = 1 + law.factors.index(wear)
    k = law.theta[at]
    J = own.copy()
    J[:, at] = drawn @ wear_law.theta
    theta = own @ law.theta + k * drawn @ wear_law.theta
    together = _together(law, wear_law)
    if together is None:
        cov = J @ law.covariance() @ J.T + k**2 * drawn @ wear_law.covariance() @ drawn.T
    else:
        moved = together[0] @ J.T + k * together[1] @ drawn.T
        cov = (len(moved) - 1) / len(moved) * moved.T @ moved
    return Composite(law, wear_law, tuple(names), theta, cov, together is not None)


def without(law: LawFit, factor: str) -> LawFit | NotAvailable:
    """A power law fitted to the same rows without one of its factors.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    >>> without(fit.power_law(runs, "P", ["V", "f", "d", "t", "AW"]), "AW").factors
    ('V', 'f', 'd', 't')
    """
    j = law.factors.index(factor)
    if len(law.factors) == 1:
        return NotAvailable(f"{factor} is the only factor of {law.response}: nothing is left without it")
    if (law.observed <= 0).any():
        return NotAvailable(f"{law.response} is zero or negative in some rows: a refit starts from its logarithm")
    form = LawForm("power", law.response, law.formula.other_factors(factor))
    X, y = np.delete(law.X, j, axis=1), np.log(law.observed)
    theta, cov, eta, r, tss = linear_stage(form.design(X, law.shifts), y)
    rows = FittedRows(X, law.shifts, law.observed, np.exp(eta), r, law.lines, law.edge)
    facts = facts_of(law) | {"units": {name: unit for name, unit in law.units.items() if name != factor}}
    plain = law_of(form, "multiplicative", (theta, cov, rows.fitted, r, tss), rows, **facts)
    if law.error == "multiplicative":
        return plain
    return plain.alternative or NotAvailable(f"least squares in natural units without {factor} does not converge")


def _check(law: LawFit, wear_law: LawFit) -> None:
    wear = wear_law.response
    for each in (law, wear_law):
        if each.form != "power":
            raise UsageError(
                f"{each.response}: the form {each.form.replace('_', ' ')}; only power laws can be combined."
            )
    if wear not in law.factors or wear in wear_law.factors:
        raise UsageError(
            f"the law of {law.response} has the factors {', '.join(law.factors)}: {wear} is not among them, so its law "
            "cannot be substituted. Fit it with that wear as a factor."
        )
    if law.response in wear_law.factors:
        raise UsageError(f"the law of {wear} has {law.response} for a factor: neither can be substituted.")
    for name in (wear, *wear_law.factors):
        here, there = law.units.get(name), wear_law.units.get(name)
        if name in law.factors and here != there:
            raise UsageError(f"{name} is in {here or 'no unit'} in one law and in {there or 'no unit'} in the other.")
    if law.by and wear_law.by and law.by.column == wear_law.by.column and law.by.reference != wear_law.by.reference:
        raise UsageError(
            f"{law.by.column} counts from {law.by.reference} in one law and from {wear_law.by.reference} in the other: "
            "fit both to the same rows."
        )


def _together(law: LawFit, wear_law: LawFit) -> tuple[Array, Array] | None:
    """Changes of both laws as each edge is left out, where they share their rows."""
    here, there = law.edges, wear_law.edges
    if isinstance(here, NotAvailable) or isinstance(there, NotAvailable) or here.edges != there.edges:
        return None
    if not np.array_equal(law.lines, wear_law.lines):
        return None
    return here.moved, there.moved


def _places(of: list[str], names: list[str]) -> Array:
    """Matrix that puts parameters ``of`` into their places among ``names``; those not among them are omitted."""
    return np.array([[float(name == other) for other in of] for name in names])


def _vif(law: LawFit, at: int) -> float:
    Z = law.design
    fit = linear(np.delete(Z, at, axis=1), Z[:, at])
    return fit.tss / fit.rss if fit.rss > 0 else float("inf")


def without_fixed(law: LawFit) -> LawFit:
    """The law of the response over its fixed powers, such as Fc/d, of the other factors; the law itself without any.

    Its estimates, residuals and inference are those of the law; checks and posteriors, which take every coefficient as
    estimated, are of this one.
    """
    if not law.formula.fixed:
        return law
    given = dict(law.formula.fixed)
    keep = [j for j, name in enumerate(law.factors) if name not in given]
    formula = replace(law.formula, response=_quotient(law), factors=tuple(law.factors[j] for j in keep), fixed=())
    facts = {**facts_of(law), "units": {name: law.units.get(name, "") for name in formula.factors}}
    free = law.free
    cov = None if law.cov_theta is None else law.cov_theta[np.ix_(free, free)]
    if law.rows is None:
        return LawFit(
            formula=formula, error=law.error, theta=law.theta[free], cov_theta=cov, nobs=law.nobs, rss=law.rss,
            tss=law.tss, domain={name: law.domain[name] for name in formula.factors}, n_edges=law.n_edges,
            edges=law.edges, **facts,
        )  # fmt: skip
    over = np.exp(law.design[:, ~free] @ law.theta[~free])
    rows = replace(law.rows, X=law.X[:, keep], observed=law.observed / over, fitted=law.fitted / over)
    tss = float(np.sum((np.log(rows.observed) - np.log(rows.observed).mean()) ** 2))
    return LawFit.of_rows(
        rows,
        formula,
        error=law.error,
        theta=law.theta[free],
        cov_theta=cov,
        rss=law.rss,
        tss=tss,
        edges=law.edges,
        **facts,
    )


def _quotient(law: LawFit) -> str:
    """``Fc/d``, or ``M/Dc^2``: the response over its fixed powers."""
    powers = [name if b == 1 else f"{name}^{b:g}" for name, b in law.formula.fixed if b]
    return f"{law.response}/{powers[0] if len(powers) == 1 else '(' + ' '.join(powers) + ')'}"
