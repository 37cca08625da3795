"""An excitation as a file that a controller or a data acquisition program plays back; written whole or not at all.

csv       time and input with units in the header, the rate in a comment; with the measured output as a third column
          it is a record that ``datasets.read_record`` reads
octave    a script (.m) or a MATLAB 5 file (.mat) that sets ``rate``, ``t`` and ``u``
labview   LabVIEW measurement file, text, version 2 (NI, Specification for the LabVIEW Measurement File)
linuxcnc  for halstreamer(1) with ``loadrt streamer cfg=f``: one float a line, comments begin with #
"""

import io
import os
import re
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from ...core.arrays import Array, is_positive
from ...core.errors import IdentError, UsageError
from ...core.files import write_whole

Form = Literal["csv", "octave", "labview", "linuxcnc"]


def write_excitation(
    u: ArrayLike, rate: float, path: str | os.PathLike[str], for_: Form = "csv", unit: str = "V", *, force: bool = False
) -> Path:
    """Write an excitation for a program that plays it back.

    Parameters
    ----------
    u : array_like, shape (N,)
        In ``unit``; written at full precision.
    rate : float
        Hz.
    path : path-like
        In a folder that exists.
    for_ : {"csv", "octave", "labview", "linuxcnc"}
    unit : str
    force : bool
        Replace an existing file.

    Returns
    -------
    Path

    Raises
    ------
    IdentError
        Values that are not finite, a rate of zero or less.
    UsageError
        An existing file, a folder that cannot be written, or an unsuitable name.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     print(write_excitation([0.0, 2.5], 50.0, f"{folder}/u.csv").read_text(), end="")
    # sample rate: 50 Hz
    t [s],u [V]
    0.0,0.0
    0.02,2.5
    """
    values, path = np.asarray(u, dtype=np.float64), Path(path)
    if values.ndim != 1 or not values.size or not np.isfinite(values).all():
        raise IdentError(f"an excitation of shape {values.shape}: one column of finite numbers, one or more.")
    if not is_positive(rate):
        raise IdentError(f"rate {rate!r} Hz of an excitation: it lies above zero, for instance 50.")
    if for_ not in FORMS:
        raise UsageError(f"--for {for_}: one of {', '.join(FORMS)}.")
    if re.search(r"[\s,;\[\]#]", unit):
        raise UsageError(f"unit {unit!r}: no spaces, commas or brackets.")
    if not force and os.path.lexists(path):
        raise UsageError(f"{path} exists already; replace it with --force, or choose another name.")
    write_whole(path, FORMS[for_](values, float(rate), unit, path), force=force)
    return path


def _csv(u: Array, rate: float, unit: str, path: Path) -> bytes:
    lines = (f"{k / rate!r},{value!r}" for k, value in enumerate(u.tolist()))
    return "\n".join(
        [f"# sample rate: {rate:.17g} Hz", f"t [s],u [{unit}]" if unit else "t [s],u", *lines, ""]
    ).encode()


def _octave(u: Array, rate: float, unit: str, path: Path) -> bytes:
    if path.suffix == ".mat":
        from scipy.io import savemat

        file: Any = io.BytesIO()
        time = np.arange(len(u)) / rate
        savemat(file, {"rate": rate, "t": time, "u": u, "unit": unit}, oned_as="column")
        return bytes(file.getvalue())
    if path.suffix != ".m" or not re.fullmatch(r"[A-Za-z]\w*", path.stem, re.ASCII):
        raise UsageError(f"{path.name}: Octave runs scripts named by letters, digits and _ with .m, or loads a .mat.")
    head = [f"% excitation in {unit or 'no unit'}", f"rate = {rate!r};  % Hz", "u = ["]
    return "\n".join([*head, *map(repr, u.tolist()), "];", "t = (0:numel(u) - 1)' / rate;  % s", ""]).encode()


def _labview(u: Array, rate: float, unit: str, path: Path) -> bytes:
    head = [
        "LabVIEW Measurement", "Writer_Version\t2", "Reader_Version\t2", "Separator\tTab", "Decimal_Separator\t.",
        "Multi_Headings\tNo", "X_Columns\tOne", "Time_Pref\tRelative", "Operator\tfitmodels",
        "Date\t2000/01/01", "Time\t00:00:00", "***End_of_Header***", "",
        "Channels\t1", f"Samples\t{len(u)}", "Date\t2000/01/01", "Time\t00:00:00",
        f"Y_Unit_Label\t{unit}", "X_Dimension\tTime", "X0\t0.0", f"Delta_X\t{1 / rate!r}", "***End_of_Header***",
        "X_Value\tu\tComment",
    ]  # fmt: skip
    lines = (f"{k / rate!r}\t{value!r}" for k, value in enumerate(u.tolist()))
    return "\r\n".join([*head, *lines, ""]).encode()


def _linuxcnc(u: Array, rate: float, unit: str, path: Path) -> bytes:
    head = [f"# sample rate: {rate:.17g} Hz", f"# unit: {unit}", "# loadrt streamer depth=4000 cfg=f"]
    return "\n".join([*head, *map(repr, u.tolist()), ""]).encode()


FORMS = {"csv": _csv, "octave": _octave, "labview": _labview, "linuxcnc": _linuxcnc}
