"""Laws that a user asks for in words: ``Ra ~ V, f, d``, ``Ra ~ + VB``, ``Ra ~ - t``."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from ..core.errors import UsageError
from ..datasets.options import named_role
from ..datasets.vocabulary import ROLES, roles_named

ALL = "*"  # stands for the responses that are not named
EXAMPLE = 'write it as "Ra ~ V, f, d", or "Ra ~ + VB" and "Ra ~ - t" to change the factors of the default law'
_SIGNED = re.compile(r"([+-])\s*([^,;+-]+)")
_FUNCTION = re.compile(r"(?:ln|log|log10|exp|I|C)\s*\(|\*|\^|:", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class LawRequest:
    """A law as a user writes it.

    Attributes
    ----------
    text : str
        As written.
    response : str
    factors : tuple of str
        All of them; empty where the default ones are changed.
    added, removed : tuple of str
        Changes of the default factors.
    """

    text: str
    response: str
    factors: tuple[str, ...] = ()
    added: tuple[str, ...] = ()
    removed: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Every name in it, the response first."""
        return self.response, *self.factors, *self.added, *self.removed


def form_for(response: str, forms: Mapping[str, str] | None) -> str | None:
    """Form that is named for a response, or under ``*`` for all others; None for the usual one.

    >>> form_for("Ra", {"*": "second-order"}), form_for("Ra", None)
    ('second-order', None)
    """
    return (forms or {}).get(response, (forms or {}).get(ALL))


def parse_law(text: str) -> LawRequest:
    """The request of a text; names are kept as written.

    Raises
    ------
    UsageError
        The text is no law.

    Examples
    --------
    >>> parse_law("Ra ~ V, f, d").factors, parse_law("Ra ~ V + f").factors, parse_law("Ra ~ + VB - t").removed
    (('V', 'f', 'd'), ('V', 'f'), ('t',))
    """
    if not isinstance(text, str):
        raise UsageError(f"law {text!r}: {EXAMPLE}.")
    response, tilde, right = (part.strip() for part in text.partition("~"))
    if not all((response, tilde, right)):
        raise UsageError(f"law {text!r}: {EXAMPLE}.")
    if _FUNCTION.search(text):
        raise UsageError(
            f"law {text!r}: name columns alone, without ln(), products or powers; a power law takes the logarithms "
            "itself."
        )
    if right[0] in "+-":
        return _changes(text, response, right)
    factors = tuple(name.strip() for name in re.split(r"[,;+]", right))
    return _checked(LawRequest(text, response, factors))


def _changes(text: str, response: str, right: str) -> LawRequest:
    """The request of a right-hand side that begins with a sign."""
    signed = _SIGNED.findall(right)
    if not signed or _SIGNED.sub("", right).strip(" ,;"):
        raise UsageError(f"law {text!r}: {EXAMPLE}.")
    added, removed = (tuple(name.strip() for mark, name in signed if mark == sign) for sign in "+-")
    return _checked(LawRequest(text, response, (), added, removed))


def _checked(request: LawRequest) -> LawRequest:
    if not all(request.names):
        raise UsageError(f"law {request.text!r}: a name is missing; {EXAMPLE}.")
    twice = next((name for name in request.names if request.names.count(name) > 1), None)
    if twice is not None:
        what = "is the response and cannot be its own factor" if twice == request.response else "is named twice"
        raise UsageError(f"law {request.text!r}: {twice} {what}; {EXAMPLE}.")
    return request


def parse_laws(texts: Sequence[str]) -> tuple[LawRequest, ...]:
    """The requests of several texts, one for each response.

    Raises
    ------
    UsageError
        A text is no law, or two are of one response.

    Examples
    --------
    >>> [request.response for request in parse_laws(["Ra ~ V, f", "Fc ~ f, d"])]
    ['Ra', 'Fc']
    """
    if isinstance(texts, str):
        raise UsageError(f"laws {texts!r}: give a list of texts, for instance ['Ra ~ V, f, d'].")
    requests = tuple(map(parse_law, texts))
    named = [named_role(request.response) for request in requests]
    twice = next((request for request, name in zip(requests, named, strict=True) if named.count(name) > 1), None)
    if twice is not None:
        raise UsageError(f"law {twice.text!r}: two laws of {twice.response} are asked for; give one of each response.")
    return requests


def symbol_of(name: str, has: Callable[[str], bool]) -> str | None:
    """Symbol of a name among the columns that a file has: a symbol, a name of one, or a header; None for no column.

    >>> held = {"d", "fm", "Ra", "hardness"}.__contains__
    >>> symbol_of("ap", held), symbol_of("feed", held), symbol_of("hardness", held), symbol_of("V", held)
    ('d', 'fm', 'hardness', None)
    """
    if name in ROLES:
        return name if has(name) else None
    return next((role for role in roles_named(name) if has(role)), name if has(name) else None)
