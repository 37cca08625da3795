"""Sections of the parameter file beyond the laws: what they hold, what they refuse, what they compute alone."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fitmodels import cards, datasets, fit, parameters
from fitmodels.cards.content.card import compose
from fitmodels.core.errors import GateError, ParameterError
from fitmodels.fit.fitted_rows import LawSource
from fitmodels.ident.model import Model
from fitmodels.ident.pi.gains import PiGains
from fitmodels.ident.pi.tuning import tune_pi
from fitmodels.parameters import collect, read, write
from fitmodels.parameters.published import published as published_file
from fitmodels.parameters.sections.dynamics import DynamicsSection, PiSection
from fitmodels.parameters.sections.force_control import AdaptiveForceSection, RoughnessSection
from fitmodels.parameters.sections.law_parts import Region
from fitmodels.parameters.sections.load_line import Bound, Engagement, LimitsSection, Range
from fitmodels.parameters.sections.origin import IdentitySection, ProvenanceSection, Sensor
from fitmodels.parameters.sections.posterior import Prior
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError
from scipy.signal import dfreqresp, dlsim

FACTORS = ["V", "f", "d", "t"]
NONE = {"kind": "none", "reason": "given"}
# Tai, Tsai & Li 2023, doi 10.1109/ACCESS.2023.3330587, eq. 18, at 50 Hz: feed voltage to spindle current
CLM = {"b": [0.0, 0.0611, -0.1338, 0.0752], "a": [1.0, -2.0311, 1.2104, -0.1655], "nk": 1, "sample_time": 0.02}


def published(**changes):
    return DynamicsSection.model_validate({**CLM, "uncertainty": NONE, "unit_u": "V", "unit_y": "A", **changes})


def model(**changes):
    cov = np.diag([4e-4, 1e-4, 9e-6, 1e-6, 4e-6, 1e-6])
    given_ = {**CLM, "cov_params": cov, "n": 750, "record": "a" * 64, "band": (0.1, 2.0), "unit_u": "V", "unit_y": "A"}
    return Model(**{**given_, "structure": "output_error", "operating_point": (2.5, 0.2), **changes})


# --- dynamics -----------------------------------------------------------------------------------------


def test_the_published_model_simulates_as_scipy_does():
    """scipy.signal.dlsim runs the same transfer function by its state space."""
    u = np.random.default_rng(1).normal(size=300)
    _, expected = dlsim((CLM["b"][1:], CLM["a"], 0.02), u)  # z^2 ... over z^3 ...
    np.testing.assert_allclose(published().simulate(u), expected[:, 0], rtol=1e-9, atol=1e-12)


def test_the_published_model_answers_in_frequency_as_scipy_does():
    w, expected = dfreqresp((CLM["b"][1:], CLM["a"], 0.02), w=np.linspace(0.01, 3, 50))
    np.testing.assert_allclose(published().response(w / (2 * np.pi * 0.02)), expected, rtol=1e-9)


def test_poles_and_gain_of_the_published_model():
    """Worked out from the printed decimals: poles 0.9187 +- 0.1025i and 0.1937, static gain 0.1812 A/V."""
    poles = sorted(published().poles, key=lambda p: (p.real, p.imag))
    np.testing.assert_allclose(poles, [0.1937, 0.9187 - 0.1025j, 0.9187 + 0.1025j], atol=1e-4)
    assert published().dc_gain == pytest.approx(0.1812, abs=1e-4)
    assert published().stable


def test_a_model_is_handed_over_number_for_number(tmp_path):
    mine = model()
    pf = read(write(collect(tool="a", work="b", dynamics=mine, held_out_fit=83.5), tmp_path / "params.json"))
    found = pf.dynamics
    assert (found.b, found.a, found.nk, found.sample_time) == (tuple(mine.b), tuple(mine.a), 1, 0.02)
    np.testing.assert_array_equal(found.uncertainty.matrix, mine.cov_params)
    assert found.uncertainty.of == mine.names
    assert found.uncertainty.df == 744
    assert (found.record_sha256, found.band, found.operating_point) == ("a" * 64, (0.1, 2.0), (2.5, 0.2))
    assert (found.structure, found.held_out_fit, found.n) == ("output_error", 83.5, 750)
    u = np.sin(np.arange(200) / 7)
    np.testing.assert_allclose(found.simulate(u), mine.simulate(u), rtol=1e-12)
    np.testing.assert_allclose(found.response([0.1, 1.0, 20.0]), mine.response([0.1, 1.0, 20.0]), rtol=1e-12)


@given(st.lists(st.floats(-0.4, 0.4), min_size=1, max_size=2), st.lists(st.floats(-5, 5), min_size=1, max_size=4))
def test_a_simulation_scales_with_its_input(a, b):
    made = DynamicsSection(b=[0.0, *b], a=[1.0, *a], nk=1, sample_time=0.1, uncertainty=NONE)
    u = np.arange(20.0)
    np.testing.assert_allclose(made.simulate(3 * u), 3 * made.simulate(u), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"a": [2.0, -1.0]}, "a starts with 1, not with 2"),
        ({"b": [0.5, 0.1]}, "begins with 1 zeros"),
        ({"nk": 9}, "begins with 9 zeros"),
        ({"sample_time": 0.0}, "greater than 0"),
        ({"band": (2.0, 0.1)}, "wrong order"),
        ({"b": [0.0] * 101}, "at most 100"),
        ({"uncertainty": {"kind": "covariance", "of": ["x"], "matrix": [[1.0]]}}, "must be of a1, a2, a3, b1"),
        ({"uncertainty": {"kind": "covariance", "of": ["x"], "matrix": [[-1.0]]}}, "diagonal is negative"),
        ({"record_sha256": "../../x"}, "pattern"),
    ],
)
def test_dynamics_that_cannot_be(changes, words):
    with pytest.raises(ValidationError, match=words):
        published(**changes)


@pytest.mark.parametrize("u", [[np.nan, 1.0], [[1.0], [2.0]], 3.0])
def test_an_input_that_cannot_be_simulated(u):
    with pytest.raises(ParameterError, match="a row of finite numbers"):
        published().simulate(u)


def test_a_run_that_leaves_all_bounds_is_a_sentence():
    with pytest.raises(ParameterError, match="diverges"):
        published(a=[1.0, -9.0]).simulate(np.ones(2000))


def test_the_file_simulates_without_the_identification_package(tmp_path):
    path = write(collect(tool="a", work="b", dynamics=model()), tmp_path / "params.json")
    code = (
        "import sys; from fitmodels import parameters as p; pf = p.read(sys.argv[1]); "
        "before = [m for m in ('scipy', 'pandas', 'pint') if m in sys.modules]; pf.dynamics.simulate([1.0]); "
        "p.check(pf); print(before, [m for m in sys.modules if m.startswith(('fitmodels.ident', 'fitmodels.fit'))])"
    )
    root = str(Path(parameters.__file__).parents[2])
    done = subprocess.run(
        [sys.executable, "-c", code, str(path)], capture_output=True, text=True, check=True, env={"PYTHONPATH": root}
    )
    assert done.stdout.split() == ["[]", "[]"]


# --- PI gains -----------------------------------------------------------------------------------------


def test_gains_are_handed_over_whole(tmp_path):
    gains = PiGains(
        0.1, 0.5, 0.02, form="incremental", integration="trapezoidal", delay=2, filter_time=0.1, average=5,
        average_of="command", low=0.0, high=5.0, rate=2.0, anti_windup="back_calculation", tracking_time=1.0,
        unit_u="V", unit_y="A",
    )  # fmt: skip
    pf = read(write(collect(tool="a", work="b", pi=gains), tmp_path / "params.json"))
    for name in PiGains.__dataclass_fields__:
        assert getattr(pf.pi, name) == getattr(gains, name), name
    assert pf.pi.ti == gains.ti


def test_tuned_gains_bring_what_they_were_tuned_to(tmp_path):
    tuned = tune_pi(model(cov_params=None), 2.0, 4.0, n=40)
    pf = read(write(collect(tool="a", work="b", dynamics=tuned.model, pi=tuned), tmp_path / "params.json"))
    assert pf.pi.specification.rise_time == 2.0
    assert pf.pi.figures.ms == tuned.figures.ms
    assert pf.pi.forced is None


def test_gains_that_miss_are_handed_over_only_with_a_reason():
    tuned = tune_pi(model(cov_params=None), 0.05, 0.1, n=40)
    assert tuned.misses
    with pytest.raises(GateError, match="the gains miss their specification"):
        collect(tool="a", work="b", pi=tuned)
    kept = collect(tool="a", work="b", pi=tuned, pi_forced="a trial at the bench").pi
    assert kept.forced.startswith("a trial at the bench: ")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"low": 2.0, "high": 1.0}, "low must lie below high"),
        ({"sample_time": 0.0}, "greater than 0"),
        ({"form": "ideal"}, "'position', 'incremental'"),
        ({"average": 10**6}, "less than or equal to 1000"),
        ({"probability": 1.2}, "less than or equal to 1"),
        ({"scaling_u": 0.0}, "greater than 0"),
    ],
)
def test_gains_that_cannot_be(changes, words):
    with pytest.raises(ValidationError, match=words):
        PiSection.model_validate({"kp": 0.1, "ki": 0.2, "sample_time": 0.02, **changes})


# --- identity, limits and settings --------------------------------------------------------------------


@pytest.mark.parametrize("group", ["P", "M", "K", "N", "S", "H", "P01", "K20", "M50"])
def test_groups_of_iso_513(group):
    assert IdentitySection(tool="a", work="b", simulated=False, iso513=group).iso513 == group


@pytest.mark.parametrize("group", ["p20", "X", "P51", "P00", "P1", "P20\n", "steel", ""])
def test_no_group_of_iso_513(group):
    with pytest.raises(ValidationError, match="no group of ISO 513"):
        IdentitySection(tool="a", work="b", simulated=False, iso513=group)


def test_properties_of_iso_13399_and_sensors_go_along(tmp_path):
    pf = collect(
        tool="end mill", work="S45C", iso513="P", iso13399={"DC": 2.0, "ZEFP": 2, "GRADE": "uncoated"}, machine="VMC",
        setup="vice, dry", sensors=[Sensor(symbol="I", unit="A", sample_rate=50.0), {"symbol": "VB", "unit": "um"}],
    )  # fmt: skip
    again = read(write(pf, tmp_path / "params.json")).identity
    assert again.iso13399 == {"DC": 2.0, "ZEFP": 2.0, "GRADE": "uncoated"}
    assert [sensor.symbol for sensor in again.sensors] == ["I", "VB"]
    with pytest.raises(ParameterError, match="'d c' is not a symbol of ISO 13399"):
        collect(tool="a", work="b", iso13399={"d c": 2.0})


@pytest.mark.parametrize("name", ["../../x", "..", "a/b", "a\\b", "", "nul\0l"])
def test_a_data_file_is_a_name_alone(name):
    with pytest.raises(ValidationError, match="not the name of a file alone"):
        ProvenanceSection(fitmodels="1", data_file=name)


@pytest.mark.parametrize("given_", ["/some/where/data.csv", "..\\where\\data.csv", "data.csv"])
def test_only_the_name_of_a_data_file_is_kept(given_):
    assert collect(tool="a", work="b", data_file=given_).provenance.data_file == "data.csv"


def test_limits_may_be_said_as_bare_numbers():
    limits = collect(
        tool="a",
        work="b",
        limits={"power": 7, "force": {"value": 1500.0, "unit": "N", "of": "Fxz"}, "speed": (50, 200)},
    ).limits
    assert limits == LimitsSection(
        power=Bound(value=7.0, unit="kW"), force=Bound(value=1500.0, unit="N", of="Fxz"),
        speed=Range(low=50.0, high=200.0, unit="m/min"),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        ({"power": -7}, r"limits\.power\.value"),
        ({"speed": (200, 50)}, r"limits\.speed: .*low 200 above high 50"),
        ({"speed": (1, 2, 3)}, "of 3 numbers"),
        ({"wear": "0.3"}, r"limits\.wear should be an object"),
    ],
)
def test_limits_that_cannot_be(limits, words):
    with pytest.raises(ParameterError, match=words):
        collect(tool="a", work="b", limits=limits)


def test_roughness_settings_in_order():
    """Force for Ra 1.0 from Ra = 0.2401 exp(0.0034 F): ln(1/0.2401)/0.0034 = 419.6 N."""
    section = RoughnessSection(
        law="Ra", roughness=1.0, force=np.log(1 / 0.2401) / 0.0034, threshold=100.0, override_high=1.5
    )
    assert section.force == pytest.approx(419.6, abs=0.1)
    with pytest.raises(ValidationError, match="not below the reference force"):
        RoughnessSection(law="Ra", roughness=1.0, force=90.0, threshold=100.0, override_high=1.5)
    with pytest.raises(ValidationError, match="leaves no range"):
        RoughnessSection(law="Ra", roughness=1.0, force=420.0, threshold=100.0, override_high=0.5, override_low=0.5)


def test_every_section_goes_there_and_back(tmp_path):
    force = AdaptiveForceSection(
        m=0.01, alpha=0.2, beta=1.0, g1=1e-5, g2=1e-4, g3=1e-4, Kd=0.5, lam=10.0,
        set_points=[{"depth": d, "force": f} for d, f in ((1.0, 150.0), (2.0, 200.0), (4.0, 320.0))],
    )  # fmt: skip
    exact = {"kind": "none", "reason": "3 points, 3 parameters"}
    line = {
        "reference": 0.24, "worn": 0.28, "safety_factor": 0.85, "rounded_to": 0.01, "unit_load": "A", "law": "I",
        "upper": {"value": 1000.0, "wear": 0.0, "interval": exact},
        "lower": {"value": 605.0, "wear": 0.22, "interval": exact},
        "unit_feed": "mm/min", "window": [0.18, 0.22], "unit_wear": "mm",
        "engagement": Engagement(engage_at=0.15, hysteresis=0.02, engage_after=0.1).model_dump(),
    }  # fmt: skip
    pf = collect(
        tool="a", work="b", dynamics=published(), pi=PiSection(kp=0.1, ki=0.2, sample_time=0.02), load_line=line,
        limits={"wear": 0.3}, adaptive_force=force,
        roughness=RoughnessSection(law="Ra", roughness=1.0, force=420.0, threshold=100.0, override_high=1.5),
    )  # fmt: skip
    assert read(write(pf, tmp_path / "params.json")) == pf
    assert pf.adaptive_force.set_points[2].force == 320.0


# Tool, work, data file and "simulated" come from the laws themselves


def wear_tests():
    return datasets.read_runs(datasets.bundled("gc435_709m40"))


def test_a_law_of_simulated_data_gives_a_file_and_a_card_that_say_so(tmp_path):
    law = fit.power_law(wear_tests(), "AW", FACTORS)
    pf = parameters.collect(laws=[law])
    assert pf.identity.simulated is True
    assert (pf.identity.tool, pf.identity.work) == (wear_tests().tool, wear_tests().work)
    assert "simulated" in pf.identity.note
    assert pf.provenance.data_sha256 == wear_tests().source.sha256
    assert (pf.provenance.data_file, pf.provenance.n_rows) == (wear_tests().source.name, 239)
    cards.write(pf, tmp_path / "card")
    assert "simulated" in (tmp_path / "card" / "README.md").read_text("utf-8").lower()


def test_arguments_take_precedence_over_the_source():
    law = fit.power_law(wear_tests(), "AW", FACTORS)
    pf = parameters.collect(tool="A", work="B", laws=[law], simulated=False, data_file="other.csv", n_rows=7)
    assert (pf.identity.tool, pf.identity.work, pf.identity.simulated, pf.identity.note) == ("A", "B", False, None)
    assert (pf.provenance.data_file, pf.provenance.data_sha256, pf.provenance.n_rows) == ("other.csv", None, 7)


def test_the_machine_is_the_one_that_the_file_names(tmp_path):
    law = fit.power_law(wear_tests(), "AW", FACTORS)
    pf = parameters.collect(laws=[law], design=wear_tests())
    assert pf.identity.machine == "Colchester Mascot centre lathe, dry turning"
    assert parameters.collect(laws=[law], design=wear_tests(), machine="Makino V33").identity.machine == "Makino V33"
    assert parameters.collect(laws=[law]).identity.machine is None
    cards.write(pf, tmp_path / "card")
    for name in ("README.md", "card.html"):
        text = (tmp_path / "card" / name).read_text("utf-8")
        assert "Colchester Mascot centre lathe" in text
        assert "Missing: machine" not in text


def test_every_kind_of_law_carries_its_source():
    rough = fit.exponential_law(datasets.read_runs(datasets.bundled("surf_table1")))
    load = fit.load_law(datasets.read_runs(datasets.bundled("clm2023_end_milling")))
    for law in (rough, load):
        assert len(law.source.sha256) == 64
        assert parameters.collect(laws=[law]).provenance.data_sha256 == law.source.sha256
    assert load.alternative is None
    assert rough.alternative.source == rough.source


def test_a_law_of_a_stream_carries_the_source_that_is_given():
    source = LawSource("big.parquet", "a" * 64, "GC435", "709M40", simulated=True, note="simulated: no measurement")
    law = fit.streamed_power_law([wear_tests().data[:100], wear_tests().data[100:]], "AW", FACTORS, source=source)
    assert law.source == replace(source, n_rows=239)
    pf = parameters.collect(laws=[law])
    assert (pf.identity.tool, pf.identity.simulated, pf.provenance.data_file) == ("GC435", True, "big.parquet")


def test_whether_a_stream_without_a_source_was_simulated_is_unknown(tmp_path):
    law = fit.streamed_power_law([wear_tests().data], "AW", FACTORS)
    pf = parameters.collect(tool="GC435", work="709M40", laws=[law])
    assert (pf.identity.simulated, pf.reading) == (None, None)
    assert parameters.read(parameters.write(pf, tmp_path / "params.json")) == pf
    cards.write(pf, tmp_path / "card")
    readme, page = ((tmp_path / "card" / name).read_text("utf-8") for name in ("README.md", "card.html"))
    assert "Measured or simulated: unknown" in readme
    assert "simulated: null" in readme
    assert "measured" not in readme.split("---")[1]
    assert "<dt>Measured</dt><dd>unknown</dd>" in page
    assert parameters.collect(tool="a", work="b", limits={"power": 7.0}).identity.simulated is False


def test_laws_of_different_data_are_refused():
    law = fit.power_law(wear_tests(), "AW", FACTORS)
    rough = fit.exponential_law(datasets.read_runs(datasets.bundled("surf_table1")))
    with pytest.raises(ParameterError, match="laws of AW and Ra come from different data"):
        parameters.collect(laws=[law, rough])
    both = parameters.collect(tool="a", work="b", laws=[law, rough], data_file="both.csv")
    assert list(both.laws) == ["AW", "Ra"]


def test_without_laws_tool_and_work_are_needed():
    with pytest.raises(ParameterError, match="give tool= and work="):
        parameters.collect(tool="a")


# Regions and priors that no design and no prior has


SPACE = {"of": "rows", "columns": [0, 1], "matrix": [[0.5, 0.0], [0.0, 0.5]], "largest": [1.0]}
REGION = {"logs": True, "centre": [4.0], "half_range": [0.5], "largest_radius": 1.0, "spaces": [SPACE]}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"half_range": [0.5, 0.5]}, "has 1 centres"),
        ({"half_range": [0.0]}, "greater than 0"),
        ({"spaces": [{**SPACE, "columns": [0, 7]}]}, "needs columns below 2"),
        ({"spaces": [{**SPACE, "largest": []}]}, "needs columns below 2, 1 limits"),
        ({"spaces": [{**SPACE, "matrix": [[0.5], [0.0, 0.5]]}]}, "must be 2 x 2"),
    ],
)
def test_a_region_that_no_design_has(changes, words):
    Region.model_validate(REGION)
    with pytest.raises(ValidationError, match=words):
        Region.model_validate({**REGION, **changes})


def test_a_prior_lacks_a_number():
    with pytest.raises(ValidationError, match="the normal prior has no sd"):
        Prior(distribution="normal", numbers={"mean": 0.0})


@pytest.mark.parametrize("paper", ["CLM-2023", "LYAP", "SURF"])
def test_every_published_file_has_a_card(paper):
    """The law of VB in CLM-2023 begins at a time of 0, where its logarithm is infinite."""
    card = compose(published_file(paper))
    assert card.laws is not None
