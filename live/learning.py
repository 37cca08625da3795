"""New versions of a parameter file: laws that take in finished edges whose wear was measured.

Each measurement is one row of the wear law and of each load law: time of contact, conditions, wear, and the loads of
the last windows. The rows of an edge are added to the file as one Gram matrix for each law (`fit.gram_by_edge`), from
which the laws, their posteriors and the tool life follow exactly as from all rows. The former file stays as it is.
"""

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.errors import FitmodelsError, ParameterError, UsageError
from ..core.files import write_whole
from ..core.rounding import count
from ..core.text import json_text
from ..datasets.vocabulary import FLANK_WEAR
from .edge_summary import EdgeSummary, check_edges, law_rows

if TYPE_CHECKING:
    from ..fit.gram_by_edge import EdgeTriangle
    from ..parameters import ParameterFile
    from ..parameters.draws import Draws
    from ..parameters.gather.learned import Learned

ABSURD = 5.0  # factor from the law, and standard errors of it, beyond which a wear is refused
UNLIKELY = 3.0  # standard errors from the law before, beyond which edges are doubted


@dataclass(frozen=True, slots=True)
class NewVersion:
    """A parameter file with further edges.

    Attributes
    ----------
    pf : ParameterFile
    draws : bytes or None
        Content of its file of draws, whose name is in ``pf.posterior``.
    lines : tuple of str
        What changed, for a reader.
    path : Path or None
        Where it was written.
    """

    pf: "ParameterFile"
    draws: bytes | None
    lines: tuple[str, ...]
    path: Path | None = None


def parse_measured(pf: "ParameterFile", text: str) -> tuple[str, float]:
    """Symbol and value, in the unit of its law, of a measured wear such as ``VB=0.21mm``.

    Raises
    ------
    UsageError
        It is not of that form, the file has no law of that wear, or the unit is no length.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> parse_measured(published("AC-2016"), "AW=210um")
    ('AW', 0.21)
    """
    from ..parameters.messages import in_unit

    found = re.fullmatch(r"\s*(\w+)\s*=\s*([0-9.,eE+-]+)\s*([^\s\d.,]\S*)?\s*", text)
    wears = [name for name in pf.laws if name in FLANK_WEAR]
    named = ", ".join(wears) or "none"
    if found is None:
        raise UsageError(f"{text!r}: a measured wear is given as {wears[0] if wears else 'VB'}=0.21mm.")
    symbol, number, unit = found[1], found[2], found[3]
    if symbol not in wears:
        raise UsageError(f"{text!r}: the file has no law of the wear {symbol}; its wear laws: {named}.")
    try:
        value = float(number)
    except ValueError:
        raise UsageError(
            f"{text!r}: {number!r} is no number with a decimal point; give the wear as {symbol}=0.21mm."
        ) from None
    own = pf.laws[symbol].unit
    wear = value if unit is None else in_unit(value, unit, own)
    if wear is None:
        raise UsageError(f"{text!r}: {unit!r} is no unit of length; the law of {symbol} is in {own}.")
    if not 0 < wear < float("inf"):
        raise UsageError(f"{text!r}: a measured wear is above zero.")
    return symbol, wear


def learn(
    pf: "ParameterFile",
    edges: Sequence[EdgeSummary],
    *,
    draws: "Mapping[str, Draws] | None" = None,
    batch: str = "",
    conditions: Mapping[str, float | str] | None = None,
    command: str | None = None,
    created: str | None = None,
    stem: str = "params",
    certain: bool = False,
    simulated: bool = False,
) -> NewVersion:
    """The next version of a parameter file, whose laws take in finished edges.

    Parameters
    ----------
    pf : ParameterFile
        Its laws keep sums by edge, as those of schema version 9 do.
    edges : sequence of EdgeSummary
        Each with one measurement or more, and a name that the file does not know.
    draws : mapping of Draws, optional
        Those of the file, kept for laws that learn nothing.
    batch : str
        Name of the delivery of tools or work that the edges belong to; by default the number of the version.
    conditions : mapping, optional
        Factors that the source does not have, in the usual units (m/min, mm/rev, mm), and the level of a category.
    command, created : str, optional
        Recorded in the history of the file; ``created`` is an ISO date.
    stem : str
        Beginning of the name of the file of draws.
    certain : bool
        Take in a wear that is more than five times, or less than a fifth of, what the law gives, and an edge whose
        contact may have been missed in part.
    simulated : bool
        Whether an edge is of a simulation: the whole file then counts as simulated.

    Raises
    ------
    ParameterError
        The file keeps no sums, or knows an edge already.
    UsageError
        No measurement, a factor of the wear law is not known, or a wear that is far from the law.

    Examples
    --------
    >>> from fitmodels import analyse, datasets
    >>> pf = analyse(datasets.bundled("gc435_709m40"), draws=1000).parameters
    >>> edge = EdgeSummary("W1")
    >>> edge.advance(12.0, {"V": 100.0, "f": 0.2, "d": 2.0})
    >>> mark = edge.measured("AW", 0.19)
    >>> found = learn(pf, [edge])
    >>> found.pf.laws["AW"].n_edges, found.pf.history[0].rows
    (25, {'AW': 1})
    """
    check_edges(edges, certain=certain)
    version = pf.history[-1].version + 1 if pf.history else 2
    batch = batch or f"version {version}"
    rows, notes = _triangles(pf, edges, batch, dict(conditions or {}))
    found, more = _learned(pf, rows, version)
    notes += more
    if not certain:
        _check_possible(found)
    sections, left_out = _sections(pf, found, edges)
    posterior, content, missing = _posterior(pf, found, dict(draws or {}), stem)
    notes += [*left_out, *missing]
    identity = pf.identity.model_dump()
    if simulated:
        identity = {
            **identity,
            "simulated": True,
            "note": _joined(pf.identity.note, f"version {version}: simulated edges"),
        }
        notes.append("Edges of a simulation: the whole file counts as simulated.")
    entry = {
        "version": version, "former_sha256": pf.content_sha256, "created": created, "batch": batch,
        "edges": [edge.edge for edge in edges], "rows": {name: sum(t.rows for t in rows[name]) for name in found},
        "shifts": {name: {"shift": of.shift, "se": of.se, "edges": of.edges} for name, of in found.items()},
        "command": command, "notes": notes,
    }  # fmt: skip
    from ..parameters.file import sealed

    laws = {**pf.laws, **{name: of.section for name, of in found.items()}}
    provenance = {**pf.provenance.model_dump(), "then": (*pf.provenance.then, *([command] if command else []))}
    new = sealed(
        pf, laws=laws, posterior=posterior, history=[*(one.model_dump() for one in pf.history), entry],
        provenance=provenance, identity=identity, **sections,
    )  # fmt: skip
    return NewVersion(new, content, (*_lines(pf, found, version), *notes, _size(new)))


def _joined(note: str | None, more: str) -> str:
    return f"{note}; {more}" if note else more


def _triangles(
    pf: "ParameterFile", edges: Sequence[EdgeSummary], batch: str, given: dict[str, float | str]
) -> "tuple[dict[str, list[EdgeTriangle]], list[str]]":
    """Sums of each edge for each law that its measurements have a row of, and why others have none."""
    from ..fit.gram_by_edge import edge_triangle

    found: dict[str, list[EdgeTriangle]] = {}
    notes: dict[str, None] = {}
    for edge in edges:
        for name, law in pf.laws.items():
            rows, why = law_rows(pf, law, edge.marks, given)
            if rows:
                found.setdefault(name, []).append(edge_triangle(edge.edge, np.array(rows), batch))
            if why:
                notes[f"The law of {name} learns nothing from edge {edge.edge}: {why}."] = None
    if not any(name in found for name in FLANK_WEAR):
        raise UsageError(
            f"the wear law learns nothing. {' '.join(notes)} Give what the source does not have, for instance "
            "--value d=2mm."
        )
    return found, [*notes]


def _learned(
    pf: "ParameterFile", rows: "Mapping[str, Sequence[EdgeTriangle]]", version: int
) -> "tuple[dict[str, Learned], list[str]]":
    """Laws that were fitted again, the wear laws first; and why others were not."""
    from ..fit.available import NotAvailable, computed
    from ..parameters.gather.learned import learned_law

    found: dict[str, Learned] = {}
    notes = []
    for name, more in rows.items():
        if name in FLANK_WEAR:
            found[name] = learned_law(pf, pf.laws[name], more, version, len(pf.laws))
            continue
        made = computed(partial(learned_law, pf, pf.laws[name], more, version, len(pf.laws)), (FitmodelsError,))
        if isinstance(made, NotAvailable):
            notes.append(f"{name} stays as it is: {made.reason}")
        else:
            found[name] = made
    return found, notes


def _check_possible(found: "Mapping[str, Learned]") -> None:
    """Refuse a wear that is far from the law: another unit, another tool, or an edge that was changed unseen."""
    for name, of in found.items():
        if name in FLANK_WEAR and of.section.logarithmic and abs(of.shift) > max(np.log(ABSURD), ABSURD * of.se):
            raise UsageError(
                f"the measured {name} is {np.exp(of.shift):.3g} times that of the law (limit {ABSURD:g} times). Is its "
                "unit right, and was it this edge all the time? If so, give certain=True."
            )


def _sections(
    pf: "ParameterFile", found: "Mapping[str, Learned]", edges: Sequence[EdgeSummary]
) -> tuple[dict[str, Any], list[str]]:
    """Sections that follow from the laws: the tool life computed again, settings of the former laws left out."""
    from ..parameters.conflicts import AGAIN
    from ..parameters.gather.learned import life_with

    made: dict[str, Any] = {}
    notes = []
    if pf.tool_life is not None and pf.tool_life.wear in found:
        wear = pf.tool_life.wear
        largest = max((mark.wear for edge in edges for mark in edge.marks if mark.symbol == wear), default=0.0)
        made["tool_life"] = life_with(pf, found[wear], largest)
    laws = {"load_line": getattr(pf.load_line, "law", ""), "roughness": getattr(pf.roughness, "law", "")}
    if pf.pi is not None and pf.pi.scaling_u != 1:
        laws["pi"] = laws["load_line"]
    for section, law in laws.items():
        if getattr(pf, section) is not None and law in found:
            made[section] = None
            notes.append(f"{section} is left out: it was computed from the former law of {law}; run {AGAIN[section]}.")
    return made, notes


def _posterior(
    pf: "ParameterFile", found: "Mapping[str, Learned]", kept: "dict[str, Draws]", stem: str
) -> tuple[dict[str, Any] | None, bytes | None, list[str]]:
    """Posterior section with the laws that were fitted again, the file of all draws, and what is missing."""
    from ..fit import NotAvailable
    from ..parameters.draws import Draws, packed
    from ..parameters.gather.learned import posterior_with
    from ..parameters.gather.posterior import posterior_section

    if pf.posterior is None:
        return None, None, ["the file has no posterior, so none was drawn"]
    drawn = {name: posterior_with(pf, of.law) for name, of in found.items()}
    posts = [post for post in drawn.values() if not isinstance(post, str)]
    none = {name: NotAvailable(why) for name, why in drawn.items() if isinstance(why, str)}
    own = posterior_section(posts, none, None)["laws"]
    former = {name: law.model_dump() for name, law in pf.posterior.laws.items() if name not in own}
    lost = [name for name, law in former.items() if law["method"] is not None and name not in kept]
    former |= {name: {"reason": "its draws were not kept, and those of other laws are"} for name in lost}
    draws = {name: kept[name] for name in former if name in kept}
    draws |= {post.response: Draws(post.names, post.draws) for post in posts}
    notes = [f"no posterior of {name}: {why.reason}" for name, why in none.items()]
    section = {"seed": pf.posterior.seed, "laws": {**former, **own}}
    if not draws:
        return section, None, notes
    content = packed(draws)
    digest = sha256(content).hexdigest()
    return {**section, "draws_file": f"{stem}-draws-{digest[:12]}.npz", "draws_sha256": digest}, content, notes


def _lines(pf: "ParameterFile", found: "Mapping[str, Learned]", version: int) -> list[str]:
    """Changes: each law before and after, the distance of the new edges, the verdict."""
    lines = []
    for name, of in found.items():
        before, after = pf.laws[name], of.section
        changes = ", ".join(
            f"{key} {before.coefficients[key]:.4g} to {value:.4g}" for key, value in after.coefficients.items()
        )
        edges = count(of.edges, "edge")
        away = f"{100 * np.expm1(of.shift):+.1f} %" if after.logarithmic else f"{of.shift:+.3g} {after.unit}"
        t = abs(of.shift) / of.se if of.se > 0 else float("inf")
        lines.append(f"Law of {name}, version {version} with {edges} more: {changes}.")
        lines.append(
            f"{edges.capitalize()} {'lies' if of.edges == 1 else 'lie'} {away} from the law before ({t:.1f} se)."
        )
        if after.verdict is not None:
            lines.append(f"Verdict on the law of {name}: {after.verdict.level}.")
    return [*lines, *_not_computed_again(found)]


def _not_computed_again(found: "Mapping[str, Learned]") -> list[str]:
    """Checks that keep their result of the rows of the first fit."""
    kept: dict[str, None] = {}
    for of in found.values():
        verdict = of.section.verdict
        kept |= {
            text.split(":")[0]: None for text in (verdict.not_checked if verdict else ()) if "as sums only" in text
        }
    if not kept:
        return []
    return [f"Not computed again, results of the rows of the first fit: {'; '.join(kept)}."]


def _size(pf: "ParameterFile") -> str:
    """Size of the sums, which alone grow with every edge."""
    sums = [law.sums for law in pf.laws.values() if law.sums is not None and law.sums.edges]
    size = sum(len(json_text(of.model_dump())) for of in sums)
    edges = max((len(of.edges) for of in sums), default=0)
    return f"Sums of {count(edges, 'edge')} and {count(len(sums), 'law')}: {size / 1000:.1f} kB."


def next_path(path: str | os.PathLike[str], pf: "ParameterFile") -> Path:
    """Path of the next version: ``params-2.json`` beside ``params.json``, then ``params-3.json``.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> next_path("shop/params.json", published("AC-2016")).name
    'params-2.json'
    """
    path = Path(path)
    version = pf.history[-1].version if pf.history else 1
    return path.with_name(f"{path.stem.removesuffix(f'-{version}')}-{version + 1}.json")


def learn_file(
    path: str | os.PathLike[str],
    edges: Sequence[EdgeSummary],
    *,
    batch: str = "",
    conditions: Mapping[str, float | str] | None = None,
    command: str | None = None,
    created: str | None = None,
    certain: bool = False,
    simulated: bool = False,
) -> NewVersion:
    """Write the next version of a parameter file and of its draws beside it; the former files stay as they are.

    Parameters
    ----------
    path : path-like
        The newest version.
    edges, batch, conditions, command, created, certain, simulated
        As in `learn`.

    Raises
    ------
    ParameterError
        As in `learn`; the file was changed by hand; or there is a later version already.
    """
    from ..parameters import read
    from ..parameters.draws import read_draws
    from ..parameters.file import require_seal, write

    pf = read(path)
    require_seal(pf, str(path))
    new = next_path(path, pf)
    if os.path.lexists(new):
        raise ParameterError(f"{new}: exists, a later version of {path}. Give it as the parameter file instead.")
    found = learn(
        pf, edges, draws=read_draws(pf, Path(path).parent), batch=batch, conditions=conditions, command=command,
        created=created, stem=new.stem, certain=certain, simulated=simulated,
    )  # fmt: skip
    if found.draws is not None and found.pf.posterior is not None and found.pf.posterior.draws_file:
        write_whole(new.parent / found.pf.posterior.draws_file, found.draws, error=ParameterError)
    write(found.pf, new)
    return NewVersion(found.pf, found.draws, (*found.lines, f"Written: {new}; {path} is unchanged."), new)
