"""Arrow arrays as numbers and labels, whatever width, encoding or type their writer chose."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from ...core.arrays import Array, Ints, numbers_of_runs
from ...core.errors import UsageError
from ...core.rounding import label_of

try:
    import pyarrow as pa  # type: ignore[import-untyped]
    import pyarrow.compute as pc  # type: ignore[import-untyped]
    import pyarrow.parquet as pq  # type: ignore[import-untyped]
except ImportError:
    raise UsageError("pyarrow is not installed: pip install 'fitmodels[batch]'.") from None

__all__ = ["UNREADABLE", "pa", "pc", "pq", "why"]

UNREADABLE = (pa.ArrowException, OSError, ValueError, MemoryError)
"""Errors of damaged files; a wrong size may raise MemoryError."""


def why(error: BaseException) -> str:
    r"""The first line of a message of Arrow, short enough for a sentence.

    >>> why(OSError("Corrupt snappy compressed data.\nIn file.cc"))
    'Corrupt snappy compressed data'
    """
    first = (str(error).strip() or type(error).__name__).splitlines()[0].rstrip(". ")
    return first if len(first) <= 200 else f"{first[:200]} ..."


@dataclass(frozen=True, slots=True)
class Labels:
    """Texts of a column: number of the text of each row, shape (n,), and the texts, some perhaps twice."""

    codes: Ints
    texts: tuple[str, ...]

    def of(self, rows: Ints | slice) -> "Labels":
        """Those of some rows."""
        return Labels(self.codes[rows], self.texts)

    def named(self, stand_in: str) -> "Labels":
        """With a stand-in where there is no text."""
        texts = list(self.texts)
        while "" in texts:  # once or twice: in C, as there may be very many texts
            texts[texts.index("")] = stand_in
        return Labels(self.codes, tuple(texts))


def constant(text: str, n: int) -> Labels:
    """The same text in n rows; their number takes no memory."""
    return Labels(np.broadcast_to(np.intp(0), n), (text,))


def kind_of(arrow_type: Any) -> str:  # noqa: ANN401  Arrow has no static types
    """``number``, ``text``, ``nothing`` (nulls alone), or the name of a type that is none of these.

    >>> kind_of(pa.dictionary(pa.int8(), pa.large_string())), kind_of(pa.decimal128(9, 2)), kind_of(pa.bool_())
    ('text', 'number', 'bool')
    """
    kind = arrow_type.value_type if pa.types.is_dictionary(arrow_type) else arrow_type
    if pa.types.is_null(kind):
        return "nothing"
    if pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind):
        return "number"
    texts = (pa.types.is_string, pa.types.is_large_string, pa.types.is_string_view)
    return "text" if any(is_text(kind) for is_text in texts) else str(kind)


def numbers(array: Any) -> Array:  # noqa: ANN401
    """Doubles of an array of any kind of number, NaN where null.

    >>> numbers(pa.array([1, None, 3], pa.int8())).tolist()
    [1.0, nan, 3.0]
    """
    if pa.types.is_dictionary(array.type):
        array = array.dictionary_decode()
    if not pa.types.is_float64(array.type):
        array = array.cast(pa.float64(), safe=False)
    return np.asarray(array.to_numpy(zero_copy_only=False), dtype=np.float64)


def labels(array: Any) -> Labels:  # noqa: ANN401
    """Texts of an array of anything, in order of appearance; a row group may have more in its dictionary.

    >>> found = labels(pa.array([7.0, None, 0.5]))
    >>> [found.texts[code] for code in found.codes]
    ['7', '', '0.5']
    >>> labels(pa.DictionaryArray.from_arrays([2, 0, 2], ["A", "B", "C"])).texts
    ('C', 'A')
    """
    if pa.types.is_null(array.type):
        return constant("", len(array))
    if not pa.types.is_dictionary(array.type):
        array = pc.dictionary_encode(array)
    dictionary, indices = array.dictionary, array.indices
    if pa.types.is_string_view(dictionary.type):  # Arrow takes none of these
        dictionary = pa.array(dictionary.to_pylist(), pa.large_string())
    if indices.null_count:
        indices = indices.cast(pa.int64()).fill_null(-1)
    codes, first = numbers_of_runs(indices.to_numpy())
    values = dictionary.take(array.indices.take(pa.array(first))).to_pylist()
    return Labels(codes, tuple(map(text_of, values)))


def text_of(value: object) -> str:
    """A label as `datasets.Runs` writes it: ``1`` for 1.0, empty where there is none.

    >>> text_of(1.0), text_of(2.5), text_of(None), text_of("01"), text_of(float("nan"))
    ('1', '2.5', '', '01', '')
    """
    if value is None or isinstance(value, str):
        return value or ""
    if isinstance(value, bool | int):
        return str(value)
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        return str(value)
    if number != number:
        return ""
    return label_of(number)


def numbered(tool: Labels, work: Labels, number: Callable[[tuple[str, str]], int]) -> Ints:
    """The ``number`` of the pair of each row, shape (n,); it is called once for each pair, in order of appearance.

    >>> both = labels(pa.array(["B", "A", "B"])), labels(pa.array(["s", "s", "s"]))
    >>> numbered(*both, number={("A", "s"): 0, ("B", "s"): 1}.__getitem__).tolist()
    [1, 0, 1]
    """
    wide = len(work.texts)
    keys = tool.codes * wide + work.codes if wide > 1 else tool.codes
    codes, first = numbers_of_runs(keys)
    asked = [number((tool.texts[key // wide], work.texts[key % wide])) for key in keys[first].tolist()]
    return np.array(asked, dtype=np.intp)[codes]


def joined(parts: list[Labels]) -> "pd.Categorical[str]":
    """Labels of parts one after the other; categories are the texts that are there, in alphabetical order.

    >>> joined([constant("B", 2), Labels(np.array([1, 0]), ("A", "B", "C"))]).tolist()
    ['B', 'B', 'B', 'A']
    """
    used = [np.flatnonzero(np.bincount(part.codes, minlength=len(part.texts))) for part in parts]
    there = {part.texts[i] for part, where in zip(parts, used, strict=True) for i in where.tolist()}
    number = {text: i for i, text in enumerate(sorted(there))}
    codes = [np.zeros(0, dtype=np.intp)]
    for part, where in zip(parts, used, strict=True):
        anew = np.zeros(len(part.texts), dtype=np.intp)
        anew[where] = [number[part.texts[i]] for i in where.tolist()]
        codes.append(anew[part.codes])
    return pd.Categorical.from_codes(np.concatenate(codes), categories=pd.Index(list(number), dtype=str))
