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

"""Blocks of rows with displacements as they are given, without an image behind them."""

import numpy as np

from stereo_selfcal.core.estimators.row_blocks import EdgeResiduals, RowBlocks


def make_blocks(displacement, information, variance=1.0, usable=None, ramp_sigmas=None):
    """Return blocks (2, L, N) that are off by (..., 3), with an information (..., 3, 3) that is broadcast."""
    displacement = np.array(displacement, dtype=float)
    shape = displacement.shape[:-1]
    information = np.array(np.broadcast_to(information, (*shape, 3, 3)))
    return RowBlocks(
        information=information,
        gradient=np.einsum("...ij,...j->...i", information, displacement),
        displacement=displacement,
        variance=variance,
        usable=np.ones(shape, bool) if usable is None else np.array(usable),
        ramp_sigmas=np.zeros(shape) if ramp_sigmas is None else np.array(ramp_sigmas),
        normal=np.zeros((*shape, 8, 8)),
    )


def make_residuals(off, columns, rows, information=1e6, variance=1.0, usable=None, ramp_sigmas=None):
    """Return what edges are off.

    Args:
        off: (2 cameras, L stripes, N, 2 edges) measured minus predicted columns [px].
        columns: (2, L, 2, N) predicted columns [px], straight in the rows.
        rows: (N,) rows [px].
        information: Of a displacement, for noise of variance 1; or (2, L, N, 2) of them.
        variance: Of the grey values.
        usable: (2, L, N), all by default.
        ramp_sigmas: (2, L, N), 0 by default.
    """
    off = np.array(off, dtype=float)
    of_edges = np.broadcast_to(information, off.shape)
    diagonal = np.concatenate([of_edges, np.ones((*off.shape[:-1], 1))], axis=-1)
    displacement = np.concatenate([off, np.zeros((*off.shape[:-1], 1))], axis=-1)
    blocks = make_blocks(displacement, diagonal[..., None] * np.eye(3), variance, usable, ramp_sigmas)
    slopes = (columns[..., -1] - columns[..., 0]) / (rows[-1] - rows[0])
    return EdgeResiduals(off, blocks, columns, slopes, rows)
