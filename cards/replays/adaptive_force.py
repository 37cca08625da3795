"""Report on adaptive force control (LYAP): depths, steps of depth, Lyapunov function, step size, and a fixed PI."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from . import Replayed

if TYPE_CHECKING:
    from ...controllers.adaptive_force.runs import By, ForceRun
    from ...controllers.adaptive_force.signals import RegulationMetrics
    from ...controllers.adaptive_force.stability import StepSize
    from ...parameters import ParameterFile
    from ...parameters.draws import Draws
    from ...parameters.sections.force_control import AdaptiveForceSection

TITLE = "Adaptive force control in end milling (LYAP, eq. 2.1-10), compared with a fixed PI"
RIPPLE, NOISE = 0.3, 2.0  # share of the force, and N


def lacks(pf: "ParameterFile") -> str:
    """Reason why a file cannot drive the system, with the remedy; empty where it can.

    Examples
    --------
    >>> from fitmodels import parameters
    >>> lacks(parameters.collect(tool="GC435", work="709M40"))[:45]
    'the file has no adaptive_force section: give '
    """
    from ...controllers.adaptive_force.settings import lacking, machine, settings_for
    from ...core.errors import GateError

    why = lacking(pf)
    if why or pf.adaptive_force is None:
        return why
    try:
        machine(pf)
        settings_for(pf, pf.adaptive_force.set_points[0].depth)
    except GateError as error:
        return str(error)
    return ""


def replayed(pf: "ParameterFile", draws: "Mapping[str, Draws]", seed: int) -> Replayed:
    """Report on each depth of the file and on steps of depth, with ripple and noise; V without them.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> replayed(published("LYAP"), {}, 1).lines[0][:46]
    'Simulated with 30 % tooth ripple and 2 N of no'
    """
    from ...controllers.adaptive_force import figures as draw
    from ...controllers.adaptive_force.runs import depth_step_run, steady_run
    from ...controllers.adaptive_force.stability import step_study

    section = pf.adaptive_force
    assert section is not None  # noqa: S101 - lacks(pf) is asked first
    depths = [point.depth for point in section.set_points]
    plan, noise = _plan(depths), noise_in(section)

    def at_depths(by: "By") -> "list[ForceRun]":
        return [steady_run(pf, depth, by, ripple=RIPPLE, noise=noise, seed=seed) for depth in depths]

    def in_steps(by: "By") -> "ForceRun":
        return depth_step_run(pf, by, depths=plan, ripple=RIPPLE, noise=noise, seed=seed)

    single, stepped = at_depths("adaptive"), in_steps("adaptive")
    pi_runs, pi_stepped = ([], None) if pf.pi is None else (at_depths("pi"), in_steps("pi"))
    proof, rows = depth_step_run(pf, depths=plan), step_study(pf)
    lines = [
        _at_depths(single, section), _at_steps(stepped, section),
        *([_comparison(single, stepped, pi_runs, pi_stepped, section)] if pi_stepped else []),
        of_proof(proof, stepped), of_estimates(stepped), *of_steps(rows),
    ]  # fmt: skip
    figures = {
        "adaptive_force_depths": draw.depths_figure(single, pi_runs, section.unit_depth),
        "adaptive_force_steps": draw.steps_figure(stepped, pi_stepped, section.unit_depth),
        "adaptive_force_energy": draw.lyapunov_figure(proof),
        "adaptive_force_step_size": draw.step_size_figure(rows),
    }
    facts = _facts(section, single, stepped, pi_runs, pi_stepped, proof, rows)
    return Replayed("adaptive-force", TITLE, tuple(lines), _assumed(pf, section, draws), facts, figures)


def noise_in(section: "AdaptiveForceSection") -> float:
    """The assumed noise of the reading in the unit of the force."""
    from ...datasets.units import convert, is_unit, same_dimension

    unit = section.unit_force
    if not (is_unit(unit) and same_dimension(unit, "N")):
        return NOISE
    return float(convert(np.array(NOISE), "N", unit))


def _plan(depths: Sequence[float]) -> tuple[float, ...]:
    """From the middle depth to the shallowest, back, to the deepest, and back; of two, there and back."""
    if len(depths) < 3:
        other = depths[1] if len(depths) == 2 else 0.5 * depths[0]
        return (depths[0], other, depths[0])
    middle = depths[len(depths) // 2]
    return (middle, depths[0], middle, depths[-1], middle)


def _s(value: float | None) -> str:
    return "never" if value is None else f"{value:.2g} s"


def _at_depths(runs: "Sequence[ForceRun]", section: "AdaptiveForceSection") -> str:
    parts = [
        f"{run.settings.set_point:g} {section.unit_force} at {run.settings.depth:g} {section.unit_depth}: settled "
        f"after {_s(held.settling)}, then within {percent(held.steady)}, at {_late(run):.3g} {section.unit_u}"
        for run, held in ((run, run.segments()[0]) for run in runs)
    ]
    return (
        f"Simulated with {100 * RIPPLE:g} % tooth ripple and {noise_in(section):g} {section.unit_force} of noise, "
        f"force averaged over a revolution: {'; '.join(parts)}."
    )


def _late(run: "ForceRun") -> float:
    command = run.trace.command
    return float(command[-len(command) // 4 :].mean())


def _stepped(run: "ForceRun") -> list[tuple[float, float, "RegulationMetrics"]]:
    """Depth before, depth after, and how the force is held after, for each step."""
    held, depths = run.segments(), [depth for _, depth in run.depths]
    return [(before, after, one) for before, after, one in zip(depths, depths[1:], held[1:], strict=False)]


def _at_steps(run: "ForceRun", section: "AdaptiveForceSection") -> str:
    parts = [
        f"{before:g} to {after:g} {section.unit_depth}: {percent(max(one.overshoot, one.undershoot))} "
        f"{'above' if one.overshoot > one.undershoot else 'below'}, settled after {_s(one.settling)}"
        for before, after, one in _stepped(run)
    ]
    return f"Steps of depth at a set point of {run.settings.set_point:g} {section.unit_force}: {'; '.join(parts)}."


def _comparison(
    single: "Sequence[ForceRun]", stepped: "ForceRun", pi_runs: "Sequence[ForceRun]", pi_stepped: "ForceRun",
    section: "AdaptiveForceSection",
) -> str:  # fmt: skip
    ours, theirs = ([one for _, _, one in _stepped(run)] for run in (stepped, pi_stepped))
    first = " and ".join(_s(run.segments()[0].settling) for run in (single[0], pi_runs[0]))
    swing = [float(run.trace.command[-len(run.trace.command) // 4 :].std()) for run in (single[-1], pi_runs[-1])]
    return (
        f"The fixed PI of the file on the same plant: after a step of depth the force deviates by up to "
        f"{percent(_worst(theirs))} (adaptive law {percent(_worst(ours))}) and settled after {_s(_slowest(theirs))} at "
        f"most (law {_s(_slowest(ours))}); at {single[0].settings.depth:g} {section.unit_depth} law and PI settle "
        f"after {first}; the feed command has a standard deviation of {swing[1]:.2g} {section.unit_u}, and of "
        f"{swing[0]:.2g} with the law, which also feeds back the rate of the force."
    )


def _worst(held: "Sequence[RegulationMetrics]") -> float:
    return max(max(one.overshoot, one.undershoot) for one in held)


def _slowest(held: "Sequence[RegulationMetrics]") -> float | None:
    times = [one.settling for one in held]
    return None if None in times else max(time for time in times if time is not None)


def _facts(
    section: "AdaptiveForceSection", single: "Sequence[ForceRun]", stepped: "ForceRun", pi_runs: "Sequence[ForceRun]",
    pi_stepped: "ForceRun | None", proof: "ForceRun", rows: "Sequence[StepSize]",
) -> dict[str, object]:  # fmt: skip
    def at_depths(runs: "Sequence[ForceRun]") -> list[dict[str, object]]:
        return [
            {"depth": r.settings.depth, "set_point": r.settings.set_point, "feed": _late(r),
             "settling_s": r.segments()[0].settling, "overshoot_share": r.segments()[0].overshoot,
             "steady_error_share": r.segments()[0].steady} for r in runs
        ]  # fmt: skip

    def at_steps(run: "ForceRun") -> list[dict[str, object]]:
        return [{"from": before, "to": after, **_held(one)} for before, after, one in _stepped(run)]

    energy = proof.energy()
    return {
        "simulated": True,
        "units": {name: getattr(section, f"unit_{name}") for name in ("u", "force", "depth")},
        "depths": at_depths(single),
        "steps": at_steps(stepped),
        "pi_depths": at_depths(pi_runs),
        "pi_steps": [] if pi_stepped is None else at_steps(pi_stepped),
        "largest_rise_of_V_share": energy.rise,
        "free_share": float(energy.free.mean()),
        "events": [[event.time, event.what] for event in stepped.trace.events[:100]],
        "step_sizes": [
            {"way": r.way, "times_Kd": r.times, "step_s": r.step, "rise_share": _finite(r.rise),
             "error_share": _finite(r.error), "diverged": r.diverged, "settled": r.settled} for r in rows
        ],
    }  # fmt: skip


def _held(one: "RegulationMetrics") -> dict[str, object]:
    return {
        "settling_s": one.settling, "overshoot_share": one.overshoot, "undershoot_share": one.undershoot,
        "steady_error_share": one.steady,
    }  # fmt: skip


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def _assumed(pf: "ParameterFile", section: "AdaptiveForceSection", draws: "Mapping[str, Draws]") -> tuple[str, ...]:
    from ...controllers.adaptive_force.settings import tooth_frequency
    from ...parameters.sections.base import ModelCovariance

    assumed = [
        "Reconstruction: reference model, average over a revolution, limits, trapezoidal steps and the treatment "
        "of lost "
        "readings; the paper prints only the continuous law.",
        f"The plant is that of the file's estimates at {section.depth:g} {section.unit_depth}, with the drive as the "
        "slower pole, d = 1, and k in proportion to the depth.",
        f"Ripple ({100 * RIPPLE:g} % at {tooth_frequency(pf):g} Hz, two flutes) and noise ({noise_in(section):g} "
        f"{section.unit_force}) are assumed, "
        "and affect only the reading.",
        *(
            f"{name} {getattr(section, name):g}, {words.partition(': ')[2]}"
            for name, words in section.sources.items()
            if words.startswith("assumed: ") and getattr(section, name, None) is not None
        ),
        *(note for note in section.notes if "ssum" in note or "simulated" in note or "printed" in note),
    ]
    if isinstance(section.uncertainty, ModelCovariance):
        se = np.sqrt(np.diag(np.array(section.uncertainty.matrix)))
        shares = se / np.array([section.m, section.alpha, section.beta])
        assumed.append(
            f"No bands: the estimates' standard errors, {percent(shares.min())} to {percent(shares.max())}, are far "
            "below the change of depth to which the law adapts."
        )
    if pf.pi is None:
        assumed.append("The file has no PI gains for comparison: tune them with `fitmodels tune`.")
    if draws:
        assumed.append("Draws of wear, power or force laws are not used in this system.")
    return tuple(assumed)


ROUNDING = 1e-12  # of V


def percent(share: float) -> str:
    """A share to two digits."""
    value = 100 * share
    return f"{value:.2g} %" if value < 99.5 else f"{value:.0f} %"


def of_proof(run: "ForceRun", rippled: "ForceRun") -> str:
    """Increase of the Lyapunov function V without and with ripple and noise."""
    found, shaken = run.energy(), rippled.energy()
    share = shaken.largest / float(shaken.V[list(shaken.starts)].max(initial=1e-300))
    rise = "does not rise" if found.rise < ROUNDING else f"rises by up to {percent(found.rise)}"
    return (
        f"Without ripple and noise the Lyapunov function V {rise} in the {percent(float(found.free.mean()))} of the "
        "run in which neither depth nor an active limit has changed for a revolution. With them it rises by up to "
        f"{percent(share)} of its largest value after a step of depth."
    )


def of_estimates(run: "ForceRun") -> str:
    """Ranges of the estimates."""
    recorded = run.trace.recorded
    parts = [
        f"{name} {recorded[name].min():.3g} to {recorded[name].max():.3g}" for name in ("m", "alpha", "beta")
    ]  # fmt: skip
    return (
        f"The estimates (over k) stay bounded: {', '.join(parts)}. A constant set point excites only beta; m and alpha "
        "change only while F_d does, so they do not identify the machine."
    )


def of_steps(rows: "Sequence[StepSize]") -> list[str]:
    """Largest step at which V does not rise, as built and as printed, at the gain of the file and at a larger one."""
    built, printed, stiff = ([r for r in rows if (r.way, r.times == 1) == way] for way in (
        ("as built", True), ("as printed", True), ("as printed", False)))  # fmt: skip
    calm = [r.step for r in built if r.rise < ROUNDING and r.settled]
    risen = [r for r in printed if not r.diverged]
    lines = []
    if calm:
        lines.append(
            f"Step of the law, deepest cut: as built V does not rise at any step tried up to {1e3 * max(calm):g} ms."
        )
    if risen:
        ends = " and ".join(f"{percent(r.rise)} at {1e3 * r.step:g} ms" for r in (risen[-1], risen[0]))
        lines.append(
            f"As printed, one Euler step at a time, V rises at every step: by {ends}{_lost(printed)}."
        )  # fmt: skip
    swinging = [r for r in rows if r.way == "as built" and r.times != 1]
    if swinging and not any(r.settled for r in swinging):
        lines.append(
            f"With {swinging[0].times:g} times the gain Kd the law as built does not settle: the average over a "
            "revolution adds too much delay, and the feed oscillates between its limits."
        )
    if lost := _lost(stiff):
        lines.append(f"With {stiff[0].times:g} times the gain Kd the printed law settles at short steps{lost}.")
    return lines


def _lost(rows: "Sequence[StepSize]") -> str:
    steps = [r.step for r in rows if r.diverged]
    return f", and the force diverges from {1e3 * min(steps):g} ms on" if steps else ""
