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

"""What a frame tells of the alignment, without what would be assumed of it had it told nothing."""

from __future__ import annotations

import numpy as np

from ..geometry.alignment import Alignment
from ..road.priors import TURNED_STD_RAD
from ..types import Array
from .far_disparity import MOST_TURN_RAD

# Variances of pitch, roll and yaw that nothing tells. Rows that were not compared may be those of a pair that
# has turned. The yaw may be anything up to the largest turn that is measured.
UNTOLD_VARIANCES: Array = np.array([TURNED_STD_RAD**2, TURNED_STD_RAD**2, MOST_TURN_RAD**2 / 3.0])
# Less than this part of the variance tells nothing: it is the error of its computation.
_LEAST_PART = 1e-6


def told_variances(alignment: Alignment) -> Array:
    """Return the variances (3,) of what is seen of the angles; infinite where an angle is not told.

    A frame that tells nothing has a variance, too. Were it taken for an independent measurement of zero, a
    thousand pictures of fog would show that no camera has turned.

    Args:
        alignment: The alignment of a frame.
    """
    variances = np.where(alignment.known(), np.diag(alignment.covariance), np.inf)
    information = 1.0 / variances - 1.0 / UNTOLD_VARIANCES
    told = information > _LEAST_PART / UNTOLD_VARIANCES
    return np.where(told, 1.0 / np.where(told, information, 1.0), np.inf)


def with_untold(variances: Array) -> Array:
    """Return the variances (3,) of angles that are told with these, which may be infinite."""
    all_of_them: Array = 1.0 / (1.0 / variances + 1.0 / UNTOLD_VARIANCES)
    return all_of_them
