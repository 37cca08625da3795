"""Laws of a file by its columns: which responses are fitted, on which factors, and in which form.

A response is fitted on the conditions of the cut (`law_conditions`) and, but for wear and tool life, on the wear. Forms
of papers: the load line of current on feed and wear (Tai, Tsai & Li 2023, doi 10.1109/ACCESS.2023.3330587, eq. 14);
roughness as an exponential of the resultant force where only the feed changed (eq. 5 of the constant-roughness paper).
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ..core.display import Displayable
from ..core.errors import UsageError
from ..datasets.options import Process, named_role
from ..datasets.runs import Readable, Runs, as_runs
from ..datasets.vocabulary import FLANK_WEAR, WEAR
from .available import computed
from .censored_lives import life_law
from .law_requests import ALL, LawRequest, form_for, parse_laws, symbol_of
from .lawfit import LawFit
from .laws import Error
from .regression import exponential_law, fit_form, load_law
from .rows import computed_note

CONDITIONS = ("V", "f", "d", "ae", "t")
SPEEDS, FEEDS, CLOCKS = ("V", "n"), ("f", "fz", "fm"), ("t", "lc", "lf")  # the first that a file has is taken
WHERE_VARIED = ("z", "D", "Dc", "re")  # conditions of a law only where the file holds several values
SETTINGS = (*SPEEDS, *FEEDS, "d", "ae", *CLOCKS, *WHERE_VARIED)
LOADS = ("Fxz", "Fx", "Fy", "Fz", "Fc", "Ff", "Fp", "F", "P", "M")
SURFACES = ("Ra", "Rz")
RESPONSES = (*WEAR, "T", *LOADS, "I", *SURFACES, "theta")
FEW = 5  # lines that are named

Has = Callable[[str], bool]


@dataclass(frozen=True, slots=True)
class Asked:
    """A law that columns or a user ask for: its response, factors and form, the request, and a note on the choice."""

    response: str
    factors: tuple[str, ...]
    form: str = "power"
    request: str = ""
    note: str = ""


@dataclass(frozen=True, slots=True, repr=False)
class Refused(Displayable):
    """A law that the file suggests but does not allow, and why."""

    response: str
    reason: str


@dataclass(frozen=True, slots=True)
class Held:
    """The columns of a file: which are there, which of them vary, and the process.

    Without ``varies`` every column counts as varying but those of `WHERE_VARIED`.
    """

    has: Has
    varies: Has
    process: Process | None = None

    @classmethod
    def of(cls, has: Has, varies: Has | None = None, process: Process | None = None) -> "Held":
        """Contents by names alone."""
        return cls(has, varies or (lambda name: has(name) and name not in WHERE_VARIED), process)

    @classmethod
    def of_runs(cls, runs: Runs) -> "Held":
        """Contents of runs: columns with a value, of roles and others, and those with several values."""
        known = {str(name): runs.data[name].dropna() for name in runs.data}
        held = frozenset(name for name, values in known.items() if len(values))
        varying = frozenset(name for name in held if _several(known[name].to_numpy()))
        return cls(held.__contains__, varying.__contains__, runs.process)

    def first(self, names: Sequence[str]) -> str | None:
        """The first of these names that is there and varies, or else the first that is there."""
        there = [name for name in names if self.has(name)]
        return next(filter(self.varies, there), there[0] if there else None)

    @property
    def rotating(self) -> bool:
        """Whether the tool rotates: milling, drilling, or columns of these."""
        if self.process is not None:
            return self.process in ("milling", "drilling")
        return self.has("Dc") or any(map(self.has, ("fz", "ae", "z"))) or not self.has("d")


def _several(values: "np.ndarray[tuple[int], np.dtype[np.generic]]") -> bool:
    return bool((values != values[0]).any())


def law_conditions(has: Has, varies: Has | None = None, process: Process | None = None) -> tuple[str, ...]:
    """Conditions that the laws of a file contain, in the order in which dependent ones are left out.

    They are V (without it the spindle speed n); f (without it, or where it is constant, the feed per tooth fz or the
    feed rate fm); d; ae; the time in cut t (without it the cutting path lc or the cut length lf). The number of teeth
    z, the diameter of the tool and the nose radius re are conditions where they vary; the diameter of a turned work
    is none, nor is a feed rate alone, which is what a controller of the load moves.

    Examples
    --------
    >>> law_conditions({"n", "fz", "d", "t"}.__contains__)
    ('n', 'fz', 'd', 't')
    >>> columns = {"V", "f", "Dc", "M"}.__contains__
    >>> law_conditions(columns, columns, "drilling")
    ('V', 'f', 'Dc')
    """
    return _conditions(Held.of(has, varies, process))


def _conditions(held: Held) -> tuple[str, ...]:
    of_tool = {name: name for name in ("z", "Dc", "D") if held.rotating and held.varies(name)}
    diameter = of_tool.get("Dc", of_tool.get("D"))
    found = [
        _speed(held), _feed(held), of_tool.get("z"), *filter(held.has, ("d", "ae")), diameter,
        *filter(held.varies, ("re",)), held.first(CLOCKS),
    ]  # fmt: skip
    conditions = tuple(name for name in found if name is not None)
    return () if conditions == ("fm",) else conditions


def _speed(held: Held) -> str | None:
    """V, but n of a rotating tool where V is not known, or constant for another reason than that n follows 1/D."""
    follows = held.has("V") and any(map(held.varies, ("D", "Dc")))
    return held.first(SPEEDS) if (held.rotating and not follows) or not held.has("V") else "V"


def _feed(held: Held) -> str | None:
    """Feed per revolution; per tooth where the number of teeth varies; the feed rate where no speed changes it."""
    if held.has("fz") and held.varies("z"):
        return "fz"
    feed = held.first(FEEDS)
    if feed == "fm" and any(map(held.varies, SPEEDS)):
        return next(filter(held.has, FEEDS))
    return feed


def asked_laws(has: Has, varies: Has | None = None, process: Process | None = None) -> tuple[Asked, ...]:
    """Every law that columns ask for, in the order of the output.

    Wear on the conditions (`law_conditions`); each force, power, torque, current, roughness and temperature on these
    and the wear; tool life T on the conditions without time. Current on feed and wear alone is a line, roughness
    where only feed and force change an exponential of the force.

    Parameters
    ----------
    has : callable
        Whether there is a column of this symbol.
    varies : callable, optional
        Whether it holds several values; without it every column counts as varying but those of `WHERE_VARIED`.
    process : {"turning", "milling", "drilling", "grinding"}, optional

    Examples
    --------
    >>> [(law.response, *law.factors) for law in asked_laws({"V", "t", "VB", "P"}.__contains__)]
    [('VB', 'V', 't'), ('P', 'V', 't', 'VB')]
    >>> [(law.response, *law.factors) for law in asked_laws({"V", "f", "d", "Ra", "T"}.__contains__)]
    [('T', 'V', 'f', 'd'), ('Ra', 'V', 'f', 'd')]
    """
    return _of_columns(Held.of(has, varies, process))


def _of_columns(held: Held) -> tuple[Asked, ...]:
    conditions = _conditions(held)
    settings = tuple(name for name in conditions if name not in CLOCKS)
    wear = () if _at_end_of_life(held) else tuple(filter(held.has, WEAR))
    given = conditions + wear[:1]
    asked = [
        *(Asked(name, conditions) for name in wear),
        Asked("T", settings),
        *(Asked(name, given) for name in LOADS),
        _current(held, settings, wear),
        *(_surface(held, name, conditions, wear[:1]) for name in SURFACES),
        Asked("theta", given if conditions else ()),
    ]
    return tuple(one for one in asked if one.factors and held.has(one.response))


def _at_end_of_life(held: Held) -> bool:
    """Whether the wear of a row is that at the end of a life: the criterion, neither a response nor a factor."""
    return held.has("T") and not any(map(held.has, CLOCKS))


def _current(held: Held, settings: tuple[str, ...], wear: tuple[str, ...]) -> Asked:
    """Straight line on feed and wear where nothing else varies, otherwise a power law on the conditions and wear."""
    feed = next(filter(held.has, ("fm", "f", "fz")), None)
    others = [name for name in settings if name not in FEEDS and held.varies(name)]
    land = [name for name in reversed(FLANK_WEAR) if name in wear] or list(wear[-1:])
    if feed is None or others:
        names = ", ".join((feed or "", *land[:1]))
        why = f'{", ".join(others)} varied as well: a power law; the straight line of one cut is --law "I ~ {names}"'
        return Asked("I", settings + wear[:1], note=why if feed else "")
    return Asked("I", (feed, land[0]), "load_line") if land else Asked("I", (feed,), "linear")


def _surface(held: Held, name: str, conditions: tuple[str, ...], wear: tuple[str, ...]) -> Asked:
    """Exponential of the force where nothing but the feed varies, otherwise a power law on conditions and wear."""
    if held.has("F") and not any(held.varies(one) for one in conditions if one not in FEEDS):
        return Asked(name, ("F",), "exponential")
    return Asked(name, conditions + wear if conditions else ())


def requested_laws(held: Held, texts: Sequence[str]) -> tuple[Asked, ...]:
    """The laws that columns ask for, with those of requests (``"Ra ~ V, f, d"``, ``"Ra ~ + VB"``) in their place.

    Laws of other responses stay. A factor that is no column is kept as written, so that the fit refuses it by name.

    Examples
    --------
    >>> held = Held.of({"V", "f", "d", "t", "VB", "Ra"}.__contains__)
    >>> [(law.response, *law.factors) for law in requested_laws(held, ["Ra ~ V, f", "VB ~ - d"])]
    [('VB', 'V', 'f', 't'), ('Ra', 'V', 'f')]
    """
    default = _of_columns(held)
    if not texts:
        return default
    requests = parse_laws(texts)
    asked = {one.response: one for one in default}
    for request in requests:
        response = symbol_of(request.response, held.has) or named_role(request.response)
        asked[response] = _requested(held, request, response, asked.get(response))
    return tuple(asked.values())


def _requested(held: Held, request: LawRequest, response: str, default: Asked | None) -> Asked:
    def named(names: Sequence[str]) -> tuple[str, ...]:
        return tuple(symbol_of(name, held.has) or named_role(name) for name in names)

    if request.factors:
        factors = named(request.factors)
    else:
        old = default.factors if default is not None else _conditions(held)
        gone, new = named(request.removed), named(request.added)
        factors = tuple(name for name in (*old, *(one for one in new if one not in old)) if name not in gone)
    return Asked(response, factors, _usual_form(response, factors), request.text)


def _usual_form(response: str, factors: tuple[str, ...]) -> str:
    if response == "I" and factors[0] in FEEDS and not {*factors[1:]} - {*WEAR} and len(factors) < 3:
        return ("linear", "load_line")[len(factors) - 1]
    return "exponential" if response in SURFACES and factors == ("F",) else "power"


def fit_asked(
    runs: Runs,
    asked: Asked,
    *,
    error: Error = "multiplicative",
    by: str | None = None,
    forms: Mapping[str, str] | None = None,
) -> LawFit:
    """Fit a law that was asked for, in its own form or in the one that ``forms`` names for its response.

    Raises
    ------
    FitError
        These rows do not allow it.
    UsageError
        A column of the law is not there.
    """
    _check_columns(runs, asked)
    form = form_for(asked.response, forms)
    if forms and form is not None:
        from .form_choice import fit_in_form, form_named

        reason = form_named(form).unsuited(asked.response, asked.factors)
        try:
            if not reason or asked.response in forms:
                return fit_in_form(runs, form, asked.response, asked.factors, error=error, by=by)
        except UsageError as unsuited:  # known from the process of the file alone
            if asked.response in forms:
                raise
            reason = str(unsuited).rstrip(".")
        law = fit_asked(runs, asked, error=error, by=by)
        return replace(law, notes=(*law.notes, f"not in the form {form}, but in its usual one: {reason}"))
    if asked.form == "load_line":
        return load_law(runs, feed=asked.factors[0], wear=asked.factors[1])
    if asked.form == "exponential":
        return exponential_law(runs, asked.response, asked.factors[0], error=error, by=by)
    if asked.response == "T" and error == "multiplicative":
        return life_law(runs, asked.factors, by=by)
    law = fit_form(runs, asked.form, asked.response, asked.factors, error=error, by=by)
    return replace(law, notes=(*law.notes, asked.note)) if asked.note else law


def _empty_responses(runs: Runs) -> tuple[Refused, ...]:
    """Responses whose column holds nothing."""
    lines = ", ".join(map(str, runs.lines[:FEW])) + (", ..." if len(runs.lines) > FEW else "")
    empty = (name for name in RESPONSES if name in runs.data and not runs.data[name].notna().any())
    return tuple(Refused(name, f"{name}: {len(runs)} rows left out: {name} missing (lines {lines}).") for name in empty)


def _wear_of_lives(held: Held, known: Collection[str]) -> tuple[Refused, ...]:
    """Wear that stands beside lives and has no law."""
    wear = [name for name in WEAR if held.has(name) and name not in known] if _at_end_of_life(held) else []
    why = "without a time or length of cut it is the wear at the end of each life T, no response;"
    return tuple(Refused(name, f'{name}: {why} --law "{name} ~ V, f" asks for a law of it.') for name in wear)


def _check_columns(runs: Runs, asked: Asked) -> None:
    """Refuse a law that names a column which the runs do not have."""
    held = [str(name) for name in runs.data]
    missing = next((name for name in (asked.response, *asked.factors) if name not in held), None)
    if missing is not None:
        law = f"law {asked.request!r}" if asked.request else f"law of {asked.response}"
        raise UsageError(f"{law}: there is no column {missing!r}; there are {', '.join(held)}.")


def default_laws(
    runs: Readable,
    *,
    error: Error = "multiplicative",
    by: str | None = None,
    laws: Sequence[str] = (),
    forms: Mapping[str, str] | None = None,
) -> tuple[tuple[LawFit, ...], tuple[Refused, ...]]:
    """Every law that the columns of the runs ask for (`asked_laws`), and those that could not be fitted.

    Parameters
    ----------
    runs : Runs, DataFrame or path
    error, by
        As of `power_law`.
    laws : sequence of str
        Laws in place of the default ones: ``"Ra ~ V, f, d"``; ``"Ra ~ + VB"`` and ``"Ra ~ - t"`` change the factors of
        the default law of this response.
    forms : mapping of str to str, optional
        Form of the law of a response, or of all others under ``*``: ``{"Ra": "linear"}`` (`form_choice.CHOICES`).

    Raises
    ------
    UsageError
        A text of ``laws`` is no law, or names a column that the runs do not have.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    >>> [law.response for law in fit.default_laws(runs)[0]]
    ['AW', 'Fxz', 'P']
    >>> fit.default_laws(runs, laws=["P ~ V, f, d"])[0][2].factors
    ('V', 'f', 'd')
    """
    runs = as_runs(runs)
    found, refused = list[LawFit](), list[Refused]()
    held = Held.of_runs(runs)
    for asked in requested_laws(held, laws):
        if asked.request:
            _check_columns(runs, asked)
        law = computed(partial(fit_asked, runs, asked, error=error, by=by, forms=forms), (OSError, UsageError))
        if isinstance(law, LawFit):
            found.append(replace(law, notes=(*law.notes, *computed_note(runs, law.response))))
        else:
            refused.append(Refused(asked.response, f"{law.reason}."))
    known = {ALL, *(law.response for law in found), *(item.response for item in refused)}
    refused += [
        Refused(name, f"these columns ask for no law of it, so that none is kept in the form {form}.")
        for name, form in (forms or {}).items()
        if name not in known
    ]
    return tuple(found), (*refused, *_empty_responses(runs), *_wear_of_lives(held, known))


def fit_law(
    runs: Readable, law: str, *, form: str | None = None, error: Error = "multiplicative", by: str | None = None
) -> LawFit:
    """Fit one law as it is written, in its usual form or in another.

    Parameters
    ----------
    runs : Runs, DataFrame or path
    law : str
        ``"Ra ~ V, f, d"``, or a change of the default law of a response, ``"Ra ~ + VB"``.
    form : str, optional
        Name of a form, e.g. ``second-order`` (`form_choice.CHOICES`).
    error, by
        As of `power_law`.

    Raises
    ------
    UsageError, FitError
        No such law, column or form; the form does not suit the law, or the rows do not allow it.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    >>> fit.fit_law(runs, "Fxz ~ V, f, d, AW", form="linear").form
    'linear'
    """
    runs = as_runs(runs)
    asked = next(one for one in requested_laws(Held.of_runs(runs), [law]) if one.request)
    return fit_asked(runs, asked, error=error, by=by, forms=None if form is None else {asked.response: form})
