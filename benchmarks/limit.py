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

"""Accuracy against the Cramér-Rao bound, and the standard deviation by noise against the error."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import numpy as np

from .bound import bound_per_noise
from .frames import READABLE, SURFACES, UNITS, Array, held_out, measured, rms, stage_errors, stages_of
from .options import Options
from .plots import save_limit_plot
from .table import Table, number, numbers

NOISES = (0.01, 0.05, 0.10, 0.20)
ASKED_OVER_BOUND = 1.5
ASKED_OVER_STD = "0.8 ... 1.25"


def limit_table(options: Options) -> Iterator[Table]:
    """RMS error of every stage over the RMS bound of the same poses."""
    table = Table(
        "limit",
        f"Accuracy against the Cramér-Rao bound, {options.poses} held-out poses a row",
        [
            "surface",
            "noise",
            "stage",
            "accepted",
            *(f"RMS {unit}" for unit in UNITS),
            "bound (mm, deg, deg)",
            "error / bound (h, p, r)",
            "error / std by noise (h, p, r)",
        ],
        f"Asked of the final stage: error / bound at most {ASKED_OVER_BOUND}, error / std {ASKED_OVER_STD}: "
        "the standard deviation by the term `noise` of the uncertainty, as nothing else is wrong with a "
        "rendered road. "
        "The bound is that of the stripes under Gaussian noise, by derivatives of the renderer; it knows of "
        "no texture, no clipping, no rounding. Errors are of accepted frames, the bound is of all.",
    )
    curves: dict[str, list[tuple[float, Array, Array]]] = {}
    for surface in SURFACES:
        for noise in NOISES:
            results = [measured(surface, noise, pose) for pose in range(options.poses)]
            bound = rms([_bound(pose) * noise for pose in range(options.poses)])
            accepted = [result for result in results if result.accepted]
            for stage in stages_of(results):
                error = rms(stage_errors(results, stage))
                honesty = "-"
                if stage == "final":
                    ratios = [r.error(stage) / r.noise_std for r in accepted if r.noise_std is not None]
                    honesty = numbers(rms(ratios))
                table.add(
                    surface,
                    f"{noise:.0%}",
                    stage,
                    f"{len(accepted)}/{len(results)}",
                    *(number(value) for value in error * READABLE),
                    numbers(bound * READABLE),
                    numbers(error / bound),
                    honesty,
                )
                if surface == "bare":
                    curves.setdefault(stage, []).append((noise, error * READABLE, bound * READABLE))
    save_limit_plot(options.folder, curves, UNITS)
    yield table


@cache
def _bound(pose: int) -> Array:
    """Return the bound of a held-out pose per unit of noise; the same on both surfaces."""
    scene, _ = held_out("bare", pose)
    return np.asarray(bound_per_noise(scene))
