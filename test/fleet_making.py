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

"""Recordings and settings for the tests of the fleet; workers import it as well."""

import os
import shutil
import signal
import time
from dataclasses import dataclass
from pathlib import Path

from stereo_selfcal.core.config import CalibratorConfig
from stereo_selfcal.fleet.scheduling import FleetRun
from stereo_selfcal.fleet.store import Bag
from stereo_selfcal.fleet.work import FleetSettings
from stereo_selfcal.fleet.workers import Failure
from stereo_selfcal.synth.bag import write_bag
from stereo_selfcal.synth.scenes import custom_scene

# For tests of what becomes of recordings and not of their numbers: lines alone, in a quarter of the time.
QUICK = CalibratorConfig.from_mapping({"texture": {"check": 0}})
_QUICK_FILE = "/**: {ros__parameters: {texture: {check: 0}}}\n"


def quick_options(folder: Path) -> list[str]:
    """Return options of the command that mean QUICK; their file is written into the folder."""
    path = folder / "quick.yaml"
    path.write_text(_QUICK_FILE, encoding="utf-8")
    return ["--config", str(path)]


def make_bags(folder: Path, n: int, n_frames: int = 2) -> list[Path]:
    """Write small recordings of different roads."""
    folder.mkdir(exist_ok=True)
    paths = [folder / f"road{index}" for index in range(n)]
    for index, path in enumerate(paths):
        height_m = 1.3 + 0.05 * index
        write_bag(path, custom_scene(name=path.name, n_frames=n_frames, height_m=height_m, seed=index))
    return paths


def make_copies(folder: Path, n: int, n_frames: int = 2) -> list[Path]:
    """Write small recordings of one road, for tests of what becomes of them; one of them is rendered."""
    (first,) = make_bags(folder, 1, n_frames)
    copies = [folder / f"road{index}" for index in range(1, n)]
    for path in copies:
        shutil.copytree(first, path)
    return [first, *copies]


# Dask does not replace a worker that dies before its nanny has heard of its start.
NANNY_HEARS_S = 1.0
FOR_EVER_S = 1000.0
LATE_S = 0.8


@dataclass(frozen=True, slots=True)
class Deadly(FleetSettings):
    """Settings under which recordings of some names kill the process that opens them, or hang.

    Attributes:
        always: Names of recordings that always do.
        once: A file that a recording of the name of its stem leaves, and dies, if it is not there.
        after_s: How long a process lives before it is killed [s].
        hanging: Names of recordings that never open.
        stopping: Names of recordings that stop the process.
    """

    always: tuple[str, ...] = ()
    once: str = ""
    after_s: float = 0.0
    hanging: tuple[str, ...] = ()
    stopping: tuple[str, ...] = ()

    def open(self, path):
        if path.name in self.hanging:
            time.sleep(FOR_EVER_S)
        if path.name in self.stopping:
            os.kill(os.getpid(), signal.SIGSTOP)
        marker = Path(self.once)
        first = self.once and path.name == marker.stem and not marker.exists()
        if first:
            marker.touch()
        if first or path.name in self.always:
            time.sleep(self.after_s)
            os.kill(os.getpid(), signal.SIGKILL)
        return FleetSettings.open(self, path)


@dataclass(frozen=True, slots=True)
class Slow(FleetSettings):
    """Settings under which every frame takes a while to be read, without any work."""

    def open(self, path):
        source = FleetSettings.open(self, path)
        frames = source.frames

        def late():
            for frame in frames():
                time.sleep(LATE_S)
                yield frame

        source.frames = late
        return source


def deadly(always=(), once="", **more):
    return Deadly(QUICK, always=tuple(always), once=str(once), **more)


def run_fleet(workers, paths, settings, patience_s=180.0, **options):
    """Calibrate recordings and return what became of each by its name; fail where nothing comes in."""
    done = {}

    def on_done(item):
        assert item.bag.path.name not in done
        done[item.bag.path.name] = item

    end_s = time.monotonic() + patience_s

    def on_wait():
        assert time.monotonic() < end_s, "nothing comes in: is a worker left?"

    bags = [Bag.of(path, settings) for path in paths]
    FleetRun(workers, settings, **options).run(bags, on_done, on_wait)
    return done


def report_of(path, settings, calibrated):
    """Make something that stands for a report; fail for one recording."""
    if path.endswith("road1"):
        return Failure("no report today")
    return f"<p>{calibrated.replay.estimate.message}</p>".encode()
