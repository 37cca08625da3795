"""Records of finished blocks, with which an interrupted batch continues without fitting anything twice."""

import json
from base64 import b64decode, b64encode
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, fields
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ..core.bounded import sha256_of, stored_json
from ..core.errors import DataError
from ..core.files import make_folder, write_whole
from ..core.journal import write_files
from ..core.version import __version__
from .law_rows import COUNTS, FLAGS, LAW, PAIR, TEXTS, Column, column
from .outcomes import BlockOutcome, Cell, Concern, PairOutcome
from .plan import BatchOptions, Block, Pair, Plan

SCHEMA = "fitmodels.batch-block/5"
RECORDS = Path(".batch", "blocks")
PAIRS = "pairs"
COLUMNS = ("tool", "work", "nobs", "reason", "simulated")  # of the pairs of a record
WRITERS = 4  # a file waits for the disk longer than for the processor: four together take a sixth of the time


def key_of(block: Block, plan: Plan, options: BatchOptions) -> str:
    """SHA-256 of everything that the numbers of a block depend on; the place of its files is excluded.

    Examples
    --------
    >>> from fitmodels.batch.plan import Piece, Reading
    >>> block = Block((Pair("GC435", "709M40"),), (Piece("/lab/a.csv", "a.csv", "7f31"),), 144)
    >>> plan = Plan("lab", "files", (block,), 144, (), {}, (), Reading())
    >>> key_of(block, plan, BatchOptions()) == key_of(block, plan, BatchOptions(seed=2))
    False
    """
    facts = {field.name: getattr(block, field.name) for field in fields(block)}
    facts["pairs"] = [(pair.tool, pair.work) for pair in block.pairs]
    facts["pieces"] = [asdict(piece) | {"path": ""} for piece in block.pieces]
    columns = [asdict(use) for use in plan.columns]
    content = {"fitmodels": __version__, "kind": plan.kind, "block": facts, "columns": columns}
    content["facts"] = options.facts(plan.reading)
    return sha256(json.dumps(content, sort_keys=True, default=str).encode()).hexdigest()


def as_json(outcome: BlockOutcome) -> str:
    """The outcome as its record contains it, without the bytes of files; made by the process that fitted it."""
    return _text(_plain(outcome))


def record(out: Path, key: str, outcome: BlockOutcome, folders: Mapping[Pair, str], text: str = "") -> None:
    """Write the files of a block's pairs, those of a pair all or none, then its record.

    The record is first written without its outcome: wherever a batch is stopped, the files that it wrote are recorded.

    Parameters
    ----------
    out : Path
        The output folder, which `output_folder.prepare` made.
    key : str
        See `key_of`.
    outcome : BlockOutcome
    folders : mapping of Pair to str
        See `output_folder.folder_names`; pairs without files need none.
    text : str
        The outcome `as_json`, where it is made already.

    Raises
    ------
    UsageError, ParameterError
        A folder cannot be made, a file cannot be written; those that are there are whole.
    """
    contents = {f"{PAIRS}/{folders[Pair(pair.tool, pair.work)]}": pair.files for pair in outcome.pairs if pair.files}
    make_folder(out / RECORDS)
    path = out / RECORDS / f"{key}.json"
    made = {f"{of}/{name}": sha256(data).hexdigest() for of, files in contents.items() for name, data in files.items()}
    head = {"schema": SCHEMA, "files": made}
    if contents:
        write_whole(path, _sealed(head, "null"), parents=True)
        with ThreadPoolExecutor(WRITERS) as pool:
            list(pool.map(lambda name: write_files(out / name, contents[name]), contents))
    write_whole(path, _sealed(head, text or as_json(outcome)), parents=True)


def recorded(out: Path, key: str, folders: Mapping[Pair, str]) -> BlockOutcome | None:
    """The outcome of a block that was finished before, without the bytes of its files.

    None where it has to be fitted: its record is missing, changed or of another schema; a file is missing or is not as
    it was written (their SHA-256 are compared), or belongs in another folder now.
    """
    data = _read(out / RECORDS / f"{key}.json")
    if data is None or data["outcome"] is None:
        return None
    try:
        outcome = _outcome(data["outcome"])
        pairs = outcome.pairs if data["files"] else ()
        places = {f"{PAIRS}/{folders[Pair(pair.tool, pair.work)]}" for pair in pairs}
    except (AttributeError, KeyError, IndexError, OverflowError, TypeError, ValueError):
        return None
    files: dict[str, str] = data["files"]
    stands = all(name.rpartition("/")[0] in places and hash_of(out / name) == made for name, made in files.items())
    return outcome if stands else None


def written(out: Path) -> dict[str, dict[str, str]]:
    """SHA-256 of the files of each record, by key and path in ``out``, whether its block was finished or not."""
    records = {path.stem: _read(path) for path in sorted((out / RECORDS).glob("*.json"))}
    return {key: data["files"] for key, data in records.items() if data is not None}


def hash_of(path: Path) -> str | None:
    """SHA-256 of a file, None where there is none to be read.

    Examples
    --------
    >>> hash_of(Path("nowhere")) is None
    True
    """
    try:
        return sha256_of(path)
    except (OSError, DataError):
        return None


def read_json(path: Path) -> dict[str, Any]:
    """The object in a JSON file; empty where there is none that can be read.

    Examples
    --------
    >>> read_json(Path("nowhere"))
    {}
    """
    data = stored_json(path)
    return data if isinstance(data, dict) else {}


def _text(data: Mapping[str, Any]) -> str:
    return json.dumps(data, separators=(",", ":"), allow_nan=False)


def _sealed(head: Mapping[str, Any], outcome: str) -> bytes:
    """A record with the SHA-256 of its other content as its last key."""
    content = f'{_text(head)[:-1]},"outcome":{outcome}'
    return f'{content},"sha256":"{_seal(content + "}")}"}}\n'.encode()


def _seal(content: str) -> str:
    return sha256(f"{content}\n".encode()).hexdigest()


def _read(path: Path) -> dict[str, Any] | None:
    """A record, None where this version cannot read it, it was changed, or a name leads out of the folder."""
    data = read_json(path)
    seal = data.pop("sha256", None)
    try:
        if data.get("schema") != SCHEMA or "outcome" not in data or seal != _seal(_text(data)):
            return None
    except ValueError:  # a number that is not finite
        return None
    files = data.get("files")
    return data if isinstance(files, dict) and all(map(_inside, files)) else None


def _inside(name: str) -> bool:
    parts = name.split("/")
    return len(parts) == 3 and parts[0] == PAIRS and not any(p in ("", ".", "..") or "\\" in p for p in parts)


def _plain(outcome: BlockOutcome) -> dict[str, Any]:
    """The outcome as JSON takes it, column by column, without the bytes of files."""
    pairs: dict[str, Any] = {name: [getattr(pair, name) for pair in outcome.pairs] for name in COLUMNS}
    pairs["nobs"] = [int(nobs) for nobs in pairs["nobs"]]
    pairs["concerns"] = [[i, one.kind, one.words] for i, pair in enumerate(outcome.pairs) for one in pair.concerns]
    pairs["groups"] = [[i, *item] for i, pair in enumerate(outcome.pairs) for item in pair.groups.items()]
    laws = {str(name): _packed(values) for name, values in outcome.laws.items()}
    rest = {"laws": laws, "unreadable": dict(outcome.unreadable), "units": dict(outcome.units)}
    return {"pairs": pairs, **rest, "seconds": float(outcome.seconds), "memory": int(outcome.memory)}


def _packed(values: "pd.Series[Any]") -> list[Cell] | str:
    """A column of the table of laws: doubles in base 64, as in memory; others cell by cell."""
    if values.dtype == np.float64:
        return b64encode(values.to_numpy(dtype="<f8").tobytes()).decode()
    cells: list[Cell] = values.array.to_numpy(dtype=object, na_value=None).tolist()
    return cells


def _unpacked(name: str, packed: list[Cell] | str) -> Column:
    """A column, or a ValueError or its like: a record may have been damaged, or written by hand."""
    if isinstance(packed, str) != (name not in (PAIR, *TEXTS, *COUNTS, *FLAGS)):
        raise ValueError(name)
    if isinstance(packed, str):
        return np.frombuffer(b64decode(packed, validate=True), dtype="<f8").astype(np.float64)
    return np.array([_whole(value) for value in packed], dtype=np.intp) if name == PAIR else column(name, packed)


def _whole(value: object) -> int:
    if type(value) is int and 0 <= value < 2**63:
        return value
    raise ValueError(value)


def _outcome(data: Mapping[str, Any]) -> BlockOutcome:
    given = data["pairs"]
    columns = [given[name] for name in COLUMNS]
    concerns: list[list[Concern]] = [[] for _ in columns[0]]
    groups: list[dict[str, str]] = [{} for _ in columns[0]]
    for i, kind, words in given["concerns"]:
        concerns[_whole(i)].append(Concern(kind, words))
    for i, header, name in given["groups"]:
        groups[_whole(i)][header] = name
    pairs = tuple(
        PairOutcome(tool, work, _whole(nobs), reason, tuple(concerns[i]), groups[i], simulated)
        for i, (tool, work, nobs, reason, simulated) in enumerate(zip(*columns, strict=True))
    )
    of_laws = {name: _unpacked(name, packed) for name, packed in data["laws"].items()}
    laws = pd.DataFrame(of_laws)
    whole = {len(values) for values in of_laws.values()} == {len(laws)} and set(LAW) <= set(of_laws)
    if not (whole and laws[PAIR].between(0, len(pairs) - 1).all()):
        raise ValueError(PAIR)
    return BlockOutcome(pairs, laws, data["unreadable"], data["units"], data["seconds"], data["memory"])
