"""Typed cells of a workbook -> numbers or unambiguous text."""

import datetime
import re

from .numerals import Cell

_QUOTED = re.compile(r'"[^"]*"|\\.|\[(?!h+\]|m+\]|s+\])[^\]]*\]', re.IGNORECASE)
_DAY = 86_400.0  # seconds
_YEAR = 365.0  # days; a serial number above it is a date, even where its format shows the hours only


def cell_of(value: object) -> Cell:
    """A stored value as a number or text: times as ``h:mm`` or ``h:mm:ss``, dates as in ISO 8601.

    >>> cell_of(datetime.time(0, 2, 30)), cell_of(datetime.date(2024, 3, 1)), cell_of(3), cell_of(None)
    ('0:02:30', '2024-03-01', 3.0, '')
    """
    if value is None:
        return ""
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        return float(value)
    if isinstance(value, str):
        return value
    if isinstance(value, datetime.timedelta):
        return time_text(value.total_seconds())
    if isinstance(value, datetime.datetime):
        since = value.replace(tzinfo=None) - datetime.datetime(1899, 12, 30)
        if since.days < _YEAR:  # a length of time that a format of dates was given to
            return time_text(since.total_seconds())
        return value.isoformat(" ").removesuffix(" 00:00:00")
    if isinstance(value, datetime.time):
        return time_text(3600 * value.hour + 60 * value.minute + value.second + value.microsecond / 1e6)
    return value.isoformat() if isinstance(value, datetime.date) else str(value)


def time_text(seconds: float, with_seconds: bool | None = None) -> str:
    """A length of time as ``h:mm:ss``, or as ``h:mm`` where it is whole minutes.

    >>> time_text(9000.0), time_text(150.5), time_text(9000.0, with_seconds=True)
    ('2:30', '0:02:30.5', '2:30:00')
    """
    sign, whole = "-" if seconds < 0 else "", round(abs(seconds), 3)
    hours, rest = divmod(whole, 3600)
    minutes, left = divmod(rest, 60)
    text = f"{sign}{int(hours)}:{int(minutes):02}"
    if with_seconds is None:
        with_seconds = left > 0
    return (
        f"{text}:{left:06.3f}".rstrip("0").rstrip(".")
        if with_seconds and left % 1
        else (f"{text}:{int(left):02}" if with_seconds or left else text)
    )


def is_length_of_time(code: str, serial: float) -> bool:
    """Whether a number of days is shown as hours, minutes or seconds without a date.

    >>> is_length_of_time("[h]:mm:ss", 1.9), is_length_of_time("dd/mm/yy", 0.5), is_length_of_time("h:mm", 45000.4)
    (True, False, False)
    """
    plain = _QUOTED.sub("", code.split(";")[0]).lower()
    return abs(serial) < _YEAR and not set("dy") & set(plain) and bool(set("hs:") & set(plain) or "[m" in plain)


def shown_time(code: str, serial: float) -> str:
    """A number of days as the time that a number format shows, with seconds where the format has them.

    >>> shown_time("h:mm", 0.10416666666666667), shown_time("mm:ss", 0.10416666666666667)
    ('2:30', '2:30:00')
    """
    plain = _QUOTED.sub("", code.split(";")[0]).lower()
    return time_text(serial * _DAY, with_seconds="s" in plain or None)
