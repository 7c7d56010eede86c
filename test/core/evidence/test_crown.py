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

"""A crown between two lines: how far their plane is from that of the own lane, and what is said of it."""

import math
from dataclasses import replace

import numpy as np
import pytest

from stereo_selfcal import Calibrator, CalibratorConfig, Extrinsics
from stereo_selfcal.core.estimators.stripe_fit import StripeFit
from stereo_selfcal.core.evidence.nuisances import crown_covariance
from stereo_selfcal.synth.ingredients import Paint
from stereo_selfcal.synth.road_shape import pose_over_plane
from stereo_selfcal.synth.worlds import named_world, render_world

POSE = Extrinsics(1.5, 0.02, -0.01)
UNIT_FALL = 0.025  # to either side, the steepest that is built


def fit(places_m, heights_m):
    places, heights = np.array(places_m), np.array(heights_m)
    widths = np.full(len(places), 0.12)
    return StripeFit(
        POSE, np.eye(3) * 1e-8, 0.0, 0.0, places, widths, heights, np.full(2, 0.5), 2.0, 1.0, 50, None
    )


def error_of_outer_lines(border_m, crown_m):
    """Return what the plane through the outer borders of two lanes with a crown is off the own lane's."""
    side = math.copysign(1.0, crown_m - border_m)
    half_m = abs(crown_m - border_m)
    level = np.array([-UNIT_FALL * half_m, 0.0, 0.0])  # the crown has height 0
    own = np.array([-UNIT_FALL * abs(crown_m), 0.0, side * UNIT_FALL])
    outer, lane = (pose_over_plane(POSE, 0.0, 0.0, plane) for plane in (level, own))
    return outer.as_array() - lane.as_array()


@pytest.mark.parametrize(("border_m", "crown_m"), [(-1.7, 1.5), (1.9, -1.2)])
def test_hidden_crown_is_two_standard_deviations(border_m, crown_m):
    other_m = 2.0 * crown_m - border_m
    places = [max(border_m, other_m), min(border_m, other_m)]
    covariance = crown_covariance(fit(places, [0.0, 0.0]))
    error = error_of_outer_lines(border_m, crown_m)
    # Nearly all of it is in one direction: that of the error.
    std = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(np.abs(error)[[0, 2]], 2.0 * std[[0, 2]], rtol=0.02)
    assert np.sign(covariance[0, 2]) == np.sign(error[0] * error[2])
    assert std[1] == 0.0


@pytest.mark.parametrize(("border_m", "crown_m"), [(-1.7, 1.5), (1.9, -1.2)])
def test_crown_with_a_line_on_it_is_one_standard_deviation(border_m, crown_m):
    other_m = 2.0 * crown_m - border_m
    height_m = UNIT_FALL * abs(crown_m - border_m)
    places = [max(border_m, other_m), min(border_m, other_m), crown_m]
    covariance = crown_covariance(fit(places, [0.0, 0.0, height_m]))
    error = error_of_outer_lines(border_m, crown_m)
    np.testing.assert_allclose(covariance[::2, ::2], np.outer(error, error)[::2, ::2], rtol=0.03)


def test_one_lane_has_no_crown():
    assert not crown_covariance(fit([1.9, -1.8], [0.0, 0.0])).any()
    assert not crown_covariance(fit([2.1, -1.9], [0.0, 0.0])).any()
    assert crown_covariance(fit([2.2, -1.9], [0.0, 0.0])).any()
    # Lines in one plane leave nothing to be said, however many they are.
    assert not crown_covariance(fit([4.8, -1.6, 1.6], [0.0, 0.0, 0.0])).any()
    assert not crown_covariance(fit([-0.2, -2.8], [0.0, 0.0])).any()
    assert not crown_covariance(None).any()


def test_lanes_that_may_lie_between_two_lines_make_no_step():
    """From the lines of one lane to those of three: the standard deviation of roll, every centimetre."""
    widths = np.arange(3.5, 11.0, 0.01)
    stds = [math.sqrt(crown_covariance(fit([width - 1.7, -1.7], [0.0, 0.0]))[2, 2]) for width in widths]
    assert stds[0] == 0.0 and stds[-1] > 0.015
    assert np.all(np.diff(stds) >= 0.0) and np.diff(stds).max() < math.radians(0.02)


def test_half_a_lane_shows_half_of_it():
    """An arrow in the middle of the lane stands for a line; the other half may slope otherwise."""
    half = np.sqrt(np.diag(crown_covariance(fit([0.05, -1.2], [0.0, 0.0]))))
    np.testing.assert_allclose(half, [0.0125 * 1.2, 0.0, 0.0125])
    # Where the arrow is to the same side of the camera as the line, too.
    aside = np.sqrt(np.diag(crown_covariance(fit([-0.05, -1.3], [0.0, 0.0]))))
    np.testing.assert_allclose(aside, [0.0125 * 1.3, 0.0, 0.0125])
    # Where both borders are there as well, it does not matter what else is.
    assert not crown_covariance(fit([1.6, -1.2, 0.05], [0.0, 0.0, 0.0])).any()


def test_lines_of_two_lanes_know_that_a_crown_may_lie_between():
    """The line between both lanes is missing: without it, nothing shows the crown."""
    world = named_world("crown")
    own, middle = sorted((paint.line for paint in world.scene.paints), key=lambda line: line.offset_m)
    far = replace(middle, offset_m=middle.offset_m + 3.2)
    scene = replace(world.scene, texture_amplitude=0.0, paints=(Paint(own), Paint(far)))
    images = render_world(replace(world, scene=scene), np.random.default_rng(3))
    result = Calibrator(scene.rig, CalibratorConfig.from_mapping({"texture.check": 0})).add(*images)
    assert result.accepted
    error = result.extrinsics.as_array() - scene.truth().as_array()
    assert abs(error[2]) > math.radians(0.8)
    assert np.all(np.abs(error) < 3.0 * np.sqrt(np.diag(result.covariance)))
