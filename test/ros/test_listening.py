"""When the node listens: while it is asked to, at the start, and for a moment now and then."""

import pytest

pytest.importorskip("rclpy")

from stereo_selfcal.ros.listening import (
    LINGER_S,
    LONG_LOOK_S,
    LOOK_S,
    PERIOD_IN_TROUBLE_S,
    PERIOD_S,
    SubscriptionSchedule,
)

CAMERA = (1, 1)


def looked(paired=True):
    """Return one that has had its first look, and when that ended [s]."""
    listening = SubscriptionSchedule()
    assert listening.due(0.0, CAMERA)
    assert listening.arrived(5.0, paired)
    end_s = 5.0 + (LOOK_S if paired else LONG_LOOK_S)
    assert listening.due(end_s - 0.01, CAMERA)
    assert not listening.due(end_s, CAMERA)
    return listening, end_s


def test_listens_as_long_as_nothing_arrives():
    listening = SubscriptionSchedule()
    assert all(listening.due(float(t), (0, 0)) for t in range(1000))


@pytest.mark.parametrize(("paired", "period_s"), [(True, PERIOD_S), (False, PERIOD_IN_TROUBLE_S)])
def test_looks_now_and_then(paired, period_s):
    listening, end_s = looked(paired)
    assert not listening.due(end_s + period_s - 0.01, CAMERA)
    assert listening.due(end_s + period_s, CAMERA)
    assert listening.arrived(end_s + period_s + 0.1, True)  # the first one again
    assert not listening.arrived(end_s + period_s + 0.2, True)
    assert not listening.due(end_s + period_s + 0.1 + LOOK_S, CAMERA)


def test_a_camera_that_comes_or_goes_is_looked_at_at_once():
    listening, end_s = looked()
    assert not listening.due(end_s + 1.0, CAMERA)
    assert listening.due(end_s + 2.0, (1, 0))


def test_listens_while_images_are_wanted_and_a_little_longer():
    listening, end_s = looked()
    listening.want()
    assert listening.wanted
    assert all(listening.due(end_s + t, CAMERA) for t in range(1000))
    listening.arrived(end_s, True)
    listening.release(end_s + 1000.0)
    assert not listening.wanted
    assert listening.due(end_s + 1000.0 + LINGER_S - 0.01, CAMERA)
    assert not listening.due(end_s + 1000.0 + LINGER_S, CAMERA)


def test_who_wants_an_image_each_second_keeps_it_listening():
    listening, end_s = looked()
    for second in range(100):
        listening.want()
        assert listening.due(end_s + second, CAMERA)
        listening.arrived(end_s + second + 0.01, True)
        listening.release(end_s + second + 0.02)
        assert listening.due(end_s + second + 0.9, CAMERA)


def test_single_images_are_taken_for_their_moment_only():
    listening, now_s = looked()
    listening.want()
    assert listening.taking
    assert listening.arrived(now_s, True)
    assert not listening.arrived(now_s, True)
    listening.release(now_s)
    assert not listening.taking
    assert listening.due(now_s + 2.0, CAMERA), "subscribed it stays"
    assert not listening.taking


def test_a_look_is_had_besides_single_images():
    """Rates are measured over a second, not over a moment."""
    listening, now_s = looked()
    times = []
    for step in range(100):
        now_s += 0.5
        listening.due(now_s, CAMERA)
        if listening.taking:
            times.append(now_s)
            listening.arrived(now_s, True)
        if step % 4 == 0:
            listening.want()
            listening.arrived(now_s, True)
            listening.release(now_s)
    assert times[-1] - times[0] <= LOOK_S
    assert times[0] - looked()[1] == pytest.approx(PERIOD_S, abs=0.5)


def test_who_gets_no_image_has_the_camera_looked_at():
    listening, now_s = looked()
    listening.want()
    listening.release(now_s + 1.0)
    assert not listening.taking
    assert listening.due(now_s + 2.0, CAMERA)
    assert listening.taking
    assert all(listening.due(now_s + t, CAMERA) and listening.taking for t in range(3, 1000))
