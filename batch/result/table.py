"""The results: a row a pair and law, as a frame and as a CSV file that comes back as the same frame."""

import csv
import os
import re
from collections.abc import Callable, Collection, Iterable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from pydantic_core import to_json

from ...datasets.errors import DataError
from ...datasets.vocabulary import ROLES
from ..law_table import LAW, NOTES, PAIR, PARTS, WHOLE, below_each_other, column, law_table, texts, truths
from ..law_table import TEXTS as TEXTS_OF_LAWS
from ..outcome import Cell, PairOutcome, cell

BEFORE = ("simulated", *WHOLE)
AFTER = (*NOTES, "no_posterior")
TEXTS = {*TEXTS_OF_LAWS, "kind", "words", "grouping", "family", "factor"}

_PARAMETER = re.compile(f"({'|'.join(PARTS)})_(.+)", re.DOTALL)
_WHOLE_NUMBER = re.compile(r"[+-]?[0-9]+")
_FORMULA = re.compile(r"'*[=+\-@\t\r].", re.DOTALL)  # what a spreadsheet would compute
_QUOTED = re.compile(r'[,"\n\r]')


def results_frame(outcomes: Sequence[PairOutcome], laws: pd.DataFrame, groups: Sequence[str] = ()) -> pd.DataFrame:
    """Give a row for each pair and law; a pair without any law keeps a row with its reason.

    Parameters
    ----------
    outcomes : sequence of PairOutcome
    laws : DataFrame
        As `law_table`, a pair by its number among the outcomes.
    groups : sequence of str
        Headers of the columns that group the pairs; they are told as `group_column` says.

    Returns
    -------
    DataFrame
        ``tool, work``, the groups, ``response, form, unit, reason``; the law as a whole; each parameter with its
        errors and interval, in the order c0, V, f, d, t; the posterior; what was left out and why. Whole numbers
        are Int64, truths boolean, missing numbers NA or NaN, missing texts empty.

    Examples
    --------
    >>> laws = law_table([(0, {"response": "AW", "reason": "", "nobs": 144, "params_V": 0.577})])
    >>> none = PairOutcome("GC435", "brass", 2, reason="2 rows")
    >>> made = results_frame([PairOutcome("GC435", "709M40", 144), none], laws)
    >>> made[["work", "nobs", "params_V", "reason"]].to_dict("list")
    {'work': ['709M40', 'brass'], 'nobs': [144, 2], 'params_V': [0.577, nan], 'reason': ['', '2 rows']}
    """
    there = np.zeros(len(outcomes), dtype=bool)
    there[laws[PAIR].to_numpy()] = True
    without = [(i, outcomes[i]) for i in np.flatnonzero(~there).tolist()]
    none = law_table((i, {**dict.fromkeys(LAW), "nobs": one.nobs, "reason": one.reason}) for i, one in without)
    table = below_each_other([laws, none] if without else [laws])
    pair = table[PAIR].to_numpy()
    of_pairs = {"tool": [one.tool for one in outcomes], "work": [one.work for one in outcomes]}
    of_pairs |= {group_column(header): [one.groups.get(header, "") for one in outcomes] for header in groups}
    columns = {name: texts(np.array(values, dtype=object)[pair]) for name, values in of_pairs.items()}
    table["simulated"] = truths(np.array([one.simulated for one in outcomes], dtype=bool)[pair])
    names = dict.fromkeys((*LAW, *_in_order(set(map(str, table)) - {PAIR})))
    return pd.DataFrame(columns | {name: table[name] if name in table else column(name, ()) for name in names})


def group_column(header: str) -> str:
    """Column of the results for a grouping: its header, unless the table has a column of that name itself.

    Examples
    --------
    >>> group_column("grade"), group_column("form")
    ('grade', 'form (group)')
    """
    own = header in {"tool", "work", *LAW, *BEFORE, *AFTER} or header.startswith("posterior")
    return f"{header} (group)" if own or _PARAMETER.fullmatch(header) else header


def read_results(path: str | os.PathLike[str]) -> pd.DataFrame:
    """Read ``results.csv`` back as the frame that was written, to the last digit.

    Raises
    ------
    DataError
        The file is missing, or no table that batch wrote.
    """
    header, rows = _rows(path)
    if header[:2] != ["tool", "work"] or "reason" not in header:
        raise DataError(f"{path}: no column tool, work or reason; give the results.csv that fitmodels batch wrote.")
    known = {*TEXTS, *header[: header.index("reason")]}  # the groups stand before the reason
    read = _read(header, rows, known)
    return read.assign(**{name: column(name, read[name].tolist()) for name in header if name not in known})


def read_frame(path: str | os.PathLike[str]) -> pd.DataFrame:
    """Read another table of `csv_bytes`; columns of texts are known by name, the others are what their cells are.

    Raises
    ------
    DataError
        The file is missing or no such table.
    """
    return _read(*_rows(path), {"tool", "work", *TEXTS})


def csv_bytes(frame: pd.DataFrame) -> bytes:
    r"""Give a frame as CSV: UTF-8, a line feed after each row, every digit of a number, nothing where it is missing.

    A text that a spreadsheet would take for a formula (``=2+3``, ``-x``) gets an apostrophe before it, as names come
    from files of other people; ``read_frame`` takes it away again. Numbers below zero stay as they are.

    Examples
    --------
    >>> csv_bytes(pd.DataFrame({"tool": ["=2+3", "a,b"], "nobs": [12, 9], "low_V": [-0.25, None]}))
    b'tool,nobs,low_V\n\'=2+3,12,-0.25\n"a,b",9,\n'
    """
    texts = [[_text(str(name)), *_cells(frame[name])] for name in frame]
    return ("\n".join(map(",".join, zip(*texts, strict=True))) + "\n").encode(errors="replace")


def _rows(path: str | os.PathLike[str]) -> tuple[list[str], list[list[str]]]:
    """Header and rows of a CSV file, as texts without the apostrophe of a formula."""
    try:
        with Path(path).open(encoding="utf-8", newline="") as file:
            table = [[_bare(text) for text in row] for row in csv.reader(file, strict=True)]
    except (OSError, ValueError, csv.Error) as error:
        why = (getattr(error, "strerror", None) or str(error)).lower()
        raise DataError(f"{path}: cannot be read: {why}; give a table that fitmodels batch wrote.") from None
    if not table:
        raise DataError(f"{path}: is empty; give a table that fitmodels batch wrote.")
    header, *rows = table
    odd = next((number for number, row in enumerate(rows, 2) if len(row) != len(header)), None)
    if odd is not None:
        raise DataError(f"{path}: row {odd} has {len(rows[odd - 2])} cells, its header {len(header)}; run batch again.")
    return header, rows


def _read(header: list[str], rows: list[list[str]], texts: Collection[str]) -> pd.DataFrame:
    columns = list(zip(*rows, strict=True)) if rows else [()] * len(header)
    held = {
        name: _column(values, True) if name in texts else _column(_told(values), False)
        for name, values in zip(header, columns, strict=True)
    }
    return pd.DataFrame(held, columns=header)


def _in_order(names: set[str]) -> list[str]:
    """Columns of laws in an order that does not depend on which law came first."""
    known = [name for name in BEFORE if name in names]
    ends = [name for name in AFTER if name in names]
    told = {name: found for name in names if (found := _PARAMETER.fullmatch(name)) and name not in (*BEFORE, *AFTER)}
    parameters = sorted(told, key=lambda name: (*_rank(told[name][2]), PARTS.index(told[name][1])))
    rest = names - {*LAW, *known, *ends, *parameters}
    posterior = sorted((name for name in rest if name.startswith("posterior")), key=_rank_of_posterior)
    return [*known, *parameters, *posterior, *ends, *sorted(rest - {*posterior})]


def _rank(parameter: str) -> tuple[int, str]:
    """c0, then the roles in the order in which tables tell them, then others by name."""
    first = ["c0", *ROLES]
    return (first.index(parameter) if parameter in first else len(first), parameter)


def _rank_of_posterior(name: str) -> tuple[int, str, int]:
    """By parameter: ``posterior_V``, then ``posterior_sd_V``."""
    return (*_rank(name.removeprefix("posterior_").removeprefix("sd_")), len(name))


def _column(values: Iterable[object], text: bool) -> pd.Series:
    """A column of one kind: texts, truths, whole numbers or floats."""
    if text:
        return pd.Series(["" if (v := cell(value)) is None else str(v) for value in values], dtype=object)
    cells = [cell(value) for value in values]
    kinds = {type(value) for value in cells} - {type(None)}
    if kinds == {bool}:
        return pd.Series(cells, dtype="boolean")
    if kinds == {int} and all(value is None or abs(int(value)) < 2**63 for value in cells):
        return pd.Series(cells, dtype="Int64")
    if kinds <= {int, float}:
        return pd.Series([np.nan if value is None else float(value) for value in cells], dtype=float)
    return pd.Series(["" if value is None else str(value) for value in cells], dtype=object)


def _told(texts: Sequence[str]) -> list[Cell]:
    """Cells of a column that is no text by its name: what all of them can be read as."""
    some = {text for text in texts if text}
    read: Callable[[str], Cell]
    if some <= {"True", "False"}:
        read = "True".__eq__
    elif all(map(_WHOLE_NUMBER.fullmatch, some)):
        read = int
    else:
        read = float
    try:
        return [read(text) if text else None for text in texts]
    except ValueError:
        return list(texts)


def _cells(values: pd.Series) -> list[str]:
    if values.dtype == np.float64:
        told = to_json(values.tolist())  # the shortest digits that read back the same, ten times as fast as repr
        return ["" if text == "NaN" else text for text in told[1:-1].decode().split(",")] if len(values) else []
    cells = values.tolist()
    if values.dtype == "Int64":
        return ["" if value is pd.NA else str(value) for value in cells]
    told_once = {text: _text(text) for text in {value for value in cells if isinstance(value, str)}}
    return [told_once[value] if isinstance(value, str) else _number(value) for value in cells]


def _number(value: object) -> str:
    plain = cell(value)
    return "" if plain is None else repr(plain) if isinstance(plain, float) else str(plain)


def _text(value: str) -> str:
    safe = f"'{value}" if _FORMULA.match(value) else value
    return f'"{safe.replace(chr(34), chr(34) * 2)}"' if _QUOTED.search(safe) else safe


def _bare(text: str) -> str:
    return text[1:] if text.startswith("'") and _FORMULA.match(text) else text
