"""The run that the published estimates come from: feed command and force of the assumed plant, simulated."""

from typing import TYPE_CHECKING

import numpy as np

from .process import DriveAndCut

if TYPE_CHECKING:
    from ...datasets import Record

STEP, DURATION = 0.004, 20.0  # s; an odd number of samples in a revolution of 20 ms, the ripple below half the rate
FEED, SWING, BAND = 250.0, 100.0, (0.1, 5.0)  # mm/min, mm/min, Hz
DEPTH, RIPPLE, NOISE = 2.0, 0.3, 2.0  # mm, share, N


def identification_run(seed: int = 1) -> "Record":
    """A chirp of the feed at 2 mm depth, 30 % ripple at tooth frequency and 2 N of noise on the force: simulated.

    Returns
    -------
    Record
        Feed command in mm/min and force in N, 5000 samples of 4 ms from rest.

    Examples
    --------
    >>> rec = identification_run()
    >>> len(rec), rec.unit_u, float(rec.y[0])
    (5000, 'mm/min', 0.0)
    """
    from ...datasets import Record
    from ...ident import chirp

    u = chirp(SWING, *BAND, DURATION, 1 / STEP, offset=FEED)
    plant, noise = DriveAndCut(DEPTH, ripple=RIPPLE, noise=NOISE), np.random.default_rng(seed)
    F = [0.0, *(plant.step(float(command), STEP, noise) for command in u[:-1])]
    return Record(
        u=u, y=np.array(F), sample_time=STEP, input="feed command", output="F", unit_u="mm/min", unit_y="N"
    )  # fmt: skip
