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

"""Images of 12 bits in bags and folders become what they would be with 8, and it is said."""

import cv2
import numpy as np
import pytest
from bag_making import RIG, Camera, cameras, make_bag, picture

from stereo_selfcal.offline.opening import open_source

SAID = "no value above 4095: they are taken as images of 12 bits"


def values(side, index):
    """The picture of a 12-bit camera: white is 4080."""
    return np.clip(picture(side, index).astype(np.uint16) * 16 * (1 + index), 0, 4080)


def png(side, index, shift=0):
    return cv2.imencode(".png", values(side, index) << shift)[1].tobytes()


def folder_of(tmp_path, n_frames):
    for side in ("left", "right"):
        (tmp_path / side).mkdir()
        for index in range(n_frames):
            (tmp_path / side / f"{index}.png").write_bytes(png(side, index))
    return tmp_path


def test_images_of_12_bits_in_a_folder_are_scaled_by_one_number(tmp_path):
    with open_source([folder_of(tmp_path, 4)], rig=RIG) as source:
        frames = list(source.frames())
        assert SAID in " ".join(source.remarks)
        again = source.frame_at(frames[0].recorded_ns)
    for index, frame in enumerate(frames):
        np.testing.assert_array_equal(frame.left, values("left", index) >> 4)
        np.testing.assert_array_equal(frame.right, values("right", index) >> 4)
    np.testing.assert_array_equal(again.left, frames[0].left)


def test_a_frame_that_is_read_alone_is_the_same_image(tmp_path):
    """The first frame uses 11 bits only; that the camera has 12 is seen in the others."""
    folder = folder_of(tmp_path, 4)
    with open_source([folder], rig=RIG) as source:
        first = next(iter(source.frames()))
    np.testing.assert_array_equal(first.left, values("left", 0) >> 4)


@pytest.mark.parametrize("kind", ["mcap", "sqlite3", "ros1"])
@pytest.mark.parametrize("packed", [True, False])
def test_images_of_12_bits_in_a_bag_are_scaled_and_told(tmp_path, kind, packed):
    if packed:
        sides = [Camera(side, compressed=png(side, 2)) for side in ("left", "right")]
    else:
        sides = cameras(encoding="mono16")
    with open_source([make_bag(tmp_path / "bag", sides, kind=kind)]) as source:
        frames = list(source.frames())
        assert SAID in source.remarks[0]
    for index, frame in enumerate(frames):
        expected = values("left", 2) if packed else picture("left", index).astype(np.uint16) * 16
        np.testing.assert_array_equal(frame.left, expected >> 4)


def test_nothing_is_said_of_images_that_use_all_16_bits(tmp_path):
    sides = [Camera(side, compressed=png(side, 2, 4)) for side in ("left", "right")]
    with open_source([make_bag(tmp_path / "bag", sides)]) as source:
        frames = list(source.frames())
        assert source.remarks == ()
    np.testing.assert_array_equal(frames[0].left, values("left", 2) >> 4)
