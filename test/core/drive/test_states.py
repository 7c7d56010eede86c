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

"""The state machine: every state with every event, and the conditions from both sides of their thresholds."""

from dataclasses import replace
from itertools import product

import pytest

from stereo_selfcal.core.drive.states import TRANSITIONS, Event, State, StateMachine, WatchVerdict, event_of

DRIFT = WatchVerdict(doubted=True, proven=True, least=2.0, most=3.0)

AFTER = {
    State.UNCALIBRATED: {
        Event.LOADED: State.CALIBRATED,
        Event.STARTED: State.CALIBRATING,
        Event.ACCEPTED: State.CALIBRATED,
    },
    State.CALIBRATED: {
        Event.STARTED: State.CALIBRATING,
        Event.WITHDRAWN: State.UNCALIBRATED,
        Event.RESET: State.UNCALIBRATED,
        Event.DOUBTED: State.SUSPECT,
    },
    State.SUSPECT: {
        Event.STARTED: State.CALIBRATING,
        Event.ACCEPTED: State.CALIBRATED,
        Event.WITHDRAWN: State.UNCALIBRATED,
        Event.RESET: State.UNCALIBRATED,
        Event.CONFIRMED: State.CALIBRATED,
        Event.REFUTED: State.INVALID,
    },
    State.INVALID: {
        Event.STARTED: State.CALIBRATING,
        Event.ACCEPTED: State.CALIBRATED,
        Event.WITHDRAWN: State.UNCALIBRATED,
        Event.RESET: State.UNCALIBRATED,
        Event.CONFIRMED: State.CALIBRATED,
        Event.EASED: State.SUSPECT,
    },
}


@pytest.mark.parametrize(("state", "event"), list(product(AFTER, Event)), ids=str)
def test_every_event_in_every_state(state, event):
    assert StateMachine(state).after(event).state is AFTER[state].get(event, state)


@pytest.mark.parametrize("event", Event, ids=str)
@pytest.mark.parametrize("before", AFTER, ids=str)
def test_a_call_that_finds_nothing_changes_nothing(before, event):
    calibrating = StateMachine(before).after(Event.STARTED)
    assert calibrating.state is State.CALIBRATING
    then = calibrating.after(event)
    if event is Event.ACCEPTED:
        assert then.state is State.CALIBRATED
    elif event is Event.FAILED:
        assert then.state is before
    elif event is Event.RESET:
        assert then.state is then.after(Event.FAILED).state is State.UNCALIBRATED
    else:
        assert then.state is State.CALIBRATING
        ended = then.after(Event.FAILED).state
        assert ended is (State.UNCALIBRATED if event is Event.WITHDRAWN else before)


def test_every_state_can_be_reached_and_left():
    for state in State:
        left = [t for t in TRANSITIONS if t.before is state]
        assert left
        assert all(t.condition for t in left)
        assert any(t.after is state for t in TRANSITIONS)


def test_there_is_one_transition_for_a_state_and_an_event():
    causes = [(t.before, t.event) for t in TRANSITIONS]
    assert len(causes) == len(set(causes))


@pytest.mark.parametrize(
    ("state", "event"),
    [
        (State.UNCALIBRATED, None),
        (State.CALIBRATING, None),
        (State.CALIBRATED, Event.DOUBTED),
        (State.SUSPECT, Event.REFUTED),
        (State.INVALID, None),
    ],
)
def test_what_a_large_drift_means(state, event):
    assert event_of(DRIFT, state) is event


@pytest.mark.parametrize(("least", "event"), [(0.999, None), (1.0, Event.REFUTED), (1.001, Event.REFUTED)])
def test_a_drift_makes_invalid_from_its_limit_on(least, event):
    assert event_of(replace(DRIFT, least=least), State.SUSPECT) is event


def test_only_a_proven_drift_makes_invalid():
    assert event_of(replace(DRIFT, proven=False), State.SUSPECT) is None


@pytest.mark.parametrize(("most", "event"), [(0.999, Event.EASED), (1.0, None), (1.001, None)])
def test_invalid_eases_only_below_its_limit(most, event):
    assert event_of(replace(DRIFT, least=0.5, most=most), State.INVALID) is event


def test_no_drift_fits_both_ways_so_that_nothing_flickers():
    """Whatever makes invalid does not ease at once, and the other way round."""
    for least, width in product((0.0, 0.5, 0.99, 1.0, 1.5), (0.0, 0.01, 1.0)):
        verdict = replace(DRIFT, least=least, most=least + width)
        makes_invalid = event_of(verdict, State.SUSPECT) is Event.REFUTED
        eases = event_of(verdict, State.INVALID) is Event.EASED
        assert not (makes_invalid and eases)


@pytest.mark.parametrize("state", State, ids=str)
def test_without_doubt_what_was_in_doubt_is_calibrated(state):
    expected = Event.CONFIRMED if state in (State.SUSPECT, State.INVALID) else None
    assert event_of(WatchVerdict(), state) is expected
