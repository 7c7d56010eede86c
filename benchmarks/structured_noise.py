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

"""Pictures of structured noise: the calibrator has a result for each, whatever is in it, and never a fault.

Checkerboards, gratings, gradients, constant pictures and single lines, alone and mixed with noise and with
each other, at sizes from 160 x 120, with usual and odd rigs. They have what roads do not have: lines of
exactly one slope, differences that are exactly zero, blocks without any contrast. The calibrator's own
:meth:`~stereo_selfcal.core.calibrator.Calibrator.calibrate_frame` is called, which catches nothing.

``python -m benchmarks.structured_noise [FRAMES [FIRST]]`` writes a line for each fault, with the seed that
shows it again.
"""

from __future__ import annotations

import sys
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import cv2
import numpy as np

from stereo_selfcal import CalibrationResult, Calibrator, StereoRig
from stereo_selfcal.core.types import Array, Image
from stereo_selfcal.synth.renderer import render
from stereo_selfcal.synth.scenes import random_scene

from .options import Options
from .table import Table

SIZES = ((160, 120), (160, 120), (200, 150), (240, 135), (320, 240), (320, 240), (400, 300), (640, 480))
_SEED = 18_018  # no other benchmark has it
_LEVEL = 255.0

Pair = tuple[Array, Array]  # grey values of both images, not yet rounded
Random = np.random.Generator


@dataclass(frozen=True, slots=True)
class Fault:
    """An exception or a warning of arithmetic.

    Attributes:
        index: Number of the frame.
        kind: Kind of its picture.
        what: Type and text.
        where: File and line, below the package.
        trace: Traceback; "" of a warning.
    """

    index: int
    kind: str
    what: str
    where: str
    trace: str = ""


def _grid(size: tuple[int, int]) -> tuple[Array, Array]:
    height, width = size
    return np.mgrid[0:height, 0:width].astype(np.float64)  # type: ignore[return-value]  # rows, columns


@dataclass(frozen=True, slots=True)
class View:
    """What a picture is drawn for.

    Attributes:
        rig: Intrinsics and baseline.
        horizon: Row of the horizon [px].
        disparity: (H,) disparity of each row [px].
    """

    rig: StereoRig
    horizon: float
    disparity: Array

    @property
    def size(self) -> tuple[int, int]:
        """Height and width [px]."""
        return self.rig.height, self.rig.width


def _view(rng: Random) -> View:
    """Draw a rig, and a disparity of each row: mostly that of a road, or none, constant, or of any plane."""
    width, height = SIZES[int(rng.integers(len(SIZES)))]
    rig = _rig(rng, (height, width))
    rows = np.arange(height)
    horizon = rng.uniform(-0.1, 0.7) * height
    slope = rig.baseline_m * rig.fx / rig.fy / rng.uniform(0.5, 4.0)
    choice = rng.integers(8)
    if choice == 0:
        return View(rig, horizon, np.zeros(height))
    if choice == 1:
        return View(rig, horizon, np.full(height, float(rng.integers(-30, 60))))
    if choice == 2:
        slope = rng.uniform(0.02, 0.6)
    disparity = np.clip((rows - horizon) * slope, 0.0, None)
    return View(rig, horizon, np.round(disparity) if choice == 3 else disparity)


def _seen_by_both(view: View, texture: Callable[[Array, Array], Array]) -> Pair:
    rows, columns = _grid(view.size)
    return texture(rows, columns), texture(rows, columns + view.disparity[:, None])


def _checkerboard(rng: Random, view: View) -> Pair:
    cell = rng.integers(2, 60, 2)
    slant = rng.choice([0.0, 0.0, rng.uniform(-1.5, 1.5)])
    low, high = np.sort(rng.integers(0, 256, 2))

    def texture(rows: Array, columns: Array) -> Array:
        odd = (rows // cell[0] + (columns + slant * rows) // cell[1]) % 2
        return np.where(odd, low, high).astype(np.float64)

    return _seen_by_both(view, texture)


def _grating(rng: Random, view: View) -> Pair:
    period, slant, duty = rng.uniform(3, 80), rng.uniform(-2, 2), rng.uniform(0.05, 0.95)
    high = rng.integers(60, 256)

    def texture(rows: Array, columns: Array) -> Array:
        return np.where(((columns + slant * rows) / period) % 1.0 < duty, float(high), 20.0)

    return _seen_by_both(view, texture)


def _gradient(rng: Random, view: View) -> Pair:
    across, down, wave = rng.uniform(-3, 3), rng.uniform(-3, 3), rng.uniform(0, 0.3)

    def texture(rows: Array, columns: Array) -> Array:
        ramp = across * columns + down * rows
        return (ramp + 60 * np.sin(wave * columns)) % 256

    return _seen_by_both(view, texture)


def _constant(rng: Random, view: View) -> Pair:
    level = rng.choice([0, 1, 127, 254, 255], 2)
    size = view.size
    return np.full(size, float(level[0])), np.full(size, float(level[rng.integers(2)]))


def _lines(rng: Random, view: View) -> Pair:
    """Straight stripes: one alone, parallel ones, or a fan, mostly through one point of the horizon."""
    height, width = view.size
    choice = rng.integers(5)
    count = 1 if choice == 0 else int(rng.integers(2, 7))
    bottoms = rng.uniform(-0.5, 1.5, count) * width
    top = view.horizon
    point = rng.uniform(0.2, 0.8) * width
    slopes = np.full(count, rng.uniform(-2, 2))
    if choice > 1:
        slopes = (bottoms - point) / (height - top)
        if choice == 2:
            slopes += rng.normal(0.0, 0.1, count)
    stripe = rng.uniform(1.0, 25.0)
    narrow = rng.random() < 0.7
    tone = rng.uniform(60, 255)

    def texture(rows: Array, columns: Array) -> Array:
        grey = np.full(rows.shape, 50.0)
        for bottom, slope in zip(bottoms, slopes, strict=True):
            width_px = stripe * np.clip((rows - top) / (height - top), 0.05, 1.0) if narrow else stripe
            below = rows > top
            grey[(np.abs(columns - (bottom + slope * (rows - height))) < width_px / 2) & below] = tone
        return grey

    return _seen_by_both(view, texture)


def _noise(rng: Random, view: View) -> Pair:
    """White, blurred or tiled noise, the same in both images or not."""
    size = view.size
    field = rng.normal(128, rng.uniform(1, 90), size)
    sigma = rng.choice([0.0, 0.7, 2.0, 8.0])
    if sigma:
        field = cv2.GaussianBlur(field, (0, 0), float(sigma))
        field = (field - field.mean()) * (rng.uniform(5, 60) / max(float(field.std()), 1e-9)) + 128
    if rng.random() < 0.5:
        tile = field[: rng.integers(4, 40), : rng.integers(4, 40)]
        reps = [-(-whole // part) for whole, part in zip(size, tile.shape, strict=True)]
        field = np.tile(tile, reps)[: size[0], : size[1]]
    if rng.random() < 0.3:
        return field, rng.permuted(field, axis=1)
    right = np.stack([np.roll(row, -round(float(by))) for row, by in zip(field, view.disparity, strict=True)])
    return field, right


_PLAIN: dict[str, Callable[[Random, View], Pair]] = {
    "checkerboard": _checkerboard,
    "grating": _grating,
    "gradient": _gradient,
    "constant": _constant,
    "lines": _lines,
    "noise": _noise,
}


def _mixture(rng: Random, view: View) -> Pair:
    """Two kinds, added or side by side."""
    size = view.size
    names = rng.choice(list(_PLAIN), 2)
    if rng.random() < 0.5:
        names[0] = "lines"
    first, second = (_PLAIN[str(name)](rng, view) for name in names)
    if rng.random() < 0.5:
        share = rng.uniform(0.1, 0.9)
        return tuple(share * a + (1 - share) * b for a, b in zip(first, second, strict=True))  # type: ignore[return-value]
    mask = np.zeros(size, dtype=bool)
    top, left = rng.integers(0, size[0]), rng.integers(0, size[1])
    mask[top : top + rng.integers(1, size[0]), left : left + rng.integers(1, size[1])] = True
    return np.where(mask, first[0], second[0]), np.where(mask, first[1], second[1])


def _saturated(rng: Random, view: View) -> Pair:
    """Any kind, with half of it black or white, in one image or in both."""
    size = view.size
    images = [image.copy() for image in _mixture(rng, view)]
    half = slice(0, size[0] // 2) if rng.random() < 0.5 else slice(size[0] // 2, None)
    across = rng.random() < 0.5
    for image in images if rng.random() < 0.5 else images[:1]:
        part = image[half] if across else image.T[half]
        part[:] = rng.choice([0.0, _LEVEL])
    return images[0], images[1]


def _amplified(rng: Random, view: View) -> Pair:
    """Any kind, with another gain in the right image, and single pixels at the ends of the range."""
    size = view.size
    left, right = _mixture(rng, view)
    right = right * rng.uniform(0.2, 5.0) + rng.uniform(-80, 80)
    for image in (left, right):
        image[rng.random(size) < rng.choice([0.0, 0.02])] = _LEVEL
    return left, right


KINDS = _PLAIN | {"mixture": _mixture, "saturated half": _saturated, "other gain": _amplified}
_SPOILED = "spoiled road"
_N_ROADS = 12
_SCALES = (0.25, 0.5, 0.5, 1.0)


@cache
def _road(number: int, scale: float) -> tuple[StereoRig, Pair]:
    """Return a rendered road between two lines, at a part of its size."""
    rng = np.random.default_rng([_SEED, number, 1])
    scene = random_scene(rng, 0.01)
    rig = scene.rig
    width, height = round(rig.width * scale), round(rig.height * scale)
    images = [
        cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA).astype(np.float64)
        for image in render(scene, rng)
    ]
    cx, cy = ((at + 0.5) * scale - 0.5 for at in (rig.cx, rig.cy))
    small = StereoRig(width, height, rig.fx * scale, rig.fy * scale, cx, cy, rig.baseline_m)
    return small, (images[0], images[1])


def _spoiled_road(rng: Random) -> tuple[StereoRig, Pair]:
    """Return a road with patterns over parts of it, so that later stages have something to do."""
    rig, road = _road(int(rng.integers(_N_ROADS)), float(rng.choice(_SCALES)))
    view = View(rig, 0.4 * rig.height, np.clip(np.arange(rig.height) - 0.4 * rig.height, 0, None) * 0.1)
    left, right = (image.copy() for image in road)
    pattern = _PLAIN[str(rng.choice(list(_PLAIN)))](rng, view)
    choice = rng.integers(7)
    if choice == 0:  # a part of the pattern's contrast everywhere
        share = rng.uniform(0.02, 0.5)
        left, right = ((1 - share) * a + share * b for a, b in zip((left, right), pattern, strict=True))
    elif choice == 1:  # a patch
        top, beside = rng.integers(0, rig.height - 8), rng.integers(0, rig.width - 8)
        patch = np.s_[top : top + rng.integers(8, rig.height), beside : beside + rng.integers(8, rig.width)]
        left[patch], right[patch] = pattern[0][patch], pattern[1][patch]
    elif choice == 2:  # no texture: few grey levels
        step = float(rng.integers(4, 90))
        left, right = (np.round(image / step) * step for image in (left, right))
    elif choice == 3:  # one camera moved or turned
        turn = np.float64(
            [[1, rng.normal(0, 0.01), rng.normal(0, 3)], [rng.normal(0, 0.02), 1, rng.normal(0, 3)]]
        )
        right = cv2.warpAffine(right, turn, (rig.width, rig.height), borderMode=cv2.BORDER_REPLICATE)
    elif choice == 4:  # clipped
        gain, offset = rng.uniform(0.1, 6.0, 2), rng.uniform(-120, 120, 2)
        left, right = left * gain[0] + offset[0], right * gain[1] + offset[1]
    elif choice == 5:  # rows repeated, as a camera under load sends them
        rows = np.minimum(np.arange(rig.height), rng.integers(rig.height // 3, rig.height))
        left, right = left[rows], (right[rows] if rng.random() < 0.5 else right)
    else:  # only a band of rows
        bottom = int(rng.integers(rig.height // 2, rig.height))
        left[bottom:], right[bottom:] = pattern[0][bottom:], pattern[1][bottom:]
    return rig, (left, right)


def _rig(rng: Random, size: tuple[int, int]) -> StereoRig:
    """Return a rig of that size: mostly usual ones, and some no camera has."""
    height, width = size
    fx = width * float(rng.choice([0.4, 0.8, 1.2, 2.0, 6.0]))
    fy = fx * float(rng.choice([1.0, 1.0, 1.0, 0.6, 1.7]))
    odd = rng.random() < 0.3
    cx = float(rng.choice([0.0, width])) if odd else (width - 1) / 2
    cy = float(rng.choice([0.0, height])) if odd else height * rng.uniform(0.3, 0.6)
    baseline_m = float(rng.choice([0.05, 0.12, 0.3, 0.54, 3.0]))
    return StereoRig(width, height, fx, fy, cx, cy, baseline_m)


def frame(index: int) -> tuple[str, StereoRig, Image, Image]:
    """Return the kind, the rig and both images of a frame, the same every time."""
    rng = np.random.default_rng([_SEED, index])
    kind = (*KINDS, _SPOILED, _SPOILED)[index % (len(KINDS) + 2)]
    if kind == _SPOILED:
        rig, images = _spoiled_road(rng)
    else:
        view = _view(rng)
        rig, images = view.rig, KINDS[kind](rng, view)
    noise = float(rng.choice([0.0, 0.0, 1.0, 6.0]))
    if noise:
        images = (
            images[0] + rng.normal(0, noise, images[0].shape),
            images[1] + rng.normal(0, noise, images[1].shape),
        )
    left, right = (np.clip(np.rint(image), 0, 255).astype(np.uint8) for image in images)
    return kind, rig, left, right


def try_frame(index: int) -> tuple[str, CalibrationResult | None, list[Fault]]:
    """Calibrate a frame; return its kind, its result (None after an exception) and all faults."""
    kind, rig, left, right = frame(index)
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        try:
            result: CalibrationResult | None = Calibrator(rig).calibrate_frame(left, right)
            faults = []
        except Exception as error:  # noqa: BLE001  (to count whatever comes is what this is for)
            result = None
            last = traceback.extract_tb(error.__traceback__)[-1]
            own = [
                each
                for each in traceback.extract_tb(error.__traceback__)
                if "stereo_selfcal" in each.filename
            ]
            where = own[-1] if own else last
            faults = [
                Fault(
                    index,
                    kind,
                    f"{type(error).__name__}: {error}",
                    f"{Path(where.filename).name}:{where.lineno}",
                    traceback.format_exc(),
                )
            ]
    faults += [
        Fault(
            index,
            kind,
            f"{each.category.__name__}: {each.message}",
            f"{Path(each.filename).name}:{each.lineno}",
        )
        for each in seen
    ]
    return kind, result, faults


def structured_noise_table(options: Options) -> Iterator[Table]:
    """Faults of each kind of picture, and what became of the frames."""
    counts: dict[str, Counter[str]] = {kind: Counter() for kind in (*KINDS, _SPOILED)}
    for index in range(options.structured_noise):
        kind, result, faults = try_frame(index)
        counts[kind]["frames"] += 1
        counts[kind]["exceptions"] += result is None
        counts[kind]["warnings"] += any(not fault.trace for fault in faults)
        counts[kind]["accepted"] += result is not None and result.accepted
    table = Table(
        "structured_noise",
        "Structured noise: faults of single frames",
        ["pictures", "frames", "exceptions", "with a warning of arithmetic", "accepted"],
        "Sizes from 160 x 120 to 640 x 480, usual and odd rigs. A picture of two painted lines in "
        "perspective is a road to any calibrator, so a few are accepted. A spoiled road is a rendered one "
        "with patterns over parts of it, clipped, turned, or with rows repeated.",
    )
    for kind, count in counts.items():
        table.add(kind, *(str(count[name]) for name in ("frames", "exceptions", "warnings", "accepted")))
    yield table


def main(arguments: list[str]) -> int:
    """Try frames one after the other; exit status 1 where there was a fault."""
    cv2.setNumThreads(1)
    frames = int(arguments[0]) if arguments else Options().structured_noise
    first = int(arguments[1]) if arguments[1:] else 0
    outcomes: Counter[str] = Counter()
    faulty = 0
    for index in range(first, first + frames):
        _, result, faults = try_frame(index)
        faulty += bool(faults)
        outcomes["exception" if result is None else str(result.reason or "accepted")] += 1
        for fault in faults:
            sys.stdout.write(f"{fault.index} {fault.kind}: {fault.where}: {fault.what}\n{fault.trace}")
            sys.stdout.flush()
    sys.stdout.write(f"{frames} frames, {faulty} with a fault: {dict(outcomes.most_common())}\n")
    return int(faulty > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
