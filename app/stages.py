"""Commands run on a parameter file: forms with their state and last values, and what a new fit has lost."""

import dataclasses
import shlex
from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

from .command_forms import ENGAGEMENT, FOLLOWING, Action, Subject, actions, subject_of
from .command_words import DEFAULT
from .jobs import Job
from .messages import colour
from .options import command_of
from .project import Entry, Project, Step

ADDING: Final = ("limits", "costs", "ident", "settings", "tune")  # commands that add to a parameter file
SECTIONS: Final = {"limits": "limits", "costs": "costs", "ident": "dynamics", "settings": "load_line", "tune": "pi"}
OF_CONTROL: Final = ("settings", "ident", "tune")  # forms of what a control of constant load is made from
USES: Final[Mapping[str, Sequence[str]]] = {  # commands whose later run makes the result of another outdated
    "optimum": ("limits", "costs"), "tune": ("ident", "settings"), "replay": ADDING, "card": ADDING, "check": ADDING,
    "export": ADDING,
}  # fmt: skip
KEPT_OF_SETTINGS: Final = frozenset(f"--{one}" for one in (*(name for name, *_ in ENGAGEMENT), "idle", "on-fault"))
MOST_TOOLS: Final = 0.9  # fewer within the wear of the tool change put settings in doubt
LIMITS_OF_GAINS: Final = ("low", "high", "unit")


@dataclasses.dataclass(frozen=True, slots=True)
class State:
    """Whether a form was run, its main result, and why it is outdated; the colour is a class of the style sheet."""

    words: str = "not done"
    colour: str = ""
    outdated: str = ""


def _parts(words: Sequence[str]) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Each argument of a command by the option that it sets, with its words.

    >>> list(_parts(["P=7kW", "--idle", "0.12", "--today", "V=100", "--force"]))
    [('P', ('P=7kW',)), ('--idle', ('--idle', '0.12')), ('--today V', ('--today', 'V=100')), ('--force', ('--force',))]
    """
    rest = list(words)
    while rest:
        one: tuple[str, ...] = (rest.pop(0),)
        if one[0].startswith("--") and "=" not in one[0] and rest and not rest[0].startswith("--"):
            one = (*one, rest.pop(0))
        name, equals, _ = one[-1].partition("=")
        yield f"{one[0]} {name}" if len(one) > 1 and equals else one[0].partition("=")[0], one


def with_kept(former: Sequence[str], words: Sequence[str]) -> tuple[str, ...]:
    """A command with what its file keeps of a former one: limits and costs by name, the engagement of settings.

    >>> " ".join(with_kept(["limits", "p", "P=7kW", "f=0.1:0.4", "--force"], ["limits", "p", "P=5kW", "--force"]))
    'limits p P=5kW f=0.1:0.4 --force'
    """
    own, by_name = dict(_parts(words[2:])), words[0] in ("limits", "costs")
    keeps = KEPT_OF_SETTINGS if words[0] == "settings" else ()
    kept = [
        word
        for key, part in _parts(former[2:])
        if key not in own and (key in keeps or (by_name and key[:2] != "--"))
        for word in part
    ]
    end = [word for word in words[2:] if word == "--force"]
    return (*words[:2], *(word for word in words[2:] if word != "--force"), *kept, *end)


def _is_fit(step: Step, entry: Entry) -> bool:
    """Whether a command has replaced the parameter files of a file."""
    words = step.words
    own = words[0] == entry.name or (words[:2] == ("ident", entry.name) and "--params" not in words)
    return own and "--force" in words


def _added(project: Project, entry: Entry) -> tuple[dict[tuple[str, str], tuple[str, ...]], ...]:
    """Commands that have added to the parameter files of a file since its last fit, and before it."""
    top, found = f"{entry.stem}-fit/", dict[tuple[str, str], tuple[str, ...]]()
    replaced: dict[tuple[str, str], tuple[str, ...]] = {}
    for step in project.steps:
        if _is_fit(step, entry):
            replaced, found = {**replaced, **found}, {}
        path = next((word for word in step.words[1:] if word.startswith(top)), "")
        if step.words[0] in ADDING and path and step.code == 0:
            key = step.words[0], path
            found[key] = with_kept(found.pop(key, ()), step.words)
    return found, replaced


def to_repeat(project: Project, entry: Entry) -> list[tuple[str, ...]]:
    """Commands that added to a parameter file of an entry before it was replaced, in their order."""
    found, replaced = _added(project, entry)
    left = [
        words
        for (name, path), words in replaced.items()
        if (name, path) not in found
        and not subject_of(project.folder, entry.stem, path, ()).content.get(SECTIONS[name])
    ]
    return sorted(left, key=lambda words: ADDING.index(words[0]))


def last_used(project: Project, entry: Entry, path: str) -> dict[str, tuple[str, ...]]:
    """The last command of each form on a parameter file that succeeded, with what the file keeps of former ones."""
    found = {}
    for step in project.steps:
        if step.code == 0 and len(step.words) > 1 and (path in step.words or step.words[1] == entry.name):
            found[step.words[0]] = step.words
    added, replaced = _added(project, entry)
    return {**found, **{name: words for (name, of), words in {**replaced, **added}.items() if of == path}}


def values(action: Action, words: Sequence[str]) -> dict[str, str]:
    """Values of the fields of a form from the words of its command.

    >>> from .command_forms import Input
    >>> form = Action("x", "", "", (Input("V", "", "--today V={}"), Input("P", "", "P={}"), Input("r", "", "{}")))
    >>> values(form, ["x", "run.csv", "--today", "V=100", "P=7 kW"])
    {'V': '100', 'P': '7 kW', 'r': 'run.csv'}
    """
    found = {}
    for one in action.inputs:
        option, _, last = one.words.rpartition(" ")
        prefix = last.partition("{}")[0]
        if one.words == "{}":
            found[one.name] = words[1]
        elif "{}" not in one.words:
            found[one.name] = one.choices[-1][0] if one.words in words else ""
        elif option:
            of = [after for before, after in pairwise(words) if before == option]
            of += [word[len(option) + 1 :] for word in words if word.startswith(f"{option}=")]
            found[one.name] = next((value[len(prefix) :] for value in of if value.startswith(prefix)), "")
        else:
            found[one.name] = next((word[len(prefix) :] for word in words[2:] if word.startswith(prefix)), "")
        if found[one.name] == DEFAULT:
            found[one.name] = ""
    return found


def filled(project: Project, entry: Entry, of: Subject) -> list[Action]:
    """The forms of a parameter file with the values last used.

    The limits of the gains are those of the constant load where that was set after them, or none were used.
    """
    used = last_used(project, entry, of.params)
    is_older = _is_later(project, of.params, "settings", "tune")
    made = []
    for action in actions(of):
        given = values(action, used[action.name]) if action.name in used else {}
        if action.name == "tune":
            unset = [name for name in LIMITS_OF_GAINS if is_older or not given.get(name)]
            given = {name: value for name, value in given.items() if name not in unset}
        inputs = tuple(
            dataclasses.replace(one, value=given[one.name]) if one.name in given else one for one in action.inputs
        )
        made.append(dataclasses.replace(action, inputs=inputs))
    return made


def with_values(action: Action, given: Mapping[str, str]) -> Action:
    """A form that is filled in with the fields of a run."""
    inputs = tuple(dataclasses.replace(one, value=given.get(one.name, one.value)) for one in action.inputs)
    return dataclasses.replace(action, inputs=inputs)


def emptied(action: Action, given: Mapping[str, str]) -> list[str]:
    """Fields of a filled form that its file keeps, and that are empty now."""
    kept = KEPT_OF_SETTINGS if action.name == "settings" else frozenset()
    was = (one for one in action.inputs if one.value and f"--{one.name}" in kept)
    return [one.name for one in was if one.name in given and not given[one.name].strip()]


def older(project: Project, entry: Entry, results: Mapping[str, Path]) -> dict[str, tuple[str, ...]]:
    """Results that are older than the parameter files of the fit, with the command that made them, where it is known.

    The picture of a reading is none of them: it is drawn again when the file is read. A card is of the file beside it.
    """
    top, made = f"{entry.stem}-fit/", {name: time_of(path) for name, path in results.items()}
    fitted = [name for name in made if name.startswith(top) and name.endswith("/params.json")]
    newest = max((made[name] for name in fitted), default=0.0)
    others = [name for name in made if not name.startswith(top) and name != f"{entry.stem}-look.png"]
    return {name: _command_of(project, name) for name in others if made[name] < newest} | _older_cards(made, fitted)


def _older_cards(made: Mapping[str, float], fitted: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Cards that are older than the parameter file beside them, with the command that makes them again."""
    cards = {name.replace("params.json", card): name for name in fitted for card in ("card.html", "card.json")}
    return {name: ("card", of, "--force") for name, of in cards.items() if made.get(name, made[of]) < made[of]}


def _command_of(project: Project, result: str) -> tuple[str, ...]:
    """The last command that wrote a file, or its folder; empty where none is known."""
    for step in reversed(project.steps):
        targets = [after for word, after in pairwise(step.words) if word in ("--out", "--figure")]
        if step.code == 0 and any(result == one or result.startswith(f"{one}/") for one in targets):
            return step.words
    return ()


def files_of(project: Project, entry: Entry, results: Mapping[str, Path]) -> dict[str, Any]:
    """Results of the present settings and of former ones, those older than the fit, and commands that it has undone."""
    current, former = current_files(project, entry)
    folders = tuple(path.removesuffix("params.json") for path in former)
    left = sorted(name for name in results if folders and (not current or name.startswith(folders)))
    found = {"results": sorted(set(results) - set(left)), "left": left, "older": older(project, entry, results)}
    return {**found, "to_repeat": to_repeat(project, entry)}


def current_files(project: Project, entry: Entry) -> tuple[dict[str, Mapping[str, Any]], dict[str, Mapping[str, Any]]]:
    """Parameter files that the command of a file wrote, and those of former options, with their contents.

    One that cannot be read counts as written: the commands refuse it and name the reason.
    """
    every = {path: subject_of(project.folder, entry.stem, path, ()).content for path in project.parameter_files(entry)}
    typed_now = shlex.join(["fitmodels", *command_of(entry)])
    former = {path: content for path, content in every.items() if content and _command_in(content) != typed_now}
    return {path: content for path, content in every.items() if path not in former}, former


def _command_in(content: Mapping[str, Any]) -> str:
    """The command that a parameter file is of; empty where it names none."""
    provenance = content.get("provenance")
    return str(provenance.get("command") or "") if isinstance(provenance, dict) else ""


def has_added(project: Project, entry: Entry) -> bool:
    """Whether something was added to the parameter files of a file that its fit does not write."""
    current, former = current_files(project, entry)
    files = current or former
    is_record = all(not content.get("laws") for content in files.values())
    return not is_record and any(content.get(one) for content in files.values() for one in SECTIONS.values())


def time_of(path: Path) -> float:
    """Time at which a file was written, s since 1970; 0 where a command has removed it since."""
    try:
        return path.stat().st_mtime
    except OSError:
        return 0.0


def _is_later(project: Project, path: str, first: str, second: str) -> bool:
    """Whether the last run of a command on a file came after the last of another."""
    runs = [step.words[0] for step in project.steps if step.code == 0 and path in step.words]
    return first in runs and second not in runs[len(runs) - runs[::-1].index(first) :]


def states(project: Project, entry: Entry, of: Subject, running: Collection[str] = ()) -> dict[str, State]:
    """State of each form of a parameter file; ``running`` are the commands on it that have not ended."""
    forms = [one for one in actions(of) if one.is_form]
    titles, used = {one.name: one.title for one in forms}, last_used(project, entry, of.params)
    lost = {words[0] for words in to_repeat(project, entry) if of.params in words}
    return {
        name: State("running", "doubt") if name in running else _state(project, entry, of, name, titles, used, lost)
        for name in titles
    }


def _state(
    project: Project, entry: Entry, of: Subject, name: str, titles: Mapping[str, str],
    used: Mapping[str, Sequence[str]], lost: Collection[str],
) -> State:  # fmt: skip
    """State of one form; a refusal after a former result names the one that the file keeps."""
    runs = [k for k, step in enumerate(project.steps) if _is_on(step, entry, of, name)]
    own = [k for k in runs if _counts(project.steps[k], entry, name)]
    is_refused = bool(runs) and project.steps[runs[-1]].code != 0
    there = of.content.get(SECTIONS[name]) if name in SECTIONS else own
    if name in lost:
        return State("outdated", "doubt", "the laws were fitted again, and it is not in the file any more")
    if not there:
        return State("last run refused", "bad") if is_refused else State()
    why = _why_outdated(project.steps[own[-1] + 1 :] if own else (), entry, of, name, titles)
    if is_refused:
        kept = _result(project, of, name, used.get(name, ())) if name in SECTIONS else ""
        words = f"last run refused; the file keeps {kept}" if kept else "refused"
        return State(f"{words}; outdated" if why else words, "bad", why)
    if why := why or _older_words(project, entry, of, name):
        return State("outdated", "doubt", why)
    words, section = _result(project, of, name, used.get(name, ())), of.content.get(SECTIONS.get(name, "")) or {}
    level = _level(section)
    if colour(level) in ("bad", "doubt"):
        return State(f"{level}: {words}", colour(level))
    share = section.get("probability") if name == "settings" else 1.0
    shown = "good" if isinstance(share, int | float) and share >= MOST_TOOLS else "doubt"
    return State(f"done: {words}" if words else "done", shown)


def _level(section: object) -> str:
    """Level of the verdict on a section of a parameter file; empty where it has none."""
    verdict = section.get("verdict") if isinstance(section, Mapping) else None
    return str(verdict.get("level") or "") if isinstance(verdict, Mapping) else ""


def _older_words(project: Project, entry: Entry, of: Subject, name: str) -> str:
    """Exports, or the card, that are older than the parameter file; empty where none are."""
    starts = {"export": f"{of.stem}-control.", "card": of.params.replace("params.json", "card.html")}
    old = older(project, entry, project.results(entry)) if name in starts else {}
    named = ", ".join(one for one in old if one.startswith(starts[name]))
    return f"{named} is older than params.json" if named else ""


def _is_on(step: Step, entry: Entry, of: Subject, name: str) -> bool:
    """Whether a step is a run of a form on a parameter file, or for the card a fit."""
    on_it = of.params in step.words or step.words[1:2] == (entry.name,)
    return (name == "card" and step.words[0] == entry.name and step.code == 0) or (step.words[0] == name and on_it)


def _counts(step: Step, entry: Entry, name: str) -> bool:
    """Whether a run has given a result; a refusal by check or export is one."""
    return step.code == 0 or (step.words[0] != entry.name and name in ("check", "export") and step.code == 5)


def _why_outdated(
    steps: Sequence[Step], entry: Entry, of: Subject, name: str, titles: Mapping[str, str]
) -> str:  # fmt: skip
    """Reason why the result of a form is outdated by the commands that were run after it; empty where it is not."""
    if name not in SECTIONS and any(_is_fit(step, entry) for step in steps):
        return "the laws were fitted again after it"
    later = [step.words[0] for step in steps if step.code == 0 and of.params in step.words]
    changed = [titles[one] for one in USES.get(name, ()) if one in later and one in titles]
    return f"{', '.join(changed)} changed after it" if changed else ""


def _result(project: Project, of: Subject, name: str, words: Sequence[str]) -> str:
    """The main result of a form in a few words, or its settings."""
    if name == "check":
        return "passed"
    if name == "export":
        return ", ".join(path.name for path in sorted(project.folder.glob(f"{of.stem}-control.*")))
    return _of_section(name, of.content.get(SECTIONS.get(name, "")) or {}) or settings_of(words)


def settings_of(words: Sequence[str]) -> str:
    """The settings of a command, without its files.

    >>> settings_of(["limits", "a/params.json", "P=7kW", "f=0.1:0.4", "--force"])
    'P=7kW f=0.1:0.4'
    """
    left = ("--force", "--out", "--figure", "--params")
    return " ".join(" ".join(part).removeprefix("--") for key, part in _parts(words[2:]) if key not in left)


def _of_section(name: str, section: Mapping[str, Any]) -> str:
    """The numbers of a section that say most; empty where they are not those of a whole file."""
    try:
        if name == "settings":
            low, high = section["lower"]["value"], section["upper"]["value"]
            known = section.get("probability")
            tools = f"{'an unknown share' if known is None else f'{known:.0%}'} of tools within the wear at tool change"
            load, feed = f"{section['reference']:.4g} {section['unit_load']}", section["unit_feed"]
            return f"reference {load}, feed {low:.4g} to {high:.4g} {feed}, {tools}"
        if name == "tune":
            return f"kp {section['kp']:.4g}, ki {section['ki']:.4g}"
        if name == "ident":
            return f"{section['output']} of {section['input']}, every {section['sample_time']:g} s"
    except (KeyError, TypeError, ValueError):
        return ""
    return ""


def after(project: Project, entry: Entry, of: Subject | None, job: Job) -> dict[str, Any]:
    """Changes of the page by a command: states, files, limits of gains, records, and the form that follows."""
    found: dict[str, Any] = {"following": None, "gains": [], "records": None, "states": {}}
    found.update(files_of(project, entry, project.results(entry)))
    if of is None:
        return found
    found["states"] = states(project, entry, of)
    forms = {one.name: one for one in filled(project, entry, of)}
    if job.words[0] == "ident" and "ident" in forms:
        found["records"] = dataclasses.replace(forms["ident"].inputs[0], value=job.words[1])
    if job.code == 0:
        found["following"] = _following(of, job.words[0], forms, found["states"])
        if job.words[0] == "settings":
            found["gains"] = [one for one in forms["tune"].inputs if one.name in LIMITS_OF_GAINS and one.value]
    return found


def _is_current(state: State) -> bool:
    """Whether a form was run, with a result that may be used and is not outdated."""
    return state.words != State().words and not state.outdated and state.colour != "bad"


def _following(
    of: Subject, name: str, forms: Mapping[str, Action], found: Mapping[str, State]
) -> Action | None:  # fmt: skip
    """The form that comes after a command: no export of a record alone, and the card where it is outdated.

    After the settings of a constant load it is the first of dynamics and gains that is lacking or outdated.
    """
    following = FOLLOWING.get(name, "")
    while following in OF_CONTROL and _is_current(found[following]):
        following = FOLLOWING[following]
    if (following == "export" and of.is_record) or (following == "card" and not found["card"].outdated):
        return None
    return forms.get(following)
