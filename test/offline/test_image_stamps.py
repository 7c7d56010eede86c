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

"""The order and the stamps of images by their names."""

import os

import cv2
import pytest
import yaml
from bag_making import RIG, picture

from stereo_selfcal.bags import BagError
from stereo_selfcal.bags.order import natural_key
from stereo_selfcal.offline.folder import FolderSource
from stereo_selfcal.offline.image_stamps import image_stamps

NS = 10**9
T_NS = 1_764_504_000_123_456_789  # 2025-11-30 12:00:00


@pytest.mark.parametrize(
    "names",
    [
        [str(number) for number in range(12)],
        ["left_2", "left_9", "left_10", "left_100"],
        ["img1a", "img1b", "img2a", "img10a"],
        ["cam2_9", "cam2_10", "cam10_1"],
        ["frame-9-1", "frame-9-11", "frame-10-2"],
        ["0000000008", "0000000009", "0000000010"],
        ["20251130_120000_9", "20251130_120000_10", "20251130_120001_1"],
        [f"run{T_NS}_{number}" for number in (1, 2, 10)],
        ["1764504000_9", "1764504000_10"],
    ],
    ids=lambda names: names[-1],
)
def test_numbers_in_names_count_as_people_count_and_that_there_are_no_stamps_is_told(names):
    stamps = image_stamps(sorted(names))
    assert list(stamps.names) == names
    assert stamps.stamps_ns == tuple(index * NS // 10 for index in range(len(names)))
    assert stamps.counted and "are no stamps: they are taken for 0.1 s apart" in stamps.note


@pytest.mark.parametrize(
    ("make", "word", "digit_ns"),
    [
        (str, "nanoseconds", 1),
        (lambda ns: str(ns // 1000), "microseconds", 1000),
        (lambda ns: str(ns // 10**6), "milliseconds", 10**6),
        (lambda ns: str(ns // NS), "seconds", NS),
        (lambda ns: f"{ns // NS}.{ns % NS:09}", "seconds", 1),
        (lambda ns: f"{ns // NS}.{ns % NS // 1000:06}", "seconds", 1000),
        (lambda ns: f"{ns // NS}_{ns % NS:09}", "seconds", 1),
        (lambda ns: f"left_{ns}", "nanoseconds", 1),
        (lambda ns: f"12-{ns // 1000}", "microseconds", 1000),
        (lambda ns: f"frame{ns // 10**6}", "milliseconds", 10**6),
        (lambda ns: f"cam0.{ns // NS}.{ns % NS:09}", "seconds", 1),
        (lambda ns: f"{ns}_rect", "nanoseconds", 1),
        (lambda ns: f"2025-11-30_12-{ns // NS // 60 % 60:02}-{ns // NS % 60:02}.{ns % NS:09}", "dates", 1),
        (lambda ns: f"IMG_20251130T12{ns // NS // 60 % 60:02}{ns // NS % 60:02}", "dates", NS),
    ],
    ids=lambda value: value(T_NS) if callable(value) else None,
)
def test_a_name_that_is_or_ends_in_a_time_stamp_is_the_stamp_whatever_its_unit(make, word, digit_ns):
    times_ns = [T_NS, T_NS + 3 * NS, T_NS + 9 * NS, T_NS + 61 * NS]
    stamps = image_stamps(sorted(map(make, times_ns), reverse=True))
    assert [ns // digit_ns for ns in stamps.stamps_ns] == [ns // digit_ns for ns in times_ns]
    assert stamps.names == tuple(map(make, times_ns))
    assert not stamps.counted
    assert stamps.note == f"stamps are in the names of the images ({word}, from 2025-11-30 12:00:00 on)"


def test_stamps_order_images_where_numbers_before_them_would_not():
    names = [f"cam{10 - index}_{T_NS + index * NS}" for index in range(10)]
    assert image_stamps(names).names == tuple(names)


def test_a_fraction_of_a_second_without_its_last_zeros_is_the_same_fraction():
    assert image_stamps(["1764504000.25", "1764504000.5", "1764504001"]).stamps_ns == (
        1764504000_250_000_000,
        1764504000_500_000_000,
        1764504001_000_000_000,
    )
    assert image_stamps(["12.0", "9.5", "10"]).stamps_ns == (9_500_000_000, 10 * NS, 12 * NS)


@pytest.mark.parametrize(
    ("names", "words"),
    [
        ([str(T_NS), str(T_NS // 10**6)], "in nanoseconds .* and in milliseconds"),
        ([f"a{T_NS // NS}", f"a{T_NS // 1000}", "b"], "in seconds .a1764504000. and in microseconds"),
        ([f"a_{T_NS}", f"b_{T_NS}"], f"a_{T_NS} and b_{T_NS} have the same time stamp: give every"),
        (["1.1", "1.10"], "1.1 and 1.10 have the same time stamp"),
        (["1.8", "1.9", "1.11"], "1.11 and 1.8 can be seconds or two numbers each"),
    ],
)
def test_names_that_can_be_read_in_two_ways_are_refused(names, words):
    with pytest.raises(BagError, match=words):
        image_stamps(names)


def test_one_name_without_a_stamp_among_stamps_is_told_and_named():
    stamps = image_stamps([str(T_NS), str(T_NS + NS), "background"])
    assert stamps.counted
    assert stamps.note.startswith(
        "1 of 3 names of images are no stamps (background): they are taken for 0.1 s apart"
    )


@pytest.mark.parametrize("name", ["2025-13-30_12-00-00", "0123456789", "9999999999", "12345678901"])
def test_what_has_the_digits_of_a_stamp_and_is_none_is_no_stamp(name):
    assert image_stamps([name]).counted


def test_natural_order_of_any_names_is_an_order():
    names = ["", "0", "00", "a", "a0", "a00", "a1b", "a1b2", "a01", "1a", "é2", "é10", "\udcff", "٣"]
    assert len(sorted(names, key=natural_key)) == len({natural_key(name) for name in names})
    assert sorted(["bag_10", "bag_2", "bag_02"], key=natural_key) == ["bag_02", "bag_2", "bag_10"]


def folder_of(path, names, suffix=".png"):
    for side in ("left", "right"):
        (path / side).mkdir(parents=True)
        for name in names:
            cv2.imwrite(str(path / side / f"{name}{suffix}"), picture(side, 0))
    (path / "rig.yaml").write_text(yaml.safe_dump(RIG.to_mapping()))
    return path


def test_counted_frames_are_told_in_the_remarks_too_which_reports_and_json_have(tmp_path):
    source = FolderSource(folder_of(tmp_path / "a", ["1", "10", "2"]), RIG)
    assert [frame.name for frame in source.frames()] == ["1.png", "2.png", "10.png"]
    assert source.remarks == source.notes and "no stamps" in source.notes[0]
    source = FolderSource(folder_of(tmp_path / "b", [str(T_NS)]), RIG)
    assert source.remarks == () and "nanoseconds" in source.notes[0]


def test_two_images_of_one_name_are_refused_with_both(tmp_path):
    folder = folder_of(tmp_path, ["1", "2"])
    (folder / "left" / "2.jpg").write_bytes(b"")
    with pytest.raises(BagError, match=r"left: 2\.jpg and 2\.png have one name"):
        FolderSource(folder, RIG)


def test_hidden_files_are_no_images(tmp_path):
    folder = folder_of(tmp_path, [str(T_NS), f"._{T_NS + NS}"])
    source = FolderSource(folder, RIG)
    assert source.n_images == (1, 1) and not source.counted


def test_a_pipe_among_the_images_is_a_frame_that_cannot_be_read(tmp_path):
    folder = folder_of(tmp_path, ["1", "2"])
    (folder / "left" / "1.png").unlink()
    os.mkfifo(folder / "left" / "1.png")
    problems = [frame.problem for frame in FolderSource(folder, RIG).frames()]
    assert "1.png" in problems[0] and "file" in problems[0] and problems[1] == ""
