"""Whether the car stands: by what moves in its images."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..camera.rig import StereoRig
from ..estimators.landmarks import Landmarks
from ..rejection import NotFitted
from .motion_between_frames import estimate_motion
from .travel import LEAST_STEP_M


@dataclass(frozen=True, slots=True, eq=False)
class PlaceOfCar:
    """Where the car was when it was seen last.

    Attributes:
        landmarks: Landmarks of the first frame at this place; None where none were looked for.
        moved: Whether the car has moved since the last accepted frame; before the first one it has.
    """

    landmarks: Landmarks | None = None
    moved: bool = True

    def followed_by(self, landmarks: Landmarks | None, rig: StereoRig) -> PlaceOfCar:
        """Return the place after another frame: the same one, where the car has not moved away from it.

        A slow car moves little from frame to frame. So a frame is compared with the first one of the place.

        Args:
            landmarks: Landmarks of the frame; None where none were looked for.
            rig: The rig of all frames.
        """
        if self.landmarks is not None and landmarks is not None:
            # Where nothing moves at all, as in a simulation without noise, no errors of a motion are left.
            if len(landmarks.left) and np.array_equal(self.landmarks.left, landmarks.left):
                return self
            motion = estimate_motion(self.landmarks, landmarks, rig)
            if not isinstance(motion, NotFitted) and np.linalg.norm(motion.moved_m) < LEAST_STEP_M:
                return self
        return PlaceOfCar(landmarks, moved=True)

    def accepted(self) -> PlaceOfCar:
        """Return the same place, for the frames after an accepted one."""
        return replace(self, moved=False)
