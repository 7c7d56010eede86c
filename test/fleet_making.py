"""Recordings and settings for the tests of the fleet; workers import it as well."""

import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path

from stereo_selfcal.core.config import CalibratorConfig
from stereo_selfcal.fleet.work import Failure, FleetSettings
from stereo_selfcal.synth.bag import write_bag
from stereo_selfcal.synth.scenes import custom_scene


def make_bags(folder: Path, n: int, n_frames: int = 2) -> list[Path]:
    """Write small recordings of different roads."""
    folder.mkdir(exist_ok=True)
    paths = [folder / f"road{index}" for index in range(n)]
    for index, path in enumerate(paths):
        height_m = 1.3 + 0.05 * index
        write_bag(path, custom_scene(name=path.name, n_frames=n_frames, height_m=height_m, seed=index))
    return paths


NANNY_HEARS_S = 1.0


@dataclass(frozen=True, slots=True)
class Deadly(FleetSettings):
    """Settings under which recordings of some names kill the process that opens them.

    Attributes:
        always: Names of recordings that always do.
        once: A file that a recording of the name of its stem leaves, and dies, if it is not there.
    """

    always: tuple[str, ...] = ()
    once: str = ""

    def open(self, path):
        marker = Path(self.once)
        first = self.once and path.name == marker.stem and not marker.exists()
        if first:
            marker.touch()
        if first or path.name in self.always:
            # Dask does not replace a worker that dies before its nanny has heard of its start.
            time.sleep(NANNY_HEARS_S)
            os.kill(os.getpid(), signal.SIGKILL)
        return FleetSettings.open(self, path)


def deadly(always=(), once=""):
    return Deadly(CalibratorConfig(), always=tuple(always), once=str(once))


def report_of(path, settings, calibrated):
    """Make something that stands for a report; fail for one recording."""
    if path.endswith("road1"):
        return Failure("no report today")
    return f"<p>{calibrated.replay.estimate.message}</p>".encode()
