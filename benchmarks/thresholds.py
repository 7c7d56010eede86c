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

"""What moving any one threshold by a fifth does to the verdicts on real frames."""

from __future__ import annotations

import multiprocessing
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from stereo_selfcal import Calibrator, CalibratorConfig
from stereo_selfcal.core import tolerances
from stereo_selfcal.core.estimators import texture_fit
from stereo_selfcal.core.evidence import cross_checks, kerb_face, measurements, profile, rig_measurements
from stereo_selfcal.core.lanes import line_geometry, matching
from stereo_selfcal.core.road import priors
from stereo_selfcal.core.search import lines_on_road

from .options import Options
from .road_pairs import pairs_of
from .table import Table

SCALES = (0.8, 1.2)
SOURCES = ("kitti_odometry02", "kitti_frames")
PROCESSES = 2
_ALLOWED = 2  # verdicts that one threshold may change


@dataclass(frozen=True)
class Threshold:
    """A number to be moved: a constant of a module, or a setting.

    Attributes:
        name: Name of the constant or of the setting.
        module: Where it is defined; None for a setting.
    """

    name: str
    module: Any = None


THRESHOLDS = (
    Threshold("extraction.min_contrast_sigma"),
    Threshold("extraction.min_line_rows"),
    Threshold("extraction.min_radius_m"),
    Threshold("fitness.max_misfit_px"),
    Threshold("_MIN_ROW_OVERLAP", matching),
    Threshold("_MAX_WIDTH_RATIO", matching),
    Threshold("_MAX_CONTRAST_RATIO", matching),
    Threshold("MIN_LIKENESS", matching),
    Threshold("_CURVATURE_SIGMAS", measurements),
    Threshold("_MIN_VERTICAL_RADIUS_M", measurements),
    Threshold("_MAX_MISFIT_SIGMAS", measurements),
    Threshold("_MAX_STAGE_SIGMAS", measurements),
    Threshold("_MIN_STRIPE_M", measurements),
    Threshold("_MIN_LANE_M", measurements),
    Threshold("_MAX_BLUR_PX", measurements),
    Threshold("_MAX_CLIPPED", measurements),
    Threshold("_MAX_VERTICAL_PX", rig_measurements),
    Threshold("_MAX_BORDER_STEP", measurements),
    Threshold("_MAX_HALF_DIFFERENCE", measurements),
    Threshold("_MAX_NARROW_STEP", measurements),
    Threshold("_SURELY_SIGMAS", measurements),
    Threshold("EXCLUDED_SIGMAS", tolerances),
    Threshold("EXCLUDED_CHI2_3", tolerances),
    Threshold("MAX_DIFFERENCE", tolerances),
    Threshold("WRONG", tolerances),
    Threshold("MAX_LINE_HEIGHT_M", tolerances),
    Threshold("_DEPTH_SIGMAS", line_geometry),
    Threshold("_BENT_SIGMAS", profile),
    Threshold("KERB_SIGMAS", tolerances),
    Threshold("_EXCLUDED_SIGMAS", kerb_face),
    Threshold("MOST_RAMP_SIGMAS", kerb_face),
    Threshold("_LEAST_CONTRAST_RATIO", kerb_face),
    Threshold("REACH_PX", profile),
    Threshold("_INSET_M", cross_checks),
    Threshold("HALF_STRIP_M", priors),
    Threshold("AGREEMENT", tolerances),
    Threshold("MAX_NOISE_STD", tolerances),
    Threshold("MIN_SIGMAS", texture_fit),
    Threshold("MIN_CELL_SHARE", texture_fit),
    Threshold("MAX_GAP_RAD", lines_on_road),
    Threshold("MAX_YAW_RAD", lines_on_road),
)


def threshold_table(_: Options) -> Iterator[Table]:
    """Count changed verdicts, threshold by threshold.

    Raises:
        NothingToMeasureError: The recordings are not there.
    """
    next(pairs_of(SOURCES))
    context = multiprocessing.get_context("spawn")
    jobs = [(None, 1.0), *((i, scale) for i in range(len(THRESHOLDS)) for scale in SCALES)]
    with context.Pool(PROCESSES, initializer=cv2.setNumThreads, initargs=(1,)) as pool:
        # One process for each job: a constant that was moved must not stay so.
        found = pool.map(verdicts, jobs, chunksize=1)
    as_is = found[0]
    table = Table(
        "thresholds",
        f"Verdicts changed by moving one threshold by a fifth, of {len(as_is)} real frames",
        ["threshold", "x 0.8", "x 1.2"],
        f"Accepted as it is: {sum(as_is)}. Asked: at most {_ALLOWED} for each.",
    )
    for i, threshold in enumerate(THRESHOLDS):
        changed = [
            sum(a != b for a, b in zip(as_is, found[1 + len(SCALES) * i + k], strict=True))
            for k in range(len(SCALES))
        ]
        table.add(f"`{threshold.name}`", *map(str, changed))
    yield table


def verdicts(job: tuple[int | None, float]) -> list[bool]:
    """Return which real frames are accepted with one threshold scaled."""
    index, scale = job
    if index is None:
        return _accepted(CalibratorConfig())
    threshold = THRESHOLDS[index]
    if threshold.module is None:
        now = {name: value for name, value, _ in CalibratorConfig().settings()}[threshold.name]
        moved = round(now * scale) if isinstance(now, int) else now * scale
        return _accepted(CalibratorConfig.from_mapping({threshold.name: moved}))
    value = getattr(threshold.module, threshold.name)
    # Wherever it was imported to.
    holders = [
        module
        for name, module in list(sys.modules.items())
        if name.startswith("stereo_selfcal.core") and getattr(module, threshold.name, None) is value
    ]
    try:
        for module in holders:
            setattr(module, threshold.name, np.multiply(value, scale) if np.ndim(value) else value * scale)
        return _accepted(CalibratorConfig())
    finally:
        for module in holders:
            setattr(module, threshold.name, value)


def _accepted(config: CalibratorConfig) -> list[bool]:
    pairs = pairs_of(SOURCES)
    return [Calibrator(pair.rig, config).add(pair.left, pair.right).accepted for pair in pairs]
