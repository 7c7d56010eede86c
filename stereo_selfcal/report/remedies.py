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

"""What to do about every reason for a refusal, for reports that count refusals instead of telling each."""

from __future__ import annotations

from ..core.evidence.gates import GATES
from ..core.lanes.frame_checks import FIND_LINES
from ..core.rejection import RejectReason
from ..core.search.refusal import FIND_ROAD, LOOK_AT_ROAD
from ..offline import FrameRow

# The remedies of the checks before there is an estimate; those of the gates are in GATES.
_BEFORE_GATES = {
    RejectReason.IMAGE_EMPTY: "check the camera driver: there are no pixels, or too few",
    RejectReason.IMAGE_TYPE: "convert the images to 8-bit grey",
    RejectReason.CAMERA_INFO_UNUSABLE: "publish the CameraInfo of a stereo calibration with these images",
    RejectReason.IMAGE_UNREADABLE: "check the camera driver and the disk the recording was made on",
    RejectReason.IMAGE_FROZEN: "restart the camera that repeats its last image, and its driver",
    RejectReason.IMAGE_SIZES_DIFFER: "set both cameras to one size",
    RejectReason.RIG_SIZE_MISMATCH: "use the rig (CameraInfo) of these images",
    RejectReason.CAMERAS_SWAPPED: "exchange the topics of the left and the right image",
    RejectReason.NO_LINES_FOUND: FIND_ROAD,
    RejectReason.ROAD_NOT_SEEN: LOOK_AT_ROAD,
    RejectReason.LINES_NOT_MATCHED: (
        f"check that the images are rectified and left and right not swapped; else {FIND_LINES}"
    ),
    RejectReason.LINES_NOT_CONVERGING: "the horizon must be in view: pitch the camera up",
    RejectReason.IMAGES_UPSIDE_DOWN: "turn the images by 180 deg, with a CameraInfo of them, and exchange "
    "left and right where the whole rig hangs upside down",
    RejectReason.IMAGES_MIRRORED: "check the mirror and flip settings of both cameras and their drivers",
    RejectReason.NO_FRAMES: "record stereo frames",
    RejectReason.INTERNAL_ERROR: "a fault of this program: report it with the traceback from the log",
}


def remedies() -> dict[str, str]:
    """Return the remedy of every reason, by its word, where nothing is known of a single frame."""
    found = {str(reason): text for reason, text in _BEFORE_GATES.items()}
    for gate in GATES:
        found.setdefault(str(gate.reason), gate.remedy)
    return found


def remedy_of(row: FrameRow) -> str:
    """Return what to do about a refused frame."""
    known = remedies().get(row.reason or "")
    return known or ("" if row.rejection is None else row.rejection.remedy)
