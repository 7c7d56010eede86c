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

"""Our genetic algorithm and three libraries' optimisers, on one fitness of one frame.

Every optimiser maximises the fitness over the same box. Evaluations and time are recorded by the fitness
itself, at the end of every call, so all pay the same for it. All evaluate a whole population per call,
DEAP too, by a ``map`` of its own: called one individual at a time it would be far slower.

Settings of the peers are what their manuals give where that finds the optimum, and what made them better
on development frames where it does not:

* scipy: differential_evolution(vectorized=True, updating="deferred"), popsize 15, dithered mutation
  (0.5, 1), recombination 0.7 (all defaults); tol 1e-4 instead of 1e-2, which stops short of the
  optimum; polish off, because its gradient descent does not suit a fitness with kinks. Once on the whole
  fitness, as a user would, and once as ours is run: a run for each camera's parallelism, which
  spares it the second optimum the whole fitness may have.
* pymoo: GA(pop_size=100), 500 generations, SBX(eta=3, prob=0.9, prob_var=1): with its defaults (eta 15,
  prob_var 0.5) it stays in the valley, far from the optimum.
* DEAP: eaSimple, 100 individuals, cxBlend(0.5) with probability 0.5, Gaussian mutation of 0.1 % of
  the box with probability 0.5, tournaments of 5, 500 generations: the best of eight settings tried;
  its selection keeps no elite, the best ever evaluated counts.

500 generations is the paper's limit, and ours.
"""

from __future__ import annotations

import random
import time
from collections.abc import Callable, Iterable
from functools import partial

import numpy as np
from deap import algorithms, base, creator, tools
from pymoo.algorithms.soo.nonconvex.ga import GA
from pymoo.core.problem import Problem
from pymoo.operators.crossover.sbx import SBX
from pymoo.optimize import minimize
from scipy.optimize import differential_evolution

from stereo_selfcal import CalibratorConfig
from stereo_selfcal.core.estimators.fitness import PatternFitness
from stereo_selfcal.core.geometry.homography import SIDES
from stereo_selfcal.core.numerics.genetic import maximise_each

from .frames import Array

SETTINGS = (
    "scipy: popsize 15, tol 1e-4, no polish; pymoo: GA(pop_size=100) with SBX(eta=3, prob=0.9, "
    "prob_var=1), 500 generations; DEAP: eaSimple, 100 individuals, cxBlend 0.5 (0.5), mutGaussian 0.1 % of "
    "the box (0.5), tournament of 5, 500 generations, whole populations evaluated at once"
)
GENERATIONS = 500
POPULATION = 100
DE_TOLERANCE = 1e-4
DEAP_CROSSOVER, DEAP_BLEND = 0.5, 0.5
DEAP_MUTATION, DEAP_STEP, DEAP_GENE_SHARE = 0.5, 0.001, 1.0
DEAP_TOURNAMENT = 5
PYMOO_ETA, PYMOO_CROSSOVER = 3, 0.9


class Recorder:
    """The fitness, with a log of when which value was reached.

    Attributes:
        fitness: What is recorded.
        best_individual: (3,) candidate of the greatest fitness so far.
    """

    def __init__(self, fitness: PatternFitness) -> None:
        self.fitness = fitness
        self._start = time.thread_time()
        self._log: list[tuple[float, int, float]] = []
        self._evaluations = 0
        self._best = -np.inf
        self.best_individual = np.empty(0)

    def __call__(self, population: Array) -> Array:
        """Return the whole fitness of (P, 3) candidates."""
        return self._note(population, self.fitness(population))

    def fitness_in_camera(self, camera: int, population: Array) -> Array:
        """Return the fitness by one camera's parallelism, never above the whole one."""
        return self._note(population, self.fitness.fitness_in_camera(camera, population))

    def fitness_in_each_camera(self, populations: Array) -> Array:
        """Return the fitness of one population a camera by that camera's parallelism."""
        values = self.fitness.fitness_in_each_camera(populations)
        self._note(populations.reshape(-1, populations.shape[-1]), values.ravel())
        return values

    def _note(self, population: Array, values: Array) -> Array:
        self._evaluations += len(values)
        top = int(values.argmax())
        if values[top] > self._best:
            self._best, self.best_individual = float(values[top]), population[top].copy()
        self._log.append((time.thread_time() - self._start, self._evaluations, self._best))
        return values

    @property
    def best(self) -> float:
        """The greatest fitness so far."""
        return self._best

    @property
    def total(self) -> tuple[float, int]:
        """Seconds and evaluations up to the last call."""
        return self._log[-1][:2]

    def reached(self, target: float) -> tuple[float, int] | None:
        """Return seconds and evaluations when a fitness was first reached, None if never."""
        return next(((seconds, n) for seconds, n, best in self._log if best >= target), None)


Optimiser = Callable[[Recorder, Array, Array, int], object]


def search_box() -> tuple[Array, Array]:
    """Return the box the calibrator searches."""
    lower, upper = CalibratorConfig().search.bounds()
    return np.array(lower), np.array(upper)


def ours(fitness: Recorder, lower: Array, upper: Array, seed: int) -> None:
    """Run the calibrator's search: one population for each camera's parallelism, side by side."""
    rng = np.random.default_rng(seed)
    maximise_each(fitness.fitness_in_each_camera, lower, upper, CalibratorConfig().genetic, rng, len(SIDES))


def scipy_de(fitness: Recorder, lower: Array, upper: Array, seed: int) -> None:
    """Run scipy's differential evolution on the whole fitness."""
    _scipy_run(fitness, lower, upper, seed)


def scipy_de_by_camera(fitness: Recorder, lower: Array, upper: Array, seed: int) -> None:
    """Run scipy's differential evolution once for each camera's parallelism, as ours does."""
    for camera in range(len(SIDES)):
        _scipy_run(partial(fitness.fitness_in_camera, camera), lower, upper, seed)


def _scipy_run(fitness: Callable[[Array], Array], lower: Array, upper: Array, seed: int) -> None:
    differential_evolution(
        lambda population: -fitness(population.T),
        list(zip(lower, upper, strict=True)),
        vectorized=True,
        updating="deferred",
        tol=DE_TOLERANCE,
        maxiter=GENERATIONS,
        polish=False,
        rng=seed,
    )


class _PymooProblem(Problem):
    """The fitness as pymoo wants it."""

    def __init__(self, fitness: Recorder, lower: Array, upper: Array) -> None:
        super().__init__(n_var=len(lower), n_obj=1, xl=lower, xu=upper)
        self._fitness = fitness

    def _evaluate(self, population: Array, out: dict[str, Array], *_: object, **__: object) -> None:
        out["F"] = -self._fitness(population)[:, None]


def pymoo_ga(fitness: Recorder, lower: Array, upper: Array, seed: int) -> None:
    """Run pymoo's genetic algorithm."""
    problem = _PymooProblem(fitness, lower, upper)
    crossover = SBX(eta=PYMOO_ETA, prob=PYMOO_CROSSOVER, prob_var=1.0)
    minimize(
        problem,
        GA(pop_size=POPULATION, crossover=crossover),
        ("n_gen", GENERATIONS),
        seed=seed,
        verbose=False,
    )


def deap_simple(fitness: Recorder, lower: Array, upper: Array, seed: int) -> None:
    """Run DEAP's eaSimple on real numbers in the unit cube."""
    random.seed(seed)  # DEAP draws from the global generator
    if not hasattr(creator, "BenchIndividual"):
        creator.create("BenchFitness", base.Fitness, weights=(1.0,))
        creator.create("BenchIndividual", list, fitness=creator.BenchFitness)
    n_dim = len(lower)

    def evaluate_all(_: object, individuals: Iterable[Iterable[float]]) -> list[tuple[float]]:
        unit = np.array([list(individual) for individual in individuals])
        values = fitness(lower + np.clip(unit, 0.0, 1.0) * (upper - lower))
        return [(float(value),) for value in values]

    box = base.Toolbox()
    box.register("individual", tools.initRepeat, creator.BenchIndividual, random.random, n_dim)
    box.register("population", tools.initRepeat, list, box.individual)
    box.register("evaluate", lambda individual: individual)
    box.register("map", evaluate_all)
    box.register("mate", tools.cxBlend, alpha=DEAP_BLEND)
    box.register("mutate", tools.mutGaussian, mu=0.0, sigma=DEAP_STEP, indpb=DEAP_GENE_SHARE)
    box.register("select", tools.selTournament, tournsize=DEAP_TOURNAMENT)
    algorithms.eaSimple(
        box.population(n=POPULATION), box, DEAP_CROSSOVER, DEAP_MUTATION, GENERATIONS, verbose=False
    )


OPTIMISERS: dict[str, Optimiser] = {
    "ours, a run for each camera": ours,
    "scipy differential_evolution": scipy_de,
    "the same, a run for each camera": scipy_de_by_camera,
    "pymoo GA": pymoo_ga,
    "DEAP eaSimple": deap_simple,
}
