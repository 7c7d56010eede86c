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

"""Stereo pairs of roads that others recorded or rendered, each with where its road is.

They may not be copied into the project. Where they lie beside it, in shared/data, they are measured.
Otherwise :class:`.NothingToMeasureError` says so.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from stereo_selfcal import StereoRig
from stereo_selfcal.bags import StereoBag
from stereo_selfcal.core.types import Image

from .frames import Array
from .table import NothingToMeasureError

_BESIDE = Path("shared") / "data"
_PARENTS = Path(__file__).resolve().parents
# Beside the project, or beside a folder that holds several checkouts of it.
DATA = next((parent / _BESIDE for parent in _PARENTS if (parent / _BESIDE).is_dir()), _PARENTS[2] / _BESIDE)
BAG = DATA / "kitti_odometry02"
BAG_REFERENCE = DATA / "kitti_odometry02_stereo_plane.csv"
FRAMES = DATA / "kitti_frames"
SEQUENCE = DATA / "kitti_odometry07"
ROADS = DATA / "roads"
WORLDS = DATA / "worlds"

STRAIGHT = "straight_lines"

# Systematic differences of the references of KITTI (README of the data), mm, deg, deg: the height by lidar
# is 15 mm more than that of the stereo pair; the plane of dense disparity is 4 mm lower and 0.1 deg more
# nose-up.
LIDAR_OFFSET = np.array([-15.0, 0.0, 0.0])
DISPARITY_OFFSET = np.array([4.0, 0.1, 0.0])
# Standard deviations of the references (README of the data), mm, deg, deg.
LIDAR_STD = np.array([3.0, 0.02, 0.05])
DISPARITY_STD = np.array([5.0, 0.05, 0.2])
EXACT = np.zeros(3)
# The mount of the sequence, of which no frame has a reference of its own: the car pitches and rolls.
SEQUENCE_MEAN = np.array([1640.0, 1.05, 0.31])

_UNKNOWN = np.full(3, np.nan)


@dataclass(frozen=True, slots=True, eq=False)
class RoadPair:
    """A stereo pair and where its road is.

    Attributes:
        source: The set it belongs to.
        name: Of the pair within its set.
        tag: What kind of road it shows.
        expected: "accepted", "welcome" (to be accepted if that is right), or "refused".
        rig: Intrinsics and baseline.
        left: (H, W) uint8 image of the left camera.
        right: The same of the right camera.
        low: Least height [mm], pitch and roll [deg] by the reference; NaN where unknown.
        high: Greatest ones.
        reference_std: Standard deviations of the reference, in the same units; infinite where the reference
            is that of the mount, and the motion of the car is not known.
    """

    source: str
    name: str
    tag: str
    expected: str
    rig: StereoRig
    left: Image
    right: Image
    low: Array = field(default_factory=_UNKNOWN.copy)
    high: Array = field(default_factory=_UNKNOWN.copy)
    reference_std: Array = field(default_factory=EXACT.copy)


@dataclass(frozen=True, slots=True)
class RoadReference:
    """What is known of one pair of the set "roads" (table of its README).

    Attributes:
        folder: Its folder.
        name: Name of its images, with the ending.
        expected: As of :class:`RoadPair`.
        low: Least height [m], pitch, roll [deg] of the planes that were fitted to dense disparity.
        high: Greatest ones.
    """

    folder: str
    name: str
    expected: str
    low: tuple[float, float, float] = (np.nan, np.nan, np.nan)
    high: tuple[float, float, float] = (np.nan, np.nan, np.nan)


ROAD_REFERENCES = (
    RoadReference(
        "cityscapes_cologne",
        "cologne_000088_000019.png",
        "accepted",
        (1.195, 2.02, -0.7),
        (1.200, 2.04, -0.4),
    ),
    RoadReference("drivingstereo", "1.png", "accepted", (1.772, 1.16, -0.16), (1.777, 1.18, -0.01)),
    RoadReference("karlsruhe", "1.png", "welcome", (1.563, 5.19, 0.1), (1.563, 5.19, 0.3)),
    RoadReference("karlsruhe", "2.png", "welcome", (1.54, 4.70, 0.8), (1.54, 4.70, 0.8)),
    RoadReference("karlsruhe", "4.png", "welcome", (1.585, 5.68, -0.9), (1.585, 5.68, -0.9)),
    RoadReference("karlsruhe", "viso_c.png", "welcome"),
    RoadReference("synthia", "1.png", "welcome", (1.316, 6.77, 0.0), (1.316, 6.77, 0.0)),
    RoadReference("korea_unrectified", "1.jpg", "refused"),
    RoadReference("sid_zed", "Campus_CCW_Clear_Day_002.png", "refused"),
    RoadReference("sid_zed", "Campus_CW_Snow_Dusk_024.png", "refused"),
    RoadReference("sid_zed", "City_Rain_Day_013.png", "welcome", (1.06, -2.3, np.nan), (1.06, -2.3, np.nan)),
)


def kitti_frames() -> Iterator[RoadPair]:
    """Yield single frames of several drives, with lidar."""
    rig = _rig(FRAMES)
    with (FRAMES / "truth.csv").open(newline="", encoding="utf-8") as lines:
        for row in csv.DictReader(lines):
            lidar = np.array(
                [float(row[f"lidar_{name}"] or "nan") for name in ("height_m", "pitch_deg", "roll_deg")]
            )
            reference = lidar * [1e3, 1.0, 1.0] + LIDAR_OFFSET
            # All their roads can be seen, and lines on the straight ones.
            expected = "accepted" if row["tag"] == STRAIGHT else "welcome"
            images = _images(FRAMES, f"{row['id']}.png")
            yield RoadPair(
                "kitti_frames", row["id"], row["tag"], expected, rig, *images, reference, reference, LIDAR_STD
            )


def kitti_odometry02() -> Iterator[RoadPair]:
    """Yield the frames of a recording, with the plane fitted to their dense disparity."""
    _need(BAG, BAG_REFERENCE)
    planes = np.loadtxt(BAG_REFERENCE, delimiter=",", skiprows=1)[:, 1:] * [1e3, 1.0, 1.0] + DISPARITY_OFFSET
    recording = StereoBag(BAG)
    rig = recording.read_rig()
    for index, (frame, plane) in enumerate(zip(recording.frames(), planes, strict=True)):
        yield RoadPair(
            "kitti_odometry02",
            f"{index:02d}",
            "recording",
            "accepted",
            rig,
            frame.left,
            frame.right,
            plane,
            plane,
            DISPARITY_STD,
        )


def kitti_odometry07() -> Iterator[RoadPair]:
    """Yield the frames of a street with hardly any paint; the mean of the mount alone is known."""
    rig = _rig(SEQUENCE)
    unknown_motion = np.full(3, np.inf)
    for path in sorted((SEQUENCE / "left").iterdir()):
        yield RoadPair(
            "kitti_odometry07",
            path.stem,
            "street",
            "accepted",
            rig,
            *_images(SEQUENCE, path.name),
            SEQUENCE_MEAN,
            SEQUENCE_MEAN,
            unknown_motion,
        )


def roads() -> Iterator[RoadPair]:
    """Yield pairs of other cameras."""
    for known in ROAD_REFERENCES:
        folder = ROADS / known.folder
        low, high = (np.array(values) * [1e3, 1.0, 1.0] for values in (known.low, known.high))
        yield RoadPair(
            "roads",
            f"{known.folder}/{Path(known.name).stem}",
            known.folder,
            known.expected,
            _rig(folder),
            *_images(folder, known.name),
            low,
            high,
            DISPARITY_STD,
        )


def worlds() -> Iterator[RoadPair]:
    """Yield rendered pairs; the tag is "good", "bad", or "turned" where the right camera is."""
    _need(WORLDS)
    for path in sorted(WORLDS.glob("*/case.json")):
        case = json.loads(path.read_text(encoding="utf-8"))
        good = case["expected"] == "accept"
        truth = case["truth"]
        pose = np.array([truth["height_m"] * 1e3, truth["pitch_deg"], truth["roll_deg"]])
        tag = "good" if good else "turned" if "_err" in case["kind"] else "bad"
        left, right = (_read(path.parent / f"{side}.png") for side in ("left", "right"))
        yield RoadPair(
            "worlds",
            path.parent.name,
            tag,
            "accepted" if good else "welcome",
            StereoRig(**case["rig"]),
            left,
            right,
            pose,
            pose,
        )


SOURCES: dict[str, Callable[[], Iterator[RoadPair]]] = {
    "kitti_frames": kitti_frames,
    "kitti_odometry02": kitti_odometry02,
    "kitti_odometry07": kitti_odometry07,
    "roads": roads,
    "worlds": worlds,
}


def pairs_of(sources: tuple[str, ...], step: int = 1) -> Iterator[RoadPair]:
    """Yield every pair of some sets, or every so many of each.

    Raises:
        NothingToMeasureError: One of the sets is not there.
    """
    for source in sources:
        for index, pair in enumerate(SOURCES[source]()):
            if index % step == 0:
                yield pair


def _need(*paths: Path) -> None:
    missing = [path for path in paths if not path.exists()]
    if missing:
        raise NothingToMeasureError(
            f"there is no {missing[0]}: the pairs of others are no part of the project, and are measured "
            "where they lie beside it"
        )


def _rig(folder: Path) -> StereoRig:
    path = folder / "rig.json"
    _need(path)
    return StereoRig(**json.loads(path.read_text(encoding="utf-8")))


def _images(folder: Path, name: str) -> tuple[Image, Image]:
    return _read(folder / "left" / name), _read(folder / "right" / name)


def _read(path: Path) -> Image:
    _need(path)
    return np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), np.uint8)
