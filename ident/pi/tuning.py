"""PI gains from a specification: among those that meet it the ones of the smallest sensitivity peak, or another aim.

Gains that were tuned, with everything that they were judged by.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from typing import Any, TypedDict, Unpack

from ...core.display import Plottable
from ...core.errors import IdentError, UsageError
from ...core.threads import one_thread
from ..model import Model
from .feasible_region import FeasibleMap, feasible_map, horizon
from .gain_search import Aim, check_aim, refined
from .gains import AntiWindup, Averaged, Form, Integration, PiGains
from .loop import FiguresOfMerit, loop_of
from .robust_design import Robustness, draws_of_models, robust_gains, robustness
from .specification import LIMITS, STEADY, Specification, table_of


@dataclass(frozen=True, slots=True, repr=False)
class TunedPi(Plottable):
    """Gains, the loop they close on the model, and what was asked.

    Attributes
    ----------
    gains : PiGains
        As the controller runs them.
    figures : FiguresOfMerit
        Of the loop on the model, run until it has died out.
    specification : Specification
    aim : str
    model : Model
    map : FeasibleMap
    assumed : tuple of str
        Limits that nobody asked for.
    robustness : Robustness or None
        What holds over draws of the covariance, or over several models.
    probability : float or None
        That was demanded.
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
        """A sentence for each limit that the gains miss, worst first, and for a demanded probability."""
        sentences = self.specification.misses(table_of(self.figures, self.kp, self.ki))
        held = self.robustness
        if self.probability is not None and held is not None and held.probability < self.probability - 2 * held.error:
            sentences.append(
                f"the specification holds with a probability of {held.probability:.1%} (Monte Carlo error "
                f"{held.error:.1%}), below the {self.probability:.1%} asked for"
            )
        return tuple(sentences)

    @property
    def feasible(self) -> bool:
        """Whether everything that was asked is met.

        Where not, `misses` name what fails and the gains are the nearest. Loosen one of those limits, shorten the delay
        or the filter, or (a probability) identify more exactly: a longer record, more amplitude.
        """
        return not self.misses

    @property
    def verdict(self) -> str:
        """One paragraph: gains, what they meet or miss, what was assumed."""
        unit = f" {self.gains.unit_u}/{self.gains.unit_y}" if self.gains.unit_u and self.gains.unit_y else ""
        head = (
            f"Kp {self.kp:.4g}{unit}, Ki {self.ki:.4g}{unit} per second, {self.gains.form} form, "
            f"{self.gains.integration} sum at {self.gains.sample_time:g} s"
        )
        if self.feasible:
            says = f"meets {self.specification}"
        else:
            says = "no gains meet the specification; these come nearest: " + "; ".join(self.misses)
            conflict = self.conflict
            says += f" ({conflict})" if conflict else ""
        assumed = f" Assumed: {'; '.join(self.assumed)}." if self.assumed else ""
        held = f" {self.robustness.verdict}" if self.robustness else ""
        return f"{head}: {says}.{assumed}{held}"

    @property
    def conflict(self) -> str:
        """Which single limit stands against the others on the map; empty where there is none, or two must go."""
        found = {n: v > 0 for n, v in self.specification.violations(self.map.figures).items()}
        stable = self.map.figures["stable"].astype(bool)
        free = []
        for name in found:
            others = [v for other, v in found.items() if other != name]
            blocked = sum(others, start=~stable) > 0 if others else ~stable
            if not blocked.all():
                free.append(name)
        words = " or that on ".join(LIMITS[name].words for name in free)
        return f"without the limit on {words} there are gains" if free and not self.map.any else ""


OVERSHOOT = 0.02  # as wide as the settling band
CALM = 1.6  # Ms assumed where an aim asks for speed and nothing for robustness; 1.4 to 2 in Åström & Hägglund 2006
LONGEST = 10.0  # integral time assumed, in settling times: 2 % of overshoot on an integrator needs about that
SPEED = ("rise_time", "settling_time", "disturbance")
FAST: tuple[Aim, ...] = ("iae", "disturbance_iae", "rise_time", "settling_time", "largest_ki")


class TuneOptions(TypedDict, total=False):
    """Further limits, and the controller as it runs; see `Specification` and `PiGains`."""

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
    """Gains of a digital PI that meet a specification on a model, and by demand on what the model leaves open.

    Parameters
    ----------
    model : Model
    rise_time, settling_time : float, optional
        s at most, on the unit step of the reference: 10-90 %, and within 2 %.
    overshoot : float, optional
        At most, as a share of the step; 2 % unless said, ``None`` leaves it free.
    aim : str
        What is made small among the gains that meet everything: ``ms``, ``iae``, ``disturbance_iae``, ``travel``,
        ``noise_gain``, ``rise_time``, ``settling_time``; or ``largest_ki``.
    probability : float, optional
        Demanded probability that the whole specification holds, over draws of the covariance of ``model`` or over
        ``models``.
    models : sequence of Model, optional
        Plants that it is to hold on, instead of draws.
    draws, seed : int
        Draws of the coefficients from their normal distribution.
    n : int
        Gains a side of the feasible map.
    **options
        Further limits (`Specification`) and the controller as it runs (`PiGains`).

    Returns
    -------
    TunedPi
        ``feasible`` says whether everything is met. Where not, the gains are the nearest and ``misses`` say what fails.

    Raises
    ------
    IdentError
        No PI is stable with this model; nothing asks for speed; a demanded probability without a covariance.
    UsageError
        An option that cannot be.

    Notes
    -----
    Saturation takes no part in the figures: limits of the command are checked by ``peak_u`` or by simulation.

    Examples
    --------
    >>> model = Model(b=[0.0, 0.02], a=[1.0, -0.98], nk=1, sample_time=0.02)
    >>> pi = tune_pi(model, rise_time=0.5, n=50)
    >>> pi.feasible, round(pi.figures.rise_time, 3)
    (True, 0.5)
    """
    check_aim(aim)
    limits, controller = sorted_options(dict(options))
    asked, assumed = completed(
        Specification(rise_time, settling_time, overshoot, steady_error=STEADY, **limits), aim, model
    )
    units = {"unit_u": model.unit_u, "unit_y": model.unit_y}
    template = PiGains(0.0, 0.0, model.sample_time, **{**units, **controller})
    found, gains = nominal_gains(model, asked, template, aim, n)
    held: Robustness | None = None
    if probability is not None or models is not None:
        plants = draws_of_models(model, draws, seed) if models is None else models
        if probability is not None:
            gains = robust_gains(plants, found, gains, aim, probability, template)
        fresh = draws_of_models(model, draws, seed + 1) if models is None else plants
        held = robustness(fresh, gains, asked, duration=found.duration)
    figures = loop_of(model, gains).figures()
    return TunedPi(gains, figures, asked, aim, model, found, assumed, held, probability)


def sorted_options(options: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Options that are limits, and those of the controller; a name that is neither is refused."""
    unknown = sorted(set(options) - set(TuneOptions.__annotations__))
    if unknown:
        near = get_close_matches(unknown[0], TuneOptions.__annotations__, 1)
        meant = f" Did you mean {near[0]!r}?" if near else f" There are: {', '.join(TuneOptions.__annotations__)}."
        raise UsageError(f"option {unknown[0]!r} of tune_pi is not known.{meant}")
    limits = {name: value for name, value in options.items() if name in LIMITS}
    return limits, {name: value for name, value in options.items() if name not in LIMITS}


def completed(asked: Specification, aim: Aim, model: Model) -> tuple[Specification, tuple[str, ...]]:
    """The specification with what has to be assumed, and the sentences that say so."""
    names = {name for name, _, _ in asked.active()}
    if aim not in FAST and not names & set(SPEED):
        raise IdentError(
            f"nothing in the specification asks for speed, and the smallest {aim} alone is a controller that does "
            "nothing. Give rise_time or settling_time, or aim='iae'."
        )
    assumed = []
    if asked.overshoot == OVERSHOOT:
        assumed.append("overshoot at most 2 % (unless said otherwise)")
    if aim in FAST and not names & {"ms", "phase_margin", "gain_margin"}:
        asked = replace(asked, ms=CALM)
        assumed.append(f"sensitivity peak Ms at most {CALM:g}: the aim {aim} knows no robustness of its own")
    if asked.integral_time is None:
        longest = LONGEST / 3 * horizon(model, asked)
        asked = replace(asked, integral_time=longest)
        assumed.append(f"integral time at most {longest:.3g} s: a slower one leaves an error of up to 2 % standing")
    return asked, tuple(assumed)


def nominal_gains(
    model: Model, asked: Specification, template: PiGains, aim: Aim, n: int
) -> tuple[FeasibleMap, PiGains]:
    """Map and best gains; simulated for longer where a slow tail shows after the horizon of the search."""
    time = horizon(model, asked)
    for _ in range(3):
        found = feasible_map(model, asked, template, n, duration=time)
        point = refined(model, asked, template, found, aim)
        gains = replace(template, kp=point.kp, ki=point.ki)
        if point.worst > 0 or float(asked.worst(table_of(loop_of(model, gains).figures(), gains.kp, gains.ki))) <= 0:
            break
        time *= 4
    return found, gains
