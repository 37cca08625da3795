"""``fitmodels app``: a page in the browser of this machine that runs the commands on the files of a project folder."""

import argparse
from pathlib import Path

from .arguments import Parser
from .output import print_lines

FOLDER = "fitmodels-project"


def parser() -> Parser:
    """Arguments of ``fitmodels app``."""
    p = Parser(
        "fitmodels app",
        "fitmodels app data.csv",
        "Open a page in the browser of this machine: drop a file of tests, see how it was read, correct it by menus,\n"
        "see laws, verdicts and card, set limits, tune, replay and export. The page runs the commands that it shows,\n"
        "in a project folder that keeps files, choices and results; the same commands give the same results there.\n\n"
        "It is served to this machine alone, loads nothing from elsewhere, and ends with the command (Ctrl-C). It\n"
        "needs starlette and uvicorn: pip install 'fitmodels[app]'.",
    )
    p.add_argument("file", metavar="FILE", nargs="*", help="files to add to the project (default: none)")
    p.add_argument("--folder", metavar="DIR", default=FOLDER, help=f"the project folder (default: ./{FOLDER})")
    p.add_argument("--port", metavar="N", type=int, default=0, help="port of the page (default: a free one)")
    p.add_argument("--no-browser", action="store_true", help="print the address only; open no browser")
    p.add_argument("--quiet", "-q", action="store_true", help="print only errors and the address")
    return p


def run(args: argparse.Namespace) -> int:
    """Serve the page until it is interrupted, and return the exit code."""
    from ..core.errors import UsageError

    try:
        from ..app.server import open_browser, serve
    except ImportError as missing:
        raise UsageError(
            f"the page needs {missing.name}, which is not installed: pip install 'fitmodels[app]'."
        ) from None
    from ..app.project import Project
    from ..core.bounded import open_regular
    from . import keep_running, main

    project = Project(args.folder)
    for name in args.file:
        with open_regular(name, "measurements") as content:
            project.add(Path(name).name, content)

    def opened(address: str) -> None:
        print_lines([address] if args.quiet else [
            f"The page of {project.folder}: {address}",
            "It is answered to this machine alone. Ctrl-C ends it; files, choices and results stay in the folder.",
        ])  # fmt: skip
        if not args.no_browser:
            open_browser(address)

    keep_running()
    serve(project, main, args.port, opened)
    return 0
