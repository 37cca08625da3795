"""The mechanistic force of an end mill against a sum over disc elements, its power balance, and CLM-2023's load line.

The figures of the slot and of the end milling cut were computed by a sum over 20000 angles and 401 discs, apart from
this package; geometry of Tai, Tsai & Li 2023, doi 10.1109/ACCESS.2023.3330587 (2 mm, two flutes, helix 38 deg).
"""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from fitmodels import fit
from fitmodels.core.errors import FitError, UsageError
from fitmodels.datasets import runs_from_frame

PAPER = {"feed_per_tooth": 0.035, "axial_depth": 0.2, "diameter": 2, "teeth": 2, "helix": 38}


def cut(ae=2.0, **changes):
    return fit.end_mill_force(2500, radial_depth=ae, **{**PAPER, **changes})


def discs(c, n=6001, angles=720):
    """Mean and largest force by discs and angles, from eq. 6 to 8 alone."""
    z = (np.arange(n) + 0.5) / n * c.axial_depth
    start, end = np.radians(c.engagement)
    total = np.zeros(angles)
    phi = np.arange(angles) / angles * 2 * np.pi
    for k in range(c.teeth):
        alpha = phi[:, None] + 2 * np.pi * k / c.teeth - z * np.tan(np.radians(c.helix)) * 2 / c.diameter
        alpha %= 2 * np.pi
        inside = (alpha >= start) & (alpha <= end)
        chip = c.feed_per_tooth * np.where(inside, np.sin(alpha), 0)
        total += c.specific_force * chip.sum(axis=1) * c.axial_depth / n
    return total.mean(), total.max()


@pytest.mark.parametrize(("ae", "mean", "sum_of_discs"), [(2.0, 11.140846, 11.140846), (1.4, 7.798592, 7.798597)])
def test_mean_force_of_slot_and_end_milling(ae, mean, sum_of_discs):
    assert cut(ae).mean_force == pytest.approx(mean, abs=6e-7)
    assert cut(ae).mean_force == pytest.approx(sum_of_discs, rel=1e-6)


def test_peak_lag_torque_and_power_of_the_slot():
    slot = cut()
    assert slot.peak_force == pytest.approx(17.482, abs=6e-4)
    assert slot.lag == pytest.approx(8.953, abs=5e-4)
    assert slot.torque == pytest.approx(0.0111408, abs=5e-8)
    assert slot.power(10_000) == pytest.approx(11.66667, abs=5e-6)
    assert slot.power(10_000) == pytest.approx(2500 * slot.removal_rate(10_000) / 60_000, rel=1e-12)


@pytest.mark.parametrize("milling", ["up", "down"])
@pytest.mark.parametrize(
    ("ae", "teeth", "helix", "da"), [(1.4, 2, 38, 0.2), (0.3, 3, 30, 4.0), (2, 1, 0, 1), (1, 4, 55, 9)]
)
def test_force_at_an_angle_is_the_sum_of_discs(ae, teeth, helix, da, milling):
    c = cut(ae, teeth=teeth, helix=helix, axial_depth=da, milling=milling)
    mean, peak = discs(c)
    assert c.force_at(np.linspace(0, 360, 3600, endpoint=False)).mean() == pytest.approx(c.mean_force, rel=2e-4)
    assert (c.mean_force, c.peak_force) == (pytest.approx(mean, rel=2e-3), pytest.approx(peak, rel=4e-3))


def test_the_mean_does_not_depend_on_helix_or_direction():
    means = [cut(1.4, helix=h, milling=m).mean_force for h in (0, 20, 60) for m in ("up", "down")]
    assert np.ptp(means) < 1e-12


def test_slope_of_the_load_line_per_feed_rate_and_per_tooth():
    """B of eq. 13 is that of eq. 12 over n Nt, and current times Kt is the torque."""
    c = cut(1.4)
    B = c.load_slope(0.5, 10_000)
    assert pytest.approx(2.22817e-5, abs=6e-11) == B
    fm = c.feed_per_tooth * c.teeth * 10_000
    assert B * fm * 0.5 == pytest.approx(c.torque, rel=1e-12)


def load_law(B=1.2416e-4, noise=1e-3):
    rng = np.random.default_rng(1)
    fm, VB = np.tile([500.0, 700, 900, 1100], 6), np.repeat([0.02, 0.05, 0.09, 0.12, 0.16, 0.2], 4)
    current = 0.1158 + B * fm + 0.2226 * VB + noise * rng.normal(size=24)
    frame = pd.DataFrame({"fm": fm, "VB": VB, "I": current})
    return fit.load_law(runs_from_frame(frame, units={"fm": "mm/min", "VB": "mm", "I": "A"}))


def test_the_papers_slope_needs_a_torque_constant_of_its_own():
    """Kf/Kt 27861 of the paper's B 1.2416e-4: Kt .090 N m/A at Kf 2500."""
    found = cut(1.4).compare_load_line(load_law(noise=1e-9), 0.5, 10_000)
    assert found.needed_ratio == pytest.approx(27861, rel=1e-4)
    assert "5.57 times the predicted one" in found.sentence
    again = cut(1.4).compare_load_line(load_law(), 2500 / 27861, 10_000)
    assert again.low < again.predicted < again.high
    assert again.sentence.endswith("they agree within the interval.")
    Kf, low, high = again.fitted_specific_force
    assert low < 2500 < high
    assert Kf == pytest.approx(2500, rel=0.05)


def test_another_law_or_unit_is_refused():
    c = cut(1.4)
    with pytest.raises(FitError, match=r"in mA on mm/min; B is computed in A/\(mm/min\)"):
        c.compare_load_line(replace(load_law(), units={"I": "mA", "fm": "mm/min", "VB": "mm"}), 0.5, 10_000)
    power = fit.power_law(runs_from_frame(pd.DataFrame({"fm": [1.0, 2, 3], "I": [2.0, 4, 5.9]})), "I", ["fm"])
    with pytest.raises(FitError, match="is a power; fit runs in which"):
        c.compare_load_line(power, 0.5, 10_000)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"ae": 2.1}, "radial_depth 2.1 mm is above the diameter 2 mm"),
        ({"teeth": 0}, "teeth 0: a whole number"),
        ({"helix": 90}, "helix 90 degrees"),
        ({"axial_depth": 0}, "axial_depth 0 mm: it must be a number above zero"),
        ({"milling": "slot"}, "give 'down' or 'up'"),
    ],
)
def test_impossible_geometry_is_refused(changes, words):
    with pytest.raises(UsageError, match=words):
        cut(**changes)
