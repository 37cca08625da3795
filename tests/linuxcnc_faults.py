"""Faults injected into the whole LinuxCNC, the outcome of each, and the runs that inject them."""

import math
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from fitmodels.controllers.constant_load_milling.control_laws import loop_of
from fitmodels.controllers.constant_load_milling.cut_model import CutModel
from fitmodels.controllers.exports import rendered
from fitmodels.parameters import ParameterFile
from fitmodels.parameters.exports.loop import LoadLoop
from fitmodels.parameters.published import published
from linuxcnc_machine import PERIOD, Cut, Event, Run, compiled, run_machine

AT = 1.5  # s after the first contact: when a fault begins
NOISE = 0.001  # A, half width of the reading's noise


@dataclass(frozen=True)
class Scenario:
    """A run and its outcome.

    Attributes
    ----------
    outcome : str
        ``fault``: lower limit, latched; ``stop``: feed inhibited; ``again``: the same after a reset; ``control``:
        nothing; ``hold``: the last feed at most; ``early``: the load of a worn tool at most, then control; ``worn``:
        pin worn, lower limit; ``air``: the last feed until motion is idle, then the lower limit; ``pause``: the feed
        is kept while the path stops; ``passes``: each entry within the load of a worn tool; ``bounded``: the real
        feed inside the limits, which HAL, with the override alone, cannot do.
    within : float
        s from the fault to its detection.
    changes : dict
        Settings of the engagement that differ.
    """

    name: str
    outcome: str
    events: tuple[Event, ...] = ()
    within: float = math.inf
    duration: float = 3.2
    wear: float = 150.0
    wear_rate: float = 0.0
    feed_share: float = 1.0
    override: float = 1.0
    length: float = 1000.0
    end: float = 1e9
    passes: int = 1
    dwell: float = 1.1
    adaptive: bool = True
    operator: tuple[tuple[float, str], ...] = ()
    changes: dict[str, object] = field(default_factory=dict)


def _reading(
    name: str, value: float, outcome: str = "fault", within: float = 0.052, until: float = 1e6, duration: float = 3.2
) -> Scenario:
    return Scenario(name, outcome, (Event("value", AT, until, value),), within, duration)


SCENARIOS = (
    Scenario("no fault", "control"),
    _reading("NaN", math.nan),
    _reading("infinite", math.inf),
    _reading("zero", 0.0),
    _reading("negative", -0.3),
    _reading("out of range", 99.0),
    _reading("spike, 40 ms", 99.0, "control", until=AT + 0.04),
    _reading("loss to idle", 0.11584, "hold", math.inf),
    Scenario("zero, wear 224 um", "fault", (Event("value", AT, value=0.0),), 0.052, wear=224.0),
    Scenario("stuck", "fault", (Event("hold", AT),), 1.002, 4.0),
    _reading("stuck below the reference", 0.2, within=1.004, duration=4.5),
    Scenario(
        "NaN, loop of 20 ms in its own thread", "fault", (Event("value", AT, value=math.nan),), 0.062,
        changes={"sample_time": 0.02},
    ),
    Scenario("dead source", "fault", (Event("dead", AT),), 0.222),
    Scenario("spindle-on lost", "hold", (Event("spindle", AT),)),
    Scenario("enable lost", "hold", (Event("enable", AT),)),
    Scenario(
        "lost in mid-cut, healed; reset during and after", "fault",
        (Event("value", AT, AT + 0.6, 0.0), Event("reset", AT + 0.4, AT + 0.5), Event("reset", AT + 1.2, AT + 1.3)),
        0.052,
    ),
    Scenario("NaN, stop chosen", "stop", (Event("value", AT, value=math.nan),), 0.052, changes={"on_fault": "stop"}),
    Scenario("overload: load 1.4 times", "stop", (Event("load", AT, value=1.4),), 0.8),
    Scenario(
        "overload that remains, reset at a stop", "again",
        (Event("load", AT, value=1.4), Event("reset", AT + 1.2, AT + 1.3)), 0.8, 5.0,
    ),
    Scenario("wear until the change", "worn", wear=192.0, wear_rate=8.0, duration=6.3),
    Scenario("end of the cut, then the end of the program", "air", end=25.0, length=45.0, duration=7.5),
    Scenario("three passes, wear 190 um", "passes", wear=190.0, end=20.0, length=25.0, passes=3, duration=9.0),
    Scenario("load pin never connected: 0 from the start", "fault", (Event("value", -1.0, value=0.0),), 0.0),
    Scenario("heartbeat never connected", "fault", (Event("beat", -1.0),), 0.0),
    Scenario("contact before the spindle has run for arm_after", "early", wear=190.0, changes={"arm_after": 3.0}),
    Scenario(
        "M52 P1 missing in the program, load 1.2 times", "stop", (Event("load", AT, value=1.2),), 1.0, adaptive=False
    ),
    Scenario(
        "operator's pause in the cut", "pause", wear=190.0, operator=((AT, "pause"), (AT + 1.0, "resume")), duration=4.5
    ),
    Scenario(
        "operator's override 100, 150, 50, 100 % in the cut", "bounded", (Event("load", 0.0, value=0.85),), wear=0.0,
        operator=((AT, "1.5"), (AT + 1.0, "0.5"), (AT + 1.5, "1.0")), duration=4.5,
    ),
    Scenario("F twice that of the file", "bounded", feed_share=2.0),
    Scenario(
        "operator's override 120 %, load 0.85 times", "bounded", (Event("load", 0.0, value=0.85),),
        override=1.2, wear=0.0, duration=4.5,
    ),
)  # fmt: skip


def machine_file(**engagement: object) -> ParameterFile:
    """The published file of constant load with gains in the position form, for a servo thread of `PERIOD`."""
    content = published("CLM-2023").model_dump(mode="json", exclude_none=True)
    content.pop("content_sha256", None)
    content["pi"] = {
        "kp": 300.0, "ki": 8000.0, "sample_time": 0.02, "filter_time": 0.08, "unit_u": "mm/min", "unit_y": "A",
        "scaling_u": 1459.129,
    }  # fmt: skip
    line = content["load_line"]
    line["dwell"] = 1.5
    line["engagement"] = {"feed_programmed": 1000.0, "load_high": 1.0, "sample_time": PERIOD, **engagement}
    return ParameterFile.model_validate(content)


def run_of(scenario: Scenario, pf: ParameterFile, export: str, **modules: Path) -> Run:
    """The run of a scenario with the plant that the file implies."""
    cut, period = CutModel.from_parameters(pf), loop_of(pf).sample_time
    plant = Cut(
        cut.A, cut.B, cut.k1, cut.b, cut.a, divide=round(cut.sample_time / period), wear=scenario.wear,
        wear_rate=scenario.wear_rate, noise=NOISE, end=scenario.end,
    )  # fmt: skip
    programmed = pf.load_line.engagement.feed_programmed
    return Run(
        export, plant, programmed * scenario.feed_share, scenario.events, scenario.duration, scenario.override,
        scenario.length, scenario.passes, scenario.dwell, scenario.adaptive, period,
        scenario.operator, modules,
    )  # fmt: skip


def run_all(runs: Sequence[Run], plant: Path, at_once: int = 2) -> list[dict[str, np.ndarray]]:
    """Traces of runs, in their order."""
    with ThreadPoolExecutor(at_once) as pool:
        return list(pool.map(lambda run: run_machine(run, plant), runs))


def loops_and_runs(scenarios: Sequence[Scenario], kind: str, folder: Path) -> tuple[list[LoadLoop], list[Run]]:
    """Loop and run of each scenario with an export of a kind, ``hal`` or ``comp``."""
    loops, runs = [], []
    for scenario in scenarios:
        pf = machine_file(**scenario.changes)
        loops.append(loop_of(pf))
        export, modules = exported(pf, kind, folder)
        runs.append(run_of(scenario, pf, export, **modules))
    return loops, runs


def exported(pf: ParameterFile, kind: str, folder: Path) -> tuple[str, dict[str, Path]]:
    """HAL text of an export, and the realtime components that it needs."""
    text = str(rendered(pf, kind, accept_verdict=True))
    if kind == "hal":
        return text, {}
    folder = Path(tempfile.mkdtemp(dir=folder))
    source = folder / "fm_control.comp"
    source.write_text(text)
    lines = [line.removeprefix("//| ") for line in text.splitlines() if line.startswith("//| ")]
    text = "\n".join(lines).replace("# >>> setp ", "setp ")  # the unit that the user confirms: this machine is in mm
    return text + "\n", {"fm_control": compiled(source)}
