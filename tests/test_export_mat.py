"""The MATLAB export, loaded by Octave and its control package, closes the loop that we close."""

import subprocess
from dataclasses import asdict
from io import BytesIO

import numpy as np
import pytest
from fitmodels.ident.model import Model
from fitmodels.ident.pi.gains import PiGains
from fitmodels.ident.pi.loop import loop_of
from fitmodels.parameters.exports import export_format
from fitmodels.parameters.exports.view import export_view
from scipy.io import loadmat

INSTALL = "apt-get install --no-install-recommends octave octave-control"
SAMPLES = 400
TOLERANCE = 1e-9  # of a unit step: two programs' rounding over 400 samples
GAINS = {
    "backward sum, low-pass": {},
    "no low-pass": {"filter_time": 0.0, "ki": 800.0},
    "trapezoidal sum": {"integration": "trapezoidal"},
    "forward sum, two samples of delay": {"integration": "forward", "delay": 2, "ki": 800.0},
    "incremental form": {"form": "incremental"},
    "average of the measurement": {"average": 3},
    "average of the command": {"average": 3, "average_of": "command"},
}
CLOSE = """
G = tf(fm.plant.num, fm.plant.den, fm.plant.Ts);
C = tf(fm.pi.C_num, fm.pi.C_den, fm.pi.Ts);
H = tf(fm.pi.H_num, fm.pi.H_den, fm.pi.Ts);
[y, t] = step(feedback(C * G, H), {last} * fm.pi.Ts);
printf("%.17g\\n", y);
"""


def mat_of(pf) -> bytes:
    return export_format("mat").render(export_view(pf))


def loaded(content: bytes) -> np.ndarray:
    return loadmat(BytesIO(content), squeeze_me=True)["fitmodels"]


@pytest.fixture
def octave(consumer, tmp_path):
    program = consumer("octave-cli", INSTALL)

    def run(content: bytes, script: str) -> subprocess.CompletedProcess[str]:
        (tmp_path / "params.mat").write_bytes(content)
        (tmp_path / "test.m").write_text(f'pkg load control\nload("params.mat");\nfm = fitmodels;\n{script}')
        asked = [program, "--norc", "--quiet", "test.m"]
        return subprocess.run(asked, cwd=tmp_path, capture_output=True, text=True, timeout=120)

    return run


def steps(said: subprocess.CompletedProcess[str]) -> np.ndarray:
    assert said.returncode == 0, said.stderr
    return np.array(said.stdout.split(), dtype=float)


def our_step(pf) -> np.ndarray:
    seen = export_view(pf)
    model = Model(b=seen.plant.b, a=seen.plant.a, nk=seen.plant.nk, sample_time=seen.plant.sample_time)
    return loop_of(model, PiGains(**asdict(seen.gains))).step(SAMPLES)


@pytest.mark.consumer
@pytest.mark.parametrize("gains", GAINS.values(), ids=GAINS)
def test_octave_closes_the_loop_and_steps_as_we_do(octave, constant_load_file, gains):
    pf = constant_load_file(pi=gains)
    theirs = steps(octave(mat_of(pf), CLOSE.replace("{last}", str(SAMPLES - 1))))
    ours = our_step(pf)
    assert theirs.shape == ours.shape
    assert np.abs(theirs - ours).max() < TOLERANCE
    assert np.abs(ours).max() > 0.1  # a loop that does something


@pytest.mark.consumer
def test_octaves_own_pid_made_digital_is_our_trapezoidal_sum(octave, constant_load_file):
    """Tustin's rule is the trapezoidal sum: c2d of pid(Kp, Ki) must be C_num / C_den."""
    script = """
D = c2d(pid(fm.pi.Kp, fm.pi.Ki), fm.pi.Ts, "tustin");
w = logspace(-1, 2, 50);
C = tf(fm.pi.C_num, fm.pi.C_den, fm.pi.Ts);
printf("%.17g\\n", max(abs(squeeze(freqresp(D, w)) - squeeze(freqresp(C, w))) ./ abs(squeeze(freqresp(C, w)))));
"""
    apart = steps(octave(mat_of(constant_load_file(pi={"integration": "trapezoidal"})), script))
    assert apart[0] < TOLERANCE


@pytest.mark.consumer
def test_octave_reads_every_value_with_its_unit(octave, constant_load_file):
    pf = constant_load_file()
    script = """
names = fieldnames(fm.quantities);
for k = 1:numel(names)
  printf("%s|%.17g|%s|%s\\n", names{k}, fm.quantities.(names{k}), fm.units.(names{k}), fm.words.(names{k}));
end
"""
    said = octave(mat_of(pf), script)
    assert said.returncode == 0, said.stderr
    rows = [line.split("|") for line in said.stdout.splitlines()]
    read = [(name, float(value), unit, words) for name, value, unit, words in rows]
    assert read == [(q.name, q.value, q.unit, q.words) for q in export_view(pf).quantities]


@pytest.mark.consumer
def test_a_broken_file_is_not_loaded_and_a_wrong_gain_is_seen(octave, constant_load_file):
    pf = constant_load_file()
    script = CLOSE.replace("{last}", str(SAMPLES - 1))
    cut = mat_of(pf)[:5000]
    assert octave(cut, script).returncode != 0
    wrong = steps(octave(mat_of(constant_load_file(pi={"ki": 8100.0})), script))
    assert np.abs(wrong - our_step(pf)).max() > 1000 * TOLERANCE


def test_every_number_of_the_struct_has_its_unit(constant_load_file):
    struct = loaded(mat_of(constant_load_file()))
    for part in ("plant", "pi"):
        section = struct[part].item()
        names = section.dtype.names
        numbers = [name for name in names if not isinstance(section[name].item(), str) and name != "nk"]
        assert {f"unit_{name}" for name in numbers} <= set(names)
    assert struct["quantities"].item().dtype.names == struct["units"].item().dtype.names


def test_the_same_file_gives_the_same_bytes_at_any_time(constant_load_file):
    first = mat_of(constant_load_file())
    assert first == mat_of(constant_load_file())
    assert first[:19] == b"MATLAB 5.0 MAT-file"
    assert b"Created on" not in first
    assert first[124:128] in (b"\x00\x01IM", b"\x01\x00MI")  # version and byte order, as the format has them


def test_a_file_without_dynamics_or_gains_still_gives_its_numbers(constant_load_file):
    struct = loaded(mat_of(constant_load_file(dynamics=None, pi=None)))
    assert {"plant", "pi"}.isdisjoint(struct.dtype.names)
    assert float(struct["quantities"].item()["safety_factor"].item()) == 0.85
