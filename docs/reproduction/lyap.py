"""Ledger of LYAP: adaptive cutting force control in end milling by Lyapunov's method."""

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np
from entry import Entry
from fitmodels.controllers.adaptive_force import stability
from fitmodels.controllers.adaptive_force.runs import depth_step_run, steady_run
from fitmodels.parameters.published import published

if TYPE_CHECKING:
    from fitmodels.controllers.adaptive_force.runs import ForceRun
    from fitmodels.controllers.adaptive_force.stability import StepSize
    from fitmodels.parameters import ParameterFile
    from fitmodels.parameters.sections.force_control import AdaptiveForceSection

RADIUS = 0.005  # m, of the 10 mm tool
TEETH = 2  # assumed: not in the paper
FIGURES = {1.0: "7", 2.0: "8", 4.0: "9"}
LATE = 0.25  # the last share of a run


def entries() -> list[Entry]:
    """Every number of the paper, and what its equations need to be right."""
    pf = published("LYAP")
    section = pf.adaptive_force
    assert section is not None  # noqa: S101 - the published file has it
    runs = {point.depth: steady_run(pf, point.depth, ripple=0.3) for point in section.set_points}
    stepped = depth_step_run(pf)
    return [
        *_set_points(section, runs),
        *_speed(section),
        *_equations(runs[4.0], stepped),
        *_not_printed(section),
        *_step_sizes(pf),
        *_not_computable(),
    ]


def _set_points(section: "AdaptiveForceSection", runs: "Mapping[float, ForceRun]") -> Iterator[Entry]:
    for point in section.set_points:
        run, figure = runs[point.depth], FIGURES[point.depth]
        held = float(run.force[-round(LATE * len(run.force)) :].mean())
        place = f"Section 4, Fig. {figure}"
        omega = 2 * np.pi / (section.average_time or np.nan)
        yield Entry(
            place, f"target cutting force at {point.depth:g} mm", f"{point.force:g}", point.force, "N (printed Nm)",
            "corrected with proof",
            "F is the force of (2.2), measured by a dynamometer. As a torque on the 10 mm tool it would be "
            f"{point.force / RADIUS / 1000:.0f} kN at the edge and {point.force * omega / 1000:.0f} kW at the spindle.",
            "identity",
        )  # fmt: skip
        yield Entry(
            place, f"force held at {point.depth:g} mm, mean of the last quarter with 30 % ripple", f"{point.force:g}",
            held, "N", "reconstructed",
            f"Simulated on the assumed plant: within {100 * run.segments()[0].steady:.2g} % of the set point, settled "
            f"after {run.segments()[0].settling:.2g} s.",
        )  # fmt: skip


def _speed(section: "AdaptiveForceSection") -> Iterator[Entry]:
    turns = 1 / (section.average_time or np.nan)
    yield Entry("Section 4", "spindle speed", "3000", 60 * turns, "1/min", "reproduced", "the file averages over 20 ms",
                "identity")  # fmt: skip
    yield Entry(
        "Section 4", "revolution and tooth frequency that follow", "not printed", TEETH * turns, "Hz", "reconstructed",
        f"{turns:g} Hz a revolution; {TEETH} flutes are assumed, the paper gives no number.",
    )  # fmt: skip


def _equations(run: "ForceRun", stepped: "ForceRun") -> Iterator[Entry]:
    yield Entry(
        "eq. 2.3, 4", "largest residual of (2.3), of (2.1) and (2.2) simulated, as a share of k f_r", "0",
        _residual(run), "", "reproduced", "The coefficients m, mc + d and dc are right.",
    )  # fmt: skip
    yield Entry(
        "eq. 5", "beta^ k / beta at the end, at 4 mm", "no k", _beta(run) * run.plant.k, "", "corrected with proof",
        "(5) gives f_r and (6) substitutes it for k f_r, so k is omitted: the estimate ends at beta / k, and beta^ "
        "/ beta "
        f"is {_beta(run):.4g}.",
    )  # fmt: skip
    yield Entry(
        "eq. 9", "largest rise of V between steps of depth, with the P that it needs", "no P", stepped.energy().rise,
        "", "reconstructed",
        "The paper requires a symmetric positive definite P and prints none. V falls only with P = [[beta + Kd lambda "
        "+ lambda (alpha + Kd), lambda m], [lambda m, m]] and alpha + Kd > lambda m, which gives "
        "V' = -2 (alpha + Kd - lambda m) F~'^2 - 2 lambda (beta + Kd lambda) F~^2. "
        f"Without lambda m off the diagonal V rises by up to {_rise(stepped, (1.0, 0.0, 1.0)):.2g} of itself in the "
        f"same run; with ten times the first entry by {_rise(stepped, (10.0, 1.0, 1.0)):.2g}.",
    )  # fmt: skip
    yield Entry(
        "Section 3, adaptation law", "largest rise of V where alpha^ and beta^ are adapted", "d~, c~",
        stepped.energy().rise, "", "corrected with proof",
        "(5) holds estimates of alpha = mc + d and beta = dc, and phi~ in (7) their errors; with alpha^' = -g2 E "
        "F_d' and beta^' = -g3 E F_d the terms of V' in phi~ cancel. The printed law moves d^ and c^, which (5) lacks.",
    )  # fmt: skip
    yield Entry(
        "eq. 5", "F_d'' of a step of the set point", "not printed", None, "", "not computable",
        "A step has no F_d'. F_d is filtered by a second-order model of 0.15 s: reconstructed. A constant F_d then "
        "excites "
        "beta only.",
    )  # fmt: skip


def _residual(run: "ForceRun") -> float:
    """(2.3) along a run, with F' and F'' by (2.1) and (2.2) from the recorded states."""
    r, plant = run.trace.recorded, run.plant
    F, v, u = r["force"][:-1], r["speed"][:-1], run.trace.command[:-1]
    acceleration = (u - plant.d * v) / plant.m
    rate = plant.k * v - plant.c * F
    second = plant.k * acceleration - plant.c * rate
    left = plant.m * second + (plant.m * plant.c + plant.d) * rate + plant.d * plant.c * F
    return float(np.abs(left - plant.k * u).max() / (plant.k * u).max())


def _beta(run: "ForceRun") -> float:
    return float(run.trace.recorded["beta"][-1] / (run.plant.d * run.plant.c))


def _rise(run: "ForceRun", times: tuple[float, float, float]) -> float:
    """The largest rise of V with another P: its entries (1,1), (1,2) and (2,2) times these."""
    found, r, plant, s = run.energy(), run.trace.recorded, run.plant, run.settings
    e = np.column_stack([r["error"], r["error_rate"]])
    k = r["k"]
    P = stability.P(plant.m / k, (plant.m * plant.c + plant.d) / k, plant.d * plant.c / k, Kd=s.Kd, lam=s.lam)
    changed = P * np.array([[times[0], times[1]], [times[1], times[2]]])
    V = found.V + np.einsum("ni,nij,nj->n", e, changed - P, e)
    return stability.rise_of(V, found.free)[0]


def _not_printed(section: "AdaptiveForceSection") -> Iterator[Entry]:
    why = (
        "No value is printed. Identified by ident.force_process_fit from a simulated run of an assumed plant (drive "
        "0.08 s, process 0.02 s, 0.4 N per mm/min and mm), seed 1; at 2 mm."
    )
    for name, value, unit in (
        ("m/k", section.m, "s2 mm/min/N"),
        ("(mc + d)/k", section.alpha, "s mm/min/N"),
        ("dc/k", section.beta, "mm/min/N"),
    ):
        yield Entry("eq. 2.1-4", name, "not printed", value, unit, "reconstructed", why)
    for name, value, unit in (
        ("Kd", section.Kd, "s mm/min/N"),
        ("lambda", section.lam, "1/s"),
        ("gamma 3", section.g3, "mm/min/N3"),
    ):
        yield Entry("eq. 5-10", name, "not printed", value, unit, "reconstructed", "No value is printed; assumed.")


def _step_sizes(pf: "ParameterFile") -> Iterator[Entry]:
    rows = stability.step_study(pf)
    built = [r for r in rows if (r.way, r.times) == ("as built", 1.0) and r.rise < 1e-12 and r.settled]
    printed = [r for r in rows if (r.way, r.times) == ("as printed", 1.0)]
    stiff = [r for r in rows if r.way == "as printed" and r.times != 1]
    at = {round(1e3 * r.step, 3): r for r in printed}
    yield Entry(
        "eq. 5-10", "longest step tried at which V does not rise, as built", "not printed",
        1e3 * max(r.step for r in built), "ms", "reconstructed",
        "The law is continuous. Averaged over a revolution, by the trapezoidal rule, at 4 mm; a revolution is most.",
    )  # fmt: skip
    yield Entry(
        "eq. 5-10", "largest rise of V at 1 ms, one Euler step at a time", "not printed", at[1.0].rise, "share of V",
        "reconstructed",
        f"At no step tried is it none: {at[min(at)].rise:.2g} at {min(at):g} ms, {at[10.0].rise:.2g} at 10 ms; the "
        f"force diverges from {_lost(printed):g} ms on, with {stiff[0].times:g} times Kd from {_lost(stiff):g} ms on.",
    )  # fmt: skip


def _lost(rows: "list[StepSize]") -> float:
    return 1e3 * min((row.step for row in rows if row.diverged), default=np.nan)


def _not_computable() -> Iterator[Entry]:
    for figure in FIGURES.values():
        yield Entry(
            f"Fig. {figure}", "force and force error over time", "a figure", None, "N", "not computable",
            "The figure carries no numbers in the text: neither settling, overshoot, error nor feed is printed.",
        )  # fmt: skip
    yield Entry(
        "Section 5",
        "tool life increased, force smooth",
        "in words",
        None,
        "",
        "not computable",
        "No number is printed.",
    )
    yield Entry(
        "eq. 2.2", "c by cutting depth and spindle speed", "in words", None, "1/s", "not computable",
        "No relation is printed; here k goes with the depth and c is one over a revolution: assumed.",
    )  # fmt: skip
