"""Files that may come from elsewhere: only regular files are opened, and within limits of size, nesting and members."""

import io
import os
import re
import socket
import sys
import tempfile
import zipfile
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from fitmodels.cards.publishing.card_toml import read_toml
from fitmodels.cards.publishing.site_folder import is_site
from fitmodels.cli import main
from fitmodels.core import bounded
from fitmodels.core.bounded import LIMITS, parse_json, parse_toml, read_bounded, stored_json
from fitmodels.core.errors import DataError, FitmodelsError, ParameterError
from fitmodels.datasets.records.formats import record_tables
from fitmodels.datasets.tables import workbook
from fitmodels.datasets.tables.decode import load_bytes
from fitmodels.datasets.tables.workbook import open_book
from fitmodels.fit.bayes.priors_file import read_priors
from fitmodels.parameters import read
from fitmodels.parameters.draws import Draws, packed, unpacked

POSIX = pytest.mark.skipif(os.name != "posix", reason="special files of POSIX systems")
READERS = {
    "table": load_bytes,
    "parameters": read,
    "priors": read_priors,
    "card": read_toml,
    "record": record_tables,
}
TABLE = "edge,V,f,VB\n" + "".join(f"{k},{100 + 7 * k},{0.1 + 0.01 * (k % 5)},{0.05 * k}\n" for k in range(1, 13))


@pytest.fixture(params=READERS)
def reader(request):
    return READERS[request.param]


def refusal(reader, path):
    with pytest.raises(FitmodelsError) as raised:
        reader(path)
    text = str(raised.value)
    assert str(path) in text or path.name in text
    assert "\n" not in text
    return text


# Special files


@POSIX
def test_a_pipe_is_refused_without_waiting_for_its_writer(reader, tmp_path):
    os.mkfifo(tmp_path / "data.csv")
    assert "is a pipe, not a regular file" in refusal(reader, tmp_path / "data.csv")


@POSIX
def test_a_device_is_refused_without_reading_it(reader):
    assert "is a device, not a regular file" in refusal(reader, Path("/dev/zero"))


@POSIX
def test_a_socket_is_refused(reader):
    with tempfile.TemporaryDirectory() as folder, socket.socket(socket.AF_UNIX) as held:  # a short path: 108 characters
        held.bind(f"{folder}/s")
        assert "is a socket, not a regular file" in refusal(reader, Path(folder, "s"))


def test_a_folder_is_refused(reader, tmp_path):
    assert "is a folder" in refusal(reader, tmp_path)


@POSIX
def test_where_standard_input_is_read_the_refusal_of_a_pipe_names_it(tmp_path, capsys):
    os.mkfifo(tmp_path / "p")
    assert main([str(tmp_path / "p")]) == 3
    assert "also read standard input, given as -" in capsys.readouterr().err


@POSIX
@pytest.mark.parametrize("command", ["check", "card", "batch", "ident", "look", "tune", "publish"])
def test_commands_end_at_once_on_a_pipe(command, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    os.mkfifo("p.csv")
    assert main([command, "p.csv"]) in (2, 3)
    said = capsys.readouterr().err
    assert "is a pipe, not a regular file" in said or "--site" in said
    assert said.count("\n") == 1


@POSIX
def test_links_are_followed_and_loops_are_reported(reader, tmp_path):
    (tmp_path / "a").symlink_to("b")
    (tmp_path / "b").symlink_to("a")
    assert "levels of symbolic links" in refusal(reader, tmp_path / "a")
    (tmp_path / "c").symlink_to("nowhere")
    assert "does not exist" in refusal(load_bytes, tmp_path / "c")
    (tmp_path / "there").write_bytes(b"x")
    (tmp_path / "d").symlink_to("there")
    assert read_bounded(tmp_path / "d", "card") == b"x"


def test_no_permission(reader, tmp_path, monkeypatch):
    path = tmp_path / "a.csv"
    path.write_text(TABLE)

    def denied(*given):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(bounded.os, "open", denied)  # the tests may run as root, who may read everything
    assert "permission denied" in refusal(reader, path).lower()


def test_names_that_no_file_has(reader):
    refusal(reader, Path("nul\0l"))
    refusal(reader, Path("x" * 5000))


# Sizes


@pytest.mark.parametrize(("kind", "name"), [("parameters", "parameters"), ("card", "card"), ("priors", "priors")])
def test_a_file_too_large_is_not_read(kind, name, tmp_path):
    path = tmp_path / "large"
    with path.open("wb") as file:
        file.truncate(LIMITS[kind].size + 1)  # sparse: takes no room on disk
    text = refusal(READERS[name], path)
    assert f"has {LIMITS[kind].size + 1} bytes" in text
    assert f"at most {LIMITS[kind].size}" in text


def test_a_sparse_file_of_10_gb_is_not_read(tmp_path):
    path = tmp_path / "a.csv"
    with path.open("wb") as file:
        file.truncate(10_000_000_000)
    for reader in (load_bytes, record_tables, read_toml):
        assert "has 10000000000 bytes" in refusal(reader, path)
    assert main([str(path)]) == 3


@contextmanager
def during(monkeypatch, act):
    """Act on a file between its opening and its end."""
    whole, calls = os.fstat, []

    def fstat(descriptor):
        found = whole(descriptor)
        calls.append(found)
        if len(calls) == 2:
            act()
        return found

    with monkeypatch.context() as patched:
        patched.setattr(bounded.os, "fstat", fstat)
        yield


@pytest.mark.parametrize("change", ["grows", "shrinks", "is rewritten"])
def test_a_file_that_changes_while_it_is_read_is_refused(change, tmp_path, monkeypatch):
    path = tmp_path / "a.csv"
    path.write_text(TABLE)
    os.utime(path, (1e9, 1e9))
    new = {"grows": TABLE * 2, "shrinks": TABLE[:30], "is rewritten": TABLE.replace("1", "2")}[change]
    with during(monkeypatch, lambda: path.write_text(new)), pytest.raises(DataError, match="changed while it was read"):
        load_bytes(path)


@POSIX
def test_a_file_removed_while_it_is_read_is_read(tmp_path, monkeypatch):
    path = tmp_path / "a.csv"
    path.write_text(TABLE)
    with during(monkeypatch, path.unlink):
        assert load_bytes(path) == TABLE.encode()


def test_standard_input_without_end_is_refused(monkeypatch, capsys):
    class Endless:
        buffer = type("", (), {"read": staticmethod(lambda size: bytes(size))})
        closed = False
        isatty = staticmethod(lambda: False)

    small = bounded.Limit("a file of measurements", 3_000_000, "Split it.")
    monkeypatch.setattr("fitmodels.cli.arguments.LIMITS", {"measurements": small})
    monkeypatch.setattr(sys, "stdin", Endless())
    assert main(["look", "-"]) == 3
    assert "standard input gives more than 3000000 bytes" in capsys.readouterr().err


# JSON and TOML


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"a = " + b"9" * 5000, "an integer of more than 300 digits"),
        (b"a = 0x" + b"f" * 5000, "an integer of more than 300 digits"),
        (b"a = " + b"[" * 100_000, "nested deeper than 50"),
        (b"a = " + b"{a = " * 50_000, "nested deeper than 50"),
        (b"a." * 100_000 + b"a = 1", "nested deeper than 50"),
        (b"[" + b"a." * 100_000 + b"a]", "nested deeper than 50"),
        (b"a = 1\na = 2", "is not TOML"),
        (b"\xff", "is not UTF-8 text"),
    ],
    ids=["digits", "hexadecimal", "lists", "tables", "keys", "header", "twice", "bytes"],
)
def test_hostile_toml_is_one_sentence(content, words, tmp_path):
    for reader in (read_priors, read_toml):
        (tmp_path / "p.toml").write_bytes(content)
        assert words in refusal(reader, tmp_path / "p.toml")


def test_toml_of_texts_with_dots_is_read():
    text = 'setup = "' + "See 1.2 and e.g. 3.4. " * 40 + '..........."\n# ' + "." * 200 + "\n"
    with pytest.raises(DataError):
        parse_toml(b"x." * 60 + b"y = 1", "card.toml")
    assert parse_toml(text.replace("See", ", See").encode(), "card.toml")["setup"].startswith(", See 1.2")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"[" + b"{}," * 3_000_001 + b"{}]", "the limit is 3000000"),
        (b"[" * 100_000, "nested deeper than 50"),
        (b"[" + b"1" * 301 + b"]", "an integer of 301 digits"),
        (b"[1e400]", "every number must be finite"),
        (b"[NaN]", "every number must be finite"),
        (b'["\\ud800"]', "unpaired surrogate"),
        (b'{"a": 1, "a": 2}', "occurs twice"),
    ],
)
def test_hostile_json_is_one_sentence(content, words):
    with pytest.raises(ParameterError, match=words) as raised:
        parse_json(content, "params.json", error=ParameterError)
    assert len(str(raised.value)) < 200


def test_a_damaged_state_counts_as_absent(tmp_path):
    for content in (b"[" * 100_000, b'{"a": ' + b"9" * 5000 + b"}", b"\xff", b"{"):
        (tmp_path / "cards.json").write_bytes(content)
        assert stored_json(tmp_path / "cards.json") is None
        assert not is_site(tmp_path)
    (tmp_path / "cards.json").write_bytes(b"[NaN]")
    assert stored_json(tmp_path / "cards.json", finite=False) is not None


# Draws


def archive(members, size=None):
    """A zip archive; ``size`` is stated for each member instead of its own."""
    with io.BytesIO() as file:
        with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as made:
            for name, content in members.items():
                made.writestr(name, content)
        content = bytearray(file.getvalue())
    if size is not None:
        at = 0
        while (at := content.find(b"PK\x01\x02", at)) >= 0:
            content[at + 24 : at + 28] = size.to_bytes(4, "little")
            at += 4
    return bytes(content)


def npy(header):
    text = header.encode().ljust(117) + b"\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text


HEADER = "{{'descr': {0!r}, 'fortran_order': False, 'shape': {1}, }}"


@pytest.mark.parametrize(
    "content",
    [
        archive({"AW.draws.npy": npy(HEADER.format("<f8", "(1000000000000, 1)")), "AW.names.npy": b""}),
        archive({"AW.draws.npy": npy(HEADER.format("|O", "(1,)")) + b"\x80\x04."}),
        archive({"AW.draws.npy": npy("(" * 100)}),
        archive({"AW.draws.npy": npy("{1: 2, 'a': 3, 'b': 4}")}),
        archive({"AW.draws.npy": b"x" * 1000}, size=2_000_000_000),
        archive({f"{k}.npy": b"" for k in range(5001)}),
        packed({"AW": Draws(("V",), np.ones((4, 1)))})[:-30],
        b"",
    ],
    ids=["lying header", "pickle", "brackets", "keys", "lying size", "members", "truncated", "empty"],
)
def test_hostile_draws_are_one_sentence(content):
    with pytest.raises(ParameterError) as raised:
        unpacked(content, "draws.npz")
    assert str(raised.value).startswith("draws.npz: ")


# Workbooks

MAIN = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
HEAD = "".join(f'<c r="{place}1" t="inlineStr"><is><t>{text}</t></is></c>' for place, text in (("A", "V"), ("B", "f")))


def xlsx(rows, before="", after="", parts=None):
    """A workbook whose sheet is written by hand."""
    import openpyxl

    with io.BytesIO() as empty:
        openpyxl.Workbook().save(empty)
        with zipfile.ZipFile(empty) as made:
            members = {item.filename: made.read(item) for item in made.infolist()}
    sheet = f'<worksheet xmlns="{MAIN}">{before}<sheetData><row r="1">{HEAD}</row>{rows}</sheetData>{after}</worksheet>'
    return archive({**members, "xl/worksheets/sheet1.xml": sheet.encode(), **(parts or {})})


def first_sheet(data):
    book = open_book(data, "a.xlsx")
    return book.sheet(book.titles[0])


def test_a_declared_dimension_costs_nothing():
    assert first_sheet(xlsx("", before='<dimension ref="A1:XFD1048576"/>')).rows == (("V", "f"),)


def test_formatted_empty_rows_are_not_kept():
    import tracemalloc

    rows = "".join(f'<row r="{k}" s="3" ht="15" customFormat="1"><c r="A{k}" s="0"/></row>' for k in range(2, 2002))
    data = xlsx(rows)
    tracemalloc.start()
    try:
        assert first_sheet(data).rows == (("V", "f"),)
        assert tracemalloc.get_traced_memory()[1] < 1_000_000  # kept rows would take 1 MB more
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    "rows",
    [
        '<row r="4000000000"><c r="A1"><v>1</v></c></row>',
        '<row r="2"><c r="ZZZZZZZZ2"><v>1</v></c></row>',
        '<row r="' + "9" * 5000 + '"><c r="A1"><v>1</v></c></row>',
    ],
)
def test_a_cell_outside_of_a_sheet_is_refused(rows):
    with pytest.raises(DataError, match="damaged Excel workbook"):
        first_sheet(xlsx(rows))


def test_cells_at_the_end_of_each_row_are_limited(monkeypatch):
    monkeypatch.setattr("fitmodels.datasets.tables.xlsx.MOST_CELLS", 100_000)
    with pytest.raises(DataError, match="more than 100000 cells"):
        first_sheet(xlsx("".join(f'<row r="{k}"><c r="XFD{k}"><v>1</v></c></row>' for k in range(2, 20))))


def test_hidden_columns_and_merged_cells_are_limited():
    columns = '<cols><col min="1" max="2000000000" hidden="1"/></cols>'
    assert first_sheet(xlsx("", before=columns)).rows == (("", ""),)
    with pytest.raises(DataError, match="merged cells"):
        first_sheet(xlsx("", after="<mergeCells>" + '<mergeCell ref="A1:A1048576"/>' * 9 + "</mergeCells>"))


@pytest.mark.parametrize(
    ("name", "most", "data"),
    [
        ("UNPACKED", 100_000, lambda: xlsx("<!--" + " " * 100_000 + "-->")),
        ("MOST_TAGS", 1000, lambda: xlsx('<row r="2">' + "<c/>" * 1000 + "</row>")),
        ("OTHER_TAGS", 1000, lambda: xlsx("", parts={"xl/styles.xml": b"<xf/>" * 1001})),
        ("LONGEST_ROW", 1000, lambda: xlsx('<row r="2">' + "<c/>" * 1000 + "</row>")),
    ],
)
def test_the_parts_of_a_workbook_are_limited(name, most, data, monkeypatch):
    content = data()
    monkeypatch.setattr(workbook, name, most)
    monkeypatch.setattr(workbook, "_CHUNK", 500)
    with pytest.raises(DataError, match=rf"^a\.xlsx.*{most}.*\.csv\.$|unpacks to"):
        open_book(content, "a.xlsx")


def test_a_part_that_is_larger_than_stated_is_damaged():
    with io.BytesIO() as file:
        with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as made:
            made.writestr("content.xml", b"<a>" + b" " * 1_000_000)
        content = bytearray(file.getvalue())
    at = content.find(b"PK\x01\x02")
    content[at + 24 : at + 28] = (50).to_bytes(4, "little")
    with pytest.raises(DataError, match="damaged"):
        open_book(bytes(content), "a.ods")


def test_repeated_cells_of_an_ods_sheet_are_counted():
    row = '<table:table-row table:number-rows-repeated="100000">{}</table:table-row>'
    cell = '<table:table-cell table:number-columns-repeated="16384" office:value="1"/>'
    empty = '<table:table-cell table:number-columns-repeated="16384"/>'
    assert workbook._repeated_cells(row.format(cell).encode()) == 100_000 * 16_384
    assert workbook._repeated_cells(row.format(empty).encode()) == 0
    with pytest.raises(DataError, match="1638400000 cells"):
        open_book(archive({"content.xml": row.format(cell)}), "a.ods")


def test_an_entity_of_a_sheet_is_not_followed():
    entity = '<!DOCTYPE worksheet [<!ENTITY x SYSTEM "file:///etc/passwd">]>'
    cell = '<row r="1"><c r="A1" t="inlineStr"><is><t>&x;</t></is></c></row>'
    sheet = f'{entity}<worksheet xmlns="{MAIN}"><sheetData>{cell}</sheetData></worksheet>'
    with pytest.raises(DataError, match="damaged Excel workbook") as raised:
        first_sheet(xlsx("", parts={"xl/worksheets/sheet1.xml": sheet.encode()}))
    assert "\n" not in str(raised.value)


def test_an_archive_in_an_archive_is_not_unpacked():
    inner = archive({"bomb": b" " * 10_000_000})
    with pytest.raises(DataError, match="damaged Excel workbook"):
        first_sheet(xlsx("", parts={"xl/worksheets/sheet1.xml": inner}))


# Records


def test_a_matlab_file_of_compressed_blanks_is_refused(tmp_path, monkeypatch):
    from scipy.io import savemat

    path = tmp_path / "run.mat"
    savemat(path, {"u": np.zeros(300_000), "y": np.zeros(300_000)}, do_compression=True)
    assert len(record_tables(path)[0].lines) == 300_000
    monkeypatch.setattr("fitmodels.datasets.records.formats.LARGEST_UNPACKED", 1_000_000)
    with pytest.raises(DataError, match="unpacks to more than 1000000 bytes"):
        record_tables(path)


def test_a_tdms_file_that_states_other_lengths_is_refused(tmp_path, capfd):
    nptdms = pytest.importorskip("nptdms")
    path, values = tmp_path / "run.tdms", np.arange(100.0)
    with nptdms.TdmsWriter(str(path)) as file:
        file.write_segment([nptdms.ChannelObject("g", name, values) for name in ("u", "y")])
    content = path.read_bytes()
    assert len(record_tables(path)[0].lines) == 100
    for stated in (101, 10**9, 2**62):
        path.write_bytes(content.replace((100).to_bytes(8, "little"), stated.to_bytes(8, "little"), 1))
        with pytest.raises(DataError, match="damaged TDMS file"):
            record_tables(path)
    assert capfd.readouterr().err == ""


def test_a_matlab_73_file_does_not_lead_to_other_files(tmp_path, monkeypatch):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "other.mat", "w") as file:
        file["y"] = np.arange(10.0)
    with h5py.File(tmp_path / "run.mat", "w", userblock_size=512) as file:
        file["u"], file["v"] = np.arange(10.0), np.arange(10.0)
        file["y"] = h5py.ExternalLink(str(tmp_path / "other.mat"), "/y")
        file.create_dataset("w", (10,), "<f8", external=[(str(tmp_path / "other.mat"), 0, 80)])
    content = (tmp_path / "run.mat").read_bytes()
    (tmp_path / "run.mat").write_bytes(b"MATLAB 7.3 MAT-file".ljust(512, b"\0") + content[512:])
    assert [column.name for column in record_tables(tmp_path / "run.mat")[0].columns] == ["u", "v"]
    monkeypatch.setattr("fitmodels.datasets.records.formats.LARGEST_UNPACKED", 100)
    with pytest.raises(DataError, match="unpacks to more than 100 bytes"):
        record_tables(tmp_path / "run.mat")


def test_a_table_of_ordinary_size_is_within_every_limit():
    assert LIMITS["measurements"].size >= 25 * 10 * 1_000_000  # a million rows of 25 columns of ten characters


@POSIX
def test_a_loop_of_links_in_a_folder_of_records_is_reported(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("runs").mkdir()
    Path("runs/a.csv").symlink_to("b.csv")
    Path("runs/b.csv").symlink_to("a.csv")
    Path("plan.csv").write_text(TABLE)
    assert main(["reduce", "runs", "--plan", "plan.csv", "--out", "r.csv"]) in (2, 3)
    assert "internal error" not in capsys.readouterr().err


# The package


def test_received_files_are_opened_in_one_place():
    """Modules that read by themselves read what they wrote, parse numbers of their own, or belong to the package."""
    package = Path(bounded.__file__).parent.parent
    own = {
        "batch/output_folder.py", "batch/engine/base.py", "cards/forms/rendering.py", "cli/physical.py", "cli/ident.py",
        "cli/plan.py", "core/bounded.py", "datasets/tables/other_books.py", "parameters/draws.py",
        "parameters/published/roughness.py",
    }  # fmt: skip
    reads = re.compile(r"\.read_(?:bytes|text)\(|\bjson\.loads?\(|\btomllib\.|np\.load\(|ZipFile\(io|\.open\(\"rb\"\)")
    found = set()
    for folder in (
        "batch",
        "cards",
        "cli",
        "controllers",
        "core",
        "datasets",
        "fit",
        "ident",
        "parameters",
        "pipeline",
    ):
        for path in (package / folder).rglob("*.py"):
            lines = path.read_text("utf-8").splitlines()
            if any(
                reads.search(one) for one in lines if "__file__" not in one and ">>> " not in one and "... " not in one
            ):
                found.add(path.relative_to(package).as_posix())
    assert found == own
