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

"""When the node subscribes: while images are wanted, at the start, and for a short probe now and then."""

import pytest

pytest.importorskip("rclpy")

from stereo_selfcal.ros.subscription_schedule import (
    LINGER_S,
    PROBE_PERIOD_S,
    PROBE_PERIOD_WITHOUT_PAIR_S,
    PROBE_S,
    PROBE_WITHOUT_PAIR_S,
    SubscriptionSchedule,
)

CAMERA = (1, 1)


def probed(paired=True):
    """Return a schedule after its first probe, and when that ended [s]."""
    schedule = SubscriptionSchedule()
    assert schedule.update(0.0, CAMERA)
    assert schedule.image_arrived(5.0, paired)
    end_s = 5.0 + (PROBE_S if paired else PROBE_WITHOUT_PAIR_S)
    assert schedule.update(end_s - 0.01, CAMERA)
    assert not schedule.update(end_s, CAMERA)
    return schedule, end_s


def test_subscribed_as_long_as_nothing_arrives():
    schedule = SubscriptionSchedule()
    assert all(schedule.update(float(t), (0, 0)) for t in range(1000))


@pytest.mark.parametrize(
    ("paired", "period_s"), [(True, PROBE_PERIOD_S), (False, PROBE_PERIOD_WITHOUT_PAIR_S)]
)
def test_probes_now_and_then(paired, period_s):
    schedule, end_s = probed(paired)
    assert not schedule.update(end_s + period_s - 0.01, CAMERA)
    assert schedule.update(end_s + period_s, CAMERA)
    assert schedule.image_arrived(end_s + period_s + 0.1, True)  # the first one again
    assert not schedule.image_arrived(end_s + period_s + 0.2, True)
    assert not schedule.update(end_s + period_s + 0.1 + PROBE_S, CAMERA)


def test_a_camera_that_comes_or_goes_begins_a_probe():
    schedule, end_s = probed()
    assert not schedule.update(end_s + 1.0, CAMERA)
    assert schedule.update(end_s + 2.0, (1, 0))


def test_subscribed_while_images_are_wanted_and_a_little_longer():
    schedule, end_s = probed()
    schedule.want()
    assert schedule.wanted
    assert all(schedule.update(end_s + t, CAMERA) for t in range(1000))
    schedule.image_arrived(end_s, True)
    schedule.release(end_s + 1000.0)
    assert not schedule.wanted
    assert schedule.update(end_s + 1000.0 + LINGER_S - 0.01, CAMERA)
    assert not schedule.update(end_s + 1000.0 + LINGER_S, CAMERA)


def test_one_wish_a_second_keeps_the_subscriptions():
    schedule, end_s = probed()
    for second in range(100):
        schedule.want()
        assert schedule.update(end_s + second, CAMERA)
        schedule.image_arrived(end_s + second + 0.01, True)
        schedule.release(end_s + second + 0.02)
        assert schedule.update(end_s + second + 0.9, CAMERA)


def test_single_images_are_taken_for_their_moment_only():
    schedule, now_s = probed()
    schedule.want()
    assert schedule.taking
    assert schedule.image_arrived(now_s, True)
    assert not schedule.image_arrived(now_s, True)
    schedule.release(now_s)
    assert not schedule.taking
    assert schedule.update(now_s + 2.0, CAMERA), "subscribed it stays"
    assert not schedule.taking


def test_a_probe_takes_place_besides_single_images():
    """Rates are measured over a second, not over a moment."""
    schedule, now_s = probed()
    times = []
    for step in range(100):
        now_s += 0.5
        schedule.update(now_s, CAMERA)
        if schedule.taking:
            times.append(now_s)
            schedule.image_arrived(now_s, True)
        if step % 4 == 0:
            schedule.want()
            schedule.image_arrived(now_s, True)
            schedule.release(now_s)
    assert times[-1] - times[0] <= PROBE_S
    assert times[0] - probed()[1] == pytest.approx(PROBE_PERIOD_S, abs=0.5)


def test_no_image_where_one_was_wanted_begins_a_probe():
    schedule, now_s = probed()
    schedule.want()
    schedule.release(now_s + 1.0)
    assert not schedule.taking
    assert schedule.update(now_s + 2.0, CAMERA)
    assert schedule.taking
    assert all(schedule.update(now_s + t, CAMERA) and schedule.taking for t in range(3, 1000))


def test_a_wish_does_not_restart_a_probe():
    schedule = SubscriptionSchedule()
    schedule.update(0.0, CAMERA)
    assert schedule.image_arrived(5.0, True)
    schedule.want()
    assert not schedule.image_arrived(5.5, True)
    schedule.release(5.6)
    assert schedule.taking
    schedule.update(5.0 + PROBE_S, CAMERA)
    assert not schedule.taking


def test_one_pair_is_enough_for_a_short_probe():
    schedule = SubscriptionSchedule()
    schedule.update(0.0, CAMERA)
    schedule.image_arrived(5.0, True)
    schedule.image_arrived(5.5, False)
    schedule.update(5.0 + PROBE_S, CAMERA)
    assert not schedule.taking
