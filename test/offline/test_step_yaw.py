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

"""Rows of a recording have the yaw of the camera against its way since the frame before."""

import csv
import io
import math

import numpy as np
import pytest
from result_making import a_result
from travel_making import YAW, step

from stereo_selfcal.core.geometry.pose import Extrinsics
from stereo_selfcal.offline import FrameRow, as_csv
from stereo_selfcal.offline.rows import with_steps


def row(stamp_s, roll_rad=0.0):
    pose = Extrinsics(1.4, 0.0, roll_rad)
    return FrameRow.from_result(a_result(extrinsics=pose, n_frames=1, stamp_s=stamp_s), stamp_s)


def test_a_row_has_the_step_that_ends_with_its_frame():
    """Of a camera at a roll, the way to the left and up are other ones."""
    rows = [row(100.0), row(100.1), row(100.2), row(100.3, roll_rad=0.3)]
    steps = [step(0), step(1, yaw=-YAW), step(2)]
    found = with_steps(rows, steps)
    assert [each.stamp_s for each in found] == [each.stamp_s for each in rows]
    assert (found[0].yaw_rad, found[0].yaw_std_rad) == (None, None)
    assert [each.yaw_rad for each in found[1:3]] == pytest.approx([YAW, -YAW])
    assert found[3].yaw_rad == pytest.approx(steps[2].against_travel(0.3)[0])
    assert abs(found[3].yaw_rad - YAW) > 0.005
    assert [each.yaw_std_rad for each in found[1:]] == [math.sqrt(each.noise()[0]) for each in steps]


def test_a_car_that_stands_or_reverses_has_no_direction():
    found = with_steps([row(100.0), row(100.1), row(100.2)], [step(0, way_m=0.01), step(1, way_m=-1.0)])
    assert [each.yaw_rad for each in found] == [None] * 3


def test_table_has_the_yaw_or_an_empty_cell():
    first, second = csv.DictReader(io.StringIO(as_csv(with_steps([row(100.0), row(100.1)], [step(0)]))))
    assert (first["yaw_rad"], first["yaw_std_rad"]) == ("", "")
    assert float(second["yaw_rad"]) == pytest.approx(YAW)
    assert 0.0 < float(second["yaw_std_rad"]) < 0.01
    assert list(first).index("yaw_rad") < list(first).index("confirmed")
    assert np.isfinite(float(second["height_m"]))
