"""Parameter files of one tool and work material joined into one: every section whole, from the file that holds it.

Sections that two files hold with other contents are conflicts, which are named together and decided by the caller;
posterior draws go along with their laws. See `fitmodels.parameters.conflicts`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..core.display import Displayable
from ..core.errors import ParameterError
from .conflicts import (
    FOLLOWING,
    WHOLE,
    MergeInput,
    SectionChoice,
    check_pair,
    plain,
    resolved,
    same_section,
    units_of,
)
from .draws import joined_posterior
from .file import ParameterFile, sealed


@dataclass(frozen=True, slots=True, repr=False)
class Merged(Displayable):
    """Merged parameter file.

    Attributes
    ----------
    pf : ParameterFile
    draws : bytes or None
        Content of its file of draws, whose name is in ``pf.posterior.draws_file``.
    taken : dict of str
        File of each section.
    notes : tuple of str
        What was decided, left out, or is to be known.
    """

    pf: ParameterFile
    draws: bytes | None
    taken: Mapping[str, str]
    notes: tuple[str, ...]


def merge(
    inputs: Sequence[MergeInput],
    *,
    take: Mapping[str, int] | None = None,
    prefer: int | None = None,
    stem: str = "merged",
) -> Merged:
    """Join the sections of parameter files of one tool and work material.

    Parameters
    ----------
    inputs : sequence of MergeInput
        Two or more; identity, provenance and design are those of the first.
    take : mapping of str to int
        Number of the file from which a section, or all in it (``limits``), is taken where files differ.
    prefer : int, optional
        File that decides all other conflicts.
    stem : str
        Beginning of the name of the file of draws.

    Raises
    ------
    ParameterError
        The files are of other tools, works or units; or conflicts are left, all of which are named.
    UsageError
        ``take`` names a section that the file does not hold.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> pf = published("CLM-2023")
    >>> bare = sealed(pf, laws={"I": pf.laws["I"]}, tool_life=None)
    >>> wear = sealed(pf, laws={"VB": pf.laws["VB"]}, dynamics=None, pi=None, load_line=None)
    >>> both = merge([MergeInput("load.json", bare), MergeInput("wear.json", wear)])
    >>> both.taken["laws.VB"], sorted(both.pf.laws)
    ('wear.json', ['I', 'VB'])
    """
    check_pair(inputs)
    choice = SectionChoice(inputs, dict(take or {}), prefer)
    chosen = resolved(choice)
    if choice.conflicts:
        raise ParameterError(_refusal(inputs, choice.conflicts))
    return _joined(choice, chosen, stem)


def _refusal(inputs: Sequence[MergeInput], conflicts: Sequence[str]) -> str:
    number = f"{len(conflicts)} conflict{'s' if len(conflicts) > 1 else ''}"
    files = " and ".join(each.name for each in inputs)
    return (
        f"{files} contradict each other, so nothing was written; {number}: {' '.join(conflicts)} Decide each with "
        "--take SECTION=FILE, or all with --prefer FILE."
    )


def _joined(choice: SectionChoice, chosen: Mapping[str, int], stem: str) -> Merged:
    """The file of the chosen sections, with posterior draws, doubts and provenance of all."""
    inputs, first = choice.inputs, choice.inputs[0].pf
    sections: dict[str, Any] = dict.fromkeys((*WHOLE, *FOLLOWING))
    laws: dict[str, Any] = {}
    limits: dict[str, Any] = {"responses": {}}
    identity: dict[str, Any] = {"iso13399": {}, "sensors": []}
    for name, number in chosen.items():
        value, (kind, _, key) = plain(choice.held[number][name]), name.partition(".")
        if kind == "laws" and key:
            laws[key] = _of_its_wear_law(choice, chosen, value, number)
        elif name.startswith("limits.responses."):
            limits["responses"][key.removeprefix("responses.")] = value
        elif kind == "limits" and key:
            limits[key] = value
        elif name.startswith("identity.sensors."):
            identity["sensors"].append(value)
        elif name.startswith("identity.iso13399."):
            identity["iso13399"][key.removeprefix("iso13399.")] = value
        else:
            (identity if kind == "identity" else sections)[key or kind] = value
    posterior, draws = joined_posterior([(of.pf.posterior, of.draws) for of in inputs], _of_laws(chosen), stem)
    choice.notes += _remarks(choice, chosen)
    data = {
        **first.model_dump(), **sections, "laws": laws, "posterior": posterior,
        "limits": limits if len(limits) > 1 or limits["responses"] else None,
        "identity": {**first.identity.model_dump(), **identity, **_mark(inputs)},
        "reading": _reading(inputs), "provenance": _provenance(inputs, chosen),
    }  # fmt: skip
    pf = sealed(ParameterFile.model_validate({**data, "content_sha256": None}))
    return Merged(pf, draws, {name: choice.name(number) for name, number in chosen.items()}, tuple(choice.notes))


def _of_laws(chosen: Mapping[str, int]) -> dict[str, int]:
    return {name.removeprefix("laws."): number for name, number in chosen.items() if name.startswith("laws.")}


def _of_its_wear_law(
    choice: SectionChoice, chosen: Mapping[str, int], law: dict[str, Any], number: int
) -> dict[str, Any]:
    """A law without its composite where the wear law in that is not the one of the result."""
    wear = f"laws.{law['composite']['wear']}" if law.get("composite") else ""
    if not wear or wear not in chosen or same_section(choice.held[number].get(wear), choice.held[chosen[wear]][wear]):
        return law
    response = law["response"]
    choice.notes.append(
        f"laws.{response}: the law with its wear replaced by {wear} of {choice.name(number)} is left out."
    )
    return {**law, "composite": None}


def _mark(inputs: Sequence[MergeInput]) -> dict[str, Any]:
    """Simulated where any file is, unknown where any is not known; and the notes of all."""
    marks = [each.pf.identity.simulated for each in inputs]
    notes = list(dict.fromkeys(each.pf.identity.note for each in inputs if each.pf.identity.note))
    simulated = True if True in marks else None if None in marks else False
    return {"simulated": simulated, "note": "; ".join(notes) or None}


def _reading(inputs: Sequence[MergeInput]) -> dict[str, Any] | None:
    """Doubts about the data of all files; those of the others name their data file and its remedy."""
    if all(each.pf.reading is None for each in inputs):
        return None
    doubts: list[dict[str, Any]] = []
    for number, each in enumerate(inputs):
        data = each.pf.provenance.data_file or each.name
        if each.pf.reading is None:
            if each.pf.laws:
                words = f"It is not known whether {data} was read without doubts."
                doubts.append({"sentence": words})
            continue
        for doubt in each.pf.reading.doubts:
            remedy = f" Remedy: fitmodels {data} {doubt.remedy}." if doubt.remedy else ""
            other = {"sentence": f"{data}: {doubt.sentence}{remedy}", "remedy": ""} if number else {}
            doubts.append({**doubt.model_dump(), **other})
    return {"doubts": doubts}


def _provenance(inputs: Sequence[MergeInput], chosen: Mapping[str, int]) -> dict[str, Any]:
    """Provenance of the first file, with the others, their sections and the commands that made them."""
    own = inputs[0].pf.provenance
    merged = [each.model_dump() for each in own.merged]
    then = list(own.then)
    for number, each in enumerate(inputs[1:], start=1):
        sections = [name for name, of in chosen.items() if of == number]
        of = each.pf.provenance
        if not sections:
            continue
        merged += [
            {
                "file": Path(each.name).name, "content_sha256": each.pf.content_sha256, "data_file": of.data_file,
                "data_sha256": of.data_sha256, "sections": sections,
            },
            *(former.model_dump() for former in of.merged),
        ]  # fmt: skip
        then += [*([of.command] if of.command else []), *of.then]
    return {**own.model_dump(), "merged": merged, "then": then}


def _remarks(choice: SectionChoice, chosen: Mapping[str, int]) -> list[str]:
    """What a reader of the result is to know: marks of simulation, machines and units that differ."""
    inputs, remarks = choice.inputs, []
    marks = {each.pf.identity.simulated for each in inputs}
    if len(marks) > 1 and marks != {False}:
        of = ", ".join(each.name for each in inputs if each.pf.identity.simulated is not False)
        remarks.append(
            f"identity.simulated: {of} {'is' if True in marks else 'may be'} simulated, so the result counts as such."
        )
    unnamed = [each.name for each in inputs if each.pf.identity.machine is None]
    if "identity.machine" in chosen and unnamed:
        remarks.append(
            f"identity.machine: taken from {choice.name(chosen['identity.machine'])}; {', '.join(unnamed)} names none."
        )
    units: dict[str, dict[str, str]] = {}
    for each in inputs:
        for symbol, unit in units_of(each.pf):
            units.setdefault(symbol, {}).setdefault(unit, each.name)
    for symbol, found in units.items():
        if len(found) > 1:
            listed = ", ".join(f"{unit} in {name}" for unit, name in found.items())
            remarks.append(f"{symbol} is in {listed}: each section keeps its unit, and constant load converts.")
    seeds = {each.pf.posterior.seed for each in inputs if each.pf.posterior is not None}
    if len(seeds) > 1:
        remarks.append(f"posterior: draws of the seeds {', '.join(map(str, sorted(seeds)))}; the file names the first.")
    return remarks
