"""Coded levels of a design and the ranges that turn them into conditions.

Box & Wilson (1951), J. R. Stat. Soc. B 13, 1-45; even in the logarithm as in Alaskari & Oraby's designs.
"""

import numpy as np
import pytest
from fitmodels import datasets, fit
from fitmodels.core import errors
from fitmodels.datasets.design import decode_levels, looks_coded

DESIGN = "V,f,AW [mm]\n-1,-1,0.10\n1,-1,0.14\n-1,1,0.12\n1,1,0.17\n0,0,0.13\n0,0,0.135\n"


def file(tmp_path, text=DESIGN):
    path = tmp_path / "coded.csv"
    path.write_text(text, "utf-8")
    return path


@pytest.mark.parametrize(
    ("levels", "coded"),
    [
        ([-1, 1], True),
        ([-1, 0, 1, np.nan], True),
        ([-1.682, -1, 0, 1, 1.682], True),
        ([-2, -1, 0, 1, 2], True),
        ([50, 100, 200], False),
        ([-1, 0.5, 1], False),
        ([-1, 1, 4, -4], False),
        ([1, 1, 1], False),
        ([0, 1], False),
        ([np.nan, np.nan], False),
    ],
)
def test_what_looks_coded(levels, coded):
    assert looks_coded(np.array(levels, dtype=float)) is coded


def test_two_ends_are_even_in_the_logarithm():
    values, said = decode_levels("V", np.array([-2, -1, 0, 1, 2.0]), (50.0, 200.0))
    np.testing.assert_allclose(values, [25, 50, 100, 200, 400], rtol=1e-12)
    assert "even in the logarithm: -1 is 50, 0 is 100, 1 is 200" in said[0]


def test_an_arithmetic_centre_makes_the_levels_even_in_the_factor():
    values, said = decode_levels("V", np.array([-1, 0, 1, 2.0, -2]), (50.0, 125.0, 200.0))
    np.testing.assert_allclose(values, [50, 125, 200, 275, -25], rtol=1e-12)
    assert "even in V itself" in said[0]


def test_a_geometric_centre_says_the_same_as_none():
    levels = np.array([-1, 0, 1.0])
    np.testing.assert_allclose(
        decode_levels("f", levels, (0.1, 0.2, 0.4))[0], decode_levels("f", levels, (0.1, 0.4))[0], rtol=1e-12
    )


def test_missing_levels_stay_missing():
    values, _ = decode_levels("V", np.array([-1, np.nan, 1]), (50.0, 200.0))
    np.testing.assert_allclose(values, [50, np.nan, 200])


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ((200.0, 50.0), "it is low:high, both above zero"),
        ((0.0, 50.0), "it is low:high, both above zero"),
        ((50.0,), "it is low:high"),
        ((50.0, np.inf), "it is low:high"),
        ((50.0, 180.0, 200.0), r"centre 180 is neither the geometric \(100\) nor the arithmetic \(125\)"),
    ],
)
def test_ranges_out_of_order_are_refused(given, says):
    with pytest.raises(errors.UsageError, match=says):
        decode_levels("V", np.array([-1, 0, 1.0]), given)


def test_a_range_for_plain_values_is_refused():
    with pytest.raises(errors.UsageError, match="--range V: the column holds no coded levels"):
        decode_levels("V", np.array([50, 100, 200.0]), (50.0, 200.0))


def test_a_file_of_levels_is_refused_until_the_ranges_are_given(tmp_path):
    with pytest.raises(errors.DataError, match=r"V holds coded levels \(-1, 0, 1\).*--range V=50:200"):
        datasets.read_runs(file(tmp_path))


def test_a_file_of_levels_is_read_with_ranges(tmp_path):
    runs = datasets.read_runs(file(tmp_path), ranges={"V": (50, 200), "f": (0.1, 0.25, 0.4)})
    np.testing.assert_allclose(runs.values("V"), [50, 200, 50, 200, 100, 100], rtol=1e-12)
    np.testing.assert_allclose(runs.values("f"), [0.1, 0.1, 0.4, 0.4, 0.25, 0.25], rtol=1e-12)
    assert sum("coded levels" in text for text in runs.assumed) == 2


def test_exponents_do_not_depend_on_how_the_design_was_written(tmp_path):
    coded = datasets.read_runs(file(tmp_path), ranges={"V": (50, 200), "f": (0.1, 0.4)})
    plain = DESIGN.splitlines()
    rows = [line.split(",") for line in plain[1:]]
    natural = ["V,f,AW [mm]"] + [
        f"{100 * 2 ** float(v)},{0.2 * 2 ** float(f)},{aw}" for v, f, aw in rows
    ]  # 50:200 and 0.1:0.4 are a factor of 2 on either side of 100 and 0.2
    other = tmp_path / "natural.csv"
    other.write_text("\n".join(natural) + "\n", "utf-8")
    a, b = (fit.power_law(runs, "AW", ["V", "f"]).params.to_numpy() for runs in (coded, datasets.read_runs(other)))
    np.testing.assert_allclose(a, b, rtol=1e-10)


def test_a_response_of_plus_and_minus_one_is_no_design(tmp_path):
    text = "V,Fx [N]\n50,-1\n100,1\n200,0\n"
    runs = datasets.read_runs(file(tmp_path, text))
    assert runs.values("Fx").tolist() == [-1, 1, 0]


L9 = [(1, 1, 1), (1, 2, 2), (1, 3, 3), (2, 1, 2), (2, 2, 3), (2, 3, 1), (3, 1, 3), (3, 2, 1), (3, 3, 2)]
HEADS = {"named": "Speed level,Feed level,Depth level", "letters": "A,B,C"}


def orthogonal(tmp_path, head):
    rows = [",".join(map(str, (*levels, 2.0 + 0.1 * i))) for i, levels in enumerate(L9)]
    return file(tmp_path, "\n".join([f"{head},Ra (um)", *rows]) + "\n")


@pytest.mark.parametrize("head", HEADS.values(), ids=HEADS)
def test_numbered_levels_become_the_values_given_for_each(tmp_path, head):
    path = orthogonal(tmp_path, head)
    doubted = [str(doubt) for doubt in datasets.read_runs(path).doubts]
    assert "--range V=LOW:MIDDLE:HIGH" in doubted[0]
    assert not any(doubt.remedy for doubt in datasets.read_runs(path).doubts)
    runs = datasets.read_runs(path, map={"V": "col1"}, ranges={"V": (80, 100, 200)})
    np.testing.assert_allclose(runs.values("V"), [80, 80, 80, 100, 100, 100, 200, 200, 200])


def test_each_numbered_level_needs_a_value(tmp_path):
    with pytest.raises(errors.UsageError, match="the levels 1, 2, 3; give the value of each, low:middle:high"):
        datasets.read_runs(orthogonal(tmp_path, "A,B,C"), map={"V": "A"}, ranges={"V": (80, 200)})


@pytest.mark.parametrize("head", ["Tool life (parts)", "Standzeit (Teile)", "pieces per edge time"])
def test_a_number_of_parts_is_never_a_time(tmp_path, head):
    text = "".join(f"{v},{f},{n}\n" for v, f, n in [(100, 0.1, 90), (100, 0.2, 70), (150, 0.1, 50), (150, 0.2, 40)] * 2)
    runs = datasets.read_runs(file(tmp_path, f"V,f,{head}\n{text}"))
    assert not any("--map" in doubt.remedy for doubt in runs.doubts)


def test_passes_are_not_proposed_as_minutes(tmp_path):
    rows = [f"E{e},{100 + 20 * e},{k},{0.05 * k + 0.01 * e:.3f}\n" for e in range(4) for k in range(1, 6)]
    runs = datasets.read_runs(file(tmp_path, "edge,V,pass,VB [mm]\n" + "".join(rows)))
    assert any("number of parts, holes or passes" in doubt.sentence for doubt in runs.doubts)
    assert not any("--map" in doubt.remedy for doubt in runs.doubts)
