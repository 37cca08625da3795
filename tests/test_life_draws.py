"""Life and metal removed over draws: the two readings, against one recursion a draw, and the band of a refit."""

from dataclasses import replace

import numpy as np
import pytest
from fitmodels import datasets, fit, parameters
from fitmodels.cards.replays import replayed
from fitmodels.controllers.loop import replay
from fitmodels.controllers.recursion.controller import TurningRecursion, WearingEdge
from fitmodels.controllers.recursion.distribution import life_draws
from fitmodels.controllers.recursion.figures import draws_figure
from fitmodels.controllers.recursion.from_file import life_laws
from fitmodels.controllers.recursion.interval_optimum import grid_of
from fitmodels.controllers.recursion.laws import Rules
from fitmodels.controllers.recursion.life import apply_plan, whole_life
from fitmodels.core.errors import UsageError
from fitmodels.parameters.draws import Draws
from fitmodels.parameters.published import published

SEED = 1  # recorded: of the posteriors and so of the bands below
PUBLISHED = Rules(times="published")
LIMITS = {"power": 7, "force": 1500, "wear": 0.3, "speed": (50, 200), "feed": (0.06, 0.6)}
ALL_RULES = [Rules(times, wear) for times in ("published", "full") for wear in ("clock", "wear_state")]


@pytest.fixture(scope="module")
def refit():
    """Laws refitted from the bundled simulated tests, as a parameter file, and their draws."""
    runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    fits = [fit.power_law(runs, "AW", ["V", "f", "d", "t"])]
    fits += [fit.power_law(runs, name, ["V", "f", "d", "t", "AW"]) for name in ("P", "Fxz")]
    posteriors = [fit.posterior(law, seed=SEED) for law in fits]
    pf = parameters.collect(tool="GC435", work="709M40", laws=fits, limits=LIMITS, simulated=True)
    return pf, {post.response: Draws(post.names, post.draws) for post in posteriors}


def width(band: tuple[float, float, float]) -> float:
    """Half the band over its middle."""
    low, middle, high = band
    return (high - low) / 2 / middle


def test_one_plan_on_drawn_edges_has_a_band_that_holds_the_published_volume_within_25_per_cent(refit):
    """Published times; band of the law, 95 %, equal-tailed; the last pair is held until the edge is worn out."""
    pf, draws = refit
    found = life_draws(life_laws(pf), draws, rules=PUBLISHED)
    low, middle, high = found.band("removed", 0.95)  # 1919, 2554, 3108 cm3: 25 % below, 22 % above
    volume = whole_life(life_laws(published("AC-2017")), PUBLISHED).removed
    assert low < volume < high
    assert width((low, middle, high)) < 0.25


def test_the_band_of_each_draws_own_recursion_holds_the_published_volume_but_is_wider(refit):
    """A draw that chooses for itself also gains from low power and force: a third either side, not a quarter."""
    pf, draws = refit
    own = life_draws(life_laws(pf), draws, of="own", rules=PUBLISHED, count=1000)
    low, middle, high = own.band("removed")
    assert low < whole_life(life_laws(published("AC-2017")), PUBLISHED).removed < high
    assert 0.25 < width((low, middle, high)) < 0.40


def drawn_laws(laws, draws, k):
    """The laws of draw k, written down apart from the package."""

    def one(terms):
        of = draws[terms.response]
        value = dict(zip(of.names, of.values[k].tolist(), strict=True))
        ln_c = value["ln c0"] + sum(times * value[name] for name, times in terms.put_in)
        V, f, t, AW = (value.get(name, 0.0) for name in ("V", "f", "t", laws.wear.response))
        return replace(terms, ln_c=ln_c, V=V, f=f, t=t, AW=AW)

    return replace(laws, wear=one(laws.wear), power=one(laws.power), force=one(laws.force))


@pytest.mark.parametrize("rules", ALL_RULES, ids=str)
def test_many_recursions_at_once_are_those_of_one_draw_after_the_other(refit, rules):
    pf, draws = refit
    laws, few = life_laws(pf), {name: Draws(of.names, of.values[:40]) for name, of in draws.items()}
    own = life_draws(laws, few, of="own", rules=rules)
    lives = [whole_life(drawn_laws(laws, few, k), rules) for k in range(40)]
    assert own.minutes.tolist() == [life.minutes for life in lives]
    np.testing.assert_allclose(own.removed, [life.removed for life in lives], rtol=1e-12)


@pytest.mark.parametrize("rules", ALL_RULES, ids=str)
def test_a_plan_on_many_edges_is_that_plan_on_one_edge_after_the_other(refit, rules):
    pf, draws = refit
    laws, few = life_laws(pf), {name: Draws(of.names, of.values[:40]) for name, of in draws.items()}
    found = life_draws(laws, few, rules=rules)
    lives = [apply_plan(found.plan, drawn_laws(laws, few, k), rules) for k in range(40)]
    assert found.minutes.tolist() == [life.minutes for life in lives]
    np.testing.assert_allclose(found.removed, [life.removed for life in lives], rtol=1e-12)
    np.testing.assert_allclose(found.peak_power, [life.P.max() for life in lives], rtol=1e-9)
    np.testing.assert_allclose(found.peak_force, [life.Fxz.max() for life in lives], rtol=1e-9)


def test_odd_signs_change_nothing_in_that(refit):
    """Wear exponents of power and force of either sign: no shortcut depends on them."""
    pf, draws = refit
    laws, few = life_laws(pf), {name: Draws(of.names, of.values[:30].copy()) for name, of in draws.items()}
    for name in ("P", "Fxz"):
        few[name].values[::2, few[name].names.index("AW")] *= -0.3
        few[name].values[::2, 0] += -0.5 if name == "P" else -2.5
    own = life_draws(laws, few, of="own", rules=PUBLISHED)
    lives = [whole_life(drawn_laws(laws, few, k), PUBLISHED) for k in range(30)]
    np.testing.assert_allclose(own.removed, [life.removed for life in lives], rtol=1e-12)
    assert len(set(own.removed)) > 10


def test_draws_without_spread_are_the_law_itself():
    laws = life_laws(published("AC-2017"))
    law = published("AC-2017").laws["AW"]
    row = [np.log(law.coefficients["c0"]), *(law.coefficients[name] for name in ("V", "f", "d", "t"))]
    same = {"AW": Draws(("ln c0", "V", "f", "d", "t"), np.array([row] * 5))}
    for of in ("plan", "own"):
        found = life_draws(laws, same, of=of)
        assert found.band() == pytest.approx((2_213_750.0,) * 3)
        assert found.minutes.tolist() == [14.0] * 5
        assert found.drawn == ("AW",)
        assert found.ends_early == 0.0


def test_levels_of_new_edges_widen_the_life_and_follow_the_seed(refit):
    pf, draws = refit
    laws = life_laws(pf)
    law = life_draws(laws, draws, rules=PUBLISHED)
    new, again, other = (life_draws(laws, draws, rules=PUBLISHED, edge="new", seed=seed) for seed in (1, 1, 2))
    assert width(new.band("minutes")) > 1.5 * width(law.band("minutes"))
    assert (new.removed == again.removed).all()
    assert (new.removed != other.removed).any()


def test_the_level_of_a_new_edge_has_the_variance_that_sd_and_icc_say():
    """Between edges sd^2 icc / (1 - icc), sd that within an edge; seen on power, of which no other is drawn."""
    laws, law = life_laws(published("AC-2017")), published("AC-2017").laws["P"]
    names = ("ln c0", "V", "f", "d", "t", "AW", "sd", "icc")
    row = [np.log(law.coefficients["c0"]), *(law.coefficients[name] for name in names[1:6]), 0.06, 0.6]
    found = life_draws(laws, {"P": Draws(names, np.array([row] * 4000))}, edge="new", seed=SEED)
    level = np.log(found.peak_power / found.plan.P.max())
    assert abs(level.mean()) < 4 * 0.0735 / np.sqrt(4000)
    assert level.std() == pytest.approx(0.06 * np.sqrt(0.6 / 0.4), rel=0.05)


def test_a_controller_that_is_reported_the_wear_of_a_drawn_edge_keeps_it_under_the_criterion(refit):
    pf, draws = refit
    laws = life_laws(pf)
    for k in range(0, 60, 6):
        controller = TurningRecursion(laws, PUBLISHED, grid_of(laws))
        edge = WearingEdge(drawn_laws(laws, draws, k), PUBLISHED)
        trace = replay(controller, edge, duration=7200, dt=60, until="worn out")
        assert trace.first("worn out") is not None
        assert edge.wear < 0.3 * 1.02


def test_draws_whose_wear_does_not_grow_are_left_out_and_counted(refit):
    pf, draws = refit
    wear = Draws(draws["AW"].names, draws["AW"].values[:20].copy())
    wear.values[3, wear.names.index("t")] = -0.01
    found = life_draws(life_laws(pf), {"AW": wear}, of="own")
    assert (len(found.minutes), found.left_out) == (19, 1)


def test_a_life_longer_than_what_is_computed_is_counted_as_such(refit):
    pf, draws = refit
    found = life_draws(life_laws(pf), draws, count=20, most=5)
    assert found.unended == 20


def test_the_summary_has_both_readings_with_their_bands_and_figures(refit):
    pf, draws = refit
    small = {name: Draws(of.names, of.values[:200]) for name, of in draws.items()}
    reported = replayed("recursion", pf, small, SEED)
    text = " ".join(reported.lines)
    for words in (
        "worn out after 17 min",
        "last pair held",
        "95 % band of the law",
        "95 % band of edges",
        "exceeds 7 kW",
    ):
        assert words in text
    assert "peaks of the fixed pair: power" in text
    assert reported.facts["replay_agrees"]
    assert any("calculated" in line for line in reported.assumed)
    for figure in reported.figures.values():
        assert "Calculated" in figure.get_suptitle()
    alone = replayed("recursion", pf, {}, SEED)
    assert "Draws: none" in alone.lines[-1]
    assert "recursion_draws" not in alone.figures


def test_a_figure_of_the_draws_is_drawn(refit):
    pf, draws = refit
    laws = life_laws(pf)
    both = (life_draws(laws, draws, of=of, count=50) for of in ("plan", "own"))
    assert len(draws_figure(*both).axes) == 4


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda laws, draws: life_draws(laws, {}), "Fit with draws"),
        (lambda laws, draws: life_draws(laws, draws, of="both"), "'plan' or 'own'"),
        (lambda laws, draws: life_draws(laws, draws, edge="old"), "'law' or 'new'"),
        (lambda laws, draws: life_draws(laws, draws, count=0), "at least one"),
        (lambda laws, draws: life_draws(laws, draws, count=5).band("wear"), "removed or minutes"),
        (lambda laws, draws: life_draws(laws, draws, of="own", count=5).band("peak_power"), "a plan also peak_power"),
        (lambda laws, draws: life_draws(laws, draws, count=5).band(level=95), "between 0 and 1"),
        (lambda laws, draws: life_draws(laws, {"AW": Draws(("V",), np.ones((3, 1)))}), "belong to another law"),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence(refit, call, words):
    pf, draws = refit
    with pytest.raises(UsageError, match=words):
        call(life_laws(pf), draws)


def test_the_share_of_edges_that_exceed_a_limit_is_named(refit):
    pf, draws = refit
    found = life_draws(life_laws(pf), draws, rules=PUBLISHED)
    for peak, terms in ((found.peak_power, found.plan.laws.power), (found.peak_force, found.plan.laws.force)):
        share = (peak > terms.most).mean()
        words = f"{100 * share:.0f} % exceed {terms.response} {terms.most:g} {terms.unit} before they are worn out"
        assert (words in " ".join(found.exceeding)) == (share >= 0.005)
    assert found.exceeding
    assert replace(found, peak_power=None, peak_force=None).exceeding == ()
