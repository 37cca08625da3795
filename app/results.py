"""Results of a file on the page: cards, laws, rows in doubt and remedies; and the JSON of its reading."""

import json
import mimetypes
import re
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from starlette.responses import FileResponse, HTMLResponse, Response

from ..core.text import line_spans
from ..datasets.options import without
from .jobs import Job
from .messages import colour
from .options import applied, pairs, typed, words
from .project import Entry, Project
from .stages import current_files, files_of, time_of

RECORD: Final = "is a record of one run"  # in a refusal of look
PICTURES: Final = (".png", ".svg")
NO_READING: Final[Mapping[str, Any]] = {
    "refused": None, "columns": [], "rows": [], "lines": [], "doubts": [], "assumed": [], "warnings": [],
    "commands": [], "units": {},
}  # fmt: skip
NO_RESULT: Final = {True: "cancelled", False: "The reading ended without a result; run it again."}
LEFT_OUT: Final = re.compile(r"assumed: left out as asked, --leave-out (.+?): (\d+ rows? \(.+)", re.S)
POLICY_OF_CARD = re.compile(r'http-equiv="Content-Security-Policy" content="([^"]{1,2000})"')


def reading_of(job: Job) -> dict[str, Any]:
    """The JSON of a reading; of one without, its message; ``record`` says whether the file is one."""
    try:
        found = json.loads(job.whole_output)
    except ValueError:
        found = None
    without = {"refused": job.errors or NO_RESULT[job.cancelled]}
    reading = {**NO_READING, **(found if isinstance(found, dict) else without)}
    reading["record"] = RECORD in (reading["refused"] or "")
    return reading


def facts_of_laws(project: Project, entry: Entry) -> dict[str, Any]:
    """Cards, laws, rows in doubt, remedies and files of the results of a file."""
    results = project.results(entry)
    current, former = current_files(project, entry)
    files = current or former
    folders = [path.removesuffix("params.json") for path in files]
    found = laws_of(files)
    laws, judged = [(name, law) for _, name, law in found], levels(found)
    return {
        "cards": [name for name in results if name.endswith("/card.html") and name.startswith(tuple(folders))],
        "is_former": files != current,
        "has_load": any(
            law.get("form") in ("load_line", "feed_line") and colour(level) != "bad"
            for (_, law), (_, level) in zip(laws, judged, strict=True)
        ),
        "is_barred": bool(judged) and all(colour(level) == "bad" for _, level in judged),
        "rows_of": rows_left_out(list(files.values())),
        "laws": list(dict.fromkeys(name for name, _ in laws)),
        "levels": shown_levels(current, former),
        "suspects": suspects([law for _, law in laws]),
        "remedies": remedies(entry, results),
        "left_out": [(value, one) for one, value in typed(entry.options) if one.startswith("--leave-out")],
        **files_of(project, entry, results),
    }


def rows_left_out(contents: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """Contents of each target that was left out, as the parameter files list it.

    >>> words = "assumed: left out as asked, --leave-out lines 15: 1 row (line 15), which holds fm 850, I 0.02"
    >>> rows_left_out([{"design": {"understood": [words]}}])
    {'lines 15': '1 row (line 15), which holds fm 850, I 0.02'}
    """
    texts = [str(one) for content in contents for one in (content.get("design") or {}).get("understood") or ()]
    found = [LEFT_OUT.fullmatch(text) for text in texts]
    return {one[1].strip("'"): one[2] for one in found if one}


def laws_of(files: Mapping[str, Mapping[str, Any]]) -> list[tuple[str, str, Mapping[str, Any]]]:
    """Laws of parameter files: tool and work where there are several pairs of them, name, and section."""
    pairs_of_laws = {path: Path(path).parent.name.replace("_", " on ", 1) if len(files) > 1 else "" for path in files}
    return [
        (pairs_of_laws[path], name, law)
        for path, content in files.items()
        for name, law in (content.get("laws") or {}).items()
    ]


def files_of_tests(project: Project) -> list[str]:
    """Files of the project that have laws."""
    return [
        entry.name
        for entry in project.files
        if any(content.get("laws") for part in current_files(project, entry) for content in part.values())
    ]


def verdicts(project: Project) -> dict[str, list[tuple[str, str]]]:
    """Laws of each file with the level of their verdicts; those of former settings are outdated."""
    found = {entry.name: current_files(project, entry) for entry in project.files}
    return {name: shown_levels(current, former) for name, (current, former) in found.items()}


def shown_levels(
    current: Mapping[str, Mapping[str, Any]], former: Mapping[str, Mapping[str, Any]]
) -> list[tuple[str, str]]:  # fmt: skip
    """Laws with the level of their verdicts; where there are none of the present settings, former ones as outdated."""
    return levels(laws_of(current)) if current else outdated(levels(laws_of(former)))


def outdated(judged: Sequence[tuple[str, str]]) -> list[tuple[str, str]]:
    """Names of laws of former settings, marked as outdated in place of their verdicts.

    >>> outdated([("VB", "usable inside the tested region")])
    [('VB', 'outdated, of former settings')]
    """
    return [(name, "outdated, of former settings") for name, _ in judged]


def levels(laws: Sequence[tuple[str, str, Mapping[str, Any]]]) -> list[tuple[str, str]]:
    """Names of laws with the level of their verdicts.

    >>> levels([("", "VB", {"verdict": {"level": "do not use"}}), ("K10 on C45", "P", {})])
    [('VB', 'do not use'), ('K10 on C45: P', 'no verdict')]
    """
    return [
        (f"{pair}: {name}" if pair else name, (law.get("verdict") or {}).get("level") or "no verdict")
        for pair, name, law in laws
    ]


def suspects(laws: Sequence[Mapping[str, Any]]) -> list[tuple[str, str, str]]:
    """Targets that could be left out, with the sentence of the check that names them and the symbol that deviates."""
    found: dict[str, tuple[str, str]] = {}
    for law in laws:
        for check in (law.get("checks") or {}).values():
            for one in check.get("suspects") or ():
                lines = one.get("lines") or ()
                target = f"lines {','.join(line_spans(lines))}" if lines else ",".join(one.get("edges") or ())
                if target:
                    found.setdefault(target, (str(check.get("verdict", "")), str(one.get("column") or "")))
    return [(target, *said) for target, said in found.items()]


def remedies(entry: Entry, results: Mapping[str, Path]) -> list[str]:
    """Options of the remedies that the cards of a file name; to leave rows out needs a reason, and is none of them."""
    found: dict[str, None] = {}
    for name, path in results.items():
        if not name.endswith("/card.json"):
            continue
        for command in _commands(path):
            if command[:2] != ["fitmodels", entry.name]:
                continue
            given = list(pairs(entry.options))
            own = [pair for pair in pairs(without(command[2:], "place", "screen")) if pair not in given]
            if own and not any(option == "--leave-out" for option, _ in own):
                found[shlex.join(words(own))] = None
    return [one for one in found if applied(entry.options, one) != list(entry.options)]


def _commands(path: Path) -> list[list[str]]:
    """Words of the commands that a card proposes, but not those that have made it; none of one that cannot be read."""
    try:
        card = json.loads(path.read_text("utf-8"))
        proposed = {name: part for name, part in card.items() if name != "provenance"} if isinstance(card, dict) else {}
        return [shlex.split(text) for text in _strings(proposed, "command") if " && " not in text]
    except (OSError, ValueError, RecursionError):
        return []


def _strings(data: object, key: str) -> list[str]:
    """Texts under a key, at any depth."""
    if isinstance(data, Mapping):
        own = [data[key]] if isinstance(data.get(key), str) and data[key] else []
        return own + [text for value in data.values() for text in _strings(value, key)]
    return [text for one in data for text in _strings(one, key)] if isinstance(data, list) else []


def written(project: Project, entry: Entry, job: Job) -> list[str]:
    """Results that a command has written since it was started; the picture of the reading is drawn beside it."""
    found, drawn = project.results(entry), f"{entry.stem}-look.png"
    later = (name for name, path in found.items() if time_of(path) >= job.clock_time - 0.05)
    return [name for name in later if name != drawn] if job.clock_time else []


def answer_of(path: Path) -> Response:
    """A result as the answer to a request: a card or picture to be shown, another file to be taken along."""
    if path.suffix == ".html":
        text = path.read_text("utf-8")
        return HTMLResponse(text, headers={"content-security-policy": policy_of_card(text)})
    if path.suffix in PICTURES:
        alone = {"content-security-policy": "default-src 'none'; sandbox"}
        return FileResponse(path, media_type=mimetypes.guess_type(path.name)[0], headers=alone)
    return FileResponse(path, media_type="application/octet-stream", filename=path.name)


def policy_of_card(text: str) -> str:
    """The policy that a card states, and that only this page may frame it; nothing at all of another page.

    >>> policy_of_card("<p>no card</p>")
    "default-src 'none'; frame-ancestors 'self'; sandbox allow-scripts allow-popups allow-downloads"
    """
    found = POLICY_OF_CARD.search(text[:20_000])
    stated = found[1].replace("&#39;", "'") if found else "default-src 'none'"
    return f"{stated}; frame-ancestors 'self'; sandbox allow-scripts allow-popups allow-downloads"
