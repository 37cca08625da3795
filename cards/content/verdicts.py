"""Verdicts of a parameter file, and the rows and edges that its checks find wrong, as parts of a card."""

import shlex
from collections.abc import Iterable, Sequence

from ...core.files import STANDARD_INPUT
from ...core.rounding import format_plain
from ...core.verdict import DO_NOT_USE, LEVELS, RESERVATIONS, USABLE
from ...parameters import LawSection, ParameterFile
from ...parameters.sections.base import VerdictSection
from ...parameters.sections.law_parts import SuspectValues
from .parts import SuspectPart, VerdictPart

NOT_JUDGED = "not judged"
NO_VERDICT = (
    "The file holds no verdict on it: it was written by hand or by an earlier version, or no check could be made; "
    "fit the data again."
)
# what a verdict is of, besides laws
TOOL_LIFE, DYNAMICS, DRIVE, GAINS, ADAPTIVE_FORCE = "tool life", "dynamics", "feed drive", "gains", "adaptive force"
LISTED = 12  # edges or lines of a suspect that are named


def verdict_part(of: str, verdict: VerdictSection | None) -> VerdictPart:
    """The verdict on a result; of a file that holds none, that it was not judged.

    >>> verdict_part("AW", None).words
    'not judged'
    """
    if verdict is None:
        return VerdictPart(of=of, level=None, words=NOT_JUDGED, reasons=(NO_VERDICT,))
    return VerdictPart(
        of=of,
        level=LEVELS.index(verdict.level),
        words=verdict.level,
        reasons=verdict.reasons,
        checked=verdict.checked,
        not_checked=verdict.not_checked,
    )


def worst(verdicts: Iterable[VerdictPart]) -> str:
    """The worst of several verdicts in words: do not use, not judged, reservations, usable; empty where there are none.

    >>> worst([verdict_part("AW", None), verdict_part("P", VerdictSection(level="usable inside the tested region"))])
    'not judged'
    """
    order = (USABLE, RESERVATIONS, None, DO_NOT_USE)
    found = sorted(verdicts, key=lambda verdict: order.index(verdict.level))
    return found[-1].words if found else ""


def sorted_by_level(verdicts: Sequence[VerdictPart]) -> list[tuple[str, list[str]]]:
    """Each level in words with the results that have it, the worst level first.

    >>> sorted_by_level([verdict_part("AW", None), verdict_part("P", None)])
    [('not judged', ['AW', 'P'])]
    """
    named = {words: [verdict.of for verdict in verdicts if verdict.words == words] for words in (*LEVELS, NOT_JUDGED)}
    order = (LEVELS[DO_NOT_USE], NOT_JUDGED, LEVELS[RESERVATIONS], LEVELS[USABLE])
    return [(words, named[words]) for words in order if named[words]]


def verdicts_of(pf: ParameterFile) -> tuple[VerdictPart, ...]:
    """The verdicts on the laws, tool life, dynamics, feed drive, gains and settings of adaptive force in a file.

    Gains have one where a tuning judged them; those that were given have none, as a controller of a machine has none.
    """
    gains = None if pf.pi is None or pf.pi.verdict is None else pf.pi
    others = (
        (TOOL_LIFE, pf.tool_life), (DYNAMICS, pf.dynamics), (DRIVE, pf.drive), (GAINS, gains),
        (ADAPTIVE_FORCE, pf.adaptive_force),
    )  # fmt: skip
    laws = (verdict_part(response, law.verdict) for response, law in pf.laws.items())
    return (*laws, *(verdict_part(name, section.verdict) for name, section in others if section is not None))


def law_cautions(pf: ParameterFile, responses: Iterable[str]) -> list[str]:
    """A clause on each of these laws that is not usable without reservations."""
    found = (verdict_part(name, pf.laws[name].verdict) for name in responses if name in pf.laws)
    return [f"the verdict on the law of {one.of} is: {one.words}" for one in found if one.level != USABLE]


def suspect_parts(law: LawSection, pf: ParameterFile) -> tuple[SuspectPart, ...]:
    """The rows and edges that the checks of a law find wrong, each once, with the command that corrects them."""
    found: dict[tuple[str, tuple[str, ...], tuple[int, ...]], SuspectValues] = {}
    for suspect in (suspect for check in law.checks.values() if check.concern for suspect in check.suspects):
        key = (suspect.column, suspect.edges, suspect.lines)
        if key not in found or (suspect.correction and not found[key].correction):
            found[key] = suspect
    return tuple(_suspect(suspect, _command(pf)) for suspect in found.values())


def _suspect(suspect: SuspectValues, command: str) -> SuspectPart:
    remedy = _remedy(suspect)
    what = f"{suspect.column} of {_place(suspect.edges, suspect.lines)}"
    cause = suspect.cause or ("" if suspect.correction else "no known mistake explains it; check the record")
    how = "corrected with" if suspect.correction else "left out with"
    return SuspectPart(
        column=suspect.column,
        edges=suspect.edges,
        lines=suspect.lines,
        words=f"{what}{f' ({cause})' if cause else ''}, {how}",
        remedy=remedy,
        command=f"{command} {remedy}",
    )


def _remedy(suspect: SuspectValues) -> str:
    if suspect.correction:
        return f"--correct {shlex.quote(suspect.correction)}"
    target = ",".join(suspect.edges) if suspect.edges else f"lines {','.join(map(str, suspect.lines))}"
    return f"--leave-out {shlex.quote(target)}"


def _command(pf: ParameterFile) -> str:
    """The command that made the file without ``--force``, or the shortest that reads its data."""
    made, file = pf.provenance.command, pf.provenance.data_file
    if made is not None and made.startswith("fitmodels ") and "\n" not in made:
        return made.replace(" --force", "")
    return f"fitmodels {'-' if file == STANDARD_INPUT else shlex.quote(file or 'FILE')}"


def without_words(law: LawSection) -> str:
    """The scatter of the law without the rows and edges that its checks find wrong, next to that of all rows."""
    other = law.without
    if other is None:
        return ""
    r2 = (
        "" if other.r2 is None or law.statistics.r2 is None else f"R² {other.r2:.3f} instead of {law.statistics.r2:.3f}"
    )
    se = "" if other.residual_se is None or law.residual_se is None else (
        f"residual SE {format_plain(other.residual_se, 3)} instead of {format_plain(law.residual_se, 3)} "
        f"{'in ln' if law.error == 'multiplicative' else law.unit}"
    )  # fmt: skip
    figures = ", ".join(filter(None, (r2, se)))
    return (
        f"Without {_place(other.edges, other.lines)} ({other.n} of {law.n} rows): {figures or 'the law fitted again'}; "
        'its coefficients are in the column "without the suspects".'
    )


def _place(edges: Sequence[str], lines: Sequence[int]) -> str:
    """``edges E07, E11 and lines 3, 4``."""
    named = (("edge", list(edges)), ("line", list(map(str, lines))))
    return " and ".join(f"{kind}{'s' if len(names) > 1 else ''} {_listed(names)}" for kind, names in named if names)


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:LISTED]) + (f" and {len(names) - LISTED} more" if len(names) > LISTED else "")
