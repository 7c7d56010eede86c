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

"""Random worlds, good and bad mixed: what is accepted must be right."""

from __future__ import annotations

import multiprocessing
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial

import cv2
import numpy as np

from stereo_selfcal import calibrate
from stereo_selfcal.synth.renderer import Frame
from stereo_selfcal.synth.world_recipes import INGREDIENTS
from stereo_selfcal.synth.worlds import BAD_SHARE, GOOD_SHARE, World, random_world, render_world

from .frames import READABLE, UNITS, Array, rms
from .options import Options
from .table import Table, numbers

# Development uses other first numbers. Which of these are wrong is in the table, though, and has been read.
SEED = 70_000
# Drawn by secrets.randbelow when the estimator was finished: nobody has looked at these worlds before they
# were measured. Whoever changes the estimator afterwards draws another one.
FRESH_SEED = 423004
PROCESSES = 2
CHUNK = 4  # worlds handed to a process at a time

# A result is wrong when one of its values is off by more than both of these ...
WRONG_SIGMAS = 5.0
WRONG = np.array([30.0, 0.3, 0.8])  # mm, deg, deg
# ... and grossly so beyond this, whatever it said of itself.
GROSS = np.array([60.0, 0.5, 1.2])

TOP_REASONS = 3


@dataclass(frozen=True)
class WorldVerdict:
    """What the calibrator made of one world.

    Attributes:
        index: Number of the world.
        expected: "accept", "either" or "refuse".
        names: Its ingredients and its rig.
        reason: Why it was refused, "" when it was accepted.
        error: Estimate minus truth (mm, deg, deg); empty when refused.
        std: Reported standard deviations in the same units; empty when refused.
        witness: Whether the asphalt was asked, and agreed.
    """

    index: int
    expected: str
    names: tuple[str, ...]
    reason: str
    error: Array
    std: Array
    witness: bool = False

    @property
    def accepted(self) -> bool:
        """Whether there is a result."""
        return not self.reason

    @cached_property
    def wrong(self) -> bool:
        """Whether it was accepted and is wrong, by its own measure and by an absolute one."""
        off = np.abs(self.error)
        return self.accepted and bool(np.any((off > WRONG_SIGMAS * self.std) & (off > WRONG)))

    @cached_property
    def gross(self) -> bool:
        """Whether it was accepted and is grossly wrong."""
        return self.accepted and bool(np.any(np.abs(self.error) > GROSS))


def world(index: int, seed: int = SEED) -> World:
    """Return one of the worlds; ``index`` and ``seed`` alone decide."""
    return random_world(np.random.default_rng([seed, index]))


def world_frame(index: int, seed: int = SEED) -> tuple[World, Frame, Frame]:
    """Return one of the worlds and its frame."""
    drawn = world(index, seed)
    return drawn, *render_world(drawn, np.random.default_rng([seed, index, 1]))


def judge_world(index: int, seed: int = SEED) -> WorldVerdict:
    """Calibrate one world."""
    drawn, left, right = world_frame(index, seed)
    result = calibrate(left, right, drawn.scene.rig)
    names = (*(drawn.ingredients or ("nothing else",)), f"rig {drawn.rig_name}")
    if result.extrinsics is None or result.covariance is None:
        return WorldVerdict(index, drawn.expected, names, str(result.reason), np.empty(0), np.empty(0))
    error = (result.extrinsics.as_array() - drawn.truth.as_array()) * READABLE
    std = np.sqrt(np.diag(result.covariance)) * READABLE
    return WorldVerdict(index, drawn.expected, names, "", error, std, result.confirmed_by_texture)


def judge_worlds(number: int, seed: int = SEED) -> list[WorldVerdict]:
    """Calibrate the first worlds of a seed, in processes of their own."""
    # Started afresh ("spawn"), the same on every system; each with one thread, as everything here.
    context = multiprocessing.get_context("spawn")
    with context.Pool(min(PROCESSES, number), initializer=cv2.setNumThreads, initargs=(1,)) as pool:
        return pool.map(partial(judge_world, seed=seed), range(number), chunksize=CHUNK)


def world_tables(options: Options) -> Iterator[Table]:
    """Count what is accepted and what is wrong, by verdict expected and by ingredient."""
    verdicts = judge_worlds(options.worlds)
    yield _by_expectation(verdicts, "worlds", f"{len(verdicts)} random worlds")
    yield by_ingredient(verdicts)
    yield _faults(verdicts)
    fresh = judge_worlds(options.worlds, FRESH_SEED)
    yield _by_expectation(fresh, "worlds_fresh", f"{len(fresh)} worlds that nobody had looked at before")
    yield _wrong(fresh)


HEADER = ["n", "accepted", "wrong", "gross", f"error / std, RMS ({', '.join(UNITS)})"]


def _by_expectation(verdicts: list[WorldVerdict], name: str, title: str) -> Table:
    limits = " / ".join(f"{value:g}" for value in WRONG)
    gross = " / ".join(f"{value:g}" for value in GROSS)
    table = Table(
        name,
        title,
        ["expected", *HEADER, "error, median of |x|"],
        f"Wrong: accepted and off by more than {WRONG_SIGMAS:g} reported standard deviations and by "
        f"more than {limits} ({', '.join(UNITS)}); gross: by more than {gross}. Good worlds (accept) are "
        f"drawn with a probability of {GOOD_SHARE:.0%}, bad ones (refuse) with {BAD_SHARE:.0%}; in the rest, "
        "and where noise drowns the paint or hardly any is in view, a result is welcome if right (either). "
        "Asked: 95 % of the good ones accepted, none wrong.",
    )
    groups: dict[str, Callable[[WorldVerdict], bool]] = {
        "accept": lambda verdict: verdict.expected == "accept",
        "either": lambda verdict: verdict.expected == "either",
        "refuse": lambda verdict: verdict.expected == "refuse",
        "all": lambda verdict: True,
        "with the asphalt as a witness": lambda verdict: verdict.witness,
        "by the lines alone": lambda verdict: verdict.accepted and not verdict.witness,
    }
    for which, belongs in groups.items():
        group = [verdict for verdict in verdicts if belongs(verdict)]
        errors = [np.abs(verdict.error) for verdict in group if verdict.accepted]
        table.add(which, *_counts(group), numbers(np.median(errors, axis=0)) if errors else "-")
    return table


def by_ingredient(verdicts: list[WorldVerdict]) -> Table:
    """Return the table of the same worlds by what is in them, rigs included."""
    table = Table(
        "worlds_ingredients",
        "The same by ingredient",
        ["ingredient", "expected", *HEADER, "accepted of the good ones", "refused as"],
        "A world has up to five ingredients and counts for each of them.",
    )
    for name in sorted({name for verdict in verdicts for name in verdict.names}):
        group = [verdict for verdict in verdicts if name in verdict.names]
        good = [verdict.accepted for verdict in group if verdict.expected == "accept"]
        reasons = Counter(verdict.reason for verdict in group if not verdict.accepted)
        told = ", ".join(f"{reason} {count}" for reason, count in reasons.most_common(TOP_REASONS))
        expected = INGREDIENTS[name].expected if name in INGREDIENTS else "-"
        table.add(name, expected, *_counts(group), f"{sum(good)}/{len(good)}" if good else "-", told)
    return table


def _faults(verdicts: list[WorldVerdict]) -> Table:
    return _listed(
        "worlds_faults",
        "The wrong ones, and the good ones that were refused",
        SEED,
        [
            each
            for each in verdicts
            if each.wrong or each.gross or (each.expected == "accept" and each.reason)
        ],
    )


def _wrong(verdicts: list[WorldVerdict]) -> Table:
    wrong = [verdict for verdict in verdicts if verdict.wrong or verdict.gross]
    return _listed("worlds_fresh_wrong", "The wrong and gross ones among them", FRESH_SEED, wrong)


def _listed(name: str, title: str, seed: int, verdicts: list[WorldVerdict]) -> Table:
    table = Table(
        name,
        title,
        ["world", "expected", "ingredients", "refused as", f"error ({', '.join(UNITS)})", "reported std"],
        f"The number makes the world anew: `benchmarks.worlds.world_frame(number, {seed})`.",
    )
    for verdict in verdicts:
        shown = [numbers(values) if len(values) else "-" for values in (verdict.error, verdict.std)]
        names = ", ".join(verdict.names)
        table.add(str(verdict.index), verdict.expected, names, verdict.reason or "-", *shown)
    return table


def _counts(group: list[WorldVerdict]) -> tuple[str, ...]:
    """Return the cells under :data:`HEADER`."""
    accepted = [verdict for verdict in group if verdict.accepted]
    share = f"{len(accepted)} ({len(accepted) / len(group):.1%})" if group else "0"
    ratio = numbers(rms([verdict.error / verdict.std for verdict in accepted])) if accepted else "-"
    wrong, gross = (sum(getattr(verdict, name) for verdict in group) for name in ("wrong", "gross"))
    return str(len(group)), share, str(wrong), str(gross), ratio
