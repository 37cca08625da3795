"""Default laws of a file by its columns: the papers' wear, force, power, load and roughness laws."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Literal

from ..core.display import Displayable
from ..core.errors import UsageError
from ..datasets import Runs
from .available import computed
from .lawfit import LawFit
from .laws import Error
from .regression import exponential_law, load_law, power_law

CONDITIONS = ("V", "f", "d", "ae", "t")
STAND_INS = {"V": ("n",), "f": ("fz", "fm")}  # in place of a condition that is neither measured nor computed
WEAR = ("AW", "VB")
LANDS = ("VBC", "VBN")  # nose and notch, where they are the only wear
LOADS = ("Fxz", "Fx", "Fy", "Fz", "Fc", "Ff", "Fp", "F", "P")


@dataclass(frozen=True, slots=True)
class Asked:
    """A law that columns ask for: its response, its factors, and which kind of law it is."""

    response: str
    factors: tuple[str, ...]
    kind: Literal["power", "load", "exponential"] = "power"


def law_conditions(has: Callable[[str], bool]) -> tuple[str, ...]:
    """Conditions that the laws of a file contain: V, f, d, ae and t.

    Without V the spindle speed stands in its place, without f the feed per tooth or the feed rate.

    A feed rate alone is no condition of a law: it is what a controller of the load moves.

    >>> law_conditions({"n", "fz", "d", "t"}.__contains__)
    ('n', 'fz', 'd', 't')
    """
    found = (next((name for name in (one, *STAND_INS.get(one, ())) if has(name)), None) for one in CONDITIONS)
    conditions = tuple(name for name in found if name is not None)
    return () if conditions == ("fm",) else conditions


def asked_laws(has: Callable[[str], bool]) -> tuple[Asked, ...]:
    """Every law of the papers that columns ask for, in the order of the output.

    Wear on the conditions (`law_conditions`); each force and the power on these and wear; current on feed rate and
    wear; roughness as an exponential of the resultant force.

    Parameters
    ----------
    has : callable
        Whether there is a column of this symbol.

    Examples
    --------
    >>> [(law.response, *law.factors) for law in asked_laws({"V", "t", "VB", "P"}.__contains__)]
    [('VB', 'V', 't'), ('P', 'V', 't', 'VB')]
    """
    conditions = law_conditions(has)
    wear = tuple(name for name in WEAR if has(name)) or tuple(name for name in LANDS if has(name))
    asked = [Asked(name, conditions) for name in wear if conditions]
    asked += [Asked(name, conditions + wear[:1]) for name in LOADS if has(name) and (conditions or wear)]
    if has("I") and has("fm") and wear:
        asked.append(Asked("I", ("fm", wear[-1]), "load"))
    if has("Ra") and has("F"):
        asked.append(Asked("Ra", ("F",), "exponential"))
    return tuple(asked)


def fit_asked(runs: Runs, asked: Asked, *, error: Error = "multiplicative", by: str | None = None) -> LawFit:
    """Fit a law that was asked for.

    Raises
    ------
    FitError
        These rows do not allow it.
    """
    if asked.kind == "load":
        return load_law(runs, wear=asked.factors[-1])
    if asked.kind == "exponential":
        return exponential_law(runs, asked.response, asked.factors[0], error=error, by=by)
    return power_law(runs, asked.response, asked.factors, error=error, by=by)


@dataclass(frozen=True, slots=True, repr=False)
class Refused(Displayable):
    """A law that the file suggests but does not allow, and why."""

    response: str
    reason: str


def default_laws(
    runs: Runs, *, error: Error = "multiplicative", by: str | None = None
) -> tuple[tuple[LawFit, ...], tuple[Refused, ...]]:
    """Every law that the columns of the runs ask for (`asked_laws`), and those that could not be fitted.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> laws, refused = fit.default_laws(datasets.read_runs(datasets.bundled("gc435_709m40")))
    >>> [law.response for law in laws], refused
    (['AW', 'Fxz', 'P'], ())
    """
    laws: list[LawFit] = []
    refused: list[Refused] = []
    for asked in asked_laws(runs.has):
        law = computed(partial(fit_asked, runs, asked, error=error, by=by), (OSError, UsageError))
        if isinstance(law, LawFit):
            laws.append(law)
        else:
            refused.append(Refused(asked.response, f"{law.reason}."))
    return tuple(laws), tuple(refused)
