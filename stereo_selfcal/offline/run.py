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

"""Calibration of one recording, from the first frame to the estimate. Replay, report and fleet use it."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Sequence
from contextlib import closing
from dataclasses import dataclass, replace

from ..bags import BagError, StereoFrame
from ..core.calibrator import Calibrator
from ..core.camera.rectifier import StereoRectifier
from ..core.camera.rig import StereoRig
from ..core.config import CalibratorConfig
from ..core.drive.camera_changes import CameraChange, CameraFollower
from ..core.drive.drive import Drive
from ..core.drive.targets import Targets
from ..core.drive.travel import TravelStep
from ..core.drive.turn_topics import TurnTopics
from ..core.faults import FaultLog
from ..core.rejection import RejectReason
from ..core.results import CalibrationResult
from .frame import FrameCalibrator, FrameHead
from .pool import calibrate_in_order
from .progress import ProgressNotes, ProgressPoint
from .recording import FrameSource
from .rows import FrameRow, with_steps
from .until_good import Goal, GoalWatch, NotedFrames


@dataclass(frozen=True, slots=True, eq=False)
class Replay:
    """Outcome of a recording.

    Attributes:
        rows: One row per frame, in order, at least one.
        drive: Poses of the mount, and its moves.
        rig: The rig of the recording.
        config: Settings it was calibrated with.
        damage: Reason why the recording ended early, in one line; None when all of it was read. The rows and
            the estimate are those of the frames before.
        remarks: Sentences about anomalies of the recording.
        camera_changes: Changes of CameraInfo, in order; the estimate is of the frames since the last one.
        since: Index of the first row since then.
        cameras: The cameras of the estimate; None where the rig is all that is known.
        goal: What became of the standard deviations that were asked for; None where none were.
        travel_steps: The motion of the car between the frames since then, where it is seen.
        progress: How well the mount was known after so many accepted frames since then; empty without one.
    """

    rows: tuple[FrameRow, ...]
    drive: Drive
    rig: StereoRig
    config: CalibratorConfig
    damage: str | None = None
    remarks: tuple[str, ...] = ()
    camera_changes: tuple[CameraChange, ...] = ()
    since: int = 0
    cameras: StereoRectifier | None = None
    goal: Goal | None = None
    travel_steps: tuple[TravelStep, ...] = ()
    progress: tuple[ProgressPoint, ...] = ()

    @property
    def rows_of_rig(self) -> tuple[FrameRow, ...]:
        """The rows of the rig: those since CameraInfo changed last."""
        return self.rows[self.since :]

    def rig_of(self, row: FrameRow) -> StereoRig:
        """Return the rig that a row comes from: that of its own CameraInfo.

        Args:
            row: One of the rows.
        """
        earlier = (change.before for change in self.camera_changes if row.stamp_s < change.at_s)
        return next(earlier, self.rig)

    @property
    def estimate(self) -> CalibrationResult:
        """The accepted frames, fused: those since the mount or CameraInfo changed, if it did."""
        return self.drive.estimate

    @property
    def with_reservations(self) -> bool:
        """Whether there is a calibration that is to be trusted less: something is wrong with its frames."""
        return self.estimate.accepted and (self.damage is not None or self.estimate.with_reservations)

    @property
    def shown(self) -> FrameRow:
        """The frame for a single picture: the last accepted one, or the last one when none was."""
        return next((row for row in reversed(self.rows_of_rig) if row.accepted), self.rows[-1])


def calibrate_recording(
    source: FrameSource,
    config: CalibratorConfig | None = None,
    on_row: Callable[[FrameRow], None] = lambda row: None,
    jobs: int = 1,
    until: Targets | None = None,
) -> Replay:
    """Calibrate the selected frames of a recording, all or until it is good, and fuse the accepted ones.

    A few frames are in memory at a time; rows stay. The outcome is the same, to the last bit, with any
    number of jobs.

    Args:
        source: The recording, open.
        config: Settings, None for the defaults.
        on_row: Called after every frame, in order.
        jobs: Processes that calibrate; with 1, and for a recording of few frames, it is done in this one.
        until: Standard deviations of the estimate at which reading ends; None: at the end.

    Raises:
        SelfcalError: The recording cannot be read, or has no frame that is selected; or a worker died.
    """
    config = config or CalibratorConfig()
    calibrator = Calibrator(source.rig, config)
    noted = NotedFrames(source)
    with closing(calibrate_in_order(noted.frames(), calibrator, jobs, source.count)) as frames:
        replay = assemble_replay(frames, calibrator, on_row, until, source.turn_topics)
    remarks = source.remarks  # known when all is read
    if replay.goal is not None and replay.goal.stopped:
        remarks = noted.remarks_until(len(replay.rows))
    return replace(replay, remarks=(*replay.remarks, *remarks))


def assemble_replay(
    frames: Iterable[tuple[FrameHead, CalibrationResult]],
    calibrator: Calibrator,
    on_row: Callable[[FrameRow], None] = lambda row: None,
    until: Targets | None = None,
    turn_topics: Sequence[str] = (),
) -> Replay:
    """Make the outcome of a recording from its frames, wherever they were calibrated.

    The traceback of each distinct fault of the program is logged once: to stderr, where nothing is set up.

    Args:
        frames: Results of all frames, in order; where a BagError ends them, those before it count.
        calibrator: A calibrator of the rig, which has seen no frame. Frames of other cameras begin anew with
            one of their rig.
        on_row: Called after every frame.
        until: Standard deviations of the estimate at which it ends; None: with the last frame.
        turn_topics: Names of the topics with turn rates that the frames have.

    Raises:
        SelfcalError: It ended before the first frame, or CameraInfo alternates.
    """
    rows: list[FrameRow] = []
    since = 0
    damage = None
    frozen: dict[str, list[float]] = {}
    follower = CameraFollower()
    chain: tuple[int, ...] = ()  # frames that started from each other
    faults = FaultLog(logging.getLogger(__name__).error)
    watch = GoalWatch(until) if until else None
    progress = ProgressNotes()
    turns = TurnTopics(turn_topics)
    stopped = False

    try:
        for head, result in frames:
            if head.cameras is not None:
                change = follower.follow(head.cameras, head.stamp_s)
                if change is not None or head.cameras.rig != calibrator.rig:
                    rows[since:] = with_steps(rows[since:], calibrator.travel_steps)
                    calibrator = Calibrator(head.cameras.rig, calibrator.config)
                if change is not None:
                    since = len(rows)
                    watch = GoalWatch(until) if until else None
                    progress.clear()
            _note_turns(head, turns, calibrator)
            kept = replace(result, stood=calibrator.remember(result, head.moved).stood)
            faults.note(result.fault, head.stamp_s)
            if result.reason is RejectReason.IMAGE_FROZEN:
                frozen.setdefault(head.frozen, []).append(head.stamp_s)
            chain = chain if kept.known_start or not kept.accepted else ()
            rows.append(FrameRow.from_result(kept, head.stamp_s, head.recorded_ns, head.name, chain))
            chain = (*chain, head.recorded_ns) if kept.accepted else chain
            on_row(rows[-1])
            progress.note(kept, calibrator)
            if watch is not None and result.accepted:
                stopped = watch.is_reached(calibrator)
                if stopped:
                    break
    except BagError as error:
        if not rows:
            raise
        n = len(rows)
        damage = f"{error}; it ended early, after {n} frames: --max-frames {n} calibrates from these alone"
    if not rows:
        raise ValueError("a recording of no frames cannot be calibrated")
    rows[since:] = with_steps(rows[since:], calibrator.travel_steps)
    drive = calibrator.drive
    changes = follower.changes
    if changes:
        message = f"{drive.estimate.message}; {changes[-1].since}"
        drive = replace(drive, estimate=replace(drive.estimate, message=message))
    remarks = (
        tuple(change.message for change in changes)
        + tuple(
            f"the {side} camera repeats an image while the other one goes on: {len(stamps)} of {len(rows)} "
            f"frames, the first one of {stamps[0]:.3f} s, are refused"
            for side, stamps in sorted(frozen.items())
        )
        + turns.doubts(calibrator.travel_steps)
    )
    return Replay(
        tuple(rows),
        drive,
        calibrator.rig,
        calibrator.config,
        damage,
        remarks,
        changes,
        since,
        follower.current,
        None
        if until is None
        else Goal.of(until, drive.estimate, len(rows), rows[-1].stamp_s - rows[0].stamp_s, stopped),
        calibrator.travel_steps,
        progress.end(drive.estimate.std),
    )


def _note_turns(head: FrameHead, turns: TurnTopics, calibrator: Calibrator) -> None:
    """Take over what topics with turn rates have said before a frame."""
    for message in head.turns:
        turns.note(message)
        if message.rate is not None:
            calibrator.note_turn_rate(message.rate)


def look_again(
    source: FrameSource, row: FrameRow, config: CalibratorConfig | None = None
) -> tuple[StereoFrame, CalibrationResult]:
    """Read a frame again and calibrate it again, for pictures: the images and all that was found in them.

    Where it started from frames before, these are calibrated again as well.

    Args:
        source: The recording the row is of, open.
        row: The row.
        config: The settings it was calibrated with; same settings, same result.
    """
    calibrator = FrameCalibrator(Calibrator(source.rig, config))
    for recorded_ns in row.started_from:
        calibrator.calibrate(source.frame_at(recorded_ns))
    frame = source.frame_at(row.recorded_ns)
    return frame, calibrator.calibrate(frame)
