"""Verdicts in the parameter file: those of judge, of an identification and of a force process, and their use."""

from dataclasses import replace
from types import SimpleNamespace
from typing import get_args

import numpy as np
import pytest
from fitmodels import datasets, fit, ident, parameters
from fitmodels.cards.content.verdicts import _first_remedy
from fitmodels.core.errors import GateError
from fitmodels.core.verdict import LEVELS, Verdict
from fitmodels.datasets.doubts import Doubt
from fitmodels.fit.checks.check import Check, Suspect
from fitmodels.fit.checks.judgement import Judgement
from fitmodels.ident.model import Model
from fitmodels.ident.physical_models.force_process import force_process_fit
from fitmodels.parameters.sections.base import Level, VerdictSection
from hypothesis import given
from hypothesis import strategies as st

FACTORS = ["V", "f", "d", "t"]
PLANT = Model(b=[0.0, 0.1, 0.05], a=[1.0, -1.5, 0.6], nk=1, sample_time=0.02, unit_u="V", unit_y="A")
texts = st.lists(st.text(min_size=1), max_size=3, unique=True).map(tuple)


@pytest.fixture(scope="module")
def runs():
    return datasets.read_runs(datasets.bundled("gc435_709m40"))


def record(n=750, noise=0.01, seed=1):
    """A chirp of 0.1 to 2 Hz on the plant."""
    t = np.arange(n) * 0.02
    u = 2.5 * np.sin(2 * np.pi * (0.1 + 1.9 / (2 * t[-1]) * t) * t)
    y = PLANT.simulate(u) + noise * np.random.default_rng(seed).standard_normal(n)
    return datasets.Record(u=u, y=y, sample_time=0.02, unit_u="V", unit_y="A")


# --- the section


def test_the_remedy_of_a_doubt_is_its_own():
    doubts = [Doubt(("t",), "column 'tc' may be t", '--map "t=col9"'), Doubt(("Fz",), "remarks on 3 of 6 rows", "")]
    pf = SimpleNamespace(reading=SimpleNamespace(doubts=doubts))
    assert _first_remedy(pf, "Doubts of the reading: remarks on 3 of 6 rows.") == ""
    assert _first_remedy(pf, "Doubts of the reading: column 'tc' may be t.") == '--map "t=col9"'


def test_levels_of_the_file_are_those_of_verdicts():
    assert get_args(Level) == LEVELS


@given(st.sampled_from([0, 1, 2]), texts, texts, texts)
def test_a_verdict_is_what_its_section_holds(level, reasons, checked, not_checked):
    verdict = Verdict(level, (reasons or ("Reason.",)) if level else (), checked, not_checked)
    assert VerdictSection.of(verdict).verdict == verdict


def test_a_level_whose_reasons_are_empty_is_still_written():
    assert VerdictSection.of(Verdict(2, ("",))).reasons == ("do not use for control.",)
    assert VerdictSection.of(Verdict()).reasons == ()


# --- laws and tool life


def test_a_law_and_a_life_have_the_verdicts_of_fit(runs):
    laws = [fit.power_law(runs, "AW", FACTORS), fit.power_law(runs, "P", [*FACTORS, "AW"])]
    life = fit.tool_life(laws[0], 0.3)
    pf = parameters.collect(design=runs, laws=laws, tool_life=life)
    for law in laws:
        found = fit.judge(law, runs=runs, laws=2)
        assert pf.laws[law.response].verdict.verdict == found.verdict
    of_law = pf.laws["AW"].verdict.verdict
    assert pf.tool_life.verdict.verdict == fit.life.life_verdict(life, laws[0], runs, of_law)
    assert parameters.collect(tool="a", work="b", tool_life=life).tool_life.verdict is None


def test_a_verdict_better_than_its_checks_is_refused(runs):
    law = parameters.collect(design=runs, laws=[fit.power_law(runs, "AW", ["V", "f", "d", "t"])]).laws["AW"]
    held = law.model_dump()
    held["checks"]["form"] = {"null": "", "statistic": 9.0, "concern": 2, "verdict": "Wrong."}
    with pytest.raises(ValueError, match=r"the verdict on AW is 'usable inside.*check 'form' is 'do not use"):
        type(law).model_validate(held)
    held["verdict"] = None
    assert type(law).model_validate(held).verdict is None


def test_runs_of_other_data_do_not_judge_a_law(runs, monkeypatch):
    given_runs = []
    real = fit.judge
    monkeypatch.setattr(fit, "judge", lambda law, *a, runs=None, **k: given_runs.append(runs) or real(law, *a, **k))
    law = fit.power_law(runs, "AW", FACTORS)
    part = datasets.runs_from_frame(runs.data[:100])
    parameters.collect(design=runs, laws=[law])
    parameters.collect(design=part, laws=[law])
    assert [one is runs for one in given_runs] == [True, False]
    assert given_runs[1] is None


def test_a_posterior_that_disagrees_with_the_law_is_a_reservation(runs, monkeypatch):
    """The posterior of t is moved by ten standard errors: a sentence names both estimates and the usual causes."""
    law = fit.power_law(runs, "AW", FACTORS)
    post = fit.posterior(law, seed=1, draws=1000)
    sound = parameters.collect(design=runs, laws=[law], posteriors=[post]).laws["AW"]
    assert sound.verdict == parameters.collect(design=runs, laws=[law]).laws["AW"].verdict
    draws = post.draws.copy()
    draws[:, post.names.index("t")] += 0.1
    shifted = parameters.collect(design=runs, laws=[law], posteriors=[replace(post, draws=draws)]).laws["AW"]
    assert shifted.verdict.concern == 1
    assert any("posterior" in reason and "exponent of t" in reason for reason in shifted.verdict.reasons)
    monkeypatch.setattr("fitmodels.fit.checks.agreement.posterior_agreement", lambda *a: 1 / 0)
    broken = parameters.collect(design=runs, laws=[law], posteriors=[post]).laws["AW"]
    assert broken.verdict == sound.verdict  # an optional comparison that fails costs only itself


def test_a_life_that_cannot_be_judged_has_a_reservation(runs, monkeypatch):
    law = fit.power_law(runs, "AW", FACTORS)
    monkeypatch.setattr("fitmodels.fit.life.life_verdict", lambda *a: 1 / 0)
    verdict = parameters.collect(laws=[law], tool_life=fit.tool_life(law, 0.3)).tool_life.verdict
    assert verdict.concern == 1
    assert "was not checked" in verdict.reasons[0]


def test_suspects_and_the_law_without_them_are_kept(runs, monkeypatch, tmp_path):
    """The correction is the argument of --correct; the law without the suspects stands beside the law."""
    law, other = (fit.power_law(runs, "AW", factors) for factors in (FACTORS, FACTORS[:3]))
    edges, rows = (
        Suspect("f", ("E07", "E11"), factor=25.4, cause="inch for mm"),
        Suspect("t", lines=(12, 13), offset=-5.0),
    )
    check = Check(null="", concern=2, verdict="f of edges E07, E11 is in inches.", suspects=(edges, rows))

    found = Judgement({"form": check}, rows_are_independent=False, nobs=law.nobs, without=other)
    monkeypatch.setattr(fit, "judge", lambda *a, **k: found)
    pf = parameters.read(parameters.write(parameters.collect(laws=[law]), tmp_path / "params.json"))
    section = pf.laws["AW"]
    assert [suspect.correction for suspect in section.checks["form"].suspects] == ["E07,E11:f*25.4", "lines 12-13:t-5"]
    assert (section.without.edges, section.without.lines) == (("E07", "E11"), (12, 13))
    assert section.without.coefficients == pytest.approx(dict(other.params))
    assert section.without.standard_errors["V"] == pytest.approx(other.bse["V"])
    assert section.verdict.concern == 2
    with pytest.raises(GateError, match=r"laws\.AW: do not use for control\. f of edges E07, E11 is in inches\."):
        parameters.export(pf, "h", tmp_path / "law.h")


# --- dynamics and force process


def test_a_sound_identification_is_usable_and_a_given_model_has_no_verdict(tmp_path):
    found = ident.identify(record(), orders=(2, 2, 1))
    assert (found.verdict.level, found.concern, found.verdict.reasons) == (0, 0, ())
    assert "Exchanged signals" in found.verdict.checked
    pf = parameters.collect(tool="a", work="b", dynamics=found)
    assert pf.dynamics.verdict.verdict == found.verdict
    assert pf.dynamics.held_out_fit == found.validation.fit
    assert parameters.export(pf, "h", tmp_path / "drive.h").exists()
    bare = parameters.collect(tool="a", work="b", dynamics=found.model)
    assert bare.dynamics.verdict is None
    with pytest.raises(GateError, match=r"dynamics has no verdict.*identify the record again"):
        parameters.export(bare, "h", tmp_path / "other.h")


def test_exchanged_signals_must_not_be_used():
    rec = record()
    found = ident.identify(replace(rec, u=rec.y, y=rec.u), orders=(2, 2, 1))
    assert found.verdict.level == 2
    assert "may be swapped" in found.verdict.reasons[0]


def test_a_record_too_short_to_hold_out_samples_has_a_reservation():
    found = ident.identify(record(n=150, noise=0.001), orders=(2, 2, 1))
    assert not found.validation.held_out
    assert found.verdict.level >= 1
    assert any("too short to hold out samples" in reason for reason in found.verdict.reasons)
    assert "too short" in found.verdict.not_checked[0]


def test_noise_that_hides_the_plant_must_not_be_used():
    found = ident.identify(record(noise=8.0), orders=(2, 2, 1))
    assert found.verdict.level == 2
    assert found.verdict.reasons == tuple(dict.fromkeys(found.verdict.reasons))
    assert all(reason.endswith(".") and reason[0].isupper() for reason in found.verdict.reasons)


def test_a_force_process_takes_its_verdict_into_the_file():
    u = np.sin(0.0005 * np.arange(1500.0) ** 2)
    F = ident.continuous.sampled([400.0], [2.0, 2.0 * 8 + 60, 60 * 8.0], 0.01).simulate(u)
    F += 0.01 * np.random.default_rng(1).standard_normal(len(F))
    found = force_process_fit(datasets.Record(u=u, y=F, sample_time=0.01))
    force = {"m": 0.01, "alpha": 0.2, "beta": 1.0, "g1": 0.0, "g2": 0.0, "g3": 1e-4, "Kd": 0.5, "lam": 10.0}
    pf = parameters.collect(tool="a", work="b", adaptive_force={**force, "verdict": found.verdict})
    assert pf.adaptive_force.verdict.verdict == found.verdict
    assert found.verdict.level == 0
