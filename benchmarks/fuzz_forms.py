"""Changed files of every kind but tables and records, through every command that reads them; see ``fuzz.py``.

Kinds: parameter files as received (``params``) and with a checksum that agrees (``sealed``), draws, priors, card.toml,
tables of pairs, the state of a batch, a published site, figures of reduced records, words of the command line.
A file is changed in its bytes (bits, a cut, spans removed or repeated, encodings), its tokens (integers of 5000 digits,
1e400, NaN, nesting 100 000 deep, keys twice, surrogates), or its structure (parts dropped, renamed, exchanged).

A file is clean where each command ends with exit code 0, 2, 3, 4 or 5; a refusal is one message and names the changed
file where this cannot be read; a changed content with a checksum is refused or named; a file that is refused stays as
it was; and processor time and memory are bounded.
"""

import contextlib
import hashlib
import io
import json
import os
import re
import resource
import shutil
import signal
import sys
import tempfile
import traceback
import warnings
import zipfile
from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import dataclass
from functools import cache, partial
from itertools import product
from pathlib import Path
from unittest import mock

import numpy as np
from fitmodels import cli, parameters
from fitmodels.core.errors import FitmodelsError
from fitmodels.parameters.file import as_bytes, seal_fault, sealed
from fitmodels.parameters.file_format import content_sha256
from fitmodels.parameters.published import published

DONE = (0, 2, 3, 4, 5)  # exit codes that the command documents
SECONDS = 5.0  # of processor time beyond three times that of the good file
LONGEST = 3000  # characters of a message
FAILED = re.compile(r"the computation failed \([^\"\n)]*\)?")
CHANGED = re.compile(r"changed after it was written|has no content_sha256|SHA-256")

# --- changes of bytes, tokens and structure

DEEP = 100_000
ODD_NUMBERS = """
1e400 -1e400 1e-400 NaN Infinity -Infinity nan inf 0 -0.0 1e308 5e-324 0x10 1_000 1,5 1.5.2 --1 true null
9007199254740993 2020-13-45 -1 1e-300 1e15 0.1e "1.5"
"""
NUMBERS = ("9" * 5000, "-" + "9" * 5000, *ODD_NUMBERS.split())
TEXTS = (
    *('""', '"\\ud800"', '"\\u0000"', '"\\u202e\\u001b[31m"', f'"{"x" * 100_000}"', '"µ é 工具"', '"../../x"', '"  "'),
    *('"<script>alert(1)</script>"', '"=1+1"', '"javascript:alert(1)"', '"/dev/zero"', '"nan"', '"1e400"'),
    *("'", '"', '"""', "\\", "#"),
)
NESTED = (
    *("[" * DEEP, "[" * DEEP + "]" * DEEP, '{"a":' * DEEP, '{"a":' * DEEP + "1" + "}" * DEEP, "{a=" * DEEP),
    *("[" * 60 + "]" * 60, "[" + "0," * 200_000 + "0]", "{}", "[]", "[[]]", '{"a": 1, "a": 2}', "a." * 20_000 + "a"),
)
TOKEN = re.compile(r'"(?:[^"\\\n]|\\.)*"|-?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?|[A-Za-z_][\w-]*')


def any_of(rng, choices):
    choices = list(choices)
    return choices[int(rng.integers(len(choices)))]


def span(content, rng):
    start = int(rng.integers(len(content) + 1))
    return start, min(len(content), start + int(rng.integers(1, 200)))


def of_bytes(content, rng):
    """Content with some of its bytes changed, and what was done."""
    kind = any_of(rng, ("bits", "cut", "removed", "repeated", "inserted", "exchanged", "encoding", "empty", "lines"))
    a, b = span(content, rng)
    made = {
        "bits": lambda: _flipped(content, rng),
        "cut": lambda: content[: int(rng.integers(len(content) + 1))],
        "removed": lambda: content[:a] + content[b:],
        "repeated": lambda: content[:b] + content[a:],
        "inserted": lambda: content[:a] + rng.bytes(int(rng.integers(1, 20))) + content[a:],
        "exchanged": lambda: content[:a] + content[b : b + b - a] + content[a:b] + content[b + b - a :],
        "encoding": lambda: _encoded(content, any_of(rng, ("utf-16", "utf-8-sig", "utf-32", "latin-1", "utf-7"))),
        "empty": lambda: any_of(rng, (b"", b"\0" * 100, b" \n" * 1000, b"\xff\xfe", b"null", b"[]", b"{}", b"0")),
        "lines": lambda: _lines(content, rng),
    }[kind]()
    return made, kind


def _flipped(content, rng):
    held = bytearray(content)
    for _ in range(int(rng.integers(1, 4))):
        if held:
            held[int(rng.integers(len(held)))] ^= 1 << int(rng.integers(8))
    return bytes(held)


def _encoded(content, encoding):
    return content.decode("utf-8", "replace").encode(encoding, "replace")


def _lines(content, rng):
    lines = content.split(b"\n")
    a, b = (int(rng.integers(len(lines))) for _ in range(2))
    change = int(rng.integers(3))
    if change == 0:
        lines[a], lines[b] = lines[b], lines[a]
    elif change == 1:
        lines.insert(a, lines[b])
    else:
        del lines[a]
    return b"\n".join(lines)


def of_token(content, rng):
    """Content with one token (a number, a text, a name) replaced."""
    text = content.decode("utf-8", "replace")
    found = list(TOKEN.finditer(text))
    if not found:
        return content, "no token"
    place = any_of(rng, found)
    new = any_of(rng, any_of(rng, (NUMBERS, NUMBERS, TEXTS, NESTED, (any_of(rng, found)[0],))))
    return f"{text[: place.start()]}{new}{text[place.end() :]}".encode("utf-8", "surrogatepass"), (
        f"{place[0][:30]} -> {new[:30]}"
    )


def descent(data, rng):
    """Path to a part of lists and objects, each step to any part with the same probability."""
    path = []
    while isinstance(data, dict | list) and data and (not path or rng.random() < 0.85):
        path.append(any_of(rng, data if isinstance(data, dict) else range(len(data))))
        data = data[path[-1]]
    return tuple(path)


def holder(data, path):
    for key in path[:-1]:
        data = data[key]
    return data


def of_structure(data, rng):
    """Data with a part dropped, renamed, exchanged, or of another value; what was done."""
    data = deepcopy(data)
    path = descent(data, rng)
    if not path:
        return data, "nothing"
    inside, key = holder(data, path), path[-1]
    kind = any_of(
        rng, ("drop", "value", "value", "value", "number", "number", "number", "rename", "exchange", "repeat")
    )
    other = descent(data, rng)
    value = deepcopy(holder(data, other)[other[-1]])
    if kind == "drop":
        del inside[key]
    elif kind == "rename" and isinstance(inside, dict):
        inside[any_of(rng, ("x", "", "V", "AW", "T", "__class__", "a b", "µ"))] = inside.pop(key)
    elif kind == "exchange":
        inside[key] = value
    elif kind == "repeat" and isinstance(inside[key], list):
        inside[key] = inside[key] * int(rng.integers(2, 5))
    elif kind == "number":
        inside[key] = _number(inside[key], rng)
    else:
        inside[key] = any_of(rng, VALUES)
    return data, f"{kind} {'.'.join(map(str, path))} {str(value)[:30] if kind == 'exchange' else ''}"


VALUES = (
    *(None, 0, 0.0, -1, -1.5, 1, 2, 1e300, -1e300, 1e-300, 1e15, 10**200, True, -0.0, 2**53 + 1),
    *("", "x", "NaN", "1", "µm", "m/min", "a" * 5000, [], {}, [0.0], [None], {"x": 1}, {"reason": "unknown"}),
    [1.0] * 5000,
)


def _number(value, rng):
    """A number near another one, or far from it; anything else unchanged in part."""
    if isinstance(value, bool) or value is None:
        return not value
    if isinstance(value, int | float):
        factor = any_of(rng, (-1.0, 0.0, 1e-6, 0.1, 0.999, 1.001, 10.0, 25.4, 1000.0, 1e6, 1e12, 1e100, 1e-100, 1e250))
        new = min(1e308, max(-1e308, value * factor))
        return int(new) if isinstance(value, int) and abs(new) < 2**53 else float(new)
    if isinstance(value, str):
        return any_of(rng, (value[:-1], value + "x", value.upper(), "", value * 3))
    if isinstance(value, list) and value:
        return [*value[:-1], _number(value[-1], rng)]
    return value


# --- good files


@cache
def home():
    """Folder of the good files of this process."""
    folder = tempfile.TemporaryDirectory(prefix="fuzz-forms-")
    home.kept = folder
    return Path(folder.name)


def write_table(path, edges=6, seed=1):
    rng, rows = np.random.default_rng(seed), ["edge,V [m/min],f [mm/rev],t [min],AW [mm]"]
    for k, t in product(range(edges), (2, 4, 6)):
        V, f = (80, 120, 180)[k % 3], (0.1, 0.2)[k % 2]
        rows += [f"E{k},{V},{f},{t},{0.0076 * V**0.577 * f**0.168 * t**0.245 * np.exp(0.1 * rng.normal()):.4f}"]
    path.write_text("\n".join(rows) + "\n")


def trusted(pf, **sections):
    """A published file as if its verdicts allowed control, with further sections."""
    data, usable = pf.model_dump(), {"level": "usable inside the tested region"}
    data["laws"] = {name: {**law, "verdict": usable} for name, law in data["laws"].items()}
    for name in ("dynamics", "adaptive_force", "tool_life"):
        data[name] = {**data[name], "verdict": usable} if data.get(name) else data.get(name)
    return sealed(parameters.ParameterFile.model_validate({**data, **sections}))


COSTS = {"machine": 60.0, "change": 1.5, "edge": 8.0, "currency": "EUR"}


@cache
def good(name):
    """Folder with a good params.json, and the draws of the fitted one."""
    folder = home() / name
    if name == "fitted":
        write_table(home() / "data.csv")
        said("data.csv", "--out", "fitted-out", "--draws", "1000", "--criterion", "0.1", "--tool", "A", "--work", "B",
             at=home())  # fmt: skip
        made = next((home() / "fitted-out").rglob("params.json")).parent
        folder.mkdir()
        for one in ("params.json", "draws.npz"):
            shutil.copy(made / one, folder / one)
        pf = sealed(parameters.read(folder / "params.json"), costs=COSTS)
    else:
        paper = {"turning": "AC-2017", "load": "CLM-2023", "roughness": "SURF", "force": "LYAP"}[name]
        pf = trusted(published(paper), **({"costs": COSTS} if name == "turning" else {}))
        folder.mkdir()
    (folder / "params.json").write_bytes(as_bytes(pf))
    other = sealed(parameters.ParameterFile(identity=pf.identity, provenance=pf.provenance, costs=COSTS))
    (folder / "other.json").write_bytes(as_bytes(other))
    return folder


P = "params.json"


def weighted(lines):
    """Weights and commands, one a line; @ is the parameter file."""
    parts = [line.split(" ", 1) for line in lines.strip().splitlines()]
    return tuple((float(weight), words.replace("@", P)) for weight, words in parts)


OF_PARAMS = """
6 card @ --json
1 card @ --force
2 publish . --check
0.6 publish . --site s --draft --jobs 1
2 merge @ other.json --out merged.json
2 merge other.json @ --out merged.json
3 costs @ machine=70/h edge=8 change=1.5min currency=EUR --force
1 excite --like @ --noise 0.01 --amplitude 1 --rate 50
1 export @ --to csv --out out.csv --force
1 export @ --to ngc --out out.ngc --force
1 export @ --to mat --out out.mat --force
1 export @ --to ssv --out out.ssv --force
1 export @ --to h --out out.h --force
1 export @ --to ini --out out.ini --force
1 export @ --to nc --out out.nc --diameter 100 --length 300 --max-rpm 3000
0.4 export @ --to hal --out out.hal --force
0.4 export @ --to st --out out.st --force
0.4 export @ --to c --out out.c --force
0.4 export @ --to comp --out out.comp --force
0.4 export @ --to fmu --out out.fmu --force
"""
OF_LAWS = """
3 simulate @
3 limits @ AW=0.2mm --force
3 predict @ V=120 f=0.2 d=2 t=5 AW=0.1
3 predict @ V=120 f=0.2 t=5
1 predict @ V=120 f=0.2 t=5 --budget
3 optimum @
"""
OF_TURNING = """
0.4 export @ --to st --system recursion --out out.st --force
0.4 export @ --to c --system region --out out.c --force
0.4 export @ --to fmu --system region --out out.fmu --force
0.2 replay @ --system region --json
"""
OF_LOAD = """
3 settings @ --worn 0.28 --force
3 predict @ fm=700 VB=100 t=1 d=0.2 ae=1.4
0.2 tune @ --rise 2 --settle 4 --force
0.4 replay @ --system constant-load --json
"""
OF_ROUGHNESS = """
3 roughness @ Ra=1.6um n=610rpm f=0.2mm/rev d=1mm r=0.8mm kc=2500N/mm2 servo=0.1s --force
3 predict @ F=500
0.2 replay @ --json
"""
OF_FORCE = """
4 adaptive-force @ 1mm=150N 2mm=200N --feed 60:500mm/min --force
0.1 replay @ --json
"""
BASES = {
    "fitted": weighted(OF_PARAMS + OF_LAWS.lstrip()),
    "turning": weighted(OF_PARAMS + OF_LAWS.lstrip() + OF_TURNING.lstrip()),
    "load": weighted(OF_PARAMS + OF_LOAD.lstrip()),
    "roughness": weighted(OF_PARAMS + OF_ROUGHNESS.lstrip()),
    "force": weighted(OF_PARAMS + OF_FORCE.lstrip()),
}


# --- kinds


@dataclass(frozen=True)
class Case:
    """A changed file: its name in the folder, the commands, and what is asked of their messages.

    ``unreadable``: each command has to refuse it by its name. ``changed``: each has to refuse or to name the change.
    """

    file: str
    commands: Sequence[str]
    what: str
    base: str
    unreadable: bool = False
    changed: bool = False


def drawn(rng, commands, number):
    """Some of the commands, by their weights."""
    weights = np.array([weight for weight, _ in commands])
    found = rng.choice(len(commands), number, replace=False, p=weights / weights.sum())
    return [commands[int(k)][1] for k in found]


def _base(rng, folder, weights=(4, 2, 2, 1, 1)):
    base = str(rng.choice(list(BASES), p=np.array(weights) / sum(weights)))
    shutil.copytree(good(base), folder, dirs_exist_ok=True)
    return base, (folder / P).read_bytes()


def params(rng, folder):
    """A parameter file as it may arrive."""
    base, before = _base(rng, folder)
    how = float(rng.random())
    if how < 0.7:
        content, what = (of_bytes if how < 0.35 else of_token)(before, rng)
    else:
        data, what = of_structure(json.loads(before), rng)
        content = json.dumps(data, indent=2).encode()
    (folder / P).write_bytes(content)
    state = _state(folder / P)
    commands = [f"check {P}", *drawn(rng, BASES[base], 3)]
    return Case(P, commands, f"{base}: {what}", base, state is None, state is False)


def _state(path):
    """Whether the checksum agrees; None where the file cannot be read."""
    try:
        return not seal_fault(parameters.read(path))
    except FitmodelsError:
        return None


def resealed(rng, folder):
    """A parameter file whose changed content has a checksum that agrees."""
    base, before = _base(rng, folder)
    for _ in range(6 if rng.random() < 0.9 else 1):  # most often until it satisfies the schema
        data, done = json.loads(before), []
        for _ in range(int(rng.integers(1, 4))):
            data, what = of_structure(data, rng)
            done.append(what)
        with contextlib.suppress(ValueError, AttributeError):
            data["content_sha256"] = content_sha256(data)
        (folder / P).write_text(json.dumps(data, indent=2))
        if (state := _state(folder / P)) is not None:
            break
    commands = [f"check {P}", *drawn(rng, BASES[base], 2)]
    return Case(P, commands, f"{base}: {'; '.join(done)}", base, state is None)


def draws(rng, folder):
    """Draws that are not those of the parameter file, or that agree with it and are no draws."""
    base, _ = _base(rng, folder, (1, 0, 0, 0, 0))
    path = folder / "draws.npz"
    before = path.read_bytes()
    commands = drawn(rng, ((3, f"check {P}"), (2, f"optimum {P}"),
                           (2, f"merge {P} other.json --out merged.json"), (1, "publish . --check")), 3)  # fmt: skip
    if rng.random() < 0.4:
        content, what = of_bytes(before, rng)
        path.write_bytes(content)
        return Case("draws.npz", commands, what, base, changed=content != before)
    content, what = _crafted(before, rng)
    path.write_bytes(content)
    pf = parameters.read(folder / P)
    posterior = {**pf.posterior.model_dump(), "draws_sha256": hashlib.sha256(content).hexdigest()}
    (folder / P).write_bytes(as_bytes(sealed(pf, posterior=posterior)))
    return Case("draws.npz", commands, f"agrees: {what}", base)


def _crafted(before, rng):
    """An archive of draws with a part exchanged for another one."""
    if rng.random() < 0.3:
        return of_bytes(before, rng)
    with np.load(io.BytesIO(before)) as held:
        arrays = {name: held[name] for name in held.files}
    name = any_of(rng, arrays)
    value, what = arrays[name], any_of(rng, (*PARTS, "dropped", "renamed", "header", "bomb", "members"))
    if what in PARTS:
        with np.errstate(all="ignore"):
            arrays[name] = PARTS[what](value)
    if what in ("dropped", "renamed"):
        arrays.pop(name)
        arrays.update({"../x.draws": value} if what == "renamed" else {})
    with io.BytesIO() as file:
        np.savez(file, **arrays)
        content = file.getvalue()
    if what not in ("header", "bomb", "members"):
        return content, f"{what} {name}"
    members = {}
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = {one: archive.read(one) for one in archive.namelist()}
    if what == "header":  # a shape of 1e12 numbers, with the data of few
        members[f"{name}.npy"] = re.sub(rb"\(\d+,( ?\d*)\)", b"(999999999999,)", members[f"{name}.npy"], count=1)
    elif what == "bomb":
        members[f"{name}.npy"] += bytes(200_000_000 if rng.random() < 0.02 else 2_000_000)
    else:
        members |= {f"x{k}.npy": b"" for k in range(3000)}
    with io.BytesIO() as file, warnings.catch_warnings():
        with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
            for one, data in members.items():
                archive.writestr(one, data)
        return file.getvalue(), f"{what} {name}"


PARTS: dict[str, Callable] = {
    "float32": lambda v: v.astype("f4") if v.dtype.kind == "f" else v[:0],
    "objects": lambda v: np.array([{}] * 3, dtype=object),
    "not finite": lambda v: v * np.nan if v.dtype.kind == "f" else v,
    "no rows": lambda v: v[:0],
    "one row": lambda v: v[:1],
    "one dimension": lambda v: v.ravel(),
    "huge": lambda v: v * 1e300 if v.dtype.kind == "f" else v,
    "zero": lambda v: v * 0 if v.dtype.kind == "f" else v[::-1],
    "negative": lambda v: -v if v.dtype.kind == "f" else v,
    "columns": lambda v: v[..., ::-1],
    "names": lambda v: np.array(["\ud800" if v.dtype.kind == "U" else "x"] * len(v)),
    "scalar": lambda v: np.float64(1.0),
}

PRIORS = """[AW]
source = "forty tests, 2019"
level = { distribution = "lognormal", median = 0.2, factor = 3, unit = "mm" }
V = { distribution = "normal", mean = 0.5, sd = 0.5 }
sd = { distribution = "half-t", df = 4, scale = 0.1 }
icc = { distribution = "beta", a = 1, b = 3 }
"""
CARD = """license = "CC-BY-4.0"
authors = ["Doe, Jane", "Roe, R."]
contact = "jane.doe@example.org"
title = "Wear of A on B"
doi = "10.5281/zenodo.1234567"
setup = "dry"
iso513 = "P20"
keywords = ["turning"]
[[sensors]]
symbol = "AW"
unit = "mm"
model = "microscope"
sd = 0.005
[tool_properties]
RE = 0.8
"""
PAIRS = "tool,work,iso513,grade\nG0_S,,P20,hard\nG1_S,unnamed-work,K10,soft\n,unnamed-work,,new\n"


def _text(content, rng, folder, name):
    """A text file with one or two changes."""
    data, done = content.encode(), []
    for _ in range(int(rng.integers(1, 3))):
        data, what = (of_bytes if rng.random() < 0.3 else of_token)(data, rng)
        done.append(what)
    (folder / name).write_bytes(data)
    return "; ".join(done)


def priors(rng, folder):
    write_table(folder / "data.csv", 4)
    what = _text(PRIORS, rng, folder, "priors.toml")
    return Case("priors.toml", ["data.csv --json --draws 1000 --priors priors.toml"], what, "table")


def card(rng, folder):
    base, _ = _base(rng, folder, (1, 1, 1, 1, 1))
    what = _text(CARD, rng, folder, "card.toml")
    commands = drawn(rng, ((4, f"card {P} --json --toml card.toml"), (2, f"card {P} --force --citation --zenodo"),
                           (3, "publish . --check"), (1, "publish . --site s --draft --jobs 1")), 2)  # fmt: skip
    return Case("card.toml", commands, what, base)


@cache
def batched(files):
    """Source and output folder of a batch."""
    folder = home() / f"batch-{files}"
    for k in range(2):
        (folder / "src").mkdir(parents=True, exist_ok=True)
        write_table(folder / "src" / f"G{k}_S.csv", 4, seed=k)
    said(*OF_BATCH[files].split(), at=folder)
    return folder


OF_BATCH = {True: "batch src --out out --jobs 1 --no-site", False: "batch src --out out --jobs 1 --table-only"}


def pairs(rng, folder):
    shutil.copytree(batched(False) / "src", folder / "src")
    what = _text(PAIRS.replace(",", any_of(rng, (",", ";", "\t"))), rng, folder, "pairs.csv")
    return Case("pairs.csv", [f"{OF_BATCH[False]} --pairs pairs.csv"], what, "batch")


def batch(rng, folder):
    """The state of a finished batch, which the next one continues from."""
    files = bool(rng.random() < 0.5)
    shutil.copytree(batched(files), folder, dirs_exist_ok=True)
    states = sorted(path for path in (folder / "out" / ".batch").rglob("*.json"))
    path = any_of(rng, states)
    what = _json(path, rng)
    commands = [OF_BATCH[files], f"{OF_BATCH[files]} --force"]
    return Case(
        path.relative_to(folder).as_posix(), commands[: 1 + (rng.random() < 0.3)], f"{path.name}: {what}", "state"
    )


def _json(path, rng):
    before, how = path.read_bytes(), float(rng.random())
    if how < 0.6:
        content, what = (of_bytes if how < 0.3 else of_token)(before, rng)
    else:
        data, what = of_structure(json.loads(before), rng)
        content = json.dumps(data).encode()
    path.write_bytes(content)
    return what


@cache
def site_folder():
    folder = home() / "site"
    shutil.copytree(good("turning"), folder / "in" / "one")
    said(*OF_SITE.split(), at=folder)
    return folder


OF_SITE = "publish in --site site --draft --jobs 1"


def site(rng, folder):
    """A published site, which is published again."""
    shutil.copytree(site_folder(), folder, dirs_exist_ok=True)
    path = folder / "site" / "cards.json"
    if rng.random() < 0.2:
        path = any_of(rng, sorted(one for one in (folder / "site").rglob("*") if one.is_file()))
        content, what = of_bytes(path.read_bytes(), rng)
        path.write_bytes(content)
    else:
        what = _json(path, rng)
    return Case(path.relative_to(folder).as_posix(), [OF_SITE, f"{OF_SITE} --force"], f"{path.name}: {what}", "state")


@cache
def reduced():
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))
    import force_records

    folder = home() / "reduced"
    (folder / "records").mkdir(parents=True)
    t, load, *_ = force_records.cut_signal([520.0, 640.0], 100, np.random.default_rng(1), seconds=4.0)
    force_records.write_table(folder / "records" / "E1.csv", t, {"Fc [N]": load})
    (folder / "tests.csv").write_text("edge,V [m/min],f [mm/rev],t [min]\nE1,120,0.2,2\nE1,120,0.2,4\n")
    said(*OF_REDUCE.split(), at=folder)
    return folder


OF_REDUCE = "reduce records --plan tests.csv --out data.csv --force"


def reduce(rng, folder):
    """Figures of reduced records, which the next run takes again."""
    shutil.copytree(reduced(), folder, dirs_exist_ok=True)
    path = any_of(rng, sorted((folder / "data-records").glob("*.json")))
    return Case(path.relative_to(folder).as_posix(), [OF_REDUCE], _json(path, rng), "state")


ODD_WORDS = """
1e400 -1e400 nan inf 0 -1 1,5 µ = V= =1 V=1e-320mm 0x10 1:2:3:4 : 1: -- -x 1e308 工具 V=120 a/b*c**d
mm**999999999 m^9999 1/0 {} %s ../x 0.1.2 1_0
"""
WORDS = ("9" * 5000, "", " ", "x" * 5000, "\ud800", "\x1b[31m", "1" * 400, "(" * 1000, "[" * 3000, *ODD_WORDS.split())


def words(rng, folder):
    """Words of the command line that are read as numbers, units, conditions or corrections."""
    base, _ = _base(rng, folder)
    write_table(folder / "data.csv", 4)
    known = drawn(rng, [(w, c) for w, c in (*BASES[base], *OF_DATA) if "=" in c or "--" in c], 3)
    commands = []
    for line in known:
        parts = line.split(" ")
        at = any_of(rng, [k for k, part in enumerate(parts) if k > 0 and part not in (P, "other.json", "data.csv")])
        piece, word = parts[at], any_of(rng, WORDS)
        key, equals, value = piece.partition("=")
        cut = int(rng.integers(len(value) + 1))
        parts[at] = any_of(
            rng, (word, f"{key}={word}", f"{key}{equals}{value[:cut]}{word}{value[cut:]}", f"{word}={value}")
        )
        commands.append("\0".join(parts))
    return Case("", commands, "; ".join(c.replace("\0", " ")[:200] for c in commands), base)


OF_DATA = (
    (2, "look data.csv --out look.png --unit V=m/min --map V=V"),
    (2, "look data.csv --out look.png --value d=2mm --edge edge"),
    (1, "data.csv --json --draws 1000 --leave-out 3 --criterion 0.1"),
    (2, "next data.csv --runs 2 --within 15 --criterion 0.1"),
    (1, "compare data.csv --law AW~V,f,t"),
    (2, "plan --range V=50:200 --range f=0.06:0.6 --levels d=1,2 --seed 3"),
    (2, "excite --amplitude 2.5 --band 0.1:2 --duration 15 --rate 50"),
    (1, "confirm data.csv --data data.csv --level 0.9 --law AW~V,f,t"),
)

MADE: dict[str, Callable[..., Case]] = {
    "params": params, "sealed": resealed, "draws": draws, "priors": priors, "card": card, "pairs": pairs,
    "batch": batch, "site": site, "reduce": reduce, "words": words,
}  # fmt: skip


# --- running


class TooLong(BaseException):
    """A command beyond its time; no handler of errors takes it for one of its own."""


@dataclass(frozen=True)
class Said:
    """Exit code and output of a command, with its time, traceback and warnings."""

    code: int
    out: str
    err: str
    seconds: float
    trace: str
    warned: tuple[str, ...]


def said(*words, at, limit=120.0):
    """Run a command in a folder."""
    out, err, before, trace = io.StringIO(), io.StringIO(), Path.cwd(), ""
    start = resource.getrusage(resource.RUSAGE_SELF).ru_utime
    os.chdir(at)
    signal.signal(signal.SIGVTALRM, _stop)
    try:
        with warnings.catch_warnings(record=True) as warned, mock.patch.dict("os.environ", FITMODELS_TRACEBACK="1"):
            warnings.simplefilter("always")
            with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
                signal.setitimer(signal.ITIMER_VIRTUAL, limit)
                code = cli.main(words)
    except TooLong:
        code, trace = -1, f"stopped after {limit:.0f} s: {place()}"
    except Exception as error:
        code, trace = cli.DEFECT, f"{type(error).__name__}: {str(error)[:150]} at {place()}"
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        os.chdir(before)
    places_of = tuple(f"{Path(one.filename).name}:{one.lineno} {str(one.message)[:80]}" for one in warned)
    seconds = resource.getrusage(resource.RUSAGE_SELF).ru_utime - start
    return Said(code, out.getvalue(), err.getvalue(), seconds, trace, places_of)


def _stop(*_):
    raise TooLong


def place():
    """The last lines of the package in the traceback of the error that is handled."""
    found = re.findall(r"fitmodels/([\w/]+\.py)\", line (\d+)", traceback.format_exc())
    return " <- ".join(f"{file}:{line}" for file, line in reversed(found[-3:]))


@cache
def without_change(base, command):
    """Exit code, and seconds, of a command with good files."""
    with tempfile.TemporaryDirectory() as scratch:
        at = Path(scratch)
        if base in BASES:
            shutil.copytree(good(base), at, dirs_exist_ok=True)
        if base == "table":
            write_table(at / "data.csv", 4)
            (at / "priors.toml").write_text(PRIORS)
        for kind, made in (("batch", lambda: batched(False)), ("state", lambda: _state_of(command))):
            if base == kind:
                shutil.copytree(made(), at, dirs_exist_ok=True)
                (at / "pairs.csv").write_text(PAIRS)
        found = said(*command.split(), at=at)
        return found.code, found.seconds


def _state_of(command):
    return reduced() if command == OF_REDUCE else site_folder() if command.startswith(OF_SITE) else batched(
        command.startswith(OF_BATCH[True]))  # fmt: skip


def trial(kind, number, folder):
    """Verdict, fault, description and size of a changed file, through all of its commands; see ``fuzz.py``."""
    case = MADE[kind](np.random.default_rng([number, list(MADE).index(kind)]), folder)
    size = (folder / case.file).stat().st_size if case.file else 0
    codes, faults = [], []
    for command in case.commands:
        words = command.split("\0") if "\0" in command else command.split()
        then, seconds = (2, 1.0) if kind == "words" else without_change(case.base, command)
        before = (folder / case.file).read_bytes() if case.file else b""
        found = said(*words, at=folder, limit=4 * (SECONDS + 3 * seconds))
        codes.append(found.code)
        wrong = [*_of_code(found), *_of_limits(found, seconds), *_of_words(found, case, then)]
        if found.code not in (0, 5) and case.file and (folder / case.file).read_bytes() != before:
            wrong.append(f"refused, and {case.file} was changed")
        faults += [f"{command[:80]}: {words}" for words in wrong]
    verdict = "read" if 0 in codes else "refused" if set(codes) <= {2, 3, 4} else "checked"
    return verdict, "; ".join(faults), f"{case.file} {case.what}"[:300], size


KINDS = {kind: partial(trial, kind) for kind in MADE}


def _of_code(found):
    if found.code not in DONE:
        yield f"exit {found.code} {found.trace}"
    yield from dict.fromkeys(FAILED.findall(found.out))
    yield from (f"warning {words}" for words in dict.fromkeys(found.warned))


def _of_limits(found, seconds):
    if found.seconds > SECONDS + 3 * seconds:
        yield f"{found.seconds:.1f} s, {seconds:.1f} s with the good file"


def _of_words(found, case, then):
    lines = [line for line in found.err.splitlines() if line.strip()]
    name = Path(case.file).name
    if found.code in (2, 3, 4) and not lines:
        yield "refused without a message"
    if case.file and any(len(line) > LONGEST for line in lines):
        yield f"message of {max(map(len, lines))} characters"
    if len(lines) > 8:
        yield f"message of {len(lines)} lines"
    if case.unreadable and (found.code in (0,) or name not in found.err + found.out):
        yield f"exit {found.code}, unreadable {name} is not named: {' '.join(lines)[:200]}"
    if case.changed and found.code == 0 and not CHANGED.search(found.err + found.out):
        yield "a changed content is not seen"
    other_site = "which a draft does not replace" in found.err
    named = name in found.err or other_site or case.base not in ("table", "batch", "state")
    if then == 0 and found.code in (2, 3) and not named:
        yield f"exit {found.code} does not name {name}: {' '.join(lines)[:200]}"
