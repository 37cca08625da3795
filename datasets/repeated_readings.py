"""Columns of repeated readings of one response (Ra1, Ra2, Ra3), and the column of their means."""

import re
from collections.abc import Mapping

import numpy as np

from .headers import parse_header
from .tables import Column
from .units import canonical
from .vocabulary import ROLES, role_of, role_of_mean

_NUMBERED = re.compile(r"(?P<stem>.*?\D)[\s_#.-]*\d{1,2}")
KINDS = ("load", "surface")  # readings of wear in several columns are of several times or edges
MOST = 12


def with_means(columns: tuple[Column, ...], mapping: Mapping[str, str]) -> tuple[tuple[Column, ...], tuple[str, ...]]:
    """The columns, with a further one of the means of repeated readings, and a sentence on each.

    Readings are columns of numbers whose headers are one force, power, temperature or roughness with different
    numbers, and the same unit. Nothing is added where a column of that response is there or assigned by ``mapping``.

    Examples
    --------
    >>> names = ("Ra1 [um]", "Ra2 [um]")
    >>> columns = tuple(Column(i, name, "", np.array([i, 3.0]), True) for i, name in enumerate(names, 1))
    >>> found, said = with_means(columns, {})
    >>> found[-1].name, found[-1].values.tolist(), said
    ('Ra [um]', [1.5, 3.0], ("Ra is the mean of the readings in columns 'Ra1 [um]' and 'Ra2 [um]' of each row",))
    """
    held, families = set(mapping), dict[tuple[str, str], list[Column]]()
    for column in columns:
        header = parse_header(column.name)
        text = column.unit_cell or header.unit_text
        unit = canonical(text) if text else None
        role = role_of(header.name, unit) or role_of_mean(header.name, unit)
        if role is not None:
            held.add(role)
        elif reading := _reading(column, header.name, unit):
            families.setdefault((reading, text), []).append(column)
    roles = [role for role, _ in families]
    found = {
        key: each for key, each in families.items()
        if 2 <= len(each) <= MOST and key[0] not in held and roles.count(key[0]) == 1
    }  # fmt: skip
    means = tuple(_mean(key, each, len(columns) + i) for i, (key, each) in enumerate(found.items(), 1))
    return (*columns, *means), tuple(_said(role, each) for (role, _), each in found.items())


def _reading(column: Column, name: str, unit: str | None) -> str:
    """Symbol of the response of which a numbered column is a reading, empty where it is none."""
    match = _NUMBERED.fullmatch(name)
    role = role_of(match["stem"], unit) if match and column.is_numeric and not column.bad else None
    return role if role is not None and ROLES[role].kind in KINDS else ""


def _mean(key: tuple[str, str], each: list[Column], number: int) -> Column:
    values = np.array([column.values for column in each], dtype=float)
    known = np.isfinite(values).sum(axis=0)
    sums = np.where(np.isfinite(values), values, 0.0).sum(axis=0)
    mean = np.divide(sums, known, out=np.full(len(sums), np.nan), where=known > 0)
    return Column(number, f"{key[0]} [{key[1]}]" if key[1] else key[0], "", mean, True)


def _said(role: str, each: list[Column]) -> str:
    names = [repr(column.name) for column in each]
    return f"{role} is the mean of the readings in columns {', '.join(names[:-1])} and {names[-1]} of each row"
