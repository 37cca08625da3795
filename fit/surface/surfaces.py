"""Response surface: a law of second order with its term-wise tests, selection of terms and canonical analysis.

``ols``, ``anova_lm``, ``mixedlm``, ``influence`` and ``beside_statsmodels`` are computed by statsmodels, from a formula
in centred factors; it is imported by them alone.
"""

import warnings
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np
import pandas as pd

from ...core.arrays import Array
from ...core.errors import FitError, UsageError
from ...core.formula import Term, first_order_terms, second_order_terms
from ...core.predicts import PredictsByLaw
from ...datasets.runs import Readable, as_runs
from ...datasets.vocabulary import ROLES
from ..available import NotAvailable, computed
from ..checks.model_checks import LackOfFit, lack_of_fit
from ..checks.strata import split
from ..edges import EdgeInference
from ..fitted_rows import LawFigures
from ..lawfit import LawFit
from ..laws import Error
from ..regression import fit_form, refitted
from ..rows import LeftOut
from ..statsmodels_ols import centred_rows, centred_words, scaled_response
from .canonical import CanonicalAnalysis, analyse_surface
from .split_plot import (
    EdgeModel,
    TermTest,
    Type,
    edge_model,
    frame_of_tests,
    means_regression,
    term_tests,
)
from .term_selection import (
    TermSelection,
    columns_of,
    containing_terms,
    factors_in,
    own_terms,
    selected_terms,
    term_groups,
)

CLOCKS = ("time", "wear")  # kinds of factors that are not set: held in a canonical analysis
SELECTED = (  # in the note of a law whose terms were chosen on its own rows
    "terms kept by AICc with strong heredity; intervals of this law take them as given in advance and are somewhat too "
    "narrow"
)
Model = Literal["full", "reduced", "factorial", "first"]
Scale = Literal["log", "original"]

# form of second order and of first order, and error structure
FORM_OF: Mapping[str, tuple[str, str, Error]] = {
    "log": ("second_order", "power", "multiplicative"),
    "original": ("second_order_original", "linear", "additive"),
}
TERMS_OF: Mapping[str, Callable[[Sequence[str]], tuple[Term, ...]]] = {
    "full": second_order_terms,
    "reduced": second_order_terms,
    "factorial": lambda names: tuple(term for term in second_order_terms(names) if max(term.degrees) == 1),
    "first": first_order_terms,
}


@dataclass(frozen=True, slots=True, repr=False)
class ResponseSurface(PredictsByLaw, LawFigures):
    """A response surface of second order.

    Attributes
    ----------
    law : LawFit
        The law that is kept: all terms asked for, or those chosen by AICc.
    full : LawFit
        The law with all terms asked for, of which the tests are; the same as ``law`` without a selection.
    model : EdgeModel or NotAvailable
        Rows and edges of ``full`` as the tests take them, or why there are no tests.
    selection : TermSelection or None
    lack_of_fit : LackOfFit or NotAvailable
        Of ``full`` against replicated edges, or replicated rows where rows are independent.
    blocks : str or None
        Category of the blocks.
    """

    law: LawFit
    full: LawFit
    model: EdgeModel | NotAvailable
    selection: TermSelection | None
    lack_of_fit: LackOfFit | NotAvailable
    blocks: str | None

    @property
    def terms(self) -> dict[str, list[int]]:
        """Columns of each term of ``full``, blocks last."""
        return columns_of(self.full)

    def tests(self, typ: Type = 3) -> tuple[TermTest, ...]:
        """Test of each term, then of all squares and of all products of each error term.

        Raises
        ------
        FitError
            These rows do not allow tests.
        """
        if typ not in get_args(Type):
            raise UsageError(f"typ={typ!r}: a test is of type 2 or 3.")
        if isinstance(self.model, NotAvailable):
            raise FitError(f"{self.full.response}: no tests of terms: {self.model}.")
        return term_tests(
            self.model,
            self.terms,
            typ=typ,
            containing=containing_terms(self.full),
            groups=term_groups(self.full, self.model),
        )

    def anova(self, typ: Type = 3) -> pd.DataFrame:
        """Tests as a frame, with the p of inference by edge (CR3) as ``p by edge`` where there is one.

        Parameters
        ----------
        typ : {2, 3}
            Type III adjusts a term for all others, type II for those that do not contain it.
        """
        table = frame_of_tests(self.tests(typ))
        if isinstance(self.full.edges, EdgeInference) and typ == 3:
            p = self.full.pvalues
            table["p by edge"] = [float(p[name]) if name in p.index else np.nan for name in table.index]
        return table

    def canonical(self, at: Mapping[str, float] | None = None) -> CanonicalAnalysis | NotAvailable:
        """Canonical analysis of the kept law over the factors that are set; time and wear are held.

        Parameters
        ----------
        at : mapping of str to float
            Factors that are held, with their values; by default times and wear at the middle of their ranges.

        Raises
        ------
        UsageError
            ``at`` names no factor of the law.
        """
        law = self.law
        if missing := _not_separated(self.full, _held(law, at)):
            return NotAvailable(missing)
        return analyse_surface(law, self.model if law is self.full else _model_of(law), _held(law, at))

    def local_exponents(self) -> pd.DataFrame:
        """Lowest and highest slope of each factor over the rows; in logarithms the exponent of a power law there."""
        slopes = _slopes(self.law)
        return pd.DataFrame({"low": slopes.min(axis=0), "high": slopes.max(axis=0)}, index=list(self.law.factors))

    @property
    def formula(self) -> str:
        """Formula of ``full`` for statsmodels, in the columns of ``frame``."""
        words = list(centred_words(self.full).values())
        return " + ".join([f"y ~ {words[0]}", *words[1:], *(["C(block, Sum)"] if self.blocks else [])])

    @property
    def frame(self) -> pd.DataFrame:
        """Rows for statsmodels: ``y`` on the scale of the fit, centred factors, ``block`` and ``edge``."""
        return centred_rows(self.full)

    def ols(self) -> Any:  # noqa: ANN401  statsmodels has no types
        """All terms by ``smf.ols``, rows taken as independent: a statsmodels result."""
        import statsmodels.formula.api as smf  # type: ignore[import-untyped]

        return smf.ols(self.formula, self.frame).fit()

    def anova_lm(self, typ: Type = 2) -> pd.DataFrame:
        """The plain analysis of variance of rows by statsmodels, to compare: its F are too large where edges repeat."""
        from statsmodels.stats.anova import anova_lm  # type: ignore[import-untyped]

        table: pd.DataFrame = anova_lm(self.ols(), typ=typ)
        return table

    def mixedlm(self) -> Any:  # noqa: ANN401
        """All terms and a random level of each edge by ``smf.mixedlm``, restricted maximum likelihood.

        Raises
        ------
        FitError
            The file names no edges with several rows.
        """
        import statsmodels.formula.api as smf

        if isinstance(self.model, NotAvailable) or not self.model.n_edges:
            raise FitError(f"{self.full.response}: no edges with several rows, so there is no random level of edges.")
        with warnings.catch_warnings():
            if self.model.ratio > 0:  # statsmodels warns of a variance of zero wherever the scale of y makes it small
                warnings.filterwarnings("ignore", "The MLE may be on the boundary")
            return smf.mixedlm(self.formula, self.frame, groups="edge").fit(reml=True)

    def beside_statsmodels(self) -> pd.DataFrame:
        """P of each term by stratum and by edge (CR3), beside statsmodels' plain rows and its mixed model.

        Plain rows (``p rows``) find too much in V, f and d where edges have several rows; Wald tests of the mixed model
        (``p mixed``) count no degrees of freedom, which finds too much where edges are few.
        """
        words, table = centred_words(self.full), self.anova()
        shown = table.loc[list(words), [name for name in ("error", "p", "p by edge") if name in table]].copy()
        shown["p rows"] = self.ols().pvalues[list(words.values())].to_numpy()
        if isinstance(self.model, EdgeModel) and self.model.n_edges:
            shown["p mixed"] = self.mixedlm().pvalues[list(words.values())].to_numpy()
        return shown

    def influence(self) -> pd.DataFrame:
        """Leverage, studentized residual and Cook's distance of each edge, or row, by statsmodels' ``OLSInfluence``.

        Of edges it is the regression of their levels on the terms that change between edges.
        """
        import statsmodels.api as sm  # type: ignore[import-untyped]

        if isinstance(self.model, NotAvailable):
            raise FitError(f"{self.full.response}: no influence of edges: {self.model}.")
        rows = means_regression(self.model)
        found = sm.OLS(rows[:, -1], rows[:, :-1]).fit().get_influence()
        labels = np.unique(np.asarray(self.full.edge, dtype=str)) if self.model.n_edges else self.full.lines
        columns = {
            "leverage": found.hat_matrix_diag,
            "studentized": found.resid_studentized_external,
            "cooks_distance": found.cooks_distance[0],
        }
        return pd.DataFrame(columns, index=pd.Index(labels, name="edge" if self.model.n_edges else "line"))


def response_surface(
    runs: Readable,
    response: str,
    factors: Sequence[str],
    *,
    model: Model = "full",
    scale: Scale = "log",
    blocks: str | None = None,
    edge: str | None = "edge",
) -> ResponseSurface:
    """Fit a response surface of second order.

    Parameters
    ----------
    runs : Runs, DataFrame or path
    response : str
    factors : sequence of str
        Most important first. Terms that the rows do not identify are left out by name.
    model : {"full", "reduced", "factorial", "first"}
        Factors, squares and products; of these the terms chosen by AICc with strong heredity; factors and products;
        factors alone.
    scale : {"log", "original"}
        ln R as a polynomial in ln X (each coefficient of a factor is its exponent at the centre), or R in X.
    blocks : str, optional
        Category of blocks (days, machines, charges), each with a level of its own.
    edge : str or None
        Column with the edge of each row; None: rows are taken as independent.

    Raises
    ------
    FitError
        Too few rows, or no factor that changes.
    UsageError
        A model or scale that does not exist.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    >>> surface = fit.response_surface(runs, "AW", ["V", "f", "d", "t"])
    >>> surface.anova().loc[["V^2", "V*t"], ["error", "p"]].round(3).to_numpy().tolist()
    [['edges', 0.011], ['rows within edges', 0.243]]
    """
    if model not in get_args(Model):
        raise UsageError(f"model={model!r}: it is {', '.join(map(repr, get_args(Model)))}.")
    if scale not in FORM_OF:
        raise UsageError(f"scale={scale!r}: it is 'log' or 'original'.")
    form, first_order, error = FORM_OF[scale]
    options: dict[str, Any] = {"error": error, "edge": edge, "by": blocks}
    tests = as_runs(runs)
    plane = fit_form(tests, first_order, response, factors, **options)  # leaves out factors that are not identified

    def fitted(terms: Sequence[Term], left_out: tuple[LeftOut, ...]) -> LawFit:
        law = fit_form(tests, form, response, factors_in(terms, plane.factors), terms=own_terms(terms), **options)
        return replace(law, left_out=(*left_out, *law.left_out))

    terms = TERMS_OF[model](plane.factors)
    _check_rows(plane, terms)
    surface = _tested(fitted(terms, plane.left_out))
    return _reduced(surface, fitted) if model == "reduced" else surface


def _check_rows(plane: LawFit, terms: Sequence[Term]) -> None:
    """Refuse fewer rows than coefficients, with the models that they allow."""
    shifts = plane.shifts.shape[1]
    if plane.nobs >= 1 + len(terms) + shifts:
        return
    counts = {name: 1 + len(TERMS_OF[name](plane.factors)) + shifts for name in ("factorial", "first")}
    allowed = [f"use model={name!r} ({count})" for name, count in counts.items() if count < plane.nobs]
    n = 1 + len(terms) + shifts
    raise FitError(
        f"{plane.response}: {plane.nobs} usable rows for the {n} coefficients of second order in "
        f"{', '.join(plane.factors)}. Measure at least {n + 1 - plane.nobs} more, {', '.join([*allowed, ''])}or leave "
        "factors out."
    )


def _reduced(
    surface: ResponseSurface, fitted: Callable[[Sequence[Term], tuple[LeftOut, ...]], LawFit]
) -> ResponseSurface:
    """The surface with the terms that AICc chooses; its tests are those of all terms, where these leave tests."""
    full, why = surface.full, surface.model
    chosen = selected_terms(full, _model_of(full, saturated=True))
    if chosen is None:
        return replace(surface, law=replace(full, notes=(*full.notes, "too few rows or edges to choose terms by AICc")))
    law = fitted([term for term in full.formula.terms if term.name in chosen.kept], full.left_out)
    law = replace(law, selected=True)
    notes = [f"{len(chosen.kept)} of {len(full.formula.terms)} {SELECTED}"]
    if isinstance(why, NotAvailable):
        notes.append(f"all terms together are not tested: {why}")
        surface = _tested(law)
    return replace(surface, law=replace(law, notes=(*law.notes, *notes)), selection=chosen)


def surface_of(law: LawFit) -> ResponseSurface:
    """The response surface of a law of second order that was fitted to rows in memory.

    Of a law whose terms AICc chose the tests are those of all terms in its factors, where the rows identify these.

    Raises
    ------
    UsageError
        The law is of another form.
    """
    if law.formula.first_order:
        raise UsageError(f"the law of {law.response} is of the form {law.form}; a response surface is of second order.")
    if not law.selected:
        return _tested(law)
    gone = [out.factor for out in law.left_out]
    terms = tuple(term for term in second_order_terms(law.factors) if term.name not in gone)
    notes = tuple(note for note in law.notes if SELECTED not in note)
    wide = law.with_rows(formula=replace(law.formula, terms=terms), notes=notes, selected=False)
    full = computed(lambda: refitted(wide, law.error))
    surface = _tested(law) if isinstance(full, NotAvailable) else _tested(full)
    if isinstance(surface.model, NotAvailable):
        surface = _tested(law)
    chosen = selected_terms(surface.full, surface.model)
    same = chosen is not None and set(chosen.kept) == {term.name for term in law.formula.terms}
    return replace(surface, law=law, selection=chosen if same else None)


def _tested(law: LawFit) -> ResponseSurface:
    model = NotAvailable("the law meets every row exactly") if law.exact else _model_of(law)
    by = None if law.by is None else law.by.column
    return ResponseSurface(law, law, model, None, lack_of_fit(law, split(law)), by)


def _model_of(law: LawFit, saturated: bool = False) -> EdgeModel | NotAvailable:
    edge = None if law.edge is None else pd.factorize(law.edge, sort=True)[0].astype(np.intp)
    return edge_model(law.design, scaled_response(law), edge, saturated=saturated)


def _slopes(law: LawFit) -> Array:
    """Derivative of the polynomial by each centred factor, at the rows; shape (n, k)."""
    U = law.formula.transformed(law.X)
    slopes = np.zeros_like(U)
    for term, b in zip(law.formula.terms, law.theta[1:], strict=False):
        for j, power in enumerate(term.degrees):
            if power:
                rest = np.array(term.degrees) - np.eye(U.shape[1], dtype=int)[j]
                slopes[:, j] += b * power * np.prod(U**rest, axis=1)
    return slopes


def _not_separated(law: LawFit, held: Collection[str]) -> str:
    """Squares and products of the factors that are analysed and that the rows do not identify, in words."""
    free = {term.name for term in second_order_terms([x for x in law.factors if x not in held]) if term.order == 2}
    missing = [out.factor for out in law.left_out if out.factor in free]
    return f"these tests do not identify {', '.join(missing)}" if missing else ""


def _held(law: LawFit, at: Mapping[str, float] | None) -> dict[str, float]:
    """Factors that are held, with their values: those given, else times and wear at the middle of their ranges."""
    if at is not None:
        unknown = [name for name in at if name not in law.factors]
        if unknown:
            raise UsageError(f"at={unknown[0]!r}: the factors of {law.response} are {', '.join(law.factors)}.")
        return {name: float(value) for name, value in at.items()}
    clocks = [j for j, name in enumerate(law.factors) if name in ROLES and ROLES[name].kind in CLOCKS]
    ends = [law.domain[law.factors[j]] for j in clocks]
    logs = [law.formula.logs[j] for j in clocks]
    middles = [(a * b) ** 0.5 if log else (a + b) / 2 for log, (a, b) in zip(logs, ends, strict=True)]
    return dict(zip((law.factors[j] for j in clocks), middles, strict=True))
