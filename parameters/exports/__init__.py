"""Exports of a parameter file in the formats that controllers load, all written from one typed view of it.

view          the file as a controller needs it; a file that fails the check is refused
loop          the PI loop on load in the units of the machine, and its settings from the sections of the file
quantities    every number under a safe name; names: identifiers and text that cannot inject into a format
hal           LinuxCNC HAL: the loop from a load pin to motion.adaptive-feed
st            IEC 61131-3 structured text
mat           MATLAB v5 struct
ssv           FMI system structure parameter values, units as powers of SI base units
text_formats  C header, ini file, G-code parameters
"""

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from ...core.errors import ParameterError, UsageError
from ...core.files import write_whole
from ...core.suggestions import did_you_mean
from .hal import NOT_IN_HAL, hal_file
from .mat import NOT_IN_MAT, mat_file
from .ssv import NOT_IN_SSV, ssv_file
from .st import NOT_IN_ST, structured_text
from .text_formats import NOT_IN_C, NOT_IN_GCODE, NOT_IN_INI, c_header, gcode, ini_file
from .view import ExportView, export_view

if TYPE_CHECKING:
    from ..file import ParameterFile


@dataclass(frozen=True, slots=True)
class ExportFormat:
    """A format: suffix of its files, description, function that writes it, what it cannot carry.

    ``loop_only`` marks a format that carries the loop and none of the other numbers of the file.
    """

    suffix: str
    words: str
    render: Callable[[ExportView], str | bytes]
    not_carried: tuple[str, ...]
    loop_only: bool = False


FORMATS: Final = {
    "hal": ExportFormat(
        ".hal", "LinuxCNC HAL file: load pin to motion.adaptive-feed", hal_file, NOT_IN_HAL, loop_only=True
    ),
    "ngc": ExportFormat(".ngc", "G-code parameters and M52", gcode, NOT_IN_GCODE),
    "mat": ExportFormat(".mat", "MATLAB v5 struct", mat_file, NOT_IN_MAT),
    "st": ExportFormat(".st", "IEC 61131-3 structured text function block", structured_text, NOT_IN_ST, loop_only=True),
    "ssv": ExportFormat(".ssv", "FMI system structure parameter values", ssv_file, NOT_IN_SSV),
    "c": ExportFormat(".h", "C header", c_header, NOT_IN_C),
    "ini": ExportFormat(".ini", "key and value", ini_file, NOT_IN_INI),
}


def export_format(kind: str) -> ExportFormat:
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
        ``hal``, ``ngc``, ``mat``, ``st``, ``ssv``, ``c`` or ``ini``.
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
    >>> from fitmodels import parameters
    >>> pf = parameters.collect(tool="GC435", work="709M40", laws=[])
    >>> with TemporaryDirectory() as folder:
    ...     print(export(pf, "ngc", f"{folder}/params.ngc").read_text().splitlines()[1])
    (fm - fitmodels 0.1.0, tool GC435, work 709M40)
    """
    of = export_format(kind)
    content = of.render(export_view(pf, accept_verdict=accept_verdict, loop_only=of.loop_only))
    path = Path(path)
    if not force and os.path.lexists(path):
        raise ParameterError(f"{path}: the file exists; choose another path, or replace it with --force.")
    write_whole(path, content, error=ParameterError)
    return path
