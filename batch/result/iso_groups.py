"""Groups of work material by ISO 513: ``P20``, ``P10`` and ``P`` are one family, P steel."""

import re

NAMES = {
    "P": "P steel",
    "M": "M stainless",
    "K": "K cast iron",
    "N": "N non-ferrous",
    "S": "S superalloys and titanium",
    "H": "H hardened",
}
_HEADERS = frozenset(
    {"iso513", "iso513group", "iso513groups", "groupiso513", "isogroup", "isomaterial", "isomaterialgroup"}
)
_GROUP = re.compile(r"(?:ISO\s*)?([PMKNSH])[\s.-]?(?:\d{1,2}(?:\.\d+)?)?", re.IGNORECASE)


def is_iso_513(header: str) -> bool:
    """Whether a column's header says that it holds groups of ISO 513.

    Examples
    --------
    >>> is_iso_513("ISO 513"), is_iso_513("iso group"), is_iso_513("ISO13399")
    (True, True, False)
    """
    return re.sub("[^a-z0-9]", "", header.casefold()) in _HEADERS


def iso_family(value: str) -> str:
    """Name of the group that a value belongs to; a value that is none of ISO 513 stays as it is.

    Examples
    --------
    >>> iso_family("P20"), iso_family("k"), iso_family("M stainless"), iso_family("steel")
    ('P steel', 'K cast iron', 'M stainless', 'steel')
    """
    plain = value.strip()
    found = _GROUP.fullmatch(plain)
    return (
        NAMES[found[1].upper()]
        if found
        else {name.casefold(): name for name in NAMES.values()}.get(plain.casefold(), plain)
    )
