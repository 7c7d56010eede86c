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

"""The pose over the road at this moment: against cold frames, and over a ROS graph at 10 Hz.

The camera, the node, and who listens are processes of their own (:mod:`.graph`).
"""

from __future__ import annotations

import json
import math
import signal
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from stereo_selfcal import CalibrationResult, Calibrator, Extrinsics, StereoRig
from stereo_selfcal.core.config import CalibratorConfig
from stereo_selfcal.core.road.priors import RIDE_MEMORY_S, RIDE_STD
from stereo_selfcal.core.road_now import RoadTracker
from stereo_selfcal.core.types import Array, Image
from stereo_selfcal.synth.renderer import render
from stereo_selfcal.synth.scenes import LEFT_PHOTOMETRY, PAPER_RIG, RIGHT_PHOTOMETRY
from stereo_selfcal.synth.world import LaneLine, Road, Scene

from .idle import cpu_s, process
from .mount_drives.rides import STEP_S, Ride, driven
from .options import RESULTS, Options
from .road_pairs import RoadPair, pairs_of
from .table import NothingToMeasureError, Table

HZ = 10.0
RIG = StereoRig(1280, 720, 1033.2, 1033.2, 639.5, 359.5, PAPER_RIG.baseline_m)
_TRUTH = np.array([1.4, math.radians(3.0), math.radians(0.5)])
_LANE_YAW_RAD, _LATERAL_M = 0.01, 0.1
_SPEED_MPS = 13.9
_SEED = 22
# A brake pitches the car for the middle third of the drive.
_BRAKE_RAD = math.radians(1.0)
_FRAMES, _QUICK_FRAMES = 60, 12
# Standard deviation of the texture of the road [grey levels]: one whose surface is seen, and one that only
# its lines tell.
ROADS = {"rendered, textured": 10.0, "rendered, bare, two lines": 3.0}
RECORDED = ("kitti_odometry07", "kitti_odometry02")
_MEASURED_S, _QUICK_S = 60.0, 10.0
_SETTLE_S = 6.0
_FOLLOWED_S = 0.2


@dataclass(frozen=True, eq=False)
class SeenDrive:
    """A drive, and what cold frames see of it.

    Attributes:
        name: Of the drive.
        rig: Its rig.
        frames: Left and right image of each frame, at :data:`HZ`.
        cold: Result of each frame, looked at as if nothing were known.
        cold_ms: Processor time of each [ms].
        mount: The mount, by the frames before the brake.
        truth: (N, 3) poses [m, rad, rad]; NaN where they are not known.
    """

    name: str
    rig: StereoRig
    frames: list[tuple[Image, Image]]
    cold: list[CalibrationResult]
    cold_ms: list[float]
    mount: CalibrationResult
    truth: Array


def road_pose_tables(options: Options) -> Iterator[Table]:
    """Follow the road in recorded and rendered drives, then in the process of the node."""
    whole = options.folder == RESULTS
    rendered = [_seen(name, RIG, *_rendered(each, whole)) for name, each in ROADS.items()]
    yield _followed_table([*_recorded(options), *rendered])
    yield _graph_table(rendered, _MEASURED_S if whole else _QUICK_S)


def _recorded(options: Options) -> Iterator[SeenDrive]:
    for name in RECORDED:
        try:
            pairs: list[RoadPair] = list(pairs_of((name,)))[: None if options.folder == RESULTS else 6]
        except NothingToMeasureError:
            continue
        frames = [(pair.left, pair.right) for pair in pairs]
        yield _seen(name, pairs[0].rig, frames, np.full((len(frames), 3), np.nan))


def _rendered(texture: float, whole: bool) -> tuple[list[tuple[Image, Image]], Array]:
    """Render a drive with a brake; return its frames and its poses (N, 3)."""
    count = _FRAMES if whole else _QUICK_FRAMES
    rng = np.random.default_rng(_SEED)
    lines = (LaneLine(-1.75), LaneLine(1.75, dash_m=4.0, gap_m=2.0))
    road = Road(lines=lines, texture_amplitude=texture, texture_seed=_SEED)
    ride = driven(Ride(np.array(RIDE_STD), RIDE_MEMORY_S), count / HZ, rng)
    frames, poses = [], []
    for index in range(count):
        pose = _TRUTH + ride.motion[round(index / HZ / STEP_S)]
        if _brakes(index, count):
            pose = pose + np.array([0.0, _BRAKE_RAD, 0.0])
        scene = Scene(
            RIG,
            Extrinsics.from_array(pose),
            _LANE_YAW_RAD,
            _LATERAL_M,
            _SPEED_MPS * index / HZ,
            road,
            left=LEFT_PHOTOMETRY,
            right=RIGHT_PHOTOMETRY,
        ).with_noise(0.01)
        left, right = render(scene, np.random.default_rng([_SEED, index]))
        frames.append((left, right))
        poses.append(pose)
    return frames, np.array(poses)


def _brakes(index: int, count: int) -> bool:
    return count // 3 <= index < 2 * count // 3


def _seen(name: str, rig: StereoRig, frames: list[tuple[Image, Image]], truth: Array) -> SeenDrive:
    """Look at every frame cold."""
    calibrator = Calibrator(rig)
    cold, cold_ms = [], []
    moved = bool(np.all(np.isfinite(truth)))
    for index, images in enumerate(frames):
        result, spent_ms = _clocked(lambda: calibrator.calibrate_frame(*images, index / HZ))  # noqa: B023
        cold.append(result)
        cold_ms.append(spent_ms)
        if not (moved and index >= len(frames) // 3):
            calibrator.remember(result)
    return SeenDrive(name, rig, frames, cold, cold_ms, calibrator.estimate, truth)


def _clocked(look: Callable[[], CalibrationResult]) -> tuple[CalibrationResult, float]:
    start = time.thread_time()
    result = look()
    return result, 1e3 * (time.thread_time() - start)


def _followed_table(drives: list[SeenDrive]) -> Table:
    table = Table(
        "road_pose",
        "The road at this moment, followed by the known camera, against cold frames",
        [
            "drive",
            "frames",
            "accepted",
            "cold ones accepted",
            "from the known camera",
            "within 1 std of the cold frame",
            "difference over its std (rms)",
            "std over that of the cold frame",
            "error over std (rms)",
            "ms, median",
            "cold",
        ],
        "Frames at 10 Hz, in order. Cells of three are height / pitch / roll. The std is that of the cold "
        "frame. Times are processor time of one thread. The mount is that of the same drive; rendered ones "
        "brake by 1 deg in their middle third, which the mount has not seen.",
    )
    for drive in drives:
        table.add(drive.name, *_followed_cells(drive))
    return table


def _followed_cells(drive: SeenDrive) -> list[str]:
    tracker = RoadTracker(drive.rig, CalibratorConfig(), drive.mount)
    results, known_ms, sigmas, ratios, errors = [], [], [], [], []
    for index, (images, cold, truth) in enumerate(zip(drive.frames, drive.cold, drive.truth, strict=True)):
        result, spent_ms = _clocked(lambda: tracker.follow(*images, index / HZ))  # noqa: B023
        results.append(result)
        if not result.known_start:
            continue
        known_ms.append(spent_ms)
        if result.extrinsics is None or result.std is None:
            continue
        pose, std = result.extrinsics.as_array(), result.std.as_array()
        if np.all(np.isfinite(truth)):
            errors.append((pose - truth) / std)
        if cold.extrinsics is not None and cold.std is not None:
            sigmas.append((pose - cold.extrinsics.as_array()) / cold.std.as_array())
            ratios.append(std / cold.std.as_array())
    within = np.mean(np.abs(sigmas) <= 1.0, axis=0)
    return [
        str(len(results)),
        str(sum(result.accepted for result in results)),
        str(sum(result.accepted for result in drive.cold)),
        str(len(sigmas)),
        " / ".join(f"{each:.0%}" for each in within),
        _three(_rms(sigmas)),
        _three(np.median(ratios, axis=0)),
        _three(_rms(errors)) if errors else "-",
        f"{np.median(known_ms):.0f}",
        f"{np.median(drive.cold_ms):.0f}",
    ]


def _graph_table(drives: list[SeenDrive], seconds: float) -> Table:
    table = Table(
        "road_pose_graph",
        f"~/road_pose over a graph: two topics of 1280 x 720 mono8 at {HZ:g} Hz",
        [
            "drive",
            "CPU while nobody listens",
            "CPU",
            "frames sent",
            "poses",
            "latency, median",
            "90 %",
            "worst",
            "within 1 std of the cold frame",
            "brake of 1 deg followed after",
        ],
        f"The node with its watch, for {seconds:.0f} s after {_SETTLE_S:.0f} s. CPU is that of the node's "
        "process, of a core. The latency is that from the stamp of the images, taken before they are sent, "
        "to the arrival of the pose in another process. A brake is followed by the first pose that is "
        "nearer to its pitch than to the one before; the worst of both steps of each round. Asked: "
        f"{_FOLLOWED_S:g} s. Where other work runs, this is to be measured with a priority above it, as the "
        "answers are.",
    )
    for drive in drives:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "drive.npz"
            np.savez(path, frames=np.array(drive.frames))
            with process("drive", str(path)) as camera, process("node", "watch") as node:
                with process("calibrate", "0.1") as caller:
                    caller.wait()
                time.sleep(_SETTLE_S)
                quiet = _core(node.pid, seconds / 3.0)
                with process("listen", str(seconds + _SETTLE_S)) as listener:
                    time.sleep(_SETTLE_S)
                    core = _core(node.pid, seconds)
                    heard = json.loads(listener.communicate()[0])
                camera.send_signal(signal.SIGINT)
                stamps = json.loads(camera.communicate()[0])
        table.add(drive.name, f"{quiet:.0%}", f"{core:.0%}", *_heard_cells(drive, stamps, heard))
    return table


def _core(pid: int, seconds: float) -> float:
    start_s, before_s = time.monotonic(), cpu_s(pid)
    time.sleep(seconds)
    return (cpu_s(pid) - before_s) / (time.monotonic() - start_s)


def _heard_cells(drive: SeenDrive, stamps: list[int], heard: list[list[float]]) -> list[str]:
    """Return the cells of what was heard.

    Args:
        drive: The drive that was sent, over and over.
        stamps: Stamp of each pair that was sent [ns].
        heard: Stamp and arrival of each pose [ns], its height, pitch and roll.
    """
    index_of = {stamp: number % len(drive.frames) for number, stamp in enumerate(stamps)}
    # The first ones are from before the node had found who listens.
    heard = heard[round(HZ) :]
    latency_ms = np.array([(arrived - stamp) / 1e6 for stamp, arrived, *_ in heard])
    sent = [stamp for stamp in stamps if heard[0][0] <= stamp <= heard[-1][0]]
    sigmas = []
    for stamp, _, *pose in heard:
        cold = drive.cold[index_of[int(stamp)]]
        if cold.extrinsics is not None and cold.std is not None:
            sigmas.append((np.array(pose) - cold.extrinsics.as_array()) / cold.std.as_array())
    return [
        str(len(sent)),
        str(len(heard)),
        *(f"{np.percentile(latency_ms, q):.0f} ms" for q in (50, 90, 100)),
        " / ".join(f"{each:.0%}" for each in np.mean(np.abs(sigmas) <= 1.0, axis=0)),
        _brake_cell(drive, index_of, heard),
    ]


def _brake_cell(drive: SeenDrive, index_of: dict[int, int], heard: list[list[float]]) -> str:
    """Return how long after the images of a step of the pitch it is followed: median and worst."""
    delays = []
    for (before, here), (after, there) in pairwise(index_of.items()):
        steps = _brakes(here, len(drive.frames)) != _brakes(there, len(drive.frames))
        if not steps or before < heard[0][0] or after > heard[-1][0]:
            continue
        middle = float(drive.truth[[here, there], 1].mean())
        side = math.copysign(1.0, drive.truth[there, 1] - middle)
        arrivals = [one[1] for one in heard if one[0] >= after and side * (one[3] - middle) > 0.0]
        if arrivals:
            delays.append((arrivals[0] - after) / 1e9)
    if not delays:
        return "-"
    return f"{np.median(delays):.2f} s, at worst {max(delays):.2f} s ({len(delays)} steps)"


def _rms(values: list[Array]) -> Array:
    rms: Array = np.sqrt(np.mean(np.square(values), axis=0))
    return rms


def _three(values: Array) -> str:
    return " / ".join(f"{each:.2f}" for each in values)
