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

"""The topics of the written recording: the inputs and outputs of the node, under the names it has by default.

The layouts for Foxglove and RViz in ``config/`` show these; a test compares them.
"""

from __future__ import annotations

from dataclasses import dataclass

from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime

from ..files.node_settings import NODE_NAME

_FOREVER = QosTime(9_223_372_036, 854_775_807)  # RMW_DURATION_INFINITE, which is what rosbag2 records
_DEPTH = 10
NODE = f"/{NODE_NAME}"


@dataclass(frozen=True, slots=True)
class RecordingTopic:
    """One topic.

    Attributes:
        name: Its full name.
        kind: Type of its messages.
        latched: Whether who subscribes late gets the last message.
    """

    name: str
    kind: str
    latched: bool = False

    @property
    def qos(self) -> Qos:
        """What its publisher offers, and a player offers again."""
        durability = QosDurability.TRANSIENT_LOCAL if self.latched else QosDurability.VOLATILE
        depth = 1 if self.latched else _DEPTH
        history, reliability = QosHistory.KEEP_LAST, QosReliability.RELIABLE
        liveliness = QosLiveliness.AUTOMATIC
        never = _FOREVER, _FOREVER
        return Qos(history, depth, reliability, durability, *never, liveliness, _FOREVER, False)


_IMAGE, _INFO = "sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/CameraInfo"
_POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"

LEFT_IMAGE = RecordingTopic("/left/image_rect/compressed", _IMAGE)
RIGHT_IMAGE = RecordingTopic("/right/image_rect/compressed", _IMAGE)
LEFT_INFO = RecordingTopic("/left/camera_info", _INFO)
RIGHT_INFO = RecordingTopic("/right/camera_info", _INFO)
DEBUG_IMAGE = RecordingTopic(f"{NODE}/debug_image/compressed", _IMAGE)
ROAD_POSE = RecordingTopic(f"{NODE}/road_pose", _POSE)
POSE = RecordingTopic(f"{NODE}/pose", _POSE, latched=True)
ALIGNMENT = RecordingTopic(f"{NODE}/alignment", _POSE, latched=True)
MARKERS = RecordingTopic(f"{NODE}/markers", "visualization_msgs/msg/MarkerArray", latched=True)
EXTRINSICS = RecordingTopic(f"{NODE}/extrinsics", "rcl_interfaces/msg/ParameterEvent", latched=True)
TF_STATIC = RecordingTopic("/tf_static", "tf2_msgs/msg/TFMessage", latched=True)
DIAGNOSTICS = RecordingTopic("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")

TOPICS = (
    LEFT_IMAGE,
    RIGHT_IMAGE,
    LEFT_INFO,
    RIGHT_INFO,
    DEBUG_IMAGE,
    ROAD_POSE,
    POSE,
    ALIGNMENT,
    MARKERS,
    EXTRINSICS,
    TF_STATIC,
    DIAGNOSTICS,
)
