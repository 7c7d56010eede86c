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

"""Stereo rigs as they are mounted on vehicles, and how they are mounted."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stereo_selfcal import StereoRig

from .cameras import Mount

_PITCH_DEG = (-2.0, 8.0)
_ROLL_DEG = 3.0
_YAW_DEG = 4.0
_LATERAL_M = 0.45
_LOW_M = 0.8  # rigs below are low


@dataclass(frozen=True)
class RigKind:
    """A rig that exists, or could.

    Attributes:
        name: Its name.
        rig: Its numbers.
        heights_m: Between which heights it is mounted.
        share: How often it is drawn.
        baselines_m: Between which its baseline is drawn, None: it is as the rig says.
    """

    name: str
    rig: StereoRig
    heights_m: tuple[float, float]
    share: float
    baselines_m: tuple[float, float] | None = None


RIGS = (
    RigKind("kitti", StereoRig(1242, 375, 721.5, 721.5, 609.56, 172.85, 0.5327), (1.5, 1.8), 0.26),
    RigKind("paper", StereoRig(640, 480, 516.6, 516.6, 319.5, 239.5, 0.1481), (1.1, 1.6), 0.22),
    RigKind("zed", StereoRig(672, 376, 338.0, 338.0, 335.5, 187.5, 0.12), (1.0, 1.6), 0.08),
    RigKind("zed_hd", StereoRig(1280, 720, 700.0, 700.0, 641.3, 356.2, 0.12), (1.1, 1.6), 0.05),
    RigKind("oak", StereoRig(640, 400, 402.0, 402.0, 318.2, 203.1, 0.075), (1.0, 1.5), 0.07),
    RigKind("wide", StereoRig(1024, 576, 560.0, 560.0, 511.5, 287.5, 0.25), (1.2, 1.8), 0.09, (0.2, 0.3)),
    RigKind("truck", StereoRig(960, 600, 700.0, 700.0, 479.5, 299.5, 0.30), (2.5, 3.0), 0.1, (0.25, 0.4)),
    RigKind("robot", StereoRig(640, 400, 400.0, 400.0, 319.5, 199.5, 0.1), (0.42, 0.65), 0.1),
    RigKind("robot_zed", StereoRig(672, 376, 338.0, 338.0, 335.5, 187.5, 0.12), (0.42, 0.65), 0.03),
)


def draw_rig(rng: np.random.Generator) -> tuple[str, StereoRig, Mount]:
    """Return the name of a rig, its numbers, and its mount."""
    shares = np.array([kind.share for kind in RIGS])
    kind = RIGS[int(rng.choice(len(RIGS), p=shares / shares.sum()))]
    rig = kind.rig
    if kind.baselines_m:
        rig = StereoRig(
            rig.width, rig.height, rig.fx, rig.fy, rig.cx, rig.cy, float(rng.uniform(*kind.baselines_m))
        )
    mount = Mount(
        float(rng.uniform(*kind.heights_m)),
        math.radians(rng.uniform(*_PITCH_DEG)),
        math.radians(rng.uniform(-_ROLL_DEG, _ROLL_DEG)),
        math.radians(rng.uniform(-_YAW_DEG, _YAW_DEG)),
        float(rng.uniform(-_LATERAL_M, _LATERAL_M)),
    )
    return kind.name, rig, mount


def is_low(mount: Mount) -> bool:
    """Say whether a rig is a low one."""
    return mount.height_m < _LOW_M
