"""Bytes -> text lines: what a file is, and in which encoding it was written."""

import codecs
import io
import re
from collections.abc import Iterator
from pathlib import Path

from ...core.bounded import read_bounded
from ...core.errors import DataError
from ...core.files import cause
from ...core.suggestions import near_path
from .worksheet import FORMATS

_SIGNATURES = (
    (b"\x89PNG", "a PNG image"),
    (b"\xff\xd8\xff", "a JPEG image"),
    (b"GIF8", "a GIF image"),
    (b"%PDF", "a PDF document"),
    (b"\x1f\x8b", "a gzip archive"),
    (b"BZh", "a bzip2 archive"),
    (b"\xfd7zXZ", "an xz archive"),
    (b"7z\xbc\xaf", "a 7z archive"),
    (b"Rar!", "a RAR archive"),
    (b"PK\x03\x04", "a zip archive"),
    (b"PAR1", "a Parquet file"),
    (b"\x89HDF", "an HDF5 or MATLAB 7.3 file"),
    (b"MATLAB 5.0", "a MATLAB file"),
    (b"SQLite format 3", "a SQLite data base"),
    (b"<!DOCTYPE", "a web page"),
    (b"<html", "a web page"),
    (b"<?xml", "an XML document"),
)
_BOMS = ((codecs.BOM_UTF8, "utf-8-sig"), (codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16"))
_BLANKS = b" \t\r\n\x0b\x0c\x00" + codecs.BOM_UTF8 + codecs.BOM_UTF16
_ENCODING_NAMES = {"utf-8": "UTF-8", "utf-8-sig": "UTF-8", "cp1252": "Windows-1252", "cp1250": "Windows-1250"}
# Tab, the line ends, the form feed and the DOS end-of-file mark (0x1a) are the control bytes a text may hold.
_CONTROL_BYTES = bytes(sorted(set(range(32)) - set(b"\t\n\r\x0b\x0c\x1a")))
_SNIFFED = 65536
# Between two letters these are letters of Windows-1250, in Windows-1252 symbols or ø, and 8d, 8f, 9d are nothing there.
_LETTER, _ODD = rb"[A-Za-z\x8a-\x8f\x9a-\x9f\xc0-\xff]", rb"[\xa3\xa5\xaa\xaf\xb3\xb9\xba\xbc\xbe\xbf\xf8]"
_CENTRAL = re.compile(rb"[\x8d\x8f\x9d]|(?<=%b)%b(?=[A-Za-z\x80-\xff])" % (_LETTER, _ODD))
_DIAMETER = re.compile(rb"(?<!%b)[\xd8\xf8]|[\xd8\xf8](?!%b)|\xb5" % (_LETTER, _LETTER))
_ALPHABETS = ("áčďéěíňóřšťúůýž", "áäčďéíĺľňóôŕšťúýž", "ąćęłńóśźż", "ăâîşţ")  # Czech, Slovak, Polish, Romanian
_FEWEST = 2  # letters that the two code pages read otherwise
_CHUNK = 1 << 20


def load_bytes(path: Path) -> bytes:
    """Read a file whole, with an error for anything that is not a file or is empty.

    Raises
    ------
    DataError
        A missing file (with the nearest name in its folder), anything but a regular file, one that is too large,
        unreadable or empty.

    >>> from pathlib import Path
    >>> load_bytes(Path(__file__))[:3]
    b'\"\"\"'

    """
    try:
        data = read_bounded(path, "measurements")
    except (FileNotFoundError, NotADirectoryError):
        raise DataError(_absent(path)) from None
    except OSError as error:
        raise DataError(f"{path} cannot be read: {cause(error)}.") from error
    if not data:
        raise DataError(f"{path.name} is empty (0 bytes): export it again.")
    if not data.strip(_BLANKS):
        raise DataError(f"{path.name} holds only blanks ({len(data)} bytes): export it again.")
    return data


def encoding_of(data: bytes, name: str) -> str:
    """Encoding of a text file's bytes, as a Python codec name.

    Tried in this order: byte order mark, zero bytes on one side of each pair (UTF-16), UTF-8, Windows-1250 where its
    letters are those of one language and Windows-1252 has symbols between letters, Windows-1252.

    Raises
    ------
    DataError
        The bytes are not text; the message names the format they resemble.

    >>> encoding_of("µm".encode("utf-8"), "a.csv"), encoding_of("µm".encode("cp1252"), "a.csv")
    ('utf-8', 'cp1252')
    >>> encoding_of("Głębokość".encode("cp1250"), "a.csv"), encoding_of("pièce, mm³/min".encode("cp1252"), "a.csv")
    ('cp1250', 'cp1252')

    """
    _refuse_signature(data, name)
    encoding = next((codec for bom, codec in _BOMS if data.startswith(bom)), None) or _utf16_without_bom(data)
    if encoding is None:
        encoding = "utf-8" if _decodes(data, "utf-8") else _code_page(data)
    if not encoding.startswith("utf-16") and _has_control_bytes(data):
        raise DataError(
            f"{name} is not text, and no workbook either: it holds {_first_control(data)}. "
            "Export the table as .csv or .xlsx."
        )
    if encoding != "utf-8" and not _decodes(data, encoding):
        raise DataError(
            f"{name} is damaged, or text in an unknown encoding: its bytes are not "
            f"{encoding_name(encoding)}. Save it as CSV UTF-8."
        )
    return encoding


def encoding_name(encoding: str) -> str:
    """Common name of a Python codec, or of the format of a workbook.

    >>> encoding_name("utf-8-sig"), encoding_name("utf-16-le")
    ('UTF-8', 'UTF-16')
    """
    if encoding in FORMATS:
        return FORMATS[encoding]
    return "UTF-16" if encoding.startswith("utf-16") else _ENCODING_NAMES.get(encoding, encoding)


def text_lines(data: bytes, encoding: str) -> Iterator[str]:
    r"""Iterate over the lines of a file, line ends kept (``\n``, ``\r\n`` or ``\r``), not holding its text.

    >>> list(text_lines(b"a\rb", "utf-8"))
    ['a\r', 'b']
    """
    return io.TextIOWrapper(io.BytesIO(data), encoding=encoding, newline="")


def looks_like(data: bytes) -> str:
    """Kind of file that begins with these bytes, or "" when none is recognised.

    >>> looks_like(b"%PDF-1.7")
    'a PDF document'
    """
    return next((kind for magic, kind in _SIGNATURES if data.startswith(magic)), "")


def _absent(path: Path) -> str:
    if path.is_symlink():
        return f"{path} is a link to a file that does not exist."
    near = near_path(path)
    if near is not None:
        return f"{path} does not exist. Did you mean {near.name if near.parent == path.parent else near}?"
    if not path.parent.is_dir():
        return f"{path} does not exist: there is no folder {path.parent}."
    return f"{path} does not exist. Look in {path.parent.resolve()}."


def _refuse_signature(data: bytes, name: str) -> None:
    kind = looks_like(data)
    if kind:
        raise DataError(f"{name} is not a text table, it looks like {kind}. Export the table as .csv or .xlsx.")


def _utf16_without_bom(data: bytes) -> str | None:
    head = data[:4096]
    even, odd = head[::2].count(0), head[1::2].count(0)
    half = max(1, len(head) // 2)
    if odd > 0.4 * half and even < 0.1 * half:
        return "utf-16-le"
    if even > 0.4 * half and odd < 0.1 * half:
        return "utf-16-be"
    return None


def _code_page(data: bytes) -> str:
    """Windows-1250 where the text is Czech, Slovak, Polish or Romanian by its letters, Windows-1252 otherwise."""
    head = data[:_SNIFFED]
    if not _CENTRAL.search(head):
        return "cp1252"
    head = _DIAMETER.sub(b" ", head)
    central = {one for one in head.decode("cp1250", "replace").lower() if one.isalpha() and not one.isascii()}
    western = set(head.decode("cp1252", "replace").lower())
    is_one = len(central - western) >= _FEWEST and any(central.issubset(letters) for letters in _ALPHABETS)
    return "cp1250" if is_one and _decodes(data, "cp1250") else "cp1252"


def _decodes(data: bytes, encoding: str) -> bool:
    decoder = codecs.getincrementaldecoder(encoding)()
    try:
        for start in range(0, len(data), _CHUNK):
            text = decoder.decode(data[start : start + _CHUNK])
            if "\x00" in text:
                return False
        decoder.decode(b"", final=True)
    except UnicodeDecodeError:
        return False
    return True


def _has_control_bytes(data: bytes) -> bool:
    head = data[:_SNIFFED]
    return b"\x00" in data or len(head.translate(None, _CONTROL_BYTES)) < len(head)


def _first_control(data: bytes) -> str:
    place = next(i for i, byte in enumerate(data) if byte in _CONTROL_BYTES)
    return f"the control byte 0x{data[place]:02x} at byte {place + 1}"
