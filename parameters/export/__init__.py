"""What a controller loads: one small module a kind, each on the same typed view of the parameter file.

    view        the file as a controller needs it: gains in its units, limits, settings, names made safe
    loop        the PI loop in the units of the machine
    settings    from the file's sections to the loop, and what is assumed where they leave it open
    quantities  every number under a safe name
    si          units as powers of SI base units
    names       names and texts that cannot inject into anything
    gate        refuses a file that fails the check
    hal         LinuxCNC HAL: the loop from a load pin to motion.adaptive-feed
    ngc         G-code parameters and M52
    mat         MATLAB v5 struct
    st          IEC 61131-3 structured text
    ssv         FMI system structure parameter values
    c_header    C header
    ini         key and value

A kind is a module with ``render(view) -> str | bytes`` and ``CANNOT``, what it cannot carry.
"""

import os
from difflib import get_close_matches
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Final, Protocol, cast

from ...core.errors import ParameterError, UsageError
from ...core.files import write_whole

if TYPE_CHECKING:
    from ..file import ParameterFile
    from .view import View

KINDS: Final = {
    "hal": ("hal", ".hal", "LinuxCNC HAL file: load pin to motion.adaptive-feed"),
    "ngc": ("ngc", ".ngc", "G-code parameters and M52"),
    "mat": ("mat", ".mat", "MATLAB v5 struct"),
    "st": ("st", ".st", "IEC 61131-3 structured text function block"),
    "ssv": ("ssv", ".ssv", "FMI system structure parameter values"),
    "c": ("c_header", ".h", "C header"),
    "ini": ("ini", ".ini", "key and value"),
}
"""Kind -> its module, the suffix of its files, what it is."""


class Exporter(Protocol):
    """What a module of this room offers."""

    CANNOT: tuple[str, ...]

    def render(self, view: "View") -> str | bytes:
        """Give the content of the file."""


def exporter(kind: str) -> Exporter:
    """Load the module of a kind.

    Raises
    ------
    UsageError
        There is no such kind.

    Examples
    --------
    >>> exporter("hal").CANNOT[0][:9]
    'the laws '
    """
    if kind not in KINDS:
        near = get_close_matches(kind.lower(), KINDS, 1, 0.5)
        meant = f" (did you mean {near[0]}?)" if near else ""
        raise UsageError(f"there is no export {kind!r}{meant}; there are {', '.join(KINDS)}.")
    return cast("Exporter", import_module(f".{KINDS[kind][0]}", __name__))


def export(pf: "ParameterFile", kind: str, path: str | os.PathLike[str], *, force: bool = False) -> Path:
    """Write what a controller loads, whole or not at all.

    Parameters
    ----------
    pf : ParameterFile
        What is exported; gains that fail the check are not.
    kind : str
        ``hal``, ``ngc``, ``mat``, ``st``, ``ssv``, ``c`` or ``ini``.
    path : path-like
        In a folder that exists.
    force : bool
        Replace a file that is there. It does not pass the check.

    Returns
    -------
    Path
        Where it was written.

    Raises
    ------
    UsageError
        There is no such kind.
    GateError
        The file fails the check, or lacks what the export needs.
    ParameterError
        A file is there, or the folder cannot be written.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> from fitmodels import parameters
    >>> pf = parameters.collect(tool="GC435", work="709M40", laws=[])
    >>> with TemporaryDirectory() as folder:
    ...     print(export(pf, "ngc", f"{folder}/params.ngc").read_text().splitlines()[1])
    (fm - fitmodels 0.1.0, tool GC435, work 709M40)
    """
    from .view import view

    module = exporter(kind)
    content = module.render(view(pf))
    path = Path(path)
    if not force and os.path.lexists(path):
        raise ParameterError(f"{path}: there is a file already; choose another path, or replace it with --force.")
    write_whole(path, content, error=ParameterError)
    return path
