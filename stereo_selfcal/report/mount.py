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

"""How the estimate of the mount was reached, in words: the drive, the car's motion, what was asked for."""

from __future__ import annotations

import numpy as np

from ..core.drive.targets import describe_std
from ..core.geometry.mount import MountEvidence
from ..core.geometry.pose import POSE_COMPONENTS

_TELLING = 3.0  # independent moments: the prior of the motion is worth about as many
_FEW = 10.0  # so many moments and more are told without decimals


def how_reached(mount: MountEvidence | None, n_frames: int) -> list[str]:
    """Return sentences without a full stop about how an estimate was reached; none where it is not known.

    Args:
        mount: What the drive has shown of the mount.
        n_frames: Number of frames behind the estimate.
    """
    if mount is None:
        return []
    sentences = [_of_motion(mount)]
    accepted = n_frames + mount.n_outliers
    if mount.n_known:
        sentences.append(
            f"{mount.n_known} of {accepted} accepted frames started from the known camera, without a search"
        )
    return sentences


def _of_motion(mount: MountEvidence) -> str:
    if mount.stood:
        return (
            f"The car stood, for {mount.duration_s:.1f} s: all frames are one view of one road, with the "
            "springs at rest"
        )
    by = f"{describe_std(mount.motion)} (std)"
    if mount.duration_s <= 0.0:
        return (
            "One moment of a car that may be moving: by its springs, the camera is "
            f"{by} off its mean then, as far as is known"
        )
    # What so few moments show is mostly what is known of cars beforehand.
    moves = "moves" if mount.looks.min() >= _TELLING else "is taken to move"
    moves += f" the camera over the road by {by}"
    text = f"In {mount.duration_s:.1f} s of drive, the car on its springs {moves}"
    memory_s, looks = mount.memory_s, mount.looks
    if np.all(np.isfinite(memory_s)) and np.all(np.isfinite(looks)):
        height, *others = [
            f"{value:.{0 if value >= _FEW else 1}f}{{}} of {component.label}"
            for component, value in zip(POSE_COMPONENTS, looks, strict=True)
        ]
        moments = ", ".join([height.format(" independent moments"), *(each.format("") for each in others)])
        text += f"; a state lasts {_span(memory_s.min(), memory_s.max())}, so the drive shows {moments}"
    return text


def _span(low_s: float, high_s: float) -> str:
    low, high = f"{low_s:.1f}", f"{high_s:.1f}"
    return f"{low} s" if low == high else f"{low} to {high} s"
