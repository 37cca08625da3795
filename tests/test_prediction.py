"""The parameter file predicts what the fit predicts, with intervals by edge, and those hold for a new edge."""

import numpy as np
import pytest
from fitmodels import datasets, fit, parameters

AT = {"V": [60.0, 120.0, 200.0], "f": 0.3, "d": 2.0, "t": [2.0, 10.0, 20.0]}


@pytest.mark.parametrize("error", ["multiplicative", "additive"])
@pytest.mark.parametrize("kind", ["mean", "prediction"])
def test_the_file_and_the_fit_agree(error, kind):
    runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    law = fit.power_law(runs, "AW", ["V", "f", "d", "t"], error=error)
    section = parameters.collect(tool="GC435", work="709M40", laws=[law]).laws["AW"]
    frame = {name: np.broadcast_to(values, 3) for name, values in AT.items()}
    band = law.predict(frame, kind, level=0.9)
    low, high = section.interval(0.9, kind, **AT)
    np.testing.assert_allclose(section.predict(**AT), band["value"], rtol=1e-12)
    np.testing.assert_allclose(low, band["low"], rtol=1e-9)
    np.testing.assert_allclose(high, band["high"], rtol=1e-9)
    assert section.uncertainty.method == "jackknife by edge (CR3)"
    assert section.uncertainty.df == 23


def test_prediction_intervals_hold_for_new_edges():
    """120 simulated tests, each judged on new edges of another: 95 % +- four standard errors of Monte Carlo."""
    ranges = {"V": (50, 200), "f": (0.06, 0.6), "d": (1.5, 3)}
    truth = {"V": 0.577, "f": 0.168, "d": 0.248, "t": 0.245}
    laws = [datasets.SimulatedLaw("AW", "mm", 7.62e-3, truth, 0.07, 0.07, digits=12)]
    plan = datasets.central_composite(ranges, seed=1)
    inside = []
    for seed in range(120):
        old, new = (
            datasets.runs_from_frame(datasets.simulate(plan, laws, t_max=12.0, criterion=None, seed=s))
            for s in (seed, 1000 + seed)
        )
        law = fit.power_law(old, "AW", list(truth))
        band = law.predict(new.data[list(truth)], "prediction")
        hit = (new.values("AW") >= band["low"]) & (new.values("AW") <= band["high"])
        inside.append(hit.mean())
    error = np.std(inside) / np.sqrt(len(inside))
    assert np.mean(inside) == pytest.approx(0.95, abs=4 * error + 0.005)


def test_the_file_knows_the_region_of_the_design():
    """The corner of the axial box has 2.6 times the largest leverage of the 24 edges: outside, as `domain` says."""
    runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    law = fit.power_law(runs, "AW", ["V", "f", "d", "t"])
    section = parameters.collect(tool="GC435", work="709M40", laws=[law]).laws["AW"]
    rng = np.random.default_rng(2)
    points = {name: np.exp(rng.uniform(*np.log(ends), 300)) for name, ends in law.domain.items()}
    np.testing.assert_array_equal(section.inside(**points), fit.domain(law).inside(points))
    assert section.inside(V=100, f=0.2, d=2, t=8) is True
    assert section.inside(V=200, f=0.6, d=3, t=8) is False
    assert section.inside(**{name: runs.values(name) for name in ("V", "f", "d", "t")}).all()
