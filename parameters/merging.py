"""Parameter files of one tool and work material joined into one: every section whole, from the file that holds it.

Sections that two files hold with other contents are conflicts, which are named together and decided by the caller;
posterior draws go along with their laws. See `fitmodels.parameters.conflicts`.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..core.display import Displayable
from ..core.errors import ParameterError
from ..core.rounding import count
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

GROUPS = ("responses.", "iso13399.", "sensors.")


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
    >>> from fitmodels.parameters.conflicts import MergeInput
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
    number = count(len(conflicts), "conflict")
    files = " and ".join(each.name for each in inputs)
    return (
        f"{files} contradict each other, so nothing was written; {number}: {' '.join(conflicts)} Decide each with "
        "--take SECTION=FILE, or all with --prefer FILE."
    )


def _joined(choice: SectionChoice, chosen: Mapping[str, int], stem: str) -> Merged:
    """The file of the chosen sections, with posterior draws, doubts and provenance of all."""
    inputs, first = choice.inputs, choice.inputs[0].pf
    sections: dict[str, Any] = dict.fromkeys((*WHOLE, *FOLLOWING))
    found: dict[str, dict[str, Any]] = {"laws": {}, "limits": {}, "identity": {}}
    for name, number in chosen.items():
        kind, _, key = name.partition(".")
        (found[kind] if kind in found and key else sections)[key or kind] = plain(choice.held[number][name])
    laws = {name: _of_its_wear_law(choice, chosen, law, chosen[f"laws.{name}"]) for name, law in found["laws"].items()}
    limits = {**_below(found["limits"]), "responses": _below(found["limits"], "responses.")}
    identity = {
        **_below(found["identity"]), "iso13399": _below(found["identity"], "iso13399."),
        "sensors": [*_below(found["identity"], "sensors.").values()],
    }  # fmt: skip
    posterior, draws = joined_posterior([(of.pf.posterior, of.draws) for of in inputs], _of_laws(chosen), stem)
    choice.notes += _remarks(choice, chosen)
    data = {
        **first.model_dump(), **sections, "laws": laws, "posterior": posterior,
        "limits": limits if found["limits"] else None,
        "identity": {**first.identity.model_dump(), **identity, **_mark(inputs)},
        "reading": _reading(inputs), "provenance": _provenance(inputs, chosen),
    }  # fmt: skip
    pf = sealed(ParameterFile.model_validate({**data, "content_sha256": None}))
    return Merged(pf, draws, {name: choice.name(number) for name, number in chosen.items()}, tuple(choice.notes))


def _below(found: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Parts whose names begin with a prefix, without it; without a prefix those with no such group."""
    if not prefix:
        return {name: value for name, value in found.items() if not name.startswith(GROUPS)}
    return {name.removeprefix(prefix): value for name, value in found.items() if name.startswith(prefix)}


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
    return {"doubts": [doubt for number, each in enumerate(inputs) for doubt in _doubts(each, other=number > 0)]}


def _doubts(of: MergeInput, *, other: bool) -> Iterator[dict[str, Any]]:
    data, reading = of.pf.provenance.data_file or of.name, of.pf.reading
    if reading is None and of.pf.laws:
        yield {"sentence": f"It is not known whether {data} was read without doubts."}
    for doubt in () if reading is None else reading.doubts:
        remedy = f" Remedy: fitmodels {data} {doubt.remedy}." if doubt.remedy else ""
        named = {"sentence": f"{data}: {doubt.sentence}{remedy}", "remedy": ""} if other else {}
        yield {**doubt.model_dump(), **named}


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
    """Remarks for a reader of the result: marks of simulation, machines, units and seeds that differ."""
    inputs = choice.inputs
    remarks = [*_unnamed(inputs), *_simulated(inputs), *_other_units(inputs)]
    unnamed = ", ".join(each.name for each in inputs if each.pf.identity.machine is None)
    if "identity.machine" in chosen and unnamed:
        remarks.append(f"identity.machine: that of {choice.name(chosen['identity.machine'])}; {unnamed} names none.")
    seeds = sorted({each.pf.posterior.seed for each in inputs if each.pf.posterior is not None})
    if len(seeds) > 1:
        remarks.append(f"posterior: draws of the seeds {', '.join(map(str, seeds))}; the file names the first used.")
    return remarks


def _unnamed(inputs: Sequence[MergeInput]) -> Iterator[str]:
    """That several files do not name tool or work material, which are therefore not known to be the same."""
    from ..datasets.vocabulary import UNNAMED

    what = [
        words
        for (role, none), words in zip(UNNAMED.items(), ("tool", "work material"), strict=True)
        if all(getattr(each.pf.identity, role) == none for each in inputs)
    ]
    if what:
        yield (
            f"No file names its {' and '.join(what)}: nothing shows that {' and '.join(each.name for each in inputs)} "
            "are of the same. Fit the tests again with --tool and --work, or be sure of it."
        )


def _simulated(inputs: Sequence[MergeInput]) -> Iterator[str]:
    marks = {each.pf.identity.simulated for each in inputs}
    if len(marks) > 1:
        of = ", ".join(each.name for each in inputs if each.pf.identity.simulated is not False)
        kind = "simulated" if True in marks else "perhaps simulated"
        yield f"identity.simulated: {of} is {kind}, so the whole result counts as that."


def _other_units(inputs: Sequence[MergeInput]) -> Iterator[str]:
    units: dict[str, dict[str, str]] = {}
    for each in inputs:
        for symbol, unit in units_of(each.pf):
            units.setdefault(symbol, {}).setdefault(unit, each.name)
    for symbol, found in units.items():
        if len(found) > 1:
            listed = ", ".join(f"{unit} in {name}" for unit, name in found.items())
            yield f"{symbol} is in {listed}: each section keeps its unit, and constant load converts."
