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

"""A CameraInfo that changes in the middle of a recording: the answer is from the frames since then."""

import json

import numpy as np
import pytest
from camera_making import cameras, make_road_bag
from fake_calibrator import refusal

from stereo_selfcal import Calibrator, CalibratorConfig, StereoRig
from stereo_selfcal.bags import Selection
from stereo_selfcal.cli.replay import main
from stereo_selfcal.cli.report import as_dict, table_summary
from stereo_selfcal.core.camera.rectifier import StereoRectifier
from stereo_selfcal.core.errors import RigError
from stereo_selfcal.core.geometry.pose import Extrinsics
from stereo_selfcal.core.results import CalibrationResult
from stereo_selfcal.fleet.outcome import BagOutcome
from stereo_selfcal.fleet.work import FleetSettings, calibrate_stretch, join
from stereo_selfcal.offline import calibrate_recording, open_source, pool
from stereo_selfcal.offline.frame import FrameHead
from stereo_selfcal.offline.run import assemble_replay

WIDE, LONG = cameras(480.0), cameras(516.6)
COVARIANCE = np.diag([1e-6, 1e-8, 1e-8])


def result(height_m, stamp_s):
    pose = Extrinsics(height_m, 0.05, 0.01)
    return CalibrationResult("good", None, pose, COVARIANCE, 0.0, stamp_s=stamp_s)


def frames(*seen_by):
    """Return frames with the height of their index, each with its cameras; None: unusable ones."""
    for index, seen in enumerate(seen_by):
        stamp_s = 100.0 + index
        yield FrameHead(stamp_s, index, "", seen), result(1.0 + 0.001 * index, stamp_s)


def assembled(*seen_by):
    return assemble_replay(frames(*seen_by), Calibrator(WIDE.rig))


def test_the_answer_is_from_the_frames_since_the_change():
    replay = assembled(WIDE, WIDE, LONG, LONG, LONG)
    assert replay.estimate.n_frames == 3
    assert replay.estimate.extrinsics.height_m == pytest.approx(1.003)
    assert replay.rig == LONG.rig
    assert replay.estimate.message.endswith("; since CameraInfo changed at 102.0 s")
    assert [row.recorded_ns for row in replay.rows_of_rig] == [2, 3, 4] and len(replay.rows) == 5
    assert "CameraInfo changed at 102.0 s (fx 480 -> 516.6" in replay.remarks[0]


def test_every_form_of_the_answer_carries_it():
    replay = assembled(WIDE, LONG)
    content = as_dict(replay)
    assert content["camera_changes"] == [
        {
            "at_s": 101.0,
            "message": replay.remarks[0],
            "before": WIDE.rig.to_mapping(),
            "after": LONG.rig.to_mapping(),
        }
    ]
    assert replay.remarks[0] in content["remarks"] and replay.remarks[0] in table_summary(replay)
    assert "since CameraInfo changed" in BagOutcome.from_replay("a", replay, ("l", "r")).message
    assert "camera_changes" not in as_dict(assembled(WIDE, WIDE))


def test_frames_without_usable_cameras_are_no_change():
    replay = assembled(WIDE, None, WIDE)
    assert replay.camera_changes == () and replay.estimate.n_frames == 3


def test_the_first_frames_may_be_of_another_rig_than_expected():
    """As where binning is not applied because of the size of the images."""
    replay = assembled(LONG, LONG)
    assert replay.camera_changes == () and replay.rig == LONG.rig and replay.remarks == ()


def test_a_change_before_frames_that_are_all_refused_leaves_no_answer():
    (before, after) = frames(WIDE, LONG)
    replay = assemble_replay([before, (after[0], refusal(101.0))], Calibrator(WIDE.rig))
    assert not replay.estimate.accepted
    assert replay.estimate.message.endswith("; since CameraInfo changed at 101.0 s")
    assert replay.shown is replay.rows[1]


def test_alternating_rigs_give_no_answer():
    with pytest.raises(RigError, match="alternates between fx 480"):
        assembled(WIDE, LONG, WIDE, LONG, WIDE)


def test_one_rig_for_all_stays():
    rig = StereoRig(640, 480, 500.0, 500.0, 319.5, 239.5, 0.2)
    assert assembled(StereoRectifier(rig), StereoRectifier(rig)).rig == rig


@pytest.mark.slow
def test_a_stale_first_camera_info_costs_its_frame_alone(tmp_path, capsys):
    """With it, the pitch would be half a degree off."""
    path = make_road_bag(tmp_path / "bag", 4, lambda index: None if index else 480.0)
    outputs = ["--report", str(tmp_path / "report.html"), "--output", str(tmp_path / "o.yaml")]
    assert main([str(path), "--json", "--jobs", "1", *outputs]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content["extrinsics"]["height_m"] == pytest.approx(1.4, abs=0.005)
    assert content["extrinsics"]["pitch_rad"] == pytest.approx(np.radians(3.0), abs=1e-3)
    assert content["message"].startswith("calibrated from 3 frames")
    assert [change["before"]["fx"] for change in content["camera_changes"]] == [480.0]
    assert "CameraInfo changed at 100.1 s (fx 480 -&gt; 516.6" in (tmp_path / "report.html").read_text()
    assert "fx: 516.6" in (tmp_path / "o.yaml").read_text()


@pytest.mark.slow
def test_workers_and_stretches_see_each_frame_with_its_own_rig(tmp_path, monkeypatch):
    """Workers from the second frame on, stretches that end before, in and after the change."""
    monkeypatch.setattr(pool, "_ALONE_FRAMES", 1)
    config = CalibratorConfig.from_mapping({"texture": {"check": 0}})  # in a quarter of the time
    path = make_road_bag(tmp_path / "bag", 6, lambda index: None if index > 2 else 480.0)
    with open_source([path]) as source:
        one = calibrate_recording(source, config, jobs=1)
    with open_source([path]) as source:
        assert as_dict(calibrate_recording(source, config, jobs=2)) == as_dict(one)
    assert one.estimate.n_frames == 3
    settings = FleetSettings(config)
    parts = [
        calibrate_stretch(str(path), settings, Selection(start_s, end_s))
        for start_s, end_s in ((0.0, 0.15), (0.15, 0.45), (0.45, None))
    ]
    assert as_dict(join(parts, settings).replay) == as_dict(one)


def test_two_publishers_on_one_topic_are_refused_on_the_command_line(tmp_path, capsys):
    path = make_road_bag(tmp_path / "bag", 4, lambda index: None if index % 2 else 480.0)
    assert main([str(path), "--json", "--jobs", "1"]) == 2
    assert "CameraInfo alternates between fx of the left camera 480" in capsys.readouterr().err
