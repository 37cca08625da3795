"""The page of a project: its files, how each is read, its laws, and the commands that lead to a machine."""

import asyncio
import shlex
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from http import HTTPStatus
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

from markupsafe import Markup
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import RedirectResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from ..core.errors import FitmodelsError, UsageError
from . import options, region, shown, stages
from .command_forms import CONTROLS, Subject, actions
from .command_words import command
from .file_page import FilePage
from .jobs import Job
from .page_base import language_of
from .project import Entry, safe_name
from .results import PICTURES, answer_of, facts_of_laws, files_of_tests, verdicts, written

SHOWN_STEPS: Final = 30
MOST_FILES: Final = 50  # of one upload


class Page(FilePage):
    """The page of one project.

    Parameters
    ----------
    project : Project
    run : callable
        Runs the words of a command and returns its exit code.
    """

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

    async def _start(self, _: Request) -> Response:
        found = await asyncio.to_thread(verdicts, self.project)
        steps = self.project.steps[-SHOWN_STEPS:][::-1]
        return self._render(
            "project.html", project=self.project, verdicts=found, steps=steps, unrecorded=self._unrecorded
        )

    async def _add(self, request: Request) -> Response:
        async with request.form(max_files=MOST_FILES, max_fields=5) as form:
            given = [part for part in form.getlist("file") if not isinstance(part, str) and part.filename]
            known = {one.name for one in self.project.files}
            added = [await asyncio.to_thread(self.project.add, part.filename or "", part.file) for part in given]
        if not added:
            raise UsageError("no file was chosen: choose a table of tests or a record.")
        for entry in added:
            self._show(entry)
        target = f"/files/{quote(added[0].name)}" if len(added) == 1 else "/"
        if (
            len(added) == 1
            and added[0].name in known
            and (named := safe_name(given[0].filename or "")) != added[0].name
        ):
            target += f"?same={quote(named)}"
        if "hx-request" in request.headers:
            return Response(headers={"HX-Redirect": target})
        return RedirectResponse(target, HTTPStatus.SEE_OTHER)

    async def _machine(self, request: Request) -> Response:
        entry = self._entry(request.path_params["name"])
        wanted = request.query_params.get("params", "")
        try:
            paths, subject = await asyncio.to_thread(self._subject, entry, wanted)
        except UsageError as missing:
            return self._render("alert.html", words=str(missing))
        subject = await asyncio.to_thread(self._with_tests, subject)
        running = self._running(entry, subject)
        forms = await asyncio.to_thread(stages.filled, self.project, entry, subject)
        forms = [stages.with_values(one, running[one.name][1]) if one.name in running else one for one in forms]
        done = await asyncio.to_thread(stages.states, self.project, entry, subject, running)
        return self._render(
            "machine.html", entry=entry, actions=[one for one in forms if one.is_form], paths=paths,
            path=subject.params, states=done, is_record=subject.is_record, language=language_of(request),
            tests=subject.tests, token=await asyncio.to_thread(shown.of_files, self.project, entry),
            waiting={name: self._waiting_words(entry, job, _address(job, entry)) for name, (job, _) in running.items()},
        )  # fmt: skip

    def _with_tests(self, subject: Subject) -> Subject:
        """A subject with the files of the project that have laws."""
        return replace(subject, tests=files_of_tests(self.project))

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
                "region.html", entry=entry, sliders=found, path=subject.params, language=language_of(request)
            )
        svg, words = await asyncio.to_thread(region.drawn, self.project.folder, subject.params, given)
        return self._render("region_drawn.html", svg=Markup(svg), words=words)  # noqa: S704  texts are escaped in it

    async def _run(self, request: Request) -> Response:
        entry = self._entry(request.path_params["name"])
        name, given = request.path_params["action"], await self._fields_of_run(request)
        check = partial(self._allowed, entry.name, name, given)
        entry, subject = await asyncio.to_thread(check)
        action = {one.name: one for one in actions(subject)}.get(name)
        if action is None:
            raise HTTPException(HTTPStatus.NOT_FOUND, "There is no such command on this page.")
        own = options.of_comparison if action.name == "compare" else options.of_reading
        forms = await asyncio.to_thread(stages.filled, self.project, entry, subject)
        emptied = [name for one in forms if one.name == action.name for name in stages.emptied(one, given)]
        words = command(action, subject, given, [entry.name, *own(entry.options)], emptied)
        job = self.jobs.start(words, entry.name, by=given.get(shown.PAGE, ""), check=check)
        self._runs[entry.name, action.name] = job, given
        return self._waiting(entry, job, action.title.lower(), _address(job, entry))

    def _allowed(self, of_file: str, name: str, given: Mapping[str, str]) -> tuple[Entry, Subject]:
        """File and subject of a form that may be run now: when it is asked for, and when its turn has come.

        Raises
        ------
        UsageError
            The page shows what has changed, or a control would be exported that is outdated.
        """
        entry = self._entry(of_file)
        self._check_shown(entry, given)
        subject = self._subject_of_form(entry, name, given.get("params", ""))
        is_control = name == "export" and given.get("to") in CONTROLS
        if is_control and (old := shown.outdated_control(self.project, entry, subject)):
            raise UsageError(old)
        return entry, subject

    def _check_shown(self, entry: Entry, given: Mapping[str, str]) -> None:
        """Refuse a request of a page that shows other options or parameter files than there are."""
        shown.check_all(self.project, entry, given, self._left.get(given.get(shown.PAGE, ""), ""))

    def _subject_of_form(self, entry: Entry, name: str, wanted: str) -> Subject:
        """The subject of a form; that of ``compare`` has no parameter file, because it reads the tests alone."""
        return Subject(entry.stem, "") if name == "compare" else self._subject(entry, wanted)[1]

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
        check = partial(self._to_repeat, entry.name, given)
        words = await asyncio.to_thread(check)
        job = self.jobs.start(words, entry.name, by=given.get(shown.PAGE, ""), check=check)
        return self._waiting(entry, job, job.words[0], _address(job, entry))

    def _to_repeat(self, of_file: str, given: Mapping[str, str]) -> tuple[str, ...]:
        """Words of the command that is to be repeated, and was not yet.

        Raises
        ------
        UsageError
            The page shows what has changed, or the command was repeated.
        """
        entry = self._entry(of_file)
        self._check_shown(entry, given)
        facts = facts_of_laws(self.project, entry)
        known: dict[str, tuple[str, ...]] = {
            shlex.join(words): words for words in (*facts["to_repeat"], *facts["older"].values())
        }
        if not given.get("command") or given["command"] not in known:
            raise UsageError("this command was run again already: reload the page.")
        return known[given["command"]]

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
        return self._render("result.html", entry=entry, job=job, written=files, pictures=pictures, to=to, **changed)

    def _after(self, entry: Entry, job: Job) -> dict[str, Any]:
        """Changes of the page by a command, besides its answer."""
        path = next((word for word in job.words if word.endswith("params.json")), "")
        is_current = path in stages.current_files(self.project, entry)[0]
        subject = self._with_tests(self._subject(entry, path)[1]) if is_current else None
        return stages.after(self.project, entry, subject, job)

    async def _cancel(self, request: Request) -> Response:
        job = self.jobs.get(request.path_params["id"])
        if job is not None:
            await asyncio.to_thread(self.jobs.cancel, job)
        return Response(status_code=HTTPStatus.NO_CONTENT)

    async def _result(self, request: Request) -> Response:
        """A file that a command has written, by its path among the results."""
        entry = self._entry(request.path_params["name"])
        results = await asyncio.to_thread(self.project.results, entry)
        path: Path | None = results.get(request.path_params["path"])
        if path is None:
            raise HTTPException(HTTPStatus.NOT_FOUND, "There is no such result.")
        return await asyncio.to_thread(answer_of, path)


def _address(job: Job, entry: Entry) -> str:
    return f"/jobs/{job.id}?file={quote(entry.name)}"
