"""The setting rules of Tai, Tsai & Li 2023, doi 10.1109/ACCESS.2023.3330587: on their numbers and on made-up ones."""

import json
import re

import numpy as np
import pandas as pd
import pytest
from fitmodels import datasets, fit, parameters
from fitmodels.cli import main
from fitmodels.core import errors
from fitmodels.core.errors import ParameterError
from fitmodels.fit.form_choice import CHOICES
from fitmodels.parameters import collect, read, setting_rules, write
from fitmodels.parameters.checks.report import worn_past_window
from fitmodels.parameters.file import sealed
from fitmodels.parameters.published import published
from fitmodels.parameters.sections.law import LawSection
from fitmodels.parameters.sections.load_line import Engagement, LimitInterval, NoInterval
from fitmodels.parameters.setting_words import window_assumed
from scipy import stats

UsageError = errors.UsageError


def of(*laws):
    return collect(tool="end mill", work="S45C", laws=laws)


def three_points():
    """Section III.A.1: 1000 mm/min sharp and 700 at 167.3 um, both 0.24 A; 600 at 205.1 um, 0.236 A."""
    runs = datasets.read_runs(datasets.bundled("clm2023_end_milling"))
    columns = {name: runs.values(name)[:3] for name in ("fm", "I", "VB")}
    assert columns["fm"].tolist() == [1000.0, 700.0, 600.0]
    return fit.load_law(datasets.runs_from_frame(pd.DataFrame(columns)))


def line_of(n=40, seed=0, noise=0.002, A=0.1158, B=1.2416e-4, k1=0.2226):
    rng = np.random.default_rng(seed)
    fm, VB = rng.uniform(500, 1000, n), rng.uniform(0, 0.23, n)
    current = A + B * fm + k1 * VB + noise * rng.normal(size=n)
    return fit.load_law(datasets.runs_from_frame(pd.DataFrame({"fm": fm, "VB": VB, "I": current})))


# --- the paper's numbers ------------------------------------------------------------------------------


def test_the_published_points_give_the_published_settings():
    """0.28 A x 0.85 is 0.24 A to two decimals; 1000 mm/min sharp; 605 at 220 um, within 1 % of the paper's 600."""
    line = parameters.settings(of(three_points()), worn=0.28)
    assert (line.reference, line.unit_load) == (0.24, "A")
    assert line.upper.value == pytest.approx(1000, abs=1e-6)
    assert line.lower.value == pytest.approx(605, abs=0.6)
    assert line.lower.value == pytest.approx(600, rel=0.01)
    assert (line.window, line.lower.wear, line.unit_wear) == ((0.18, 0.22), 0.22, "mm")


def test_three_points_for_three_parameters_leave_no_interval_and_no_probability():
    line = parameters.settings(of(three_points()), worn=0.28)
    for limit in (line.upper, line.lower):
        assert limit.interval == NoInterval(reason="no interval: 3 observations fix 3 parameters exactly")
    assert line.probability is None
    assert line.probability_of == "no interval: 3 observations fix 3 parameters exactly"
    assert any("extrapolated" in note for note in line.notes)  # nobody measured beyond 205.1 um


def test_without_rounding_the_reference_is_the_product():
    assert parameters.settings(of(three_points()), 0.28, rounded_to=None).reference == 0.85 * 0.28


def test_all_published_points_give_limits_with_intervals():
    """Seven rows held at 0.24 A: the interval is that of an ordinary line, by scipy."""
    runs = datasets.read_runs(datasets.bundled("clm2023_end_milling"))
    line = parameters.settings(of(fit.load_law(runs)), worn=0.28)
    held = runs.values("I") == 0.24
    x, y = runs.values("VB")[held], runs.values("fm")[held]
    found = stats.linregress(x, y)
    s2 = np.sum((y - found.intercept - found.slope * x) ** 2) / 5
    for limit, wear in ((line.upper, 0.0), (line.lower, 0.22)):
        half = stats.t.ppf(0.975, 5) * np.sqrt(s2 * (1 / 7 + (wear - x.mean()) ** 2 / np.sum((x - x.mean()) ** 2)))
        value = found.intercept + found.slope * wear
        np.testing.assert_allclose(
            [limit.interval.low, limit.value, limit.interval.high], [value - half, value, value + half]
        )
    assert line.lower.interval.low < 600 < line.lower.interval.high
    assert line.upper.interval.low < 1000 < line.upper.interval.high
    assert any("feeds at 0.24 A, and hold only there" in note for note in line.notes)


def test_a_lower_limit_at_the_top_of_the_window_leaves_half_the_tools_beyond_it():
    """At 220 um half of further tools are worn further; aiming at the middle of the window holds more of them."""
    pf = of(fit.load_law(datasets.read_runs(datasets.bundled("clm2023_end_milling"))))
    top, middle = (parameters.settings(pf, 0.28, wear_limit=w).probability for w in (0.22, 0.20))
    assert 0.4 < top < 0.5 < middle < 0.8


# --- intervals and probability ------------------------------------------------------------------------


def test_fieller_by_scanning_the_feeds():
    """The feeds at which the current is not told from the reference: |I - m(f)| within t standard errors of m(f)."""
    law = line_of(n=12, noise=0.006)
    line = parameters.settings(of(law), 0.28)
    C, (A, B, k1) = law.covariance(), law.params
    f = np.linspace(0, 3000, 600_001)
    for limit in (line.upper, line.lower):
        g = np.stack([np.ones_like(f), f, np.full_like(f, limit.wear)])
        inside = np.abs(0.24 - A - B * f - k1 * limit.wear) <= stats.t.ppf(0.975, 9) * np.sqrt(
            np.sum(g * (C @ g), axis=0)
        )
        assert limit.interval.method == "Fieller"
        np.testing.assert_allclose([limit.interval.low, limit.interval.high], [f[inside][0], f[inside][-1]], atol=0.02)


def test_fieller_is_the_delta_method_where_the_slope_is_known_well():
    law = line_of(n=4000, noise=0.0005)
    line = parameters.settings(of(law), 0.28)
    B, C = law.params["B"], law.covariance()
    for limit in (line.upper, line.lower):
        gradient = np.array([-1, -limit.value, -limit.wear]) / B
        half = stats.t.ppf(0.975, 3997) * np.sqrt(gradient @ C @ gradient)
        assert limit.interval.high - limit.interval.low == pytest.approx(2 * half, rel=1e-4)


def test_a_slope_that_is_not_distinct_from_zero_leaves_no_interval():
    line = parameters.settings(of(line_of(n=5, seed=1, noise=0.04)), 0.28, wear_limit=0.18)
    assert isinstance(line.upper.interval, NoInterval)
    assert "B does not differ from zero" in line.upper.interval.reason


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_the_interval_of_the_lower_limit_holds_the_truth_as_often_as_it_says(seed):
    """90 % of 200 studies within 4 standard errors of Monte Carlo; true limit (0.24 - A - 0.2 k1)/B."""
    truth = (0.24 - 0.1158 - 0.2 * 0.2226) / 1.2416e-4
    held = 0
    for study in range(200):
        line = of_numbers(line_of(n=10, seed=1000 * seed + study, noise=0.004))
        held += line.low <= truth <= line.high
    assert abs(held - 180) < 4 * np.sqrt(200 * 0.9 * 0.1)


def of_numbers(law):
    from fitmodels.parameters.gather.law import fitted_fields
    from fitmodels.parameters.sections.law import LawSection
    from fitmodels.parameters.setting_rules import feed_limit

    return feed_limit(LawSection.model_validate(fitted_fields(law)), 0.24, 0.2, level=0.9).interval


def test_the_probability_is_the_share_of_further_tools():
    """Tools drawn about the true line, the wear at which each draws 0.24 A at the lower limit; a well-known law."""
    line = parameters.settings(of(line_of(n=4000, noise=0.004)), 0.28, wear_limit=0.2)
    e = 0.004 * np.random.default_rng(3).normal(size=400_000)
    wear = (0.24 - 0.1158 - 1.2416e-4 * line.lower.value - e) / 0.2226
    share = np.mean((wear > 0.18) & (wear < 0.22))
    assert line.probability == pytest.approx(share, abs=0.02)
    assert line.probability_of.startswith("t of the law's prediction of one further tool (residual 0.00")


def test_the_share_of_worn_tools_is_that_of_further_tools():
    """Tools drawn about the true line as above: half of them by default, fewer with the limit in the middle."""
    pf = of(line_of(n=4000, noise=0.004))
    e = 0.004 * np.random.default_rng(3).normal(size=400_000)
    shares = []
    for limit in (None, 0.2):
        line = parameters.settings(pf, 0.28, wear_limit=limit)
        wear = (0.24 - 0.1158 - 1.2416e-4 * line.lower.value - e) / 0.2226
        share, words = worn_past_window(sealed(pf, load_line=line))
        assert share == pytest.approx(np.mean(wear > 0.22), abs=0.02)  # the law is estimated
        assert words.startswith(f"{100 * share:.0f} % of further tools are worn past 0.22 mm")
        shares.append(share)
    assert shares[0] == pytest.approx(0.5, abs=0.02)
    assert shares[1] < 0.2


def test_the_default_window_follows_the_unit_of_the_wear():
    pf = of(line_of())
    data = pf.model_dump()
    law = data["laws"]["I"]
    law["coefficients"]["k1"] /= 1000
    wear = law["factors"][-1]
    wear |= {"unit": "um", "low": 1000 * wear["low"], "high": 1000 * wear["high"]}
    law["uncertainty"] = {"kind": "none", "reason": "of a test"}
    line = parameters.settings(parameters.ParameterFile.model_validate({**data, "content_sha256": None}), 0.28)
    assert (line.window, line.lower.wear, line.unit_wear) == ((180.0, 220.0), 220.0, "um")
    assert line.lower.value == pytest.approx(parameters.settings(pf, 0.28).lower.value)


def test_the_probability_grows_with_the_window():
    pf = of(line_of())
    windows = [(0.19, 0.21), (0.18, 0.22), (0.1, 0.3)]
    found = [parameters.settings(pf, 0.28, window=w, wear_limit=0.2).probability for w in windows]
    assert found == sorted(found)
    assert found[-1] > 0.99


def test_units_of_wear_and_feed_scale_through():
    """Wear in um and feed in mm/s: the same limits."""
    pf = of(line_of())
    law = pf.laws["I"]
    to = np.diag([1, 60.0, 1e-3])
    order = [law.uncertainty.of.index(n) for n in ("A", "B", "k1")]
    C = np.array(law.uncertainty.matrix)[np.ix_(order, order)]
    A, B, k1 = (law.coefficients[n] for n in ("A", "B", "k1"))
    other = law.model_validate({
        **law.model_dump(exclude={"region"}), "coefficients": {"A": A, "B": 60 * B, "k1": k1 / 1000},
        "uncertainty": {"kind": "covariance", "of": ["A", "B", "k1"], "matrix": (to @ C @ to).tolist(), "df": law.df},
        "factors": [
            {**f.model_dump(), "unit": unit, "low": times * f.low, "high": times * f.high}
            for f, unit, times in zip(law.factors, ("mm/s", "um"), (1 / 60, 1000.0), strict=True)
        ],
    })  # fmt: skip
    one = parameters.settings(pf, 0.28)
    two = parameters.settings(pf.model_copy(update={"laws": {"I": other}}), 0.28, window=(180.0, 220.0))
    assert (two.unit_feed, two.unit_wear) == ("mm/s", "um")
    assert 60 * two.lower.value == pytest.approx(one.lower.value)
    assert 60 * two.lower.interval.high == pytest.approx(one.lower.interval.high)
    assert two.probability == pytest.approx(one.probability)


@pytest.mark.parametrize("worn", [2.8, 280.0])
def test_a_worn_load_in_another_unit_or_ten_times_as_large_is_refused(worn):
    words = r"times the largest feed tested, 9\d+\.\d+ mm/min\. --worn .* times the largest load of the tests"
    with pytest.raises(ParameterError, match=words):
        parameters.settings(of(line_of()), worn)


# --- refusals -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({"worn": 0.0}, UsageError, "worn 0.0: it must be above zero"),
        ({"worn": float("nan")}, UsageError, "worn nan"),
        ({"safety_factor": 1.17}, UsageError, r"safety_factor 1.17: it must be between 0 and 1, in the paper 0.85"),
        ({"worn": 2.2, "safety_factor": 0.109}, UsageError, "factor 0.109 is below 0.5: twice the reference, 0.48 A"),
        ({"worn": 0.85, "safety_factor": 0.28}, UsageError, "factor 0.28 is below 0.5: twice the reference, 0.476 A"),
        ({"window": (0.22, 0.18)}, UsageError, "the smaller first"),
        ({"wear_limit": 0.3}, UsageError, "outside the window 0.18 to 0.22"),
        ({"rounded_to": 10.0}, UsageError, "rounds to nothing"),
        ({"level": 95}, UsageError, "level 95"),
        ({"law": "AW"}, UsageError, "--law AW: the file holds laws of I"),
        ({"window": (180.0, 220.0)}, ParameterError, "must lie above zero and below the upper"),
        ({"worn": 0.1}, ParameterError, "must lie above zero"),
    ],
)
def test_settings_that_cannot_be_meant(options, error, words):
    with pytest.raises(error, match=words):
        parameters.settings(of(three_points()), **{"worn": 0.28, **options})


def test_a_file_without_a_load_law():
    with pytest.raises(ParameterError, match="the file has no load law"):
        parameters.settings(collect(tool="a", work="b"), 0.28)


def test_feeds_held_at_one_load_say_nothing_of_another():
    pf = of(fit.load_law(datasets.read_runs(datasets.bundled("clm2023_slot_milling"))))
    with pytest.raises(ParameterError, match=r"was measured at 0.24 A and does not apply to 0.26"):
        parameters.settings(pf, 0.31)


# --- the command --------------------------------------------------------------------------------------


@pytest.fixture
def params(tmp_path):
    return write(of(three_points()), tmp_path / "params.json")


def test_the_command_adds_the_section_and_renews_the_checksum(params, capsys):
    before = read(params)
    assert main(["settings", str(params), "--worn", "0.28"]) == 0
    out = capsys.readouterr().out
    assert out.startswith("Verdict on the law of I: ")
    assert "Reference 0.24 A: 0.85 x 0.28 A = 0.238 A, rounded to 0.01." in out
    assert "Lower feed limit 605.5 mm/min at wear 0.22 mm (no interval: 3 observations fix 3 parameters" in out
    after = read(params)
    assert after.load_line.lower.value == pytest.approx(605.5, abs=0.1)
    assert after.content_sha256 != before.content_sha256
    failed = parameters.check(after).failed
    assert {finding.name for finding in failed} == {"verdict"}  # three observations fix the law: nothing is checked
    assert after.model_copy(update={"load_line": None, "provenance": before.provenance}) == before
    assert [path.name for path in params.parent.iterdir()] == ["params.json"]


def test_settings_that_are_there_stand_without_force(params, capsys):
    assert main(["settings", str(params), "--worn", "0.28"]) == 0
    before = params.read_bytes()
    assert main(["settings", str(params), "--worn", "0.28", "--window", "0.18:0.21"]) == 2
    assert "replace them with --force" in capsys.readouterr().err
    assert params.read_bytes() == before
    assert main(["settings", str(params), "--worn", "0.28", "--window", "0.18:0.21", "--force"]) == 0
    assert read(params).load_line.window == (0.18, 0.21)


@pytest.mark.parametrize("window", ["180:220um", "180:220 µm", "0.18:0.22", "0.18:0.22mm", "0.018:0.022cm"])
def test_a_window_may_be_said_in_any_unit_of_length(params, window, capsys):
    assert main(["settings", str(params), "--worn", "0.28", "--window", window, "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["schema"] == "fitmodels.settings/3"
    assert facts["load_line"]["window"] == [0.18, 0.22]
    assert facts["worn_past_window"] is None  # three points leave no scatter


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["--window", "220"], 2, "give two ends with a colon between, with decimal points, as 180:220um"),
        (["--window", "180:220A"], 3, "cannot be converted to 'mm'"),
        (["--window", "a:b"], 2, "as 180:220um"),
        (["--wear-limit", "1:2"], 2, "give one number, with decimal points, as 200um"),
        (["--safety-factor", "1.17"], 2, "between 0 and 1"),
        (["--window", "180:220"], 3, "read as a wear of 220 mm, where no tool was tested above 0.205"),
        (
            ["--worn", "0.112"],
            3,
            "--worn was read as 0.112 A, a reference of 0.1 A; by the law of 'I' a tool with a wear",
        ),
        (["--windw", "1:2"], 2, "did you mean --window"),
    ],
)
def test_what_the_command_refuses(params, arguments, code, words, capsys):
    before = params.read_bytes()
    assert main(["settings", str(params), "--worn", "0.28", *arguments]) == code
    assert words in capsys.readouterr().err
    assert params.read_bytes() == before


def test_intervals_are_printed(tmp_path, capsys):
    path = write(of(line_of()), tmp_path / "params.json")
    assert main(["settings", str(path), "--worn", "0.28", "--wear-limit", "200um", "--dwell", "2"]) == 0
    out = capsys.readouterr().out
    assert "95% interval" in out
    assert "Fieller" in out
    assert "when the lower limit is reached: 0." in out
    assert isinstance(read(path).load_line.lower.interval, LimitInterval)
    assert read(path).load_line.dwell == 2.0


# --- engagement and monitoring ------------------------------------------------------------------------


def settled(params, capsys, *options, code=0):
    assert main(["settings", str(params), "--worn", "0.28", *options]) == code
    said = capsys.readouterr()
    return " ".join((said.out + said.err).split())


def test_what_is_not_given_is_assumed_and_printed(params, capsys):
    said = settled(params, capsys)
    assert "Given" not in said
    assert read(params).load_line.engagement is None
    for words in ("load_low 0.05", "half of the load law at a feed of zero", "lost_after 0.05 s", "stuck_after 1 s",
                  "heartbeat 0.2 s", "overload_after 0.5 s", "arm_after 0.5 s", "dwell 4 s", "on_fault lower limit",
                  "feed_programmed 1000 mm/min, the upper feed limit"):  # fmt: skip
        assert words in said


def test_options_of_the_monitoring_are_written_kept_and_undone(params, capsys):
    """A second call keeps what it does not name, and states it: a stop on a fault is not lost by another limit."""
    said = settled(params, capsys, "--idle", "0.1", "--on-fault", "stop", "--feed-forward", "0.5", "--stuck-after", "0")
    assert "Given: idle 0.1 A; stuck_after 0 s; on_fault stop; feed_forward 0.5." in said
    assert "load_low 0.05 A, half of the load in air" in said
    assert "stuck_after 1 s" not in said
    said = settled(params, capsys, "--force", "--stuck-after", "default", "--recover", "0.1")
    assert "Given: recover 0.1 per s. Kept of the former settings: idle 0.1 A; on_fault stop; feed_forward 0.5." in said
    assert "stuck_after 1 s" in said
    held = read(params).load_line.engagement
    assert (held.idle, held.on_fault, held.feed_forward, held.stuck_after, held.recover) == (
        0.1,
        "stop",
        0.5,
        None,
        0.1,
    )


def test_gains_in_another_unit_are_stated_and_refuse_no_settings(params, capsys):
    pf = read(params)
    gains = {"kp": 0.3, "ki": 1.0, "sample_time": 0.02, "unit_u": "V", "unit_y": "A"}
    write(sealed(pf, pi=gains), params, force=True)
    said = settled(params, capsys, "--idle", "0.1")
    assert (
        "No controller can run these settings: the file has a PI that commands 'V' but feed limits in 'mm/min'" in said
    )
    assert read(params).load_line.engagement.idle == 0.1


def test_every_field_of_the_engagement_has_an_option(params, capsys):
    given = {
        "feed_programmed": 1000.0, "filter_corner": 5.0, "engage_at": 0.16, "hysteresis": 0.02, "engage_after": 0.2,
        "back_off": 1.0, "recover": 0.1, "idle": 0.1, "load_low": 0.04, "load_high": 1.0, "arm_after": 0.4,
        "lost_after": 0.06, "stuck_after": 0.9, "heartbeat": 0.3, "overload_after": 0.4, "on_fault": "stop",
        "feed_forward": 0.5, "sample_time": 0.01,
    }  # fmt: skip
    words = [word for name, value in given.items() for word in (f"--{name.replace('_', '-')}", str(value))]
    assert set(given) == set(Engagement.model_fields)
    settled(params, capsys, *words)
    assert read(params).load_line.engagement.model_dump() == given


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--load-low", "0"], "a lost sensor, which reads zero, would be taken for air; give load_low above zero"),
        (["--idle", "0.2"], "below the threshold of a cut"),
        (["--engage-at", "0.3"], "engages at 0.3"),
        (["--load-high", "0.2"], "readings up to 0.2"),
        (["--engage-after", "1e9"], "Engage_after is 1e+09 s, outside 0 to 2 s"),
        (["--lost-after", "5"], "Lost_after is 5 s, outside 0 to 0.5 s"),
        (["--dwell", "0"], "Dwell is 0 s, outside 0.5 to 60 s"),
        (["--feed-programmed", "1500"], "The programmed feed 1500 mm/min is above the upper feed limit"),
        (["--recover", "9"], "is faster than back_off"),
        (["--load-high", "0.25"], "is not above the overload"),
        (["--idle", "-1"], "engagement: idle should be greater than 0, not -1.0"),
        (["--feed-forward", "2"], "feed_forward should be less than or equal to 1"),
        (["--lost-after", "nan"], "nan is not a number"),
        (["--on-fault", "ignore"], "invalid choice"),
    ],
)
def test_an_engagement_that_cannot_be_run_is_refused(params, options, words, capsys):
    before = params.read_bytes()
    assert words in settled(params, capsys, *options, code=2)
    assert params.read_bytes() == before


@pytest.mark.parametrize(
    ("engagement", "words"),
    [({"lost_afer": 0.1}, "Did you mean 'lost_after'"), ({"on_fault": "go"}, "on_fault should be 'lower limit'")],
)
def test_an_engagement_in_python_is_checked(engagement, words):
    with pytest.raises(UsageError, match=words):
        parameters.settings(of(three_points()), worn=0.28, engagement=engagement)


@pytest.mark.parametrize(
    ("lower", "upper", "words"),
    [(590.0, 1019.0, "the limits 590 and 1019 are extrapolated"), (700.0, 1019.0, "the limit 1019 is extrapolated")],
)
def test_only_feed_limits_outside_the_tests_are_named_as_extrapolated(lower, upper, words):
    law = published("CLM-2023").laws["I"]
    assert (law.factors[0].low, law.factors[0].high) == (600.0, 1000.0)
    (note,) = setting_rules._beyond(law, 0.1, lower, upper)
    assert words in note


# --- words --------------------------------------------------------------------------------------------


def test_a_window_that_is_not_given_is_stated_as_assumed_where_it_is_used(params, capsys):
    """In the list of assumptions, in the notes of the file, and in the view of exports."""
    said = settled(params, capsys)
    assert "of its name: window 0.18 to 0.22 mm, the wear at tool change; engage_at" in said
    line = read(params).load_line
    assert window_assumed(line)
    assert [words for words in line.notes if "--window sets it" in words]
    said = settled(params, capsys, "--force", "--window", "180:205um")
    assert "window 0.18" not in said
    assert not window_assumed(read(params).load_line)


def test_a_window_is_stated_as_assumed_where_no_controller_can_run_the_settings(params, capsys):
    gains = {"kp": 0.3, "ki": 1.0, "sample_time": 0.02, "unit_u": "V", "unit_y": "A"}
    write(sealed(read(params), pi=gains), params, force=True)
    assert "The wear at tool change is assumed: 0.18 to 0.22 mm" in settled(params, capsys)


def test_what_limits_the_use_of_settings_is_a_warning(params, tmp_path, capsys):
    assert "! No tool was tested at a wear above 0.2051 mm" in settled(params, capsys)
    path = write(of(line_of()), tmp_path / "others.json")
    assert main(["settings", str(path), "--worn", "0.28"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line for line in lines if line.startswith("! 50 % of further tools are worn past 0.22 mm")]
    assert main(["settings", str(path), "--worn", "0.28", "--force", "--wear-limit", "0.18"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line for line in lines if re.match(r"(less than 1|[1-5]) % of further tools", line)]


def test_a_reference_rounded_above_its_factor_says_so_and_names_the_option(params, capsys):
    said = settled(params, capsys)
    assert "the reference is 0.857 x 0.28 A, above the safety factor 0.85; --round 0 keeps 0.238 A." in said
    for options in (("--round", "0"), ("--safety-factor", "0.9")):  # 0.252 A is rounded down to 0.25 A
        assert "above the safety factor" not in settled(params, capsys, "--force", *options)


def test_a_programmed_feed_above_the_upper_limit_is_refused_with_the_safety_factor_that_allows_it(params, capsys):
    """The factor and the limit that the refusal names are those that the command then computes."""
    feed = ["--feed-programmed", "1060"]
    said = settled(params, capsys, *feed, code=2)
    assert "A sharp tool reaches the reference 0.24 A (0.85 x 0.28 A) at 1000 mm/min. Program F1000 at most" in said
    found = re.search(r"safety factor (\S+) gives (\S+) A and (\S+) mm/min \(`fitmodels settings --safety-factor", said)
    assert found
    settled(params, capsys, *feed, "--safety-factor", found[1])
    line = read(params).load_line
    assert (line.reference, round(line.upper.value)) == (float(found[2]), round(float(found[3])))
    assert line.reference <= line.safety_factor * line.worn


def test_no_safety_factor_is_offered_where_none_below_one_is_enough(params, capsys):
    said = settled(params, capsys, "--feed-programmed", "1400", code=2)
    assert "Program F1000 at most. Nothing was written." in said


def test_a_law_that_must_not_be_used_is_named_first_as_the_cause(params, capsys):
    pf = read(params)
    reasons = ["R2 0.00459.", "I in line 9 (0.826 A) deviates by 0.604 A from the law of the other rows."]
    verdict = {"level": "do not use for control", "reasons": reasons}
    law = LawSection.model_validate({**pf.laws["I"].model_dump(), "verdict": verdict})
    write(sealed(pf, laws={**pf.laws, "I": law}), params, force=True)
    assert main(["settings", str(params), "--worn", "0.112"]) == 3
    said = " ".join(capsys.readouterr().err.split())
    cause = said.index("The likely cause is the law of 'I', 'do not use for control'. I in line 9 (0.826 A) deviates")
    assert cause < said.index("Otherwise: --worn was read as 0.112 A")


@pytest.mark.parametrize(
    ("worn", "words"),
    [
        ("280", "is 980 times the largest load of the tests, 0.286 A by their law. Was 0.28 A meant (280 mA)?"),
        ("2.8", "--worn 2.8 A is 9.8 times the largest load of the tests, 0.286 A by their law. Give it in A"),
        ("280 V", "values in 'V' cannot be converted to 'A'"),
        ("0,28", "--worn 0,28: give one number, with decimal points, as 0.28A."),
    ],
)  # fmt: skip
def test_a_worn_load_in_another_unit_is_refused_with_the_likely_slip(params, worn, words, capsys):
    assert main(["settings", str(params), "--worn", worn]) in (2, 3)
    assert words in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize(
    ("worn", "code", "words"),
    [("280kg", 2, "the unit 'kg' is not known"), ("28000uA", 2, "the unit 'uA' is not known"),
     ("0.28V", 3, "values in 'V' cannot be converted to 'A', which measures another quantity")],
)  # fmt: skip
def test_a_worn_load_in_a_unit_of_no_load_names_the_option(params, worn, code, words, capsys):
    assert main(["settings", str(params), "--worn", worn]) == code
    assert f"--worn {worn}: {words}; give it in A, as 0.28A." in " ".join(capsys.readouterr().err.split())


def test_a_worn_load_may_have_its_unit(params, capsys):
    settled(params, capsys)
    one = read(params).load_line
    assert main(["settings", str(params), "--worn", "280mA", "--force"]) == 0
    assert read(params).load_line == one


def test_settings_of_constant_power_come_from_the_load_line_of_the_power(tmp_path, capsys):
    rng, rows = np.random.default_rng(5), [(fm, VB) for fm in (500, 700, 900, 1100) for VB in (0.02, 0.08, 0.14, 0.2)]
    frame = pd.DataFrame(rows, columns=["fm [mm/min]", "VB [mm]"])
    noise = 0.02 * rng.standard_normal(len(rows))
    frame["P [kW]"] = 1.18 + 1.18e-3 * frame["fm [mm/min]"] + 2.75 * frame["VB [mm]"] + noise
    path = tmp_path / "mill.csv"
    path.write_text(f"# simulated\n# tool: T1\n# work: W1\n{frame.to_csv(index=False)}")
    law, worn = ("--law", "P ~ fm, VB", "--out"), ("--worn", "2.8kW", "--force")
    assert main([str(path), "--form", "P=linear", *law, str(tmp_path / "linear")]) == 0
    capsys.readouterr()
    assert main(["settings", str(tmp_path / "linear/T1_W1/params.json"), *worn]) == 3
    said = capsys.readouterr().err
    assert "has no load law" in said
    assert "--form P=load-line" in said
    assert main([str(path), "--form", "P=load-line", *law, str(tmp_path / "line")]) == 0
    assert main(["settings", str(tmp_path / "line/T1_W1/params.json"), *worn]) == 0
    line = read(tmp_path / "line/T1_W1/params.json").load_line
    assert (line.load, line.unit_load, line.law, line.reference) == ("P", "kW", "P", 2.38)
    assert line.upper.value == pytest.approx((2.38 - 1.18) / 1.18e-3, rel=0.03)


@pytest.mark.parametrize(("response", "factors"), [("Ra", ("fm", "VB")), ("P", ("fm",)), ("P", ("V", "VB"))])
def test_a_load_line_is_of_a_load_on_feed_and_wear(response, factors):
    assert CHOICES["load-line"].unsuited(response, factors)
