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

"""What a history is made of: folders of fleets and result files, as far as they are of one camera."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from ..core.camera.rig import StereoRig
from ..core.errors import ConfigError, RigError, printable
from ..core.geometry.alignment import ALIGNMENT_NAMES, ALIGNMENT_STD_NAMES
from ..core.geometry.pose import POSE_COMPONENTS
from ..files.result_file import load_result
from ..files.saved_result import SavedResult, check_fits, same_images
from .history import DriveResult, Known
from .outcome import BagOutcome, Status, rig_of_text
from .store import read_outcomes

# Earlier stamps are times of a simulation, or those of a folder of images: September 2001.
_FIRST_CLOCK_S = 1e9


@dataclass(frozen=True, slots=True)
class Source:
    """A result with what tells its camera.

    Attributes:
        drive: The result.
        rig: The rig; None where it is not known.
        topics: Topics of the images; None where they are not known.
    """

    drive: DriveResult
    rig: StereoRig | None
    topics: tuple[str, str] | None = None


def read_sources(paths: Sequence[Path], page_folder: Path) -> tuple[list[Source], list[str]]:
    """Read folders of fleets and result files.

    Args:
        paths: Folders that ``fleet`` has written, and files that the node or ``replay`` has.
        page_folder: Where the page will be, for links to reports.

    Returns:
        The results in the order of the paths, and a sentence for each that cannot be used.

    Raises:
        ConfigError: A path is neither.
    """
    sources: list[Source] = []
    problems: list[str] = []
    for path in paths:
        if path.is_dir():
            outcomes, damaged = read_outcomes(path)
            problems += damaged
            sources += (_of_outcome(outcome, path, page_folder) for outcome in outcomes)
            continue
        saved = load_result(path)
        if not saved.is_of_mount:
            problems.append(
                f"{printable(str(path))}: its standard deviations may be those of one moment, which says too "
                "little of the mount; calibrate anew with this version"
            )
            continue
        sources.append(_of_saved(saved, path))
    return sources, problems


def of_one_camera(sources: Iterable[Source]) -> tuple[list[DriveResult], list[str]]:
    """Return the results of one camera: the one with the most calibrations, of several such the first.

    Args:
        sources: In any order; the first one is that by time, where all have one.

    Returns:
        The results, and a sentence for each that is of another camera. What has no calibration stays: it is
        not compared.
    """
    ordered = in_order(sources)
    calibrated = [source for source in ordered if source.drive.known]
    cameras: list[list[Source]] = []
    for source in calibrated:
        same = next((camera for camera in cameras if not _why_another(camera[0], source)), None)
        if same is None:
            cameras.append([source])
        else:
            same.append(source)
    if not cameras:
        return [source.drive for source in ordered], []
    most = max(cameras, key=len)
    of_others = {id(source) for camera in cameras if camera is not most for source in camera}
    problems = [
        f"{source.drive.name}: {_why_another(most[0], source)}"
        for source in calibrated
        if id(source) in of_others
    ]
    return [source.drive for source in ordered if id(source) not in of_others], problems


def in_order(sources: Iterable[Source]) -> list[Source]:
    """Return results by time where all have one, else as they are."""
    given = list(sources)
    if any(source.drive.stamp_s is None for source in given):
        return given
    return sorted(given, key=lambda source: source.drive.stamp_s or 0.0)


def _why_another(reference: Source, source: Source) -> str:
    """Return why a result is of another camera than the reference, "" where it is of the same."""
    if reference.rig is None or source.rig is None:
        return "it does not say of which rig it is"
    try:
        check_fits(reference.rig, source.rig)
    except ConfigError as error:
        return str(error).partition(";")[0]
    known = reference.topics is not None and source.topics is not None
    if known and reference.topics and source.topics and not same_images(reference.topics, source.topics):
        return f"it is of the images of {' and '.join(source.topics)}, the first one of other images"
    return ""


def _of_outcome(outcome: BagOutcome, folder: Path, page_folder: Path) -> Source:
    known: dict[str, Known] = {}
    if outcome.extrinsics is not None and outcome.std is not None:
        pose, std = outcome.extrinsics, outcome.std
        known |= {each.name: Known(each.of(pose), each.of(std)) for each in POSE_COMPONENTS}
        others = [("yaw_rad", "yaw_std_rad")]
        pairs = zip(ALIGNMENT_NAMES, ALIGNMENT_STD_NAMES, strict=True)
        others += [(f"alignment_{name}", f"alignment_{std_name}") for name, std_name in pairs]
        for name, std_name in others:
            value, spread = getattr(outcome, name), getattr(outcome, std_name)
            if value is not None and spread is not None:
                known[name] = Known(value, spread)
    said = str(outcome.status).replace("_", " ")
    if outcome.with_reservations:
        said += ", with reservations"
    elif outcome.status is not Status.CALIBRATED and outcome.reason:
        said += f": {outcome.reason}"
    report = ""
    if outcome.report:
        report = quote(os.fsencode(os.path.relpath(folder / outcome.report, page_folder)))
    drive = DriveResult(outcome.bag, _clock(outcome.first_stamp_s), known, said, report, outcome.moves)
    try:
        rig = rig_of_text(outcome.rig)
    except RigError:
        rig = None
    topics = (outcome.left, outcome.right)
    return Source(drive, rig, topics if all(name.startswith("/") for name in topics) else None)


def _of_saved(saved: SavedResult, path: Path) -> Source:
    std = saved.std
    known = {each.name: Known(each.of(saved.extrinsics), each.of(std)) for each in POSE_COMPONENTS}
    travel, alignment = saved.evidence.travel, saved.alignment
    if travel is not None and travel.tells_yaw:
        known["yaw_rad"] = Known(travel.yaw_rad, float(travel.std[0]))
    if alignment is not None:
        values, stds = alignment.as_dict(), alignment.std_dict()
        for name, std_name in zip(ALIGNMENT_NAMES, ALIGNMENT_STD_NAMES, strict=True):
            if name in values and std_name in stds:
                known[f"alignment_{name}"] = Known(values[name], stds[std_name])
    said = "calibrated, with reservations" if saved.reservations else "calibrated"
    drive = DriveResult(printable(str(path)), _clock(saved.stamp_s), known, said)
    return Source(drive, saved.rig, saved.topics)


def _clock(stamp_s: float | None) -> float | None:
    return stamp_s if stamp_s is not None and stamp_s >= _FIRST_CLOCK_S else None
