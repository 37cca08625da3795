"""The page of a project: its files, how each is read, its laws, and the commands that lead to a machine."""

import asyncio
import re
import shlex
import threading
from collections.abc import Sequence
from dataclasses import dataclass, field
from http import HTTPStatus
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import HTMLResponse, RedirectResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from ..core.errors import FitmodelsError, UsageError
from ..core.files import cause
from . import messages, options, reading, region, shown, stages
from .cells import Cells, cells_of
from .command_forms import Subject, actions, command
from .jobs import Job, Jobs, Runner
from .project import Entry, Project
from .results import PICTURES, answer_of, facts_of_laws, files_of_tests, reading_of, verdicts, written
from .stages import colour, current_files

PRELOAD: Final = ("fitmodels.app.warm", "fitmodels.datasets.overview")
SHOWN_STEPS = 30
POLL = 0.02  # s between looks at a command that is waited for
MOST_FILES = 50  # of one upload


@dataclass(slots=True)
class Shown:
    """Commands that show a file as it is set now, and its reading."""

    key: tuple[str, ...]
    look: Job
    laws: Job
    picture: Job | None = None  # drawn after the laws
    found: dict[str, Any] = field(default_factory=dict)
    cells: Cells | None = None


class Page:
    """The page of one project.

    Parameters
    ----------
    project : Project
    run : callable
        Runs the words of a command and returns its exit code.
    """

    def __init__(self, project: Project, run: Runner) -> None:
        self.project = project
        self.jobs = Jobs(run, project.folder, PRELOAD, self._ended)
        self._shown: dict[str, Shown] = {}
        self._runs: dict[tuple[str, str], tuple[Job, dict[str, str]]] = {}  # last run of each form, and its fields
        self._lock = threading.Lock()
        self._unrecorded = ""  # why the last command is not in the list of the project
        self._templates = Environment(
            loader=PackageLoader("fitmodels.app"), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
            lstrip_blocks=True,
        )  # fmt: skip
        self._templates.filters["colour"] = colour
        self._templates.filters["typed"] = lambda words: shlex.join(["fitmodels", *words])
        self._templates.filters["joined"] = shlex.join
        self._templates.filters.update(
            on_page=messages.on_page, of_laws=messages.of_laws, described=messages.described,
            localised=reading.localised, micro=reading.micro,
        )  # fmt: skip
        self._templates.filters["options_of"] = lambda text: shlex.join(shlex.split(text)[2:])

    def application(self) -> Starlette:
        """The application without its guard."""
        of_file, get, post = "/files/{name}", ["GET"], ["POST"]
        return Starlette(
            routes=[
                Route("/", self._start, methods=get),
                Route("/files", self._add, methods=post),
                Route(of_file, self._file, methods=get),
                Route(f"{of_file}/reading", self._reading, methods=get),
                Route(f"{of_file}/picture", self._picture, methods=get),
                Route(f"{of_file}/laws", self._laws, methods=get),
                Route(f"{of_file}/set", self._set, methods=post),
                Route(f"{of_file}/apply", self._apply, methods=post),
                Route(f"{of_file}/again", self._fit_again, methods=post),
                Route(f"{of_file}/repeat", self._repeat, methods=post),
                Route(f"{of_file}/undo", self._undo, methods=post),
                Route(f"{of_file}/leave-out", self._leave_out, methods=post),
                Route(f"{of_file}/new-value", self._new_value, methods=post),
                Route(f"{of_file}/take-back", self._take_back, methods=post),
                Route(f"{of_file}/machine", self._machine, methods=get),
                Route(f"{of_file}/region", self._region, methods=get),
                Route(f"{of_file}/run/{{action}}", self._run, methods=post),
                Route(f"{of_file}/results/{{path:path}}", self._result, methods=get),
                Route("/jobs/{id}", self._job, methods=get),
                Route("/jobs/{id}/cancel", self._cancel, methods=post),
                Mount("/static", StaticFiles(packages=[("fitmodels.app", "templates")])),
            ],
            exception_handlers={FitmodelsError: self._refused, HTTPException: self._missing, OSError: self._unwritten},
        )

    def _render(self, template: str, status: int = 200, **facts: Any) -> HTMLResponse:  # noqa: ANN401
        return HTMLResponse(self._templates.get_template(template).render(**facts), status)

    async def _refused(self, _: Request, error: Exception) -> Response:
        words = messages.plain(str(error), messages.Places({}, {}))
        return self._render("alert.html", HTTPStatus.UNPROCESSABLE_ENTITY, words=words)

    async def _missing(self, _: Request, error: Exception) -> Response:
        status = error.status_code if isinstance(error, HTTPException) else HTTPStatus.INTERNAL_SERVER_ERROR
        return self._render("alert.html", status, words=getattr(error, "detail", ""))

    async def _unwritten(self, _: Request, error: Exception) -> Response:
        reason = cause(error) if isinstance(error, OSError) else ""
        words = f"The project folder cannot be read or written: {reason}. Nothing was changed."
        return self._render("alert.html", HTTPStatus.INSUFFICIENT_STORAGE, words=words)

    # the project

    async def _start(self, _: Request) -> Response:
        found = await asyncio.to_thread(verdicts, self.project)
        steps = self.project.steps[-SHOWN_STEPS:][::-1]
        return self._render(
            "project.html", project=self.project, verdicts=found, steps=steps, unrecorded=self._unrecorded
        )

    async def _add(self, request: Request) -> Response:
        async with request.form(max_files=MOST_FILES, max_fields=5) as form:
            given = [part for part in form.getlist("file") if not isinstance(part, str) and part.filename]
            added = [await asyncio.to_thread(self.project.add, part.filename or "", part.file) for part in given]
        if not added:
            raise UsageError("no file was chosen: choose a table of tests or a record.")
        for entry in added:
            self._show(entry)
        target = f"/files/{quote(added[0].name)}" if len(added) == 1 else "/"
        if "hx-request" in request.headers:
            return Response(headers={"HX-Redirect": target})
        return RedirectResponse(target, HTTPStatus.SEE_OTHER)

    def _entry(self, name: str) -> Entry:
        entry = self.project.entry(name)
        if entry is None:
            raise HTTPException(HTTPStatus.NOT_FOUND, "There is no such file in the project.")
        return entry

    # one file

    async def _file(self, request: Request) -> Response:
        entry = self._entry(request.path_params["name"])
        changed = await asyncio.to_thread(self.project.is_changed, entry)
        return self._render(
            "file.html", entry=entry, project=self.project, changed=changed, command=options.command_of(entry),
            token=shown.of_options(entry),
        )  # fmt: skip

    def _show(self, entry: Entry, *, force: bool = False) -> Shown:
        """Commands that read and fit a file as it is set now, started where they are not yet, or again by force."""
        key = (entry.sha256, *entry.options)
        with self._lock:
            now = self._shown.get(entry.name)
            if now is None or now.key != key or force:
                for job in () if now is None else (now.look, now.laws, now.picture):
                    if job is not None:
                        self.jobs.cancel(job)
                fit = self.jobs.start(options.command_of(entry, force=force))
                look = self.jobs.start(["look", entry.name, *options.of_reading(entry.options), "--json"])
                now = self._shown[entry.name] = Shown(key, look, fit)
            return now

    def _drawn(self, entry: Entry) -> Job:
        """The command that draws the picture of a reading, or what it waits for."""
        now = self._show(entry)
        with self._lock:
            if now.laws.code is None:
                return now.laws
            if now.picture is None:
                words = ["look", entry.name, *options.of_reading(entry.options)]
                now.picture = self.jobs.start([*words, "--out", f"{entry.stem}-look.png", "--force"])
            return now.picture

    async def _reading(self, request: Request) -> Response:
        entry = self._entry(request.path_params["name"])
        now = self._show(entry)
        if now.look.code is None:
            return self._waiting(entry, now.look, "reading", f"/files/{quote(entry.name)}/reading")
        now.found = now.found or reading_of(now.look)
        columns = await asyncio.to_thread(reading.column_menus, now.found, _language(request))
        is_of_cells = bool(now.found["doubts"]) or "--correct" in entry.options
        cells = await self._cells(entry, now) if is_of_cells else None
        return self._render(
            "reading.html", entry=entry, look=now.found, columns=columns, job=now.look,
            set_here=[_set_here(entry, cells, typed, value) for typed, value in options.typed(entry.options)],
            sheets=reading.sheets_of(now.found), fields=reading.fields_of(now.found, entry.options),
            to=self._places(entry), assumed=reading.assumptions(now.found, entry.options),
            doubts=[(one, cells.of_doubt(one) if cells else []) for one in now.found["doubts"]],
            doubted=reading.doubted_rows(now.found, cells), offered=reading.offered(now.found),
            has_added=await asyncio.to_thread(stages.has_added, self.project, entry),
        )  # fmt: skip

    async def _cells(self, entry: Entry, now: Shown) -> Cells | None:
        """Cells of a file where a doubt, a check or a correction is about some of them."""
        if now.cells is None and not now.found.get("record"):
            path = self.project.folder / entry.name
            now.cells = await asyncio.to_thread(cells_of, path, entry.options, now.found)
        return now.cells

    def _places(self, entry: Entry, own: str = "") -> messages.Places:
        """What messages on a file can lead to: the forms of its laws, the menus of its columns."""
        now = self._shown.get(entry.name)
        try:
            forms = actions(self._subject(entry, "")[1])
        except UsageError:
            forms = ()
        return messages.places(forms, {} if now is None else now.found, own)

    async def _picture(self, request: Request) -> Response:
        entry = self._entry(request.path_params["name"])
        job = self._drawn(entry)
        if job.code is None or job.words[0] != "look":
            return self._render("waiting.html", job=None, what="drawing", again=f"/files/{quote(entry.name)}/picture")
        path = f"{entry.stem}-look.png" if job.code == 0 else ""
        return self._render("picture.html", entry=entry, path=path, job=job)

    async def _laws(self, request: Request) -> Response:
        entry = self._entry(request.path_params["name"])
        job = self._show(entry).laws
        if job.code is None:
            return self._waiting(entry, job, "fitting", f"/files/{quote(entry.name)}/laws")
        facts = await asyncio.to_thread(facts_of_laws, self.project, entry)
        cells = await self._cells_when_read(entry) if facts["suspects"] else None
        return self._render("laws.html", entry=entry, job=job, to=self._places(entry), cells=cells, **facts)

    async def _cells_when_read(self, entry: Entry) -> Cells | None:
        """Cells of a file, once its reading has ended."""
        now = self._show(entry)
        await _ended(now.look)
        now.found = now.found or reading_of(now.look)
        return await self._cells(entry, now)

    def _waiting(self, entry: Entry, job: Job, what: str, again: str) -> Response:
        return self._render("waiting.html", job=job, what=what, again=again, to=self._places(entry, job.words[0]))

    def _waiting_words(self, entry: Entry, job: Job, again: str) -> Markup:
        """The block of a command that runs, for the page that is opened again."""
        block = self._templates.get_template("waiting.html")
        to = self._places(entry, job.words[0])
        return Markup(block.render(job=job, what=job.words[0], again=again, to=to))  # noqa: S704  texts are escaped

    # its options

    async def _set(self, request: Request) -> Response:
        entry, given = await self._form(request)
        found = self._show(entry).found
        name, value = await asyncio.to_thread(reading.option_of_change, given, found.get("columns", []))
        words = options.replaced(entry.options, name, value)
        if value and name in reading.TEXTS:
            return await self._tried(entry, words, name)
        return self._changed(entry, words)

    async def _form(self, request: Request) -> tuple[Entry, dict[str, str]]:
        """The file of a form that changes how it is read, and the fields; the page must show the present options."""
        entry, given = self._entry(request.path_params["name"]), await _fields(request)
        shown.check_options(entry, given)
        return entry, given

    async def _tried(
        self, entry: Entry, words: list[str], option: str, reasons: dict[str, str] | None = None
    ) -> Response:
        """The page after a change that the reading accepts; what it refuses is not kept.

        Raises
        ------
        UsageError
            The reading refuses the option.
        """
        job = self.jobs.start(["look", entry.name, *options.of_reading(words), "--json"])
        now = self._show(entry)
        await _ended(job)
        await _ended(now.look)
        before, found = reading_of(now.look), reading_of(job)
        refused = found["refused"]
        is_of_it = refused and (option in refused.partition(":")[0] or not before["refused"])
        if is_of_it and not found["record"]:
            raise UsageError(f"Not changed. {messages.plain(refused, self._places(entry))}")
        return self._changed(self._entry(entry.name), words, reasons)

    async def _apply(self, request: Request) -> Response:
        """Set the options of a remedy that the reading or a card names."""
        entry, given = await self._form(request)
        wanted = given.get("options", "")
        found = self._show(entry).found
        facts = await asyncio.to_thread(facts_of_laws, self.project, entry)
        known = {doubt["remedy"] for doubt in found.get("doubts", [])} | set(facts["remedies"])
        known |= set(reading.offered(found))
        if wanted not in known:
            raise UsageError("there is no such remedy any more: reload the page.")
        return self._changed(entry, options.applied(entry.options, wanted))

    async def _undo(self, request: Request) -> Response:
        """Read the file as it came."""
        return self._changed((await self._form(request))[0], [], {})

    async def _leave_out(self, request: Request) -> Response:
        """Leave rows or edges out with a reason."""
        entry, given = await self._form(request)
        target, reason = (given.get(name, "").strip() for name in ("target", "reason"))
        if not target or len(target) > 200 or target.startswith("-") or any(ord(sign) < 32 for sign in target):
            raise UsageError("name an edge, or lines, such as: lines 16, 18-20.")
        reasons = {**entry.reasons, target: _reason(reason, "it is left out")}
        return await self._tried(entry, options.replaced(entry.options, "--leave-out", target), "--leave-out", reasons)

    async def _new_value(self, request: Request) -> Response:
        """Give one cell a new value with a reason, by the correction that leads to it."""
        entry, given = await self._form(request)
        symbol, line, to, reason = (given.get(name, "").strip() for name in ("symbol", "line", "to", "reason"))
        reason = _reason(reason, "the value is changed")
        cells = await self._cells_when_read(entry)
        if cells is None or not line.isdecimal() or len(line) > 9:
            raise UsageError(f"line {line[:20]}: the file has no such row; reload the page.")
        text = await asyncio.to_thread(cells.correction, int(line), symbol, to)
        kept = [pair for pair in options.pairs(entry.options) if not _is_of_cell(*pair, int(line), symbol)]
        reasons = {key: words for key, words in entry.reasons.items() if key in {value for _, value in kept}}
        words = options.replaced(options.words(kept), "--correct", text)
        return await self._tried(entry, words, "--correct", {**reasons, text: reason})

    async def _take_back(self, request: Request) -> Response:
        """Read the file without one of its options."""
        entry, given = await self._form(request)
        wanted = given.get("option", "")
        known = options.typed(entry.options)
        kept = [word for typed, _ in known if typed != wanted for word in shlex.split(typed)]
        left = {value for typed, value in known if typed != wanted}
        return self._changed(entry, kept, {key: words for key, words in entry.reasons.items() if key in left})

    def _changed(self, entry: Entry, words: list[str], reasons: dict[str, str] | None = None) -> Response:
        """The page after the options of a file were changed."""
        self._show(self.project.change(entry, words, reasons), force=True)
        return Response(headers={"HX-Redirect": f"/files/{quote(entry.name)}"})

    async def _fit_again(self, request: Request) -> Response:
        """Fit again, in place of what other options gave."""
        entry, _ = await self._form(request)
        return self._changed(entry, list(entry.options))

    # commands on its parameter file

    def _subject(self, entry: Entry, wanted: str) -> tuple[list[str], Subject]:
        """The parameter files of a file, and the one that is wanted, or the first."""
        files, _ = current_files(self.project, entry)
        if not files:
            raise UsageError("there is no parameter file yet: the laws above must be fitted first.")
        others = [one.name for one in self.project.files if one.name != entry.name]
        path = wanted if wanted in files else next(iter(files))
        return list(files), Subject(entry.stem, path, files[path], others)

    async def _machine(self, request: Request) -> Response:
        entry = self._entry(request.path_params["name"])
        wanted = request.query_params.get("params", "")
        try:
            paths, subject = await asyncio.to_thread(self._subject, entry, wanted)
        except UsageError as missing:
            return self._render("alert.html", words=str(missing))
        running = self._running(entry, subject)
        forms = await asyncio.to_thread(stages.filled, self.project, entry, subject)
        forms = [stages.with_values(one, running[one.name][1]) if one.name in running else one for one in forms]
        done = await asyncio.to_thread(stages.states, self.project, entry, subject, running)
        tests = await asyncio.to_thread(files_of_tests, self.project) if subject.is_record else []
        return self._render(
            "machine.html", entry=entry, actions=[one for one in forms if one.is_form], paths=paths,
            path=subject.params, states=done, is_record=subject.is_record, language=_language(request), tests=tests,
            token=await asyncio.to_thread(shown.of_files, self.project, entry),
            waiting={name: self._waiting_words(entry, job, _address(job, entry)) for name, (job, _) in running.items()},
        )  # fmt: skip

    def _running(self, entry: Entry, of: Subject) -> dict[str, tuple[Job, dict[str, str]]]:
        """Commands of the forms of a parameter file that have not ended, with the fields that they were given."""
        found = {name: run for (of_file, name), run in self._runs.items() if of_file == entry.name}
        return {
            name: (job, given)
            for name, (job, given) in found.items()
            if job.code is None and (of.params in job.words or entry.name in job.words)
        }

    async def _region(self, request: Request) -> Response:
        """The region of speed and feed within the limits of the sliders; without values, the sliders themselves."""
        entry = self._entry(request.path_params["name"])
        given = {name: value for name, value in request.query_params.items() if name not in shown.NAMES}
        _, subject = await asyncio.to_thread(self._subject, entry, given.pop("params", ""))
        if not given:
            found = await asyncio.to_thread(region.sliders, self.project.folder, subject.params)
            return self._render(
                "region.html", entry=entry, sliders=found, path=subject.params, language=_language(request)
            )
        svg, words = await asyncio.to_thread(region.drawn, self.project.folder, subject.params, given)
        return self._render("region_drawn.html", svg=Markup(svg), words=words)  # noqa: S704  texts are escaped in it

    async def _run(self, request: Request) -> Response:
        entry = self._entry(request.path_params["name"])
        given = await self._fields_of_run(request)
        await asyncio.to_thread(shown.check_all, self.project, entry, given)
        _, subject = await asyncio.to_thread(self._subject, entry, given.get("params", ""))
        action = {one.name: one for one in actions(subject)}.get(request.path_params["action"])
        if action is None:
            raise HTTPException(HTTPStatus.NOT_FOUND, "There is no such command on this page.")
        own = options.of_comparison if action.name == "compare" else options.of_reading
        forms = await asyncio.to_thread(stages.filled, self.project, entry, subject)
        emptied = [name for one in forms if one.name == action.name for name in stages.emptied(one, given)]
        job = self.jobs.start(command(action, subject, given, [entry.name, *own(entry.options)], emptied))
        self._runs[entry.name, action.name] = job, given
        return self._waiting(entry, job, action.title.lower(), _address(job, entry))

    async def _fields_of_run(self, request: Request) -> dict[str, str]:
        """Fields of a command; a record that comes with them is added to the project and chosen."""
        async with request.form(max_files=1, max_fields=40) as form:
            given = {name: value for name, value in form.items() if isinstance(value, str)}
            part = form.get("upload")
            if part is not None and not isinstance(part, str) and part.filename:
                added = await asyncio.to_thread(self.project.add, part.filename, part.file)
                given["record"] = added.name
        return given

    async def _repeat(self, request: Request) -> Response:
        """Run a command again that added to the former parameter file, or made a result that is older than it."""
        entry, given = await self._form(request)
        wanted = given.get("command", "")
        facts = await asyncio.to_thread(facts_of_laws, self.project, entry)
        known = {shlex.join(words): words for words in (*facts["to_repeat"], *facts["older"].values())}
        if not wanted or wanted not in known:
            raise UsageError("this command was run again already: reload the page.")
        job = self.jobs.start(known[wanted])
        return self._waiting(entry, job, job.words[0], _address(job, entry))

    async def _job(self, request: Request) -> Response:
        job = self.jobs.get(request.path_params["id"])
        if job is None:
            raise HTTPException(HTTPStatus.NOT_FOUND, "This command is no longer known: run it again.")
        entry = self._entry(request.query_params.get("file", ""))
        if job.code is None:
            return self._waiting(entry, job, job.words[0], _address(job, entry))
        files = await asyncio.to_thread(written, self.project, entry, job)
        pictures = [name for name in files if name.endswith(PICTURES)]
        to = await asyncio.to_thread(self._places, entry, job.words[0])
        changed = await asyncio.to_thread(self._after, entry, job)
        token = await asyncio.to_thread(shown.of_files, self.project, entry)
        return self._render(
            "result.html", entry=entry, job=job, written=files, pictures=pictures, to=to, token=token, **changed
        )

    def _after(self, entry: Entry, job: Job) -> dict[str, Any]:
        """What a command has changed on the page beside its answer."""
        path = next((word for word in job.words if word.endswith("params.json")), "")
        subject = self._subject(entry, path)[1] if path in self.project.parameter_files(entry) else None
        return stages.after(self.project, entry, subject, job)

    async def _cancel(self, request: Request) -> Response:
        job = self.jobs.get(request.path_params["id"])
        if job is not None:
            await asyncio.to_thread(self.jobs.cancel, job)
        return Response(status_code=HTTPStatus.NO_CONTENT)

    def _ended(self, words: Sequence[str], code: int) -> None:
        """Keep in the project what was run, but for readings."""
        if words[0] not in ("look", "--version"):
            try:
                self.project.ran(words, code)
            except (FitmodelsError, OSError) as error:
                self._unrecorded = str(error)

    async def _result(self, request: Request) -> Response:
        """A file that a command has written, by its path among the results."""
        entry = self._entry(request.path_params["name"])
        results = await asyncio.to_thread(self.project.results, entry)
        path: Path | None = results.get(request.path_params["path"])
        if path is None:
            raise HTTPException(HTTPStatus.NOT_FOUND, "There is no such result.")
        return await asyncio.to_thread(answer_of, path)


async def _fields(request: Request) -> dict[str, str]:
    """Fields of a form without files."""
    async with request.form(max_files=0, max_fields=40) as form:
        return {name: str(value) for name, value in form.items()}


def _language(request: Request) -> str:
    """The language of the browser, of those that the vocabulary has."""
    return reading.language_of(request.headers.get("accept-language", ""))


def _address(job: Job, entry: Entry) -> str:
    return f"/jobs/{job.id}?file={quote(entry.name)}"


async def _ended(job: Job) -> None:
    """Wait for the end of a command."""
    while job.code is None:
        await asyncio.sleep(POLL)


def _reason(given: str, what: str) -> str:
    """A reason that is kept in the project."""
    if not given or len(given) > 500:
        raise UsageError(f"state why {what}: the reason is kept in the project.")
    return given


def _set_here(entry: Entry, cells: Cells | None, typed: str, value: str) -> tuple[str, str, str]:
    """An option that was set on the page, as typed, with its reason, and in words where it corrects one cell."""
    words = cells.worded(value) if cells is not None and typed.startswith("--correct") else ""
    return typed, entry.reasons.get(value, ""), words


def _is_of_cell(name: str, value: str, line: int, symbol: str) -> bool:
    """Whether an option corrects one cell."""
    return name == "--correct" and bool(re.match(rf"lines {line}:{re.escape(symbol)}[*/+-]", value))
