"""Simulated wear tests: the rows that a laboratory would record if the given laws held."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from ..core.arrays import Array, Flags, is_positive
from ..core.display import Displayable
from ..core.errors import DataError, UsageError
from ..core.files import write_whole
from ..core.text import printable, spreadsheet_cell
from .design import round_significant
from .tables.numerals import parse_number
from .vocabulary import ROLES

MOST_ROWS = 10_000_000


class Deviations:
    """Deviations of a simulated response, between edges and between the rows of an edge."""

    __slots__ = ()
    response: str
    sd_edge: float
    sd_row: float
    digits: int

    def _check_deviations(self, unit: str) -> None:
        for name, sd in (("sd_edge", self.sd_edge), ("sd_row", self.sd_row)):
            if not (np.isfinite(sd) and sd >= 0):
                raise UsageError(f"law of {self.response}: {name} {sd:g}; give 0 or more, in {unit}.")
        if self.digits < 1:
            raise UsageError(f"law of {self.response}: digits {self.digits}; give 1 or more.")


def weibull_deviation(z: Array) -> Array:
    """Deviation of ln T of a Weibull life of shape 1 from its median, for standard normal deviates of equal rank.

    >>> weibull_deviation(np.array([0.0, -2.0, 2.0])).round(3).tolist()
    [0.0, -3.405, 1.697]
    """
    from scipy.special import log_ndtr

    return np.asarray(np.log(-log_ndtr(-z)) - np.log(np.log(2.0)))


@dataclass(frozen=True, slots=True, repr=False)
class SimulatedResponse(Deviations, Displayable):
    """A response by any function of the factors, with normal deviations that multiply it or are added to it.

    Parameters
    ----------
    response, unit : str
        such as "Ra" and "um"
    factors : tuple of str
        columns of the design, "t", or responses of earlier laws
    function : callable
        from a mapping of arrays by factor, which broadcast, to the response in `unit`
    sd_edge, sd_row : float
        standard deviations between edges and between the rows of an edge: of ln R, or of R where they add
    adds : bool
        whether deviations are added
    weibull : bool
        whether lives scatter as Weibull ones about their median: `sd_row` is then the reciprocal shape
    digits : int
        significant digits recorded

    Raises
    ------
    UsageError
        for a negative deviation

    Examples
    --------
    >>> line = SimulatedResponse("I", "A", ("VB",), lambda x: 0.1 + 0.5 * x["VB"], 0.0, 0.01, adds=True)
    >>> float(line.recorded({"VB": np.array(0.2)}, 0.0, 1.0))
    0.21

    """

    response: str
    unit: str
    factors: tuple[str, ...]
    function: Callable[[Mapping[str, Array]], Array]
    sd_edge: float
    sd_row: float
    adds: bool = False
    weibull: bool = False
    digits: int = 4

    def __post_init__(self) -> None:
        """Check the numbers once."""
        self._check_deviations(self.unit if self.adds else "natural logs")

    def recorded(self, known: Mapping[str, Array], edge: ArrayLike, row: ArrayLike) -> Array:
        """Values as recorded, for standard normal deviations of edges and rows; arrays broadcast."""
        own = weibull_deviation(np.asarray(row, dtype=np.float64)) if self.weibull else np.asarray(row)
        off = self.sd_edge * np.asarray(edge) + self.sd_row * own
        value = self.function(known)
        return round_significant(value + off if self.adds else value * np.exp(off), self.digits)


@dataclass(frozen=True, slots=True, repr=False)
class SimulatedLaw(Deviations, Displayable):
    """A power law with two lognormal deviations: R = c0 * prod X_j^b_j * exp(edge) * exp(row).

    Parameters
    ----------
    response, unit : str
        such as "AW" and "mm"
    c0 : float
        positive, in the unit that the natural units of the factors imply
    exponents : mapping of factor to exponent
        a factor is a column of the design, "t", or an earlier law's response
    sd_edge, sd_row : float
        standard deviations of ln R between edges and between the rows of an edge, 0 or more
    digits : int
        significant digits recorded

    Raises
    ------
    UsageError
        for a constant that is not positive, a negative deviation, an exponent that is not finite

    Examples
    --------
    >>> wear = SimulatedLaw("AW", "mm", 0.01, {"V": 0.5, "t": 0.25}, sd_edge=0.07, sd_row=0.07)
    >>> round(float(wear.median({"V": 100.0, "t": 16.0})), 9)
    0.2

    """

    response: str
    unit: str
    c0: float
    exponents: Mapping[str, float]
    sd_edge: float
    sd_row: float
    digits: int = 4

    def __post_init__(self) -> None:
        """Check the numbers once."""
        if not is_positive(self.c0):
            raise UsageError(f"law of {self.response}: c0 {self.c0:g}; a power law needs a positive constant.")
        self._check_deviations("natural logs")
        for factor, exponent in self.exponents.items():
            if not np.isfinite(exponent):
                raise UsageError(f"law of {self.response}: exponent {exponent:g} of {factor}; give a finite one.")

    @property
    def factors(self) -> tuple[str, ...]:
        """Factors of the law."""
        return tuple(self.exponents)

    def recorded(self, known: Mapping[str, Array], edge: ArrayLike, row: ArrayLike) -> Array:
        """Values as recorded, for standard normal deviations of edges and rows; arrays broadcast."""
        off = self.sd_edge * np.asarray(edge) + self.sd_row * np.asarray(row)
        return round_significant(self.median(known) * np.exp(off), self.digits)

    def median(self, factors: Mapping[str, ArrayLike]) -> Array:
        """Value without deviations, c0 * prod X_j^b_j; broadcasts over arrays, in `unit`.

        >>> SimulatedLaw("MRR", "mm3/min", 1000, {"V": 1, "f": 1}, 0, 0).median({"V": [50, 60], "f": 0.6})
        array([30000., 36000.])
        """
        log = np.log(self.c0)
        for factor, exponent in self.exponents.items():
            log = log + exponent * np.log(np.asarray(factors[factor], dtype=np.float64))
        return np.asarray(np.exp(log), dtype=np.float64)


def simulate(
    design: pd.DataFrame,
    laws: Sequence[SimulatedLaw | SimulatedResponse],
    *,
    interval: float = 2.0,
    t_max: float = 20.0,
    times: ArrayLike | None = None,
    criterion: float | None = 0.3,
    wear: str = "AW",
    seed: int,
) -> pd.DataFrame:
    """Simulate every edge of a design in sub-tests until its wear reaches the criterion, or to `t_max`.

    Each law has one deviation per edge and one per row; a later law uses an earlier response as it was
    recorded. A longer `t_max`, another `criterion` or a further law leave the other numbers as they are.

    Parameters
    ----------
    design : DataFrame
        one row an edge, with an `edge` column and positive factors, as `central_composite` gives it
    laws : sequence of SimulatedLaw or SimulatedResponse
        in the order in which they depend on each other
    interval, t_max : float
        length of a sub-test and longest time on an edge, min
    times : array, optional
        times of all edges, rising, min, in place of equal sub-tests
    criterion : float or None
        wear at which an edge is worn out (its row is kept), in the unit of `wear`; None cuts to `t_max`
    wear : str
        response that the criterion applies to
    seed : int
        seed of all deviations

    Returns
    -------
    DataFrame, one row a sub-test: edge, the other columns of the design (without run and the coded ones),
    t and the responses; `attrs["units"]` holds the units for `write_csv`

    Raises
    ------
    UsageError
        for an unknown factor or response, or an impossible time
    DataError
        for a design without edges, or with a factor that is not positive

    Examples
    --------
    >>> law = SimulatedLaw("AW", "mm", 0.01, {"V": 0.5, "t": 0.5}, 0, 0)
    >>> simulate(pd.DataFrame({"edge": ["E1"], "V": [100.0]}), [law], criterion=0.2, seed=1)["AW"].tolist()
    [0.1414, 0.2]

    """
    carried = [c for c in design.columns if c not in ("run", "edge") and not str(c).endswith("_coded")]
    factors = [c for c in carried if pd.api.types.is_numeric_dtype(design[c])]
    powers = [law for law in laws if isinstance(law, SimulatedLaw)]
    _check_design(design, [factor for factor in factors if any(factor in law.factors for law in powers)])
    t = _times(interval, t_max, criterion, len(design)) if times is None else _rising(times)
    _check_laws(laws, factors, wear if criterion is not None else None)
    grid = {factor: design[factor].to_numpy(dtype=np.float64)[:, None] for factor in factors}
    written = _responses(laws, {**grid, "t": t[None, :]}, (len(design), len(t)), seed)
    keep = np.ones((len(design), len(t)), dtype=bool) if criterion is None else _kept(written[wear], criterion)
    edge, row = np.nonzero(keep)
    frame = design[["edge", *carried]].iloc[edge].reset_index(drop=True)
    frame = frame.assign(t=t[row], **{name: values[edge, row] for name, values in written.items()})
    usual = {symbol: ROLES[symbol].unit for symbol in ("V", "f", "d", "t")}
    frame.attrs = {"units": usual | {law.response: law.unit for law in laws}}
    return frame


def write_csv(
    frame: pd.DataFrame,
    path_or_buffer: str | Path | TextIO,
    notes: Sequence[str],
    *,
    units: Mapping[str, str] | None = None,
    force: bool = True,
) -> None:
    """Write a lab file: notes as `# ...` lines, then a header such as `V [m/min]`, then the rows.

    Parameters
    ----------
    frame : DataFrame
        any columns; numbers are written in the fewest digits that read back the same
    path_or_buffer : str, Path or text stream
        a file is written completely or not at all
    notes : sequence of str
        one comment each; a line break starts a new comment
    units : mapping of column to unit
        by default `frame.attrs["units"]`; a column without a unit keeps its bare name
    force : bool
        whether a file that has the name is replaced

    Examples
    --------
    >>> import sys
    >>> write_csv(pd.DataFrame({"V": [100.0]}), sys.stdout, ["tool: GC435"], units={"V": "m/min"})
    # tool: GC435
    V [m/min]
    100

    """
    known = frame.attrs.get("units", {}) if units is None else units
    header = [spreadsheet_cell(f"{c} [{known[c]}]" if c in known else str(c)) for c in frame.columns]
    lines = [f"# {printable(line)}".rstrip() for note in notes for line in note.splitlines()]
    body = _without_formulas(frame).to_csv(index=False, header=header, lineterminator="\n", float_format=_shortest)
    text = "".join(f"{line}\n" for line in lines) + body
    if not isinstance(path_or_buffer, str | Path):
        path_or_buffer.write(text)
        return
    write_whole(path_or_buffer, text, force=force)


def _without_formulas(frame: pd.DataFrame) -> pd.DataFrame:
    """The frame with its texts as a spreadsheet may open them; a text that is a number stays as it is."""
    safe = frame.copy()
    for place, kind in enumerate(frame.dtypes):
        if not pd.api.types.is_numeric_dtype(kind):
            safe.isetitem(place, frame.iloc[:, place].map(_text_cell).to_list())
    return safe


def _text_cell(value: object) -> object:
    return spreadsheet_cell(value) if isinstance(value, str) and parse_number(value, "point") is None else value


def _shortest(value: object) -> str:
    return str(value).removesuffix(".0")


def _rising(times: ArrayLike) -> Array:
    """The given times, shape (times,), min."""
    t = np.atleast_1d(np.asarray(times, dtype=np.float64))
    if not (t.ndim == 1 and np.isfinite(t).all() and len(t) and t[0] > 0 and (np.diff(t) > 0).all()):
        raise UsageError("times: give numbers above zero, min, each greater than the one before.")
    return t


def _times(interval: float, t_max: float, criterion: float | None, edges: int) -> Array:
    """List the ends of the sub-tests, shape (times,), min; the tolerance keeps 3 * 0.1 within 0.3."""
    _check_times(interval, t_max, criterion, edges)
    n = int(np.floor(t_max / interval * (1 + 1e-12)))
    return np.asarray(round_significant(interval * np.arange(1, n + 1), 12), dtype=np.float64)


def _responses(
    laws: Sequence[SimulatedLaw | SimulatedResponse], factors: Mapping[str, Array], shape: tuple[int, int], seed: int
) -> dict[str, Array]:
    """Responses as recorded, each of shape (edges, times), every edge to the end."""
    known, written = dict(factors), {}
    for law, stream in zip(laws, np.random.SeedSequence(seed).spawn(len(laws)), strict=True):
        rng = np.random.default_rng(stream)
        of_edge = rng.standard_normal(shape[0])[:, None]
        of_row = rng.standard_normal((shape[1], shape[0])).T  # drawn time by time: more times only add draws
        known[law.response] = written[law.response] = law.recorded(known, of_edge, of_row)
    return written


def _kept(wear: Array, criterion: float) -> Flags:
    """Rows up to and with the first that reaches the criterion, shape (edges, times)."""
    reached = wear >= criterion
    return np.asarray(np.cumsum(reached, axis=1) - reached == 0)


def _check_times(interval: float, t_max: float, criterion: float | None, edges: int) -> None:
    if not is_positive(interval):
        raise UsageError(f"interval {interval:g} min: a sub-test needs a positive length; give one such as 2.")
    if not (np.isfinite(t_max) and t_max >= interval):
        raise UsageError(f"t_max {t_max:g} min is shorter than one sub-test of {interval:g} min; give a longer time.")
    if edges * t_max / interval > MOST_ROWS:
        raise UsageError(
            f"{edges} edges to {t_max:g} min in sub-tests of {interval:g} min are more than {MOST_ROWS} "
            "rows; give a longer interval."
        )
    if criterion is not None and not criterion > 0:
        raise UsageError(f"criterion {criterion:g}: wear is positive; give a positive limit, or None for no limit.")


def _check_laws(laws: Sequence[SimulatedLaw | SimulatedResponse], factors: Sequence[str], wear: str | None) -> None:
    known = [*factors, "t"]
    for law in laws:
        if law.response in known:
            raise UsageError(f"law of {law.response}: that name is taken by a factor or an earlier law; rename it.")
        for factor in law.factors:
            if factor not in known:
                raise UsageError(
                    f"law of {law.response}: factor {factor!r} is none of {', '.join(known)}; "
                    "add it to the design, or put its law first."
                )
        known.append(law.response)
    if not laws:
        raise UsageError("no laws given; a simulated test needs at least one.")
    if wear is not None and wear not in [law.response for law in laws]:
        raise UsageError(
            f"wear {wear!r} is not a simulated response ({', '.join(law.response for law in laws)}); "
            "name one of them, or set criterion=None."
        )


def _check_design(design: pd.DataFrame, factors: Sequence[str]) -> None:
    if "edge" not in design.columns:
        raise DataError("the design has no column 'edge'; give each row of it a label, such as E01.")
    if "t" in design.columns:
        raise DataError("the design has a column 't'; time comes from interval and t_max: leave the column out.")
    if len(design) == 0:
        raise DataError("the design has no rows; a simulated test needs at least one edge.")
    twice = design["edge"][design["edge"].duplicated()]
    if len(twice):
        raise DataError(f"edge {twice.iloc[0]} occurs twice in the design; give each row its own label.")
    for factor in factors:
        bad = design.loc[~(design[factor] > 0), ["edge", factor]]
        if len(bad):
            edge, value = bad.iloc[0]
            raise DataError(f"edge {edge}: {factor} {value:g}; a power law needs positive factors: correct the design.")
