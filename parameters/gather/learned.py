"""Laws of a parameter file fitted again with further edges, from their sums by edge.

Coefficients, covariance, variance components, statistics and posterior are those of a fit of all rows. Of the checks,
those that sums by edge determine are computed again; the others keep their result of the rows of the first fit, with
its concern, and are named.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from pydantic import ValidationError

from ...core.arrays import Array
from ...core.display import Display, Plottable, TextTable
from ...core.errors import ParameterError
from ...core.rounding import count
from ...core.verdict import RESERVATIONS, Verdict, verdict_from
from ..messages import schema_message
from ..sections.base import VerdictSection
from ..sections.law import LawSection
from ..sections.law_parts import LawCheck
from .law import check_fields, edge_sums, fitted_fields
from .lives import taylor_fields, tool_life_section
from .posterior import priors_of

if TYPE_CHECKING:
    from ...core.display import Frame
    from ...fit import LawFit
    from ...fit.bayes.posterior import Posterior
    from ...fit.gram_by_edge import EdgeTriangle
    from ..file import ParameterFile

RECOMPUTED: Final = ("exponents", "predictive use", "collinearity", "number of edges")  # whatever the rows are
ROUNDING: Final = 1e-8  # relative difference of a parameter
OF_EDGES: Final = ("single edges", "prediction", "even scatter of edges", "normality of edges", "agreement")


@dataclass(frozen=True, slots=True)
class Learned:
    """A law fitted again.

    Attributes
    ----------
    section : LawSection
    law : LawFit
        On rows with the sums of all edges.
    shift, se : float
        Distance of the further edges from the law before, on the scale of its errors.
    edges : int
        Further edges.
    """

    section: LawSection
    law: "LawFit"
    shift: float
    se: float
    edges: int


def triangles_of(section: LawSection) -> "tuple[EdgeTriangle, ...]":
    """Triangles of the edges of a law of a file.

    Raises
    ------
    ParameterError
        The file holds none; the message says why.
    """
    from ...fit.gram_by_edge import EdgeTriangle

    sums = section.sums
    if sums is None:
        raise ParameterError(
            f"the law of {section.response} has no sums by edge, as in files before fitmodels.parameters/9, so it "
            "cannot take in further edges. Fit its data file again."
        )
    if not sums.edges:
        raise ParameterError(f"the law of {section.response} cannot take in further edges: {sums.reason}.")
    return tuple(
        EdgeTriangle(one.edge, one.rows, np.array(one.mean), one.moves, _root(one.root, len(one.moves)), one.batch)
        for one in sums.edges
    )


def _root(rows: Sequence[Sequence[float]], m: int) -> Array:
    root = np.zeros((len(rows), m))
    for i, row in enumerate(rows):
        root[i, i:] = row
    return root


def law_with(pf: "ParameterFile", section: LawSection, more: "Sequence[EdgeTriangle]" = ()) -> "LawFit":
    """The law of a section fitted to the sums of its edges and of further ones."""
    return law_of(pf, section, (*triangles_of(section), *more))


def law_of(pf: "ParameterFile", section: LawSection, triangles: "Sequence[EdgeTriangle]") -> "LawFit":
    """The law of a section fitted to sums of edges."""
    from ...fit.fitted_rows import LawSource
    from ...fit.gram_by_edge import law_of_triangles
    from ...fit.laws import LawForm
    from ...fit.rows import By, Dropped, LeftOut

    symbols = tuple(factor.symbol for factor in section.factors)
    by, origin, identity = section.by, pf.provenance, pf.identity
    return law_of_triangles(
        LawForm(section.form, section.response, symbols), section.error, triangles,
        factors=len(symbols), domain=_domain(section, triangles),
        units={section.response: section.unit, **{factor.symbol: factor.unit for factor in section.factors}},
        by=None if by is None else By(by.column, by.reference, tuple(by.shifts)),
        left_out=tuple(LeftOut(one.factor, one.reason) for one in section.left_out),
        dropped=tuple(Dropped(one.reason, one.count, one.lines) for one in section.dropped_rows),
        source=LawSource(
            origin.data_file or "", origin.data_sha256 or "", identity.tool, identity.work, identity.simulated,
            identity.note or "", origin.n_rows,
        ),
    )  # fmt: skip


def _domain(section: LawSection, more: "Sequence[EdgeTriangle]") -> dict[str, tuple[float, float]]:
    """Ranges of the factors, widened by the means of edges outside them."""
    found = {}
    for j, (factor, log) in enumerate(zip(section.factors, section.formula.logs, strict=True)):
        means = [float(np.exp(one.mean[j]) if log else one.mean[j]) for one in more]
        found[factor.symbol] = (min([factor.low, *means]), max([factor.high, *means]))
    return found


def learned_law(
    pf: "ParameterFile", section: LawSection, more: "Sequence[EdgeTriangle]", version: int, laws: int = 1
) -> Learned:
    """A law fitted again with further edges, as its section in a later version of the file.

    Raises
    ------
    ParameterError
        The file has no sums of the law, or knows an edge already.
    FitError
        The law cannot be fitted to the sums.
    """
    known = {one.edge for one in triangles_of(section)}
    if twice := next((one.edge for one in more if one.edge in known), None):
        raise ParameterError(
            f"the law of {section.response} has edge {twice!r} already, so it is not added again. Give a further "
            "edge another name."
        )
    before, law = law_with(pf, section), law_with(pf, section, more)
    _check_sums(section, before)
    shift, se = level_shift(before, more)
    checks, kept = _checks(section, law, laws)
    data = {**section.model_dump(), **fitted_fields(law), **_unchanged(section), "checks": checks}
    names = dict.fromkeys(kept, f"result of version {version - 1}, of rows that this version has as sums only")
    verdict = _verdict(checks, names, law, more)
    edges = [edge_sums(one) for one in (*triangles_of(section), *more)]
    added = f"version {version} adds {count(len(more), 'edge')} as sums"
    data |= {
        "edges": {**data["edges"], "smearing_within": None},
        "sums": {**section.sums.model_dump(), "edges": edges} if section.sums else None,
        "verdict": VerdictSection.of(verdict).model_dump(),
        "verdicts": _sentences(checks, section),
        "notes": (*section.notes, f"{added}: region, smearing, composite law and other error structure are not of it"),
    }
    try:
        found = LawSection.model_validate(data)
    except ValidationError as error:
        raise ParameterError(f"the law of {law.response} cannot be written: {schema_message(error, data)}.") from None
    return Learned(found, law, shift, se, len(more))


def _check_sums(section: LawSection, law: "LawFit") -> None:
    """Refuse sums that do not give the coefficients of the law, as of a file that was put together by hand."""
    away = np.abs(law.theta - section.theta) > ROUNDING * np.maximum(np.abs(section.theta), 1.0)
    if away.any():
        raise ParameterError(
            f"the sums by edge of {section.response} do not give its coefficients: "
            f"{law.theta_names[int(away.argmax())]} is another. Fit its data again."
        )


def _unchanged(section: LawSection) -> dict[str, Any]:
    """Fields of the former version that a fit of sums has no other values of, and those that are left out."""
    kept = ("quantity", "life", "region", "published", "checked_rows", "dropped_rows", "left_out")
    own = {name: section.model_dump()[name] for name in kept}
    return own | {"alternative": None, "composite": None, "without": None, "smearing": None}


def level_shift(law: "LawFit", more: "Sequence[EdgeTriangle]") -> tuple[float, float]:
    """Mean distance of further edges from a law, on the scale of its errors, and its standard error.

    The scatter between edges and of rows, and the error of the law at the mean of these edges, are in the error.
    """
    from ...fit.edges import EdgeInference

    Z = np.array([np.concatenate([[1.0], one.mean[:-1]]) for one in more])
    away = np.array([one.mean[-1] for one in more]) - Z @ law.theta
    rows = np.array([one.rows for one in more], dtype=float)
    between, within = 0.0, float(law.scale_se or 0.0) ** 2
    if isinstance(law.edges, EdgeInference):
        between, within = law.edges.mixed.sd_between**2, law.edges.mixed.sd_within**2
    z, cov = Z.mean(axis=0), law.covariance()
    of_law = float(z @ cov @ z) if np.isfinite(cov).all() else 0.0
    variance = float((between + within / rows).mean()) / len(more) + of_law
    return float(away.mean()), float(np.sqrt(variance))


def _checks(section: LawSection, law: "LawFit", laws: int) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Checks of a law, those that the sums determine computed again, and the names of the others."""
    from ...fit.available import NotAvailable, computed
    from ...fit.checks.check import FAMILY_LEVEL, family_wise
    from ...fit.checks.judgement import CHECKS, CheckInput

    given = CheckInput(law, law, law)
    names = [name for name in (*RECOMPUTED, *(() if law.n_edges is None else OF_EDGES)) if name in section.checks]
    done = {name: computed(partial(CHECKS[name], given)) for name in names}
    found = family_wise({name: check for name, check in done.items() if check is not None}, FAMILY_LEVEL / laws)
    new = {
        name: LawCheck.model_validate(
            {"reason": check.reason} if isinstance(check, NotAvailable) else check_fields(check)
        ).model_dump()
        for name, check in found.items()
    }
    former = {name: check.model_dump() for name, check in section.checks.items()}
    kept = tuple(name for name, check in former.items() if name not in new and check["verdict"] is not None)
    return {**former, **new}, kept


def _verdict(
    checks: Mapping[str, Mapping[str, Any]], kept: Mapping[str, str], law: "LawFit", more: "Sequence[EdgeTriangle]"
) -> Verdict:
    """The verdict of all checks; a reservation where most edges have had no check of their rows."""
    from ...fit.checks.check import TITLES

    title = {name: TITLES.get(name, name) for name in checks}
    held = [(int(check["concern"]), str(check["verdict"])) for check in checks.values() if check["verdict"]]
    edges = law.n_edges or law.nobs
    if 2 * len(more) > edges:
        held.append((RESERVATIONS, f"{len(more)} of {edges} edges were added as sums, without checks of their rows."))
    done = [title[name] for name, check in checks.items() if check["verdict"] and name not in kept]
    missing = [f"{title[name]}: {check['reason']}" for name, check in checks.items() if check["reason"]]
    return verdict_from(held, done, [*(f"{title[name]}: {why}" for name, why in kept.items()), *missing])


def _sentences(checks: Mapping[str, Mapping[str, Any]], section: LawSection) -> tuple[str, ...]:
    """Sentences of the concerns, then those that were there before and are still a check's."""
    now = [str(check["verdict"]) for check in checks.values() if check["verdict"]]
    held = [str(check["verdict"]) for check in checks.values() if check["verdict"] and check["concern"]]
    return tuple(dict.fromkeys((*held, *(words for words in section.verdicts if words in now))))[:6]


def posterior_with(pf: "ParameterFile", law: "LawFit") -> "Posterior | str":
    """The posterior of a law fitted again, with the priors of the file; or the reason why there is none."""
    from ...fit import NotAvailable, posterior
    from ...fit.available import computed

    section = pf.posterior
    if section is None or section.laws.get(law.response) is None:
        return "the file holds no posterior of this law"
    of = section.laws[law.response]
    if of.reason is not None:
        return of.reason
    if of.errors == "student" and law.n_edges is None:
        return "Student's errors of rows are not determined by sums of rows"
    priors = priors_of(of)
    found = computed(
        partial(
            posterior, law, seed=section.seed, draws=max(of.draws or 4000, 1000),
            priors="weak" if priors is None else priors, errors=of.errors or "normal",
        )
    )  # fmt: skip
    return found.reason if isinstance(found, NotAvailable) else found


def life_with(pf: "ParameterFile", found: Learned, largest: float) -> dict[str, Any] | None:
    """The tool life of a wear law fitted again, None where the file has none; ``largest`` wear of the further edges."""
    from ...fit import tool_life
    from ...fit.life import life_verdict

    former = pf.tool_life
    if former is None:
        return None
    life = tool_life(found.law, former.criterion)
    of_law = None if found.section.verdict is None else found.section.verdict.verdict
    verdict = life_verdict(life, found.law, None, of_law)
    known = former.wear_observed
    return {
        **(tool_life_section(replace(life, law=None)) or {}),
        "wear_observed": None if known is None else max(known, largest),
        "taylor": taylor_fields(life.taylor, found.law),
        "verdict": VerdictSection.of(verdict).model_dump(),
    }


@dataclass(frozen=True, slots=True)
class DriftRow:
    """A law after the edges of one batch, and their distance from the first fit.

    Attributes
    ----------
    response, batch : str
    edges, rows : int
        Of the batch.
    estimates : dict of (value, se)
        Coefficients but the constant, of all edges so far.
    shift, se : float or None
        Mean distance of the edges of the batch from the law of the first fit, on the scale of its errors; None for
        that itself.
    """

    response: str
    batch: str
    edges: int
    rows: int
    estimates: dict[str, tuple[float, float]]
    shift: float | None = None
    se: float | None = None


@dataclass(frozen=True, slots=True, repr=False)
class Drift(Plottable):
    """Exponents of laws over the batches of edges that a parameter file has taken in.

    Attributes
    ----------
    rows : tuple of DriftRow
        By law, then in the order of the batches.
    """

    rows: tuple[DriftRow, ...]

    def to_frame(self) -> "Frame":
        """A row for each law, batch and coefficient; ``change`` is in standard errors of the first fit."""
        from pandas import DataFrame

        first = {row.response: row.estimates for row in self.rows if row.shift is None}
        return DataFrame(
            [
                {
                    "law": row.response, "batch": row.batch, "edges": row.edges, "rows": row.rows, "name": name,
                    "estimate": value, "se": se, "shift": row.shift, "shift_se": row.se,
                    "change": (value - first[row.response][name][0]) / (first[row.response][name][1] or np.nan),
                }
                for row in self.rows
                for name, (value, se) in row.estimates.items()
            ]
        )  # fmt: skip

    def _display(self) -> Display:
        lines = []
        for row in self.rows:
            level = "" if row.shift is None or row.se is None else f"{row.shift:+.3f} ± {row.se:.3f}"
            exponents = ", ".join(f"{name} {value:.3f} ± {se:.3f}" for name, (value, se) in row.estimates.items())
            lines.append((row.response, row.batch, str(row.edges), level, exponents))
        heads = ("law", "batch", "edges", "level against the first fit", "exponents of all edges so far")
        return Display("Drift of the laws over batches", table=TextTable(heads, tuple(lines)))


def drift(pf: "ParameterFile") -> Drift:
    """Drift of the laws of a parameter file over the batches of its edges; the tests of the first fit are one batch.

    Raises
    ------
    ParameterError
        No law of the file has sums by edge.

    Examples
    --------
    >>> from fitmodels import analyse, datasets
    >>> found = drift(analyse(datasets.bundled("gc435_709m40"), draws=1000).parameters)
    >>> found.rows[0].batch, found.rows[0].edges, round(found.rows[0].estimates["V"][0], 3)
    ('first fit', 24, 0.533)
    """
    laws = [law for law in pf.laws.values() if law.sums is not None and law.sums.edges]
    if not laws:
        raise ParameterError("no law of the file has sums by edge, so its drift is not known. Fit its data again.")
    return Drift(tuple(row for law in laws for row in _drift_of(pf, law)))


def _drift_of(pf: "ParameterFile", section: LawSection) -> list[DriftRow]:
    all_of = triangles_of(section)
    batches = list(dict.fromkeys(one.batch for one in all_of))
    rows: list[DriftRow] = []
    first: LawFit | None = None
    for number, batch in enumerate(batches, start=1):
        own = [one for one in all_of if one.batch == batch]
        law = law_of(pf, section, [one for one in all_of if one.batch in batches[:number]])
        away = (None, None) if first is None else level_shift(first, own)
        pairs = zip(law.names[1:], law.params.to_numpy()[1:], law.bse.to_numpy()[1:], strict=True)
        estimates = {name: (float(value), float(se)) for name, value, se in pairs}
        n = sum(one.rows for one in own)
        rows.append(DriftRow(section.response, batch or "first fit", len(own), n, estimates, *away))
        first = law if first is None else first
    return rows
