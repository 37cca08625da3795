"""Every form of law with every command: it works, or one message states why not; never a traceback.

The cases are the forms of `core.formula.FORMS`: a new form without a case here fails. Numbers predicted from the file
equal those of the fit, which computes them from its own arrays.
"""

import csv
import json

import numpy as np
import pytest
from fitmodels import parameters
from fitmodels.cards.replays import region as report_on_region
from fitmodels.cli import main
from fitmodels.controllers.region import probability
from fitmodels.core.formula import FORMS
from fitmodels.datasets import central_composite, read_runs, runs_from_frame, write_csv
from fitmodels.fit import default_laws
from fitmodels.fit.form_choice import CHOICES
from fitmodels.fit.regression import fit_form
from fitmodels.parameters.exports import VALUES

# forms that cannot be chosen for a power on V, f and d, with the reason
UNSUITED = {"taylor": "tool lives T", "weibull": "tool lives T", "load-line": "its factors are a feed and a wear"}
SAME = 1e-9  # of a prediction from the file: it goes through the shortest decimal, and sums in another order
FACTORS = {"AW": ("V", "f", "d", "t"), "P": ("V", "f", "d", "AW")}
LINES = {"load_line": ("I", ("fm", "VB")), "feed_line": ("fm", ("VB",))}
CUTTING = {"V": 110.0, "f": 0.2, "d": 1.7, "t": 5.0, "AW": 0.15}
MILLING = {"fm": 800.0, "VB": 0.1}
LIMITS = {"power": 5.0, "wear": 0.3, "speed": (60.0, 200.0), "feed": (0.1, 0.5)}


def cutting_tests():
    """24 edges of a central composite design at 5 times: wear and power, with errors of edges and rows."""
    rng = np.random.default_rng(3)
    plan = central_composite({"V": (60.0, 200.0), "f": (0.1, 0.5), "d": (1.0, 3.0)}, seed=3)
    rows = plan.loc[plan.index.repeat(5), ["edge", "V", "f", "d"]].reset_index(drop=True)
    t = np.tile([2.0, 4.0, 6.0, 8.0, 10.0], len(plan))
    off, e = rng.normal(size=(2, len(plan))).repeat(5, axis=1), rng.normal(size=(2, len(t)))
    u, v, w, s = np.log([rows["V"] / 110, rows["f"] / 0.22, rows["d"] / 1.7, t / 5])
    AW = 0.15 * np.exp(0.6 * u + 0.2 * v + 0.25 * w + 0.3 * s + 0.15 * u * u + 0.04 * off[0] + 0.03 * e[0])
    P = 3 * np.exp(0.9 * u + 0.65 * v + 0.85 * w + 0.8 * (AW - 0.15) + 0.02 * (off[1] + e[1]))
    return rows.assign(t=t, AW=AW, P=P)


def milling_tests():
    """Load and feed over wear: 6 tools at 5 feeds."""
    rng = np.random.default_rng(4)
    plan = central_composite({"fm": (600.0, 1000.0), "VB": (0.02, 0.2)}, seed=4)
    load = 0.1158 + 1.2416e-4 * plan["fm"] + 0.29 * plan["VB"] + 1e-3 * rng.normal(size=len(plan))
    return plan[["edge", "fm", "VB"]].assign(I=load)


def feed_tests():
    """Feed that holds the load, over wear."""
    rng = np.random.default_rng(5)
    VB = np.linspace(0.02, 0.2, 12)
    fm = 996.0 - 1970.0 * VB + 2.0 * rng.normal(size=12)
    return milling_tests().iloc[:0][["edge"]].reindex(range(12)).assign(edge="E1", VB=VB, fm=fm)


def laws_of(form):
    """The laws of one form, and the runs that they are fitted to."""
    if form in LINES:
        response, factors = LINES[form]
        runs = runs_from_frame(milling_tests() if form == "load_line" else feed_tests(), judge=False)
        return [fit_form(runs, form, response, factors, error="additive")], runs
    runs = runs_from_frame(cutting_tests(), judge=False)
    return [fit_form(runs, form, response, factors) for response, factors in FACTORS.items()], runs


@pytest.fixture(scope="module", params=FORMS)
def case(request, tmp_path_factory):
    """Form, laws, and folder with the parameter file."""
    form = request.param
    laws, runs = laws_of(form)
    limits = {"speed": (60.0, 200.0)} if form in LINES else LIMITS
    pf = parameters.collect(tool="T1", work="W1", laws=laws, design=runs, limits=limits, simulated=True)
    folder = tmp_path_factory.mktemp(form)
    parameters.write(pf, folder / "params.json")
    return form, laws, folder


def conditions(law):
    return {symbol: {**CUTTING, **MILLING}[symbol] for symbol in law.factors}


# --- the file


def test_the_file_is_read_back_as_it_was_written(case):
    form, laws, folder = case
    pf = parameters.read(folder / "params.json")
    again = parameters.write(pf, folder / "again.json")
    assert again.read_bytes() == (folder / "params.json").read_bytes()
    assert [law.form for law in pf.laws.values()] == [form] * len(laws)
    assert parameters.check(pf, folder).ok


@pytest.mark.parametrize("kind", ["mean", "prediction", "tolerance"])
def test_predictions_from_the_file_are_those_of_the_fit(case, kind):
    _, laws, folder = case
    pf = parameters.read(folder / "params.json")
    for law in laws:
        at = {name: value * np.array([0.9, 1.0, 1.1]) for name, value in conditions(law).items()}
        section, fitted = pf.laws[law.response], law.predict(at, kind).to_frame()
        low, high = section.interval(kind=kind, **at)
        np.testing.assert_allclose(section.values(**at), law.values(at), rtol=SAME)
        np.testing.assert_allclose(low, fitted["low"], rtol=SAME)
        np.testing.assert_allclose(high, fitted["high"], rtol=SAME)
        assert list(section.inside(**at)) == list(law.region.inside(at))


def test_exported_coefficients_alone_give_the_prediction(case):
    """The names and words of exported numbers suffice to evaluate the law, terms and centres included."""
    form, laws, folder = case
    assert main(["export", str(folder / "params.json"), "--to", "ini", "--out", str(folder / "v.ini"), "--force",
                 "--accept-verdict"]) == 0  # fmt: skip
    lines = (folder / "v.ini").read_text().partition("[values]")[2].partition("[units]")[0].splitlines()
    held = {name: float(value) for name, _, value in (line.partition(" = ") for line in lines if " = " in line)}
    for law in laws:
        own = f"law_{law.response.lower()}_"
        for symbol in law.factors:
            assert held[f"{own}{symbol.lower()}_low"] <= conditions(law)[symbol] <= held[f"{own}{symbol.lower()}_high"]
        value = evaluated(form, law, held, own)
        assert value == pytest.approx(float(law.values(conditions(law))), rel=1e-6)


def evaluated(form, law, held, own):
    """The law from exported numbers, by the published formula of its form."""
    x = conditions(law)
    b = {name: held[own + name.lower()] for name in x if own + name.lower() in held}
    if form == "power":
        return held[own + "c0"] * np.prod([x[s] ** b[s] for s in x])
    if form == "linear":
        return held[own + "c0"] + sum(b[s] * x[s] for s in x)
    if form == "exponential":
        return held[own + "a"] * np.exp(sum(b[s] * x[s] for s in x))
    if form == "power_exponential":
        *logged, last = x
        return held[own + "c0"] * np.prod([x[s] ** b[s] for s in logged]) * np.exp(b[last] * x[last])
    if form == "additive_wear":
        *logged, last = x
        return held[own + "c0"] * np.prod([x[s] ** b[s] for s in logged]) + b[last] * x[last]
    if form in LINES:
        first, *others = {"load_line": ("a", "b", "k1"), "feed_line": ("fm0", "slope")}[form]
        return held[own + first] + sum(held[own + c] * v for c, v in zip(others, x.values(), strict=True))
    centre = {s: held[f"{own}{s.lower()}_centre"] for s in x}
    u = {s: np.log(x[s] / centre[s]) if form == "second_order" else x[s] - centre[s] for s in x}
    eta = sum(held[own + a.lower()] * u[a] for a in x if own + a.lower() in held)
    pairs = [(a, b) for i, a in enumerate(x) for b in list(x)[i:]]
    for a, b in pairs:
        name = own + (f"{a}_squared" if a == b else f"{a}_times_{b}").lower()
        eta += held.get(name, 0.0) * u[a] * u[b]
    return held[own + "c0"] * np.exp(eta) if form == "second_order" else held[own + "c0"] + eta


# --- the commands: words of the message where a command refuses a form

REFUSED = {(form, "settings"): "load law" for form in FORMS if form not in LINES}
COMMANDS = {
    "check": ["check", "{file}"],
    "predict": ["predict", "{file}", "{at}"],
    "predict --json": ["predict", "{file}", "{at}", "--json", "--interval", "tolerance"],
    "card": ["card", "{file}", "--force"],
    "card --json": ["card", "{file}", "--json"],
    "simulate": ["simulate", "{file}", "--out", "{folder}/simulated.csv", "--force", "--t-max", "10"],
    "limits": ["limits", "{copy}", "{limit}", "--force"],
    "settings": ["settings", "{copy}", "--worn", "0.28", "--window", "0.15:0.2mm", "--force"],
    **{f"export {kind}": ["export", "{file}", "--to", kind, "--out", "{folder}/x", "--force", "--accept-verdict"]
       for kind in VALUES},
    "export hal": ["export", "{file}", "--to", "hal", "--out", "{folder}/x", "--force", "--accept-verdict"],
}  # fmt: skip


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_works_or_says_in_one_message_why_not(case, command, capsys, monkeypatch):
    form, laws, folder = case
    monkeypatch.delenv("FITMODELS_TRACEBACK", raising=False)
    copy = folder / "copy.json"
    copy.write_bytes((folder / "params.json").read_bytes())
    at = {name: value for law in laws for name, value in conditions(law).items()}
    put = {"{file}": [str(folder / "params.json")], "{copy}": [str(copy)], "{limit}": [f"{laws[-1].response}=4"],
           "{at}": [f"{name}={value}" for name, value in at.items()]}  # fmt: skip
    if form == "feed_line":
        put["{limit}"] = ["fm=100:2000"]
    words = [item for word in COMMANDS[command] for item in put.get(word, [word.replace("{folder}", str(folder))])]
    code, said = main(words), capsys.readouterr()
    refused = REFUSED.get((form, command)) or ("has no PI gains" if command == "export hal" else None)
    if refused is None:
        assert (code, said.err) == (0, "")
        return
    assert code in (2, 3, 4, 5), (said.out, said.err)
    assert refused in said.err
    assert "internal error" not in said.err
    assert len(said.err.strip().splitlines()) <= 2


@pytest.fixture(scope="module")
def halves(tmp_path_factory):
    """The cutting tests as two files, of 18 and of 6 edges."""
    folder, rows = tmp_path_factory.mktemp("halves"), cutting_tests()
    units = {"V": "m/min", "f": "mm/rev", "d": "mm", "t": "min", "AW": "mm", "P": "kW"}
    late = rows["edge"].isin(rows["edge"].unique()[-6:])
    for name, part in (("old", rows[~late]), ("new", rows[late])):
        write_csv(part, folder / f"{name}.csv", ["tool: T1", "work: W1", "simulated"], units=units)
    return folder


@pytest.mark.parametrize("form", CHOICES)
def test_new_runs_confirm_laws_of_every_form_that_can_be_chosen(form, halves, capsys):
    words = ["confirm", str(halves / "new.csv"), "--data", str(halves / "old.csv"), "--law", "P ~ V, f, d, AW"]
    code, said = main([*words, "--form", f"P={form}"]), capsys.readouterr()
    if form in UNSUITED:
        assert code == 0  # the wear is confirmed
        assert "P is not tested: " in said.out
        return
    assert code == (5 if "does not hold" in " ".join(said.out.split()) else 0)
    assert "internal error" not in said.err
    of_power = said.out[said.out.index("P: ") :]
    assert "rows" in of_power
    assert "the law holds" in " ".join(of_power.split()) or form in ("linear", "exponential", "additive")


@pytest.mark.parametrize("form", CHOICES)
def test_the_table_of_a_batch_has_the_law_of_the_chosen_form(form, halves, tmp_path, capsys):
    out = tmp_path / "out"
    words = ["batch", str(halves / "old.csv"), "--table-only", "--jobs", "1", "--out", str(out), "--form", f"P={form}"]
    assert main(words) == 0
    assert "internal error" not in capsys.readouterr().err
    with (out / "results.csv").open(newline="") as file:
        rows = {row["response"]: row for row in csv.DictReader(file)}
    if form in UNSUITED:
        assert UNSUITED[form] in rows["P"]["reason"]
        return
    runs = read_runs(halves / "old.csv")
    (law,) = (law for law in default_laws(runs, forms={"P": form})[0] if law.response == "P")
    assert rows["P"]["form"] == law.form
    for name, value in law.params.items():
        assert float(rows["P"][f"params_{name}"]) == pytest.approx(value, rel=1e-6)


def test_simulated_data_are_read_and_give_the_law_again(case, capsys):
    """At the middle of the tests the law of the simulated data and the first one agree within their intervals."""
    form, laws, folder = case
    out = folder / "simulated_long.csv"
    assert main(["simulate", str(folder / "params.json"), "--out", str(out), "--t-max", "10", "--criterion", "5",
                 "--seed", "11", "--force"]) == 0  # fmt: skip
    capsys.readouterr()
    runs = read_runs(out)
    assert runs.simulated
    for law in laws:
        error = "additive" if form in LINES else law.error
        again = fit_form(runs, form, law.response, law.factors, error=error, terms=law.formula.terms or None)
        at = conditions(law)
        before, after = law.predict(at, "mean").to_frame(), again.predict(at, "mean").to_frame()
        wide = np.hypot(before["high"] - before["low"], after["high"] - after["low"])
        assert abs(float(again.values(at) - law.values(at))) < float(wide.iloc[0])


@pytest.mark.slow
def test_a_replay_finds_the_best_pair_within_limits_and_tests_or_names_what_is_missing(case, capsys, monkeypatch):
    form, _, folder = case
    monkeypatch.setattr(probability, "MOST", (100, 100))
    if form not in ("power", "second_order", "additive_wear"):  # figures are of half planes or of curves
        monkeypatch.setattr(report_on_region, "_figures", lambda *_: {})
    code, said = main(["replay", str(folder / "params.json"), "--json", "--system", "region"]), capsys.readouterr()
    if form in LINES:
        assert code == 3
        assert "does not support this controller" in said.err
        return
    assert (code, said.err) == (0, "")
    best = json.loads(said.out)["systems"]["region"]["optimum"]
    assert best["exceeds"] == []
    assert best["responses"]["P"]["value"] <= 5.0 * (1 + 1e-8)
    assert best["tested"] or form == "power"


def test_a_plan_with_times_gives_a_row_for_each_of_its_readings(case, tmp_path, capsys):
    form, _, folder = case
    if form in LINES:
        return
    plan = tmp_path / "plan.csv"
    ranges = ["--range", "V=60:200", "--range", "f=0.1:0.5", "--range", "d=1:3"]
    assert main(["plan", *ranges, "--duration", "4:10", "--readings", "3", "--out", str(plan)]) == 0
    out = tmp_path / "simulated.csv"
    assert (
        main(["simulate", str(folder / "params.json"), "--plan", str(plan), "--criterion", "5", "--out", str(out)]) == 0
    )
    capsys.readouterr()
    planned, runs = read_runs(plan), read_runs(out)
    for name in ("V", "t"):
        np.testing.assert_array_equal(planned.values(name), runs.values(name))
    assert planned.labels("edge").tolist() == runs.labels("edge").tolist()


def test_exports_of_laws_with_levels_carry_the_shifts(tmp_path, capsys):
    rows = cutting_tests()
    soft = rows["edge"].isin(rows["edge"].unique()[::2]).to_numpy()
    runs = runs_from_frame(rows.assign(work=np.where(soft, "soft", "hard"), P=rows["P"] * np.where(soft, 1, 1.3)))
    law = fit_form(runs, "second_order", "P", FACTORS["P"], by="work")
    file = parameters.write(parameters.collect(tool="T1", work="W1", laws=[law]), tmp_path / "params.json")
    for kind in ("ini", "h", "ngc"):
        out = tmp_path / f"x.{kind}"
        assert main(["export", str(file), "--to", kind, "--out", str(out), "--accept-verdict"]) == 0
        assert "at work hard" in out.read_text()
    shift = float((tmp_path / "x.ini").read_text().partition("law_p_shift_soft = ")[2].partition("\n")[0])
    assert np.exp(shift) == pytest.approx(1 / 1.3, rel=0.05)
    assert shift == float(law.params["work[soft]"])
    capsys.readouterr()
