"""What a source is asked for: quantities, units, time, speed of replay, security."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite, isnan
from pathlib import Path

from ...core.errors import UsageError
from ...core.suggestions import did_you_mean
from ...datasets.vocabulary import ROLES

CONDITIONS = ("V", "f", "fz", "fm", "d", "ae", "n", "D", "Dc", "z")
PROGRAMMED = {"f_set": "f", "fm_set": "fm"}  # feeds that the override multiplies
OWN = ("time", "state", "tool", "override")


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceOptions:
    """The options of a source.

    Attributes
    ----------
    loads : mapping of str to str
        Symbol of each load and the unit of its law. A source has to give one of them; the first that is not there is
        named.
    needs : tuple of str
        Conditions that the laws need; a table that does not give them is refused.
    given : mapping of str to float
        Conditions that are known without the source.
    map : mapping of str to str
        Column, JSON key, HAL pin or OPC UA node of a quantity: a load, one of `CONDITIONS`, ``f_set`` and ``fm_set``
        (programmed feeds, which ``override`` multiplies), or ``time``, ``state``, ``tool``, ``override``. ``load`` is
        the only load of the laws. A quantity mapped to ``none`` is not read.
    units : mapping of str to str
        Unit of a quantity in the source, where it does not name it itself.
    scales : mapping of str to float
        Factor of a quantity, in its unit here per unit of the source.
    replay : float or None
        Speed of a recorded run: 1 as recorded, 100 a hundred times as fast, infinite without waiting. None: the
        file grows.
    rate : float or None
        Samples per second of a recorded run without times, Hz.
    after : float or None
        Samples of a file up to this time are not given again, s by the clock of the source.
    from_end : bool
        Rows that a growing file already holds are left out.
    silent : float
        s without readings after which a source is lost.
    certificate, key, server_certificate : Path or None
        Of an OPC UA connection with SignAndEncrypt: ours, its private key, and that of the server.
    user : str
    password_file : Path or None
        First line is the password of the user.
    python : str
        Python of LinuxCNC.

    Examples
    --------
    >>> SourceOptions(loads={"P": "kW"}, map={"load": "Spindle power"}).map
    {'P': 'Spindle power'}
    """

    loads: Mapping[str, str] = field(default_factory=dict)
    needs: tuple[str, ...] = ()
    given: Mapping[str, float] = field(default_factory=dict)
    map: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    scales: Mapping[str, float] = field(default_factory=dict)
    replay: float | None = None
    rate: float | None = None
    after: float | None = None
    from_end: bool = False
    silent: float = 5.0
    certificate: Path | None = None
    key: Path | None = None
    server_certificate: Path | None = None
    user: str = ""
    password_file: Path | None = None
    python: str = "/usr/bin/python3"

    def __post_init__(self) -> None:
        for name in ("map", "units", "scales"):
            given = getattr(self, name)
            object.__setattr__(self, name, {self._symbol(symbol, name): value for symbol, value in given.items()})
        for symbol, factor in self.scales.items():
            if not (isfinite(factor) and factor != 0):
                raise UsageError(f"--scale {symbol}={factor:g}: give a factor other than zero.")
        if self.replay is not None and (isnan(self.replay) or self.replay <= 0):
            raise UsageError(f"--replay {self.replay:g}: give a speed above zero, such as 100x, or max.")
        for name in ("rate", "silent"):
            value = getattr(self, name)
            if value is not None and not (isfinite(value) and value > 0):
                raise UsageError(f"--{name} {value:g}: give a number above zero.")

    def target(self, symbol: str) -> str:
        """Unit in which a quantity is given; empty for one without a unit."""
        role = ROLES.get(PROGRAMMED.get(symbol, symbol))
        return self.loads.get(symbol) or (role.unit if role else "")

    def _symbol(self, symbol: str, name: str) -> str:
        known = (*self.loads, *CONDITIONS, *PROGRAMMED, *OWN)
        if symbol == "load" and "load" not in self.loads:
            if len(self.loads) != 1:
                raise UsageError(
                    f"'load' is open: the laws have {', '.join(self.loads) or 'no load'}. Give the symbol, as in "
                    f"{next(iter(self.loads), 'P')}=..."
                )
            return next(iter(self.loads))
        if symbol not in known:
            option = {"map": "map", "units": "unit", "scales": "scale"}[name]
            raise UsageError(f"--{option} {symbol}=...: no quantity {symbol!r}. {did_you_mean(symbol, known)}")
        return symbol
