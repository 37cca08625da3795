"""The posterior of a law as a part of a card: priors, gate, table, what to make of it."""

from ...parameters import Law, LawPosterior
from ..posterior_facts import posterior_words
from .drawn import drawn_parameters
from .numbers import count, fact, percent, places
from .parts import Named, Posterior

AT_MIDDLE = "The prior of the constant is that of the law at the middle of the tests."


def posterior_part(law: Law, of: LawPosterior | None) -> Posterior | None:
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
        sentences=(*said, *([AT_MIDDLE] if of.level_at else [])),
    )


def gate(of: LawPosterior) -> tuple[Named, ...]:
    """The figures by which the draws were let through."""
    return (
        *fact("draws", count(of.draws)),
        *fact("R-hat", places(of.r_hat, 3), "the largest of any parameter"),
        *fact("effective draws", places(of.ess, 0), "the fewest of any parameter"),
        *(() if of.k_hat is None else fact("k-hat", places(of.k_hat, 2), "of the weights of the draws")),
    )
