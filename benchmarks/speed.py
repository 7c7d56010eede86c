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

"""Time and memory of one thread: parts, image sizes, population, frames; OpenCV's block matching beside."""

from __future__ import annotations

import time
import tracemalloc
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import cv2
import numpy as np

from stereo_selfcal import Calibrator, CalibratorConfig, StereoRig
from stereo_selfcal.core.estimators.fitness import PatternFitness
from stereo_selfcal.core.geometry.homography import SIDES
from stereo_selfcal.core.numerics.genetic import maximise_each
from stereo_selfcal.synth.renderer import Frame, render
from stereo_selfcal.synth.scenes import PAPER_RIG, named_scene, random_scene

from .frames import FIRST_POSE_SEED
from .optimisers import search_box
from .options import Options
from .parts import PARTS, clocked_parts
from .plots import save_size_plot
from .table import Table

SIZES = ((640, 480), (1024, 768), (1280, 960), (1600, 1200), (2048, 1536), (2448, 2048))
N_QUICK_SIZES = 2
POPULATIONS = (50, 100, 200, 400, 800)
FRAME_COUNTS = (1, 10, 100)
NOISE = 0.01
N_DISPARITIES, BLOCK_PX = 64, 5
MEBIBYTE = 2**20

REST, WHOLE = "all the rest", "calibrate()"


def ratio_table(options: Options) -> Iterator[Table]:
    """One whole calibration against one block matching of the same pair, by turns."""
    named = named_scene("straight_road")
    _, left, right = named.frame(0)
    calibrator = Calibrator(named.scene.rig)
    lines_alone = Calibrator(named.scene.rig, CalibratorConfig.from_mapping({"texture.check": 0}))
    matcher = cv2.StereoSGBM_create(minDisparity=0, numDisparities=N_DISPARITIES, blockSize=BLOCK_PX)
    whole, alone, theirs = [], [], []
    for _ in range(options.repeats):
        whole.append(_ms(lambda: calibrator.add(left, right)))
        alone.append(_ms(lambda: lines_alone.add(left, right)))
        theirs.append(_ms(lambda: matcher.compute(left, right)))
    table = Table(
        "ratio",
        f"calibrate() against one cv2.StereoSGBM, 640 x 480, {options.repeats} times by turns",
        ["what", "best ms", "median ms", "ratio of the best"],
        f"One thread each, the same pair; {N_DISPARITIES} disparities, block {BLOCK_PX}. Asked: a ratio "
        "of at most 2.5 with the asphalt, of 1 with the lines alone.",
    )
    for what, times in (
        ("calibrate(): all stages and gates", whole),
        ("calibrate(): lines alone (texture.check: 0)", alone),
        ("cv2.StereoSGBM.compute()", theirs),
    ):
        table.add(
            what, f"{min(times):.1f}", f"{float(np.median(times)):.1f}", f"{min(times) / min(theirs):.2f}"
        )
    yield table


def size_table(options: Options) -> Iterator[Table]:
    """Time of the parts and peak memory over image sizes."""
    table = Table(
        "sizes",
        "Time and memory over image sizes, the paper's rig scaled",
        ["size", *(f"{name} ms" for name in (*PARTS, REST, WHOLE)), "peak memory MiB"],
        f"Median of {options.repeats}, one thread, {NOISE:.0%} noise. Memory: the most that NumPy and "
        "OpenCV's results held at once during one call, beyond the images themselves (tracemalloc).",
    )
    sizes = SIZES if options.all_sizes else SIZES[:N_QUICK_SIZES]
    columns: dict[str, list[float]] = {name: [] for name in (*PARTS, REST, WHOLE)}
    for width, height in sizes:
        calibrator, left, right = _pair(width, height)
        memory = _peak_mib(partial(calibrator.add, left, right))
        times = [_part_times_ms(partial(calibrator.add, left, right)) for _ in range(options.repeats)]
        for name, values in columns.items():
            values.append(float(np.median([each[name] for each in times])))
        cells = [f"{values[-1]:.1f}" if any(values) else "-" for values in columns.values()]
        table.add(f"{width} x {height}", *cells, f"{memory:.1f}")
    drawn = {name: values for name, values in columns.items() if any(values) and name != REST}
    save_size_plot(options.folder, [width * height for width, height in sizes], drawn)
    yield table


def cost_tables(options: Options) -> Iterator[Table]:
    """Cost over the size of the population and over the number of frames."""
    calibrator, left, right = _pair(*SIZES[0])
    fitness = _fitness(calibrator, left, right)
    table = Table(
        "population",
        "Cost of the genetic algorithm over its population",
        ["population", "evaluations", "generations", "ms"],
        f"Both runs of one frame, median of {options.repeats}; to its own stopping rule.",
    )
    for population in POPULATIONS:
        config = CalibratorConfig()
        config = replace(config, genetic=replace(config.genetic, population=population))
        evaluations, generations = _search(fitness, config)
        milliseconds = _median_ms(partial(_search, fitness, config), options.repeats)
        table.add(str(population), str(evaluations), str(generations), f"{milliseconds:.1f}")
    yield table

    table = Table(
        "frames",
        "Cost over the number of frames that are fused",
        ["frames", "ms per frame", "ms for the fused estimate"],
        "640 x 480, the same frame again and again.",
    )
    for count in FRAME_COUNTS:
        fresh = Calibrator(calibrator.rig)
        adding = [_ms(partial(fresh.add, left, right)) for _ in range(count)]
        fused = _median_ms(lambda: fresh.estimate, options.repeats)  # noqa: B023 - called at once
        table.add(str(count), f"{np.median(adding):.1f}", f"{fused:.2f}")
    yield table


def _pair(width: int, height: int) -> tuple[Calibrator, Frame, Frame]:
    """Return a calibrator and a frame of the paper's rig with other cameras."""
    focal_px = PAPER_RIG.fx * width / PAPER_RIG.width
    rig = StereoRig(
        width, height, focal_px, focal_px, (width - 1) / 2, (height - 1) / 2, PAPER_RIG.baseline_m
    )
    scene = random_scene(np.random.default_rng(FIRST_POSE_SEED), NOISE, rig=rig)
    return Calibrator(rig), *render(scene, np.random.default_rng(0))


def _fitness(calibrator: Calibrator, left: Frame, right: Frame) -> PatternFitness:
    result = calibrator.add(left, right)
    if result.pattern is None:
        raise RuntimeError(f"no pattern to measure with: {result.message}")
    return PatternFitness(result.pattern, calibrator.rig, calibrator.config.fitness)


def _search(fitness: PatternFitness, config: CalibratorConfig) -> tuple[int, int]:
    """Search as the calibrator does; return evaluations and generations of both runs."""
    rng = np.random.default_rng(config.seed)
    runs = maximise_each(fitness.fitness_in_each_camera, *search_box(), config.genetic, rng, len(SIDES))
    return sum(run.evaluations for run in runs), max(run.generations for run in runs)


def _part_times_ms(call: Callable[[], object]) -> dict[str, float]:
    """Return the time of one calibration and of its parts, by clocks around the parts."""
    with clocked_parts() as spent:
        whole_ms = _ms(call)
    times = {name: seconds * 1e3 for name, seconds in spent.items()}
    return {**times, REST: whole_ms - sum(times.values()), WHOLE: whole_ms}


def _median_ms(call: Callable[[], object], repeats: int) -> float:
    return float(np.median([_ms(call) for _ in range(repeats)]))


def _ms(call: Callable[[], object]) -> float:
    # CPU time: other programs of this machine must not count.
    start = time.thread_time()
    call()
    return (time.thread_time() - start) * 1e3


def _peak_mib(call: Callable[[], object]) -> float:
    """Return the most memory held at once during a call."""
    tracemalloc.start()
    try:
        call()
        return tracemalloc.get_traced_memory()[1] / MEBIBYTE
    finally:
        tracemalloc.stop()
