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

"""What the node is given at its start: followed, refused in words, or said to have no effect."""

import pytest

pytest.importorskip("rclpy")

from node_in_process import NodeInProcess

from stereo_selfcal.core.errors import ConfigError

INFO = "qos_overrides./left/camera_info.subscription."
PICTURE = "qos_overrides./stereo_selfcal/debug_image.publisher."


def start(**parameters):
    return NodeInProcess(**parameters)


def warnings_of(**parameters):
    with start(**parameters) as node:
        return [line for line in node.logged if "listening to" not in line]


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        (f"{INFO}reliability", "reliabel", "is 'reliabel': it must be one of reliable, best_effort"),
        (f"{INFO}durability", "latched", "is 'latched': it must be one of volatile, transient_local"),
        (f"{INFO}history", 5, "history is 5: it must be one of keep_last, keep_all"),
        (f"{INFO}depth", -1, "depth is -1: it must lie in 1 ... 10000"),
        (f"{INFO}depth", 99_999_999_999, "it must lie in 1 ... 10000"),
        (f"{INFO}depth", "five", "depth is 'five': it must lie in"),
        (f"{PICTURE}reliability", "yes", "is 'yes': it must be one of reliable"),
        ("use_sim_time", 5, "the node cannot be made: .*use_sim_time"),
    ],
)
def test_wrong_value_of_a_qos_policy_is_refused_with_its_name_and_what_it_may_be(name, value, words):
    with pytest.raises(ConfigError, match=words), start(**{name: value}):
        pass


def test_latched_and_best_effort_at_once_is_refused_as_dds_would_not_follow_it():
    given = {f"{INFO}durability": "transient_local", f"{INFO}reliability": "best_effort"}
    with pytest.raises(ConfigError, match="no effect while reliability is best_effort"), start(**given):
        pass


def test_durability_can_be_overridden_and_brings_the_reliability_it_needs():
    with start(**{f"{INFO}durability": "transient_local"}) as node:
        asked = [node.node.get_parameter(INFO + name).value for name in ("durability", "reliability")]
        assert asked == ["transient_local", "reliable"]
        profile = next(s for s in node.node.subscriptions if s.topic_name == "/left/camera_info").qos_profile
        assert (profile.durability.name, profile.reliability.name) == ("TRANSIENT_LOCAL", "RELIABLE")


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        (f"{INFO}deadline", 5, f"{INFO}deadline has no effect"),
        ("qos_overrides./lfet/image_rect.subscription.depth", 5, "there is no such topic here"),
        ("frmaes", 3, "frmaes has no effect: this node has no such parameter"),
    ],
)
def test_value_without_effect_is_named(name, value, words):
    (line,) = warnings_of(**{name: value})
    assert words in line


def test_of_many_values_without_effect_a_few_are_named():
    (line,) = warnings_of(**{f"other{i}": i for i in range(100)})
    assert "and 95 more" in line and len(line) < 300


def test_own_result_file_among_the_parameter_files_is_said_to_have_no_effect():
    given = {"extrinsics.height_m": 1.4, "provenance.schema": 1}
    with start(**given) as node:
        (line,) = (text for text in node.logged if "listening to" not in text)
        assert "extrinsics.height_m, provenance.schema given at the start" in line
        assert "set output_path to its file" in line
        assert node.node.get_parameter("extrinsics.height_m").value is None


def test_node_without_such_values_says_nothing():
    assert warnings_of() == []
