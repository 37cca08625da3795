"""Summary, intended use, limits of use, safety notes and next commands of a parameter file."""

import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from ...core.errors import ParameterError
from ...core.rounding import count, join_words
from ...core.verdict import DO_NOT_USE
from ...parameters import LawSection, ParameterFile
from .design import at_words, middle, reference
from .numbers import figure, number, percent, quantity
from .parts import VerdictPart
from .verdicts import ADAPTIVE_FORCE, DRIVE, DYNAMICS, GAINS, TOOL_LIFE, follow_up, verdicts_of

LIMITED = ("V", "n", "f", "fm")  # conditions whose ranges `fitmodels limits` writes


def title(pf: ParameterFile) -> str:
    """Tool on work."""
    return f"{pf.identity.tool} on {pf.identity.work}"


def summary(pf: ParameterFile) -> str:
    """Content of the file and its sample size, then its first number; for simulated data that comes first."""
    simulated = "Not measured, simulated: " if pf.identity.simulated else ""
    what = join_words(_holds(pf)) or "no law, no dynamics and no settings yet"
    first = f"{simulated}{what}, for {title(pf)}{_from(pf)}."
    n = len(pf.reading.doubts) if pf.reading is not None else 0
    doubted = [f"The reading of its data raised {count(n, 'doubt')}."] if n else []
    return " ".join([first[:1].upper() + first[1:], *_said(pf), *doubted])


def _holds(pf: ParameterFile) -> list[str]:
    laws = [f"{law.quantity} {law.response}" for law in pf.laws.values()]
    parts = [("law of " if len(laws) == 1 else "laws of ") + join_words(laws)] if laws else []
    parts += [f"a dynamic model of {pf.dynamics.output} from {pf.dynamics.input}"] if pf.dynamics else []
    parts += ["inertia and friction of a feed drive"] if pf.drive else []
    parts += ["PI gains"] if pf.pi else []
    force = "settings" if pf.adaptive_force is not None and pf.adaptive_force.Kd is not None else "estimates"
    parts += [name for name, section in (
        ("settings of constant load", pf.load_line),
        ("settings of constant roughness", pf.roughness),
        (f"{force} of adaptive force", pf.adaptive_force),
    ) if section]  # fmt: skip
    return parts


def _from(pf: ParameterFile) -> str:
    rows = [law.n for law in pf.laws.values()]
    edges = max((law.n_edges or 0 for law in pf.laws.values()), default=0)
    if not rows:
        return ""
    count = f"{max(rows)}" if min(rows) == max(rows) else f"{min(rows)} to {max(rows)}"
    return f", from {count} rows" + (f" of {edges} edges" if edges else "")


def _said(pf: ParameterFile) -> list[str]:
    """The first law at the middle of its tests, or the gains."""
    law = next(iter(pf.laws.values()), None)
    if law is not None:
        return [] if law.response in _refused(pf) else [_of_law(law)]
    pi = pf.pi
    if pi is not None:
        return [
            f"Kp {figure(pi.kp, 4).text}, Ki {figure(pi.ki, 4).text} per second, sampled every {pi.sample_time:g} s."
        ]
    d = pf.dynamics
    if d is not None and d.held_out_fit is not None:
        return [f"A simulation explains {d.held_out_fit:.1f} % of the variation of samples not used in the fit."]
    return []


def _of_law(law: LawSection) -> str:
    at: dict[str, Any] = dict(middle(law))
    by = reference(law)
    where = f"At {at_words(law, at, by)}" if at else "At these conditions"
    try:
        p = law.predict(at, by=by)
    except ParameterError:
        return f"{where}, {law.response} is {quantity(figure(float(law.values(at, by=by)), 4, law.unit))}."
    half = (float(p.high) - float(p.low)) / 2
    width = min(half, float(p.low)) if p.low > 0 else half
    value, low, high = (number(float(x), width, law.unit) for x in (p.value, p.low, p.high))
    new = "on a new edge" if p.edge == "new" else "for a new observation"
    return (
        f"{where}, {law.response} is {quantity(value)}; {percent(p.level).text} % prediction interval {new}: "
        f"{low.text} to {quantity(high)}."
    )


def intended(pf: ParameterFile) -> tuple[str, ...]:
    """Uses supported by the sections of the file."""
    pair, sentences, refused = f"{pf.identity.tool} on {pf.identity.work}", [], _refused(pf)
    usable = [response for response in pf.laws if response not in refused]
    if usable:
        sentences.append(
            f"To choose conditions and to predict {', '.join(usable)} for {pair}, inside the ranges of the tests, "
            "each prediction with its interval."
        )
    if pf.tool_life and not refused.keys() & {TOOL_LIFE, pf.tool_life.wear}:
        sentences.append(
            f"To plan tool changes at {pf.tool_life.wear} {pf.tool_life.criterion:g} {pf.tool_life.unit_of_wear}."
        )
    if pf.dynamics and DYNAMICS not in refused:
        sentences.append(f"To simulate {pf.dynamics.output} from {pf.dynamics.input} and to tune a controller for it.")
    if pf.drive and DRIVE not in refused:
        sentences.append("To simulate the motion of the feed drive from its force, and to size its feed-forward.")
    if pf.pi and GAINS not in refused:
        sentences.append(
            "To set up a PI controller with the form, sample time and limits given here, after the checks below."
        )
    if pf.load_line and pf.load_line.law not in refused:
        sentences.append("To mill at constant load with the reference and the feed limits given here.")
    if pf.roughness and pf.roughness.law not in refused:
        sentences.append("To turn at constant roughness through the reference force given here.")
    if pf.adaptive_force and ADAPTIVE_FORCE not in refused:
        rates = " and rates" if pf.adaptive_force.Kd is not None else ""
        chosen = "" if rates else ", once its rates and gains are chosen"
        sentences.append(f"To start an adaptive force controller from the estimates{rates} given here{chosen}.")
    return tuple(sentences) or (f"As a record of {pair}: the file holds nothing to compute with yet.",)


def _refused(pf: ParameterFile) -> dict[str, str]:
    """Results that must not be used for control, each with the first reason."""
    return {verdict.of: verdict.reasons[0] for verdict in verdicts_of(pf) if verdict.level == DO_NOT_USE}


def out_of_scope(pf: ParameterFile) -> tuple[str, ...]:
    """Uses that the numbers do not support."""
    uses = [f"Control and choice of conditions by {name}: {reason}" for name, reason in _refused(pf).items()]
    uses += ["Other tools, other work, another machine or set-up: these were not tested."]
    if pf.laws:
        uses.append("Conditions outside the ranges or outside the tested region: there the laws are extrapolations.")
        uses.append(
            "Sudden failure (chipping, breakage) and built-up edge: the laws describe gradual change and its scatter."
        )
    if pf.dynamics:
        band = pf.dynamics.band
        where = f" ({band[0]:.3g} to {band[1]:.3g} Hz)" if band else ""
        uses.append(
            f"Dynamics outside the excited band{where}, or far from the operating point they were identified at."
        )
    if pf.identity.simulated:
        uses.append("Any machine: the numbers come from a simulation, made for testing methods.")
    if pf.identity.simulated is None:
        uses.append("Any machine, before it is known that the tests were measured: the file does not say.")
    uses.append("Computing from the rounded numbers of this card: use the equations or params.json.")
    return tuple(uses)


def safety(pf: ParameterFile) -> tuple[str, ...]:
    """A plain warning, and what a person must check first."""
    sentences = []
    if pf.identity.simulated:
        sentences.append("NOT MEASURED: these numbers come from a simulation. Do not run a machine with them.")
    sentences.append(
        "These numbers are estimates from a limited number of tests; about one in twenty cuts may lie outside a 95 % "
        "prediction interval even under the conditions of the tests. They are not a safety function and do not "
        "replace guards."
    )
    sentences.append(
        "Before a machine moves, a person who knows it checks: the hard limits of spindle power, torque, force, feed "
        "and speed in the control itself; clamping and overhang; that tool, work and units are those of this card; "
        "that the emergency stop works."
    )
    if _acts(pf):
        sentences += _of_a_loop(pf)
    else:
        sentences.append(
            "Approach new conditions from the safe side, in steps, and stop when load or sound is not as expected."
        )
    return tuple(sentences)


def _acts(pf: ParameterFile) -> bool:
    return any((pf.pi, pf.load_line, pf.roughness, pf.adaptive_force))


def _of_a_loop(pf: ParameterFile) -> list[str]:
    sentences = [
        "A controller with these settings changes the feed automatically. First run it without cutting, then with low "
        "limits of feed and feed rate, with the emergency stop within reach; set the limits in the control, not only "
        "in the file.",
        "Check the response of the loop when the sensor fails, saturates or reads zero, and when the tool enters and "
        "leaves the work: it must return to a safe feed automatically.",
    ]
    pi = pf.pi
    if pi is not None and pi.forced:
        miss = f"FORCED GAINS: they do not meet their specification ({pi.forced})."
        sentences.insert(0, f"{miss} Do not close the loop without a new check.")
    if pi is not None and (pi.low is None or pi.high is None):
        sentences.append(
            "The file lacks a lower or upper limit of the command: set both in the control before the loop is closed."
        )
    if pi is not None and pf.dynamics is None:
        sentences.append("The file holds no dynamics, so these gains could not be checked: start with a tenth of them.")
    return sentences


def next_commands(pf: ParameterFile, verdicts: Sequence[VerdictPart], path: str) -> list[tuple[tuple[str, ...], str]]:
    """Words of each next command with its purpose: further tests, limits, replay, export."""
    usable = [one.of for one in verdicts if one.of in pf.laws and one.level != DO_NOT_USE]
    tests = tuple(shlex.split(follow_up(pf, "next")))
    further = [(tests, "plan further tests")] if tests and pf.laws else []
    if usable:
        return [*further, *_with_the_file(pf, usable, path)]
    look = tuple(shlex.split(follow_up(pf, "look")))
    return [(look, "see how the file was read"), *further] if look else further


def _with_the_file(pf: ParameterFile, usable: Sequence[str], path: str) -> Iterator[tuple[tuple[str, ...], str]]:
    """Commands that read the parameter file: limits, replay, export."""
    bounds = limits(pf, usable)
    if bounds:
        yield ("fitmodels", "limits", path, *bounds), "your limits in place of the tested ones"
    if bounds and _replays(pf, bounds):
        yield ("fitmodels", "replay", path), "best V and f within the limits"
    if len(usable) == len(pf.laws):
        out = (Path(path).parent.parent / "params.ini").as_posix()
        yield ("fitmodels", "export", path, "--to", "ini", "--out", out), "values for a controller"


def limits(pf: ParameterFile, usable: Sequence[str]) -> tuple[str, ...]:
    """Arguments of ``fitmodels limits``: the wear criterion, and tested ranges of speed and feed."""
    life = pf.tool_life
    wear = [] if life is None else [f"{life.wear}={life.criterion:g}{life.unit_of_wear}"]
    ranges: dict[str, str] = {}
    for law in (pf.laws[name] for name in usable):
        for f in law.factors:
            if f.symbol in LIMITED and f.low < f.high:
                ends = (quantity(figure(f.low, 4)), quantity(figure(f.high, 4)))
                unit = "" if f.unit[:1].isdigit() else f.unit  # 1/min behind a number would be one of its digits
                ranges.setdefault(f.symbol, f"{f.symbol}={ends[0]}:{ends[1]}{unit}")
    return (*wear, *ranges.values())


def _replays(pf: ParameterFile, bounds: Sequence[str]) -> bool:
    """Whether the wear law supports a replay once these limits are written."""
    names = {bound.split("=")[0] for bound in bounds}
    return pf.tool_life is not None and {"V", "f", pf.tool_life.wear} <= names
