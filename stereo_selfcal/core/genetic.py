"""Genetic algorithm (paper section 2.3, Table II)."""

from __future__ import annotations

from dataclasses import dataclass

from .extrinsics import Array


@dataclass(frozen=True, slots=True, eq=False)
class GeneticResult:
    """Report of one run.

    Attributes:
        best: (D,) best individual.
        fitness: Its fitness.
        converged: Whether the stopping rule was met before the generations ran out.
        message: Why the run ended.
        generations: Generations evaluated after the first population.
        evaluations: Fitness evaluations.
        history: (generations + 1,) best fitness after every generation.
    """

    best: Array
    fitness: float
    converged: bool
    message: str
    generations: int
    evaluations: int
    history: Array
