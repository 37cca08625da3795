"""One file of the project: how it is read, its laws, and the changes of its options."""

import asyncio
import re
import secrets
import shlex
from urllib.parse import quote

from starlette.requests import Request
from starlette.responses import Response

from ..core.errors import UsageError
from ..fit.form_choice import CHOICES
from . import messages, options, reading, shown, stages
from .cells import Cells, cells_of
from .jobs import Job
from .page_base import PageBase, Shown, ended, fields_of, language_of
from .project import LONGEST_OPTION, Entry
from .results import facts_of_laws, reading_of


class FilePage(PageBase):
    """Requests on the reading of a file and on its laws."""

    async def _file(self, request: Request) -> Response:
        entry = self._entry(request.path_params["name"])
        changed = await asyncio.to_thread(self.project.is_changed, entry)
        return self._render(
            "file.html", entry=entry, project=self.project, changed=changed, command=options.command_of(entry),
            token=shown.of_options(entry), page=secrets.token_hex(8), same=request.query_params.get("same", "")[:100],
        )  # fmt: skip

    def _drawn(self, entry: Entry) -> Job:
        """The command that draws the picture of a reading, or what it waits for."""
        now = self._show(entry)
        with self._lock:
            if now.laws.code is None:
                return now.laws
            if now.picture is None:
                words = ["look", entry.name, *options.of_reading(entry.options)]
                now.picture = self.jobs.start([*words, "--out", f"{entry.stem}-look.png", "--force"], entry.name)
            return now.picture

    async def _reading(self, request: Request) -> Response:
        entry = self._entry(request.path_params["name"])
        now = self._show(entry)
        if now.look.code is None:
            return self._waiting(entry, now.look, "reading", f"/files/{quote(entry.name)}/reading")
        now.found = now.found or reading_of(now.look)
        columns = await asyncio.to_thread(reading.column_menus, now.found, language_of(request))
        is_of_cells = bool(now.found["doubts"]) or "--correct" in entry.options
        cells = await self._cells(entry, now) if is_of_cells else None
        return self._render(
            "reading.html", entry=entry, look=now.found, columns=columns, job=now.look,
            set_here=[_set_here(entry, cells, typed, value) for typed, value in options.typed(entry.options)],
            sheets=reading.sheets_of(now.found), fields=reading.fields_of(now.found, entry.options),
            to=self._places(entry), assumed=reading.assumptions(now.found, entry.options),
            doubts=[(one, cells.of_doubt(one, now.found["doubts"]) if cells else []) for one in now.found["doubts"]],
            named=reading.named_rows(now.found, cells, entry.options), offered=reading.offered(now.found),
            has_added=await asyncio.to_thread(stages.has_added, self.project, entry),
        )  # fmt: skip

    async def _cells(self, entry: Entry, now: Shown) -> Cells | None:
        """Cells of a file where a doubt, a check or a correction is about some of them."""
        if now.cells is None and not now.found.get("record"):
            path = self.project.folder / entry.name
            now.cells = await asyncio.to_thread(cells_of, path, entry.options, now.found)
        return now.cells

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
        return self._render(
            "laws.html", entry=entry, job=job, to=self._places(entry), cells=cells, forms=CHOICES, **facts
        )

    async def _cells_when_read(self, entry: Entry) -> Cells | None:
        """Cells of a file, once its reading has ended."""
        now = self._show(entry)
        await ended(now.look)
        now.found = now.found or reading_of(now.look)
        return await self._cells(entry, now)

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
        entry, given = self._entry(request.path_params["name"]), await fields_of(request)
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
        await ended(job)
        await ended(now.look)
        before, found = reading_of(now.look), reading_of(job)
        refused = found["refused"]
        is_of_it = refused and (option in refused.partition(":")[0] or not before["refused"])
        if is_of_it and not found["record"]:
            raise UsageError(f"Not changed. {messages.plain(refused, self._places(entry))}")
        return self._changed(entry, words, reasons)

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
        if not target or target.startswith("-") or any(ord(sign) < 32 for sign in target):
            raise UsageError("name an edge, or lines, such as: lines 16, 18-20.")
        if len(target) > LONGEST_OPTION:
            raise UsageError(
                f"the names of edges or lines have {len(target)} characters, the project keeps {LONGEST_OPTION} in one "
                "option: leave them out in several parts."
            )
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
