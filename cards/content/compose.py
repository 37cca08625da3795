"""A parameter file becomes a card: every section composed, and why the others are empty."""

from pathlib import Path
from typing import Any

from ...parameters import ParameterFile
from ..facts import about_intervals, life_equation, life_words
from .design import design_part
from .dynamics import transfer_part
from .empty import empty
from .figures import figures
from .gains import gains_part
from .identity import identity_part, provenance_part, slug
from .law import law_part
from .parts import Card, Publication, ToolLife
from .profiler import profiler_part
from .summary import summary, title
from .uncertainty import statements
from .uses import intended, out_of_scope, safety
from .windows import windows


def compose(pf: ParameterFile, *, publication: Publication | None = None, folder: Path | None = None) -> Card:
    """The card of a parameter file.

    Parameters
    ----------
    pf : ParameterFile
        Everything that is told comes from it.
    publication : Publication, optional
        Licence, authors, title and so on, as ``card.toml`` has them.
    folder : path, optional
        Where the card stands, for the pictures in ``figures`` beside it.

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
    publication = publication or Publication()
    identity = identity_part(pf)
    parts: dict[str, Any] = {
        "slug": slug(pf),
        "title": publication.title or title(pf),
        "summary": summary(pf),
        "identity": identity,
        "publication": publication,
        "design": design_part(pf.design),
        "about_intervals": about_intervals(pf) if pf.laws else "",
        "laws": tuple(law_part(pf, law) for law in pf.laws.values()),
        "tool_life": tool_life_part(pf),
        "uncertainty": statements(pf),
        "dynamics": transfer_part(pf.dynamics),
        "gains": gains_part(pf.pi, pf.dynamics),
        "windows": windows(pf),
        "figures": figures(pf, folder),
        "profiler": profiler_part(pf),
        "intended": intended(pf),
        "out_of_scope": out_of_scope(pf),
        "safety": safety(pf),
        "provenance": provenance_part(pf),
    }
    end = f"End of card {parts['slug']}, {identity.content_sha256[:12]}"
    return Card(schema="fitmodels.card/1", **parts, empty=empty(pf, parts), end=end)


def tool_life_part(pf: ParameterFile) -> ToolLife | None:
    """Tool life at the criterion: equation, what T is, T at the middle of the tests, Taylor's n."""
    life = pf.tool_life
    if life is None:
        return None
    what = (
        f"T is the time, in {life.unit}, at which {life.wear} reaches {life.criterion:g} {life.unit_of_wear}, solved "
        "from the wear law."
    )
    taylor = [f"Taylor's n is {life.taylor_n:.3g}, in V T^n = C."] if life.taylor_n is not None else []
    return ToolLife(equation=life_equation(pf), words=(what, life_words(pf), *taylor))
