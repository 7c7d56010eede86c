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

"""Time and memory of one thread: parts, image sizes, population, frames."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from stereo_selfcal import Calibrator, CalibratorConfig, StereoRig
from stereo_selfcal.core.estimators.fitness import PatternFitness
from stereo_selfcal.core.geometry.homography import SIDES
from stereo_selfcal.core.numerics.genetic import maximise_each
from stereo_selfcal.synth.renderer import Frame, render
from stereo_selfcal.synth.scenes import PAPER_RIG, random_scene

from .frames import FIRST_POSE_SEED
from .optimisers import search_box
from .options import Options
from .parts import PARTS, clocked_parts
from .plots import save_size_plot
from .ratios import elapsed_ms
from .table import Table

SIZES = ((640, 480), (1024, 768), (1280, 960), (1600, 1200), (2048, 1536), (2448, 2048))
N_QUICK_SIZES = 2
POPULATIONS = (50, 100, 200, 400, 800)
FRAME_COUNTS = (1, 10, 100)
NOISE = 0.01
MEBIBYTE = 2**20

REST, WHOLE = "all the rest", "calibrate()"


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
        adding = [elapsed_ms(partial(fresh.add, left, right)) for _ in range(count)]
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
        whole_ms = elapsed_ms(call)
    times = {name: seconds * 1e3 for name, seconds in spent.items()}
    return {**times, REST: whole_ms - sum(times.values()), WHOLE: whole_ms}


def _median_ms(call: Callable[[], object], repeats: int) -> float:
    return float(np.median([elapsed_ms(call) for _ in range(repeats)]))


def _peak_mib(call: Callable[[], object]) -> float:
    """Return the most memory held at once during a call."""
    tracemalloc.start()
    try:
        call()
        return tracemalloc.get_traced_memory()[1] / MEBIBYTE
    finally:
        tracemalloc.stop()
