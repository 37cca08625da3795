"""Pictures of a posterior: what is drawn is what was drawn from, every axis has its unit, and nothing is in the way."""

import re
import subprocess
import sys
from dataclasses import replace
from itertools import combinations

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit
from fitmodels.core import figure_style
from fitmodels.core.errors import UsageError
from fitmodels.fit.bayes.figures import posterior_figure
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from scipy import stats

pytestmark = pytest.mark.slow

KINDS = ("marginals", "pairs", "predictive", "curves")
CONDITIONS = ["V", "f", "d", "t"]
ORANGE = to_rgb(figure_style.ORANGE)
MONTE_CARLO = 0.05  # of a width: bands of 4000 draws, each with another noise


def bundled(factors=CONDITIONS, draws_by=None, **options):
    runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    return fit.posterior(fit.power_law(runs, "AW", factors, **options), **(draws_by or {}))


def many_edges(edges=40, rows=6, scatter=0.1, **options):
    """Edges e1, e2, ... at V from 50 to 200 m/min over t; the last has one row."""
    rng = np.random.default_rng(1)
    V = np.repeat(np.geomspace(50, 200, edges), rows)
    t = np.tile(np.linspace(2, 20, rows), edges)
    ln = -5 + 0.5 * np.log(V) + 0.3 * np.log(t) + rng.normal(0, scatter, len(V)) + np.repeat(
        rng.normal(0, scatter, edges), rows
    )  # fmt: skip
    frame = pd.DataFrame(
        {"V": V, "t": t, "AW": np.exp(ln), "edge": np.repeat([f"e{i + 1}" for i in range(edges)], rows)}
    )
    runs = datasets.runs_from_frame(frame.iloc[: 1 - rows])
    return fit.posterior(fit.power_law(runs, "AW", ["V", "t"], **options))


def categories(levels=3):
    """Independent rows of several materials, each twice as hard on the edge as the one before."""
    rng = np.random.default_rng(1)
    V = np.tile(np.geomspace(50, 200, 8), levels)
    k = np.repeat(np.arange(levels), 8)
    frame = pd.DataFrame({"V": V, "material": [f"m{i}" for i in k]})
    frame["AW"] = 0.01 * V**0.5 * 2.0**k * np.exp(rng.normal(0, 0.1, len(V)))
    return fit.posterior(fit.power_law(datasets.runs_from_frame(frame, judge=False), "AW", ["V"], by="material"))


def line():
    return fit.posterior(fit.exponential_law(datasets.read_runs(datasets.bundled("surf_table1"))))


@pytest.fixture(scope="module")
def posteriors():
    return {
        "bundled": bundled(),
        "one factor": bundled(["t"]),
        "natural units": bundled(error="additive"),
        "Student errors": bundled(draws_by={"errors": "student"}),
        "independent rows": bundled(edge=None),
        "forty edges": many_edges(),
        "materials": categories(),
        "exponential": line(),
    }


LOOKED_AT = [
    *((name, what) for name in ("bundled", "exponential") for what in KINDS),
    ("Student errors", "marginals"), ("Student errors", "pairs"), ("materials", "curves"), ("one factor", "curves"),
    ("natural units", "predictive"), ("natural units", "curves"), ("independent rows", "predictive"),
    ("forty edges", "predictive"),
]  # fmt: skip


def panels(posterior, what, **options):
    drawn = posterior_figure(posterior, kind=what, **options)
    return [drawn] if isinstance(drawn, Axes) else list(drawn)


def line_of(ax, label):
    return next(artist for artist in ax.lines if artist.get_label() == label)


def band_of(ax, label):
    """Lowest and highest y of a filled band at its first and last x."""
    band = next(artist for artist in ax.collections if artist.get_label() == label)
    points = band.get_paths()[0].vertices
    ends = [points[np.isclose(points[:, 0], x, rtol=1e-12)][:, 1] for x in (points[:, 0].min(), points[:, 0].max())]
    return [(y.min(), y.max()) for y in ends]


# What a picture looks like


def boxes_of(ax, renderer):
    """What stands around a panel: tick labels with axis labels, and the title."""
    found = [axis.get_tightbbox(renderer) for axis in (ax.xaxis, ax.yaxis)]
    found += [ax.title.get_window_extent(renderer)] if ax.get_title() else []
    return [box for box in found if box is not None]


def apart(boxes):
    for one, other in combinations(boxes, 2):
        assert not one.overlaps(other)


def sound(axes):
    """Nothing reaches out of the figure, or into another panel, the title or the legend."""
    figure = axes[0].figure
    figure.draw_without_rendering()
    renderer = figure._get_renderer()
    whole = figure.bbox.padded(1)
    single = [text.get_window_extent(renderer) for text in figure.texts if text.get_text()]
    single += [legend.get_window_extent(renderer) for legend in figure.legends if legend.get_texts()]
    groups = [[box] for box in single]
    for ax in axes:
        around = boxes_of(ax, renderer)
        inside = [text.get_window_extent(renderer) for text in ax.texts]
        assert all(ax.bbox.padded(1).containsx(b.x0) and ax.bbox.padded(1).containsx(b.x1) for b in inside)
        groups.append([ax.get_window_extent(renderer), *around])
        for axis in (ax.xaxis, ax.yaxis):
            low, high = sorted(axis.get_view_interval())
            ticks = [
                text for at, text in zip(axis.get_ticklocs(), axis.get_ticklabels(), strict=False) if low <= at <= high
            ]
            apart([text.get_window_extent(renderer) for text in ticks if text.get_visible() and text.get_text()])
    for box in (box for group in groups for box in group):
        assert whole.x0 <= box.x0 <= box.x1 <= whole.x1, box
        assert whole.y0 <= box.y0 <= box.y1 <= whole.y1, box
    for one, other in combinations(groups, 2):
        assert not any(a.padded(-1).overlaps(b.padded(-1)) for a in one for b in other)


@pytest.mark.parametrize(("name", "what"), LOOKED_AT)
def test_nothing_overlaps_and_every_axis_has_its_unit(posteriors, name, what):
    axes = panels(posteriors[name], what)
    sound(axes)
    for ax in axes:
        assert ax.lines
        for axis in (ax.xaxis, ax.yaxis):
            reported = any(label.get_visible() and label.get_text() for label in axis.get_ticklabels())
            assert not reported or re.search(r"\[.+\]$", axis.get_label_text()), axis.get_label_text()
            assert all(label.get_fontsize() >= 7 for label in axis.get_ticklabels())
    assert any(ax.get_xlabel() for ax in axes)
    assert axes[0].get_ylabel()


@pytest.mark.parametrize("what", KINDS)
def test_pictures_of_a_real_mill(measurements, what):
    runs = datasets.read_runs(
        measurements / "nasa_milling" / "nasa_mill_runs.csv", map={"edge": "case", "t": "time", "d": "DOC"}
    )
    post = fit.posterior(fit.power_law(runs, "VB", ["f", "d", "t"], by="material"))
    axes = panels(post, what)
    sound(axes)
    assert len(axes) == {"marginals": 7, "pairs": 21, "predictive": 15, "curves": 6}[what]


@pytest.mark.parametrize(
    ("name", "numbers"),
    [
        ("bundled", (7, 21, 24, 4)),
        ("independent rows", (6, 15, 1, 4)),
        ("forty edges", (5, 10, 24, 2)),
        ("materials", (5, 10, 1, 3)),
        ("exponential", (3, 3, 1, 1)),
    ],
)
def test_how_many_panels_there_are(posteriors, name, numbers):
    assert tuple(len(panels(posteriors[name], what)) for what in KINDS) == numbers


@pytest.mark.parametrize(
    ("name", "scales"),
    [("bundled", ("log", "log")), ("natural units", ("log", "log")), ("exponential", ("linear",) * 2)],
)
def test_axes_are_logarithmic_where_the_law_is_a_power_law(posteriors, name, scales):
    assert {(ax.get_xscale(), ax.get_yscale()) for ax in panels(posteriors[name], "curves")} == {scales}


def test_a_band_that_reaches_zero_is_not_on_a_logarithmic_axis():
    post = many_edges(scatter=0.45, error="additive")
    for what in ("predictive", "curves"):
        axes = panels(post, what)
        sound(axes)
        assert {ax.get_yscale() for ax in axes} == {"linear"}


def test_drawing_leaves_pyplot_alone_and_the_method_hands_it_the_figure(tmp_path):
    code = (
        "import sys; from fitmodels import datasets, fit; from fitmodels.fit.bayes.figures import posterior_figure; "
        "law = fit.power_law(datasets.read_runs(datasets.bundled('gc435_709m40')), 'AW', ['t']); "
        "post = fit.posterior(law); posterior_figure(post, kind='curves').figure.savefig(sys.argv[1]); "
        "print('matplotlib.pyplot' in sys.modules); ax = post.plot('curves'); import matplotlib.pyplot as plt; "
        "print(plt.gcf() is ax.figure, plt.get_fignums()); plt.close(); print(plt.get_fignums())"
    )
    run = subprocess.run([sys.executable, "-c", code, tmp_path / "a.png"], capture_output=True, text=True, check=True)
    assert run.stdout.splitlines() == ["False", "True [1]", "[]"]
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")


# What is in it


def test_priors_are_drawn_on_the_scale_of_the_draws():
    """Normal, half-t, beta and gamma of scipy; the constant's by drawing level and exponents from theirs."""
    given = {"AW": {"V": {"distribution": "normal", "mean": 0.6, "sd": 0.3}}}
    post = bundled(draws_by={"errors": "student", "priors": given})
    known = {"V": stats.norm(0.6, 0.3), "f": stats.norm(0, 2), "icc": stats.uniform(), "nu": stats.gamma(2, scale=10)}
    for name, ax in zip(post.names, panels(post, "marginals"), strict=True):
        x, y = line_of(ax, "prior").get_data()
        if name in known:
            assert y == pytest.approx(known[name].pdf(x), rel=1e-9)
        if name == "sd":
            assert y == pytest.approx(2 * stats.t(4, scale=0.3).pdf(x), rel=1e-9)
        if name == "ln c0":
            rng = np.random.default_rng(1)
            drawn = {key: prior.draw(rng, 200_000) for key, prior in post.priors.of.items()}
            middle = np.log(post.law.X).mean(axis=0)
            constant = drawn["level"] - sum(drawn[f] * m for f, m in zip(CONDITIONS, middle, strict=True))
            assert y == pytest.approx(stats.norm(constant.mean(), constant.std()).pdf(x), rel=0.02)


def test_histograms_hold_all_the_mass(posteriors):
    for ax in panels(posteriors["bundled"], "marginals"):
        values, edges, _ = ax.patches[0].get_data()
        assert np.sum(values * np.diff(edges)) == pytest.approx(1, abs=1e-9)


def test_flat_priors_have_no_density():
    post = bundled(draws_by={"priors": "reference"})
    labels = [[artist.get_label() for artist in ax.lines] for ax in panels(post, "marginals")]
    assert ["prior" in found for found in labels] == [False] * 6 + [True]  # the share between edges is uniform


def test_intervals_and_least_squares_are_marked(posteriors):
    post = posteriors["bundled"]
    ends = post.interval()
    for j, (name, ax) in enumerate(zip(post.names, panels(post, "marginals"), strict=True)):
        dashed = sorted(artist.get_xdata()[0] for artist in ax.lines if artist.get_linestyle() == "--")
        assert dashed == pytest.approx(ends.loc[name].to_list(), rel=1e-12)
        if j < len(post.law.theta):
            assert line_of(ax, "least squares").get_xdata()[0] == pytest.approx(post.law.theta[j])
    assert line_of(ax, "least squares").get_xdata()[0] == pytest.approx(post.law.edges.icc)


def test_pairs_tell_their_correlation(posteriors):
    post = posteriors["bundled"]
    reported = [float(ax.texts[0].get_text().replace("−", "-")) for ax in panels(post, "pairs")]
    r = np.corrcoef(post.draws.T)
    assert reported == pytest.approx([r[i, j] for i in range(1, 7) for j in range(i)], abs=0.006)


def test_only_the_parameters_that_hang_together_are_paired_where_there_are_many():
    post = categories(levels=12)
    axes = panels(post, "pairs")
    assert len(axes) == 36
    assert "the 9 of 14 most correlated" in axes[0].figure._suptitle.get_text().replace("\n", " ")
    sound(axes)


def test_rows_of_an_edge_lie_in_the_band_that_predict_gives(posteriors):
    post = posteriors["bundled"]
    ax = next(ax for ax in panels(post, "predictive") if ax.get_title().startswith("E07"))
    mine = post.law.edge == "E07"
    rows = pd.DataFrame(post.law.X[mine], columns=CONDITIONS).sort_values("t").iloc[[0, -1]]
    expected = post.predict(rows, "prediction").to_frame()
    drawn = band_of(ax, "95 % of a row of a new edge")
    width = np.log(expected["high"] / expected["low"]).to_numpy()
    for side, name in enumerate(("low", "high")):
        off = np.log([band[side] for band in drawn] / expected[name].to_numpy()) / width
        assert np.abs(off).max() < MONTE_CARLO
    seen = np.concatenate([artist.get_ydata() for artist in ax.lines if artist.get_marker() == "o"])
    assert sorted(seen) == pytest.approx(sorted(post.law.observed[mine]))


def test_edges_that_lie_outside_are_seen_and_counted(posteriors):
    post = posteriors["one factor"]  # without V, f and d edges differ much
    said = 0
    for ax in panels(post, "predictive"):
        outside = sum(len(artist.get_ydata()) for artist in ax.lines if artist.get_label() == "rows outside")
        reported = re.search(r": (\d+) of \d+ outside", ax.get_title())
        assert (int(reported[1]) if reported else 0) == outside
        assert (to_rgb(ax.title.get_color()) == ORANGE) == bool(outside)
        said += outside
    assert 0 < said < 0.1 * post.law.nobs


def test_edges_are_chosen_evenly_in_their_order_and_the_title_says_so(posteriors):
    axes = panels(posteriors["forty edges"], "predictive")
    number = [int(re.match(r"e(\d+)", ax.get_title())[1]) for ax in axes]
    assert number == sorted(number)
    assert (number[0], number[-1]) == (1, 40)
    assert set(np.diff(number)) == {1, 2}
    assert "139 of 235 rows of 24 of 40 edges, evenly chosen" in axes[0].figure._suptitle.get_text()
    low, high = band_of(axes[-1], "95 % of a row of a new edge")  # its one row has a band that can be seen
    assert low == pytest.approx(high)


def test_rows_without_edges_are_one_panel_in_the_order_of_the_prediction(posteriors):
    ax = posteriors["independent rows"].plot("predictive")
    assert (np.diff(line_of(ax, "median").get_ydata()) > -1e-3).all()
    outside = line_of(ax, "rows outside")
    assert ax.get_title() == f"{len(outside.get_xdata())} of 239 outside"
    assert 2 <= len(outside.get_xdata()) <= 24  # of 12 expected


def test_curves_are_what_predict_gives(posteriors):
    post = posteriors["bundled"]
    middle = {name: np.sqrt(low * high) for name, (low, high) in post.law.domain.items()}
    for name, ax in zip(CONDITIONS, panels(post, "curves"), strict=True):
        x, y = line_of(ax, "median").get_data()
        whole, row = (post.predict({**middle, name: x[[0, -1]]}, kind).to_frame() for kind in ("mean", "prediction"))
        assert y[[0, -1]] == pytest.approx(whole["value"].to_numpy(), rel=1e-9)
        assert band_of(ax, "95 % of the law") == pytest.approx(whole[["low", "high"]].to_numpy(), rel=1e-9)
        assert band_of(ax, "95 % of a row of a new edge") == pytest.approx(row[["low", "high"]].to_numpy(), rel=0.03)


@pytest.mark.parametrize("name", ["bundled", "natural units", "materials"])
def test_rows_keep_their_distance_from_the_law_when_they_are_moved(posteriors, name):
    post = posteriors[name]
    law, middle = post.law, np.median(post.draws[:, : len(post.law.theta)], axis=0)
    fitted = law.formula.response_at(middle, law.formula.design(law.X, law.shifts))
    away = law.observed - fitted if name == "natural units" else np.log(law.observed / fitted)
    for ax in panels(post, "curves")[: len(law.factors)]:
        x, y = line_of(ax, "rows").get_data()
        grid, curve = line_of(ax, "median").get_data()
        there = np.exp(np.interp(np.log(x), np.log(grid), np.log(curve)))
        moved = y - there if name == "natural units" else np.log(y / there)
        expected = away[law.shifts.sum(axis=1) == 0]
        assert moved == pytest.approx(expected, abs=0.02 * np.abs(away).max() + 1e-3)


def test_rows_of_a_law_of_one_factor_stay_where_they_are(posteriors):
    law = posteriors["one factor"].law
    x, y = line_of(posteriors["one factor"].plot("curves"), "rows").get_data()
    assert np.array_equal(x, law.X[:, 0])
    assert y == pytest.approx(law.observed, rel=1e-12)


@pytest.mark.parametrize("name", ["bundled", "exponential", "materials"])
def test_what_was_not_tested_is_grey(posteriors, name):
    post = posteriors[name]
    axes = panels(post, "curves")
    for factor, ax in zip(post.law.factors, axes, strict=False):
        spans = [patch.get_x() + np.array([0, patch.get_width()]) for patch in ax.patches]
        assert (spans[0][1], spans[1][0]) == pytest.approx(post.law.domain[factor])
        assert (spans[0][0], spans[1][1]) == pytest.approx(ax.get_xlim())


def test_of_many_rows_some_are_drawn_and_what_was_tested_is_reported_of_all():
    post = many_edges(edges=201)
    for factor, ax in zip(post.law.factors, panels(post, "curves"), strict=True):
        assert len(line_of(ax, "rows").get_xdata()) == 1000
        assert "at most 1000 rows in a panel" in ax.figure._suptitle.get_text().replace("\n", " ")
        assert ax.patches[0].get_x() + ax.patches[0].get_width() == pytest.approx(post.law.domain[factor][0])


# What is asked


def test_one_panel_is_drawn_on_axes_that_are_given(posteriors):
    ax = Figure().subplots()
    assert posteriors["one factor"].plot("curves", ax) is ax
    assert ax.get_title() == "AW on t"
    assert ax.get_legend() is not None


@pytest.mark.parametrize("what", ["marginals", "pairs", "predictive", "curves"])
def test_several_panels_are_not_drawn_on_one(posteriors, what):
    with pytest.raises(UsageError, match=rf"^{what} of AW has \d+ panels, and ax is one: omit ax"):
        posteriors["bundled"].plot(what, Figure().subplots())


@pytest.mark.parametrize(
    ("what", "hint"), [("pair", "Did you mean 'pairs'"), ("predictiv", "Did you mean 'predictive'"), ("", "curves.$")]
)
def test_a_picture_that_there_is_not(posteriors, what, hint):
    with pytest.raises(UsageError, match=f"Posterior: no figure of kind '{what}'. .*{hint}"):
        posteriors["bundled"].plot(what)


@pytest.mark.parametrize("what", KINDS)
def test_what_was_not_measured_says_so(posteriors, what):
    post = posteriors["exponential"]
    noted = replace(post, notes=("simulated: no real measurement; drawn from published laws",))
    for asked, banner, reported in ((post, "", ""), (post, "not measured", "not measured"),
                                (noted, "", "simulated: no real measurement")):  # fmt: skip
        axes = panels(asked, what, banner=banner)
        texts = [text.get_text() for text in axes[0].figure.texts if text is not axes[0].figure._suptitle]
        assert texts == [reported]
        sound(axes)


def test_a_long_banner_fits(posteriors):
    sound(panels(posteriors["one factor"], "curves", banner="not measured, but computed from published laws " * 3))


def test_a_banner_is_written_on_axes_that_are_given(posteriors):
    ax = posteriors["one factor"].plot("curves", Figure().subplots(), banner="not measured")
    assert "not measured" in [text.get_text() for text in ax.texts]


def test_the_posterior_stays_as_it_was(posteriors):
    post = posteriors["exponential"]
    kept = post.draws.copy()
    for what in KINDS:
        post.plot(what)
    assert np.array_equal(post.draws, kept)
