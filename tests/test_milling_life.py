"""Tools at constant load from their first pass to their change, from the published files alone.

Figures of Tai, Tsai & Li 2023, doi 10.1109/ACCESS.2023.3330587. The paper prints no wear law: VB = r t by its lives at
constant feed with an assumed criterion, so gains are asked for in bands and not to a digit.
"""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from fitmodels import parameters
from fitmodels.cards import replays
from fitmodels.cards.replays import constant_load
from fitmodels.controllers.constant_load_milling.cut_model import CutModel
from fitmodels.controllers.constant_load_milling.mixed_path import mixed_run
from fitmodels.controllers.constant_load_milling.plant import MillingCut
from fitmodels.controllers.constant_load_milling.runs import constant_feed_run, constant_load_run
from fitmodels.controllers.constant_load_milling.steady import drawn_life, steady_life
from fitmodels.core.errors import ParameterError, UsageError
from fitmodels.datasets import bundled, read_runs
from fitmodels.parameters import ParameterFile
from fitmodels.parameters.draws import Draws
from fitmodels.parameters.published import milling, published

FILES = ("CLM-2023", "CLM-2023-slot")
RNG = np.random.default_rng(0)  # of plants without noise: never drawn from


@pytest.fixture(scope="module", params=FILES)
def name(request):
    return request.param


@pytest.fixture(scope="module")
def pf(name):
    return published(name)


@pytest.fixture(scope="module")
def runs(pf):
    return constant_load_run(pf), constant_feed_run(pf)


def changed(pf, **sections):
    """The file with parts of its sections put in place of its own."""
    data = pf.model_dump(exclude={"content_sha256"})
    for section, parts in sections.items():
        data[section] = {**data[section], **parts} if isinstance(parts, dict) else parts
    return ParameterFile.model_validate(data)


# ---- what the issue asks of the replay


def test_the_mean_current_of_each_pass_is_within_one_per_cent_until_the_lower_limit(runs):
    run, _ = runs
    assert len(run.regulated) >= 11
    assert all(p.whole and p.length == pytest.approx(150.0, abs=0.5) for p in run.regulated)
    assert max(abs(p.mean_load / 0.24 - 1) for p in run.regulated) < 0.01
    assert run.regulated[-1].number == next(p.number for p in run.passes if p.limited) - 1  # none was left out


def test_the_tool_is_changed_inside_the_window(runs):
    run, _ = runs
    assert run.worn
    assert 180.0 <= run.wear <= 220.0


@pytest.mark.parametrize(("name", "low", "high"), [("CLM-2023", 1.10, 1.25), ("CLM-2023-slot", 1.30, 1.50)])
def test_life_and_removal_gain_over_constant_feed(name, low, high):
    run, fixed = (of(published(name)) for of in (constant_load_run, constant_feed_run))
    assert low < run.length / fixed.length < high
    assert low < run.rate / fixed.rate < high


@pytest.mark.parametrize(
    ("name", "length", "rate"),
    [("CLM-2023", 1800.0, 700 * 1.4 * 0.2 / 60), ("CLM-2023-slot", 1350.0, 400 * 2.0 * 0.2 / 60)],
)
def test_constant_feed_lives_as_long_as_printed_and_removes_what_feed_width_and_depth_give(name, length, rate):
    fixed = constant_feed_run(published(name))
    assert fixed.length == pytest.approx(length, abs=0.5)  # a sample is 0.2 mm
    assert fixed.rate == pytest.approx(rate, rel=1e-9)


def test_the_feed_comes_to_its_limit_where_figures_10_and_13_show_it(name, runs):
    run, _ = runs
    first = next(p for p in run.passes if p.limited)
    low, high = {"CLM-2023": (2000, 2400), "CLM-2023-slot": (1500, 2000)}[name]
    assert low < first.start + first.length < high


def test_on_a_mixed_path_the_wear_lies_between_the_two_that_are_printed():
    """Section III.E, limits of Table 3: 179.48 and 199.63 um."""
    run = mixed_run([published("CLM-2023-slot"), milling.end_milling(upper=1100.0)])
    assert run.worn
    assert 179.48 < run.wear < 199.63
    assert [p.kind for p in run.passes[:4]] == [0, 1, 0, 1]
    assert abs(run.worst_mean) < 0.01
    assert run.removed == pytest.approx(sum(p.length * (0.4, 0.28)[p.kind] for p in run.passes))


def test_each_kind_of_cut_keeps_its_own_limits_on_a_mixed_path():
    run = mixed_run([published("CLM-2023-slot"), milling.end_milling(upper=1100.0)])
    r = run.trace.recorded
    for kind, low, high in ((0, 500.0, 700.0), (1, 600.0, 1100.0)):
        feeds = r["feed"][(r["kind"] == kind) & (r["in_cut"] > 0)]
        assert low * (1 - 1e-12) <= feeds.min() <= feeds.max() <= high * (1 + 1e-12)


# ---- the published files


@pytest.mark.parametrize(
    ("cut", "data"), [(milling.END, "clm2023_end_milling"), (milling.SLOT, "clm2023_slot_milling")]
)
def test_the_points_of_the_files_are_the_bundled_ones(cut, data):
    rows = read_runs(bundled(data))
    held = rows.values("I") == 0.24
    pairs = sorted(zip(rows.values("fm")[held], 1000 * rows.values("VB")[held], strict=True))
    np.testing.assert_allclose(pairs, sorted([(cut.sharp, 0.0), *cut.held]), rtol=1e-12)


def test_k1_over_b_of_end_milling_is_1_99_and_the_idle_current_that_of_three_points():
    cut = CutModel.from_parameters(published("CLM-2023"))
    assert cut.k1 / cut.B == pytest.approx(1.99, abs=0.005)
    feed, load, wear = np.array(milling.THREE).T
    A, B, _ = np.linalg.solve(np.column_stack([np.ones(3), feed, wear]), load)
    np.testing.assert_allclose([cut.A, cut.B], [A, B], rtol=1e-9)


def test_the_scaling_that_follows_is_g_of_1_over_b(pf):
    cut = CutModel.from_parameters(pf)
    assert cut.scaling == pytest.approx(0.0025 / 0.0138 / cut.B)  # sums of eq. 18
    assert sum(cut.b) / sum(cut.a) == pytest.approx(1.0)
    assert pf.pi.scaling_u == pytest.approx(cut.scaling)
    assert any("derived, not printed" in note for note in pf.pi.notes)


def test_a_file_passes_its_check_and_reads_back(pf, tmp_path):
    assert not parameters.check(pf).inconsistent  # its verdicts are "do not use": nothing printed can be checked
    again = parameters.read(parameters.write(pf, tmp_path / "params.json"))
    assert constant_load_run(again).length == constant_load_run(pf).length


# ---- the mill


@pytest.mark.parametrize("n", [0.4, 1.0, 1.7])
@pytest.mark.parametrize("m", [0.0, 0.8])
def test_at_one_feed_wear_is_the_law_of_time_in_the_cut(n, m):
    cut = replace(CutModel.from_parameters(published("CLM-2023")), n=n, m=m, c0=3.0 / 700.0**m)
    mill = MillingCut([cut], programmed=1000.0, gap=1.0)
    in_cut = 0
    for _ in range(2000):
        mill.step(0.7, 0.02, RNG)
        in_cut += int(mill.in_cut)
    assert mill.number > 2
    assert mill.wear == pytest.approx(3.0 * (in_cut * 0.02) ** n, rel=1e-9)
    assert mill.length == pytest.approx(700 / 60 * in_cut * 0.02)


def test_a_feed_that_changes_goes_on_from_the_wear_that_was_reached():
    """Equal wear is equal life gone: 10 s at one feed and 10 s at another, in either order."""
    cut = replace(CutModel.from_parameters(published("CLM-2023")), n=0.5, m=1.2, c0=1e-3)

    def worn(*overrides):
        mill = MillingCut([cut], programmed=1000.0, passes=((0, 1e6),))
        for override in overrides:
            for _ in range(500):
                mill.step(override, 0.02, RNG)
        return mill.wear

    assert worn(0.6, 0.9) == pytest.approx(worn(0.9, 0.6), rel=1e-12)
    assert worn(0.6, 0.9) == pytest.approx(np.hypot(worn(0.6), worn(0.9)), rel=1e-9)  # squares add where n is 1/2


def test_at_rest_the_load_is_the_load_line():
    cut = CutModel.from_parameters(published("CLM-2023-slot"))
    mill = MillingCut([replace(cut, c0=1e-9)], programmed=700.0, passes=((0, 1e6),), wear=100.0)
    load = [mill.step(0.8, 0.02, RNG) for _ in range(2000)][-1]
    assert load == pytest.approx(cut.A + cut.B * 560.0 + cut.k1 * 100.0, rel=1e-6)


def test_out_of_the_cut_nothing_wears_and_the_load_is_idle(pf):
    mill = MillingCut.from_parameters(pf, pass_length=10.0, gap=1.0)
    seen = [(mill.step(1.0, 0.02, RNG), mill.in_cut, mill.wear, mill.length) for _ in range(100)]
    out = [row for row in seen if not row[1]]
    assert len(out) == 50
    assert len({row[2:] for row in out}) == 1
    assert {row[0] for row in out} == {CutModel.from_parameters(pf).A}


def test_noise_is_the_sensor_s_and_the_same_by_seed(pf):
    sensor = {"symbol": "I", "unit": "A", "sd": 0.003}
    noisy = changed(pf, identity={"sensors": [sensor]})
    assert MillingCut.from_parameters(noisy).noise == 0.003
    one, again, other = (constant_load_run(noisy, seed=seed) for seed in (1, 1, 2))
    assert (one.trace.measurement == again.trace.measurement).all()
    assert (one.trace.measurement[:50] != other.trace.measurement[:50]).any()
    assert abs(one.worst_mean) < 0.01
    assert 180 < one.wear < 220


@pytest.mark.parametrize("by", [0.8, 1.25])
def test_a_tool_whose_current_rises_otherwise_is_changed_at_another_wear(pf, by):
    own = CutModel.from_parameters(pf)
    cut = replace(own, k1=by * own.k1)
    run = constant_load_run(pf, plant=MillingCut.from_parameters(pf, cut=cut))
    assert run.wear == pytest.approx(float(steady_life(cut, pf.load_line).wear[0]), rel=0.035)  # and the dwell
    assert run.wear < 180 or run.wear > 220


def test_a_line_of_feed_on_wear_makes_the_same_cut_by_the_scaling_of_the_gains(pf):
    line, cut = pf.laws["I"], CutModel.from_parameters(pf)
    fm0 = (0.24 - cut.A) / cut.B
    held = {
        **line.model_dump(), "form": "feed_line", "response": "fm", "unit": "mm/min", "residual_scale": "mm/min",
        "coefficients": {"fm0": fm0, "slope": -cut.k1 / cut.B}, "factors": [line.factors[1].model_dump()],
    }  # fmt: skip
    other = changed(pf, laws={"fm": held}, load_line={"law": "fm"})
    found = CutModel.from_parameters(other)
    assert (found.A, found.B, found.k1) == pytest.approx((cut.A, cut.B, cut.k1))
    bare = changed(other, pi=None)
    with pytest.raises(ParameterError, match=r"at 0\.24 A alone"):
        CutModel.from_parameters(bare)


# ---- life by calculation


def test_calculated_life_is_that_of_a_straight_line(pf):
    """Feed falls evenly with wear and wear grows evenly: mean feed halfway between sharp and lower limit."""
    cut, line = CutModel.from_parameters(pf), pf.load_line
    sharp = (line.reference - cut.A) / cut.B
    life = steady_life(cut, line)
    minutes = (sharp - line.lower.value) / (cut.k1 / cut.B) / (60 * cut.c0)
    assert float(life.time[0]) == pytest.approx(60 * minutes)
    assert float(life.length[0]) == pytest.approx(minutes * (sharp + line.lower.value) / 2)


def test_a_replay_lives_as_calculated_and_the_dwell_longer(pf, runs):
    life = steady_life(CutModel.from_parameters(pf), pf.load_line)
    assert 0.99 * life.length[0] < runs[0].length < life.length[0] + 4.0 * pf.load_line.lower.value / 60 + 2


def test_calculated_life_with_bent_wear_is_that_of_the_replay():
    """t^0.6 fm^0.5, with a dwell too short to matter."""
    pf = published("CLM-2023")
    cut = replace(CutModel.from_parameters(pf), n=0.6, m=0.5, c0=0.45)
    short = changed(pf, load_line={"dwell": 0.5})
    run = constant_load_run(short, plant=MillingCut.from_parameters(short, cut=cut))
    life = steady_life(cut, pf.load_line)
    assert run.wear == pytest.approx(float(life.wear[0]), rel=0.015)  # it rests within 1 % of the range of the limits
    assert run.length == pytest.approx(float(life.length[0]), rel=0.03)


def test_life_over_draws_moves_as_the_coefficients_do(pf):
    law, wear = pf.laws["I"].coefficients, pf.laws["VB"].coefficients
    rows = np.array([[law["A"], law["B"], k * law["k1"]] for k in (1.0, 2.0)])
    draws = {
        "I": Draws(("A", "B", "k1"), rows),
        "VB": Draws(
            ("ln c0", "t", "fm", "d", "ae"), np.log(wear["c0"]) * np.array([[1, 0, 0, 0, 0]] * 2) + [0, 1, 0, 0, 0]
        ),
    }
    life, used = drawn_life(pf, draws)
    one = steady_life(CutModel.from_parameters(pf), pf.load_line)
    assert used == ("I", "VB")
    assert life.wear == pytest.approx(np.array([1, 0.5]) * one.wear)
    assert life.length == pytest.approx(np.array([1, 0.5]) * one.length)


def test_draws_of_the_exponent_of_time_keep_the_minutes_of_the_law():
    """VB = c0 t^n in minutes: at n 0.5 the wear after 4 min is 2 c0, whatever unit the plant counts in."""
    pf = published("CLM-2023")
    c0 = 100.0
    draws = {"VB": Draws(("ln c0", "t", "fm", "d", "ae"), np.array([[np.log(c0), 0.5, 0.0, 0.0, 0.0]]))}
    life, _ = drawn_life(pf, draws)
    assert float(life.time[0]) / 60 == pytest.approx((float(life.wear[0]) / c0) ** 2, rel=1e-3)


# ---- what is reported


def test_the_summary_states_change_regulation_gain_and_scaling(pf):
    assert replays.lacks("constant-load", pf) == ""
    reported = replays.replayed("constant-load", pf, {}, 1)
    text = " ".join(reported.lines)
    for words in ("Change the tool at VB", "inside the window of 180 to 220 um", "within the 1 % of the paper",
                  "Against a constant feed of", "stayed there for", "derived, not measured", "No draws"):  # fmt: skip
        assert words in text
    assert "slot milling signals the change" in text
    assert any("simulated" in words for words in reported.assumed)
    assert any("assumption: that life ends at" in words for words in reported.assumed)
    assert json.loads(json.dumps(reported.facts))["simulated"] is True
    assert set(reported.figures) == {"constant_load", "constant_load_pass"}
    assert all("Simulated" in figure.axes[0].get_title() for figure in reported.figures.values())


def test_with_draws_it_has_a_band(pf):
    law = pf.laws["I"].coefficients
    rng = np.random.default_rng(1)
    rows = np.column_stack([np.full(500, law["A"]), np.full(500, law["B"]), law["k1"] * rng.normal(1, 0.05, 500)])
    reported = replays.replayed("constant-load", pf, {"I": Draws(("A", "B", "k1"), rows)}, 1)
    assert "Over 500 posterior draws of the laws of I" in reported.lines[-1]
    assert "90 % bands" in reported.lines[-1]


@pytest.mark.parametrize(
    ("ends", "words"),
    [((1959.2, 2231.4), "1960 to 2230"), ((30.0, 3037.0), "30 to 3000"), ((0.1881, 0.2129), "0.188 to 0.213")],
)
def test_a_band_has_the_digits_of_its_width_and_no_end_becomes_zero(ends, words):
    low, high = ends
    a = (low * 0.95 - high * 0.05) / 0.9  # the quantiles of two draws lie between them
    assert constant_load._band(np.array([a, a + (high - low) / 0.9])) == words


def test_draws_that_never_reach_the_limit_are_said(pf, monkeypatch):
    never = SimpleNamespace(length=np.full(500, np.inf), wear=np.full(500, np.nan))
    monkeypatch.setattr(constant_load, "drawn_life", lambda *_: (never, ("I",)))
    reported = replays.replayed("constant-load", pf, {"I": Draws(("A", "B", "k1"), np.ones((500, 3)))}, 1)
    assert reported.lines[-1] == "No tool of 500 posterior draws of the laws of I reaches the lower limit."


@pytest.mark.parametrize(
    ("sections", "words"),
    [({"load_line": None}, "fitmodels settings"),
     ({"pi": None}, "fitmodels tune"),
     ({"dynamics": None}, "fitmodels ident"),
     ({"laws": {"I": None}}, "no load law of 'I'"),
     ({"laws": {"VB": None}}, "no power law of VB in the time t"),
     ({"pi": {"ki": -0.3, "kp": -160.0}}, "not stable")],
)  # fmt: skip
def test_a_file_that_lacks_something_says_what_and_the_cure(pf, sections, words):
    data = pf.model_dump(exclude={"content_sha256"})
    for section, parts in sections.items():
        data[section] = None if parts is None else {**data[section], **parts}
    data["laws"] = {key: law for key, law in data["laws"].items() if law is not None}
    if "I" not in data["laws"]:
        data["laws"] = {}
    sentence = replays.lacks("constant-load", ParameterFile.model_validate(data))
    assert words in sentence
    assert sentence.endswith(".")
    assert sentence[0].isupper()


def test_gains_in_position_form_drive_it_too():
    """As `fitmodels tune` makes them."""
    gains = {"form": "position", "kp": 0.0, "ki": 8000.0, "average": 1, "specification": None}
    pf = changed(published("CLM-2023"), pi=gains)
    run = constant_load_run(pf)
    assert run.worn
    assert 180 < run.wear < 220
    assert abs(run.worst_mean) < 0.01
    assert any(
        "each further one with the last feed" in line for line in replays.replayed("constant-load", pf, {}, 1).lines
    )


@pytest.mark.parametrize(
    ("call", "words"),
    [(lambda cut: MillingCut([cut], 1000.0, passes=()), "passes"),
     (lambda cut: MillingCut([cut], 1000.0, passes=((1, 150.0),)), "passes"),
     (lambda cut: MillingCut([cut], 0.0), "programmed feed 0"),
     (lambda cut: constant_feed_run(published("CLM-2023"), feed=0.0), "above zero")],
)  # fmt: skip
def test_what_cannot_be_cut_is_refused(call, words):
    with pytest.raises(UsageError, match=words):
        call(CutModel.from_parameters(published("CLM-2023")))


def test_a_mixed_path_of_two_drives_is_refused():
    other = changed(published("CLM-2023"), dynamics={"b": [0.0, 0.0611, -0.1338, 0.0753]})
    with pytest.raises(UsageError, match="give files of one machine"):
        mixed_run([published("CLM-2023"), other])
