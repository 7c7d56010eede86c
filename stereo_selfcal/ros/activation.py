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

"""Activates calibrations and takes them back: all that depends on them, at once."""

from __future__ import annotations

import threading
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from rclpy.node import Node

from ..core.camera.rectifier import StereoRectifier
from ..core.camera.rig import StereoRig
from ..core.errors import ConfigError, RigError, printable
from ..core.results import CalibrationResult
from ..core.types import Array
from ..files.frames import FrameNames, InfoFrames, PlacedCamera, place_camera
from ..files.node_settings import CAMERA_FRAME
from ..files.result_file import restore, restore_old_default
from ..files.saved_result import check_fits, topics_source
from .calibration_keeper import ActiveCalibration, CalibrationKeeper
from .config import NodeConfig
from .outputs import Outputs, Publication
from .pair_source import Topics
from .parameters import NodeParameters
from .store import keep_aside, restored_calibration, save


@dataclass(frozen=True, slots=True, eq=False)
class FoundCalibration:
    """A calibration that a call or the watch has found.

    Attributes:
        result: The result.
        rig: The rig it holds for.
        stamp_ns: Stamp of the last frame in it [ns].
        cameras: The cameras of its frames, None where they are not known.
        lanes: Lane lines of the last frame on the road, each (N, 2) [m]; empty where they are not known.
        by_watch: Whether the watch has found it.
    """

    result: CalibrationResult
    rig: StereoRig
    stamp_ns: int
    cameras: StereoRectifier | None
    lanes: tuple[Array, ...] = ()
    by_watch: bool = False


class Activation:
    """Activates calibrations and takes them back, one at a time, whichever thread asks for it.

    Args:
        node: The node, for its log and clock.
        parameters: Its parameters.
        outputs: What it publishes.
        keeper: Keeps the active calibration.
        topics: Topics of its images.
        infos: Returns what CameraInfo calls the cameras; None before both have come.
    """

    def __init__(
        self,
        node: Node,
        parameters: NodeParameters,
        outputs: Outputs,
        keeper: CalibrationKeeper,
        topics: Topics,
        infos: Callable[[], InfoFrames | None],
    ) -> None:
        self._node = node
        self._parameters = parameters
        self._outputs = outputs
        self._keeper = keeper
        self._topics = topics.left, topics.right
        self._infos = infos
        self._lock = threading.Lock()  # a call and the watch may publish at the same time
        self._files: set[Path] = set()  # result files of this run
        self._published: Publication | None = None
        self._frames: tuple[FrameNames, InfoFrames] | None = None  # those it was published with

    def restore(self) -> None:
        """Activate the calibration of the last run; to be called before the node is spun."""
        config, logger = self._parameters.config, self._node.get_logger()
        if config.output_path is None:
            return
        restored = restore(config.output_path, self._topics)
        if restored.path is None and self._parameters.output_is_default:
            restored = restore_old_default(self._topics)
        if restored.of_others:
            logger.warning(restored.problem)
        elif restored.problem:
            logger.error(restored.problem)
        if restored.problem:
            self._keeper.reject(restored.problem)
        if restored.saved is None or restored.path is None:
            return
        now_s = self._node.get_clock().now().nanoseconds / 1e9
        active = restored_calibration(restored.saved, restored.path, now_s)
        problem = other_cameras(active.rig, _rig_of(config))
        if problem:
            logger.warning(f"{printable(str(restored.path))} is not used: {problem}")
            self._keeper.reject(problem)
            return
        self._files.add(restored.path)
        # Which frame camera_frame is, the CameraInfo to come will tell.
        publication = self._publication(active, config, restored.saved.stamp_ns, self._infos())
        self._outputs.publish_now(publication)
        self._published = publication
        self._keeper.load(active)
        logger.info("; ".join([f"{active.saved}: {active.result.message}", *self.told]))

    @property
    def placed(self) -> PlacedCamera | None:
        """The camera in the vehicle as it is published; None where it is not."""
        published = self._published
        return None if published is None else published.placed

    @property
    def told(self) -> tuple[str, ...]:
        """What is to be known of the published transform, a sentence each; none where all is well."""
        placed = self.placed
        each = (placed.yaw_remark, placed.problem, self._outputs.outdated) if placed is not None else ()
        return tuple(filter(None, (*each, self._outputs.conflict)))

    def follow_frames(self, infos: InfoFrames) -> None:
        """Publish where the camera is in the vehicle anew, where the names of frames or its place are new.

        To be called from the default callback group.

        Args:
            infos: What CameraInfo calls the cameras now.
        """
        if not self._lock.acquire(blocking=False):  # what is being published has the newest frames
            return
        try:
            published, active = self._published, self._keeper.active
            config = self._parameters.config
            if published is None or active is None or self._frames == (config.frame_names, infos):
                return
            before = self.told
            again = self._publication(active, config, published.stamp_ns, infos)
            self._published = replace(again, lanes=published.lanes, pair=published.pair)
            self._outputs.publish_camera(self._published)
            for text in self.told:
                if text not in before:
                    self._node.get_logger().warning(text)
        finally:
            self._lock.release()

    def _publication(
        self, active: ActiveCalibration, config: NodeConfig, stamp_ns: int, infos: InfoFrames | None
    ) -> Publication:
        """Return a calibration to be published, with the camera in the vehicle where its frames are known.

        The default name of the camera is taken for its body before CameraInfo has come, as hardly any camera
        is called so. ``/tf_static``, which cannot be taken back, waits all the same.
        """
        names = config.frame_names
        self._frames = None if infos is None else (names, infos)
        if infos is None and names.camera_frame != CAMERA_FRAME:
            return Publication(active.result, config, stamp_ns)
        placed = place_camera(active.result, active.rig, names, infos or InfoFrames())
        return Publication(active.result, config, stamp_ns, placed=placed, frames_told=infos is not None)

    def activate(
        self, found: FoundCalibration, config: NodeConfig, is_wanted: Callable[[], bool]
    ) -> str | None:
        """Publish, activate and save a calibration.

        Args:
            found: The calibration.
            config: Parameters it was found with.
            is_wanted: Returns whether it is wanted still; asked when nothing can come in between any more.

        Returns:
            Where it was saved, or why it was not, and what is to be known of its transform; None where it was
            not wanted, and nothing was done.
        """
        result = found.result
        with self._lock:
            if not is_wanted():
                return None
            active = ActiveCalibration(
                result, found.rig, time.monotonic(), saved="not yet", cameras=found.cameras
            )
            pair = next(iter(active.repaired_pairs), None) if config.publish_camera_info else None
            infos = self._infos() if found.cameras is None or config.rig else InfoFrames.of(found.cameras)
            publication = self._publication(active, config, found.stamp_ns, infos)
            publication = replace(publication, lanes=found.lanes, pair=pair)
            self._outputs.publish(publication)
            self._published = publication
            # It is active from here on, even if it cannot be saved.
            self._keeper.accept(active, found.by_watch)
            if config.output_path is not None:
                self._files.add(config.output_path)
            try:
                asked = None if found.by_watch or config.targets.any_std else config.targets
                saved, failed = save(active, config, topics_source(*self._topics), self.placed, asked)
            except Exception as error:  # noqa: BLE001 - it is in effect, so the answer is no failure
                self._node.get_logger().error(traceback.format_exc())
                saved = f"in effect, but not saved: {type(error).__name__}: {error}, see the node's log"
                failed = True
            self._keeper.saved(saved, failed)
            return "; ".join([*self.told, saved])

    def withdraw(self, problem: str) -> None:
        """Take the calibration back, as it is of other cameras; its file stays."""
        with self._lock:
            self._keeper.withdraw(problem)
            self._published = self._frames = None
            self._outputs.withdraw()

    def reset(self) -> tuple[str, bool]:
        """Take the calibration back, and keep the files aside that the next start would restore.

        Returns:
            What was done, in words; and whether the next start finds nothing.
        """
        with self._lock:
            active = self._keeper.reset()
            self._published = self._frames = None
            path = self._parameters.config.output_path
            files = self._files if path is None else self._files | {path}
            kept, failed = keep_aside(
                sorted(files), self._topics, old_default=self._parameters.output_is_default
            )
            if not failed:
                self._files.clear()
            if active is not None:
                self._outputs.withdraw()
        taken = "there was no active calibration" if active is None else "the calibration is taken back"
        return "; ".join(filter(None, (taken, kept))), not failed


def other_cameras(calibrated: StereoRig, rig: StereoRig | None) -> str:
    """Return why a calibration is not of these cameras; "" if it is, or if they are not known."""
    if rig is None:
        return ""
    try:
        check_fits(calibrated, rig)
    except ConfigError as error:
        return str(error)
    return ""


def _rig_of(config: NodeConfig) -> StereoRig | None:
    """Return the rig of the parameters; None where it comes from CameraInfo, or is invalid."""
    try:
        return config.rig_from_parameters()
    except RigError:  # reported when the rig is needed
        return None
