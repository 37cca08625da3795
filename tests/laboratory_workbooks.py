"""Workbooks of rows of cells: .xlsx with what Excel adds, .xls, .ods and .xlsb."""

import io
import struct
import zipfile
from xml.sax.saxutils import escape

import openpyxl


def xlsx(sheets, edit=None):
    """An .xlsx of sheets (title to rows); ``edit`` changes the workbook before it is saved."""
    book = openpyxl.Workbook()
    book.remove(book.active)
    for title, rows in sheets.items():
        page = book.create_sheet(title)
        for row in rows:
            page.append(list(row))
    if edit:
        edit(book)
    buffer = io.BytesIO()
    book.save(buffer)
    return buffer.getvalue()


def xls(rows):
    """An .xls of one sheet."""
    import xlwt

    book = xlwt.Workbook()
    page = book.add_sheet("Data")
    for i, row in enumerate(rows):
        for j, cell in enumerate(row):
            page.write(i, j, cell)
    buffer = io.BytesIO()
    book.save(buffer)
    return buffer.getvalue()


_ODS = (
    '<?xml version="1.0" encoding="UTF-8"?><office:document-content '
    'xmlns:office="urn:oasis:names:tc:opendocument:xmlns:office:1.0" '
    'xmlns:table="urn:oasis:names:tc:opendocument:xmlns:table:1.0" '
    'xmlns:text="urn:oasis:names:tc:opendocument:xmlns:text:1.0" office:version="1.2">'
    '<office:body><office:spreadsheet><table:table table:name="Data">{}</table:table>'
    "</office:spreadsheet></office:body></office:document-content>"
)


def _ods_cell(cell):
    if isinstance(cell, str):
        return f'<table:table-cell office:value-type="string"><text:p>{escape(cell)}</text:p></table:table-cell>'
    value = f'office:value-type="float" office:value="{cell!r}"'
    return f"<table:table-cell {value}><text:p>{cell:g}</text:p></table:table-cell>"


def ods(rows):
    """An .ods of one sheet (OASIS OpenDocument 1.2)."""
    body = "".join(f"<table:table-row>{''.join(map(_ods_cell, row))}</table:table-row>" for row in rows)
    kind = "application/vnd.oasis.opendocument.spreadsheet"
    manifest = (
        '<?xml version="1.0"?><manifest:manifest xmlns:manifest="urn:oasis:names:tc:opendocument:xmlns:manifest:1.0">'
        f'<manifest:file-entry manifest:full-path="/" manifest:media-type="{kind}"/>'
        '<manifest:file-entry manifest:full-path="content.xml" manifest:media-type="text/xml"/></manifest:manifest>'
    )
    return _zip({"mimetype": kind, "content.xml": _ODS.format(body), "META-INF/manifest.xml": manifest})


def _zip(members):
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return buffer.getvalue()


def _record(kind, data=b""):
    """A record of [MS-XLSB] 2.1.4: type and size in 7-bit groups, then the data."""
    head = bytes([kind]) if kind < 128 else bytes([kind & 0x7F | 0x80, kind >> 7])
    size, n = b"", len(data)
    while True:
        size += bytes([n & 0x7F | (0x80 if n > 0x7F else 0)])
        n >>= 7
        if not n:
            return head + size + data


def _wide(string):
    """XLWideString: number of characters, UTF-16."""
    return struct.pack("<I", len(string)) + string.encode("utf-16-le")


def _sheet_bin(rows):
    """BrtBeginSheet .. BrtEndSheet with BrtWsDim, BrtRowHdr, BrtCellReal and BrtCellSt."""
    last = (len(rows) - 1, max(map(len, rows)) - 1)
    out = [_record(129), _record(148, struct.pack("<IIII", 0, last[0], 0, last[1])), _record(145)]
    for i, row in enumerate(rows):
        out.append(_record(0, struct.pack("<IIHHBI", i, 0, 300, 0, 0, 1) + struct.pack("<II", 0, last[1])))
        for j, cell in enumerate(row):
            at = struct.pack("<II", j, 0)
            out.append(
                _record(6, at + _wide(cell)) if isinstance(cell, str) else _record(5, at + struct.pack("<d", cell))
            )
    return b"".join([*out, _record(146), _record(130)])


def xlsb(rows):
    """An .xlsb of one sheet ([MS-XLSB]: Excel (.xlsb) binary file format)."""
    sheet = struct.pack("<II", 0, 1) + _wide("rId1") + _wide("Data")
    book = _record(131) + _record(143) + _record(156, sheet) + _record(144) + _record(132)
    relations = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
    package = "http://schemas.openxmlformats.org/package/2006"
    kind = "application/vnd.ms-excel"

    def links(target, name):
        return (
            f'<?xml version="1.0"?><Relationships xmlns="{package}/relationships"><Relationship Id="rId1" '
            f'Type="{relations}/{name}" Target="{target}"/></Relationships>'
        )

    types = (
        f'<?xml version="1.0"?><Types xmlns="{package}/content-types"><Default Extension="rels" '
        'ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
        f'<Override PartName="/xl/workbook.bin" ContentType="{kind}.sheet.binary.macroEnabled.main"/>'
        f'<Override PartName="/xl/worksheets/sheet1.bin" ContentType="{kind}.worksheet"/></Types>'
    )
    return _zip({
        "[Content_Types].xml": types,
        "_rels/.rels": links("xl/workbook.bin", "officeDocument"),
        "xl/workbook.bin": book,
        "xl/_rels/workbook.bin.rels": links("worksheets/sheet1.bin", "worksheet"),
        "xl/worksheets/sheet1.bin": _sheet_bin(rows),
    })  # fmt: skip
