"""Report on turning at constant roughness (SURF): control, theory, draws, and the simulations of Table 1."""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ...controllers.roughness.controller import ConstantRoughness
from ...controllers.roughness.plant import TurningForce, loop_theory
from ...controllers.roughness.reference import law_of, reference_force
from ...controllers.roughness.simulations import SteadyCut, TurningRun, steady, turn
from ...core.errors import ParameterError, UsageError
from . import Replayed

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ...controllers.roughness.simulations import TableSimulation
    from ...parameters import LawSection, ParameterFile
    from ...parameters.draws import Draws
    from ...parameters.sections.force_control import RoughnessSection

TITLE = "Turning at constant roughness through constant force (SURF)"
FINER = 1.6  # times: the paper's change along the run, from 1.6 to 1.0 um
CHANGE = 7.5  # s: the paper prints no times of its sections A to D
OUT = (5.0, 8.0)  # s, tool out of the work
SURE = 0.95
STIFFER = 1.2


def lacks(pf: "ParameterFile") -> str:
    """Reason why a file cannot drive the system; empty where it can."""
    try:
        ConstantRoughness.from_parameters(pf)
        plant = TurningForce.from_parameters(pf)
    except (ParameterError, UsageError) as error:
        return str(error)
    if not min(plant.tc, plant.ts) > 0:
        return "The roughness section has a servo_time or process_time of 0; give the measured value."
    return ""


def replayed(pf: "ParameterFile", draws: "Mapping[str, Draws]", seed: int) -> Replayed:
    """Report on a file, with and without control: constant and changed roughness, tool out of the work."""
    section = _section(pf)
    facts: dict[str, object] = {}
    controlled, constant = turn(pf, seed=seed), turn(pf, control=False, seed=seed)
    lines = [
        *_held(pf, steady(controlled), steady(constant), facts),
        _limited(pf, controlled, steady(controlled), facts),
        _loop(section, facts),
        *_of_draws(pf, draws, facts),
        _stiffer(pf, seed, facts),
    ]
    figures: dict[str, Figure] = {}
    lines += [*_changed(pf, seed, facts, figures), _out_of_work(pf, facts), _other_reading(pf, seed, facts, figures)]
    if pf.provenance.options.get("paper") == "SURF":
        lines += table_lines(section, seed, facts, figures)
    return Replayed("roughness", TITLE, tuple(lines), _assumed(pf), facts, figures)


def _section(pf: "ParameterFile") -> "RoughnessSection":
    if pf.roughness is None:
        raise UsageError(lacks(pf))
    return pf.roughness


def _held(pf: "ParameterFile", on: SteadyCut, off: SteadyCut, facts: dict[str, object]) -> list[str]:
    section, law = _section(pf), law_of(pf)
    facts |= {
        "Ra_ref_um": section.roughness, "F_ref_N": section.force, "force_from": section.force_from,
        "Ra_mean_um": on.Ra, "Ra_sd_um": on.Ra_sd, "Ra_mean_without_um": off.Ra, "Ra_sd_without_um": off.Ra_sd,
        "F_mean_N": on.F, "f_mean_mm_per_rev": on.f, "f_peak_to_peak_mm_per_rev": on.ripple,
        "f_command_peak_to_peak_mm_per_rev": on.command_ripple, "f_without_mm_per_rev": off.f,
    }  # fmt: skip
    how = "the inverse of its law" if section.force_from == "inverse" else "a regression of force on roughness"
    beyond = "" if _inside(law, section.force) else "; that force lies outside the tested range of the law"
    return [
        f"Ra {section.roughness:g} um corresponds to a reference force of {section.force:.0f} N, by {how} "
        f"({law.equation})"
        f"{beyond}.",
        f"Simulated, in steady cut from 3 to 15 s: mean Ra {on.Ra:.3g} um, {_percent(on.Ra / section.roughness - 1)} "
        f"from the required one, standard deviation {on.Ra_sd:.2f} um; at a constant feed of {off.f:.3g} mm/rev "
        f"{off.Ra:.3g} um, {_percent(off.Ra / section.roughness - 1)}, standard deviation {off.Ra_sd:.2f} um.",
        f"Feed {on.f:.3f} mm/rev on average, {on.ripple:.3f} mm/rev peak-to-peak at the servo's output "
        f"({on.command_ripple:.3f} of the command); force {on.F:.0f} N.",
    ]


def _limited(pf: "ParameterFile", cut: TurningRun, on: SteadyCut, facts: dict[str, object]) -> str:
    facts |= {
        "low_mm_per_rev": cut.low,
        "high_mm_per_rev": cut.high,
        "share_at_low": on.at_low,
        "share_at_high": on.at_high,
    }
    section = _section(pf)
    programmed = section.feed or 1.0
    words = (
        f"The feed may go from {cut.low:g} to {cut.high:.3g} mm/rev, {100 * cut.low / programmed:.0f} to "
        f"{100 * cut.high / programmed:.0f} % of the programmed {programmed:g}"
    )
    rests = [f"{100 * share:.0f} % of the time on the {name}" for share, name in
             ((on.at_low, "lower limit"), (on.at_high, "upper limit")) if share]  # fmt: skip
    return (
        f"{words}; the command is {' and '.join(rests)}." if rests else f"{words}; no limit was active in steady cut."
    )


def _loop(section: "RoughnessSection", facts: dict[str, object]) -> str:
    loop = loop_theory(section.process_time or 0.0, section.servo_time or 0.0, section.sample_time or 0.0)
    facts |= {"crossover_Hz": loop.crossover, "enlarged": loop.enlarged, "damping": loop.damping}
    return (
        f"The loop attenuates changes of force slower than {loop.crossover:.2g} Hz (calculated) and amplifies "
        "faster ones "
        f"by up to {loop.enlarged:.2g}, so it corrects the mean but not the variation from revolution to revolution."
    )


def _stiffer(pf: "ParameterFile", seed: int, facts: dict[str, object]) -> str:
    on, off = (steady(turn(pf, control=control, seed=seed, engaged=lambda t: STIFFER)) for control in (True, False))
    facts |= {"stiffer_times": STIFFER, "stiffer_Ra_mean_um": on.Ra, "stiffer_Ra_mean_without_um": off.Ra}
    return (
        f"In a cut {100 * (STIFFER - 1):.0f} % stiffer than in the file (harder work, more depth) the control "
        f"sets the feed to {on.f:.3f} mm/rev and the mean Ra is {on.Ra:.3g} um; at constant feed {off.Ra:.3g} um."
    )


def _of_draws(pf: "ParameterFile", draws: "Mapping[str, Draws]", facts: dict[str, object]) -> list[str]:
    section = _section(pf)
    found = draws.get(section.law)
    if found is None:
        return ["No draws of the law's parameters, so no interval of the roughness at that force."]
    ln_a, b = (found.values[:, found.names.index(name)] for name in ("ln a", "b"))
    low, high = np.quantile(np.exp(ln_a + b * section.force), [0.025, 0.975])
    safe = float(np.quantile((math.log(section.roughness) - ln_a) / b, 1 - SURE))
    facts |= {"Ra_band_um": [float(low), float(high)], "F_safe_N": safe, "probability": SURE}
    return [
        f"By {len(ln_a)} draws of the law the roughness at {section.force:.0f} N is {low:.3g} to {high:.3g} um "
        f"(95 % credible interval); it stays at or below {section.roughness:g} um with a probability of "
        f"{100 * SURE:.0f} % at "
        f"{safe:.0f} N."
    ]


def _changed(pf: "ParameterFile", seed: int, facts: dict[str, object], figures: "dict[str, Figure]") -> list[str]:
    from ...controllers.roughness.figures import comparison_figure

    section = _section(pf)
    finer = round(section.roughness / FINER, 6)
    try:
        force = reference_force(pf, finer)
    except UsageError as error:
        return [f"A change along the run was not simulated: {error}"]
    schedule = [(CHANGE, finer)]
    cut, without = (turn(pf, control=control, schedule=schedule, seed=seed) for control in (True, False))
    before, after = steady(cut, end=CHANGE), steady(cut, CHANGE + 3)
    wait = section.threshold_time or 0.0
    sections = [("A", 0.0), ("B", wait), ("C", CHANGE), ("D", CHANGE + 1)]
    figures["roughness_run"] = comparison_figure(without, cut, sections)
    seconds = _settles(turn(pf, schedule=schedule, disturbance=0.0), force)
    facts |= {
        "changed_Ra_um": finer, "changed_F_ref_N": force, "changed_f_mm_per_rev": after.f,
        "changed_Ra_mean_um": after.Ra, "changed_settling_s": seconds,
    }  # fmt: skip
    return [
        f"Required roughness {finer:g} um from {CHANGE:g} s on (sections A to D of the figure), the control "
        "changes the feed from "
        f"{before.f:.3f} to {after.f:.3f} mm/rev; the force is within 2 % of {force:.0f} N after {seconds:.1f} s "
        f"(without disturbance), and Ra is {after.Ra:.3g} um on average."
    ]


def _settles(cut: TurningRun, force: float) -> float:
    """Seconds after the change from which the force stays within 2 %."""
    off = np.abs(cut.trace.measurement - force) > 0.02 * force
    return float(cut.trace.time[off].max()) - CHANGE


def _out_of_work(pf: "ParameterFile", facts: dict[str, object]) -> str:
    section = _section(pf)
    start, end = OUT
    cut = turn(pf, disturbance=0.0, engaged=lambda t: 0.0 if start <= t < end else 1.0)
    time, feed = cut.trace.time, cut.trace.recorded["feed"]
    air = (time >= start) & (time < end)
    highest, kept = float(feed[air].max()), float(feed[air][-1])
    peak = float(cut.trace.measurement[time >= end].max())
    facts |= {
        "feed_peak_leaving_mm_per_rev": highest, "feed_kept_in_air_mm_per_rev": kept, "force_peak_entering_N": peak,
    }  # fmt: skip
    return (
        f"As the tool leaves the work the law raises the feed, to {highest:.3f} mm/rev at the servo, until the force "
        f"is below {section.threshold:g} N; in air the control keeps the last feed, but at most the programmed one: "
        f"{kept:.3f} mm/rev. On re-entry the force peaks at {peak:.0f} N, {_percent(peak / section.force - 1)} of the "
        f"reference. After power-on the feed stays at its lower limit, {cut.low:.3g} mm/rev, until the force has been "
        "below the threshold and shows a tool in air."
    )


def _other_reading(pf: "ParameterFile", seed: int, facts: dict[str, object], figures: "dict[str, Figure]") -> str:
    from ...controllers.roughness.figures import readings_figure

    section = _section(pf)
    loop = loop_theory(section.process_time or 0.0, section.servo_time or 0.0, section.sample_time or 0.0)
    cut = turn(pf, feed="command", seed=seed)
    found = steady(cut)
    verdict = "not stable" if loop.command_radius > 1 else "stable"
    against = f"an integrator of gain {loop.gain:.0f}/s against a limit of {loop.limit:.3g}/s"
    figures["roughness_readings"] = readings_figure(turn(pf, seed=seed), cut, f"Last command: {against}, {verdict}")
    command = cut.trace.command[cut.trace.time >= 3]
    facts |= {
        "command_reading_gain_per_s": loop.gain, "command_reading_limit_per_s": loop.limit,
        "command_reading_peak_to_peak_mm_per_rev": found.command_ripple,
    }  # fmt: skip
    return (
        f"With the last command instead of the servo's feed the law is {against}, {verdict}: its command ranges "
        f"from {command.min():.3f} to {command.max():.3f} mm/rev."
    )


def _assumed(pf: "ParameterFile") -> tuple[str, ...]:
    section = _section(pf)
    chip = () if section.chip_thickness is None else (
        "Assumption: the chip is as thick as the feed, as at a cutting-edge angle of 90 degrees; it is never thicker.",
    )  # fmt: skip
    return (
        "Reconstruction: the cut is kc a / ((tc s + 1)(ts s + 1)), kc a "
        f"{section.force_per_feed:.0f} N per mm/rev, tc {section.process_time:.3g} s, ts {section.servo_time:.3g} s.",
        "Reconstruction: the feed law fc = f F_ref / F takes f from a model of the servo.",
        "Assumption: the force is disturbed uniformly by up to 10 %, constant over each revolution; it affects the "
        "surface.",
        f"Assumption: the roughness is that of the file's law at each force, {law_of(pf).equation}.",
        f"Assumption: the sections of the run change at {CHANGE:g} s.",
        *chip,
        *section.notes,
    )


def _inside(law: "LawSection", force: float) -> bool:
    given: dict[str, Any] = {law.factors[0].symbol: force}
    return bool(law.inside(**given))


def _percent(share: float) -> str:
    return f"{100 * share:+.1f} %"


def table_lines(
    section: "RoughnessSection", seed: int, facts: dict[str, object], figures: "dict[str, Figure]"
) -> list[str]:
    """Mean roughness with and without control, and the ripple of the feed; adds to ``facts`` and ``figures``."""
    from ...controllers.roughness.figures import table_figure
    from ...controllers.roughness.simulations import simulated_table

    found = simulated_table(section.force_from, feed=section.feed, seed=seed)
    white = simulated_table(section.force_from, feed=section.feed, seed=seed, hold=0.0)
    figures["roughness_table"] = table_figure(found, f"; reference force by {section.force_from}")
    facts["table"] = [_fact(run) for run in found]
    worst = max(found, key=lambda run: abs(run.error))
    mean, without = (float(np.mean([abs(e) for e in errors])) for errors in
                     ([run.error for run in found], [run.error_without for run in found]))  # fmt: skip
    rests = [f"{run.row.number} ({100 * run.controlled.at_high:.0f} % of the time)" for run in found
             if run.controlled.at_high > 0.05]  # fmt: skip
    limited = f" Simulations {' and '.join(rests)} are at the upper limit of the feed." if rests else ""
    ripple, of_white = (max(run.controlled.ripple for run in runs) for runs in (found, white))
    facts |= {"table_mean_error": mean, "table_mean_error_without": without, "table_ripple_mm_per_rev": ripple,
              "table_ripple_drawn_each_sample_mm_per_rev": of_white}  # fmt: skip
    return [
        f"The eight simulations of Table 1: mean Ra within {100 * abs(worst.error):.1f} % of each reference with "
        f"control, {100 * mean:.1f} % off on average, {100 * without:.1f} % at the table's constant feeds.{limited}",
        f"Largest ripple of the feed {ripple:.3f} mm/rev peak-to-peak with a disturbance constant over each "
        f"revolution, {of_white:.3f} drawn every 10 ms.",
    ]


def _fact(run: "TableSimulation") -> dict[str, float]:
    on, off = run.controlled, run.without
    return {
        "simulation": run.row.number, "Ra_ref_um": run.row.Ra_ref, "F_ref_N": run.force, "Ra_um": on.Ra, "F_N": on.F,
        "f_mm_per_rev": on.f, "f_peak_to_peak_mm_per_rev": on.ripple, "share_at_high": on.at_high,
        "Ra_without_um": off.Ra, "F_without_N": off.F,
    }  # fmt: skip
