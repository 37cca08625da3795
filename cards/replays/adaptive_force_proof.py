"""What the proof of adaptive force control says of a run: V, the estimates, and the step at which it stops to hold."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ...controllers.adaptive_force import ForceRun, StepSize

ROUNDING = 1e-12  # of V


def percent(share: float) -> str:
    """A share to two digits."""
    return f"{100 * share:.2g} %"


def of_proof(run: "ForceRun", rippled: "ForceRun") -> str:
    """Whether V falls where it must, and what ripple and noise do to it."""
    found, shaken = run.energy(), rippled.energy()
    share = shaken.largest / float(shaken.V[list(shaken.starts)].max(initial=1e-300))
    rise = "does not rise" if found.rise < ROUNDING else f"rises by up to {percent(found.rise)}"
    return (
        f"Without ripple and noise the energy V of the proof {rise} in the {percent(float(found.free.mean()))} of the "
        "run in which neither depth nor a limit has changed for a revolution. With them it does, by up to "
        f"{percent(share)} of what the largest step of depth put into it."
    )


def of_estimates(run: "ForceRun") -> str:
    """Between which values the estimates stay."""
    recorded = run.trace.recorded
    told = [
        f"{name} {recorded[name].min():.3g} to {recorded[name].max():.3g}" for name in ("m", "alpha", "beta")
    ]  # fmt: skip
    return (
        f"The estimates (over k) stay bounded: {', '.join(told)}. A constant set point teaches beta alone; m and alpha "
        "move only while F_d does, so they are no measurement of the machine."
    )


def of_steps(rows: "Sequence[StepSize]") -> list[str]:
    """Up to which step V does not rise, as built and as printed, at the gain of the file and at a larger one."""
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
            f"With {swinging[0].times:g} times the gain Kd the law as built never settles: the average over a "
            "revolution comes too late for it, and the feed swings between its limits."
        )
    if lost := _lost(stiff):
        lines.append(f"With {stiff[0].times:g} times the gain Kd the printed law settles at short steps{lost}.")
    return lines


def _lost(rows: "Sequence[StepSize]") -> str:
    steps = [r.step for r in rows if r.diverged]
    return f", and the force runs away from {1e3 * min(steps):g} ms on" if steps else ""
