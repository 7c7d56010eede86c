"""What counts as the same road, as wrong, as a kerb: every such limit, once."""

from __future__ import annotations

import numpy as np

from .types import Array

# What stripes and texture have to agree within (height [m], pitch, roll [rad]); beyond, it is another road.
AGREEMENT = np.array([0.030, np.radians(0.25), np.radians(0.8)])
# Enough texture: noise decides less than a third of that, one false alarm in 370. The whole uncertainty, with
# the road's own shape, has to be below it: else the comparison says nothing.
MAX_NOISE_STD = AGREEMENT / 3.0
# Height [m], pitch, roll [rad] by which both may differ all the same, as far as the lever of the nearest line
# stretches that: an estimate off by this is called wrong, and the asphalt alone is better by half.
MAX_DIFFERENCE = np.array([0.060, np.radians(0.5), np.radians(1.2)])
# The same, of an estimate that has nothing but its own standard deviation to show that it is not wrong.
WRONG = MAX_DIFFERENCE.copy()
# Asphalt that says how high a line or a plane lies excludes what is this many of its standard deviations off:
# a second question, after all of the asphalt has agreed.
KERB_SIGMAS = 2.0
# Painted lines lie in the asphalt; the lowest kerbs are 6 cm high, and half of that tells them apart.
MAX_LINE_HEIGHT_M = 0.030
# Smaller shifts are those of load and speed: one person more in a car does as much. Height [m], pitch, roll
# [rad].
LEAST_SHIFT: Array = np.array([0.010, np.radians(0.10), np.radians(0.15)])
# What load, speed and fuel move over an hour without anybody having touched the camera, standard deviations:
# no drift. Height [m], pitch, roll [rad].
WANDER_STD: Array = np.array([0.001, np.radians(0.005), np.radians(0.01)])
# Twice what is called wrong: a tape measure and a spirit level on the parked car tell as much.
MAX_STD = 2.0 * WRONG
