"""What a long run says of itself while it runs: one line that is renewed, in a notebook or at a terminal."""

import sys
from time import monotonic
from typing import Any

from .chains import Progress

PATIENCE = 2.0  # s: what takes less says nothing
EVERY = 0.2  # s between two looks


def watch(what: str = "drawing", patience: float = PATIENCE) -> Progress:
    """A ``progress`` for ``posterior``, ``latent_wear`` and ``rival_posterior``: steps, effective draws and seconds.

    In a notebook the line stands under the cell and is renewed there; at a terminal on standard error; into a pipe
    nothing is written.

    Parameters
    ----------
    what : str
        What the line begins with.
    patience : float
        Seconds before anything is shown.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> fit.posterior(law, seed=1, progress=fit.watch()).method
    'exact'
    """
    began = last = monotonic()
    line = _notebook_line() or _terminal_line

    def tell(steps: int, effective: float) -> None:
        nonlocal last
        now = monotonic()
        if now - began >= patience and now - last >= min(EVERY, patience):
            last = now
            line(f"{what}: {steps} steps, {effective:.0f} effective draws, {now - began:.0f} s")

    return tell


def _terminal_line(text: str) -> None:
    if sys.stderr.isatty():
        sys.stderr.write(f"\x1b[2K{text}\r")  # the cursor goes back: what is written next stands in its place
        sys.stderr.flush()


def _notebook_line() -> Any:  # noqa: ANN401
    """A line under the running cell; None outside a notebook."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    if shell is None or not hasattr(shell, "kernel"):
        return None
    from IPython import display  # type: ignore[import-not-found, unused-ignore]

    show: Any = display.display

    class Line:
        def __init__(self) -> None:
            self.text, self.handle = "", None

        def __repr__(self) -> str:
            return self.text

        def __call__(self, text: str) -> None:
            self.text = text
            if self.handle is None:
                self.handle = show(self, display_id=True)
            else:
                self.handle.update(self)

    return Line()
