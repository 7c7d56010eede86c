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

"""How far a call of ``~/calibrate`` has come, as a sentence and as numbers. Needs no ROS."""

from __future__ import annotations

from dataclasses import dataclass

from ..core.drive.targets import Targets, describe_std
from ..core.geometry.pose import POSE_COMPONENTS, Extrinsics


@dataclass(frozen=True, slots=True)
class CallProgress:
    """What a call has so far.

    Attributes:
        accepted: Accepted frames.
        seen: Frames that went through the calibrator, or were refused before.
        elapsed_s: Time since the call began [s].
        timeout_s: Time after which it ends [s].
        targets: What it waits for.
        std: Standard deviations of the estimate; None before the first one.
        last_refusal: Word of the last refusal's reason, "" before the first one.
    """

    accepted: int
    seen: int
    elapsed_s: float
    timeout_s: float
    targets: Targets
    std: Extrinsics | None = None
    last_refusal: str = ""

    @property
    def frames_text(self) -> str:
        """The frames as people read them: ``14 of 31 frames in 8 s``."""
        return f"{self.accepted} of {self.seen} frames in {self.elapsed_s:.0f} s"

    @property
    def text(self) -> str:
        """The progress as people read it: ``14 of 31 frames in 8 s; std 12 mm, 0.15, 0.3 deg; asked ...``."""
        text = self.frames_text
        if self.std is not None:
            text += f"; std {describe_std(self.std)}"
        elif self.last_refusal:
            text += f"; the last one was refused: {self.last_refusal}"
        if not self.targets.any_std:
            text += f"; asked {self.targets.describe()}"
        if self.accepted < self.targets.frames > 1:
            text += f"; at least {self.targets.frames} frames"
        return text

    def values(self) -> dict[str, str]:
        """Return the progress as values of ``/diagnostics``: numbers have SI units, named by the key."""
        values = {
            "call": self.text,
            "call_frames_accepted": str(self.accepted),
            "call_frames_seen": str(self.seen),
            "call_elapsed_s": f"{self.elapsed_s:.3f}",
            "call_timeout_s": repr(self.timeout_s),
        }
        for component in POSE_COMPONENTS:
            if self.std is not None:
                values[f"call_{component.std_name}"] = repr(component.of(self.std))
            values[f"call_target_{component.std_name}"] = repr(component.of(self.targets.std))
        return values
