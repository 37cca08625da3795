"""Times of day, with or without a date, as loggers write them -> seconds."""

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

DAY = 86400.0
_CLOCK = re.compile(
    r"(?:(?P<date>\d[\d./ -]*\d)[T ,;]+)?(?:(?P<h>\d{1,2}):)?(?P<m>\d{1,2}):(?P<s>\d{1,2}(?:[.,]\d+)?)"
    r"(?:\s*(?P<half>[AP])\.?M\.?)?(?:Z|[+-]\d\d:?\d\d)?",
    re.IGNORECASE,
)


def clock_seconds(texts: Sequence[str]) -> NDArray[np.float64] | None:
    """Seconds since the first midnight, shape (n,), nan where a text is empty; None when one is no time.

    A date counts only by its change, which is one day on: so 01.03. and 03/01 need not be told apart. A fall of
    more than half a day is midnight.

    >>> clock_seconds(["23:59:59,5", "00:00:00,0"]), clock_seconds(["1.3.24 11:59:59.5 PM", "2.3.24 12:00:00 AM"])
    (array([86399.5, 86400. ]), array([86399.5, 86400. ]))
    """
    out = np.full(len(texts), np.nan)
    days, today, before = 0, None, -1.0
    for i, text in enumerate(texts):
        if not text.strip():
            continue
        match = _CLOCK.fullmatch(text.strip())
        if match is None:
            return None
        if match["date"] != today:
            days, today = days + (today is not None), match["date"]
        hours = int(match["h"] or 0)
        if match["half"]:
            hours = hours % 12 + (12 if match["half"] in "Pp" else 0)
        seconds = 3600 * hours + 60 * int(match["m"]) + float(match["s"].replace(",", "."))
        if match["date"] is None and seconds < before - DAY / 2:
            days += 1
        out[i], before = days * DAY + seconds, seconds
    return out
