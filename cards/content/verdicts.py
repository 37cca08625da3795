"""Verdicts of a parameter file with remedies, and the rows and edges that its checks find wrong, as parts of a card."""

import re
import shlex
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

from ...core.files import STANDARD_INPUT
from ...core.rounding import format_plain
from ...core.text import line_spans
from ...core.verdict import DO_NOT_USE, LEVELS, NOT_JUDGED, RESERVATIONS, USABLE
from ...datasets.options import TAKEN, chosen, merged, without
from ...parameters import LawSection, ParameterFile
from ...parameters.sections.base import VerdictSection
from ...parameters.sections.law_parts import LawCheck, SuspectValues
from .parts import RemedyPart, SuspectPart, VerdictPart

NO_VERDICT = (
    "The file holds no verdict on it: it was written by hand or by an earlier version, or no check could be made; "
    "fit the data again."
)
# what a verdict is of, besides laws
TOOL_LIFE, DYNAMICS, DRIVE, GAINS, ADAPTIVE_FORCE = "tool life", "dynamics", "feed drive", "gains", "adaptive force"
LISTED = 12  # edges or lines of a suspect that are named
# Remedy of a check that has a concern: what to do, and the command that does it ("" where none does)
REMEDIES: Mapping[str, tuple[str, str]] = MappingProxyType({
    "copies": ("Check the record; leave copied rows out with --leave-out 'lines ...'.", ""),
    "sensor limit": ("Leave these rows out; measure with a wider range.", ""),
    "limited readings": ("Measure finer, or from a larger value on.", ""),
    "time exponent": ("Predict only inside the times tested, and compare other forms of the law.", "compare"),
    "time between edges": ("Check unit and start of the times of each edge.", "look"),
    "time within edges": ("Check that t = 0 is a new edge; compare other forms of the law.", "compare"),
    "time restarts": ("Give t as the time in cut since the edge was new.", "look"),
    "exponents": ("Check column and unit of the factor.", "look"),
    "fixed exponents": ("Test several values of the factor.", "next"),
    "possible values": ("Check columns and units; compare other forms of the law.", "look"),
    "predictive use": ("Run more tests, first at the ends of the ranges.", "next"),
    "missing conditions": ("Add the condition as a column, or its constant value with --value.", ""),
    "aliased columns": ("Test conditions in which the column and the factor do not vary together.", "next"),
    "form": ("Compare other forms of the law.", "compare"),
    "curvature": ("Compare other forms of the law, and stay inside the tested conditions.", "compare"),
    "single edges": ("Repeat the conditions of this edge on another one.", ""),
    "prediction": ("Test more edges.", "next"),
    "collinearity": ("Test conditions in which these factors do not vary together.", "next"),
    "signal to noise": ("Test wider ranges of the conditions, or more edges.", "next"),
    "scale of the response": ("Compare other forms and error structures of the law.", "compare"),
    "order within edges": ("Use intervals by edge; compare forms with another course over time.", "compare"),
    "order of tests": ("Repeat the first test; cut tests in random order, numbered in a column 'run'.", "next"),
    "even scatter": ("Allow for wider intervals where the scatter is larger; compare other forms.", "compare"),
    "even scatter of edges": ("Repeat the conditions that scatter more on other edges.", ""),
    "normality": ("Check the rows with the largest residuals (figures/residuals.png).", "look"),
    "normality of edges": ("Repeat the conditions of the edges with the largest residuals.", ""),
    "error structure": ("Compare other forms and error structures of the law.", "compare"),
    "competing forms": ("Compare the forms, and keep the one that predicts best.", "compare"),
    "number of edges": ("Test more edges.", "next"),
    "gauge error": ("Measure the wear more precisely, or as the mean of several readings.", ""),
    "priors": ("Correct the prior or its width, or leave --priors out.", ""),
    "agreement": ("Use the cluster-robust interval; further edges decide between the estimates.", "next"),
    "reading": ("Look at the columns as they were read, and correct them.", "look"),
    "run-outs": ("Run tests until the edges are worn out.", "next"),
    "longest lives": ("Mark lives that did not end: 60+, or a column run-out.", ""),
    "extrapolated lives": ("Run tests until the edges are worn out.", "next"),
    "single lives": ("Repeat the test that it rests on.", "next"),
})  # fmt: skip
OF_LIVES = REMEDIES["longest lives"][0]  # before any other: other reasons may follow from run-outs that are not marked
# Reasons of checks in a few words, where these differ from the name of the check
SHORT: Mapping[str, str] = MappingProxyType({
    "copies": "copied rows", "sensor limit": "sensor at its limit",
    "limited readings": "readings in steps or at a floor",
    "time exponent": "time exponents differ", "time between edges": "times of edges differ",
    "time within edges": "not a power of time", "exponents": "unusual exponent",
    "fixed exponents": "exponent not fitted",
    "possible values": "impossible values", "predictive use": "predicts poorly",
    "missing conditions": "condition missing",
    "aliased columns": "a column changes with a factor",
    "form": "lack of fit", "collinearity": "factors vary together", "signal to noise": "scatter hides the effect",
    "prediction": "rests on few edges", "single edges": "rests on one edge",
    "scale of the response": "curved or uneven",
    "order within edges": "rows of an edge alike", "order of tests": "order of the tests",
    "even scatter": "scatter not even",
    "even scatter of edges": "scatter not even", "normality": "scatter not normal", "reading": "doubts about the data",
    "normality of edges": "scatter not normal", "competing forms": "another form predicts better",
    "number of edges": "edges not named", "agreement": "estimates disagree",
    "priors": "prior contradicts the tests",
    "longest lives": "run-outs not marked",
    "extrapolated lives": "lives extrapolated", "single lives": "rests on one life", "run-outs": "many run-outs",
})  # fmt: skip
OF_EDGES = {"Only": "few edges", "No inference by edge": "no inference by edge"}  # beginnings of reasons
# Remedies of reasons that are of no check of a law, by their beginnings
OF_REASONS = (
    (("The life of", "No test reached", "95 % of lives", "The 95 % interval of the time"),
     "Run edges until the wear reaches the criterion.", "next"),
    (("No edge is named", "The file names no edges"), "Add a column 'edge' with a number for each cutting edge.", ""),
    (("P rises less than that of a cut", "P was measured without a cut"),
     "Measure the power in air at each speed, and subtract it.", ""),
    (("Taylor's n", "Life rises", "A life of"), "Check columns and units of speed, time and wear.", "look"),
)  # fmt: skip
OPTION = re.compile(r"""--(?:by|law|form|correct|leave-out) (?:"[^"]*"|'[^']*'|[^\s"'();,]*[^\s"'();,.])""")
CORRECTING = re.compile(r" --(by|law|form|correct|leave-out) ")  # in words of remedies that remove a reason
SUSPECTED = "Compare with the record: correct the values, or leave them out."


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
    laws = (law_verdict(pf, law) for law in pf.laws.values())
    found = (verdict_part(name, section.verdict) for name, section in others if section is not None)
    return (*laws, *(with_remedies(pf, one) for one in found))


def law_verdict(pf: ParameterFile, law: LawSection) -> VerdictPart:
    """The verdict on a law, with a remedy for each of its reasons."""
    return with_remedies(pf, verdict_part(law.response, law.verdict), law.checks)


def with_remedies(
    pf: ParameterFile, verdict: VerdictPart, checks: Mapping[str, LawCheck] = MappingProxyType({})
) -> VerdictPart:
    """The verdict with a remedy for each of its reasons, None where none is known; ``checks`` are those of its law."""
    by_reason = {check.verdict: (name, check) for name, check in checks.items() if check.concern}
    remedies = tuple(_remedy_of(pf, reason, *by_reason.get(reason, ("", None))) for reason in verdict.reasons)
    return verdict.model_copy(update={"remedies": remedies})


def _first_remedy(pf: ParameterFile, reason: str) -> str:
    """Options that settle the first doubt of the reading in a reason that has such options; empty without one."""
    doubts = () if pf.reading is None else pf.reading.doubts
    return next((one.remedy for one in doubts if one.remedy and one.sentence.rstrip(".") in reason), "")


def _remedy_of(pf: ParameterFile, reason: str, name: str, check: LawCheck | None) -> RemedyPart | None:
    """The remedy of one reason: the option that it names, the correction of suspects, or that of its check."""
    if check is not None and check.suspects:
        remedies = " ".join(dict.fromkeys(_remedy(suspect) for suspect in check.suspects))
        return RemedyPart(words=SUSPECTED, command=_command(pf, remedies))
    if option := OPTION.search(reason):
        words = "If the record confirms it" if name.startswith("time") else "Fit the law so"
        refitted = "" if option[0].startswith(("--correct", "--leave-out")) else " --force"  # not a former reading
        return RemedyPart(words=f"{words}: {option[0]}.", command=_command(pf, f"{option[0]}{refitted}"))
    if name == "reading" and (option_of_doubt := _first_remedy(pf, reason)):
        words = f"If this is so, read the file with {option_of_doubt}."
        return RemedyPart(words=words, command=_command(pf, option_of_doubt))
    if name == "number of edges" and (column := reason.removesuffix(".").partition("name its edges with --edge ")[2]):
        edge = f"--edge {shlex.quote(column)}"
        return RemedyPart(words=f"If {column} numbers the edges: {edge}.", command=_command(pf, edge))
    if reason == NO_VERDICT:
        return RemedyPart(words="Fit the data again.", command=_command(pf))
    found = next((pair for heads, *pair in OF_REASONS if reason.startswith(heads)), None) or REMEDIES.get(name)
    return None if found is None else RemedyPart(words=found[0], command=found[1] and follow_up(pf, found[1]))


def follow_up(pf: ParameterFile, name: str) -> str:
    """The command ``name`` on the data of the file, read with the same options; empty of standard input.

    >>> from fitmodels import parameters
    >>> pf = parameters.collect(tool="T", work="W", command="fitmodels d.csv --map V=col2 --draws 1000 --full")
    >>> follow_up(pf, "next")
    'fitmodels next d.csv --map V=col2'
    """
    words = shlex.split(_command(pf))[1:]
    found = chosen(words, TAKEN[name])
    if "-" in words or not found:
        return ""
    return shlex.join(["fitmodels", name, *found, *(_of_pair(pf) if name == "next" else ())])


def _of_pair(pf: ParameterFile) -> list[str]:
    """Options that name the pair of the file where its data hold several."""
    pair = pf.provenance.options.get("pair")
    if not isinstance(pair, dict):
        return []
    named = ((f"--{role}", str(name)) for role, name in pair.items())
    return [word for option, name in named for word in ([f"{option}={name}"] if name[:1] == "-" else [option, name])]


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
    return tuple(_suspect(suspect, pf) for suspect in found.values())


def _suspect(suspect: SuspectValues, pf: ParameterFile) -> SuspectPart:
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
        command=_command(pf, remedy),
    )


def _remedy(suspect: SuspectValues) -> str:
    if suspect.correction:
        return f"--correct {shlex.quote(suspect.correction)}"
    target = ",".join(suspect.edges) if suspect.edges else f"lines {','.join(line_spans(suspect.lines))}"
    return f"--leave-out {shlex.quote(target)}"


def _command(pf: ParameterFile, remedy: str = "") -> str:
    """The command that made the file, or the shortest that reads its data, with the options of a remedy."""
    made, file = pf.provenance.command, pf.provenance.data_file
    words = ["-" if file == STANDARD_INPUT else file or "FILE"]
    if made is not None and made.startswith("fitmodels ") and "\n" not in made:
        words = shlex.split(made)[1:]
        words = _of_its_file(words[1:], file) if words[:1] == ["batch"] else without(words, "screen")
    return shlex.join(["fitmodels", *merged(words, shlex.split(remedy))])


def _of_its_file(words: Sequence[str], file: str | None) -> list[str]:
    """Words of the main command for the one file of a pair that a batch has fitted; joined from several, for all.

    >>> _of_its_file(["shop", "--jobs", "1", "--criterion", "0.2"], "a.csv")
    ['shop/a.csv', '--criterion', '0.2']
    """
    source, *given = chosen(words, TAKEN["batch"]) or ["FILE"]
    is_in_folder = file and " + " not in file and " other files" not in file and Path(source).name != file
    return [f"{source.rstrip('/')}/{file}" if is_in_folder else source, *given]


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


def with_reasons(verdicts: Sequence[VerdictPart]) -> list[VerdictPart]:
    """The verdicts with reasons, the worst first."""
    order = (DO_NOT_USE, None, RESERVATIONS)
    found = (one for one in verdicts if one.level != USABLE and one.reasons)
    return sorted(found, key=lambda one: order.index(one.level))


def remedy_command(verdicts: Sequence[VerdictPart]) -> list[str]:
    """Words of the command that is shown as the remedy of the largest reservation; empty without one."""
    held = with_reasons(verdicts)
    remedy = main_reason(held[0])[0][1] if held else None
    return shlex.split(remedy.command) if remedy else []


def measured_first(pf: ParameterFile, computed: Collection[str]) -> ParameterFile:
    """The file with the laws of measured responses before those of computed ones."""
    order = sorted(pf.laws, key=lambda name: name in computed)
    return pf.model_copy(update={"laws": {name: pf.laws[name] for name in order}})


def short_reasons(law: LawSection, verdict: VerdictPart) -> list[str]:
    """The reasons of the verdict on a law in two or three words each, in their order."""
    by_reason = {check.verdict: name for name, check in law.checks.items() if check.concern}
    names = (
        next((words for head, words in OF_EDGES.items() if reason.startswith(head)), "") or by_reason.get(reason, "")
        for reason in verdict.reasons
    )
    return list(dict.fromkeys(SHORT.get(name, name) for name in names if name))


def main_reason(verdict: VerdictPart) -> tuple[tuple[str, RemedyPart | None], ...]:
    """The first reason with its remedy; of reservations the first that an option removes, if there is one.

    Run-outs that are not marked stay first. Empty where there is no reason.
    """
    found = verdict.reservations
    of_lives = any(remedy is not None and remedy.words == OF_LIVES for _, remedy in found[:1])
    if verdict.level == RESERVATIONS and not of_lives:
        done = [(why, remedy) for why, remedy in found if remedy and _corrects(remedy)]
        return (*done, *found)[:1]
    return found[:1]


def _corrects(remedy: RemedyPart) -> bool:
    """Whether the command of a remedy removes its reason by an option."""
    return remedy.command != "" and (remedy.words == SUSPECTED or CORRECTING.search(remedy.words) is not None)
