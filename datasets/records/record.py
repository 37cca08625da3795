"""Record of evenly sampled input and output, in stretches that no regressor may cross."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ...core.arrays import Array, is_positive
from ...core.display import Display, Plottable, as_columns
from ...core.errors import DataError, IdentError
from ...core.rounding import count, format_plain

if TYPE_CHECKING:
    from ...core.display import Frame


CLOCKS = 1e-3  # two clocks differ by parts in 1e5; smaller differences do not affect the poles of a model


@dataclass(frozen=True, slots=True, repr=False)
class Record(Plottable):
    """Input u and output y at a fixed rate.

    Attributes
    ----------
    u, y : ndarray, shape (N,)
        In ``unit_u`` and ``unit_y``, less the ``offsets``; finite.
    sample_time : float
        Seconds between samples.
    starts : tuple of int
        First sample of each stretch: a run of its own, or what follows a gap. The first is 0.
    offsets : ndarray, shape (stretches, 2)
        Operating point subtracted from u and y of each stretch.
    input, output, unit_u, unit_y : str
        Names and units.
    source, sha256 : str or None
        File, and hash of its bytes (of the numbers, where there is no file; of the hashes, where there are several).
    notes : tuple of str
        Assumptions and corrections made when reading.
    reference : ndarray, shape (N,), or None
        Reference of the controller that was active, less its mean in each stretch of a centred record.

    Examples
    --------
    >>> rec = Record(u=[0.0, 1.0, 1.0, 1.0], y=[0.0, 0.0, 0.5, 0.75], sample_time=0.02)
    >>> len(rec), rec.rate
    (4, 50.0)
    """

    u: Array
    y: Array
    sample_time: float
    starts: tuple[int, ...] = (0,)
    offsets: Array | None = None
    input: str = "u"
    output: str = "y"
    unit_u: str = ""
    unit_y: str = ""
    source: str | None = None
    sha256: str | None = None
    notes: tuple[str, ...] = ()
    reference: Array | None = None

    def __post_init__(self) -> None:
        u, y = (np.ascontiguousarray(a, dtype=np.float64) for a in (self.u, self.y))
        if u.ndim != 1 or u.shape != y.shape or not u.size:
            raise DataError(
                f"input has shape {u.shape} and output {y.shape}; a record needs one column of each, of one length."
            )
        for name, values in ((self.input, u), (self.output, y)):
            if not np.isfinite(values).all():
                k = int(np.flatnonzero(~np.isfinite(values))[0])
                raise DataError(
                    f"{name} is {values[k]} at sample {k}: a record holds numbers only. Leave the gap out and let what "
                    "follows be a separate segment (starts)."
                )
        if self.reference is not None:
            object.__setattr__(self, "reference", _checked_reference(self.reference, u))
        if not is_positive(self.sample_time):
            raise DataError(f"sample_time {self.sample_time!r} s: it must be above zero, for instance 0.02 for 50 Hz.")
        starts = tuple(int(s) for s in self.starts)
        if starts[:1] != (0,) or any(b <= a for a, b in zip(starts, (*starts[1:], len(u)), strict=True)):
            raise DataError(f"starts {starts} of {len(u)} samples: they rise from 0, each below the number of samples.")
        offsets = np.zeros((len(starts), 2)) if self.offsets is None else np.asarray(self.offsets, dtype=np.float64)
        if offsets.shape != (len(starts), 2):
            raise DataError(f"offsets have shape {offsets.shape}; {len(starts)} stretches need ({len(starts)}, 2).")
        for name, value in (("u", u), ("y", y), ("starts", starts), ("offsets", offsets)):
            object.__setattr__(self, name, value)
        if self.sha256 is None:
            object.__setattr__(self, "sha256", hashlib.sha256(u.tobytes() + y.tobytes()).hexdigest())

    def __len__(self) -> int:
        return len(self.u)

    def _display(self) -> Display:
        ends = [
            f"{name} {format_plain(float(v.min()))} to {format_plain(float(v.max()))} {unit}".rstrip()
            for name, v, unit in ((self.input, self.u, self.unit_u), (self.output, self.y, self.unit_y))
        ]
        several = f" in {len(self.starts)} stretches" if len(self.starts) > 1 else ""
        span = f"{format_plain(len(self) * self.sample_time)} s at {format_plain(self.rate)} Hz"
        facts = (("from", self.source),) if self.source else ()
        return Display(f"{len(self)} samples{several}, {span}; {', '.join(ends)}", facts, None, self.notes)

    def to_frame(self) -> "Frame":
        """One row per sample: time in s, input and output under their names, and the number of the stretch."""
        from pandas import Index

        stretch = np.repeat(np.arange(len(self.starts)), np.diff([*self.starts, len(self)]))
        held = {self.input: self.u, self.output: self.y, "stretch": stretch}
        return as_columns(self, **held).set_index(Index(self.sample_time * np.arange(len(self)), name="time"))

    @property
    def rate(self) -> float:
        """Samples per second, Hz."""
        return 1.0 / self.sample_time

    @property
    def stretches(self) -> tuple[slice, ...]:
        """Samples of each stretch."""
        ends = (*self.starts[1:], len(self))
        return tuple(slice(start, end) for start, end in zip(self.starts, ends, strict=True))

    def part(self, start: int, stop: int) -> "Record":
        """Samples ``start`` up to, not with, ``stop``."""
        if not 0 <= start < stop <= len(self):
            raise DataError(f"samples {start} to {stop} of a record of {len(self)}: 0 <= start < stop <= {len(self)}.")
        kept = [k for k, s in enumerate(self.stretches) if s.start < stop and s.stop > start]
        starts = tuple(max(self.stretches[k].start - start, 0) for k in kept)
        assert self.offsets is not None  # noqa: S101  set in __post_init__
        return replace(
            self, u=self.u[start:stop], y=self.y[start:stop], starts=starts, offsets=self.offsets[kept], sha256=None,
            reference=None if self.reference is None else self.reference[start:stop],
        )  # fmt: skip

    def centred(self, trend: bool = False) -> "Record":
        """The record minus the mean (with ``trend``, the line) of each stretch, which ``offsets`` keeps."""
        u, y = self.u.copy(), self.y.copy()
        reference = None if self.reference is None else self.reference.copy()
        assert self.offsets is not None  # noqa: S101
        offsets = np.column_stack([self.offsets, np.zeros(len(self.starts))])
        for k, s in enumerate(self.stretches):
            for j, values in enumerate((u, y) if reference is None else (u, y, reference)):
                mean = values[s].mean()
                offsets[k, j] += mean
                values[s] -= mean
                if trend and s.stop - s.start > 1:
                    time = np.arange(s.stop - s.start) - (s.stop - s.start - 1) / 2
                    values[s] -= time * (time @ values[s]) / (time @ time)
        return replace(self, u=u, y=y, offsets=offsets[:, :2], reference=reference)

    def less(self, u: float, y: float) -> "Record":
        """The record minus one operating point for all stretches, which ``offsets`` keeps.

        >>> rec = Record(u=[2.0, 3.0], y=[10.0, 11.0], sample_time=0.1).less(2.0, 10.0)
        >>> rec.u.tolist(), rec.offsets.tolist()
        ([0.0, 1.0], [[2.0, 10.0]])
        """
        if not np.isfinite([u, y]).all():
            raise DataError(f"operating point ({u}, {y}): two finite numbers, in the units of input and output.")
        assert self.offsets is not None  # noqa: S101
        return replace(self, u=self.u - u, y=self.y - y, offsets=self.offsets + np.array([u, y]))

    def decimated(self, k: int) -> "Record":
        """Every k-th sample after a zero-phase anti-alias filter, applied to each stretch separately.

        Input and output pass the same filter, so that the relation between them is unchanged; 80 % of the new half rate
        passes unchanged. Stretches of fewer than 3 new samples are left out, with a note.

        Raises
        ------
        DataError
            k is not a whole number of 1 or more, or no segment is long enough.

        Examples
        --------
        >>> slow = Record(u=np.arange(100.0), y=np.ones(100), sample_time=0.01).decimated(5)
        >>> len(slow), slow.sample_time, slow.u[:3].round(6).tolist()
        (20, 0.05, [0.0, 5.0, 10.0])
        """
        if k != int(k) or k < 1:
            raise DataError(f"decimation by {k!r}: a whole number of 1 or more.")
        return self if k == 1 else self._at(1, int(k))

    def resampled(self, rate: float) -> "Record":
        """At another rate in Hz: a ratio of whole numbers to the present one, up or down, filtered as `decimated`.

        Examples
        --------
        >>> rec = Record(u=np.arange(100.0), y=np.ones(100), sample_time=0.01).resampled(40.0)
        >>> len(rec), rec.sample_time
        (40, 0.025)
        """
        from .resampling import ratio_of

        ratio = ratio_of(rate, self.sample_time)
        return self if ratio == 1 else self._at(ratio.numerator, ratio.denominator)

    def _at(self, up: int, down: int) -> "Record":
        from .resampling import KEPT, rational

        assert self.offsets is not None  # noqa: S101
        kept = [i for i, s in enumerate(self.stretches) if (s.stop - s.start - 1) * up // down + 1 >= 3]
        if not kept:
            raise DataError(
                f"no segment of this record has 3 samples left at {self.rate * up / down:g} Hz: the longest has "
                f"{max(s.stop - s.start for s in self.stretches)} at {self.rate:g} Hz."
            )
        signals = (self.u, self.y) if self.reference is None else (self.u, self.y, self.reference)
        parts = [[rational(x[self.stretches[i]], up, down) for x in signals] for i in kept]
        begins = np.concatenate([[0], np.cumsum([len(part[0]) for part in parts])])[:-1]
        slower = min(1.0, up / down)
        notes = [
            f"resampled from {self.rate:.6g} to {self.rate * up / down:.6g} Hz; the band below "
            f"{KEPT * slower * self.rate / 2:.4g} Hz is kept, that above {slower * self.rate / 2:.4g} Hz removed"
        ]
        if len(kept) < len(self.starts):
            notes.append(f"{count(len(self.starts) - len(kept), 'segment')} too short for the new rate left out")
        return replace(
            self,
            u=np.concatenate([part[0] for part in parts]),
            y=np.concatenate([part[1] for part in parts]),
            sample_time=self.sample_time * down / up,
            starts=tuple(int(b) for b in begins),
            offsets=self.offsets[kept],
            sha256=None,
            notes=(*self.notes, *notes),
            reference=None if self.reference is None else np.concatenate([part[2] for part in parts]),
        )


def _checked_reference(reference: Array, u: Array) -> Array:
    """The reference as an array of the shape of the input; DataError if it is not one of finite numbers."""
    values = np.ascontiguousarray(reference, dtype=np.float64)
    if values.shape != u.shape:
        raise DataError(f"reference has shape {values.shape}, input {u.shape}; a record needs one value per sample.")
    if not np.isfinite(values).all():
        k = int(np.flatnonzero(~np.isfinite(values))[0])
        raise DataError(f"reference is {values[k]} at sample {k}: a record holds numbers only. Leave the gap out.")
    return values


def join_records(records: Sequence[Record]) -> Record:
    """Several records of one machine as one, each a stretch of its own.

    Examples
    --------
    >>> rec = Record(u=[0.0, 1.0], y=[0.0, 0.5], sample_time=0.1)
    >>> join_records([rec, rec]).starts
    (0, 2)
    """
    if not records:
        raise DataError("no record to join; give at least one.")
    first = records[0]
    for other in records[1:]:
        if not np.isclose(other.sample_time, first.sample_time, rtol=CLOCKS):
            raise DataError(
                f"one record is sampled every {first.sample_time:g} s, another every {other.sample_time:g} s: they "
                "cannot be joined. Resample one of them."
            )
        if (other.unit_u, other.unit_y) != (first.unit_u, first.unit_y):
            raise DataError(
                f"one record is in {first.unit_u!r} and {first.unit_y!r}, another in {other.unit_u!r} and "
                f"{other.unit_y!r}: bring them to the same units."
            )
    begin = np.concatenate([[0], np.cumsum([len(rec) for rec in records])])
    sources = dict.fromkeys(rec.source for rec in records if rec.source)
    references = [rec.reference for rec in records if rec.reference is not None]
    if references and len(references) < len(records):
        raise DataError(
            f"{len(references)} of {len(records)} records have a reference: runs that are joined are all of one loop, "
            "or all of the open loop. Identify them separately."
        )
    hashes = "".join(rec.sha256 or "" for rec in records)
    return replace(
        first,
        u=np.concatenate([rec.u for rec in records]),
        y=np.concatenate([rec.y for rec in records]),
        starts=tuple(int(b + s) for b, rec in zip(begin[:-1], records, strict=True) for s in rec.starts),
        offsets=np.vstack([rec.offsets for rec in records if rec.offsets is not None]),
        source=" + ".join(sources) or None,
        sha256=hashlib.sha256(hashes.encode()).hexdigest(),
        notes=tuple(dict.fromkeys(note for rec in records for note in rec.notes)),
        reference=np.concatenate(references) if references else None,
    )


def averaged_over(rec: Record, samples: int) -> Record:
    """The record with command and force averaged over a number of samples, which leaves their relation unchanged.

    Stretches of fewer samples than three averages are left out.

    Examples
    --------
    >>> averaged_over(Record(u=[1.0, 3.0, 5.0, 7.0, 9.0, 1.0], y=np.ones(6), sample_time=0.1), 2).u.tolist()
    [2.0, 4.0, 6.0, 8.0, 5.0]
    """
    kept = [k for k, s in enumerate(rec.stretches) if s.stop - s.start >= 3 * samples]
    if not kept:
        raise IdentError(
            f"a revolution of {samples * rec.sample_time:.4g} s is more than a third of the record; record longer, or "
            "leave out the spindle speed."
        )
    weights, parts = np.full(samples, 1 / samples), [rec.stretches[k] for k in kept]
    u, y = ([np.convolve(row[s], weights, "valid") for s in parts] for row in (rec.u, rec.y))
    starts = np.cumsum([0, *map(len, u)])[:-1]
    assert rec.offsets is not None  # noqa: S101
    return replace(
        rec, u=np.concatenate(u), y=np.concatenate(y), starts=tuple(map(int, starts)), offsets=rec.offsets[kept],
        sha256=None, reference=None,
    )  # fmt: skip
