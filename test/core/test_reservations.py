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

"""Reservations: what is said of a frame is still said when frames are fused, saved and read again."""

from dataclasses import replace

import numpy as np
import pytest

from stereo_selfcal import Calibrator, CalibratorConfig, ConfigError
from stereo_selfcal.core.reservations import (
    Reservation,
    ReservationKind,
    merge_reservations,
    reservations_from_mapping,
    reservations_to_mapping,
)
from stereo_selfcal.synth.scenes import named_scene

TEXTURE = Reservation(ReservationKind.NOT_CHECKED_BY_TEXTURE, "too little texture between the lines")
KERB = Reservation(ReservationKind.KERB_NOT_EXCLUDED)


def test_merged_reservations_count_frames_and_keep_the_detail_they_share():
    merged = merge_reservations([[TEXTURE], [TEXTURE, KERB], [TEXTURE], []])
    assert merged == (replace(TEXTURE, frames=3), KERB)
    assert merged[0].text(4) == (
        "not checked against the texture of the road surface: too little texture between the lines "
        "(3 of 4 frames)"
    )
    assert merged[1].text(1) == "a kerb beside a line cannot be ruled out; the uncertainty allows for it"


def test_merged_reservations_with_other_details_keep_the_kind():
    uneven = replace(TEXTURE, detail="too uneven")
    (merged,) = merge_reservations([[TEXTURE], [uneven]])
    assert merged == Reservation(ReservationKind.NOT_CHECKED_BY_TEXTURE, "", 2)


def test_a_frame_with_several_of_one_kind_counts_once():
    kind = ReservationKind.CLOSED_FORM_DIFFERS
    frame = [Reservation(kind, "height by 3 mm"), Reservation(kind, "roll by 1 deg")]
    assert merge_reservations([frame, []])[0].frames == 1
    assert reservations_to_mapping(frame) == {
        "closed_form_differs": {"frames": 1, "detail": "height by 3 mm and roll by 1 deg"}
    }


def test_a_mapping_gives_the_same_reservations_again():
    kept = (replace(TEXTURE, frames=3), KERB)
    assert reservations_from_mapping(reservations_to_mapping(kept), 4) == kept


@pytest.mark.parametrize(
    "values",
    [
        None,
        [],
        {"kerb_not_excluded": 1},
        {"kerb_not_excluded": {}},
        {"kerb_not_excluded": {"frames": 0}},
        {"kerb_not_excluded": {"frames": 5}},
        {"kerb_not_excluded": {"frames": True}},
        {"kerb_not_excluded": {"frames": 1, "detail": 2}},
        {"of_the_future": {"frames": 1}},
        {3: {"frames": 1}},
    ],
)
def test_a_mapping_of_something_else_is_refused(values):
    with pytest.raises(ConfigError):
        reservations_from_mapping(values, 4)


def calibrated(n_frames, config=None):
    scene = named_scene("straight_road")
    calibrator = Calibrator(scene.scene.rig, config)
    for index in range(n_frames):
        frame = scene.frame(index)
        result = calibrator.add(frame.left, frame.right, frame.stamp_s)
        assert result.accepted and TEXTURE.kind in {each.kind for each in result.reservations}
    return calibrator.estimate


def test_fused_frames_keep_that_texture_has_not_confirmed_them():
    alone, fused = calibrated(1), calibrated(3)
    assert alone.reservations == (TEXTURE,)
    assert fused.reservations == (replace(TEXTURE, frames=3),)
    assert fused.message.endswith(f"; {TEXTURE.sentence} (3 of 3 frames)")
    assert alone.with_reservations and fused.with_reservations


def test_texture_that_is_not_asked_is_a_reservation():
    alone = calibrated(1, CalibratorConfig.from_mapping({"texture.check": 0}))
    assert alone.notes == ("not checked against the texture of the road surface: texture.check is 0",)


def test_a_result_has_reservations_where_one_holds_for_most_of_its_frames():
    fused = calibrated(2)
    for frames, reserved in ((1, False), (2, True)):
        some = replace(fused, reservations=(replace(TEXTURE, frames=frames),))
        assert some.with_reservations == reserved
    assert not replace(fused, reservations=()).with_reservations
    assert np.isfinite(fused.covariance).all()
