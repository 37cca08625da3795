"""The dynamics section: an identified model that simulates and answers in frequency from the file alone.

    y(t) = b(q) / a(q) u(t) + noise,    b(q) = b_nk q^-nk + ...,    a(q) = 1 + a_1 q^-1 + ...

Source: Ljung 1999, System Identification, section 4.2. ``nk`` counts as MATLAB does; Octave's arx counts one less.
"""

from typing import Annotated, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, model_validator

from ...core.display import Plottable
from ...core.errors import ParameterError
from .base import Count, NotNegative, Number, Positive, Section, Sha256, Text
from .covariance import ModelCovariance, NoCovariance

Array = NDArray[np.float64]
Polynomial = Annotated[tuple[Number, ...], Field(min_length=1, max_length=100)]  # roots take time with the cube


class DynamicsSection(Plottable, Section):
    """An identified model of the feed drive and the cut.

    Attributes
    ----------
    structure : str
        How it was estimated: ``arx``, ``sriv``, ``output_error``, ``armax``; ``given``.
    b, a, c : tuple of float
        Whole polynomials in z^-1: b keeps its nk leading zeros, a and the noise polynomial c start with 1.
    nk : int
        Samples of delay.
    sample_time : float
        Seconds.
    input, output, unit_u, unit_y : str
    uncertainty : ModelCovariance or NoCovariance
        Of a1 ... and the coefficients of b from b<nk> on.
    noise_variance : float or None
        In unit_y squared.
    n, record_sha256
        Samples it was fitted to, and the checksum of their record.
    operating_point : tuple of float or None
        Mean input and output that were taken off before the fit.
    band : tuple of float or None
        Hz that the record excited: outside the model has seen nothing.
    held_out_fit : float or None
        Per cent of the output of a record it was not fitted to that a free run explains, 100 (1 - rms error / rms);
        ``held_out_sha256`` is the checksum of that record.
    notes : tuple of str

    Examples
    --------
    >>> given = {"kind": "none", "reason": "given"}
    >>> model = DynamicsSection(b=[0.0, 0.5], a=[1.0, -0.5], nk=1, sample_time=0.1, uncertainty=given)
    >>> model.simulate([1.0, 1.0, 1.0]).tolist(), model.dc_gain, model.stable
    ([0.0, 0.5, 0.75], 1.0, True)
    """

    structure: Text = "given"
    b: Polynomial
    a: Polynomial
    c: Polynomial = (1.0,)
    nk: Count
    sample_time: Positive
    input: str = "u"
    output: str = "y"
    unit_u: str = ""
    unit_y: str = ""
    uncertainty: Annotated[ModelCovariance | NoCovariance, Field(discriminator="kind")]
    noise_variance: NotNegative | None = None
    n: Count | None = None
    record_sha256: Sha256 | None = None
    operating_point: tuple[Number, Number] | None = None
    band: tuple[NotNegative, NotNegative] | None = None
    held_out_fit: Number | None = None
    held_out_sha256: Sha256 | None = None
    notes: tuple[str, ...] = ()

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.a[0] != 1 or self.c[0] != 1:
            raise ValueError(f"a and c start with 1, not with {self.a[0]:g} and {self.c[0]:g}")
        if len(self.b) <= self.nk or any(self.b[: self.nk]):
            raise ValueError(f"b with nk {self.nk} begins with {self.nk} zeros, then its coefficients")
        if self.band is not None and not self.band[0] < self.band[1]:
            raise ValueError(f"the band {self.band[0]:g} to {self.band[1]:g} Hz has its ends the wrong way round")
        if isinstance(self.uncertainty, ModelCovariance) and set(self.uncertainty.of) != set(self.names):
            raise ValueError(f"the covariance must be of {', '.join(self.names)}")
        return self

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the coefficients that were estimated: a1 ..., then b<nk> ..."""
        return (*(f"a{i}" for i in range(1, len(self.a))), *(f"b{j}" for j in range(self.nk, len(self.b))))

    @property
    def poles(self) -> NDArray[np.complex128]:
        """Roots of a, in z."""
        return np.asarray(np.roots(self.a), dtype=np.complex128)

    @property
    def stable(self) -> bool:
        """Whether a free run dies out: every pole inside the unit circle."""
        return bool((np.abs(self.poles) < 1).all())

    @property
    def dc_gain(self) -> float:
        """Response to a constant input of 1, unit_y per unit_u; infinite for an integrator."""
        above, below = float(np.sum(self.b)), float(np.sum(self.a))
        return above / below if below else float(np.copysign(np.inf, above))

    def response(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """G at frequencies in Hz, complex, the shape of ``frequency``."""
        z = np.exp(-2j * np.pi * np.asarray(frequency, dtype=np.float64) * self.sample_time)
        return np.asarray(np.polyval(self.b[::-1], z) / np.polyval(self.a[::-1], z), dtype=np.complex128)

    def simulate(self, u: ArrayLike) -> Array:
        """Free run from rest.

        Parameters
        ----------
        u : array_like, shape (n,)
            Input in unit_u, less the operating point; a value each sample_time.

        Returns
        -------
        ndarray, shape (n,)
            Output in unit_y, less the operating point.

        Raises
        ------
        ParameterError
            The input is no row of finite numbers, or the run leaves all bounds.
        """
        from scipy.signal import lfilter

        given = np.asarray(u, dtype=np.float64)
        if given.ndim != 1 or not np.isfinite(given).all():
            raise ParameterError(f"an input of shape {given.shape}: a simulation takes a row of finite numbers.")
        with np.errstate(all="ignore"):
            out = np.asarray(lfilter(self.b, self.a, given), dtype=np.float64)
        if not np.isfinite(out).all():
            raise ParameterError(
                "the simulation leaves all bounds: the model is not stable, or the input far too large."
            )
        return out
