"""What a page shows is run: its files written, its commands and Python executed, its output compared.

    python docs/_ext/blocks.py docs/tutorial.md           # tells where a page differs from what the program prints
    python docs/_ext/blocks.py --write docs/tutorial.md   # puts in what is printed, where nothing was left out

Fenced blocks of a page are met in order, in one folder that holds the checkout's ``docs`` and ``datasets``:

- ``{code-block}`` with ``:caption: name.ext``: a file, written as it stands;
- ``console``: lines after ``$`` are commands, the lines below each what it prints;
- ``python``: executed, all blocks of a page in one namespace; a ``text`` block right behind it is what it prints.

In what is printed a line of ``...`` stands for any lines, and ``...`` inside a line for anything.
"""

import contextlib
import io
import os
import re
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent.parent
FENCE = re.compile(r"^(?P<fence>`{3,})(?P<info>.*)\n(?P<body>(?:.*\n)*?)(?P=fence) *$", re.M)
CAPTION = re.compile(r"\A(?::[\w-]+:.*\n)*?:caption: *(?P<name>[\w./-]+\.\w+) *\n(?::[\w-]+:.*\n)*\n?")
SIMPLE = re.compile(
    r"fitmodels [^|<>&;$`*]*"
)  # no shell needed: runs in this process, which spares its start (`> file` is seen to)


@dataclass(frozen=True, slots=True)
class Shown:
    """A command or a piece of Python on a page, and what stands below it."""

    line: int
    source: str
    language: str
    expected: str
    start: int  # where `expected` stands in the page
    end: int


@dataclass(frozen=True, slots=True)
class Difference:
    """Where a page differs from what is printed."""

    shown: Shown
    printed: str

    def __str__(self) -> str:
        """Both, one above the other."""
        where = f"line {self.shown.line}: {self.shown.source}"
        return f"{where}\n--- shown\n{self.shown.expected}\n--- printed\n{self.printed}"


def shown_on(page: str) -> Iterator[Shown | tuple[str, str]]:
    """Everything to do on a page, in order: what to run, and files as (name, text)."""
    fences = list(FENCE.finditer(page))
    for fence, behind in zip_longest(fences, fences[1:]):
        info, body = fence["info"].strip(), fence["body"]
        if info.startswith("{code-block}") and (caption := CAPTION.match(body)):
            yield caption["name"], body[caption.end() :]
        elif info == "console":
            yield from _commands(page, fence.start("body"), body)
        elif info == "python":
            line = page.count("\n", 0, fence.start()) + 1
            told = (
                behind is not None
                and behind["info"].strip() == "text"
                and not page[fence.end() : behind.start()].strip()
            )
            span = behind.span("body") if told and behind is not None else (fence.end(), fence.end())
            yield Shown(line, body, "python", page[slice(*span)] if told else "...", *span)


def _commands(page: str, start: int, body: str) -> Iterator[Shown]:
    for part in re.finditer(r"^\$ (?P<source>(?:.*\\\n)*.*)\n(?P<told>(?:(?!\$ ).*\n)*)", body, flags=re.M):
        begin, end = (start + place for place in part.span("told"))
        yield Shown(page.count("\n", 0, start + part.start()) + 1, part["source"], "console", part["told"], begin, end)


def agrees(expected: str, printed: str) -> bool:
    r"""Whether what was printed is what is shown.

    >>> agrees("one\n...\nfour in ... s\n", "one\ntwo\nthree\nfour in 0.3 s")
    True
    >>> agrees("one\ntwo\n", "one\n")
    False
    """
    lines = [line.rstrip() for line in expected.strip().splitlines()]
    pattern = "".join(
        r"(?:.*\n)*?" if line.strip() == "..." else ".*".join(map(re.escape, line.split("..."))) + r"\n"
        for line in lines
    )
    text = "\n".join(line.rstrip() for line in printed.strip().splitlines())
    return re.fullmatch(pattern, text + "\n" if text else "") is not None


def differences(page: Path, folder: Path) -> list[Difference]:
    """Run a page in a folder, and tell where it differs from what is printed."""
    for name in ("docs", "datasets"):
        (folder / name).symlink_to(ROOT / name)
    names: dict[str, Any] = {"__name__": "__page__"}
    found = []
    with contextlib.chdir(folder), _surroundings():
        for item in shown_on(page.read_text("utf-8")):
            if isinstance(item, tuple):
                Path(item[0]).parent.mkdir(parents=True, exist_ok=True)
                Path(item[0]).write_text(item[1], encoding="utf-8")
                continue
            printed = _python(item.source, names) if item.language == "python" else _command(item.source)
            if not agrees(item.expected, printed):
                found.append(Difference(item, printed))
    return found


@contextlib.contextmanager
def _surroundings() -> Iterator[None]:
    """A width that does not hang on the terminal, no colours, no windows."""
    fixed = {"COLUMNS": "100", "LC_ALL": "C", "NO_COLOR": "1", "MPLBACKEND": "agg", "FITMODELS_TRACEBACK": "1"}
    before = {name: os.environ.get(name) for name in fixed}
    os.environ.update(fixed)
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name, None) if value is None else os.environ.__setitem__(name, value)


def _python(source: str, names: dict[str, Any]) -> str:
    with contextlib.redirect_stdout(io.StringIO()) as out:
        exec(compile(source, "page", "exec"), names)  # noqa: S102  the page is ours
    return out.getvalue()


def _command(source: str) -> str:
    """What a command prints, both streams, and its exit code where `; echo $?` asks for it."""
    from fitmodels.cli import main

    plain, asked, _ = source.replace("\\\n", " ").partition("; echo $?")
    plain, _, kept = plain.partition(" > ")
    if not SIMPLE.fullmatch(plain):
        run = {"capture_output": True, "text": True, "check": False}
        done = subprocess.run(["bash", "-c", _resolved(source)], **run)  # noqa: S603, S607
        return done.stdout + done.stderr
    out = io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
        code = main(shlex.split(plain)[1:])
    if kept:
        Path(kept.strip()).write_text(out.getvalue(), encoding="utf-8")
    return ("" if kept else out.getvalue()) + (f"{code}\n" if asked else "")


def _resolved(source: str) -> str:
    return f'fitmodels() {{ {shlex.quote(sys.executable)} -m fitmodels "$@"; }}\n{source}'


def written(page: str, found: list[Difference]) -> str:
    """A page with what is printed in place of what was shown; what leaves out lines is left to its author."""
    for one in sorted(found, key=lambda one: -one.shown.start):
        if "..." in (line.strip() for line in one.shown.expected.splitlines()):
            continue
        text = (
            "\n".join(line.rstrip() for line in one.printed.rstrip().splitlines()) + "\n" if one.printed.strip() else ""
        )
        page = page[: one.shown.start] + text + page[one.shown.end :]
    return page


def _main(arguments: list[str]) -> int:
    code = 0
    for name in (word for word in arguments if word != "--write"):
        page = Path(name).resolve()
        with tempfile.TemporaryDirectory() as folder:
            found = differences(page, Path(folder))
        for one in found:
            print(f"{name}, {one}\n")
        if found and "--write" in arguments:
            page.write_text(written(page.read_text("utf-8"), found), encoding="utf-8")
        code = 1 if found else code
    return code


if __name__ == "__main__":
    sys.exit(_main(sys.argv[1:]))
