"""The figures that a specification looks at, for many loops: margins are followed only where they are asked for.

On hundreds of different plants the margins take most of the time, and a specification in seconds needs none.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..model import Model
from .gains import PiGains
from .loops import loops_of, split
from .maps import UNSTABLE
from .margins import margin_figures
from .norms import noise_size, stable_columns
from .specification import LIMITS, Specification, table_of
from .steps import step_figures

Array = NDArray[np.float64]
MARGINS = frozenset({"ms", "mt", "phase_margin", "gain_margin", "crossover", "delay_margin"})


def judged_figures(
    model: Model | Sequence[Model],
    kp: ArrayLike,
    ki: ArrayLike,
    template: PiGains,
    duration: float,
    specification: Specification,
    *more: str,
) -> dict[str, Array]:
    """Figures of the step for every pair of gains, and those of the margins where the specification or ``more`` asks.

    Shapes as of `figures_on_grid`: (m,), or (number of models, m) for a sequence.

    Examples
    --------
    >>> model = Model(b=[0.0, 0.2], a=[1.0, -0.8], nk=1, sample_time=0.1)
    >>> asked = Specification(rise_time=2.0)
    >>> table = judged_figures(model, [0.5, 20.0], [0.5, 0.5], PiGains(1.0, 1.0, 0.1), 20.0, asked)
    >>> table["stable"].tolist(), "ms" in table
    ([True, False], False)
    """
    wanted = {LIMITS[name].figure for name, _, _ in specification.asked()} | set(more)
    loops = loops_of(model, kp, ki, template)
    names = [name for name in UNSTABLE if name in wanted or name not in MARGINS]
    table: dict[str, Array] = {name: np.full(len(loops), UNSTABLE[name]) for name in names}
    samples = round(duration / template.sample_time) + 1
    for where, part in split(loops):
        characteristic = part.characteristic
        good = stable_columns(characteristic)
        if not good.any():
            continue
        kept = part[good]
        found = {"stable": np.ones(len(kept), dtype=bool), **step_figures(kept, samples)}
        found["noise_gain"] = noise_size(kept.noise_numerator, characteristic[:, good])
        if wanted & MARGINS:
            found |= margin_figures(kept)
        for name in names:
            table[name][where[good]] = found[name]
    if not isinstance(model, Model):
        table = {name: values.reshape(len(model), -1) for name, values in table.items()}
    return table_of(table, kp, ki)
