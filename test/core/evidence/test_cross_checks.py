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

"""What else the images say where two lines stand alone: horizon, profile, what lies beside the stripes."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from stereo_selfcal import Calibrator, CalibratorConfig, Extrinsics, RejectReason
from stereo_selfcal.core.estimators.stripe_fit import refine
from stereo_selfcal.core.evidence.frame_evidence import FrameObservations
from stereo_selfcal.core.evidence.horizon import horizon_offset
from stereo_selfcal.core.evidence.kerb_face import measure_edge_steps
from stereo_selfcal.core.evidence.nuisances import seen_slope_covariance, unseen_slope_covariance
from stereo_selfcal.core.evidence.profile import FAR_M, NEAR_M, measure_profile
from stereo_selfcal.core.evidence.stripe_border import measure_borders
from stereo_selfcal.core.geometry.homography import SIDES
from stereo_selfcal.core.geometry.plane import plane_from_pose
from stereo_selfcal.core.lanes.closed_form import solve_plane
from stereo_selfcal.core.lanes.extra_lines import inner_line_height
from stereo_selfcal.core.lanes.hypotheses import find_hypotheses
from stereo_selfcal.core.lanes.line_geometry import height_and_offset_m
from stereo_selfcal.core.lanes.stripe_points import find_stripe_points
from stereo_selfcal.core.rejection import NotFitted
from stereo_selfcal.core.reservations import Reservation, ReservationKind
from stereo_selfcal.synth.ingredients import Car, Paint, Shadow
from stereo_selfcal.synth.road_shape import RoadShape, near_plane, pose_over_plane
from stereo_selfcal.synth.world import LaneLine
from stereo_selfcal.synth.world_renderer import render_side
from stereo_selfcal.synth.world_sensor import capture
from stereo_selfcal.synth.worlds import named_world, render_world

SLOPE_UNKNOWN = Reservation(ReservationKind.SLOPE_AHEAD_UNKNOWN)
LINES_ALONE = CalibratorConfig.from_mapping({"texture.check": 0})


@cache
def seen(name, **changes):
    """Return a named world without texture, and its images."""
    world = named_world(name)
    world = replace(world, scene=replace(world.scene, texture_amplitude=0.0, **changes))
    return world, render_world(world, np.random.default_rng(5))


@cache
def bare(name, **changes):
    """Return a named world without texture, its images, and what the calibrator makes of the lines."""
    world, images = seen(name, **changes)
    return world, images, Calibrator(world.scene.rig, LINES_ALONE).add(*images)


def of_right_camera(world, **changes):
    return {"right": replace(world.scene.right, **changes)}


@pytest.mark.parametrize("turned_deg", [0.0, -0.3, 1.2])
@pytest.mark.parametrize("lower_px", [0.0, 1.0, -3.0])
def test_horizon_shows_turn_and_offset(turned_deg, lower_px):
    camera = of_right_camera(named_world("plain"), turned_rad=math.radians(turned_deg), lower_px=lower_px)
    world, images = seen("plain", **camera)
    found = horizon_offset(images, world.scene.rig, world.truth)
    # The turn of a camera, right side down, lifts what is to its right in the picture.
    assert found.roll_rad == pytest.approx(-math.radians(turned_deg), abs=2e-4)
    assert found.offset_px == pytest.approx(lower_px, abs=0.1)
    # What stands before a horizon may pass for a turn by 0.04 deg; here there is nothing.
    assert found.std_px < 0.1 and found.roll_std_rad == pytest.approx(math.radians(0.04), rel=0.05)


def test_horizon_is_found_with_a_wrong_roll():
    world, images = seen("plain")
    pose = world.truth
    wrong = Extrinsics(pose.height_m, pose.pitch_rad, pose.roll_rad + math.radians(3.0))
    found = horizon_offset(images, world.scene.rig, wrong)
    assert abs(found.offset_px) < 0.1 and abs(found.roll_rad) < 2e-4


@pytest.mark.parametrize("turned_deg", [0.0, 0.5])
def test_a_bare_horizon_that_is_slanted_shows_the_turn_as_well(turned_deg):
    """Along a slanted edge, rows and disparities are one: what is far away has next to no disparity."""
    camera = named_world("plain").scene.right
    soft = replace(camera, photometry=replace(camera.photometry, psf_sigma_px=1.5))
    pose = replace(named_world("plain").truth, roll_rad=math.radians(2.6))
    turned = replace(soft, turned_rad=math.radians(turned_deg))
    world, images = seen("plain", pose=pose, left=soft, right=turned)
    found = horizon_offset(images, world.scene.rig, pose)
    assert not isinstance(found, NotFitted)
    assert found.roll_rad == pytest.approx(-math.radians(turned_deg), abs=math.radians(0.05))


@pytest.mark.parametrize("turned_deg", [0.0, 0.35])
def test_horizon_shows_a_turn_through_noise_that_drowns_its_cells(turned_deg):
    """A right camera turned by 0.34 deg passed (58 mm, 0.8 deg off) with noise of 17 grey values."""
    camera = named_world("plain").scene.right
    noisy = replace(camera, photometry=replace(camera.photometry, noise_fraction=0.10))
    turned = replace(noisy, turned_rad=math.radians(turned_deg))
    world, images = seen("plain", sky_grey=130.0, left=noisy, right=turned)
    found = horizon_offset(images, world.scene.rig, world.truth)
    assert not isinstance(found, NotFitted)
    assert found.roll_rad == pytest.approx(-math.radians(turned_deg), abs=math.radians(0.1))
    assert abs(found.roll_rad + math.radians(turned_deg)) < 4.0 * found.roll_std_rad


def test_horizon_outside_of_the_image_says_nothing():
    world, images = seen("plain")
    up = Extrinsics(1.4, math.radians(24.5), 0.0)
    assert isinstance(horizon_offset(images, world.scene.rig, up), NotFitted)
    blank = np.full_like(images[0], 90)
    assert isinstance(horizon_offset((blank, blank), world.scene.rig, world.truth), NotFitted)


def test_a_turned_camera_is_refused_where_it_is_not_corrected():
    """Two lines cannot tell: without the horizon the estimate would be off by a tenth of the height."""
    _, _, plain = bare("plain")
    assert plain.accepted
    world, images, _ = bare("plain", **TURNED)
    settings = {"texture.check": 0, "alignment.correct": "none"}
    result = Calibrator(world.scene.rig, CalibratorConfig.from_mapping(settings)).add(*images)
    assert result.reason is RejectReason.IMAGES_NOT_RECTIFIED
    assert abs(result.stages["refined"].height_m - world.truth.height_m) > 0.05


TURNED = of_right_camera(named_world("plain"), turned_rad=math.radians(0.5))
LOWER = of_right_camera(named_world("plain"), lower_px=0.3)


@pytest.mark.parametrize(("camera", "pitch_px", "roll_deg"), [(TURNED, 0.0, 0.5), (LOWER, -0.3, 0.0)])
def test_rows_of_a_bare_road_are_corrected_once_its_pose_is_known(camera, pitch_px, roll_deg):
    """No texture tells them before. Content that is lower is that of a camera that is nose up.

    Half a degree, of which the horizon tells 0.04 deg, is 7 % less by the prior of turned pairs.
    """
    world, _, result = bare("plain", **camera)
    assert result.accepted
    error = result.extrinsics.as_array() - world.truth.as_array()
    assert np.all(np.abs(error) < [0.025, math.radians(0.02), math.radians(0.1)])
    assert np.all(np.abs(error) < 1.5 * result.std.as_array())
    turn = result.alignment
    assert turn.pitch_rad * world.scene.rig.fy == pytest.approx(pitch_px, abs=0.05)
    assert turn.roll_rad == pytest.approx(math.radians(roll_deg), abs=math.radians(0.04))
    for found, expected, std in zip(
        (turn.pitch_rad, turn.roll_rad),
        (pitch_px / world.scene.rig.fy, math.radians(roll_deg)),
        turn.std[:2],
        strict=True,
    ):
        assert abs(found - expected) < 3.0 * std < math.radians(0.13)


def test_a_bare_road_whose_rows_are_right_is_looked_at_once():
    """What calibrations leave is in all standard deviations: the first estimate stands."""
    _, images, result = bare("plain")
    looks = []
    of_images = FrameObservations.from_images

    def counted(*arguments, **named):
        looks.append(arguments)
        return of_images(*arguments, **named)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(FrameObservations, "from_images", counted)
        again = Calibrator(named_world("plain").scene.rig, LINES_ALONE).add(*images)
    assert len(looks) == 1 and again.extrinsics == result.extrinsics


@pytest.mark.parametrize("change", [0.02, -0.02])
def test_profile_says_what_a_slope_ahead_does_to_the_estimate(change):
    shape = RoadShape(grade_change=change, grade_begins_m=9.0, grade_length_m=20.0)
    world, images, result = bare("plain", shape=shape)
    calibrator = Calibrator(world.scene.rig, LINES_ALONE)
    pattern = calibrator.extract(*images)
    fit = refine(images, pattern, world.scene.rig, result.stages["genetic"])
    # The plane that the profile is about.
    plane = near_plane(shape, world.scene.lane_m, (NEAR_M, FAR_M))
    truth = pose_over_plane(world.scene.pose, world.scene.lane_yaw_rad, world.scene.lateral_offset_m, plane)
    profile, wide_profile = (
        measure_profile(fit.residuals, world.scene.rig, fit.extrinsics, wide=wide) for wide in (False, True)
    )
    found = np.array([fit.extrinsics.height_m, fit.extrinsics.pitch_rad]) + wide_profile.change
    before = abs(fit.extrinsics.pitch_rad - truth.pitch_rad)
    assert before > math.radians(0.1)
    # Rows whose edges are 5 px off and more are not seen: of a crest, these are the farther ones.
    assert abs(found[1] - truth.pitch_rad) < 0.5 * before
    assert abs(found[0] - truth.height_m) < 0.5 * abs(fit.extrinsics.height_m - truth.height_m)
    # Of edges that are within reach it says less, and knows how much.
    allowed = seen_slope_covariance(profile) + unseen_slope_covariance(profile)
    assert before < 2.0 * np.sqrt(allowed[1, 1])
    if result.accepted:  # what is accepted knows how uncertain it is
        assert result.std.pitch_rad > 0.5 * before


@pytest.mark.parametrize("change", [0.026, -0.026])
def test_lines_that_end_where_a_slope_may_begin_leave_it_open(change):
    """Lines that were seen to 9 m only gave a result that was 36 mm and 0.25 deg off with 0.1 mm."""
    low = Extrinsics(0.95, math.radians(-2.4), math.radians(1.0))
    shape = RoadShape(grade_change=change, grade_begins_m=8.8, grade_length_m=20.0)
    dashes = tuple(Paint(LaneLine(at_m, 0.12, 7.0, 30.0, 3.0)) for at_m in (-1.75, 1.75))
    world, _, result = bare("plain", pose=low, paints=dashes, shape=shape)
    if result.accepted:
        error = result.extrinsics.as_array() - world.scene.truth().as_array()
        assert np.all(np.abs(error) < 4.0 * result.std.as_array())
    _, _, flat = bare("plain", pose=low, paints=dashes)
    assert flat.accepted and SLOPE_UNKNOWN in flat.reservations
    _, _, high = bare("plain")
    assert high.accepted and SLOPE_UNKNOWN not in high.reservations


def test_profile_of_a_flat_road_is_flat_also_behind_a_car():
    world, images, result = bare("plain", cars=(Car(14.0, 0.0),))
    assert result.accepted
    pattern = Calibrator(world.scene.rig, LINES_ALONE).extract(*images)
    fit = refine(images, pattern, world.scene.rig, result.extrinsics)
    profile = measure_profile(fit.residuals, world.scene.rig, fit.extrinsics)
    assert np.all(np.abs(profile.change) < 5.0 * profile.std)
    assert np.all(profile.std < [0.01, math.radians(0.05)])


@pytest.mark.slow
def test_a_kerb_shows_its_face_and_paint_nothing():
    def borders(name):
        world, images, result = bare(name)
        pattern = Calibrator(world.scene.rig, LINES_ALONE).extract(*images)
        start = result.stages["genetic"]
        return measure_borders(
            images, pattern, refine(images, pattern, world.scene.rig, start), world.scene.rig
        )

    for name in ("plain", "double_line", "worn_paint", "grass", "kerb", "shadows_across"):
        assert max(abs(border.step) for border in borders(name)) < 0.05, name
    assert max(abs(border.step) for border in borders("kerb_for_line")) > 0.1


def test_a_kerb_under_a_high_camera_shows_a_narrow_face():
    """From high above and near by, it is narrower than the strip that is looked at beside a stripe."""

    def borders(name):
        world = named_world(name)
        pose = replace(world.scene.pose, height_m=2.2)
        world, images, result = bare(name, pose=pose, lateral_offset_m=-0.4)
        pattern = Calibrator(world.scene.rig, LINES_ALONE).extract(*images)
        fit = refine(images, pattern, world.scene.rig, result.stages["genetic"])
        return measure_borders(images, pattern, fit, world.scene.rig)

    faces = {
        name: [border.narrow_step for border in borders(name)]
        for name in ("plain", "worn_paint", "kerb_for_line")
    }
    assert np.nanmax(np.abs(faces["plain"])) < 0.03
    assert np.nanmax(np.abs(faces["worn_paint"])) < 0.06
    assert np.nanmax(np.abs(faces["kerb_for_line"])) > 0.15


def test_a_kerb_for_a_line_is_refused_without_any_texture():
    _, _, result = bare("kerb_for_line")
    assert result.reason is RejectReason.LINE_NOT_PAINTED
    assert "kerb" in result.message


@pytest.mark.parametrize("fall", [0.0, 0.03])
def test_a_line_between_two_others_tells_a_crown(fall):
    """A crown in the middle of the lane, with a line on it: the outer lines have a plane of their own."""
    middle = Paint(replace(named_world("plain").scene.paints[0].line, offset_m=0.1))
    shape = RoadShape(crown_at_m=0.1, fall_right=fall, fall_left=fall)
    world, images = seen("plain", paints=(*named_world("plain").scene.paints, middle), shape=shape)
    rig, config = world.scene.rig, CalibratorConfig()
    points = tuple(find_stripe_points(image, config.extraction) for image in images)
    found = find_hypotheses(points, images, rig, config)

    def width_m(pattern):
        plane = plane_from_pose(solve_plane(pattern, rig).extrinsics, rig)
        pairs = zip(pattern.left, pattern.right, strict=True)
        return np.ptp([height_and_offset_m(*pair, plane, rig)[1] for pair in pairs])

    outer = max(found.patterns, key=width_m)
    assert width_m(outer) == pytest.approx(3.5, abs=0.2)
    plane = plane_from_pose(solve_plane(outer, rig).extrinsics, rig)
    between = inner_line_height(outer, plane, found.matches, points, rig, config)
    height_m, std_m = between.value_m, between.std_m
    # Both outer lines lie as much lower as the road falls to them, the crown is rounded off.
    assert height_m == pytest.approx(1.75 * fall, abs=0.012)
    assert std_m < 0.01


def edge_steps(images, pattern, rig, start):
    fit = refine(images, pattern, rig, start)
    return measure_edge_steps(fit.residuals, fit.widths_m, rig)


def test_a_face_that_passes_for_a_part_of_a_stripe_shows_its_height():
    """As bright as the top of the kerb, it makes the stripe wider, in one camera more than in the other."""
    scene = named_world("kerb_for_line").scene
    for height_m in (0.08, 0.12):
        kerb = replace(scene.kerbs[0], height_m=height_m, face_grey=scene.kerbs[0].top_grey)
        world, images, result = bare("kerb_for_line", kerbs=(kerb,))
        pattern = Calibrator(world.scene.rig, LINES_ALONE).extract(*images)
        faces = edge_steps(images, pattern, world.scene.rig, result.stages["genetic"])
        of_paint, of_kerb = faces if scene.kerbs[0].face_m < 0.0 else faces[::-1]
        assert of_paint.surely_lower_than(0.03)
        assert of_kerb.height_m == pytest.approx(height_m, rel=0.3)
        assert of_kerb.height_m > 4.0 * of_kerb.std_m
        # The face makes the stripe wider: the fit of the stripes may differ from their left edges, too.
        assert result.reason in (RejectReason.LINE_NOT_PAINTED, RejectReason.STAGES_DISAGREE)


def test_both_edges_of_paint_lie_in_the_road_also_in_a_shadow():
    for name in ("plain", "worn_paint", "double_line", "shadows_across"):
        world, images, result = bare(name)
        pattern = Calibrator(world.scene.rig, LINES_ALONE).extract(*images)
        faces = edge_steps(images, pattern, world.scene.rig, result.stages["genetic"])
        for face in faces:
            assert abs(face.height_m) < max(0.01, 3.0 * face.std_m), name


def with_noise(scene, seed):
    """Return the images of a scene; those of other noise are made of the same pictures."""
    rng = np.random.default_rng(seed)
    return [capture(without_noise(scene, side), scene.camera(side), rng) for side in SIDES]


@cache
def without_noise(scene, side):
    return render_side(scene, side)


def in_noise_and_soft_focus(name, seed, **changes):
    """Return what the calibrator makes of a bare world that a lens out of focus and a noisy sensor see."""
    world = named_world(name)
    photometry = replace(world.scene.left.photometry, psf_sigma_px=1.1, noise_fraction=0.05)
    cameras = {side: replace(getattr(world.scene, side), photometry=photometry) for side in SIDES}
    scene = replace(world.scene, texture_amplitude=0.0, **cameras, **changes)
    return Calibrator(scene.rig, LINES_ALONE).add(*with_noise(scene, seed))


@pytest.mark.parametrize("seed", range(4))
def test_a_faint_face_is_doubted_through_noise_and_soft_focus(seed):
    """Of 3 grey levels beside a stripe of 128, with a noise of 13: all pixels of the strip have to count."""
    kerb = replace(named_world("kerb_for_line").scene.kerbs[0], face_grey=93.0)
    doubted = in_noise_and_soft_focus("kerb_for_line", seed, kerbs=(kerb,))
    assert "a kerb beside a line cannot be ruled out; the uncertainty allows for it" in doubted.notes
    assert math.degrees(doubted.std.roll_rad) > 0.4
    paint = in_noise_and_soft_focus("plain", seed)
    assert paint.accepted and not any("kerb" in note for note in paint.notes)


@pytest.mark.parametrize("side", [-1, 1])
def test_the_soft_edge_of_a_shadow_across_a_line_is_no_face(side):
    """Light that grows towards the lane does so on the paint, too; what it may hide is a doubt."""
    edge_m = side * 1.70
    shadow = Shadow("along", *sorted((edge_m, side * 20.0)), 0.5, 0.8)
    world, images, result = bare("plain", shadows=(shadow,))
    assert result.accepted
    assert "a kerb beside a line cannot be ruled out; the uncertainty allows for it" in result.notes
    pattern = Calibrator(world.scene.rig, LINES_ALONE).extract(*images)
    fit = refine(images, pattern, world.scene.rig, result.stages["genetic"])
    border = measure_borders(images, pattern, fit, world.scene.rig)[0 if side > 0 else 1]
    assert border.step == 0.0 and border.doubtful
    # A face in the shade is as dark, but the stripe above it is as bright in both halves.
    kerb = replace(named_world("kerb_for_line").scene.kerbs[0], face_grey=60.0)
    _, _, refused = bare("kerb_for_line", kerbs=(kerb,))
    assert refused.reason is RejectReason.LINE_NOT_PAINTED


@pytest.mark.slow
def test_a_few_cells_in_noise_do_not_tell_a_turn():
    """In noise of 51 grey values six of twelve cells agreed by chance on a turn by 0.16 deg."""
    camera = named_world("plain").scene.right
    noisy = replace(camera, photometry=replace(camera.photometry, noise_fraction=0.20))
    world = named_world("plain")
    scene = replace(world.scene, texture_amplitude=0.0, sky_grey=150.0, left=noisy, right=noisy)
    for seed in range(20):
        assert isinstance(horizon_offset(with_noise(scene, seed), scene.rig, world.truth), NotFitted)
    clear = replace(scene, sky_grey=200.0)
    images = render_world(replace(world, scene=clear), np.random.default_rng(0))
    assert abs(horizon_offset(images, scene.rig, world.truth).roll_rad) < math.radians(0.1)
