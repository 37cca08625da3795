"""A pair with more rows than memory: each of its power laws is fitted in one pass over the chunks."""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from ...datasets.plausibility.ranges import process_of
from ...datasets.runs import disclaimers
from ...datasets.vocabulary import ROLES
from ...fit.defaults import SETTINGS, Asked, Held, requested_laws
from ..law_rows import law_table, reasons, row_of, row_without
from ..outcomes import GONE, Cell, Concern, Failure, PairOutcome, attempt
from ..pair_table import identity_of
from ..plan import BatchOptions, Block, Plan
from .concerns import concerns_of_file, concerns_of_laws, differs, responses_of_power_laws, unknown_conditions
from .pair_file import PARAMETERS, law_cells, with_cells
from .pair_laws import is_stacked, texts, unit_of

if TYPE_CHECKING:
    from collections.abc import Generator

    from ...fit import LawFit
    from ...fit.fitted_rows import LawSource

NO_DRAWS = "rows of a stream are not kept, but draws need them; for so many rows the confidence interval is equivalent"
SEVERAL = 5  # names of a group that are kept


@dataclass(slots=True)
class Seen:
    """Contents of a stream: number of rows, non-empty columns, names of groups; ``whole`` at its end."""

    headers: tuple[str, ...]
    rows: int = 0
    held: set[str] = field(default_factory=set)
    ends: dict[str, tuple[float, float]] = field(default_factory=dict)  # of columns of settings
    names: dict[str, list[str]] = field(default_factory=dict)
    whole: bool = False

    def over(self, chunks: Iterable[pd.DataFrame]) -> Iterator[pd.DataFrame]:
        """The chunks, recorded as they pass."""
        for chunk in chunks:
            self.rows += len(chunk)
            self.held |= {str(name) for name in chunk if name not in self.held and chunk[name].notna().any()}
            for name in (str(name) for name in chunk if name in SETTINGS and chunk[name].notna().any()):
                low, high = self.ends.get(name, (np.inf, -np.inf))
                self.ends[name] = min(low, float(chunk[name].min())), max(high, float(chunk[name].max()))
            for header in (name for name in self.headers if name in chunk):
                new = [name for name in dict.fromkeys(texts(chunk[header])) if name]
                self.names[header] = list(dict.fromkeys([*self.names.get(header, []), *new]))[:SEVERAL]
            yield chunk
        self.whole = True


def streamed_outcome(block: Block, plan: Plan, options: BatchOptions) -> tuple[PairOutcome, pd.DataFrame]:
    """Fit the power laws of the pair of a streamed block; the table of its laws is that of rows in memory.

    Every law reads the chunks anew. Load laws, roughness and additive errors need all rows at once: their
    rows in the table give this reason. There is no posterior, no tool life and no design section.
    """
    pair = block.pairs[0]
    with closing(_chunks(block, plan)) as chunks:
        first = next(chunks, None)
    if first is None:
        return PairOutcome(pair.tool, pair.work, 0, reason=GONE), law_table(())
    seen = Seen(plan.reading.groups)
    fitted = _laws(block, plan, options, seen, frozenset(map(str, first.columns)))
    table = law_table((0, row) for row, _ in fitted)
    groups = {header: next(iter(seen.names.get(header, [])), "") for header in plan.reading.groups}
    none = reasons(table)
    concerns = [
        *concerns_of_laws(table, none, 1)[0],
        *(differs(h, names, len(names) == SEVERAL) for h, names in seen.names.items() if len(names) > 1),
    ]
    known, process = {*plan.reading.constants, *seen.held}, plan.reading.process or process_of(seen.held, plan.notes)
    concerns += unknown_conditions(responses_of_power_laws(table).get(0, []), known, plan.notes, process)
    files: Mapping[str, bytes] = {}
    if options.files and any(law is not None for _, law in fitted):
        made = attempt(lambda: _file(block, options, [law for _, law in fitted if law is not None], groups))
        if isinstance(made, Failure):
            concerns.append(Concern("no parameter file", made.reason))
        else:
            files, cells, odd = made
            table, concerns = with_cells(table, {0: cells}), [*concerns, *odd]
    reason = none.get(0, "") if fitted else no_law_asked(seen.held)
    simulated = bool(disclaimers(plan.notes))
    rows = seen.rows or block.rows
    return PairOutcome(pair.tool, pair.work, rows, reason, tuple(concerns), groups, simulated, files), table


def no_law_asked(held: Iterable[str]) -> str:
    """Reason why the columns allow no law.

    >>> no_law_asked({"V", "tool"})
    'its rows hold V alone: a law needs a response (wear, a force, T, Ra) and conditions (V, f, d, t).'
    """
    names = ", ".join(sorted(set(held) & set(ROLES) - {"tool", "work", "edge"})) or "nothing with a role"
    return f"its rows hold {names} alone: a law needs a response (wear, a force, T, Ra) and conditions (V, f, d, t)."


def _chunks(block: Block, plan: Plan) -> "Generator[pd.DataFrame, None, None]":
    from ..source import chunks_of

    yield from chunks_of(block, plan)


def _laws(
    block: Block, plan: Plan, options: BatchOptions, seen: Seen, header: frozenset[str]
) -> "list[tuple[dict[str, Cell], LawFit | None]]":
    """The rows of the table and the laws; the first pass also finds empty columns."""
    process = plan.reading.process or process_of(header, plan.notes)
    asked, done = requested_laws(Held.of(header.__contains__, process=process), options.laws), {}
    if asked:
        done[asked[0]] = _law(block, plan, options, asked[0], seen)
        if seen.whole:
            varying = frozenset(name for name, (low, high) in seen.ends.items() if low < high)
            asked = requested_laws(Held(seen.held.__contains__, varying.__contains__, process), options.laws)
    else:
        for _ in seen.over(_chunks(block, plan)):
            pass
    return [done[law] if law in done else _law(block, plan, options, law, None) for law in asked]


def _law(
    block: Block, plan: Plan, options: BatchOptions, asked: Asked, seen: Seen | None
) -> "tuple[dict[str, Cell], LawFit | None]":
    from ...fit import streamed_power_law

    unit = unit_of({}, asked.response)

    def fitted() -> "LawFit":
        with closing(_chunks(block, plan)) as chunks:
            read = chunks if seen is None else seen.over(chunks)
            return streamed_power_law(read, asked.response, asked.factors, source=_source(block, plan))

    if not is_stacked(asked, options):
        form = options.form_of(asked.response) or asked.form
        kind = "additive errors" if form == "power" else f"the form {form}"
        kind = f"laws of {asked.response}" if asked.form != "power" or asked.response == "T" else kind
        why = f"{asked.response}: {kind} need all rows in memory, and these are streamed; fit a sample of them."
        return row_without(asked, unit, why), None
    made = attempt(fitted)
    if isinstance(made, Failure):
        return row_without(asked, unit, made.reason), None
    return row_of(made, asked), made


def _source(block: Block, plan: Plan) -> "LawSource":
    from ...fit.fitted_rows import LawSource

    pair, found = block.pairs[0], disclaimers(plan.notes)
    return LawSource(plan.name, "", pair.tool, pair.work, bool(found), ". ".join(found))


def _file(
    block: Block, options: BatchOptions, laws: "list[LawFit]", groups: Mapping[str, str]
) -> tuple[dict[str, bytes], dict[str, dict[str, Cell]], list[Concern]]:
    from ... import fit, parameters
    from ...parameters.file import as_bytes

    identity, odd = identity_of(
        block.identity_of(block.pairs[0]) | {header: name for header, name in groups.items() if name}
    )
    none = {law.response: fit.NotAvailable(NO_DRAWS) for law in laws}
    pf = parameters.collect(
        laws=laws, no_posterior=none, command=options.command, options=options.recorded(), seed=options.seed,
        **identity,  # type: ignore[arg-type]
    )  # fmt: skip
    return {PARAMETERS: as_bytes(pf)}, law_cells(pf), [*odd, *concerns_of_file(pf)]
