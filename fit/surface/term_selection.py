"""Selection of the terms of a response surface by AICc with strong heredity.

A square or a product is kept only with its main effects. The criterion is the sum of AICc over the strata, each by
maximum likelihood on its own observations: edges for terms that change between edges, rows less edges for terms that
change within them. Counting rows for the former would take repeated measures for independent tests and keep too much.

All sets of terms are compared where they are few; of more, terms are removed and added one at a time from the full set.
P-values after a selection are too small, so that tests stay those of the full model.

Sources: Hurvich & Tsai 1989, Biometrika 76, 297 (AICc); Chipman 1996, Canadian J. Statistics 24, 17 (strong heredity);
Burnham & Anderson 2002, Model Selection and Multimodel Inference, section 4.2 (weight of a term).
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, combinations

import numpy as np

from ...core.arrays import Array
from ...core.display import Displayable
from ...core.formula import Term
from ..available import NotAvailable
from ..lawfit import LawFit
from .split_plot import EDGES, WITHIN, EdgeModel, error_of, means_regression

Degrees = tuple[int, ...]
MOST_SETS = 20_000  # sets of terms that are all compared


@dataclass(frozen=True, slots=True, repr=False)
class TermSelection(Displayable):
    """Terms chosen by AICc with strong heredity.

    Attributes
    ----------
    kept : tuple of str
    aicc, aicc_full : float
        Of the chosen set and of all terms, up to a constant that both share; infinite where observations are too few.
    close : int
        Other sets within 2 of the smallest AICc; 0 where sets were searched one term at a time.
    weights : mapping of str to float
        Akaike weight of the sets that hold a term; empty where sets were searched one term at a time.
    """

    kept: tuple[str, ...]
    aicc: float
    aicc_full: float
    close: int
    weights: Mapping[str, float]


class _Stratum:
    """AICc of sets of columns in one stratum, from its triangle of columns and response."""

    def __init__(self, rows: Array, n: int, forced: Sequence[int]) -> None:
        self.gram = rows.T @ rows
        self.n, self.forced = n, list(forced)

    def aicc(self, columns: Sequence[int]) -> float:
        use = [*self.forced, *columns]
        k = len(use) + 1
        if self.n - k - 1 <= 0:
            return float("inf")
        explained = 0.0
        if use:
            cross = self.gram[use, -1]
            explained = float(cross @ np.linalg.lstsq(self.gram[np.ix_(use, use)], cross, rcond=None)[0])
        rss = max(float(self.gram[-1, -1]) - explained, 1e-300)
        return float(self.n * np.log(rss / self.n) + 2 * k + 2 * k * (k + 1) / (self.n - k - 1))


def select_terms(
    model: EdgeModel, terms: Mapping[str, Sequence[int]], degrees: Mapping[str, Degrees], forced: Sequence[int] = (0,)
) -> TermSelection | None:
    """Terms of smallest AICc among the sets with strong heredity; None where no set leaves enough observations.

    Parameters
    ----------
    model : EdgeModel
        Of all terms.
    terms : mapping of str to sequence of int
        Columns of each term that may be left out.
    degrees : mapping of str to tuple of int
        Power of each factor in a term: (1, 0) of V, (2, 0) of V^2, (1, 1) of V:f.
    forced : sequence of int
        Columns that always stay: the constant, blocks.

    Examples
    --------
    >>> from fitmodels.fit.surface.split_plot import edge_model
    >>> x = np.linspace(-1, 1, 15)
    >>> y = 1 + 2 * x + 0.01 * np.sin(40 * x)
    >>> model = edge_model(np.column_stack([np.ones(15), x, x**2]), y)
    >>> select_terms(model, {"V": [1], "V^2": [2]}, {"V": (1,), "V^2": (2,)}).kept
    ('V',)
    """
    between, within = _strata(model, forced)
    is_within = {
        name: bool(model.within[list(columns)].all()) and bool(model.n_edges) for name, columns in terms.items()
    }
    known: dict[tuple[bool, frozenset[str]], float] = {}

    def part(inside: bool, names: frozenset[str]) -> float:
        mine = frozenset(name for name in names if is_within[name] == inside)
        if (inside, mine) not in known:
            stratum = within if inside else between
            columns = [j for name in terms if name in mine for j in terms[name]]
            known[inside, mine] = stratum.aicc(columns) if stratum is not None else 0.0
        return known[inside, mine]

    def aicc(names: frozenset[str]) -> float:
        return part(False, names) + part(True, names)

    everything = frozenset(terms)
    sets = _all_sets(degrees)
    if sets is None:
        best = _one_at_a_time(everything, degrees, aicc)
        if not np.isfinite(aicc(best)):
            return None
        return TermSelection(_ordered(terms, best), aicc(best), aicc(everything), 0, {})
    values = np.array([aicc(names) for names in sets])
    lowest = float(values.min())
    if not np.isfinite(lowest):
        return None
    weight = np.exp(-(values - lowest) / 2)
    weight = weight / weight.sum()
    weights = {name: float(weight[[name in names for names in sets]].sum()) for name in terms}
    best = sets[int(values.argmin())]
    return TermSelection(_ordered(terms, best), lowest, aicc(everything), int((values < lowest + 2).sum()) - 1, weights)


def _strata(model: EdgeModel, forced: Sequence[int]) -> tuple[_Stratum, _Stratum | None]:
    """Between and within stratum; one alone where rows are independent.

    Means of edges are freed of the terms within edges at their estimates, which matters where edges have unequal times.
    """
    if not model.n_edges:
        return _Stratum(model.whitened, model.nobs, forced), None
    inner = model.within
    means = np.zeros((model.n_edges, len(inner) + 1))
    means[:, np.append(~inner, True)] = means_regression(model)
    return (
        _Stratum(means, model.n_edges, [j for j in forced if not inner[j]]),
        _Stratum(model.whitened[model.size == 0], model.nobs - model.n_edges, [j for j in forced if inner[j]]),
    )


def _all_sets(degrees: Mapping[str, Degrees]) -> list[frozenset[str]] | None:
    """All sets of one term or more with strong heredity; None where they are too many."""
    main = [name for name, powers in degrees.items() if sum(powers) == 1]
    sets: list[frozenset[str]] = []
    for mains in _subsets(main):
        second = [name for name in degrees if name not in main and _allowed(degrees[name], set(mains), degrees)]
        if len(sets) + 2 ** len(second) > MOST_SETS:
            return None
        sets += [frozenset((*mains, *more)) for more in _subsets(second)]
    return [names for names in sets if names]


def _subsets(names: Sequence[str]) -> Iterator[tuple[str, ...]]:
    return chain.from_iterable(combinations(names, size) for size in range(len(names) + 1))


def _allowed(powers: Degrees, kept: set[str], degrees: Mapping[str, Degrees]) -> bool:
    """Whether the main effects of all factors of a term are kept."""
    there = {tuple(degrees[name]).index(1) for name in kept if sum(degrees[name]) == 1}
    return all(j in there for j, power in enumerate(powers) if power)


def _one_at_a_time(
    start: frozenset[str], degrees: Mapping[str, Degrees], aicc: Callable[[frozenset[str]], float]
) -> frozenset[str]:
    """Best set reached from ``start`` by removing or adding a term at a time."""
    best, value = start, aicc(start)
    while True:
        steps = [best ^ {name} for name in degrees]
        valid = [names for names in steps if names and _hereditary(names, degrees)]
        values = [aicc(names) for names in valid]
        if not values or min(values) >= value:
            return best
        value, best = min(values), valid[int(np.argmin(values))]


def _hereditary(names: frozenset[str], degrees: Mapping[str, Degrees]) -> bool:
    return all(sum(degrees[name]) == 1 or _allowed(degrees[name], set(names), degrees) for name in names)


def _ordered(terms: Mapping[str, Sequence[int]], names: frozenset[str]) -> tuple[str, ...]:
    return tuple(name for name in terms if name in names)


def columns_of(law: LawFit) -> dict[str, list[int]]:
    """Columns of each term of a law of second order, the category of blocks last."""
    names = {term.name: [1 + j] for j, term in enumerate(law.formula.terms)}
    if law.by is not None:
        first = 1 + len(law.formula.terms)
        names[law.by.column] = list(range(first, first + law.shifts.shape[1]))
    return names


def containing_terms(law: LawFit) -> dict[str, list[str]]:
    """Terms that contain each term: of V, V^2 and V*f."""
    terms = law.formula.terms
    return {
        a.name: [b.name for b in terms if b != a and all(i <= j for i, j in zip(a.degrees, b.degrees, strict=True))]
        for a in terms
    }


def term_groups(law: LawFit, model: EdgeModel) -> dict[str, list[str]]:
    """Squares, and products, of each error term where there are two or more."""
    columns = columns_of(law)
    groups: dict[str, list[str]] = {}
    for term in law.formula.terms:
        if term.order == 2:
            error = error_of(model, columns[term.name])
            kind = "squares" if max(term.degrees) == 2 else "products"
            where = {EDGES: " (edges)", WITHIN: " (within)"}.get(error, "")
            groups.setdefault(f"{kind}{where}", []).append(term.name)
    return {name: members for name, members in groups.items() if len(members) > 1}


def selected_terms(law: LawFit, model: EdgeModel | NotAvailable) -> TermSelection | None:
    """Terms of a law of second order chosen by AICc, blocks kept; None where its rows are too few."""
    if isinstance(model, NotAvailable):
        return None
    own, columns = {term.name: term.degrees for term in law.formula.terms}, columns_of(law)
    terms = {name: of for name, of in columns.items() if name in own}
    return select_terms(model, terms, own, [0, *(j for name, of in columns.items() if name not in own for j in of)])


def factors_in(terms: Sequence[Term], factors: Sequence[str]) -> list[str]:
    """Factors that some term holds."""
    return [name for j, name in enumerate(factors) if any(term.degrees[j] for term in terms)]


def own_terms(terms: Sequence[Term]) -> list[Term]:
    """Terms with powers of the factors that some term holds, and no others."""
    held = np.any([term.degrees for term in terms], axis=0)
    return [Term(term.name, tuple(int(d) for d in np.array(term.degrees)[held])) for term in terms]
