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

"""What a node is given at its start, apart from its own settings: checked, as ROS is silent or obscure."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions

from ..core.errors import ConfigError, printable, shortened
from ..files.node_settings import ALIGNMENT_RESULTS, RESULT_PREFIX

QOS_PREFIX = "qos_overrides."
_RESULT_FILE = (RESULT_PREFIX, "provenance.")
# A parameter of a library that this node does without; files of whole vehicles set it for every node.
_NOBODYS = ("diagnostic_updater.",)
_MOST_NAMES = 5  # a file for a whole vehicle may hold hundreds that are meant for other nodes

# The words of a policy, as ROS writes them; both of the last two leave the choice to the middleware.
_MIDDLEWARES = ("system_default", "best_available")
_QOS_WORDS = {
    "history": ("keep_last", "keep_all", "system_default"),
    "reliability": ("reliable", "best_effort", *_MIDDLEWARES),
    "durability": ("volatile", "transient_local", *_MIDDLEWARES),
}
# Images of 1 MB would take 10 GB then; DDS would take any number.
_GREATEST_DEPTH = 10_000


def start_values(node: Node) -> Mapping[str, Any]:
    """Return the values that the node was given at its start, by name, declared or not."""
    # rclpy hands them out one by one, to whoever knows their names.
    return {name: each.value for name, each in getattr(node, "_parameter_overrides", {}).items()}


def check_qos_overrides(prefix: str, given: Mapping[str, Any]) -> None:
    """Make sure that the QoS policies of a subscription or publisher can be followed.

    Args:
        prefix: ``qos_overrides.<topic>.subscription.``, or of a publisher.
        given: Values given at the start, by name.

    Raises:
        ConfigError: A value is none of its policy's, or DDS would take it and not follow it.
    """
    for policy, words in _QOS_WORDS.items():
        value = given.get(prefix + policy, words[0])
        if not isinstance(value, str) or value.lower() not in words:
            raise ConfigError(f"{prefix}{policy} is {shortened(value)}: it must be one of {', '.join(words)}")
    depth = given.get(f"{prefix}depth", 1)
    if type(depth) is not int or not 1 <= depth <= _GREATEST_DEPTH:
        raise ConfigError(f"{prefix}depth is {shortened(depth)}: it must lie in 1 ... {_GREATEST_DEPTH}")
    latched = str(given.get(f"{prefix}durability")).lower() == "transient_local"
    if latched and str(given.get(f"{prefix}reliability")).lower() == "best_effort":
        raise ConfigError(
            f"{prefix}durability is transient_local, which has no effect while reliability is best_effort: "
            "set it to reliable"
        )


def overridable_publisher(node: Node, message_type: Any, topic: str, depth: int) -> Publisher:
    """Return a publisher whose QoS policies may be given at the start of the node.

    Args:
        node: The node.
        message_type: Type of the messages.
        topic: Name of the topic.
        depth: Number of messages that wait.

    Raises:
        ConfigError: As of :func:`check_qos_overrides`.
    """
    check_qos_overrides(f"{QOS_PREFIX}{node.resolve_topic_name(topic)}.publisher.", start_values(node))
    return node.create_publisher(
        message_type,
        topic,
        QoSProfile(depth=depth),  # one for each: rclpy writes the overrides of a topic into it
        qos_overriding_options=QoSOverridingOptions.with_default_policies(),
    )


def unused_start_values(node: Node) -> list[str]:
    """Return a sentence about each kind of value that was given at the start and has no effect.

    To be called when everything is declared.

    Args:
        node: The node.
    """
    given = start_values(node)
    results = [name for name in given if name.startswith(_RESULT_FILE) or name in ALIGNMENT_RESULTS]
    # Result parameters are declared, and take no value from outside.
    unused = [name for name in given if not node.has_parameter(name) and name not in results]
    qos = [name for name in unused if name.startswith(QOS_PREFIX)]
    unknown = [name for name in unused if name not in qos and not name.startswith(_NOBODYS)]
    said = []
    if results:
        said.append(
            f"{_named(results)} given at the start: this node finds them itself and takes no result file as "
            "a file of parameters; to begin with an earlier calibration, set output_path to its file"
        )
    if qos:
        said.append(
            f"{_named(qos)} has no effect: there is no such topic here, or the policy cannot be overridden; "
            f"{QOS_PREFIX}<full name of the topic>.subscription.* takes history, depth, reliability and "
            "durability for images and CameraInfo, .publisher.* the first three for the pictures"
        )
    if unknown:
        said.append(
            f"{_named(unknown)} has no effect: this node has no such parameter; ros2 param list shows those "
            "it has"
        )
    return said


def _named(names: list[str]) -> str:
    shown = ", ".join(printable(name) for name in sorted(names)[:_MOST_NAMES])
    more = len(names) - _MOST_NAMES
    return f"{shown} and {more} more" if more > 0 else shown
