"""Coverage of the confidence bands of gain and step response, over many records.

    python benchmarks/bands.py [draws]

Output error on the published plant (Tai, Tsai & Li 2023, doi 10.1109/ACCESS.2023.3330587, eq. 17 and 18) with 30 dB of
sensor noise. Aim: 95 % bands of |G| at 0.1, 0.5, 1 and 2 Hz and of the step cover 93 to 97 %.
"""

import sys

import numpy as np
from fitmodels.datasets import Record
from fitmodels.ident.estimators.prediction_error import output_error
from fitmodels.ident.excitation.predicted_precision import predicted_errors
from fitmodels.ident.excitation.signals import chirp
from fitmodels.ident.model import Model
from fitmodels.ident.responses.confidence_bands import response_band, step_band
from fitmodels.ident.responses.frequency import frequency_response

PLANT = Model(b=[0.0, 0.0611, -0.1338, 0.0752], a=[1.0, -2.0311, 1.2104, -0.1655], nk=1, sample_time=0.02)
FREQUENCIES = np.array([0.1, 0.5, 1.0, 2.0])
TIMES = np.array([5, 10, 25, 50, 100, 150])  # samples of 0.02 s


def study(draws, measured):
    u, rng = chirp(), np.random.default_rng(2023)
    x = PLANT.simulate(u)
    sd = np.std(x) * 10 ** (-30 / 20)
    g, step = PLANT.response(FREQUENCIES), PLANT.simulate(np.ones(151))[TIMES]
    gain, phase, by_step, errors, raw = [], [], [], [], []
    for k in range(draws):
        rec = Record(u=u, y=x + sd * rng.standard_normal(len(x)), sample_time=0.02)
        model = output_error(rec, 3, 3)
        band, steps = response_band(model, FREQUENCIES), step_band(model, 3.0)
        gain.append((band.gain_low <= np.abs(g)) & (np.abs(g) <= band.gain_high))
        turn = np.degrees(np.angle(model.response(FREQUENCIES) / g))
        phase.append(np.abs(turn) <= band.phase_high - band.phase)
        by_step.append((steps.low[TIMES] <= step) & (step <= steps.high[TIMES]))
        errors.append(100 * (band.gain / np.abs(g) - 1))
        if k < measured:
            found = frequency_response(rec, FREQUENCIES)
            raw.append((found.gain_low <= np.abs(g)) & (np.abs(g) <= found.gain_high))
    predicted = predicted_errors(PLANT, u, sd, frequency=FREQUENCIES).response
    at = "".join(f"{f:9.1f} Hz" for f in FREQUENCIES)
    print(f"{draws} draws of output error{'':20}{at}")
    for name, rows in (("|G| covered, %", gain), ("phase covered, %", phase)):
        print(f"{name:<44}" + "".join(f"{100 * c:12.1f}" for c in np.mean(rows, axis=0)))
    print(f"{'standard deviation of |G|, %':<44}" + "".join(f"{s:12.3f}" for s in np.std(errors, axis=0)))
    print(f"{'predicted by predicted_errors, %':<44}" + "".join(f"{s:12.3f}" for s in predicted.gain_se))
    if raw:
        print(
            f"{f'measured response, {len(raw)} draws, |G| covered, %':<44}"
            + "".join(f"{100 * c:12.1f}" for c in np.mean(raw, axis=0))
        )
    print(f"{'step':<44}" + "".join(f"{t * 0.02:10.1f} s" for t in TIMES))
    print(f"{'step covered, %':<44}" + "".join(f"{100 * c:12.1f}" for c in np.mean(by_step, axis=0)))


if __name__ == "__main__":
    draws = int(sys.argv[1]) if len(sys.argv) > 1 else 2000
    study(draws, measured=draws // 10)
