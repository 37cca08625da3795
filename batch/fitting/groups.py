"""What a pair belongs to: the first name that its rows give in each column that groups the pairs."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from ..outcome import Concern
from .pairs_of_rows import PairsOfRows, texts

ABOUT = ("machine", "setup", "iso513")  # groups that the identity of a parameter file has a place for
SHOWN = 3


def groups_of_pairs(of: PairsOfRows, headers: Sequence[str]) -> tuple[list[dict[str, str]], list[list[Concern]]]:
    """For each pair its groups, empty text where its rows do not say, and concerns where they name several.

    Examples
    --------
    >>> from fitmodels.datasets.runs import Source
    >>> from fitmodels.batch.plan import Pair
    >>> from fitmodels.batch.rows import Rows
    >>> from fitmodels.batch.fitting.pairs_of_rows import looked_over
    >>> frame = pd.DataFrame({"tool": ["A", "A"], "work": ["W", "W"], "coolant": ["", "dry"]})
    >>> rows = Rows(frame, np.arange(2), {}, (), Source("", "", 2, ""))
    >>> groups_of_pairs(looked_over(rows, {Pair("A", "W")}), ["coolant"])
    ([{'coolant': 'dry'}], [[]])
    """
    groups: list[dict[str, str]] = [dict.fromkeys(headers, "") for _ in of.pairs]
    concerns: list[list[Concern]] = [[] for _ in of.pairs]
    for header in (h for h in headers if h in of.rows.frame):
        named = pd.DataFrame({"pair": of.number, "name": texts(of.rows.frame[header])})
        named = named[named["name"] != ""].drop_duplicates()
        for i, name in zip(*(named.drop_duplicates("pair")[c] for c in named), strict=True):
            groups[i][header] = name
        counts = np.bincount(named["pair"], minlength=len(of.pairs))
        for i in np.flatnonzero(counts > 1):
            concerns[i].append(differs(header, named["name"][named["pair"] == i].tolist()))
    return groups, concerns


def differs(header: str, names: Sequence[str]) -> Concern:
    """A pair whose rows name several groups.

    >>> differs("grade", ["P20", "P30"]).words
    "'grade' names 2 groups in the rows of this pair (P20, P30); it counts as P20."
    """
    shown = ", ".join(names[:SHOWN]) + (", ..." if len(names) > SHOWN else "")
    words = f"{header!r} names {len(names)} groups in the rows of this pair ({shown}); it counts as {names[0]}."
    return Concern("group differs within the pair", words)


def identity_of(groups: Mapping[str, str]) -> tuple[dict[str, str], list[Concern]]:
    """What the groups tell of the identity of a parameter file, and what cannot stand there.

    Examples
    --------
    >>> identity_of({"ISO 513": "p20", "coolant": "dry"})
    ({'iso513': 'P20'}, [])
    """
    import re

    from ...parameters.sections.origin import ISO513

    found = {plain: name for header, name in groups.items() if (plain := _plain(header)) in ABOUT and name}
    group = found.get("iso513")
    if group is None:
        return found, []
    if re.fullmatch(ISO513[1:-1], group.strip().upper()):
        return found | {"iso513": group.strip().upper()}, []
    found.pop("iso513")
    words = f"{group!r} is no group of ISO 513 (P, M, K, N, S or H, or with its number as P20); the file has none."
    return found, [Concern("no group of ISO 513", words)]


def is_identity(header: str) -> bool:
    """Whether a group of this header has a place in the identity of a parameter file.

    >>> is_identity("ISO 513"), is_identity("coolant")
    (True, False)
    """
    return _plain(header) in ABOUT


def _plain(header: str) -> str:
    return "".join(letter for letter in header.lower() if letter.isalnum())
