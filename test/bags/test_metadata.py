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

"""metadata.yaml: a value of a wrong type is named, and what is not needed may be anything."""

import shutil

import pytest
import yaml
from bag_making import cameras, make_bag, make_split_bag

from stereo_selfcal.bags import BagError, StereoBag
from stereo_selfcal.offline.bag import BagSource

ROOT = "rosbag2_bagfile_information"
NAN = float("nan")


@pytest.fixture
def bag(tmp_path):
    return make_bag(tmp_path / "bag", cameras(), 2)


def change(bag, path, value):
    """Set a value of metadata.yaml, by the keys and numbers that lead to it; KeyError: leave it out."""
    file = bag / "metadata.yaml"
    document = yaml.safe_load(file.read_text())
    at = document[ROOT]
    *above, last = path
    for key in above:
        at = at[key]
    if value is KeyError:
        del at[last]
    else:
        at[last] = value
    file.write_text(yaml.safe_dump(document))


TOPIC = ("topics_with_message_count", 0, "topic_metadata")
COUNT = ("topics_with_message_count", 0, "message_count")


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        ((*TOPIC, "name"), 5, r"topics_with_message_count\[0\]\.topic_metadata\.name is 5: a text is needed"),
        ((*TOPIC, "name"), ["a"], r"topic_metadata\.name is \['a'\]: a text"),
        ((*TOPIC, "name"), None, r"topic_metadata\.name is missing: a text"),
        ((*TOPIC, "type"), {"a": 1}, r"topic_metadata\.type is \{'a': 1\}: a text"),
        ((*TOPIC, "type"), KeyError, r"topic_metadata\.type is missing"),
        (COUNT, -3, r"message_count of /stereo/left/image_rect is -3: a whole number, zero or more"),
        (COUNT, NAN, "message_count of /stereo/left/image_rect is nan"),
        (COUNT, "4", "message_count of /stereo/left/image_rect is '4'"),
        (COUNT, True, "message_count of .* is True"),
        (COUNT, 10**30, "message_count of .* is 1000000"),
        (COUNT, [1, 2], r"message_count of .* is \[1, 2\]"),
        (TOPIC, "x", r"topics_with_message_count\[0\]\.topic_metadata is 'x': names with values"),
        (TOPIC[:2], 7, r"topics_with_message_count\[0\] is 7: names with values"),
        (TOPIC[:1], {"a": 1}, "topics_with_message_count is .*: a list is needed"),
        (TOPIC[:1], KeyError, "topics_with_message_count is missing"),
        (("relative_file_paths",), "bag.mcap", "relative_file_paths is 'bag.mcap': a list is needed"),
        (("relative_file_paths",), [None], "relative_file_paths is missing: a text"),
        (("relative_file_paths",), [["bag.mcap"]], "relative_file_paths is .*: a text is needed"),
        (("relative_file_paths",), [], "relative_file_paths names no file"),
        (("relative_file_paths",), ["bag.mcap", "bag.mcap"], "names a file twice"),
        (("relative_file_paths",), [".."], "is a folder, where a file is needed|missing"),
        (("version",), "nine", "version is 'nine': a whole number"),
        (("version",), -1, "version is -1"),
        (("storage_identifier",), ["mcap"], r"Storage plugin \['mcap'\]"),
        (("compression_mode",), 3, "compression_mode is 3: a text"),
        (("compression_mode",), "whole", "compression_mode is 'whole': file or message is needed"),
    ],
)
def test_value_of_a_wrong_type_is_named_with_its_place(bag, path, value, words):
    change(bag, path, value)
    with pytest.raises(BagError, match=words) as error, StereoBag(bag):
        pass
    assert str(bag) in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "value", [None, -1, NAN, "x", [], [[1]], {"a": {"b": []}}, "- [history: 3", KeyError]
)
@pytest.mark.parametrize(
    "path",
    [
        (*TOPIC, "offered_qos_profiles"),
        (*TOPIC, "serialization_format"),
        (*TOPIC, "type_description_hash"),
        ("duration",),
        ("starting_time",),
        ("starting_time", "nanoseconds_since_epoch"),
        ("message_count",),
        ("files",),
        ("custom_data",),
        ("ros_distro",),
    ],
    ids=lambda path: str(path[-1]),
)
def test_what_is_not_needed_may_be_anything(bag, path, value):
    change(bag, path, value)
    with StereoBag(bag) as opened:
        assert len(list(opened.frames())) == 2
        assert opened.remarks == ()


def test_more_messages_than_there_are_is_remarked(bag):
    change(bag, COUNT, 5)
    with StereoBag(bag) as opened:
        assert len(list(opened.frames())) == 2
        assert "2 left and 2 right images were read, the recording should have 5 and 2" in opened.remarks[0]


@pytest.mark.parametrize(
    "content", ["", "null", "5", "[]", "a: b", f"{ROOT}: []", f"{ROOT}: x", "\x00", "\t", "&a [*a]"]
)
def test_any_other_document_is_refused(bag, content):
    (bag / "metadata.yaml").write_text(content)
    with pytest.raises(BagError, match=r"metadata\.yaml"), StereoBag(bag):
        pass


def test_aliases_that_python_programs_write_are_read(bag):
    file = bag / "metadata.yaml"
    document = yaml.safe_load(file.read_text())
    shared = [{"history": 1}]
    for topic in document[ROOT]["topics_with_message_count"]:
        topic["topic_metadata"]["offered_qos_profiles"] = shared
    file.write_text(yaml.safe_dump(document))
    assert "*id001" in file.read_text()
    with StereoBag(bag) as opened:
        assert len(list(opened.frames())) == 2


def test_storage_files_that_are_not_listed_are_told_with_the_remedy(tmp_path):
    bag = make_split_bag(tmp_path / "bag", cameras(), n_files=3, n_frames=3)
    names = sorted(file.name for file in bag.glob("*.mcap"))
    change(bag, ("relative_file_paths",), names[:1])
    (bag / "notes.txt").write_text("not of the recording")
    with BagSource([bag]) as source:
        list(source.frames())
        first = source.remarks[0]
    assert first == (
        f"metadata.yaml of bag lists 1 of 3 storage files, not {names[1]}, {names[2]}, which are not read: "
        "if they are one recording, 'ros2 bag reindex' writes it anew from the storage files"
    )


def test_files_that_are_not_listed_are_told_where_the_others_have_no_images(tmp_path):
    bag = make_bag(tmp_path / "bag", [], 2, other_topics=(("/chatter", "std_msgs/msg/String"),))
    other = make_bag(tmp_path / "other", cameras(), 2)
    shutil.copy(other / "other.mcap", bag)
    with pytest.raises(
        BagError, match=r"no images: .*lists 1 of 2 storage files, not other\.mcap, which is not"
    ):
        StereoBag(bag)


@pytest.mark.parametrize("kind", ["mcap", "mcap-file", "sqlite3"])
def test_files_that_are_listed_packed_or_not_are_no_matter(tmp_path, kind):
    bag = make_bag(tmp_path / "bag", cameras(), 2, kind=kind)
    if kind == "mcap-file":
        (bag / "bag.mcap").write_bytes(b"unpacked by somebody")
    with StereoBag(bag) as recording:
        assert recording.file_remarks == ()
