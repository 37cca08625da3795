"""The tables of a batch: results by pair and law, attention, comparison, as frames and as CSV with all digits."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import numpy as np
import pandas as pd
from pydantic_core import to_json

from ..core.progress import grouped
from ..core.text import spreadsheet_cell
from ..core.verdict import NOT_JUDGED
from ..datasets.vocabulary import ROLES
from .attention import Attention, attention_frame, attention_summary, with_families
from .comparison import Comparison, compare
from .engine import SERIAL, Run
from .law_rows import (
    AFTER,
    BEFORE,
    ENDS,
    LAW,
    PAIR,
    PARAMETER,
    PARTS,
    Column,
    fitted,
    flags,
    group_column,
    joined_tables,
    law_table,
    renumbered,
    texts,
)
from .outcomes import BlockOutcome, PairOutcome, cell
from .output_folder import claim, claimed, holds, put, retire
from .pair_table import unknown_pairs, with_groups
from .plan import Plan

_QUOTED = re.compile(r'[,"\n\r]')
AT_ONCE = 5000  # rows of a table as Python numbers


def results_frame(outcomes: Sequence[PairOutcome], laws: pd.DataFrame, groups: Sequence[str] = ()) -> pd.DataFrame:
    """A row for each pair and law; a pair without any law has a row with its reason.

    Parameters
    ----------
    outcomes : sequence of PairOutcome
    laws : DataFrame
        As `law_table`, a pair by its number among the outcomes.
    groups : sequence of str
        Headers of the columns that group the pairs; named as by `group_column`.

    Returns
    -------
    DataFrame
        ``tool, work``, the groups, ``response, form, unit, reason, verdict``; the law as a whole; each parameter with
        its errors and interval, in the order c0, V, f, d, t; the posterior; what was left out and why. Whole numbers
        are Int64, flags boolean, missing numbers NA or NaN, missing texts empty.

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
    table = joined_tables([laws, none] if without else [laws])
    pair = table[PAIR].to_numpy()
    of_pairs = {"tool": [one.tool for one in outcomes], "work": [one.work for one in outcomes]}
    of_pairs |= {group_column(header): [one.groups.get(header, "") for one in outcomes] for header in groups}
    columns = {name: texts(np.array(values, dtype=object)[pair]) for name, values in of_pairs.items()}
    simulated = flags(np.array([one.simulated for one in outcomes], dtype=bool)[pair])
    table = table.assign(simulated=simulated, verdict=_verdicts(table))
    names = (*LAW, *_in_order(set(map(str, table)) - {PAIR}))
    return pd.DataFrame(columns | {name: table[name] for name in names})


def _verdicts(table: pd.DataFrame) -> Column:
    """The verdict on each law; of one without checks, that it was not judged, and nothing where there is no law."""
    known = table["verdict"] if "verdict" in table else pd.Series("", index=table.index, dtype=object)
    return known.where((known != "") | ~fitted(table), NOT_JUDGED)


def csv_bytes(frame: pd.DataFrame) -> bytes:
    r"""A frame as CSV: UTF-8, a line feed after each row, empty where a number is missing or not finite.

    Numbers have the fewest digits that read back the same. A text that a spreadsheet would interpret as a formula
    (``=2+3``, ``-x``) gets an apostrophe before it. Negative numbers are unchanged.

    Examples
    --------
    >>> csv_bytes(pd.DataFrame({"tool": ["=2+3", "a,b"], "nobs": [12, 9], "low_V": [-0.25, None]}))
    b'tool,nobs,low_V\n\'=2+3,12,-0.25\n"a,b",9,\n'
    """
    parts = (frame.iloc[first : first + AT_ONCE] for first in range(0, len(frame), AT_ONCE))
    return b"".join([_header(frame), *map(_csv_rows, parts)])


def results_csv(results: pd.DataFrame, blocks: Sequence[BlockOutcome]) -> bytes:
    """The results as CSV: the parts that were written with their blocks, where all have these columns.

    Examples
    --------
    >>> from dataclasses import replace
    >>> block = BlockOutcome((PairOutcome("GC435", "brass", 2, reason="2 rows"),), law_table(()), {}, {})
    >>> made = results_frame(block.pairs, block.laws)
    >>> results_csv(made, [replace(block, csv=csv_bytes(made))]) == results_csv(made, [block])
    True
    """
    header = _header(results)
    if all(block.csv.startswith(header) for block in blocks):
        return b"".join([header, *(block.csv[len(header) :] for block in blocks)])
    return csv_bytes(results)


def _header(frame: pd.DataFrame) -> bytes:
    return (",".join(_text(str(name)) for name in frame) + "\n").encode(errors="replace")


def _csv_rows(frame: pd.DataFrame) -> bytes:
    columns: list[list[str]] = []
    for of_floats, group in groupby(frame, lambda name: frame[name].dtype == np.float64):
        names = list(group)
        columns += [_floats(frame[names])] if of_floats else [_cells(frame[name]) for name in names]
    return ("\n".join(map(",".join, zip(*columns, strict=True))) + "\n").encode(errors="replace")


def _floats(frame: pd.DataFrame) -> list[str]:
    """Rows of floats with commas between them, by pydantic in a fifth of the time of ``repr``."""
    text = to_json(frame.to_numpy().tolist(), inf_nan_mode="null").decode()
    return text[2:-2].replace("null", "").split("],[")


def _in_order(names: set[str]) -> list[str]:
    """Columns of laws in an order that does not depend on which law came first."""
    known = [name for name in BEFORE if name in names]
    ends = [name for name in AFTER if name in names]
    matches = {name: found for name in names if (found := PARAMETER.fullmatch(name)) and name not in (*BEFORE, *AFTER)}
    parts = (*PARTS, *ENDS)
    parameters = sorted(matches, key=lambda name: (*_rank(matches[name][2]), parts.index(matches[name][1])))
    rest = names - {*LAW, *known, *ends, *parameters}
    posterior = sorted((name for name in rest if name.startswith("posterior")), key=_rank_of_posterior)
    return [*known, *parameters, *posterior, *ends, *sorted(rest - {*posterior})]


def _rank(parameter: str) -> tuple[int, str]:
    """c0, then the roles in their order, then others by name."""
    first = ["c0", *ROLES]
    return (first.index(parameter) if parameter in first else len(first), parameter)


def _rank_of_posterior(name: str) -> tuple[int, str, int]:
    """By parameter: ``posterior_V``, then ``posterior_sd_V``."""
    return (*_rank(name.removeprefix("posterior_").removeprefix("sd_")), len(name))


def _cells(values: pd.Series) -> list[str]:
    if values.dtype == object and pd.api.types.infer_dtype(values, skipna=True) not in ("string", "empty"):
        return [_cell(value) for value in values.tolist()]  # 1, 1.0 and True are the same to `factorize`
    code, unique = pd.factorize(values)  # a missing value is the last one
    found: list[str] = np.array([*map(_cell, unique), ""], dtype=object)[code].tolist()
    return found


def _cell(value: object) -> str:
    if isinstance(value, str):
        return _text(value)
    plain = cell(value)
    return "" if plain is None else repr(plain) if isinstance(plain, float) else str(plain)


def _text(value: str) -> str:
    safe = spreadsheet_cell(value)
    return f'"{safe.replace(chr(34), chr(34) * 2)}"' if _QUOTED.search(safe) else safe


PART = "Part of the source could not be read: a pair that has rows there too was fitted without them."
RESULTS, FIGURES = "results.csv", "figures/"


@dataclass(frozen=True, slots=True)
class Tables:
    """The tables and the number of simulated pairs; the fields are those of `Batch`."""

    results: pd.DataFrame
    attention: pd.DataFrame
    comparison: Comparison
    concerns: tuple[Attention, ...]
    warnings: tuple[str, ...]
    simulated: int

    def files(self) -> dict[str, pd.DataFrame]:
        """The tables by the names of their files."""
        return {
            RESULTS: self.results,
            "attention.csv": self.attention,
            "comparison.csv": self.comparison.families,
            "pooled.csv": self.comparison.pairs,
        }


def tables_of(plan: Plan, blocks: Sequence[BlockOutcome], about: pd.DataFrame | None, workers: Run = SERIAL) -> Tables:
    """The tables of a batch; ``about`` is the table of pairs with their groups."""
    outcomes = [pair for block in blocks for pair in block.pairs]
    warnings = [PART] if plan.unreadable else []
    if about is not None:
        strange = unknown_pairs(outcomes, about)
        warnings += [strange] if strange else []
        outcomes = list(with_groups(outcomes, about))
    groups = _groupings(outcomes, plan.reading.groups)
    results = results_frame(outcomes, laws_of(blocks), groups)
    comparison = compare(results, groups, workers=workers)
    outcomes = with_families(outcomes, results, comparison.pairs)
    return Tables(
        results=results,
        attention=attention_frame(outcomes),
        comparison=comparison,
        concerns=tuple(attention_summary(outcomes)),
        warnings=tuple(warnings),
        simulated=sum(one.simulated for one in outcomes),
    )


def laws_of(blocks: Sequence[BlockOutcome]) -> pd.DataFrame:
    """The laws of all blocks, a pair by its number among the pairs of all."""
    first = np.cumsum([0, *(len(block.pairs) for block in blocks)])
    return joined_tables([
        renumbered(block.laws, np.arange(len(block.pairs)) + start)
        for block, start in zip(blocks, first, strict=False)
    ])  # fmt: skip


def write_tables(out: Path, tables: Tables, blocks: Sequence[BlockOutcome]) -> bool:
    """Write tables and figures into ``out``, and remove figures of laws that no longer exist; True if any table is new.

    Figures are written first: unchanged tables then mean unchanged figures. ``blocks`` are those of the results.
    """
    contents = {
        name: results_csv(frame, blocks) if name == RESULTS else csv_bytes(frame)
        for name, frame in tables.files().items()
    }
    pictured = {name: contents[name] for name in ("comparison.csv", "pooled.csv")}
    if not (all(holds(out, name, content) for name, content in pictured.items()) and _stand(out, tables.comparison)):
        drawn = _drawn(out, tables)
        claim(out, drawn)
        retire(out, FIGURES, drawn)
    new = [put(out, name, content) for name, content in contents.items()]  # all of them
    return any(new)


def _groupings(outcomes: Sequence[PairOutcome], of_source: Sequence[str]) -> tuple[str, ...]:
    """Columns that group the pairs: those of the source first, then those of the table of pairs."""
    return tuple(dict.fromkeys((*of_source, *(name for one in outcomes for name in one.groups))))


def _stand(out: Path, comparison: Comparison) -> bool:
    """Whether all figures that were drawn exist."""
    made = claimed(out, FIGURES)
    return bool(made) == bool(len(comparison.families)) and all((out / name).is_file() for name in made)


def _drawn(out: Path, tables: Tables) -> list[str]:
    if not len(tables.comparison.families):
        return []
    from .exponent_figures import write_figures

    banner = f"{grouped(tables.simulated)} of these pairs simulated, not measured" if tables.simulated else ""
    former = [name.removeprefix(FIGURES) for name in claimed(out, FIGURES)]
    return [f"{FIGURES}{path.name}" for path in write_figures(tables.comparison, out / FIGURES, banner, former)]
