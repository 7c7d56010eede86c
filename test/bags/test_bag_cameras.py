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

"""Each frame of a recording has the cameras of its own CameraInfo."""

import numpy as np
import pytest
from bag_making import FIRST_NS, PERIOD_NS, RIG, Camera, cameras, make_bag, picture

from stereo_selfcal.bags import BagError, Selection, StereoBag
from stereo_selfcal.core.camera.camera_info import CameraInfoError
from stereo_selfcal.core.camera.rectifier import StereoRectifier
from stereo_selfcal.offline import open_source

ZEROS = {"k": np.zeros(9), "p": np.zeros(12)}


def projection(fx, side):
    shift = -fx * RIG.baseline_m if side == "right" else 0.0
    return {"p": np.array([fx, 0, RIG.cx, shift, 0, RIG.fy, RIG.cy, 0, 0, 0, 1.0, 0])}


def pair(fx_of, **both):
    """Cameras whose fx is that of ``fx_of(index)``; None: no message, 0: uncalibrated."""

    def changes(side):
        def info_of(index):
            fx = fx_of(index)
            return None if fx is None else projection(fx, side) if fx else ZEROS

        return info_of

    return [Camera(side, info_of=changes(side), **both) for side in ("left", "right")]


def focal_lengths(path, selection=None, **options):
    with open_source([path], selection=selection, **options) as source:
        frames = list(source.frames())
        for frame in frames:
            again = source.frame_at(frame.recorded_ns)
            assert (again.cameras, again.rig_problem) == (frame.cameras, frame.rig_problem)
        return [frame.cameras and frame.cameras.rig.fx for frame in frames], source


@pytest.mark.parametrize("kind", ["mcap", "mcap-chunks", "sqlite3", "ros1"])
@pytest.mark.parametrize("delay_ns", [0, 3_000_000, 250_000_000])
def test_each_frame_has_the_camera_info_of_its_stamp(tmp_path, kind, delay_ns):
    """Recorded with it, a little later, and frames later."""
    sides = pair(lambda index: 50.0 if index < 4 else 60.0, info_delay_ns=delay_ns)
    path = make_bag(tmp_path / "bag", sides, n_frames=8, kind=kind)
    found, source = focal_lengths(path)
    assert found == [50.0] * 4 + [60.0] * 4
    assert source.rig.fx == 50.0
    assert focal_lengths(path, Selection(start_s=0.55))[0] == [60.0] * 2


def test_a_stale_first_camera_info_holds_for_its_frame_alone(tmp_path):
    path = make_bag(tmp_path / "bag", pair(lambda index: 60.0 if index else 40.0), n_frames=4)
    assert focal_lengths(path)[0] == [40.0, 60.0, 60.0, 60.0]


def test_uncalibrated_ones_at_the_start_are_skipped_with_a_remark(tmp_path):
    path = make_bag(tmp_path / "bag", pair(lambda index: 50.0 if index > 1 else 0), n_frames=4)
    found, source = focal_lengths(path)
    assert found == [50.0] * 4
    assert [remark for remark in source.remarks if "/stereo/left/camera_info" in remark] == [
        "the first 2 CameraInfo on /stereo/left/camera_info are uncalibrated (all zero) and were skipped: "
        "frames from then are taken with the first calibrated one"
    ]
    assert focal_lengths(path, Selection(start_s=0.1))[0] == [50.0] * 3


def test_uncalibrated_ones_in_the_middle_refuse_their_frames(tmp_path):
    path = make_bag(tmp_path / "bag", pair(lambda index: 0 if index == 2 else 50.0), n_frames=4)
    with open_source([path]) as source:
        frames = list(source.frames())
    assert [bool(frame.rig_problem) for frame in frames] == [False, False, True, False]
    assert "left CameraInfo is uncalibrated" in frames[2].rig_problem


@pytest.mark.parametrize("start_s", [0.0, 0.5, 5.5, 11.5])
def test_a_camera_info_that_came_once_holds_to_the_end(tmp_path, start_s):
    """Also where reading begins long after it, and the second one of two holds from its time on."""
    path = make_bag(tmp_path / "bag", pair({0: 50.0, 10: 60.0}.get), n_frames=120)
    found, source = focal_lengths(path, Selection(start_s=start_s, max_frames=15))
    assert found == [50.0 if start_s + i / 10 < 0.999 else 60.0 for i in range(len(found))]
    assert source.rig.fx == found[0]


def test_rates_of_images_and_camera_info_may_differ(tmp_path):
    path = make_bag(tmp_path / "bag", pair(lambda i: None if i % 3 else 50.0 + i // 9), n_frames=30)
    assert focal_lengths(path)[0] == [50.0 + i // 9 for i in range(30)]


def test_left_and_right_that_change_at_different_times_make_no_pair(tmp_path):
    left, right = pair(lambda index: 50.0 if index < 2 else 60.0)
    right.info_of = pair(lambda index: 50.0 if index < 3 else 60.0)[1].info_of
    with open_source([make_bag(tmp_path / "bag", [left, right], n_frames=5)]) as source:
        frames = list(source.frames())
    assert [frame.cameras and frame.cameras.rig.fx for frame in frames] == [50.0, 50.0, None, 60.0, 60.0]
    assert "P of the cameras differ in fx: 60.0 left, 50.0 right" in frames[2].rig_problem


def test_raw_images_are_rectified_by_their_own_camera_info(tmp_path):
    def moved(index):
        k = np.array([RIG.fx, 0, RIG.cx + (4 if index < 2 else 8), 0, RIG.fy, RIG.cy, 0, 0, 1.0])
        return {"k": k}

    sides = [Camera(side, f"/stereo/{side}/image_raw", info_of=moved) for side in ("left", "right")]
    with open_source([make_bag(tmp_path / "bag", sides, n_frames=4)], raw=True) as source:
        frames = list(source.frames())
    for index, frame in enumerate(frames):
        columns = 4 if index < 2 else 8
        np.testing.assert_array_equal(frame.left[:, :-columns], picture("left", index)[:, columns:])
    assert not frames[1].cameras.sees_as(frames[2].cameras)
    assert frames[2].cameras.sees_as(frames[3].cameras)


def test_bags_of_different_rigs_are_refused_with_both(tmp_path):
    first = make_bag(tmp_path / "first", pair(lambda index: 50.0))
    other = make_bag(tmp_path / "other", pair(lambda index: 40.0), first=3)
    with pytest.raises(BagError) as error:
        open_source([other, first])
    words = str(error.value)
    assert (
        f"{first} has fx of the left camera 50" in words and f"{other} has fx of the left camera 40" in words
    )
    with open_source([other, first], rig=RIG) as source:
        assert len(list(source.frames())) == 6


def test_bags_of_one_rig_are_one_recording(tmp_path):
    first = make_bag(tmp_path / "first", pair(lambda index: 50.0))
    other = make_bag(tmp_path / "other", pair(lambda index: 50.0 if index > 3 else 0), first=3, kind="ros1")
    with open_source([first, other]) as source:
        frames = list(source.frames())
    assert [bool(frame.rig_problem) for frame in frames] == [False] * 3 + [True] + [False] * 2


def test_a_change_does_not_hold_images_back_for_longer_than_a_second(tmp_path):
    """Memory: with a CameraInfo that came once, a frame waits for ten others at 10 Hz."""
    path = make_bag(tmp_path / "bag", pair({0: 50.0}.get), n_frames=40)
    with StereoBag(path) as bag:
        bag.follow_cameras()
        read_ns = []
        (part,) = bag._parts
        inner = part.messages
        part.messages = lambda *a: (read_ns.append(m.recorded_ns) or m for m in inner(*a))
        next(iter(bag.frames()))
    assert read_ns[-1] - FIRST_NS <= 12 * PERIOD_NS  # the second pair is needed as well


def test_frames_of_one_rig_share_their_cameras(tmp_path):
    """They are sent to other processes and back, a thousand times."""
    with open_source([make_bag(tmp_path / "bag", cameras(), n_frames=3)]) as source:
        frames = list(source.frames())
    assert isinstance(frames[0].cameras, StereoRectifier)
    assert frames[0].cameras is frames[1].cameras is frames[2].cameras


@pytest.mark.parametrize("shift_ns", [0, 7_000_000])
def test_two_publishers_on_one_topic_are_refused(tmp_path, shift_ns):
    """With the stamps of the images, and with others that no frame would take."""
    other = [
        Camera(side, image="", info_changes=projection(60.0, side), stamp_shift_ns=shift_ns)
        for side in ("left", "right")
    ]
    path = make_bag(tmp_path / "bag", [*cameras(), *other], n_frames=6)
    with open_source([path]) as source, pytest.raises(CameraInfoError) as error:
        list(source.frames())
    assert "alternates between fx of the left camera 50 and fx of the left camera 60" in str(error.value)
    assert "on /stereo/left/camera_info, as if two cameras" in str(error.value)


def surround():
    """Two cameras calibrated each alone, which look to both sides."""
    made = []
    for side in ("left", "right"):
        p = np.array([50.0, 0, 31.5, 0, 0, 50.0, 23.5, 0, 0, 0, 1, 0])
        name = f"/surround/front_{side}"
        made.append(Camera(side, f"{name}/image_rect", f"{name}/camera_info", info_changes={"p": p}))
    return made


def test_cameras_without_a_baseline_do_not_hide_the_stereo_pair(tmp_path):
    pair = [Camera(s, f"/cam_{s[0]}/image_rect", f"/cam_{s[0]}/camera_info") for s in ("left", "right")]
    with StereoBag(make_bag(tmp_path / "bag", [*surround(), *pair], 1)) as bag:
        assert bag.topics.left.name == "/cam_l/image_rect"


def test_a_pair_without_a_baseline_is_refused_with_the_other_cameras(tmp_path):
    other = Camera("left", "/one/image_rect", "/one/camera_info")
    with (
        StereoBag(make_bag(tmp_path / "bag", [*surround(), other], 1)) as bag,
        pytest.raises(BagError, match=r"baseline of zero .*with --left and --right: /one/image_rect\)$"),
    ):
        bag.follow_cameras()
