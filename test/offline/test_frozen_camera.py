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

"""A camera that hangs in a recording: its frames are refused, in every way to read them."""

import shutil

import bag_making
import cv2
import numpy as np
import pytest
from bag_making import FIRST_NS, PERIOD_NS, RIG, Camera, cameras, make_bag, picture

from stereo_selfcal.bags import BagError, StereoBag
from stereo_selfcal.core.calibrator import Calibrator
from stereo_selfcal.core.rejection import RejectReason
from stereo_selfcal.offline import BagSource, Selection, calibrate_recording
from stereo_selfcal.offline.folder import FolderSource
from stereo_selfcal.offline.frame import FrameCalibrator

STEP_S = PERIOD_NS * 1e-9


@pytest.fixture
def stand(monkeypatch):
    """Have the right camera show the frame of ``last`` in all later ones."""

    def after(last, side="right"):
        monkeypatch.setattr(
            bag_making,
            "picture",
            lambda s, index, rig=RIG: picture(s, min(index, last) if s == side else index, rig),
        )

    return after


def sides(frames):
    return [None if frame.frozen is None else frame.frozen.side for frame in frames]


def make_folder(path, n_frames, shown):
    for side in ("left", "right"):
        (path / side).mkdir(parents=True)
        for index in range(n_frames):
            cv2.imwrite(str(path / side / f"{index:03}.png"), picture(side, shown(side, index)))
    return path


@pytest.mark.parametrize("compressed", [None, "png"])
def test_frames_of_a_bag_know_which_camera_hangs(tmp_path, stand, compressed):
    stand(2)
    with StereoBag(make_bag(tmp_path / "bag", cameras(compressed=compressed), n_frames=6)) as bag:
        frames = list(bag.frames())
        assert sides(frames) == [None, None, None, "right", "right", "right"]
        again = [bag.frame_at(frame.recorded_ns) for frame in frames]
        assert sides(again) == sides(frames)
        assert sides(bag.frames(Selection(every=2))) == [None, None, "right"]
        assert sides(bag.frames(Selection(start_s=3 * STEP_S))) == ["right", "right", "right"]


def test_what_hangs_from_the_start_is_of_unknown_age_in_the_first_frame_too(tmp_path, stand):
    stand(0, "left")
    with StereoBag(make_bag(tmp_path / "bag", cameras(), n_frames=3)) as bag:
        assert sides(bag.frames()) == ["left"] * 3


def test_a_scene_that_stands_is_no_fault(tmp_path, monkeypatch):
    monkeypatch.setattr(bag_making, "picture", lambda side, _index, rig=RIG: picture(side, 0, rig))
    with StereoBag(make_bag(tmp_path / "bag", cameras(), n_frames=3)) as bag:
        assert sides(bag.frames()) == [None] * 3


def test_frames_of_a_folder_know_which_camera_hangs(tmp_path):
    path = make_folder(tmp_path / "folder", 6, lambda side, i: min(i, 2) if side == "right" else min(i, 4))
    expected = [None, None, None, "right", "right", "right"]  # in the last one, both are as before
    with FolderSource(path, RIG) as source:
        frames = list(source.frames())
        assert sides(frames) == expected
    with FolderSource(path, RIG) as source:
        assert sides(source.frame_at(frame.recorded_ns) for frame in reversed(frames)) == expected[::-1]
    with FolderSource(path, RIG, selection=Selection(every=5)) as source:
        assert sides(source.frames()) == [None, "right"]
    for side, shown in (("right", [0, 0, 1]), ("left", [0, 1, 2])):
        for index, each in enumerate(shown):
            shutil.rmtree(tmp_path / "other", ignore_errors=True) if side == "right" and index == 0 else None
            (tmp_path / "other" / side).mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(tmp_path / "other" / side / f"{index}.png"), picture(side, each))
    with FolderSource(tmp_path / "other", RIG) as source:
        assert sides(source.frames()) == ["right", "right", None]


def test_a_frame_with_a_repeated_image_is_refused_and_a_remark_counts_them(tmp_path, stand):
    stand(1)
    with BagSource([make_bag(tmp_path / "bag", cameras(), n_frames=4)]) as source:
        replay = calibrate_recording(source)
    assert [row.reason == str(RejectReason.IMAGE_FROZEN) for row in replay.rows] == [False, False, True, True]
    assert (
        "the right camera repeats its last image, while the left one goes on"
        in replay.rows[2].rejection.message
    )
    first_s = FIRST_NS * 1e-9 + 2 * STEP_S
    assert (
        "the right camera repeats an image while the other one goes on: 2 of 4 frames, the first one of "
        f"{first_s:.3f} s, are refused" in replay.remarks
    )


def test_an_image_that_cannot_be_read_is_told_before_one_that_repeats(tmp_path):
    both = [Camera("left", compressed="png"), Camera("right", compressed=b"no image")]
    with (
        StereoBag(make_bag(tmp_path / "bag", both, n_frames=12)) as bag,
        pytest.raises(BagError, match="cannot be decoded"),
    ):
        list(bag.frames())


def test_images_that_are_recorded_twice_are_frames_once(tmp_path):
    path = make_bag(tmp_path / "bag", [*cameras(), *cameras()], n_frames=3)
    with StereoBag(path) as bag:
        assert len(list(bag.frames())) == 3
        assert bag.any_repeated
        assert bag.remarks == (
            "3 left and 3 right images came twice (one stamp and the same bytes): each counts once",
        )


def test_covered_cameras_repeat_themselves_and_are_told_by_what_they_show(tmp_path, monkeypatch):
    monkeypatch.setattr(
        bag_making,
        "picture",
        lambda side, i, rig=RIG: (
            picture(side, i, rig) if side == "left" else np.zeros((rig.height, rig.width), np.uint8)
        ),
    )
    with StereoBag(make_bag(tmp_path / "bag", cameras(), n_frames=2)) as bag:
        (_, frame) = bag.frames()
    assert frame.frozen is not None
    assert FrameCalibrator(Calibrator(RIG)).calibrate(frame).reason is not RejectReason.IMAGE_FROZEN
