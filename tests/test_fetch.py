"""Real measurements by name: what is taken, what is refused, and with which sentence. Nothing here uses a network."""

import sys
from hashlib import sha256
from types import SimpleNamespace

import pytest
from fitmodels import datasets
from fitmodels.core import errors
from fitmodels.datasets.sets import GITHUB, SETS, PublicFile, PublicSet

CONTENT = {"a.csv": b"V,f\n100,0.2\n", "b.csv": b"V,f\n200,0.4\n"}
FILES = tuple(PublicFile(n, sha256(b).hexdigest(), f"https://example.org/{n}") for n, b in CONTENT.items())
MADE_FILES = tuple(PublicFile(file.name, file.sha256) for file in FILES)


@pytest.fixture(autouse=True)
def sets(monkeypatch):
    """Two small sets, one to download and one that was made; no local copies."""
    monkeypatch.delenv("FITMODELS_DATA", raising=False)
    monkeypatch.setitem(SETS, "small", PublicSet("a trial", "CC0", FILES))
    monkeypatch.setitem(SETS, "made", PublicSet("a trial", "CC0", MADE_FILES, "averaged from x.csv of example.org"))


@pytest.fixture
def pooch(monkeypatch, tmp_path):
    """A pooch that writes what it is reported to have downloaded."""
    asked = []

    def retrieve(url, known_hash, fname, path):
        asked.append((url, known_hash))
        path.mkdir(parents=True, exist_ok=True)
        (path / fname).write_bytes(CONTENT[fname])

    made = SimpleNamespace(retrieve=retrieve, os_cache=lambda name: tmp_path / "cache" / name, asked=asked)
    monkeypatch.setitem(sys.modules, "pooch", made)
    return made


def filled(folder):
    folder.mkdir(parents=True)
    for name, content in CONTENT.items():
        (folder / name).write_bytes(content)
    return folder


def test_a_local_copy_is_taken_before_anything_is_downloaded(monkeypatch, tmp_path, pooch):
    monkeypatch.setenv("FITMODELS_DATA", str(tmp_path))
    there = filled(tmp_path / "small")
    assert datasets.fetch("small") == there
    assert pooch.asked == []


def test_a_local_copy_that_was_changed_is_refused(monkeypatch, tmp_path):
    monkeypatch.setenv("FITMODELS_DATA", str(tmp_path))
    (filled(tmp_path / "made") / "b.csv").write_bytes(b"V,f\n200,0.5\n")
    with pytest.raises(errors.DataError, match=r"b\.csv: SHA-256 .* it is not the file that was published\. Restore"):
        datasets.fetch("made")


@pytest.mark.parametrize("given", [True, False], ids=["into a folder that is given", "into the user's cache"])
def test_every_file_is_downloaded_with_its_known_hash(tmp_path, pooch, given):
    found = datasets.fetch("small", tmp_path / "mine" if given else None)
    assert found == (tmp_path / "mine" / "small" if given else tmp_path / "cache" / "fitmodels" / "small")
    assert {path.name: path.read_bytes() for path in found.iterdir()} == CONTENT
    assert pooch.asked == [(file.url, f"sha256:{file.sha256}") for file in FILES]


def test_what_was_downloaded_once_is_taken_without_pooch(tmp_path, pooch, monkeypatch):
    datasets.fetch("small", tmp_path)
    monkeypatch.setitem(sys.modules, "pooch", None)
    assert datasets.fetch("small", tmp_path) == tmp_path / "small"


def test_without_pooch_the_sentence_says_how_to_get_either(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "pooch", None)
    with pytest.raises(errors.DataError, match=r"pip install 'fitmodels\[fetch\]', or set FITMODELS_DATA .*small/a"):
        datasets.fetch("small", tmp_path)


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (OSError("404 Client Error: Not Found"), "404 Client Error: Not Found. Try again"),
        (OSError("x" * 400), "OSError. Try again"),
        (ValueError("SHA256 hash of downloaded file does not match"), "does not match. Try again"),
    ],
    ids=["no such address", "a long message", "other bytes"],
)
def test_a_download_that_fails_names_address_licence_and_cure(pooch, tmp_path, error, said):
    def retrieve(*_, **__):
        raise error

    pooch.retrieve = retrieve
    with pytest.raises(errors.DataError) as raised:
        datasets.fetch("small", tmp_path)
    assert all(part in str(raised.value) for part in ("https://example.org/a.csv", "licence: CC0", said))


def test_a_set_that_was_made_says_from_what(pooch, tmp_path):
    with pytest.raises(errors.DataError, match=r"was averaged from x\.csv .* cannot be downloaded .* made/a\.csv and "):
        datasets.fetch("made", tmp_path)
    assert pooch.asked == []


@pytest.mark.parametrize(("name", "hint"), [("nasa_millling", "Did you mean 'nasa_milling'"), ("zzz", "There are")])
def test_an_unknown_name_is_reported_what_there_is(name, hint):
    with pytest.raises(errors.UsageError, match=hint):
        datasets.fetch(name)


def test_every_set_states_its_licence_and_either_an_address_or_how_it_was_made():
    for name, known in SETS.items():
        assert known.what, name
        assert known.licence, name
        assert all(bool(file.url) != bool(known.made) for file in known.files), name
        assert all(len(file.sha256) == 64 for file in known.files), name
        pinned = [file.url.split("/")[5] for file in known.files if file.url.startswith(GITHUB)]
        assert all(len(commit) == 40 for commit in pinned), f"{name}: a commit, or bytes may change"


@pytest.mark.parametrize("name", [name for name in SETS if name not in ("small", "made")])
def test_the_measurements_at_hand_are_those_of_the_list(measurements, monkeypatch, name):
    monkeypatch.setenv("FITMODELS_DATA", str(measurements))
    assert datasets.fetch(name) == measurements / name
