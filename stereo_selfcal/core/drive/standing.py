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

"""Whether the car stands: by what moves in its images."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..camera.rig import StereoRig
from ..estimators.landmarks import Landmarks
from ..rejection import NotFitted
from .motion_between_frames import FrameMotion, estimate_motion
from .travel import LEAST_STEP_M

# Of the landmarks of a standing car, at least so many stay where they are: traffic hides half of them, and
# others are found in noise. In a rendered drive with a bonnet, 9 % lie on that.
_LEAST_SEEN = 0.15


@dataclass(frozen=True, slots=True, eq=False)
class PlaceOfCar:
    """Where the car was when it was seen last.

    Attributes:
        landmarks: Landmarks of the first frame at this place; None where none were looked for.
        latest: Landmarks of the frame before; None where none were looked for.
        moved: Whether the car has moved since the last accepted frame; before the first one it has.
        recognised: Whether the frame before was recognised as one of this place, or began it.
    """

    landmarks: Landmarks | None = None
    latest: Landmarks | None = None
    moved: bool = True
    recognised: bool = True

    def followed_by(
        self,
        landmarks: Landmarks | None,
        rig: StereoRig,
        motion_of: Callable[[Landmarks, Landmarks, StereoRig], FrameMotion | NotFitted] = estimate_motion,
    ) -> PlaceOfCar:
        """Return the place after another frame: the same one, where the car has not moved away from it.

        A slow car moves little from frame to frame. So a frame is compared with the first one of the place.
        One that shows nothing of it, as behind a lorry, does not say that the car has moved. The car has left
        the place where the frame continues the one before and is not at the place.

        Args:
            landmarks: Landmarks of the frame; None where none were looked for.
            rig: The rig of all frames.
            motion_of: Returns the motion between the landmarks of two frames.
        """
        if landmarks is None:
            return replace(self, latest=None, recognised=False)
        way_m = _way_m(self.landmarks, landmarks, rig, motion_of)
        if way_m is not None and way_m < LEAST_STEP_M:
            return replace(self, latest=landmarks, recognised=True)
        if self.landmarks is not None and way_m is None:
            continues = not self.recognised and _way_m(self.latest, landmarks, rig, motion_of) is not None
            if not continues:
                return replace(self, latest=landmarks, recognised=False)
        return PlaceOfCar(landmarks, landmarks)

    @property
    def stands(self) -> bool:
        """Whether the car is seen to stand where it stood at the last accepted frame."""
        return self.recognised and not self.moved

    def accepted(self) -> PlaceOfCar:
        """Return the same place, for the frames after an accepted one."""
        return replace(self, moved=False)


def _way_m(
    before: Landmarks | None,
    after: Landmarks,
    rig: StereoRig,
    motion_of: Callable[[Landmarks, Landmarks, StereoRig], FrameMotion | NotFitted],
) -> float | None:
    """Return how far the car has moved between two frames [m]; None where that is not seen."""
    if before is None:
        return None
    # Where nothing moves at all, as in a simulation without noise, no errors of a motion are left.
    if len(after.left) and np.array_equal(before.left, after.left):
        return 0.0
    motion = motion_of(before, after, rig)
    if isinstance(motion, NotFitted):
        return None
    way_m = float(np.linalg.norm(motion.moved_m))
    # A bonnet, or dirt on a windscreen, stays where it is while the car drives.
    few = motion.n_points < _LEAST_SEEN * min(len(before), len(after))
    return None if way_m < LEAST_STEP_M and few else way_m
