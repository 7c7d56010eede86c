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

"""The result of an alignment of the texture of the road surface, and whether it is sufficient."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..geometry.pose import Extrinsics
from ..geometry.uncertainty import UncertaintyTerm, total_covariance
from ..road.unevenness import RoadUnevenness
from ..tolerances import AGREEMENT, MAX_NOISE_STD
from ..types import Array

MIN_SIGMAS = 8.0  # least texture common to both images, in standard errors
MIN_CELL_SHARE = 0.4  # least share of the area whose cells have texture and agree with the plane


@dataclass(frozen=True, slots=True)
class TextureQuality:
    """Whether the road has enough texture, as figures.

    Attributes:
        sigmas: Texture common to both images over its standard error, for all cells together.
        cell_share: Share of the road's sampled area, up to 15 m ahead, whose cells have texture and agree
            with the plane.
        pixel_share: Share of the samples that were used: neither saturated, nor paint, nor outliers.
        correlation: Correlation of both images after the alignment, with the means of the segments removed.
        noise_std: Standard deviations of height [m], pitch, roll [rad] caused by the images' noise alone.
        strip_share: As ``cell_share``, of the strip under the car alone: what is beside it may be a pavement.
    """

    sigmas: float
    cell_share: float
    pixel_share: float
    correlation: float
    noise_std: tuple[float, float, float]
    strip_share: float = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class TextureFit:
    """Outcome of the alignment.

    Attributes:
        extrinsics: Height, pitch and roll over the plane of the sampled road.
        terms: Terms of the covariance of height, pitch and roll.
        quality: Whether there is enough texture, as figures.
        unevenness: Deviation of the road from a plane.
        cells_xy_m: (C, 2) middles of the cells on the road [m].
        cells_height_m: (C,) heights over the plane [m]; NaN without texture.
        cells_weight: (C,) robust weights, 0 ... 1.
        cells_variance: (C,) variances of the heights caused by the noise of the images [m^2].
        halves: Differences (3,) of the poses by near and far, and by left and right half of the road, with
            their standard deviations (3,) [m, rad, rad].
        attempt: Which attempt it is: a road with little texture needs more blur.
    """

    extrinsics: Extrinsics
    terms: tuple[UncertaintyTerm, ...]
    quality: TextureQuality
    unevenness: RoadUnevenness
    cells_xy_m: Array
    cells_height_m: Array
    cells_weight: Array
    cells_variance: Array
    halves: tuple[tuple[Array, Array], ...] = ()
    attempt: int = 0

    @property
    def covariance(self) -> Array:
        """(3, 3) of height, pitch and roll: the sum of the terms."""
        return total_covariance(self.terms)

    @property
    def common_texture(self) -> bool:
        """Whether both images show the same texture, on a sufficient share of the road."""
        return self.quality.sigmas >= MIN_SIGMAS and self.quality.cell_share >= MIN_CELL_SHARE

    @property
    def enough_texture(self) -> bool:
        """Whether the texture is sufficient for an estimate."""
        return self.common_texture and bool(np.all(np.array(self.quality.noise_std) <= MAX_NOISE_STD))

    @property
    def sufficiency(self) -> float:
        """The least of texture, area and precision, each over its limit: below 1 it is no cross-check."""
        of_texture, of_area = self.quality.sigmas / MIN_SIGMAS, self.quality.cell_share / MIN_CELL_SHARE
        of_noise = MAX_NOISE_STD / self.quality.noise_std
        return float(min(of_texture, of_area, *of_noise, *(AGREEMENT / np.sqrt(np.diag(self.covariance)))))
