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

"""``replay`` on recordings of many frames: processor time, memory over their length, where the time goes.

Every measurement is a process of its own, as users start it. Processor time is quoted, since it does not
depend on what else the machine does; the wall time is beside it.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np

from stereo_selfcal import Calibrator, StereoRig
from stereo_selfcal.bags import StereoFrame
from stereo_selfcal.core.camera.image_messages import decode_compressed
from stereo_selfcal.offline import open_source
from stereo_selfcal.synth.bag import Storage, write_bag
from stereo_selfcal.synth.scenes import FIRST_STAMP_S, NamedScene, RenderedPair, named_scene

from .options import Options
from .parts import clocked_parts
from .table import Table

ROOT = Path(__file__).resolve().parents[1]

LENGTHS = (100, 400, 1600)
SIZES = ((640, 480), (1280, 960), (1920, 1440))
SIZE_FRAMES = 30
# Standard deviation of the texture of the road [grey levels]: as the scene has it, so that its lines alone
# tell the pose, or so that its surface does.
ROADS: dict[str, float | None] = {"bare": None, "textured": 45.0}
# Different frames of a recording, which is these over and over: rendering is slower than calibrating.
N_RENDERED = 10
GOAL_FRAMES, GOAL_S, GOAL_JOBS = 6000, 60, 2  # ten minutes at 10 Hz
_POLL_S = 0.05
_MEBIBYTE = 2**20


class Repeated(NamedScene):
    """A drive whose images are a few, over and over."""

    def frame(self, index: int) -> RenderedPair:
        """Return a frame with the stamp of its own."""
        frame = _rendered(replace(self, n_frames=N_RENDERED), index % N_RENDERED)
        return frame._replace(stamp_s=FIRST_STAMP_S + index / self.rate_hz)


@lru_cache(maxsize=N_RENDERED)
def _rendered(scene: NamedScene, index: int) -> RenderedPair:
    return NamedScene.frame(scene, index)


@dataclass(frozen=True, slots=True)
class Cost:
    """What a run of replay took.

    Attributes:
        wall_s: Time [s].
        cpu_s: Processor time of all its processes [s].
        memory: Peak of resident memory, summed over its processes [B].
        accepted: Whether it calibrated.
    """

    wall_s: float
    cpu_s: float
    memory: int
    accepted: bool


def offline_tables(options: Options) -> Iterator[Table]:
    """Time and memory of replay over length and size, and the parts of the time."""
    lengths = LENGTHS if options.all_sizes else LENGTHS[:2]
    sizes = SIZES if options.all_sizes else SIZES[:1]
    with tempfile.TemporaryDirectory() as folder:
        yield _length_table(Path(folder), lengths)
        yield _size_table(Path(folder), sizes)
        yield _part_table(Path(folder))


def _length_table(folder: Path, lengths: tuple[int, ...]) -> Table:
    table = Table(
        "offline_lengths",
        "replay over the length of a recording",
        ["road", "frames", "jobs", "wall s", "processor s", "processor ms per frame", "peak memory MiB"],
    )
    first, last = lengths[0], lengths[-1]
    taken = []
    for road, texture in ROADS.items():
        costs: dict[int, Cost] = {}
        for n_frames in lengths:
            path = recording(folder / f"{road}_{n_frames}", n_frames, *SIZES[0], texture=texture)
            for jobs in (1, GOAL_JOBS):
                costs[n_frames] = replay_cost(path, jobs)
                table.add(road, str(n_frames), str(jobs), *_cells(costs[n_frames], n_frames))
        ten_minutes_s = (costs[last].cpu_s - costs[first].cpu_s) / (last - first) * GOAL_FRAMES
        taken.append(
            f"{ten_minutes_s:.0f} s ({ten_minutes_s / GOAL_JOBS:.0f} s on {GOAL_JOBS} cores, {road})"
        )
    table.note = (
        "640 x 480, mcap with zstd, with --json. The wall time depends on what else the machine does. "
        f"{GOAL_FRAMES} frames (10 minutes at 10 Hz) take {' and '.join(taken)} of processor time by the "
        f"difference of the shortest and the longest, where the cores are busy; the goal is {GOAL_S} s."
    )
    return table


def _size_table(folder: Path, sizes: tuple[tuple[int, int], ...]) -> Table:
    table = Table(
        "offline_sizes",
        "replay over the size of the images",
        ["size", "jobs", "wall s", "processor s", "processor ms per frame", "peak memory MiB"],
        f"{SIZE_FRAMES} frames.",
    )
    for size in sizes:
        path = recording(folder / f"size_{size[0]}", SIZE_FRAMES, *size)
        for jobs in (1, 2):
            table.add(f"{size[0]} x {size[1]}", str(jobs), *_cells(replay_cost(path, jobs), SIZE_FRAMES))
    return table


def _part_table(folder: Path) -> Table:
    table = Table(
        "offline_parts",
        "Where the time of a frame goes",
        ["part", "process", "ms"],
        "640 x 480, one thread, processor time. The reading process and the workers work at the same time.",
    )
    n_frames = 4 * N_RENDERED
    for storage in ("mcap", "sqlite3"):
        path = recording(folder / f"parts_{storage}", n_frames, *SIZES[0], storage=storage)
        with open_source([path]) as source:
            start = time.process_time()
            frames = list(source.frames())
            rig = source.rig
        what = "mcap, zstd" if storage == "mcap" else "sqlite3"
        table.add(f"reading, unpacking, pairing ({what})", "reader", _ms(start, n_frames))
    for suffix in (".png", ".jpg"):
        packed = [cv2.imencode(suffix, frame.left)[1] for frame in frames[:N_RENDERED]]
        start = time.process_time()
        for each in packed:
            decode_compressed(each, suffix)
        what = f"decoding a pair of CompressedImage ({suffix[1:]}), if it is one"
        table.add(what, "reader", _ms(start, len(packed) / 2))
    start = time.process_time()
    for frame in frames:
        pickle.loads(pickle.dumps(frame, -1))
    table.add("handing the images to a worker", "both", _ms(start, n_frames))
    calibrator = Calibrator(rig)
    with clocked_parts() as spent:
        start = time.process_time()
        for frame in frames:
            calibrator.calibrate_frame(frame.left, frame.right, frame.stamp_s)
    whole_s = time.process_time() - start
    for name, seconds in spent.items():
        table.add(name, "worker", f"{seconds / n_frames * 1e3:.2f}")
    table.add("all the rest", "worker", f"{(whole_s - sum(spent.values())) / n_frames * 1e3:.2f}")
    table.add("a cold frame, all of it", "worker", f"{whole_s / n_frames * 1e3:.2f}")
    followed = [_followed_ms(calibrator, frame) for frame in frames]
    known = [spent_ms for known_start, spent_ms in followed if known_start]
    table.add("a followed frame, all of it", "worker", f"{np.mean(known):.2f}" if known else "-")
    return table


def _followed_ms(calibrator: Calibrator, frame: StereoFrame) -> tuple[bool, float]:
    """Return whether the next frame was followed, and the processor time that it took [ms]."""
    start = time.process_time()
    result = calibrator.calibrate_next(frame.left, frame.right, frame.stamp_s)
    return result.known_start, (time.process_time() - start) * 1e3


def recording(
    path: Path,
    n_frames: int,
    width: int,
    height: int,
    storage: Storage = "mcap",
    texture: float | None = None,
) -> Path:
    """Write a recording of the paper's rig with cameras of a size, on a road with a texture [grey levels]."""
    named = named_scene("straight_road")
    rig = named.scene.rig
    focal_px = rig.fx * width / rig.width
    rig = StereoRig(width, height, focal_px, focal_px, (width - 1) / 2, (height - 1) / 2, rig.baseline_m)
    scene_of_rig = replace(named.scene, rig=rig)
    if texture is not None:
        road = replace(scene_of_rig.road, texture_amplitude=texture)
        scene_of_rig = replace(scene_of_rig, road=road)
    scene = Repeated(path.name, "for the clock", scene_of_rig, n_frames=n_frames)
    write_bag(path, scene, storage)
    return path


def replay_cost(path: Path, jobs: int) -> Cost:
    """Run replay as a process and measure it."""
    command = [sys.executable, "-m", "stereo_selfcal", "replay", str(path), "--json", "--jobs", str(jobs)]
    peaks: dict[int, int] = {}
    start = time.perf_counter()
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL) as process:
        while True:
            pid, status, usage = os.wait4(process.pid, os.WNOHANG)
            if pid:
                break
            _look(process.pid, peaks)
            time.sleep(_POLL_S)
        wall_s = time.perf_counter() - start
        process.returncode = os.waitstatus_to_exitcode(status)
    return Cost(wall_s, usage.ru_utime + usage.ru_stime, sum(peaks.values()), process.returncode == 0)


def _look(pid: int, peaks: dict[int, int]) -> None:
    """Note the peaks of resident memory of a process and of its children [B]."""
    with suppress(OSError, StopIteration, ValueError):
        lines = Path(f"/proc/{pid}/status").read_text(encoding="ascii", errors="replace").splitlines()
        peaks[pid] = int(next(line for line in lines if line.startswith("VmHWM")).split()[1]) * 1024
        for child in Path(f"/proc/{pid}/task/{pid}/children").read_text(encoding="ascii").split():
            _look(int(child), peaks)


def _cells(cost: Cost, n_frames: int) -> tuple[str, str, str, str]:
    if not cost.accepted:
        raise RuntimeError("replay did not calibrate")
    per_frame_ms = cost.cpu_s / n_frames * 1e3
    return (
        f"{cost.wall_s:.1f}",
        f"{cost.cpu_s:.1f}",
        f"{per_frame_ms:.1f}",
        f"{cost.memory / _MEBIBYTE:.0f}",
    )


def _ms(start_s: float, n: float) -> str:
    return f"{(time.process_time() - start_s) / n * 1e3:.2f}"
