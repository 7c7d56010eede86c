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

"""Rigs and paint drawn from the stated priors: errors over standard deviations of pose and alignment."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from ..options import Options
from ..road_verdicts import in_processes
from ..table import Table
from .angles import AS_IT_IS, Angles, Array
from .cells import COUNTS_HEADER, RATIOS_HEADER, WRONG_MEANS, counts, every_table, faults_table, ratios
from .drawn import BOTH, NONE, RIG_NAMES, Road
from .verdicts import RigVerdict, against_truth, judge

# The stated priors (issue 20): what calibrations leave of a pair, and how parallel paint is.
VERGENCE_STD_DEG = 0.01
ROWS_STD_DEG = 0.01
ROLL_STD_DEG = 0.01
PAINT_STD_RAD = 5e-3

# Asked of error over standard deviation.
RATIO = (0.8, 1.3)

# What speaks: texture of the asphalt, and paint.
CUES = {"lines alone": (False, BOTH), "surface alone": (True, NONE), "both": (True, BOTH)}
_POSE_AXES, _ANGLES = "height, pitch, roll", "pitch, roll, yaw"
_TURN_STREAM = 2  # of random numbers, apart from that of the paint


@dataclass(frozen=True)
class Drawn:
    """A road, and how the right camera over it is turned.

    Attributes:
        road: The road.
        cue: One of :data:`CUES`.
        perfect: Whether rig and paint are perfect; otherwise they are drawn from the priors.
    """

    road: Road
    cue: str
    perfect: bool

    @property
    def turn(self) -> Angles:
        """How the right camera is turned."""
        if self.perfect:
            return AS_IT_IS
        rng = np.random.default_rng(
            [self.road.seed, self.road.index, RIG_NAMES.index(self.road.rig_name), _TURN_STREAM]
        )
        pitch, roll, yaw = rng.standard_normal(3) * (ROWS_STD_DEG, ROLL_STD_DEG, VERGENCE_STD_DEG)
        return Angles(float(pitch), float(roll), float(yaw))


@dataclass(frozen=True, eq=False)
class Seen:
    """What became of one.

    Attributes:
        drawn: What was rendered.
        verdict: What became of it.
    """

    drawn: Drawn
    verdict: RigVerdict


def prior_tables(options: Options) -> Iterator[Table]:
    """Judge worlds of drawn and of perfect rigs: by what speaks and by rig, what is wrong, and everything."""
    tasks = [
        Drawn(_road(cue, rig, options.seed, index, perfect), cue, perfect)
        for perfect in (False, True)
        for cue in CUES
        for rig in RIG_NAMES
        for index in range(0, options.rig_worlds, options.road_step)
    ]
    seen = list(in_processes(judge_drawn, tasks, options.processes))
    yield _ratio_table(
        "rig_priors",
        f"Rigs and paint from the priors: vergence {VERGENCE_STD_DEG:g}, rows {ROWS_STD_DEG:g}, turn "
        f"{ROLL_STD_DEG:g} deg, paint {PAINT_STD_RAD * 1e3:g} mrad",
        [each for each in seen if not each.drawn.perfect],
        {f"pose: {_POSE_AXES}": _pose_sigmas, f"alignment: {_ANGLES}": _alignment_sigmas},
    )
    yield _ratio_table(
        "rig_priors_noise",
        "A perfect rig, parallel paint and a plane: error over the term of the pixels' noise",
        [each for each in seen if each.drawn.perfect],
        {f"pose over noise: {_POSE_AXES}": _noise_sigmas, f"pose: {_POSE_AXES}": _pose_sigmas},
    )
    verdicts = [each.verdict for each in seen]
    yield faults_table("rig_priors_faults", "Drawn and perfect rigs: accepted and wrong", verdicts)
    yield every_table("rig_priors_every", verdicts)


def _road(cue: str, rig_name: str, seed: int, index: int, perfect: bool) -> Road:
    """Return a road; over a perfect rig it is a plane, so that nothing is uncertain but the noise."""
    textured, paint = CUES[cue]
    return Road(rig_name, textured, paint, seed, index, 0.0 if perfect else PAINT_STD_RAD, plane=perfect)


def judge_drawn(drawn: Drawn) -> Seen:
    """Render one and calibrate it."""
    turn = drawn.turn
    return Seen(drawn, against_truth(judge(drawn.road.pair(turn), turn)))


def _pose_sigmas(verdict: RigVerdict) -> Array | None:
    road = verdict.road
    return road.error / road.std if road.accepted else None


def _noise_sigmas(verdict: RigVerdict) -> Array | None:
    return (
        verdict.road.error / verdict.noise_std if verdict.road.accepted and len(verdict.noise_std) else None
    )


def _alignment_sigmas(verdict: RigVerdict) -> Array | None:
    return verdict.change / verdict.change_std if len(verdict.change) else None


def _ratio_table(
    name: str, title: str, seen: list[Seen], of: dict[str, Callable[[RigVerdict], Array | None]]
) -> Table:
    table = Table(
        name,
        title,
        ["what speaks", "rig", *COUNTS_HEADER, "error / std of", *RATIOS_HEADER],
        f"Asked: {RATIO[0]:g} to {RATIO[1]:g}. {WRONG_MEANS} "
        "Robust: 1.48 times the median of absolute values.",
    )
    for cue in CUES:
        for rig in ("all rigs", *RIG_NAMES):
            group = [
                each.verdict
                for each in seen
                if each.drawn.cue == cue and rig in ("all rigs", each.drawn.road.rig_name)
            ]
            for what, sigmas_of in of.items():
                values = [sigmas for sigmas in map(sigmas_of, group) if sigmas is not None]
                table.add(cue, rig, *counts(group), what, *ratios(values))
    return table
