"""A folder of a pair: read, judged, and written as the folder of a card."""

import hashlib
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from ...core.errors import FitmodelsError
from ...parameters import ParameterFile, read
from ..content.compose import compose
from ..content.parts import Card
from ..forms.together import PAGE, PROGRAM, README, forms
from ..gate import GateReport, judge, read_toml, template
from ..gate.ask import QUESTIONS
from .entry import Entry, entry
from .find import PARAMETERS
from .report import Problem

TOML = "card.toml"


@dataclass(frozen=True, slots=True)
class Task:
    """A pair to be looked at.

    Attributes
    ----------
    folder : Path
    name : str
        What it is called in the report.
    to : Path or None
        Where its card goes, if anywhere.
    above : Path or None
        The ``card.toml`` that holds for all pairs, where there is one.
    """

    folder: Path
    name: str
    to: Path | None = None
    above: Path | None = None


@dataclass(frozen=True, slots=True)
class Looked:
    """What came of a pair: its entry, or what stands against it and the ``card.toml`` to fill in."""

    task: Task
    entry: Entry | None
    problems: tuple[Problem, ...] = ()
    template: str = ""


def look(task: Task) -> Looked:
    """Read a pair and judge it; where nothing stands against it write its card."""
    try:
        pf, whole, card = read_pair(task.folder, above=task.above)
        report = judge(card, pf, task.folder)
    except FitmodelsError as error:
        return Looked(task, None, (Problem(task.name, "unreadable", str(error).replace(f"{task.folder}/", "")),))
    problems = tuple(_against(task, report))
    if problems:
        asks = any(p.kind == "field" for p in problems) and not os.path.lexists(task.folder / TOML)
        return Looked(task, None, problems, template(card) if asks else "")
    hashes = {} if task.to is None else _write(task.folder, task.to, whole, card)
    return Looked(task, entry(card, whole, hashes))


def read_pair(
    folder: Path, name: str = PARAMETERS, toml: Path | None = None, above: Path | None = None
) -> tuple[ParameterFile, ParameterFile, Card]:
    """The parameter file as it is on disk, the same with what ``card.toml`` says of its identity, and their card.

    Parameters
    ----------
    folder : Path
        Where the parameter file stands, and the pictures and draws beside it.
    name : str
        Of the parameter file.
    toml : Path, optional
        By default the ``card.toml`` beside it, where there is one.
    above : Path, optional
        A ``card.toml`` that holds for many pairs; what the other says counts first.

    Raises
    ------
    FitmodelsError
        One of the two cannot be read, or they contradict each other.
    """
    pf = read(folder / name)
    if toml is None and os.path.lexists(folder / TOML):
        toml = folder / TOML
    if toml is None and above is None:
        return pf, pf, compose(pf, folder=folder)
    told = read_toml(toml or above or TOML, above if toml else None)
    whole = told.applied(pf)
    return pf, whole, compose(whole, publication=told.publication, folder=folder)


def _against(task: Task, report: GateReport) -> Iterator[Problem]:
    """What is empty, in one sentence; what only a new fit brings; then each refusal."""
    asked = tuple(m.field for m in report.missing if m.field in QUESTIONS)
    if asked:
        yield Problem(task.name, "field", f"not told: {', '.join(asked)}; say it in {TOML}.", asked)
    for m in report.missing:
        if m.field not in QUESTIONS:
            yield Problem(task.name, "field", f"not told: {m.field}; {m.why}. {m.ask}", (m.field,))
    for words in report.refusals:
        yield Problem(task.name, "check", words)


def _write(folder: Path, to: Path, pf: ParameterFile, card: Card) -> dict[str, str]:
    """Write the folder of a card; SHA-256 of each file by its path."""
    beside = [PARAMETERS, *(f.file for f in card.figures if f.file)]
    if pf.posterior is not None and pf.posterior.draws_file is not None:
        beside.append(pf.posterior.draws_file)  # without them the file that is published fails its own check
    made = {name: (folder / name).read_bytes() for name in beside}
    named = sorted(name for name in (*made, README, PROGRAM) if "/" not in name)
    for name, content in forms(card, pf, named).items():
        made["index.html" if name == PAGE else name] = content
    for name, content in made.items():
        (to / name).parent.mkdir(parents=True, exist_ok=True)
        (to / name).write_bytes(content)
    return {name: hashlib.sha256(content).hexdigest() for name, content in sorted(made.items())}
