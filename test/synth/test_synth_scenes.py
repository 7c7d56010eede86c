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

"""The named scenes, made-to-order scenes and random scenes."""

import json
import math

import numpy as np
import pytest

from stereo_selfcal.core.camera.rig import StereoRig
from stereo_selfcal.core.errors import ConfigError
from stereo_selfcal.core.rejection import RejectReason
from stereo_selfcal.synth import scenes
from stereo_selfcal.synth.scenes import NAMED_SCENES, custom_scene, named_scene, random_scene

SMALL_RIG = StereoRig(64, 48, 51.66, 51.66, 31.5, 23.5, 0.1481)


def test_the_committed_bags_have_their_scenes():
    frames = {scene.name: (scene.n_frames, scene.noise_fraction, scene.expected) for scene in NAMED_SCENES}
    assert frames == {
        "straight_road": (10, 0.01, "calibrated"),
        "noisy_10": (2, 0.10, "calibrated"),
        "noisy_20": (2, 0.20, "calibrated"),
        "curve": (3, 0.01, str(RejectReason.LINES_NOT_STRAIGHT)),
        "no_lines": (3, 0.01, str(RejectReason.NO_LINES_FOUND)),
    }


@pytest.mark.parametrize("scene", NAMED_SCENES, ids=lambda scene: scene.name)
def test_truth_is_plain_and_plausible(scene):
    truth = scene.truth()
    assert json.loads(json.dumps(truth)) == truth
    assert 1.2 <= truth["height_m"] <= 1.6
    assert math.radians(2) <= truth["pitch_rad"] <= math.radians(5)
    assert abs(truth["roll_rad"]) <= math.radians(2)
    assert abs(truth["lane_yaw_rad"]) <= math.radians(1)
    assert StereoRig.from_mapping(truth["rig"]) == scenes.PAPER_RIG
    assert scene.scene.left.noise_fraction == scene.scene.right.noise_fraction == truth["noise_fraction"]
    assert named_scene(scene.name) is scene


def test_unknown_scene_lists_the_known_ones():
    with pytest.raises(ConfigError, match=r"'nowhere'.*straight_road"):
        named_scene("nowhere")


def test_frames_come_in_time_and_the_car_moves_on():
    drive = custom_scene(rig=SMALL_RIG, n_frames=3, noise_fraction=0.0, seed=5)
    frames = list(drive.frames())
    assert [frame.stamp_s for frame in frames] == pytest.approx([100.0, 100.1, 100.2])
    assert frames[0].left.shape == (48, 64)
    assert not np.array_equal(frames[0].left, frames[1].left)
    assert drive.scene_at(2).travelled_m == pytest.approx(2 * 1.39)
    assert drive.scene_at(2).extrinsics == drive.scene.extrinsics


def test_a_frame_does_not_depend_on_the_frames_before_it():
    drive = custom_scene(rig=SMALL_RIG, n_frames=3, noise_fraction=0.1, seed=5)
    for alone, (_, left, right) in zip(map(drive.frame, range(3)), drive.frames(), strict=True):
        assert np.array_equal(alone.left, left)
        assert np.array_equal(alone.right, right)


def test_frames_are_rendered_when_asked_for(monkeypatch):
    calls = []
    monkeypatch.setattr(scenes, "render", lambda scene, rng: calls.append(scene) or (None, None))
    frames = custom_scene(n_frames=1000).frames()
    assert not calls
    next(frames)
    assert len(calls) == 1


def test_custom_scene_says_what_to_expect():
    drive = custom_scene(
        height_m=1.3, pitch_rad=0.04, roll_rad=-0.01, lane_yaw_rad=0.02, noise_fraction=0.03, seed=9
    )
    truth = drive.truth()
    asked = {
        "height_m": 1.3,
        "pitch_rad": 0.04,
        "roll_rad": -0.01,
        "lane_yaw_rad": 0.02,
        "noise_fraction": 0.03,
    }
    assert {name: truth[name] for name in asked} == asked
    assert (truth["expected"], truth["line_offsets_m"], truth["seed"]) == ("calibrated", [-1.75, 1.75], 9)
    assert custom_scene(curvature_per_m=0.01).expected == "lines_not_straight"
    assert custom_scene(no_lines=True, curvature_per_m=0.01).expected == "no_lines_found"
    assert custom_scene(no_lines=True).truth()["line_offsets_m"] == []


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"n_frames": 0}, "n_frames is 0"),
        ({"seed": -1}, "seed is -1"),
        ({"height_m": -1.0}, r"height_m is -1\.0"),
        ({"height_m": math.nan}, "height_m is nan"),
        ({"pitch_rad": 1.5}, r"pitch_rad is 1\.5"),
        ({"noise_fraction": 1.5}, r"noise_fraction is 1\.5"),
        ({"curvature_per_m": 1.0}, r"curvature_per_m is 1\.0"),
        ({"curvature_per_m": math.nan}, "curvature_per_m is nan"),
        ({"lane_yaw_rad": math.inf}, "lane_yaw_rad is inf"),
    ],
)
def test_custom_scene_names_a_bad_value(options, match):
    with pytest.raises(ConfigError, match=match):
        custom_scene(**options)


def test_random_scenes_fill_their_ranges_and_repeat():
    rng = np.random.default_rng(0)
    drawn = [random_scene(rng, 0.05) for _ in range(300)]
    ranges = {
        "height_m": ([s.extrinsics.height_m for s in drawn], 1.1, 1.7),
        "pitch_deg": (np.degrees([s.extrinsics.pitch_rad for s in drawn]), 1, 6),
        "roll_deg": (np.degrees([s.extrinsics.roll_rad for s in drawn]), -2, 2),
        "yaw_deg": (np.degrees([s.lane_yaw_rad for s in drawn]), -1.5, 1.5),
        "lateral_offset_m": ([s.lateral_offset_m for s in drawn], -0.4, 0.4),
    }
    for values, low, high in ranges.values():
        assert low <= min(values) < low + 0.05 * (high - low)
        assert high - 0.05 * (high - low) < max(values) <= high
    assert len({s.road.texture_seed for s in drawn}) > 250
    assert random_scene(np.random.default_rng(0), 0.05) == drawn[0]
    # The noise level changes the noise alone.
    assert random_scene(np.random.default_rng(0), 0.2).extrinsics == drawn[0].extrinsics


def test_a_bump_moves_the_mount_and_leaves_it_there():
    drive = custom_scene(
        rig=SMALL_RIG,
        n_frames=5,
        rate_hz=0.5,
        bump_at_s=4.0,
        bump_height_m=-0.02,
        bump_pitch_rad=0.01,
        bump_roll_rad=0.005,
    )
    poses = [drive.scene_at(index).extrinsics for index in range(5)]
    before, after = drive.scene.extrinsics, drive.bump.extrinsics
    assert poses == [before, before, after, after, after]
    assert after.as_array() - before.as_array() == pytest.approx([-0.02, 0.01, 0.005])
    assert [frame.stamp_s for frame in drive.frames()] == [100.0, 102.0, 104.0, 106.0, 108.0]
    assert drive.truth()["bump"] == {
        "stamp_s": 104.0,
        "height_m": after.height_m,
        "pitch_rad": after.pitch_rad,
        "roll_rad": after.roll_rad,
    }
    assert "knocked after 4 s to height 1.3800 m" in drive.description
    assert "bump" not in custom_scene(rig=SMALL_RIG).truth()


def test_a_bump_has_a_time():
    with pytest.raises(ConfigError, match="bump_at_s"):
        custom_scene(rig=SMALL_RIG, bump_pitch_rad=0.01)
