"""Why a section of a card has nothing to say, and what would fill it."""

from typing import Any

from ...parameters import Covariance, ParameterFile
from ...parameters.evaluate import LOGARITHMIC
from .identity import missing
from .parts import Identity, Publication

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


def _identity(identity: Identity) -> dict[str, str]:
    names = missing(identity)
    return {"identity": f"Not told: {', '.join(names)}; say it in card.toml."} if names else {}


def _publication(publication: Publication) -> dict[str, str]:
    lacking = [name for name in ("license", "authors", "contact") if not getattr(publication, name)]
    return {"publication": f"Not told: {', '.join(lacking)}; say it in card.toml."} if lacking else {}
