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

"""Rates of the diagnostics: over which time they are measured, and when they are not."""

from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy")

from ros_graph import info_message

from stereo_selfcal.core.camera.pairing import PairCounts
from stereo_selfcal.ros.config import SETTINGS, NodeConfig
from stereo_selfcal.ros.diagnostics import CalibrationReport
from stereo_selfcal.ros.intake import ImageFormat, IntakeWindow
from stereo_selfcal.ros.pair_source import InputState, Topics
from stereo_selfcal.ros.reporter import DiagnosticsReporter

CONFIG = NodeConfig.from_values({name: setting.default for name, setting in SETTINGS.items()})


class Input:
    """An input whose counts and window are those that are set."""

    topics = Topics("/left", "/right", "/left_info", "/right_info")
    camera_infos = (info_message("left"), info_message("right"))

    def __init__(self):
        self.counts, self.window, self.formats, self.ticks = PairCounts(), None, {}, 0

    @property
    def state(self):
        return InputState(self.counts, None)

    def camera_infos_of(self, _pair):
        return self.camera_infos

    def publishers(self, topic):
        return 1

    def tick(self):
        self.ticks += 1


class Stage:
    """A reporter on a node of cardboard, whose time is set by the test."""

    def __init__(self):
        self.now_s, self.source, self.sent = 100.0, Input(), []
        clock = SimpleNamespace(now=lambda: SimpleNamespace(to_msg=lambda: None))
        node = SimpleNamespace(
            create_publisher=lambda *_: SimpleNamespace(publish=self.sent.append),
            create_timer=lambda *_, **__: None,
            get_clock=lambda: clock,
            context=SimpleNamespace(ok=lambda: True),
            get_fully_qualified_name=lambda: "/stereo_selfcal",
        )
        self.reporter = DiagnosticsReporter(
            node,
            self.source,
            lambda: CONFIG,
            lambda: CalibrationReport("uncalibrated"),
            lambda: self.now_s,
        )

    def open(self):
        self.source.window = IntakeWindow(self.source.counts, self.now_s)

    def pass_time(self, seconds, pairs=0):
        """Let images arrive, and measure."""
        before = self.source.counts
        self.now_s += seconds
        self.source.counts = PairCounts(before.left + pairs, before.right + pairs, before.pairs + pairs)
        self.reporter._measure()
        return self.report

    @property
    def report(self):
        return self.reporter.snapshot().images


@pytest.fixture
def stage():
    return Stage()


def test_nothing_is_measured_before_images_are_taken(stage):
    report = stage.pass_time(10.0)
    assert (report.receiving, report.added, report.no_pair, report.age_s) == (False, PairCounts(), "", 0.0)


def test_rates_are_means_over_the_last_three_reports(stage):
    stage.open()
    spans = [(stage.pass_time(1.0, pairs).elapsed_s, stage.report.added.pairs) for pairs in (30, 20, 10, 6)]
    assert spans == [(1.0, 30), (2.0, 50), (3.0, 60), (3.0, 36)]


def test_rates_begin_anew_with_each_window(stage):
    stage.open()
    stage.pass_time(1.0, 30)
    stage.pass_time(1.0, 30)
    stage.source.window = None
    stage.pass_time(7.0)
    stage.open()
    report = stage.pass_time(0.6, 6)
    assert (report.elapsed_s, report.added.pairs) == (pytest.approx(0.6), 6)


def test_the_last_rates_stay_with_their_age_while_no_images_are_taken(stage):
    stage.open()
    stage.pass_time(1.0, 30)
    stage.source.window = None
    report = stage.pass_time(12.5)
    assert (report.receiving, report.age_s, report.added.pairs) == (False, 12.5, 30)


@pytest.mark.parametrize(("seconds", "pairs", "measured"), [(0.49, 5, 30), (0.5, 5, 5)])
def test_a_short_time_measures_no_rate(stage, seconds, pairs, measured):
    stage.open()
    stage.pass_time(1.0, 30)
    stage.open()
    assert stage.pass_time(seconds, pairs).added.pairs == measured


@pytest.mark.parametrize(("seconds", "measured"), [(1.99, 30), (2.0, 0)])
def test_a_slow_camera_has_two_seconds_for_its_first_pair(stage, seconds, measured):
    stage.open()
    stage.pass_time(1.0, 30)
    stage.open()
    report = stage.pass_time(seconds)
    assert report.added.pairs == measured
    assert report.no_pair.startswith("no pair in 2.0 s: left 0.0 Hz") == (not measured)


def test_without_earlier_rates_no_pair_is_told_at_once(stage):
    stage.open()
    assert stage.pass_time(0.1).no_pair.startswith("no pair in 0.1 s: ")


def test_no_time_at_all_is_no_division_by_zero(stage):
    stage.open()
    assert stage.pass_time(0.0).elapsed_s == 1e-3


def test_the_timer_measures_before_the_schedule_ends_a_probe(stage):
    """The last second of a probe is a part of it."""
    stage.open()
    stage.source.counts, stage.now_s = PairCounts(30, 30, 30), stage.now_s + 1.0

    def tick():
        stage.source.window = None

    stage.source.tick = tick
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("stereo_selfcal.ros.reporter.diagnostics_message", lambda _, snapshot: snapshot)
        stage.reporter._on_timer()
    (snapshot,) = stage.sent
    assert (snapshot.images.receiving, snapshot.images.added.pairs) == (False, 30)


def test_encodings_that_cannot_be_read_are_named(stage):
    stage.source.formats = {"left": ImageFormat(640, 480, "yuv422"), "right": ImageFormat(0, 0, "png")}
    report = stage.report
    assert report.formats == stage.source.formats
    (sentence,) = report.unusable
    assert sentence.startswith("/left: image encoding 'yuv422' is not supported: publish one of mono8")
