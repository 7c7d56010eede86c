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

"""Conversion of image messages to grey: every encoding, padding, byte order, and what is refused."""

import array
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stereo_selfcal.core.camera.image_messages import (
    SUPPORTED_ENCODINGS,
    decode_compressed,
    message_to_grey,
    to_grey,
)
from stereo_selfcal.core.errors import ImageError

H, W = 6, 10
CHANNELS = {"bgr8": "bgr", "rgb8": "rgb", "bgra8": "bgra", "rgba8": "rgba"}
LUMA = {"r": 0.299, "g": 0.587, "b": 0.114}  # ITU-R BT.601, as OpenCV documents it


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def padded(rows, padding):
    """Return (bytes, step) of rows (H, N) uint8 with ``padding`` bytes of 255 after each."""
    wide = np.full((rows.shape[0], rows.shape[1] + padding), 255, np.uint8)
    wide[:, : rows.shape[1]] = rows
    return wide.tobytes(), wide.shape[1]


def is_grey_image(image, shape=(H, W), dtype=np.uint8):
    return image.shape == shape and image.dtype == dtype and image.flags.c_contiguous


@pytest.mark.parametrize("padding", [0, 1, 7])
@pytest.mark.parametrize("encoding", ["mono8", "8UC1"])
def test_mono8(rng, encoding, padding):
    image = rng.integers(0, 256, (H, W), dtype=np.uint8)
    data, step = padded(image, padding)
    grey = to_grey(data, W, H, step, encoding, False)
    assert is_grey_image(grey)
    np.testing.assert_array_equal(grey, image)


def test_mono8_without_padding_is_not_copied(rng):
    image = rng.integers(0, 256, (H, W), dtype=np.uint8)
    assert np.shares_memory(to_grey(image.ravel(), W, H, W, "mono8", False), image)


@pytest.mark.parametrize("kind", [bytes, bytearray, memoryview, lambda b: array.array("B", b)])
def test_every_kind_of_bytes(kind):
    grey = to_grey(kind(bytes(range(H * W))), W, H, W, "mono8", False)
    np.testing.assert_array_equal(grey.ravel(), np.arange(H * W))


@pytest.mark.parametrize("padding", [0, 1, 2, 5])
@pytest.mark.parametrize("big", [False, True])
def test_mono16_keeps_all_bits(rng, big, padding):
    image = rng.integers(0, 65536, (H, W), dtype=np.uint16)
    rows = image.astype(">u2" if big else "<u2").view(np.uint8).reshape(H, 2 * W)
    data, step = padded(rows, padding)
    grey = to_grey(data, W, H, step, "mono16", big)
    assert is_grey_image(grey, dtype=np.uint16)
    np.testing.assert_array_equal(grey, image)


@pytest.mark.parametrize("padding", [0, 1, 4])
@pytest.mark.parametrize("encoding", CHANNELS)
def test_colour(rng, encoding, padding):
    order = CHANNELS[encoding]
    image = rng.integers(0, 256, (H, W, len(order)), dtype=np.uint8)
    data, step = padded(image.reshape(H, -1), padding)
    grey = to_grey(data, W, H, step, encoding, False)
    assert is_grey_image(grey)
    expected = sum(LUMA[c] * image[:, :, i] for i, c in enumerate(order) if c in LUMA)
    assert np.abs(grey - expected).max() <= 1


@pytest.mark.parametrize("padding", [0, 3])
@pytest.mark.parametrize("pattern", ["rggb", "bggr", "gbrg", "grbg"])
@pytest.mark.parametrize("colour", ["r", "g", "b"])
def test_bayer_of_one_colour(pattern, colour, padding):
    """Light of one colour excites its own pixels only; the name gives them row by row."""
    mosaic = np.zeros((H, W), np.uint8)
    for i, letter in enumerate(pattern):
        if letter == colour:
            mosaic[i // 2 :: 2, i % 2 :: 2] = 200
    data, step = padded(mosaic, padding)
    grey = to_grey(data, W, H, step, f"bayer_{pattern}8", False)
    assert is_grey_image(grey)
    assert np.abs(grey[1:-1, 1:-1] - 200 * LUMA[colour]).max() <= 1.5


@pytest.mark.parametrize("encoding", ["yuv422", "32FC1", "16UC1", "8UC3", "bayer_rggb16", "", "MONO8"])
def test_other_encodings_are_refused_by_name(encoding):
    with pytest.raises(ImageError) as refusal:
        to_grey(bytes(1000), W, H, W, encoding, False)
    assert repr(encoding) in str(refusal.value)
    assert all(supported in str(refusal.value) for supported in SUPPORTED_ENCODINGS)


@pytest.mark.parametrize(
    ("width", "height", "step", "encoding", "size", "words"),
    [
        (0, H, 0, "mono8", 100, "image of 0 x 6 pixels is empty"),
        (W, 0, W, "mono8", 100, "image of 10 x 0 pixels is empty"),
        (W, H, W - 1, "mono8", 100, "step is 9 bytes, a row of 10 pixels in mono8 needs at least 10"),
        (W, H, 2 * W - 1, "mono16", 1000, "step is 19 bytes, a row of 10 pixels in mono16 needs at least 20"),
        (W, H, 3 * W - 1, "bgr8", 1000, "step is 29 bytes, a row of 10 pixels in bgr8 needs at least 30"),
        (W, H, 0, "rgba8", 1000, "step is 0 bytes"),
        (W, H, W, "mono8", H * W - 1, "image has 59 bytes, step 10 x height 6 needs at least 60"),
        (W, H, W, "mono8", 0, "image has 0 bytes"),
        (2, 2, 2, "bayer_rggb8", 4, "bayer_rggb8 image of 2 x 2 pixels is too small"),
    ],
)
def test_sizes_that_do_not_agree(width, height, step, encoding, size, words):
    with pytest.raises(ImageError, match=words):
        to_grey(bytes(size), width, height, step, encoding, False)


def test_bytes_beyond_the_image_are_ignored():
    assert is_grey_image(to_grey(bytes(1000), W, H, W, "mono8", False))


@given(
    st.sampled_from(SUPPORTED_ENCODINGS),
    st.integers(0, 40),
    st.integers(0, 40),
    st.integers(0, 200),
    st.integers(0, 9000),
    st.booleans(),
)
def test_any_header_gives_an_image_or_a_refusal(encoding, width, height, step, size, big):
    try:
        grey = to_grey(bytes(size), width, height, step, encoding, big)
    except ImageError:
        return
    assert is_grey_image(grey, (height, width), np.uint16 if encoding == "mono16" else np.uint8)


@pytest.mark.parametrize("suffix", [".png", ".bmp"])
def test_compressed_without_loss(rng, suffix):
    image = rng.integers(0, 256, (H, W), dtype=np.uint8)
    data = cv2.imencode(suffix, image)[1].tobytes()
    grey = decode_compressed(data, suffix[1:])
    assert is_grey_image(grey)
    np.testing.assert_array_equal(grey, image)


def test_compressed_colour_jpeg():
    image = np.full((H, W, 3), (10, 100, 200), np.uint8)
    grey = decode_compressed(
        array.array("B", cv2.imencode(".jpg", image)[1].tobytes()), "rgb8; jpeg compressed bgr8"
    )
    assert is_grey_image(grey)
    assert np.abs(grey - (0.114 * 10 + 0.587 * 100 + 0.299 * 200)).max() <= 3


def test_compressed_16_bit_png_keeps_all_bits(rng):
    image = rng.integers(0, 65536, (H, W), dtype=np.uint16)
    grey = decode_compressed(cv2.imencode(".png", image)[1].tobytes(), "mono16; png compressed mono16")
    np.testing.assert_array_equal(grey, image)


@pytest.mark.parametrize("data", [b"", b"\0" * 100, b"\xff\xd8\xff\xe0 not a jpeg"])
def test_undecodable_bytes_are_refused_with_their_format(data):
    with pytest.raises(ImageError, match=rf"format 'h264' with {len(data)} bytes cannot be decoded"):
        decode_compressed(data, "h264")


def test_compressed_mosaic_is_refused(rng):
    data = cv2.imencode(".png", rng.integers(0, 256, (H, W), dtype=np.uint8))[1].tobytes()
    with pytest.raises(ImageError, match="Bayer"):
        decode_compressed(data, "bayer_rggb8; png compressed bayer_rggb8")


def test_messages_of_both_kinds():
    image = np.arange(H * W, dtype=np.uint8).reshape(H, W)
    raw = SimpleNamespace(data=image.ravel(), width=W, height=H, step=W, encoding="mono8", is_bigendian=0)
    compressed = SimpleNamespace(data=cv2.imencode(".png", image)[1].tobytes(), format="png")
    np.testing.assert_array_equal(message_to_grey(raw), image)
    np.testing.assert_array_equal(message_to_grey(compressed), image)


def road_of_12_bits(left_aligned):
    rng = np.random.default_rng(5)
    v, u = np.mgrid[0:120, 0:160]
    grey = 40 + v + u // 2 + 40 * (np.abs(u - 80 - v / 2) < 3)  # a stripe on a road that is brighter below
    image = (grey * 16 + rng.integers(0, 16, grey.shape)).astype(np.uint16)
    return image << 4 if left_aligned else image


@pytest.mark.parametrize("left_aligned", [False, True])
@pytest.mark.parametrize("big", [False, True])
def test_a_wrong_byte_order_of_mono16_is_named_and_the_right_one_is_read(big, left_aligned):
    image = road_of_12_bits(left_aligned)
    data = image.astype(">u2" if big else "<u2").tobytes()
    np.testing.assert_array_equal(to_grey(data, 160, 120, 320, "mono16", big), image)
    orders = ("little-endian numbers (is_bigendian is 0)", "big-endian numbers (is_bigendian is 1)")
    with pytest.raises(ImageError, match="the bytes of mono16 are in the wrong order") as refusal:
        to_grey(data, 160, 120, 320, "mono16", not big)
    assert orders[not big] in str(refusal.value)
    assert "correct is_bigendian in the camera driver" in str(refusal.value)


@pytest.mark.parametrize("big", [False, True])
def test_images_that_tell_no_byte_order_are_read(big, rng):
    """Noise, a single value, and 8 bits in the low or in the high byte."""
    low = road_of_12_bits(False) >> 4
    for image in (
        rng.integers(0, 2**16, (120, 160)).astype(np.uint16),
        np.full((120, 160), 700, np.uint16),
        low,
        low << 8,
    ):
        assert to_grey(image.tobytes(), 160, 120, 320, "mono16", big).shape == (120, 160)
    assert to_grey(b"\x01\x02" * 5, 1, 5, 2, "mono16", big).shape == (5, 1)


@pytest.mark.parametrize(("name", "video"), [("h264", True), ("hevc", True), ("jpeg", False), ("png", False)])
def test_video_is_refused_with_what_makes_images_of_it(name, video):
    with pytest.raises(ImageError) as caught:
        decode_compressed(b"\x00\x00\x00\x01\x67", name)
    assert ("'ros2 run image_transport republish' makes images of video" in str(caught.value)) == video
