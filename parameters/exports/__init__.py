"""Values of a parameter file in the formats that programs load, all written from one typed view of it.

view          the file as a controller needs it; a file that fails the check is refused
loop          the PI loop on load in the units of the machine, and its settings from the sections of the file
quantities    every number under a safe name; names: identifiers and text that cannot inject into a format
mat           MATLAB v5 struct
ssv           FMI system structure parameter values, units as powers of SI base units
text_formats  C header, ini file, G-code parameters

Running controls are written by `fitmodels.controllers.exports`.
"""

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from ...core.errors import GateError, ParameterError, UsageError
from ...core.files import write_whole
from ...core.suggestions import did_you_mean
from .mat import NOT_IN_MAT, mat_file
from .ssv import NOT_IN_SSV, ssv_file
from .text_formats import NOT_IN_C, NOT_IN_GCODE, NOT_IN_INI, c_header, gcode, ini_file
from .view import ExportView, export_view

if TYPE_CHECKING:
    from ..file import ParameterFile


@dataclass(frozen=True, slots=True)
class ExportFormat:
    """A format of values: suffix of its files, description, function that writes it, what it cannot carry."""

    suffix: str
    words: str
    render: Callable[[ExportView], str | bytes]
    not_carried: tuple[str, ...]


VALUES: Final = {
    "ngc": ExportFormat(".ngc", "G-code parameters and M52", gcode, NOT_IN_GCODE),
    "mat": ExportFormat(".mat", "MATLAB v5 struct", mat_file, NOT_IN_MAT),
    "ssv": ExportFormat(".ssv", "FMI system structure parameter values", ssv_file, NOT_IN_SSV),
    "h": ExportFormat(".h", "C header of values", c_header, NOT_IN_C),
    "ini": ExportFormat(".ini", "key and value", ini_file, NOT_IN_INI),
}
CONTROLS: Final = ("hal", "st", "c", "comp", "fmu")  # written by `fitmodels.controllers.export`
PLANS: Final = ("nc", "csv")  # so are these


def export_format(kind: str) -> ExportFormat:
    """The format of values of this name.

    Raises
    ------
    UsageError
        The format does not exist, or is one of a running control.

    Examples
    --------
    >>> export_format("mat").suffix
    '.mat'
    """
    if kind in CONTROLS:
        raise UsageError(
            f"{kind} is a running control, not values: write it with `fitmodels export --to {kind}` or "
            "fitmodels.controllers.export, which simulate it first."
        )
    if kind in PLANS:
        raise UsageError(
            f"{kind} is a plan of speed and feed, not values: write it with `fitmodels export --to {kind}` or "
            "fitmodels.controllers.export."
        )
    if kind not in VALUES:
        raise UsageError(f"there is no export {kind!r}. {did_you_mean(kind, VALUES, names='There are ')}")
    return VALUES[kind]


def export(
    pf: "ParameterFile",
    kind: str,
    path: str | os.PathLike[str],
    *,
    force: bool = False,
    accept_verdict: bool = False,
) -> Path:
    """Write the values of a parameter file; an incomplete file is never left behind.

    A file with gains and settings of a control is written by `fitmodels.controllers.export`, which simulates it first.

    Parameters
    ----------
    pf : ParameterFile
        Gains that fail the check are not exported; nor are laws, dynamics or a force process that must not be used for
        control, or that have no verdict.
    kind : str
        ``ngc``, ``mat``, ``ssv``, ``h`` or ``ini``.
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
        There is no such kind, or it is that of a running control.
    GateError
        The file fails the check, has a loop, or a part of it must not be used for control.
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
    of, view = export_format(kind), export_view(pf, accept_verdict=accept_verdict)
    if pf.pi is not None and pf.load_line is not None:
        raise GateError(
            f"not exported: the file of {view.tool} on {view.work} holds a control loop, which is simulated before its "
            "values are written; use `fitmodels export` or fitmodels.controllers.export."
        )
    return write_export(of.render(view), path, force=force)


def write_export(content: str | bytes, path: str | os.PathLike[str], *, force: bool) -> Path:
    """The path of an exported file, written whole; an existing file is replaced only by ``force``."""
    path = Path(path)
    if not force and os.path.lexists(path):
        raise ParameterError(f"{path}: the file exists; choose another path, or replace it with --force.")
    write_whole(path, content, error=ParameterError, force=force)
    return path
