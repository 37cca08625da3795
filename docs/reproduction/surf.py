"""Ledger of the constant-roughness paper (SURF)."""

import math
from collections.abc import Callable, Iterator

import numpy as np
from entry import Entry
from fitmodels import fit
from fitmodels.controllers.roughness.plant import TurningForce, loop_theory
from fitmodels.controllers.roughness.reference import reference_force
from fitmodels.controllers.roughness.simulations import SteadyCut, simulated_table, steady, turn
from fitmodels.parameters.published.roughness import (
    REVOLUTION,
    SAMPLE_TIME,
    SERVO_TIME,
    A,
    B,
    Reading,
    TableRow,
    surf,
    table1,
)

READINGS: tuple[Reading, ...] = ("regression", "inverse")
LAWS = {"regression": "the law of the controlled columns", "inverse": "eq. 5"}
PLANT = "plant reconstructed: kc a = F/f of this row without control, tc one revolution"


def entries() -> list[Entry]:
    """Every number of the paper, in its order."""
    return [*_settings(), *_equations(), *_text(), *_command_reading(), *_table(), *_elsewhere()]


def _settings() -> Iterator[Entry]:
    servo = TurningForce(gain=1.0, tc=0.0, ts=SERVO_TIME, disturbance=0.0)
    noise = np.random.default_rng(1)
    feeds = np.array([servo.step(1.0, 0.001, noise) for _ in range(1000)])
    late = int(np.argmax(feeds >= 1 - math.exp(-1))) + 1
    yield Entry(
        "Fig. 4 and text",
        "share of a step after one time constant",
        "0.632",
        1 - math.exp(-1),
        "",
        "reproduced",
        kind="identity",
    )
    yield Entry("Fig. 4 and text", "ts, time to 0.632 of a step", "0.13", late * 0.001, "s", "reproduced",
                "of the servo model, which has this ts; the measured step is not printed", "identity")  # fmt: skip
    pf = surf()
    high = turn(pf, duration=0.1).high
    yield Entry("section 3", "highest feed, 150 % of 0.2 mm/rev", "0.3", high, "mm/rev", "reproduced",
                kind="identity")  # fmt: skip
    low = turn(pf, duration=0.1).low
    yield Entry("section 3", "lowest feed, 0 % of 0.2 mm/rev", "0", low, "mm/rev", "reconstructed",
                "a floor of a tenth of 0.2: from 0 the feed law, which multiplies, cannot recover")  # fmt: skip


def _equations() -> Iterator[Entry]:
    rows = table1()
    x = np.column_stack([np.ones(len(rows)), [row.F_without for row in rows]])
    ln_a, b = fit.linear(x, np.log([row.Ra_ref for row in rows])).params
    why = (
        "least squares of ln Ra_ref on F without control, the eight rows of Table 1: the paper states 1500 experiments"
    )
    yield Entry("eq. 5", "constant of Ra = a exp(b F)", "0.2401", float(np.exp(ln_a)), "um", "reproduced", why)
    yield Entry("eq. 5", "exponent of Ra = a exp(b F)", "0.0034", float(b), "1/N", "reproduced", why)


def _text() -> Iterator[Entry]:
    found = {reading: _sections(reading) for reading in READINGS}
    places: tuple[tuple[str, str, str, Callable[[tuple[SteadyCut, SteadyCut]], float], str], ...] = (
        ("section 3, Fig. 5b", "force held at Ra 1.6 um", "570", lambda run: run[0].F, "N"),
        ("section 3, Fig. 5c", "force after the change to Ra 1.0 um", "448", lambda run: run[1].F, "N"),
        ("section 3, Fig. 5e", "mean Ra with control at 1.6 um", "1.59", lambda run: run[0].Ra, "um"),
        ("section 3", "feed that the control reaches at 1.6 um", "0.2", lambda run: run[0].f, "mm/rev"),
    )
    for place, what, printed, number, unit in places:
        for reading in READINGS:
            why = f"{reading} of Ra for F_ref, roughness by {LAWS[reading]}; {PLANT}; change at 7.5 s assumed"
            yield Entry(place, f"{what}, {reading}", printed, number(found[reading]), unit, "reconstructed", why)
    for Ra, printed in ((1.6, "582.12"), (1.0, "448.06")):
        for reading in READINGS:
            ours = reference_force(surf(), Ra, reading)
            yield Entry("eq. 4", f"reference force at Ra {Ra:g} um, {reading}", printed, ours, "N", "reconstructed",
                        "eq. 4 is missing in the copy used; printed: controlled force of Table 1")  # fmt: skip


def _sections(reading: Reading) -> tuple[SteadyCut, SteadyCut]:
    cut = turn(surf(force_from=reading), schedule=[(7.5, 1.0)])
    return steady(cut, end=7.5), steady(cut, 10.5)


def _command_reading() -> Iterator[Entry]:
    loop = loop_theory(REVOLUTION, SERVO_TIME, SAMPLE_TIME)
    servo, command = turn(surf()), turn(surf(), feed="command")
    what = "share of its range that the feed command swings over, %, f(t-1) read as"
    shares = [100 * steady(cut).command_ripple / (cut.high - cut.low) for cut in (servo, command)]
    yield Entry("feed law", f"{what} the servo's output", "stable", shares[0], "", "reconstructed",
                f"largest pole {loop.servo_radius:.3f}; what is left is the disturbance")  # fmt: skip
    yield Entry("feed law", f"{what} the last command", "stable", shares[1], "", "corrected with proof",
                f"largest pole {loop.command_radius:.3f}, an integrator of gain {loop.gain:.0f}/s against a limit of "
                f"{loop.limit:.1f}/s: 'previous actual feed rate command' must be the servo's output")  # fmt: skip


def _table() -> Iterator[Entry]:
    found = {reading: simulated_table(reading) for reading in READINGS}
    for number, row in enumerate(table1()):
        place = f"Table 1, simulation {row.number}"
        yield Entry(place, "desired Ra", f"{row.Ra_ref}", None, "um", "not computable", "an input")
        yield Entry(place, "f without control", f"{row.f_without}", None, "mm/rev", "not computable",
                    "an input: recommended by a prediction model that the paper does not print")  # fmt: skip
        yield Entry(place, "F without control", f"{row.F_without}", found["inverse"][number].without.F, "N",
                    "reconstructed", f"mean of 12 s; {PLANT}, so only the disturbance is left", "identity")  # fmt: skip
        for reading in READINGS:
            yield from _controlled(place, row, reading, found[reading][number].controlled)
        yield _by_equation_5(place, row)


def _controlled(place: str, row: TableRow, reading: Reading, run: SteadyCut) -> Iterator[Entry]:
    rests = f"; {100 * run.at_high:.0f} % of the time at 150 % of 0.2 mm/rev" if run.at_high else ""
    why = f"{reading} for F_ref, roughness by {LAWS[reading]}; {PLANT}{rests}"
    ratio = (
        f"; printed F/f is {row.F / row.f:.0f} N per mm/rev with control, {row.F_without / row.f_without:.0f} without"
    )
    yield Entry(place, f"F with control, {reading}", f"{row.F}", run.F, "N", "reconstructed", why)
    yield Entry(place, f"f with control, {reading}", f"{row.f}", run.f, "mm/rev", "reconstructed", why + ratio)
    yield Entry(place, f"Ra with control, {reading}", f"{row.Ra}", run.Ra, "um", "reconstructed", why)


def _by_equation_5(place: str, row: TableRow) -> Entry:
    ours = A * math.exp(B * row.F)
    what = "Ra with control, eq. 5 at the printed F"
    if round(ours, 2) == row.Ra:
        return Entry(place, what, f"{row.Ra}", ours, "um", "reproduced")
    why = "the paper states that Ra was calculated by eq. 5; the printed F and Ra of one row do not satisfy it"
    return Entry(place, what, f"{row.Ra}", ours, "um", "corrected with proof", why)


def _elsewhere() -> Iterator[Entry]:
    trace = turn(surf(), control=False).trace
    part = trace.time >= 3.0
    factor = trace.measurement[part] / (surf().roughness.force_per_feed * 0.2)  # type: ignore[union-attr, operator]
    yield Entry("section 3", "largest random change of the force", "10", 100 * float(np.abs(factor - 1).max()), "%",
                "reconstructed", "uniform, drawn anew each revolution: the paper prints neither",
                "identity")  # fmt: skip
    for place, what, printed, unit, why in (
        ("section 2", "experiments behind eq. 4 and 5", "1500", "", "they are not printed"),
        (
            "section 2",
            "how much closer a neural network comes",
            "2",
            "%",
            "neither network nor measurements are printed",
        ),
        ("section 3", "spindle speed", "610", "1/min", "a setting"),
        ("section 3", "simulated time", "15", "s", "a setting"),
        ("section 3", "depth of cut of simulation 3", "1", "mm", "a setting; kc alone is not printed"),
        ("section 3", "threshold of the control", "100", "N", "a setting; its time is not printed, 0.3 s assumed"),
        ("section 1", "time between force samples", "10", "ms", "a setting"),
    ):
        yield Entry(place, what, printed, None, unit, "not computable", why)
