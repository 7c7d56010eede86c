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

"""The drive that the demo plays: ``python -m benchmarks.travel_drives.demo_bag`` renders it into ``bags``.

Half a minute in a suburb at 22 km/h: trees, houses, cars, a kerb, and bends in which lines are refused.
"""

from __future__ import annotations

import shutil
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from stereo_selfcal.synth.bag import SyntheticBag, write_recording
from stereo_selfcal.synth.scenes import FIRST_STAMP_S, RenderedPair

from ..second_worlds.mesh import Look, Material, Mesh, MeshBuilder
from .kinds import Course, Drive, Plan, drive
from .streets import Hour, Street, Surroundings, joined

BAG = Path(__file__).resolve().parents[2] / "bags" / "drive"
PLAN = Plan(5, 0, Course.WITH_BENDS, 30.0, "zed", 0.5, Surroundings.SUBURB, Hour.DAY)
RATE_HZ = 2.0
# Of JPEG. Cameras use 80 to 95; the recording is to be small.
_QUALITY_PERCENT = 72
# A kerb on the right, beside the edge line, and the pavement behind it.
_KERB_AT_M, _KERB_HEIGHT_M, _PAVEMENT_WIDTH_M = -2.6, 0.12, 2.2


def demo_drive() -> Drive:
    """Return the drive, with its kerb."""
    planned = drive(PLAN)
    film = replace(planned.film, street=_with_kerb(planned.film.street))
    times = np.arange(0.0, PLAN.duration_s - 1.0 / RATE_HZ, 1.0 / RATE_HZ)
    return replace(planned, film=film, times_s=times)


def _with_kerb(street: Street) -> Street:
    """Return a street with a kerb and a pavement on its right."""
    way = street.way
    cuts = way.cuts(-12.0, float(np.nanmax(street.along_m)))
    behind_m = _KERB_AT_M - _PAVEMENT_WIDTH_M
    foot, edge, back = (
        way.world(cuts, aside_m, height_m)
        for aside_m, height_m in ((_KERB_AT_M, 0.0), (_KERB_AT_M, _KERB_HEIGHT_M), (behind_m, _KERB_HEIGHT_M))
    )
    builder = MeshBuilder()
    stone = Look(Material.GROUND, 0.45, 0.1, 0.01)
    for near, far in ((foot, edge), (edge, back)):
        builder.add(np.stack([near[:-1], near[1:], far[1:], far[:-1]], axis=1), stone)
    kerb: Mesh = builder.build()
    middle = kerb.corners_m.mean(axis=1).astype(np.float32)
    along, *_ = way.lane(middle[:, 0], middle[:, 1])
    mesh = joined([kerb, street.mesh])
    return replace(street, mesh=mesh, along_m=np.concatenate([along.astype(np.float64), street.along_m]))


def _pairs(planned: Drive) -> Iterator[RenderedPair]:
    for time_s in planned.times_s.tolist():
        yield RenderedPair(FIRST_STAMP_S + time_s, *planned.film.pair(time_s))


def demo_bag(planned: Drive) -> SyntheticBag:
    """Return the recording, with what is true of it."""
    mounted, car = planned.film.mounted, planned.film.car
    truth = {
        "name": BAG.name,
        "description": "Half a minute in a suburb with trees, cars, a kerb and bends: calibrates",
        "expected": "calibrated",
        # The car at rest on its springs, on a straight level road of the usual fall.
        "height_m": car.camera_m[2],
        "pitch_rad": mounted.pitch_rad,
        "roll_rad": mounted.roll_rad,
        "yaw_rad": planned.yaw_rad,
        "n_frames": len(planned.times_s),
        "rate_hz": RATE_HZ,
        "speed_mps": planned.labels["speed_mps"],
        "jpeg_quality_percent": _QUALITY_PERCENT,
        "rig": planned.film.rig.to_mapping(),
    }
    return SyntheticBag(planned.film.rig, truth, _QUALITY_PERCENT)


def main() -> int:
    """Render the drive in place of the one that is there."""
    cv2.setNumThreads(1)
    if BAG.exists():
        shutil.rmtree(BAG)
    planned = demo_drive()
    write_recording(BAG, demo_bag(planned), _pairs(planned))
    sys.stdout.write(f"{BAG}: {sum(each.stat().st_size for each in BAG.iterdir()) / 1e6:.1f} MB\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
