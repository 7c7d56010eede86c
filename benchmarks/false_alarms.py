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

"""Pictures without a road: none may be accepted."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator

import numpy as np

from stereo_selfcal import calibrate
from stereo_selfcal.synth.renderer import Frame, Picture
from stereo_selfcal.synth.scenes import PAPER_RIG

from .frames import FULL_SCALE, draw
from .options import Options
from .table import Table

SEED = 40_000
# Pure noise comes in the strengths of a night picture: mild to beyond any camera.
NOISE_RANGE = (0.01, 0.50)
MILD_NOISE_MAX = 0.10
CELL_RANGE_PX = (4, 80)
MAX_DISPARITY_PX = 40

Maker = Callable[[np.random.Generator], tuple[Frame, Frame]]
_SHAPE = (PAPER_RIG.height, PAPER_RIG.width)


def false_alarm_table(options: Options) -> Iterator[Table]:
    """Count accepted pictures of every kind."""
    table = Table(
        "false_alarms",
        "False alarms: pictures without a road that were accepted",
        ["pictures", "accepted", "refused as"],
        "Asked: none.",
    )
    for name, make in KINDS.items():
        reasons: Counter[str] = Counter()
        for index in range(options.false_alarms):
            result = calibrate(*make(np.random.default_rng([SEED, index])), PAPER_RIG)
            reasons["accepted" if result.accepted else str(result.reason)] += 1
        accepted = reasons.pop("accepted", 0)
        told = ", ".join(f"{reason} {count}" for reason, count in reasons.most_common())
        table.add(name, f"{accepted}/{options.false_alarms}", told)
    yield table


def _noise(rng: np.random.Generator) -> tuple[Frame, Frame]:
    """Noise of its own in each camera."""
    grey = np.full(_SHAPE, rng.uniform(0, FULL_SCALE), np.float32)
    return draw((grey, grey), float(rng.uniform(*NOISE_RANGE)), rng)


def _seen_noise(rng: np.random.Generator) -> tuple[Frame, Frame]:
    """The same noise in both cameras, shifted: texture at one distance."""
    shift = int(rng.integers(MAX_DISPARITY_PX))
    grey = np.full((_SHAPE[0], _SHAPE[1] + shift), rng.uniform(0, FULL_SCALE), np.float32)
    wide, _ = draw((grey, grey[:1, :1]), float(rng.uniform(*NOISE_RANGE)), rng)
    return np.ascontiguousarray(wide[:, : _SHAPE[1]]), np.ascontiguousarray(wide[:, shift:])


def _constant(rng: np.random.Generator) -> tuple[Frame, Frame]:
    """One grey level, noise-free."""
    frame = np.full(_SHAPE, rng.integers(FULL_SCALE + 1), np.uint8)
    return frame, frame.copy()


def _gradient(rng: np.random.Generator) -> tuple[Frame, Frame]:
    """A ramp in any direction, with mild noise."""
    slope_u, slope_v = rng.uniform(-0.5, 0.5, size=2)
    v, u = np.mgrid[: _SHAPE[0], : _SHAPE[1]]
    ramp = slope_u * (u - _SHAPE[1] / 2) + slope_v * (v - _SHAPE[0] / 2) + FULL_SCALE / 2
    return _with_mild_noise(ramp.astype(np.float32), ramp.astype(np.float32), rng)


def _checkerboard(rng: np.random.Generator) -> tuple[Frame, Frame]:
    """A checkerboard, turned and shifted between the cameras, with mild noise."""
    cell_px, turn_rad = rng.uniform(*CELL_RANGE_PX), rng.uniform(0, np.pi)
    dark, bright = np.sort(rng.uniform(0, FULL_SCALE, size=2))
    shift = rng.integers(MAX_DISPARITY_PX)
    v, u = np.mgrid[: _SHAPE[0], : _SHAPE[1]]

    def board(first_u: int) -> Picture:
        along = np.cos(turn_rad) * (u + first_u) + np.sin(turn_rad) * v
        across = np.cos(turn_rad) * v - np.sin(turn_rad) * (u + first_u)
        odd = (np.floor(along / cell_px) + np.floor(across / cell_px)) % 2
        picture: Picture = np.where(odd > 0, bright, dark).astype(np.float32)
        return picture

    return _with_mild_noise(board(0), board(int(shift)), rng)


def _with_mild_noise(left: Picture, right: Picture, rng: np.random.Generator) -> tuple[Frame, Frame]:
    return draw((left, right), float(rng.uniform(0, MILD_NOISE_MAX)), rng)


KINDS: dict[str, Maker] = {
    "noise, different in each camera": _noise,
    "noise both cameras see": _seen_noise,
    "constant": _constant,
    "gradient": _gradient,
    "checkerboard": _checkerboard,
}
