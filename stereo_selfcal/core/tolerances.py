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

"""Limits of what counts as the same road, as wrong, as a kerb or as a shift: each is defined here once."""

from __future__ import annotations

import numpy as np

from .types import Array

# Estimates from stripes and texture must agree to within this (height [m], pitch, roll [rad]); beyond, they
# are of different roads.
AGREEMENT = np.array([0.030, np.radians(0.25), np.radians(0.8)])
# The texture is sufficient where the standard deviation by noise alone is at most this, a third of AGREEMENT:
# one false alarm in 370. The whole uncertainty, with the unevenness of the road, has to be below AGREEMENT;
# otherwise the comparison shows nothing.
MAX_NOISE_STD = AGREEMENT / 3.0
# Greatest difference between stripes and texture in height [m], pitch, roll [rad], as far as the lever of the
# nearest line enlarges it. An estimate with a larger error is called wrong; the road surface alone is twice
# as accurate.
MAX_DIFFERENCE = np.array([0.060, np.radians(0.5), np.radians(1.2)])
# The same for an estimate whose only evidence that it is not wrong is its own standard deviation: beyond,
# nobody can use it.
WRONG = MAX_DIFFERENCE.copy()
# An estimate excludes another one that differs by this many standard deviations of both, and is wrong then.
EXCLUDED_SIGMAS = 5.0
# The chi-squared of three numbers that normal errors exceed as rarely.
EXCLUDED_CHI2_3 = 31.8
# The surface of the lane excludes the height of a line or a plane that differs by this many of its standard
# deviations. It is a second check, after the whole surface has agreed with the lines.
KERB_SIGMAS = 2.0
# Painted lines lie in the road surface. The lowest kerbs are 6 cm high, and half of that tells them apart.
MAX_LINE_HEIGHT_M = 0.030
# Smaller shifts are caused by load and speed: one more person in a car has the same effect. Height [m],
# pitch, roll [rad].
LEAST_SHIFT: Array = np.array([0.010, np.radians(0.10), np.radians(0.15)])
# Standard deviations of the changes by load, speed and fuel over an hour, without a shift of the camera:
# these are no drift. Height [m], pitch, roll [rad].
WANDER_STD: Array = np.array([0.001, np.radians(0.005), np.radians(0.01)])
# Standard deviations of a mount that are good enough, unless a user asks for others: half a minute of usual
# drive reaches them with each rig of `benchmarks/results/mount_how_long.md`, on roads whose surface is seen.
# The angles are 0.12 and 0.25 deg.
DEFAULT_HEIGHT_STD_M = 0.010
DEFAULT_PITCH_STD_RAD = 0.0021
DEFAULT_ROLL_STD_RAD = 0.00436
