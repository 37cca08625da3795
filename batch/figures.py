"""Figure of a batch: the first exponent of its pairs."""

from matplotlib.axes import Axes

from ..core.display import plot
from ..core.errors import UsageError
from ..core.plotting import whiskers
from .exponent_figures import pair_names
from .result import Batch


@plot.register
def exponents_figure(result: Batch, ax: Axes | None = None) -> Axes:
    """The first exponent of the first power law of the pairs, with 95 % intervals; the first sixty in their order."""
    results = result.results
    laws = results[(results["reason"] == "") & (results["form"] == "power")]
    rows = laws[laws["response"] == laws["response"].iloc[0]] if len(laws) else laws
    exponents = rows.filter(regex="^params_(?!c0$)").dropna(axis="columns", how="all")
    if not len(exponents.columns):
        raise UsageError("no pair has a power law: there is no exponent to draw.")
    response, factor = rows["response"].iloc[0], str(exponents.columns[0]).removeprefix("params_")
    rows = rows[exponents.iloc[:, 0].notna()]
    values = rows[[f"{part}_{factor}" for part in ("params", "low", "high")]].astype(float)
    estimates = dict(zip(pair_names(rows), values.itertuples(index=False, name=None), strict=True))
    return whiskers(
        estimates, ax, label=f"exponent of {factor} in the law of {response} (no unit), with 95 % intervals"
    )
