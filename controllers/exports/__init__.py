"""Exports of a parameter file: running controls, and the values that `fitmodels.parameters.exports` writes.

hal     LinuxCNC HAL: the loop from a load pin to motion.adaptive-feed
st      IEC 61131-3 structured text: the loop as a function block
c       C for firmware: one step function with the settings of the tool
comp    LinuxCNC component: the same C, compiled by halcompile
fmu     FMI 2.0 co-simulation: the same C as a source FMU

A running control, and the values of a file that has one, are written only after `fitmodels.controllers.gate`.
"""

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from ...core.errors import GateError, UsageError
from ...core.suggestions import did_you_mean
from ...parameters.exports import VALUES, ExportFormat, write_export
from ...parameters.exports.view import export_view
from ..gate import GatedControl, gated_control, require_control
from .c_source import NOT_IN_C, c_file
from .component import NOT_IN_COMPONENT, component_file
from .fmu import NOT_IN_FMU, fmu_file
from .hal import NOT_IN_HAL, hal_file
from .st import NOT_IN_ST, structured_text

if TYPE_CHECKING:
    from ...parameters import ParameterFile


@dataclass(frozen=True, slots=True)
class ControlFormat:
    """A format of a running control: suffix, description, function that writes it, what it cannot carry.

    ``file_name`` is the name that the program which reads it demands; ``incremental_sum`` whether it carries that
    form of the PI.
    """

    suffix: str
    words: str
    render: Callable[[GatedControl], str | bytes]
    not_carried: tuple[str, ...]
    file_name: str = ""
    incremental_sum: bool = True


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
FORMATS: Final[dict[str, ControlFormat | ExportFormat]] = {**CONTROLS, **VALUES}


def export_format(kind: str) -> ControlFormat | ExportFormat:
    """The format of this name.

    Raises
    ------
    UsageError
        The format does not exist.

    Examples
    --------
    >>> export_format("hal").suffix
    '.hal'
    """
    if kind not in FORMATS:
        raise UsageError(f"there is no export {kind!r}. {did_you_mean(kind, FORMATS, names='There are ')}")
    return FORMATS[kind]


def rendered(pf: "ParameterFile", kind: str, *, accept_verdict: bool = False) -> str | bytes:
    """Content of an export; arguments and errors are those of `export`."""
    of = export_format(kind)
    if isinstance(of, ControlFormat):
        control = gated_control(pf, accept_verdict=accept_verdict)
        if control.loop.form == "incremental_sum" and not of.incremental_sum:
            raise GateError(
                f"the gains of {control.view.tool} on {control.view.work} have the form incremental_sum, which "
                f"{kind} does not carry; use the component (kind comp) or the C controller (kind c), or tune in the "
                "form position."
            )
        return of.render(control)
    view = export_view(pf, accept_verdict=accept_verdict)
    require_control(pf, accept_verdict=accept_verdict)
    return of.render(view)


def export(
    pf: "ParameterFile",
    kind: str,
    path: str | os.PathLike[str],
    *,
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
        A running control, ``hal``, ``st``, ``c``, ``comp`` or ``fmu``, or values: ``ngc``, ``mat``, ``ssv``, ``h`` or
        ``ini``.
    path : path-like
        In a folder that exists.
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
        There is no such kind.
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
    return write_export(rendered(pf, kind, accept_verdict=accept_verdict), path, force=force)
