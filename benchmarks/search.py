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

"""Our genetic algorithm against the optimisers of three libraries."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.optimize import minimize

from stereo_selfcal import Calibrator
from stereo_selfcal.core.estimators.fitness import PatternFitness

from .frames import Array, held_out_frame
from .optimisers import OPTIMISERS, SETTINGS, Recorder, search_box
from .options import Options
from .plots import save_search_plot
from .table import Table

NOISES = (0.0, 0.01, 0.05, 0.10, 0.20)
RELATIVE = 1e-3
ALL = "all"


def search_table(options: Options) -> Iterator[Table]:
    """Time and evaluations until the optimum is reached, and how often it is."""
    per_frame = max(1, options.seeds // len(NOISES))
    table = Table(
        "search",
        f"Optimisers on the same fitness: {per_frame} seeds on each of {len(NOISES)} frames",
        [
            "noise",
            "optimiser",
            f"within {RELATIVE:g} of the optimum",
            "median ms until there",
            "median evaluations until there",
            "median ms until it stops",
            "evaluations until it stops",
        ],
        "One textured held-out frame per noise level, one thread, CPU time. The optimum is the best any run "
        f"found, polished by Nelder-Mead. Until there: of the runs that got there. {SETTINGS}.",
    )
    runs: dict[str, dict[str, list[tuple[Recorder, float]]]] = {ALL: {}}
    for pose, noise in enumerate(NOISES):
        fitness = _fitness(noise, pose)
        frame = {name: _run(name, fitness, per_frame) for name in OPTIMISERS}
        optimum = _optimum(fitness, frame)
        target = optimum * (1 - RELATIVE)
        runs[f"{noise:.0%}"] = {name: [(run, target) for run in done] for name, done in frame.items()}
        for name, done in runs[f"{noise:.0%}"].items():
            runs[ALL].setdefault(name, []).extend(done)
    for level in [*list(runs)[1:], ALL]:
        for name, done in runs[level].items():
            table.add(level, name, *_cells(done))
    save_search_plot(options.folder, {name: _curve(done) for name, done in runs[ALL].items()})
    yield table


def _fitness(noise: float, pose: int) -> PatternFitness:
    """Return the fitness of a held-out frame, as the calibrator makes it."""
    scene, left, right = held_out_frame("textured", noise, pose)
    calibrator = Calibrator(scene.rig)
    pattern = calibrator.add(left, right).pattern
    if pattern is None:
        raise RuntimeError(f"no lines in the frame with {noise:.0%} noise: choose another one")
    return PatternFitness(pattern, scene.rig, calibrator.config.fitness)


def _run(name: str, fitness: PatternFitness, n_seeds: int) -> list[Recorder]:
    runs = []
    for seed in range(n_seeds):
        recorder = Recorder(fitness)
        OPTIMISERS[name](recorder, *search_box(), seed)
        runs.append(recorder)
    return runs


def _optimum(fitness: PatternFitness, frame: dict[str, list[Recorder]]) -> float:
    """Return the greatest fitness there is, as far as anybody knows."""
    best = max((run for runs in frame.values() for run in runs), key=lambda run: run.best)
    polished = minimize(
        lambda candidate: -float(fitness(candidate[None])[0]),
        best.best_individual,
        method="Nelder-Mead",
        options={"xatol": 1e-12, "fatol": 1e-9},
    )
    return max(best.best, -float(polished.fun))


def _cells(done: list[tuple[Recorder, float]]) -> list[str]:
    reached = [at for run, target in done if (at := run.reached(target)) is not None]
    until = np.median(reached, axis=0) if reached else None
    stop = np.median([run.total for run, _ in done], axis=0)
    return [
        f"{len(reached)}/{len(done)}",
        "-" if until is None else f"{until[0] * 1e3:.1f}",
        "-" if until is None else f"{until[1]:.0f}",
        f"{stop[0] * 1e3:.1f}",
        f"{stop[1]:.0f}",
    ]


def _curve(done: list[tuple[Recorder, float]]) -> tuple[Array, Array]:
    """Return times [ms] at which one run more has arrived, and the share that has."""
    times = sorted(at[0] * 1e3 for run, target in done if (at := run.reached(target)) is not None)
    last = max(run.total[0] * 1e3 for run, _ in done)
    share = np.arange(1, len(times) + 1) / len(done)
    return np.array([1.0, *times, last]), np.array([0.0, *share, share[-1] if len(share) else 0.0])
