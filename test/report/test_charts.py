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

"""Charts as SVG: what is drawn where."""

import re
from xml.etree import ElementTree

import numpy as np
import pytest

from stereo_selfcal.report.charts import (
    HEIGHT,
    MOST_POINTS,
    WIDTH,
    Level,
    histogram,
    tick_text,
    ticks,
    time_series,
)

NONE = np.array([])


def elements(svg, kind):
    return [e for e in ElementTree.fromstring(svg).iter() if kind in (e.get("class") or "").split()]


def dots(svg):
    (path,) = elements(svg, "frame")
    return np.array([[float(v) for v in pair] for pair in re.findall(r"M(\S+) (\S+?)h0", path.get("d"))])


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [
        (0.0, 10.0, [0, 2, 4, 6, 8, 10]),
        (1.3995, 1.4006, [1.3995, 1.4, 1.4005]),
        (-3.0, 3.0, [-2, 0, 2]),
        (5.0, 5.0, [5.0]),
    ],
)
def test_ticks_are_round_and_few(low, high, expected):
    assert ticks(low, high) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("value", "step", "text"),
    [(0.2, 0.1, "0.2"), (20.0, 10.0, "20"), (1.4, 0.005, "1.400"), (-0.0, 1.0, "0")],
)
def test_ticks_have_the_digits_of_their_step(value, step, text):
    assert tick_text(value, step) == text


def test_later_is_right_and_more_is_up():
    places = dots(
        time_series(np.array([0.0, 5.0, 10.0]), np.array([1.0, 2.0, 3.0]), NONE, [], [], ("a", "b"))
    )
    assert np.all(np.diff(places[:, 0]) > 0)
    assert np.all(np.diff(places[:, 1]) < 0)
    assert places.min() > 0
    assert np.all(places < [WIDTH, HEIGHT])


def test_levels_moves_and_refusals_are_drawn_at_their_times():
    times = np.linspace(0.0, 10.0, 11)
    levels = [Level(0.0, 5.0, 1.0, 0.1), Level(6.0, 10.0, 2.0, 0.1)]
    values = np.where(times < 5.5, 1.0, 2.0)
    svg = time_series(times, values, np.array([3.0, 7.0]), levels, [5.5], ("a", "b"))
    places = dots(svg)
    (moved,) = elements(svg, "moved")
    assert places[5, 0] < float(moved.get("x1")) < places[6, 0]
    lower, upper = elements(svg, "mount")
    assert float(lower.get("y1")) == pytest.approx(places[0, 1], abs=0.11)
    assert float(upper.get("y1")) == pytest.approx(places[-1, 1], abs=0.11)
    (rug,) = elements(svg, "refused")
    assert rug.get("d").count("M") == 2


def test_a_wild_value_is_put_on_the_edge_and_does_not_flatten_the_rest():
    values = np.sin(np.arange(1000.0))
    values[500] = 1e6
    places = dots(time_series(np.arange(1000.0), values, NONE, [], [], ("a", "b")))
    assert np.ptp(np.delete(places[:, 1], 500)) > HEIGHT / 3
    assert places[:, 1].min() > 0


@pytest.mark.parametrize("n", [1, 2, MOST_POINTS + 1, 10 * MOST_POINTS])
def test_any_number_of_frames_can_be_drawn(n):
    svg = time_series(np.arange(float(n)), np.full(n, 1.4), NONE, [], [], ("a", "b"))
    assert 0 < len(dots(svg)) <= MOST_POINTS
    assert "nan" not in svg


def test_dots_that_stand_out_are_drawn_over_their_places():
    times, values = np.arange(4.0), np.array([1.0, 2.0, 3.0, 2.0])
    svg = time_series(times, values, NONE, [], [], ("a", "b"), marked=[False, True, False, True])
    (path,) = elements(svg, "changed")
    places = re.findall(r"M(\S+ \S+?)h0", path.get("d"))
    (all_dots,) = elements(svg, "frame")
    assert places == re.findall(r"M(\S+ \S+?)h0", all_dots.get("d"))[1::2]
    assert not elements(time_series(times, values, NONE, [], [], ("a", "b")), "changed")


def test_a_level_that_is_longer_than_the_dots_is_inside_the_axes():
    levels = [Level(-5.0, 20.0, 1.0, 0.1)]
    svg = time_series(np.array([4.0, 6.0]), np.array([1.0, 1.1]), NONE, levels, [], ("a", "b"))
    (band,), (axis,) = elements(svg, "band"), elements(svg, "axis")
    assert float(axis.get("x1")) <= float(band.get("x"))
    assert float(band.get("x")) + float(band.get("width")) <= float(axis.get("x2"))


def test_drives_are_counted_in_whole_numbers():
    svg = time_series(np.array([1.0, 2.0]), np.array([1.0, 2.0]), NONE, [], [], ("a", "b"), least_step=1.0)
    assert [text.text for text in elements(svg, "middle")] == ["1", "2"]


def test_histogram_counts_what_is_beyond_in_its_last_bars():
    svg = histogram(np.array([-100.0, 0.1, 0.2, 100.0]), "a", "b")
    bars = elements(svg, "bar")
    assert len(bars) == 3
    heights = [float(bar.get("height")) for bar in bars]
    assert heights[1] == pytest.approx(2 * heights[0], abs=0.2)
    assert heights[0] == heights[2]
