"""Excitations against their equations and known properties, their limits, the files they become, what they foretell."""

import numpy as np
import pytest
from fitmodels.core.errors import IdentError, UsageError
from fitmodels.datasets import Record, read_record
from fitmodels.ident.estimators.prediction_error import output_error
from fitmodels.ident.excitation.files import write_excitation
from fitmodels.ident.excitation.predicted_precision import predicted_errors
from fitmodels.ident.excitation.signals import TAPS, chirp, crest_factor, multisine, prbs, shift_register, steps
from fitmodels.ident.model import Model
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.io import loadmat
from scipy.signal import chirp as scipy_chirp

PLANT = Model(b=[0.0, 0.0611, -0.1338, 0.0752], a=[1.0, -2.0311, 1.2104, -0.1655], nk=1, sample_time=0.02)


def test_linear_chirp_is_equation_17_of_clm_2023():
    t = np.arange(750) / 50
    expected = 2.5 * np.sin(2 * np.pi * (0.1 + (2.0 - 0.1) / (2 * 15) * t) * t)  # doi 10.1109/ACCESS.2023.3330587
    assert chirp() == pytest.approx(expected, abs=1e-12)  # 24 rad of phase in double precision


@pytest.mark.parametrize("kind", ["linear", "logarithmic"])
def test_chirps_are_those_of_scipy(kind):
    t = np.arange(3000) / 200
    expected = 1.5 * scipy_chirp(t, 0.2, 15.0, 20.0, method=kind, phi=-90) + 3
    assert chirp(1.5, 0.2, 20.0, 15, 200, kind=kind, offset=3) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("order", TAPS)
def test_every_shift_register_has_the_longest_period(order):
    # Golomb: one period of a maximum-length sequence has autocorrelation -1 at every shift
    period = 2**order - 1
    bits = shift_register(order, 5, 2 * period)
    x = 2.0 * bits[:period] - 1
    shifted = np.fft.irfft(np.abs(np.fft.rfft(x)) ** 2, period)[1:]
    assert np.array_equal(bits[:period], bits[period:])
    assert np.abs(shifted + 1).max() < 1e-6


def test_prbs_holds_and_starts_where_its_seed_says():
    u = prbs(2.0, 10, 50, hold=0.1, offset=1, seed=7)
    assert set(u) == {-1.0, 3.0}
    assert (np.flatnonzero(np.diff(u)) % 5 == 4).all()
    assert not np.array_equal(u, prbs(2.0, 10, 50, hold=0.1, offset=1, seed=8))


def test_multisine_has_power_at_its_lines_only_and_a_low_crest():
    lines = np.arange(1, 31) / 15
    u = multisine(2.5, lines, 15, 50)
    power = np.abs(np.fft.rfft(u)) ** 2
    assert power[1:31] == pytest.approx(power[1:31].mean(), rel=1e-9)
    assert power[31:].max() < 1e-20 * power.max()
    # Schroeder 1970: about 1.7 for flat spectra; in phase they would have sqrt(2 * 30) = 7.7
    assert np.abs(u).max() == pytest.approx(2.5)
    assert crest_factor(u) < 2


LIMITED = {
    "level": (lambda **k: chirp(2.5, **k), {"high": 2.0}),
    "low level": (lambda **k: chirp(2.5, offset=5, **k), {"low": 3.0}),
    "rate": (lambda **k: chirp(2.5, **k), {"max_rate": 20.0}),
    "rate of steps": (lambda **k: steps([0, 1], 0.1, **k), {"max_rate": 10.0}),
}


@pytest.mark.parametrize("what", LIMITED)
def test_beyond_a_limit_is_refused_or_made_smaller_as_a_whole(what):
    make, limits = LIMITED[what]
    with pytest.raises(IdentError, match=r"limit .*scale"):
        make(**limits)
    full, small = make(), make(**limits, limit="scale")
    offset = 5.0 if what == "low level" else 0.0
    assert small.max() <= limits.get("high", np.inf) + 1e-12
    assert small.min() >= limits.get("low", -np.inf) - 1e-12
    assert np.abs(np.diff(small)).max() * 50 <= limits.get("max_rate", np.inf) + 1e-9
    ratio = np.ptp(small) / np.ptp(full)
    assert small - offset == pytest.approx(ratio * (full - offset), abs=1e-12)


REFUSED = {
    "above Nyquist": (lambda: chirp(f1=26), "f1 26 Hz at 50 Hz"),
    "frequency zero": (lambda: chirp(f0=0, kind="logarithmic"), "f0 0 Hz"),
    "no duration": (lambda: chirp(duration=0), "above zero"),
    "kind": (lambda: chirp(kind="cubic"), "'cubic': one of linear, logarithmic"),
    "offset beyond": (lambda: chirp(offset=9, high=8, limit="scale"), "offset alone"),
    "limit word": (lambda: chirp(high=9, limit="clip"), "'clip': one of"),
    "not finite": (lambda: chirp(amplitude=np.nan), "not finite"),
    "infinite": (lambda: chirp(amplitude=np.inf), "amplitude inf is not finite"),
    "half a sample": (lambda: prbs(hold=0.03), "1.5 samples"),
    "half a period": (lambda: multisine(lines=[0.15], duration=10), "0.15 Hz in 10 s"),
    "line twice": (lambda: multisine(lines=[0.2, 0.2], duration=10), "each line once"),
    "one level": (lambda: steps([1.0], 1), "two numbers or more"),
    "stands still": (lambda: crest_factor([1.0, 1.0]), "does not vary"),
    "unstable guess": (
        lambda: predicted_errors(Model(b=[0, 1], a=[1, -1.1], nk=1, sample_time=0.02), chirp(), 1),
        "1.1",
    ),
    "no noise": (lambda: predicted_errors(PLANT, chirp(), 0.0), "noise_sd 0.0"),
}


@pytest.mark.parametrize("what", REFUSED)
def test_bad_values_are_refused_in_words(what):
    make, words = REFUSED[what]
    with pytest.raises(IdentError, match=words):
        make()


def test_csv_with_the_answer_beside_it_is_a_record(tmp_path):
    u = chirp()
    path = write_excitation(u, 50, tmp_path / "u.csv", unit="V")
    lines = path.read_text().splitlines()
    assert lines[:2] == ["# sample rate: 50 Hz", "t [s],u [V]"]
    y = PLANT.simulate(u).tolist()
    answered = [lines[0], lines[1] + ",I [A]", *(f"{a},{b!r}" for a, b in zip(lines[2:], y, strict=True))]
    (tmp_path / "run.csv").write_text("\n".join(answered))
    rec = read_record(tmp_path / "run.csv")
    assert np.array_equal(rec.u, u)
    assert (rec.rate, rec.input, rec.unit_u) == (pytest.approx(50), "u", "V")


@settings(max_examples=20, deadline=None)
@given(st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=30))
def test_each_form_keeps_every_digit(tmp_path_factory, values):
    folder = tmp_path_factory.mktemp("forms")
    write_excitation(values, 1000 / 3, folder / "u.mat", "octave")
    mat = loadmat(folder / "u.mat")
    assert mat["u"].ravel().tolist() == values
    assert mat["rate"].item() == 1000 / 3
    write_excitation(values, 1000 / 3, folder / "u.ngc", "linuxcnc")
    reported = [line for line in (folder / "u.ngc").read_text().splitlines() if not line.startswith("#")]
    assert [float(line) for line in reported] == values
    script = write_excitation(values, 1000 / 3, folder / "excite.m", "octave").read_text()
    assert [float(x) for x in script.split("[")[1].split("]")[0].split()] == values


def test_labview_file_says_its_step_and_unit(tmp_path):
    text = write_excitation([0.0, 0.5, 1.0], 50, tmp_path / "u.lvm", "labview", "A").read_text()
    fields = dict(line.split("\t")[:2] for line in text.splitlines() if line.count("\t") == 1)
    # NI, Specification for the LabVIEW Measurement File
    assert text.startswith("LabVIEW Measurement")
    assert text.count("***End_of_Header***") == 2
    assert (fields["Delta_X"], fields["Samples"], fields["Y_Unit_Label"], fields["0.04"]) == ("0.02", "3", "A", "1.0")


def test_a_file_is_kept_unless_forced_and_left_whole(tmp_path):
    path = write_excitation([0.0, 1.0], 50, tmp_path / "u.csv")
    before = path.read_bytes()
    with pytest.raises(UsageError, match="--force"):
        write_excitation([2.0, 3.0], 50, path)
    assert path.read_bytes() == before
    assert write_excitation([2.0, 3.0], 50, path, force=True).read_bytes() != before
    with pytest.raises(UsageError, match="cannot be written"):
        write_excitation([2.0, 3.0], 50, tmp_path / "none" / "u.csv")
    with pytest.raises(UsageError, match=r"2nd run\.m"):
        write_excitation([2.0, 3.0], 50, tmp_path / "2nd run.m", "octave")
    with pytest.raises(UsageError, match="one of csv"):
        write_excitation([2.0, 3.0], 50, tmp_path / "u.x", "fanuc")
    with pytest.raises(IdentError, match="finite"):
        write_excitation([2.0, np.inf], 50, tmp_path / "v.csv")
    assert [p.name for p in tmp_path.iterdir()] == ["u.csv"]


def test_predicted_errors_are_those_of_fits():
    u, rng = chirp(), np.random.default_rng(5)
    x = PLANT.simulate(u)
    f, sd = np.array([0.1, 0.5, 1.0, 2.0]), 0.03 * np.std(x)
    models = [
        output_error(Record(u=u, y=x + sd * rng.standard_normal(750), sample_time=0.02), 3, 3) for _ in range(150)
    ]
    found = predicted_errors(PLANT, u, sd, frequency=f)
    g = np.stack([m.response(f) for m in models])
    # a standard deviation of 150 draws has a standard error of 6 %
    predicted = found.response.to_numpy().T
    assert 100 * np.std(np.abs(g), axis=0) / predicted[0] == pytest.approx(predicted[1], rel=0.2)
    assert np.degrees(np.std(np.angle(g / PLANT.response(f)), axis=0)) == pytest.approx(predicted[3], rel=0.2)
    assert np.std([m.theta for m in models], axis=0) == pytest.approx(found.params.se.to_numpy(), rel=0.25)
    assert found.snr == pytest.approx(20 * np.log10(1 / 0.03))


def test_four_runs_halve_the_errors():
    one, four = (predicted_errors(PLANT, chirp(), 0.01, runs=n) for n in (1, 4))
    assert four.params.se.to_numpy() == pytest.approx(one.params.se.to_numpy() / 2)
    assert four.response.gain_se.to_numpy() == pytest.approx(one.response.gain_se.to_numpy() / 2)


def test_outside_the_sweep_the_errors_grow():
    response = predicted_errors(PLANT, chirp(), 0.01, frequency=[1.0, 10.0]).response
    assert response.gain_se[10.0] > 5 * response.gain_se[1.0]
