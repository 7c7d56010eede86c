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

"""Time of one real frame, accepted or refused, against one block matching of the same pair."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stereo_selfcal import Calibrator

from .options import Options
from .parts import PARTS, clocked_parts
from .ratios import DISPARITIES, ROUNDS, clocked_cold, elapsed_ms
from .road_pairs import RoadPair, pairs_of
from .table import Table

MOST_MEDIAN, MOST_RATIO = 1.0, 2.0
REST = "all the rest"


@dataclass(frozen=True, slots=True)
class FrameTime:
    """Processor times of one pair.

    Attributes:
        source: The set it belongs to.
        name: Of the pair.
        reason: Why it is refused; empty where it is accepted.
        ours_ms: Median time of a calibration [ms].
        matching_ms: Median time of a block matching [ms].
        parts_ms: Times of the parts of one calibration [ms].
    """

    source: str
    name: str
    reason: str
    ours_ms: float
    matching_ms: float
    parts_ms: Mapping[str, float]

    @property
    def ratio(self) -> float:
        """Time of a calibration in block matchings."""
        return self.ours_ms / self.matching_ms


def time_tables(options: Options) -> Iterator[Table]:
    """Time every pair, calibration and block matching by turns."""
    table = Table(
        "road_times",
        "One calibration of a real frame against one cv2.StereoSGBM of the same pair",
        [
            "set",
            "frames",
            "n",
            "ours, median ms",
            "SGBM, median ms",
            "median ratio",
            "90 %",
            "worst ratio",
            "of",
        ],
        f"CPU time of one thread each, {ROUNDS} times by turns, the median of each frame; {DISPARITIES} "
        "disparities, with the penalties that OpenCV recommends. Asked: a ratio of at most "
        f"{MOST_MEDIAN:g} in the median and {MOST_RATIO:g} at worst.",
    )
    every = Table(
        "road_times_every",
        "Every frame",
        ["set", "pair", "reason", "ours_ms", "sgbm_ms", "ratio"],
        shown=False,
    )
    times = [clocked(pair) for pair in pairs_of(options.sources or ("kitti_frames",), options.road_step)]
    for source in dict.fromkeys(each.source for each in times):
        of_source = [each for each in times if each.source == source]
        groups = {
            "accepted": [each for each in of_source if not each.reason],
            "refused": [each for each in of_source if each.reason],
            "all": of_source,
        }
        for name, group in groups.items():
            if group:
                table.add(source, name, str(len(group)), *_cells(group))
    for each in times:
        numbers = (f"{value:.2f}" for value in (each.ours_ms, each.matching_ms, each.ratio))
        every.add(each.source, each.name, each.reason, *numbers)
    yield table
    yield _parts_table(times)
    yield every


def _parts_table(times: Sequence[FrameTime]) -> Table:
    """Return where the time of real frames goes, accepted and refused ones apart."""
    groups = {
        "accepted": [each for each in times if not each.reason],
        "refused": [each for each in times if each.reason],
    }
    table = Table(
        "road_parts",
        "Where the time of one real frame goes",
        ["part", *(f"{name}, mean ms" for name in groups)],
        ", ".join(f"{len(group)} {name}" for name, group in groups.items())
        + "; CPU time of one thread, of one calibration each.",
    )
    for part in (*PARTS, REST):
        means = (
            float(np.mean([each.parts_ms[part] for each in group] or [0.0])) for group in groups.values()
        )
        table.add(part, *(f"{mean:.1f}" for mean in means))
    matching = (float(np.mean([each.matching_ms for each in group] or [0.0])) for group in groups.values())
    table.add("one block matching, beside", *(f"{mean:.1f}" for mean in matching))
    return table


def clocked(pair: RoadPair) -> FrameTime:
    """Time one pair."""
    images = pair.left, pair.right
    times = clocked_cold(pair.rig, images)
    calibrator, results = Calibrator(pair.rig), []
    with clocked_parts() as spent:
        whole_ms = elapsed_ms(lambda: results.append(calibrator.calibrate_frame(*images)))
    parts_ms = {name: seconds * 1e3 for name, seconds in spent.items()}
    parts_ms[REST] = whole_ms - sum(parts_ms.values())
    reason = str(results[0].reason or "")
    return FrameTime(pair.source, pair.name, reason, times.ours_ms, times.matching_ms, parts_ms)


def _cells(group: list[FrameTime]) -> list[str]:
    ratios = [each.ratio for each in group]
    worst = max(group, key=lambda each: each.ratio)
    return [
        f"{np.median([each.ours_ms for each in group]):.0f}",
        f"{np.median([each.matching_ms for each in group]):.0f}",
        f"{np.median(ratios):.2f}",
        f"{np.quantile(ratios, 0.9):.2f}",
        f"{worst.ratio:.2f}",
        worst.name,
    ]
