"""Findings of the check of a parameter file, and verdicts of its parts: findings, sentences, refusal of an export."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from ...core.display import Displayable
from ...core.errors import GateError
from ...core.rounding import count
from ...core.text import shortened
from ...core.verdict import DO_NOT_USE, LEVELS, USABLE
from ..sections.base import VerdictSection

if TYPE_CHECKING:
    from pandas import DataFrame

    from ..file import ParameterFile


VERDICT: Final = "verdict"  # name of the findings on verdicts
SHOWN = 3  # reasons in a finding; the others are counted


@dataclass(frozen=True, slots=True, repr=False)
class FileFinding(Displayable):
    """Result of one check.

    Attributes
    ----------
    name : str
        Name of the check.
    passed : bool or None
        None where it could not be tested, or is a remark that does not fail the file.
    words : str
        One sentence.
    """

    name: str
    passed: bool | None
    words: str


@dataclass(frozen=True, slots=True, repr=False)
class CheckReport(Displayable):
    """All findings on a parameter file.

    Attributes
    ----------
    findings : tuple of FileFinding
        In the order of the checks.
    """

    findings: tuple[FileFinding, ...]

    @property
    def failed(self) -> tuple[FileFinding, ...]:
        """Findings that fail the file."""
        return tuple(f for f in self.findings if f.passed is False)

    @property
    def inconsistent(self) -> tuple[FileFinding, ...]:
        """Findings that fail the file apart from verdicts: a simulation may use what must not control a machine."""
        return tuple(f for f in self.failed if f.name != VERDICT)

    @property
    def ok(self) -> bool:
        """Whether no check failed; untested ones do not count."""
        return not self.failed

    def facts(self) -> dict[str, Any]:
        """The report for programs, without a name of its schema."""
        return {
            "ok": self.ok,
            "findings": [{"name": f.name, "passed": f.passed, "words": f.words} for f in self.findings],
        }

    def to_frame(self) -> "DataFrame":
        """One row per finding."""
        from pandas import DataFrame

        return DataFrame([(f.name, f.passed, f.words) for f in self.findings], columns=["name", "passed", "words"])


class Judged(NamedTuple):
    """A part of the file that has a verdict, or None where it was not judged; ``remedy`` leads to one."""

    where: str
    verdict: VerdictSection | None
    remedy: str


def judged_parts(pf: "ParameterFile", *, loop_only: bool = False) -> list[Judged]:
    """Laws, dynamics, drive, gains and force process of a file; of a loop, law of its limits, dynamics and gains."""
    loop = () if pf.load_line is None else (pf.load_line.law,)
    parts = [
        Judged(f"laws.{shortened(name)}", law.verdict, "fit the data again")
        for name, law in pf.laws.items()
        if not loop_only or name in loop
    ]
    if pf.dynamics is not None:
        parts.append(Judged("dynamics", pf.dynamics.verdict, "identify the record again"))
    if pf.drive is not None and not loop_only:
        parts.append(Judged("drive", pf.drive.verdict, "identify it again: fitmodels ident --as drive"))
    gains = getattr(
        pf.pi, "verdict", None
    )  # gains that were given have none: the simulation before an export judges them
    if isinstance(gains, VerdictSection):
        parts.append(Judged("pi", gains, "tune again"))
    if pf.adaptive_force is not None and not loop_only:
        remedy = "identify it again: fitmodels ident --as force-process"
        parts.append(Judged("adaptive_force", pf.adaptive_force.verdict, remedy))
    return parts


def check_verdicts(pf: "ParameterFile") -> Iterator[FileFinding]:
    """A finding for each verdict; what must not be used fails the file, a tool life does not."""
    for part in judged_parts(pf):
        if part.verdict is None:
            words = f"{part.where}: there is no verdict on how far it can be used; {part.remedy}."
            yield FileFinding(VERDICT, None, words)
        else:
            passed = {USABLE: True, DO_NOT_USE: False}.get(part.verdict.concern)
            yield FileFinding(VERDICT, passed, verdict_words(part.where, part.verdict))
    if pf.tool_life is not None and pf.tool_life.verdict is not None and pf.tool_life.verdict.concern > USABLE:
        yield FileFinding(VERDICT, None, verdict_words("tool_life", pf.tool_life.verdict))


def verdict_words(where: str, verdict: VerdictSection, shown: int = SHOWN) -> str:
    """The verdict of a part with its first reasons, one line.

    >>> verdict_words("laws.AW", VerdictSection(level="usable with reservations", reasons=["No edges."]))
    'laws.AW: usable with reservations. No edges.'
    """
    more = len(verdict.reasons) - shown
    further = [f"And {count(more, 'more reason')}: see the card."] if more > 0 else []
    return " ".join([f"{where}: {verdict.level}.", *verdict.reasons[:shown], *further])


def cautions(pf: "ParameterFile", *names: str) -> list[str]:
    """A sentence on each part of the file that is not usable without reservations, with all its reasons.

    ``names`` are responses of laws, ``dynamics``, ``drive``, ``pi`` and ``adaptive_force``; all parts without them.
    """
    sentences = []
    for part in judged_parts(pf):
        kind, _, law = part.where.partition(".")
        if names and (law or kind) not in names:
            continue
        what = (
            f"law of {law}"
            if law
            else {"dynamics": "dynamics", "drive": "drive", "pi": "gains"}.get(kind, "force process")
        )
        if part.verdict is None:
            sentences.append(f"No verdict on the {what}: it is not known how far it can be used; {part.remedy}.")
        elif part.verdict.concern > USABLE:
            sentences.append(" ".join([f"Verdict on the {what}: {part.verdict.level}.", *part.verdict.reasons]))
    return sentences


def require_verdicts(
    pf: "ParameterFile", accepted: bool, *, loop_only: bool = False, only: Collection[str] = ()
) -> tuple[str, ...]:
    """Raise where a part that is exported must not be used or has no verdict, unless that is accepted.

    Parameters
    ----------
    pf : ParameterFile
    accepted : bool
        Whether such parts are exported all the same.
    loop_only : bool
        As of `judged_parts`.
    only : collection of str
        Responses of the laws, or names of sections, that are used; all parts without it.

    Returns
    -------
    tuple of str
        One line on each part that is not usable without reservations, for the exported file.

    Raises
    ------
    GateError
        A part must not be used for control, or its verdict is not known.
    """
    laws = {f"laws.{shortened(name)}" for name in only} | set(only)
    parts = [part for part in judged_parts(pf, loop_only=loop_only) if not laws or part.where in laws]
    life = (
        pf.tool_life if only else None
    )  # a life that cannot be is a wear law in another unit: its limit has no effect
    if life is not None and life.verdict is not None and life.wear in only and life.verdict.concern == DO_NOT_USE:
        parts.append(Judged("tool_life", life.verdict, "fit the data again"))
    refused = [part for part in parts if part.verdict is None or part.verdict.concern == DO_NOT_USE]
    if refused and not accepted:
        raise GateError(_refusal(*refused))
    lines = []
    for part in parts:
        level = "no verdict" if part.verdict is None else part.verdict.level
        if level != LEVELS[USABLE]:
            lines.append(f"{'VERDICT ACCEPTED - ' if part in refused else ''}{part.where} - {level}")
            lines += () if part.verdict is None else part.verdict.reasons
    return tuple(lines)


def _refusal(part: Judged, *others: Judged) -> str:
    if part.verdict is None:
        found = f"{part.where} has no verdict, so it is not known whether it can be used for control; {part.remedy}"
    else:
        found = verdict_words(part.where, part.verdict, 1).rstrip(".")
    more = f" The same holds for {', '.join(other.where for other in others)}: see `fitmodels check`." if others else ""
    return (
        f"not exported: {found}.{more} --accept-verdict exports it all the same and records that in the exported file."
    )


def worn_past_window(pf: "ParameterFile") -> tuple[float | None, str]:
    """Share of further tools that are worn past the window when they reach the lower feed limit, and a sentence.

    The share is None where it is not known; the sentence is empty without settings of constant load.
    """
    from ..sections.base import Covariance
    from ..setting_rules import LOAD_FORMS, feed_limit, worn_below

    line = pf.load_line
    if line is None:
        return None, ""
    law, high, unit = pf.laws.get(line.law), line.window[1], line.unit_wear
    what = f"worn past {high:g} {unit} when they reach the lower feed limit"
    if law is None or law.form not in LOAD_FORMS or law.factors[-1].unit != unit:
        return None, f"Share of tools {what}: not known, the file has no load law of its settings."
    if not isinstance(law.uncertainty, Covariance) or law.residual_se is None:
        rule = "; about half, as the limit stands at the top of the window" if line.lower.wear >= high else ""
        return None, f"Share of tools {what}: not known, the law of {law.response} has no uncertainty{rule}."
    share = 1 - worn_below(law, line.reference, line.lower.value, high, line.by)
    words = f"{_percent_of(share)} of further tools are {what} (by the scatter of the law of {law.response})"
    middle = (line.window[0] + high) / 2
    if line.lower.wear > middle:
        feed = feed_limit(law, line.reference, middle, by=line.by).value
        other = 1 - worn_below(law, line.reference, feed, high, line.by)
        words += f"; {_percent_of(other)} with the limit at the middle of the window, --wear-limit {middle:g}{unit}"
    return share, f"{words}."


def _percent_of(share: float) -> str:
    return "less than 1 %" if share < 0.005 else f"{100 * share:.0f} %"
