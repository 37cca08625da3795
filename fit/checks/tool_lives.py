"""Checks of a law of tool lives: those that replace the checks of least squares, which run-outs do not allow.

Tests compare nested laws by their likelihood: ``F = (exp(2 (log L1 - log L0) / n) - 1) df / q``, which without run-outs
is the F test of least squares. A life is judged by the law that is fitted without it.

Source: Meeker & Escobar 1998, Statistical Methods for Reliability Data, sections 17.4 to 17.6.
"""

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Array, Flags
from ...core.censored import (
    ENDED,
    RUN_OUT,
    Distribution,
    LifeDistribution,
    Side,
    fit_censored,
    standard_deviation,
    standard_quantile,
)
from ...core.errors import FitError
from ...core.predictions import EXTRAPOLATED
from ...core.rounding import count, middle_of
from ...datasets import Runs
from ...datasets.vocabulary import WEAR
from ..available import NotAvailable
from ..lawfit import LawFit
from .check import SIGNIFICANT, Check
from .strata import LIFE, rows_in

MOST_CENSORED, FEW_DF = 0.5, 3
SEVERAL = 3  # run-outs beyond all lives that ended: one or two may be the corner of a plan
SURE = 3.0  # difference of log-likelihoods beyond which lives prefer a distribution
MOVED = 2.0  # standard errors that one life may move an exponent by
EQUAL_BY_CHANCE = 1.15  # ratio of expected lives above which equal ones are no chance
MOST_LEFT_OUT = 200  # lives that are left out one by one
WIDE = 10.0  # factor within which 95 % of lives lie, beyond which the law says little
BY_SCATTER, MOST_BEYOND = 2.0, 1.5  # SD of ln life, and ratio, by which a life may be longer than the longest test
SETTINGS = 3  # that are named
FEWEST_ENDS, MOST_ENDS, ABOUT = 5, 0.7, 0.15  # readings; share of the lives that end about the median of the wear
EARLY = 0.7  # of the wear at which most lives end
OUTLYING = 0.02  # level of the largest of all lives together


def run_outs(law: LawFit) -> Check:
    """Check that enough lives ended for the law to be known.

    Examples
    --------
    >>> import pandas as pd
    >>> from fitmodels import datasets, fit
    >>> table = pd.DataFrame({"V": [120, 120, 150, 150, 180, 180.0], "T": ["60+", "60+", "60+", "26", "17", "14"]})
    >>> run_outs(fit.life_law(datasets.runs_from_frame(table), ["V"])).level
    'warning'
    """
    life = _life_of(law)
    n, bounds = law.nobs, life.run_outs + life.earlier
    share, df = bounds / n, law.df_resid
    few = bool(bounds) and df < FEW_DF  # without bounds the check of the explained variance names the few tests
    words = f"{life.ended} of {n} lives ended" + (f", {bounds} are known by a bound alone" if bounds else "")
    words = f"Only {words}" if few and share <= MOST_CENSORED else words
    concern = int(share > MOST_CENSORED or few)
    remedy = " Run more tests to the end of the life." if concern else ""
    beyond = _beyond_ended(law)
    concern = max(concern, int(bool(beyond)))
    verdict = f"{words}; {df} degrees of freedom.{beyond}{remedy}"
    return Check(null="At least half of the lives end; with run-outs, 3 degrees of freedom are left.", statistic=share,
                 symbol="share of bounds", concern=concern, verdict=verdict)  # fmt: skip


def _beyond_ended(law: LawFit) -> str:
    """Sentence on several run-outs beyond all lives that ended, with the remedy; empty without them."""
    side = _side(law)
    if law.rows is None or not (side == ENDED).any():
        return ""
    for j, name in enumerate(law.factors):
        ended, run_outs = law.X[side == ENDED, j], law.X[side == RUN_OUT, j]
        sides = (("below", ended.min(), run_outs < ended.min()), ("above", ended.max(), run_outs > ended.max()))
        for word, end, beyond in sides:
            if (n := int(beyond.sum())) >= SEVERAL:
                at = f"{name} {end:.4g} {law.units.get(name, '')}".rstrip()
                where = f"No life ended {word} {at}, where all {n} tests are run-outs"
                return f" {where}: the law is extrapolated there. Test longer there."
    return ""


def edges_of_lives(law: LawFit) -> Check:
    """Check that each life is of an edge of its own, which makes lives independent."""
    n, m = law.nobs, law.n_edges
    several = m is not None and m < n
    verdict = (
        f"The column of edges names {m} edges for {n} different lives: each is taken as that of an edge of its own. "
        "If the names are those of inserts with several corners, this is right; otherwise correct the column."
        if several
        else f"Each of the {n} lives is of an edge of its own: lives are independent."
    )
    concern = int(several and isinstance(law.edges, NotAvailable))
    return Check(null="Each life is of an edge of its own.", concern=concern, verdict=verdict)


def longest_lives(law: LawFit, runs: Runs | None = None) -> Check | None:
    """Check that no life ended otherwise than by wear: long before the wear of the others, or as a run-out.

    Run-outs that are written as lives are equal where the law expects others, in whatever form it is. None of another
    response.
    """
    if law.rows is None or law.response != LIFE:
        return None
    ended = _side(law) == ENDED
    longest = float(law.observed.max())
    equal = ended & (law.observed >= longest * (1 - 1e-9))
    expected = law.fitted[equal]
    n = int(equal.sum())
    suspicious = n >= 2 and float(expected.max() - expected.min() * EQUAL_BY_CHANCE) > 0
    unit = law.units[law.response]
    early = "" if runs is None else _ended_early(law, runs, ended & ~(equal & suspicious))
    marked = (
        f"{n} lives are exactly {longest:g} {unit}, the longest of all, where the law expects {expected.min():.3g} to "
        f"{expected.max():.3g} {unit}: run-outs written as lives? Mark them ({longest:g}+, or a column run-out)."
        if suspicious
        else ""
    )
    verdict = f"{marked} {early}".strip() or "The longest lives are not equal."
    return Check(null="All lives end by wear, and the longest differ.", statistic=float(n), symbol="equal lives",
                 concern=int(suspicious or bool(early)), verdict=verdict)  # fmt: skip


def _ended_early(law: LawFit, runs: Runs, among: Flags) -> str:
    """The sentence on lives that ended at a fraction of the wear at which most others did; empty without any."""
    name, rows = next(filter(runs.has, WEAR), ""), rows_in(law, runs)
    wear = runs.values(name)[rows] if name and rows is not None else np.empty(0)
    if (wear > 0).sum() < FEWEST_ENDS:
        return ""
    usual = float(np.median(wear[wear > 0]))
    early = (wear > 0) & (wear < EARLY * usual) & among
    if (np.abs(wear / usual - 1) <= ABOUT).mean() < MOST_ENDS or not early.any():
        return ""
    low, high = f"{wear[early].min():.3g}", f"{wear[early].max():.3g}"
    lines = ",".join(map(str, law.lines[early]))
    return (
        f"{count(int(early.sum()), 'life', 'lives')} ended at {name} {low if low == high else f'{low} to {high}'} "
        f"{runs.units.get(name, '')}, most others at {usual:.3g}: not ended by wear, as after chipping or a stop. Mark "
        f"them as run-outs (60+, or a column run-out), or leave them out with --leave-out 'lines {lines}'."
    )


def extrapolated_lives(law: LawFit) -> Check:
    """Check that the lives at the middle of the tests and at each tested setting were reached by tests."""
    middle = {name: middle_of(*ends, logs=True) for name, ends in law.domain.items()}
    level = {law.by.column: law.by.reference} if law.by is not None else {}
    typical, longest = float(law.values({**middle, **level})), float(law.observed.max())
    unit = law.units[law.response]
    beyond = typical > EXTRAPOLATED * longest
    settings = "" if beyond else _settings_beyond(law, longest)
    verdict = (
        settings
        + (f"Life at the middle of the tests {typical:.3g} {unit}; the longest test lasted {longest:.3g} {unit}")
        + (": extrapolated. Test longer, or at conditions of shorter life." if beyond else ".")
    )
    return Check(null="The lives at the middle of the tests and at the tested settings were tested.",
                 statistic=typical / longest, symbol="life over longest test", concern=int(beyond or bool(settings)),
                 verdict=verdict)  # fmt: skip


def _settings_beyond(law: LawFit, longest: float) -> str:
    """Tested settings whose life by the law is longer than any test, by more than scatter explains; empty if none."""
    if law.rows is None:
        return ""
    allowed = longest * min(float(np.exp(BY_SCATTER * _life_of(law).scale)), MOST_BEYOND)
    lives = {
        tuple(x): float(life) for x, life in zip(law.X.tolist(), law.fitted.tolist(), strict=True) if life > allowed
    }
    if not lives:
        return ""
    unit = law.units[law.response]
    named = [
        f"{life:.3g} {unit} at {', '.join(_set_to(law, name, x) for name, x in zip(law.factors, row, strict=True))}"
        for row, life in sorted(lives.items(), key=lambda one: -one[1])
    ]
    more = f" and at {len(named) - SETTINGS} more settings" if len(named) > SETTINGS else ""
    head = f"EXTRAPOLATED at tested settings, up to {max(lives.values()) / longest:.2g} times the longest test"
    return f"{head}: {'; '.join(named[:SETTINGS])}{more}. Test longer there. "


def _set_to(law: LawFit, name: str, value: float) -> str:
    return f"{name} {value:.4g} {law.units.get(name, '')}".rstrip()


def distribution_of_lives(law: LawFit) -> Check | NotAvailable:
    """Comparison of lognormal and Weibull lives by their likelihood, which few lives seldom decide."""
    life = _life_of(law)
    if law.exact or law.rows is None:
        return NotAvailable("the lives meet the law exactly")
    name: Distribution = "weibull" if life.name == "lognormal" else "lognormal"
    other = fit_censored(law.design, np.log(law.observed), _side(law), name)
    more = other.log_likelihood - life.log_likelihood
    titles, form = {"weibull": "Weibull", "lognormal": "lognormal"}, "weibull" if name == "weibull" else "power"
    verdict = f"{titles[life.name]} against {titles[name]} lives: log-likelihood {life.log_likelihood:.2f} and " + (
        f"{other.log_likelihood:.2f}; the lives prefer {titles[name]}: --form T={form}."
        if more > SURE
        else f"{other.log_likelihood:.2f}: these lives do not contradict {titles[life.name]} ones."
    )
    return Check(null=f"Lives are {titles[life.name]} about the law.", statistic=more, symbol="ln likelihood ratio",
                 concern=int(more > SURE), verdict=verdict[0].upper() + verdict[1:])  # fmt: skip


def single_lives(law: LawFit) -> Check | NotAvailable | None:
    """Largest change of an exponent when one life is left out, in standard errors; None for least squares."""
    if _life_of(law).least_squares or law.rows is None:
        return None  # the check of influence of every law does it
    left = _left_out(law)
    if isinstance(left, NotAvailable):
        return left
    null = "No single life decides an exponent."
    if left.alone is not None:
        words = f"Without the life of line {law.lines[left.alone]} the law cannot be fitted: measure there again."
        return Check(null=null, concern=1, verdict=words)
    moved = np.abs(left.theta[:, 1:] - law.theta[1:]) / np.sqrt(np.diag(law.covariance()))[1:]
    row, j = np.unravel_index(int(moved.argmax()), moved.shape)
    size = float(moved[row, j])
    verdict = (
        f"Without the life of line {law.lines[row]} the exponent of {law.names[j + 1]} changes by {size:.2g} SE"
        + (": measure there again." if size > MOVED else "; no single life decides the law.")
    )
    return Check(null=null, statistic=size, symbol="max. change (SE)", concern=int(size > MOVED), verdict=verdict)


def useful_law(law: LawFit) -> Check | None:
    """Likelihood test of all factors together, and the factor within which one life lies; None for least squares."""
    from scipy.special import fdtrc

    if _life_of(law).least_squares or law.df_resid < 1 or law.rss <= 0:
        return None
    q, df = law.df_model, law.df_resid
    F = max(law.tss / law.rss - 1, 0.0) * df / q
    p = float(fdtrc(q, df, F))
    middle = {name: middle_of(*ends, logs=True) for name, ends in law.domain.items()}
    level = {law.by.column: law.by.reference} if law.by is not None else {}
    one = law.predict({**middle, **level})
    factor = float(one.high / one.value)
    concern = 2 if p > SIGNIFICANT else int(factor > WIDE)
    verdict = {
        0: f"The lives follow the factors (p {p:.2g}); 95 % of lives lie within a factor of {factor:.2g} of the law.",
        1: f"95 % of lives lie within a factor of {factor:.2g} of the law only: repeat tests at the same conditions.",
        2: f"The lives do not depend on {', '.join(law.factors)} beyond their scatter (p {p:.2g}): no law of them.",
    }[concern]
    return Check(null="The factors have no effect on the life.", statistic=F, symbol="F", df=(q, df), concern=concern,
                 verdict=verdict)  # fmt: skip


def outlying_lives(law: LawFit) -> Check | NotAvailable | None:
    """Lives that ended far from the law that is fitted without them; None for least squares."""
    from scipy.special import stdtr

    if _life_of(law).least_squares or law.rows is None:
        return None
    left = _left_out(law)
    if isinstance(left, NotAvailable):
        return left
    if left.alone is not None or law.df_resid < 2:
        return NotAvailable("the law cannot be fitted without each of its lives")
    ended = _side(law) == ENDED
    t = np.where(ended, (np.log(law.observed) - np.sum(law.design * left.theta, axis=1)) / left.sd, 0.0)
    p = float(2 * stdtr(law.df_resid - 1, -np.abs(t).max()))
    row = int(np.abs(t).argmax())
    expected = float(np.exp(law.design[row] @ left.theta[row]))
    found = p * int(ended.sum()) < OUTLYING
    unit = law.units[law.response]
    verdict = (
        f"The life of line {law.lines[row]}, {law.observed[row]:.3g} {unit}, is {law.observed[row] / expected:.2g} "
        f"times that of the law of the others ({expected:.3g} {unit}): check the number and its unit."
        if found
        else "No life lies far from the law of the others."
    )
    return Check(null="Each life follows the law of the others.", statistic=float(t[row]), symbol="t", pvalue=None,
                 concern=int(found), verdict=verdict)  # fmt: skip


def curvature_of_lives(law: LawFit) -> Check | NotAvailable:
    """Likelihood test of the squares of the logarithms of the factors: whether Taylor's line bends."""
    from scipy.special import fdtrc

    life = _life_of(law)
    if law.rows is None or law.exact:
        return NotAvailable("the lives meet the law exactly")
    ended = _side(law) == ENDED
    U = np.log(law.X) - np.log(law.X).mean(axis=0)
    bent = [j for j in range(U.shape[1]) if len(np.unique(U[ended, j])) > 2]
    Z = np.hstack([law.design, U[:, bent] ** 2])
    q, df = len(bent), life.ended - Z.shape[1]
    if not q:
        return NotAvailable("no factor has three levels among the lives that ended")
    if df < 1 or np.linalg.matrix_rank(Z[ended]) < Z.shape[1]:
        return NotAvailable(f"{life.ended} lives that ended do not identify {q} squares beside the law")
    try:
        more = fit_censored(Z, np.log(law.observed), _side(law), life.name)
    except (FitError, np.linalg.LinAlgError) as error:
        return NotAvailable(str(error))
    F = max(float(np.expm1(2 * (more.log_likelihood - life.log_likelihood) / law.nobs)), 0.0) * df / q
    p = float(fdtrc(q, df, F))
    names = ", ".join(law.factors[j] for j in bent)
    kept = f"No curvature of {names} in logarithms, p {p:.2g}."
    found = f"The life bends against the power law in {names}, p {p:.2g}: stay inside the tested speeds and feeds."
    return Check(null=f"The squares of ln {names} have no effect.", statistic=F, symbol="F", df=(q, df), pvalue=p,
                 concern=int(p < SIGNIFICANT), verdict=found if p < SIGNIFICANT else kept, kept=kept)  # fmt: skip


@dataclass(frozen=True, slots=True)
class _LeftOut:
    """Laws without each life: theta (n, p), standard deviation of its prediction (n,), and a life that decides."""

    theta: Array
    sd: Array
    alone: int | None = None


def _left_out(law: LawFit) -> _LeftOut | NotAvailable:
    """The law without each of its lives in turn, of the median life."""
    life, n, p = _life_of(law), law.nobs, len(law.theta)
    if n > MOST_LEFT_OUT:
        return NotAvailable(f"{n} lives: only up to {MOST_LEFT_OUT} are left out one by one")
    side, y, Z = _side(law), np.log(law.observed), law.design
    theta, sd = np.empty((n, p)), np.empty(n)
    for row in range(n):
        keep = np.arange(n) != row
        ended = int((side[keep] == ENDED).sum())
        try:
            part = fit_censored(Z[keep], y[keep], side[keep], life.name)
        except (FitError, np.linalg.LinAlgError):
            return _LeftOut(theta, sd, row)
        if part.scale < 1e-9 or ended <= p:
            return _LeftOut(theta, sd, row)
        wider = ended / (ended - p)
        theta[row] = part.beta
        theta[row, 0] += part.scale * standard_quantile(life.name, 0.5)
        variance = float(Z[row] @ part.covariance[:p, :p] @ Z[row]) + standard_deviation(life.name, part.scale) ** 2
        sd[row] = np.sqrt(wider * variance)
    return _LeftOut(theta, sd)


def _side(law: LawFit) -> Side:
    """Side of each life of a law with rows."""
    held = None if law.rows is None else law.rows.side
    return np.zeros(law.nobs, dtype=np.int8) if held is None else held


def _life_of(law: LawFit) -> LifeDistribution:
    if law.life is None:
        raise FitError(f"the law of {law.response} is not one of tool lives: fit it with life_law.")
    return law.life
