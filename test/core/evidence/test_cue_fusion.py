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

"""Lines and texture together: heights of lines over a road, the road's shape as uncertainty, the mean."""

import math
from dataclasses import replace

import numpy as np
import pytest
from independent_camera import ideal_pattern

from stereo_selfcal import Extrinsics
from stereo_selfcal.core.estimators.stripe_fit import StripeFit
from stereo_selfcal.core.estimators.texture_fit import TextureFit, TextureQuality
from stereo_selfcal.core.evidence.cue_fusion import combine, difference_covariance
from stereo_selfcal.core.evidence.estimate import Estimate
from stereo_selfcal.core.evidence.lane_heights import (
    _heights_along,
    heights_over_surface,
    surely_no_kerb,
)
from stereo_selfcal.core.evidence.nuisances import (
    kerb_covariance,
    paint_angle_covariance,
    road_shape_terms,
    seen_slope_covariance,
    stage_disagreement_covariance,
    unseen_slope_covariance,
)
from stereo_selfcal.core.evidence.profile import Profile, SlopeChange
from stereo_selfcal.core.evidence.rig_unknowns import CALIBRATED, RigResponse
from stereo_selfcal.core.geometry.homography import apply_homography, road_from_image
from stereo_selfcal.core.geometry.plane import DisparityPlane, PlaneCamera, plane_from_pose, pose_from_plane
from stereo_selfcal.core.geometry.uncertainty import UncertaintyTerm, total_covariance
from stereo_selfcal.core.road.unevenness import RoadUnevenness, unit_covariances
from stereo_selfcal.synth.scenes import PAPER_RIG

POSE = Extrinsics(1.4, 0.05, 0.02)
PATTERN = ideal_pattern(PAPER_RIG, POSE)
PLANE = RoadUnevenness(0.0, 0.0, 0.0)


def road_shape(pattern, rig, pose, unevenness):
    return total_covariance(road_shape_terms(pattern, rig, pose, unevenness))


def known_to(covariance):
    return (UncertaintyTerm("noise", covariance),)


def moved(**changes):
    return replace(POSE, **{name: getattr(POSE, name) + value for name, value in changes.items()})


def heights_over(line_pose, road_pose):
    """Return the mean height of each line over a road, by the weights of its rows."""
    along = _heights_along(PATTERN, PAPER_RIG, line_pose, road_pose)
    return np.array([np.average(height_m, weights=weights) for height_m, weights, _ in along])


@pytest.mark.parametrize("lift_m", [-0.1, 0.0, 0.02])
def test_a_camera_lower_over_the_lines_has_them_higher(lift_m):
    heights = heights_over(moved(height_m=-lift_m), POSE)
    np.testing.assert_allclose(heights, lift_m, rtol=0.05, atol=1e-9)


def test_a_road_rolled_against_the_lines_has_one_above_and_one_below():
    """By the roll times the distance of each."""
    left, right = heights_over(moved(roll_rad=0.01), POSE)
    assert left == pytest.approx(-right, rel=0.3)
    assert abs(left) == pytest.approx(0.01 * 1.75, rel=0.2)


def test_shape_of_the_road_is_uncertainty_of_the_lines():
    """None for a plane; in proportion to the roughness; a bent profile is uncertainty of height and roll."""
    of_plane = road_shape(PATTERN, PAPER_RIG, POSE, PLANE)
    np.testing.assert_allclose(of_plane, 0.0, atol=1e-15)
    rough, rougher = (
        road_shape(PATTERN, PAPER_RIG, POSE, replace(PLANE, roughness=value)) for value in (1e-6, 4e-6)
    )
    np.testing.assert_allclose(rougher, 4 * rough, rtol=1e-9)
    assert np.all(np.linalg.eigvalsh(rough) > 0)
    crowned = road_shape(PATTERN, PAPER_RIG, POSE, replace(PLANE, camber=1.0))
    assert crowned[2, 2] > 0 and crowned[1, 1] < 1e-3 * crowned[2, 2]


def test_shape_of_the_road_counts_as_far_as_it_is_no_plane():
    """Planes reach a likelihood ratio of 100: there it begins at nothing."""
    rough = replace(PLANE, roughness=1e-6)
    whole = road_shape(PATTERN, PAPER_RIG, POSE, rough)
    for ratio, share in ((1.0, 0.0), (1e2, 0.0), (1e4, 0.5), (1e8, 0.75)):
        found = replace(rough, log_likelihood_ratio=math.log(ratio))
        np.testing.assert_allclose(
            road_shape(PATTERN, PAPER_RIG, POSE, found), share * whole, rtol=1e-9, atol=1e-18
        )


def test_shape_of_many_roads_scatters_the_lines_as_claimed():
    """Roads drawn with the claimed covariance of heights, fitted as planes: the same scatter."""
    unevenness = replace(PLANE, mismatch_px=0.1)
    claimed = road_shape(PATTERN, PAPER_RIG, POSE, unevenness)
    rng = np.random.default_rng(0)
    rays, disparity = [], []
    for i, lines in enumerate(PATTERN.left):
        u = PATTERN.columns[:, i].mean(axis=0)
        rows = PATTERN.rows
        seen = (rows >= lines.rows.min()) & (rows <= lines.rows.max())
        ray = np.column_stack(
            [np.ones(len(rows)), -(u - PAPER_RIG.cx) / PAPER_RIG.fx, -(rows - PAPER_RIG.cy) / PAPER_RIG.fy]
        )[seen]
        rays.append(ray)
        disparity.append(plane_from_pose(POSE, PAPER_RIG).disparities(ray))
    ray, disparity = np.concatenate(rays), np.concatenate(disparity)
    ray, disparity = ray[disparity > 1], disparity[disparity > 1]
    planes = [
        np.linalg.lstsq(ray, disparity + rng.normal(0, 0.1, len(ray)), rcond=None)[0] for _ in range(600)
    ]
    poses = [pose_from_plane(DisparityPlane(plane, PlaneCamera.MIDDLE), PAPER_RIG) for plane in planes]
    scatter = np.cov([pose.as_array() for pose in poses], rowvar=False)
    np.testing.assert_allclose(np.sqrt(np.diag(scatter)), np.sqrt(np.diag(claimed)), rtol=0.15)


def surface_of(pose, terms):
    """Return an alignment of the surface with a pose and terms, and nothing else that counts here."""
    nothing = np.empty(0)
    quality = TextureQuality(50.0, 0.9, 0.9, 0.9, (1e-3, 1e-4, 1e-4))
    return TextureFit(pose, terms, quality, PLANE, nothing, nothing, nothing, nothing)


def of_rig(changes):
    return RigResponse.of(changes, CALIBRATED)


RIGHT_RIG = of_rig(np.zeros((3, 6)))  # a rig of which everything is known


def test_mean_lies_nearer_to_the_surer_and_is_surer_than_both():
    sure, unsure = np.diag([1e-3, 1e-4, 1e-3]) ** 2, np.diag([1e-2, 1e-3, 1e-2]) ** 2
    lines = moved(height_m=0.015)  # within the deviations of both

    def mean_of(of_lines, of_surface):
        line_estimate = Estimate(lines, known_to(of_lines), 0.0)
        return combine(line_estimate, surface_of(POSE, known_to(of_surface)), RIGHT_RIG, RIGHT_RIG)

    mean = mean_of(sure, unsure)
    assert mean.pose.height_m == pytest.approx(lines.height_m - 0.015 / 101, abs=1e-9)
    assert np.all(np.diag(mean.covariance) < np.diag(sure))
    mean = mean_of(unsure, sure)
    assert mean.pose.height_m == pytest.approx(POSE.height_m + 0.015 / 101, abs=1e-9)


def drawn_covariance(rng):
    root = np.diag([1e-2, 1e-3, 1e-2]) @ rng.standard_normal((3, 5))
    return root @ root.T


def test_terms_of_both_are_weighted_and_what_contradicts_is_one_more():
    """By hand: the inverse of the sum of informations, times chi squared over three where it is unlikely."""
    rng = np.random.default_rng(3)
    noise, kerb, roughness = (drawn_covariance(rng) for _ in range(3))
    terms = (UncertaintyTerm("noise", noise), UncertaintyTerm("kerb", kerb))
    of_texture = (UncertaintyTerm("noise", noise), UncertaintyTerm("roughness", roughness))
    expected = np.linalg.inv(np.linalg.inv(noise + kerb) + np.linalg.inv(noise + roughness))
    for height_m, contradicts in ((0.001, False), (0.3, True)):
        fit = surface_of(moved(height_m=height_m), of_texture)
        mean = combine(Estimate(POSE, terms, 0.0), fit, RIGHT_RIG, RIGHT_RIG)
        names = ["noise", "roughness", "kerb", *(["combination_disagreement"] if contradicts else [])]
        assert [term.name for term in mean.terms] == names
        difference = np.array([height_m, 0.0, 0.0])
        chi2 = difference @ np.linalg.solve(2.0 * noise + kerb + roughness, difference)
        factor = chi2 / 3.0 if contradicts else 1.0
        np.testing.assert_allclose(mean.covariance, factor * expected, rtol=1e-9, atol=1e-15)


def responses(rng):
    return of_rig(np.diag([1e-2, 1e-3, 1e-2]) @ rng.standard_normal((3, 6)))


def test_unknowns_of_the_rig_are_estimated_with_the_pose():
    """The same as least squares for pose and unknowns together, each unknown with a prior of one."""
    rng = np.random.default_rng(4)
    of_lines, of_surface = responses(rng), responses(rng)
    line_noise, surface_noise = drawn_covariance(rng), drawn_covariance(rng)
    lines, surface = POSE.as_array(), POSE.as_array() + np.array([1e-3, 2e-4, -5e-4])
    mean = combine(
        Estimate(POSE, known_to(line_noise), 0.0),
        surface_of(Extrinsics.from_array(surface), known_to(surface_noise)),
        of_lines,
        of_surface,
    )
    both = np.block([[np.eye(3), of_lines.changes], [np.eye(3), of_surface.changes]])
    weights = np.zeros((6, 6))
    weights[:3, :3], weights[3:, 3:] = np.linalg.inv(line_noise), np.linalg.inv(surface_noise)
    information = both.T @ weights @ both + np.diag([0.0] * 3 + [1.0] * 6)
    covariance = np.linalg.inv(information)
    solution = covariance @ both.T @ weights @ np.concatenate([lines, surface])
    np.testing.assert_allclose(mean.pose.as_array(), solution[:3], rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(mean.covariance, covariance[:3, :3], rtol=1e-7, atol=1e-14)
    names = [term.name for term in mean.terms]
    assert names == ["noise", "vergence", "rectification", "row_offset", "ahead"]


def test_what_only_the_surface_does_not_know_is_taken_from_the_lines():
    """A vergence that pitches the surface and not the lines: the mean has the pitch of the lines."""
    sure, apart = np.diag([1e-3, 1e-4, 1e-3]) ** 2, math.radians(0.1)
    of_surface = of_rig(np.zeros((3, 6)))
    of_surface.changes[1, 0] = 100.0 * apart
    lines = Estimate(POSE, known_to(sure), 0.0)
    surface = surface_of(moved(pitch_rad=apart), known_to(sure))
    mean = combine(lines, surface, RIGHT_RIG, of_surface)
    assert mean.pose.pitch_rad == pytest.approx(POSE.pitch_rad, abs=1e-3 * apart)
    assert math.sqrt(mean.covariance[1, 1]) == pytest.approx(1e-4, rel=0.01)
    # What both respond to in the same way, neither of them can tell.
    mean = combine(lines, surface, of_surface, of_surface)
    (vergence,) = (term for term in mean.terms if term.name == "vergence")
    np.testing.assert_allclose(vergence.covariance[1, 1], (100.0 * apart) ** 2, rtol=1e-9)


def test_difference_of_lines_and_surface_scatters_as_claimed():
    """Both are off by their own noise, and by the same unknowns of one rig."""
    rng = np.random.default_rng(5)
    of_lines, of_surface = responses(rng), responses(rng)
    line_noise, surface_noise = drawn_covariance(rng), drawn_covariance(rng)
    claimed = difference_covariance(
        Estimate(POSE, known_to(line_noise), 0.0),
        surface_of(POSE, known_to(surface_noise)),
        of_lines,
        of_surface,
    )
    unknown = rng.standard_normal((20000, 6))
    lines = unknown @ of_lines.changes.T + rng.multivariate_normal(np.zeros(3), line_noise, len(unknown))
    surface = unknown @ of_surface.changes.T + rng.multivariate_normal(
        np.zeros(3), surface_noise, len(unknown)
    )
    scatter = np.cov(lines - surface, rowvar=False)
    # Of 20 000 draws, a standard deviation is known to half a percent.
    np.testing.assert_allclose(np.sqrt(np.diag(claimed)), np.sqrt(np.diag(scatter)), rtol=0.03)
    scale = np.sqrt(np.outer(np.diag(claimed), np.diag(claimed)))
    np.testing.assert_allclose(claimed / scale, scatter / scale, atol=0.05)


def test_a_road_that_may_be_a_plane_makes_the_lines_no_worse():
    """In a hundred runs, unevenness that the texture does not surely show adds no term."""
    rough = replace(PLANE, roughness=1e-6)
    for evidence, uneven in ((math.log(99.0), False), (math.log(101.0), True)):
        covariance = road_shape(PATTERN, PAPER_RIG, POSE, replace(rough, log_likelihood_ratio=evidence))
        assert bool(covariance.any()) == uneven


def asphalt(height_beside_m, height_beyond_m):
    """Return a road whose cells between the lines (at 1.75 m) and beyond lie this high over its plane."""
    places = np.array([(x, y) for x in np.arange(6.0, 25.0, 2.0) for y in (-2.3, -1.2, 0.0, 1.2, 2.3)])
    heights = np.where(np.abs(places[:, 1]) < 1.75, height_beside_m, height_beyond_m)
    quality = TextureQuality(50.0, 0.9, 0.9, 0.9, (1e-3, 1e-4, 1e-4))
    unevenness = replace(PLANE, roughness=1e-4, camber=1.0)
    sure = np.full(len(places), 1e-3**2)
    return TextureFit(
        POSE, known_to(np.eye(3)), quality, unevenness, places, heights, np.ones(len(places)), sure
    )


def heights_of(*arguments):
    return [height.value_m for height in heights_over_surface(*arguments)]


def test_a_line_in_a_hollow_of_the_asphalt_lies_in_it():
    lower = moved(height_m=0.03)
    np.testing.assert_allclose(heights_over(lower, POSE), -0.03, rtol=0.05)
    heights = heights_of(PATTERN, PAPER_RIG, lower, asphalt(-0.03, 0.03))
    np.testing.assert_allclose(heights, 0.0, atol=0.012)  # the nearest cell is half a metre away


def test_a_kerb_is_higher_than_the_lane_however_high_the_pavement_is():
    higher = moved(height_m=-0.06)
    heights = heights_of(PATTERN, PAPER_RIG, higher, asphalt(0.0, 0.06))
    np.testing.assert_allclose(heights, 0.06, rtol=0.1)


def test_heights_over_the_asphalt_scatter_by_their_standard_deviations():
    """Roads drawn as they are said to be, with lines that lie in them: 200 heights of each line."""
    flat = asphalt(0.0, 0.0)
    between = np.abs(flat.cells_xy_m[:, 1]) < 1.75
    (_, left_weights, left), (_, right_weights, right) = _heights_along(PATTERN, PAPER_RIG, POSE, POSE)
    n, weights = len(left), [left_weights, right_weights]
    at = np.concatenate([left, right, flat.cells_xy_m[between]])
    kernel, profile = unit_covariances(at)
    of_road = flat.unevenness.roughness * kernel + flat.unevenness.camber**2 * profile
    rng = np.random.default_rng(0)
    roads = rng.multivariate_normal(np.zeros(len(at)), of_road, size=200, method="eigh")
    # Heights are those over the plane that was fitted to the cells, by generalised least squares.
    planes = np.column_stack([np.ones(len(at)), at])
    information = np.linalg.inv(of_road[2 * n :, 2 * n :] + 1e-6 * np.eye(np.count_nonzero(between)))
    fit = np.linalg.solve(planes[2 * n :].T @ information @ planes[2 * n :], planes[2 * n :].T @ information)
    relative = []
    for road in roads:
        measured = road[2 * n :] + rng.normal(0.0, 1e-3, np.count_nonzero(between))
        plane = fit @ measured
        heights = np.full(len(between), np.nan)
        heights[between] = measured - planes[2 * n :] @ plane
        over = heights_over_surface(PATTERN, PAPER_RIG, POSE, replace(flat, cells_height_m=heights))
        seen, std = np.transpose([(height.value_m, height.std_m) for height in over])
        # The lines are in the plane of the pose; the road under them is as much higher as it is there.
        under = (road - planes @ plane)[: 2 * n].reshape(2, n)
        relative.append((seen + np.average(under, axis=1, weights=np.array(weights))) / std)
    assert 0.8 < np.sqrt(np.mean(np.square(relative))) < 1.25


def beneath(roughness):
    """Return the road surface under the car, a metre to either side, level and known to a millimetre."""
    fit = asphalt(0.0, 0.0)
    own = np.where(np.abs(fit.cells_xy_m[:, 1]) < 1.5, fit.cells_height_m, np.nan)
    unevenness = replace(fit.unevenness, roughness=roughness, camber=0.0)
    return replace(fit, cells_height_m=own, unevenness=unevenness)


@pytest.mark.parametrize(
    ("change", "excluded"),
    [
        ({}, True),
        ({"height_m": 0.045}, True),
        ({"height_m": 0.06}, False),
        # A kerb is that high beside the camera.
        ({"roll_rad": 0.045 / 1.75}, True),
        ({"roll_rad": 0.06 / 1.75}, False),
        # What is ahead has the lever of its distance: the rows of the lines have their weight 8 m ahead.
        ({"pitch_rad": -0.08 / 6.0}, False),
    ],
)
def test_surface_excludes_a_kerb_that_is_two_deviations_off(change, excluded):
    """The lowest one is 60 mm high; half a metre beside the cells a smooth road is known to a few mm."""
    heights = heights_over_surface(PATTERN, PAPER_RIG, moved(**change), beneath(roughness=2.7e-6))
    assert (surely_no_kerb(heights) >= 1.0) == excluded


def test_surface_as_rough_as_a_kerb_is_high_excludes_none():
    """Heights half a metre apart differ by 60 mm there: 0.06^2 / 0.5^1.5."""
    assert surely_no_kerb(heights_over_surface(PATTERN, PAPER_RIG, POSE, beneath(roughness=1e-2))) < 1.0


def test_a_doubtful_boundary_lifts_one_end_of_the_plane():
    """By the standard deviation of its height: of lines 3.5 m apart, the camera is in the middle."""
    one = kerb_covariance(PATTERN, PAPER_RIG, POSE, [1], 0.030)
    std = np.sqrt(np.diag(one))
    np.testing.assert_allclose(std[[0, 2]], [0.015, 0.030 / 3.5], rtol=0.1)
    assert std[1] < 1e-3
    np.testing.assert_allclose(kerb_covariance(PATTERN, PAPER_RIG, POSE, [1], 0.060), 4.0 * one)
    assert not kerb_covariance(PATTERN, PAPER_RIG, POSE, [], 0.030).any()


def test_kerbs_on_both_sides_are_one_doubt():
    """They share one height: the road is as much lower than both, and not turned."""
    std = np.sqrt(np.diag(kerb_covariance(PATTERN, PAPER_RIG, POSE, [0, 1], 0.030)))
    np.testing.assert_allclose(std[0], 0.030, rtol=0.1)
    assert std[2] < 0.1 * 0.030 / 3.5


def test_lines_painted_not_quite_parallel_leave_a_valley():
    """One standard deviation along it, lines that are parallel meet at 5 mrad; a plane's lines are."""
    covariance = paint_angle_covariance(PATTERN, PAPER_RIG, POSE)
    assert np.linalg.matrix_rank(covariance, tol=1e-9 * covariance.max()) == 1
    std = np.sqrt(np.diag(covariance))
    along = std * np.sign(covariance[1])
    to_road = road_from_image(PAPER_RIG, Extrinsics.from_array(POSE.as_array() + along), "left")
    directions = []
    for line in PATTERN.left:
        rows = np.array([line.rows.min(), line.rows.max()])
        far, near = apply_homography(to_road, np.column_stack([line.column_at(rows), rows]))
        directions.append(math.atan2(far[1] - near[1], far[0] - near[0]))
    assert abs(directions[0] - directions[1]) == pytest.approx(0.005, rel=0.05)


FLAT = Profile(np.empty(0), np.empty(0), np.empty(0), np.zeros(2), np.zeros((2, 2)))


def refined_to(pose):
    none = np.empty(0)
    return StripeFit(pose, np.eye(3) * 1e-6, 0.0, 0.0, none, none, none, np.full(2, 0.5), 2.0, 1.0, 50, None)


def test_stages_that_contradict_each_other_are_as_uncertain_as_they_differ():
    """By what chance does not explain in nineteen of twenty frames, from nothing on and without a jump."""
    of_lines = np.eye(3) * 3e-6  # with that of the refinement: 2 mm and mrad
    difference = np.array([0.0, 0.0, 0.007])

    def found(times):
        off = refined_to(Extrinsics.from_array(POSE.as_array() + times * difference))
        return stage_disagreement_covariance(POSE, of_lines, off)

    chance = 7.815 / (0.007**2 / 4e-6)
    np.testing.assert_allclose(found(1.0), np.outer(difference, difference) * (1.0 - chance), atol=1e-12)
    np.testing.assert_allclose(found(10.0)[2, 2], 0.07**2, rtol=0.01)
    assert not found(0.79).any() and 0.0 < found(0.81)[2, 2] < 0.1 * 0.007**2
    assert not stage_disagreement_covariance(POSE, of_lines, None).any()


def profile_of(height_m, change=(0.02, 0.003), std=(0.03, 0.004), **others):
    """Return a profile with one height, 15 m ahead, that is known to 2 mm."""
    at = np.array([15.0]), np.array([height_m]), np.array([0.002])
    return Profile(*at, np.array(change), np.diag(std) ** 2, **others)


def test_a_road_seen_to_bend_is_as_uncertain_as_the_bend_and_as_what_is_not_seen_of_it():
    flat = profile_of(0.0)
    change = np.outer(flat.change, flat.change)
    np.testing.assert_allclose(seen_slope_covariance(flat)[:2, :2], change)
    np.testing.assert_allclose(unseen_slope_covariance(flat)[:2, :2], flat.covariance)
    assert not seen_slope_covariance(flat)[2].any() and not unseen_slope_covariance(flat)[2].any()
    for found in (seen_slope_covariance, unseen_slope_covariance):
        assert not found(None).any()
    # Of a bend, stripes show half or more: one step of least squares sees no farther.
    scales = [
        np.sqrt(seen_slope_covariance(profile_of(height_m, seen_share=0.5))[0, 0]) / 0.02
        for height_m in (0.0, 0.008, 0.5)
    ]
    np.testing.assert_allclose(scales, [1.0, 1.5, 2.0], atol=1e-3)


def test_of_a_gentle_and_a_sharp_road_each_counts_by_its_probability():
    gentle, sharp = (
        SlopeChange(probability, np.array(change), np.diag(std) ** 2)
        for probability, change, std in (
            (0.75, (0.001, 0.0002), (0.002, 0.0003)),
            (0.25, (0.01, 0.002), (0.02, 0.003)),
        )
    )
    profile = profile_of(0.0, kinds=(gentle, sharp))
    seen = 0.75 * np.outer(gentle.change, gentle.change) + 0.25 * np.outer(sharp.change, sharp.change)
    np.testing.assert_allclose(seen_slope_covariance(profile)[:2, :2], seen)
    unseen = 0.75 * gentle.covariance + 0.25 * sharp.covariance
    np.testing.assert_allclose(unseen_slope_covariance(profile)[:2, :2], unseen)
