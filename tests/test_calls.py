"""The Python interface as it is called: sources of tests, wrong arguments, completion."""

import inspect
import pickle
import warnings
from types import SimpleNamespace

import fitmodels
import pandas as pd
import pytest
from fitmodels import controllers, datasets, fit, ident, parameters
from fitmodels.core.calls import checked
from fitmodels.core.errors import FitmodelsError, ReadingWarning

FACTORS = ["V", "f", "d", "t"]
AT = {"V": 100.0, "f": 0.2, "d": 2.0, "t": 8.0}
PATH = datasets.bundled("gc435_709m40")


@pytest.fixture(scope="module")
def names():
    """What the calls of `WRONG` use."""
    runs = datasets.read_runs(PATH)
    law = fit.power_law(runs, "AW", FACTORS)
    chips = pd.DataFrame(
        {"d [mm]": [1, 2, 2.5, 1], "f [mm/rev]": [0.1, 0.2, 0.3, 0.4], "Fc [N]": [300.0, 900, 1700, 900]}
    )
    return {
        "runs": runs, "df": runs.to_frame(), "law": law, "life": fit.tool_life(law), "at": AT, "PATH": PATH,
        "post": fit.posterior(law, draws=1000), "kienzle": fit.kienzle_law(chips), "fit": fit,
        "pf": parameters.collect(tool="A", work="B", laws=[law], simulated=True), "datasets": datasets,
        "surface": fit.response_surface(runs, "AW", ["V", "f"]), "parameters": parameters, "ident": ident,
        "controllers": controllers, "fitmodels": fitmodels, "analysis": fitmodels.analyse(runs, draws=1000),
        "pd": pd, "float": float,
    }  # fmt: skip


# A wrong call, and a part of the sentence that it ends in.
WRONG = {
    "fit.posterior(runs)": "law is Runs; give a LawFit",
    "fit.posterior(df)": "law is a DataFrame; give a LawFit",
    "fit.posterior(law, draws=1000.5)": "draws=1000.5: give a whole number",
    "fit.posterior(law, draws='many')": "draws='many': give a whole number",
    "fit.posterior(law, drawz=5)": "there is no argument 'drawz'. Did you mean 'draws'?",
    "fit.posterior(law, seed=-1)": "seed -1: it must be between 0",
    "fit.posterior(law, priors=3)": "priors=3: give a text",
    "fit.posterior(law, errors='studnt')": "Did you mean 'student'?",
    "fit.power_law(runs, 'AW', 'V, f')": "is one text; give a list of texts, for instance ['V', 'f']",
    "fit.power_law(runs, 'AW', 'V')": "give a list of texts, for instance ['V']",
    "fit.power_law(runs, 'AW', None)": "factors=None: give a list of texts",
    "fit.power_law(runs, 'AW', ['V', 3])": "factors is a list of str, int; give a list of texts",
    "fit.power_law(runs, 'AW', ['V', 'V'])": "a factor is named twice",
    "fit.power_law(runs, ['AW'], ['V'])": "response is a list of str; give a text",
    "fit.power_law(runs, 'AW')": "factors is missing; give a list of texts",
    "fit.power_law(runs, 'AW', ['V'], 'additive')": "at most 3 arguments without a name",
    "fit.power_law(runs, 'AW', ['V'], response='AW')": "response is given twice",
    "fit.power_law(runs, 'AW', ['V'], eror='additive')": "Did you mean 'error'?",
    "fit.power_law(runs, 'AW', ['V'], error='additve')": "Did you mean 'additive'?",
    "fit.power_law(runs, 'AW', ['V'], edge='egde')": "no column 'egde'",
    "fit.power_law(law, 'AW', ['V'])": "runs is a LawFit; give a path",
    "fit.power_law({'V': [1.0]}, 'AW', ['V'])": "runs is a dict; give a path",
    "fit.power_law(df['V'], 'AW', ['V'])": "runs is a Series",
    "fit.power_law(df.iloc[:0], 'AW', ['V'])": "DataFrame has no rows",
    "fit.power_law('nowhere.csv', 'AW', ['V'])": "nowhere.csv does not exist",
    "fit.fit_law(runs, ['AW ~ V'])": "law is a list of str; give a text",
    "fit.judge(runs)": "give a LawFit",
    "fit.judge(post)": "This Posterior has one as .law",
    "fit.judge(law, runs=law)": "runs is a LawFit",
    "fit.judge(law, runs=df)": "give as runs what the law was fitted to",
    "fit.judge(law, gauge_sd=-0.01)": "a standard deviation is above zero",
    "fit.judge(law, gauge_sd='0.01')": "gauge_sd='0.01': give a number, or None",
    "fit.tool_life(runs)": "give a LawFit",
    "fit.tool_life(law, '0.3')": "criterion='0.3': give a number",
    "fit.tool_life(law, -0.3)": "needs a value above zero",
    "fit.confirm(runs, law)": "law is Runs; give a LawFit",
    "fit.confirm(law, runs, 95)": "for 95 % give 0.95",
    "fit.composite(law, runs)": "wear_law is Runs; give a LawFit",
    "fit.compare_laws(runs)": "law is missing; give a LawFit or a text",
    "fit.next_runs(law, 'three')": "n='three': give a whole number",
    "fit.next_runs(law, 0)": "whole number from 1",
    "fit.interval(runs, at)": "an interval of a Runs",
    "fit.edge_bootstrap(law, draws=100)": "there is no argument 'draws'. It has law, repetitions, seed.",
    "fit.response_surface(runs, 'AW', 'V')": "is one text; give a list of texts",
    "law.conf_int(95)": "level 95 of an interval: it must be between 0 and 1; for 95 % give 0.95",
    "law.conf_int('95 %')": "level '95 %' of an interval",
    "law.table(95)": "for 95 % give 0.95",
    "kienzle.conf_int(95)": "for 95 % give 0.95",
    "kienzle.specific_force('0.1')": "chip thickness 0.1 mm: it must be above zero",
    "surface.anova(4)": "a test is of type 2 or 3",
    "post.table(95)": "for 95 % give 0.95",
    "post.exceeds(at, '0.3')": "limit='0.3': give a number",
    "law.predict(V=100)": "AW needs f, d, t; given: V",
    "law.predict({'speed': 100, 'f': 0.2})": "needs V, d, t, by symbol; given: speed, f",
    "law.predict([100, 0.2, 2, 8])": "conditions as list; give a mapping",
    "law.predict({**at, 'V': 'fast'})": "V = 'fast' is not a number; give it in m/min",
    "law.predict({**at, 'V': float('nan')})": "V = nan: give a finite number",
    "law.predict({**at, 'V': -100})": "V -100: a power law needs values above zero",
    "law.predict({**at, 'V': [1, 2], 'f': [0.1, 0.2, 0.3]})": "each factor is one value or a column of",
    "law.predict(at, V=100)": "V is given twice",
    "law.predict(at, lvl=0.9)": "has no factor 'lvl'; its factors are V, f, d, t. Did you mean 'level'?",
    "law.predict(at, interval='prediction')": "Did you mean 'kind'?",
    "law.predict(at, 'predicton')": "kind='predicton': it is one of",
    "law.predict(at, level=95)": "for 95 % give 0.95",
    "law.predict(at, by='2')": "has no levels; leave '2' out",
    "post.predict(at, level=95)": "for 95 % give 0.95",
    "post.predict(at, 'tolerance')": "draws give no tolerance limits",
    "life.predict(V=100)": "tool life needs f, d; give f=...",
    "life.predict(V=100, f=0.2, d='2')": "d = '2' is not a number; give it in mm",
    "life.predict(V=100, f=0.2, d=2, level=95)": "for 95 % give 0.95",
    "life.interval('edg', V=100, f=0.2, d=2)": "of='edg': an interval of the 'law' or of one new 'edge'",
    "life.interval(V=100)": "tool life needs f, d",
    "pf.laws['AW'].predict(V=100)": "needs f (feed, mm/rev); give f=...",
    "pf.laws['AW'].predict(at, level=95)": "for 95 % give 0.95",
    "pf.laws['AW'].predict(at, lvl=0.9)": "Did you mean 'level'?",
    "analysis.laws['VC']": "there is no result of 'VC'. There are results of AW, Fxz, P.",
    "fit.edge_bootstrap(law, 100).interval(95)": "for 95 % give 0.95",
    "fit.compare_laws(runs, law, forms=['powr'])": "Did you mean 'power'?",
    "fit.posterior(law, priors={'V': {'distribution': 'normal', 'mean': 0.5, 'sd': 0.2}})": "priors are by response",
    "parameters.collect(laws=[law], limits={'pwer': 7.0})": "there is no limit 'pwer'. Did you mean 'power'?",
    "controllers.visible_region(pf, limits=7)": "limits=7: give a LimitsSection or a mapping",
    "runs.values('speed')": "no column 'speed'; there are",
    "runs.join(law)": "tests as LawFit: give the path of a file, a DataFrame or Runs",
    "datasets.read_runs(42)": "path=42: give a path",
    "datasets.read_runs(PATH, units={'V': 'parsec'})": "unit 'parsec' is not in the table of units",
    "datasets.read_runs(PATH, mapp={})": "Did you mean 'map'?",
    "datasets.runs_from_frame(runs)": "frame is Runs; give a DataFrame",
    "datasets.plan_tests(law)": "ranges is a LawFit; give a mapping",
    "parameters.collect(laws=law)": "laws is a LawFit; give a list of LawFits",
    "parameters.read(pf)": "path is a ParameterFile; give a path",
    "parameters.check(law)": "pf is a LawFit; give a ParameterFile",
    "ident.identify('run.csv')": "rec='run.csv': give a Record",
    "ident.tune_pi(law)": "model is a LawFit; give",
    "controllers.best_point(law)": "pf is a LawFit; give a ParameterFile",
    "fit.linear('a', 'b')": "X or y holds something else than numbers",
    "fitmodels.analyse(df.iloc[:0])": "the DataFrame has no rows",
    "fitmodels.analyse(law)": "LawFit",
    "fitmodels.analyse(runs, draws=10)": "draws 10: give a whole number from 1000",
    "fitmodels.analyse(runs, eror='additive')": "Did you mean 'error'?",
    "fitmodels.analyse(runs, options={'draws': 2000})": "options is a dict; give a FitOptions, or None",
}


@pytest.mark.parametrize("call", WRONG)
def test_a_wrong_call_ends_in_a_sentence_with_a_remedy(call, names):
    with pytest.raises(FitmodelsError) as caught:
        eval(call, names)  # noqa: S307  the calls above
    assert WRONG[call] in str(caught.value)
    assert str(caught.value).endswith((".", "?"))


def test_a_name_that_a_package_does_not_have_gets_a_hint():
    with pytest.raises(AttributeError, match="Did you mean 'power_law'"):
        fit.powerlaw  # noqa: B018


@pytest.mark.parametrize("numbers", [pd.Series([1])[0], 1, True])
def test_numbers_of_numpy_are_numbers_and_truths_are_not(numbers):
    @checked
    def doubled(length: float, times: int = 2) -> float:
        return length * times

    if numbers is True:
        with pytest.raises(FitmodelsError, match="length=True: give a number"):
            doubled(numbers)
    else:
        assert doubled(numbers, times=numbers) == 1


def test_a_frame_a_path_and_runs_give_the_same_law(names):
    laws = [fit.power_law(source, "AW", FACTORS) for source in (names["runs"], names["df"], PATH, str(PATH))]
    assert {tuple(law.params) for law in laws} == {tuple(names["law"].params)}
    assert all(law.source.simulated and law.source.tool == "GC435" for law in laws)
    assert fit.fit_law(names["df"], "AW ~ V, f, d, t").nobs == names["law"].nobs
    assert fit.judge(laws[1], runs=names["df"]).verdict == fit.judge(names["law"], runs=names["runs"]).verdict
    assert len(fit.default_laws(names["df"])[0]) == 3
    assert len(names["runs"].join(names["df"])) == 2 * len(names["runs"])


def test_assumed_units_and_doubts_of_a_frame_are_warnings():
    frame = pd.DataFrame({"Vc": [100.0, 150, 200, 250], "VB": [110.0, 150, 190, 230]})
    with pytest.warns(ReadingWarning) as seen:
        law = fit.power_law(frame, "VB", ["V"])
    texts = [str(one.message) for one in seen]
    assert any("units that its columns do not name: V m/min" in text and '"V [m/min]"' in text for text in texts)
    assert any("taken as um" in text and "units={'VB': 'um'}" in text for text in texts)
    assert {one.filename for one in seen} == {__file__}  # at the line of the caller
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        frame.attrs["units"] = {"Vc": "m/min", "VB": "um"}
        named = fit.power_law(frame, "VB", ["V"])
    assert named.params.equals(law.params)


def test_predictions_have_one_signature_and_one_kind_of_result(names):
    """Law, file, posterior, life, surface and Kienzle's law, by mapping, by name and as a DataFrame."""
    holders = [names["law"], names["pf"].laws["AW"], names["post"], names["life"], names["surface"]]
    signatures = {str(inspect.signature(type(one).predict)) for one in (*holders, names["kienzle"])}
    assert len(signatures) == 1
    for one in holders:
        at = {name: AT[name] for name in one._takes.units}
        found = one.predict(at, "mean", level=0.9)
        assert (found.low < found.value < found.high, found.level, found.kind) == (True, 0.9, "mean")
        assert found.value == pytest.approx(one.values(**at), rel=1e-9)
        assert str(round(100 * found.level)) in found.words
        several = one.predict(pd.DataFrame({**at, "V": [100.0, 400.0]}), "mean", level=0.9)
        assert (several.value[0], several.low[0]) == pytest.approx((found.value, found.low), rel=1e-9)
        assert not several.inside[1]
        assert several.to_frame().columns.tolist() == ["value", "low", "high", "inside"]
        assert "400" in several._repr_html_()
        assert "outside the tested region" in several.summary()
    chips = names["kienzle"].predict(d=2, f=0.2)
    assert chips.value == pytest.approx(names["kienzle"].law.values(d=2, f=0.2))


def test_columns_named_by_their_headers_give_a_law_in_symbols_and_units():
    V, f = [1.0, 2.0, 3.0, 1.0, 2.0, 3.0, 2.0], [0.1, 0.1, 0.1, 0.2, 0.2, 0.2, 0.15]
    wear = [0.1 * v**0.5 * x**0.3 for v, x in zip(V, f, strict=True)]
    frame = pd.DataFrame({"cutting speed [m/s]": V, "feed [mm/rev]": f, "flank wear [mm]": wear})
    with pytest.raises(FitmodelsError, match="by symbol; given: cutting speed"):
        fit.power_law(frame, "VB", ["V", "f"]).predict(frame)
    law = fit.power_law(frame, "flank wear [mm]", ["cutting speed [m/s]", "feed"])
    assert (law.response, law.factors, law.units["V"]) == ("VB", ("V", "f"), "m/min")
    other = pd.DataFrame({"V": [2.0], "f": [0.2]})
    other.attrs["units"] = {"V": "m/s"}
    with pytest.raises(FitmodelsError, match="V is in m/s in the DataFrame; give it in m/min"):
        law.predict(other)
    assert law.values(V=120.0, f=0.2) == pytest.approx(0.1 * 2**0.5 * 0.2**0.3)


def test_a_simulated_frame_stays_simulated_after_a_selection(names):
    some = names["df"].query("V < 200")
    assert fitmodels.analyse(some, draws=1000).runs.simulated


@pytest.mark.parametrize(
    "package", ["batch", "cards", "controllers", "datasets", "fit", "ident", "parameters", "pipeline"]
)
def test_public_functions_keep_their_signature_and_can_be_pickled(package):
    module = getattr(fitmodels, package)
    for name in module.__all__:
        thing = getattr(module, name)
        if inspect.isfunction(thing):
            assert pickle.loads(pickle.dumps(thing)) is thing  # noqa: S301
            assert list(inspect.signature(thing).parameters) == list(
                inspect.signature(inspect.unwrap(thing)).parameters
            )


def completions(line, **held):
    """What IPython's completer, or jedi alone, offers at the end of a line."""
    completer = pytest.importorskip("jedi")
    return {one.name for one in completer.Interpreter(line, [held]).complete()}


def test_completion_lists_every_public_name(names):
    for package in ("fit", "datasets", "parameters", "ident", "controllers"):
        module = getattr(fitmodels, package)
        assert set(module.__all__) <= completions("module.", module=module)
    assert set(fitmodels.__all__) <= completions("fitmodels.", fitmodels=fitmodels)
    law = completions("law.", law=names["law"])
    assert {"params", "bse", "conf_int", "predict", "plot", "summary", "table", "to_statsmodels"} <= law
    assert {"predict", "interval", "budget", "inside"} <= completions("pf.laws['AW'].", pf=names["pf"])


def test_completion_offers_the_arguments_of_a_function():
    held = SimpleNamespace(fit=fit)
    assert {"error=", "edge=", "by="} <= completions("held.fit.power_law(runs, 'AW', ['V'], ", held=held)
