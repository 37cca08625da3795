"""Every public result says what it is on a line, in a notebook and as text, and draws itself on axes that are given.

Results are found by looking: a public class without manners, or one that no builder below makes, fails.
"""

import ast
import dataclasses
import inspect
import os
import re
import typing
from collections.abc import Callable
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from tempfile import TemporaryDirectory

import fitmodels
import numpy as np
import pandas as pd
import pytest
from fitmodels import batch, controllers, datasets, fit, ident, parameters, pipeline
from fitmodels.controllers.adaptive_force.stability import step_study
from fitmodels.controllers.constant_load_milling.cut_model import CutModel
from fitmodels.controllers.constant_load_milling.steady import steady_life
from fitmodels.controllers.recursion.interval_optimum import best_exact
from fitmodels.controllers.recursion.laws import Rules
from fitmodels.controllers.recursion.life import best_fixed
from fitmodels.controllers.region.visible import wear_front
from fitmodels.controllers.roughness.simulations import turn
from fitmodels.core.display import Display, Displayable, HasRepr, TextTable, estimates, format_value
from fitmodels.core.rounding import with_error
from fitmodels.core.verdict import MARKS
from fitmodels.datasets.records.formats import looks_like_record
from fitmodels.fit.bayes.competing_posterior import posterior_of_form
from fitmodels.fit.bayes.sampling import watch
from fitmodels.fit.checks.response_scale import error_structure
from fitmodels.fit.checks.time_exponent import common_exponent
from fitmodels.fit.defaults import Refused
from fitmodels.fit.many.many_laws import ManyLaws
from fitmodels.fit.published import compare_published
from fitmodels.fit.rows import By, Dropped, LeftOut
from fitmodels.ident.continuous import sampled, to_continuous
from fitmodels.ident.pi.controller import simulate_loop
from fitmodels.ident.pi.loop import loop_of
from fitmodels.ident.responses.confidence_bands import response_band, step_band
from fitmodels.parameters.draws import Draws
from fitmodels.parameters.file import sealed
from fitmodels.parameters.published import published
from matplotlib.axes import Axes
from matplotlib.figure import Figure

ROOMS = (datasets, fit, ident, parameters, controllers, pipeline, batch)
FACTORS = ["V", "f", "d", "t"]

# --- results, one of each kind; each is made once, when a test asks for it


@cache
def runs():
    return datasets.read_runs(datasets.bundled("gc435_709m40"))


@cache
def halves():
    """Runs of all edges but three, and of these three."""
    of = runs()
    edge = of.labels("edge")
    new = np.isin(edge, list(dict.fromkeys(edge))[-3:])
    return [
        dataclasses.replace(of, data=of.data[rows].reset_index(drop=True), lines=of.lines[rows]) for rows in (~new, new)
    ]


@cache
def law():
    return fit.power_law(runs(), "AW", FACTORS)


@cache
def load():
    return fit.power_law(runs(), "P", ["V", "f", "d", "AW"])


@cache
def post():
    return fit.posterior(law(), seed=1, draws=1000)


@cache
def plant():
    return ident.Model(b=[0, 0.1, 0.05], a=[1, -1.5, 0.6], nk=1, sample_time=0.02, unit_u="V", unit_y="A")


@cache
def record():
    u = ident.chirp(amplitude=2.5, f0=0.1, f1=5.0, duration=12, rate=50)
    y = plant().simulate(u) + 0.05 * np.random.default_rng(1).normal(size=len(u))
    return datasets.Record(u=u, y=y, sample_time=0.02, unit_u="V", unit_y="A")


@cache
def found():
    return ident.identify(record(), orders=(2, 2, 1))


@cache
def tuned():
    return ident.tune_pi(found().model, rise_time=1.0, settling_time=2.0)


@cache
def pf():
    limits = {"power": 7.0}
    return parameters.collect(
        tool="GC435", work="709M40", laws=[law(), load()], posteriors=[post()], dynamics=found().model, pi=tuned(),
        limits=limits,
    )  # fmt: skip


@cache
def region():
    return controllers.visible_region(published("AC-2016"), d=2.5, t=10.0)


@cache
def life_laws():
    return controllers.life_laws(published("AC-2017"))


@cache
def tool_run():
    return controllers.constant_load_run(published("CLM-2023"), pass_length=300.0)


@cache
def turned():
    return turn(published("SURF"), duration=2.0)


def drive():
    """A mass of 50 kg with friction, in still air: force N, velocity m/s."""
    t = np.arange(4000) * 1e-3
    F = 60 * np.sin(2 * np.pi * 0.7 * t) + 30 * np.sin(2 * np.pi * 2.3 * t)
    v = np.zeros_like(t)
    for k in range(len(t) - 1):
        v[k + 1] = v[k] + 1e-3 * (F[k] - 100 * v[k] - 10 * np.tanh(v[k] / 1e-3)) / 50
    v += 1e-4 * np.random.default_rng(1).normal(size=len(v))
    return ident.drive_fit(datasets.Record(u=F, y=v, sample_time=1e-3, unit_u="N", unit_y="m/s"))


def force():
    u = 1 + np.sin(0.0003 * np.arange(900.0) ** 2)
    y = sampled([400.0], [2.0, 76.0, 480.0], 0.01).simulate(u)
    rec = datasets.Record(u=u, y=y + 0.01 * np.random.default_rng(1).normal(size=len(u)), sample_time=0.01, unit_y="N")
    return ident.force_process_fit(rec, m=2.0, drive="faster")


def step():
    t = np.arange(-0.1, 2, 0.01)
    y = np.where(t > 0.1, 2 * (1 - np.exp(-(t - 0.1) / 0.3)), 0.0)
    return ident.step_response_fit((t, y + 0.01 * np.random.default_rng(1).normal(size=len(t))))


def chance():
    draws = {"AW": Draws(post().names, post().draws), "P": Draws(*load_draws())}
    file = sealed(pf(), limits={"power": {"value": 4.0, "unit": "kW"}})
    return controllers.feasibility(file, draws=draws, most=200, grid=(5, 5))


@cache
def load_draws():
    of = fit.posterior(load(), seed=1, draws=1000)
    return of.names, of.draws


def life_draws():
    exact = published("AC-2017").laws["AW"]
    names = ("ln c0", *list(exact.coefficients)[1:])
    middle = np.array([np.log(exact.coefficients["c0"]), *list(exact.coefficients.values())[1:]])
    values = middle + 0.01 * np.random.default_rng(1).normal(size=(60, len(middle)))
    return controllers.life_draws(life_laws(), {"AW": Draws(names, values)})


def latent():
    return fit.latent_wear(law(), [load()], 0.05, draws=400, method="importance")


@cache
def many() -> ManyLaws:
    data = runs().data.assign(pair=[f"p{i % 3}" for i in range(len(runs().data))])
    return fit.many_power_laws(data, "AW", ["V", "f", "d", "t"], pair="pair", edge="edge")


@cache
def analysis():
    return pipeline.analyse(datasets.bundled("ac2017_table1"), draws=1000)


@cache
def shop():
    with TemporaryDirectory() as place:
        return batch.run(datasets.bundled("gc435_709m40"), Path(place, "out"), files=False)


def forces():
    """Cutting forces of exact Kienzle constants, with rounding to 1 N."""
    table = pd.DataFrame({"d": [1.0, 2.0, 2.5, 1.0, 1.5, 2.0], "f": [0.1, 0.2, 0.3, 0.4, 0.25, 0.15]})
    return datasets.runs_from_frame(table.assign(Fc=(1780 * table["d"] * table["f"] ** 0.74).round()))


RESULTS: dict[str, Callable[[], object]] = {
    "Runs": runs,
    "Record": record,
    "SimulatedLaw": lambda: datasets.SimulatedLaw("AW", "mm", 0.01, {"V": 0.5, "t": 0.25}, 0.07, 0.07),
    "ColumnUse": lambda: runs().columns[0],
    "Source": lambda: runs().source,
    "FileKind": lambda: looks_like_record(datasets.bundled("gc435_709m40")),
    "LawFit": law,
    "LawFit of a stream": lambda: fit.streamed_power_law([runs().data], "AW", ["V", "f", "d", "t"]),
    "ManyLaws": many,
    "PooledExponents": lambda: fit.pooled_exponents(many(), "V"),
    "LinearFit": lambda: fit.linear(np.random.default_rng(1).normal(size=(20, 2)), np.arange(20.0)),
    "Judgement": lambda: fit.judge(law()),
    "Posterior": post,
    "JointPosterior": latent,
    "CompetingPosterior": lambda: posterior_of_form(law(), "second order in logs", draws=400),
    "Priors": lambda: post().priors,
    "PublishedComparison": lambda: compare_published(
        fit.exponential_law(datasets.read_runs(datasets.bundled("surf_table1"))), "", "Ck 45"
    ),
    "By": lambda: By("material", "steel", ("iron",)),
    "Composite": lambda: fit.composite(load(), law()),
    "Confirmation": lambda: fit.confirm(fit.power_law(halves()[0], "AW", FACTORS), halves()[1]),
    "DesignRegion": lambda: law().region,
    "Dropped": lambda: Dropped("no wear", 3, (4, 5, 9)),
    "EdgeBootstrap": lambda: fit.edge_bootstrap(law()),
    "EdgeInference": lambda: law().edges,
    "CompetingModels": lambda: fit.compare_forms(law()),
    "FormComparison": lambda: fit.compare_laws(runs(), law(), forms=["linear", "second-order"]),
    "GaugeFit": lambda: fit.gauge_corrected(load(), 0.01),
    "LeftOut": lambda: LeftOut("d", "it never changes"),
    "NotAvailable": lambda: fit.NotAvailable("no replicated edges"),
    "Refused": lambda: Refused("Fxz", "no force in the file"),
    "RobustFit": lambda: fit.robust(law()),
    "ToolLife": lambda: fit.tool_life(law(), 0.3),
    "WearCurveLives": lambda: fit.wear_curve_lives(law(), 0.3),
    "ResponseSurface": lambda: fit.response_surface(runs(), "AW", FACTORS),
    "KienzleLaw": lambda: fit.kienzle_law(forces()),
    "EndMillForce": lambda: fit.end_mill_force(
        2500, feed_per_tooth=0.035, axial_depth=0.2, radial_depth=2, diameter=2, teeth=2, helix=38
    ),
    "CommonExponent": lambda: common_exponent(law()),
    "ErrorStructure": lambda: error_structure(law()),
    "Model": plant,
    "ContinuousModel": lambda: to_continuous(plant()),
    "NoContinuousForm": lambda: to_continuous(ident.Model(b=[0, 1], a=[1, 0.5], nk=1, sample_time=0.1)),
    "Identification": found,
    "Validation": lambda: found().validation,
    "OrderSearch": lambda: found().one_step,
    "FrequencyResponse": lambda: ident.frequency_response(record()),
    "ResponseBand": lambda: response_band(found().model, [0.5, 1.0, 2.0]),
    "StepBand": lambda: step_band(found().model, 2.0),
    "PredictedErrors": lambda: ident.predicted_errors(plant(), record().u, 0.05),
    "StepFit": step,
    "DriveFit": drive,
    "ForceProcess": force,
    "TunedPi": tuned,
    "PiGains": lambda: tuned().gains,
    "FeasibleMap": lambda: tuned().map,
    "Specification": lambda: tuned().specification,
    "Loop": lambda: loop_of(plant(), tuned().gains),
    "LoopTrace": lambda: simulate_loop(plant(), tuned().gains, np.ones(100)),
    "PiCheck": lambda: ident.check_pi(plant(), 100.0, 1800.0, rise_time=1.0),
    "ParameterFile": pf,
    "LawSection": lambda: pf().laws["AW"],
    "DynamicsSection": lambda: pf().dynamics,
    "CheckReport": lambda: parameters.check(pf()),
    "FileFinding": lambda: parameters.check(pf()).findings[0],
    "Draws": lambda: Draws(post().names, post().draws),
    "Prediction": lambda: pf().laws["AW"].predict(V=150.0, f=0.4, d=2.0, t=10.0),
    "GivenFactor": lambda: pf().laws["AW"].predict(V=150.0, f=0.4, d=2.0, t=10.0).given[0],
    "EconomicSettings": lambda: controllers.economic_settings(
        published("AC-2017"), {"currency": "EUR", "machine": 60.0, "edge": 8.0, "change": 1.5}
    ),
    "VisibleRegion": region,
    "Feasibility": chance,
    "WearFront": lambda: wear_front(region(), [0.0, 0.05, 0.1]),
    "Corner": lambda: region().corners[0],
    "OperatingPoint": lambda: region().best,
    "Life": lambda: controllers.whole_life(life_laws()),
    "LifeLaws": life_laws,
    "LifeDraws": life_draws,
    "Rules": Rules,
    "FixedLife": lambda: best_fixed(life_laws()),
    "Choice": lambda: best_exact(life_laws(), Rules(), 0.0, 0.0),
    "ToolRun": tool_run,
    "Trace": lambda: tool_run().trace,
    "Event": lambda: tool_run().trace.events[0],
    "CutModel": lambda: CutModel.from_parameters(published("CLM-2023")),
    "SteadyLife": lambda: steady_life(CutModel.from_parameters(published("CLM-2023")), published("CLM-2023").load_line),
    "TurningRun": turned,
    "StepSize": lambda: step_study(published("LYAP"), steps=(0.01,), duration=0.2)[0],
    "Batch": shop,
    "Analysis": analysis,
    "PairAnalysis": lambda: analysis().pairs[0],
    "FitOptions": lambda: pipeline.FitOptions(criterion=0.2),
}

# What has no picture, and why
SENTENCE = "a sentence"
POINT = "one point: the region, life or map that it is taken from draws it"
GIVEN = "what is asked for, not what is found"
PICTURELESS = {
    **dict.fromkeys(("ColumnUse", "Source", "FileKind", "By", "Dropped", "LeftOut", "Refused", "Event"), SENTENCE),
    **dict.fromkeys(("NotAvailable", "NoContinuousForm", "CheckReport", "FileFinding", "GivenFactor"), SENTENCE),
    **dict.fromkeys(("Corner", "OperatingPoint", "Choice", "FixedLife", "StepSize"), POINT),
    **dict.fromkeys(("SimulatedLaw", "Specification", "LifeLaws", "Rules", "CutModel"), GIVEN),
    **dict.fromkeys(("FitOptions",), GIVEN),
    **dict.fromkeys(("KienzleLaw", "WearCurveLives"), "its law has figures"),
    **dict.fromkeys(("EndMillForce",), "numbers of one setting"),
}
# What read_table gives: Runs and Record, which are made of it, have the manners
BEFORE = {"Table"}


@cache
def made(name):
    return RESULTS[name]()


@pytest.mark.slow
def test_the_lists_name_what_there_is():
    assert set(PICTURELESS) <= set(RESULTS)
    for name in RESULTS:
        assert type(made(name)).__name__ == name.split(" of ")[0]
        assert hasattr(made(name), "to_frame") == (name in FRAMED), name


# --- what is public


def named_in(hint):
    """Classes of the package in a type: in unions, tuples and options too."""
    if inspect.isclass(hint) and hint.__module__.startswith("fitmodels"):
        yield hint
    for part in typing.get_args(hint):
        yield from named_in(part)


def public():
    """Classes that rooms export, and those that their public functions return."""
    for folder in ROOMS:
        for name in folder.__all__:
            thing = getattr(folder, name)
            if inspect.isclass(thing):
                yield thing
            elif callable(thing):
                yield from named_in(inspect.signature(thing, eval_str=False).return_annotation)


CLASSES = sorted(
    {
        of for of in public()
        if not issubclass(of, Exception) and not getattr(of, "_is_protocol", False) and of.__name__ not in BEFORE
    },
    key=lambda of: (of.__module__, of.__name__),
)  # fmt: skip


TABLES = {
    "ResponseBand", "StepBand", "LoopTrace", "Prediction", "WearFront", "SteadyLife",  # of methods
    *(of.__name__ for of in CLASSES if hasattr(of, "to_frame")),
}  # fmt: skip
FRAMED = [name for name in RESULTS if name.split(" of ")[0] in TABLES]


@pytest.mark.parametrize("of", CLASSES, ids=lambda of: of.__name__)
def test_every_public_class_says_what_it_is(of):
    assert issubclass(of, Displayable), f"{of.__name__} inherits Displayable, and its decorator says repr=False"
    assert of.__repr__ is HasRepr.__repr__, f"@dataclass(..., repr=False) on {of.__name__}, or repr dumps every field"


@pytest.mark.parametrize("of", CLASSES, ids=lambda of: of.__name__)
def test_every_public_result_is_tried_below_and_draws_itself(of):
    section = of.__module__.startswith("fitmodels.parameters.sections")
    machine = dataclasses.is_dataclass(of) and not of.__dataclass_params__.frozen  # controllers and plants
    if machine or (section and not hasattr(of, "plot")):
        return  # a trace draws the one, the file the other
    assert of.__name__ in RESULTS, f"make one in RESULTS of {Path(__file__).name}"
    assert hasattr(of, "plot") != (of.__name__ in PICTURELESS), f"{of.__name__}.plot(ax=None), or why it has none"


# --- manners


class Checked(HTMLParser):
    """Closed tags of a few kinds, with a style at most, and no colour."""

    def __init__(self):
        super().__init__()
        self.open, self.text = [], ""

    def handle_starttag(self, tag, attrs):
        assert tag in {"div", "p", "strong", "table", "tr", "th", "td"}
        assert {name for name, _ in attrs} <= {"style"}
        style = dict(attrs).get("style", "")
        for mark in MARKS.values():  # legible on light and dark pages (test_card_content.py)
            style = style.replace(f"; color: {mark.tone}", "")
        assert not re.search(r"color|background: (?!none)|#[0-9a-f]", style)
        self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data


@pytest.fixture(params=RESULTS)
def result(request):
    return made(request.param)


def test_the_repr_is_a_line_and_dumps_no_array(result):
    said = repr(result)
    assert said.startswith(f"{type(result).__name__}: ")
    assert len(said.splitlines()) <= 4
    assert max(map(len, said.splitlines())) <= 110
    assert not re.search(r"array\(|dtype|\bnan\b|object at 0x|[0-9a-f]{40}|nothing to tell", said)
    assert said == repr(result)


def test_a_notebook_gets_a_plain_table(result):
    page = Checked()
    page.feed(result._repr_html_())
    assert page.open == []
    assert 10 < len(page.text) < 12_000
    assert not re.search(r"array\(|\bnan\b|[0-9a-f]{40}", page.text)


def test_the_summary_is_text_and_begins_with_what_it_is(result):
    said = result.summary()
    assert isinstance(said, str)
    assert len(said.splitlines()) < 120
    assert not re.search(r"<[A-Za-z/_]", said)  # no repr of an object, no tag; limits such as <= 1 s may stand there
    assert "array(" not in said


@pytest.mark.parametrize("name", [name for name in RESULTS if name not in PICTURELESS])
def test_a_picture_is_axes_that_a_notebook_shows_and_nothing_else(name):
    result = made(name)
    own = result.plot()
    assert isinstance(np.ravel(own)[0], Axes)
    assert hasattr(own, "_repr_png_")
    parameter = inspect.signature(result.plot).parameters["ax"]
    assert parameter.default is None
    if name not in ("Posterior", "Analysis", "PairAnalysis"):  # several panels
        given = Figure().subplots()
        assert result.plot(given) is given
        assert given.has_data()


@pytest.mark.parametrize("name", FRAMED)
def test_a_frame_has_rows_and_named_columns(name):
    frame = made(name).to_frame()
    assert isinstance(frame, pd.DataFrame)
    assert len(frame) > 0
    assert all(isinstance(column, str) and column for column in frame.columns)


def test_frames_hold_the_numbers_of_their_results():
    np.testing.assert_array_equal(runs().to_frame()["AW"], runs().values("AW"))
    assert runs().to_frame().attrs["units"]["V"] == "m/min"
    frame = record().to_frame()
    np.testing.assert_array_equal(frame["u"], record().u)
    np.testing.assert_allclose(frame.index, 0.02 * np.arange(len(record())), rtol=1e-12)
    table = law().table(0.9)
    np.testing.assert_array_equal(table[["low", "high"]], law().conf_int(0.9))
    np.testing.assert_array_equal(table["estimate"], law().params)
    trace = tool_run().trace.to_frame()
    np.testing.assert_array_equal(trace["wear"], tool_run().trace.recorded["wear"])
    stretches = dataclasses.replace(record(), starts=(0, 100), offsets=None).to_frame()["stretch"]
    assert stretches.tolist() == [0] * 100 + [1] * (len(record()) - 100)


# --- what everything stands on


@pytest.mark.parametrize(
    ("name", "said"),
    [
        (
            "LawFit",
            "AW [mm] = 0.0086 V^0.533 f^0.167 d^0.316 t^0.2465, R2 0.893, residual SE 0.0958 ln, 239 rows of 24",
        ),
        ("Runs", "GC435 on 709M40 (En 19), simulated: 239 rows of 24 edges; V 50 to 200 m/min, f 0.06 to 0.6 mm/rev"),
        ("Model", "given of u to y, na 2, nb 2, nk 1 at 0.02 s, gain 1.5 A/V, poles 0.75 ± 0.1936j"),
        ("Record", "600 samples, 12 s at 50 Hz; u -2.5 to 2.5 V"),
        ("ParameterFile", "GC435 on 709M40, simulated: laws AW, P; posterior; dynamics; pi; limits"),
        ("VisibleRegion", "6 corners at d 2.5 mm, t 10 min; best V 147.9 m/min, f 0.5302 mm/rev: MRR 196028 mm3/min"),
    ],
)
def test_main_numbers_come_with_their_units(name, said):
    assert said in repr(made(name)).replace("\n", " ")


def test_text_of_files_is_escaped():
    nasty = dataclasses.replace(record(), output='<script>alert("y")</script>', notes=("a < b & c",))
    page = nasty._repr_html_()
    assert "<script" not in page
    assert "&lt;script&gt;" in page
    assert "a &lt; b &amp; c" in page


@dataclasses.dataclass(frozen=True, slots=True, repr=False)
class Odd(Displayable):
    many: np.ndarray
    text: str = "x" * 64
    nothing: None = None
    _hidden: int = 3
    of: tuple = (1.0, "two", {"V": 0.57712})


@pytest.mark.parametrize(
    ("many", "said"),
    [
        (np.arange(100.0), "many 100 values, 0 to 99"),
        (np.zeros((3, 4)), "many 3 by 4 values"),
        (np.array([]), "Odd: text xxx"),
        (np.array(2.5), "many 2.5"),
        (np.array([1 + 2j] * 20), "many 20 values"),
        (np.array(["a"] * 20, dtype=object), "many 20 items"),
    ],
    ids=["long", "a matrix", "empty", "one number", "complex", "texts"],
)
def test_fields_of_any_kind_are_reported_in_a_few_words(many, said):
    assert said in repr(Odd(many))
    assert "hidden" not in repr(Odd(many))
    assert "nothing" not in repr(Odd(many))
    assert "of 1; two; V 0.5771" in repr(Odd(many)).replace("\n", " ")


def test_a_long_hash_is_shortened_and_a_long_sentence_broken():
    assert format_value("ab12" * 16) == "ab12ab12ab12..."
    assert len(repr(Odd(np.zeros(2), text="word " * 300)).splitlines()) <= 4


@pytest.mark.parametrize(
    ("value", "error", "said"),
    [(0.577123, 0.0213, "0.577 ± 0.021 mm"), (2.0, None, "2 mm"), (1.0, np.nan, "1 mm"), (0.0, 0.5, "0.00 ± 0.50 mm")],
    ids=["rounded by its error", "without one", "of an unknown one", "zero"],
)
def test_a_value_is_reported_as_its_uncertainty_deserves(value, error, said):
    assert with_error(value, error, "mm") == said


def test_a_grid_is_the_same_in_text_and_on_a_page():
    grid = estimates(["V", "f"], [0.577123, 0.33], [0.0213, None], [0.53, np.nan], [0.62, np.inf], units=["", "1/mm"])
    assert grid.rows == (("V", "0.577", "0.021", "0.530", "0.620", ""), ("f", "0.33", "", "", "", "1/mm"))
    page = Checked()
    page.feed(grid.html())
    assert page.text == "".join((*grid.header, *(cell for row in grid.rows for cell in row)))
    assert grid.text().splitlines()[1].split() == ["V", "0.577", "0.021", "0.530", "0.620"]
    assert TextTable(("", ""), (("a", "b"),)).text() == "a  b"  # no empty head


def test_a_telling_may_be_a_head_alone():
    class Bare(Displayable):
        def _display(self):
            return Display("nothing more")

    assert repr(Bare()) == "Bare: nothing more"
    assert Bare().summary() == "Bare: nothing more"
    assert Bare()._repr_html_() == "<div><p><strong>Bare</strong>: nothing more</p></div>"


@pytest.mark.slow
def test_pyplot_is_used_where_figures_are_handed_to_it_and_nowhere_else():
    """Figures of pyplot stay open and ask for a screen: the command and the card draw without it."""
    home = Path(fitmodels.__file__).parent
    users = set()
    for path in home.rglob("*.py"):
        if {"tests", "docs", "notebooks", "benchmarks"} & set(path.relative_to(home).parts):
            continue
        text = path.read_text("utf-8")
        for node in ast.walk(ast.parse(text)) if "pyplot" in text else ():
            names = [a.name for a in node.names] if isinstance(node, ast.Import | ast.ImportFrom) else []
            if {"pyplot", "matplotlib.pyplot"} & {*names, getattr(node, "module", None)}:
                users.add(path.name)
            assert not (isinstance(node, ast.Attribute) and node.attr == "pyplot"), path
    assert users == {"plotting.py"}


@pytest.mark.slow
def test_a_notebook_shows_results_and_pictures():
    """As IPython asks: results as HTML, axes, sheets of axes and figures made without pyplot as PNG."""
    formatters = pytest.importorskip("IPython.core.formatters")
    shown = formatters.DisplayFormatter()
    assert {"text/plain", "text/html"} <= set(shown.format(law())[0])
    for picture in (law().plot(), law().plot().figure, post().plot("pairs"), record().plot()):
        data, about = shown.format(picture)
        assert data["image/png"][:8] == b"\x89PNG\r\n\x1a\n"
        inches = np.ravel(picture)[0].get_figure().get_size_inches() if not isinstance(picture, Figure) else None
        width = about["image/png"]["width"]
        assert width == (round(100 * inches[0]) if inches is not None else 540)


@pytest.mark.parametrize(
    ("patience", "lines"), [(0.0, ["drawing: 10 steps, 5 effective", "drawing: 20 steps, 9 effective"]), (60.0, [])],
    ids=["at once", "only of long runs"],
)  # fmt: skip
def test_a_long_run_renews_one_line_in_a_notebook(monkeypatch, patience, lines):
    ipython = pytest.importorskip("IPython")
    display = pytest.importorskip("IPython.display")
    shown = []

    class Handle:
        def update(self, line):
            shown.append(repr(line))

    def first(line, display_id):
        shown.append(repr(line))
        return Handle()

    monkeypatch.setattr(ipython, "get_ipython", lambda: type("Shell", (), {"kernel": None})())
    monkeypatch.setattr(display, "display", first)
    progress = watch(patience=patience)
    progress(10, 5.2)
    progress(20, 9.4)
    assert [line.split(" draws")[0] for line in shown] == lines


@pytest.mark.parametrize("terminal", [True, False], ids=["at a terminal", "into a pipe"])
def test_a_long_run_renews_one_line(monkeypatch, capsys, terminal):
    monkeypatch.setattr("sys.stderr.isatty", lambda: terminal)
    watch("sampling", patience=0.0)(10, 5.2)
    written = capsys.readouterr()
    assert written.out == ""
    assert ("sampling: 10 steps, 5 effective draws, 0 s" in written.err) == terminal


# --- kinds of figure


def surface():
    return fit.response_surface(runs(), "AW", ["V", "f", "d"])


@pytest.mark.parametrize("of", [law, surface, post], ids=["law", "surface", "posterior"])
def test_each_kind_of_figure_is_drawn_and_named_in_the_docstring(of):
    from fitmodels.core.display import draw_figure, figures_of

    result = of()
    draw_figure(result)  # registers the kinds
    kinds = figures_of(result)
    named = inspect.getdoc(type(result).plot)
    for kind in kinds:
        assert f"``{kind}``" in named or f'"{kind}"' in named
        axes = np.ravel(draw_figure(result, kind))
        assert len({ax.figure for ax in axes}) == 1
        assert all(ax.has_data() for ax in axes)


@pytest.mark.parametrize(
    ("draw", "words"),
    [
        (lambda: law().plot("contour"), "no figure of kind 'contour'. Did you mean 'contours'?"),
        (lambda: law().edges.plot("contours"), "It has one figure: omit the kind"),
        (lambda: law().plot("contours", colour="r"), "no option 'colour' of the figure 'contours'. Its options are"),
        (lambda: law().plot(ax="here"), "it is no Axes of matplotlib"),
        (lambda: law().plot("profile", Figure().subplots()), "has 4 panels, and ax is one"),
        (lambda: law().plot("profile", factor="v"), "'v' is no factor of AW. Did you mean 'V'?"),
        (lambda: law().plot("profile", at={"V": -1.0}), "V -1.0 is no value of this factor; tested 50 to 200 m/min"),
        (lambda: law().plot("interactions", over="V"), "name two factors of AW"),
        (lambda: fit.power_law(runs(), "AW", ["V"]).plot("interactions"), "a law of one factor has no interactions"),
    ],
)  # fmt: skip
def test_a_figure_that_there_is_not_is_refused_with_what_there_is(draw, words):
    with pytest.raises(fitmodels.FitmodelsError, match=re.escape(words)):
        draw()


def test_a_profile_shows_what_the_law_predicts_and_dashes_what_was_not_tested():
    ax = law().plot("profile", factor="V", at={"t": 2.0, "f": 0.1})
    inside, outside = (np.array(line.get_data()) for line in ax.lines[1:3])
    at = {"V": outside[0], "f": np.full(81, 0.1), "d": np.full(81, np.sqrt(1.5 * 3.0)), "t": np.full(81, 2.0)}
    np.testing.assert_allclose(outside[1], law().values(at))
    np.testing.assert_array_equal(np.isfinite(inside[1]), law().region.inside(at))
    assert 0 < np.isfinite(inside[1]).sum() < 81
    assert "simulated" in law().plot("profile").ravel()[0].figure.get_suptitle()


def test_an_analysis_draws_all_its_laws_or_the_one_that_is_named():
    analysis = fitmodels.analyse(runs(), draws=1000)
    assert [ax.get_ylabel().split()[0] for ax in analysis.plot("profile")].count("Fxz") == 5
    assert len(analysis.plot("residuals")) == 3
    assert analysis.plot("contours", law="P").get_title().startswith("P [kW]")
    for kind, words in (("interactions", "name one, for instance law='AW'"), ("observd", "Did you mean 'observed'")):
        with pytest.raises(fitmodels.FitmodelsError, match=words):
            analysis.plot(kind)


CELLS = {  # a cell, and the figures that it shows in their order: kinds, or the width in pixels
    "last line": ("of().plot()", ["observed"]),
    "several": ("of().plot(); of().plot('influence'); None", ["observed", "influence"]),
    "order": ("of().plot('profile'); of().plot()", ["profile", "observed"]),
    "named, last line": ("ax = of().plot(); ax", ["observed"]),
    "again": ("ax", ["observed"]),
    "display": ("display(of().plot()); 1", ["observed"]),
    "axes of pyplot": (
        "import matplotlib.pyplot as plt; _, on = plt.subplots(figsize=(6, 5)); of().plot(ax=on); 1",
        [600],
    ),
    "shown": ("import matplotlib.pyplot as plt; of().plot(); plt.show()", ["observed"]),
    "closed": ("import matplotlib.pyplot as plt; of().plot(); plt.close(); plt.get_fignums()", []),
    "drawn only": ("from fitmodels.core.display import draw_figure; kept = draw_figure(of()); plt.get_fignums()", []),
}


@pytest.mark.slow
def test_a_notebook_shows_each_figure_once_and_keeps_none_open(tmp_path):
    """In a real kernel, whose inline backend shows the open figures of pyplot at the end of a cell."""
    nbclient = pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    from nbformat.v4 import new_code_cell, new_notebook

    first = (
        "from fitmodels import datasets, fit\n"
        "law = fit.power_law(datasets.read_runs(datasets.bundled('gc435_709m40')), 'AW', ['V', 'f', 'd', 't'])\n"
        "of = lambda: law"
    )
    cells = [first, *(source for source, _ in CELLS.values()), "plt.get_fignums()"]
    wanted = {
        name: pytest.approx([_laid_out(kind) if isinstance(kind, str) else kind for kind in kinds], rel=0.12)
        for name, (_, kinds) in CELLS.items()
    }  # cut at the ink by IPython
    notebook = new_notebook(cells=[new_code_cell(source) for source in cells])
    client = nbclient.NotebookClient(notebook, timeout=120, resources={"metadata": {"path": str(tmp_path)}})
    # a command that ran in this process has chosen a backend without a screen for all that it starts
    client.execute(env={name: value for name, value in os.environ.items() if name != "MPLBACKEND"})
    found = {
        name: [_width(out) for out in cell.outputs if "image/png" in out.get("data", {})]
        for name, cell in zip(CELLS, notebook.cells[1:-1], strict=True)
    }
    assert found == wanted
    assert notebook.cells[-1].outputs[0].data["text/plain"] == "[]"


def _laid_out(kind):
    """Width of a figure of the law, in pixels."""
    from fitmodels.core.display import draw_figure

    return 100 * np.ravel(draw_figure(law(), kind))[0].figure.get_figwidth()


def _width(out):
    """Width of a picture as laid out, in pixels."""
    import base64

    drawn = int.from_bytes(base64.b64decode(out.data["image/png"])[16:20])
    return drawn // 2 if "width" in out.metadata.get("image/png", {}) else drawn
