"""Detection of chipping, another tool and another batch, on innovations and edges of known truth."""

import json
import sys
from math import log
from pathlib import Path

import numpy as np
import pytest
from fitmodels.live.detection import BatchDetector, ChippingDetector, Detection
from fitmodels.live.edge_estimate import EdgeEstimate
from fitmodels.live.edge_state import LawDeviation
from fitmodels.live.samples import LoadMean, Window

sys.path.insert(0, str(Path(__file__).parent))

from watched_edge import CONDITIONS, laws

sys.path.remove(str(Path(__file__).parent))

NOISE = 0.01


def edge(shift=0.0, chipped=None, n=90, seed=1, detection=None):
    """Alarms (window, kind) of an edge with the mean wear of the law, its power shifted, and after a chip."""
    rng, detection, found = np.random.default_rng(seed), detection or Detection(), []
    estimate, truth = EdgeEstimate(laws(), 0.3), EdgeEstimate(laws(), 0.3)
    level = 0.02 * rng.standard_normal()
    for k in range(n):
        truth.advance(1 / 6, CONDITIONS)
        ln = truth.expected_ln("P", CONDITIONS)[0] + level + shift + NOISE * rng.standard_normal()
        if chipped is not None and k >= chipped:
            ln += 0.342 * log(1.7)
        load = {"P": LoadMean(ln, NOISE, 500)}
        estimate.add(Window(10.0 * k, 10.0 * (k + 1), 1 / 6, CONDITIONS, load))
        for alarm in detection.add(estimate):
            found.append((k, alarm))
            if alarm.kind == "chipping":
                estimate.reopen()
    found += [(n, alarm) for alarm in detection.finish(estimate)]
    return found


def test_an_edge_that_follows_its_laws_gives_no_alarm():
    assert [alarm for seed in range(5) for alarm in edge(seed=seed)] == []


def test_chipping_is_found_within_three_minutes():
    (k, alarm), *_ = edge(chipped=60)
    assert alarm.kind == "chipping"
    assert 60 < k < 78
    assert "may have chipped. Look at it and gauge it" in alarm.text


def test_loads_far_from_their_laws_from_the_beginning_are_of_another_tool():
    assert [(alarm.kind, alarm.text[:50]) for _, alarm in edge(shift=log(2.0), n=30)][:1] == [
        ("tool", "loads are far from their laws since this edge bega")
    ]
    assert edge(shift=log(0.4), n=30)[0][1].kind == "tool"


def test_a_load_thirty_per_cent_low_is_found_within_forty_windows():
    (k, alarm), *_ = edge(shift=log(0.7), n=70)
    assert alarm.kind == "tool"
    assert k <= 46


@pytest.mark.parametrize("factor", [1000.0, 1 / 60, 3.0])
def test_a_wrong_unit_is_no_chipping(factor):
    assert [(k, alarm.kind) for k, alarm in edge(shift=log(factor), n=60)] == [(10, "tool")]


@pytest.mark.parametrize(("shift", "words"), [(0.15, "higher than before"), (-0.15, "lower than before")])
def test_a_shifted_batch_is_found_over_edges(shift, words):
    detection, found = Detection(), []
    for i in range(16):
        found += [(i, alarm) for _, alarm in edge(shift=shift if i >= 6 else 0.0, n=30, seed=i, detection=detection)]
    assert [alarm.kind for _, alarm in found][:1] == ["batch"]
    assert 6 <= found[0][0] < 15
    assert words in found[0][1].text


def test_single_outlying_windows_give_no_alarm():
    rng, detector = np.random.default_rng(5), ChippingDetector()
    for _ in range(3000):
        z = rng.standard_normal() + (rng.random() < 0.1) * rng.choice([-15, 15])
        assert detector.add({"P": z, "Fxz": rng.standard_normal()}, {"P": 1.0, "Fxz": 1.0}) == 0


def test_the_scatter_is_learned():
    """With twice the scatter that the model states, false alarms stay rare."""
    rng, detector = np.random.default_rng(6), ChippingDetector()
    alarms = [detector.add({"P": 2 * rng.standard_normal()}, {"P": 1.0}) for _ in range(3600)]
    assert sum(alarm != 0 for alarm in alarms) <= 3


def test_a_law_that_is_wrong_by_its_own_error_is_no_batch():
    detector = BatchDetector()
    assert not any(detector.finish({"P": LawDeviation(0.06, 0.06, 0.06, 0.3)}) for _ in range(30))


def test_loads_without_a_scatter_or_a_slope_are_left_out():
    assert BatchDetector().finish({"P": LawDeviation(1.0, 0.0, 0.0, 0.3)}) == 0
    assert ChippingDetector().add({"P": 50.0}, {"P": 0.0}) == 0
    assert ChippingDetector().add({}, {}) == 0


def test_snapshots_are_exact():
    detection = Detection()
    edge(seed=3, n=40, detection=detection)
    edge(seed=4, n=7, detection=detection)
    again = Detection.from_json(json.loads(json.dumps(detection.as_json())))
    assert again.as_json() == detection.as_json()
    assert edge(seed=8, chipped=20, n=40, detection=again) == edge(seed=8, chipped=20, n=40, detection=detection)


def test_loads_that_are_unusually_low_are_said_once_and_not_an_alarm():
    sentences = []
    for shift in (0.0, -0.2):
        detection, estimate, truth = Detection(), EdgeEstimate(laws(), 0.3), EdgeEstimate(laws(), 0.3)
        for k in range(45):
            truth.advance(1 / 6, CONDITIONS)
            load = {"P": LoadMean(truth.expected_ln("P", CONDITIONS)[0] + shift, NOISE, 500)}
            estimate.add(Window(10.0 * k, 10.0 * (k + 1), 1 / 6, CONDITIONS, load))
            assert not detection.add(estimate)
            sentences += [(shift, text)] if (text := detection.unusual(estimate)) else []
    assert [shift for shift, _ in sentences] == [-0.2]
    assert "below its law" in sentences[0][1]
    assert "less wear" in sentences[0][1]
