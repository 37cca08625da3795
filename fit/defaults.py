"""Which laws a file is asked for when nobody says: the papers' wear, force, power, load and roughness laws."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from ..datasets import Runs
from ..datasets.telling import Told
from .errors import FitError
from .lawfit import LawFit
from .laws import Error
from .load_line import load_law
from .regression import exponential_law, power_law

CONDITIONS = ("V", "f", "d", "t")
WEAR = ("AW", "VB")
LOADS = ("Fxz", "Fx", "Fy", "Fz", "Fc", "Ff", "Fp", "F", "P")


@dataclass(frozen=True, slots=True, repr=False)
class Refused(Told):
    """A law that the file suggests but does not allow, and why."""

    response: str
    reason: str


def default_laws(
    runs: Runs, *, error: Error = "multiplicative", by: str | None = None
) -> tuple[tuple[LawFit, ...], tuple[Refused, ...]]:
    """Every law of the papers whose columns the runs hold, and those that could not be fitted.

    Wear on V, f, d, t; each force and the power on V, f, d, t and wear; current on feed rate and wear;
    roughness as an exponential of the resultant force.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> laws, refused = fit.default_laws(datasets.read_runs(datasets.bundled("gc435_709m40")))
    >>> [law.response for law in laws], refused
    (['AW', 'Fxz', 'P'], ())
    """
    laws: list[LawFit] = []
    refused: list[Refused] = []

    def attempt(response: str, fit: Callable[[], LawFit]) -> None:
        try:
            laws.append(fit())
        except FitError as exc:
            refused.append(Refused(response, str(exc)))

    conditions = [name for name in CONDITIONS if runs.has(name)]
    wear = [name for name in WEAR if runs.has(name)]
    for name in wear:
        if conditions:
            attempt(name, partial(power_law, runs, name, conditions, error=error, by=by))
    for name in LOADS:
        if runs.has(name) and (conditions or wear):
            attempt(name, partial(power_law, runs, name, conditions + wear[:1], error=error, by=by))
    if runs.has("I") and runs.has("fm") and wear:
        attempt("I", partial(load_law, runs, wear=wear[-1]))
    if runs.has("Ra") and runs.has("F"):
        attempt("Ra", partial(exponential_law, runs, error=error, by=by))
    return tuple(laws), tuple(refused)
