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

"""The layouts for Foxglove and RViz show topics of the written recording, as what they are."""

import json
import re
from pathlib import Path

import pytest
import yaml

from stereo_selfcal.files.frames import FrameNames
from stereo_selfcal.recording.messages import make
from stereo_selfcal.recording.topics import TOPICS

CONFIG = Path(__file__).resolve().parents[2] / "config"
KINDS = {topic.name: topic for topic in TOPICS}
IMAGE, INFO = "sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/CameraInfo"
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"
OF_IMAGE_PANEL = {"imageTopic": IMAGE, "calibrationTopic": INFO}
# What panels of Foxglove and displays of RViz can show.
IN_3D = {"visualization_msgs/msg/MarkerArray", "geometry_msgs/msg/PoseWithCovarianceStamped"}
OF_DISPLAY = {
    "MarkerArray": "visualization_msgs/msg/MarkerArray",
    "PoseWithCovariance": "geometry_msgs/msg/PoseWithCovarianceStamped",
    "Image": IMAGE,  # by the transport that ends the name
}


@pytest.fixture(scope="module")
def foxglove():
    return json.loads((CONFIG / "foxglove_layout.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def rviz():
    return yaml.safe_load((CONFIG / "stereo_selfcal.rviz").read_text(encoding="utf-8"))[
        "Visualization Manager"
    ]


def panels_in(layout):
    if isinstance(layout, str):
        return [layout]
    return panels_in(layout["first"]) + panels_in(layout["second"])


def test_every_panel_is_placed_once(foxglove):
    placed = panels_in(foxglove["layout"])
    assert sorted(placed) == sorted(foxglove["configById"])


def test_foxglove_shows_topics_as_what_they_are(foxglove):
    shown = set()
    for name, panel in foxglove["configById"].items():
        topics = dict.fromkeys(panel.get("topics", {}), IN_3D)
        mode = panel.get("imageMode", {})
        topics |= {
            mode[key]: {kind}
            for key, kind in (("imageTopic", IMAGE), ("calibrationTopic", INFO))
            if key in mode
        }
        topics |= {panel["topicToRender"]: {DIAGNOSTICS}} if "topicToRender" in panel else {}
        for topic, kinds in topics.items():
            assert KINDS[topic].kind in kinds, f"{name}: {topic}"
        shown |= set(topics)
    assert shown >= set(KINDS) - {"/tf_static", "/stereo_selfcal/extrinsics"}


def test_paths_of_foxglove_are_fields_of_the_messages(foxglove):
    """A plot of a field that is not there stays empty without a word."""
    paths = [path["value"] for panel in foxglove["configById"].values() for path in panel.get("paths", [])]
    paths += [panel["topicPath"] for panel in foxglove["configById"].values() if "topicPath" in panel]
    assert len(paths) == 3
    for path in paths:
        topic, _, fields = path.partition(".")
        message = make(KINDS[topic].kind)
        for field in re.sub(r"\[.*?\]", "", fields).split("."):
            message = getattr(message, field)


def test_rviz_shows_topics_as_what_they_are_with_a_qos_that_matches(rviz):
    shown = set()
    for display in rviz["Displays"]:
        if "Topic" not in display:
            continue
        asked = display["Topic"]
        topic = KINDS[asked["Value"]]
        kind = display["Class"].removeprefix("rviz_default_plugins/")
        assert topic.kind == OF_DISPLAY[kind], display["Name"]
        # Who asks for less than is latched misses what was sent before.
        assert asked["Durability Policy"] == ("Transient Local" if topic.latched else "Volatile")
        shown.add(topic.name)
    assert {"/stereo_selfcal/markers", "/stereo_selfcal/pose", "/stereo_selfcal/alignment"} <= shown
    assert rviz["Global Options"]["Fixed Frame"] == FrameNames().road_frame
