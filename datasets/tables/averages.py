"""Rows of averages among the data: found by their label, or as the mean of the rows above them."""

import math
import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Array, Flags
from .body import Body, Findings
from .gather import Column
from .layout import FOOTERS, footer_label
from .numerals import Cell, is_missing, is_number

_LONGEST = 60  # rows that one average may be of
_NO_DIGITS = dict.fromkeys(map(ord, "0123456789"))
_FINER = 2  # decimals that a mean has beyond set levels
_ROUNDED = 0.5  # largest rounding of a mean: to a whole number
_DECADES = 6.0  # chance of all agreements together, as a power of ten
_WORDS = (
    "mean|average|avg|mittelwert|durchschnitt|moyenne|promedio|std dev|stdev|standard deviation|"
    "standardabweichung|stabw|écart-type|ecart-type"
)
_AVERAGE = re.compile(rf"(?:(?:{_WORDS})\b[\s\w.,:()#/-]{{0,40}}|[\s\w.,:()#/-]{{0,40}}\b(?:{_WORDS}))[\s:=]*")
_BARE = frozenset(("mw", "ø", "mittel", "media", "moy", "sd", "std", "s"))
_SHORT = "|".join(re.escape(word) for word in {*FOOTERS, *_BARE} if len(word) < 4)
_LONG = "|".join(re.escape(word) for word in FOOTERS if len(word) >= 4)
_AROUND = r"(?:[.:=]|[^\S\n])*+"
_HINT = re.compile(rf"{_WORDS}|{_LONG}|^{_AROUND}(?:{_SHORT}){_AROUND}$", re.MULTILINE)  # a quick look


def average_label(text: str) -> bool:
    """Whether a text labels a row of means or standard deviations.

    >>> [average_label(text) for text in ("Mean", "Mittelwert E3:", "E1 average", "meander", "max")]
    [True, True, True, False, False]
    """
    plain = text.strip().replace(".", " ").replace("  ", " ").casefold()
    return len(plain) <= 2 * 40 and (plain.strip(" .:=") in _BARE or _AVERAGE.fullmatch(plain) is not None)


def average_rows(columns: Sequence[Column], lines: NDArray[np.int64], body: Body) -> dict[int, str]:
    """Lines of the rows of averages with their labels, "" where they have none."""
    if any(map(_holds_label, columns)):
        found = _labelled(body)
        if 2 * len(found) < len(lines):
            return found
    with np.errstate(all="ignore"):  # values near the largest number have no mean
        places = _means([column.values for column in columns if column.is_numeric])
    return dict.fromkeys((int(lines[i]) for i in places), "")


def average_sentences(found: dict[int, str]) -> list[str]:
    """Full sentences on rows that were left out.

    >>> average_sentences({4: "Mean", 8: "Mean"}), average_sentences({4: ""})
    (["Rows of averages are left out: lines 4, 8 ('Mean')."], ['The mean of the rows above it is left out: line 4.'])
    """
    if not found:
        return []
    shown = f"line{'s' * (len(found) > 1)} " + ", ".join(map(str, list(found)[:8]))
    shown += f" and {len(found) - 8} more" if len(found) > 8 else ""
    if labels := list(dict.fromkeys(repr(label) for label in found.values() if label)):
        return [f"Rows of averages are left out: {shown} ({', '.join(labels[:3])}{', ...' * (len(labels) > 3)})."]
    if len(found) == 1:
        return [f"The mean of the rows above it is left out: {shown}."]
    return [f"Rows that are the mean of the rows above them are left out: {shown}."]


def _holds_label(column: Column) -> bool:
    """Whether some cells of a column, and not most of them, are labels of averages."""
    if column.is_numeric:
        return any(average_label(text) or footer_label([text]) for _, text in column.bad)
    texts = set(column.values.tolist())
    kinds = "\n".join(set("\n".join(texts).translate(_NO_DIGITS).split("\n")))  # of many names few kinds are left
    if not _HINT.search(kinds.replace(".", " ").replace("  ", " ").casefold()):
        return False
    labels = [text for text in texts if text and (average_label(text) or footer_label([text]))]
    return 0 < len(labels) < len(texts) and not all(average_label(t) for t in texts if t)


def _labelled(body: Body) -> dict[int, str]:
    found: dict[int, str] = {}
    for block in body.blocks(Findings()):
        for line, row in zip(block.lines, zip(*block.columns, strict=True), strict=True):
            if label := _label(row):
                found[line] = label
    return found


def _label(row: Sequence[Cell]) -> str:
    """The label of a row of averages: its first filled cell, or a later one before the first of two numbers."""
    numbers = 0
    for i, cell in enumerate(row):
        text = str(cell).strip()
        if not text or is_missing(text):
            continue
        if is_number(cell):
            numbers += 1
            if numbers > 1:
                return ""
        elif average_label(text) or (not numbers and footer_label(row[i:])):
            rest = row[i + 1 :]
            return text if any(is_number(other) for other in rest) or not rest else ""
    return ""


def _means(arrays: Sequence[Array]) -> list[int]:
    """Positions of rows that are the mean of the rows since the last such row, in every column that varies."""
    varying = [values for values in arrays if _varies(values)]
    if len(varying) < 2:
        return []
    found: list[int] = []
    decades, start = 0.0, 0
    while True:
        table = np.column_stack([values[start : start + _LONGEST + 1] for values in varying])
        place, sure = _first_mean(table, varying)
        if place < 0:
            return found if decades >= _DECADES else [] if found else _last_mean(varying)
        found.append(start + place)
        decades += sure
        start += place + 1


def _last_mean(columns: Sequence[Array]) -> list[int]:
    """Position of the last row if it is the mean of all others."""
    n = len(columns[0])
    if n <= _LONGEST:
        return []
    ends = np.column_stack([np.array([_mean(values[:-1]), values[-1]]) for values in columns])
    both = np.isfinite(ends).all(axis=0)
    if both.sum() < 2 or (np.abs(ends[0] - ends[1])[both] > _ROUNDED + 1e-9 * np.abs(ends[0][both])).any():
        return []
    above = np.column_stack([values[:-1] for values in columns])
    return [n - 1] if _sureness(ends[1], ends[0], above, both, columns) >= _DECADES else []


def _mean(values: Array) -> float:
    """Mean of the known values; `np.nanmean` alone takes five times as long."""
    mean = float(values.mean())
    return mean if mean == mean else float(np.nanmean(values))


def _varies(values: Array) -> bool:
    head = values[: _LONGEST + 1]
    steps = np.diff(head)
    counts_rows = len(steps) > 2 and bool((steps == 1).all())
    return not counts_rows and bool((head[np.isfinite(head)] != head[np.isfinite(head)][:1]).any())


def _first_mean(table: Array, columns: Sequence[Array]) -> tuple[int, float]:
    """Position of the first row that is the mean of all above it, and how sure this is in powers of ten."""
    known = np.isfinite(table)
    counts = known.cumsum(axis=0)
    means = np.divide(
        np.where(known, table, 0.0).cumsum(axis=0), counts, out=np.full_like(table, np.nan), where=counts > 0
    )
    both = known[2:] & np.isfinite(means[1:-1])
    near = np.abs(table[2:] - means[1:-1]) <= _ROUNDED + 1e-9 * np.abs(means[1:-1])
    for place in (np.flatnonzero((near | ~both).all(axis=1) & (both.sum(axis=1) >= 2)) + 2).tolist():
        sure = _sureness(table[place], means[place - 1], table[:place], both[place - 2], columns)
        if sure > 0:
            return place, sure
    return -1, 0.0


def _sureness(row: Array, mean: Array, above: Array, both: Flags, columns: Sequence[Array]) -> float:
    """Powers of ten by which chance is excluded, 0 where a column differs from the mean by more than its rounding."""
    sure, agreeing = 0.0, 0
    for j in np.flatnonzero(both).tolist():
        block = above[:, j][np.isfinite(above[:, j])]
        spread = float(np.ptp(block))
        rounding = 0.51 * 10.0 ** -_decimals(float(row[j]))
        exact = 1e-9 * max(abs(float(mean[j])), spread)
        if abs(row[j] - mean[j]) > max(rounding if spread else 0.0, exact):
            return 0.0
        if spread > 0:
            agreeing += 1
            head = columns[j][:2000]
            measured = 2 * len(np.unique(head[np.isfinite(head)])) > len(head)
            if measured or _decimals(float(row[j])) >= _FINER + max(map(_decimals, np.unique(block).tolist()[:20])):
                sure += max(0.0, math.log10(spread / (2 * max(rounding, exact))))
    return sure if agreeing >= 2 and sure >= 1 else 0.0


def _decimals(value: float) -> int:
    text = f"{value:.12f}".rstrip("0")
    return len(text) - text.index(".") - 1
