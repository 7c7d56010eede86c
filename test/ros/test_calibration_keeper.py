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

"""The active calibration, and where it is saved; without a graph."""

import dataclasses
import errno
import time

import numpy as np
import pytest
from result_making import COVARIANCE, EXTRINSICS, RIG, a_result, write

from stereo_selfcal import Extrinsics
from stereo_selfcal.core.drive.alignment_watch import AlignmentState
from stereo_selfcal.core.drive.states import Event, State
from stereo_selfcal.core.drive.targets import USUAL_TARGETS
from stereo_selfcal.core.geometry.alignment import Alignment
from stereo_selfcal.core.geometry.mount import MountEvidence
from stereo_selfcal.core.rejection import Bound, Rejection, RejectReason
from stereo_selfcal.core.results import rejected
from stereo_selfcal.files import atomic_file
from stereo_selfcal.files.frames import FrameNames, InfoFrames, place_camera
from stereo_selfcal.files.node_settings import all_settings
from stereo_selfcal.files.result_file import load_result
from stereo_selfcal.ros.calibration_keeper import ActiveCalibration, CalibrationKeeper
from stereo_selfcal.ros.config import NodeConfig
from stereo_selfcal.ros.store import keep_aside, restored_calibration, save

DEFAULTS = {setting.name: setting.default for setting in all_settings()}
ACTIVE = ActiveCalibration(a_result(), RIG, 0.0)
PLACED = place_camera(a_result(), RIG, FrameNames(), InfoFrames())
OTHER_RIG = dataclasses.replace(RIG, fx=500.0)
STEP_S = 3.0
REJECTION = Rejection(RejectReason.NO_LINES_FOUND, "lines", 0, Bound.LEAST, 2, "", "drive on")


def config(**changes):
    return NodeConfig.from_values({**DEFAULTS, "output_path": "", **changes})


def frames(n, pose=EXTRINSICS, shift=(0.0, 0.0, 0.0), start_s=0.0):
    """Yield n results of a road, scattered by a few millimetres and hundredths of a degree."""
    rng = np.random.default_rng(1)
    scatter = np.array([3e-3, 1e-3, 1e-3])
    for i in range(n):
        values = pose.as_array() + shift + scatter * rng.standard_normal(3)
        yield a_result(
            extrinsics=Extrinsics.from_array(values),
            stamp_s=start_s + STEP_S * i,
            n_frames=1,
            covariance=COVARIANCE,
        )


def drive(keeper, n, rig=RIG, **options):
    """Return the events of n frames."""
    events = [keeper.watched(result, rig) for result in frames(n, **options)]
    return [event for event in events if event is not None]


@pytest.fixture
def calibrated():
    keeper = CalibrationKeeper()
    keeper.begin()
    keeper.accept(ACTIVE)
    return keeper


def test_no_calibration_is_active_at_first():
    keeper = CalibrationKeeper()
    assert (keeper.state, keeper.active, keeper.wants_another) == (State.UNCALIBRATED, None, True)
    assert keeper.reason == "call ~/calibrate on a straight road with painted lines"


def test_a_call_activates_its_result():
    keeper = CalibrationKeeper()
    keeper.begin()
    assert keeper.state is State.CALIBRATING
    assert keeper.reason == "a call of ~/calibrate is running"
    keeper.accept(ACTIVE)
    keeper.fail()  # as the end of every call; means nothing now
    assert (keeper.state, keeper.active, keeper.wants_another) == (State.CALIBRATED, ACTIVE, False)
    assert keeper.reason == "accepted when ~/calibrate was called"
    keeper.saved("saved to /x", failed=True)
    assert (keeper.active.saved, keeper.active.save_failed) == ("saved to /x", True)


def test_a_call_that_finds_nothing_leaves_what_was(calibrated):
    calibrated.begin()
    calibrated.fail()
    assert (calibrated.state, calibrated.active) == (State.CALIBRATED, ACTIVE)


def test_the_last_good_calibration_stays_active_while_it_is_suspect(calibrated):
    assert drive(calibrated, 60) == []
    events = drive(calibrated, 60, shift=(0.1, 0.0, 0.0), start_s=200.0)
    assert events == [Event.DOUBTED, Event.REFUTED]
    assert (calibrated.state, calibrated.active) == (State.INVALID, ACTIVE)
    assert calibrated.reason.startswith("height over the road has changed by +")
    assert calibrated.explain().startswith("drift, proven by the frames since the alarm: height")
    assert calibrated.wants_another
    calibrated.begin()
    calibrated.fail()
    assert calibrated.state is State.INVALID


def test_a_drift_that_ends_makes_it_calibrated_again(calibrated):
    drive(calibrated, 100)
    drive(calibrated, 30, shift=(0.1, 0.0, 0.0), start_s=300.0)
    assert calibrated.state is State.INVALID
    assert drive(calibrated, 100, start_s=400.0)[-1] is Event.CONFIRMED
    assert calibrated.state is State.CALIBRATED
    assert calibrated.reason == "the road shows the pose of before the drift again"


def test_the_watch_proposes_a_better_one(calibrated):
    drive(calibrated, 60)
    assert calibrated.proposal(RIG) is None
    drive(calibrated, 60, shift=(0.1, 0.0, 0.0), start_s=200.0)
    better = ActiveCalibration(calibrated.proposal(RIG), RIG, 0.0)
    assert better.result.extrinsics.height_m == pytest.approx(EXTRINSICS.height_m + 0.1, abs=5e-3)
    calibrated.accept(better, by_watch=True)
    assert (calibrated.state, calibrated.active) == (State.CALIBRATED, better)
    assert calibrated.reason == "proven better by the watch"
    assert drive(calibrated, 200, shift=(0.1, 0.0, 0.0), start_s=400.0) == []


def test_withdrawn_is_uncalibrated_and_says_why(calibrated):
    calibrated.withdraw("other cameras")
    assert (calibrated.state, calibrated.active) == (State.UNCALIBRATED, None)
    assert calibrated.reason == "other cameras"
    assert drive(calibrated, 60) == []


def test_a_reset_leaves_nothing_and_says_so(calibrated):
    drive(calibrated, 60)
    assert calibrated.reset() is ACTIVE
    assert (calibrated.state, calibrated.active, calibrated.resets) == (State.UNCALIBRATED, None, 1)
    assert calibrated.reason.startswith("taken back by ~/reset; call ~/calibrate on a straight road")
    assert calibrated.explain().startswith("nothing to compare with; 0 frames")
    assert calibrated.reset() is None
    assert calibrated.resets == 2


def test_a_reset_ends_the_state_of_a_call_whatever_it_finds(calibrated):
    calibrated.begin()
    calibrated.reset()
    assert calibrated.state is State.UNCALIBRATED
    calibrated.fail()  # its end
    assert calibrated.state is State.UNCALIBRATED


def with_std(height_m, mount=None):
    return a_result(covariance=np.diag([height_m**2, 1e-10, 1e-10]), mount=mount)


MOUNT = MountEvidence(9.0, 0, 0, False, EXTRINSICS, np.ones(3), np.ones(3))


@pytest.mark.parametrize(
    ("old", "new", "better", "why"),
    [
        (with_std(0.012), with_std(0.010), True, "the one before is less certain (std 12 mm, "),
        (with_std(0.012), with_std(0.012), False, "the active one is no less certain (std 12 mm, "),
        (with_std(0.012), with_std(0.014), False, "the active one is no less certain (std 12 mm, "),
        (with_std(0.001), with_std(0.014, MOUNT), True, "the file of the one before does not say"),
    ],
)
def test_what_misses_its_targets_takes_over_from_what_is_less_certain(old, new, better, why):
    keeper = CalibrationKeeper()
    keeper.load(ActiveCalibration(old, RIG, 0.0))
    keeper.begin()
    found, reason = keeper.compare(new, USUAL_TARGETS, same_cameras=True)
    assert (found, reason[: len(why)]) == (better, why)


def test_what_misses_its_targets_takes_over_from_nothing_others_and_what_is_invalid(calibrated):
    worse = with_std(0.1)
    nothing = CalibrationKeeper()
    nothing.begin()
    assert nothing.compare(worse, USUAL_TARGETS, same_cameras=False) == (True, "there was none")
    others = calibrated.compare(worse, USUAL_TARGETS, same_cameras=False)
    assert others == (True, "the one before is of other cameras")
    assert not calibrated.compare(worse, USUAL_TARGETS, same_cameras=True)[0]
    drive(calibrated, 60)
    drive(calibrated, 60, shift=(0.1, 0.0, 0.0), start_s=200.0)
    assert calibrated.state is State.INVALID
    calibrated.begin()
    invalid = calibrated.compare(worse, USUAL_TARGETS, same_cameras=True)
    assert invalid == (True, "the one before is invalid")


def test_frames_of_two_rigs_make_no_mean():
    keeper = CalibrationKeeper()
    drive(keeper, 15)
    drive(keeper, 15, rig=OTHER_RIG, start_s=45.0)
    assert keeper.proposal(OTHER_RIG) is None
    drive(keeper, 15, rig=OTHER_RIG, start_s=90.0)
    assert keeper.proposal(OTHER_RIG) is not None


def test_restored_has_the_age_of_its_stamp(tmp_path):
    path = tmp_path / "out.yaml"
    write(path)
    saved = load_result(path)
    restored = restored_calibration(saved, path, saved.stamp_s + 500.0)
    assert time.monotonic() - restored.since_s == pytest.approx(500.0, abs=60.0)
    assert restored.saved == f"restored from {path}"
    assert (restored.rig, restored.result.extrinsics) == (RIG, EXTRINSICS)
    for now_s in (saved.stamp_s - 5.0, saved.stamp_s + 1e10):  # of another clock
        assert -1.0 < time.monotonic() - restored_calibration(saved, path, now_s).since_s < 60.0


def test_saved_with_its_exports(tmp_path):
    path = tmp_path / "out.yaml"
    text, failed = save(ACTIVE, config(output_path=str(path), exports="urdf,autoware"), "topics", PLACED)
    assert (text, failed) == (f"saved to {path} and exported as urdf, autoware", False)
    assert load_result(path).extrinsics == EXTRINSICS
    assert sorted(p.name for p in tmp_path.iterdir()) == ["out.autoware.yaml", "out.urdf.xml", "out.yaml"]


def test_without_a_path_nothing_is_saved():
    assert save(ACTIVE, config(), "topics", PLACED) == ("not saved, as output_path is empty", False)


def test_exports_that_fail_leave_the_result_saved(tmp_path):
    path = tmp_path / "out.yaml"
    (tmp_path / "out.urdf.xml").mkdir()
    text, failed = save(ACTIVE, config(output_path=str(path), exports="urdf"), "topics", PLACED)
    assert failed
    assert text.startswith(f"saved to {path}, but not exported: ")
    assert load_result(path).extrinsics == EXTRINSICS


@pytest.mark.parametrize(
    ("code", "words"),
    [(errno.ENOSPC, "no space left on device; make room"), (errno.EROFS, "read-only file system; choose")],
)
def test_full_disk_and_read_only_folder_are_named(tmp_path, monkeypatch, code, words):
    path = tmp_path / "out.yaml"
    write(path)

    def fails(*_):
        raise OSError(code, atomic_file.os.strerror(code))

    with monkeypatch.context() as patch:
        patch.setattr(atomic_file.os, "write", fails)
        better = dataclasses.replace(ACTIVE, result=a_result(n_frames=9))
        text, failed = save(better, config(output_path=str(path)), "topics", PLACED)
    assert failed
    assert text.startswith("in effect, but not saved: ")
    assert words in text
    assert load_result(path).n_frames == 3  # the old one
    assert [p.name for p in tmp_path.iterdir()] == ["out.yaml"]


def test_a_strange_file_is_kept_aside_before_saving(tmp_path):
    path = tmp_path / "out.yaml"
    path.write_text("my diary")
    text = f"saved to {path}; what was there, not of these images, is kept as {path}.rejected"
    assert save(ACTIVE, config(output_path=str(path)), "topics", PLACED) == (text, False)
    assert (tmp_path / "out.yaml.rejected").read_text() == "my diary"


TOPICS = ("/left/image_rect", "/right/image_rect")


def test_files_that_the_next_start_would_restore_are_kept_aside(tmp_path):
    path, other = tmp_path / "out.yaml", tmp_path / "other.yaml"
    write(path, source=" ".join(TOPICS))
    write(other, source="/rear/left/image_rect /rear/right/image_rect")
    paths = [path, other, tmp_path / "missing.yaml", path]
    assert keep_aside(paths, TOPICS, old_default=False) == (f"its file is kept as {path}.rejected", False)
    assert not path.exists() and load_result(tmp_path / "out.yaml.rejected").extrinsics == EXTRINSICS
    assert other.exists(), "it is not restored, as it is of other images"
    assert keep_aside(paths, TOPICS, old_default=False) == ("", False)


def test_the_old_default_file_is_kept_aside_where_it_would_be_restored(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    old = tmp_path / ".ros" / "stereo_selfcal.yaml"
    old.parent.mkdir()
    write(old, source=" ".join(TOPICS))
    assert keep_aside([], TOPICS, old_default=False) == ("", False)
    assert keep_aside([], TOPICS, old_default=True) == (f"its file is kept as {old}.rejected", False)


def test_a_file_that_cannot_be_kept_aside_is_told(tmp_path, monkeypatch):
    path = tmp_path / "out.yaml"
    write(path, source=" ".join(TOPICS))

    def fails(*_):
        raise OSError(errno.EROFS, "Read-only file system")

    monkeypatch.setattr(atomic_file.os, "open", fails)
    text, failed = keep_aside([path], TOPICS, old_default=False)
    assert failed
    assert text.startswith(f"the next start will restore it: {path} cannot be kept aside: read-only file")


def aligned(yaw_rad):
    return Alignment(0.0, 0.0, yaw_rad, np.diag([1e-10, 1e-9, 1e-9]))


def test_alignment_is_watched_in_refused_frames_too_and_begins_anew_with_a_calibration():
    keeper = CalibrationKeeper()
    keeper.begin()
    keeper.accept(ActiveCalibration(a_result(alignment=aligned(0.0)), RIG, 0.0))
    assert keeper.alignment.state is AlignmentState.NOT_WATCHED
    for index in range(60):
        frame = rejected(REJECTION, STEP_S * index)
        keeper.watched(dataclasses.replace(frame, alignment=aligned(0.0 if index < 30 else 2e-3)), RIG)
        if index == 29:
            assert keeper.alignment.state is AlignmentState.STEADY
    assert keeper.alignment.state is AlignmentState.DRIFTED
    assert keeper.alignment.message.startswith("the right camera has turned in yaw by +0.")
    assert keeper.state is State.CALIBRATED, "the pose is watched by itself"
    keeper.accept(ActiveCalibration(a_result(alignment=aligned(2e-3)), RIG, 0.0))
    assert keeper.alignment.frames == 0 and keeper.alignment.message == ""
    keeper.watched(a_result(alignment=aligned(2e-3)), RIG)
    assert keeper.alignment.frames == 1
    keeper.withdraw("other cameras")
    assert keeper.alignment.frames == 0


def test_what_the_watch_proposes_has_the_alignment_of_now(calibrated):
    for frame in frames(80, shift=(0.1, 0.0, 0.0)):
        calibrated.watched(dataclasses.replace(frame, alignment=aligned(1e-3)), RIG)
    better = calibrated.proposal(RIG)
    assert better is not None
    assert better.alignment.yaw_rad == pytest.approx(1e-3)
    assert better.alignment.std[2] < 1e-4
