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

"""Frames that start from the frame before: the same result as a cold look, whatever the start was."""

from dataclasses import replace
from functools import cache
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from stereo_selfcal import Calibrator, CalibratorConfig, Extrinsics
from stereo_selfcal.core.evidence.frame_evidence import FoundBy
from stereo_selfcal.core.search.known import MOST_AGE_S, KnownCamera, KnownStarts
from stereo_selfcal.core.search.strategy import choose
from stereo_selfcal.offline.bag import BagSource
from stereo_selfcal.synth.scenes import custom_scene

BAGS = Path(__file__).resolve().parents[3] / "bags"
WRONG = np.array([0.060, np.radians(0.5), np.radians(1.2)])
SIGNS = [signs for signs in product((-1, 0, 1), repeat=3) if any(signs)]


def frame_of(seed=0, **changes):
    (frame,) = custom_scene(n_frames=1, noise_fraction=0.02, seed=seed, **changes).frames()
    return frame.left, frame.right


@cache
def two_frames_of_a_ride():
    """A car that pitches by 0.1 deg, rises by 4 mm, drifts by 3 cm and turns by 0.3 deg in 0.1 s."""
    rig = custom_scene(n_frames=1).scene.rig
    calibrator = Calibrator(rig)
    before = calibrator.calibrate_frame(*frame_of(), 10.1)
    images = frame_of(
        1,
        height_m=1.404,
        pitch_rad=np.radians(3.1),
        lane_yaw_rad=np.radians(0.3),
        lateral_offset_m=0.03,
    )
    known = KnownCamera.after(choose(before.attempts), 10.1)
    return calibrator, images, known, calibrator.calibrate_frame(*images, 10.2)


def over_std(result, cold):
    difference = result.extrinsics.as_array() - cold.extrinsics.as_array()
    return np.max(np.abs(difference) / cold.std.as_array())


def test_a_frame_that_starts_from_the_one_before_gives_what_a_cold_look_gives():
    calibrator, images, known, cold = two_frames_of_a_ride()
    result = calibrator.calibrate_frame(*images, 10.2, known=known)
    assert result.known_start and not cold.known_start
    assert [attempt.found_by for attempt in result.attempts] == [FoundBy.KNOWN]
    assert result.genetic is None and "genetic" not in result.stages and "nearby" in result.stages
    assert over_std(result, cold) < 0.2
    np.testing.assert_allclose(result.std.as_array(), cold.std.as_array(), rtol=0.05)
    assert [gate.name for gate in result.gates] == [gate.name for gate in cold.gates]


@pytest.mark.slow
@pytest.mark.parametrize("signs", SIGNS, ids=str)
def test_a_wrong_start_does_not_confirm_itself(signs):
    calibrator, images, known, cold = two_frames_of_a_ride()
    wrong = replace(known, pose=Extrinsics.from_array(known.pose.as_array() + WRONG * signs))
    result = calibrator.calibrate_frame(*images, 10.2, known=wrong)
    assert result.accepted
    if result.known_start:  # the lines are the right ones, and the start is within its uncertainty
        assert over_std(result, cold) < 0.2
    else:
        np.testing.assert_array_equal(result.extrinsics.as_array(), cold.extrinsics.as_array())


def test_a_start_that_claims_to_be_sure_and_is_wrong_leads_to_a_cold_look():
    calibrator, images, known, cold = two_frames_of_a_ride()
    for component, wrong in enumerate(WRONG):
        values = known.pose.as_array()
        values[component] += wrong
        sure = replace(known, pose=Extrinsics.from_array(values), covariance=known.covariance / 100.0)
        confirmed = sure.is_confirmed_by(
            replace(choose(cold.attempts), estimate=with_certainty(choose(cold.attempts).estimate)), 10.2
        )
        assert not confirmed
        assert calibrator.calibrate_frame(*images, 10.2, known=sure).accepted


def with_certainty(estimate):
    """Return an estimate with a tenth of its standard deviations."""
    return replace(
        estimate, terms=tuple(replace(term, covariance=term.covariance / 100.0) for term in estimate.terms)
    )


def test_lines_that_have_gone_lead_to_a_cold_look():
    calibrator, _, known, _ = two_frames_of_a_ride()
    images = frame_of(1, no_lines=True)
    cold = calibrator.calibrate_frame(*images, 10.2)
    result = calibrator.calibrate_frame(*images, 10.2, known=known)
    assert not result.known_start
    assert (result.accepted, result.message) == (cold.accepted, cold.message)


def test_refused_frames_and_faint_lines_tell_the_next_one_nothing():
    calibrator, _, _, cold = two_frames_of_a_ride()
    accepted = choose(cold.attempts)
    assert KnownCamera.after(accepted, 10.2) is not None
    faint = tuple(
        [
            replace(match, left=replace(match.left, votes=1.0), right=replace(match.right, votes=1.0))
            for match in side
        ]
        for side in accepted.hypothesis.other_lines
    )
    hypothesis = replace(accepted.hypothesis, other_lines=faint)
    assert KnownCamera.after(replace(accepted, hypothesis=hypothesis), 10.2) is None
    refused = calibrator.calibrate_frame(*frame_of(no_lines=True))
    assert KnownCamera.after(choose(refused.attempts), 10.2) is None
    assert KnownCamera.after(None, 10.2) is None


def test_the_first_frame_of_each_part_of_the_time_is_cold():
    known = two_frames_of_a_ride()[2]

    def starts_of(stamps_s, cold_every_s=0.5):
        starts, found = KnownStarts(cold_every_s), []
        for stamp_s in stamps_s:
            found.append(starts.of_next(stamp_s) is not None)
            starts.note(replace(known, stamp_s=stamp_s))
        return found

    assert starts_of([10.0, 10.1, 10.2, 10.3, 10.4, 10.5, 10.6]) == [False, *[True] * 4, False, True]
    # A recording that begins in the middle of a part is the same from the next part on.
    assert starts_of([10.3, 10.4, 10.5, 10.6]) == [False, True, False, True]
    assert starts_of([10.0, 10.1, 10.2], cold_every_s=0.0) == [False] * 3
    assert starts_of([0.0, 0.0, 0.0]) == [False] * 3  # images without stamps
    assert starts_of([10.1, 10.0]) == [False] * 2
    assert starts_of([10.0, 10.0 + MOST_AGE_S + 0.01], cold_every_s=10.0) == [False, False]


def test_after_a_frame_that_tells_nothing_the_next_one_is_cold():
    known = two_frames_of_a_ride()[2]
    starts = KnownStarts(0.5)
    starts.of_next(10.0)
    starts.note(replace(known, stamp_s=10.0))
    assert starts.of_next(10.1) is not None
    assert starts.of_next(10.2) is None  # a fault has come up on the frame before, and nothing was noted


def test_a_calibrator_that_is_to_look_cold_gives_what_single_frames_give():
    calibrator, images, _, cold = two_frames_of_a_ride()
    config = CalibratorConfig.from_mapping({"known.cold_every_s": 0.0})
    alone = Calibrator(calibrator.rig, config)
    results = [alone.add(*frame_of(), 10.1), alone.add(*images, 10.2)]
    assert [result.known_start for result in results] == [False, False]
    np.testing.assert_array_equal(results[1].extrinsics.as_array(), cold.extrinsics.as_array())
    following = Calibrator(calibrator.rig)
    assert not following.add(*frame_of(), 10.1).known_start
    assert following.add(*images, 10.2).known_start


@pytest.mark.slow
@pytest.mark.parametrize("name", ["straight_road", "noisy_10", "noisy_20", "curve", "no_lines"])
def test_recordings_give_what_cold_looks_give(name):
    with BagSource([BAGS / name]) as source:
        frames = list(source.frames())
    calibrator = Calibrator(source.rig)
    n_known = 0
    for frame in frames:
        cold = calibrator.calibrate_frame(frame.left, frame.right, frame.stamp_s)
        result = calibrator.calibrate_next(frame.left, frame.right, frame.stamp_s)
        assert (result.accepted, result.reason) == (cold.accepted, cold.reason)
        n_known += result.known_start
        if result.known_start:
            assert over_std(result, cold) < 0.2
    assert n_known == {"straight_road": 8, "noisy_10": 1, "noisy_20": 1}.get(name, 0)
