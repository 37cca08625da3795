"""What a long run says of itself while it runs: one line that is renewed, in a notebook or at a terminal."""

from time import monotonic

from ...core.progress import status_line
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
    line = status_line()

    def tell(steps: int, effective: float) -> None:
        nonlocal last
        now = monotonic()
        if now - began >= patience and now - last >= min(EVERY, patience):
            last = now
            line(f"{what}: {steps} steps, {effective:.0f} effective draws, {now - began:.0f} s")

    return tell
