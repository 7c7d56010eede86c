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

"""Makes small files that state, or unpack to, far more than they are, of each kind that a reader may meet."""

import bz2
import os
import sqlite3
import struct
import zlib

import cv2
import lz4.frame
import numpy as np
from bag_making import Camera, cameras, make_bag
from rosbags.rosbag1 import Reader
from rosbags.rosbag2 import reader as rosbags_reader

from stereo_selfcal.core.camera.rig import StereoRig

zstd = rosbags_reader.zstd  # of Python or a package, by the version

GIGABYTES = 2_000_000_000
MCAP_MAGIC = b"\x89MCAP0\r\n"


def png(width, height, bits=8, colour=0):
    """A PNG whose header is right, with the pixels of one row."""

    def chunk(kind, content):
        body = kind + content
        return struct.pack(">I", len(content)) + body + struct.pack(">I", zlib.crc32(body))

    head = struct.pack(">IIBBBBB", width, height, bits, colour, 0, 0, 0)
    row = zlib.compress(bytes(width))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", row) + chunk(b"IEND", b"")


def jpeg(width, height, progressive=False):
    """A JPEG of a few hundred bytes whose frame header states another size than it has."""
    flags = [cv2.IMWRITE_JPEG_PROGRESSIVE, int(progressive)]
    data = bytearray(cv2.imencode(".jpg", np.full((8, 8, 3), 128, np.uint8), flags)[1].tobytes())
    start = data.index(b"\xff\xc2" if progressive else b"\xff\xc0")
    data[start + 5 : start + 9] = struct.pack(">HH", height, width)
    return bytes(data)


def jpeg_of_many_scans():
    data = jpeg(4000, 4000, progressive=True)
    start, end = data.rindex(b"\xff\xda"), data.rindex(b"\xff\xd9")
    return data[:end] + data[start:end] * 500 + data[end:]


def bmp(width, height):
    info = struct.pack("<IiiHHIIiiII", 40, width, height, 1, 24, 0, 0, 0, 0, 0, 0)
    return b"BM" + struct.pack("<IHHI", 54 + 64, 0, 0, 54) + info + bytes(64)


def pgm(width, height, comment=b""):
    return b"P5\n" + comment + b"%d %d\n255\n" % (width, height) + bytes(64)


def webp(width, height):
    sides = b"".join((side - 1).to_bytes(3, "little") for side in (width, height))
    body = b"WEBP" + b"VP8X" + struct.pack("<I", 10) + bytes(4) + sides
    return b"RIFF" + struct.pack("<I", len(body)) + body


def tiff(*entries, order="<", big=False):
    """A TIFF of one directory; the entries are (tag, type, value)."""
    mark = b"II" if order == "<" else b"MM"
    if big:
        head = mark + struct.pack(f"{order}HHHQ", 43, 8, 0, 16)
        body = struct.pack(f"{order}Q", len(entries))
        body += b"".join(struct.pack(f"{order}HHQQ", tag, 16, 1, value) for tag, _, value in entries)
        return head + body + bytes(8)
    body = struct.pack(f"{order}H", len(entries))
    for tag, kind, value in entries:
        content = struct.pack(f"{order}{'H' if kind == 3 else 'I'}", value).ljust(4, b"\0")
        body += struct.pack(f"{order}HHI", tag, kind, 1) + content
    return mark + struct.pack(f"{order}HI", 42, 8) + body + bytes(4)


def tiff_of(width, height, *more, **options):
    grey = ((258, 3, 8), (259, 3, 1), (262, 3, 1), (273, 4, 8), (277, 3, 1), (279, 4, 64))
    return tiff((256, 4, width), (257, 4, height), *grey, *more, **options)


IMAGES = {
    "jpeg": (jpeg(65_500, 65_500), "JPEG image states 65500 x 65500"),
    "jpeg-progressive": (jpeg(65_500, 65_500, True), "JPEG image states 65500 x 65500"),
    "jpeg-scans": (jpeg_of_many_scans(), "more than 64 passes"),
    "png": (png(30_000, 30_000), "PNG image states 30000 x 30000"),
    "png-16-bit": (png(20_000, 20_000, 16, 6), "PNG image states 20000 x 20000"),
    "bmp": (bmp(30_000, -30_000), "BMP image states 30000 x 30000"),
    "pgm": (pgm(30_000, 30_000), "PGM image states 30000 x 30000"),
    "pgm-comment": (pgm(30_000, 30_000, b"# 8 8\n"), "PGM image states 30000 x 30000"),
    "webp": (webp(16_383, 16_383), "WebP image states 16383 x 16383"),
    "tiff": (tiff_of(30_000, 30_000), "TIFF image states 30000 x 30000"),
    "tiff-big-endian": (tiff_of(30_000, 30_000, order=">"), "TIFF image states 30000 x 30000"),
    "tiff-64": (tiff_of(30_000, 30_000, big=True), "TIFF image states 30000 x 30000"),
    "tiff-twice": (tiff_of(30_000, 30_000, (256, 3, 8)), "TIFF image states 30000 x 30000"),
    "tiff-tile": (tiff_of(64, 48, (322, 4, 30_000), (323, 4, 30_000)), "TIFF image states 30000 x 30000"),
}


def record(code, content):
    return bytes([code]) + struct.pack("<Q", len(content)) + content


def text(value):
    return struct.pack("<I", len(value)) + value


def mcap(path, *records, index=b""):
    """An MCAP file of these records, with a summary of ``index`` where that is given."""
    start = MCAP_MAGIC + record(1, text(b"ros2") + text(b"tests"))
    data = start + b"".join(records) + record(15, struct.pack("<I", 0))
    foot = record(2, struct.pack("<QQI", len(data) if index else 0, 0, 0))
    path.write_bytes(data + index + foot + MCAP_MAGIC)
    return path


def chunk(packed, compression, size, start_ns=0, end_ns=1):
    head = struct.pack("<QQQI", start_ns, end_ns, size, 0)
    return record(6, head + text(compression) + struct.pack("<Q", len(packed)) + packed)


def zeros_zstd(n_bytes, stated=True):
    packer = zstd.ZstdCompressor(options={zstd.CompressionParameter.content_size_flag: int(stated)})
    if stated:
        packer.set_pledged_input_size(n_bytes)
    block = bytes(10_000_000)
    parts = [packer.compress(block) for _ in range(n_bytes // len(block))]
    return b"".join(parts) + packer.flush()


def zeros_lz4(n_bytes):
    packer, block = lz4.frame.LZ4FrameCompressor(), bytes(10_000_000)
    parts = [packer.begin(n_bytes), *(packer.compress(block) for _ in range(n_bytes // len(block)))]
    return b"".join(parts) + packer.flush()


def zeros_bz2(n_bytes):
    packer, block = bz2.BZ2Compressor(), bytes(10_000_000)
    return b"".join(packer.compress(block) for _ in range(n_bytes // len(block))) + packer.flush()


def mcap_chunk(pack, compression, stated):
    def make(folder):
        return mcap(folder / "bomb.mcap", chunk(pack(GIGABYTES // 2), compression, stated))

    return make


def packed_message(kind, stated):
    """A recording whose messages are packed, one of them with gigabytes in it."""

    def make(folder):
        path = make_bag(folder / "bag", cameras(), kind="sqlite3-messages")
        with sqlite3.connect(next(path.glob("*.db3"))) as connection:
            connection.execute("UPDATE messages SET data = ?", (zeros_zstd(GIGABYTES, stated),))
        connection.close()
        return path

    return make


def packed_file(stated):
    def make(folder):
        path = make_bag(folder / "bag", cameras(), kind="mcap-file")
        next(path.glob("*.zstd")).write_bytes(zeros_zstd(GIGABYTES, stated))
        return path

    return make


def sqlite_message(folder):
    path = make_bag(folder / "bag", cameras(), kind="sqlite3")
    with sqlite3.connect(next(path.glob("*.db3"))) as connection:
        connection.execute("UPDATE messages SET data = zeroblob(300000000) WHERE id = 1")
    connection.close()
    return path


def sqlite_pages_in_circles(folder):
    """Pages of the table of messages that name the same pages again and again: 80 ** 18 rows."""
    path = folder / "bomb.db3"
    connection = sqlite3.connect(path, isolation_level=None)
    connection.execute("PRAGMA page_size = 512")
    connection.execute("BEGIN")
    connection.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name, type, serialization_format)")
    connection.execute("CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id, timestamp, data)")
    row = "INSERT INTO messages(topic_id, timestamp, data) VALUES (1, 1, zeroblob(300))"
    for _ in range(2_000):
        connection.execute(row)
    connection.execute("COMMIT")
    (root,) = connection.execute("SELECT rootpage FROM sqlite_master WHERE name = 'messages'").fetchone()
    connection.close()
    content = bytearray(path.read_bytes())
    leaf = next(page for page in range(2, len(content) // 512) if content[page * 512] == 13) + 1
    # Interior pages of 70 cells, each of which names the next page; the last one names a leaf.
    n_pages = len(content) // 512
    for level in range(15):
        child = leaf if level == 14 else n_pages + level + 2
        page = bytearray(512)
        cells = [struct.pack(">IB", child, key) for key in range(1, 71)]
        page[0:12] = struct.pack(">BHHHBI", 5, 0, len(cells), 512 - 5 * len(cells), 0, child)
        for number, cell in enumerate(cells):
            position = 512 - 5 * (number + 1)
            page[position : position + 5] = cell
            page[12 + 2 * number : 14 + 2 * number] = struct.pack(">H", position)
        content += page
    content[(root - 1) * 512 : root * 512] = content[n_pages * 512 : (n_pages + 1) * 512]
    content[28:32] = struct.pack(">I", len(content) // 512)
    path.write_bytes(content)
    return path


def ros1_chunk(kind, pack):
    """A bag whose only chunk unpacks to far more than its header states."""

    def make(folder):
        path = make_bag(folder / "bag", cameras(), kind=kind)
        with Reader(path) as reader:
            chunk = reader.chunks[reader.chunk_infos[0].pos]
        content = path.read_bytes()
        packed = pack(GIGABYTES // 10)
        content = (
            content[: chunk.datapos - 4]
            + struct.pack("<I", len(packed))
            + packed
            + content[chunk.datapos + chunk.datasize :]
        )
        index = content.index(b"index_pos=") + 10
        (position,) = struct.unpack_from("<Q", content, index)
        position += len(packed) - chunk.datasize
        path.write_bytes(content[:index] + struct.pack("<Q", position) + content[index + 8 :])
        return path

    return make


def ros1_index(folder):
    """The index of a bag states four billion topics in a chunk, and the file is long but empty."""
    path = make_bag(folder / "bag", cameras(), kind="ros1")
    content = bytearray(path.read_bytes())
    start = content.rindex(b"count=", 0, content.rindex(b"chunk_pos=") + 80)
    content[start + 6 : start + 10] = b"\xff\xff\xff\xff"
    path.write_bytes(bytes(content) + bytes(70_000_000))
    return path


def long_empty_file(name, start):
    def make(folder):
        path = folder / name
        path.write_bytes(start)
        os.truncate(path, GIGABYTES)
        return path

    return make


def mcap_record(folder):
    """A record of 300 MB that says what a topic is."""
    path = mcap(folder / "bomb.mcap", record(4, b"HERE"))
    start, end = path.read_bytes().split(record(4, b"HERE"))
    with path.open("wb") as file:
        file.write(start + bytes([4]) + struct.pack("<Q", 300_000_000))
        for _ in range(30):
            file.write(b"X" * 10_000_000)
        file.write(end)
    return path


def mcap_index(folder):
    """An index that names one chunk 100 000 times."""
    packed = zeros_zstd(10_000_000)
    data_start = len(MCAP_MAGIC) + len(record(1, text(b"ros2") + text(b"tests")))
    one = chunk(packed, b"zstd", 10_000_000)
    entry = struct.pack("<QQQQI", 0, 1, data_start, len(one), 0) + struct.pack("<Q", 0)
    entry = record(8, entry + text(b"zstd") + struct.pack("<QQ", len(packed), 10_000_000))
    return mcap(folder / "bomb.mcap", one, index=entry * 100_000)


def mcap_chunks_at_once(folder):
    """20 chunks of 100 MB, each with a message of its first and of its last moment."""
    bag = make_bag(folder / "bag", cameras(), n_frames=1, kind="mcap-lz4") / "bag.mcap"
    content = bag.read_bytes()
    good = content[content.index(b"\x06", 20) : content.rindex(record(15, struct.pack("<I", 0)))]
    unpacked = lz4.frame.decompress(good[good.index(b"\x04\x22\x4d\x18") :])
    (first_ns,), position = struct.unpack_from("<Q", good, 9), 0
    while unpacked[position] != 5 or unpacked[position + 9] != 1:  # to the message of the first topic
        position += 9 + struct.unpack_from("<Q", unpacked, position + 1)[0]
    (length,) = struct.unpack_from("<Q", unpacked, position + 1)
    last = unpacked[position + 9 : position + 9 + length]
    times = first_ns, first_ns + 10**9
    ends = [record(5, last[:6] + struct.pack("<QQ", time, time) + last[22:]) for time in times]
    n_bytes = 100_000_000
    space = record(0x80, bytes(n_bytes - 9 - sum(map(len, ends))))
    bomb = chunk(lz4.frame.compress(ends[0] + space + ends[1]), b"lz4", n_bytes, *times)
    return mcap(folder / "bomb.mcap", good, bomb * 20)


def images_that_wait(folder):
    """Images of one camera only, of 60 MB each unpacked: all that would wait for a partner are 1.4 GB."""
    rig = StereoRig(10_000, 6_000, 9_000.0, 9_000.0, 5_000.0, 3_000.0, 0.15)
    sides = [Camera("left"), Camera("right", stamp_shift_ns=50_000_000)]
    return make_bag(folder / "bag", sides, 12, "mcap-chunks", rig)


def metadata(content):
    def make(folder):
        path = make_bag(folder / "bag", cameras())
        (path / "metadata.yaml").write_bytes(content)
        return path

    return make


def metadata_lines(folder):
    path = make_bag(folder / "bag", cameras())
    with (path / "metadata.yaml").open("a") as file:
        file.writelines(f"  key_{number}: [a, b, c]\n" for number in range(300_000))
    return path


def merged_keys(start=b"a0: &a0 {k: v}\n", levels=40):
    lines = [start]
    lines += [
        b"a%d: &a%d {<<: [%s]}\n" % (n, n, b", ".join([b"*a%d" % (n - 1)] * 9)) for n in range(1, levels)
    ]
    return b"".join(lines)


RECORDINGS = {
    "zstd-chunk": (mcap_chunk(zeros_zstd, b"zstd", GIGABYTES // 2), "a chunk states 1.0 GB"),
    "zstd-chunk-lies": (mcap_chunk(zeros_zstd, b"zstd", 1000), "a chunk states 1000 bytes and has more"),
    "lz4-chunk": (mcap_chunk(zeros_lz4, b"lz4", GIGABYTES // 2), "a chunk states 1.0 GB"),
    "lz4-chunk-lies": (mcap_chunk(zeros_lz4, b"lz4", 1000), "a chunk states 1000 bytes and has more"),
    "zstd-message": (packed_message("mcap", True), "a message states 2.0 GB"),
    "zstd-message-silent": (packed_message("mcap", False), r"a message unpacks to more than the 134\.2 MB"),
    "zstd-file": (packed_file(True), r"bag\.mcap\.zstd \(.*\) states 2\.0 GB"),
    "zstd-file-silent": (packed_file(False), r"bag\.mcap\.zstd \(.*\) unpacks to more than"),
    "sqlite-message": (sqlite_message, r"a message states 300\.0 MB"),
    "sqlite-circles": (sqlite_pages_in_circles, "name one another"),
    "bz2-chunk": (ros1_chunk("ros1-bz2", zeros_bz2), "a chunk states .* and has more"),
    "ros1-lz4-chunk": (ros1_chunk("ros1-lz4", zeros_lz4), "a chunk states .* and has more"),
    "ros1-index": (ros1_index, "its index is larger than that of any bag"),
    "mcap-record": (mcap_record, r"a record states 300\.0 MB"),
    "mcap-index": (mcap_index, "names a part of the file twice"),
    "mcap-at-once": (mcap_chunks_at_once, r"chunks of one time, together, states 200"),
    "mcap-holes": (long_empty_file("long.mcap", MCAP_MAGIC), r"2\.0 GB long, but only"),
    "sqlite-holes": (long_empty_file("long.db3", b"SQLite format 3\0"), r"2\.0 GB long, but only"),
    "ros1-holes": (long_empty_file("long.bag", b"#ROSBAG V2.0\n"), r"2\.0 GB long, but only"),
    "images-that-wait": (images_that_wait, "no pair of images among 12 on .* and 12 on"),
    "metadata-lines": (metadata_lines, r"metadata\.yaml states 7\.\d MB"),
    "metadata-merges": (metadata(merged_keys()), "merge keys"),
    "metadata-depth": (metadata(b"[" * 100_000), "more than 20 levels"),
    "metadata-values": (metadata(b"[" + b"1," * 1_000_000 + b"]"), "more than 500000 values"),
}
