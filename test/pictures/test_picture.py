"""The overview picture: drawn where the geometry says, for every kind of result."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

from stereo_selfcal.core.geometry.homography import apply_homography, image_from_road
from stereo_selfcal.core.geometry.pose import Extrinsics
from stereo_selfcal.core.lanes.lane_pair import ImageLine, LanePattern
from stereo_selfcal.core.rejection import Bound, GateReading, Rejection, RejectReason
from stereo_selfcal.core.results import CalibrationResult, rejected
from stereo_selfcal.pictures import canvas as canvas_module
from stereo_selfcal.pictures import picture
from stereo_selfcal.pictures.canvas import Canvas, StripContent, verdict_strip
from stereo_selfcal.pictures.picture import (
    draw_birds_eye,
    draw_camera_view,
    draw_debug_image,
    draw_fringes,
    draw_notice,
    draw_overview,
    shown_extrinsics,
    verdict_of,
)
from stereo_selfcal.synth.scenes import PAPER_RIG, named_scene

RIG = PAPER_RIG
SCENE = named_scene("straight_road")
POSE = SCENE.scene.extrinsics
FRAME = SCENE.frame(0)
COVARIANCE = np.diag([1e-6, 1e-8, 1e-8])
REJECTION = Rejection(RejectReason.LINES_NOT_STRAIGHT, "bend", 3, Bound.MOST, 1, "px", "drive straight " * 20)


def line(u_mid, slope):
    rows = np.arange(280.0, 480.0, 2.0)
    columns = u_mid + slope * (rows - 380.0)
    return ImageLine(
        u_mid,
        slope,
        380.0,
        np.eye(2),
        rows,
        columns,
        np.ones(rows.size),
        rows.size,
        width_px=6.0,
        contrast=90.0,
    )


LINES = (line(200.0, -1.2), line(440.0, 1.2))
BLACK, NONE = np.zeros((480, 640), np.uint8), np.empty(0)
PATTERN = LanePattern(LINES, LINES, np.array([320.0, 280.0]), LINES[0].rows, np.zeros((2, 2, 100)))
ACCEPTED = CalibrationResult("good", None, POSE, COVARIANCE, 0.01, pattern=PATTERN, n_frames=3)


def has_colour(image, colour, tolerance=40):
    return int((np.abs(image.astype(int) - colour).max(axis=2) <= tolerance).sum())


@pytest.mark.parametrize(
    "result",
    [
        ACCEPTED,
        replace(ACCEPTED, pattern=None),
        rejected(REJECTION),
        rejected(REJECTION, pattern=PATTERN, stages={"genetic": POSE}),
        rejected(REJECTION, stages={"genetic": Extrinsics(0.3, math.radians(-20), math.radians(15))}),
        rejected(REJECTION, stages={"genetic": Extrinsics(4.0, math.radians(20), math.radians(-15))}),
        rejected(replace(REJECTION, remedy="Größe ≤ 1")),
    ],
    ids=lambda result: str(result.reason),
)
def test_every_result_gives_a_picture(result):
    image = draw_overview(FRAME.left, FRAME.right, RIG, result)
    assert image.dtype == np.uint8
    assert image.shape[1:] == (960, 3)
    assert image.std() > 10
    np.testing.assert_array_equal(image, draw_overview(FRAME.left, FRAME.right, RIG, result))


@pytest.mark.parametrize(
    ("left", "right"),
    [
        (np.zeros((0, 0), np.uint8), np.zeros((0, 0), np.uint8)),
        (np.zeros((40, 60), np.uint8), np.zeros((480, 640), np.uint8)),
        (np.zeros((480, 640), np.uint8), np.zeros((240, 320), np.uint8)),
        (np.full((480, 640), 255, np.uint8), np.full((480, 640), 255, np.uint8)),
        (np.zeros((480, 640), np.uint8), np.zeros((480, 640), np.uint8)),
        (np.zeros((1200, 1920), np.uint8), np.zeros((1200, 1920), np.uint8)),
    ],
)
def test_images_that_do_not_fit_the_rig(left, right):
    for result in (ACCEPTED, rejected(REJECTION)):
        assert draw_overview(left, right, RIG, result).shape[1] >= 960


def test_small_images_are_enlarged_and_large_ones_kept():
    small = replace_size(320, 240)
    assert (
        draw_overview(np.zeros((240, 320), np.uint8), np.zeros((240, 320), np.uint8), small, ACCEPTED).shape[
            1
        ]
        == 960
    )
    large = np.zeros((1080, 1920), np.uint8)
    assert draw_overview(large, large, replace_size(1920, 1080), ACCEPTED).shape[1] == 1920


def replace_size(width, height):
    scale = width / RIG.width
    return replace(
        RIG, width=width, height=height, fx=RIG.fx * scale, fy=RIG.fy * scale, cx=width / 2, cy=height / 2
    )


def test_lines_lie_on_their_pixels():
    bare = replace(PATTERN, left=tuple(replace(each, rows=NONE, columns=NONE) for each in LINES))
    view = draw_camera_view(BLACK, RIG, rejected(REJECTION, pattern=bare))
    across = np.arange(640)
    for row in (310, 380, 470):
        for each in LINES:
            ink = np.where(np.abs(across - each.column_at(row)) < 8, view[row, :, 2].astype(float), 0.0)
            assert (ink * across).sum() / ink.sum() == pytest.approx(each.column_at(row), abs=0.25)


def test_points_lie_on_their_pixels():
    view = draw_camera_view(BLACK, RIG, rejected(REJECTION, pattern=PATTERN))
    row = LINES[0].rows[0]
    for each in LINES:
        assert tuple(view[round(row), round(each.column_at(row))]) == picture.WHITE


@pytest.mark.parametrize("x_m", picture.GRID_LABELS_M)
def test_grid_lies_on_the_road(x_m):
    """At a crossing of the grid the picture is painted, beside it it is not."""
    view = draw_camera_view(BLACK, RIG, replace(ACCEPTED, pattern=None), 3.0)
    crossing = apply_homography(image_from_road(RIG, POSE, "left"), [x_m, 0.0])
    u, v = np.round((crossing + 0.5) * 3.0 - 0.5).astype(int)
    assert view[v - 1 : v + 2, u - 1 : u + 2].max() > 60
    beside = apply_homography(image_from_road(RIG, POSE, "left"), [x_m + 2.5, 0.5])
    u, v = np.round((beside + 0.5) * 3.0 - 0.5).astype(int)
    assert view[v, u].max() == 0


@pytest.fixture
def no_grid(monkeypatch):
    monkeypatch.setattr(picture, "_blend_line", lambda canvas, points: None)


def fringes(pose):
    """Share of pixels on which the two cameras differ clearly in the bird's-eye view."""
    view = draw_birds_eye(FRAME.left, FRAME.right, RIG, pose).astype(int)
    inside = (view > 0).all(axis=2)
    return (np.abs(view[:, :, 2] - view[:, :, 0])[inside] > 40).mean()


def test_birds_eye_agrees_only_for_the_right_pose(no_grid):
    best = fringes(POSE)
    assert best < 0.003
    assert fringes(replace(POSE, pitch_rad=POSE.pitch_rad + math.radians(1.0))) > 3 * best
    assert fringes(replace(POSE, height_m=POSE.height_m * 1.1)) > 3 * best
    assert fringes(replace(POSE, roll_rad=POSE.roll_rad + math.radians(3.0))) > 3 * best


def test_birds_eye_is_metric():
    """A solid line at a known place of the road lies on its row, forward is right, left is up."""
    view = draw_birds_eye(FRAME.left, FRAME.right, RIG, POSE)
    across = view.shape[0] / (2 * picture.BIRDS_EYE_HALF_WIDTH_M)
    scene = SCENE.scene
    for column in (200, 400):
        x_m = picture._near_edge_m(RIG, POSE)
        x_m += column * (picture.BIRDS_EYE_FAR_M - x_m) / view.shape[1]
        y_m = -1.75 - scene.lateral_offset_m - math.tan(scene.lane_yaw_rad) * x_m
        row = across * (picture.BIRDS_EYE_HALF_WIDTH_M - y_m)
        lower = view[220:390, column].mean(axis=1)
        assert 220 + lower.argmax() == pytest.approx(row, abs=0.08 * across)


def test_brightness_of_the_cameras_does_not_tint_the_road(no_grid):
    darker = (FRAME.right * 0.6).astype(np.uint8)
    view = draw_birds_eye(FRAME.left, darker, RIG, POSE).astype(float)
    inside = (view > 0).all(axis=2)
    assert view[:, :, 2][inside].mean() == pytest.approx(view[:, :, 0][inside].mean(), rel=0.02)


def test_verdict_has_its_colour_and_legend_is_there():
    good = draw_overview(FRAME.left, FRAME.right, RIG, ACCEPTED)
    bad = draw_overview(FRAME.left, FRAME.right, RIG, rejected(REJECTION))
    assert tuple(good[30, 3]) == picture.GREEN
    assert tuple(bad[30, 3]) == picture.VERMILION
    assert has_colour(good, picture.SKY_BLUE) > 900


def test_refused_result_shows_its_last_stage():
    stages = {"genetic": POSE, "closed_form": replace(POSE, height_m=2.0)}
    assert shown_extrinsics(rejected(REJECTION, stages=stages)).height_m == 2.0
    assert shown_extrinsics(rejected(REJECTION)) is None


def test_inputs_are_left_alone():
    left = FRAME.left.copy()
    left.setflags(write=False)
    draw_overview(left, FRAME.right, RIG, ACCEPTED)
    np.testing.assert_array_equal(left, FRAME.left)


def test_png_round_trip():
    image = draw_overview(FRAME.left, FRAME.right, RIG, ACCEPTED)
    _, content = cv2.imencode(".png", image)
    np.testing.assert_array_equal(cv2.imdecode(content, cv2.IMREAD_COLOR), image)


def test_gates_are_shown_and_the_closed_one_stands_out():
    """As a strip below the rest; only a closed gate has the colour of a refusal."""
    passed = GateReading("straight", "straight lane", 5000.0, Bound.LEAST, 1000.0, "m", True)
    closed = GateReading(
        "consistent", "consistent lines", 12.0, Bound.MOST, 10.0, "standard deviations", False
    )
    refused = rejected(REJECTION)
    without = draw_overview(FRAME.left, FRAME.right, RIG, refused)
    for gates, stands_out in (((passed,), False), ((passed, closed), True)):
        image = draw_overview(FRAME.left, FRAME.right, RIG, replace(refused, gates=gates))
        np.testing.assert_array_equal(image[: len(without)], without)
        strip = image[len(without) :]
        assert has_colour(strip, picture.GREEN) > 0
        assert (has_colour(strip, picture.VERMILION) > 0) == stands_out


def test_notes_are_shown():
    """What is not quite as it should be stands below the numbers."""
    plain, noted = (
        draw_overview(FRAME.left, FRAME.right, RIG, replace(ACCEPTED, notes=notes))
        for notes in ((), ("not checked against the asphalt",))
    )
    assert len(noted) > len(plain)


def rig_and_image(width, height):
    return replace_size(width, height), np.zeros((height, width), np.uint8)


@pytest.mark.parametrize(("width", "shown"), [(320, 960), (960, 960), (1100, 1100), (1920, 1280)])
def test_pictures_of_a_stream_are_neither_small_nor_huge(width, shown):
    rig, image = rig_and_image(width, width * 3 // 4)
    verdict = verdict_of(ACCEPTED)
    assert draw_debug_image(image, rig, ACCEPTED, verdict).shape[1] == shown
    assert draw_fringes(image, image, rig, POSE, verdict).shape[1] == shown


def test_horizon_of_a_stream_lies_where_parallel_lines_meet():
    """The blue line runs through the image of the point at infinity straight ahead of the rig."""
    verdict = StripContent("", picture.GREEN)
    picture_, header = draw_debug_image(BLACK, RIG, ACCEPTED, verdict), verdict_strip(verdict, 960)
    view = picture_[len(header) : len(header) + 720].astype(float)
    far = apply_homography(image_from_road(RIG, POSE, "left"), [1e9, 0.0])
    column, row = ((far + 0.5) * 1.5 - 0.5).round().astype(int)
    blue = np.where(np.abs(view - picture.SKY_BLUE).max(axis=2) < 60, 1.0, 0.0)[:, column]
    rows = np.flatnonzero(blue)
    assert rows.size and abs(rows.mean() - row) < 1.5


def test_stripes_are_painted_though_nothing_came_of_them():
    """Without a result or a rig, too: they tell whether paint is seen at all."""
    verdict = StripContent("not calibrated", picture.YELLOW)
    places = np.array([[100.0, 200.0], [300.0, 400.0], [-5.0, 3.0], [5000.0, 3.0]])
    view = draw_camera_view(BLACK, None, None, 2.0, stripes=places)
    painted = np.argwhere((view == canvas_module.ORANGE).all(axis=2))
    assert {tuple(p) for p in np.round(painted / 2.0 / 20) * 20} == {(200.0, 100.0), (400.0, 300.0)}
    assert draw_debug_image(BLACK, None, None, verdict, places).shape[1] == 960


def test_words_of_a_verdict_are_there_and_wrapped():
    def ink(verdict):
        strip = verdict_strip(verdict, 960)
        return (strip[:, 40:] > 150).all(axis=2).sum(), len(strip)

    none, short = ink(StripContent("", picture.GREEN)), ink(StripContent("REFUSED", picture.GREEN))
    long = ink(
        StripContent("REFUSED", picture.GREEN, ("bend of the road: 320 m, at least 1000 m needed; " * 6,))
    )
    assert none[0] == 0 < short[0] < long[0]
    assert none[1] == short[1] < long[1]
    assert draw_notice(StripContent("no picture", picture.GREEN)).shape == (403, 960, 3)


def test_verdict_of_a_refusal_names_reason_and_limit():
    verdict = verdict_of(rejected(REJECTION))
    assert verdict.title == "REFUSED: lines_not_straight"
    assert "3 px, at most 1 px allowed; drive straight" in verdict.lines[0]


def test_text_stays_inside_the_picture():
    strip = Canvas(np.zeros((60, 960, 3), np.uint8), 1.0)
    strip.text("x" * 500, 10, 40)
    assert (strip.pixels[:, -1] > 150).sum() == 0


def test_fringes_are_orange_and_blue(no_grid):
    """Not red and green, which most of those who are colour-blind cannot tell apart."""
    left, right = np.full((480, 640), 60, np.uint8), np.full((480, 640), 60, np.uint8)
    left[:, :280] = right[:, 360:] = 200  # left of the road only the left camera sees something bright
    view = draw_birds_eye(left, right, RIG, POSE)[40:, 500:].astype(int)
    blue, green, red = view[:150].reshape(-1, 3).mean(axis=0)
    assert red > green + 10 > blue + 20
    blue, green, red = view[-150:-40].reshape(-1, 3).mean(axis=0)
    assert blue > green + 10 > red + 20
