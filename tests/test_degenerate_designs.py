"""Designs that cannot answer everything: the command still ends well, and says in words what it cannot tell."""

import numpy as np
import pandas as pd
import pytest
from fitmodels.cli import main
from fitmodels.core.errors import FitError
from fitmodels.fit.laws import LawForm
from fitmodels.fit.rows import check_constant


def table_of(V, f, t, edge, noise=0.08, level=0.08, seed=1):
    rng = np.random.default_rng(seed)
    levels = {name: rng.normal(0, level) for name in dict.fromkeys(edge)}
    ln = np.log(0.01 * V**0.5 * f**0.2 * t**0.3) + np.array([levels[name] for name in edge])
    wear = np.exp(ln + rng.normal(0, 1, len(V)) * noise)
    return pd.DataFrame({"edge": edge, "V [m/min]": V, "f [mm/rev]": f, "t [min]": t, "AW [mm]": wear})


def ten_edges(**options):
    rng = np.random.default_rng(2)
    V, f = (np.repeat(np.exp(rng.uniform(*ends, 10)), 4) for ends in ((4, 5.2), (-2.5, -0.7)))
    spread = options.pop("spread", 0.0)
    V = V * np.exp(rng.normal(0, 1, 40) * spread)
    return table_of(V, f, np.tile([2, 5, 9, 14.0], 10), np.repeat([f"e{i}" for i in range(10)], 4), **options)


DESIGNS = {
    "fewer edges than parameters": (
        table_of(
            np.repeat([60, 180.0], 4), np.repeat([0.1, 0.3], 4), np.tile([2, 5, 9, 14.0], 2), np.repeat(["a", "b"], 4)
        ),
        ["2 edges for 2 parameters estimated between edges: cut at least 1 more"],
    ),
    "one edge": (
        table_of(np.full(8, 100.0), np.full(8, 0.2), np.arange(1, 9) * 2.0, np.repeat("a", 8)),
        [
            "n = 8 rows; residual df = 6. edges = 1",
            "all rows are from one edge",
            "V is left out: constant",
            "one edge only",
        ],
    ),
    "no replicates": (ten_edges(), ["no two edges were tested at the same conditions, so pure error is unknown"]),
    "no variance between edges": (ten_edges(level=0.0), ["SD between edges = 0 in ln"]),
    "a factor that changes within edges": (ten_edges(spread=0.05), ["V varies within edges"]),
    "a perfectly fitted law": (
        ten_edges(noise=0.0, level=0.0),
        ["the law fits every row exactly", "No posterior", "No inference by edge"],
    ),
    "eight rows": (
        ten_edges().iloc[::5],
        ["each of the 8 rows is a separate edge: rows are independent"],
    ),
}


@pytest.mark.parametrize(("table", "words"), DESIGNS.values(), ids=DESIGNS.keys())
def test_the_command_answers_in_words(tmp_path, monkeypatch, capsys, table, words):
    monkeypatch.chdir(tmp_path)
    table.to_csv("data.csv", index=False)
    assert main(["data.csv", "--tool", "T", "--work", "W", "--full"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    said = " ".join(out.split())
    for sentence in words:
        assert sentence in said
    assert "nan" not in said.lower().replace("tenant", "")


def test_every_law_gets_at_most_six_verdicts_worst_first(tmp_path, monkeypatch):
    from fitmodels import parameters

    monkeypatch.chdir(tmp_path)
    for name, (table, _) in DESIGNS.items():
        table.to_csv("data.csv", index=False)
        assert main(["data.csv", "--tool", "T", "--work", "W", "--out", name.replace(" ", "-")]) == 0
        pf = parameters.read(tmp_path / name.replace(" ", "-") / "T_W" / "params.json")
        for law in pf.laws.values():
            assert 1 <= len(law.verdicts) <= 6
            concern = {check.verdict: check.concern for check in law.checks.values() if check.verdict}
            reported = [concern[verdict] for verdict in law.verdicts if concern.get(verdict)]
            assert reported == sorted(reported, reverse=True)


@pytest.mark.parametrize(
    ("V", "words"),
    [((150.0, 200, 300), "since V varies with f in these rows"), ((200.0, 200.1, 200), "since V hardly changes in")],
)
def test_a_constant_that_overflows_names_what_its_factor_lacks(V, words):
    Z = np.column_stack([np.ones(3), np.log(V), np.log([0.1, 0.2, 0.3])])
    with pytest.raises(FitError, match=words):
        check_constant(LawForm("power", "Fc", ("V", "f")), np.array([900.0, -170.0, 1.0]), Z)
