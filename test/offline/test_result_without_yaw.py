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

"""A result of the road surface alone has no yaw: whatever prints or writes a result copes with that."""

import csv
import io
import json

import numpy as np
import pytest
from result_making import EXTRINSICS, RIG, a_result

from stereo_selfcal import CalibratorConfig
from stereo_selfcal.cli.report import as_json, table_row, table_summary
from stereo_selfcal.core.drive.drive import estimate_drive
from stereo_selfcal.core.drive.fusion import fuse_frames
from stereo_selfcal.files.result_file import format_result
from stereo_selfcal.fleet.outcome import BagOutcome
from stereo_selfcal.fleet.table import csv_of
from stereo_selfcal.offline import FrameRow, Replay
from stereo_selfcal.offline.csv_table import as_csv
from stereo_selfcal.pictures.verdict import numbers


def row(stamp_s, yaw_rad=None):
    return FrameRow.from_result(
        a_result(lane_yaw_rad=yaw_rad, n_frames=1, stamp_s=stamp_s, confirmed_by_texture=True), stamp_s
    )


def replay_of(*rows):
    return Replay(tuple(rows), estimate_drive(rows, RIG, fuse_frames(rows, RIG)), RIG, CalibratorConfig())


@pytest.fixture
def replay():
    return replay_of(row(0.0), row(1.0), row(2.0))


def test_the_table_and_the_object_of_replay(replay):
    assert "None" not in table_row(replay.rows[0]) + table_summary(replay)
    content = json.loads(as_json(replay))
    assert content["accepted"] and content["lane_yaw_rad"] is None and content["extrinsics"] is not None


def test_the_table_of_frames_has_an_empty_cell():
    (cells,) = csv.DictReader(io.StringIO(as_csv([row(0.0)])))
    assert cells["lane_yaw_rad"] == "" and cells["accepted"] == "1"
    assert float(cells["height_m"]) == EXTRINSICS.height_m


def test_the_table_of_a_fleet_has_an_empty_cell(replay):
    outcome = BagOutcome.from_replay("a.bag", replay, ("left", "right"))
    (cells,) = csv.DictReader(io.StringIO(csv_of([outcome])))
    assert cells["lane_yaw_rad"] == "" and float(cells["height_m"]) == pytest.approx(EXTRINSICS.height_m)
    assert json.loads(json.dumps(outcome.to_mapping()))["lane_yaw_rad"] is None


def test_the_result_file_and_the_picture_have_no_yaw(replay):
    assert "yaw: " not in format_result(replay.estimate, RIG, "a.bag", 0).replace("R_z(0)", "")
    assert all("None" not in line for line in numbers(replay.estimate))


def test_the_yaw_of_several_frames_is_that_of_those_that_have_one():
    rows = [row(0.0), row(1.0, 0.02), row(2.0)]
    assert fuse_frames(rows, RIG).lane_yaw_rad == pytest.approx(0.02)
    assert fuse_frames([row(0.0), row(1.0)], RIG).lane_yaw_rad is None
    assert np.allclose(fuse_frames(rows, RIG).extrinsics.as_array(), EXTRINSICS.as_array())
