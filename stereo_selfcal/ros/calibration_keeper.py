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

"""The active calibration, its state, and the watch over it. Needs no ROS."""

from __future__ import annotations

import threading
from dataclasses import dataclass, replace

from ..core.camera.rectifier import StereoRectifier
from ..core.camera.rig import StereoRig
from ..core.drive.alignment_watch import AlignmentFinding, AlignmentWatch
from ..core.drive.standing import PlaceOfCar
from ..core.drive.states import Event, State, StateMachine, event_of
from ..core.drive.targets import Targets, describe_std, is_less_certain
from ..core.drive.watch import Watch
from ..core.geometry.camera_info_repair import RepairedPair, repaired_pairs
from ..core.results import CalibrationResult

_NEVER = "call ~/calibrate on a straight road with painted lines"
_AGREES = "the road shows the pose of before the drift again"
_TAKEN_BACK = f"taken back by ~/reset; {_NEVER}"


@dataclass(frozen=True, slots=True, eq=False)
class ActiveCalibration:
    """The calibration that the node publishes and watches.

    Attributes:
        result: The result.
        rig: The rig it holds for.
        since_s: Steady time [s] of its beginning (:func:`time.monotonic`).
        saved: Where it is saved, or why it is not saved.
        save_failed: Whether saving was tried and failed.
        cameras: The cameras whose frames it is from; None where they are not known, as after a restart.
    """

    result: CalibrationResult
    rig: StereoRig
    since_s: float
    saved: str = ""
    save_failed: bool = False
    cameras: StereoRectifier | None = None

    @property
    def repaired_pairs(self) -> tuple[RepairedPair, ...]:
        """The CameraInfo of the cameras, corrected (:func:`.repaired_pairs`); none of unknown cameras."""
        return () if self.cameras is None else repaired_pairs(self.cameras, self.result.alignment)


class CalibrationKeeper:
    """Keeps the active calibration, its state and the watch consistent; safe to be used by several threads.

    Args:
        watch: The watch, for tests.
    """

    def __init__(self, watch: Watch | None = None) -> None:
        self._lock = threading.Lock()
        self._machine = StateMachine()
        self._watch = watch or Watch()
        self._alignment_watch = AlignmentWatch()
        self._active: ActiveCalibration | None = None
        self._watched_rig: StereoRig | None = None
        self._place = PlaceOfCar()  # of the watched frames
        self._why = _NEVER
        self._resets = 0

    @property
    def active(self) -> ActiveCalibration | None:
        """The active calibration. One that is suspect or invalid stays active until there is a better one."""
        return self._active

    @property
    def state(self) -> State:
        """The present state."""
        return self._machine.state

    @property
    def wants_another(self) -> bool:
        """Whether there is no active calibration, or the road contradicts it."""
        return self._machine.state in (State.UNCALIBRATED, State.SUSPECT, State.INVALID)

    @property
    def reason(self) -> str:
        """The reason of the state, one sentence."""
        with self._lock:
            state = self._machine.state
            if state is State.CALIBRATING:
                return "a call of ~/calibrate is running"
            if state in (State.SUSPECT, State.INVALID):
                return self._watch.verdict.message
            return self._why

    @property
    def resets(self) -> int:
        """How often a calibration was taken back by a reset: what was found before one is not activated."""
        return self._resets

    def explain(self) -> str:
        """Return what the watch has found, one sentence."""
        with self._lock:
            return self._watch.explain()

    @property
    def alignment(self) -> AlignmentFinding:
        """What the watch has found of the right camera's alignment."""
        with self._lock:
            return self._alignment_watch.finding

    def reject(self, problem: str) -> None:
        """Note why the calibration of an earlier run did not become the active one."""
        self._why = problem

    def load(self, active: ActiveCalibration) -> None:
        """Activate a calibration of an earlier run."""
        self._activate(active, Event.LOADED, active.saved)

    def begin(self) -> None:
        """Note that a call of ``~/calibrate`` has begun."""
        self._happen(Event.STARTED)

    def fail(self) -> None:
        """Note that the call has found nothing better: the active calibration stays.

        After :meth:`accept` this does nothing.
        """
        self._happen(Event.FAILED)

    def compare(self, result: CalibrationResult, targets: Targets, *, same_cameras: bool) -> tuple[bool, str]:
        """Return whether a calibration short of its targets is better than the active one, and why.

        The active one stays where the state before the call was not invalid, and it is no less certain than
        the other one (:func:`.is_less_certain`).

        Args:
            result: An accepted calibration.
            targets: What was asked.
            same_cameras: Whether it is of the cameras of the active one.
        """
        with self._lock:
            active, state = self._active, self._machine.before_call
        if active is None or active.result.std is None:
            return True, "there was none"
        if not same_cameras:
            return True, "the one before is of other cameras"
        if state is State.INVALID:
            return True, "the one before is invalid"
        std = describe_std(active.result.std)
        if active.result.mount is None and result.mount is not None:
            return True, "the file of the one before does not say what the motion of the car leaves of it"
        if is_less_certain(active.result, result, targets):
            return True, f"the one before is less certain (std {std})"
        return False, f"the active one is no less certain (std {std})"

    def accept(self, active: ActiveCalibration, by_watch: bool = False) -> None:
        """Activate a new calibration.

        Args:
            active: The calibration.
            by_watch: Whether the watch has found it, as a mean over minutes of road.
        """
        why = "proven better by the watch" if by_watch else "accepted when ~/calibrate was called"
        self._activate(active, Event.ACCEPTED, why)

    def saved(self, where: str, failed: bool) -> None:
        """Note where the active calibration was saved, or why it was not."""
        with self._lock:
            if self._active is not None:
                self._active = replace(self._active, saved=where, save_failed=failed)

    def withdraw(self, reason: str) -> None:
        """Deactivate the calibration: it is of other cameras."""
        with self._lock:
            self._deactivate(Event.WITHDRAWN, reason)

    def reset(self) -> ActiveCalibration | None:
        """Deactivate the calibration, as its user wants; return what was active, None where nothing was.

        A call that is running has to be ended by who runs it: it would activate what it finds.
        """
        with self._lock:
            active, self._resets = self._active, self._resets + 1
            self._deactivate(Event.RESET, _TAKEN_BACK)
            return active

    def watched(self, result: CalibrationResult, rig: StereoRig) -> Event | None:
        """Give a frame to the watch.

        Args:
            result: Result of the frame.
            rig: The rig it comes from.

        Returns:
            The event that changed the state, None when it did not change.
        """
        with self._lock:
            if self._active is None and rig != self._watched_rig:
                self._watch.start(None)
                self._alignment_watch.start(None)
            if rig != self._watched_rig:
                self._place = PlaceOfCar()
            self._watched_rig = rig
            place = self._place.followed_by(result.landmarks, rig)
            self._place = place.accepted() if result.accepted else place
            result = replace(result, stood=place.stands)
            self._alignment_watch.add(result.alignment, result.stamp_s)
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
            better = self._watch.proposal(rig)
            present = self._alignment_watch.finding.present
            return None if better is None else replace(better, alignment=present)

    def _activate(self, active: ActiveCalibration, event: Event, why: str) -> None:
        with self._lock:
            self._machine = self._machine.after(event)
            self._active, self._why = active, why
            self._watch.start(active.result)
            self._alignment_watch.start(active.result.alignment)

    def _deactivate(self, event: Event, why: str) -> None:
        """Leave nothing active; callers lock."""
        self._machine = self._machine.after(event)
        self._active, self._why = None, why
        self._watch.start(None)
        self._alignment_watch.start(None)

    def _happen(self, event: Event) -> None:
        with self._lock:
            self._machine = self._machine.after(event)
