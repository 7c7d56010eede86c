"""Time of the stages, one thread."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np

from stereo_selfcal import Calibrator, CalibratorConfig
from stereo_selfcal.core.fitness import PatternFitness
from stereo_selfcal.core.genetic import maximise
from stereo_selfcal.synth.scenes import named_scene

from .table import Table

REPEATS = 30


def stage_table() -> Table:
    """CPU time of extraction, genetic algorithm and one whole frame, beside OpenCV's block matching."""
    cv2.setNumThreads(1)
    named = named_scene("straight_road")
    _, left, right = named.frame(0)
    calibrator = Calibrator(named.scene.rig)
    pattern = calibrator.add(left, right).pattern
    fitness = PatternFitness(pattern, named.scene.rig, calibrator.config.fitness)
    # The paper's size, and no early stop: 100 + 200 * 90 evaluations.
    config = replace(CalibratorConfig().genetic, population=100, max_generations=200, tolerance=0.0)
    box = calibrator.config.search
    lower = (box.height_min_m, -box.pitch_max_rad, -box.roll_max_rad)
    upper = (box.height_max_m, box.pitch_max_rad, box.roll_max_rad)
    matcher = cv2.StereoSGBM_create(minDisparity=0, numDisparities=64, blockSize=5)

    table = Table(
        f"CPU time on one core, 640 x 480 pair, best and median of {REPEATS}",
        ["what", "best ms", "median ms", "asked"],
    )
    rows: list[tuple[str, Callable[[], object], str]] = [
        ("extraction: both images to the sampled pattern", lambda: calibrator.extract(left, right), "10 ms"),
        (
            "genetic algorithm, 100 individuals x 200 generations (18 100 evaluations)",
            lambda: maximise(fitness, lower, upper, config, np.random.default_rng(0)),
            "100 ms",
        ),
        ("calibrate(): all stages", lambda: calibrator.add(left, right), "-"),
        ("cv2.StereoSGBM, 64 disparities, block 5", lambda: matcher.compute(left, right), "-"),
    ]
    for name, call, asked in rows:
        times = [_cpu_ms(call) for _ in range(REPEATS)]
        table.add(name, f"{min(times):.1f}", f"{np.median(times):.1f}", asked)
    return table


def _cpu_ms(call: Callable[[], object]) -> float:
    start = time.thread_time()
    call()
    return (time.thread_time() - start) * 1e3
