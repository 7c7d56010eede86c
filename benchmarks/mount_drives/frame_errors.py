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

"""What frames of four rendered rigs and a recorded one report of themselves, and how wrong they are.

The frames are calibrated one by one. Of each, the table keeps the covariance of every cause and the error
against the truth. Drives are drawn from it, without any image (:mod:`.draws`).
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import count
from pathlib import Path

import numpy as np

from stereo_selfcal import Calibrator, Extrinsics, StereoRig
from stereo_selfcal.core.evidence.rig_unknowns import RIG_TERMS
from stereo_selfcal.core.geometry.uncertainty import UncertaintyTerm, total_covariance
from stereo_selfcal.core.types import Array

from ..frames import READABLE
from ..options import RESULTS, Options
from ..road_pairs import kitti_frames
from ..road_verdicts import in_processes
from ..second_worlds.cameras import Mount
from ..second_worlds.drafts import Draft, furnish, ordinary
from ..second_worlds.worlds import World, finished
from ..table import NothingToMeasureError, Table

# Rigs of the second generator that are rendered, and the one pose each is mounted in: height [m], pitch, roll
# and yaw [deg], place in the lane [m].
MOUNTS = {
    "kitti": (1.65, 0.9, 0.3, -0.3, 0.1),
    "zed": (1.25, 4.0, -0.8, 0.5, -0.1),
    "oak": (1.20, 3.0, 0.6, -0.4, 0.2),
    "paper": (1.35, 3.5, -0.5, 0.3, 0.0),
}
RECORDED = "kitti recorded"
RIG_NAMES = (RECORDED, *MOUNTS)
FRAMES_CSV = RESULTS / "mount_frames.csv"
# What a pair of cameras has, and a rendered one has not: errors of the rig, and a delay of one camera.
OF_PAIR = RIG_TERMS | {"synchronisation"}
_SEED = 21
# Frames of the quick run.
_FEW, _MANY = 3, 24
_LOWER = np.tril_indices(3)
_RIG_KEYS = ("width", "height", "fx", "fy", "cx", "cy", "baseline_m")
# A frame that is wrong by more is one of the bad ones, which drives have in numbers of their own.
_GROSS_SIGMAS = 6.0


@dataclass(frozen=True, eq=False)
class FrameError:
    """One calibrated frame.

    Attributes:
        rig_name: One of :data:`RIG_NAMES`.
        name: Of the frame.
        rig: Its rig.
        pose: The true pose (3,) [m, rad, rad].
        error: Estimate minus truth (3,).
        reference_std: Standard deviation of what is known of the truth (3,).
        terms: The causes of its uncertainty.
    """

    rig_name: str
    name: str
    rig: StereoRig
    pose: Array
    error: Array
    reference_std: Array
    terms: tuple[UncertaintyTerm, ...]

    @cached_property
    def of_road(self) -> tuple[UncertaintyTerm, ...]:
        """The causes that change from road to road."""
        return tuple(term for term in self.terms if term.name not in OF_PAIR)

    @cached_property
    def of_rig(self) -> tuple[UncertaintyTerm, ...]:
        """The causes that stay as long as the rig does."""
        return tuple(term for term in self.terms if term.name in RIG_TERMS)

    @cached_property
    def of_delay(self) -> tuple[UncertaintyTerm, ...]:
        """The causes that depend on a delay, and on how the car drives."""
        return tuple(term for term in self.terms if term.name in OF_PAIR - RIG_TERMS)

    @property
    def sigmas(self) -> Array:
        """The error over what it may be: a rendered rig is as it says, a recorded one is not."""
        terms = self.terms if self.rig_name == RECORDED else self.of_road
        variances = np.diag(total_covariance(terms)) + self.reference_std**2
        sigmas: Array = self.error / np.sqrt(variances)
        return sigmas


def frame_tables(options: Options) -> Iterator[Table]:
    """Calibrate the frames; one row for each cause of each frame."""
    number = _MANY if options.drives >= _MANY else _FEW
    tasks = [(name, index) for name in MOUNTS for index in range(number)]
    frames = [each for each in in_processes(_rendered, tasks, options.processes) if each is not None]
    try:
        frames += list(_recorded())
    except NothingToMeasureError:
        # What was measured of the recorded frames before is kept.
        frames += [each for each in read_frames(options.folder) if each.rig_name == RECORDED]
    yield scale_table(frames)
    table = Table(
        "mount_frames",
        "Frames from which drives are drawn",
        ["rig", "frame", *_RIG_KEYS, "pose", "error", "reference std", "term", "covariance"],
        "Heights in mm, angles in degrees. Covariances are lower triangles of (height, pitch, roll).",
        shown=False,
    )
    for each in frames:
        scale = np.outer(READABLE, READABLE)
        for term in each.terms:
            table.add(
                each.rig_name,
                each.name,
                *(f"{getattr(each.rig, key):.8g}" for key in _RIG_KEYS),
                _joined(each.pose * READABLE),
                _joined(each.error * READABLE),
                _joined(each.reference_std * READABLE),
                term.name,
                _joined((term.covariance * scale)[_LOWER]),
            )
    yield table


def scale_table(frames: list[FrameError]) -> Table:
    """Return how wrong the frames are against what they say."""
    table = Table(
        "mount_frame_errors",
        "Errors of the frames from which drives are drawn",
        ["rig", "frames", "error over std (rms)", "used", "std (median; mm, deg, deg)"],
        "Height / pitch / roll. A rendered rig has no error, so its terms are left out of the std. "
        f"Errors beyond {_GROSS_SIGMAS:g} std are left out: drives have bad frames of their own.",
    )
    for name in RIG_NAMES:
        mine = [each for each in frames if each.rig_name == name]
        if mine:
            stds = [np.sqrt(np.diag(total_covariance(each.terms))) * READABLE for each in mine]
            sigmas = np.array([each.sigmas for each in mine])
            rms = np.sqrt(np.mean(sigmas**2, axis=0))
            cells = (rms, measured_scale(mine), np.median(stds, axis=0))
            table.add(name, str(len(mine)), *(" / ".join(f"{value:.3g}" for value in cell) for cell in cells))
    return table


def measured_scale(frames: list[FrameError]) -> Array:
    """Return by how much (3,) the errors of the frames of a rig are larger than they say."""
    sigmas = np.array([each.sigmas for each in frames])
    usual = sigmas[np.all(np.abs(sigmas) < _GROSS_SIGMAS, axis=1)]
    scale: Array = np.sqrt(np.mean(usual**2, axis=0))
    return scale


def read_frames(folder: Path = RESULTS) -> list[FrameError]:
    """Return the frames of the table that was written last.

    Raises:
        NothingToMeasureError: There is none.
    """
    path = folder / FRAMES_CSV.name
    path = path if path.is_file() else FRAMES_CSV
    if not path.is_file():
        raise NothingToMeasureError("there is no mount_frames.csv: measure the section mount_frames first")
    frames: dict[tuple[str, str], FrameError] = {}
    with path.open(newline="", encoding="utf-8") as lines:
        for row in csv.DictReader(lines):
            key = (row["rig"], row["frame"])
            triangle = np.zeros((3, 3))
            triangle[_LOWER] = _split(row["covariance"])
            covariance = triangle + triangle.T - np.diag(np.diag(triangle))
            term = UncertaintyTerm(row["term"], covariance / np.outer(READABLE, READABLE))
            if key in frames:
                frames[key] = replace(frames[key], terms=(*frames[key].terms, term))
                continue
            numbers = {key: float(row[key]) for key in _RIG_KEYS}
            rig = StereoRig(**numbers | {key: int(numbers[key]) for key in ("width", "height")})  # type: ignore[arg-type]
            values = [_split(row[name]) / READABLE for name in ("pose", "error", "reference std")]
            frames[key] = FrameError(*key, rig, *values, (term,))
    return list(frames.values())


def mounted(rig_name: str, index: int, seed: int = _SEED) -> tuple[Draft, World]:
    """Return an ordinary road as one of the rigs sees it from its mount, and its draft.

    Args:
        rig_name: One of :data:`MOUNTS`.
        index: Number of the road.
        seed: Seed of the series.
    """
    height, pitch, roll, yaw, lateral = MOUNTS[rig_name]
    mount = Mount(height, *np.radians([pitch, roll, yaw]).tolist(), lateral)
    for attempt in count():
        rng = np.random.default_rng([seed, index, list(MOUNTS).index(rig_name), attempt])
        draft = ordinary(rng)
        if draft.rig_name != rig_name:
            continue
        draft.mount = mount
        furnish(draft)
        world = finished(draft, rig_name, seed, index)
        if world.good:
            return draft, world
    raise AssertionError("a series has no end")


def _rendered(task: tuple[str, int]) -> FrameError | None:
    rig_name, index = task
    _, world = mounted(rig_name, index)
    result = Calibrator(world.rig).add(*world.render())
    if result.extrinsics is None:
        return None
    truth = world.truth.as_array()
    error = result.extrinsics.as_array() - truth
    return FrameError(rig_name, str(index), world.rig, truth, error, np.zeros(3), result.uncertainty)


def _recorded() -> Iterator[FrameError]:
    for pair in kitti_frames():
        truth = pair.low / READABLE
        result = Calibrator(pair.rig).add(pair.left, pair.right)
        if result.extrinsics is not None and np.isfinite(truth).all():
            error = result.extrinsics.as_array() - truth
            std = pair.reference_std / READABLE
            yield FrameError(RECORDED, pair.name, pair.rig, truth, error, std, result.uncertainty)


def mount_of(frame: FrameError) -> Extrinsics:
    """Return the true pose of a frame as one."""
    return Extrinsics.from_array(frame.pose)


def _joined(values: Array) -> str:
    return " ".join(f"{float(value):.8g}" for value in values)


def _split(text: str) -> Array:
    return np.array([float(value) for value in text.split()] or [math.nan])
