"""Files of data acquisition programs -> tables: LabVIEW .lvm, NI .tdms, MATLAB .mat; anything else is a table already.

The packages that read them are extras, imported only when such a file is met. A file is known by its first bytes.
"""

import hashlib
import io
import os
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Array
from ...core.display import Displayable
from ...core.errors import DataError, UsageError
from ..tables import Column, Table, read_table
from ..tables.decode import encoding_of, load_bytes
from ..tables.dialect import Dialect
from ..units import is_unit
from ..vocabulary import ROLES
from .columns import heads, is_label, rises_evenly, seconds_in, signals, time_column, times

Series = tuple[str, str, Array]  # name, unit, values
_STEP_NAMES = {"ts": 1, "dt": 1, "sampletime": 1, "sample_time": 1, "fs": -1, "rate": -1, "samplerate": -1}
HDF5 = b"\x89HDF\r\n\x1a\n"
LARGEST_UNPACKED = 1_000_000_000  # bytes of the variables of a MATLAB file
WIDEST = 50  # columns of a matrix that are signals; a wider one is something else


def record_tables(
    path: str | os.PathLike[str],
    *,
    decimal: Literal["point", "comma"] | None = None,
    delimiter: str | None = None,
    sheet: str | None = None,
) -> list[Table]:
    """Tables of a file, one a run: a text file or workbook holds one, a .lvm or .tdms file one a segment or group.

    Raises
    ------
    UsageError
        The package that reads the format is not installed, or an option does not go with the format.
    DataError
        The file cannot be read.
    """
    path = Path(path)
    data = load_bytes(path)
    reader = _READERS.get(kind_of(data, path.name))
    if reader is None:
        return [read_table(path, is_unit=is_unit, decimal=decimal, delimiter=delimiter, sheet=sheet)]
    for option, value in (("decimal", decimal), ("delimiter", delimiter)):
        if value is not None:
            raise UsageError(f"the format of {path.name} is fixed: leave out --{option}.")
    if sheet is not None and reader is not _tdms:
        raise UsageError(f"{path.name} has no sheets: leave out --sheet {sheet}.")
    tables = [_table(path, data, *found) for found in reader(path, data, sheet)]
    if not tables:
        raise DataError(f"{path.name} holds no columns of numbers. Export the run again.")
    return tables


def kind_of(data: bytes, name: str) -> str:
    """``lvm``, ``tdms``, ``mat`` or, for whatever the table reader takes, ``table``.

    >>> kind_of(b"LabVIEW Measurement", "run.txt"), kind_of(b"t,u,y", "run.lvm")
    ('lvm', 'table')
    """
    if data.removeprefix(b"\xef\xbb\xbf").startswith(b"LabVIEW Measurement"):
        return "lvm"
    if data.startswith(b"TDSm"):
        return "tdms"
    return "mat" if data.startswith(b"MATLAB") or name.lower().endswith(".mat") else "table"


def _extra(package: str, extra: str, name: str) -> ModuleType:
    try:
        return import_module(package)
    except ImportError as error:
        raise UsageError(
            f"{name} needs the package {package}, which is not installed: pip install 'fitmodels[{extra}]', or export "
            "the run as .csv."
        ) from error


def _table(path: Path, data: bytes, kind: str, series: Iterable[Series], notes: Iterable[str]) -> Table:
    columns = tuple(
        Column(number, name, unit, values, True) for number, (name, unit, values) in enumerate(series, start=1)
    )
    rows = np.arange(1, len(columns[0].values) + 1, dtype=np.int64)
    dialect = Dialect(kind, "", "point", "", True)
    return Table(path, hashlib.sha256(data).hexdigest(), columns, rows, (), tuple(notes), dialect)


Found = Iterable[tuple[str, list[Series], list[str]]]


def _lvm(path: Path, data: bytes, sheet: str | None) -> Found:
    """Segments of a LabVIEW measurement file.

    Only ``read_str`` of lvm_read is called: its ``read`` loads and leaves a pickle next to the file, and opening a
    pickle that came with a measurement runs whatever is in it.
    """
    reader = _extra("lvm_read", "lvm", path.name)
    try:
        parsed = reader.read_str(data.decode(encoding_of(data, path.name)))
        segments = [parsed[k] for k in range(parsed["Segments"])]
        for segment in segments:
            yield "lvm", list(_lvm_series(segment, parsed.get("X_Columns", "One"))), []
    except (ValueError, KeyError, IndexError, SyntaxError, TypeError) as error:
        raise DataError(f"{path.name} is a damaged LabVIEW file ({error}). Export it again, or as .csv.") from error


def _lvm_series(segment: Mapping[str, Any], x_columns: str) -> Iterable[Series]:
    values, names = np.atleast_2d(segment["data"]), [str(name).strip() for name in segment["Channel names"]]
    units = [str(unit).strip() for unit in segment.get("Y_Unit_Label", [])]
    channels = iter(range(len(names)))
    if x_columns == "No":
        step, start = float(segment["Delta_X"][0]), float(segment["X0"][0])
        yield "X_Value", "s", (start + step * np.arange(len(values))).astype(np.float64)
    found = 0
    for place, name in enumerate(names[: values.shape[1]]):
        if name == "Comment":
            continue
        if name == "X_Value":
            if not found:
                yield name, "s", values[:, place]
            found += 1
            continue
        channel = next(channels)
        yield name, _plain_unit(units[channel] if channel < len(units) else ""), values[:, place]


def _plain_unit(unit: str) -> str:
    """A unit label of LabVIEW, which writes words: Volts, Amps."""
    return unit if is_unit(unit) else unit.removesuffix("s") if is_unit(unit.removesuffix("s")) else unit


def _tdms(path: Path, data: bytes, sheet: str | None) -> Found:
    """Groups of an NI file that hold channels: each a run, or the one that ``sheet`` names."""
    reader = _extra("nptdms", "tdms", path.name)
    console, said = import_module("nptdms.log").log_manager.console_handler, io.StringIO()
    former, console.stream = console.stream, said  # it logs what does not agree, and reads on
    try:
        known = reader.TdmsFile.read_metadata(io.BytesIO(data))
        if sum(len(channel) for group in known.groups() for channel in group.channels()) > len(data):
            raise ValueError("it states more values than it has bytes")
        groups = {g.name: list(g.channels()) for g in reader.TdmsFile.read(io.BytesIO(data)).groups()}
        notes = sorted({line.partition("] ")[2] for line in said.getvalue().splitlines()})
        if broken := [words for words in notes if not words.startswith("Last segment metadata")]:
            raise ValueError(broken[0])
    except Exception as error:  # a damaged file raises whatever its reader raises
        raise DataError(f"{path.name} is a damaged TDMS file ({error}). Export it again.") from error
    finally:
        console.stream = former
    filled = {name: [c for c in channels if len(c) > 1 and c.dtype.kind in "fiu"] for name, channels in groups.items()}
    filled = {name: channels for name, channels in filled.items() if channels}
    if sheet is not None and sheet not in filled:
        raise UsageError(f"--sheet {sheet}: the groups of {path.name} are {', '.join(map(repr, filled))}.")
    if sheet is not None:
        filled = {sheet: filled[sheet]}
    if len({tuple(c.name for c in channels) for channels in filled.values()}) > 1:
        raise UsageError(
            f"{path.name} has groups of different channels: give --sheet, one of {', '.join(map(repr, filled))}."
        )
    for name, channels in filled.items():
        yield "tdms", list(_tdms_series(channels, f"{path.name}, group {name!r}")), notes


def _tdms_series(channels: list[Any], name: str) -> Iterable[Series]:
    if len({len(c) for c in channels}) > 1:
        lengths = ", ".join(f"{c.name} {len(c)}" for c in channels)
        raise DataError(f"{name}: channels are of different lengths ({lengths}): export those of one rate.")
    steps = {float(c.properties["wf_increment"]) for c in channels if c.properties.get("wf_increment")}
    if len(steps) > 1:
        raise DataError(f"{name}: channels have sample times {sorted(steps)} s: export those of one rate.")
    if steps:
        start = float(channels[0].properties.get("wf_start_offset", 0.0))
        yield "time", "s", (start + steps.pop() * np.arange(len(channels[0]))).astype(np.float64)
    for c in channels:
        unit = str(c.properties.get("unit_string") or c.properties.get("NI_UnitDescription") or "")
        yield c.name, _plain_unit(unit), np.asarray(c[:], dtype=np.float64)


def _hdf5(path: Path, data: bytes) -> dict[str, NDArray[Any]]:
    """Arrays of a MATLAB 7.3 file, which stores them transposed; texts and structures are left out."""
    try:
        reader = import_module("h5py")
    except ImportError as error:
        raise DataError(
            f"{path.name} is a MATLAB 7.3 file, which needs the package h5py: pip install 'fitmodels[mat]', or save it "
            "in MATLAB with the option -v7."
        ) from error
    try:
        with reader.File(io.BytesIO(data), "r") as file:
            own = [name for name in file if isinstance(file.get(name, getlink=True), reader.HardLink)]
            sets = {name: item for name, item in ((name, file[name]) for name in own) if _is_inside(item, reader)}
            if sum(item.size * item.dtype.itemsize for item in sets.values()) > LARGEST_UNPACKED:
                raise ValueError(f"it unpacks to more than {LARGEST_UNPACKED} bytes")
            return {
                name: np.atleast_2d(np.asarray(item[()])).T
                for name, item in sets.items()
                if item.dtype.kind in "fiub"
                and item.ndim <= 2
                and "MATLAB_empty" not in item.attrs
                and item.attrs.get("MATLAB_class") != b"char"
            }
    except (OSError, ValueError, KeyError) as error:
        raise DataError(f"{path.name} is a damaged MATLAB 7.3 file ({error}). Save it again with -v7.") from error


def _is_inside(item: Any, reader: ModuleType) -> bool:  # noqa: ANN401
    """Whether an item of an HDF5 file is a data set whose values are in this file, not in another one."""
    return isinstance(item, reader.Dataset) and not item.external and not item.is_virtual


def _check_unpacked(data: bytes) -> None:
    """ValueError where the compressed variables of a MATLAB 5 file unpack to too much."""
    place, total = 128, 0
    order: Literal["big", "little"] = "big" if data[126:128] == b"MI" else "little"
    while place + 8 <= len(data):
        kind, size = (int.from_bytes(data[at : at + 4], order) for at in (place, place + 4))
        place += 8
        if kind == 15:
            unpack, rest = zlib.decompressobj(), data[place : place + size]
            while rest and total <= LARGEST_UNPACKED:
                total += len(unpack.decompress(rest, 1 << 24))
                rest = unpack.unconsumed_tail
        if total > LARGEST_UNPACKED:
            raise ValueError(f"it unpacks to more than {LARGEST_UNPACKED} bytes")
        place += size


def _mat(path: Path, data: bytes, sheet: str | None) -> Found:
    """Vectors and narrow matrices of one length of a MATLAB file, and its sample time where a number names it."""
    if data.startswith(b"MATLAB 7.3") or data[:8] == HDF5:
        held = _hdf5(path, data)
    else:
        from scipy.io import loadmat

        try:
            if data.startswith(b"MATLAB"):
                _check_unpacked(data)
            held = loadmat(io.BytesIO(data))  # type: ignore[arg-type]  # a file object is read too
        except Exception as error:  # as above
            raise DataError(f"{path.name} is a damaged MATLAB file ({error}). Save it again with -v7.") from error
    arrays = {k: np.asarray(v) for k, v in held.items() if not k.startswith("__")}
    numbers = {k: v for k, v in arrays.items() if v.dtype.kind in "fiub" and v.ndim == 2}
    columns = {k: v.T if 1 == v.shape[0] < v.shape[1] else v for k, v in numbers.items() if v.size > 1}
    columns = {k: v for k, v in columns.items() if v.shape[1] <= WIDEST}
    if not columns:
        names = ", ".join(arrays) or "nothing"
        raise DataError(f"{path.name} holds no column of numbers, only {names}: save each signal as a vector.")
    rows = max(len(v) for v in columns.values())
    kept = {k: v for k, v in columns.items() if len(v) == rows}
    series = [
        (k if v.shape[1] == 1 else f"{k}_{j + 1}", "", v[:, j].astype(np.float64))
        for k, v in kept.items()
        for j in range(v.shape[1])
    ]
    notes = []
    step = next(((k, float(v[0, 0])) for k, v in numbers.items() if v.size == 1 and k.lower() in _STEP_NAMES), None)
    if step is not None and not any(name.lower() in ("t", "time") for name, _, _ in series):
        seconds = step[1] ** _STEP_NAMES[step[0].lower()]
        series.insert(0, ("time", "s", (seconds * np.arange(rows)).astype(np.float64)))
        notes.append(f"the sample time {seconds:g} s is taken from {step[0]} = {step[1]:g}")
    left = [k for k in arrays if k not in kept and (step is None or k != step[0])]
    notes += [f"not read, of another kind or length: {', '.join(left)}"] if left else []
    yield "mat", series, notes


_READERS = {"lvm": _lvm, "tdms": _tdms, "mat": _mat}


FEW_ROWS = 50  # rows; a shorter table of even times may as well be a wear test
TESTED = ("edge", "V", "f")  # roles of a cutting test
SLOWEST = 5.0  # Hz; loads of cutting tests are not written that often


@dataclass(frozen=True, slots=True, repr=False)
class FileKind(Displayable):
    """Kind of a file, and the reason; true for a record.

    Attributes
    ----------
    kind : {"record", "table", "either"}
    reason : str
    loads : tuple of str
        Forces, torque, power or current that a record contains instead of input and output.

    Examples
    --------
    >>> bool(FileKind("either", "12 rows at even times")), bool(FileKind("record", "even times"))
    (False, True)
    """

    kind: Literal["record", "table", "either"]
    reason: str
    loads: tuple[str, ...] = ()

    def __bool__(self) -> bool:
        return self.kind == "record"


def looks_like_record(file: str | os.PathLike[str] | Table) -> FileKind:
    r"""Whether a file is a record of samples or a table of cutting tests.

    A record has an evenly spaced column of times and two or more signals, and no column that is an edge, a cutting
    speed V, a feed f or a wear. Even times together with such a column, a few rows, or times in minutes leave it open
    (``either``): the user is asked to run ``fitmodels ident``.

    Parameters
    ----------
    file : path, or a Table that was read with ``is_unit`` of `datasets.units`

    Examples
    --------
    >>> import pathlib, tempfile
    >>> path = pathlib.Path(tempfile.mkdtemp(), "run.csv")
    >>> _ = path.write_text("t [s],u,y\n" + "".join(f"{k / 50},{k % 3},{k % 5}\n" for k in range(60)))
    >>> looks_like_record(path).reason
    't rises evenly, 2 further signals, no column of a cutting test'
    """
    if not isinstance(file, Table):
        path = Path(file)
        kind = kind_of(load_bytes(path), path.name)
        if kind != "table":
            return FileKind("record", f"a file of samples ({kind})", loads_recorded(record_tables(path)[0]))
        file = read_table(path, is_unit=is_unit)
    known = heads(file.columns)
    wear = [h.role for h in known if h.role and ROLES[h.role].kind == "wear"]
    if wear:
        return FileKind("table", f"a column of wear, {wear[0]}")
    try:
        clock = time_column(known)
        values, scale = times(clock) if clock is not None and clock.column.is_numeric else (None, 1.0)
    except UsageError:
        return FileKind("table", "more than one column may be the time")
    except DataError as refusal:
        return FileKind("table", str(refusal))
    if clock is None:
        return FileKind("table", "no column rises evenly as a time does")
    count = len(signals(known, clock))
    if loads := loads_recorded(file):
        step = float(np.median(np.diff(values))) * (scale or 1.0) if values is not None else 1.0
        return FileKind("record", f"{clock.name} rises evenly, {1 / step:.6g} samples a second", loads)
    if count < 2:
        return FileKind("table", f"{'1 signal' if count == 1 else 'no signals'} besides the time {clock.name}")
    if values is not None and not _even(np.asarray(values, dtype=np.float64), any(is_label(h) for h in known)):
        return FileKind("table", f"{clock.name} does not rise evenly")
    tested = [h.name for h in known if h.role in TESTED]
    even = f"{clock.name} rises evenly, {count} further signals"
    if tested:
        return FileKind("either", f"{even}, as in a record, but {tested[0]} is that of a cutting test")
    if file.n_rows < FEW_ROWS or scale == seconds_in("min"):
        return FileKind("either", f"{even}, but {file.n_rows} rows in {clock.unit or 'no unit'} may be a cutting test")
    return FileKind("record", f"{even}, no column of a cutting test")


def loads_recorded(table: Table) -> tuple[str, ...]:
    """Forces, torque, power or current of a record without input and output: two, or nothing else; otherwise none.

    Examples
    --------
    >>> t = 0.001 * np.arange(100)
    >>> columns = (Column(1, "t [s]", "", t, True), Column(2, "Fc [N]", "", np.sin(t), True))
    >>> loads_recorded(Table(Path("a.csv"), "", columns, np.arange(100), (), (), Dialect("", "", "point", "", True)))
    ('Fc',)
    """
    known = heads(table.columns)
    try:
        clock = time_column([h for h in known if not (h.role and ROLES[h.role].kind == "load")])
        values, scale = times(clock) if clock is not None else (np.zeros(0), 1.0)
    except (UsageError, DataError):
        return ()
    steps = np.diff(values)
    if len(steps) < FEW_ROWS or not 0 < float(np.median(steps)) * (scale or 1.0) <= 1 / SLOWEST:
        return ()
    held = signals(known, clock)
    loads = tuple(h.role for h in held if h.role and ROLES[h.role].kind == "load")
    tested = any(h.role in TESTED or (h.role and ROLES[h.role].kind == "wear") for h in known)
    return loads if not tested and (len(loads) >= 2 or 0 < len(loads) == len(held)) else ()


def _even(values: Array, runs: bool) -> bool:
    """Whether times rise evenly, apart from gaps and from further runs (a label, or times that restart)."""
    finite = values[np.isfinite(values)]
    steps = np.diff(finite)
    rising = finite[1:][steps > 0]
    if len(rising) < 3 or np.count_nonzero(steps < 0) > 0.05 * len(steps):
        return False
    middle = float(np.median(steps[steps > 0]))
    return rises_evenly(finite) or bool(np.mean(np.abs(steps - middle) <= 0.1 * middle) >= 0.9 or runs)
