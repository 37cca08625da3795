"""Forms of the commands that take the laws of a file on to a machine, and the words of a command from a filled form."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from ..datasets.derived import COMPUTED

LABELS = {  # kinds of exports, which are the suffixes of their files
    "hal": "LinuxCNC HAL file", "comp": "LinuxCNC component for halcompile", "st": "IEC 61131-3 structured text",
    "c": "C source for firmware", "fmu": "FMI 2.0 co-simulation", "nc": "NC program of the plan",
    "csv": "table of the plan", "ngc": "G-code parameters and M52", "mat": "MATLAB struct",
    "ssv": "FMI parameter values", "h": "C header of values", "ini": "key and value",
}  # fmt: skip
CONTROLS = ("hal", "comp", "st", "c", "fmu")  # kinds of exports that a machine runs
SYSTEMS = tuple((name, name) for name in ("region", "recursion", "constant-load", "roughness", "adaptive-force"))


@dataclass(frozen=True, slots=True)
class Input:
    """One field of a form.

    Attributes
    ----------
    name, label : str
    words : str
        What the command gets where the field is filled, ``{}`` in the place of the value: ``--rise {}``.
    hint, value : str
        An example, and what the field holds at first.
    default : str
        What the command takes where the field is empty.
    kinds : tuple of str
        Kinds of exports that it is of; empty for all.
    choices : tuple of (str, str)
        Values and labels of a menu; empty for a text.
    needed : bool
    is_rare : bool
        Whether it is shown below the others, on request.
    """

    name: str
    label: str
    words: str
    hint: str = ""
    value: str = ""
    choices: tuple[tuple[str, str], ...] = ()
    needed: bool = False
    is_rare: bool = False
    default: str = ""
    kinds: tuple[str, ...] = ()

    @property
    def placeholder(self) -> str:
        """Text of an empty field: its default, or an example marked as one."""
        return f"empty: {self.default}" if self.default else f"e.g. {self.hint}" if self.hint else ""


@dataclass(frozen=True, slots=True)
class Action:
    """A command with its form.

    Attributes
    ----------
    name : str
        Of the command.
    title, words : str
        What it does.
    inputs : tuple of Input
    fixed : str
        Further words, with ``{stem}`` of the file and ``{to}`` of the kind of an export.
    first : str
        What stands after the command: ``params``, ``tests``, or ``record``, which is chosen.
    is_form : bool
        Whether it stands among the forms; ``compare`` stands beside the laws.
    """

    name: str
    title: str
    words: str
    inputs: tuple[Input, ...] = ()
    fixed: str = ""
    first: str = "params"
    is_form: bool = True


@dataclass(frozen=True, slots=True)
class Subject:
    """Subject of the forms: a file, its parameter file, the other files of the project, and those that have laws."""

    stem: str
    params: str
    content: Mapping[str, Any] = field(default_factory=dict)
    others: Sequence[str] = ()
    tests: Sequence[str] = ()

    @property
    def is_record(self) -> bool:
        """Whether it holds the dynamics of a record alone."""
        return bool(not self.content.get("laws") and self.content.get("dynamics"))

    @property
    def has_load_law(self) -> bool:
        """Whether it has a law of load on feed and wear, or what was set by one."""
        laws = (self.content.get("laws") or {}).values()
        return bool(self.content.get("load_line")) or any(law.get("form") in ("load_line", "feed_line") for law in laws)


def subject_of(folder: Path, stem: str, params: str, others: Sequence[str]) -> Subject:
    """The subject of a parameter file of the folder; without content where it cannot be read."""
    try:
        content = json.loads((folder / params).read_text("utf-8"))
    except (OSError, ValueError):
        content = {}
    return Subject(stem, params, content if _is_whole(content) else {}, others)


def _is_whole(content: object) -> bool:
    """Whether the parts that the page shows have the shapes that they have in a parameter file."""
    if not isinstance(content, dict):
        return False
    laws, design, parts = content.get("laws") or {}, content.get("design") or {}, {"symbol", "quantity", "unit"}
    line = content.get("load_line") or {}
    return (
        isinstance(laws, dict)
        and all(isinstance(law, dict) and isinstance(law.get("verdict") or {}, dict) for law in laws.values())
        and isinstance(design, dict)
        and isinstance(line, dict)
        and all(isinstance(line.get(name) or {}, dict) for name in ("lower", "upper"))
        and all(isinstance(one, dict) and one.keys() >= parts for one in design.get("factors") or ())
    )


def actions(of: Subject) -> tuple[Action, ...]:
    """The forms, in the order in which they are needed; of a record those that need no law."""
    if of.is_record:
        return (tune(of), CARD, CHECK, EXPORT_OF_RECORD)
    return (*_of_laws(of), *_of_control(of), CARD, CHECK, EXPORT)


def _of_laws(of: Subject) -> tuple[Action, ...]:
    """Forms of what the laws give."""
    return (
        Action("compare", "Compare forms", "Forms of each law on the same rows.", first="tests", is_form=False),
        Action("predict", "Predict", "What the laws give at your settings, with intervals.", _conditions(of)),
        Action(
            "next",
            "Plan further tests",
            "The tests that narrow the answer most, as a table to fill in.",
            (
                Input("runs", "edges to add", "--runs {}", default="4"),
                Input("within", "half width of the interval asked for, %", "--within {}", "15"),
            ),
            "--out {stem}-next.csv --force",
            "tests",
        ),
        Action("limits", "Limits", "Limits that optimum, replay and exports respect.", _limits(of), "--force"),
        Action("costs", "Costs", "Rates, prices and times of a part.", COSTS, "--force"),
        Action(
            "optimum",
            "Optimum",
            "Speed and feed of least cost and of greatest rate; when to change the edge.",
            (
                Input("V", "cutting speed today, m/min", "--today V={}"),
                Input("f", "feed today, mm/rev", "--today f={}"),
                Input("depth", "depth of cut", "--depth {}", "2.5mm"),
                Input("at", "a further factor of the laws", "--at {}", "D=80mm", is_rare=True),
            ),
            "--figure {stem}-cost.png --force",
        ),
    )


def _of_control(of: Subject) -> tuple[Action, ...]:
    """Forms of dynamics, settings and gains."""
    others = sorted(of.others, key=lambda name: name in of.tests)  # files of tests are hardly the record
    chosen = [("", "choose one, or add it below")] if others and others[0] in of.tests else []
    records = (*chosen, *((name, name) for name in others))
    return (
        Action(
            "settings",
            "Constant load",
            "Reference load (load limit times safety factor), and by the load law feed limits and tool change.",
            _settings(of),
            "--force",
        ),
        Action(
            "ident",
            "Dynamics",
            "A model of the feed drive from a chirp record of the project, for the gains.",
            (Input("record", "record of the project", "{}", choices=records, needed=True), *SIGNALS),
            "--params {params} --force",
            "record",
        ),
        tune(of),
        Action(
            "replay",
            "Replay",
            "The controllers of the papers with these laws, on simulated machines.",
            (Input("system", "system", "--system {}", choices=(("", "all that the file supports"), *SYSTEMS)),),
            "--out {stem}-replay",
        ),
    )


def tune(of: Subject) -> Action:
    """The form of the gains; its limits are the feed limits of Constant load, where the file has them."""
    line = of.content.get("load_line") or {}
    low, high = ((line.get(name) or {}).get("value") for name in ("lower", "upper"))
    ends, unit = ("", ""), ""
    if isinstance(low, int | float) and isinstance(high, int | float):
        ends, unit = (f"{math.ceil(low)}", f"{math.floor(high)}"), str(line.get("unit_feed") or "")
    unset = "the feed limits of Constant load" if line else ""
    command = (
        Input(
            "low",
            "lowest command: lower bound of the feed, in the unit below",
            "--low {}",
            "521",
            ends[0],
            default=unset,
        ),
        Input(
            "high",
            "highest command: upper bound of the feed, in the unit below",
            "--high {}",
            "1034",
            ends[1],
            default=unset,
        ),
        Input("unit", "unit of the command", "--unit {}", "mm/min", unit),
    )
    scaling = Input(
        "scaling", "feed for 1 unit of the command (mm/min for 1 V)", "--scaling {}",
        "1500" if not of.has_load_law else "", default="by the load law" if of.has_load_law else "",
    )  # fmt: skip
    words = "PI gains that meet a specification, with its probability."
    return Action("tune", "Gains", words, (*SPECIFICATION, *command, scaling), "--force")


ENGAGEMENT = (  # thresholds and times of the control, with units and defaults; loads and feeds in those of the settings
    ("feed-programmed", "feed that programs command (F), {feed}; at most the upper feed limit", "the upper feed limit"),
    ("engage-at", "load above which a cut is recognised{load}", "between load in air and in a cut"),
    ("hysteresis", "hysteresis of this load, whole width{load}", "a tenth of the reference load"),
    ("engage-after", "time above this load until the loop controls, s", "0.1"),
    ("feed-forward", "share of the correction that the load law gives at once, 0 to 1", "0"),
    ("back-off", "fastest fall of the override, per second", "the whole range in 0.5 s"),
    ("recover", "fastest rise of the override, per second", "the whole range in 2 s"),
    ("filter-corner", "corner of a low-pass of the load, Hz", "none"),
    ("sample-time", "period of the thread of the control, s", "that of the gains"),
    ("load-low", "smallest valid load reading{load}", "half of the load in air"),
    ("load-high", "largest valid load reading{load}", "10 times the reference load"),
    ("arm-after", "time of a running spindle before the load is monitored, s", "0.5"),
    ("lost-after", "time with invalid readings that is a fault, s", "0.05"),
    ("stuck-after", "time of equal readings in the cut that is a fault, s; 0: not monitored", "1"),
    ("heartbeat", "time without a sign of the load's source that is a fault, s; 0: not monitored", "0.2"),
    ("overload-after", "time of overload that stops the feed, s", "0.5"),
    ("dwell", "time at the lower feed limit before the tool counts as worn, s", "not used"),
)
FOLLOWING = {  # what is done after a command
    "settings": "ident", "ident": "tune", "tune": "check", "check": "export", "limits": "costs", "costs": "optimum",
    "export": "card",
}  # fmt: skip
HELD = (("", "the measured load"), ("yes", "deviations from a load in the cut"))
SIGNALS = (
    Input("input", "commanded column", "--input {}", default="found by its name"),
    Input("output", "measured column", "--output {}", default="found by its name"),
    Input("rate", "samples per second", "--rate {}", default="by the column of times"),
    Input("deviations", "the record holds", "--deviations", choices=HELD),
    Input("time", "column of times", "--time {}", is_rare=True),
    Input("sample-time", "seconds between samples", "--sample-time {}", is_rare=True),
    Input("resample", "resample uneven samples to, Hz", "--resample {}", is_rare=True),
    Input("reference", "column of the set point, of a run in closed loop", "--reference {}", is_rare=True),
    Input("unit", "unit of a column", "--unit {}", "time=ms", is_rare=True),
)
SPECIFICATION = (
    Input("rise", "rise time at most, s", "--rise {}", "2"),
    Input("settle", "settling time at most, s", "--settle {}", "4"),
    Input("overshoot", "overshoot at most, as a fraction", "--overshoot {}", default="0.02"),
    Input("probability", "required probability", "--probability {}", default="0.9"),
)
CARD = Action("card", "Card", "The card again, with all that was added to the file.", fixed="--force")
CHECK = Action("check", "Check", "Whether the file is consistent, and its control safe.")
EXPORT = Action(
    "export",
    "Export",
    "A file that a controller loads; what fails the check is refused.",
    (
        Input("to", "kind", "--to {}", choices=tuple(LABELS.items()), needed=True),
        Input("system", "what is controlled", "--system {}", choices=(("", "as the file asks for"), *SYSTEMS)),
        Input("diameter", "diameter of the part (NC program)", "--diameter {}", "60mm", kinds=("nc",)),
        Input("length", "length of the cut (NC program)", "--length {}", "100mm", kinds=("nc",)),
        Input("max-rpm", "highest spindle speed (NC program)", "--max-rpm {}", "3000", kinds=("nc",)),
        Input("pass", "diameter:length of a pass (NC program)", "--pass {}", "80:200", is_rare=True, kinds=("nc",)),
        Input("depth", "depth of cut (plan, NC program)", "--depth {}", "1.5mm", is_rare=True),
        Input("at", "a further factor of the laws", "--at {}", "D=80mm", is_rare=True),
        Input("beyond-tests", "reason to go beyond the tests (plan)", "--beyond-tests {}", is_rare=True),
        Input(
            "accept-verdict",
            "export in spite of a verdict",
            "--accept-verdict",
            choices=(("", "no"), ("yes", "yes, recorded in the exported file")),
            is_rare=True,
        ),
    ),
    "--out {stem}-control.{to} --force",
)
OF_RECORD = ("mat", "ssv", "h", "ini")  # kinds of exports that hold dynamics and gains without laws
EXPORT_OF_RECORD = replace(
    EXPORT,
    words="Values of the dynamics and gains of this record; a controller needs the file of tests.",
    inputs=(replace(EXPORT.inputs[0], choices=tuple((name, LABELS[name]) for name in OF_RECORD)), EXPORT.inputs[-1]),
)
COSTS = (
    Input("machine", "machine rate", "machine={}", "60/h"),
    Input("edge", "price of an edge", "edge={}", "8"),
    Input("change", "time of a change", "change={}", "1.5min"),
    Input("handling", "handling time of a part", "handling={}", "2min"),
    Input("volume", "volume cut from a part", "volume={}", "120cm3"),
    Input("failure", "cost of a failed edge beyond its change", "failure={}", "40"),
    Input("currency", "currency", "currency={}", "EUR"),
)


def _factors(of: Subject) -> list[Mapping[str, Any]]:
    """Factors of the design, with finite ranges."""
    found = (of.content.get("design") or {}).get("factors") or []
    return [
        one for one in found if isinstance(one.get("low"), int | float) and isinstance(one.get("high"), int | float)
    ]


def _settings(of: Subject) -> tuple[Input, ...]:
    """Fields of constant load; loads in the unit of the law of load."""
    found = of.content.get("laws") or {}
    unit = next((f", {found[name].get('unit', '')}" for name in ("I", "P", "Fc", "M") if name in found), "")
    feed = str((of.content.get("load_line") or {}).get("unit_feed") or "mm/min")
    engagement = (
        Input(name, label.format(load=unit, feed=feed), f"--{name} {{}}", default=default,
              is_rare=name != "feed-programmed")
        for name, label, default in ENGAGEMENT
    )  # fmt: skip
    return (
        Input("worn", f"load limit of a worn tool{unit}", "--worn {}", "0.28" if unit == ", A" else "", needed=True),
        Input("safety-factor", "safety factor: reference load divided by the load limit", "--safety-factor {}",
              default="0.85"),
        Input("window", "wear at tool change, from:to with unit", "--window {}", default="180:220um"),
        Input("wear-limit", "wear for the lower feed limit, with unit", "--wear-limit {}",
              default="the end of the wear at tool change"),
        Input("idle", f"load of the running spindle in air{unit}", "--idle {}", default="not known"),
        Input(
            "on-fault", "on a lost or wrong load", "--on-fault {}",
            choices=(("", "feed to its lower limit"), ("stop", "stop the feed")),
        ),
        *engagement,
        Input("round", f"step of the reference load{unit}; 0: not rounded", "--round {}", default="0.01", is_rare=True),
        Input("level", "level of the intervals of the feed limits", "--level {}", default="0.95", is_rare=True),
    )  # fmt: skip


def _conditions(of: Subject) -> tuple[Input, ...]:
    return tuple(
        Input(one["symbol"], f"{one['quantity']}, {one['unit']}", one["symbol"] + "={}",
              f"{one['low']:g} to {one['high']:g}", f"{_middle(of, one):g}")
        for one in _factors(of)
    )  # fmt: skip


def _middle(of: Subject, factor: Mapping[str, Any]) -> float:
    """The middle of a factor as on its card: geometric where the first law that has it takes its logarithm."""
    from ..core.formula import FORMS
    from ..core.rounding import middle_of

    laws = [law for law in (of.content.get("laws") or {}).values() if str(law.get("form")) in FORMS]
    factors = ((law["form"], one) for law in laws for one in law.get("factors") or () if isinstance(one, dict))
    held = (form for form, one in factors if one.get("symbol") == factor["symbol"])
    form = next(held, "power")
    return middle_of(factor["low"], factor["high"], logs=FORMS[form].log_factors)


def _limited(name: str, law: Mapping[str, Any]) -> str:
    """Quantity and symbol of a response; of a power that was computed from the force what it is of."""
    of_cut = name == "P" and f"{name}{COMPUTED}" in str(law.get("notes"))
    return f"{law.get('quantity', name)}{' of the cut' if of_cut else ''} {name}"


def _limits(of: Subject) -> tuple[Input, ...]:
    laws = (of.content.get("laws") or {}).items()
    upper = [Input(name, f"{_limited(name, law)} at most, {law.get('unit', '')}", name + "={}") for name, law in laws]
    life = [Input("T", "tool life at least, min", "T={}")] if of.content.get("tool_life") else []
    ranges = [
        Input(one["symbol"], f"range of {one['quantity']}, {one['unit']}", one["symbol"] + "={}",
              f"{one['low']:g}:{one['high']:g}", f"{one['low']:g}:{one['high']:g}")
        for one in _factors(of) if one["symbol"] in ("V", "f")
    ]  # fmt: skip
    return (*upper, *life, *ranges)
