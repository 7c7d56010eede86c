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

"""The watch: alarms, their withdrawal, proof and proposals, over frames of a simulated drive."""

import dataclasses
import math

import numpy as np
import pytest

from stereo_selfcal import CalibrationResult, Extrinsics, StereoRig
from stereo_selfcal.core.drive import watch as watch_module
from stereo_selfcal.core.drive.drift import LEAST_FRAMES, LEAST_SPAN_S
from stereo_selfcal.core.drive.fusion import fuse_frames
from stereo_selfcal.core.drive.watch import PROPOSAL_FRAMES, PROPOSAL_SPAN_S, Watch
from stereo_selfcal.core.geometry.uncertainty import UncertaintyTerm
from stereo_selfcal.core.rejection import Bound, Rejection, RejectReason
from stereo_selfcal.core.results import rejected
from stereo_selfcal.core.tolerances import AGREEMENT

RIG = StereoRig(640, 480, 516.6, 516.6, 319.5, 239.5, 0.1481)
TRUTH = np.array([1.4, 0.05, 0.01])
NOISE = np.array([2e-3, math.radians(0.01), math.radians(0.03)])
MOTION = np.array([4e-3, math.radians(0.08), math.radians(0.1)])
BUMPS = {
    "height": np.array([0.03, 0.0, 0.0]),
    "pitch": np.array([0.0, math.radians(0.3), 0.0]),
    "roll": np.array([0.0, 0.0, math.radians(-0.5)]),
}
STEP_S = 3.0
REFUSED = rejected(Rejection(RejectReason.NO_LINES_FOUND, "rows", 3, Bound.LEAST, 40, "px", "clean the lens"))


def frame(pose, stamp_s):
    covariance = np.diag(NOISE**2)
    return CalibrationResult(
        "", extrinsics=Extrinsics.from_array(pose), covariance=covariance, stamp_s=stamp_s, n_frames=1
    )


class Drive:
    """Frames one after the other; what moves the camera is white from frame to frame."""

    def __init__(self, seed=0, outliers=0.0):
        self.rng = np.random.default_rng(seed)
        self.pose = TRUTH.copy()
        self.outliers = outliers
        self.stamp_s = 1000.0

    def next(self):
        self.stamp_s += STEP_S
        pose = self.pose + self.rng.standard_normal(3) * np.hypot(MOTION, NOISE)
        if self.rng.random() < self.outliers:
            pose = pose + self.rng.standard_normal(3) * (0.1, 0.05, 0.05)
        return frame(pose, self.stamp_s)

    def into(self, watch, n, until=None):
        """Add n frames; return how many it took until the verdict was so, None if it never was."""
        for i in range(n):
            if until is not None and until(watch.add(self.next())):
                return i + 1
            if until is None:
                watch.add(self.next())
        return None


def doubted(verdict):
    return verdict.doubted


def proven(verdict):
    return verdict.proven


@pytest.fixture
def watch():
    watch = Watch()
    watch.start(frame(TRUTH, 0.0))
    return watch


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_an_hour_without_change_raises_no_alarm(watch, seed):
    assert Drive(seed, outliers=0.1).into(watch, int(3600 / STEP_S), until=doubted) is None
    assert watch.explain().startswith("no drift in ")


@pytest.mark.parametrize("name", BUMPS)
def test_a_bump_is_doubted_proven_and_named(watch, name):
    drive = Drive(outliers=0.1)
    drive.into(watch, 100)
    drive.pose = TRUTH + BUMPS[name]
    assert drive.into(watch, 40, until=doubted)
    assert not watch.verdict.proven
    assert watch.verdict.message.startswith(f"{name} over the road has changed by ")
    assert drive.into(watch, 40, until=proven)


def test_unknowns_of_the_rig_hide_no_drift():
    """They are the same before and after it: the verdict is that without them, to the last frame."""
    part = UncertaintyTerm("vergence", np.diag((30.0 * NOISE) ** 2))

    def seen(result):
        terms = (UncertaintyTerm("noise", result.covariance), part)
        return dataclasses.replace(result, covariance=result.covariance + part.covariance, uncertainty=terms)

    plain, whole = Watch(), Watch()
    plain.start(frame(TRUTH, 0.0))
    whole.start(seen(frame(TRUTH, 0.0)))
    drive = Drive()
    for index in range(140):
        if index == 100:
            drive.pose = TRUTH + BUMPS["pitch"]
        now = drive.next()
        assert whole.add(seen(now)) == plain.add(now)
    assert whole.verdict.proven
    # The calibration that takes the old one's place has them again, once.
    for _ in range(40):
        whole.add(seen(drive.next()))
    proposal = whole.proposal(RIG)
    (of_rig,) = (term for term in proposal.uncertainty if term.name == "vergence")
    np.testing.assert_allclose(of_rig.covariance, part.covariance, rtol=1e-9)


def test_a_calibration_that_was_never_right_is_doubted():
    watch = Watch()
    watch.start(frame(TRUTH + np.array([0.1, 0.0, 0.0]), 0.0))
    assert Drive().into(watch, 60, until=doubted)


def test_a_mean_over_minutes_is_trusted_more_than_a_moment():
    """A fifth of a degree off: a braking, for a single frame; too much for a mean."""
    shift = np.array([0.0, math.radians(0.2), 0.0])
    moment = frame(TRUTH + shift, 0.0)
    mean = fuse_frames([frame(TRUTH + shift, STEP_S * i) for i in range(40)], RIG)
    of_one = fuse_frames([moment], RIG)
    for reference, is_doubted in ((moment, False), (of_one, False), (mean, True)):
        watch = Watch()
        watch.start(reference)
        assert (Drive().into(watch, 100, until=doubted) is not None) == is_doubted


@pytest.mark.slow
def test_a_drift_that_ends_is_taken_back(watch):
    drive = Drive()
    drive.into(watch, 200)
    drive.pose = TRUTH + BUMPS["pitch"]
    assert drive.into(watch, 40, until=proven)
    drive.pose = TRUTH.copy()
    back = drive.into(watch, 200, until=lambda verdict: not verdict.doubted)
    assert back is not None
    assert back > 1  # not by one frame
    assert drive.into(watch, 400, until=doubted) is None
    drive.pose = TRUTH + BUMPS["pitch"]  # and the watch goes on
    assert drive.into(watch, 40, until=doubted)


def test_a_drift_that_stays_is_never_taken_back(watch):
    drive = Drive(outliers=0.1)
    drive.into(watch, 100)
    drive.pose = TRUTH + BUMPS["pitch"]
    assert drive.into(watch, 40, until=doubted)
    assert drive.into(watch, 1000, until=lambda verdict: not verdict.doubted) is None


def raised(watch):
    """Raise an alarm of pitch; return the drift that was found and its standard deviation in a frame."""
    drive = Drive()
    drive.into(watch, 200)
    drive.pose = TRUTH + BUMPS["pitch"]
    assert drive.into(watch, 40, until=doubted)
    change = watch._alarm.change
    assert change.axis == 1
    return drive, change


def test_less_than_half_of_a_drift_that_was_found_too_large_is_still_one(watch):
    """0.45 of it is nearer to 0.7 of it than to none."""
    drive, change = raised(watch)
    for _ in range(60):
        drive.stamp_s += STEP_S
        assert watch.add(frame(change.before + 0.45 * change.drift, drive.stamp_s)).doubted


def test_a_move_to_the_other_side_is_no_proof_of_a_drift(watch):
    drive, change = raised(watch)
    verdicts = []
    while watch.verdict.doubted:
        drive.stamp_s += STEP_S
        verdicts.append(watch.add(frame(change.before - 3.0 * change.drift, drive.stamp_s)))
        assert len(verdicts) < 40
    assert not any(verdict.proven for verdict in verdicts)


@pytest.mark.parametrize("outliers", [0.0, 0.1])
def test_size_of_a_drift_is_judged_by_its_bounds(watch, outliers):
    drive = Drive(outliers=outliers)
    drive.into(watch, 300)
    drive.pose = TRUTH + BUMPS["pitch"]
    drive.into(watch, 300)
    ratio = BUMPS["pitch"][1] / AGREEMENT[1]
    assert watch.verdict.least < ratio < watch.verdict.most
    assert watch.verdict.most - watch.verdict.least < 0.5


def test_fewer_frames_or_less_road_than_needed_are_never_compared():
    for n, step_s in ((LEAST_FRAMES - 1, LEAST_SPAN_S), (50, LEAST_SPAN_S / 51)):
        watch = Watch()
        watch.start(frame(TRUTH, 0.0))
        for i in range(n):
            watch.add(frame(TRUTH + 1.0, i * step_s))
        assert not watch.verdict.doubted
        assert watch.progress < 1.0


def test_pauses_are_no_road(watch):
    """Five frames with hours between them are fifty seconds of road at most."""
    for i in range(LEAST_FRAMES):
        watch.add(frame(TRUTH, i * 3600.0))
    assert watch.progress == 1.0
    assert watch._series.times_s[-1] == pytest.approx(10.0 * (LEAST_FRAMES - 1))


def test_stamps_that_jump_back_do_no_harm(watch):
    drive = Drive()
    drive.into(watch, 30)
    drive.stamp_s = 0.0
    drive.into(watch, 30)
    assert np.all(np.diff(watch._series.times_s) > 0)
    assert not watch.verdict.doubted


def test_refused_frames_change_nothing(watch):
    drive = Drive()
    drive.into(watch, 20)
    before = watch.explain()
    assert watch.add(REFUSED) is watch.verdict
    assert watch.explain() == before


def test_a_few_wrong_frames_in_a_row_are_no_drift(watch):
    drive = Drive()
    drive.into(watch, 50)
    drive.pose = TRUTH + np.array([0.07, 0.0, 0.0])  # a kerb beside the lane for 15 s
    assert drive.into(watch, 5, until=doubted) is None
    drive.pose = TRUTH.copy()
    assert drive.into(watch, 200, until=doubted) is None


@pytest.mark.slow
def test_old_frames_are_kept_in_the_reference_only(watch, monkeypatch):
    monkeypatch.setattr(watch_module, "_MOST_FRAMES", 60)
    monkeypatch.setattr(watch_module, "_DROPPED", 20)
    drive = Drive(outliers=0.1)
    assert drive.into(watch, 600, until=doubted) is None
    assert watch.n_frames <= 60
    drive.pose = TRUTH + BUMPS["height"]
    assert drive.into(watch, 40, until=doubted)


def test_frames_since_an_alarm_are_bounded_too(watch, monkeypatch):
    drive = Drive(outliers=0.1)
    drive.into(watch, 100)
    drive.pose = TRUTH + BUMPS["pitch"]
    assert drive.into(watch, 60, until=proven)
    monkeypatch.setattr(watch_module, "_MOST_FRAMES", 60)
    monkeypatch.setattr(watch_module, "_DROPPED", 20)
    assert drive.into(watch, 300, until=lambda verdict: not verdict.proven) is None
    assert watch.n_frames <= 60
    assert watch.proposal(RIG) is not None
    drive.pose = TRUTH.copy()
    assert drive.into(watch, 300, until=lambda verdict: not verdict.doubted)


def test_the_quantity_that_is_beyond_its_limit_is_named(watch):
    drive = Drive()
    drive.into(watch, 100)
    drive.pose = TRUTH + np.array([0.02, math.radians(0.6), 0.0])
    drive.into(watch, 100)
    assert watch.verdict.least > 1.0
    assert watch.verdict.message.startswith("pitch over the road has changed by +0.")


def test_proposal_only_once_the_drift_is_proven(watch):
    drive = Drive(outliers=0.1)
    drive.into(watch, 100)
    assert watch.proposal(RIG) is None
    drive.pose = TRUTH + BUMPS["roll"]
    assert drive.into(watch, 60, until=doubted)
    assert watch.proposal(RIG) is None
    assert drive.into(watch, 60, until=proven)
    drive.into(watch, 20)
    better = watch.proposal(RIG)
    error = (better.extrinsics.as_array() - drive.pose) / better.std.as_array()
    assert np.all(np.abs(error) < 4.0)
    assert np.all(better.std.as_array() > MOTION / 10)  # of 60 frames at most: not that of noise alone
    assert better.message.startswith(f"calibrated from {better.n_frames} frames")
    assert better.stamp_s == drive.stamp_s


def test_without_a_calibration_a_mean_is_gathered():
    watch = Watch()
    drive = Drive()
    n = max(PROPOSAL_FRAMES, int(PROPOSAL_SPAN_S / STEP_S) + 1)
    drive.into(watch, n - 1)
    assert watch.proposal(RIG) is None
    assert watch.progress < 1.0
    drive.into(watch, 1)
    assert watch.progress == 1.0
    better = watch.proposal(RIG)
    assert np.all(np.abs(better.extrinsics.as_array() - TRUTH) < 5 * better.std.as_array())
    assert not watch.verdict.doubted


def test_a_mean_is_of_one_pose_only():
    """A camera that is moved while a mean is gathered: what is before that does not count."""
    watch = Watch()
    drive = Drive()
    drive.into(watch, 40)
    drive.pose = TRUTH + np.array([0.0, math.radians(3.0), 0.0])
    drive.into(watch, 40)
    better = watch.proposal(RIG)
    assert better.n_frames <= 42
    assert abs(better.extrinsics.pitch_rad - drive.pose[1]) < math.radians(0.1)


def test_same_frames_same_verdict():
    verdicts = []
    for _ in range(2):
        watch = Watch()
        watch.start(frame(TRUTH, 0.0))
        drive = Drive(seed=5)
        drive.into(watch, 100)
        drive.pose = TRUTH + BUMPS["height"]
        drive.into(watch, 60)
        verdicts.append((watch.verdict, watch.proposal(RIG).extrinsics))
    assert verdicts[0] == verdicts[1]


def test_it_keeps_no_images(watch):
    watch.add(dataclasses.replace(Drive().next(), pattern=object(), genetic=object(), unused_lines=(1,)))
    kept = watch._results[-1]
    assert (kept.pattern, kept.genetic, kept.unused_lines) == (None, None, ())
