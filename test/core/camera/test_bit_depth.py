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

"""Images of 10, 12 and 14 bits in 16: the bits that are there are used, alike in all images of a stream."""

import numpy as np
import pytest

from stereo_selfcal.core.camera.bit_depth import BitDepth, depth_of


def values(bits, shape=(50, 60)):
    """An image of that many bits, from black to white."""
    return np.linspace(0, 2**bits - 1, shape[0] * shape[1]).astype(np.uint16).reshape(shape)


@pytest.mark.parametrize("bits", [8, 10, 12, 14, 16])
def test_all_usual_depths_become_the_same_image(bits):
    depth = BitDepth()
    left, right = depth.to_8_bits(values(bits), values(bits))
    np.testing.assert_array_equal(left, values(bits) >> (bits - 8))
    np.testing.assert_array_equal(right, left)
    assert left.dtype == np.uint8
    assert (f"taken as images of {bits} bits" in depth.remark) == (bits < 16)
    if bits < 16:
        assert f"no value above {2**bits - 1}" in depth.remark


@pytest.mark.parametrize(
    ("greatest", "bits"), [(0, 8), (255, 8), (256, 10), (1023, 10), (1024, 12), (20_000, 16)]
)
def test_depth_is_the_smallest_usual_one_in_which_the_values_fit(greatest, bits):
    image = np.zeros((10, 10), np.uint16)
    image[:5] = greatest
    assert depth_of(image) == bits


def test_both_cameras_are_scaled_alike_by_the_brighter_one():
    left, right = BitDepth().to_8_bits(values(12), values(12) // 8)
    np.testing.assert_array_equal(left, values(12) >> 4)
    np.testing.assert_array_equal(right, (values(12) // 8) >> 4)


def test_a_dark_frame_of_a_stream_stays_dark():
    depth = BitDepth()
    depth.to_8_bits(values(12), values(12))
    dark, _ = depth.to_8_bits(values(12) // 16, values(12) // 16)
    np.testing.assert_array_equal(dark, (values(12) // 16) >> 4)


def test_a_recording_gives_a_frame_the_same_image_in_any_order():
    frames = [values(12) // 8, values(12), values(14), values(12) // 16]
    images = []
    for order in ((0, 1, 2, 3), (3, 2, 1, 0), (2, 0, 3, 1)):
        depth = BitDepth(lambda: [values(12)], lasting=False)
        found = {number: depth.to_8_bits(frames[number], frames[number])[0] for number in order}
        images.append([found[number] for number in range(4)])
    for other in images[1:]:
        np.testing.assert_array_equal(images[0], other)
    np.testing.assert_array_equal(images[0][0], frames[0] >> 4)
    np.testing.assert_array_equal(images[0][2], frames[2] >> 6)  # brighter than any that was looked up


def test_a_few_broken_pixels_do_not_make_an_image_black():
    image = np.tile(values(12, (50, 100)), (20, 10))
    broken = image.copy()
    broken[7, :5] = 65_535
    left, right = BitDepth().to_8_bits(broken, image)
    np.testing.assert_array_equal(right, image >> 4)
    assert (left[7, :5] == 255).all()
    assert depth_of(np.where(np.arange(image.size).reshape(image.shape) < 100, 65_535, image)) == 16


def test_images_of_8_bits_stay_as_they_are():
    image = values(8).astype(np.uint8)
    depth = BitDepth(lambda: pytest.fail("nobody asks"))
    left, right = depth.to_8_bits(image, image)
    assert left is image
    assert right is image
    assert depth.remark == ""
    mixed, _ = BitDepth().to_8_bits(image, values(12))
    assert mixed is image
