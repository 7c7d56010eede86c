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

"""How much to measure."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

RESULTS = Path(__file__).parent / "results"


@dataclass(frozen=True, slots=True)
class Options:
    """Sizes of the measurements.

    Attributes:
        poses: Random poses per noise level and surface.
        draws: Noise draws of the bias table.
        seeds: Runs of each optimiser per frame.
        repeats: Repetitions of a timing.
        false_alarms: Pictures without a road of each kind.
        worlds: Random worlds.
        structured_noise: Pictures of structured noise.
        kills: Writers of result files killed.
        mutations: Mutations of each kind of file.
        bag_mutations: Mutated recordings.
        watch_hours: Hours the watch is driven without a change, for each ride.
        bumps: Drives with each bump.
        soak_s: How long the node is soaked [s].
        fleet_bags: Recordings of the fleet.
        states: Mutations of the folder of a fleet.
        drives: Simulated drives of each kind.
        drive_frames: Frames of the rendered drive.
        all_sizes: Whether to go through all image sizes, or the smallest two only.
        sources: Sets of stereo pairs of roads; none for all of them.
        road_step: One pair out of so many of each set.
        processes: Processes that judge pairs.
        seed: Seed of the worlds of the second generator.
        only: The one of them that is written as a case, and not judged.
        kind: The only kind of them that is drawn.
        rig_roads: Rendered roads of each kind with every turn of the right camera.
        rig_worlds: Rendered roads of each kind and rig with a right camera drawn from its priors.
        rig_parts: Parts of the section of turned right cameras; none for all of them.
        turned: Whether worlds with a turned right camera are among them.
        folder: Where tables and plots go.
    """

    poses: int = 100
    draws: int = 200
    seeds: int = 50
    repeats: int = 20
    false_alarms: int = 200
    worlds: int = 2000
    structured_noise: int = 20_000
    kills: int = 200
    mutations: int = 500
    bag_mutations: int = 1000
    watch_hours: int = 60
    bumps: int = 30
    soak_s: float = 600.0
    fleet_bags: int = 200
    states: int = 500
    drives: int = 200
    drive_frames: int = 450
    all_sizes: bool = True
    sources: tuple[str, ...] = ()
    road_step: int = 1
    processes: int = 2
    seed: int = 1
    only: int | None = None
    kind: str | None = None
    turned: bool = False
    rig_roads: int = 6
    rig_worlds: int = 24
    rig_parts: tuple[str, ...] = ()
    folder: Path = RESULTS


# To see that everything runs; apart, so that nothing measured so thinly is quoted.
QUICK = Options(
    poses=5,
    draws=20,
    seeds=5,
    repeats=5,
    false_alarms=20,
    worlds=60,
    structured_noise=300,
    kills=20,
    mutations=50,
    bag_mutations=100,
    watch_hours=2,
    bumps=3,
    soak_s=60.0,
    fleet_bags=12,
    states=20,
    drives=5,
    drive_frames=60,
    all_sizes=False,
    road_step=6,
    folder=RESULTS / "quick",
)
