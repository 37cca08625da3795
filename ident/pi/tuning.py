"""PI tuning to a specification: gains of the smallest maximum sensitivity, or of another objective, with a probability.

The specification shall hold on the estimate and, where its uncertainty is known, with a required probability over it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypedDict, Unpack

from ...core.display import Plottable
from ...core.errors import IdentError, UsageError
from ...core.suggestions import did_you_mean
from ...core.threads import one_thread
from ...core.verdict import DO_NOT_USE, PROBABILITY, RESERVATIONS, USABLE, Verdict, verdict_from
from ..draws import Plants
from ..model import Model
from .controller import LimitedStep, against_limits, limited_step
from .feasible_region import FeasibleMap, horizon, map_in_units
from .gain_search import Aim, check_aim, nominal_gains
from .gains import AntiWindup, Averaged, Form, Integration, PiGains
from .loop import FiguresOfMerit, loop_of
from .robust_design import (
    Robustness,
    TradeOff,
    beyond_band,
    plants_of,
    poor_margins,
    reservations,
    robust_gains,
    robustness,
    trade_off,
)
from .specification import LIMITS, STEADY, LimitMargin, Specification, in_units, table_of

if TYPE_CHECKING:
    from ..identification import Identification

CHECKED = ("Specification on the model", "Probability over the model uncertainty", "Unstable loops", "Excited band",
           "Sign of the static gain", "Limits of the command",
           "Margins of the loop")  # fmt: skip


@dataclass(frozen=True, slots=True, repr=False)
class TunedPi(Plottable):
    """Tuned PI gains with their closed loop and specification.

    Attributes
    ----------
    gains : PiGains
        With all options of the controller.
    figures : FiguresOfMerit
        Of the loop on the model, simulated until it has decayed.
    specification : Specification
    aim : str
    model : Model
    map : FeasibleMap
    assumed : tuple of str
        Limits that were added by default.
    robustness : Robustness or None
        Over draws of the covariance that did not choose the gains, or over several models.
    probability : float or None
        Required probability; None for a design on the estimate alone.
    unknown : str
        Reason why the probability cannot be stated; empty where it is.
    of_model : Verdict or None
        How far the model can be used; None where it was not validated.
    plants : Plants or None
        Draws for the trade-off.
    limited : LimitedStep or None
        Of the reference; None for gains without limits.
    """

    gains: PiGains
    figures: FiguresOfMerit
    specification: Specification
    aim: str
    model: Model
    map: FeasibleMap
    assumed: tuple[str, ...] = ()
    robustness: Robustness | None = None
    probability: float | None = None
    unknown: str = ""
    of_model: Verdict | None = None
    plants: Plants | None = None
    limited: LimitedStep | None = None

    @property
    def kp(self) -> float:
        """unit_u per unit_y."""
        return self.gains.kp

    @property
    def ki(self) -> float:
        """unit_u per unit_y per second, parallel form."""
        return self.gains.ki

    @property
    def misses(self) -> tuple[str, ...]:
        """A sentence for each limit violated on the model, worst first; else for a probability below the required."""
        sentences = self.specification.misses(table_of(self.figures, self.kp, self.ki))
        held = self.robustness
        if not sentences and self.probability is not None and held is not None and held.probability < self.probability:
            sentences.append(f"{held.words.rstrip('.')}, below the required {100 * self.probability:g} %")
        return tuple(sentences)

    @property
    def margins(self) -> tuple[LimitMargin, ...]:
        """Value on the model, limit, share left and share of draws that violate it, for each limit."""
        held = self.robustness
        return self.specification.margins(
            table_of(self.figures, self.kp, self.ki), None if held is None else held.missed
        )

    @property
    def verdict(self) -> Verdict:
        """The verdict on the gains, by limits missed, probability, unstable loops and the verdict on the model."""
        missed = () if self.only_probability else self.misses
        found = [(DO_NOT_USE, f"The gains miss their specification: {words.rstrip('.')}.") for words in missed]
        found += [
            *reservations(self.robustness, self.unknown, self.probability),
            *beyond_band(self.figures, self.model),
            *poor_margins(self.figures, self.specification),
            *_of_sign(self.model),
            *against_limits(self.limited, self.gains, self.specification, self.model.output),
            *_of_model(self.of_model),
        ]
        left = () if self.robustness else (f"{CHECKED[1]}: {self.unknown}",)
        checked = tuple(name for name in CHECKED if self.robustness or name not in CHECKED[1:3])
        return verdict_from(found, checked, left)

    @property
    def feasible(self) -> bool:
        """Whether the specification is met.

        If not, `misses` names the violated limits and the gains have the least violation. Relax one of these limits,
        shorten the delay or the filter, or (for a probability) identify more precisely: longer, larger amplitude; or
        require less with ``probability``, or ``nominal=True`` for a design on the estimate alone.
        """
        return not self.misses

    @property
    def words(self) -> str:
        """Gains, whether they meet the specification, the probability that it holds, and the assumptions."""
        unit = f" {self.gains.unit_u}/{self.gains.unit_y}" if self.gains.unit_u and self.gains.unit_y else ""
        head = (
            f"Kp {self.kp:.4g}{unit}, Ki {self.ki:.4g}{unit} per second, {self.gains.form} form, "
            f"{self.gains.integration} integration, sample time {self.gains.sample_time:g} s"
        )
        assumed = f" Assumed: {'; '.join(self.assumed)}." if self.assumed else ""
        if self.feasible:
            return f"{head}: meets the specification on the model ({self.specification}). {self.stated}{assumed}"
        conflict = f" ({self.conflict})" if self.conflict else ""
        least = "most probable" if self.only_probability else "least violation"
        return f"{head}: no gains meet the specification; {least}: {'; '.join(self.misses)}{conflict}.{assumed}"

    @property
    def only_probability(self) -> bool:
        """Whether the limits hold on the model, and only the required probability is missed."""
        return not self.feasible and not self.specification.misses(table_of(self.figures, self.kp, self.ki))

    @property
    def stated(self) -> str:
        """One sentence on the probability that the specification holds, or why it cannot be stated."""
        if self.robustness is None:
            return f"The probability that the specification holds cannot be stated: {self.unknown}."
        required = "not required" if self.probability is None else f"required {100 * self.probability:g} %"
        return f"{self.robustness.words.rstrip('.')}; {required}."

    @property
    def conflict(self) -> str:
        """The single limit that conflicts with the others on the map; empty if there is none, or several conflict."""
        found = {n: v > 0 for n, v in self.map.specification.violations(self.map.figures).items()}
        stable = self.map.figures["stable"].astype(bool)
        free = []
        for name in found:
            others = [v for other, v in found.items() if other != name]
            blocked = sum(others, start=~stable) > 0 if others else ~stable
            if not blocked.all():
                free.append(name)
        words = " or ".join(LIMITS[name].words for name in free)
        return f"feasible without the limit on {words}" if free and not self.map.any else ""

    def in_units(self, unit_u: str, factor: float) -> "TunedPi":
        """The same tuning with the command in another unit, ``factor`` new units per old unit.

        Examples
        --------
        >>> model = Model(b=[0.0, 0.02], a=[1.0, -0.98], nk=1, sample_time=0.02)
        >>> pi = tune_pi(model, rise_time=0.5, n=30)
        >>> round(pi.in_units("mm/min", 1000.0).kp / pi.kp, 6)
        1000.0
        """
        f, plants = self.figures, self.plants
        drawn = (
            None if plants is None else replace(plants, models=tuple(m.in_units(unit_u, factor) for m in plants.models))
        )
        return replace(
            self, gains=self.gains.in_units(unit_u, factor), model=self.model.in_units(unit_u, factor), plants=drawn,
            figures=FiguresOfMerit(**in_units({n: getattr(f, n) for n in f.__dataclass_fields__}, factor)),
            specification=self.specification.in_units(factor), map=map_in_units(self.map, factor),
        )  # fmt: skip

    def trade_off(self) -> TradeOff:
        """Speed, maximum sensitivity and probability of other gains."""
        return trade_off(self.map, self.gains, self.plants)


def _of_sign(model: Model) -> list[tuple[int, str]]:
    """Reservation about an output that falls where the input rises."""
    if not model.dc_gain < 0:
        return []
    words = (
        f"The static gain of the model is negative: {model.output} falls where {model.input} rises, and the gains are "
        "negative. Check the sign of the sensor: with the other sign these gains are positive feedback."
    )
    return [(RESERVATIONS, words)]


def _of_model(verdict: Verdict | None) -> list[tuple[int, str]]:
    """Reservations that come with the model."""
    if verdict is None:
        return [(RESERVATIONS, "There is no verdict on the model; tune on an identification of a record.")]
    reasons = verdict.reasons or ((f"{verdict.words}.",) if verdict.level else ())
    return [(verdict.level, f"Model: {words}") for words in reasons if verdict.level > USABLE]


OVERSHOOT = 0.02  # equal to the settling band
ROBUST = 1.6  # default limit of Ms for objectives of speed; 1.4 to 2 in Åström & Hägglund 2006
LONGEST = 10.0  # default limit of the integral time, in settling times: 2 % overshoot on an integrator needs that
SPEED = ("rise_time", "settling_time", "disturbance")
FAST: tuple[Aim, ...] = ("iae", "disturbance_iae", "rise_time", "settling_time", "largest_ki")


class TuneOptions(TypedDict, total=False):
    """Further limits, and options of the controller; see `Specification` and `PiGains`."""

    undershoot: float | None
    ms: float | None
    phase_margin: float | None
    gain_margin: float | None
    disturbance: float | None
    travel: float | None
    peak_u: float | None
    noise_gain: float | None
    integral_time: float | None
    form: Form
    integration: Integration
    delay: int
    filter_time: float
    average: int
    average_of: Averaged
    low: float | None
    high: float | None
    rate: float | None
    anti_windup: AntiWindup
    tracking_time: float | None
    unit_u: str
    unit_y: str
    setpoint_weight: float


@one_thread
def tune_pi(
    model: "Model | Identification",
    rise_time: float | None = None,
    settling_time: float | None = None,
    overshoot: float | None = OVERSHOOT,
    *,
    aim: Aim = "ms",
    probability: float | None = None,
    nominal: bool = False,
    models: Sequence[Model] | None = None,
    verdict: Verdict | None = None,
    draws: int = 500,
    seed: int = 1,
    n: int = 200,
    step: float | None = None,
    **options: Unpack[TuneOptions],
) -> TunedPi:
    """Tune a digital PI to a specification on a model, with a required probability over its uncertainty.

    Parameters
    ----------
    model : Model or Identification
        Reservations about an identification lower the verdict on the gains.
    rise_time, settling_time : float, optional
        s at most, on the unit step of the reference: 10-90 %, and within 2 %.
    overshoot : float, optional
        At most, as a fraction of the step; default 2 %, ``None`` for no limit.
    aim : str
        Objective to minimise among feasible gains: ``ms``, ``iae``, ``disturbance_iae``, ``travel``,
        ``noise_gain``, ``rise_time``, ``settling_time``; or ``largest_ki``.
    probability : float, optional
        Required probability that the whole specification holds, over draws of the covariance of ``model`` or over
        ``models``; by default 0.9 where there are such.
    nominal : bool
        Require no probability: gains for the estimate alone. The probability is stated all the same.
    models : sequence of Model, optional
        Plants to use instead of draws.
    verdict : Verdict, optional
        On the model, where it is not an Identification.
    draws, seed : int
        Draws of the coefficients from their normal distribution that choose gains; 2000 others state the probability.
    n : int
        Gains per side of the feasible map.
    step : float, optional
        Of the reference, unit_y, that is simulated with the limits and the rate of the command; 1 by default.
    **options
        Further limits (`Specification`) and options of the controller (`PiGains`).

    Returns
    -------
    TunedPi
        ``feasible`` if the specification is met; otherwise the gains of least violation, with ``misses``.

    Raises
    ------
    IdentError
        No PI stabilises this model; no limit on speed; a probability given for a model without a covariance, or whose
        draws are mostly unstable.
    UsageError
        An invalid option.

    Notes
    -----
    Limits of the command are not part of the figures: they enter the verdict by a simulated step (``limited``).

    Examples
    --------
    >>> model = Model(b=[0.0, 0.02], a=[1.0, -0.98], nk=1, sample_time=0.02)
    >>> pi = tune_pi(model, rise_time=0.5, n=50)
    >>> pi.feasible, round(pi.figures.rise_time, 3)
    (True, 0.5)
    """
    check_aim(aim)
    if not isinstance(model, Model):
        verdict = model.verdict if verdict is None else verdict
        model = model.model
    if nominal and probability is not None:
        raise UsageError("nominal and probability: a nominal design requires no probability; give one of them.")
    limits, controller = sorted_options(dict(options))
    target, assumed = completed(
        Specification(rise_time, settling_time, overshoot, steady_error=STEADY, **limits), aim, model
    )
    units = {"unit_u": model.unit_u, "unit_y": model.unit_y}
    template = PiGains(0.0, 0.0, model.sample_time, **{**units, **controller})
    found, gains = nominal_gains(model, target, template, aim, n)
    choosing, stating, showing, unknown = plants_of(model, models, draws, seed, strict=probability is not None)
    held: Robustness | None = None
    required = None if nominal or choosing is None else PROBABILITY if probability is None else probability
    if choosing is not None and stating is not None:
        if required is not None:
            gains = robust_gains(choosing, found, gains, aim, required, template)
        held = robustness(stating, gains, target, duration=found.duration)
    figures = loop_of(model, gains).figures()
    limited = limited_step(model, gains, step, found.duration) if figures.stable else None
    return TunedPi(
        gains, figures, target, aim, model, found, assumed, held, required, unknown, verdict, showing, limited,
    )  # fmt: skip


def sorted_options(options: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Options that are limits, and options of the controller; UsageError for others."""
    unknown = sorted(set(options) - set(TuneOptions.__annotations__))
    if unknown:
        hint = did_you_mean(unknown[0], TuneOptions.__annotations__, 0.6)
        raise UsageError(f"option {unknown[0]!r} of tune_pi is not known. {hint}")
    limits = {name: value for name, value in options.items() if name in LIMITS}
    return limits, {name: value for name, value in options.items() if name not in LIMITS}


def completed(target: Specification, aim: Aim, model: Model) -> tuple[Specification, tuple[str, ...]]:
    """The specification completed by default limits, and sentences that state them."""
    names = {name for name, _, _ in target.active()}
    if aim not in FAST and not names & set(SPEED):
        raise IdentError(
            f"the specification has no limit on speed, and the smallest {aim} alone is a controller with zero gains. "
            "Give rise_time or settling_time, or aim='iae'."
        )
    assumed = []
    if target.overshoot == OVERSHOOT:
        assumed.append("overshoot <= 2 %")
    if aim in FAST and not names & {"ms", "phase_margin", "gain_margin"}:
        target = replace(target, ms=ROBUST)
        assumed.append(f"maximum sensitivity Ms <= {ROBUST:g}, as the objective {aim} does not ensure robustness")
    if target.integral_time is None:
        longest = LONGEST / 3 * horizon(model, target)
        target = replace(target, integral_time=longest)
        assumed.append(
            f"integral time Ti <= {longest:.3g} s, because a larger Ti can leave an error of up to 2 % for a long time"
        )
    return target, tuple(assumed)
