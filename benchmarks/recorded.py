"""Real cars: frames of recordings against lidar, or against the plane fitted to their dense disparity."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from stereo_selfcal import Calibrator, Extrinsics, StereoRig
from stereo_selfcal.bags import StereoBag
from stereo_selfcal.core.geometry.plane import plane_from_pose
from stereo_selfcal.core.results import CalibrationResult
from stereo_selfcal.core.types import Image

from .frames import READABLE, Array, pose_of_plane
from .options import Options
from .table import Table

# Real recordings may not be copied into the project; where they lie beside it they are measured too.
_RECORDED = Path(__file__).resolve().parents[2] / "shared" / "data"
BAG = _RECORDED / "kitti_odometry02"
REFERENCE = _RECORDED / "kitti_odometry02_stereo_plane.csv"
FRAMES = _RECORDED / "kitti_frames"

# Systematic differences of the references (README of the data): the lidar's height is 15 mm more than that of
# the stereo pair; the plane of dense disparity is 4 mm lower and 0.1 deg more nose-up. mm, deg, deg.
LIDAR_OFFSET = np.array([-15.0, 0.0, 0.0])
DISPARITY_OFFSET = np.array([4.0, 0.1, 0.0])

# A result that is farther off is wrong, whatever it says of itself [mm, deg, deg].
WRONG = np.array([60.0, 0.5, 1.2])

# The strips of road that the plane of dense disparity is fitted to, and how: as the reference of the data.
STRIPS_M = (1.2, 1.6, 2.0, 3.0, 4.0, 6.0)
N_DISPARITIES, BLOCK_PX, FIXED_POINT = 128, 5, 16
STRIP_NEAR_M, STRIP_FAR_M = 5.5, 20.0
STRIP_INLIER_PX, STRIP_ROUNDS = 1.0, 10

STRAIGHT = "straight_lines"  # tag of frames of which a calibration is expected

_MEASURED = ["dh mm", "dpitch deg", "droll deg", "std mm", "std deg", "std deg roll", "stages"]


@dataclass(frozen=True, slots=True, eq=False)
class Recorded:
    """A recorded pair and where the road is by another sensor.

    Attributes:
        name: Of the frame.
        tag: What kind of road it shows.
        rig: Intrinsics and baseline.
        left: (H, W) uint8 image of the left camera.
        right: The same of the right camera.
        reference: Height [mm], pitch and roll [deg], systematic differences removed; NaN where unknown.
    """

    name: str
    tag: str
    rig: StereoRig
    left: Image
    right: Image
    reference: Array


def recorded_table(_: Options) -> Iterator[Table]:
    """Every recorded frame against its reference, the recording's as in the paper's Table V."""
    if BAG.is_dir():
        yield _recording()
        yield _strips()
    if FRAMES.is_dir():
        yield from _frames()


def _recording() -> Table:
    table = Table(
        "recorded",
        "A real car (KITTI odometry 02, 20 frames): difference to the plane fitted to dense disparity",
        ["frame", "verdict", *_MEASURED],
        "Height + 4 mm and pitch + 0.1 deg, what that plane is off on other frames with lidar.",
    )
    frames = list(recording_frames())
    calibrator = Calibrator(frames[0].rig)
    accepted: list[tuple[CalibrationResult, Array]] = []
    for index, frame in enumerate(frames):
        result = calibrator.add(frame.left, frame.right, float(index))
        table.add(frame.name, *_row(result, frame.reference))
        if result.accepted:
            accepted.append((result, frame.reference))
    _summary(table, accepted, [], "median", "of accepted")
    fused = calibrator.estimate
    table.add("fused", *_row(fused, np.mean([frame.reference for frame in frames], axis=0)))
    return table


def _strips() -> Table:
    """Return how the plane of dense disparity depends on how much of the road it is fitted to."""
    table = Table(
        "recorded_strips",
        "The same recording: the plane of dense disparity, by the strip of road it is fitted to",
        ["strip, to either side of the camera", "dh mm", "dpitch deg", "droll deg"],
        "OpenCV SGBM, least squares on what lies within a pixel of the plane, 5.5 to 20 m ahead; mean of 20 "
        "frames less the mean of the reference, as above. Ours is the plane of the own lane: a road that is "
        "bent across has another one for each strip.",
    )
    frames = list(recording_frames())
    reference = np.mean([frame.reference for frame in frames], axis=0)
    points = [_disparities(frame) for frame in frames]
    for half_width_m in STRIPS_M:
        poses = [
            _strip_pose(frame, of_frame, half_width_m) for frame, of_frame in zip(frames, points, strict=True)
        ]
        off = np.mean(poses, axis=0) + DISPARITY_OFFSET - reference
        table.add(f"{half_width_m:g} m", f"{off[0]:+.0f}", f"{off[1]:+.2f}", f"{off[2]:+.2f}")
    return table


def _disparities(frame: Recorded) -> tuple[Array, Array]:
    """Return rays (1, y, z) of the left camera, (N, 3), and their disparities [px], (N,)."""
    matcher = cv2.StereoSGBM_create(minDisparity=0, numDisparities=N_DISPARITIES, blockSize=BLOCK_PX)
    disparity = matcher.compute(frame.left, frame.right).astype(np.float64) / FIXED_POINT
    rows, columns = np.nonzero(disparity > 0)
    rig = frame.rig
    rays = np.stack([np.ones(len(rows)), (rig.cx - columns) / rig.fx, (rig.cy - rows) / rig.fy], axis=1)
    return rays, disparity[rows, columns]


def _strip_pose(frame: Recorded, points: tuple[Array, Array], half_width_m: float) -> Array:
    """Return height [mm], pitch and roll [deg] of the plane of a strip of road."""
    rays, disparity = points
    rig = frame.rig
    start = Extrinsics.from_array((frame.reference - DISPARITY_OFFSET) / READABLE)
    plane = plane_from_pose(start, rig).coefficients
    depth = rig.fx * rig.baseline_m / disparity
    aside = rays[:, 1] * depth + rig.baseline_m / 2.0
    strip = (np.abs(aside) < half_width_m) & (depth > STRIP_NEAR_M) & (depth < STRIP_FAR_M)
    rays, disparity = rays[strip], disparity[strip]
    for _ in range(STRIP_ROUNDS):
        near = np.abs(rays @ plane - disparity) < STRIP_INLIER_PX
        plane = np.linalg.lstsq(rays[near], disparity[near], rcond=None)[0]
    pose: Array = np.array(pose_of_plane(plane, rig)) * READABLE
    return pose


def recording_frames() -> Iterator[Recorded]:
    """Yield the frames of the recording."""
    planes = np.loadtxt(REFERENCE, delimiter=",", skiprows=1)[:, 1:] * [1e3, 1, 1] + DISPARITY_OFFSET
    recording = StereoBag(BAG)
    rig = recording.read_rig()
    for index, (frame, plane) in enumerate(zip(recording.frames(), planes, strict=True)):
        yield Recorded(str(index), "recording", rig, frame.left, frame.right, plane)


def single_frames() -> Iterator[Recorded]:
    """Yield the frames of other drives."""
    rig = StereoRig(**json.loads((FRAMES / "rig.json").read_text()))
    with (FRAMES / "truth.csv").open(newline="") as lines:
        for row in csv.DictReader(lines):
            left, right = (
                np.asarray(
                    cv2.imread(str(FRAMES / side / f"{row['id']}.png"), cv2.IMREAD_GRAYSCALE), np.uint8
                )
                for side in ("left", "right")
            )
            lidar = [float(row[f"lidar_{name}"] or "nan") for name in ("height_m", "pitch_deg", "roll_deg")]
            reference = np.array(lidar) * [1e3, 1, 1] + LIDAR_OFFSET
            yield Recorded(row["id"], row["tag"], rig, left, right, reference)


def _frames() -> Iterator[Table]:
    table = Table(
        "recorded_frames",
        "Real cars (KITTI, 42 frames of other drives): difference to lidar - 15 mm",
        ["frame", "tag", "verdict", *_MEASURED],
    )
    by_tag: dict[str, list[tuple[CalibrationResult, Array]]] = {}
    counts: dict[str, int] = {}
    for frame in single_frames():
        result = Calibrator(frame.rig).add(frame.left, frame.right)
        table.add(frame.name, frame.tag, *_row(result, frame.reference))
        counts[frame.tag] = counts.get(frame.tag, 0) + 1
        if result.accepted:
            by_tag.setdefault(frame.tag, []).append((result, frame.reference))
    for tag, accepted in by_tag.items():
        for what in ("median", "90 %"):
            _summary(table, accepted, [tag], what, f"{len(accepted)} of {counts[tag]}")
    yield table


def _error(result: CalibrationResult, reference: Array) -> Array:
    assert result.extrinsics is not None
    error: Array = result.extrinsics.as_array() * READABLE - reference
    return error


def _row(result: CalibrationResult, reference: Array) -> list[str]:
    if result.std is None:
        return [str(result.reason), *["-"] * len(_MEASURED)]
    error, std = _error(result, reference), result.std.as_array() * READABLE
    wrong = bool(np.any(np.abs(error) > WRONG))
    last = list(result.stages)[-1] if result.stages else ""
    return [
        "accepted, wrong" if wrong else "accepted",
        f"{error[0]:+.0f}",
        f"{error[1]:+.2f}",
        f"{error[2]:+.2f}",
        f"{std[0]:.1f}",
        f"{std[1]:.2f}",
        f"{std[2]:.2f}",
        last,
    ]


def _summary(
    table: Table, accepted: list[tuple[CalibrationResult, Array]], cells: list[str], what: str, verdict: str
) -> None:
    """Add quantiles of the absolute errors, and how they compare with what was promised."""
    if not accepted:
        return
    errors = np.abs([_error(result, reference) for result, reference in accepted])
    std = np.array([result.std.as_array() * READABLE for result, _ in accepted if result.std is not None])
    at = np.quantile(errors, 0.5 if what == "median" else 0.9, axis=0)
    ratio = np.sqrt(np.mean((errors / std) ** 2, axis=0))
    shown = [f"{at[0]:.1f}", f"{at[1]:.3f}", f"{at[2]:.3f}"]
    promised = " / ".join(f"{value:.2f}" for value in ratio)
    table.add(what, *cells, verdict, *shown, "", "", "", f"error / std: RMS {promised}")
