"""The cutting process of a file of tests, from its option, its columns or its notes."""

import re
from collections.abc import Collection, Iterable, Mapping

from .options import Process

_WORDS: Mapping[Process, str] = {
    "turning": r"turning|turned|lathe|drehen|drehmaschine|drehversuch|tournage|torneado|\btorno\b",
    "milling": r"milling|\bmill(?:ed)?\b|fr[äa](?:e)?s|fraisage|fraise|fresado|fresa\b",
    "drilling": r"drilling|\bdrill|bohren|bohrer|bohrung|per[çc]age|\bforet|taladrado|\bbroca",
    "grinding": r"grinding|\bgr(?:ou)?nd\b|schleif|rectificado|rectification",
}


def process_of(given: Process | None, roles: Collection[str], notes: Iterable[str] = ()) -> Process | None:
    """The process: as given, else milling where a width of cut or a feed per tooth is a column, else from the notes.

    None where nothing tells, or where the notes name two.

    >>> process_of(None, ("V", "f", "ae")), process_of(None, ("V", "f"), ("machine: Colchester lathe, dry turning",))
    ('milling', 'turning')
    """
    if given is not None:
        return given
    text = " ".join(notes).casefold()
    named: list[Process] = [process for process, words in _WORDS.items() if re.search(words, text)]
    if len(named) == 1:
        return named[0]
    return "milling" if not named and not {"fz", "ae"}.isdisjoint(roles) else None
