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

"""The drive that the demo plays: what replay makes of it, and how large it is."""

import contextlib
import io
import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from stereo_selfcal.cli.replay import main

BAGS = Path(__file__).resolve().parents[1] / "bags"
_MOST_BYTES = 12_000_000  # of all recordings that come with the package


@pytest.fixture(scope="module")
def replayed():
    """Return what replay prints of the drive, twice."""
    return [printed() for _ in range(2)]


def printed():
    with contextlib.redirect_stdout(io.StringIO()) as stream:
        assert main([str(BAGS / "drive"), "--json"]) == 0
    return stream.getvalue()


def test_the_same_numbers_each_time(replayed):
    assert replayed[0] == replayed[1]


def test_the_mount_is_found_with_its_yaw(replayed):
    content, truth = json.loads(replayed[0]), yaml.safe_load((BAGS / "drive" / "truth.yaml").read_text())
    found, std = content["extrinsics"], content["std"]
    for name in ("height_m", "pitch_rad", "roll_rad"):
        assert abs(found[name] - truth[name]) < 3.0 * std[name], name
    travel = content["travel"]
    assert travel["yaw_known"]
    assert abs(travel["yaw_rad"] - truth["yaw_rad"]) < 3.0 * travel["yaw_std_rad"]


def test_the_surface_confirms_most_frames_and_what_it_must_is_refused(replayed):
    content = json.loads(replayed[0])
    accepted = [frame for frame in content["frames"] if frame["accepted"]]
    reasons = {frame["reason"] for frame in content["frames"] if not frame["accepted"]}
    unchecked = [
        frame
        for frame in accepted
        if any(each["kind"] == "not_checked_by_texture" for each in frame["reservations"])
    ]
    assert len(accepted) > 0.6 * len(content["frames"])
    assert len(unchecked) < 0.25 * len(accepted)
    assert "lines_not_straight" in reasons and "internal_error" not in reasons
    heights = np.array([frame["height_m"] for frame in accepted])
    assert np.ptp(heights) < 0.1


def test_recordings_of_the_package_are_small():
    assert sum(path.stat().st_size for path in BAGS.rglob("*") if path.is_file()) <= _MOST_BYTES
