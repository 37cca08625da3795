"""The card of a parameter file: every section composed, and the reason for each that is empty."""

from pathlib import Path
from typing import Any

from ...parameters import ParameterFile
from ...parameters.sections.base import Covariance
from ...parameters.sections.law_fields import LOGARITHMIC
from .design import design_part
from .dynamics import transfer_part
from .figure_texts import figures
from .gains import gains_part
from .guidance import intended, out_of_scope, safety, summary, title
from .identity import identity_part, missing, provenance_part, slug
from .laws import about_intervals, law_part, life_equation, life_words
from .parts import Card, IdentityPart, PublicationPart, ToolLifePart
from .profiler import profiler_part
from .uncertainty import statements
from .windows import windows


def compose(pf: ParameterFile, *, publication: PublicationPart | None = None, folder: Path | None = None) -> Card:
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
    publication = publication or PublicationPart()
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


def tool_life_part(pf: ParameterFile) -> ToolLifePart | None:
    """Tool life at the criterion: equation, what T is, T at the middle of the tests, Taylor's n."""
    life = pf.tool_life
    if life is None:
        return None
    what = (
        f"T is the time, in {life.unit}, at which {life.wear} reaches {life.criterion:g} {life.unit_of_wear}, solved "
        "from the wear law."
    )
    taylor = [f"Taylor's n is {life.taylor_n:.3g}, in V T^n = C."] if life.taylor_n is not None else []
    return ToolLifePart(equation=life_equation(pf), words=(what, life_words(pf), *taylor))


NO_TESTS = "The file holds no law; fit a file of cutting tests: fitmodels data.csv."


def empty(pf: ParameterFile, parts: dict[str, Any]) -> dict[str, str]:
    """Field of the card -> a sentence, for each that is empty."""
    reasons = {
        "design": _design(pf),
        "laws": NO_TESTS,
        "tool_life": _tool_life(pf),
        "uncertainty": _uncertainty(pf),
        "dynamics": "No dynamics were identified; record a run with a moving input: fitmodels ident run.csv.",
        "gains": _gains(pf),
        "windows": _windows(pf),
        "figures": "There is nothing to draw: the file holds no power or exponential law and no dynamics.",
        "profiler": _profiler(pf),
    }
    found = {name: words for name, words in reasons.items() if not parts[name]}
    return {**found, **_posterior(pf), **_identity(parts["identity"]), **_publication(parts["publication"])}


def _design(pf: ParameterFile) -> str:
    if not pf.laws:
        return "There are no cutting tests behind this file."
    return "The file does not tell its tests: it was made by hand or by an earlier version; fit the data again."


def _tool_life(pf: ParameterFile) -> str:
    wear = next((law for name, law in pf.laws.items() if name in ("AW", "VB")), None)
    if wear is None:
        return "There is no law of wear, so no tool life; measure AW or VB over time."
    if "t" not in [f.symbol for f in wear.factors]:
        return f"The law of {wear.response} has no time, so no tool life; record when each wear was read."
    if wear.by is not None:
        return f"The law of {wear.response} has levels, and tool life is told of one at a time: fit each level alone."
    return f"No tool life was solved from the law of {wear.response}: ask for one with --criterion."


def _uncertainty(pf: ParameterFile) -> str:
    if not pf.laws:
        return NO_TESTS.replace("no law", "no law to be uncertain of", 1)
    reasons = [law.uncertainty.reason for law in pf.laws.values() if not isinstance(law.uncertainty, Covariance)]
    why = reasons[0].rstrip(".") if reasons else "the laws have no residual standard error"
    return f"No uncertainty can be told: {why}."


def _posterior(pf: ParameterFile) -> dict[str, str]:
    if not pf.laws or pf.posterior is not None:
        return {}
    return {"posterior": "No posterior was drawn; fitmodels data.csv draws one of each law."}


def _gains(pf: ParameterFile) -> str:
    cure = "fitmodels tune params.json." if pf.dynamics else "identify dynamics first: fitmodels ident run.csv."
    return f"No gains were tuned; {cure}"


def _windows(pf: ParameterFile) -> str:
    laws = "" if pf.laws else " and no laws"
    return (
        f"The file names no limits of power, force or wear{laws}, so there is no window of operation; put them in with "
        "fitmodels limits params.json."
    )


def _profiler(pf: ParameterFile) -> str:
    if not pf.laws:
        return NO_TESTS
    forms = ", ".join(sorted({law.form.replace("_", " ") for law in pf.laws.values() if law.form not in LOGARITHMIC}))
    return f"The profiler moves power and exponential laws; this file holds a {forms}."


def _identity(identity: IdentityPart) -> dict[str, str]:
    names = missing(identity)
    return {"identity": f"Not told: {', '.join(names)}; say it in card.toml."} if names else {}


def _publication(publication: PublicationPart) -> dict[str, str]:
    lacking = [name for name in ("license", "authors", "contact") if not getattr(publication, name)]
    return {"publication": f"Not told: {', '.join(lacking)}; say it in card.toml."} if lacking else {}
