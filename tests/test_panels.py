"""Panels without matplotlib: ticks, contours and shapes are those that matplotlib draws."""

import struct
import subprocess
import sys
import zlib

import numpy as np
import pytest
from fitmodels import datasets, fit
from fitmodels.cards.figures import draw_figures
from fitmodels.cards.forms.svg_panel import SvgPen
from fitmodels.core import pens
from fitmodels.core.figure_style import contour_levels, number_labels, tick_values
from fitmodels.core.panels import PanelAxes
from fitmodels.core.pens import PngPen, dashed
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

ROUNDING = 1e-9  # relative, of the same sums in another order
BOX = (50.0, 20.0, 200.0, 100.0)


@pytest.mark.parametrize("steps", [None, (1.0, 2.0, 5.0, 10.0)])
def test_ticks_are_those_of_matplotlib(steps):
    rng = np.random.default_rng(1)
    for _ in range(400):
        low = rng.normal() * 10 ** rng.uniform(-6, 8)
        high = low + abs(rng.normal()) * 10 ** rng.uniform(-6, 8)
        n = int(rng.integers(2, 10))
        expected = MaxNLocator(n, steps=steps).tick_values(low, high)
        found = tick_values(low, high, n, *([steps] if steps else []))
        np.testing.assert_allclose(found, expected, rtol=ROUNDING, atol=ROUNDING * max(abs(low), abs(high)))


def test_labels_have_the_decimals_that_they_need():
    assert number_labels([0.0, 0.5, 1.0]) == ["0.0", "0.5", "1.0"]
    assert number_labels([-20.0, 0.0]) == ["−20", "0"]
    assert number_labels([1e-9, 2e-9]) == ["1e−09", "2e−09"]
    assert number_labels([]) == []


@pytest.mark.parametrize("log", [False, True])
def test_limits_are_those_of_matplotlib(log):
    x, y = [1.0, 3.0, 20.0], [5.0, -2.0, 7.0]
    drawn, reference = PanelAxes(BOX), Figure().add_subplot()
    for ax in (drawn, reference):
        ax.set_xscale("log" if log else "linear")
        ax.plot(x, y, "o")
        ax.axhline(9.0)
    np.testing.assert_allclose(drawn.get_xlim(), reference.get_xlim(), rtol=ROUNDING)
    np.testing.assert_allclose(drawn.get_ylim(), reference.get_ylim(), rtol=ROUNDING)


def test_contours_are_those_of_matplotlib():
    x, y = np.meshgrid(np.linspace(0, 1, 21), np.linspace(0, 2, 31))
    z = np.ma.masked_array(x + y**2, x * y > 1.2)
    levels = contour_levels(z.compressed())
    drawn = PanelAxes(BOX).contour(x, y, z, levels, colors="#000000", linewidths=1.0)
    reference = Figure().add_subplot().contour(x, y, z, levels)
    for points, path in zip(drawn.points, reference.get_paths(), strict=True):
        ours, theirs = (np.unique(np.round(found, 9), axis=0) for found in (points, path.vertices))
        np.testing.assert_array_equal(ours, theirs)


def test_one_panel_is_drawn_by_both_pens():
    """A line from corner to corner, a band and a word: numbers of the SVG, colours of the picture."""
    ax = PanelAxes(BOX)
    ax.set(xlim=(0.0, 1.0), ylim=(0.0, 1.0))
    ax.axhspan(0.4, 0.6, color="#00ff00")
    ax.plot([0.0, 1.0], [0.0, 1.0], color="#ff0000", lw=2)
    svg = SvgPen()
    ax.draw_shapes(svg)
    assert 'd="M50 80L250 80L250 60L50 60z"' in svg.shapes[0]
    assert 'd="M50 120L250 20"' in svg.shapes[1]
    pen = PngPen(300.0, 140.0)
    ax.draw(pen)
    picture = np.asarray(pen.picture())
    middle = picture[round(70 * 110 / 72), round(150 * 110 / 72)]
    np.testing.assert_array_equal(middle, [255, 0, 0])
    np.testing.assert_array_equal(picture[round(70 * 110 / 72), round(60 * 110 / 72)], [0, 255, 0])


def test_dashes_cover_their_share_of_a_line():
    line = np.array([[0.0, 0.0], [3.0, 4.0], [3.0, 10.0]])
    parts = list(dashed(line, (2.0, 1.0)))
    length = sum(np.hypot(*np.diff(part, axis=0).T).sum() for part in parts)
    assert length == pytest.approx(8.0)  # 11 long: three whole periods and a dash


@pytest.mark.parametrize("name", ["gc435_709m40", "ac2017_table1"])
def test_figures_of_a_folder_are_whole_png_files(name, tmp_path):
    laws, _ = fit.default_laws(datasets.read_runs(datasets.bundled(name)))
    names = draw_figures(laws, tmp_path, "not measured")
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(names)
    for each in names:
        content = (tmp_path / each).read_bytes()
        assert content[:8] == b"\x89PNG\r\n\x1a\n"
        width, height = struct.unpack(">II", content[16:24])
        assert 300 < width < 900
        assert height > 300
        at = content.index(b"IDAT")
        assert zlib.decompressobj().decompress(content[at + 4 :], 100)


def test_a_picture_does_not_depend_on_the_strips_that_it_is_drawn_in(monkeypatch):
    """Lines, joints, areas and markers that cross the strips, drawn in strips of 7 rows and at once."""

    def picture(strip):
        monkeypatch.setattr(pens, "STRIP", strip)
        rng = np.random.default_rng(3)
        pen = PngPen(200.0, 200.0)
        for marker, face in zip("osD^vP", ("none", "#112233") * 3, strict=True):
            at = rng.uniform(5.0, 195.0, (30, 2))
            pen.area([at[:5], at[5:9]], "#0072b2", 0.4)
            pen.line(at, "#d55e00", rng.uniform(0.2, 3.0), (3.0, 2.0) if face == "none" else ())
            pen.markers(at, marker, rng.uniform(2.0, 12.0), face, "#445566", rng.uniform(0.2, 2.0))
        return np.asarray(pen.picture())

    whole = picture(10_000)
    assert (whole != 255).any(axis=2).mean() > 0.2
    np.testing.assert_array_equal(picture(7), whole)
    np.testing.assert_array_equal(picture(pens.FINE), whole)


def test_names_are_drawn_as_they_are(tmp_path):
    """Markup, escape sequences, dollars and long cells of a file are words in a picture."""
    pen = PngPen(100.0, 50.0)
    ax = PanelAxes((10.0, 10.0, 80.0, 30.0))
    ax.text(0.5, 0.5, "$<b>\x1b[2J\u202e" + "x" * 40_000, transform=ax.transAxes)
    ax.draw(pen)
    pen.save(tmp_path / "a.png")
    assert (tmp_path / "a.png").stat().st_size > 100


def test_a_saved_picture_has_the_colours_that_were_drawn(tmp_path):
    from PIL import Image

    pen = PngPen(100.0, 50.0)
    pen.area([np.array([[10.0, 10.0], [50.0, 10.0], [50.0, 40.0], [10.0, 40.0]])], "#0072b2", 0.3)
    pen.line(np.array([[60.0, 40.0], [90.0, 10.0]]), "#d55e00", 4.0)
    drawn = np.asarray(pen.picture()).astype(int)
    pen.save(tmp_path / "a.png")
    saved = np.asarray(Image.open(tmp_path / "a.png").convert("RGB")).astype(int)
    white = (drawn == 255).all(axis=2)
    assert (saved[white] == 255).all()
    assert (saved[30, 40] == drawn[30, 40]).all()
    assert np.abs(saved - drawn).max() < 16  # mixed colours at edges share those of the palette


def test_the_main_job_loads_neither_matplotlib_nor_pint(tmp_path):
    code = (
        "import sys; from fitmodels.cli import main; "
        f"code = main([{str(datasets.bundled('ac2017_table1'))!r}, '--out', {str(tmp_path / 'out')!r}, '--quiet']); "
        "print(code, [name for name in ('matplotlib', 'pint', 'statsmodels') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "0 []"
