"""Runs of one tool that alternates two kinds of cut, each with its own limits: the mixed path of Table 3.

The program selects the settings, as it knows which cut comes. The paper prints no lengths of its tool path: passes of
150 mm in turn are a reconstruction.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from ...core.errors import UsageError
from ..loop import replay
from .control_laws import line_of
from .controller import ConstantLoad
from .cut_model import CutModel
from .plant import GAP, PASS, MillingCut
from .runs import BEYOND, CHANGE, RECORDED, SETTLE, ToolRun, longest, run_of

if TYPE_CHECKING:
    from ...parameters import ParameterFile


@dataclass(slots=True)
class ControllerByCut:
    """One controller for each kind of cut: that of the current cut runs, the others keep their last command.

    Its command is the feed over the mill's programmed feed.
    """

    controllers: Sequence[ConstantLoad]
    mill: MillingCut
    command: float = field(init=False)
    reference: float = field(init=False)
    news: tuple[str, ...] = field(default=(), init=False)
    labels: tuple[str, str] = field(init=False)

    def __post_init__(self) -> None:
        first = self.controllers[self.mill.kind]
        self.command = first.command * first.loop.feed_programmed / self.mill.programmed
        self.reference, self.labels = first.reference, first.labels

    def step(self, measurement: float, dt: float) -> float:
        """Answer a load by the controller of the current cut."""
        now = self.controllers[self.mill.kind]
        self.command = now.step(measurement, dt) * now.loop.feed_programmed / self.mill.programmed
        self.reference, self.news = now.reference, now.news
        return self.command


def mixed_run(
    files: Sequence["ParameterFile"],
    passes: Sequence[tuple[int, float]] = ((0, PASS), (1, PASS)),
    *,
    gap: float = GAP,
    seed: int = 1,
    settle: float = SETTLE,
) -> ToolRun:
    """Replay one tool over several kinds of cut until one of their controllers signals the change.

    Parameters
    ----------
    files : sequence of ParameterFile
        One for each kind of cut, of one drive, period and unit.
    passes : sequence of (int, float)
        Kind and length in mm, over and over again.
    gap, seed, settle
        As in `constant_load_run`.

    Raises
    ------
    UsageError
        The files differ in the drive, in its period or in their units.
    GateError, ParameterError
        A file cannot drive it.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> from fitmodels.parameters.published.milling import end_milling
    >>> run = mixed_run([published("CLM-2023-slot"), end_milling(upper=1100.0)])
    >>> run.worn, f"{run.wear:.0f} um, by {('slot', 'end')[run.passes[-1].kind]} milling"
    (True, '189 um, by slot milling')
    """
    controllers = [ConstantLoad.from_parameters(pf, running=True) for pf in files]
    cuts = [CutModel.from_parameters(pf) for pf in files]
    _check_alike(cuts, controllers)
    mill = MillingCut(cuts, max(c.loop.feed_programmed for c in controllers), passes, gap)
    worst = max(line_of(pf).window[1] for pf in files)
    slowest = min(passes, key=lambda item: item[1])[1]
    duration = sum(longest(cut, BEYOND * worst, c.loop.feed_low, gap, slowest)
                   for cut, c in zip(cuts, controllers, strict=True))  # fmt: skip
    trace = replay(
        ControllerByCut(controllers, mill), mill, duration=duration, dt=cuts[0].sample_time, seed=seed, record=RECORDED,
        until=CHANGE,
    )  # fmt: skip
    rest = [c.rest * c.loop.feed_programmed / mill.programmed for c in controllers]
    return run_of(trace, controllers[0].reference, rest, [cut.area for cut in cuts], settle)


def _check_alike(cuts: Sequence[CutModel], controllers: Sequence[ConstantLoad]) -> None:
    alike = {
        (cut.b, cut.a, c.loop.sample_time, cut.unit_load, cut.unit_feed, cut.unit_wear)
        for cut, c in zip(cuts, controllers, strict=True)
    }
    if len(alike) > 1:
        raise UsageError(
            f"{len(cuts)} files of a mixed path: they differ in drive, period or units; give files of one machine."
        )
