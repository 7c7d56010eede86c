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

"""The work of a worker: it calibrates a recording, or a stretch of a long one, and returns the outcome."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from .. import __version__
from ..bags import StereoFrame
from ..bags.remarks import remarks_on
from ..core.calibrator import Calibrator
from ..core.camera.pairing import PairCounts
from ..core.camera.rig import StereoRig
from ..core.config import CalibratorConfig
from ..core.errors import SelfcalError, one_line
from ..core.results import CalibrationResult
from ..offline import BagSource, FrameSource, Replay, Selection, calibrate_recording
from ..offline.frame import FrameHead
from ..offline.opening import open_source
from ..offline.pool import calibrate_in_order
from ..offline.pool import stretches_of as parts_of
from ..offline.run import assemble_replay
from .workers import Failure, internal_error, progress

# What is read before a stretch, over the part of the time in which frames may start from each other: that
# part, and as much again, as times of recording differ from stamps.
_LEAD = 2.0


@dataclass(frozen=True, slots=True)
class FleetSettings:
    """How every recording of a fleet is calibrated; the same as the options of ``replay``.

    Attributes:
        config: Settings of the calibrator.
        left: Image topic of the left camera, None to find it.
        right: The same of the right camera.
        tolerance_s: Greatest difference of the header stamps of a pair [s].
        rig: The rig of all recordings, None for that of each.
        selection: Which frames are used of each.
        raw: Whether the images are to be undistorted and rectified.
        left_info: CameraInfo topic of the left camera, None to find it.
        right_info: The same of the right camera.
        rectified: Whether the images are rectified whatever their topics are called.
    """

    config: CalibratorConfig
    left: str | None = None
    right: str | None = None
    tolerance_s: float = 0.0
    rig: StereoRig | None = None
    selection: Selection = field(default_factory=Selection)
    raw: bool = False
    left_info: str | None = None
    right_info: str | None = None
    rectified: bool = False

    def to_mapping(self) -> dict[str, Any]:
        """Return all of it as plain values: equal settings give equal results."""
        return {
            "config": {name: value for name, value, _ in self.config.settings()},
            "left": self.left,
            "right": self.right,
            "tolerance_s": self.tolerance_s,
            "rig": None if self.rig is None else self.rig.to_mapping(),
            "selection": [
                self.selection.start_s,
                self.selection.end_s,
                self.selection.every,
                self.selection.max_frames,
            ],
            "raw": self.raw,
            "rectified": self.rectified,
            "infos": [self.left_info, self.right_info],
        }

    def open(self, path: Path) -> FrameSource:
        """Open a recording with these settings.

        Raises:
            SelfcalError: It cannot be read.
        """
        return open_source(
            [path],
            self.left,
            self.right,
            self.tolerance_s,
            self.rig,
            self.selection,
            self.raw,
            self.left_info,
            self.right_info,
            self.rectified,
        )


@dataclass(frozen=True, slots=True)
class Stretches:
    """A recording that is too long for one task.

    Attributes:
        selections: The stretches, one after the other.
    """

    selections: tuple[Selection, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Stretch:
    """The frames of one stretch, calibrated.

    Attributes:
        frames: Results of all its frames, in order.
        rig: The rig of the recording.
        topics: Topics of the left and of the right images.
        n_images: Left and right images of the whole recording.
        remarks: Sentences about anomalies of its cameras.
    """

    frames: list[tuple[FrameHead, CalibrationResult]]
    rig: StereoRig
    topics: tuple[str, str]
    n_images: tuple[int, int]
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Calibrated:
    """A recording, calibrated.

    Attributes:
        replay: Rows and estimate, as of ``replay``.
        topics: Topics of the left and of the right images.
    """

    replay: Replay
    topics: tuple[str, str]


def versions() -> dict[str, str]:
    """Return the versions that the numbers of a result depend on, besides the settings."""
    return {"stereo_selfcal": __version__, "numpy": np.__version__, "opencv": cv2.__version__}


def calibrate_bag(
    path: str, settings: FleetSettings, stretch_s: float | None = None
) -> Calibrated | Stretches | Failure:
    """Calibrate one recording, or say that it is better done in stretches.

    Args:
        path: The recording; this process sees it under the same name as the one that asks.
        settings: How.
        stretch_s: A recording that is longer than this is to be done in stretches [s]; None for never.

    Returns:
        The outcome, always: a recording that cannot be read is none of the other recordings' business.
    """
    _be_a_worker()
    try:
        with settings.open(Path(path)) as source:
            stretches = None if stretch_s is None else stretches_of(source, settings, stretch_s)
            if stretches is not None:
                return stretches
            replay = calibrate_recording(source, settings.config, lambda _: progress())
            return Calibrated(replay, (source.left_name, source.right_name))
    except (SelfcalError, OSError) as error:
        return Failure(one_line(error))
    except Exception as error:  # noqa: BLE001  (a fault of ours must not end the other 10 000 recordings)
        return internal_error(error)


def stretches_of(source: FrameSource, settings: FleetSettings, stretch_s: float) -> Stretches | None:
    """Return the stretches of a long recording; None where it is short or cannot be divided.

    It can where no frame depends on those long before it: images pair by equal stamps, and frames are not
    counted.
    """
    selection = settings.selection
    countless = selection.every == 1 and selection.max_frames is None
    if not (isinstance(source, BagSource) and countless and settings.tolerance_s == 0):
        return None
    start_s = selection.start_s
    end_s = source.length_s if selection.end_s is None else min(selection.end_s, source.length_s)
    n = math.ceil((end_s - start_s) / stretch_s)
    if n < 2:
        return None
    # Counted in nanoseconds, borders fall between frames; the last one is as open as the selection.
    borders = [start_s + (end_s - start_s) * index / n for index in range(n)]
    ends = [*borders[1:], selection.end_s]
    return Stretches(
        tuple(replace(selection, start_s=a, end_s=b) for a, b in zip(borders, ends, strict=True))
    )


def calibrate_stretch(path: str, settings: FleetSettings, selection: Selection) -> Stretch | Failure:
    """Calibrate the frames of one stretch of a recording.

    Args:
        path: The recording.
        settings: How.
        selection: The stretch.

    Returns:
        All its frames; a failure where even one could not be read or is there twice, or there is none: such a
        recording is to be done as a whole, so that it ends where it would have ended.
    """
    _be_a_worker()
    whole = settings.selection
    # Frames start from those before, as far as a part of the time reaches.
    first_s = max(whole.start_s, selection.start_s - _LEAD * settings.config.known.cold_every_s)
    settings = replace(settings, selection=replace(selection, start_s=min(first_s, selection.start_s)))
    try:
        with settings.open(Path(path)) as source:
            calibrator = Calibrator(source.rig, settings.config)
            own_ns = source.start_ns + selection.start_ns
            if first_s <= whole.start_s:
                read = source.frames()
            else:
                read = _whole_stretches(source.frames(), settings.config, own_ns)
            frames = []
            for head, result in calibrate_in_order(read, calibrator, jobs=1):
                if head.recorded_ns >= own_ns or selection.whole:
                    frames.append((head, result))
                progress()
            if not frames:
                return Failure("a stretch without a frame")
            if isinstance(source, BagSource) and source.any_repeated:
                return Failure("images are there twice: how many is known of the whole recording only")
            topics = source.left_name, source.right_name
            return Stretch(frames, source.rig, topics, source.n_images, source.remarks)
    except Exception as error:  # noqa: BLE001  (whatever it is, the whole recording shows it again)
        return Failure(one_line(error))


def _whole_stretches(
    frames: Iterator[StereoFrame], config: CalibratorConfig, own_ns: int
) -> Iterator[StereoFrame]:
    """Yield the frames on which those from a time on may depend, and these.

    Args:
        frames: Frames in order, from some time before on.
        config: Settings.
        own_ns: The time [ns].

    Raises:
        SelfcalError: The frames do not begin early enough: stamps and times of recording differ.
    """
    for index, stretch in enumerate(parts_of(frames, config)):
        if stretch[-1].recorded_ns < own_ns:
            continue
        if index == 0 and stretch[0].recorded_ns < own_ns:
            raise SelfcalError("where frames start from those before is known of the whole recording only")
        yield from stretch


def join(stretches: Sequence[Stretch], settings: FleetSettings) -> Calibrated:
    """Return what comes out of the stretches of a recording, which is what comes out of the whole.

    Args:
        stretches: All of them, in order.
        settings: How they were calibrated.
    """
    first = stretches[0]
    frames = [frame for stretch in stretches for frame in stretch.frames]
    replay = assemble_replay(frames, Calibrator(first.rig, settings.config))
    # What was noticed in several stretches is said once.
    found = dict.fromkeys(remark for stretch in stretches for remark in stretch.remarks)
    remarks = (*replay.remarks, *found)
    if settings.selection.whole:  # nothing was amiss, so all images there are were read
        remarks += remarks_on(PairCounts(*first.n_images, len(frames)), first.n_images)
    return Calibrated(replace(replay, remarks=remarks), first.topics)


def make_report(path: str, settings: FleetSettings, calibrated: Calibrated) -> bytes | Failure:
    """Return the report of a calibrated recording as HTML.

    Args:
        path: The recording. The frames of the report's pictures are read again.
        settings: Settings of the calibration.
        calibrated: The calibrated recording.
    """
    from ..report.page import render_report  # noqa: PLC0415  (Jinja2 is for who wants reports)

    _be_a_worker()
    try:
        with settings.open(Path(path)) as source:
            return render_report(source, calibrated.replay).encode()
    except Exception as error:  # noqa: BLE001  (the numbers are there, whatever becomes of the report)
        return Failure(f"{type(error).__name__}: {one_line(error)}")


def _be_a_worker() -> None:
    """Limit this process to one thread, because other workers use the other cores."""
    cv2.setNumThreads(1)
