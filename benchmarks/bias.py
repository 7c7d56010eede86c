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

"""Bias: many noise draws of one scene, under blur, unequal gains and vignetting."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from stereo_selfcal import Extrinsics, calibrate
from stereo_selfcal.synth.scenes import PAPER_RIG
from stereo_selfcal.synth.world import PAINT_GREY, Photometry, Road, Scene, two_lines

from .frames import READABLE, SURFACES, UNITS, draw, finely_rendered, judge, stage_errors, stages_of
from .options import Options
from .table import Table, number, numbers

NOISES = (0.01, 0.10)
NOISE_SEED = 30_000
ASKED_STANDARD_ERRORS = 3

POSE = Extrinsics(1.37, math.radians(3.3), math.radians(0.9))
LANE_YAW_RAD = math.radians(0.6)
LATERAL_OFFSET_M = 0.15

# Left and right camera of every variant.
CAMERAS: dict[str, tuple[Photometry, Photometry]] = {
    "PSF 0 px": (Photometry(psf_sigma_px=0.0), Photometry(psf_sigma_px=0.0)),
    "PSF 0.6 px": (Photometry(psf_sigma_px=0.6), Photometry(psf_sigma_px=0.6)),
    "PSF 1.2 px": (Photometry(psf_sigma_px=1.2), Photometry(psf_sigma_px=1.2)),
    "gains 0.8 and 1.2": (Photometry(gain=0.8), Photometry(gain=1.2)),
    "gains 0.8 and 1.2, grey paint": (Photometry(gain=0.8), Photometry(gain=1.2)),
    "vignetting 30 %": (Photometry(vignetting=0.3), Photometry(vignetting=0.3)),
}

# Paint that no gain drives into clipping: what unequal gains do by themselves.
PAINT = {"gains 0.8 and 1.2, grey paint": 150.0}


def bias_table(options: Options) -> Iterator[Table]:
    """Mean error over noise draws, in standard errors of the mean."""
    table = Table(
        "bias",
        f"Bias: {options.draws} noise draws of one scene",
        [
            "cameras",
            "noise",
            "stage",
            "accepted",
            *(f"mean error {unit}" for unit in UNITS),
            "|mean| in standard errors (h, p, r)",
        ],
        f"Asked of the final stage: below {ASKED_STANDARD_ERRORS}. Bare asphalt: a texture that stays the "
        "same in every draw would itself be an error that does not average out. The lens is sampled at a "
        "quarter of a pixel; PSF 0.5 px where nothing else is said. Paint of grey 213 clips at a gain of "
        "1.2, and under 10 % noise at any gain; grey paint, 150, hardly ever.",
    )
    for name, (left_camera, right_camera) in CAMERAS.items():
        lines = tuple(replace(line, grey=PAINT.get(name, PAINT_GREY)) for line in two_lines())
        road = Road(lines=lines, texture_amplitude=SURFACES["bare"])
        scene = Scene(PAPER_RIG, POSE, LANE_YAW_RAD, LATERAL_OFFSET_M, road=road)
        scene = replace(scene, left=left_camera, right=right_camera)
        pictures = finely_rendered(scene)
        for noise in NOISES:
            results = []
            for index in range(options.draws):
                left, right = draw(pictures, noise, np.random.default_rng([NOISE_SEED, index]))
                results.append(judge(calibrate(left, right, scene.rig), scene))
            accepted = sum(result.accepted for result in results)
            for stage in stages_of(results):
                errors = stage_errors(results, stage)
                if len(errors) < 2:
                    table.add(name, f"{noise:.0%}", stage, f"{accepted}/{options.draws}", "-", "-", "-", "-")
                    continue
                mean = errors.mean(axis=0)
                standard_error = errors.std(axis=0, ddof=1) / math.sqrt(len(errors))
                table.add(
                    name,
                    f"{noise:.0%}",
                    stage,
                    f"{accepted}/{options.draws}",
                    *(number(value) for value in mean * READABLE),
                    numbers(np.abs(mean) / standard_error, digits=2),
                )
    yield table
