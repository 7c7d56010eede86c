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

"""The overview picture and those of a stream: composed for every kind of result."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from picture_making import ACCEPTED, FRAME, PATTERN, POSE, REJECTION, RIG, has_colour, replace_size

from stereo_selfcal.core.geometry.pose import Extrinsics
from stereo_selfcal.core.rejection import Bound, GateReading
from stereo_selfcal.core.reservations import Reservation, ReservationKind
from stereo_selfcal.core.results import rejected
from stereo_selfcal.pictures.canvas import GREEN, SKY_BLUE, VERMILION
from stereo_selfcal.pictures.overview import draw_debug_image, draw_fringes, draw_overview
from stereo_selfcal.pictures.verdict import verdict_of


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


def test_verdict_has_its_colour_and_legend_is_there():
    good = draw_overview(FRAME.left, FRAME.right, RIG, ACCEPTED)
    bad = draw_overview(FRAME.left, FRAME.right, RIG, rejected(REJECTION))
    assert tuple(good[30, 3]) == GREEN
    assert tuple(bad[30, 3]) == VERMILION
    assert has_colour(good, SKY_BLUE) > 900


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
        assert has_colour(strip, GREEN) > 0
        assert (has_colour(strip, VERMILION) > 0) == stands_out


def test_notes_are_shown():
    """What is not quite as it should be stands below the numbers."""
    plain, noted = (
        draw_overview(FRAME.left, FRAME.right, RIG, replace(ACCEPTED, reservations=reservations))
        for reservations in ((), (Reservation(ReservationKind.NOT_CHECKED_BY_TEXTURE),))
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
