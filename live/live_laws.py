"""Laws of wear and of loads as the estimate of one edge needs them: log-linear, with the scatter between edges.

A wear law ``w = c0 V^a f^b d^g t^m`` holds at constant conditions. Where they change, wear grows at every moment as
fast as it would at that wear under the conditions of the moment, so that ``w^(1/m)`` is additive:

    ln w = m ln S,    S = sum_i C(V_i, f_i, d_i)^(1/m) t_i,    C = c0 V^a f^b d^g,

over the minutes t_i at each setting, in any order.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from typing import TYPE_CHECKING

import numpy as np

from ..controllers.region.log_planes import USUAL, ratio
from ..core.arrays import Array, is_positive
from ..core.errors import UsageError
from ..core.formula import Formula
from ..datasets.vocabulary import FLANK_WEAR
from ..parameters.evaluation import covariance_of
from .edge_scatter import Assumptions, EdgeScatter, scatter_of_edges, typical_response

if TYPE_CHECKING:
    from ..parameters import LawSection, ParameterFile
    from ..parameters.draws import Draws

TIME = "t"
ONE = np.ones(1)
FEWEST_DRAWS = 100  # from which a covariance is estimated
FAR = 3.0  # times outside of the tested range, from which on a law gives no decision
OTHER_UNITS = {"m/min": ("m/s", "ft/min"), "mm/rev": ("in/rev",), "mm": ("in", "m", "um")}  # that may be meant
CLEARLY = 1.96  # standard errors of its exponent of wear above zero, from which a load shows wear
UNCLEAR = (
    "{0} is not used to estimate {1}: in its law the exponent of {1} is {2:.2g} (95 % between {3:.2g} and {4:.2g}), "
    "not clearly above zero. A sudden rise or fall of {0} is still an alarm. {5}"
)
WITHOUT_T = 'Fit the law of {0} without t (--law "{0} ~ {1}"), which shares its rise between t and {2}.'
WIDER = "Test over a wider range of {0}."


@dataclass(frozen=True, slots=True)
class LiveLaw:
    """One law, linear in its parameters for the logarithm of its response, and the scatter of edges about it.

    Attributes
    ----------
    symbol, unit, quantity : str
    formula : Formula
    theta : ndarray, shape (p,)
        Mean of the parameters: ln c0, exponents, and shifts of the levels of a category.
    covariance : ndarray, shape (p, p)
    sd_level : float
        Standard deviation between edges of ln response.
    df : float
        Degrees of freedom of ``sd_level``.
    shifts : ndarray, shape (number of shifts,)
        1 at the level of the work that is cut.
    scales : ndarray, shape (k,)
        Factors from the usual units of V, f, d and t to those of the law.
    ranges : mapping of (low, high)
        Tested, by factor, in the usual units.
    unclear : str
        Of a load: why its law is not used to estimate wear; it gives the expected load in any case.

    """

    symbol: str
    unit: str
    quantity: str
    formula: Formula
    theta: Array
    covariance: Array
    sd_level: float
    df: float
    shifts: Array
    scales: Array
    ranges: Mapping[str, tuple[float, float]]
    unclear: str = ""

    @property
    def shows_wear(self) -> bool:
        """Whether the law of a load is used to estimate wear."""
        return not self.unclear

    def columns(self, given: Mapping[str, float]) -> Array:
        """Columns of the law at given factors, shape (p,), in the usual units."""
        X = np.array([given[name] for name in self.formula.factors]) * self.scales
        plain = np.concatenate([ONE, np.log(X)]) if self.formula.name == "power" else self.formula.columns(X)
        return np.concatenate([plain, self.shifts])

    def slope(self, symbol: str, given: Mapping[str, float]) -> float:
        """Derivative of the ln of the response by the ln of one factor."""
        return float(self._by_ln(symbol, given) @ self.theta)

    def slope_se(self, symbol: str, given: Mapping[str, float]) -> float:
        """Standard error of `slope`."""
        by_ln = self._by_ln(symbol, given)
        return float((by_ln @ self.covariance @ by_ln) ** 0.5)

    def _by_ln(self, symbol: str, given: Mapping[str, float]) -> Array:
        """Derivatives of the columns by the ln of one factor, shape (p,)."""
        by_ln: Array = np.zeros(len(self.theta))
        if symbol not in self.formula.factors:
            return by_ln
        if self.formula.name == "power":
            by_ln[1 + self.formula.factors.index(symbol)] = 1.0
            return by_ln
        step = 1e-4
        up, down = ({**given, symbol: given[symbol] * np.exp(sign * step)} for sign in (1, -1))
        by_ln += (self.columns(up) - self.columns(down)) / (2 * step)
        return by_ln

    def outside(self, given: Mapping[str, float]) -> tuple[str, ...]:
        """Factors outside their tested ranges, in words."""
        far = [(name, given[name], *ends) for name, ends in self.ranges.items() if name in given]
        return tuple(
            f"{name} {value:.4g} (tested {low:g} to {high:g})"
            for name, value, low, high in far
            if not low * (1 - 1e-6) <= value <= high * (1 + 1e-6)
        )


@dataclass(frozen=True, slots=True)
class LiveLaws:
    """Laws of wear and of loads of one tool and work.

    Attributes
    ----------
    wear : LiveLaw
        A power law on the time of contact t.
    loads : mapping of LiveLaw
        By symbol; each depends on the wear. Those whose exponent of it is not clearly above zero show no wear.
    criterion : float or None
        Wear at the end of life that the file states, in the unit of the wear law.
    tested : (float, float)
        Shortest and longest time of contact in the tests, min.
    simulated : bool
    scatter : EdgeScatter
        Of edges about these laws.
    notes : tuple of str
        What was assumed and what was left out, in sentences.

    Examples
    --------
    >>> from fitmodels import datasets, fit, parameters
    >>> runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    >>> found = [fit.power_law(runs, "AW", ["V", "f", "d", "t"]), fit.power_law(runs, "P", ["V", "f", "d", "t", "AW"])]
    >>> laws = LiveLaws.of(parameters.collect(laws=found))
    >>> laws.wear.symbol, tuple(laws.loads), laws.conditions
    ('AW', ('P',), ('V', 'f', 'd'))
    """

    wear: LiveLaw
    loads: Mapping[str, LiveLaw]
    criterion: float | None
    tested: tuple[float, float]
    simulated: bool
    scatter: EdgeScatter
    notes: tuple[str, ...] = ()

    @classmethod
    def of(
        cls,
        pf: "ParameterFile",
        draws: "Mapping[str, Draws] | None" = None,
        *,
        wear: str | None = None,
        loads: Sequence[str] | None = None,
        by: str | None = None,
        assumptions: Assumptions | None = None,
    ) -> "LiveLaws":
        """Laws of a parameter file.

        Parameters
        ----------
        pf : ParameterFile
        draws : mapping of Draws, optional
            Posterior draws of `parameters.read_draws`; without them the covariances of the file are used.
        wear : str, optional
            Symbol of the wear; otherwise that of the tool life, or the power law on t on which other laws depend.
        loads : sequence of str, optional
            Symbols of the loads that the machine gives; otherwise every law that depends on the wear.
        by : str, optional
            Level of a category of the laws, such as the work material.
        assumptions : Assumptions, optional

        Raises
        ------
        UsageError
            The file has no law of wear that grows with time, or a named load has no law that depends on the wear.
        """
        draws = draws or {}
        symbol = _wear_symbol(pf, wear)
        law = _live_law(pf.laws[symbol], draws.get(symbol), by, USUAL)
        _check_wear(law)
        named = [name for name, one in pf.laws.items() if symbol in one.formula.factors] if loads is None else loads
        found, notes = {}, []
        for name in named:
            fault = _load_fault(pf, name, symbol)
            if fault and loads is not None:
                raise UsageError(fault)
            if fault:
                notes.append(fault)
                continue
            one = _live_law(pf.laws[name], draws.get(name), by, {**USUAL, symbol: law.unit})
            if unclear := _unclear(one, symbol):  # the printed law gives the expected load
                one = replace(_live_law(pf.laws[name], None, by, {**USUAL, symbol: law.unit}), unclear=unclear)
            found[name] = one
        life, limits = pf.tool_life, pf.limits
        criterion = life.criterion * ratio(life.unit_of_wear, law.unit) if life and life.wear == symbol else None
        if limits and limits.wear and (limits.wear.of or symbol) == symbol:
            criterion = limits.wear.value * ratio(limits.wear.unit, law.unit)
        elif limits and limits.wear:
            notes.append(f"the limit of {limits.wear.of} is not applied: the wear law in use is that of {symbol}")
        low, high = law.ranges[TIME]
        if not all(name in draws for name in (symbol, *found)):
            notes.append("uncertainty of the laws: covariances of the file, as it has no draws of all laws")
        exponent = float(law.theta[1 + law.formula.factors.index(TIME)])
        scatter = scatter_of_edges(
            pf.laws[symbol], [pf.laws[name] for name in found], exponent, assumptions or Assumptions()
        )
        laws = cls(law, found, criterion, (low, high), bool(pf.identity.simulated), scatter)
        return replace(laws, notes=(*notes, *laws.unused, *scatter.notes))

    @property
    def unused(self) -> tuple[str, ...]:
        """Sentences on the loads that show no wear, with the remedy."""
        return tuple(law.unclear for law in self.loads.values() if law.unclear)

    @property
    def fingerprint(self) -> str:
        """First digits of the SHA-256 of all numbers: a state is of use with the same laws alone."""
        digest = sha256()
        for law in (self.wear, *self.loads.values()):
            digest.update(f"{law.symbol} {law.unit} {law.formula.factors} {law.sd_level!r} {law.df!r}".encode())
            digest.update(np.concatenate([law.theta, law.covariance.ravel(), law.shifts, law.scales]).tobytes())
        return digest.hexdigest()[:16]

    @property
    def df(self) -> float:
        """Degrees of freedom of the variance of wear: those of the scatter of edges, summed over the laws used.

        As for a sum of about equal variances (Satterthwaite 1946, Biometrics Bulletin 2, 110).
        """
        return self.wear.df + sum(law.df for law in self.loads.values() if law.shows_wear)

    @property
    def largest_wear(self) -> float:
        """Largest wear in the tests of the loads, in the unit of the wear law; infinite where no load names it."""
        known = [law.ranges[self.wear.symbol][1] for law in self.loads.values()]
        return max(known, default=float("inf"))

    @property
    def conditions(self) -> tuple[str, ...]:
        """Symbols of the conditions that the laws need, such as V, f and d."""
        own = {TIME, self.wear.symbol}
        names = [name for law in (self.wear, *self.loads.values()) for name in law.formula.factors]
        return tuple(dict.fromkeys(name for name in names if name not in own))

    def missing(self, given: Mapping[str, float]) -> tuple[str, ...]:
        """Conditions that are absent, or not numbers above zero."""
        return tuple(name for name in self.conditions if not is_positive(given.get(name, 0.0)))

    def far(self, given: Mapping[str, float]) -> dict[str, str]:
        """Conditions that lie `FAR` times or more outside of their tested ranges, each with a clause."""
        tested = {name: ends for law in (*self.loads.values(), self.wear) for name, ends in law.ranges.items()}
        found = {}
        for name in self.conditions:
            value, (low, high) = given.get(name, 0.0), tested[name]
            if is_positive(value) and is_positive(low) and not low / FAR < value < FAR * high:
                unit = USUAL.get(name, "")
                text = f"{name} {value:.3g} {unit}".rstrip() + f" is far from the tested {low:g} to {high:g}"
                found[name] = text + _other_unit(name, value, unit, low, high)
        return found

    def beyond(self, given: Mapping[str, float], minutes: float) -> tuple[str, ...]:
        """Sentences on conditions and on a time of contact outside the tests."""
        laws = (self.wear, *self.loads.values())
        far = dict.fromkeys(
            words for law in laws for words in law.outside({k: v for k, v in given.items() if k != TIME})
        )
        found = [f"EXTRAPOLATED: {', '.join(far)}: outside the tested region."] if far else []
        if minutes > self.tested[1] * (1 + 1e-6):
            times = f"{minutes:.3g} min of contact, {minutes / self.tested[1]:.2g} times the longest test"
            found.append(f"EXTRAPOLATED: {times} ({self.tested[1]:g} min).")
        return tuple(found)


def _other_unit(name: str, value: float, unit: str, low: float, high: float) -> str:
    """The unit with which a value lies in its tested range, as the end of a clause; empty where there is none."""
    for other in OTHER_UNITS.get(unit, ()):
        meant = value * ratio(other, unit)
        if low <= meant <= high:
            return f" (in {other} it would be {meant:.4g} {unit}: --unit {name}={other})"
    return ""


def _wear_symbol(pf: "ParameterFile", named: str | None) -> str:
    if named is not None:
        if named not in pf.laws:
            raise UsageError(f"the file has no law of {named}; it has {', '.join(pf.laws) or 'none'}.")
        return named
    if pf.tool_life is not None and pf.tool_life.wear in pf.laws:
        return pf.tool_life.wear
    inside = {name for law in pf.laws.values() for name in law.formula.factors}
    found = [name for name, law in pf.laws.items() if TIME in law.formula.factors and name in inside]
    found = found or [name for name in FLANK_WEAR if name in pf.laws]
    if not found:
        raise UsageError(
            f"the file has no law of wear on the time of contact t (laws: {', '.join(pf.laws) or 'none'}): fit one to "
            "tests with columns of wear and time."
        )
    return found[0]


def _check_wear(law: LiveLaw) -> None:
    factors = law.formula.factors
    if law.formula.name != "power" or TIME not in factors:
        what = law.formula.name.replace("_", " ")
        raise UsageError(
            f"the law of {law.symbol} is {what} on {', '.join(factors)}: the estimate of an edge needs a power law on "
            f'the time of contact t; fit it with --law "{law.symbol} ~ V, f, d, t".'
        )
    m = law.theta[1 + factors.index(TIME)]
    if not m > 0:
        raise UsageError(
            f"the law of {law.symbol} has the exponent {m:.3g} of t: wear must grow with the time of contact."
        )


def _load_fault(pf: "ParameterFile", name: str, wear: str) -> str:
    """Reason why the law of a load cannot serve; empty where it can."""
    if name not in pf.laws:
        return f"the file has no law of {name}; it has {', '.join(pf.laws)}."
    law = pf.laws[name]
    if wear not in law.formula.factors:
        return f"the law of {name} does not depend on {wear}: this load does not show wear."
    if not (law.logarithmic and law.formula.linearisable):
        return (
            f"the law of {name} is {law.form.replace('_', ' ')}, not linear in ln {name}: it is not used for the wear."
        )
    return ""


def _unclear(load: LiveLaw, wear: str) -> str:
    """Why a load does not show wear, by the exponent that is used, with the remedy; empty where it does."""
    at = {name: (low * high) ** 0.5 if low > 0 else (low + high) / 2 for name, (low, high) in load.ranges.items()}
    slope, half = load.slope(wear, at), CLEARLY * load.slope_se(wear, at)
    if slope > half:
        return ""
    factors = load.formula.factors
    without = ", ".join(name for name in factors if name != TIME)
    remedy = WITHOUT_T.format(load.symbol, without, wear) if TIME in factors else WIDER.format(wear)
    return UNCLEAR.format(load.symbol, wear, slope, slope - half, slope + half, remedy)


def _live_law(law: "LawSection", draws: "Draws | None", by: str | None, units: Mapping[str, str]) -> LiveLaw:
    """Law whose factors are given in ``units``, with mean and covariance of its parameters, from draws if there are."""
    theta, covariance = _parameters(law, draws)
    scales = [ratio(units.get(f.symbol, f.unit), f.unit) for f in law.factors]
    e = law.edges
    sd = e.sd_between if e is not None and e.sd_between is not None else law.residual_se
    if sd is None:
        raise UsageError(f"the law of {law.response} has no residual standard error: the scatter of edges is unknown.")
    if law.error == "additive":
        sd = sd / typical_response(law)
    df = e.df_between if e is not None and e.df_between else max((law.n_edges or law.n) - 1, 3)
    ranges = {f.symbol: (f.low / k, f.high / k) for f, k in zip(law.factors, scales, strict=True)}
    return LiveLaw(
        law.response, law.unit, law.quantity, law.formula, theta, covariance, float(sd), float(max(df, 3)),
        _shifts(law, by), np.array(scales), ranges,
    )  # fmt: skip


def _parameters(law: "LawSection", draws: "Draws | None") -> tuple[Array, Array]:
    names = law.parameter_names
    if draws is None or len(draws.values) < FEWEST_DRAWS or not set(names) <= set(draws.names):
        return law.theta, covariance_of(law)
    values = draws.values[:, [draws.names.index(name) for name in names]]
    return np.asarray(values.mean(axis=0)), np.cov(values, rowvar=False)


def _shifts(law: "LawSection", by: str | None) -> Array:
    if law.by is None:
        return np.zeros(0)
    known = (law.by.reference, *law.by.shifts)
    if by not in known:
        seen = "no level was named" if by is None else f"it has no {by!r}"
        raise UsageError(f"the law of {law.response} is by {law.by.column}: {seen}; name one of {', '.join(known)}.")
    return np.array([float(name == by) for name in law.by.shifts])
