"""Execution of the examples of a page: files are written, commands and Python are run, and the output is compared.

    python docs/_ext/blocks.py docs/tutorial.md           # print the differences to the output of the program
    python docs/_ext/blocks.py --write docs/tutorial.md   # update the output, except where lines are left out
    python docs/_ext/blocks.py --script docs/stories/ac2017.md   # write the commands of a page as a script, ac2017.sh

Fenced blocks of a page are processed in order, in one folder that contains ``docs`` and ``datasets`` of the checkout:

- ``{code-block}`` with ``:caption: name.ext``: a file, written unchanged;
- ``console``: lines after ``$`` are commands, the lines below each are its output;
- ``python``: executed, all blocks of a page in one namespace; a ``text`` block immediately after it is its output.

In an output a line of ``...`` matches any lines, and ``...`` inside a line matches any text.
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
)  # run in this process, which is faster than a shell (`> file` is handled here)


@dataclass(frozen=True, slots=True)
class Example:
    """A command or a block of Python on a page, and the output below it."""

    line: int
    source: str
    language: str
    expected: str
    start: int  # position of `expected` in the page
    end: int


@dataclass(frozen=True, slots=True)
class Difference:
    """A difference between a page and the output of the program."""

    example: Example
    printed: str

    def __str__(self) -> str:
        """Expected and actual output, one above the other."""
        where = f"line {self.example.line}: {self.example.source}"
        return f"{where}\n--- shown\n{self.example.expected}\n--- printed\n{self.printed}"


def examples_of(page: str) -> Iterator[Example | tuple[str, str]]:
    """Examples of a page in order: commands and Python to run, and files as (name, text)."""
    fences = list(FENCE.finditer(page))
    for fence, following in zip_longest(fences, fences[1:]):
        info, body = fence["info"].strip(), fence["body"]
        if info.startswith("{code-block}") and (caption := CAPTION.match(body)):
            yield caption["name"], body[caption.end() :]
        elif info == "console":
            yield from _commands(page, fence.start("body"), body)
        elif info == "python":
            line = page.count("\n", 0, fence.start()) + 1
            has_output = (
                following is not None
                and following["info"].strip() == "text"
                and not page[fence.end() : following.start()].strip()
            )
            span = following.span("body") if has_output and following is not None else (fence.end(), fence.end())
            yield Example(line, body, "python", page[slice(*span)] if has_output else "...", *span)


def _commands(page: str, start: int, body: str) -> Iterator[Example]:
    for part in re.finditer(r"^\$ (?P<source>(?:.*\\\n)*.*)\n(?P<output>(?:(?!\$ ).*\n)*)", body, flags=re.M):
        begin, end = (start + place for place in part.span("output"))
        line = page.count("\n", 0, start + part.start()) + 1
        yield Example(line, part["source"], "console", part["output"], begin, end)


def agrees(expected: str, printed: str) -> bool:
    r"""Whether the printed output matches the expected one.

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
    """Differences between a page and its output when it is run in a folder."""
    for name in ("docs", "datasets"):
        (folder / name).symlink_to(ROOT / name)
    names: dict[str, Any] = {"__name__": "__page__"}
    found = []
    with contextlib.chdir(folder), _environment():
        for item in examples_of(page.read_text("utf-8")):
            if isinstance(item, tuple):
                Path(item[0]).parent.mkdir(parents=True, exist_ok=True)
                Path(item[0]).write_text(item[1], encoding="utf-8")
                continue
            printed = _python(item.source, names) if item.language == "python" else _command(item.source)
            if not agrees(item.expected, printed):
                found.append(Difference(item, printed))
    return found


@contextlib.contextmanager
def _environment() -> Iterator[None]:
    """Fixed terminal width, no colours, no windows, no progress on a slow machine."""
    from fitmodels.core import progress

    fixed = {"COLUMNS": "100", "LC_ALL": "C", "NO_COLOR": "1", "MPLBACKEND": "agg", "FITMODELS_TRACEBACK": "1"}
    before = {name: os.environ.get(name) for name in fixed}
    os.environ.update(fixed)
    patience, progress.PATIENCE = progress.PATIENCE, 3600.0
    try:
        yield
    finally:
        progress.PATIENCE = patience
        for name, value in before.items():
            os.environ.pop(name, None) if value is None else os.environ.__setitem__(name, value)


def _python(source: str, names: dict[str, Any]) -> str:
    with contextlib.redirect_stdout(io.StringIO()) as out:
        exec(compile(source, "page", "exec"), names)  # noqa: S102  our own page
    return out.getvalue()


def _command(source: str) -> str:
    """Output of a command on both streams, and its exit code where the command ends with `; echo $?`."""
    from fitmodels.cli import main

    plain, asked, _ = source.replace("\\\n", " ").partition("; echo $?")
    plain, _, kept = plain.partition(" > ")
    if not SIMPLE.fullmatch(plain):
        run = {"capture_output": True, "text": True, "check": False}
        done = subprocess.run(["bash", "-c", _resolved(source)], **run)  # noqa: S603, S607
        return done.stdout + PROGRESS.sub("", done.stderr)
    out = io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
        code = main(shlex.split(plain)[1:])
    if kept:
        Path(kept.strip()).write_text(out.getvalue(), encoding="utf-8")
    return ("" if kept else out.getvalue()) + (f"{code}\n" if asked else "")


PROGRESS = re.compile(
    r"^(?:.*\b\d[\d ]* of \d[\d ]* \w+.*|(?:reading|planning|writing) [\w-]+)\n", flags=re.M
)  # printed on slow machines only


def _resolved(source: str) -> str:
    return f'fitmodels() {{ {shlex.quote(sys.executable)} -m fitmodels "$@"; }}\n{source}'


def script_of(page: str, name: str) -> str:
    """The commands and files of a page as a script for ``bash`` that stops at the first failure."""
    parts = ["set -eu"]
    for item in examples_of(page):
        if isinstance(item, tuple):
            parts.append(f"cat > {item[0]} <<'END'\n{item[1].rstrip()}\nEND")
        elif item.language == "console":
            parts.append(item.source)
    return f"# The commands of {name}; run it in the folder of a checkout.\n" + "\n".join(parts) + "\n"


def written(page: str, found: list[Difference]) -> str:
    """The page with the printed output; outputs in which lines are left out are not changed."""
    for one in sorted(found, key=lambda one: -one.example.start):
        if "..." in (line.strip() for line in one.example.expected.splitlines()):
            continue
        text = (
            "\n".join(line.rstrip() for line in one.printed.rstrip().splitlines()) + "\n" if one.printed.strip() else ""
        )
        page = page[: one.example.start] + text + page[one.example.end :]
    return page


def _main(arguments: list[str]) -> int:
    code = 0
    for name in (word for word in arguments if word not in ("--write", "--script")):
        page = Path(name).resolve()
        if "--script" in arguments:
            page.with_suffix(".sh").write_text(script_of(page.read_text("utf-8"), page.name), "utf-8")
            continue
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
