"""Design rule of adaptive force control, and ``fitmodels adaptive-force``, which writes the settings.

The margins are held against the poles of the closed loop, whose plant is sampled by SciPy; the rule against runs of the
controller on random plants.
"""

import json

import numpy as np
import pytest
from fitmodels import parameters
from fitmodels.cli import main
from fitmodels.controllers.adaptive_force.controller import AdaptiveForceControl
from fitmodels.controllers.adaptive_force.derivation import STEP, ForceChoices, design
from fitmodels.controllers.adaptive_force.design import Timing, design_gains, largest_step, loop_margins
from fitmodels.controllers.adaptive_force.plant import DriveAndCut
from fitmodels.controllers.adaptive_force.runs import depth_step_run, steady_run
from fitmodels.controllers.adaptive_force.settings import force_loop, settings_for
from fitmodels.controllers.constant_load_milling.controller import ConstantLoad
from fitmodels.controllers.gate import adaptive_force as adaptive_force_gate
from fitmodels.controllers.gate.adaptive_force import check_adaptive_force, gated_adaptive_force
from fitmodels.controllers.loop import replay
from fitmodels.core.errors import GateError, UsageError
from fitmodels.parameters.file import sealed
from fitmodels.parameters.published import published
from fitmodels.parameters.sections.force_control import AdaptiveForceSection
from scipy.signal import cont2discrete

PAPER = ((1.0, 150.0), (2.0, 200.0), (4.0, 320.0))  # mm and N, section 4 of LYAP
RUN = "command 100 to 400 mm/min, force 80 to 320 N: smallest and largest values of run.csv"
CROSSING = 0.01  # of a margin: the frequency grid of `loop_margins` against poles on the unit circle
ROUNDING = 1e-12  # of V


def section_of(ratios, depth=2.0, **fields):
    """A section with estimates alone."""
    m, alpha, beta = map(float, ratios)
    return AdaptiveForceSection(
        m=m, alpha=alpha, beta=beta, unit_u="mm/min", depth=depth, spindle_speed=3000.0, sources={"tested": RUN},
        **fields,
    )  # fmt: skip


@pytest.fixture
def given():
    """Estimates of LYAP with the ranges of a run, without settings."""
    held = published("LYAP").adaptive_force
    return section_of((held.m, held.alpha, held.beta), uncertainty=held.uncertainty, verdict=held.verdict)


def random_plant(rng):
    """m/k, (mc+d)/k, dc/k of poles 5 to 40 1/s and up to ten times that, and of 0.1 to 10 mm/min per N."""
    slow = 5 * 8 ** rng.random()
    fast, beta = slow * 10 ** rng.random(), 0.1 * 100 ** rng.random()
    return np.array([beta / (slow * fast), beta * (slow + fast) / (slow * fast), beta])


def closed_loop_radius(ratios, gains, force, timing, factor=1.0, delay=0):
    """Largest pole of the closed loop with its gain times a factor and further steps of delay."""
    h, N = timing.sample_time, timing.samples
    b, a, _ = cont2discrete(([1 / ratios[0]], [1, ratios[1] / ratios[0], ratios[2] / ratios[0]]), h, "zoh")
    mean = np.convolve([0.5, 0.5], np.ones(N)) / N
    rate = np.r_[1.0, np.zeros(N - 1), -1.0] / (N * h)
    integral = gains.g3 * force**2 * h / 2
    law = np.array([gains.Kd + integral, integral - gains.Kd])  # over 1 - z^-1
    top = factor * np.convolve(np.convolve(law, rate + gains.lam * mean), b[0])
    top = np.r_[np.zeros(round(timing.delay / h) + delay), top]
    below = np.convolve([1.0, -1.0], a)
    whole = np.zeros(max(len(top), len(below)))
    whole[: len(top)] += top
    whole[: len(below)] += below
    return np.abs(np.roots(whole)).max()


@pytest.mark.parametrize("seed", range(8))
def test_margins_are_those_at_which_a_pole_of_the_closed_loop_reaches_the_unit_circle(seed):
    rng = np.random.default_rng(seed)
    ratios, timing = random_plant(rng), Timing(STEP, int(rng.integers(2, 60)), STEP)
    gains = design_gains(ratios.tolist(), 320.0, timing)
    found = loop_margins(ratios[None], gains, 320.0, timing)[0]
    assert closed_loop_radius(ratios, gains, 320.0, timing) < 1
    assert closed_loop_radius(ratios, gains, 320.0, timing, found.gain * (1 - CROSSING)) < 1
    assert closed_loop_radius(ratios, gains, 320.0, timing, found.gain * (1 + CROSSING)) > 1
    steps = found.dead_time / STEP
    assert closed_loop_radius(ratios, gains, 320.0, timing, delay=int(steps * (1 - CROSSING))) < 1
    assert closed_loop_radius(ratios, gains, 320.0, timing, delay=int(np.ceil(steps * (1 + CROSSING)))) > 1


@pytest.mark.parametrize("seed", range(200))
def test_the_rule_gives_its_margins_for_any_plant(seed):
    """With the slower pole cancelled by lambda and the faster by g3, all plants give the loop of dead time alone.

    Half of the averaging is dead time and the mean itself attenuates, so both margins lie above those of
    exp(-theta s) / (2 theta s), a gain of pi and 61 degrees; the delay of one step is longer than assumed at no plant.
    """
    rng = np.random.default_rng(seed)
    ratios, timing = random_plant(rng), Timing(STEP, int(rng.integers(3, 100)), STEP * int(rng.integers(0, 5)))
    force = 50 * 40 ** rng.random()
    gains = design_gains(ratios.tolist(), force, timing)
    found = loop_margins(ratios[None], gains, force, timing)[0]
    assert 3.0 < found.gain < 5.5
    assert 60 < found.phase < 66
    assert 1.9 < found.dead_time / timing.dead_time < 2.4
    for deeper, less in ((0.25, 0.4), (0.5, 0.6)):  # k grows with the depth
        shallow = loop_margins(ratios[None] / deeper, gains, less * force, timing)[0]
        assert shallow.gain > found.gain
        assert shallow.phase > found.phase


def random_file(rng, scatter=0.05):
    """A file designed for a random plant, and a file of another plant near it, both at three depths."""
    ratios = random_plant(rng)
    force = 50 * 40 ** rng.random()
    points = ((1.0, 0.4 * force), (2.0, 0.6 * force), (4.0, force))
    speed = 600 * 13 ** rng.random()
    need = [ratios[2] * 2 / d * F for d, F in points]
    found = design(
        section_of(ratios),
        ForceChoices(points, spindle_speed=speed, limits=(0.1 * min(need), 2 * max(need)), beyond_tested=True),
    )
    truth = ratios * np.exp(scatter * rng.standard_normal(3))
    held = {**section_of(ratios).model_dump(), **found.settings}
    pf = published("LYAP")
    return sealed(pf, adaptive_force=held, pi=None, limits=None), truth, found


def check_runs(seeds, scatter=0.05):
    """Overshoot at the start of runs at each depth, on plants off the estimates; V on the plant of the estimates."""
    for seed in seeds:
        pf, truth, found = random_file(np.random.default_rng(seed), scatter)
        if truth[1] ** 2 < 4 * truth[0] * truth[2]:
            continue  # no drive and cut
        slow, fast = sorted(-np.roots(truth).real)
        for at in found.points:
            plant = DriveAndCut(depth=at.depth, m=1 / slow, c=fast, k_per_depth=1 / slow / truth[0] / 2)
            control = AdaptiveForceControl.from_parameters(pf, at.depth)
            time = 2 * at.settling + 20 * found.timing.sample_time * found.timing.samples
            trace = replay(control, plant, duration=time, dt=found.timing.sample_time, record=("force",))
            share = trace.recorded["force"] / at.force - 1
            assert share.max() < 0.02, (seed, at.depth)
            assert abs(share[-1]) < 0.02, (seed, at.depth)
        run = steady_run(pf, found.points[-1].depth, duration=2 * found.points[-1].settling)
        assert run.energy().rise < ROUNDING, seed


def test_runs_on_random_plants_settle_without_overshoot_and_v_falls():
    """Estimates off by 5 % (sd), and k by a factor of 2 at other depths: within 2 % after twice the time stated."""
    check_runs(range(4))


@pytest.mark.slow
def test_the_same_of_many_plants():
    check_runs(range(100, 130))


def test_a_step_of_depth_that_doubles_the_force_comes_back():
    pf, _, found = random_file(np.random.default_rng(3))
    between = 2 * max(at.settling for at in found.points)
    run = depth_step_run(pf, depths=(2.0, 4.0, 2.0), between=between)
    assert max(segment.steady for segment in run.segments()) < 0.02


def test_the_largest_step_is_where_the_loop_is_still_stable():
    timing = Timing(0.001, 20, 0.001)
    ratios = np.array([1e-3, 0.0625, 0.625])
    gains = design_gains(ratios.tolist(), 320.0, timing)
    assert largest_step(ratios[None], gains, 320.0, timing) == 0.02
    stiff = gains._replace(Kd=2 * gains.Kd, g3=2 * gains.g3)
    step = largest_step(ratios[None], stiff, 320.0, timing)
    assert step < 0.02
    n = round(0.02 / step)
    assert closed_loop_radius(ratios, stiff, 320.0, Timing(step, n, step)) < 1
    assert closed_loop_radius(ratios, stiff, 320.0, Timing(0.02 / (n - 1), n - 1, 0.02 / (n - 1))) > 1


def test_the_paper_by_the_rule(given):
    found = design(given, ForceChoices(PAPER))
    assert found.settings["Kd"] == pytest.approx(0.0434, rel=1e-3)
    assert (found.settings["low"], found.settings["high"]) == (100.0, 400.0)
    assert found.drawn[1] > 4.3
    assert [round(at.feed) for at in found.points] == [375, 250, 200]
    assert found.points[-1].margins == pytest.approx((4.39, 62.2, 0.0257), rel=3e-3)


@pytest.mark.parametrize(
    ("ratios", "says"),
    [
        ((-2e-3, -0.125, -1.25), "the force of the record falls when the feed rises"),
        ((2e-3, 0.125, -1.25), "not all positive"),
        ((2e-3, 0.02, 1.25), "complex poles"),
        ((2e-3, 1e200, 1.25), "poles further apart"),
    ],
)
def test_estimates_of_no_cut_are_refused(ratios, says):
    with pytest.raises(UsageError, match=says):
        design(section_of(tuple(max(r, 1e-9) if i == 0 else r for i, r in enumerate(ratios))), ForceChoices(PAPER))


# --- the command


@pytest.fixture
def file(given, tmp_path, monkeypatch):
    """params.json with estimates alone."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")
    pf = sealed(published("LYAP"), adaptive_force=given.model_dump(), pi=None, dynamics=None)
    return parameters.write(pf, tmp_path / "params.json")


@pytest.fixture
def run(capsys):
    def call(*arguments):
        code = main(["adaptive-force", *map(str, arguments)])
        out, err = capsys.readouterr()
        return code, out, err

    return call


def test_each_value_is_printed_with_its_source_and_the_command_is_recorded(file, run):
    code, out, _ = run(file, "1mm=150N", "--spindle", "3000rpm", "2mm=200N", "4mm=0.32kN", "--feed", "60:500mm/min")
    assert code == 0
    for words in ("design rule: the slower pole", "identified", "gain margin 4.39, phase margin 62 degrees",
                  "In 1000 draws", "steps up to 20 ms", "assumed: period of the control"):  # fmt: skip
        assert words in " ".join(out.split()) or words == "identified", words
    pf = parameters.read(file)
    a = pf.adaptive_force
    assert [(p.depth, p.force) for p in a.set_points] == list(PAPER)
    assert (a.low, a.high, a.average_time, a.spindle_speed) == (60.0, 500.0, 0.02, 3000.0)
    settings = set(type(a).model_fields) - {"uncertainty", "unit_u", "unit_force", "unit_depth", "sources", "verdict",
                                            "notes", "m", "alpha", "beta", "depth"}  # fmt: skip
    assert settings <= set(a.sources)
    assert pf.provenance.then[-1].startswith("fitmodels adaptive-force")
    assert run(file, "2mm=200N")[0] == 2
    assert run(file, "--force", "--delay", "5ms")[0] == 0  # set points and limits that were given stay
    b = parameters.read(file).adaptive_force
    assert (b.set_points, b.low, b.high) == (a.set_points, a.low, a.high)
    assert b.Kd < a.Kd


def test_the_same_settings_in_other_units_give_the_same_run(file, run):
    points = ("1mm=150N", "2mm=200N", "4mm=320N", "--feed", "60:500mm/min")
    assert run(file, *points)[0] == 0
    first = parameters.read(file)
    assert run(file, *points, "--units", "mm/rev,kN", "--force")[0] == 0
    second = parameters.read(file)
    a = second.adaptive_force
    assert (a.unit_u, a.unit_force, a.low, a.set_points[2].force) == ("mm/rev", "kN", 0.02, 0.32)
    assert a.tested.force == pytest.approx((0.08, 0.32))
    one, other = (steady_run(pf, 4.0, duration=1.0) for pf in (first, second))
    np.testing.assert_allclose(other.trace.command * 3000, one.trace.command, rtol=1e-9)
    np.testing.assert_allclose(other.force * 1000, one.force, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["2mm=200N", "--feed", "30:600000mm/min"], "more than the 3e+04 mm/min of any tool"),
        (["2mm=200N", "--feed", "30:900"], "tested up to 400 mm/min"),
        (["2mm=450N"], "450 N at 2 mm needs a command of 562.6 mm/min by the estimates, outside of the limits"),
        (["2mm=600N", "--feed", "100:600"], "a force of 600 N, tested up to 320 N"),
        (["2mm=200N", "--sample-time", "10s"], "--sample-time 10 s"),
        (["2mm=200N", "--sample-time", "15ms"], "near a whole part"),
        (["2mm=200N", "--sample-time", "10ms"], "Give a step of 0.001818 s, or the number of teeth with --teeth"),
        (["2mm=200N", "--sample-time", "10ms", "--teeth", "2"], "cutter with 2 teeth"),
        (["2mm=200N", "--sample-time", "4ms", "--teeth", "2"], ""),
        (["2mm=200N", "--teeth", "0"], "not a number of teeth"),
        (["2mm=200N", "--kd", "5"], "gain margin of"),
        (["2mm=200N", "--spindle", "6000"], "the estimates are of a cut at 3000 1/min"),
        (["2mm=200N", "--delay", "5"], "at most 1 s; give it in s or ms"),
        (["2mm=200N", "--reference-time", "1ms"], "the rule gives 0.16 s"),
        (["2mm=200N", "--readings", "0:150N"], "every set point must lie between"),
        (["2mm=200N", "--readings", "100:260N"], "a range that encloses 0 and 200 N, the largest set point"),
        (["2mm=200mm"], "mm does not convert into N"),
        (["2mm=200"], ""),
        (["200N"], "write it as 2mm=200N"),
        ([], "no set point"),
        (["2mm=200N", "--units", "V,N"], "mm/min does not convert into V"),
        (["2mm=200N", "--depth", "2"], "only with --record"),
        (["2mm=200N", "--feed", "400:100"], "low must be below high"),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence_and_nothing_is_written(file, run, words, says):
    before = file.read_bytes()
    code, out, err = run(file, *words)
    assert (code == 0) == (not says)
    assert says in err
    assert (file.read_bytes() == before) == bool(says)
    assert bool(out) != bool(says)


def test_samples_at_the_same_angles_of_the_teeth_are_refused_in_a_resealed_file_too(file, run):
    """A ripple of 70 % was read as its value at one angle of the teeth, and the force was twice the set point."""
    assert run(file, "2mm=200N", "--teeth", "2")[0] == 0
    held = parameters.read(file)
    assert held.identity.iso13399["ZEFP"] == 2
    assert all(finding.passed for finding in check_adaptive_force(held))
    for step, teeth in ((0.01, 2), (0.02, 2), (0.005, 4), (0.004, None)):
        identity = held.identity.model_copy(update={"iso13399": {"ZEFP": float(teeth)} if teeth else {}})
        changed = held.adaptive_force.model_copy(update={"sample_time": step})
        found = check_adaptive_force(sealed(held, identity=identity, adaptive_force=changed))
        assert [finding.name for finding in found] == ["times"], (step, teeth)
        assert "do not give the mean force" in found[0].words


RUNS = [(3000, None, 20), (5000, None, 13), (5000, 2, 12), (15000, 4, 5)]


@pytest.mark.parametrize(("rpm", "teeth", "samples"), RUNS)
def test_the_assumed_step_gives_the_mean_of_a_revolution(given, rpm, teeth, samples):
    choices = ForceChoices(PAPER, spindle_speed=rpm, teeth=teeth, beyond_tested=True)
    timing = design(given, choices).timing
    assert (timing.samples, timing.samples * timing.sample_time) == (samples, pytest.approx(60 / rpm))


def test_a_file_changed_by_hand_is_refused_and_units_are_exported(file, run, tmp_path):
    assert run(file, "2mm=200N")[0] == 0
    assert main(["export", str(file), "--to", "ini", "--out", str(tmp_path / "x.ini"), "--accept-verdict"]) == 0
    lines = (tmp_path / "x.ini").read_text().splitlines()
    assert "adaptive_force_kd = s (mm/min)/N" in lines
    assert "adaptive_force_set_points_0_force = N" in lines
    data = json.loads(file.read_text())
    data["adaptive_force"]["high"] = 390.0
    del data["content_sha256"]
    file.write_text(json.dumps(data))
    before = file.read_bytes()
    code, _, err = run(file, "--force")
    assert code != 0
    assert "no content_sha256" in err
    assert file.read_bytes() == before


def test_the_running_control_is_exported_at_a_depth(file, run, tmp_path, capsys):
    assert run(file, "1mm=150N", "2mm=200N", "4mm=320N", "--feed", "60:500")[0] == 0
    words = ["export", str(file), "--system", "adaptive-force", "--to", "c", "--accept-verdict"]
    assert main([*words, "--depth", "0.4cm", "--out", str(tmp_path / "x.c")]) == 0
    head = " ".join((tmp_path / "x.c").read_text()[:2000].replace("*", " ").split())
    assert "Load 320 N; feed 60 to 500 mm/min, 0.12 to 1 of the programmed 500 mm/min." in head
    capsys.readouterr()
    assert main([*words, "--depth", "3mm", "--out", str(tmp_path / "y.c")]) != 0
    assert "no set point for a depth of 3 mm" in capsys.readouterr().err


def test_the_limit_of_force_in_the_file_is_the_overload_and_lies_above_the_set_points(file, run, capsys):
    """It was not used: the control let twice the set point pass."""
    assert run(file, "2mm=200N", "4mm=320N", "--feed", "60:500")[0] == 0
    free = parameters.read(file)
    limits = {} if free.limits is None else free.limits.model_dump()
    limited = {
        kN: sealed(free, limits={**limits, "force": {"value": kN, "unit": "kN", "of": None}}) for kN in (0.3, 0.35, 9)
    }
    for kN, overload in ((0.35, 350.0), (9, 420.0)):
        assert force_loop(settings_for(limited[kN], 2.0)).overload_at == pytest.approx(overload)
    assert (
        "overload above 350 N, the limit of force in the file"
        in gated_adaptive_force(limited[0.35], accept_verdict=True).view.assumed
    )
    words = "at most 300 N, but adaptive_force has a set point of 320 N"
    with pytest.raises(GateError, match=words):
        settings_for(limited[0.3], 2.0)
    (found,) = check_adaptive_force(limited[0.3])
    assert found.passed is False
    assert words in found.words
    parameters.write(limited[0.3], file, replaces=free)
    assert main(["check", str(file)]) != 0
    assert words in " ".join(capsys.readouterr().out.split())
    before = file.read_bytes()
    code, out, err = run(file, "4mm=320N", "--force")
    assert (code, out) == (2, "")
    assert words in " ".join(err.split())
    assert file.read_bytes() == before


def test_a_negative_value_follows_its_option(file, run):
    assert run(file, "2mm=200N", "--readings", "-32:1280N")[0] == 0
    assert parameters.read(file).adaptive_force.force_low == -32.0
    assert run(file, "--force", "--readings", "-.04:1.2kN")[0] == 0
    assert parameters.read(file).adaptive_force.force_low == -40.0
    code, _, err = run(file, "--force", "--feed", "-10:500")
    assert code == 2
    assert "give 0 < low < high with --feed" in err
    code, _, err = run(file, "--force", "--readings", "--delay", "5ms")
    assert code == 2
    assert "--readings: expected one argument" in err


def test_a_feed_beyond_the_tests_is_recorded_where_it_is_allowed(file, run):
    assert run(file, "2mm=200N", "--feed", "100:900", "--beyond-tested")[0] == 0
    a = parameters.read(file).adaptive_force
    assert "allowed beyond the tests: the command up to 900 mm/min, tested up to 400 mm/min" in a.sources["high"]


def test_a_record_gives_estimates_and_a_reversed_one_is_refused(file, run, tmp_path):
    dt, noise, plant = 0.004, np.random.default_rng(1), DriveAndCut(depth=2.0, ripple=0.3, noise=2.0)
    t = dt * np.arange(2500)
    u = 250 + 100 * np.sin(2 * np.pi * (0.1 + 0.245 * t) * t)
    F = np.array([0.0, *(plant.step(float(command), dt, noise) for command in u[:-1])])
    for name, sign in (("run.csv", 1), ("reversed.csv", -1)):
        rows = [f"{a:.3f},{b:.1f},{sign * c:.1f}" for a, b, c in zip(t[250:], u[250:], F[250:], strict=True)]
        (tmp_path / name).write_text("\n".join(["time [s],feed rate [mm/min],force [N]", *rows]))
    given = ("2mm=200N", "--depth", "2", "--spindle", "3000")
    code, out, _ = run(file, *given, "--record", "run.csv", "--json")
    assert code == 0
    facts = json.loads(out)
    assert facts["schema"] == "fitmodels.adaptive-force/1"
    a = parameters.read(file).adaptive_force
    np.testing.assert_allclose([a.m, a.alpha, a.beta], [0.002, 0.125, 1.25], rtol=0.01)  # DriveAndCut at 2 mm
    assert "run.csv" in a.sources["m"]
    assert facts["points"][0]["margins"]["gain"] == pytest.approx(4.39, rel=0.01)
    before = file.read_bytes()
    code, _, err = run(file, *given, "--record", "reversed.csv", "--force")
    assert code == 4
    assert "the force falls when the feed rises" in err
    assert file.read_bytes() == before


def test_estimates_are_not_replaced_by_ones_that_must_not_be_used(file, run, tmp_path):
    rng, plant, t = np.random.default_rng(1), DriveAndCut(depth=2.0, ripple=0.3, noise=2.0), 0.004 * np.arange(2500)
    u = 250 + 100 * np.sin(2 * np.pi * (0.1 + 0.245 * t) * t)
    F = np.array([plant.step(float(command), 0.004, rng) for command in u])
    # the time in ms, with s in its header
    rows = [f"{a:.3f},{b:.1f},{c:.1f}" for a, b, c in zip(1000 * t, u, F, strict=True)]
    (tmp_path / "slow.csv").write_text("\n".join(["time [s],feed rate [mm/min],force [N]", *rows]))
    held = parameters.read(file)
    good = held.adaptive_force.model_dump() | {"verdict": {"level": "usable inside the tested region"}}
    parameters.write(sealed(held, adaptive_force=good), file, replaces=held)
    words = ("2mm=200N", "--depth", "2", "--spindle", "3000", "--record", "slow.csv", "--force", "-q")
    before = file.read_bytes()
    code, out, err = run(file, *words)
    assert (code, out) == (2, "")
    assert "do not use for control" in err
    assert "--accept-verdict" in err
    assert file.read_bytes() == before
    code, out, err = run(file, *words, "--accept-verdict", "--beyond-tested")
    assert code == 0, err
    assert out.split() == [str(file)]
    assert "Verdict on the force process: do not use for control" in err


@pytest.mark.parametrize(
    ("changes", "of"),
    [
        ({"alpha": 10.0}, "lam"), ({"m": 0.5}, "lam"), ({"lam": 0.1}, "lam"), ({"Kd": 0.1}, "Kd"), ({"g1": 0.1}, "g1"),
        ({"g2": 10.0}, "g2"), ({"g3": 0.5}, "g3"), ({"reference_time": 10.0}, "reference_time"),
        ({"force_low": 10.0}, "force_low"), ({"force_high": 2.0}, "force_high"),
    ],
)  # fmt: skip
def test_gains_of_the_rule_are_those_of_the_estimates(file, run, changes, of):
    assert run(file, "1mm=150N", "2mm=200N", "--delay", "2ms")[0] == 0
    pf = parameters.read(file)
    assert not [finding for finding in check_adaptive_force(pf) if finding.passed is False]
    section = pf.adaptive_force.model_dump()
    wrong = sealed(pf, adaptive_force={**section, **{name: times * section[name] for name, times in changes.items()}})
    failed = [finding.words for finding in check_adaptive_force(wrong) if finding.passed is False]
    assert any(f"Adaptive force control: {of} is " in words and "; its source, " in words for words in failed)


def test_more_force_at_less_depth_is_noted(file, run):
    assert "exchanged" not in run(file, "1mm=150N", "2mm=200N")[1]
    code, out, _ = run(file, "1mm=200N", "2mm=150N", "--force", "--feed", "60:900mm/min", "--beyond-tested")
    assert code == 0
    assert "at 1 mm asks for more force than that at 2 mm, 200 and 150 N" in " ".join(out.split())
    assert any("exchanged" in finding.words for finding in check_adaptive_force(parameters.read(file)))


@pytest.mark.parametrize("words", [("4mm=150N", "--feed", "60:500mm/min"), ("1mm=150N", "2mm=200N", "--kd", "0.0043")])
def test_settings_that_the_check_fails_are_refused_or_said_at_once(file, run, capsys, words):
    before = file.read_bytes()
    code, out, err = run(file, *words)
    assert (code, out) == (2, "")
    assert "Adaptive force control: " in err
    assert "Nothing was written." in err
    assert file.read_bytes() == before
    code, out, err = run(file, *words, "--accept-verdict")
    assert code == 0, err
    assert "! fitmodels check fails these settings, and no export is made: Adaptive force" in " ".join(out.split())
    assert main(["check", str(file), "-q"]) == 5


def test_the_gate_refuses_a_control_whose_feed_jumps_after_a_gap(monkeypatch):
    """The law on the last valid reading, as it was before: 49 of 300 readings lost took the feed to 600 mm/min."""
    pf = published("LYAP")
    assert all(finding.passed is not False for finding in check_adaptive_force(pf))
    monkeypatch.setattr(
        ConstantLoad, "_bridged", lambda self, target, u, *, begins: min(target, u) if self._bad else target
    )
    adaptive_force_gate._findings.cache_clear()
    words = [finding.words for finding in check_adaptive_force(pf) if finding.passed is False]
    adaptive_force_gate._findings.cache_clear()
    assert any("49 of 300 readings lost raise the feed to 600, without gaps" in each for each in words)
