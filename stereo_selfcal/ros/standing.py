"""What the node stands by: the calibration in force, its state, and the watch over it. Needs no ROS."""

from __future__ import annotations

import threading
from dataclasses import replace

from ..core.camera.rig import StereoRig
from ..core.drive.states import Event, Machine, State, event_of
from ..core.drive.watch import Watch
from ..core.results import CalibrationResult
from .record import ActiveCalibration

_NEVER = "call ~/calibrate on a straight road with painted lines"
_AGREES = "the road shows the pose of before the drift again"


class CalibrationKeeper:
    """Keeps state, calibration and watch together; safe to be used by several threads.

    Args:
        watch: The watch, for tests.
    """

    def __init__(self, watch: Watch | None = None) -> None:
        self._lock = threading.Lock()
        self._machine = Machine()
        self._watch = watch or Watch()
        self._in_force: ActiveCalibration | None = None
        self._watched_rig: StereoRig | None = None
        self._why = _NEVER

    @property
    def in_force(self) -> ActiveCalibration | None:
        """The calibration in force; what is suspect or invalid stays so until there is a better one."""
        return self._in_force

    @property
    def state(self) -> State:
        """The state now."""
        return self._machine.state

    @property
    def wants_another(self) -> bool:
        """Whether the calibration in force is not what the road shows, or there is none."""
        return self._machine.state in (State.UNCALIBRATED, State.SUSPECT, State.INVALID)

    @property
    def reason(self) -> str:
        """Why the state is what it is, one sentence."""
        with self._lock:
            state = self._machine.state
            if state is State.CALIBRATING:
                return "a call of ~/calibrate is running"
            if state in (State.SUSPECT, State.INVALID):
                return self._watch.verdict.message
            return self._why

    def explain(self) -> str:
        """Return what the watch has to say, one sentence."""
        with self._lock:
            return self._watch.explain()

    def reject(self, problem: str) -> None:
        """Note why the calibration of an earlier run is not in force."""
        self._why = problem

    def load(self, in_force: ActiveCalibration) -> None:
        """Stand by a calibration of an earlier run."""
        self._stand_by(in_force, Event.LOADED, in_force.saved, settled=False)

    def begin(self) -> None:
        """A calibration was asked for."""
        self._happen(Event.STARTED)

    def fail(self) -> None:
        """Nothing came of it: what was in force stays so."""
        self._happen(Event.FAILED)

    def accept(self, in_force: ActiveCalibration, settled: bool = False) -> None:
        """Stand by a new calibration.

        Args:
            in_force: The calibration.
            settled: Whether it is the watch's own: a mean over minutes of road.
        """
        why = "proven better by the watch" if settled else "accepted when ~/calibrate was called"
        self._stand_by(in_force, Event.ACCEPTED, why, settled)

    def saved(self, where: str, failed: bool) -> None:
        """Note what came of saving the calibration in force."""
        with self._lock:
            if self._in_force is not None:
                self._in_force = replace(self._in_force, saved=where, save_failed=failed)

    def withdraw(self, reason: str) -> None:
        """Stand by no calibration any more: it is of other cameras."""
        with self._lock:
            self._machine = self._machine.after(Event.WITHDRAWN)
            self._in_force, self._why = None, reason
            self._watch.start(None)

    def watched(self, result: CalibrationResult, rig: StereoRig) -> Event | None:
        """Give a frame to the watch.

        Args:
            result: Result of the frame.
            rig: The rig it comes from.

        Returns:
            What it has made happen to the state, None for nothing.
        """
        with self._lock:
            if self._in_force is None and rig != self._watched_rig:
                self._watch.start(None)
            self._watched_rig = rig
            event = event_of(self._watch.add(result), self._machine.state)
            if event is not None:
                self._machine = self._machine.after(event)
            if event is Event.CONFIRMED:
                self._why = _AGREES
            return event

    def proposal(self, rig: StereoRig) -> CalibrationResult | None:
        """Return the calibration that the watch has proven to be better, None if there is none.

        Args:
            rig: The rig its frames come from.
        """
        with self._lock:
            return self._watch.proposal(rig)

    def _stand_by(self, in_force: ActiveCalibration, event: Event, why: str, settled: bool) -> None:
        with self._lock:
            self._machine = self._machine.after(event)
            self._in_force, self._why = in_force, why
            self._watch.start(in_force.result, settled)

    def _happen(self, event: Event) -> None:
        with self._lock:
            self._machine = self._machine.after(event)
