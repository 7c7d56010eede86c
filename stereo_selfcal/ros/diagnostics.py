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

"""The message for ``/diagnostics``, made from a plain snapshot of the node; needs no graph.

There is one status for each thing a person can mend. Its level says what is to be done:

* OK: nothing.
* WARN: somebody should look. Nothing arrives, nothing is calibrated yet, or the last call was refused.
* ERROR: it cannot work before somebody changes something. A CameraInfo contradicts itself, a QoS does not
  match, an encoding cannot be read, or the calibration is invalid.
* STALE is never sent. diagnostic_aggregator and rqt_robot_monitor show it for a node that is silent for some
  seconds.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from ..core.alignment_verdict import report_alignment
from ..core.camera.pairing import PairCounts
from ..core.camera.rig import StereoRig
from ..core.delay_report import describe_delay, is_late
from ..core.drive.alignment_watch import AlignmentFinding
from ..core.geometry.homography import Side
from ..published.status import (
    StatusLevel,
    StatusReport,
    alignment_numbers,
    alignment_values,
    delay_values,
    describe_rig,
    estimate_values,
    number_values,
    rejection_values,
    rig_values,
)
from .calibration_keeper import ActiveCalibration
from .call_progress import CallProgress
from .intake import ImageFormat
from .pair_source import Topics
from .record import FrameStatistics
from .transform_report import TransformReport

OK, WARN, ERROR = StatusLevel.OK, StatusLevel.WARN, StatusLevel.ERROR

# By the word of the state; an unknown state is a warning.
_STATE_LEVELS = {"calibrating": OK, "calibrated": OK, "uncalibrated": WARN, "suspect": WARN, "invalid": ERROR}
_LEAST_ELAPSED_S = 1e-3  # two reports at once must not divide by zero
_AGE_UNITS = ((86400, "d"), (3600, "h"), (60, "min"), (1, "s"))


@dataclass(frozen=True, slots=True)
class CalibrationReport:
    """The state of the calibration.

    Attributes:
        state: Word of the state: uncalibrated, calibrating, calibrated, suspect, invalid.
        reason: Reason of the state, one sentence.
        active: The active calibration, None if there is none.
        age_s: Age of the active calibration [s].
        last_answer: Answer to the last call.
        last_success: Whether the last call found a result, None before the first call.
        frames: Frames so far.
        watch: Finding of the watch, one sentence.
        alignment: Finding of the watch over the right camera's alignment.
        progress: How far the running call has come, None while none is running.
        road_pose: What ``~/road_pose`` publishes, or why nothing, one sentence.
        transform: Where the camera is in the vehicle, as it is published.
    """

    state: str
    reason: str = ""
    active: ActiveCalibration | None = None
    age_s: float = 0.0
    last_answer: str = "not called yet"
    last_success: bool | None = None
    frames: FrameStatistics = field(default_factory=FrameStatistics)
    watch: str = "off"
    alignment: AlignmentFinding = field(default_factory=AlignmentFinding)
    progress: CallProgress | None = None
    road_pose: str = "nobody listens"
    transform: TransformReport = field(default_factory=TransformReport)


@dataclass(frozen=True, slots=True)
class ImagesReport:
    """The images that arrive.

    Attributes:
        counts: Images and pairs so far.
        added: The same within the last ``elapsed_s``.
        elapsed_s: Time over which rates are measured [s].
        receiving: Whether images are taken now; they are not while nobody wants them.
        age_s: Time since the rates were measured [s].
        no_pair: Why there was no pair within that time, "" if there was one.
        nearest_s: Least difference of a left and a right stamp [s], None before the first.
        topics: Names of the topics.
        publishers: Publishers of the left and of the right images.
        drops: Number of images that were not used, by reason, besides those without a partner.
        formats: How the images arrive, by side.
        incompatible_qos: Sentences about publishers whose QoS does not match, with both policies.
        unusable: Sentences about images that cannot be read.
    """

    counts: PairCounts
    added: PairCounts
    elapsed_s: float
    receiving: bool = True
    age_s: float = 0.0
    no_pair: str = ""
    nearest_s: float | None = None
    topics: Topics | None = None
    publishers: tuple[int, int] | None = None
    drops: Mapping[str, int] = field(default_factory=dict)
    formats: Mapping[Side, ImageFormat] = field(default_factory=dict)
    incompatible_qos: tuple[str, ...] = ()
    unusable: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class CameraInfoReport:
    """The cameras, as far as they are known.

    Attributes:
        source: "CameraInfo", or "parameters rig.*"; with what R turns, where it is a corrected CameraInfo.
        rig: The rig, None as long as it is not known.
        missing: Sentence about each CameraInfo that has not come yet, "" when both have.
        faults: Sentences about what is invalid.
        doubts: Sentences about what is unusual, but usable.
    """

    source: str
    rig: StereoRig | None = None
    missing: str = ""
    faults: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Snapshot:
    """The state of the node at the time of a report.

    Attributes:
        node: Full name of the node.
        road_frame: Frame of the road.
        camera_frame: Frame of the camera, reported as the hardware id.
        calibration: The calibration.
        images: The images that arrive.
        camera_info: The cameras.
    """

    node: str
    road_frame: str
    camera_frame: str
    calibration: CalibrationReport
    images: ImagesReport
    camera_info: CameraInfoReport


def diagnostics_message(stamp: Time, snapshot: Snapshot) -> DiagnosticArray:
    """Return the report of the node: calibration, images, camera info.

    Args:
        stamp: Time of the report.
        snapshot: State of the node.
    """
    parts = {
        "calibration": _calibration(snapshot),
        "images": _images(snapshot.images),
        "camera info": _camera_info(snapshot.camera_info),
    }
    reports = [
        StatusReport(level, f"{snapshot.node}: {topic}", text, values)
        for topic, (level, text, values) in parts.items()
    ]
    message = DiagnosticArray(status=[_status_message(each, snapshot.camera_frame) for each in reports])
    message.header.stamp = stamp
    return message


def _status_message(report: StatusReport, hardware_id: str) -> DiagnosticStatus:
    return DiagnosticStatus(
        level=bytes([report.level]),
        name=report.name,
        message=report.message,
        hardware_id=hardware_id,
        values=[KeyValue(key=key, value=value) for key, value in report.values.items()],
    )


def age_text(age_s: float) -> str:
    """Return a time as text of its two largest units: ``5 min 12 s``."""
    if not math.isfinite(age_s):
        return "unknown"
    remainder_s, parts = max(0, int(age_s)), []
    for size_s, unit in _AGE_UNITS:
        number, remainder_s = divmod(remainder_s, size_s)
        if number or unit == "s":
            parts.append(f"{number} {unit}")
        elif parts:
            break
    return " ".join(parts[:2])


_Part = tuple[StatusLevel, str, dict[str, str]]


def _calibration(snapshot: Snapshot) -> _Part:
    report = snapshot.calibration
    values = {"state": report.state}
    if report.reason:
        values["state_reason"] = report.reason
    if report.progress is not None:
        values |= report.progress.values()
    values |= _estimate(report)
    if report.active is not None:
        values |= report.transform.values(report.active.result.travel)
    values |= _alignment(report)
    values["watch"] = report.watch
    values["road_pose"] = report.road_pose
    values |= {"last_answer": report.last_answer, **_frames(report.frames)}
    values |= {"road_frame": snapshot.road_frame, "camera_frame": snapshot.camera_frame}
    level, text = _verdict(report)
    return level, text, values


def _verdict(report: CalibrationReport) -> tuple[StatusLevel, str]:
    """Return level and sentence of the calibration."""
    level = _STATE_LEVELS.get(report.state, WARN)
    refused = report.last_success is False
    if report.state == "calibrating":
        return level, _calibrating(report)
    if report.active is None:
        return level, f"{report.state}: {report.last_answer if refused else report.reason}"
    text = f"{report.state}: {_described(report.active)}, {age_text(report.age_s)} old"
    if level != OK:
        text = f"{report.state}: {report.reason}; {_described(report.active)}"
    if level == OK:
        if refused:
            return (
                WARN,
                f"the last call was refused: {report.last_answer}; the calibration from before stays active",
            )
        if report.active.save_failed:
            return WARN, f"{text}; {report.active.saved}"
        turned = report.alignment.message or _misalignment(report.active)
        wrong = (*report.transform.faults, turned, _lateness(report.active))
        if any(wrong):
            return WARN, "; ".join([text, *filter(None, wrong)])
    return level, text


def _calibrating(report: CalibrationReport) -> str:
    """Return the sentence while a call is running."""
    text = "calibrating" if report.progress is None else f"calibrating: {report.progress.text}"
    return text if report.active is None else f"{text}; active meanwhile: {_described(report.active)}"


def _misalignment(active: ActiveCalibration) -> str:
    """Return how the right camera is turned; "" where nothing is to be done about it."""
    alignment = report_alignment(active.result.alignment, active.rig)
    return alignment.message if alignment.verdict.is_fault else ""


def _lateness(active: ActiveCalibration) -> str:
    """Return by how much right images are late; "" where that is not sure."""
    delay = active.result.delay
    return describe_delay(delay) if is_late(delay) else ""


def _described(active: ActiveCalibration) -> str:
    extrinsics, std = active.result.extrinsics, active.result.std
    if extrinsics is None or std is None:
        return "no numbers"
    travel = active.result.travel
    yaw = f", {travel.describe_yaw()}" if travel is not None and travel.tells_yaw else ""
    return extrinsics.describe(std) + yaw


def _estimate(report: CalibrationReport) -> dict[str, str]:
    """Return the active calibration; nothing without one."""
    active = report.active
    if active is None:
        return {}
    values = estimate_values(active.result)
    return values and number_values({"age_s": report.age_s}) | values | {"saved": active.saved or "no"}


def _alignment(report: CalibrationReport) -> dict[str, str]:
    """Return how the right camera is turned: by the calibration, and by the watch since then."""
    active = report.active
    if active is None:
        return {}
    finding = report.alignment
    values = alignment_values(active.result.alignment, active.rig) | {
        "alignment_state": str(finding.state),
        **alignment_numbers("alignment_now", finding.present),
        "alignment_now_frames": str(finding.frames),
        **delay_values(active.result.delay),
    }
    return values | ({"alignment_change": finding.message} if finding.message else {})


def _frames(frames: FrameStatistics) -> dict[str, str]:
    values = {
        "frames_accepted": str(frames.accepted),
        "frames_rejected": str(sum(frames.rejected.values())),
        **{f"rejected_{reason}": str(count) for reason, count in frames.rejected.items()},
    }
    if frames.last_rejection is not None:
        values |= rejection_values("last_rejection", frames.last_rejection)
        values |= number_values({"last_rejection_age_s": frames.last_rejection_age_s})
    if frames.total:
        times = {"time_per_frame_s": frames.last_s, "time_per_frame_mean_s": frames.mean_s}
        values |= number_values(times | {"time_per_frame_longest_s": frames.longest_s})
    return values


def _images(report: ImagesReport) -> _Part:
    added, elapsed_s = report.added, max(report.elapsed_s, _LEAST_ELAPSED_S)
    rates = [f"{count / elapsed_s:.1f}" for count in (added.left, added.right, added.pairs)]
    values = dict(zip(("left_rate_hz", "right_rate_hz", "pair_rate_hz"), rates, strict=True))
    values |= {name: str(getattr(report.counts, name)) for name in report.counts.__slots__}
    values |= {f"dropped_{reason}": str(count) for reason, count in report.drops.items()}
    rates_age_s = 0.0 if report.receiving else report.age_s
    values |= number_values({"nearest_stamp_difference_s": report.nearest_s, "rates_age_s": rates_age_s})
    for side, found in report.formats.items():
        if found.is_raw:
            values |= {f"{side}_width_px": str(found.width), f"{side}_height_px": str(found.height)}
        values[f"{side}_encoding"] = found.encoding
    if report.topics is not None:
        values |= {"left_topic": report.topics.left, "right_topic": report.topics.right}
    if report.publishers is not None:
        values["left_publishers"], values["right_publishers"] = map(str, report.publishers)
    values["incompatible_qos"] = "; ".join(report.incompatible_qos) or "none"
    faults = (*report.incompatible_qos, *report.unusable)
    if faults:
        return ERROR, "; ".join(faults), values
    ago = "" if report.receiving else f"; looked at {age_text(report.age_s)} ago, as nobody wants images"
    if not added.pairs:
        if not report.receiving and not report.no_pair:
            return OK, "not listening: images are read when they are wanted", values
        return WARN, (report.no_pair or f"no pairs: left {rates[0]} Hz, right {rates[1]} Hz") + ago, values
    return OK, f"{rates[2]} pairs per second (left {rates[0]} Hz, right {rates[1]} Hz){ago}", values


def _camera_info(report: CameraInfoReport) -> _Part:
    rig = report.rig
    values = {"source": report.source}
    if rig is not None:
        values |= rig_values(rig)
    values["faults"] = "; ".join(report.faults) or "none"
    values["doubts"] = "; ".join(report.doubts) or "none"
    if report.faults:
        return ERROR, values["faults"], values
    if report.missing or rig is None:
        return WARN, report.missing or "the rig is not known yet", values
    if report.doubts:
        return WARN, values["doubts"], values
    return OK, describe_rig(rig, report.source), values
