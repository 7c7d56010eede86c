"""The state of a calibration, as one machine: what it can be, what may happen to it, and on which condition.

A calibration that is suspect or invalid stays in force: it is what there is until a better one is proven.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class State(Enum):
    """What is to be thought of the calibration; ``str(state)`` is a stable word."""

    UNCALIBRATED = "uncalibrated"
    CALIBRATING = "calibrating"
    CALIBRATED = "calibrated"
    SUSPECT = "suspect"
    INVALID = "invalid"

    def __str__(self) -> str:
        return self.value


class Event(Enum):
    """What may happen to it."""

    LOADED = "loaded"
    STARTED = "started"
    ACCEPTED = "accepted"
    FAILED = "failed"
    WITHDRAWN = "withdrawn"
    DOUBTED = "doubted"
    REFUTED = "refuted"
    EASED = "eased"
    CONFIRMED = "confirmed"

    def __str__(self) -> str:
        return self.value


@dataclass(frozen=True, slots=True)
class Transition:
    """A way from one state into another.

    Attributes:
        before: The state before.
        event: What happens.
        after: The state after; None: the one before the calibration was started.
        condition: When it happens, in words.
    """

    before: State
    event: Event
    after: State | None
    condition: str


_ACCEPTED = "a calibration was accepted by every gate"
_STARTED = "~/calibrate is called"
_OTHER = "size, focal length, principal point or baseline of the cameras differ from those it was made with"
_AGAIN = "frames since speak against the drift, 1000 to 1"

TRANSITIONS = (
    Transition(State.UNCALIBRATED, Event.LOADED, State.CALIBRATED, "every value of the result file is right"),
    Transition(State.UNCALIBRATED, Event.STARTED, State.CALIBRATING, _STARTED),
    Transition(State.UNCALIBRATED, Event.ACCEPTED, State.CALIBRATED, "the watch has a mean over minutes"),
    Transition(State.CALIBRATING, Event.ACCEPTED, State.CALIBRATED, _ACCEPTED),
    Transition(State.CALIBRATING, Event.FAILED, None, "the call ends without a calibration"),
    Transition(State.CALIBRATING, Event.WITHDRAWN, State.CALIBRATING, _OTHER),
    Transition(State.CALIBRATED, Event.STARTED, State.CALIBRATING, _STARTED),
    Transition(State.CALIBRATED, Event.WITHDRAWN, State.UNCALIBRATED, _OTHER),
    Transition(State.CALIBRATED, Event.DOUBTED, State.SUSPECT, "the drift test raises the alarm"),
    Transition(State.SUSPECT, Event.STARTED, State.CALIBRATING, _STARTED),
    Transition(State.SUSPECT, Event.ACCEPTED, State.CALIBRATED, "the watch has proven a better one"),
    Transition(State.SUSPECT, Event.WITHDRAWN, State.UNCALIBRATED, _OTHER),
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
    Transition(State.INVALID, Event.CONFIRMED, State.CALIBRATED, _AGAIN),
    Transition(
        State.INVALID, Event.EASED, State.SUSPECT, "the drift is within its limit by two standard deviations"
    ),
)
_BY_CAUSE = {(transition.before, transition.event): transition for transition in TRANSITIONS}


@dataclass(frozen=True, slots=True)
class Machine:
    """The state now; :meth:`after` gives the next one.

    Attributes:
        state: The state.
        resumed: While calibrating: the state that a call without a calibration goes back to.
    """

    state: State = State.UNCALIBRATED
    resumed: State = State.UNCALIBRATED

    def after(self, event: Event) -> Machine:
        """Return the machine after an event; itself where the event means nothing in this state."""
        transition = _BY_CAUSE.get((self.state, event))
        if transition is None:
            return self
        if self.state is State.CALIBRATING:
            resumed = State.UNCALIBRATED if event is Event.WITHDRAWN else self.resumed
            return Machine(transition.after or resumed, resumed)
        if transition.after is State.CALIBRATING:
            return Machine(State.CALIBRATING, self.state)
        assert transition.after is not None
        return Machine(transition.after, self.resumed)


@dataclass(frozen=True, slots=True)
class WatchVerdict:
    """What the watch thinks of the calibration in force (`core.drive.watch`).

    Attributes:
        doubted: Whether the drift test has raised the alarm and nothing has lowered it since.
        proven: Whether the frames after the alarm alone show the drift.
        least: The drift less two standard deviations, over its limit; of that quantity where it is greatest.
        most: The drift and two standard deviations, over its limit; likewise.
        message: One sentence: what was measured, and the limit.
    """

    doubted: bool = False
    proven: bool = False
    least: float = 0.0
    most: float = 0.0
    message: str = ""


def event_of(verdict: WatchVerdict, state: State) -> Event | None:
    """Return what a verdict means in a state, None if it changes nothing.

    Between ``least`` and ``most`` lie four standard deviations: what is invalid does not flicker.
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
