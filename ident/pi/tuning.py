"""PI tuning to a specification: feasible gains of the smallest maximum sensitivity, or of another objective."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, TypedDict, Unpack

from ...core.display import Plottable
from ...core.errors import IdentError, UsageError
from ...core.suggestions import did_you_mean
from ...core.threads import one_thread
from ..model import Model
from .feasible_region import FeasibleMap, horizon
from .gain_search import Aim, check_aim, nominal_gains
from .gains import AntiWindup, Averaged, Form, Integration, PiGains
from .loop import FiguresOfMerit, loop_of
from .robust_design import Robustness, draws_of_models, robust_gains, robustness
from .specification import LIMITS, STEADY, Specification, table_of


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
        Over draws of the covariance, or over several models.
    probability : float or None
        Required probability.
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
        """A sentence for each violated limit, worst first, and for a required probability."""
        sentences = self.specification.misses(table_of(self.figures, self.kp, self.ki))
        held = self.robustness
        if self.probability is not None and held is not None and held.probability < self.probability - 2 * held.error:
            sentences.append(
                f"the specification holds with probability {100 * held.probability:.1f} % (Monte Carlo SE "
                f"{100 * held.error:.1f} %), below the required {100 * self.probability:.1f} %"
            )
        return tuple(sentences)

    @property
    def feasible(self) -> bool:
        """Whether the specification is met.

        If not, `misses` names the violated limits and the gains have the least violation. Relax one of these limits,
        shorten the delay or the filter, or (for a probability) identify more precisely: longer, larger amplitude.
        """
        return not self.misses

    @property
    def verdict(self) -> str:
        """Gains, whether they meet the specification, and the assumptions."""
        unit = f" {self.gains.unit_u}/{self.gains.unit_y}" if self.gains.unit_u and self.gains.unit_y else ""
        head = (
            f"Kp {self.kp:.4g}{unit}, Ki {self.ki:.4g}{unit} per second, {self.gains.form} form, "
            f"{self.gains.integration} integration, sample time {self.gains.sample_time:g} s"
        )
        if self.feasible:
            result = f"meets the specification ({self.specification})"
        else:
            result = "no gains meet the specification; least violation: " + "; ".join(self.misses)
            conflict = self.conflict
            result += f" ({conflict})" if conflict else ""
        assumed = f" Assumed: {'; '.join(self.assumed)}." if self.assumed else ""
        held = f" {self.robustness.verdict}" if self.robustness else ""
        return f"{head}: {result}.{assumed}{held}"

    @property
    def conflict(self) -> str:
        """The single limit that conflicts with the others on the map; empty if there is none, or several conflict."""
        found = {n: v > 0 for n, v in self.specification.violations(self.map.figures).items()}
        stable = self.map.figures["stable"].astype(bool)
        free = []
        for name in found:
            others = [v for other, v in found.items() if other != name]
            blocked = sum(others, start=~stable) > 0 if others else ~stable
            if not blocked.all():
                free.append(name)
        words = " or ".join(LIMITS[name].words for name in free)
        return f"feasible without the limit on {words}" if free and not self.map.any else ""


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


@one_thread
def tune_pi(
    model: Model,
    rise_time: float | None = None,
    settling_time: float | None = None,
    overshoot: float | None = OVERSHOOT,
    *,
    aim: Aim = "ms",
    probability: float | None = None,
    models: Sequence[Model] | None = None,
    draws: int = 500,
    seed: int = 1,
    n: int = 200,
    **options: Unpack[TuneOptions],
) -> TunedPi:
    """Tune a digital PI to a specification on a model, optionally with a probability over its uncertainty.

    Parameters
    ----------
    model : Model
    rise_time, settling_time : float, optional
        s at most, on the unit step of the reference: 10-90 %, and within 2 %.
    overshoot : float, optional
        At most, as a fraction of the step; default 2 %, ``None`` for no limit.
    aim : str
        Objective to minimise among feasible gains: ``ms``, ``iae``, ``disturbance_iae``, ``travel``,
        ``noise_gain``, ``rise_time``, ``settling_time``; or ``largest_ki``.
    probability : float, optional
        Required probability that the whole specification holds, over draws of the covariance of ``model`` or over
        ``models``.
    models : sequence of Model, optional
        Plants to use instead of draws.
    draws, seed : int
        Draws of the coefficients from their normal distribution.
    n : int
        Gains per side of the feasible map.
    **options
        Further limits (`Specification`) and options of the controller (`PiGains`).

    Returns
    -------
    TunedPi
        ``feasible`` if the specification is met; otherwise the gains of least violation, with ``misses``.

    Raises
    ------
    IdentError
        No PI stabilises this model; no limit on speed; a required probability without a covariance.
    UsageError
        An invalid option.

    Notes
    -----
    Saturation is not part of the figures: check limits of the command by ``peak_u`` or by simulation.

    Examples
    --------
    >>> model = Model(b=[0.0, 0.02], a=[1.0, -0.98], nk=1, sample_time=0.02)
    >>> pi = tune_pi(model, rise_time=0.5, n=50)
    >>> pi.feasible, round(pi.figures.rise_time, 3)
    (True, 0.5)
    """
    check_aim(aim)
    limits, controller = sorted_options(dict(options))
    target, assumed = completed(
        Specification(rise_time, settling_time, overshoot, steady_error=STEADY, **limits), aim, model
    )
    units = {"unit_u": model.unit_u, "unit_y": model.unit_y}
    template = PiGains(0.0, 0.0, model.sample_time, **{**units, **controller})
    found, gains = nominal_gains(model, target, template, aim, n)
    held: Robustness | None = None
    if probability is not None or models is not None:
        plants = draws_of_models(model, draws, seed) if models is None else models
        if probability is not None:
            gains = robust_gains(plants, found, gains, aim, probability, template)
        fresh = draws_of_models(model, draws, seed + 1) if models is None else plants
        held = robustness(fresh, gains, target, duration=found.duration)
    figures = loop_of(model, gains).figures()
    return TunedPi(gains, figures, target, aim, model, found, assumed, held, probability)


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
