"""Gate of adaptive force control: it runs on drive and process of the file's estimates, with ripple and noise."""

import copy
import itertools
from collections.abc import Iterator
from functools import lru_cache
from typing import TYPE_CHECKING, Final

import numpy as np

from ...core.errors import FitmodelsError, GateError
from ...datasets.plausibility.ranges import plausible
from ...datasets.records.resampling import aliased_teeth, aliased_words
from ...datasets.units import canonical
from ...parameters.checks.report import FileFinding, require_verdicts
from ...parameters.exports.names import plain_unit
from ...parameters.messages import in_unit
from ...parameters.sections.base import ModelCovariance
from ...parameters.sections.load_line import feed_in
from ..adaptive_force.controller import AdaptiveForceControl
from ..adaptive_force.derivation import ALLOWED, UNEVEN, far_beyond, off_rule
from ..adaptive_force.design import ForceGains, Timing, fast_rates, loop_margins, settling_time, small_margins
from ..adaptive_force.plant import DriveAndCut
from ..adaptive_force.settings import (
    DRIFT,
    OVERLOAD,
    assumed_settings,
    beyond_limit,
    command_limits,
    falling_force,
    force_loop,
    incomplete,
    lacking,
    machine,
    needed_feeds,
    not_applied,
    settings_for,
    teeth_of,
    turning,
)
from . import GatedControl
from .roughness import (
    BRIDGED,
    ForceBench,
    check_roughness,
    fault_findings,
    gated,
    require_passed,
    wrong_at_rest,
)
from .settings import HIGHEST
from .simulation import FileKey

if TYPE_CHECKING:
    from ...parameters import ParameterFile
    from ...parameters.sections.force_control import AdaptiveForceSection

SEED: Final = 20
DRAWS, SPREAD = 6, 0.3  # of the plant; relative change of k, where the file has a covariance of the estimates besides
RIPPLE, NOISE = 0.3, 0.01  # of the force, and of the set point
BEYOND: Final = 5.0  # times the feed that the estimates need for the set points
PER_TURN: Final = 2.0  # mm per revolution
GAPS_FOR: Final = 1.5  # s of simulation with gaps
LONGEST: Final = 10000  # samples of a run
SETTLES: Final = 1.2  # times the settling time of the loop on the simulated plant
REST: Final = 0.95  # of the upper limit: a command that rests there, but for ripple and noise
SHARE: Final = 0.5  # of the pitch of the teeth in which an interrupted cut has a force
MEAN: Final = 0.25  # deviation of the mean force that the samples of a revolution give of it
SWING: Final = 0.1  # of the set point: deviation of the mean of a revolution at rest


def check_adaptive_force(pf: "ParameterFile") -> tuple[FileFinding, ...]:
    """Findings of the gate on the adaptive force control of a file; none without its section or its settings.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> check_adaptive_force(published("SURF"))
    ()
    """
    if pf.adaptive_force is None or pf.adaptive_force.Kd is None:
        return ()
    return _findings(FileKey(pf, {"adaptive_force", "limits"}))


def _of_control(pf: "ParameterFile") -> list[FileFinding]:
    """Findings on the rule of the gains and on margins, or where these are kept on the simulated control."""
    if why := lacking(pf):
        raise GateError(why)
    machine(pf)
    off = () if pf.adaptive_force is None else off_rule(pf.adaptive_force)
    wrong = [_failed("rule", f"{words}; derive it again or restore the file.") for words in off]
    return wrong or list(_loops(pf)) or list(_simulated(pf))


@lru_cache(maxsize=16)
def _findings(same: FileKey) -> tuple[FileFinding, ...]:
    pf = same.pf
    try:
        if why := beyond_limit(pf):
            return (_failed("limits", why),)
        found = list(_order(pf))
        if not any(finding.passed is False for finding in found):
            found += _of_control(pf)
    except FitmodelsError as error:
        words = f"The adaptive force control was not simulated: {error}"
        return (FileFinding("control", None if incomplete(pf) else False, words),)
    except (ArithmeticError, ValueError) as error:
        words = f"its numbers are too large or too small to simulate ({error}); check times, gains and estimates."
        return (_failed("control", words),)
    return tuple(found)


def _order(pf: "ParameterFile") -> Iterator[FileFinding]:
    """Findings on estimates, units and limits against each other."""
    section = pf.adaptive_force
    if section is None:
        return
    if not section.beta > 0:
        words = f"beta is {section.beta:.4g}: the force falls when the feed rises; check the sensor's sign."
        yield _failed("units", words)
        return
    if incomplete(pf):
        return
    yield from (FileFinding("limits", None, words) for words in (*not_applied(pf), *falling_force(section)))
    yield from _units(section)
    yield from _turns(pf, section)
    yield from _feeds(pf, section)
    yield from _readings(section)


def _loops(pf: "ParameterFile") -> Iterator[FileFinding]:
    """Finding on margins, with a step from reading to feed, or rates of a set point; none where all suffice."""
    section = pf.adaptive_force
    if section is None or section.depth is None:
        return
    ratios = np.array([section.m, section.alpha, section.beta]) * section.depth
    s = settings_for(pf, section.set_points[0].depth)
    gains = ForceGains(s.Kd, s.lam, s.g1, s.g2, s.g3, s.reference_time)
    timing = Timing(s.sample_time, s.samples, s.sample_time)
    for point in section.set_points:
        of_cut = ratios / point.depth
        found = loop_margins(of_cut[None], gains, point.force, timing)[0]
        if words := small_margins(found) or fast_rates(of_cut, gains, point.force):
            at = f"{point.force:g} {section.unit_force} at {point.depth:g} {section.unit_depth}"
            yield _failed("margins", f"{at}: {words}")
            return


def _readings(section: "AdaptiveForceSection") -> Iterator[FileFinding]:
    """Valid readings against the set points."""
    forces = [point.force for point in section.set_points]
    readings, most = (section.force_low or 0.0, section.force_high or 0.0), HIGHEST * OVERLOAD * max(forces)
    if max(map(abs, readings)) > most:
        span = f"valid readings from {readings[0]:.4g} to {readings[1]:.4g} {section.unit_force}"
        times = f"{HIGHEST * OVERLOAD:g} times the largest set point"
        yield _failed("readings", f"{span} go beyond {most:.4g}, {times}, so that none is invalid; narrow them.")
    per_force = (feed / force for feed, force in zip(needed_feeds(section), forces, strict=True))
    at_low = (section.low or 0.0) / max(per_force)  # the smallest force of a cut, by the estimates
    least, low = max(at_low, DRIFT * max(forces)), section.force_low or 0.0  # the other is a drift of the zero
    if low < -least:
        words = f"A sensor of reversed sign reads {-at_low:.4g} {section.unit_force} in a cut at the lower feed limit, "
        end = f"taken for air, as readings are valid from {low:.4g}; raise force_low above {-least:.4g} for a fault."
        yield FileFinding("readings", None, f"{words}{end}")


def _units(section: "AdaptiveForceSection") -> Iterator[FileFinding]:
    """Units of the section against those of the record that its estimates come from, and the size of the force."""
    own, of_record = (section.unit_u, section.unit_force), section.tested_units
    if of_record is not None and [*map(canonical, own)] != [*map(canonical, of_record)]:
        words = f"the section is in {plain_unit(own[0])} and {plain_unit(own[1])}, its record in"
        yield _failed("units", f"{words} {plain_unit(of_record[0])} and {plain_unit(of_record[1])}; restore the file.")
    largest, usual = max(point.force for point in section.set_points), plausible("F", "milling")
    newton = in_unit(largest, section.unit_force, "N")
    if usual is not None and newton is not None and newton > usual.unusual[1]:
        words = f"a set point of {largest:.4g} {section.unit_force} is above the {usual.unusual[1]:g} N of milling"
        yield _failed("units", f"{words}: check the unit of the force.")


def _turns(pf: "ParameterFile", section: "AdaptiveForceSection") -> Iterator[FileFinding]:
    """The time that the force is averaged over against the spindle speed, and its samples against the teeth."""
    speed, average = section.spindle_speed, section.average_time
    if speed is not None and average is not None and abs(average * speed / 60 - 1) > UNEVEN:
        turns = f"is {average * speed / 60:.3g} revolutions at {speed:g} 1/min"
        yield _failed("times", f"average_time {average:g} s {turns}; it is that of one: check both.")
        return
    n, step, teeth = turning(pf), section.sample_time, teeth_of(pf)
    if n and step and (aliased := aliased_teeth(60 / n, step, teeth)):
        words = f"{aliased_words(60 / n, step, aliased, teeth)}; set it up again with a shorter step"
        yield _failed("times", f"{words}{'' if teeth else ', or with the number of teeth (--teeth)'}.")


def _feeds(pf: "ParameterFile", section: "AdaptiveForceSection") -> Iterator[FileFinding]:
    """Limits of the command against the estimates, the tests and the spindle speed."""
    (low, high), unit = command_limits(pf), section.unit_u
    feeds = needed_feeds(section)
    words = f"by the estimates the set points need feeds of {min(feeds):.4g} to {max(feeds):.4g} {unit}"
    if not (low < min(feeds) and max(feeds) < high):
        limits = f"the limits are {low:.4g} to {high:.4g}"
        yield _failed("limits", f"{words}, {limits}: check the units of feed and force, or widen the limits.")
    if high > BEYOND * max(feeds):
        beyond = f"the upper limit {high:.4g} is more than {BEYOND:g} times as much"
        yield _failed("limits", f"{words}, {beyond}; lower it: no run is known to have cut at it.")
    yield from _beyond_tests(section, high)
    turn, speed = feed_in(high, unit, "mm/rev", turning(pf)), turning(pf) or 0.0
    if turn is not None and turn > PER_TURN:
        of = f"is {turn:.3g} mm per revolution at {speed:g} 1/min"
        yield _failed("limits", f"the upper limit {high:.4g} {unit} {of}, more than {PER_TURN:g}; lower it.")


def _beyond_tests(section: "AdaptiveForceSection", high: float) -> Iterator[FileFinding]:
    """Upper limit and set points against the record, unless what lies beyond it was allowed."""
    points = [(point.depth, point.force) for point in section.set_points]
    if section.tested is not None and ALLOWED not in section.sources.get("high", ""):
        for far in far_beyond(section, points, high):
            yield _failed("limits", f"{far}; lower it, or allow it with `fitmodels adaptive-force --beyond-tested`.")


def _failed(name: str, words: str) -> FileFinding:
    return FileFinding(name, False, f"Adaptive force control: {words}")


def _simulated(pf: "ParameterFile") -> Iterator[FileFinding]:
    section = pf.adaptive_force
    if section is None:
        return
    means, middle = [], None
    for point in section.set_points[:5]:
        bench = _bench(pf, point.depth)
        wrong, mean = _run(bench, point.force)
        if wrong:
            where = f"simulated at {point.depth:g} {section.unit_depth}"
            yield _failed("simulation", f"{where}, {wrong}; choose Kd, lam and the feed limits again.")
            return
        means.append(f"{mean:.4g} at {point.force:.4g}")
        middle = middle or bench
    named = ", ".join(means)
    yield FileFinding(
        "simulation", True, f"Simulated on drive and process of the estimates, the mean force is {named} "
        f"{section.unit_force} asked for.",
    )  # fmt: skip
    yield from _interrupted(pf)
    yield from _draws(pf)
    if middle is not None:
        yield from fault_findings(middle)
        yield from _gaps(middle)


def _interrupted(pf: "ParameterFile") -> Iterator[FileFinding]:
    """Finding on a cut whose force is zero between the teeth."""
    section = pf.adaptive_force
    if section is None:
        return
    point = section.set_points[0]
    noise = NOISE * point.force
    plant = DriveAndCut.from_parameters(pf, point.depth, noise=noise, share=SHARE)
    bench = _bench(pf, point.depth, plant)
    wrong, _ = _run(bench, point.force, 1 / SHARE)  # it adapts while the teeth cut
    true, asked = plant.force, f"{point.force:.4g} {section.unit_force} asked for"
    where = f"in an interrupted cut, with a force in {100 * SHARE:.0f} % of the pitch of the teeth"
    if not wrong and true > (1 + MEAN) * point.force:
        wrong = f"the true mean force is {true:.4g} at {asked}"
    if wrong:
        yield _failed("simulation", f"{where}, {wrong}; shorten the sample time.")
        return
    words = f"I{where[1:]}, the mean force is {true:.4g} at {asked}."
    yield FileFinding("simulation", True, words)


def _gaps(middle: ForceBench) -> Iterator[FileFinding]:
    """Findings on readings that are lost for moments, too short or too seldom for a fault."""
    loop = middle.controller.control.loop
    lost = loop.samples(loop.lost_after)
    usual = float(copy.deepcopy(middle).run(GAPS_FOR)[0].max())
    for missing, of in ((lost - 1, 6 * lost), (max(lost // 5, 1), 6 * max(lost // 5, 1))):
        bench, count = copy.deepcopy(middle), itertools.count()

        def reading(force: float, missing: int = missing, of: int = of, count: Iterator[int] = count) -> float:
            return float("nan") if next(count) % of < missing else force

        highest = float(bench.run(GAPS_FOR, reading=reading)[0].max())
        if highest > BRIDGED * usual:
            words = f"{missing} of {of} readings lost raise the feed to {highest:.4g}, without gaps {usual:.4g} at most"
            yield _failed("fault", f"{words}; lower Kd.")


def _bench(pf: "ParameterFile", depth: float, plant: DriveAndCut | None = None, seed: int = SEED) -> ForceBench:
    control = AdaptiveForceControl.from_parameters(pf, depth)
    noise = NOISE * control.set_point
    cut = plant or DriveAndCut.from_parameters(pf, depth, ripple=RIPPLE, noise=noise)
    return ForceBench(control, cut, control.settings.sample_time, np.random.default_rng(seed))


def _run(bench: ForceBench, point: float, slower: float = 1.0) -> tuple[str, float]:
    """Fault found after settling, ``slower`` times as long; empty where there is none; and the mean force."""
    settings = bench.controller.settings
    settle = max(1.0 + 8 * settings.reference_time + 6 / settings.lam, SETTLES * _settling(bench, point))
    bench.run(min(slower * settle, LONGEST * settings.sample_time))
    turn = settings.samples * settings.sample_time
    turns = max(round(0.5 / turn), 4)
    commands, forces = bench.run(turns * turn)
    means, span = forces.reshape(turns, -1).mean(axis=1), settings.high - settings.low
    if float(forces.mean()) < point and commands.mean() > REST * settings.high and not bench.controller.control.fault:
        return "", float(forces.mean())  # the cut needs more than the upper limit: less force than asked for is right
    words = wrong_at_rest(bench, commands, forces, point)
    if not words and np.abs(means / point - 1).max() > SWING:
        words = f"the mean force of a revolution swings between {means.min():.4g} and {means.max():.4g}"
    if not words and np.ptp(commands) > 0.9 * span:
        words = f"the feed command swings from {commands.min():.4g} to {commands.max():.4g}, over its whole range"
    return words, float(forces.mean())


def _settling(bench: ForceBench, point: float) -> float:
    """Time until the loop has settled on the plant of the bench, s."""
    s, plant = bench.controller.settings, bench.plant
    k = plant.k_per_depth * plant.depth_at(0.0)
    ratios = np.array([plant.m, plant.m * plant.c + plant.d, plant.d * plant.c]) / k
    return settling_time(ratios, ForceGains(s.Kd, s.lam, s.g1, s.g2, s.g3, s.reference_time), point)


def _draws(pf: "ParameterFile") -> Iterator[FileFinding]:
    """Plants drawn from the covariance of the estimates, and with another k: harder work, another depth."""
    section = pf.adaptive_force
    if section is None or section.depth is None:
        return
    rng, point = np.random.default_rng(SEED + 1), section.set_points[0]
    held, failed = section.uncertainty, []
    estimates = np.array([section.m, section.alpha, section.beta])
    covariance = np.zeros((3, 3))
    if isinstance(held, ModelCovariance) and set(held.of) == {"m", "alpha", "beta"}:
        order = [held.of.index(name) for name in ("m", "alpha", "beta")]
        covariance = np.array(held.matrix)[np.ix_(order, order)]
    for k in range(DRAWS):
        drawn = rng.multivariate_normal(estimates, covariance, method="eigh")
        fields = dict(zip(("m", "alpha", "beta"), (float(value) for value in drawn), strict=True))
        try:
            m, c, gain = machine(pf.model_copy(update={"adaptive_force": section.model_copy(update=fields)}))
        except GateError:
            failed.append("unstable poles")
            continue
        factor = 1 + SPREAD * (2 * k / (DRAWS - 1) - 1)
        noise = NOISE * point.force
        plant = DriveAndCut(point.depth, m=m, c=c, k_per_depth=gain * factor, ripple=RIPPLE, noise=noise)
        words, _ = _run(_bench(pf, point.depth, plant, k), point.force)
        failed += [words] if words else []
    what = f"of {DRAWS} plants drawn from the estimates with a gain changed by up to {100 * SPREAD:.0f} %"
    if failed:
        yield _failed("draws", f"{what}, {len(failed)} are not held ({failed[0]}); identify or design again.")
    else:
        result = "all are held, or have less force at the upper feed limit."
        yield FileFinding("draws", True, f"{what[:1].upper()}{what[1:]}, {result}")


def require_force_controls(pf: "ParameterFile") -> tuple[FileFinding, ...]:
    """Findings on constant roughness and adaptive force of a file whose values are exported.

    Raises
    ------
    GateError
        One of them fails.

    Examples
    --------
    >>> from fitmodels import parameters
    >>> require_force_controls(parameters.collect(tool="GC435", work="709M40", laws=[]))
    ()
    """
    found = (*check_roughness(pf), *check_adaptive_force(pf))
    require_passed(found)
    return found


def gated_adaptive_force(
    pf: "ParameterFile", *, depth: float | None = None, accept_verdict: bool = False
) -> GatedControl:
    """The adaptive force control of a file at one of its set points, once it has passed the gate.

    Parameters
    ----------
    pf : ParameterFile
    depth : float, optional
        Of the set point; by default that of the smallest force.
    accept_verdict : bool

    Raises
    ------
    GateError
        The file fails the check or the gate, lacks a setting, or its estimates must not be used for control.
    """
    section = pf.adaptive_force
    if section is None or (why := lacking(pf)):
        raise GateError(f"not exported: {lacking(pf) if section is None else why}")
    least = min(section.set_points, key=lambda point: point.force)
    settings = settings_for(pf, least.depth if depth is None else depth)
    assumed = assumed_settings(pf, settings)
    if depth is None and len(section.set_points) > 1:
        words = f"set point {least.force:g} {section.unit_force} at a depth of {least.depth:g} {section.unit_depth}"
        assumed = (f"{words}, the smallest of {len(section.set_points)}; another one by --depth", *assumed)
    held = require_verdicts(pf, accept_verdict, only=("adaptive_force",))
    return gated(pf, force_loop(settings), check_adaptive_force(pf), held, assumed)
