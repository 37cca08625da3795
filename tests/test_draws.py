"""Draws on disk: bytes that repeat, a hash that is checked, and nothing but numbers read."""

import hashlib
from contextlib import suppress

import numpy as np
import pytest
from fitmodels.core.errors import ParameterError
from fitmodels.parameters import ParameterFile, read_draws
from fitmodels.parameters.draws import Draws, packed, unpacked

IDENTITY = {"tool": "GC435", "work": "709M40", "simulated": False}


def some(seed=1):
    return {"AW": Draws(("ln c0", "V"), np.random.default_rng(seed).normal(size=(50, 2)))}


def file_of(folder, content, sha256=None):
    (folder / "draws.npz").write_bytes(content)
    section = {"seed": 1, "draws_file": "draws.npz", "draws_sha256": sha256 or hashlib.sha256(content).hexdigest()}
    return ParameterFile(identity=IDENTITY, provenance={"fitmodels": "0.1.0"}, posterior=section)


def test_written_and_read_bit_for_bit(tmp_path):
    content = packed(some())
    assert content == packed(some())
    found = read_draws(file_of(tmp_path, content), tmp_path)["AW"]
    assert found.names == ("ln c0", "V")
    assert np.array_equal(found.values, some()["AW"].values)


def test_other_draws_than_those_that_were_written_are_refused(tmp_path):
    pf = file_of(tmp_path, packed(some()))
    (tmp_path / "draws.npz").write_bytes(packed(some(2)))
    with pytest.raises(ParameterError, match="not the draws that the parameter file was written with"):
        read_draws(pf, tmp_path)


def test_missing_draws_are_named(tmp_path):
    pf = file_of(tmp_path, packed(some()))
    (tmp_path / "draws.npz").unlink()
    with pytest.raises(ParameterError, match=r"draws\.npz.*cannot be read"):
        read_draws(pf, tmp_path)


@pytest.mark.parametrize("name", ["../draws.npz", "/etc/passwd", "a/b.npz", "draws.pkl", ".npz", ""])
def test_a_name_cannot_leave_the_folder(name):
    with pytest.raises(ValueError, match="draws_file"):
        ParameterFile(identity=IDENTITY, provenance={"fitmodels": "0.1.0"}, posterior={"seed": 1, "draws_file": name})


class Mischief:
    def __reduce__(self):
        return (print, ("unpickled",))


def test_a_pickle_is_not_opened(tmp_path, capsys):
    np.savez(tmp_path / "x.npz", **{"AW.draws": np.array([Mischief()], dtype=object), "AW.names": np.array(["V"])})
    with pytest.raises(ParameterError, match="is not a file of draws"):
        unpacked((tmp_path / "x.npz").read_bytes(), "x.npz")
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize(
    "arrays",
    [
        {"AW.draws": np.ones(3), "AW.names": np.array(["V"])},
        {"AW.draws": np.ones((3, 2)), "AW.names": np.array(["V"])},
        {"AW.draws": np.full((3, 1), np.nan), "AW.names": np.array(["V"])},
        {"AW.draws": np.ones((0, 1)), "AW.names": np.array(["V"])},
        {"AW.draws": np.ones((3, 1))},
        {"AW.draws": np.ones((3, 1), dtype=int), "AW.names": np.array(["V"])},
    ],
    ids=["one row", "a name missing", "not a number", "no rows", "no names", "integers"],
)
def test_what_is_no_table_of_draws_is_refused(tmp_path, arrays):
    np.savez(tmp_path / "x.npz", **arrays)
    with pytest.raises(ParameterError):
        unpacked((tmp_path / "x.npz").read_bytes(), "x.npz")


def test_any_bytes_give_a_named_error():
    rng = np.random.default_rng(3)
    content = packed(some())
    for _ in range(300):
        broken = bytearray(content)
        for at in rng.integers(0, len(broken), 3):
            broken[at] = rng.integers(256)
        with suppress(ParameterError):  # anything else fails the test
            unpacked(bytes(broken[: rng.integers(1, len(broken) + 1)]), "x.npz")
