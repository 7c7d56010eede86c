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

"""The transform of the camera in ``/diagnostics``. Needs no ROS."""

from __future__ import annotations

from dataclasses import dataclass

from ..core.geometry.travel import Travel
from ..files.frames import PlacedCamera
from ..published.status import yaw_values

_WAITS = "waits for the CameraInfo of both cameras, which name their frames"


@dataclass(frozen=True, slots=True)
class TransformReport:
    """Where the camera is in the vehicle, as it is published.

    Attributes:
        placed: The camera; None where it is not published.
        told: What is to be known of it, a sentence each; none where all is well.
    """

    placed: PlacedCamera | None = None
    told: tuple[str, ...] = ()

    @property
    def faults(self) -> tuple[str, ...]:
        """What keeps the transform from who needs it; a yaw that is not known does not."""
        unknown_yaw = "" if self.placed is None else self.placed.yaw_remark
        return tuple(text for text in self.told if text != unknown_yaw)

    def values(self, travel: Travel | None) -> dict[str, str]:
        """Return what there is to report, by its keys.

        Args:
            travel: The direction of travel by the active calibration.
        """
        values = yaw_values(travel)
        if self.placed is None:
            return values | {"transform": _WAITS}
        axes = self.placed.camera.axes.value
        whole = f"{axes} frame {self.placed.child or 'without a name'} in {self.placed.parent}"
        return values | {"transform": "; ".join([whole, *self.told])}
