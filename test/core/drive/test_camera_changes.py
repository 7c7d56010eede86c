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

"""Changes of CameraInfo in the middle of a drive, and what is said of them."""

import pytest
from camera_making import cameras

from stereo_selfcal import StereoRig
from stereo_selfcal.core.camera.camera_info import CameraInfoError, InfoReason
from stereo_selfcal.core.camera.rectifier import StereoRectifier
from stereo_selfcal.core.drive.camera_changes import CameraFollower


def followed(*all_cameras):
    follower = CameraFollower()
    return [follower.follow(each, 100.0 + i) for i, each in enumerate(all_cameras)], follower


def test_a_change_is_told_with_its_time_and_both_values():
    (first, change, same), follower = followed(cameras(480.0), cameras(516.6), cameras(516.6))
    assert first is None and same is None
    assert follower.changes == (change,)
    assert (change.before.fx, change.after.fx, change.at_s) == (480.0, 516.6, 101.0)
    assert change.message.startswith(
        "CameraInfo changed at 101.0 s (fx 480 -> 516.6, fy 480 -> 516.6, "
        "P[3] of the right camera -96 -> -103.32)"
    )
    assert change.since == "since CameraInfo changed at 101.0 s"


@pytest.mark.parametrize("rectified", [True, False])
def test_what_is_not_used_of_a_camera_info_may_change(rectified):
    """Zeros are written with and without a sign, and D with and without trailing zeros."""
    _, follower = followed(
        cameras(rectified=rectified, d=[0.0] * 5, binning_x=0, frame_id="a"),
        cameras(rectified=rectified, d=[], binning_x=1, frame_id="b"),
        cameras(rectified=rectified, d=[-0.0] * 4),
    )
    assert follower.changes == ()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"d": [-0.1, 0.01, 0, 0, 0]}, "D () -> (-0.1, 0.01, 0, 0, 0)"),
        ({"k": [510.0, 0, 319.5, 0, 500.0, 239.5, 0, 0, 1]}, "fx of K 500 -> 510"),
        ({"r": [1.0, 0, 0, 0, 0, -1.0, 0, 1.0, 0]}, "R (1, 0, 0"),
    ],
)
def test_the_lens_matters_for_raw_images_alone(changes, words):
    (_, change), _ = followed(cameras(rectified=False), cameras(rectified=False, **changes))
    assert words in change.message
    assert followed(cameras(), cameras(**changes))[0] == [None, None]


def test_a_change_of_the_last_digit_is_shown():
    (_, change), _ = followed(cameras(500.0), cameras(500.0000001))
    assert "fx 500 -> 500.0000001" in change.message


def test_two_rigs_that_alternate_are_refused_with_both():
    a, b = cameras(480.0), cameras(516.6)
    follower = CameraFollower()
    with pytest.raises(
        CameraInfoError, match=r"alternates between fx 480, .* and fx 516\.6.*leave one"
    ) as caught:
        for i, each in enumerate((a, a, b, a, a, b)):
            follower.follow(each, 100.0 + i)
    assert caught.value.reason is InfoReason.ALTERNATING
    assert len(followed(a, b, a)[1].changes) == 2
    follower = CameraFollower()
    for stamp_s, each in ((100.0, a), (100.1, b), (700.0, a), (700.1, b)):  # a driver that was started twice
        follower.follow(each, stamp_s)
    assert len(follower.changes) == 3
    assert len(followed(a, b, cameras(490.0), b, a, b, cameras(500.0))[1].changes) == 6


def test_one_rig_for_all_frames_never_changes():
    rig = StereoRig(640, 480, 500.0, 500.0, 319.5, 239.5, 0.2)
    assert followed(StereoRectifier(rig), StereoRectifier(rig))[1].changes == ()
