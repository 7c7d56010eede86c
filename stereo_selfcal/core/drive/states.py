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

"""The states of a calibration as a state machine: states, events, and the condition of each transition.

A calibration that is suspect or invalid stays active until a better one is proven, because there is no other.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class State(Enum):
    """How far the calibration can be trusted; ``str(state)`` is a stable word."""

    UNCALIBRATED = "uncalibrated"
    CALIBRATING = "calibrating"
    CALIBRATED = "calibrated"
    SUSPECT = "suspect"
    INVALID = "invalid"

    def __str__(self) -> str:
        return self.value


class Event(Enum):
    """An event that may change the state."""

    LOADED = "loaded"
    STARTED = "started"
    ACCEPTED = "accepted"
    FAILED = "failed"
    WITHDRAWN = "withdrawn"
    RESET = "reset"
    DOUBTED = "doubted"
    REFUTED = "refuted"
    EASED = "eased"
    CONFIRMED = "confirmed"

    def __str__(self) -> str:
        return self.value


@dataclass(frozen=True, slots=True)
class Transition:
    """A transition from one state to another.

    Attributes:
        before: State before the transition.
        event: Event that causes it.
        after: State after the transition; None: the state before the calibration was started.
        condition: Condition of the event, in words.
    """

    before: State
    event: Event
    after: State | None
    condition: str


_ACCEPTED = "the call ends with a calibration that is good, or better than the active one"
_RESET = "~/reset is called"
_STARTED = "~/calibrate is called"
_OTHER = "size, focal length, principal point or baseline of the cameras differ from those it was made with"
_AGAIN = "frames since speak against the drift, 1000 to 1"

TRANSITIONS = (
    Transition(State.UNCALIBRATED, Event.LOADED, State.CALIBRATED, "every value of the result file is right"),
    Transition(State.UNCALIBRATED, Event.STARTED, State.CALIBRATING, _STARTED),
    Transition(State.UNCALIBRATED, Event.ACCEPTED, State.CALIBRATED, "the watch has a mean over minutes"),
    Transition(State.CALIBRATING, Event.ACCEPTED, State.CALIBRATED, _ACCEPTED),
    Transition(State.CALIBRATING, Event.FAILED, None, "the call ends without a better calibration"),
    Transition(State.CALIBRATING, Event.WITHDRAWN, State.CALIBRATING, _OTHER),
    Transition(State.CALIBRATING, Event.RESET, State.UNCALIBRATED, _RESET),
    Transition(State.CALIBRATED, Event.STARTED, State.CALIBRATING, _STARTED),
    Transition(State.CALIBRATED, Event.WITHDRAWN, State.UNCALIBRATED, _OTHER),
    Transition(State.CALIBRATED, Event.RESET, State.UNCALIBRATED, _RESET),
    Transition(State.CALIBRATED, Event.DOUBTED, State.SUSPECT, "the drift test raises the alarm"),
    Transition(State.SUSPECT, Event.STARTED, State.CALIBRATING, _STARTED),
    Transition(State.SUSPECT, Event.ACCEPTED, State.CALIBRATED, "the watch has proven a better one"),
    Transition(State.SUSPECT, Event.WITHDRAWN, State.UNCALIBRATED, _OTHER),
    Transition(State.SUSPECT, Event.RESET, State.UNCALIBRATED, _RESET),
    Transition(State.SUSPECT, Event.CONFIRMED, State.CALIBRATED, _AGAIN),
    Transition(
        State.SUSPECT,
        Event.REFUTED,
        State.INVALID,
        "frames after the alarm alone show the drift, and it is beyond its limit by two standard deviations",
    ),
    Transition(State.INVALID, Event.STARTED, State.CALIBRATING, _STARTED),
    Transition(State.INVALID, Event.ACCEPTED, State.CALIBRATED, "the watch has proven a better one"),
    Transition(State.INVALID, Event.WITHDRAWN, State.UNCALIBRATED, _OTHER),
    Transition(State.INVALID, Event.RESET, State.UNCALIBRATED, _RESET),
    Transition(State.INVALID, Event.CONFIRMED, State.CALIBRATED, _AGAIN),
    Transition(
        State.INVALID, Event.EASED, State.SUSPECT, "the drift is within its limit by two standard deviations"
    ),
)
_BY_CAUSE = {(transition.before, transition.event): transition for transition in TRANSITIONS}


@dataclass(frozen=True, slots=True)
class StateMachine:
    """The current state; :meth:`after` returns the next one.

    Attributes:
        state: Current state.
        resumed: State to which the machine returns when the calibration in progress ends without a result.
    """

    state: State = State.UNCALIBRATED
    resumed: State = State.UNCALIBRATED

    @property
    def before_call(self) -> State:
        """The state without the calibration in progress."""
        return self.resumed if self.state is State.CALIBRATING else self.state

    def after(self, event: Event) -> StateMachine:
        """Return the machine after an event; the same one where the state has no transition for the event."""
        transition = _BY_CAUSE.get((self.state, event))
        if transition is None:
            return self
        if self.state is State.CALIBRATING:
            taken_back = event in (Event.WITHDRAWN, Event.RESET)
            resumed = State.UNCALIBRATED if taken_back else self.resumed
            return StateMachine(transition.after or resumed, resumed)
        if transition.after is State.CALIBRATING:
            return StateMachine(State.CALIBRATING, self.state)
        assert transition.after is not None
        return StateMachine(transition.after, self.resumed)


@dataclass(frozen=True, slots=True)
class WatchVerdict:
    """Verdict of the watch on the active calibration (`core.drive.watch`).

    Attributes:
        doubted: Whether the drift test has raised an alarm that has not been withdrawn.
        proven: Whether the frames after the alarm alone show the drift.
        least: Drift minus two standard deviations, over its limit; the greatest over all quantities.
        most: Drift plus two standard deviations, over its limit; the greatest over all quantities.
        message: One sentence with the measured drift and its limit.
    """

    doubted: bool = False
    proven: bool = False
    least: float = 0.0
    most: float = 0.0
    message: str = ""


def event_of(verdict: WatchVerdict, state: State) -> Event | None:
    """Return the event that a verdict causes in a state, None where it changes nothing.

    ``least`` and ``most`` are four standard deviations apart. This hysteresis keeps the state from
    flickering.
    """
    if not verdict.doubted:
        return Event.CONFIRMED if state in (State.SUSPECT, State.INVALID) else None
    if state is State.CALIBRATED:
        return Event.DOUBTED
    if state is State.SUSPECT and verdict.proven and verdict.least >= 1.0:
        return Event.REFUTED
    if state is State.INVALID and verdict.most < 1.0:
        return Event.EASED
    return None
