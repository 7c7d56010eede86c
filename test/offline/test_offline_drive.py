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

"""A rendered drive with a bump, from the images on: when, and both poses."""

import math

import numpy as np
import pytest

from stereo_selfcal.offline import BagSource, calibrate_recording
from stereo_selfcal.synth.bag import write_bag
from stereo_selfcal.synth.scenes import custom_scene


@pytest.fixture(scope="module")
def bumped(tmp_path_factory):
    path = tmp_path_factory.mktemp("drive") / "bumped"
    scene = custom_scene(
        name="bumped",
        n_frames=26,
        rate_hz=0.1,
        noise_fraction=0.02,
        bump_at_s=130.0,
        bump_height_m=-0.012,
        bump_pitch_rad=math.radians(0.4),
    )
    write_bag(path, scene)
    return path, scene


@pytest.mark.slow
def test_the_bump_is_found_with_both_poses(bumped):
    path, scene = bumped
    with BagSource([path]) as source:
        replay = calibrate_recording(source)
    (change,) = replay.drive.changes
    assert change.at_s == pytest.approx(225.0), "between the frames before and after it"
    # Half the gap between the frames; and more, as lines may be painted at another angle in each of them.
    assert 5.0 <= change.within_s < 20.0
    for segment, truth in zip(
        replay.drive.segments, (scene.scene.extrinsics, scene.bump.extrinsics), strict=True
    ):
        error = segment.estimate.extrinsics.as_array() - truth.as_array()
        assert np.all(np.abs(error) <= 3 * segment.estimate.std.as_array())
    assert replay.estimate.extrinsics == replay.drive.segments[-1].estimate.extrinsics
