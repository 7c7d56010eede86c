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

"""What an error of the calibration does to a pose: against estimates that are made again with that error."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from independent_camera import ideal_pattern, of_turned_camera, with_columns

from stereo_selfcal import Calibrator, CalibratorConfig, Extrinsics
from stereo_selfcal.core.config import FitnessConfig
from stereo_selfcal.core.estimators.fitness import PatternFitness
from stereo_selfcal.core.estimators.line_covariance import propagate
from stereo_selfcal.core.estimators.stripe_fit import refine
from stereo_selfcal.core.evidence.rig_unknowns import (
    CALIBRATED,
    RigResponse,
    changes_of_lines,
    response_of_lines,
    response_of_surface,
    rig_terms,
)
from stereo_selfcal.core.geometry.plane import plane_from_pose
from stereo_selfcal.core.geometry.rays import pixel_rays
from stereo_selfcal.core.geometry.uncertainty import total_covariance
from stereo_selfcal.synth.renderer import render
from stereo_selfcal.synth.scenes import PAPER_RIG, random_scene

RIG = PAPER_RIG
POSE = Extrinsics(1.4, 0.05, 0.02)
CONFIG = FitnessConfig()
VERGENCE_PX = RIG.fx * math.radians(0.01)  # of the optical axes; beside them it is more by a part in ten


def nothing(u, v=0.0):
    return np.zeros_like(u + v)


PITCH_PX, ROLL_RAD = RIG.fy * math.radians(0.015), math.radians(0.02)
# By how much each unknown makes the disparity larger at (column, row), and the right image's content lower
# [px]. A right camera that is nose down has its content higher; one whose right side is low, to the right.
UNKNOWNS = {
    "vergence": (lambda u, v: VERGENCE_PX * np.ones_like(u + v), nothing),
    "across": (lambda u, v: 0.1 * (u - RIG.cx) / (RIG.width / 2.0), nothing),
    "down": (lambda u, v: 0.1 * (v - RIG.cy) / (RIG.height / 2.0), nothing),
    "pitch": (nothing, lambda u: -PITCH_PX * np.ones_like(u)),
    "roll": (
        lambda u, v: -ROLL_RAD * (v - RIG.cy) * RIG.fx / RIG.fy,
        lambda u: -ROLL_RAD * (u - RIG.cx) * RIG.fy / RIG.fx,
    ),
}


@pytest.mark.parametrize("unknown", UNKNOWNS)
@pytest.mark.parametrize("pose", [POSE, Extrinsics(2.0, -0.03, -0.04)])
def test_surface_is_another_plane_with_other_disparities(unknown, pose):
    """All pixels of the road, whose disparities are larger: the plane that fits them best."""
    changed, _ = UNKNOWNS[unknown]
    u, v = (grid.ravel() for grid in np.meshgrid(np.arange(20.0, 620.0, 50.0), np.arange(280.0, 480.0, 20.0)))
    rays = pixel_rays(RIG, u, v)
    disparity = plane_from_pose(pose, RIG).disparities(rays)
    again = np.linalg.lstsq(rays, disparity + changed(u, v), rcond=None)[0]
    moved = pose_of(again).as_array() - pose.as_array()
    found = response_of_surface(RIG, pose).changes[:, list(UNKNOWNS).index(unknown)]
    assert moved.any() or unknown == "pitch"
    assert np.all(np.abs(found - moved) < 0.02 * np.abs(moved).max() + 1e-12)


def pose_of(coefficients):
    """Return the pose over a plane of disparities, as in the design notes: p = -fx b / h * up."""
    length = np.linalg.norm(coefficients)
    up = -coefficients / length
    return Extrinsics(RIG.fx * RIG.baseline_m / length, -math.asin(up[0]), math.atan2(up[1], up[2]))


def with_unknown(pattern, larger, lower):
    """Return the pattern with the lines of the right image where an error of the rig moves them."""
    columns = pattern.columns.copy()
    for index, line in enumerate(pattern.right):
        at = line.column_at(pattern.rows)
        at = line.column_at(pattern.rows - lower(at))
        columns[1, index] = at - larger(at, pattern.rows)
    return with_columns(pattern, columns)


def best_pose(pattern, start, camera):
    """Return the pose (3,) with the greatest fitness: least E1, with lines that are parallel in one image."""
    fitness = PatternFitness(pattern, RIG, CONFIG)
    pose, steps = start.as_array(), np.array([1e-5, 1e-6, 1e-6])

    def terms(at):
        distances, angles = fitness.linear_terms(at[None])
        return np.append(distances[0], 1e6 * angles[camera][0])  # a constraint: it has all the weight

    for _ in range(4):
        jacobian = np.column_stack(
            [terms(pose + step) - terms(pose - step) for step in np.diag(steps)] / (2.0 * steps[:, None])
        )
        pose = pose - np.linalg.lstsq(jacobian, terms(pose), rcond=None)[0]
    return pose


@pytest.mark.parametrize("unknown", UNKNOWNS)
@pytest.mark.parametrize("camera", [0, 1])
@pytest.mark.parametrize(("pose", "yaw"), [(POSE, 0.0), (Extrinsics(1.6, 0.03, -0.02), 0.02)])
def test_lines_that_an_error_moves_have_another_pose(unknown, camera, pose, yaw):
    """The search again, with the lines of the right image moved by one standard deviation."""

    def apart(image, line, rows):
        """Turn a line of the other camera by next to nothing: the search takes that with parallel lines."""
        return 1e-7 * (rows - rows.mean()) * (image != camera and line == 0)

    pattern = ideal_pattern(RIG, pose, lane_yaw_rad=yaw, columns=apart)
    np.testing.assert_allclose(best_pose(pattern, pose, camera), pose.as_array(), atol=1e-6)
    again = best_pose(with_unknown(pattern, *UNKNOWNS[unknown]), pose, camera)
    fit = propagate(pattern, RIG, pose, CONFIG)
    found = response_of_lines(fit, pattern, RIG).changes[:, list(UNKNOWNS).index(unknown)]
    moved = again - pose.as_array()
    assert np.any(np.abs(moved) > 1e-5)
    # A line moves by a fifth of a pixel at most, so that all is linear to a hundredth.
    assert np.all(np.abs(found - moved) < 0.02 * np.abs(moved).max() + 1e-6), (found, moved)


@pytest.mark.parametrize("angle", ["pitch", "roll"])
@pytest.mark.parametrize(("pose", "yaw"), [(POSE, 0.0), (Extrinsics(1.6, 0.03, -0.02), 0.02)])
def test_lines_of_a_turned_camera_respond_as_claimed(angle, pose, yaw):
    """A rotation moves columns as well, by a part of what the rows do: a quarter, at the borders."""
    std_rad = getattr(CALIBRATED, f"{angle}_rad")
    pattern = ideal_pattern(RIG, pose, lane_yaw_rad=yaw)
    turned = of_turned_camera(pattern, RIG, **{f"{angle}_rad": std_rad})
    claimed = changes_of_lines(pattern, RIG)[:, list(UNKNOWNS).index(angle)].reshape(2, 2, 2)
    assert not claimed[0].any()
    for line, before, change in zip(turned.right, pattern.right, claimed[1], strict=True):
        at = np.array([before.rows.min(), before.rows.max()])
        moved = line.column_at(at) - before.column_at(at)
        np.testing.assert_allclose(change[0] + change[1] * (at - before.v_mid), moved, rtol=0.25, atol=0.01)


@pytest.mark.slow
def test_the_fit_of_the_stripes_responds_as_the_lines_do():
    """The estimate is that of the stripes' grey values: rendered ones, moved by five standard deviations."""
    scene = random_scene(np.random.default_rng(4), 0.0)
    left, right = render(scene, np.random.default_rng(0))
    calibrator = Calibrator(RIG, CalibratorConfig.from_mapping({"texture.check": 0}))
    pattern = calibrator.extract(left, right)
    start = calibrator.calibrate_frame(left, right).stages["genetic"]
    claimed = response_of_lines(propagate(pattern, RIG, start, CONFIG), pattern, RIG).changes
    before = refine((left, right), pattern, RIG, start).extrinsics.as_array()
    v, u = np.mgrid[0 : RIG.height, 0 : RIG.width].astype(np.float32)
    for unknown, (larger, lower) in enumerate(UNKNOWNS.values()):
        # What lies at (u, v) moves to the left by as much as the disparity is larger, or down.
        maps = (u + 5.0 * larger(u, v)).astype(np.float32), (v - 5.0 * lower(u)).astype(np.float32)
        image = cv2.remap(
            right.astype(np.float32), *maps, cv2.INTER_LANCZOS4, borderMode=cv2.BORDER_REPLICATE
        )
        moved = np.clip(np.rint(image), 0, 255).astype(np.uint8)
        after = refine((left, moved), pattern, RIG, start).extrinsics.as_array()
        found, expected = (after - before) / 5.0, claimed[:, unknown]
        scale = np.abs(expected) / [1e-3, 1e-4, 1e-3]
        strongest = int(np.argmax(scale))
        assert found[strongest] == pytest.approx(expected[strongest], rel=0.15)


def test_lines_know_the_horizon_where_the_surface_does_not():
    """A hundredth of a degree of vergence pitches the surface by 0.1 deg; lines that are parallel stay."""
    pattern = ideal_pattern(RIG, POSE)
    lines = response_of_lines(propagate(pattern, RIG, POSE, CONFIG), pattern, RIG).changes
    surface = response_of_surface(RIG, POSE).changes
    assert math.degrees(abs(surface[1, 0])) == pytest.approx(0.1, abs=0.02)
    assert abs(lines[1, 0]) < 0.05 * abs(surface[1, 0])
    # Rows that are off move slanted lines, and no texture.
    rows = list(UNKNOWNS).index("pitch")
    assert not surface[:, rows].any() and lines[:, rows].any()


def test_terms_are_one_for_each_cause_and_none_averages_out():
    changes = np.arange(18.0).reshape(3, 6) - 4.0
    terms = rig_terms(RigResponse.of(changes, CALIBRATED))
    names = ["vergence", "rectification", "rectification", "row_offset", "row_offset", "ahead"]
    assert [term.name for term in terms] == names
    np.testing.assert_allclose(total_covariance(terms), changes @ changes.T)
    for term in terms:
        assert np.linalg.matrix_rank(term.covariance) == 1


def test_what_the_rows_of_a_frame_leave_open_is_noise_of_that_frame():
    """Compared anew in every frame, it averages out."""
    terms = rig_terms(RigResponse.of(np.ones((3, 6)), replace(CALIBRATED, rows_measured=True)))
    names = ["vergence", "rectification", "rectification", "noise", "noise", "ahead"]
    assert [term.name for term in terms] == names


@pytest.mark.parametrize("pose", [POSE, Extrinsics(2.0, -0.03, -0.04)])
def test_rectification_leaves_a_tenth_of_a_pixel_at_the_borders_of_the_image(pose):
    """Draws of what grows to the sides and of what grows to top and bottom, and of the vergence."""
    rng = np.random.default_rng(0)
    # Rays (1, y, z) to the middle of the borders.
    at_side, at_bottom = RIG.width / 2.0 / RIG.fx, RIG.height / 2.0 / RIG.fy
    plane = plane_from_pose(pose, RIG).coefficients
    # What grows downwards is a lens's, or a camera's that is turned about its axis.
    down = math.hypot(0.1 / at_bottom, RIG.fx * ROLL_RAD)
    errors = rng.normal(size=(3000, 3)) * [VERGENCE_PX, 0.1 / at_side, down]
    poses = np.array([pose_of(plane + error).as_array() for error in errors])
    scale = poses.std(axis=0)
    claimed = total_covariance(rig_terms(response_of_surface(RIG, pose)))
    # Of 3000 draws, a correlation is known to 0.02.
    np.testing.assert_allclose(claimed / np.outer(scale, scale), np.corrcoef(poses.T), atol=0.08)


def test_a_right_camera_that_seems_to_sit_ahead_makes_the_roll_of_texture_uncertain():
    """A late image at 10 m/s and 2 ms: 2 cm of a baseline of 15 cm."""
    ahead = replace(CALIBRATED, ahead=0.02 / 0.15)
    response = response_of_surface(RIG, POSE, ahead)
    change = response.changes[:, response.terms.index("ahead")]
    assert abs(change[2]) == pytest.approx(ahead.ahead / 5.0, rel=0.05)
    assert abs(change[1]) < 0.1 * abs(change[2])
    of_rig = response_of_surface(RIG, POSE).changes
    np.testing.assert_allclose(of_rig[:, response.terms.index("ahead")], 0.0)
