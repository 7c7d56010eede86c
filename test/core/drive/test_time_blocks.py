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

"""Means over ten seconds: of which frames they are, and by how much they scatter."""

import math

import numpy as np
import pytest
from drive_making import MOTION, NOISE, POSE, make_drive, series_of

from stereo_selfcal.core.drive.time_blocks import (
    BLOCK_S,
    BlockScatter,
    TimeBlocks,
    blocks_of,
    measure_scatter_of_blocks,
    without_excursions,
)


def test_blocks_are_those_that_have_frames():
    stamps = np.array([100.0, 103.0, 109.9, 110.0, 135.0, 136.0])
    values = np.arange(18.0).reshape(6, 3)
    blocks = blocks_of(stamps, values)
    assert blocks.number.tolist() == [0, 1, 3]
    np.testing.assert_allclose(blocks.values[0], values[:3].mean(axis=0))
    np.testing.assert_allclose(blocks.values[1:], [values[3], values[4:].mean(axis=0)])


def test_a_wild_frame_is_not_in_the_mean_of_its_block():
    rng = np.random.default_rng(0)
    stamps, values = np.arange(200) / 4.0, rng.normal(size=(200, 3))
    expected = blocks_of(stamps, values).values
    wild = values.copy()
    wild[50] += 100.0
    np.testing.assert_allclose(blocks_of(stamps, wild).values, expected, atol=0.3)


def test_excursions_are_left_out_and_moves_stay():
    rng = np.random.default_rng(1)
    values = rng.normal(size=(60, 3))
    values[30:] += 20.0
    values[10] += 20.0
    kept = without_excursions(TimeBlocks(np.arange(60), values))
    assert 10 not in kept.number
    assert {28, 29, 30, 31} <= set(kept.number.tolist())


@pytest.mark.parametrize("correlation_s", [0.5, 2.0])
def test_means_of_blocks_scatter_by_motion_and_noise(correlation_s):
    """Over many blocks: by motion over the time it lasts, and noise over the frames."""
    sigmas = []
    for seed in range(4):
        drive = series_of(*make_drive(1800.0, 1.0, correlation_s, seed, outliers=0.0))
        blocks = blocks_of(drive.times_s, drive.values)
        sigmas.append(measure_scatter_of_blocks(drive, blocks).sigma)
    keep = math.exp(-1.0 / correlation_s)
    in_block = MOTION**2 / BLOCK_S * (1.0 + keep) / (1.0 - keep) + NOISE**2 / BLOCK_S
    ratio = np.mean(sigmas, axis=0) / np.sqrt(in_block)
    assert np.all(ratio > 0.75) and np.all(ratio < 1.5)


def test_moves_between_levels_are_no_scatter():
    drive = make_drive(1800.0, 1.0, seed=5, outliers=0.0)
    moved = make_drive(1800.0, 1.0, seed=5, outliers=0.0, steps=((700.0, 40.0 * MOTION),))
    scatters = []
    for each in (drive, moved):
        series = series_of(*each)
        scatters.append(measure_scatter_of_blocks(series, blocks_of(series.times_s, series.values)).sigma)
    np.testing.assert_allclose(scatters[1], scatters[0], rtol=0.3)
    assert POSE.shape == scatters[0].shape


def test_a_shift_is_judged_by_the_blocks_on_both_sides():
    scatter = BlockScatter(np.array([1.0, 2.0, 4.0]))
    np.testing.assert_allclose(scatter.statistic(np.array([-1.0, 1.0, 2.0]), 2, 2), [1.0, 0.5, 0.5])
    of_many = scatter.statistic(np.ones((5, 3)), np.full(5, 8), np.full(5, 8))
    np.testing.assert_allclose(of_many, np.tile([2.0, 1.0, 0.5], (5, 1)))
