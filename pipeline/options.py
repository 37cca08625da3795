"""Options of the main job, validated once: how a file of tests is read, and how the laws of each pair are fitted."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from math import inf
from numbers import Integral, Real
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

from ..core.bounded import sha256_of
from ..core.errors import UsageError
from ..core.suggestions import did_you_mean
from ..datasets.options import ReadOptions, check_choice
from ..datasets.plausibility.ranges import MOST_WEAR

Error: TypeAlias = Literal["multiplicative", "additive"]

NAMED_PRIORS = ("weak", "reference")
# Names in the parameter file are those of the command's options.
OF_READING = (
    *("map", "unit", "range", "value", "tool", "work", "edge", "process", "decimal", "delimiter", "sheet", "hidden"),
    *("correct", "leave_out"),
)
RECORDED = (
    *("map", "unit", "range", "value", "law", "tool", "work", "by", "error", "criterion", "gauge_sd", "seed", "draws"),
    *("priors", "student", "verify", "posterior_figures", "decimal", "delimiter", "sheet", "edge", "process", "hidden"),
    *("correct", "leave_out", "form"),
)


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class FitOptions(ReadOptions):
    """Options of an analysis, with the names and defaults of the command ``fitmodels FILE``.

    Attributes
    ----------
    map, units, ranges, constants, correct, leave_out, tool, work, edge, process, decimal, delimiter, sheet, hidden
        How a file is read, as in `datasets.read_runs`.
    laws : tuple of str
        Laws in place of the default ones, as ``"Ra ~ V, f, d"``, or changes of their factors, as ``"Ra ~ + VB"``.
    by : str or None
        A category whose levels shift the laws, fitted together.
    error : {"multiplicative", "additive"}
        Multiplicative errors (log scale) or additive errors (original scale).
    form : str or mapping of str to str
        Form that laws are kept in (`fit.form_choice.CHOICES`): of all laws, or by response with ``*`` for all others;
        empty for the usual ones.
    criterion : float or None
        Wear at the end of tool life, mm; 0.3 mm where None.
    gauge_sd : float or None
        Standard deviation of the wear gauge, mm.
    seed, draws : int
        Of the posterior.
    priors : str, path or mapping
        ``weak``, ``reference``, the path of a TOML file of priors, or its content.
    student : bool
        Student-t errors in the posterior.
    verify : bool
        Compare every law with statsmodels, and every posterior with chains of another sampler.
    posterior_figures : bool
        Draw four figures of each posterior when the result is written.

    Examples
    --------
    >>> FitOptions(criterion=0.2).criterion
    0.2
    >>> FitOptions(draws=3)
    Traceback (most recent call last):
    fitmodels.core.errors.UsageError: draws 3: give a whole number from 1000 (fewer cannot pass the convergence \
checks) to 1000000.
    """

    laws: tuple[str, ...] = ()
    by: str | None = None
    error: Error = "multiplicative"
    form: str | Mapping[str, str] = ""
    criterion: float | None = None
    gauge_sd: float | None = None
    seed: int = 1
    draws: int = 4000
    priors: str | os.PathLike[str] | Mapping[str, object] = "weak"
    student: bool = False
    verify: bool = False
    posterior_figures: bool = False

    def __post_init__(self) -> None:
        from ..fit.bayes import FEWEST_DRAWS, MOST_DRAWS
        from ..fit.law_requests import parse_laws

        ReadOptions.__post_init__(self)
        if isinstance(self.laws, str) or not isinstance(self.laws, Sequence):
            raise UsageError(f"laws {self.laws!r}: give a list of texts, for instance ['Ra ~ V, f, d'].")
        object.__setattr__(self, "laws", tuple(self.laws))
        parse_laws(self.laws)
        check_choice("error", self.error, get_args(Error))
        if not isinstance(self.by, str | None):
            raise UsageError(f"by {self.by!r}: give a text, or leave it out.")
        if self.criterion is not None and not (_is_number(self.criterion) and 0 < self.criterion < inf):
            raise UsageError(f"criterion {self.criterion}: a wear criterion is above zero, for instance 0.3.")
        if self.criterion is not None and self.criterion > MOST_WEAR:
            most = f"more than the {MOST_WEAR:g} mm of wear that an edge can have"
            raise UsageError(f"criterion {self.criterion:g} mm: {most}; give mm, for instance 0.3.")
        if self.gauge_sd is not None and not (_is_number(self.gauge_sd) and 0 <= self.gauge_sd < inf):
            raise UsageError(f"gauge_sd {self.gauge_sd}: a standard deviation is not below zero, for instance 0.01.")
        if not (_is_whole(self.seed) and 0 <= self.seed < 2**32):
            raise UsageError(f"seed {self.seed}: give a whole number from 0 to {2**32 - 1}.")
        if not (_is_whole(self.draws) and FEWEST_DRAWS <= self.draws <= MOST_DRAWS):
            few = f"{FEWEST_DRAWS} (fewer cannot pass the convergence checks)"
            raise UsageError(f"draws {self.draws}: give a whole number from {few} to {MOST_DRAWS}.")
        for name, kind in (("seed", int), ("draws", int), ("criterion", float), ("gauge_sd", float)):
            if (given := getattr(self, name)) is not None:  # of numpy, too, which no file takes
                object.__setattr__(self, name, kind(given))
        if not isinstance(self.priors, str | os.PathLike | Mapping):
            raise UsageError(
                f"priors {self.priors!r}: give 'weak', 'reference', the path of a TOML file or its content."
            )
        for name in ("student", "verify", "posterior_figures"):
            check_choice(name, getattr(self, name), (True, False))
        self.forms  # noqa: B018  a form that does not exist is refused here
        self.prior_tables()  # a file of priors that cannot be read is refused here

    @property
    def forms(self) -> dict[str, str]:
        """Form of the laws of each response, under ``*`` of all others; empty for the usual ones.

        Examples
        --------
        >>> FitOptions(form="second_order").forms, FitOptions(form={"Ra": "linear"}).forms
        ({'*': 'second-order'}, {'Ra': 'linear'})
        """
        if not self.form and isinstance(self.form, str):
            return {}
        from ..datasets.vocabulary import ROLES
        from ..fit.form_choice import form_named
        from ..fit.law_requests import ALL

        if isinstance(self.form, str):
            return {ALL: form_named(self.form).name}
        if not isinstance(self.form, Mapping):
            raise UsageError(f"form {self.form!r}: give the name of a form, or one for each response.")
        for name in self.form:
            if name != ALL and name not in ROLES:
                raise UsageError(f"form of {name}: there is no such response. {did_you_mean(name, list(ROLES))}")
        return {name: form_named(form).name for name, form in self.form.items()}

    def form_of(self, response: str) -> str | None:
        """Form that the law of a response is kept in; None for the usual one."""
        from ..fit.law_requests import form_for

        return form_for(response, self.forms)

    def prior_tables(self) -> str | Mapping[str, object]:
        """The priors as `fit.posterior` takes them, read where they are a file; refused for an unknown response."""
        if not isinstance(self.priors, Mapping) and self.priors in NAMED_PRIORS:
            return self.priors
        from ..datasets.vocabulary import ROLES
        from ..fit.bayes.priors_file import laws_of, read_priors
        from ..fit.law_requests import parse_laws

        tables = self.priors if isinstance(self.priors, Mapping) else read_priors(Path(self.priors))
        asked = [request.response for request in parse_laws(self.laws)]
        for name in laws_of(tables):
            if name not in ROLES and name not in asked:
                raise UsageError(f"priors of {name}: there is no such response. {did_you_mean(name, list(ROLES))}")
        return tables

    def recorded(self) -> dict[str, Any]:
        """Options for the provenance of a parameter file: the kind of errors, and what differs from the defaults.

        Examples
        --------
        >>> FitOptions(criterion=0.2, map={"VB": "col7"}).recorded()
        {'map': ['VB=col7'], 'error': 'multiplicative', 'criterion': 0.2}
        """
        ranges = {symbol: ":".join(f"{end:.12g}" for end in ends) for symbol, ends in self.ranges.items()}
        values = {symbol: f"{value:.12g}" for symbol, value in self.constants.items()}
        given_by_role = {"map": self.map, "unit": self.units, "range": ranges, "value": values}
        listed = {name: _equations(of) for name, of in given_by_role.items()} | {"law": list(self.laws)}
        given: dict[str, Any] = {name: value for name, value in listed.items() if value}
        usual = {one.name: one.default for one in fields(self)}
        for name in RECORDED[len(listed) :]:
            value = getattr(self, name)
            if name == "error" or value != usual[name]:
                given[name] = _plain(value)
        if isinstance(self.form, Mapping) and self.form:
            given["form"] = _equations(self.forms)
        if isinstance(given.get("priors"), str) and given["priors"] not in NAMED_PRIORS:
            given["priors_sha256"] = sha256_of(given["priors"])
        return given


def fit_options(given: Mapping[str, Any]) -> FitOptions:
    """Options from keywords; a name that does not exist is refused with the closest one.

    Raises
    ------
    UsageError

    Examples
    --------
    >>> fit_options({"criterium": 0.2})
    Traceback (most recent call last):
    fitmodels.core.errors.UsageError: criterium: there is no such option. Did you mean 'criterion'?
    """
    known = [one.name for one in fields(FitOptions)]
    for name in given:
        if name not in known:
            raise UsageError(f"{name}: there is no such option. {did_you_mean(name, known)}")
    return FitOptions(**given)


def _plain(value: object) -> object:
    """A value as JSON has it."""
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    return list(value) if isinstance(value, tuple) else value


def _is_number(value: object) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool)


def _is_whole(value: object) -> bool:
    return isinstance(value, Integral) and not isinstance(value, bool)


def _equations(of: Mapping[str, str]) -> list[str]:
    return [f"{symbol}={value}" for symbol, value in of.items()]
