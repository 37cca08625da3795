"""A law's interval from the file alone: what is asked, what it stands on, and its ends.

How wide it is, is worked out in ``datasets.widths``, where the fit goes too: a file answers as its fit did.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.errors import ParameterError
from ..core.intervals import (
    KNOWN_LEVEL,
    Centre,
    Edge,
    Kind,
    Scatter,
    between_and_within,
    centre_factor,
    half_width,
    interval_ends,
    interval_label,
    log_mean_variance,
    one_component,
)
from .errors import short
from .evaluate import LOGARITHMIC, parameter_names, response, terms, theta
from .sections.covariance import Covariance, NoCovariance
from .sections.law_parts import Edges

if TYPE_CHECKING:
    from .sections.law import LawSection

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class IntervalOptions:
    """Which interval is asked for; what the options mean stands at ``LawSection.interval``."""

    kind: Kind = "mean"
    level: float = 0.95
    edge: Edge = "new"
    coverage: float = 0.95
    centre: Centre = "median"

    def __post_init__(self) -> None:
        for name, given, known in (
            ("kind", self.kind, Kind),
            ("edge", self.edge, Edge),
            ("centre", self.centre, Centre),
        ):
            if given not in get_args(known):
                words = ", ".join(map(repr, get_args(known)))
                raise ParameterError(f"{name} = {short(given)}: it is one of {words}.")
        for name, share in (("level", self.level), ("coverage", self.coverage)):
            if not isinstance(share, float) or not 0 < share < 1:
                raise ParameterError(
                    f"{name} = {short(share)}: a coverage is between 0 and 1, as 0.95 (a level of the law is by=)."
                )


@dataclass(frozen=True, slots=True)
class Band:
    """The answer: value and ends in the unit of the law, in the shape of the factors.

    ``of`` says what it is of; ``edge`` is new, same or independent rows; ``centre`` is what the value is.
    """

    value: Array
    low: Array
    high: Array
    of: str
    edge: str
    centre: Centre


@dataclass(frozen=True, slots=True)
class _About:
    """Of which edge a row is, its scatter (None where it is not needed and the file lacks it), and df of t."""

    edge: str
    scatter: Scatter
    df: float
    words: str | None


def band(law: "LawSection", asked: IntervalOptions, by: str | None, factors: Mapping[str, ArrayLike]) -> Band:
    """Value and ends at the given factors, by the delta method.

    Raises
    ------
    ParameterError
        A factor or level that the law cannot take, or the file lacks what this interval needs.
    """
    covariance, multiplies = _covariance(law), law.error == "multiplicative"
    centre: Centre = asked.centre if multiplies else "mean"
    moves = asked.kind == "mean" and multiplies and centre != "median"
    about = _about(law, covariance, asked, parts=moves or asked.kind == "tolerance")
    smearing = _smearing(law, about) if centre == "smeared" else 1.0
    with np.errstate(all="ignore"):  # `as_given` refuses what is not finite
        factor = centre_factor(centre, about.scatter.sd, smearing) if multiplies else 1.0
        Z = terms(law, by, factors)
        median = response(law, Z @ theta(law))
        G = Z if multiplies or law.form not in LOGARITHMIC else Z * median[..., None]
        variance = np.zeros(median.shape) if about.edge == "same" else _quadratic(law, covariance, G)
        half = half_width(
            asked.kind,
            variance,
            about.df,
            about.scatter,
            level=asked.level,
            coverage=asked.coverage,
            unsure=log_mean_variance(about.scatter) if moves else 0.0,
        )
        low, high = interval_ends(median * factor if moves else median, half, multiplies=multiplies)
    of = interval_label(asked.kind, asked.level, asked.coverage, about.words)
    return Band(median * factor, low, high, of, about.edge, centre)


def _covariance(law: "LawSection") -> Covariance:
    if isinstance(law.uncertainty, NoCovariance):
        reason = law.uncertainty.reason.removeprefix("no interval: ").rstrip(".")
        raise ParameterError(f"the law of {law.response} has no interval: {reason}.")
    return law.uncertainty


def _quadratic(law: "LawSection", covariance: Covariance, G: Array) -> Array:
    order = [covariance.of.index(name) for name in parameter_names(law)]
    C = np.array(covariance.matrix)[np.ix_(order, order)]
    return np.asarray(np.einsum("...i,ij,...j->...", G, C, G), dtype=float)


def _about(law: "LawSection", covariance: Covariance, asked: IntervalOptions, *, parts: bool) -> _About:
    """Of rows by edge where the file splits their scatter, else of rows as independent."""
    e, df = law.edges, float(covariance.df)
    if e is None or e.sd_between is None or e.sd_within is None:
        if law.residual_se is None and (asked.kind != "mean" or asked.centre != "median"):
            words = f"no {asked.kind} interval" if asked.kind != "mean" else f"no {asked.centre} of its own"
            raise ParameterError(f"the law of {law.response} has no residual standard error: {words}.")
        return _About("independent rows", one_component(law.residual_se or 0.0, df), df, None)
    if asked.edge == "same":
        (within,) = _held(law, e, "df_within", of="an interval for the same edge")
        return _About("same", one_component(e.sd_within, within), within, KNOWN_LEVEL)
    if not parts:
        return _About("new", Scatter(float(np.hypot(e.sd_between, e.sd_within)), ()), df, "a new edge")
    what = "a tolerance interval" if asked.kind == "tolerance" else f"the interval of a {asked.centre}"
    m, between, within = _held(law, e, "rows_per_edge", "df_between", "df_within", of=what)
    return _About("new", between_and_within(e.sd_between, e.sd_within, m, between, within), df, "a new edge")


def _smearing(law: "LawSection", about: _About) -> float:
    if about.edge == "same" and law.edges is not None:
        return _held(law, law.edges, "smearing_within", of="the smeared mean")[0]
    return _held(law, law, "smearing", of="the smeared mean")[0]


def _held(law: "LawSection", section: "Edges | LawSection", *names: str, of: str) -> list[float]:
    """Fields that earlier files lack."""
    values = [getattr(section, name) for name in names]
    lacking = [name for name, value in zip(names, values, strict=True) if value is None]
    if lacking:
        where = "" if section is law else "edges."
        fields = ", ".join(f"{where}{name}" for name in lacking)
        raise ParameterError(
            f"the law of {law.response} lacks {fields} in this file, which {of} needs; fit the data again to have it."
        )
    return [float(value) for value in values]
