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

"""What a turn of the right camera that a drive has found means for the pose over the road.

A pose is that of the rig as its CameraInfo has it. Single frames hardly tell the yaw of the right camera; a
drive does. Where it has turned, the standard deviation of the pose holds what that does to it, and where it
makes the pose wrong, there is no calibration.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ..camera.rig import StereoRig
from ..evidence.camera_yaw import YawTold, wrong_yaw_rad, yaw_posterior
from ..evidence.rig_unknowns import RigStd, response_of_surface
from ..geometry.uncertainty import UncertaintyTerm, merge_terms, total_covariance
from ..rejection import Bound, Rejection, RejectReason
from ..results import CalibrationResult, announce, rejected

_REMEDY = (
    "calibrate the pair again, or correct its CameraInfo: the right camera has turned about the vertical"
)
_TERM = "vergence"


def with_doubt_of_rig(fused: CalibrationResult, rig: StereoRig) -> CalibrationResult:
    """Return a fused estimate with what the drive tells of the yaw of the right camera.

    The part of the covariance by that yaw becomes what the drive leaves of it, where that is more than the
    single frames have assumed.

    Args:
        fused: The fused estimate of a drive, with its alignment.
        rig: Intrinsics and baseline.

    Returns:
        The estimate; a refusal where the yaw makes the pose wrong.
    """
    pose, alignment = fused.extrinsics, fused.alignment
    if pose is None or alignment is None or not fused.confirmed_by_texture:
        return fused
    corrected_rad = alignment.yaw_corrected_rad
    told = YawTold(alignment.yaw_rad - corrected_rad, float(alignment.std[2]))
    yaw = yaw_posterior([told], None, rig, calibrated=True, corrected_rad=corrected_rad)
    if abs(yaw.yaw_rad) > wrong_yaw_rad(rig, pose):
        what = (
            "over the frames so far, the right camera looks {value} farther to the "
            f"{'left' if yaw.yaw_rad > 0.0 else 'right'} than its calibration has it "
            f"(std {math.degrees(yaw.std_rad):.3f} deg)"
        )
        limit = math.degrees(wrong_yaw_rad(rig, pose))
        numbers = math.degrees(abs(yaw.yaw_rad)), Bound.MOST, limit, "deg"
        refusal = Rejection(RejectReason.IMAGES_NOT_RECTIFIED, what, *numbers, _REMEDY)
        return replace(
            rejected(refusal, fused.stamp_s),
            alignment=alignment,
            delay=fused.delay,
        )
    change = response_of_surface(rig, pose, RigStd(yaw_rad=yaw.rms_rad)).changes[:, 0]
    assumed = sum(float(each.covariance[1, 1]) for each in fused.uncertainty if each.name == _TERM)
    if change[1] ** 2 <= assumed:
        return fused
    others = [each for each in fused.uncertainty if each.name != _TERM]
    terms = merge_terms((*others, UncertaintyTerm(_TERM, np.outer(change, change))))
    wider = replace(fused, covariance=total_covariance(terms), uncertainty=terms)
    return replace(wider, message=announce(wider))
