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

"""Times of calibrations over that of one block matching of the same pair: real, rendered, cold and known."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from stereo_selfcal import Calibrator, StereoRig
from stereo_selfcal.core.types import Image
from stereo_selfcal.synth.renderer import Frame, render
from stereo_selfcal.synth.scenes import PAPER_RIG, random_scene

from .frames import FIRST_POSE_SEED
from .options import Options
from .road_pairs import pairs_of
from .table import NothingToMeasureError, Table

DISPARITIES = 96
_BLOCK_PX = 5
# The penalties that OpenCV's documentation recommends, for this block.
_P1, _P2 = 8 * _BLOCK_PX**2, 32 * _BLOCK_PX**2
ROUNDS = 3  # by turns; the median counts
COLD = "kitti_frames"
FOLLOWED = ("kitti_odometry07", "kitti_odometry02")
_PERIOD_S = 0.1  # of the recordings that are followed
# Rendered sizes, their disparities, and the most that is asked of their ratio.
_SIZES = ((640, 480, 64, 1.0), (1920, 1080, DISPARITIES, 0.25), (2448, 2048, DISPARITIES, 0.1))
# Standard deviations of the texture of rendered roads [grey levels]: one whose surface is seen, and one that
# only lines tell.
_TEXTURES = {"textured": 10.0, "bare": 3.0}
_SCENES = 5
_NOISE = 0.01
_MOST_COLD, _MOST_KNOWN = 1.0, 0.35


@dataclass(frozen=True, slots=True)
class Clocked:
    """Processor times of one pair.

    Attributes:
        accepted: Whether it was calibrated.
        ours_ms: Time of the calibration [ms].
        matching_ms: Time of a block matching [ms].
    """

    accepted: bool
    ours_ms: float
    matching_ms: float

    @property
    def ratio(self) -> float:
        """Time of the calibration in block matchings."""
        return self.ours_ms / self.matching_ms


def block_matcher(disparities: int = DISPARITIES) -> cv2.StereoSGBM:
    """Return the block matching that a user would run instead, with its recommended settings.

    Args:
        disparities: How many disparities it tries [px].
    """
    return cv2.StereoSGBM_create(0, disparities, _BLOCK_PX, _P1, _P2)


def elapsed_ms(call: Callable[[], object]) -> float:
    """Return the processor time of a call [ms]: other programs of this machine must not count."""
    start = time.thread_time()
    call()
    return (time.thread_time() - start) * 1e3


def clocked_cold(
    rig: StereoRig, images: tuple[Image, Image], disparities: int = DISPARITIES, rounds: int = ROUNDS
) -> Clocked:
    """Time a pair whose camera is not known, calibration and block matching by turns.

    Args:
        rig: Intrinsics and baseline.
        images: Left and right image, (H, W) uint8.
        disparities: How many disparities the block matching tries [px].
        rounds: Repetitions.
    """
    matcher, calibrator = block_matcher(disparities), Calibrator(rig)
    accepted = calibrator.calibrate_frame(*images).accepted  # not timed: the first call fills the caches
    ours, theirs = [], []
    for _ in range(rounds):
        theirs.append(elapsed_ms(lambda: matcher.compute(*images)))
        ours.append(elapsed_ms(lambda: calibrator.calibrate_frame(*images)))
    return Clocked(accepted, float(np.median(ours)), float(np.median(theirs)))


def clocked_known(source: str, step: int) -> list[Clocked]:
    """Time the frames of a recording that are known by the frame before, block matching by turns.

    Args:
        source: The recording.
        step: One out of so many is timed; all of them are followed.
    """
    matcher, found, n_known = block_matcher(), [], 0
    calibrator: Calibrator | None = None
    for index, pair in enumerate(pairs_of((source,))):
        calibrator = calibrator or Calibrator(pair.rig)
        start = time.thread_time()
        result = calibrator.add(pair.left, pair.right, index * _PERIOD_S)
        ours_ms = (time.thread_time() - start) * 1e3
        n_known += result.known_start
        if result.known_start and n_known % step == 0:
            theirs_ms = elapsed_ms(lambda: matcher.compute(pair.left, pair.right))  # noqa: B023 - called at once
            found.append(Clocked(result.accepted, ours_ms, theirs_ms))
    return found


def speed_table(options: Options) -> Iterator[Table]:
    """Time real frames, cold and known, and rendered ones of several sizes."""
    table = Table(
        "speed",
        "One calibration against one cv2.StereoSGBM of the same pair",
        [
            "frames",
            "disparities",
            "n",
            "accepted",
            "ours, median ms",
            "SGBM, median ms",
            "median ratio",
            "worst ratio",
            "asked: median, worst",
        ],
        f"CPU time of one thread each, by turns; block {_BLOCK_PX}, P1 {_P1}, P2 {_P2}. Cold: nothing is "
        "known but the pair. Known: the frame 0.1 s before has told the camera.",
    )
    cold = list(_real_cold(options.road_step))
    for name, accepted in (("accepted", True), ("refused", False)):
        of_kind = [each for each in cold if each.accepted is accepted]
        _add(table, f"{COLD}, cold, {name}", DISPARITIES, of_kind, (_MOST_COLD, 2.0 * _MOST_COLD))
    for source in FOLLOWED:
        try:
            known = clocked_known(source, options.road_step)
        except NothingToMeasureError:
            continue
        _add(table, f"{source}, known", DISPARITIES, known, (_MOST_KNOWN, math.inf))
    for width, height, disparities, most in _SIZES if options.all_sizes else _SIZES[:1]:
        for name, texture in _TEXTURES.items():
            scenes = [_rendered(width, height, texture, index) for index in range(_SCENES)]
            times = [clocked_cold(*scene, disparities) for scene in scenes]
            asked = (most, math.inf) if name == "textured" else (math.inf, math.inf)
            _add(table, f"rendered, {name}, {width} x {height}, cold", disparities, times, asked)
    yield table


def _real_cold(step: int) -> Iterator[Clocked]:
    try:
        for pair in pairs_of((COLD,), step):
            yield clocked_cold(pair.rig, (pair.left, pair.right))
    except NothingToMeasureError:
        return


def _rendered(width: int, height: int, texture: float, index: int) -> tuple[StereoRig, tuple[Frame, Frame]]:
    """Return a frame of the paper's rig with other cameras, and that rig."""
    focal_px = PAPER_RIG.fx * width / PAPER_RIG.width
    rig = StereoRig(
        width, height, focal_px, focal_px, (width - 1) / 2, (height - 1) / 2, PAPER_RIG.baseline_m
    )
    rng = np.random.default_rng([FIRST_POSE_SEED, index])
    scene = random_scene(rng, _NOISE, rig=rig, texture_amplitude=texture)
    return rig, render(scene, np.random.default_rng(index))


def _add(
    table: Table, name: str, disparities: int, times: Sequence[Clocked], asked: tuple[float, float]
) -> None:
    if not times:
        return
    ratios = [each.ratio for each in times]
    table.add(
        name,
        str(disparities),
        str(len(times)),
        str(sum(each.accepted for each in times)),
        f"{np.median([each.ours_ms for each in times]):.0f}",
        f"{np.median([each.matching_ms for each in times]):.0f}",
        f"{np.median(ratios):.2f}",
        f"{max(ratios):.2f}",
        ", ".join("-" if math.isinf(most) else f"{most:g}" for most in asked),
    )
