# Copyright 2026 Seed 64efc911 maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The order of the hypotheses: the surface first, lines on it, lines alone; and what ends the search."""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest

from stereo_selfcal import CalibratorConfig, RejectReason
from stereo_selfcal.core.evidence.frame_evidence import FoundBy, FrameObservations, Hypothesis
from stereo_selfcal.core.evidence.gates import GATES
from stereo_selfcal.core.lanes.hypotheses import LaneHypotheses, NoPattern
from stereo_selfcal.core.lanes.line_geometry import BelowPlane
from stereo_selfcal.core.rejection import Bound, GateReading, Rejection
from stereo_selfcal.core.search import strategy
from stereo_selfcal.core.search.attempt import Attempt, Verdict
from stereo_selfcal.core.search.strategy import FrameSearch, choose
from stereo_selfcal.synth.renderer import render
from stereo_selfcal.synth.scenes import random_scene

CONFIG = CalibratorConfig()
LINES_ALONE = CalibratorConfig.from_mapping({"texture.check": 0})
ROAD, SURFACE, HOUGH = FoundBy.ROAD, FoundBy.SURFACE, FoundBy.HOUGH


def rejection(reason):
    return Rejection(reason, "something", 1.0, Bound.MOST, 0.5, "", "do something")


def refused(hypothesis, reason=RejectReason.FITNESS_TOO_LOW, gate="fitness"):
    reading = GateReading(gate, gate, 1.0, Bound.MOST, 0.5, "", False)
    return Attempt(hypothesis, Verdict.REFUSED, "no", rejection(reason), readings=(reading,))


def gave_up(hypothesis):
    return Attempt(hypothesis, Verdict.NOT_FITTED, "no estimate")


def accepted(hypothesis):
    return Attempt(hypothesis, Verdict.ACCEPTED)


@cache
def seen(texture_amplitude, config=CONFIG):
    scene = random_scene(np.random.default_rng(3), texture_amplitude=texture_amplitude)
    images = render(scene, np.random.default_rng(0))
    return FrameObservations.from_images(images, scene.rig, config), scene.rig


def run(search, *verdicts):
    """Return how each hypothesis was found; the attempts at them end as given, the last for all others."""
    attempts, found_by = [], []
    for hypothesis in search.hypotheses(attempts):
        found_by.append(hypothesis.found_by)
        attempts.append(verdicts[min(len(attempts), len(verdicts) - 1)](hypothesis))
    return found_by


def test_lines_on_the_road_come_first_then_the_road_alone_then_lines_alone():
    frame, rig = seen(12.0)
    search = FrameSearch(frame, rig, CONFIG)
    found_by = run(search, refused)
    order = [ROAD, SURFACE, HOUGH]
    assert sorted(set(found_by), key=order.index) == order
    assert found_by == sorted(found_by, key=order.index)
    assert found_by.count(SURFACE) == 1 and found_by[0] is ROAD
    assert search.on_road is not None and search.in_image is search.lines


def test_hypotheses_on_the_road_know_the_surface_and_those_of_lines_alone_do_not():
    frame, rig = seen(12.0)
    attempts = []
    for hypothesis in FrameSearch(frame, rig, CONFIG).hypotheses(attempts):
        on_surface = hypothesis.found_by is not HOUGH
        assert (hypothesis.texture is frame.surface.located) == on_surface
        assert (hypothesis.below is None) == on_surface
        assert (hypothesis.pattern is None) == (hypothesis.found_by is SURFACE)
        assert all(hypothesis.other_lines)
        attempts.append(refused(hypothesis))


def test_the_first_that_is_accepted_ends_the_search():
    frame, rig = seen(12.0)
    search = FrameSearch(frame, rig, CONFIG)
    assert run(search, accepted) == [ROAD]
    # What nobody asked for was not looked for.
    assert search.in_image is None and search.lines is search.on_road
    others = run(FrameSearch(frame, rig, CONFIG), *([refused] * 8))
    n_on_road = others.count(ROAD)
    assert run(FrameSearch(frame, rig, CONFIG), *([refused] * n_on_road), accepted) == others[: n_on_road + 1]


@pytest.mark.parametrize("gate", strategy._CONTRADICTIONS)
def test_a_contradiction_ends_the_search(gate):
    """What the surface or the rows refuse, neither the surface alone nor other lines accept."""
    frame, rig = seen(12.0)
    attempts = []
    for hypothesis in FrameSearch(frame, rig, CONFIG).hypotheses(attempts):
        attempts.append(refused(hypothesis, RejectReason.TEXTURE_DISAGREES, gate))
    assert len(attempts) == 1
    assert gate in {each.key for each in GATES}


def test_a_road_that_is_not_seen_leaves_the_lines_alone():
    frame, rig = seen(0.0)
    assert frame.surface.located is None
    search = FrameSearch(frame, rig, CONFIG)
    assert set(run(search, refused)) == {HOUGH}
    assert search.on_road is None


def test_without_the_check_nothing_is_asked_of_the_surface():
    frame, rig = seen(12.0, LINES_ALONE)
    assert frame.surface is None
    assert set(run(FrameSearch(frame, rig, LINES_ALONE), refused)) == {HOUGH}


@dataclass(frozen=True)
class Pair:
    """Stands for a pair of lines."""

    name: str
    extra: tuple = ()

    def joined(self, extra):
        return replace(self, extra=extra)


@pytest.fixture
def pairs(monkeypatch):
    """Let a frame have five pairs of lines: one crosses the clearest, one is surely below another line."""
    patterns = [Pair(name) for name in ("clearest", "crosses", "below", "third", "fourth", "fifth")]
    depths = [BelowPlane(0.2, 0.0) if pair.name == "below" else BelowPlane() for pair in patterns]
    found = LaneHypotheses((([], []), ([], [])), ([], []), patterns)
    monkeypatch.setattr(strategy, "find_hypotheses", lambda *_: found)
    monkeypatch.setattr(strategy, "lines_below_plane", lambda *_: depths)
    monkeypatch.setattr(strategy, "cross", lambda _, other: other.name == "crosses")
    monkeypatch.setattr(strategy, "find_extra_lines", lambda *_: ("extra",))
    return found


def solved(*verdicts):
    frame, rig = seen(12.0, LINES_ALONE)
    attempts = []
    for hypothesis in FrameSearch(frame, rig, LINES_ALONE).hypotheses(attempts):
        attempts.append(verdicts[min(len(attempts), len(verdicts) - 1)](hypothesis))
    return [(each.pattern.name, each.pattern.extra) for each in attempts]


WITH, WITHOUT = ("clearest", ("extra",)), ("clearest", ())


def test_the_clearest_pair_is_solved_with_and_without_its_extra_lines(pairs):
    assert solved(accepted) == [WITH]
    assert solved(refused) == [WITH, WITHOUT]


@pytest.mark.parametrize("reason", strategy._REASONS_FOR_OTHER_PAIRS)
def test_two_other_pairs_are_solved_where_a_line_may_be_none(pairs, reason):
    def because(hypothesis):
        return refused(hypothesis, reason, "painted")

    assert solved(because) == [WITH, WITHOUT, ("third", ()), ("fourth", ())]
    assert solved(because, because, because, refused) == [WITH, WITHOUT, ("third", ()), ("fourth", ())]
    assert solved(because, because, accepted) == [WITH, WITHOUT, ("third", ())]


def test_a_frame_without_lines_has_no_hypothesis(monkeypatch):
    none = LaneHypotheses((([], []), ([], [])), ([], []), NoPattern(rejection(RejectReason.NO_LINES_FOUND)))
    monkeypatch.setattr(strategy, "find_hypotheses", lambda *_: none)
    frame, rig = seen(12.0, LINES_ALONE)
    search = FrameSearch(frame, rig, LINES_ALONE)
    assert run(search, refused) == []
    assert search.lines is none


def of(found_by, pattern=None):
    return Hypothesis(found_by, pattern)


def test_the_accepted_attempt_is_the_result_then_contradictions_then_lines_then_the_surface():
    pair = Pair("some")
    lines, more = refused(of(ROAD, pair)), refused(of(HOUGH, pair))
    surface, failed = refused(of(SURFACE)), gave_up(of(SURFACE))
    contradicted = refused(of(ROAD, pair), RejectReason.TEXTURE_DISAGREES, "surface_agrees")
    good = accepted(of(HOUGH, pair))
    assert choose([contradicted, good]) is good
    assert choose([surface, lines, contradicted]) is contradicted
    assert choose([surface, failed, lines, more]) is lines
    assert choose([failed, surface]) is surface
    assert choose([failed]) is None and choose([]) is None


def test_refused_by_names_the_gate_and_nothing_where_none_refused():
    assert refused(of(ROAD), gate="rectified").refused_by == "rectified"
    assert accepted(of(ROAD)).refused_by == gave_up(of(ROAD)).refused_by == ""
