"""A real car: every frame of a recording against the plane fitted to its dense disparity."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from stereo_selfcal import Calibrator, CalibratorConfig
from stereo_selfcal.bags import StereoBag

from .options import Options
from .table import Table

# Real recordings may not be copied into the project; where they lie beside it they are measured too.
_RECORDED = Path(__file__).resolve().parents[2] / "shared" / "data"
BAG = _RECORDED / "kitti_odometry02"
REFERENCE = _RECORDED / "kitti_odometry02_stereo_plane.csv"


def recorded_table(_: Options) -> Iterator[Table]:
    """Every frame of a recording of a real car against its stereo plane, as in the paper's Table V."""
    if not BAG.is_dir():
        return

    table = Table(
        "recorded",
        "A real car (KITTI odometry 02, 20 frames): difference to the plane fitted to dense disparity",
        [
            "frame",
            "verdict",
            "with texture.check",
            "height m",
            "pitch deg",
            "roll deg",
            "dh mm",
            "dpitch deg",
            "droll deg",
        ],
    )
    planes = np.loadtxt(REFERENCE, delimiter=",", skiprows=1)[:, 1:]
    differences = []
    recording = StereoBag(BAG)
    calibrator = Calibrator(recording.read_rig())
    strict = Calibrator(calibrator.rig, CalibratorConfig.from_mapping({"texture.check": 1}))
    n_strict = 0
    for index, frame in enumerate(recording.frames()):
        result = calibrator.add(frame.left, frame.right, frame.stamp_s)
        checked = strict.add(frame.left, frame.right, frame.stamp_s)
        n_strict += checked.accepted
        verdict = "accepted" if checked.accepted else str(checked.reason)
        if result.extrinsics is None:
            table.add(str(index), str(result.reason), verdict, *["-"] * 6)
            continue
        pose = result.extrinsics.as_array() * [1, math.degrees(1), math.degrees(1)]
        difference = (pose - planes[index]) * [1e3, 1, 1]
        differences.append(difference)
        table.add(
            str(index),
            "accepted",
            verdict,
            f"{pose[0]:.4f}",
            f"{pose[1]:+.3f}",
            f"{pose[2]:+.3f}",
            f"{difference[0]:+.0f}",
            f"{difference[1]:+.2f}",
            f"{difference[2]:+.2f}",
        )
    median = np.median(np.abs(differences), axis=0)
    table.add(
        "median",
        f"{len(differences)} accepted",
        f"{n_strict} accepted",
        "",
        "",
        "",
        *(f"{value:.2f}" for value in np.round(median, 2)),
    )
    yield table
