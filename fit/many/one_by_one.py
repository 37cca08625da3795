"""The careful way: one pair through ``power_law``, for whatever a stack cannot settle beyond doubt."""

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ...core.errors import FitmodelsError
from ...datasets.runs import Runs, Source
from ..lawfit import LawFit
from ..regression import power_law
from .pair_rows import PairRows

Ints = NDArray[np.intp]
EDGE = "edge of the row"


def one_law(rows: PairRows, mine: Ints, response: str, factors: tuple[str, ...]) -> LawFit | str:
    """The law of the rows ``mine`` (positions among all), or the sentence that says why there is none."""
    infinite = [(name, i) for name, values in rows.raw.items() for i in mine[np.isinf(values[mine])][:1]]
    if infinite:
        name, i = infinite[0]
        return f"column {name!r} row {i}: {rows.raw[name][i]} is no measurement; leave the row out."
    data = pd.DataFrame({name: values[mine] for name, values in rows.raw.items()})
    if rows.edge is not None:
        data[EDGE] = rows.edge[mine].astype(object)
    source = Source("rows of one pair", "", len(mine), "in memory")
    runs = Runs(data, {}, (), mine, source, "", "")
    try:
        return power_law(runs, response, factors, edge=None if rows.edge is None else EDGE)
    except FitmodelsError as error:
        return str(error)
    except np.linalg.LinAlgError as error:
        return f"{response}: no law, since {error}. Fit the pair with fewer factors."
