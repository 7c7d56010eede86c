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

"""The watch over the alignment, on simulated drives: errors over standard deviations, alarms, their end."""

import math

import numpy as np
import pytest

from stereo_selfcal.core.alignment_verdict import GOOD_LIMITS_RAD
from stereo_selfcal.core.drive.alignment_watch import AlignmentState, AlignmentWatch
from stereo_selfcal.core.evidence.told_alignment import UNTOLD_VARIANCES
from stereo_selfcal.core.geometry.alignment import Alignment

# Of single frames: pitch, roll, yaw.
STDS = np.radians([0.005, 0.02, 0.04])
COVARIANCE = np.diag(STDS**2)
PERIOD_S, CORRELATION_S = 2.0, 10.0
WALK_PER_S = np.radians([0.01, 0.02, 0.01]) / math.sqrt(1800.0)


def drive(rng, n_frames, walk=True, start=(0.0, 0.0, 0.0)):
    """Return the truth and what frames tell (N, 3): errors that last for ten seconds, a rig that warms up."""
    keep = math.exp(-2.0 * PERIOD_S / CORRELATION_S)  # the integral of the correlation is ten seconds
    errors = np.empty((n_frames, 3))
    now = rng.normal(size=3)
    for index in range(n_frames):
        errors[index] = now * STDS
        now = keep * now + math.sqrt(1.0 - keep**2) * rng.normal(size=3)
    steps = rng.normal(size=(n_frames, 3)) * WALK_PER_S * math.sqrt(PERIOD_S) * walk
    truth = np.array(start) + np.cumsum(steps, axis=0)
    return truth, truth + errors


def watched(told, reference=None, covariance=COVARIANCE):
    """Return the findings after each frame."""
    watch = AlignmentWatch()
    watch.start(reference)
    return [watch.add(Alignment(*values, covariance), PERIOD_S * index) for index, values in enumerate(told)]


def test_error_over_standard_deviation_is_one():
    rng = np.random.default_rng(1)
    ratios = []
    for _ in range(60):
        truth, told = drive(rng, 240)
        present = watched(told)[-1].present
        ratios.append((present.as_array() - truth[-1]) / present.std)
    rms = np.sqrt(np.mean(np.square(ratios), axis=0))
    assert np.all(rms > 0.8) and np.all(rms < 1.3), rms


def test_no_alarm_in_two_hundred_half_hours_of_a_steady_rig():
    rng = np.random.default_rng(2)
    for _ in range(200):
        _, told = drive(rng, 900 // 4, walk=False)
        reference = Alignment(*(rng.normal(size=3) * STDS / 3.0), COVARIANCE / 9.0)
        states = {finding.state for finding in watched(told, reference)[5:]}
        assert states == {AlignmentState.STEADY}


@pytest.mark.parametrize(("index", "name"), [(0, "pitch"), (1, "roll"), (2, "yaw")])
def test_bump_is_told_within_minutes_with_its_angle_and_ends_when_it_is_undone(index, name):
    rng = np.random.default_rng(3)
    _, told = drive(rng, 800, walk=False)
    bump = 3.0 * GOOD_LIMITS_RAD[index] + 2.0 * STDS[index]
    told[100:250, index] += bump
    findings = watched(told, Alignment(0.0, 0.0, 0.0, COVARIANCE / 9.0))
    states = [finding.state for finding in findings]
    first = states.index(AlignmentState.DRIFTED)
    assert 100 <= first < 100 + 180 / PERIOD_S
    assert states[249] is AlignmentState.DRIFTED
    assert findings[249].message.startswith(f"the right camera has turned in {name} by +0.")
    # The memory is that of a rig that warms up: after five minutes it has followed most of the way.
    assert 0.5 * bump < findings[249].present.as_array()[index] < 1.2 * bump
    assert states[-1] is AlignmentState.STEADY and findings[-1].message == ""


def test_one_wrong_frame_is_no_bump():
    told = np.zeros((60, 3))
    told[30] = np.radians([0.4, 0.4, 0.4])
    findings = watched(told, Alignment(0.0, 0.0, 0.0, COVARIANCE / 9.0))
    assert {finding.state for finding in findings[5:]} == {AlignmentState.STEADY}
    assert np.all(np.abs(findings[30].present.as_array()) < GOOD_LIMITS_RAD)


def test_frames_that_do_not_tell_the_yaw_are_no_evidence_of_zero():
    """Anything up to half a degree is as probable: mean 0, standard deviation 0.29 deg."""
    anything = np.diag([*np.square(STDS[:2]), math.radians(0.5) ** 2 / 3.0])
    present = watched(np.zeros((200, 3)), covariance=anything)[-1].present
    assert present.std[2] == math.inf
    assert np.all(present.std[:2] < STDS[:2])
    assert not present.known()[2]


def test_many_frames_at_once_are_not_many_times_the_evidence():
    """Thirty frames of one second show the same road."""
    watch = AlignmentWatch()
    for index in range(30):
        finding = watch.add(Alignment(0.0, 0.0, 0.0, COVARIANCE), index / 30.0)
    assert np.all(finding.present.std > 0.9 * STDS)


def test_nothing_is_watched_without_a_reference_or_frames():
    watch = AlignmentWatch()
    assert watch.finding.state is AlignmentState.NOT_WATCHED and watch.finding.present is None
    watch.start(Alignment(0.0, 0.0, 0.0, COVARIANCE))
    nothing = Alignment(0.0, 0.0, 0.0, np.diag([math.inf] * 3))
    for each in (None, nothing, Alignment(0.0, 0.0, 0.0, np.eye(3))):
        assert watch.add(each, 0.0).frames == 0
    for index in range(5):
        finding = watch.add(Alignment(0.0, 0.0, 0.0, COVARIANCE), 10.0 * index)
        assert (finding.state is AlignmentState.STEADY) == (index == 4)


def test_stamps_that_jump_back_begin_another_drive():
    watch = AlignmentWatch()
    for _ in range(3):
        for index in range(10):
            finding = watch.add(Alignment(0.0, 0.0, 1e-3, COVARIANCE), 100.0 + PERIOD_S * index)
    assert finding.frames == 30
    assert np.all(np.isfinite(finding.present.covariance))
    assert finding.present.yaw_rad == pytest.approx(1e-3)


def test_reference_that_does_not_know_an_angle_raises_no_alarm_for_it():
    reference = Alignment(0.0, 0.0, 0.0, np.diag([*np.square(STDS[:2]), math.inf]))
    findings = watched(np.tile([0.0, 0.0, math.radians(0.3)], (60, 1)), reference)
    assert findings[-1].state is AlignmentState.STEADY
    assert findings[-1].present.yaw_rad == pytest.approx(math.radians(0.3))


def test_hours_of_frames_that_tell_nothing_are_no_drift():
    turned = Alignment(*np.radians([0.1, 0.2, 0.1]), np.diag(np.square(np.radians([0.002, 0.005, 0.01]))))
    watch = AlignmentWatch()
    watch.start(turned)
    for index in range(400):
        finding = watch.add(Alignment(0.0, 0.0, 0.0, np.diag(UNTOLD_VARIANCES)), CORRELATION_S * index)
        assert finding.state is AlignmentState.NOT_WATCHED and finding.present is None
