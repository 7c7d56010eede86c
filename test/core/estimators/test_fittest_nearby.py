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

"""The pose of the greatest fitness from the closed form on: that of the genetic algorithm."""

import numpy as np
import pytest

from stereo_selfcal import Calibrator, CalibratorConfig
from stereo_selfcal.core.estimators.fitness import PatternFitness
from stereo_selfcal.core.estimators.fittest_nearby import fittest_nearby
from stereo_selfcal.synth.scenes import custom_scene

CONFIG = CalibratorConfig()


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"noise_fraction": 0.1},
        {"height_m": 0.9, "pitch_rad": 0.1, "roll_rad": -0.05},
        {"lateral_offset_m": 0.8, "lane_yaw_rad": 0.03},
        {"curvature_per_m": 1 / 1500},
    ],
    ids=str,
)
def test_it_is_as_fit_as_that_of_the_genetic_algorithm(changes):
    scene = custom_scene(n_frames=1, **changes)
    (frame,) = scene.frames()
    result = Calibrator(scene.scene.rig).calibrate_frame(frame.left, frame.right)
    fitness = PatternFitness(result.pattern, scene.scene.rig, CONFIG.fitness)
    pose, greatest = fittest_nearby(result.pattern, fitness, scene.scene.rig)
    assert greatest == pytest.approx(result.genetic.fitness, rel=1e-4)
    difference = np.abs(pose.as_array() - result.stages["genetic"].as_array())
    # The genetic algorithm itself is accurate to 40 um and 0.0004 deg.
    assert np.all(difference < [4e-5, np.radians(4e-4), np.radians(4e-4)])


def test_normal_equations_are_those_of_the_errors():
    scene = custom_scene(n_frames=1, noise_fraction=0.05)
    (frame,) = scene.frames()
    result = Calibrator(scene.scene.rig).calibrate_frame(frame.left, frame.right)
    fitness = PatternFitness(result.pattern, scene.scene.rig, CONFIG.fitness)
    at = result.stages["genetic"].as_array() + np.array([0.003, 1e-3, -2e-3])
    for camera in (0, 1):
        steps = fitness.normal_equations(camera, at)
        for normal, side in steps:
            np.testing.assert_allclose(normal, normal.T, rtol=1e-9)
            assert side.shape == (3,)
        matching = steps[0]
        step = 1e-5 * np.array([1.0, 0.1, 0.1])
        after, before = fitness.errors(np.stack([at + step, at - step]))[0]
        assert after - before == pytest.approx(-4.0 * float(matching[1] @ step), rel=1e-3)
