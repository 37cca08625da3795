"""The card of a parameter file: every section composed, and the reason for each that is empty."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from pydantic import ConfigDict, Field

from ...core.display import Display, facts_of
from ...core.verdict import MARKS, Mark
from ...fit.available import NotAvailable, computed
from ...parameters import ParameterFile
from ...parameters.checks.record import record_notes
from ...parameters.sections.base import Covariance
from .design import design_part, doubts
from .dynamics import GainsPart, dynamics_part, gains_part
from .figure_texts import figures
from .guidance import intended, out_of_scope, safety, summary, title
from .identity import identity_part, missing_identity, provenance_part, slug, without_folders
from .laws import about_intervals, law_part
from .parts import (
    DesignPart,
    DoubtPart,
    DynamicsPart,
    FigurePart,
    IdentityPart,
    LawPart,
    Part,
    ProfilerPart,
    ProvenancePart,
    PublicationPart,
    ToolLifePart,
    VerdictPart,
    WindowPart,
)
from .profiler import profiler_part
from .tool_life import PlanPart, no_plan, no_tool_life, plan_part, tool_life_part
from .uncertainty import UncertaintyPart, statements
from .verdicts import verdicts_of, worst
from .windows import costs_part, window_parts

NO_LAWS = "The file holds no law; fit a file of cutting tests: fitmodels data.csv."


class Card(Part):
    """A model card of a tool/work pair, schema ``fitmodels.card/8``.

    ``empty``: name of each empty field -> the reason in a sentence.
    """

    schema_: str = Field(default="fitmodels.card/8", alias="schema")
    slug: str
    title: str
    verdict: str  # the worst of all results, in words; empty where the card has none that is judged
    summary: str  # one or two sentences
    identity: IdentityPart
    publication: PublicationPart = PublicationPart()
    doubts: tuple[DoubtPart, ...] = ()  # about the data behind the laws
    design: DesignPart | None = None
    about_intervals: str = ""
    laws: tuple[LawPart, ...] = ()
    tool_life: ToolLifePart | None = None
    uncertainty: tuple[UncertaintyPart, ...] = ()
    dynamics: DynamicsPart | None = None
    gains: GainsPart | None = None
    windows: tuple[WindowPart, ...] = ()
    plan: PlanPart | None = None
    costs: WindowPart | None = None
    figures: tuple[FigurePart, ...] = ()
    intended: tuple[str, ...]
    out_of_scope: tuple[str, ...]
    safety: tuple[str, ...]
    provenance: ProvenancePart
    profiler: ProfilerPart | None = None
    empty: dict[str, str] = Field(default_factory=dict)
    end: str  # the end mark

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, defer_build=True, populate_by_name=True)

    @property
    def mark(self) -> Mark:
        """Icon and colour of the verdict of the whole card."""
        return next((mark for mark in MARKS.values() if mark.words == self.verdict), MARKS[None])

    @property
    def verdicts(self) -> tuple[VerdictPart, ...]:
        """The verdict of each law, of the tool life, the dynamics and the settings, in this order."""
        found = [law.verdict for law in self.laws]
        found += [self.tool_life.verdict] if self.tool_life else []
        found += [self.dynamics.verdict] if self.dynamics else []
        return (*found, *(window.verdict for window in self.windows if window.verdict is not None))

    def _display(self) -> Display:
        return Display(self.summary, tuple(facts_of(self)))


def compose(pf: ParameterFile, *, publication: PublicationPart | None = None, folder: Path | None = None) -> Card:
    """The card of a parameter file.

    Parameters
    ----------
    pf : ParameterFile
        The source of everything in the card.
    publication : PublicationPart, optional
        Licence, authors, title and so on, as in ``card.toml``.
    folder : path, optional
        Folder of the card, for the pictures in its ``figures``.

    Returns
    -------
    Card
        Names as they are in the file: each form escapes them in its own way.

    Examples
    --------
    >>> from fitmodels import parameters
    >>> card = compose(parameters.collect(tool="GC435", work="709M40", limits={"power": 7}))
    >>> card.title, card.windows[0].facts[0].number.text
    ('GC435 on 709M40', '7')
    """
    publication = publication or PublicationPart()
    identity = identity_part(pf)
    pf = without_folders(pf)
    parts: dict[str, Any] = {
        "slug": slug(pf),
        "title": publication.title or title(pf),
        "verdict": worst(verdicts_of(pf)),
        "summary": summary(pf),
        "identity": identity,
        "publication": publication,
        "doubts": doubts(pf),
        "about_intervals": about_intervals(pf) if pf.laws else "",
        "laws": tuple(law_part(pf, law) for law in pf.laws.values()),
        "intended": intended(pf),
        "out_of_scope": out_of_scope(pf),
        "safety": safety(pf),
        "provenance": provenance_part(pf),
    }
    optional: dict[str, Callable[[], Any]] = {
        "design": lambda: design_part(pf.design),
        "tool_life": lambda: tool_life_part(pf),
        "uncertainty": lambda: statements(pf),
        "dynamics": lambda: dynamics_part(pf.dynamics, record_notes(pf)),
        "gains": lambda: gains_part(pf.pi, pf.dynamics),
        "windows": lambda: window_parts(pf),
        "plan": lambda: plan_part(pf),
        "costs": lambda: costs_part(pf),
        "figures": lambda: figures(pf, parts["laws"], folder),
        "profiler": lambda: profiler_part(pf),
    }
    made = {name: computed(make) for name, make in optional.items()}
    failed = {name: f"Not composed: {why}." for name, why in made.items() if isinstance(why, NotAvailable)}
    parts |= {name: part for name, part in made.items() if name not in failed}
    end = f"End of card {parts['slug']}, {identity.content_sha256[:12]}"
    return Card(schema="fitmodels.card/8", **parts, empty=_empty(pf, parts) | failed, end=end)


def _empty(pf: ParameterFile, parts: dict[str, Any]) -> dict[str, str]:
    """Field of the card -> the reason in a sentence, for each that is empty."""
    tune = "fitmodels tune params.json." if pf.dynamics else "identify dynamics first: fitmodels ident run.csv."
    laws = "" if pf.laws else " and no laws"
    reasons = {
        "design": "The file does not describe its tests: it was written by hand or by an earlier version; fit the data "
        "again." if pf.laws else "There are no cutting tests behind this file.",
        "laws": NO_LAWS,
        "tool_life": no_tool_life(pf),
        "uncertainty": _uncertainty(pf),
        "dynamics": "No dynamics were identified; record a run with a varying input: fitmodels ident run.csv.",
        "gains": f"No gains were tuned; {tune}",
        "windows": f"The file holds no limits of power, force or wear{laws}, so there is no operating window; add "
        "them with fitmodels limits params.json.",
        "plan": no_plan(pf),
        "costs": "The file holds no costs of a part; add them with fitmodels costs params.json.",
        "figures": "There are no figures: the file holds no law and no dynamics.",
        "profiler": NO_LAWS,
    }  # fmt: skip
    found = {name: words for name, words in reasons.items() if not parts.get(name)}
    if pf.laws and pf.reading is None:
        found["doubts"] = "It is not known whether the data were read without doubts: they were not judged."
    if pf.laws and pf.posterior is None:
        found["posterior"] = "No posterior was drawn; fitmodels data.csv draws one of each law."
    identity: IdentityPart = parts["identity"]
    publication = [name for name in ("license", "authors", "contact") if not getattr(parts["publication"], name)]
    for field, names in (("identity", missing_identity(identity)), ("publication", publication)):
        if names:
            found[field] = f"Missing: {', '.join(names)}; add them in card.toml."
    return found


def _uncertainty(pf: ParameterFile) -> str:
    if not pf.laws:
        return NO_LAWS
    reasons = [law.uncertainty.reason for law in pf.laws.values() if not isinstance(law.uncertainty, Covariance)]
    why = reasons[0].rstrip(".") if reasons else "the laws have no residual standard error"
    return f"No uncertainty can be given: {why}."
