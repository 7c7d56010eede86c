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

"""Which frames of a drive are shown: best, median, worst by where they put the road, and refused ones."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from ..core.drive.drive import Drive, DriveSegment
from ..core.geometry.pose import Extrinsics
from ..core.types import Array
from ..offline import FrameRow

# The own lane from where most cameras see it to where a metre of road is a few pixels: there two planes are
# compared.
_ALONG_M = (5.0, 20.0)
HALF_LANE_M = 1.75
_N_ALONG = 16


def segment_of(row: FrameRow, drive: Drive) -> DriveSegment:
    """Return the segment of a drive that an accepted frame belongs to."""
    for segment in drive.segments:
        if row.stamp_s <= segment.end_s:
            return segment
    return drive.segments[-1]


def road_difference_m(a: Extrinsics, b: Extrinsics) -> float:
    """Return how far apart two poses put the own lane's surface 5 to 20 m ahead, RMS [m]."""
    along = np.linspace(*_ALONG_M, _N_ALONG)[:, None]
    across = np.array([-HALF_LANE_M, 0.0, HALF_LANE_M])[None, :]
    height_m = a.height_m - b.height_m
    pitch_rad = a.pitch_rad - b.pitch_rad
    roll_rad = a.roll_rad - b.roll_rad
    # p_road = R p_camera + [0, 0, height], for small angles: nose down lowers what is ahead, right side down
    # raises what is to the left.
    difference: Array = height_m - along * pitch_rad + across * roll_rad
    return float(np.sqrt(np.mean(difference**2)))


def ranked(rows: Sequence[FrameRow], drive: Drive) -> list[tuple[float, FrameRow]]:
    """Return the accepted frames with their difference from their segment's pose [m], the nearest first."""
    ranking = []
    for row in rows:
        if row.extrinsics is None:
            continue
        pose = segment_of(row, drive).estimate.extrinsics
        if pose is not None:
            ranking.append((road_difference_m(row.extrinsics, pose), row))
    return sorted(ranking, key=lambda entry: entry[0])


def best_median_worst(ranking: Sequence[tuple[float, FrameRow]]) -> list[tuple[str, float, FrameRow]]:
    """Return up to three frames with their names; of few frames, those there are."""
    places = {"Best": 0, "Median": len(ranking) // 2, "Worst": len(ranking) - 1}
    if len(ranking) == 1:
        places = {"Only": 0}
    elif len(ranking) == 2:
        places = {"Best": 0, "Worst": 1}
    return [(name, *ranking[index]) for name, index in places.items()] if ranking else []


def refusals(rows: Sequence[FrameRow]) -> list[tuple[str, int, FrameRow]]:
    """Return every reason with its count and the middle one of its frames, the most frequent first."""
    counts = Counter(row.reason for row in rows if row.reason is not None)
    found = []
    for reason, count in sorted(counts.items(), key=lambda item: (-item[1], item[0])):
        frames = [row for row in rows if row.reason == reason]
        found.append((reason, count, frames[len(frames) // 2]))
    return found
