"""The posterior of a law as a part of a card: priors, gate, table, what to make of it."""

from ...parameters import LawPosterior, LawSection
from ...parameters.checks.estimates import ESS, K_HAT, R_HAT
from ..posterior_facts import posterior_words
from .drawn import drawn_parameters
from .numbers import count, fact, percent, places
from .parts import Named, Posterior

AT_MIDDLE = (
    "The prior of the constant is set on what the law says at the middle of the tests, not on the constant itself."
)
ROWS = "sd is the scatter of rows."
EDGES = "sd is the scatter of rows within an edge, icc the share of the whole variance that lies between edges."


def posterior_part(law: LawSection, of: LawPosterior | None) -> Posterior | None:
    """The posterior, its reason where there is none, None where nobody drew one."""
    if of is None:
        return None
    said = tuple(posterior_words(law, of))
    if of.reason is not None:
        return Posterior(reason=of.reason, sentences=said)
    return Posterior(
        method=of.words or of.method or "",
        priors=of.prior_set or "",
        gate=gate(of),
        level=percent(of.level),
        parameters=drawn_parameters(of),
        sentences=(*said, *_meaning(of), *([AT_MIDDLE] if of.level_at else [])),
    )


def gate(of: LawPosterior) -> tuple[Named, ...]:
    """The figures by which the draws were let through."""
    return (
        *fact("draws", count(of.draws)),
        *fact("R-hat", places(of.r_hat, 3), f"the largest of any parameter; the gate asks for at most {R_HAT:g}"),
        *fact("effective draws", places(of.ess, 0), f"the fewest of any parameter; the gate asks for at least {ESS:g}"),
        *(() if of.k_hat is None else fact(
            "k-hat", places(of.k_hat, 2), f"of the weights of the draws; the gate asks for at most {K_HAT:g}"
        )),
    )  # fmt: skip


def _meaning(of: LawPosterior) -> list[str]:
    """What is drawn beside the coefficients."""
    if "sd" not in of.parameters:
        return []
    return [EDGES if "icc" in of.parameters else ROWS]
