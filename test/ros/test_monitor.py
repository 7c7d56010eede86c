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

"""When the watch takes a frame, and that it waits in between; with a clock that only waiting advances."""

from types import SimpleNamespace

import numpy as np
import pytest

from stereo_selfcal import Calibrator, CalibratorConfig
from stereo_selfcal.core.rejection import RejectReason
from stereo_selfcal.core.results import caught
from stereo_selfcal.ros import monitor as monitor_module
from stereo_selfcal.ros.live import LiveFrame, NoFrame
from stereo_selfcal.ros.monitor import TICK_S, Monitor
from stereo_selfcal.synth.renderer import render
from stereo_selfcal.synth.scenes import PAPER_RIG, random_scene

GREY = np.full((PAPER_RIG.height, PAPER_RIG.width), 90, np.uint8)
LIVE = LiveFrame(GREY, GREY, PAPER_RIG, "", 5 * 10**9)
LONGEST_RUN_S = 30.0
MAX_WAITS = 1000


class Waiting:
    """Stands in for the event that ends the watch: waiting advances the time, and ends it at last."""

    def __init__(self, stage):
        self.stage, self.delays, self.ended = stage, [], False

    def wait(self, delay_s):
        assert len(self.delays) < MAX_WAITS, "the watch spins"
        self.delays.append(delay_s)
        self.stage.now_s += delay_s
        self.ended |= self.stage.now_s >= LONGEST_RUN_S
        return self.ended

    def set(self):
        self.ended = True

    def is_set(self):
        return self.ended


class Stage:
    """A monitor whose steps are written down, with what a frame takes [s]."""

    def __init__(self, period_s, step_s=0.0, wanted=True, alive=True):
        self.now_s, self.steps_s, self.step_s, self.trimmed, self.errors = 0.0, [], step_s, 0, []
        self.period_s, self.wanted, self.failure = period_s, wanted, None
        self.monitor = Monitor(
            take=self.take,
            config=lambda: SimpleNamespace(monitor_period_s=self.period_s),
            check=lambda: self.wanted,
            report=lambda _: None,
            alive=lambda: alive,
            logger=SimpleNamespace(error=lambda text, **_: self.errors.append(text)),
            clock=lambda: self.now_s,
        )
        self.monitor._stopped = self.waiting = Waiting(self)

    def take(self, timeout_s):
        assert timeout_s == self.period_s
        self.steps_s.append(self.now_s)
        self.now_s += self.step_s
        if self.failure:
            raise self.failure
        return NoFrame("nothing arrives")

    def run(self):
        self.monitor._run()
        return self.steps_s


@pytest.fixture(autouse=True)
def trimmed(monkeypatch):
    """Count how often the heap was trimmed."""
    calls = []
    monkeypatch.setattr(monitor_module, "trim_heap", lambda: calls.append(True))
    return calls


@pytest.mark.parametrize("period_s", [0.2, 2.0, 3.25])
@pytest.mark.parametrize("step_s", [0.0, 0.05])
def test_one_frame_each_period(period_s, step_s, trimmed):
    stage = Stage(period_s, step_s)
    steps_s = stage.run()
    assert steps_s[0] == 0.0
    np.testing.assert_allclose(np.diff(steps_s), period_s)
    assert len(steps_s) == pytest.approx(LONGEST_RUN_S / period_s, abs=1)
    assert len(trimmed) == len(steps_s)


@pytest.mark.parametrize("period_s", [0.2, 2.0, 3.25])
def test_the_watch_waits_between_two_frames(period_s):
    """It would use a whole core otherwise."""
    stage = Stage(period_s, step_s=0.05)
    stage.run()
    waited_s = sum(stage.waiting.delays)
    assert waited_s == pytest.approx(LONGEST_RUN_S - 0.05 * len(stage.steps_s), abs=TICK_S)
    assert max(stage.waiting.delays) <= TICK_S
    assert len(stage.waiting.delays) <= LONGEST_RUN_S / min(period_s - 0.05, TICK_S) + 2 * len(stage.steps_s)


def test_a_frame_that_takes_longer_than_the_period_is_followed_by_the_next():
    stage = Stage(1.0, step_s=2.5)
    np.testing.assert_allclose(np.diff(stage.run()), 2.5)
    assert set(stage.waiting.delays) == {0.0}


@pytest.mark.parametrize(("period_s", "wanted"), [(0.0, True), (2.0, False)])
def test_without_wish_or_period_it_only_ticks(period_s, wanted):
    stage = Stage(period_s, wanted=wanted)
    assert stage.run() == []
    assert set(stage.waiting.delays[1:]) == {TICK_S}


def test_a_changed_period_is_noticed_within_a_tick():
    stage = Stage(1000.0)
    waiting = stage.waiting.wait

    def wait(delay_s):
        if stage.now_s >= 10.0:
            stage.period_s = 5.0
        return waiting(delay_s)

    stage.waiting.wait = wait
    assert stage.run()[:2] == [0.0, 10.0 + TICK_S]


def test_a_failure_is_logged_and_the_watch_goes_on_without_spinning():
    stage = Stage(2.0)
    stage.failure = ZeroDivisionError("division by zero")
    np.testing.assert_allclose(np.diff(stage.run()), 2.0)
    assert len(stage.errors) == len(stage.steps_s)
    assert "division by zero" in stage.errors[0]
    assert 0.0 not in stage.waiting.delays[1:]


def test_after_a_shutdown_failures_are_not_logged():
    stage = Stage(2.0, alive=False)
    stage.failure = ZeroDivisionError()
    assert len(stage.run()) > 1
    assert stage.errors == []


def step(frame):
    """Return what the monitor reports of a frame, by the real calibrator."""
    reports = []
    config = SimpleNamespace(monitor_period_s=2.0, calibrator=CalibratorConfig())
    Monitor(lambda _: frame, lambda: config, lambda: True, reports.append, lambda: True, None).step()
    return reports


def test_a_frame_is_reported_with_its_stamp():
    (report,) = step(LIVE)
    assert (report.stamp_ns, report.rig, report.result.reason) == (
        5 * 10**9,
        PAPER_RIG,
        RejectReason.ROAD_NOT_SEEN,
    )
    assert report.result.stamp_s == 5.0
    assert report.elapsed_s > 0.0


@pytest.mark.parametrize(
    "frame", [None, NoFrame("nothing arrives"), LiveFrame(GREY, GREY, None, "no CameraInfo", 5)]
)
def test_without_a_frame_or_its_rig_nothing_is_reported(frame):
    assert step(frame) == []


def test_a_fault_while_a_frame_is_read_is_a_refused_frame_of_the_watch():
    stage, reports = Stage(2.0), []
    fault = caught(lambda: 1 // 0, 0.0).fault
    stage.monitor._take = lambda _: NoFrame("a bug", fault, 7_000_000_000)
    stage.monitor._report = reports.append
    stage.monitor.step()
    (report,) = reports
    assert report.result.reason is RejectReason.INTERNAL_ERROR
    assert (report.result.fault, report.result.stamp_s, report.rig) == (fault, 7.0, None)


def test_a_fault_of_the_calibrator_is_a_refused_frame_of_the_watch(monkeypatch):
    def fail(*_):
        raise ZeroDivisionError("a bug")

    monkeypatch.setattr(Calibrator, "calibrate_frame", fail)
    stage, reports = Stage(2.0), []
    config = SimpleNamespace(monitor_period_s=2.0, calibrator=CalibratorConfig())
    stage.monitor._config, stage.monitor._take, stage.monitor._report = (
        lambda: config,
        lambda _: LIVE,
        reports.append,
    )
    stage.monitor.step()
    assert reports[0].result.reason is RejectReason.INTERNAL_ERROR
    assert not stage.errors


@pytest.fixture(scope="module")
def road():
    """Return the images of a road whose surface is seen."""
    scene = random_scene(np.random.default_rng(5), 0.005, texture_amplitude=45.0)
    return render(scene, np.random.default_rng(0))


def looks(road, stamps_s, cold_every_s=2.0):
    """Return the results of looks at a road at these stamps."""
    config = SimpleNamespace(
        monitor_period_s=2.0,
        calibrator=CalibratorConfig.from_mapping({"known.cold_every_s": cold_every_s}),
    )
    stamps, reports = iter(stamps_s), []
    monitor = Monitor(
        lambda _: LiveFrame(*road, PAPER_RIG, "", round(next(stamps) * 1e9)),
        lambda: config,
        lambda: True,
        reports.append,
        lambda: True,
        None,
    )
    for _ in stamps_s:
        monitor.step()
    return [report.result for report in reports]


def test_looks_are_followed_from_the_one_before_but_for_one_in_ten_seconds(road):
    results = looks(road, range(100, 116, 2))
    assert all(result.accepted for result in results)
    assert [result.known_start for result in results] == [False, *[True] * 4, False, True, True]
    # Only looks that are not followed tell how the right camera is turned.
    assert [result.alignment is None for result in results] == [each.known_start for each in results]


def test_no_look_is_followed_where_no_frame_is_to_be(road):
    assert not any(result.known_start for result in looks(road, (100, 102, 104), cold_every_s=0.0))
