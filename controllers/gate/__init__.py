"""The gate in front of the export of a running control: it simulates the exported arithmetic on the cut of the file.

settings      signs, sizes, units, limits and times of the sections against each other
simulation    the controller on load law and dynamics, from a sharp to a worn tool, and under faults

`check_control` lists the findings; `gated_control` refuses where one fails, and makes the only object that the writers
of running controls take.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING, Final, final

import numpy as np

from ...core.arrays import Array
from ...core.errors import GateError, IdentError, ParameterError
from ...ident.draws import drawn_models
from ...parameters.checks import check
from ...parameters.checks.loop_figures import closed_loop, figures
from ...parameters.checks.report import VERDICT, CheckReport, FileFinding
from ...parameters.exports.loop import LoadLoop, loop_settings
from ...parameters.exports.names import plain_lines
from ...parameters.exports.view import ExportView, export_view
from ...parameters.gather.control import model_of
from ...parameters.sections.base import Covariance, ModelCovariance
from ...parameters.setting_words import limits_not_applied
from .settings import Line, check_line, check_order, dynamics_slope, in_units_of_the_loop, line_of_file
from .simulation import LONGEST, Bench, FileKey, Tool, check_losses, drive_of, faults_of, simulate_fault, simulate_tool

if TYPE_CHECKING:
    from ...parameters import ParameterFile
    from ...parameters.sections.dynamics import DynamicsSection, PiSection

_MADE_BY_THE_GATE = object()
DRAWS: Final = 100  # of load law and dynamics
UNSTABLE: Final = 0.05  # share of draws: more are refused
SENSITIVE: Final = 3.0  # sensitivity peak; 1.2 to 2 are typical (Astrom & Hagglund, PID Controllers, 2nd ed. 1995)
LONG: Final = 60.0  # s to settle
NOT_SIMULATED: Final = (
    "No simulation checks calibration and wiring of the sensor, chatter, work, tools and operations other than those "
    "of the load law, a reading that falls to exactly the load in air, a sensor stuck until it is detected, and a "
    "sensor whose steps are coarser than its noise (equal readings for stuck_after are a fault)."
)
DITHER: Final = 1e-5  # of the reference: noise of a sensor whose noise is not known, so that no reading repeats
SEED: Final = 20


def check_control(pf: "ParameterFile") -> CheckReport:
    """Findings of the gate on the control of a parameter file; none where the file has no gains and no settings.

    Signs, sizes, units, limits and times of the sections are compared; then the arithmetic that is exported runs on the
    load law behind the drive's dynamics, the override in steps of 1 %, from a sharp to a worn tool, with draws of law
    and dynamics, and under faults of the sensor. A simulation: it knows no more of the machine than the file.

    Parameters
    ----------
    pf : ParameterFile

    Returns
    -------
    CheckReport

    Examples
    --------
    >>> from fitmodels import controllers, parameters
    >>> controllers.check_control(parameters.collect(tool="GC435", work="709M40", laws=[])).findings
    ()
    """
    if pf.pi is None or pf.load_line is None:
        return CheckReport(())
    if check(pf).inconsistent:
        return CheckReport(
            (FileFinding("control", None, "The control was not simulated, as the file fails its check."),)
        )
    sensors = (sensor.model_dump_json() for sensor in pf.identity.sensors)
    return CheckReport(_findings(FileKey(pf, {"laws", "dynamics", "pi", "load_line", "limits"}, *sensors)))


@lru_cache(maxsize=64)
def _findings(same: FileKey) -> tuple[FileFinding, ...]:
    pf = same.pf
    found = loop_settings(pf, own_form=True)
    if found.loop is None:
        passed = False if pf.pi and pf.load_line and in_units_of_the_loop(pf.pi, pf.load_line) else None
        return (FileFinding("control", passed, f"No control can be exported: the file {found.lacking}"),)
    findings = list(check_line(pf, found.loop))
    if any(f.passed is False and f.name != VERDICT for f in findings):
        return tuple(findings)
    try:
        findings += _simulated(pf, found.loop)
    except ParameterError as error:
        findings.append(FileFinding("control", False, f"The control cannot be simulated: {error}"))
    return tuple(findings)


def _simulated(pf: "ParameterFile", loop: LoadLoop) -> Iterator[FileFinding]:
    pi, model, line = pf.pi, pf.dynamics, pf.load_line
    if pi is None or model is None or line is None:
        return
    if model.integrating:
        yield FileFinding(
            "dynamics",
            False,
            "The dynamics integrate, so that a constant feed has no constant load, but the load line states one for "
            "each feed: a constant-load loop needs dynamics from feed to load, identified in a cut.",
        )
        return
    cut, settling = line_of_file(pf, loop), figures(closed_loop(model, pi))["settling_time"]
    order = [*check_order(pf, loop, cut, settling), *_robust(pf, loop)]
    yield from order
    if not settling <= LONG or settling / loop.sample_time > LONGEST:
        yield FileFinding(
            "times",
            False,
            f"The loop settles in {settling:.4g} s at a sample time of {loop.sample_time:.4g} s; at most {LONG:g} s "
            f"and {LONGEST} samples are simulated. Tune faster, or at a longer sample time.",
        )
        return
    if any(f.passed is False for f in order):
        return
    if pi.verdict is None:
        words = (
            "The gains have no verdict: the file does not state how they were tuned, so no probability of a "
            "specification is known; tune again."
        )
        yield FileFinding("gains", None, words)
    if not cut.noise:
        yield FileFinding(
            "noise",
            None,
            "The file states neither noise of the load's sensor nor residuals of the dynamics, so the "
            "control was simulated without any.",
        )
        cut = replace(cut, noise=DITHER * loop.reference)
    drive = drive_of(model, pi.delay)
    slope = dynamics_slope(pi, model, line, loop)
    basis = "by the load law" if cut.law else "by dynamics and feed limits"
    tools = [(basis, simulate_tool(loop, cut, drive, settling))]
    if abs(slope / cut.B - 1) > 0.02:
        tilted = _tilted(cut, slope, loop)
        tools.append(("with the gain of the dynamics", simulate_tool(loop, tilted, drive, settling, design=False)))
    yield from _tool_findings(tools, loop)
    if not tools[0][1].wrong:
        yield from _draw_findings(pf, loop, cut, settling)
        yield from _fault_findings(loop, tools[0][1].middle)
    yield from (FileFinding("limits", None, words) for words in limits_not_applied(pf.limits, line))
    yield FileFinding("limits", None, NOT_SIMULATED)


def _robust(pf: "ParameterFile", loop: LoadLoop) -> Iterator[FileFinding]:
    """Sensitivity peak of the gains with the gain of the dynamics and with that of the load law."""
    pi, model, line = pf.pi, pf.dynamics, pf.load_line
    if pi is None or model is None or line is None:
        return
    ratio = line_of_file(pf, loop).B / dynamics_slope(pi, model, line, loop)
    for name, gain in (("the dynamics", 1.0), ("the load law", ratio)):
        peak = figures(closed_loop(_scaled(model, gain), pi))["ms"]
        if not peak <= SENSITIVE:
            yield FileFinding(
                "robustness",
                False,
                f"With the gain of {name} the sensitivity peak is {peak:.3g}, more than {SENSITIVE:g}: a small change "
                "of the cut makes the loop oscillate; tune slower.",
            )


def _scaled(model: "DynamicsSection", gain: float) -> "DynamicsSection":
    return model.model_copy(update={"b": tuple(gain * value for value in model.b)})


def _tilted(cut: Line, slope: float, loop: LoadLoop) -> Line:
    """The line with another slope through the load at the middle of the feed limits."""
    middle = (loop.feed_low + loop.feed_high) / 2
    return replace(cut, A=cut.A + (cut.B - slope) * middle, B=slope)


def _tool_findings(tools: list[tuple[str, Tool]], loop: LoadLoop) -> Iterator[FileFinding]:
    for name, tool in tools:
        for words in tool.wrong:
            yield FileFinding("simulation", False, f"Simulated {name}, {words}.")
        if not tool.wrong:
            yield FileFinding(
                "simulation",
                True,
                f"Simulated {name}, a tool runs from sharp to worn: largest mean load "
                f"over 0.2 s {tool.largest:.4g} {loop.unit_load}, a worn tool withstands "
                f"{loop.worn_load:.4g}.",
            )


def _draw_findings(pf: "ParameterFile", loop: LoadLoop, cut: Line, settling: float) -> Iterator[FileFinding]:
    """Findings over draws of load law and dynamics: the share of unstable loops, and a tool on an unfavourable one."""
    pi, model = pf.pi, pf.dynamics
    if pi is None or model is None:
        return
    try:
        lines, models = _lines(pf, cut), _models(model)
    except IdentError as error:
        yield FileFinding("draws", False, f"The dynamics cannot be drawn: {error}")
        return
    used = ["the load law"] if len(lines) > 1 else []
    used += ["the dynamics"] if len(models) > 1 else []
    if not used:
        yield FileFinding(
            "draws",
            None,
            "Neither load law nor dynamics have a covariance, so the control was simulated at their estimates alone.",
        )
        return
    pairs = [(lines[k % len(lines)], models[k % len(models)]) for k in range(DRAWS)]
    radii = np.array([_radius(line, drawn, model, pi, cut) for line, drawn in pairs])
    unstable, words = float(np.mean(~(radii < 1))), f"{DRAWS} draws of {' and '.join(used)}"
    if unstable > UNSTABLE:
        yield FileFinding(
            "draws",
            False,
            f"Of {words}, {100 * unstable:.0f} % make the loop unstable, more than "
            f"{100 * UNSTABLE:.0f} %; tune slower, or identify from a longer record.",
        )
        return
    wrong = dict.fromkeys(
        words
        for line, drawn in _unfavourable(pairs, radii)
        for words in simulate_tool(loop, line, drive_of(drawn, pi.delay), settling, design=False).wrong
    )
    for found in wrong:
        yield FileFinding("draws", False, f"Simulated on an unfavourable draw of {' and '.join(used)}, {found}.")
    if not wrong:
        yield FileFinding(
            "draws",
            True,
            f"Of {words}, {100 * unstable:.0f} % make the loop unstable (at most {100 * UNSTABLE:.0f} % allowed); on "
            "unfavourable ones (stability, slope and level at 95 %) a tool runs from sharp to worn.",
        )


def _unfavourable(pairs: "list[tuple[Line, DynamicsSection]]", radii: Array) -> "list[tuple[Line, DynamicsSection]]":
    """The draws at 95 % of the spectral radius and of the slope, and at 5 % and 95 % of the load at rest."""
    place = round((1 - UNSTABLE) * (len(pairs) - 1))
    levels, slopes = np.array([line.A for line, _ in pairs]), np.array([line.B for line, _ in pairs])
    orders = [np.argsort(radii), np.argsort(slopes), np.argsort(levels), np.argsort(-levels)]
    return [pairs[k] for k in dict.fromkeys(int(order[place]) for order in orders)]


def _lines(pf: "ParameterFile", cut: Line) -> list[Line]:
    """Draws of A, B and k1, those with a load that rises with feed and wear; the line itself without a covariance."""
    law = None if pf.load_line is None else pf.laws.get(pf.load_line.law)
    if law is None or law.form != "load_line" or not isinstance(law.uncertainty, Covariance):
        return [cut]
    held, rng = law.uncertainty, np.random.default_rng(SEED)
    steps = rng.multivariate_normal(np.zeros(len(held.of)), np.array(held.matrix), DRAWS, method="eigh")
    moved = {name: steps[:, k] for k, name in enumerate(held.of)}
    A, B, k1 = (getattr(cut, name) + moved.get(name, np.zeros(DRAWS)) for name in ("A", "B", "k1"))
    lines = [
        replace(cut, A=float(a), B=float(b), k1=float(k)) for a, b, k in zip(A, B, k1, strict=True) if b > 0 and k > 0
    ]
    return lines or [cut]


def _models(model: "DynamicsSection") -> list["DynamicsSection"]:
    """Draws of the dynamics and of its alternatives that are stable; the model itself without a covariance.

    Raises
    ------
    IdentError
        Most draws are unstable.
    """
    if not isinstance(model.uncertainty, ModelCovariance):
        return [model]
    drawn = drawn_models(model_of(model), DRAWS, SEED + 1).models
    sections = [
        model.model_copy(update={"a": tuple(one.a.tolist()), "b": tuple(one.b.tolist()), "nk": one.nk})
        for one in drawn
        if np.isfinite(one.dc_gain) and one.dc_gain > 0
    ]
    return sections or [model]


def _radius(line: Line, drawn: "DynamicsSection", model: "DynamicsSection", pi: "PiSection", cut: Line) -> float:
    """Spectral radius of the loop with the shape of a drawn drive, its gain in proportion to the drawn slope."""
    gain = model.dc_gain / drawn.dc_gain * line.B / cut.B
    return closed_loop(_scaled(drawn, gain), pi).radius


def _fault_findings(loop: LoadLoop, middle: Bench | None) -> Iterator[FileFinding]:
    if middle is None:
        return
    faults = faults_of(loop, loop.reference)
    wrong = [words for fault in faults if (words := simulate_fault(loop, middle, fault))]
    for words in wrong:
        yield FileFinding("fault", False, f"{words[:1].upper()}{words[1:]}; run `fitmodels settings` again.")
    if not wrong:
        names = ", ".join(fault.name for fault in faults)
        yield FileFinding(
            "fault", True, f"Each of these takes the feed to its lower limit, latched until reset: {names}."
        )
    yield from check_losses(middle)


@final
class GatedControl:
    """A control that has passed the gate, the only argument that the writers of running controls take.

    Attributes
    ----------
    view : ExportView
        The parameter file as a controller needs it.
    loop : LoadLoop
        Gains, limits and settings of the control, in the form of the file: ``position`` or ``incremental_sum``.

    Examples
    --------
    >>> try:
    ...     GatedControl()
    ... except TypeError as error:
    ...     print(error)
    a GatedControl is made by gated_control(pf), which checks the control first
    """

    __slots__ = ("loop", "view")
    view: ExportView
    loop: LoadLoop

    def __init__(self, view: ExportView | None = None, loop: LoadLoop | None = None, *, _key: object = None) -> None:
        if _key is not _MADE_BY_THE_GATE or view is None or loop is None:
            raise TypeError("a GatedControl is made by gated_control(pf), which checks the control first")
        object.__setattr__(self, "view", view)
        object.__setattr__(self, "loop", loop)

    def __setattr__(self, name: str, value: object) -> None:
        """Refuse: what passed the gate does not change."""
        raise AttributeError(f"GatedControl.{name} cannot be set")


def gated_control(pf: "ParameterFile", *, accept_verdict: bool = False) -> GatedControl:
    """The control of a parameter file, once it has passed the gate.

    Parameters
    ----------
    pf : ParameterFile
    accept_verdict : bool
        Accept laws, dynamics and gains that must not be used for control, or have no verdict, and a file without a load
        law, whose cut is then that of dynamics and feed limits.

    Raises
    ------
    GateError
        The file fails the check or the gate, has no control, or a part of it must not be used for control.
    """
    require_control(pf, accept_verdict=True)  # what no acceptance carries is named before a verdict
    view = export_view(pf, accept_verdict=accept_verdict, loop_only=True)
    found = loop_settings(pf, own_form=True)
    if found.loop is None:
        raise GateError(f"the parameter file of {view.tool} on {view.work} {found.lacking}")
    remarks = require_control(pf, accept_verdict=accept_verdict)
    lines = tuple(line for words in remarks for line in plain_lines(words))
    return GatedControl(replace(view, verdicts=(*view.verdicts, *lines)), found.loop, _key=_MADE_BY_THE_GATE)


def require_control(pf: "ParameterFile", *, accept_verdict: bool = False) -> tuple[str, ...]:
    """Raise where a finding of the gate fails; returns what was accepted and what was not checked, for the export.

    Raises
    ------
    GateError
        A finding fails that is not a verdict, or a verdict that is not accepted.

    Examples
    --------
    >>> from fitmodels import parameters
    >>> require_control(parameters.collect(tool="GC435", work="709M40", laws=[]))
    ()
    """
    report = check_control(pf)
    refused = [f for f in report.failed if not (accept_verdict and f.name == VERDICT)]
    if refused:
        first, *others = refused
        more = f" {len(others)} more: see `fitmodels check`." if others else ""
        accept = " --accept-verdict exports it all the same and records that in the exported file."
        acceptable = all(f.name == VERDICT for f in refused)
        raise GateError(f"not exported: {first.words}{more}{accept if acceptable else ''}")
    accepted = [f"VERDICT ACCEPTED - {f.words}" for f in report.failed]
    return (*accepted, *(f.words for f in report.findings if f.passed is None))
