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

"""Grey images from the bytes of image messages. Node and replay use the same conversion."""

from __future__ import annotations

import re
from typing import Any

import cv2
import numpy as np

from ..errors import ImageError, shortened
from ..types import Image
from .bit_depth import Pixels
from .image_header import SUPPORTED_FORMATS, check_image_size, read_image_header

# Names of video codecs, as they stand in ``format``.
_VIDEO = re.compile(r"h\.?26[45]|hevc|av1|vp[89]|mpeg[124]|theora|video", re.IGNORECASE)
_GREY = "mono8", "8UC1"  # cv_bridge uses 8UC1 for a grey array without a named encoding
_COLOUR = {
    "bgr8": (3, cv2.COLOR_BGR2GRAY),
    "rgb8": (3, cv2.COLOR_RGB2GRAY),
    "bgra8": (4, cv2.COLOR_BGRA2GRAY),
    "rgba8": (4, cv2.COLOR_RGBA2GRAY),
}
# ROS names the mosaic by the first two pixels of the first two rows. OpenCV names it by the second and third
# pixel of the second and third row. So RGGB of ROS is BG of OpenCV, not RG.
_BAYER = {
    "bayer_rggb8": cv2.COLOR_BayerBG2GRAY,
    "bayer_bggr8": cv2.COLOR_BayerRG2GRAY,
    "bayer_gbrg8": cv2.COLOR_BayerGR2GRAY,
    "bayer_grbg8": cv2.COLOR_BayerGB2GRAY,
}
# Neighbouring pixels of a picture are alike. Of 18 recorded and rendered roads in 8 to 16 bits, their
# differences were at most as great as with exchanged bytes, both over the spread of all pixels; in the wrong
# order, where the low bits come first, 3.5 times as great or more. Of 8 bits, the order does not matter.
_MOST_ROUGHER = 2.0
_ORDER_ROWS = 60  # rows that are looked at
_BAYER_LEAST_SIDE_PX = 3  # the interpolation reads one pixel on every side

SUPPORTED_ENCODINGS = (*_GREY, "mono16", *_COLOUR, *_BAYER)


def message_to_grey(message: Any, rig_size: tuple[int, int] | None = None) -> Pixels:
    """Convert a sensor_msgs/Image or CompressedImage, of rclpy or rosbags alike.

    Args:
        message: The message.
        rig_size: (width, height) of the images of the rig, None where it is not known.

    Returns:
        (H, W) uint8, or uint16 for images of more than 8 bits, which
        :class:`~stereo_selfcal.core.camera.bit_depth.BitDepth` converts; see :func:`to_grey` and
        :func:`decode_compressed`.

    Raises:
        ImageError: The message cannot be converted.
    """
    if hasattr(message, "format"):
        return decode_compressed(message.data, message.format, rig_size)
    return to_grey(
        message.data,
        message.width,
        message.height,
        message.step,
        message.encoding,
        bool(message.is_bigendian),
    )


def to_grey(data: Any, width: int, height: int, step: int, encoding: str, is_bigendian: bool) -> Pixels:
    """Convert the fields of sensor_msgs/Image to a grey image.

    Args:
        data: Bytes of the image: bytes, array.array, memoryview or (N,) uint8 array.
        width: Columns [px].
        height: Rows [px].
        step: Bytes from the start of a row to the next; may exceed the row.
        encoding: One of :data:`SUPPORTED_ENCODINGS`.
        is_bigendian: Byte order of mono16.

    Returns:
        (height, width) uint8, for mono16 uint16, C-contiguous; a read-only view of ``data`` for mono8 without
        padding.

    Raises:
        ImageError: The encoding is not supported, or sizes and bytes do not agree.
    """
    pixel_bytes = _pixel_bytes(encoding)
    width, height, step = int(width), int(height), int(step)
    if width <= 0 or height <= 0:
        raise ImageError(f"image of {width} x {height} pixels is empty: check the camera driver")
    if step < width * pixel_bytes:
        raise ImageError(
            f"step is {step} bytes, a row of {width} pixels in {encoding} needs at least "
            f"{width * pixel_bytes}: check the camera driver"
        )
    buffer = np.frombuffer(data, dtype=np.uint8)
    if buffer.size < step * height:
        raise ImageError(
            f"image has {buffer.size} bytes, step {step} x height {height} needs at least {step * height}: "
            "the message is cut short"
        )
    # The strides skip the padding of the rows without a copy.
    pixels: Image = np.ndarray(
        (height, width, pixel_bytes), dtype=np.uint8, buffer=buffer.data, strides=(step, pixel_bytes, 1)
    )
    if encoding in _COLOUR:
        return np.asarray(cv2.cvtColor(pixels, _COLOUR[encoding][1]), dtype=np.uint8)
    if pixel_bytes == 2:
        values = np.ascontiguousarray(pixels).view(">u2" if is_bigendian else "<u2")[:, :, 0]
        image = np.ascontiguousarray(values, dtype=np.uint16)
        _check_byte_order(image, is_bigendian)
        return image
    grey = np.ascontiguousarray(pixels[:, :, 0])
    return _demosaic(grey, encoding) if encoding in _BAYER else grey


def decode_compressed(data: Any, image_format: str, rig_size: tuple[int, int] | None = None) -> Pixels:
    """Decode the fields of sensor_msgs/CompressedImage to a grey image.

    Args:
        data: Bytes of the compressed file, in one of
            :data:`~stereo_selfcal.core.camera.image_header.SUPPORTED_FORMATS`.
        image_format: Field ``format`` of the message, such as "jpeg" or "rgb8; jpeg compressed bgr8". It is
            used in error messages, and to refuse a format that would be misread.
        rig_size: (width, height) of the images of the rig, None where it is not known. The header of an image
            that is far larger is not believed: decoding it could take all memory.

    Returns:
        (H, W) uint8, or uint16 for an image of 16 bits, C-contiguous.

    Raises:
        ImageError: The bytes contain no image, one that is too large, or a Bayer mosaic.
    """
    if image_format.rpartition("compressed")[2].strip().startswith("bayer_"):
        raise ImageError(
            f"compressed image in format {shortened(image_format)} is a Bayer mosaic: "
            "publish it as a raw image"
        )
    buffer = np.frombuffer(data, dtype=np.uint8)
    header = read_image_header(buffer.data) if buffer.size else None
    if header is not None:
        check_image_size(header, rig_size)
    # The geometry refers to the rows and columns of the sensor, so an orientation tag is ignored.
    flags = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
    try:
        image = None if header is None else cv2.imdecode(buffer, flags)
    except cv2.error:
        image = None
    if image is None:
        raise ImageError(
            f"compressed image in format {shortened(image_format)} with {buffer.size} bytes cannot be "
            f"decoded: {', '.join(SUPPORTED_FORMATS)} are supported{_remedy(image_format)}"
        )
    if image.dtype not in (np.uint8, np.uint16):
        raise ImageError(
            f"compressed image in format {shortened(image_format)} has pixels of type {image.dtype}: "
            "8 or 16 bits are read"
        )
    return np.ascontiguousarray(image)


def _check_byte_order(image: Pixels, is_bigendian: bool) -> None:
    """Refuse 16-bit pixels that are a picture with their bytes exchanged, and noise as they are.

    Raises:
        ImageError: They are.
    """
    rows = image[:: max(1, image.shape[0] // _ORDER_ROWS)]
    declared, exchanged = _roughness(rows), _roughness(rows.byteswap())
    if declared > _MOST_ROUGHER * exchanged:
        said, right = ("big", "little") if is_bigendian else ("little", "big")
        ratio = declared / max(exchanged, 1e-9)
        raise ImageError(
            f"the bytes of mono16 are in the wrong order: as {said}-endian numbers (is_bigendian is "
            f"{int(is_bigendian)}), neighbouring pixels differ {ratio:.3g} times as much as {right}-endian, "
            f"at most {_MOST_ROUGHER:g} times are allowed: correct is_bigendian in the camera driver"
        )


def _roughness(rows: Pixels) -> float:
    """Return the mean difference of neighbours over the spread of all pixels; 0 where all are equal."""
    values = rows.astype(np.float64)
    spread = float(values.std())
    return float(np.abs(np.diff(values)).mean()) / spread if spread and rows.shape[1] > 1 else 0.0


def _remedy(image_format: str) -> str:
    """Return how images are made of video, "" for other formats."""
    return (
        "; 'ros2 run image_transport republish' makes images of video" if _VIDEO.search(image_format) else ""
    )


def _pixel_bytes(encoding: str) -> int:
    """Return the number of bytes of one pixel.

    Raises:
        ImageError: The encoding is not supported.
    """
    if encoding in _GREY or encoding in _BAYER:
        return 1
    if encoding == "mono16":
        return 2
    if encoding in _COLOUR:
        return _COLOUR[encoding][0]
    raise ImageError(
        f"image encoding {shortened(encoding)} is not supported: "
        f"publish one of {', '.join(SUPPORTED_ENCODINGS)}"
    )


def _demosaic(mosaic: Image, encoding: str) -> Image:
    height, width = mosaic.shape
    if min(height, width) < _BAYER_LEAST_SIDE_PX:
        raise ImageError(
            f"{encoding} image of {width} x {height} pixels is too small: each side needs "
            f"at least {_BAYER_LEAST_SIDE_PX} pixels"
        )
    return np.asarray(cv2.cvtColor(mosaic, _BAYER[encoding]), dtype=np.uint8)
