"""Base of every part of the page: the project, its commands, its templates, and the places that messages lead to."""

import asyncio
import shlex
import threading
from dataclasses import dataclass, field
from http import HTTPStatus
from typing import Any, Final

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import HTMLResponse, Response

from ..core.errors import FitmodelsError, UsageError
from ..core.files import cause
from . import messages, options, reading, shown
from .cells import Cells
from .command_forms import Subject, actions
from .jobs import Job, Jobs, Runner
from .messages import colour
from .project import SUFFIXES, Entry, Project
from .stages import current_files

PRELOAD: Final = ("fitmodels.app.warm", "fitmodels.datasets.overview")
OF_FORMER: Final = (
    "The present settings have given no parameter file; the one in the folder is of former settings, and nothing is "
    "computed or exported from it. Correct the file under 1 and 2, or take the last change back."
)
POLL: Final = 0.02  # s between looks at a command that is waited for


@dataclass(slots=True)
class Shown:
    """Commands that show a file as it is set now, and its reading."""

    key: tuple[str, ...]
    look: Job
    laws: Job
    picture: Job | None = None  # drawn after the laws
    found: dict[str, Any] = field(default_factory=dict)
    cells: Cells | None = None


class PageBase:
    """A project with the commands that run in its folder, and answers that show them.

    Parameters
    ----------
    project : Project
    run : callable
        Runs the words of a command and returns its exit code.
    """

    def __init__(self, project: Project, run: Runner) -> None:
        self.project = project
        self.jobs = Jobs(run, project.folder, PRELOAD, self._ended, self._held)
        self._shown: dict[str, Shown] = {}
        self._runs: dict[tuple[str, str], tuple[Job, dict[str, str]]] = {}  # last run of each form, and its fields
        self._left: dict[str, str] = {}  # checksum of parameter files at the end of the last command of each page
        self._lock = threading.Lock()
        self._unrecorded = ""  # why the last command is not in the list of the project
        self._templates = Environment(
            loader=PackageLoader("fitmodels.app"), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
            lstrip_blocks=True,
        )  # fmt: skip
        self._templates.globals["suffixes"] = ",".join(SUFFIXES)
        self._templates.filters["colour"] = colour
        self._templates.filters["typed"] = lambda words: shlex.join(["fitmodels", *words])
        self._templates.filters["joined"] = shlex.join
        self._templates.filters.update(
            on_page=messages.on_page, in_parts=messages.in_parts, of_laws=messages.of_laws,
            described=messages.described, localised=reading.localised, micro=reading.micro,
        )  # fmt: skip
        self._templates.filters["options_of"] = lambda text: shlex.join(shlex.split(text)[2:])

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

    def _entry(self, name: str) -> Entry:
        entry = self.project.entry(name)
        if entry is None:
            raise HTTPException(HTTPStatus.NOT_FOUND, "There is no such file in the project.")
        return entry

    def _show(self, entry: Entry, *, force: bool = False) -> Shown:
        """Commands that read and fit a file as it is set now, started where they are not yet, or again by force."""
        key = (entry.sha256, *entry.options)
        with self._lock:
            now = self._shown.get(entry.name)
            if now is None or now.key != key or force:
                for job in () if now is None else (now.look, now.laws, now.picture):
                    if job is not None:
                        self.jobs.cancel(job)
                fit = self.jobs.start(options.command_of(entry, force=force), entry.name)
                look = self.jobs.start(["look", entry.name, *options.of_reading(entry.options), "--json"])
                now = self._shown[entry.name] = Shown(key, look, fit)
            return now

    def _held(self) -> list[Job]:
        """Jobs whose output the page shows: of each file as it is set now."""
        of_files = [job for now in tuple(self._shown.values()) for job in (now.look, now.laws, now.picture)]
        return [job for job in of_files if job is not None]

    def _places(self, entry: Entry, own: str = "") -> messages.Places:
        """Places that messages on a file can lead to: the forms of its laws, the menus of its columns."""
        now = self._shown.get(entry.name)
        try:
            forms = actions(self._subject(entry, "")[1])
        except UsageError:
            forms = ()
        return messages.places(forms, {} if now is None else now.found, own)

    def _waiting(self, entry: Entry, job: Job, what: str, again: str) -> Response:
        return self._render("waiting.html", job=job, what=what, again=again, to=self._places(entry, job.words[0]))

    def _waiting_words(self, entry: Entry, job: Job, again: str) -> Markup:
        """The block of a command that runs, for the page that is opened again."""
        block = self._templates.get_template("waiting.html")
        to = self._places(entry, job.words[0])
        return Markup(block.render(job=job, what=job.words[0], again=again, to=to))  # noqa: S704  texts are escaped

    def _subject(self, entry: Entry, wanted: str) -> tuple[list[str], Subject]:
        """The parameter files of a file, and the one that is wanted, or the first.

        Raises
        ------
        UsageError
            The file has none, or none of its present settings.
        """
        files, former = current_files(self.project, entry)
        if not files:
            raise UsageError(OF_FORMER if former else "there is no parameter file yet: the laws must be fitted first.")
        others = [one.name for one in self.project.files if one.name != entry.name]
        path = wanted if wanted in files else next(iter(files))
        return list(files), Subject(entry.stem, path, files[path], others)

    def _ended(self, job: Job, code: int) -> None:
        """Keep in the project what was run, but for readings, and the checksum of what the command has left."""
        if job.words[0] not in ("look", "--version") and not job.cancelled:
            try:
                self.project.ran(job.words, code)
            except (FitmodelsError, OSError) as error:
                self._unrecorded = str(error)
        entry = self.project.entry(job.writes)
        if entry is not None:
            job.left = shown.of_files(self.project, entry)
        if job.by:
            self._left[job.by] = job.left


async def fields_of(request: Request) -> dict[str, str]:
    """Fields of a form without files."""
    async with request.form(max_files=0, max_fields=40) as form:
        return {name: str(value) for name, value in form.items()}


def language_of(request: Request) -> str:
    """The language of the browser, of those that the vocabulary has."""
    return reading.language_of(request.headers.get("accept-language", ""))


async def ended(job: Job) -> None:
    """Wait for the end of a command."""
    while job.code is None:
        await asyncio.sleep(POLL)
