"""One run of the main command when it is imported: processes that are forked afterwards have all that a run imports.

The server of processes of `jobs` imports this module; nothing else does. Nothing is printed or kept.
"""

import contextlib
import io
import tempfile
from importlib import import_module

from ..datasets import bundled

with (
    contextlib.suppress(Exception),  # without it the first command is slower, and says what is wrong
    contextlib.redirect_stdout(io.StringIO()),
    contextlib.redirect_stderr(io.StringIO()),
    tempfile.TemporaryDirectory() as folder,
):
    run = import_module("fitmodels.cli").main  # by its name: the command is above this package
    for words in ([], ["look", "--json"]):
        run([*words[:1], str(bundled("gc435_709m40")), *words[1:], *([] if words else ["--out", folder, "--force"])])
