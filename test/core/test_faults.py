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

"""The net around a single frame, and that it hides nothing."""

import copy
import pickle
import threading
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from stereo_selfcal import Calibrator, RejectReason
from stereo_selfcal.core import calibrator as calibrator_module
from stereo_selfcal.core.faults import Fault, FaultLog
from stereo_selfcal.core.results import caught
from stereo_selfcal.synth.scenes import custom_scene

SCENE = custom_scene(n_frames=3)
RIG = SCENE.scene.rig


@cache
def rendered(index):
    return SCENE.frame(index)


@pytest.fixture
def faulty(monkeypatch):
    def choose_none(*_):
        raise IndexError("index 9 is out of\nbounds")

    monkeypatch.setattr(calibrator_module, "choose", choose_none)


def test_a_fault_refuses_the_frame_and_says_what_happened_in_one_line(faulty):
    frame = rendered(0)
    calibrator = Calibrator(RIG)
    result = calibrator.add(frame.left, frame.right, 7.5)
    assert result.reason is RejectReason.INTERNAL_ERROR
    assert (result.accepted, result.stamp_s, result.n_frames) == (False, 7.5, 0)
    assert (
        "ended the work on this frame: IndexError: index 9 is out of\\nbounds (test_faults.py, line "
        in result.message
    )
    assert "\n" not in result.message
    assert result.message.endswith("the other frames are not affected")
    assert "choose_none" in result.fault.trace and "Traceback" in result.fault.trace
    assert calibrator.estimate.fault is result.fault


def test_the_frame_alone_has_no_net(faulty):
    frame = rendered(0)
    with pytest.raises(IndexError):
        Calibrator(RIG).calibrate_frame(frame.left, frame.right)


def test_the_other_frames_count():
    frames = [rendered(index) for index in range(2)]
    alone, with_fault = Calibrator(RIG), Calibrator(RIG)
    for index, frame in enumerate(frames):
        with_fault.remember(alone.add(frame.left, frame.right, index))
        with_fault.remember(caught(lambda: 1 // 0, index))
    assert with_fault.estimate.n_frames == 2
    np.testing.assert_array_equal(alone.estimate.covariance, with_fault.estimate.covariance)


@pytest.mark.parametrize("stamp_s", [None, "x", True, 1j, [1.0]])
def test_a_stamp_that_is_no_number_is_the_callers_fault(stamp_s):
    frame = rendered(0)
    with pytest.raises(TypeError, match=r"stamp_s is .*: a number of seconds is needed"):
        Calibrator(RIG).add(frame.left, frame.right, stamp_s)


@pytest.mark.parametrize("stamp_s", [np.nan, np.inf, -np.float32(np.inf)])
def test_a_stamp_that_is_not_finite_is_the_callers_fault(stamp_s):
    frame = rendered(0)
    with pytest.raises(ValueError, match="a finite number of seconds is needed"):
        Calibrator(RIG).add(frame.left, frame.right, stamp_s)


def test_interrupts_pass_the_net():
    def interrupted():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        caught(interrupted, 0.0)


def fault(kind, depth=0):
    def fail(left):
        if left:
            fail(left - 1)
        raise kind("of frame 5")

    return caught(lambda: fail(depth), 1.0).fault


def test_each_distinct_fault_is_logged_once_with_its_traceback():
    written = []
    log = FaultLog(written.append)
    for stamp_s in range(3):
        log.note(fault(ValueError), stamp_s)
        log.note(None, stamp_s)
        log.note(fault(KeyError), stamp_s)
    assert len(written) == 2
    assert written[0].startswith("the frame of 0.000000 s is refused, ValueError: of frame 5 (test_faults.py")
    assert "this fault is not logged again\nTraceback (most recent call last):" in written[0]


def test_a_log_of_very_many_faults_ends():
    written = []
    log = FaultLog(written.append)
    for depth in range(80):
        log.note(fault(ValueError, depth), 0.0)
    assert len(written) == 50


def test_a_fault_can_be_sent_to_another_process():
    result = caught(lambda: 1 // 0, 2.0)
    assert (
        pickle.loads(pickle.dumps(result)).fault
        == result.fault
        == Fault(*pickle.loads(pickle.dumps((result.fault.what, result.fault.trace, result.fault.where))))
    )


def test_threads_may_add_frames_and_read_the_estimate():
    frames = [rendered(index) for index in range(3)]
    calibrator, seen, faults = Calibrator(RIG), [], []
    start = threading.Barrier(5)

    def add(first):
        start.wait()
        for index in range(2):
            frame = frames[(first + index) % 3]
            calibrator.add(frame.left, frame.right, float(index))

    def read():
        start.wait()
        while len(seen) < 400:
            try:
                seen.append(calibrator.estimate.n_frames)
            except Exception as error:  # noqa: BLE001  (whatever a race leads to)
                faults.append(error)
                return

    threads = [threading.Thread(target=add, args=(first,)) for first in range(3)]
    threads += [threading.Thread(target=read) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    estimate = calibrator.estimate
    assert not faults
    assert estimate.accepted
    # All frames are alike, so that none is an outlier.
    assert estimate.n_frames == 6
    assert max(seen) <= 6


def test_a_calibrator_can_be_copied():
    frame = rendered(0)
    calibrator = Calibrator(RIG)
    calibrator.add(frame.left, frame.right)
    for other in (copy.deepcopy(calibrator), pickle.loads(pickle.dumps(calibrator))):
        other.add(frame.left, frame.right)
        assert (other.estimate.n_frames, calibrator.estimate.n_frames) == (2, 1)


def test_results_share_no_array_with_the_calibrator():
    calibrator = Calibrator(RIG)
    for index in range(2):
        frame = rendered(index)
        result = calibrator.add(frame.left, frame.right, index)
        before = calibrator.estimate
        kept = before.covariance.copy()
        for given in (result, before):
            given.covariance[:] = 0.0
            for term in given.uncertainty:
                term.covariance[:] = 0.0
        np.testing.assert_array_equal(calibrator.estimate.covariance, kept)


def test_a_result_that_cannot_be_fused_is_not_remembered():
    frame = rendered(0)
    calibrator = Calibrator(RIG)
    result = calibrator.add(frame.left, frame.right)
    for broken in (np.zeros((3, 3)), np.full((3, 3), np.nan), -np.eye(3)):
        with pytest.raises(ValueError, match="positive definite"):
            calibrator.remember(replace(result, covariance=broken))
    assert calibrator.estimate.n_frames == 1


def test_arrays_of_other_classes_are_taken_or_refused():
    frame = rendered(0)
    plain = Calibrator(RIG).add(frame.left, frame.right)
    matrix = Calibrator(RIG).add(frame.left.view(np.matrix), frame.right.view(np.matrix))
    assert matrix.message == plain.message
    masked = np.ma.masked_equal(frame.left, 0)
    refused = Calibrator(RIG).add(masked, frame.right)
    assert refused.reason is RejectReason.IMAGE_TYPE
    assert "the left image is a masked array" in refused.message
