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

"""Where pairs of image messages come from, and why none came. Needs no ROS."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

from ..core.camera.camera_info_checks import check_claim
from ..core.camera.pairing import PairCounts, StampedPair
from ..core.camera.rectifier import StereoRectifier
from ..core.camera.stamp_pattern import NoPairCause, StampPattern
from .config import NodeConfig

_RECTIFIED_REMEDY = "set rectified: false, or rig.* if they are rectified after all"
_RAW_REMEDY = "set rectified: true"
_LOST_REMEDY = (
    "make the subscriptions reliable (qos_overrides.<topic>.subscription.reliability), give the camera's DDS "
    "more shared memory (segment_size), or use image_transport compressed"
)


class Topics(NamedTuple):
    """Full names of the topics the node listens to."""

    left: str
    right: str
    left_info: str
    right_info: str


@dataclass(frozen=True, slots=True)
class InputState:
    """What the source has received so far.

    Attributes:
        counts: Images, pairs and drops.
        nearest_s: Least difference of a left and a right stamp since the call began [s].
        mismatches: Sentences about publishers that nothing can be received from.
        info_mismatches: The same of CameraInfo, while one has not come.
    """

    counts: PairCounts
    nearest_s: float | None
    mismatches: tuple[str, ...] = ()
    info_mismatches: tuple[str, ...] = ()


class PairSource(Protocol):
    """Where a call gets its pairs of image messages from."""

    @property
    def topics(self) -> Topics:
        """Topics of the source."""

    @property
    def state(self) -> InputState:
        """Counts so far, and what may be wrong with the publishers."""

    @property
    def pattern(self) -> StampPattern:
        """Why the images since the last pair, or since the call began, formed none."""

    @property
    def stopped(self) -> bool:
        """Whether the node shuts down: no pairs will come any more."""

    @property
    def camera_infos(self) -> tuple[Any, Any]:
        """Last CameraInfo of both cameras, None where none came."""

    def camera_infos_of(self, pair: StampedPair[Any]) -> tuple[Any, Any]:
        """Return the CameraInfo that hold for the images of a pair, None where none came."""

    def publishers(self, topic: str) -> int:
        """Return how many publishers a topic has."""

    def next_pair(self, timeout_s: float) -> StampedPair[Any] | None:
        """Wait for the next pair and return it, None when none came in time, or it was interrupted."""

    def interrupt(self) -> None:
        """Wake whoever waits for a pair; there is none until the next call."""


def known_rectifier(
    source: PairSource, config: NodeConfig, pair: StampedPair[Any] | None = None
) -> StereoRectifier | None:
    """Return the cameras of the parameters or of CameraInfo, None before both have come.

    Args:
        source: Where the pair and CameraInfo come from.
        config: Parameters of the node.
        pair: The pair whose cameras are wanted, None for the last CameraInfo.

    Raises:
        RigError: They are invalid, or the images are not what ``rectified`` says.
    """
    rig = config.rig_from_parameters()
    if rig is not None:
        return StereoRectifier.of_rig(rig)
    left, right = source.camera_infos if pair is None else source.camera_infos_of(pair)
    if left is None or right is None:
        return None
    rectifier = StereoRectifier.from_camera_info(left, right, config.rectified)
    if rectifier.cameras is not None:
        remedy = _RECTIFIED_REMEDY if config.rectified else _RAW_REMEDY
        check_claim(rectifier.cameras, source.topics[:2], config.rectified, remedy)
    return rectifier


def no_pair_reason(source: PairSource, config: NodeConfig, before: PairCounts, elapsed_s: float) -> str:
    """Return why no pair was formed: which side is missing, or how far the stamps are apart.

    Args:
        source: Where the frames should have come from.
        config: Parameters of the node.
        before: Counts at the beginning of the wait.
        elapsed_s: Length of the wait [s].
    """
    state, topics = source.state, source.topics
    added = state.counts.since(before)
    text = (
        f"no pair in {elapsed_s:.1f} s: left {added.left / elapsed_s:.1f} Hz, "
        f"right {added.right / elapsed_s:.1f} Hz; "
    )
    silent = [topic for topic, count in ((topics.left, added.left), (topics.right, added.right)) if not count]
    if silent:
        named = " and ".join(f"{topic} ({publishers_text(source, topic)})" for topic in silent)
        why = "; ".join(state.mismatches) or "start the camera, remap the topic or check its QoS"
        return f"{text}nothing arrives on {named}: {why}"
    return text + _unpaired_reason(source.pattern, config)


def _unpaired_reason(pattern: StampPattern, config: NodeConfig) -> str:
    """Return why images of both sides formed no pair, with the remedy."""
    if pattern.cause is NoPairCause.QUEUE:
        return (
            f"{pattern}, which is tolerated, but none was formed: raise queue_size from {config.queue_size}"
        )
    if pattern.cause is NoPairCause.LOST:
        return f"{pattern}; no tolerance helps: {_LOST_REMEDY}"
    if pattern.cause is NoPairCause.UNCLEAR:
        return f"{pattern}; {_LOST_REMEDY}, or synchronise the cameras"
    suggested_s = pattern.tolerance_s
    if suggested_s is None:
        return str(pattern)
    if not config.approximate_sync:
        return (
            f"{pattern}: set approximate_sync, and approximate_sync_tolerance_seconds to {suggested_s:g} "
            f"({pattern.half_frame}), or synchronise the cameras"
        )
    return (
        f"{pattern}, approximate_sync_tolerance_seconds allows "
        f"{config.approximate_sync_tolerance_seconds * 1e3:.3f} ms: raise it to {suggested_s:g} "
        f"({pattern.half_frame}), or synchronise the cameras"
    )


def publishers_text(source: PairSource, topic: str) -> str:
    """Return the number of publishers of a topic, in words."""
    count = source.publishers(topic)
    return "1 publisher" if count == 1 else f"{count} publishers"
