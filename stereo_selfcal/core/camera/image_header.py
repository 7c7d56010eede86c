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

"""What the header of a compressed image states, read without decoding it.

A decoder allocates what the header states before it looks at the pixels: 380 bytes can ask for gigabytes. So
the size is read here first. The formats are those that cameras are recorded in; for each, the fields are
where its specification has them: PNG (ISO 15948), JPEG (ITU-T T.81), BMP, TIFF 6.0, Netpbm, WebP.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable
from typing import NamedTuple

from ..errors import ImageError

# An image of 8192 x 8192 pixels: three times those of the largest cameras on cars (20 megapixels). To decode
# one takes 0.6 GB at most (a progressive JPEG keeps six bytes of coefficients for each pixel, a PNG of 16
# bits eight bytes).
MOST_PIXELS = 2**26
# Where the size of the rig is known, an image may have four times its rows and columns: the CameraInfo may be
# binned, and another resolution is refused with a better reason, after decoding. Up to this many pixels it is
# in any case.
_TIMES_THE_RIG = 16
_HARMLESS_PIXELS = 2**22
# A progressive JPEG usually has ten passes over the image. Each takes time for all pixels, and hardly a byte.
_MOST_SCANS = 64
# Bytes a decoder may keep for a pixel: four channels of 16 bits.
_MOST_PIXEL_BYTES = 8

_NETPBM = re.compile(rb"P([1-7])(?:\s|#[^\n]*\n)")
_NETPBM_NUMBER = re.compile(rb"(?:\s|#[^\n]*\n)*(\d{1,10})(?=[\s#])")
_PAM_SIDE = re.compile(rb"^(WIDTH|HEIGHT)\s+(\d{1,10})\s*$", re.MULTILINE)
# Types BYTE, SHORT, LONG and LONG8, and their signed ones, all of which libtiff takes for a size.
_TIFF_SIZES = {1: "B", 6: "B", 3: "H", 8: "H", 4: "I", 9: "I", 16: "Q", 17: "Q"}
_TIFF_WIDTH, _TIFF_HEIGHT, _TIFF_BITS, _TIFF_SAMPLES = 256, 257, 258, 277
_TIFF_TILE_WIDTH, _TIFF_TILE_HEIGHT = 322, 323
_MOST_TIFF_ENTRIES = 1_000
_PNG_SIGNATURE_BYTES = 8
_PNG_CHUNK_BYTES = 12  # length, kind and checksum
# Frame headers of JPEG: SOF0 to SOF15 without DHT (C4), JPG (C8) and DAC (CC).
_JPEG_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_JPEG_WITHOUT_LENGTH = frozenset({0x01, *range(0xD0, 0xD9)})
# Far more than the longest comments of a Netpbm file.
_LONGEST_TEXT_HEADER = 65_536


class ImageHeader(NamedTuple):
    """What an image file states of itself.

    Attributes:
        kind: Name of the format.
        width: Columns [px].
        height: Rows [px].
    """

    kind: str
    width: int
    height: int


def read_image_header(content: bytes | memoryview) -> ImageHeader | None:
    """Return the format and size that an image file states, None where it is of no known format or damaged.

    Args:
        content: The file.

    Raises:
        ImageError: To decode it would take long, or memory beyond its size.
    """
    start = bytes(content[:16])
    for kind, is_kind, read in _FORMATS:
        if is_kind(start):
            try:
                return ImageHeader(kind, *read(memoryview(content)))
            except ImageError:
                raise
            except (struct.error, IndexError, ValueError):
                return None
    return None


def most_pixels(rig_size: tuple[int, int] | None) -> int:
    """Return how many pixels an image may have.

    Args:
        rig_size: (width, height) of the images of the rig, None where it is not known.
    """
    if rig_size is None:
        return MOST_PIXELS
    # The rig may come from the same recording, so its size is not believed without a limit either.
    return min(MOST_PIXELS, max(_TIMES_THE_RIG * rig_size[0] * rig_size[1], _HARMLESS_PIXELS))


def check_image_size(header: ImageHeader, rig_size: tuple[int, int] | None) -> None:
    """Refuse an image that is too large to be decoded.

    Args:
        header: What it states.
        rig_size: (width, height) of the images of the rig, None where it is not known.

    Raises:
        ImageError: It has too many pixels.
    """
    limit = most_pixels(rig_size)
    if header.width * header.height <= limit:
        return
    stated = f"{header.kind} image states {header.width} x {header.height} pixels"
    if rig_size is not None and limit < MOST_PIXELS:
        raise ImageError(
            f"{stated}, the rig has {rig_size[0]} x {rig_size[1]}: it is not decoded; check that the topic "
            "or file is of this camera"
        )
    raise ImageError(f"{stated}, more than the {limit / 1e6:.0f} million that are decoded: it is damaged")


def _png(content: memoryview) -> tuple[int, int]:
    # Some versions of OpenCV take memory for a chunk before they see that the file is shorter.
    position = _PNG_SIGNATURE_BYTES
    while position < len(content):
        length, kind = struct.unpack_from(">I4s", content, position)
        position += _PNG_CHUNK_BYTES + length
        if position > len(content):
            raise ValueError("a chunk is longer than the file")
        if kind == b"IEND":
            break
    width, height = struct.unpack_from(">II", content, 16)
    return width, height


def _jpeg(content: memoryview) -> tuple[int, int]:
    """Return the size in the first frame header, at which a decoder allocates."""
    data, position = bytes(content), 2
    while True:
        position = data.index(b"\xff", position) + 1
        while data[position] == 0xFF:  # fill bytes
            position += 1
        marker = data[position]
        position += 1
        if marker == 0 or marker in _JPEG_WITHOUT_LENGTH:
            continue
        if marker in _JPEG_FRAMES:
            break
        position += struct.unpack_from(">H", data, position)[0]
    # In the pixels, a byte of FF is followed by 0: FF DA is the start of a scan.
    if data.count(b"\xff\xda", position) > _MOST_SCANS:
        raise ImageError(
            f"JPEG image has more than {_MOST_SCANS} passes over its pixels: it would take minutes; "
            "it is damaged or made to do harm"
        )
    height, width = struct.unpack_from(">HH", data, position + 3)
    return width, height


def _bmp(content: memoryview) -> tuple[int, int]:
    (size,) = struct.unpack_from("<I", content, 14)
    width, height = struct.unpack_from("<HH" if size == 12 else "<ii", content, 18)
    return abs(width), abs(height)


def _tiff(content: memoryview) -> tuple[int, int]:
    order = "<" if bytes(content[:2]) == b"II" else ">"
    big = struct.unpack_from(f"{order}H", content, 2)[0] == 43
    (position,) = struct.unpack_from(f"{order}{'Q' if big else 'I'}", content, 8 if big else 4)
    (count,) = struct.unpack_from(f"{order}{'Q' if big else 'H'}", content, position)
    if count > _MOST_TIFF_ENTRIES:
        raise ValueError("too many entries")
    position += 8 if big else 2
    values: dict[int, int] = {}
    for entry in range(position, position + count * (20 if big else 12), 20 if big else 12):
        tag, kind = struct.unpack_from(f"{order}HH", content, entry)
        if kind in _TIFF_SIZES:
            (n,) = struct.unpack_from(f"{order}{'Q' if big else 'I'}", content, entry + 4)
            code, at = _TIFF_SIZES[kind], entry + (12 if big else 8)
            if n * struct.calcsize(code) > (8 if big else 4):  # the value is elsewhere
                (at,) = struct.unpack_from(f"{order}{'Q' if big else 'I'}", content, at)
            (value,) = struct.unpack_from(f"{order}{code}", content, at)
            values[tag] = max(
                value, values.get(tag, 0)
            )  # of a tag given twice, decoders differ in which counts
    width, height = values.get(_TIFF_WIDTH, 0), values.get(_TIFF_HEIGHT, 0)
    bits = values.get(_TIFF_BITS, 1) * values.get(_TIFF_SAMPLES, 1)
    if bits > 8 * _MOST_PIXEL_BYTES:
        raise ImageError(f"TIFF image states {bits} bits for each pixel: 8 or 16 for each colour are read")
    tile = values.get(_TIFF_TILE_WIDTH, 0), values.get(_TIFF_TILE_HEIGHT, 0)
    if tile[0] * tile[1] > width * height:  # a decoder allocates whole tiles
        width, height = max(width, tile[0]), max(height, tile[1])
    return width, height


def _netpbm(content: memoryview) -> tuple[int, int]:
    text = bytes(content[:_LONGEST_TEXT_HEADER])
    if text[1:2] == b"7":
        sides = {name: int(value) for name, value in _PAM_SIDE.findall(text.partition(b"ENDHDR")[0])}
        return sides.get(b"WIDTH", 0), sides.get(b"HEIGHT", 0)
    width = _NETPBM_NUMBER.match(text, 2)
    height = width and _NETPBM_NUMBER.match(text, width.end())
    if width is None or height is None:
        raise ValueError("no size")
    return int(width[1]), int(height[1])


def _webp(content: memoryview) -> tuple[int, int]:
    chunk = bytes(content[12:16])
    if chunk == b"VP8X":
        wide, high = (int.from_bytes(content[at : at + 3], "little") + 1 for at in (24, 27))
        return wide, high
    if chunk == b"VP8L":
        (bits,) = struct.unpack_from("<I", content, 21)
        return (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    if chunk != b"VP8 ":
        raise ValueError("no image")
    width, height = struct.unpack_from("<HH", content, 26)
    return width & 0x3FFF, height & 0x3FFF


_Reader = Callable[[memoryview], tuple[int, int]]
_FORMATS: tuple[tuple[str, Callable[[bytes], bool], _Reader], ...] = (
    ("JPEG", lambda start: start.startswith(b"\xff\xd8"), _jpeg),
    ("PNG", lambda start: start.startswith(b"\x89PNG\r\n\x1a\n"), _png),
    ("TIFF", lambda start: start[:4] in (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"), _tiff),
    ("BMP", lambda start: start.startswith(b"BM"), _bmp),
    ("PGM", lambda start: _NETPBM.match(start) is not None, _netpbm),
    ("WebP", lambda start: start[:4] == b"RIFF" and start[8:12] == b"WEBP", _webp),
)
SUPPORTED_FORMATS = tuple(kind for kind, _, _ in _FORMATS)
