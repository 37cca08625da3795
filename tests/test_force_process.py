"""Drive and milling process from command and force: what a record tells, what it does not, and how it says so."""

import matplotlib as mpl
import numpy as np
import pytest
from fitmodels.core.errors import IdentError
from fitmodels.datasets import Record
from fitmodels.ident.continuous import sampled
from fitmodels.ident.physical_models.force_process import RATIOS, force_process_fit
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

pytestmark = pytest.mark.slow

mpl.use("agg")
M, D, C, K = 2.0, 60.0, 8.0, 400.0  # no published values: a drive of 30 rad/s and a process of 8 rad/s
TRUTH = np.array([M, M * C + D, D * C]) / K
DEPTHS = (1.0, 2.0, 4.0)  # mm, as cut in the paper; the force, and so k, scales with depth


def run(k=K, noise=0.0, seed=0, n=1500, dt=0.01, m=M, d=D, c=C, delay=0.0, scale=1.0):
    u = 1 + np.sin(0.0003 * np.arange(float(n)) ** 2)
    F = sampled([k], [m, m * c + d, d * c], dt, delay).simulate(u)
    e = np.random.default_rng(seed).standard_normal(n)
    return Record(u=u, y=scale * (F + noise * F.std() * e), sample_time=dt, input="f_r", output="F", unit_y="N")


def test_the_two_equations_are_the_simulated_process():
    """(2.1) and (2.2) integrated as they stand, by scipy, under a held command."""
    u = run(n=150).u

    def slope(t, s):
        v, F = s
        return [(u[min(int(t / 0.01 + 1e-9), 149)] - D * v) / M, K * v - C * F]

    F, state = [], np.zeros(2)
    for k in range(150):
        F.append(state[1])
        state = solve_ivp(slope, [k * 0.01, (k + 1) * 0.01 - 1e-12], state, rtol=1e-9, atol=1e-12).y[:, -1]
    np.testing.assert_allclose(F, run(n=150).y, atol=1e-6)


@pytest.mark.parametrize("depth", DEPTHS)
def test_depth_scales_k_alone(depth):
    fit = force_process_fit(run(k=K * depth), m=M, drive="faster")
    np.testing.assert_allclose(fit.ratios, TRUTH / depth, rtol=1e-6)
    assert fit.parameters == pytest.approx({"m": M, "d": D, "c": C, "k": K * depth}, rel=1e-5)
    assert fit.fit > 99.99


@pytest.mark.parametrize("depth", DEPTHS)
def test_depth_scales_k_alone_under_noise(depth):
    fit = force_process_fit(run(k=K * depth, noise=0.02, seed=int(depth)), m=M, drive="faster")
    for name, value in {"d": D, "c": C, "k": K * depth}.items():
        assert abs(fit.parameters[name] - value) < 3 * fit.parameter_errors[name], name
    assert fit.parameter_errors["k"] < 0.02 * K * depth


@pytest.mark.parametrize("known", [{"m": M}, {"k": K}, {"d": D}], ids=["m", "k", "d"])
def test_one_known_value_gives_the_others(known):
    fit = force_process_fit(run(noise=0.02), **known, drive="faster")
    errors = fit.parameter_errors
    (name,) = known
    assert errors[name] == 0.0
    assert fit.identifiable[name] == "given"
    for other, value in {"m": M, "d": D, "c": C, "k": K}.items():
        assert abs(fit.parameters[other] - value) <= 3 * errors[other], other
    assert "with" in fit.identifiable["c"]


def test_which_pole_is_the_drives_cannot_be_determined():
    """Exchanged, m c + d and d c stay: the same force from another machine."""
    fast, slow = (force_process_fit(run(), m=M, drive=which) for which in ("faster", "slower"))
    np.testing.assert_allclose(fast.ratios, slow.ratios)
    p = slow.parameters
    assert (p["c"], p["d"] / p["m"]) == pytest.approx((D / M, C), rel=1e-5)
    other = run(m=p["m"], d=p["d"], c=p["c"], k=p["k"])
    np.testing.assert_allclose(other.y, run().y, rtol=1e-5)


def test_without_a_known_value_products_alone_are_reported():
    fit = force_process_fit(run(noise=0.02))
    assert fit.parameters == {}
    assert set(fit.identifiable) >= {"m", "d", "c", "k", *RATIOS}
    assert fit.identifiable["m/k"] == "from the record alone"
    assert "only as the products m/k, (mc+d)/k and dc/k" in fit.identifiable["k"]
    assert "in an order that is not identifiable" in fit.identifiable["c, d/m"]
    assert "only as the products" in fit.words
    assert "give drive='faster' or 'slower'" in force_process_fit(run(), k=K).identifiable["c"]


@settings(max_examples=10, deadline=None)
@given(st.floats(0.01, 100.0))
def test_units_of_force_scale_the_ratios(scale):
    one, two = force_process_fit(run(noise=0.01)), force_process_fit(run(noise=0.01, scale=scale))
    np.testing.assert_allclose(two.ratios * scale, one.ratios, rtol=1e-6)
    np.testing.assert_allclose(two.bse * scale, one.bse, rtol=1e-3)


def test_errors_hold():
    """40 draws at 34 dB: z of the ratios, of d, c, k, and of the coefficient that is zero."""
    z = []
    for seed in range(40):
        fit = force_process_fit(run(noise=0.02, seed=seed), m=M, drive="faster")
        p, s = fit.parameters, fit.parameter_errors
        reported = [(p[n] - v) / s[n] for n, v in {"d": D, "c": C, "k": K}.items()]
        z.append([*((fit.ratios - TRUTH) / fit.bse), *reported, fit.zero_test])
    assert (np.abs(z) < 1.96).mean() > 0.9
    assert 0.8 < np.std(z) < 1.2


def test_simulation_and_picture():
    fit = force_process_fit(run(noise=0.02))
    clean = run()
    assert np.abs(fit.simulate(clean.u) - clean.y).max() < 0.01 * np.ptp(clean.y)
    fine = fit.simulate(np.repeat(clean.u, 10), 0.001)[::10]
    np.testing.assert_allclose(fine, fit.simulate(clean.u), atol=1e-9)
    assert fit.plot().get_ylabel() == "F [N]"
    assert 97 < fit.fit < 99
    assert fit.verdict.level == 0
    assert force_process_fit(run(noise=0.7)).verdict.level >= 1
    centred = force_process_fit(run(noise=0.02).centred())
    np.testing.assert_allclose(centred.ratios, TRUTH, rtol=0.03)


@pytest.mark.parametrize(
    ("rate", "rpm", "stated", "level"),
    [
        (1000, 15000, 4, 2),  # 4 samples a revolution, each at the same angle of the 4 teeth
        (1000, 15000, None, 2),
        (1000, 20000, 3, 2),
        (100, 3000, None, 2),
        (1000, 12000, 3, 0),  # 5 samples
        (1000, 12000, None, 1),  # of 5 teeth they would be at one angle
        (1000, 3000, None, 0),
        (100, 12000, None, 2),  # less than a sample a revolution
    ],
)
def test_samples_at_the_same_angles_of_the_teeth_are_no_mean_force(rate, rpm, stated, level):
    """The gain was wrong by a factor of 2.5, at a fit of 90 %."""
    rec = run(dt=1 / rate, n=1500, m=2 * 0.01 * rate, c=8 / 0.01 / rate)
    teeth = stated or 4
    t = np.arange(len(rec)) / rate
    ripple = 1 + 0.6 * np.cos(2 * np.pi * teeth * rpm / 60 * t + 1)
    rec = Record(u=rec.u, y=rec.y * ripple, sample_time=rec.sample_time, input="f_r", output="F", unit_y="N")
    fit = force_process_fit(rec, revolution=60 / rpm, teeth=stated, proportional=False)
    assert [found for found, _ in fit.doubts] == ([level] if level else [])
    assert fit.verdict.level >= level
    if level == 2:
        assert "do not give the mean force of a cutter with" in fit.verdict.reasons[0]


def milled(limit=np.inf, command=np.inf, teeth=lambda angle: 1 + 0.3 * np.sin(angle), seed=1):
    """Force of two teeth at 3000 1/min, sampled at 1 kHz; the command is 250 +- 100 mm/min."""
    t = np.arange(6000) / 1000
    u = 250 + 100 * np.sin(2 * np.pi * (0.1 + 0.4 * t) * t)
    F = sampled([0.8 * 625], [1.0, 62.5, 625.0], 0.001).simulate(np.minimum(u, command) - 250) + 200
    F = F * teeth(2 * np.pi * 100 * t) + 2 * np.random.default_rng(seed).standard_normal(len(t))
    y = np.minimum(F.round(2), limit)
    rec = Record(u=u, y=y, sample_time=0.001, input="feed", output="force", unit_u="mm/min", unit_y="N")
    return force_process_fit(rec.centred(), revolution=0.02, teeth=2)


@pytest.mark.parametrize("seed", range(3))
def test_a_limited_command_and_a_clipped_force_are_named(seed):
    """The gain was wrong by 20 %, at a clean verdict."""
    assert milled(seed=seed).doubts == ()
    interrupted = milled(teeth=lambda angle: np.maximum(np.pi * np.sin(angle), 0), seed=seed)
    assert interrupted.doubts == ()
    ((level, words), *_) = milled(limit=300.0, seed=seed).doubts
    assert level == 2
    assert words.startswith("The force runs into 300 N and stays there")
    ((level, words), *_) = milled(command=280.0, seed=seed).doubts
    assert level == 1
    assert words.startswith("The force hardly responds to a feed above 2")


@pytest.mark.parametrize(
    ("share", "level"),
    [(0.0, 0), (0.08, 0), (0.2, 1), (-0.25, 1), (0.5, 2), (-0.5, 2)],  # of the mean force by the gain
)
def test_a_force_that_is_not_proportional_to_the_feed_is_a_doubt(share, level):
    """An edge force, or the zero of a sensor: the mean of the record itself contradicts dc/k."""
    rec = run(noise=0.02)
    offset = share * float(rec.u.mean()) / TRUTH[2]
    moved = Record(u=rec.u, y=rec.y + offset, sample_time=rec.sample_time, input="f_r", output="F", unit_y="N")
    fit = force_process_fit(moved.centred())
    assert [found for found, _ in fit.doubts] == ([level] if level else [])
    assert fit.verdict.level == level
    if level:
        assert f"{offset:+.2g}"[:2] in fit.verdict.reasons[0]
        assert "not proportional to the f_r" in fit.verdict.reasons[0]
        assert ("or the F rises as f_r^0.8" in fit.verdict.reasons[0]) == (share == 0.2)
    assert not force_process_fit(moved.centred(), proportional=False).doubts


def test_another_form_is_reported():
    late = force_process_fit(run(noise=0.005, delay=0.008))
    assert abs(late.zero_test) > 3
    assert late.verdict.level == 1
    assert "another structure than (2.1) and (2.2), or there is a delay" in late.verdict.reasons[0]
    rec = run()
    swinging = sampled([K], [2.0, 10.0, 480.0], 0.01).simulate(rec.u)
    fit = force_process_fit(Record(u=rec.u, y=swinging, sample_time=0.01), m=M, drive="faster")
    assert fit.verdict.level == 2
    assert "poles are complex" in fit.verdict.reasons[0]
    assert fit.parameters == {}
    assert "no positive m, d, c gives" in fit.identifiable["d"]


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: force_process_fit(run(), m=M, k=K), "m and k given"),
        (lambda: force_process_fit(run(), m=-1.0), "m -1.0: above zero"),
        (lambda: force_process_fit(run(), m=M, drive="left"), "drive 'left'"),
        (lambda: force_process_fit(run().part(0, 9)), "samples"),
        (lambda: force_process_fit(Record(u=np.ones(500), y=np.ones(500), sample_time=0.01)), "does not vary"),
        (
            lambda: force_process_fit(Record(u=U, y=np.r_[0, 0.9 * U[:-1] - 0.4 * np.r_[0, U[:-2]]], sample_time=0.01)),
            "no continuous form",
        ),
    ],
    ids=["two given", "negative", "drive", "short", "constant", "a finite response"],
)
def test_refusals(call, says):
    with pytest.raises(IdentError) as error:
        call()
    assert says in str(error.value)


U = np.random.default_rng(0).standard_normal(400)
