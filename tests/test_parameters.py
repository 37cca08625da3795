"""The parameter file: what is written is what is read, and nothing else gets in."""

import ast
import copy
import json
import math
import os
import random
import subprocess
import sys
from collections import UserDict
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from fitmodels import fit, parameters
from fitmodels.core.bounded import LIMITS
from fitmodels.core.errors import ParameterError
from fitmodels.fit.checks.judgement import Judgement
from fitmodels.fit.fitted_rows import LawSource
from fitmodels.fit.laws import LawForm
from fitmodels.parameters import LawSection, ParameterFile, collect, read, write
from fitmodels.parameters import file as file_module
from fitmodels.parameters.file import sealed
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from pydantic import ValidationError

ROUNDING = 1e-12  # a logarithm and its exponential, and a handful of products
MUTATIONS = 600

POWER = {
    "form": "power",
    "response": "AW",
    "quantity": "average wear",
    "unit": "mm",
    "equation": "AW = 0.002 V^0.5 f^0.25",
    "error": "multiplicative",
    "coefficients": {"c0": 0.002, "V": 0.5, "f": 0.25},
    "factors": [
        {"symbol": "V", "quantity": "cutting speed", "unit": "m/min", "low": 50.0, "high": 200.0},
        {"symbol": "f", "quantity": "feed", "unit": "mm/rev", "low": 0.1, "high": 0.4},
    ],
    "by": {"column": "material", "reference": "1", "shifts": {"2": 0.3}},
    "uncertainty": {
        "kind": "covariance",
        "of": ["ln c0", "V", "f", "material[2]"],
        "matrix": [
            [0.5, -0.1, 0.01, 0.0],
            [-0.1, 0.03, 0.0, 0.0],
            [0.01, 0.0, 0.02, 0.0],
            [0.0, 0.0, 0.0, 0.01],
        ],
        "df": 12,
    },
    "residual_se": 0.1,
    "residual_scale": "ln",
    "n": 16,
    "df": 12,
    "statistics": {"r2": 0.9, "r2_adj": 0.88, "F": 40.0, "F_df": [3, 12], "F_p": 1e-6},
    "standard_errors": {"c0": 0.001, "V": 0.17, "f": 0.14, "material[2]": 0.1},
    "left_out": [{"factor": "d", "reason": "the same in every row"}],
    "dropped_rows": [{"reason": "AW is empty", "count": 2}],
    "notes": ["µ and ü survive"],
}
IDENTITY = {"tool": "GC435", "work": "709M40", "simulated": False}
PROVENANCE = {"fitmodels": "0.1.0", "data_file": "data.csv", "n_rows": 18, "created": "2024-05-01"}


def law(**changes):
    return LawSection.model_validate({**copy.deepcopy(POWER), **changes})


def line(**changes):
    """The load line of CLM-2023, with made-up numbers."""
    factors = [
        {"symbol": s, "quantity": s, "unit": u, "low": 0.0, "high": 1.0} for s, u in (("fm", "mm/min"), ("VB", "mm"))
    ]
    wide = {
        "kind": "covariance",
        "of": ["A", "B", "k1"],
        "matrix": np.diag([0.04, 0.01, 0.09]).tolist(),
        "df": 5,
    }
    return law(
        **{
            "form": "load_line",
            "response": "I",
            "unit": "A",
            "error": "additive",
            "coefficients": {"A": 2.0, "B": 0.5, "k1": 3.0},
            "factors": factors,
            "by": None,
            "uncertainty": wide,
            "residual_se": 0.2,
            "residual_scale": "A",
            "standard_errors": {},
            **changes,
        }
    )


def whole(**changes):
    data = {"identity": IDENTITY, "laws": {"AW": POWER}, "provenance": PROVENANCE, **changes}
    return ParameterFile.model_validate(copy.deepcopy(data))


@pytest.fixture
def path(tmp_path):
    return tmp_path / "params.json"


# --- a law predicts from the file alone -------------------------------------------------------------


def test_power_law_is_its_equation():
    V, f = np.array([60.0, 120.0]), np.array([[0.2], [0.3], [0.4]])
    expected = 0.002 * V**0.5 * f**0.25
    assert_allclose(law().values(by="1", V=V, f=f), expected, rtol=ROUNDING)
    assert_allclose(law().values(by="2", V=V, f=f), expected * math.exp(0.3), rtol=ROUNDING)


def test_single_point_is_a_float():
    assert (
        type(law(by=None, uncertainty={"kind": "none", "reason": "r"}, standard_errors={}).values(V=60, f=1)) is float
    )
    low, high = law().interval(by="1", V=60, f=0.2)
    assert type(low) is float
    assert type(high) is float
    assert law().inside(V=60, f=0.2) is True


def test_other_forms_are_their_equations():
    rough = law(
        form="exponential",
        response="Ra",
        coefficients={"a": 0.2401, "b": 0.0034},
        factors=[{"symbol": "F", "quantity": "force", "unit": "N", "low": 100.0, "high": 500.0}],
        by=None,
        uncertainty={"kind": "none", "reason": "r"},
        standard_errors={},
    )
    assert_allclose(rough.values(F=[0.0, 300.0]), 0.2401 * np.exp([0.0, 0.0034 * 300]), rtol=ROUNDING)
    assert_allclose(line().values(fm=0.4, VB=[0.0, 0.1]), [2.2, 2.5], rtol=ROUNDING)


@given(st.floats(0.01, 100), st.floats(0.01, 100))
def test_units_scale_through_a_power_law(scale, V):
    """Speed in other units with c0 to match gives the same wear."""
    other = law(coefficients={"c0": 0.002 * scale**0.5, "V": 0.5, "f": 0.25})
    assert_allclose(other.values(by="1", V=V / scale, f=0.2), law().values(by="1", V=V, f=0.2), rtol=1e-9)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"V": 100}, "needs f"),
        ({"V": 100, "f": 0.2, "d": 1}, "no factor 'd'"),
        ({"V": 100, "f": -0.2}, "f = -0.2 mm/rev"),
        ({"V": [100, 0], "f": 0.2}, "V = 0 m/min"),
        ({"V": np.nan, "f": 0.2}, "V = nan"),
        ({"V": "fast", "f": 0.2}, "V = 'fast' is not a number"),
        ({"V": [1, 2], "f": [1, 2, 3]}, "do not broadcast"),
        ({"V": 1e300, "f": 1e300, "by": "9"}, "no material '9'"),
        ({"V": 100, "f": 0.2, "by": None}, "give by= one of its levels"),
    ],
)
def test_what_a_law_cannot_take_is_named(arguments, words):
    with pytest.raises(ParameterError, match=words):
        law().values(**{"by": "1", **arguments})


def test_a_level_where_there_is_none_is_refused():
    with pytest.raises(ParameterError, match="has no levels"):
        line().values(by="2", fm=1, VB=0)


def test_overflow_is_a_sentence():
    steep = law(coefficients={"c0": 1.0, "V": 200.0, "f": 1.0})
    with pytest.raises(ParameterError, match="not finite"):
        steep.values(by="1", V=1e5, f=1)


def test_inside_counts_both_ends():
    assert law().inside(V=[49.9, 50, 200, 200.1], f=0.1).tolist() == [False, True, True, False]


# --- intervals ------------------------------------------------------------------------------------


def test_interval_of_a_multiplicative_law_by_hand():
    """t(12) at 97.5 % is 2.179 (any table of Student's t)."""
    low, high = law().interval(by="2", V=1.0, f=1.0)  # ln V = ln f = 0: variance 0.5 + 0.01
    middle, half = math.log(0.002) + 0.3, 2.179 * math.sqrt(0.51)
    assert_allclose(np.log([low, high]), [middle - half, middle + half], rtol=1e-3)


def test_prediction_adds_the_residual():
    """t(5) at 97.5 % is 2.571; A = 2, variance 0.04, residual 0.2."""
    assert_allclose(line().interval(fm=0, VB=0), [2 - 2.571 * 0.2, 2 + 2.571 * 0.2], rtol=1e-3)
    both = 2.571 * math.sqrt(0.08)
    assert_allclose(line().interval(kind="prediction", fm=0, VB=0), [2 - both, 2 + both], rtol=1e-3)


def test_additive_power_law_by_the_delta_method():
    """Gradient by numerical differences of predict, in ln c0 and the exponents."""
    additive = law(error="additive", residual_scale="mm")
    V, f, step = 120.0, 0.3, 1e-6
    c = dict(POWER["coefficients"])

    def at(**delta):
        moved = {
            "c0": c["c0"] * math.exp(delta.get("c0", 0)),
            "V": c["V"] + delta.get("V", 0),
            "f": c["f"] + delta.get("f", 0),
        }
        return law(error="additive", residual_scale="mm", coefficients=moved).values(by="1", V=V, f=f)

    gradient = np.array([(at(**{name: step}) - at(**{name: -step})) / (2 * step) for name in c])
    C = np.array(POWER["uncertainty"]["matrix"])[:3, :3]
    half = 2.1788128 * math.sqrt(gradient @ C @ gradient)  # t(12) at 97.5 %
    low, high = additive.interval(by="1", V=V, f=f)
    assert_allclose([(high + low) / 2, (high - low) / 2], [at(), half], rtol=1e-6)


def test_order_of_the_covariance_does_not_matter():
    shuffled = [2, 0, 3, 1]
    given_ = POWER["uncertainty"]
    matrix = np.array(given_["matrix"])[np.ix_(shuffled, shuffled)].tolist()
    other = law(uncertainty={**given_, "of": [given_["of"][i] for i in shuffled], "matrix": matrix})
    at = {"by": "2", "V": [60.0, 190.0], "f": 0.3}
    assert_allclose(other.interval(**at), law().interval(**at), rtol=ROUNDING)


@given(st.floats(0.01, 0.98), st.floats(0.001, 0.01), st.floats(50, 200))
def test_intervals_nest(level, more, V):
    at = {"by": "2", "V": V, "f": 0.2}
    low, high = law().interval(level, **at)
    wide_low, wide_high = law().interval(level + more, **at)
    far_low, far_high = law().interval(level, "prediction", **at)
    assert wide_low <= low < law().values(by="2", V=V, f=0.2) < high <= wide_high
    assert far_low < low < high < far_high


def test_no_interval_gives_its_reason():
    bare = law(uncertainty={"kind": "none", "reason": "4 observations, 4 parameters"})
    with pytest.raises(ParameterError, match="4 observations, 4 parameters"):
        bare.interval(by="1", V=100, f=0.2)
    with pytest.raises(ParameterError, match="no residual standard error"):
        law(residual_se=None).interval(kind="prediction", by="1", V=100, f=0.2)


@pytest.mark.parametrize("level", [0, 1, 95, "2", None, math.nan])
def test_coverage_is_between_0_and_1(level):
    with pytest.raises(ParameterError, match="between 0 and 1"):
        law().interval(level, by="1", V=100, f=0.2)


def test_kind_of_interval():
    with pytest.raises(ParameterError, match=r"kind = 'confidence'.*'mean', 'prediction', 'tolerance'"):
        law().interval(kind="confidence", by="1", V=100, f=0.2)


# --- the schema -----------------------------------------------------------------------------------


def covariance(matrix, of=("ln c0", "V", "f", "material[2]")):
    return {"uncertainty": {"kind": "covariance", "of": list(of), "matrix": matrix, "df": 3}}


SKEWED = [[1.0, 0.2, 0, 0], [0.1, 1.0, 0, 0], [0, 0, 1.0, 0], [0, 0, 0, 1.0]]
INDEFINITE = [[1.0, 0.9, -0.9, 0], [0.9, 1.0, 0.9, 0], [-0.9, 0.9, 1.0, 0], [0, 0, 0, 1.0]]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"coefficients": {"c0": 1.0, "V": 1.0}}, "has the coefficients c0, V, not c0, V, f"),
        ({"coefficients": {"c0": 0.0, "V": 1.0, "f": 1.0}}, "must be positive"),
        ({"coefficients": {"c0": math.inf, "V": 1.0, "f": 1.0}}, "finite number"),
        ({"coefficients": {"c0": "1", "V": 1.0, "f": 1.0}}, "valid number"),
        (
            {"factors": [{**POWER["factors"][0], "low": 300.0}, POWER["factors"][1]]},
            "low 300 above high 200",
        ),
        ({"factors": [POWER["factors"][0], POWER["factors"][0]]}, "names a factor twice"),
        (
            {"factors": [{**POWER["factors"][0], "symbol": "level"}, POWER["factors"][1]]},
            "can be called level",
        ),
        ({"by": {"column": "m", "reference": "1", "shifts": {"1": 0.0}}}, "cannot have a shift"),
        ({"by": None, "standard_errors": {}}, "the covariance of AW is of"),
        ({"by": None}, r"no parameter material\[2\]"),
        ({"standard_errors": {"d": 1.0}}, "no parameter d"),
        ({"standard_errors": {"V": -1.0}}, "greater than or equal to 0"),
        ({"residual_scale": "mm"}, "is in ln"),
        ({"form": "load_line"}, "the load_line law"),
        ({"alternative": POWER}, "other error structure"),
        ({"n": -1}, "greater than or equal to 0"),
        (covariance(np.eye(3).tolist()), "must be 4 x 4"),
        (covariance([[1.0], [1.0, 2.0], [], []]), "must be 4 x 4"),
        (covariance((-np.eye(4)).tolist()), "diagonal is negative"),
        (covariance(SKEWED), "not symmetric"),
        (covariance(INDEFINITE), "not a covariance"),
        (covariance((np.eye(4) + 1e3 * np.eye(4)[::-1]).tolist()), "larger than its two variances"),
        (covariance(np.eye(4).tolist(), ("ln c0", "V", "f", "f")), "named twice"),
        (covariance(np.eye(4).tolist(), ("c0", "V", "f", "material[2]")), "must be of ln c0, V, f"),
    ],
)
def test_schema_refuses(changes, words):
    with pytest.raises(ValidationError, match=words):
        law(**changes)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"laws": {"VB": POWER}}, "laws.VB is a law of AW"),
        ({"": {"x": 1}}, "a section has no name"),
        ({"limits": {"feed": {"low": 1e-300, "high": 0.6, "unit": "mm/rev"}}}, "none of a machine"),
    ],
)
def test_the_file_refuses(change, words):
    with pytest.raises(ValidationError, match=words):
        ParameterFile(**{"identity": {"tool": "T", "work": "W", "simulated": True}, "provenance": PROVENANCE, **change})


def test_a_line_has_additive_errors():
    with pytest.raises(ValidationError, match="additive errors"):
        line(error="multiplicative")


def test_tiny_and_huge_variances_are_judged_by_correlation():
    scale = np.diag([1e-150, 1e150, 1.0, 1e-20])
    matrix = (scale @ np.array(POWER["uncertainty"]["matrix"]) @ scale).tolist()
    assert law(**covariance(matrix)).uncertainty.kind == "covariance"


def test_sections_are_frozen():
    with pytest.raises(ValidationError, match="frozen"):
        law().n = 3


def test_alternative_is_kept():
    other = {**POWER, "error": "additive", "residual_scale": "mm"}
    assert law(alternative=other).alternative.error == "additive"


@pytest.mark.parametrize("created", ["yesterday", "01/05/2024"])
def test_created_is_an_iso_date(created):
    with pytest.raises(ValidationError, match="is not an ISO date"):
        whole(provenance={**PROVENANCE, "created": created})


# --- writing and reading ----------------------------------------------------------------------------

finite = st.floats(allow_nan=False, allow_infinity=False)
positive = st.floats(min_value=0, exclude_min=True, allow_infinity=False)
text = st.text(st.characters(exclude_categories=["Cs"]), max_size=8)
names = text.filter(bool)
json_values = st.recursive(
    st.none() | st.booleans() | st.integers(-(10**40), 10**40) | finite | text,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(text, inner, max_size=3),
    max_leaves=8,
)
unknown = st.dictionaries(text.map("x-{}".format), json_values, max_size=2)


@st.composite
def laws(draw):
    symbols = draw(st.lists(names.filter(lambda s: s not in ("level", "kind", "by", "c0")), max_size=3, unique=True))
    levels = draw(st.lists(text, min_size=1, max_size=3, unique=True))
    by = {"column": draw(names), "reference": levels[0], "shifts": {at: draw(finite) for at in levels[1:]}}
    of = ["ln c0", *symbols, *(f"{by['column']}[{at}]" for at in levels[1:])]
    assume(len(set(of)) == len(of))
    root = np.array(draw(st.lists(st.floats(-1e6, 1e6), min_size=len(of), max_size=len(of))))
    covariance = {
        "kind": "covariance",
        "of": of,
        "matrix": np.diag(root**2).tolist(),
        "df": draw(st.integers(1, 99)),
    }
    none = {"kind": "none", "reason": draw(names)}
    ends = [sorted([draw(finite), draw(finite)]) for _ in symbols]
    error = draw(st.sampled_from(["multiplicative", "additive"]))
    return {
        **POWER,
        **draw(unknown),
        "error": error,
        "equation": draw(text),
        "coefficients": {"c0": draw(positive), **{s: draw(finite) for s in symbols}},
        "factors": [
            {"symbol": s, "quantity": draw(text), "unit": draw(text), "low": low, "high": high}
            for s, (low, high) in zip(symbols, ends, strict=True)
        ],
        "by": by,
        "uncertainty": draw(st.sampled_from([covariance, none])),
        "residual_se": draw(st.none() | st.floats(0, allow_infinity=False)),
        "residual_scale": "ln" if error == "multiplicative" else draw(text),
        "standard_errors": {},
    }


above = st.floats(1e-9, 1e9)
polynomials = st.lists(finite, max_size=3)


@st.composite
def dynamics(draw):
    a, b = draw(polynomials), draw(polynomials.filter(bool))
    of = [*(f"a{i + 1}" for i in range(len(a))), *(f"b{j + 2}" for j in range(len(b)))]
    matrix = np.diag(draw(st.lists(st.floats(0, 1e6), min_size=len(of), max_size=len(of)))).tolist()
    held = {"kind": "covariance", "of": of, "matrix": matrix, "df": draw(st.none() | st.integers(0, 99))}
    given_ = {"b": [0.0, -0.0, *b], "a": [1.0, *a], "nk": 2, "sample_time": draw(above), **draw(unknown)}
    return {**given_, "uncertainty": draw(st.sampled_from([held, {"kind": "none", "reason": "given"}]))}


gains = st.fixed_dictionaries(
    {"kp": finite, "ki": finite, "sample_time": above},
    optional={"delay": st.integers(0, 1000), "rate": above, "specification": st.fixed_dictionaries({"ms": above})},
)
limits = st.fixed_dictionaries({}, optional={"wear": st.fixed_dictionaries({"value": above, "unit": names})})
sections = st.fixed_dictionaries({}, optional={"dynamics": dynamics(), "pi": gains, "limits": limits})
named_laws = st.dictionaries(names, laws(), max_size=2)


@st.composite
def files(draw):
    return ParameterFile.model_validate(
        {
            "identity": {
                "tool": draw(names),
                "work": draw(names),
                "simulated": draw(st.booleans()),
                **draw(unknown),
            },
            "laws": {name: {**law, "response": name} for name, law in draw(named_laws).items()},
            "provenance": {
                **PROVENANCE,
                "options": draw(st.dictionaries(text, json_values, max_size=2)),
                "seed": draw(st.none() | st.integers(0, 2**32)),
                **draw(unknown),
            },
            **draw(sections),
            **draw(unknown),
        }
    )


def hexed(value):
    """Floats by their bits, so that -0.0 and 0.0 differ."""
    if isinstance(value, dict):
        return {key: hexed(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [hexed(inner) for inner in value]
    return value.hex() if isinstance(value, float) else value


@pytest.mark.slow
@settings(max_examples=150, deadline=None)
@given(files())
def test_what_is_written_is_read(pf):
    with TemporaryDirectory() as folder:
        first = write(pf, Path(folder) / "params.json")
        again = read(first)
        second = write(again, Path(folder) / "again.json")
        assert again == pf
        assert hexed(again.model_dump()) == hexed(sealed(pf).model_dump())
        assert first.read_bytes() == second.read_bytes()


def test_the_text_is_for_people(path):
    content = write(whole(), path).read_bytes()
    assert content.endswith(b"}\n")
    assert content.startswith(b'{\n  "schema_version": "fitmodels.parameters/10",\n  "identity": {\n')
    assert "µ and ü" in content.decode()


def test_unknown_sections_survive(path):
    later = {"kp": 0.1, "margins": [None, -0.0, {"deep": [True, 1e-310]}]}
    data = whole().model_dump(mode="json") | {"later": later}
    data["laws"]["AW"]["future"] = "field"
    data["laws"]["AW"]["factors"][0]["predict"] = 3
    path.write_text(json.dumps(data))
    out = json.loads(write(read(path), path.with_name("out.json")).read_text())
    assert len(out["content_sha256"]) == 64
    assert out | {"content_sha256": None} == data


def test_an_existing_file_stands_without_force(path):
    write(whole(), path)
    before = path.read_bytes()
    other = whole(identity={**IDENTITY, "tool": "other"})
    with pytest.raises(ParameterError, match=r"params\.json: the file exists.*--force"):
        write(other, path)
    assert path.read_bytes() == before
    assert read(write(other, path, force=True)).identity.tool == "other"


@pytest.mark.parametrize("name", ["fsync", "replace"])
@pytest.mark.parametrize("failure", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_a_write_cut_short_leaves_the_old_file(path, monkeypatch, name, failure):
    write(whole(), path)
    before = path.read_bytes()

    def fail(*_):
        raise failure

    monkeypatch.setattr(file_module.os, name, fail)
    expected = ParameterError if isinstance(failure, OSError) else KeyboardInterrupt
    with pytest.raises(expected, match="no space" if isinstance(failure, OSError) else None):
        write(whole(identity={**IDENTITY, "tool": "other"}), path, force=True)
    assert path.read_bytes() == before
    assert [entry.name for entry in path.parent.iterdir()] == ["params.json"]


def test_a_write_asks_for_the_disk_before_the_name(path, monkeypatch):
    calls = []
    for name in ("fsync", "link", "replace"):
        real = getattr(os, name)
        monkeypatch.setattr(file_module.os, name, lambda *a, real=real, name=name: (calls.append(name), real(*a))[1])
    write(whole(), path)
    assert calls[:2] == ["fsync", "link"]  # which fails where the name was taken meanwhile
    calls.clear()
    write(whole(), path, force=True)
    assert calls[:2] == ["fsync", "replace"]


@pytest.mark.parametrize("where", ["no/params.json", "plain/params.json", "folder", "nul\0l", ""])
def test_a_place_that_cannot_be_written(tmp_path, where):
    (tmp_path / "plain").write_text("")
    (tmp_path / "folder").mkdir()
    with pytest.raises(ParameterError, match="cannot be written"):
        write(whole(), tmp_path / where, force=True)
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["folder", "plain"]


@pytest.mark.parametrize(
    "section",
    [math.nan, np.arange(3), {"a": {1, 2}}, "\ud800", {1: "a", "1": "b"}, UserDict(a=1)],
)
def test_a_section_that_json_cannot_hold(path, section):
    with pytest.raises(ParameterError, match=r"params\.json: "):
        write(whole(later={"kp": section}), path)
    with pytest.raises(ParameterError, match="JSON cannot represent"):
        sealed(whole(later={"kp": section}))
    assert not path.exists()


def test_a_sealed_file_that_was_changed_is_read_back_before_it_is_written(path):
    changed = sealed(whole()).model_copy(update={"later": json.loads("[" * 60 + "]" * 60)})
    with pytest.raises(ParameterError, match="nested deeper"):
        write(changed, path)
    assert not path.exists()


def altered(change):
    data = whole().model_dump(mode="json")
    change(data)
    return json.dumps(data).encode()


def deep(levels):
    return altered(lambda d: d.update(later=json.loads("[" * levels + "]" * levels)))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is not JSON at line 1, column 1"),
        (b'{"schema_version": \n nul}', "is not JSON at line 2, column 2"),
        (b'{"a": "\xff"}', r"is not UTF-8 text \(byte 7\)"),
        (b"[]", "is not a parameter file"),
        (b"{}", "is not a parameter file"),
        (b'{"schema_version": "fitmodels.parameters/11"}', "newer schema.*Upgrade"),
        (b'{"schema_version": "fitmodels.card/1"}', "schema_version is 'fitmodels.card/1'"),
        (b'{"schema_version": [1]}', r"schema_version is a list"),
        (b'{"schema_version": "fitmodels.parameters/1"}', "identity is missing; provenance is missing"),
        (b'{"a": 1, "b": 2, "a": 3}', "the key 'a' occurs twice"),
        (b'{"a": NaN}', "holds NaN"),
        (b'{"a": -Infinity}', "holds -Infinity"),
        (b'{"a": 1e999}', "holds 1e999"),
        (b'{"a": ' + b"9" * 5000 + b"}", "an integer of 5000 digits"),
        (b'{"a": "\\ud800"}', "an unpaired surrogate"),
        (b'{"a": ' + b"[" * 100_000, "nested deeper"),
        (deep(60), "nested deeper than 50"),
        (
            altered(lambda d: d["laws"]["AW"]["factors"][0].update(low="x")),
            r"laws\.AW\.factors\[0\]\.low .*, not 'x'",
        ),
        (
            altered(lambda d: d["laws"]["AW"]["uncertainty"].update(df=None)),
            r"laws\.AW\.uncertainty\.df should be a whole number, not null",
        ),
        (altered(lambda d: d["laws"]["AW"].update(uncertainty={})), r"laws\.AW\.uncertainty needs a known kind"),
        (
            altered(lambda d: d["laws"]["AW"].update(factors={})),
            r"laws\.AW\.factors should be a list, not an object",
        ),
        (altered(lambda d: d["laws"].update(AW=[])), r"laws\.AW should be an object, not a list"),
        (
            altered(lambda d: d["identity"].update(simulated=1)),
            r"identity\.simulated should be true or false, not 1",
        ),
        (altered(lambda d: d["laws"]["AW"].clear()), r"laws\.AW\.form is missing; .*; and \d+ more"),
        (altered(lambda d: d["provenance"].update(data_sha256="abc")), r"provenance\.data_sha256 .*'abc'"),
    ],
)
def test_reading_what_is_wrong_is_one_sentence(path, content, words):
    path.write_bytes(content)
    with pytest.raises(ParameterError, match=words) as raised:
        read(path)
    assert str(raised.value).startswith(str(path))
    assert str(raised.value).endswith((".", "?"))
    assert "\n" not in str(raised.value)


def test_reading_what_is_not_a_file(tmp_path):
    with pytest.raises(ParameterError, match="the file does not exist"):
        read(tmp_path / "nowhere.json")
    with pytest.raises(ParameterError, match="is a folder"):
        read(tmp_path)
    with pytest.raises(ParameterError, match="cannot be read"):
        read("nul\0l")
    if hasattr(os, "mkfifo"):
        os.mkfifo(tmp_path / "pipe")
        with pytest.raises(ParameterError, match="is a pipe, not a regular file"):
            read(tmp_path / "pipe")


def test_a_file_too_large_is_not_read(path):
    with path.open("wb") as file:
        file.truncate(LIMITS["parameters"].size + 1)  # sparse: takes no room on disk
    with pytest.raises(ParameterError, match="at most 50000000"):
        read(path)


def test_a_whole_number_is_a_number(path):
    path.write_bytes(altered(lambda d: d["laws"]["AW"]["coefficients"].update(V=10**299)))
    assert read(path).laws["AW"].coefficients["V"] == 1e299


def test_a_byte_order_mark_is_read(path):
    path.write_bytes(b"\xef\xbb\xbf" + altered(lambda _: None))
    assert read(path) == whole()


def mutate(rng, content):
    """A byte flipped, a slice cut out or doubled, or a token put where it does not belong."""
    start = rng.randrange(len(content))
    stop = min(len(content), start + rng.randrange(1, 40))
    tokens = [
        b"null",
        b"-1",
        b"1e400",
        b"NaN",
        b'""',
        b"[]",
        b"{}",
        b"true",
        b"0",
        b"1e308",
        b'"\\u0000"',
        b"\xff",
    ]
    return rng.choice(
        [
            content[:start] + bytes([rng.randrange(256)]) + content[start + 1 :],
            content[:start] + content[stop:],
            content[:stop] + content[start:],
            content[:start] + rng.choice(tokens) + content[stop:],
        ]
    )


def swap_value(rng, data):
    """One value of the tree replaced by another of some other kind: still JSON, seldom valid."""
    here = data
    while True:
        key = rng.choice(list(here) if isinstance(here, dict) else range(len(here)))
        inner = here[key]
        if not isinstance(inner, dict | list) or not inner or rng.random() < 0.1:
            break
        here = inner
    here[key] = rng.choice([None, -1, 0, 1e308, -0.0, 5e-324, True, "", "V", [], {}, [[1.0]], {"a": 1}, 10**30])
    return json.dumps(data).encode()


def complaint(path):
    """What reading the file, or the law in it, complains about; None when it is valid."""
    try:
        pf = read(path)
        for one in pf.laws.values():
            at = {"by": one.by and one.by.reference, **{factor.symbol: 1.0 for factor in one.factors}}
            one.interval(**at)
            one.predict(kind="tolerance", centre="mean", **at)
            one.predict(kind="mean", centre="mean", **at)
    except ParameterError as error:
        return str(error)
    return None


def test_a_damaged_file_is_refused_or_valid(path):
    """Never another exception; and what is still valid predicts, or says why not."""
    rng = random.Random(20240501)  # noqa: S311
    good = altered(lambda _: None)
    raised = []
    for turn in range(MUTATIONS):
        path.write_bytes(mutate(rng, good) if turn % 2 else swap_value(rng, json.loads(good)))
        raised.append(complaint(path))
    assert MUTATIONS / 4 < sum(text is not None for text in raised) < MUTATIONS
    assert not any("\n" in text for text in raised if text)


# --- collecting -------------------------------------------------------------------------------------


@pytest.fixture(autouse=True)
def no_checks(monkeypatch):
    """A stand-in has no rows to check: what `judge` finds on real fits is tested beside it."""
    monkeypatch.setattr("fitmodels.parameters.gather.law._region", lambda law: None)
    nothing = Judgement({}, rows_are_independent=True, nobs=20)
    monkeypatch.setattr(fit, "judge", lambda law, gauge_sd, **more: nothing)


def stand_in(**changes):
    """What a fitted law looks like from outside."""
    names = ["c0", "V", "f", "material[2]"]
    attributes = {
        "form": "power",
        "response": "AW",
        "factors": ("V", "f"),
        "source": LawSource(),
        "rows": (),
        "units": {"AW": "mm", "V": "m/min", "f": "mm/rev"},
        "error": "multiplicative",
        "params": pd.Series([0.00123456789, 0.577, -0.21, 0.3], index=names),
        "bse": pd.Series([0.0002, 0.02, 0.03, 0.1], index=names),
        "theta_names": ("ln c0", "V", "f", "material[2]"),
        "cov_theta": np.diag([0.5, 0.01, 0.02, 0.01]) + np.triu(np.full((4, 4), 1e-13), 1),
        "no_interval": None,
        "nobs": 20,
        "residuals": np.array([0.1, -0.1]),
        "n_edges": 5,
        "edges": fit.NotAvailable("no edge column"),
        "df_resid": 16,
        "df": 16,
        "df_model": 3,
        "rsquared": 0.9,
        "rsquared_adj": 0.88,
        "fvalue": np.float64(40.0),
        "f_pvalue": 1e-7,
        "scale_se": 0.1,
        "scale_unit": "ln",
        "domain": {"V": (50.0, 200.0), "f": (0.1, 0.4)},
        "by": SimpleNamespace(column="material", reference="1", levels=("2",)),
        "left_out": (SimpleNamespace(factor="d", reason="the same in every row"),),
        "dropped": (SimpleNamespace(reason="AW is empty", count=np.int64(2), lines=(3, 7)),),
        "notes": ("a note",),
        "life": None,
        "not_least_squares": "",
        "alternative": None,
    }
    law = SimpleNamespace(**{**attributes, **changes})
    law.formula = LawForm(law.form, law.response, law.factors)
    law.covariance = lambda: law.cov_theta
    return law


def test_collect_hands_every_number_over(path):
    other = stand_in(error="additive", scale_unit="mm")
    pf = collect(
        tool="another",
        work="709M40",
        laws=[stand_in(alternative=other)],
        data_file="/some/where/data.csv",
        data_sha256="0" * 64,
        n_rows=22,
        created="2024-05-01",
        options={"error": "multiplicative"},
        later={"kp": 0.5},
    )
    section = read(write(pf, path)).laws["AW"]
    assert section.coefficients == {"c0": 0.00123456789, "V": 0.577, "f": -0.21}
    assert section.by.shifts == {"2": 0.3}
    assert section.equation == "AW = 0.00123457 V^0.577 f^-0.21 for material 1; times 1.34986 for 2"
    assert (section.quantity, section.factors[0].quantity) == ("average wear", "cutting speed")
    assert (section.factors[1].low, section.factors[1].high) == (0.1, 0.4)
    assert section.statistics.F_df == (3, 16)
    assert (section.n_edges, section.dropped_rows[0].lines) == (5, (3, 7))
    assert section.standard_errors["material[2]"] == 0.1
    assert section.uncertainty.df == 16
    assert section.alternative.residual_scale == "mm"
    assert (section.left_out[0].factor, section.dropped_rows[0].count, section.notes[0]) == ("d", 2, "a note")
    assert pf.provenance.data_file == "data.csv"
    assert set(pf.provenance.versions) == {"python", "numpy", "scipy"}
    assert pf.model_dump()["later"] == {"kp": 0.5}
    assert_allclose(section.values(by="2", V=100, f=0.2), 0.00123456789 * 100**0.577 * 0.2**-0.21 * math.exp(0.3))


def test_the_same_call_gives_the_same_bytes(tmp_path):
    one, two = (write(collect(tool="a", work="b", laws=[stand_in()]), tmp_path / name) for name in ("1", "2"))
    assert one.read_bytes() == two.read_bytes()


def test_an_exactly_solved_law_has_a_reason_for_no_interval():
    exact = stand_in(
        cov_theta=None,
        no_interval="no interval: 4 observations fix 4 parameters exactly",
        bse=pd.Series(np.nan, index=["c0", "V", "f", "material[2]"]),
        scale_se=None,
        fvalue=None,
        rsquared_adj=None,
        f_pvalue=None,
    )
    section = collect(tool="a", work="b", laws=[exact]).laws["AW"]
    assert section.standard_errors == {}
    assert section.statistics.F_df is None
    with pytest.raises(ParameterError, match="4 observations fix 4 parameters exactly"):
        section.interval(by="1", V=100, f=0.2)


def test_equations_of_the_other_forms():
    rough = stand_in(
        form="exponential",
        response="Ra",
        factors=("F",),
        units={"Ra": "µm", "F": "N"},
        params=pd.Series({"a": 0.2401, "b": 0.0034}),
        bse=pd.Series({"a": 0.1, "b": 0.1}),
        theta_names=("ln a", "b"),
        cov_theta=np.eye(2),
        domain={"F": (1.0, 2.0)},
        by=None,
    )
    load = stand_in(
        form="load_line",
        response="I",
        factors=("fm", "VB"),
        units={"I": "A", "fm": "mm/min", "VB": "mm"},
        error="additive",
        scale_unit="A",
        params=pd.Series({"A": 2.0, "B": 0.5, "k1": -3.0, "m[x]": -0.25}),
        bse=pd.Series({"A": 0.1}),
        theta_names=("A", "B", "k1", "m[x]"),
        cov_theta=np.eye(4),
        domain={"fm": (1.0, 2.0), "VB": (0.0, 0.3)},
        by=SimpleNamespace(column="m", reference="r", levels=("x",)),
    )
    pf = collect(tool="a", work="b", laws=[rough, load])
    assert pf.laws["Ra"].equation == "Ra = 0.2401 exp(0.0034 F)"
    assert pf.laws["I"].equation == "I = 2 + 0.5 fm - 3 VB for m r; minus 0.25 for x"
    assert pf.laws["I"].values(by="x", fm=1, VB=0.1) == pytest.approx(1.95)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            {"params": pd.Series({"c0": math.inf, "V": 1.0, "f": 1.0, "material[2]": 0.0})},
            r"coefficients\.c0",
        ),
        ({"theta_names": ("c0", "V", "f", "material[2]")}, "must be of ln c0"),
    ],
)
def test_a_fit_that_cannot_be_handed_over(changes, words):
    with pytest.raises(ParameterError, match=f"the law of AW cannot be written: .*{words}"):
        collect(tool="a", work="b", laws=[stand_in(**changes)])


def test_collect_refuses():
    with pytest.raises(ParameterError, match="two laws of AW"):
        collect(tool="a", work="b", laws=[stand_in(), stand_in()])
    with pytest.raises(ParameterError, match=r"identity\.tool"):
        collect(tool="", work="b")
    with pytest.raises(ParameterError, match="identity is written by collect"):
        collect(tool="a", work="b", identity={})


# --- the real fits ------------------------------------------------------------------------------------


@pytest.mark.parametrize("error", ["multiplicative", "additive"])
def test_a_fitted_law_predicts_the_same_from_its_file(path, error):
    from fitmodels import datasets, fit

    runs = datasets.read_runs(datasets.bundled("ac2017_table1"))
    fitted = fit.power_law(runs, "AW", ["V", "f"], error=error)
    section = read(write(collect(tool="GC435", work="709M40", laws=[fitted]), path)).laws["AW"]
    at = {name: np.linspace(*fitted.domain[name], 5) for name in ("V", "f")}
    assert_allclose(section.values(**at), fitted.values(at), rtol=1e-11)
    for kind in ("mean", "prediction"):
        table = fitted.predict(at, kind=kind).to_frame()
        assert_allclose(section.interval(kind=kind, **at), [table["low"], table["high"]], rtol=1e-9)
    assert section.inside(**at).all()


# --- the room ---------------------------------------------------------------------------------------


ROOM = Path(parameters.__file__).parent
WITH_LIBRARIES = ("gather/", "exports/", "export/", "collection.py", "setting_rules.py", "figures.py")
HEADS = [
    path for path in sorted(ROOM.rglob("*.py")) if not path.relative_to(ROOM).as_posix().startswith(WITH_LIBRARIES)
]


@pytest.mark.parametrize("path", HEADS, ids=[path.relative_to(ROOM).as_posix() for path in HEADS])
def test_the_file_knows_no_fitting_package_and_nothing_heavy(path):
    """Imports at the head of each module; scipy may stand inside a function."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    found = {alias.name for node in tree.body if isinstance(node, ast.Import) for alias in node.names}
    found |= {node.module for node in tree.body if isinstance(node, ast.ImportFrom) and node.module}
    assert not [
        name for name in found if name.split(".")[0] in ("pandas", "scipy", "matplotlib", "fit", "ident", "pint")
    ]


def test_reading_and_predicting_load_no_fitting_package(path):
    write(whole(), path)
    code = (
        "import sys; from fitmodels import parameters as p; "
        "p.read(sys.argv[1]).laws['AW'].values(by='1', V=100, f=0.2); "
        "print(*[m for m in sys.modules if m.startswith('fitmodels.fit')])"
    )
    environment = {**os.environ, "PYTHONPATH": str(Path(parameters.__file__).parents[2])}
    done = subprocess.run(
        [sys.executable, "-c", code, str(path)], capture_output=True, text=True, check=True, env=environment
    )
    assert done.stdout.strip() == ""


def test_public_names_are_there_and_reported():
    for name in parameters.__all__:
        assert getattr(parameters, name).__doc__, name
