"""Exports of a parameter file: running controls, and the values that `fitmodels.parameters.exports` writes.

`SYSTEMS` holds what can be controlled, each in its formats:

hal     LinuxCNC HAL: the loop from a load pin to motion.adaptive-feed
st      IEC 61131-3 structured text: the loop as a function block
c       C for firmware: one step function with the settings of the tool
comp    LinuxCNC component: the same C, compiled by halcompile
fmu     FMI 2.0 co-simulation: the same C as a source FMU
nc      NC program of the turning plan; csv: its table

A running control, and the values of a file that has one, are written only after `fitmodels.controllers.gate`.
"""

import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from ...core.errors import GateError, UsageError
from ...core.suggestions import did_you_mean
from ...parameters.checks.report import require_verdicts
from ...parameters.exports import VALUES, ExportFormat, write_export
from ...parameters.exports.view import export_view
from ..adaptive_force.settings import lacking as adaptive_force_lacks
from ..gate import GatedControl, check_control, gated_control, require_control
from ..gate.adaptive_force import check_adaptive_force, gated_adaptive_force, require_force_controls
from ..gate.roughness import check_roughness, gated_roughness, roughness_lacks
from ..recursion.from_file import shortfall
from .c_source import NOT_IN_C, c_file
from .component import NOT_IN_COMPONENT, component_file
from .fmu import NOT_IN_FMU, fmu_file
from .hal import NOT_IN_HAL, hal_file
from .plan_table import (
    NOT_IN_PLAN,
    NOT_IN_PLAN_ST,
    ExportJob,
    plan_c,
    plan_component,
    plan_control,
    plan_fmu,
    plan_notes,
    plan_st,
)
from .region_table import (
    NOT_IN_REGION,
    NOT_IN_REGION_ST,
    region_c,
    region_component,
    region_control,
    region_fmu,
    region_lacks,
    region_notes,
    region_st,
)
from .st import NOT_IN_ST, structured_text
from .turning_program import NOT_IN_CSV, NOT_IN_NC, TurningExport, csv_table, nc_program, turning_export

if TYPE_CHECKING:
    from ...parameters import ParameterFile
    from ...parameters.checks.report import FileFinding

SIMULATED: Final = ("simulation", "draws", "fault")  # findings that state how the control was tried


@dataclass(frozen=True, slots=True)
class ControlFormat:
    """A format of a running control: suffix, description, function that writes it, what it cannot carry.

    ``render`` takes what `ControlSystem.prepared` returns. ``file_name`` is the name that the program which reads it
    demands; ``incremental_sum`` whether it carries that form of the PI. ``prepared`` and ``notes`` are those of the
    format where they are not those of its system.
    """

    suffix: str
    words: str
    render: Callable[[Any], str | bytes]
    not_carried: tuple[str, ...]
    file_name: str = ""
    incremental_sum: bool = True
    prepared: "Callable[[ParameterFile, ExportJob], Any] | None" = None
    notes: "Callable[[ParameterFile, Any], tuple[str, ...]] | None" = None


@dataclass(frozen=True, slots=True)
class ControlSystem:
    """A system that running controls are exported for, with the formats in which it is exported.

    Attributes
    ----------
    words : str
        Description in one line.
    lacks : callable
        Reason why a file does not support it; empty where it does.
    prepared : callable
        The control of a file and a job, as the formats render it; raises GateError where it must not be exported.
    notes : callable
        Lines on it for the person who exports it: verdicts, how it was tried, what was assumed.
    formats : mapping of ControlFormat
        By kind.
    draws : bool
        Whether it uses the draws of the file.
    """

    words: str
    lacks: "Callable[[ParameterFile], str]"
    prepared: "Callable[[ParameterFile, ExportJob], Any]"
    notes: "Callable[[ParameterFile, Any], tuple[str, ...]]"
    formats: Mapping[str, ControlFormat]
    draws: bool = False


@dataclass(frozen=True, slots=True)
class Exported:
    """Content of an exported file, the lines to print about it, and its system, empty of values."""

    content: str | bytes
    notes: tuple[str, ...]
    system: str = ""


def _load_lacks(pf: "ParameterFile") -> str:
    lacking = [name for name in ("pi", "load_line") if getattr(pf, name) is None]
    return f"the file has no section {' nor '.join(lacking)}." if lacking else ""


def _load_control(pf: "ParameterFile", job: ExportJob) -> GatedControl:
    return gated_control(pf, accept_verdict=job.accept_verdict)


def _load_notes(pf: "ParameterFile", control: GatedControl) -> tuple[str, ...]:
    held = require_verdicts(pf, accepted=True, loop_only=True)
    return (*held, *_tried(check_control(pf).findings), *(f"assumed: {words}" for words in control.view.assumed))


def _tried(found: "Iterable[FileFinding]") -> tuple[str, ...]:
    """Lines on how the controls of the file were tried."""
    return (
        *(f"VERDICT ACCEPTED - {f.words}" for f in found if f.passed is False),
        *(f"{f.name}: {f.words}" for f in found if f.passed and f.name in SIMULATED),
        *(f"not known: {f.words}" for f in found if f.passed is None),
    )


CONTROLS: Final = {
    "hal": ControlFormat(
        ".hal", "LinuxCNC HAL file: load pin to motion.adaptive-feed", hal_file, NOT_IN_HAL, incremental_sum=False
    ),
    "st": ControlFormat(".st", "IEC 61131-3 structured text function block", structured_text, NOT_IN_ST),
    "c": ControlFormat(".c", "C source of the controller for firmware", c_file, NOT_IN_C),
    "comp": ControlFormat(
        ".comp", "LinuxCNC component for halcompile", component_file, NOT_IN_COMPONENT, file_name="fm_control.comp"
    ),
    "fmu": ControlFormat(".fmu", "FMI 2.0 co-simulation, source FMU", fmu_file, NOT_IN_FMU),
}


def _turning(pf: "ParameterFile", job: ExportJob) -> TurningExport:
    return turning_export(pf, job.turning, draws=job.draws, seed=job.seed, accept_verdict=job.accept_verdict)


def _turning_notes(pf: "ParameterFile", made: TurningExport) -> tuple[str, ...]:
    return made.notes


TURNING: Final = {
    "nc": ControlFormat(
        ".nc", "NC program of the turning plan, LinuxCNC or Fanuc", nc_program, NOT_IN_NC, prepared=_turning,
        notes=_turning_notes,
    ),
    "csv": ControlFormat(
        ".csv", "table of the turning plan", csv_table, NOT_IN_CSV, prepared=_turning, notes=_turning_notes
    ),
}  # fmt: skip
PLAN: Final = {
    "st": ControlFormat(".st", "structured text function block", plan_st, NOT_IN_PLAN_ST),
    "c": ControlFormat(".c", "C source of the table", plan_c, NOT_IN_PLAN),
    "comp": ControlFormat(".comp", "LinuxCNC component", plan_component, NOT_IN_PLAN, file_name="fm_plan.comp"),
    "fmu": ControlFormat(".fmu", "FMI 2.0 co-simulation, source FMU", plan_fmu, NOT_IN_PLAN),
}
REGION: Final = {
    "st": ControlFormat(".st", "structured text function block", region_st, NOT_IN_REGION_ST),
    "c": ControlFormat(".c", "C source of the limits", region_c, NOT_IN_REGION),
    "comp": ControlFormat(".comp", "LinuxCNC component", region_component, NOT_IN_REGION, file_name="fm_region.comp"),
    "fmu": ControlFormat(".fmu", "FMI 2.0 co-simulation, source FMU", region_fmu, NOT_IN_REGION),
}


def _roughness(pf: "ParameterFile", job: ExportJob, *, per_minute: bool = False) -> GatedControl:
    return gated_roughness(pf, accept_verdict=job.accept_verdict, per_minute=per_minute)


def _adaptive_force(pf: "ParameterFile", job: ExportJob) -> GatedControl:
    return gated_adaptive_force(pf, depth=job.depth, accept_verdict=job.accept_verdict)


def _force_notes(pf: "ParameterFile", control: GatedControl) -> tuple[str, ...]:
    ratio = control.loop.law == "ratio"
    found = (check_roughness if ratio else check_adaptive_force)(pf)
    law = pf.roughness.law if ratio and pf.roughness is not None else "adaptive_force"
    held = (*require_verdicts(pf, accepted=True, only=(law,)), *(f.words for f in found if f.passed is None))
    tried = (f"{f.name}: {f.words}" for f in found if f.passed and f.name in SIMULATED)
    assumed = (f"assumed: {words}" for words in control.view.assumed)
    return (*held, *tried, *assumed)


FORCE: Final = {kind: CONTROLS[kind] for kind in ("st", "c", "comp", "fmu")}
ROUGHNESS: Final = {**FORCE, "comp": replace(CONTROLS["comp"], prepared=partial(_roughness, per_minute=True))}
LOAD: Final = "constant-load"
SYSTEMS: Final[dict[str, ControlSystem]] = {
    LOAD: ControlSystem("constant load by feed override", _load_lacks, _load_control, _load_notes, CONTROLS),
    "recursion": ControlSystem(
        "speed and feed by a plan of the life of an edge",
        shortfall,
        plan_control,
        plan_notes,
        {**PLAN, **TURNING},
        draws=True,
    ),
    "roughness": ControlSystem(
        "constant roughness by feed override", roughness_lacks, _roughness, _force_notes, ROUGHNESS
    ),
    "adaptive-force": ControlSystem(
        "adaptive force control by feed override", adaptive_force_lacks, _adaptive_force, _force_notes, FORCE
    ),
    "region": ControlSystem(
        "limits on speed and feed at a time and a wear", region_lacks, region_control, region_notes, REGION
    ),
}


def _formats() -> dict[str, ControlFormat | ExportFormat]:
    """Every format by kind: of a kind that several systems have, that of the first."""
    found: dict[str, ControlFormat | ExportFormat] = {}
    for system in SYSTEMS.values():
        for kind, of in system.formats.items():
            found.setdefault(kind, of)
    return {**found, **VALUES}


FORMATS: Final = _formats()


def export_format(kind: str, system: str | None = None) -> ControlFormat | ExportFormat:
    """The format of this name; of a running control that of the system, by default the first that has it.

    Raises
    ------
    UsageError
        The format does not exist.

    Examples
    --------
    >>> export_format("hal").suffix
    '.hal'
    """
    if kind.lower() in ("fanuc", "linuxcnc"):
        raise UsageError(f"there is no export {kind!r}: an NC program for it is --to nc --dialect {kind.lower()}.")
    if kind not in FORMATS:
        raise UsageError(f"there is no export {kind!r}. {did_you_mean(kind, FORMATS, names='There are ')}")
    return FORMATS[kind] if system is None or kind in VALUES else SYSTEMS[system].formats[kind]


def system_of(pf: "ParameterFile", kind: str, system: str | None = None) -> str:
    """The system whose control is exported in this kind; empty for values.

    Without a name it is constant load where the file has gains and a load line, else the only one that the file
    supports.

    Raises
    ------
    UsageError
        There is no such system, it is not exported in this kind, or the file supports several.

    Examples
    --------
    >>> from fitmodels import parameters
    >>> system_of(parameters.collect(tool="GC435", work="709M40", laws=[]), "hal")
    'constant-load'
    """
    export_format(kind)
    if system is not None and system not in SYSTEMS:
        raise UsageError(f"--system {system}: there is no such system. {did_you_mean(system, SYSTEMS, 0.6)}")
    if kind in VALUES:
        if system is not None:
            raise UsageError(f"{kind} holds the values of the whole file; leave --system {system} out.")
        return ""
    able = [name for name, each in SYSTEMS.items() if kind in each.formats]
    if system is not None:
        if system not in able:
            kinds = ", ".join(SYSTEMS[system].formats)
            raise UsageError(f"{system} is not exported as {kind}; its kinds: {kinds}.")
        return system
    if len(able) == 1 or (LOAD in able and not _load_lacks(pf)):
        return LOAD if LOAD in able else able[0]
    supported = [name for name in able if not SYSTEMS[name].lacks(pf)]
    if len(supported) > 1:
        raise UsageError(f"the file supports {' and '.join(supported)}; choose one with --system {supported[0]}.")
    return supported[0] if supported else LOAD if LOAD in able else able[0]


def exported(pf: "ParameterFile", kind: str, *, system: str | None = None, job: ExportJob | None = None) -> Exported:
    """Content of an export with its notes; errors are those of `export`."""
    job = job or ExportJob()
    name = system_of(pf, kind, system)
    of = export_format(kind, name or None)
    not_carried = tuple(f"not included: {words}" for words in of.not_carried)
    if isinstance(of, ControlFormat):
        control = (of.prepared or SYSTEMS[name].prepared)(pf, job)
        if isinstance(control, GatedControl) and control.loop.form == "incremental_sum" and not of.incremental_sum:
            raise GateError(
                f"the gains of {control.view.tool} on {control.view.work} have the form incremental_sum, which "
                f"{kind} does not carry; use the component (kind comp) or the C controller (kind c), or tune in the "
                "form position."
            )
        content = of.render(control)
        return Exported(content, (*(of.notes or SYSTEMS[name].notes)(pf, control), *not_carried), name)
    view = export_view(pf, accept_verdict=job.accept_verdict)
    require_control(pf, accept_verdict=job.accept_verdict)
    notes = (
        *require_verdicts(pf, accepted=True),
        *_tried((*check_control(pf).findings, *require_force_controls(pf))),
        *(f"assumed: {words}" for words in view.assumed),
    )
    return Exported(of.render(view), (*notes, *not_carried))


def rendered(
    pf: "ParameterFile",
    kind: str,
    *,
    system: str | None = None,
    job: ExportJob | None = None,
    accept_verdict: bool = False,
) -> str | bytes:
    """Content of an export; arguments and errors are those of `export`."""
    return exported(pf, kind, system=system, job=job or ExportJob(accept_verdict)).content


def export(
    pf: "ParameterFile",
    kind: str,
    path: str | os.PathLike[str],
    *,
    system: str | None = None,
    job: ExportJob | None = None,
    force: bool = False,
    accept_verdict: bool = False,
) -> Path:
    """Write a file that a controller loads; an incomplete file is never left behind.

    Parameters
    ----------
    pf : ParameterFile
        Gains that fail the check are not exported; nor are laws, dynamics or a force process that must not be used for
        control, or that have no verdict.
    kind : str
        A running control, ``hal``, ``st``, ``c``, ``comp`` or ``fmu``; a plan, ``nc`` or ``csv``; or values: ``ngc``,
        ``mat``, ``ssv``, ``h`` or ``ini``.
    path : path-like
        In a folder that exists.
    system : str, optional
        What is controlled, a name of ``SYSTEMS``; by default see `system_of`.
    job : ExportJob, optional
        Choices of the system; ``accept_verdict`` counts without one.
    force : bool
        Replace an existing file. It does not bypass the check.
    accept_verdict : bool
        Export such laws, dynamics and force processes all the same; the exported file names them with the reasons.

    Returns
    -------
    Path
        The file written.

    Raises
    ------
    UsageError
        There is no such kind or system.
    GateError
        The file fails the check, lacks what the export needs, or a part of it must not be used for control.
    ParameterError
        The file exists, or the folder cannot be written.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> from fitmodels import controllers, parameters
    >>> pf = parameters.collect(tool="GC435", work="709M40", laws=[])
    >>> with TemporaryDirectory() as folder:
    ...     print(controllers.export(pf, "ini", f"{folder}/params.ini").name)
    params.ini
    """
    content = rendered(pf, kind, system=system, job=job, accept_verdict=accept_verdict)
    return write_export(content, path, force=force)
