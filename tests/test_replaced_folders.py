"""A corrected reading replaces the folder of the former one, and nothing that somebody else put there."""

import os
import shutil

import pytest
from fitmodels import analyse, datasets, parameters
from fitmodels.cli import main
from fitmodels.core.errors import UsageError
from fitmodels.parameters.file import sealed

ROWS = [
    f"{grade},E{i},{V},{f},{t},{scale * 0.01 * V**0.5 * f**0.2 * t**0.3 * (1 + 0.01 * ((7 * i + 3 * t) % 5 - 2)):.5g}"
    for grade, scale in (("A", 1.0), ("B", 1.4))
    for i, (V, f) in enumerate([(80, 0.1), (80, 0.2), (160, 0.1), (160, 0.2), (120, 0.15)])
    for t in (2, 5, 9, 14)
]
WORDS = ("--tool", "T", "--work", "W", "--draws", "1000")


CORRECTED = (*WORDS, "--map", "f=feed", "--unit", "f=mm/rev", "--posterior-figures")


def data(folder):
    (folder / "a.csv").write_text("\n".join(["batch,edge,V [m/min],feed,t [min],VB [mm]", *ROWS]) + "\n")
    return folder


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return data(tmp_path)


@pytest.fixture(scope="module")
def once(tmp_path_factory):
    """A reading without the feed, to be corrected with ``--map f=feed --unit f=mm/rev``."""
    root = data(tmp_path_factory.mktemp("once"))
    words = [str(root / "a.csv"), *WORDS, "--map", "f=none", "--posterior-figures", "--out", str(root / "a-fit")]
    assert main(words) == 0
    return root


@pytest.fixture
def fitted(once, tmp_path, monkeypatch):
    """The folder of that reading, in a place of its own."""
    shutil.copytree(once, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path / "a-fit" / "T_W"


def files(folder):
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_a_corrected_reading_replaces_the_former_one(fitted, capsys):
    before = parameters.read(fitted / "params.json")
    capsys.readouterr()
    assert main(["a.csv", *CORRECTED]) == 0
    after = parameters.read(fitted / "params.json")
    assert "f" not in before.laws["VB"].coefficients
    assert "f" in after.laws["VB"].coefficients
    assert "in place of the former reading" in " ".join(capsys.readouterr().out.split())
    fresh = analyse("a.csv", tool="T", work="W", draws=1000, map={"f": "feed"}, units={"f": "mm/rev"},
                    posterior_figures=True)  # fmt: skip
    fresh.write("fresh")
    assert files(fitted).keys() == files(fitted.parents[1] / "fresh" / "T_W").keys()
    assert not [path for path in fitted.parent.iterdir() if path != fitted]


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda folder: (folder / "notes.txt").write_text("mine"), "notes.txt is not a file of fitmodels"),
        (lambda folder: (folder / "figures" / "mine.png").write_bytes(b""), "mine.png is not a file of fitmodels"),
        (lambda folder: (folder / "README.md").write_text("# Mine"), "README.md was edited"),
        (lambda folder: (folder / "card.html").unlink(), "card.html was edited"),
        (lambda folder: main(["limits", str(folder / "params.json"), "VB=0.3mm"]), "sections were added"),
        (
            lambda folder: parameters.write(
                sealed(parameters.read(folder / "params.json"), later={"mine": 1}), folder / "params.json", force=True
            ),
            "sections were added",
        ),
        (lambda folder: (folder / "params.json").write_text("{"), "no parameter file that can be read"),
        (
            lambda folder: (folder.parents[1] / "a.csv").write_text(
                (folder.parents[1] / "a.csv").read_text().replace("A,E0,80,0.1,2", "A,E0,80,0.1,3")
            ),
            "before that file was changed",
        ),
    ],
)
def test_what_is_not_the_untouched_former_reading_needs_force(fitted, capsys, change, reason):
    change(fitted)
    before = files(fitted)
    capsys.readouterr()
    assert main(["a.csv", *CORRECTED]) == 2
    said = capsys.readouterr().err
    assert "exists and contains a different result or other files" in said
    assert reason in said
    assert "--force" in said
    assert files(fitted) == before


def test_another_fit_of_the_same_reading_needs_force(fitted, capsys):
    before = files(fitted)
    assert main(["a.csv", *CORRECTED, "--error", "additive"]) == 2
    assert "fitted with other options" in capsys.readouterr().err
    assert files(fitted) == before


def test_an_interrupted_replacement_leaves_the_former_result(fitted, monkeypatch):
    before = files(fitted)

    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("fitmodels.cards.figures.draw_posteriors", interrupted)
    assert main(["a.csv", *CORRECTED]) == 130
    assert files(fitted) == before
    monkeypatch.undo()
    monkeypatch.chdir(fitted.parents[1])
    rename = os.rename

    def fails(path, target):
        if path.name == "made":
            raise OSError(5, "input/output error")
        return rename(path, target)

    monkeypatch.setattr(os, "rename", fails)
    assert main(["a.csv", *CORRECTED]) == 2
    assert files(fitted) == before
    assert [path.name for path in fitted.parent.iterdir()] == ["T_W"]


def test_a_file_that_arrives_during_the_fit_is_kept(fitted):
    given = {"tool": "T", "work": "W", "draws": 1000, "map": {"f": "feed"}, "units": {"f": "mm/rev"}}
    analysis = analyse("a.csv", posterior_figures=True, **given)
    from fitmodels.pipeline.folders import pair_folders

    (folder,) = pair_folders([pair.runs for pair in analysis.pairs], "a-fit", analysis.options)
    (fitted / "mine.txt").write_text("mine")
    with pytest.raises(UsageError, match=r"T_W: mine.txt was written by another process since this command began"):
        folder.write(analysis.pair, analysis.options)
    assert (fitted / "mine.txt").read_text() == "mine"


def test_pairs_of_a_former_reading_are_named_and_kept(here, capsys):
    assert main(["a.csv", "--map", "tool=batch", "--work", "W", "--draws", "1000"]) == 0
    capsys.readouterr()
    (here / "a-fit" / "other").mkdir()
    assert main(["a.csv", *WORDS]) == 0
    out = capsys.readouterr().out
    assert "Left in a-fit from a former reading of a.csv: 2 folders (A_W, B_W)." in out
    assert sorted(path.name for path in (here / "a-fit").iterdir()) == ["A_W", "B_W", "T_W", "other"]
    shutil.rmtree(here / "a-fit" / "A_W")
    shutil.rmtree(here / "a-fit" / "B_W")
    assert main(["a.csv", *WORDS]) == 0
    assert "Left in" not in capsys.readouterr().out


def test_a_result_of_another_file_of_this_name_is_not_left(here, capsys):
    assert main(["a.csv", *WORDS]) == 0
    assert main([str(datasets.bundled("ac2017_table1")), "--out", "a-fit", "--draws", "1000"]) == 0
    assert "Left in" not in capsys.readouterr().out
