"""What far things and lane lines know of a right camera that has turned about the vertical."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from independent_camera import ideal_pattern

from stereo_selfcal import Extrinsics, RejectReason, calibrate
from stereo_selfcal.core.evidence.far_disparity import FarDisparity
from stereo_selfcal.core.evidence.vergence import measure_vergence
from stereo_selfcal.core.geometry.plane import DisparityPlane, PlaneCamera, plane_from_pose, pose_from_plane
from stereo_selfcal.core.lanes.matching import Candidate, Match
from stereo_selfcal.core.road.priors import PAINT_ANGLE_STD_RAD
from stereo_selfcal.synth.renderer import render
from stereo_selfcal.synth.scenes import PAPER_RIG, random_scene

RIG = PAPER_RIG
POSE = Extrinsics(1.4, 0.05, 0.02)
NO_LINES = ([], [])


def turned_pose(yaw_rad):
    """Return the pose over the surface when the right camera looks farther left: disparities are smaller."""
    plane = plane_from_pose(POSE, RIG).coefficients - [RIG.fx * yaw_rad, 0.0, 0.0]
    return pose_from_plane(DisparityPlane(plane, PlaneCamera.MIDDLE), RIG)


def lines_at(*positions_m, likeness=1.0, yaw_rad=0.0):
    """Return lines of the true road at positions left of the middle, as both cameras see them."""
    found = ([], [])
    for position_m in positions_m:
        pattern = ideal_pattern(RIG, POSE, (position_m, position_m - 3.0), lane_yaw_rad=yaw_rad)
        match = Match(Candidate(pattern.left[0], 10.0), Candidate(pattern.right[0], 10.0), likeness)
        found[0 if position_m > 0.0 else 1].append(match)
    return found


def by_lines(lines, pose, far=None):
    """Return the turn that lines tell; None where they tell none."""
    told = [each for each in measure_vergence(far, lines, RIG, pose) if each.by_lines]
    return told[0] if told else None


@pytest.mark.parametrize("turn_deg", [-0.3, -0.1, 0.04, 0.25])
@pytest.mark.parametrize("positions_m", [(1.75, -1.75), (1.6, -1.9, -5.3)])
def test_lines_tell_the_turn_under_which_they_are_parallel(turn_deg, positions_m):
    turn_rad = math.radians(turn_deg)
    seen = by_lines(lines_at(*positions_m), turned_pose(turn_rad))
    assert abs(seen.yaw_rad - turn_rad) < 0.03 * abs(turn_rad) + 1e-6
    assert seen.by_lines


def test_paint_that_is_not_parallel_is_in_the_uncertainty():
    """Two lines at an angle on the true road look like a turn of that many standard deviations."""
    first, second = lines_at(1.75), lines_at(-1.75, yaw_rad=3.0 * PAINT_ANGLE_STD_RAD)
    seen = by_lines((first[0], second[1]), POSE)
    assert abs(seen.yaw_rad) / seen.std_rad == pytest.approx(3.0, rel=0.1)


def test_more_lines_tell_it_better():
    two, four = (by_lines(lines_at(*at), POSE) for at in ((1.75, -1.75), (5.25, 1.75, -1.75, -5.25)))
    assert four.std_rad < 0.5 * two.std_rad


def test_turn_that_makes_the_pose_wrong_is_given():
    """By the plane itself: half a degree of pitch or 6 cm of height, whichever comes first."""
    wrong_rad = by_lines(lines_at(1.75, -1.75), POSE).wrong_rad
    change = np.abs(turned_pose(wrong_rad).as_array() - POSE.as_array())
    assert np.max(change / [0.060, math.radians(0.5), math.radians(1.2)]) == pytest.approx(1.0, rel=0.05)


def test_two_lines_that_are_parallel_on_the_surface_confirm_it():
    """A line that leads away, such as that of an exit, is clearer here, and tells nothing."""
    lines = lines_at(1.75, -1.75)
    exit_line = lines_at(-5.0, yaw_rad=0.1)[1][0]
    lines[1].append(replace(exit_line, left=Candidate(exit_line.left.line, 1e3)))
    seen = by_lines(lines, POSE)
    assert seen is None or abs(seen.yaw_rad) < seen.std_rad


@pytest.mark.parametrize("lines", [NO_LINES, lines_at(1.75), lines_at(1.75, -1.75, likeness=0.8)])
def test_one_line_or_lines_that_differ_tell_nothing(lines):
    assert by_lines(lines, turned_pose(math.radians(0.3))) is None


def test_lines_far_from_parallel_are_no_turn():
    """No calibration is off by a degree."""
    assert by_lines(lines_at(1.75, -1.75), turned_pose(math.radians(0.6))) is None


def test_far_things_deny_that_the_camera_has_turned():
    """Nothing is farther than infinity, and things that are equally far in all directions are there."""
    looks_right = turned_pose(math.radians(-0.2))  # lines say that disparities are 1.8 px too large
    lines = lines_at(1.75, -1.75)
    assert by_lines(lines, looks_right, FarDisparity(0.0, 0.1, 1.0)) is None
    assert by_lines(lines, looks_right, FarDisparity(4.0, 0.1, 1.0)) is not None
    looks_left = turned_pose(math.radians(0.2))
    assert by_lines(lines, looks_left, FarDisparity(0.0, 0.1, 8.0)) is None
    assert by_lines(lines, looks_left, FarDisparity(0.0, 0.1, 1.0)) is not None


def test_only_a_negative_disparity_shows_a_turn():
    for disparity_px, shown_px in ((-1.5, 1.5), (0.0, 0.0), (1.5, 0.0)):
        (seen,) = measure_vergence(FarDisparity(disparity_px, 0.1, 16.0), NO_LINES, RIG, POSE)
        assert seen.yaw_rad * RIG.fx == pytest.approx(shown_px)


@pytest.mark.parametrize("turn_px", [-2.0, -1.0, 1.0, 2.0])
def test_turned_camera_is_refused_with_its_angle(turn_px):
    """Images of a textured road with two lines, the right one turned as by a rotation of its camera.

    By whole pixels, so that the images are as sharp as before.
    """
    scene = random_scene(np.random.default_rng(3), texture_amplitude=12.0)
    left, right = render(scene, np.random.default_rng(0))
    assert calibrate(left, right, scene.rig).accepted
    rig, turn_rad = scene.rig, turn_px / scene.rig.fx
    camera = np.array([[rig.fx, 0.0, rig.cx], [0.0, rig.fy, rig.cy], [0.0, 0.0, 1.0]])
    # A camera that looks farther left sees everything farther right.
    about_vertical = cv2.Rodrigues(np.array([0.0, turn_rad, 0.0]))[0]
    seen = camera @ about_vertical @ np.linalg.inv(camera)
    turned = cv2.warpPerspective(
        right, seen, right.shape[::-1], flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
    )
    result = calibrate(left, turned, scene.rig)
    assert not result.accepted
    assert result.reason is RejectReason.IMAGES_NOT_RECTIFIED
    assert f"farther to the {'left' if turn_px > 0 else 'right'}" in result.message
