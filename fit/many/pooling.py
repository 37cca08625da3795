"""Partial pooling of an exponent over families of pairs (an ISO group, a grade, a coolant), with moderated variances.

The squared standard error of a pair is its variance times a factor of its design, ``se^2 = s^2 c`` with
``c = (row_bse / scale_se)^2``. With d_i degrees of freedom s_i^2 is nearly sigma_i^2 chi^2 / d_i, and over the family
sigma_i^2 is scaled inverse chi^2 with d_0 degrees of freedom about s_0^2. The moderated variance is

    s~_i^2 = (d_0 s_0^2 + d_i s_i^2) / (d_0 + d_i),    with d_0 + d_i degrees of freedom.

d_0 and s_0 follow from the spread of ln s_i^2, whose variance beyond trigamma(d_i / 2) is trigamma(d_0 / 2): a family
with heterogeneous variances has a small d_0, and every pair keeps its own error.

Source: Smyth 2004, Statistical Applications in Genetics and Molecular Biology 3, article 3, sections 3 and 6.2; the
spread here by restricted likelihood, since pairs differ in their degrees of freedom.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from ...core.arrays import Array
from ...core.calls import check_share
from ...core.display import Display, Plottable, TextTable
from ...core.errors import UsageError
from ...core.rounding import with_error
from .many_laws import ManyLaws
from .random_effects import Family, family, given, half_t, moments, of_pairs, quantiles, reml, tau_quantile, thinned

FEWEST = 3  # pairs of a family
AT_ONCE = 4096  # pairs in one array over tau: about a megabyte
STEPS, CLOSE = 100, 1e-14  # of Newton's method: most of them, and a relative step that ends it
NONE = 1e-6  # variance of ln sigma^2 below which variances are equal
USED = ("se_used", "df_used")
POOLED = ("pooled", "pooled_se", "pooled_low", "pooled_high")
WHOLE = "all pairs"  # the family where none is asked for


@dataclass(frozen=True, slots=True, repr=False)
class PooledExponents(Plottable):
    """One exponent over families of pairs.

    Attributes
    ----------
    factor : str
    level : float
        Of every interval.
    prior : str
        Prior of tau.
    table : DataFrame
        A row a pair, in the order and with the index of the table that was given: ``family``; ``estimate, se, df,
        low, high`` of the pair alone; ``se_used, df_used``, moderated by those of the family; ``pooled,
        pooled_se, pooled_low, pooled_high`` with its family; ``shrinkage``, the share of the way from its own
        estimate to the family's mean; ``reason`` why it is not pooled.
    families : DataFrame
        A row a family: ``pairs``; ``mean, mean_se, mean_low, mean_high``; ``tau`` (posterior median), ``tau_low,
        tau_high, tau_reml``; ``new_low, new_high``, the exponent of a new pair of the family.
    """

    factor: str
    level: float
    prior: str
    table: pd.DataFrame
    families: pd.DataFrame

    def to_frame(self) -> pd.DataFrame:
        """A copy of ``table``."""
        return self.table.copy()

    def _display(self) -> Display:
        pooled = self.table["pooled"].notna()
        shrunk = f", shrunk {self.table['shrinkage'].median():.0%} towards its mean (median)" if pooled.any() else ""
        head = f"exponent of {self.factor}: {pooled.sum()} pairs in {len(self.families)} families{shrunk}"
        ends = f"{100 * self.level:g} %"
        rows = tuple(
            (str(name), f"{row['pairs']:.0f}", with_error(row["mean"], row["mean_se"]),
             f"{row['tau']:.3g} ({row['tau_low']:.2g} to {row['tau_high']:.2g})",
             f"{row['new_low']:.3g} to {row['new_high']:.3g}")
            for name, row in self.families.head(8).iterrows()
        )  # fmt: skip
        grid = TextTable(("family", "pairs", "mean", f"tau ({ends})", f"new pair ({ends})"), rows) if rows else None
        alone = self.table.loc[self.table["reason"] != "", "reason"].value_counts()
        return Display(head, (("prior", self.prior),), grid, tuple(f"{n} pairs: {why}" for why, n in alone.items()))


def pooled_exponents(
    table: pd.DataFrame | ManyLaws | Mapping[str, object],
    factor: str,
    *,
    by: str | None = None,
    level: float = 0.95,
    tau_scale: float = 0.3,
    tau_df: float = 3.0,
) -> PooledExponents:
    """Pool the exponent of a factor over families of pairs.

    Parameters
    ----------
    table : DataFrame or ManyLaws
        A row a pair, with the columns ``params_V`` and ``bse_V`` for the factor V, and ``df``; without ``df`` the
        standard errors are taken as exact. Where ``row_bse_V`` and ``scale_se`` are there too, standard errors are
        moderated by those of the family (``errors_of_family``): four edges estimate their scatter poorly.
    factor : str
    by : str, optional
        Column that names the family of each pair, for instance its ISO group; None: all pairs are one.
    level : float
    tau_scale, tau_df : float
        Half-t prior of tau, the standard deviation of exponents in a family. As it is, half of it lies below 0.23 and
        95 % below 0.95: exponents of tools and materials differ by tenths. An infinite ``tau_scale`` is uniform.

    Raises
    ------
    UsageError
        A column or a number that cannot be.

    Notes
    -----
    ``b_i ~ N(beta_i, v_i), beta_i ~ N(mu, tau^2)``, mu flat; integrated over tau, so that intervals include
    the uncertainty of tau (Gelman et al. 2013, Bayesian Data Analysis, section 5.4). The error of an estimate with few
    edges is t-distributed; it is replaced by the normal with the same 95 % interval,
    ``v_i = (se_i t(.975, df_i) / 1.96)^2`` with ``se_used`` and ``df_used``. From three degrees of freedom on this
    is nearly the variance of that t, and it is finite for any. A family of fewer than three pairs is not pooled.

    Examples
    --------
    >>> import pandas as pd
    >>> from fitmodels import fit
    >>> table = pd.DataFrame({"params_V": [0.45, 0.55, 0.60, 0.9], "bse_V": [0.05, 0.05, 0.05, 0.3], "df": 23})
    >>> fit.pooled_exponents(table, "V").table["pooled"].round(2).tolist()
    [0.48, 0.55, 0.58, 0.6]
    """
    rows = _separate(table, factor, by, level)
    if not (tau_scale > 0 and tau_df > 0):
        raise UsageError(f"tau_scale={tau_scale}, tau_df={tau_df}: both are above zero, for instance 0.3 and 3.")
    found = _pool(rows, half_t(tau_df, tau_scale), level)
    if isinstance(table, pd.DataFrame):
        rows.index = table.index
    rows = rows.drop(columns="design")
    words = "uniform" if np.isinf(tau_scale) else f"tau half-t with {tau_df:g} df and scale {tau_scale:g}"
    return PooledExponents(factor, level, words, rows, pd.DataFrame.from_dict(found, orient="index"))


def _pool(rows: pd.DataFrame, prior: Callable[[Array], Array], level: float) -> dict[str, dict[str, float]]:
    """Enter the pooled estimates of each family, and return its own; as arrays, since families may be many."""
    found: dict[str, dict[str, float]] = {}
    own = {name: rows[name].to_numpy(dtype=float) for name in ("estimate", "se", "df", "design")}
    made = {name: np.full(len(rows), np.nan) for name in (*USED, *POOLED, "shrinkage")}
    reason = rows["reason"].to_numpy(dtype=object, copy=True)
    known = np.flatnonzero(reason == "")
    named = rows["family"].iloc[known]
    for name, places in named.groupby(named, sort=True).indices.items():
        at = known[places]
        if len(at) < FEWEST:
            reason[at] = f"a family of fewer than {FEWEST} pairs does not identify their spread"
            continue
        se, df = _errors(own["se"][at], own["df"][at], own["design"][at])
        of = family(own["estimate"][at], _variances(se, df), prior)
        found[str(name)] = _of_family(of, level)
        for column, values in (dict(zip(USED, (se, df), strict=True)) | _of_pairs(of, level)).items():
            made[column][at] = values
    for column, values in made.items():
        rows[column] = values
    rows["reason"] = reason
    return found


def _separate(
    table: pd.DataFrame | ManyLaws | Mapping[str, object], factor: str, by: str | None, level: float
) -> pd.DataFrame:
    """The pairs by themselves: estimate, se, df and t intervals, and why some cannot be pooled."""
    from scipy.special import stdtrit

    check_share("level", level)
    frame = table.table if isinstance(table, ManyLaws) else pd.DataFrame(table)
    needed = [f"params_{factor}", f"bse_{factor}", *([] if by is None else [by])]
    missing = [name for name in needed if name not in frame]
    if missing:
        raise UsageError(f"no column {missing[0]!r}; there are {', '.join(map(str, frame.columns))}.")
    b, se = (frame[name].to_numpy(dtype=float) for name in needed[:2])
    df = frame["df"].to_numpy(dtype=float) if "df" in frame else np.full(len(frame), np.inf)
    half = se * stdtrit(np.maximum(df, 1), (1 + level) / 2)
    named = pd.Series(WHOLE, index=range(len(frame))) if by is None else frame[by].reset_index(drop=True)
    reason = np.where(named.isna(), "no family is named", "").astype(object)
    reason[~(np.isfinite(se) & (se > 0) & (df > 0))] = f"no standard error of the exponent of {factor}"
    reason[~np.isfinite(b)] = f"no exponent of {factor}"
    empty = {name: np.full(len(frame), np.nan) for name in (*USED, *POOLED)}
    return pd.DataFrame({
        "family": named.astype(object).where(named.notna(), "").astype(str), "estimate": b, "se": se, "df": df,
        "low": b - half, "high": b + half, **empty, "shrinkage": np.nan, "reason": reason,
        "design": _design(frame, factor),
    })  # fmt: skip


def _errors(se: Array, df: Array, design: Array) -> tuple[Array, Array]:
    """Standard errors and degrees of freedom of the pairs of a family, moderated where their designs are known."""
    known = np.isfinite(design) & (design > 0) & np.isfinite(df)
    if known.sum() < FEWEST:
        return se, df
    se, df = se.copy(), df.copy()
    se[known], df[known] = moderated(se[known], df[known], design[known])
    return se, df


def _variances(se: Array, df: Array) -> Array:
    """Variance of the normal whose 95 % interval is that of the estimate's t, shape (J,)."""
    from scipy.special import ndtri, stdtrit

    return np.asarray(np.square(se * stdtrit(df, 0.975) / ndtri(0.975)))


def _design(frame: pd.DataFrame, factor: str) -> Array:
    """Squared standard error of each pair for a variance of one; NaN where it or an error by edge is not known."""
    row, scale = f"row_bse_{factor}", "scale_se"
    if row not in frame or scale not in frame:
        return np.full(len(frame), np.nan)
    with np.errstate(divide="ignore", invalid="ignore"):  # rows that a law meets without a rest scatter by nothing
        design = np.square(frame[row].to_numpy(dtype=float) / frame[scale].to_numpy(dtype=float))
    by_edge = frame["by_edge"].to_numpy(dtype=bool) if "by_edge" in frame else np.ones(len(frame), dtype=bool)
    return np.where(by_edge if by_edge.any() else True, design, np.nan)


def _of_pairs(of: Family, level: float) -> dict[str, Array]:
    """Each pair with its family, so many pairs at once that memory does not grow with the family."""
    few = thinned(of)
    some = [_of_some(replace(few, b=b, v=v), level) for b, v in zip(_cut(of.b), _cut(of.v), strict=True)]
    return {name: np.concatenate([part[name] for part in some]) for name in some[0]}


def _of_some(of: Family, level: float) -> dict[str, Array]:
    mean, variance, pull = of_pairs(of)
    pooled, se = moments(of, mean, variance)
    low, high = (quantiles(of, mean, variance, p) for p in ((1 - level) / 2, (1 + level) / 2))
    return {"pooled": pooled, "pooled_se": se, "pooled_low": low, "pooled_high": high, "shrinkage": of.weight @ pull}


def _cut(values: Array) -> list[Array]:
    return np.array_split(values, -(-len(values) // AT_ONCE))


def _of_family(of: Family, level: float) -> dict[str, float]:
    tails = (1 - level) / 2, (1 + level) / 2
    mean, variance = of.mean[:, None], of.variance[:, None]
    middle, se = moments(of, mean, variance)
    about, new = (
        [float(quantiles(of, mean, spread, p)[0]) for p in tails]
        for spread in (variance, variance + np.square(of.tau)[:, None])
    )
    return {
        "pairs": len(of.b), "mean": float(middle[0]), "mean_se": float(se[0]),
        "mean_low": about[0], "mean_high": about[1], "tau": tau_quantile(of, 0.5),
        "tau_low": tau_quantile(of, tails[0]), "tau_high": tau_quantile(of, tails[1]), "tau_reml": reml(of.b, of.v),
        "new_low": new[0], "new_high": new[1],
    }  # fmt: skip


def moderated(se: Array, df: Array, design: Array) -> tuple[Array, Array]:
    """Standard errors and degrees of freedom moderated by the family, shapes (J,).

    Parameters
    ----------
    se, df : ndarray, shape (J,)
        Of each pair by itself; J is 3 or more, df finite.
    design : ndarray, shape (J,)
        c, the squared standard error for a variance of one.

    Examples
    --------
    >>> se, df = moderated(np.array([0.1, 0.11, 0.09, 0.02]), np.array([20.0, 20, 20, 3]), np.ones(4))
    >>> bool(se[3] > 0.04), bool(df[3] > 4)
    (True, True)
    """
    from scipy.special import polygamma, psi

    own = np.square(se) / design
    level, noise = np.log(own) - psi(df / 2) + np.log(df / 2), polygamma(1, df / 2)
    spread = reml(level, noise)
    mean = float(given(np.array([spread]), level, noise).mean[0])
    d0 = _trigamma_inverse(spread**2) * 2
    most = df.sum()  # the information of all pairs together
    if d0 >= most:
        return np.sqrt(np.exp(mean) * design), np.full(len(df), most)
    s0 = np.exp(mean + psi(d0 / 2) - np.log(d0 / 2))
    return np.sqrt((d0 * s0 + df * own) / (d0 + df) * design), np.minimum(d0 + df, most)


def _trigamma_inverse(value: float) -> float:
    """Inverse of trigamma; infinite for values near zero.

    Newton's steps for ``1 / trigamma``, which is convex: they fall to the root from above (Smyth 2004, appendix).

    >>> round(_trigamma_inverse(1.6449340668482264), 12)
    1.0
    """
    from scipy.special import polygamma

    if value < NONE:
        return float("inf")
    x = 0.5 + 1 / value
    for _ in range(STEPS):
        trigamma = float(polygamma(1, x))
        step = trigamma * (trigamma / value - 1) / float(polygamma(2, x))
        x -= step
        if step < CLOSE * x:
            break
    return x
