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

"""Steps of a car whose camera points so against its direction, without images."""

import numpy as np

from stereo_selfcal.core.drive.motion_between_frames import FrameMotion
from stereo_selfcal.core.drive.travel import TravelStep
from stereo_selfcal.synth.renderer import rotation

YAW, PITCH = 0.012, 0.035
NOISE = np.diag([1e-4, 1e-4, 1e-4, 5e-3, 1e-3, 1e-3, 1e-4]) ** 2


def step(i, yaw=YAW, pitch=PITCH, way_m=1.0, turn=0.0, period_s=0.1):
    """Return a step of a camera that points so against its direction, in the middle of the step."""
    middle = rotation(0, 0, yaw) @ rotation(0, pitch, 0)
    moved = rotation(0, 0, turn / 2) @ middle.T @ [way_m, 0.0, 0.0]
    motion = FrameMotion(np.array([0.0, 0.0, turn]), moved, 0.0, NOISE, 100, 1.0)
    return TravelStep(100.0 + i * period_s, period_s, motion)
