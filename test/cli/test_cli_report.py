"""The table and the JSON object of replay."""

import json
import math

import numpy as np
import pytest

from stereo_selfcal.cli.report import FrameRow, as_json, table_header, table_row, table_summary
from stereo_selfcal.core.extrinsics import Extrinsics
from stereo_selfcal.core.results import CalibrationResult, Rejection, RejectReason, rejected

POSE = Extrinsics(1.0 / 3.0, math.radians(-2.0), 0.1)
RESULT = CalibrationResult("fine", None, POSE, np.diag([1e-6, 1e-8, 1e-8]), -0.02, n_frames=1)
REFUSED = rejected(Rejection(RejectReason.LINES_NOT_CONVERGING, "lines", 1, 2, "px", "drive straight"))


@pytest.mark.parametrize("reason", list(RejectReason))
def test_every_reason_fits_its_column(reason):
    rows = [FrameRow(1.7e9, str(reason), None), FrameRow(1.7e9, None, POSE)]
    assert len({len(line) for line in map(table_row, rows)}) == 1
    assert len(table_row(rows[0]).rstrip("\n")) == len(table_header().splitlines()[0])
    assert f" {reason} " in table_row(rows[0])


def test_pitch_and_roll_are_shown_in_degrees_with_sign():
    assert table_row(FrameRow(0.5, None, POSE)).split() == [
        "0.500000",
        "accepted",
        "0.3333",
        "-2.000",
        "+5.730",
    ]


def test_one_frame_has_no_spread():
    text = table_summary([FrameRow(0.0, None, POSE)], RESULT)
    assert "mean" in text
    assert "over the frames" not in text


def test_refused_result_has_no_estimate():
    text = table_summary([FrameRow.from_result(REFUSED, 0.0)] * 2, REFUSED)
    assert "0 of 2 frames accepted" in text
    assert "2 x lines_not_converging" in text
    assert "fused" not in text


def test_json_keeps_every_digit():
    content = json.loads(as_json([FrameRow.from_result(RESULT, 1.7e9 + 0.1)], RESULT))
    assert content["extrinsics"] == {"height_m": 1 / 3, "pitch_rad": math.radians(-2.0), "roll_rad": 0.1}
    assert content["frames"][0]["stamp_s"] == 1.7e9 + 0.1
    assert content["std"]["height_m"] == math.sqrt(1e-6)


def test_json_never_holds_nan():
    broken = CalibrationResult("nan", None, Extrinsics(math.nan, 0, 0), np.eye(3))
    with pytest.raises(ValueError, match="JSON"):
        as_json([], broken)
