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

"""How the estimate of the mount was reached, in words."""

import dataclasses
import math

import numpy as np
import pytest

from stereo_selfcal.core.geometry.mount import MountEvidence
from stereo_selfcal.core.geometry.pose import Extrinsics
from stereo_selfcal.report.mount import how_reached

MOTION = Extrinsics(0.005, math.radians(0.15), math.radians(0.2))
MOVED = (
    "In 30.0 s of drive, the car on its springs moves the camera over the road by 5 mm, 0.15, 0.2 deg (std)"
)
DRIVE = MountEvidence(30.0, 0, 0, False, MOTION, np.array([1.5, 1.46, 2.04]), np.array([9.96, 12.4, 7.25]))


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        (
            {},
            f"{MOVED}; a state lasts 1.5 to 2.0 s, so the drive shows 10.0 independent moments of height, "
            "12 of pitch, 7.2 of roll",
        ),
        (
            {"memory_s": np.full(3, 1.5), "looks": np.full(3, 12.0)},
            f"{MOVED}; a state lasts 1.5 s, so the drive shows 12 independent moments of height, "
            "12 of pitch, 12 of roll",
        ),
        (
            {"memory_s": np.full(3, math.inf)},
            MOVED,
        ),
        (
            {"duration_s": 0.0},
            "One moment of a car that may be moving: by its springs, the camera is 5 mm, 0.15, 0.2 deg (std) "
            "off its mean then, as far as is known",
        ),
        (
            {"stood": True, "motion": Extrinsics(0.0, 0.0, 0.0)},
            "The car stood, for 30.0 s: all frames are one view of one road, with the springs at rest",
        ),
    ],
)
def test_motion_of_the_car(changes, sentence):
    assert how_reached(dataclasses.replace(DRIVE, **changes), 30) == [sentence]


def test_frames_that_started_from_the_known_camera_are_counted():
    _, sentence = how_reached(dataclasses.replace(DRIVE, n_known=20, n_outliers=2), 28)
    assert sentence == "20 of 30 accepted frames started from the known camera, without a search"


def test_nothing_is_said_of_what_is_not_known():
    assert how_reached(None, 3) == []


def test_what_few_moments_show_is_told_as_what_is_expected():
    """A tenth of a second shows nothing of the motion: its size is that of usual cars."""
    few = dataclasses.replace(DRIVE, duration_s=0.1, looks=np.ones(3))
    (sentence, *_) = how_reached(few, 2)
    assert "the car on its springs is taken to move the camera over the road by " in sentence
