"""Life of an edge and the responses at its end, over ln V and ln f, from the laws of a parameter file.

Power and force rise with wear, so that a limit must hold when the edge is worn: at the wear criterion, after the life
that V and f give. For power laws each of these is a plane again.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import log
from typing import TYPE_CHECKING

import numpy as np

from ...core.arrays import Array
from ...core.display import Displayable
from ...core.errors import UsageError
from ..recursion.from_file import PAPER
from ..recursion.laws import Times
from ..region.log_planes import CutSetting, LogPlane, plane, ratio, wear_law
from ..region.surfaces import LawSurface, Surface, surface_of

if TYPE_CHECKING:
    from ...parameters import LawSection, ParameterFile
    from ...parameters.sections.load_line import LimitsSection

LIFE = "T"
POWER = "P"


@dataclass(frozen=True, slots=True, repr=False)
class LifeSource(Displayable):
    """The law that gives the life of an edge: of lives, or of wear with the criterion it is solved for.

    Attributes
    ----------
    law : LawSection
    criterion : float or None
        Wear in the unit of the law; None for a law of lives.
    longest : float or None
        Longest time tested, min.
    times : {"full", "published"}
        Whether the factors t of power and force count, or are left out, as AC-2017 leaves them out in eq. 6 and 7.
    """

    law: "LawSection"
    criterion: float | None
    longest: float | None
    times: Times = "full"

    @property
    def words(self) -> str:
        """Source of the life in words."""
        if self.criterion is None:
            return "tool life by the law of lives T"
        return f"tool life to {self.law.response} {self.criterion:g} {self.law.unit}, by the wear law"

    def worn(self, setting: CutSetting) -> CutSetting:
        """The setting with the wear at the criterion, and a time of 1 min in place of the life."""
        wear = {} if self.criterion is None else {self.law.response: self.criterion}
        return replace(setting, t=1.0, at={**setting.at, **wear})


def life_source(pf: "ParameterFile", limits: "LimitsSection", times: Times | None = None) -> LifeSource:
    """The law of lives of a file, else its wear law with the limit of wear, or else the criterion of its tool life.

    ``times`` is by default "published" for the file of AC-2017 itself.

    Raises
    ------
    UsageError
        The file has neither, or the law is not a power law.
    """
    times = times or ("published" if pf.provenance.options.get("paper") == PAPER else "full")
    if LIFE in pf.laws:
        need_power(pf.laws[LIFE], "a law of lives")
        return LifeSource(pf.laws[LIFE], None, None, times)
    life, bound = pf.tool_life, limits.wear
    named = None if bound is None else bound.of
    law = wear_law(pf, named or (None if life is None else life.wear))
    if law is None or (bound is None and life is None):
        raise UsageError(
            "the file has no tool life: costs need a law of lives T, or a wear law on t with a criterion "
            "(fitmodels data.csv --criterion 0.3, or fitmodels limits params.json AW=0.3mm)."
        )
    need_power(law, "a wear law on t")
    if law.coefficients.get("t", 0.0) <= 0:
        raise UsageError(f"the law of {law.response} does not grow with t: it gives no tool life.")
    tested = next(factor.high * ratio(factor.unit, "min") for factor in law.factors if factor.symbol == "t")
    if bound is not None:
        return LifeSource(law, bound.value * ratio(bound.unit, law.unit), tested, times)
    assert life is not None  # noqa: S101  one of both is given
    return LifeSource(law, life.criterion * ratio(life.unit_of_wear, law.unit), tested, times)


def need_power(law: "LawSection", what: str) -> None:
    """Raise UsageError for a law of another form than the power law."""
    if law.form != "power":
        raise UsageError(
            f"the law of {law.response} is {law.form.replace('_', ' ')}: costs need {what} that is a power law; fit it "
            f'with --form "{law.response}=power".'
        )


@dataclass(frozen=True, slots=True, repr=False)
class WornEdge(Displayable):
    """Life, mean power and limited responses at the end of the life, for each of S draws.

    Attributes
    ----------
    life : LogPlane
        min.
    power : LogPlane or None
        Mean power over the life, kW; None without a power law of P.
    responses : dict of LogPlane
        At the end of the life, of those limited responses that have power laws.
    """

    life: LogPlane
    power: LogPlane | None
    responses: Mapping[str, LogPlane]


def worn_edge(
    pf: "ParameterFile",
    source: LifeSource,
    setting: CutSetting,
    limited: tuple[str, ...],
    thetas: Mapping[str, Array] | None = None,
) -> WornEdge:
    """Planes of a worn edge by the file's estimates (S = 1), or by draws of the parameters of each law, (S, p)."""
    thetas = thetas or {}

    def of(law: "LawSection") -> Array:
        return thetas.get(law.response, law.theta[None])

    life = _life(source, setting, of(source.law))
    straight = {name: pf.laws[name] for name in limited if name != LIFE and pf.laws[name].form == "power"}
    ends = {name: _at_end(law, source, setting, life, of(law)) for name, law in straight.items()}
    power = pf.laws.get(POWER)
    if power is None or power.form != "power":
        return WornEdge(life, None, {**ends, LIFE: life})
    end = ends.get(POWER) or _at_end(power, source, setting, life, of(power))
    return WornEdge(life, _mean(end, power, source), {**ends, LIFE: life})


def _life(source: LifeSource, setting: CutSetting, theta: Array) -> LogPlane:
    """Tool life, min: of its own law, or where the wear law reaches the criterion."""
    if source.criterion is None:
        found = plane(source.law, setting, of=theta)
        return replace(found, intercept=found.intercept + log(ratio(source.law.unit, "min")), unit="min")
    wear = plane(source.law, replace(setting, t=1.0), of=theta)
    with np.errstate(divide="ignore", invalid="ignore"):
        intercept = (log(source.criterion) - wear.intercept) / wear.t_power
        slopes = -wear.slopes / wear.t_power[..., None]
    zero = np.zeros_like(intercept)
    return LogPlane(LIFE, "tool life", "min", intercept, slopes, zero, zero)


def _at_end(law: "LawSection", source: LifeSource, setting: CutSetting, life: LogPlane, theta: Array) -> LogPlane:
    """A response after the life of the edge, at the criterion."""
    found = plane(law, source.worn(setting), of=theta)
    if source.times == "published":
        return found
    return replace(
        found,
        intercept=found.intercept + found.t_power * life.intercept,
        slopes=found.slopes + found.t_power[..., None] * life.slopes,
    )


def _mean(end: LogPlane, law: "LawSection", source: LifeSource) -> LogPlane | None:
    """Mean of a response over the life, kW: with ``P ~ t^k`` that at the end over 1 + k; None where k <= -1."""
    k = law.coefficients.get("t", 0.0) if source.times == "full" else 0.0
    if source.criterion is not None:
        k += law.coefficients.get(source.law.response, 0.0) * source.law.coefficients["t"]
    if k <= -1:
        return None
    return replace(end, intercept=end.intercept - log(1 + k) + log(ratio(law.unit, "kW")), unit="kW")


def curved_ends(
    pf: "ParameterFile", source: LifeSource, setting: CutSetting, limited: tuple[str, ...]
) -> dict[str, Surface]:
    """Limited responses at the criterion whose laws are no power laws.

    Raises
    ------
    UsageError
        Such a law depends on t, which differs from pair to pair.
    """
    found: dict[str, Surface] = {}
    for name in limited:
        law = pf.laws.get(name)
        if law is None or law.form == "power" or name == LIFE:
            continue
        if any(factor.symbol == "t" for factor in law.factors):
            raise UsageError(
                f"the {law.form.replace('_', ' ')} law of {name} depends on t: its value at the end of an edge's life "
                f"is not computed. Fit it without t, or leave the limit out with limits={{{name!r}: None}}."
            )
        surface = surface_of(law, source.worn(setting))
        assert isinstance(surface, LawSurface)  # noqa: S101  not a power law
        found[name] = surface
    return found
