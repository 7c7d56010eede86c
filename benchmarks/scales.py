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

"""Standard deviations without steps: a pair made smaller in small steps is as uncertain as the one before.

A term of the uncertainty that is added behind a threshold shows here: the estimate stays as it is, and its
standard deviation is a multiple of the one before.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain, islice, pairwise

import numpy as np

from .frames import SURFACES, Array, held_out_frame
from .harmless import scaled
from .options import Options
from .road_pairs import RoadPair, kitti_frames, roads
from .road_verdicts import RoadVerdict, in_processes, judge
from .table import NothingToMeasureError, Table, numbers

SCALES = np.arange(1.0, 0.4999, -0.025)
MOST_STEP = 1.5
_NOISES = (0.02, 0.1)
_POSES = 2
_EVERY_FRAME = 6  # one of so many of the recorded frames
_TO_BE_ACCEPTED = ("cityscapes_cologne", "drivingstereo")


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """From one scale to the next one.

    Attributes:
        scale: The smaller one.
        growth: Factor by which the standard deviation grows or shrinks most, at least 1.
        same: Whether the estimate is the same: within one standard deviation, the smaller one.
    """

    scale: float
    growth: float
    same: bool


def scale_tables(options: Options) -> Iterator[Table]:
    """Compare the standard deviations of neighbouring scales, pair by pair."""
    every = options.road_step if options.road_step > 1 else _EVERY_FRAME
    table = Table(
        "scales",
        f"Pairs from {SCALES[0]:g} to {SCALES[-1]:g} of their size, in steps of {SCALES[0] - SCALES[1]:g}",
        [
            "set",
            "pair",
            "accepted",
            "std, greatest scale (mm, deg, deg)",
            "std, smallest scale",
            "greatest step, same estimate",
            "at",
            "greatest step at all",
            "at",
        ],
        f"A step: the ratio of the standard deviations of neighbouring scales that are both accepted. Asked: "
        f"at most {MOST_STEP:g} where the estimate is the same, to within one standard deviation.",
    )
    for verdicts in in_processes(judge_scales, _pairs(every), options.processes):
        table.add(*_row(verdicts))
    yield table


def judge_scales(pair: RoadPair) -> list[RoadVerdict]:
    """Return the verdicts on a pair, from its own size on down."""
    return [judge(scaled(pair, scale) if scale < 1.0 else pair, with_peer=False) for scale in SCALES]


def steps_of(verdicts: list[RoadVerdict]) -> list[Step]:
    """Return the steps between neighbouring scales that are both accepted."""
    steps = []
    for scale, (before, after) in zip(SCALES[1:], pairwise(verdicts), strict=True):
        if not before.accepted or not after.accepted:
            continue
        growth = np.maximum(after.std / before.std, before.std / after.std)
        moved: Array = np.abs(after.pose - before.pose) / np.minimum(after.std, before.std)
        steps.append(Step(float(scale), float(growth.max()), bool(np.all(moved <= 1.0))))
    return steps


def _pairs(every: int) -> Iterator[RoadPair]:
    for surface in SURFACES:
        for noise in _NOISES:
            for pose in range(_POSES):
                scene, left, right = held_out_frame(surface, noise, pose)
                yield RoadPair(
                    "rendered", f"{surface} {pose}, noise {noise:.0%}", "", "", scene.rig, left, right
                )
    try:
        recorded = islice(kitti_frames(), 0, None, every)
        yield from chain(recorded, (pair for pair in roads() if pair.tag in _TO_BE_ACCEPTED))
    except NothingToMeasureError:
        return  # the rendered ones are part of the project


def _row(verdicts: list[RoadVerdict]) -> list[str]:
    accepted = [each for each in verdicts if each.accepted]
    first = verdicts[0]
    row = [first.source, first.name, f"{len(accepted)}/{len(verdicts)}"]
    if not accepted:
        return [*row, *["-"] * 6]
    steps = steps_of(verdicts)
    row += [numbers(accepted[0].std), numbers(accepted[-1].std)]
    for some in ([step for step in steps if step.same], steps):
        worst = max(some, key=lambda step: step.growth, default=None)
        row += ["-", "-"] if worst is None else [f"{worst.growth:.2f}", f"{worst.scale:.3f}"]
    return row
