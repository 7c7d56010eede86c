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

"""How the right camera has turned in pitch and roll, as the rows of both images tell, and its correction.

Rows are compared by points of texture all over both images. Where these show too few, they are compared on
the road surface, and along the horizon once the pose over the road is known. What the rows tell is corrected
in the right image before anything else is estimated; the standard deviation of the rest is that of an unknown
of the rig.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from ..camera.rig import StereoRig
from ..estimators.coarse_road import USUAL_HEIGHT_M, n_disparities
from ..estimators.dense_disparity import DenseDisparities, SmallImages
from ..estimators.landmarks import Landmarks, describe_points
from ..estimators.matched_points import match_points
from ..estimators.row_alignment import LEAST_SMOOTH_PX, RowAlignment, align_rows, turn_by_smooth_rows
from ..geometry.alignment import Alignment, optical_rotation
from ..geometry.homography import camera_matrix
from ..geometry.pose import Extrinsics
from ..rejection import Bound, NotFitted, fitted
from ..road.priors import (
    BASELINE_DIRECTION_STD_RAD,
    CALIBRATED_TURN_STD_RAD,
    RECTIFICATION_STD_PX,
    TURNED_ROWS_PART,
    TURNED_STD_RAD,
)
from ..types import Array, Image
from .rig_unknowns import RigStd
from .row_offset import VerticalOffset, vertical_offset

# Rows tell a turn where its standard deviation is at most this part of what calibrations leave: with less,
# a correction would add about as much noise as it takes away.
_MOST_OF_PRIOR = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class CameraTurn:
    """Pitch and roll of the right camera against where the rig has it.

    Attributes:
        pitch_rad: Pitch [rad], with the sign of an :class:`..geometry.alignment.Alignment`.
        roll_rad: Roll [rad].
        covariance: (2, 2) of both.
        distortion_px: Standard deviation of the smooth error that no turn explains [px].
        points: What points all over both images tell; None where they show too few.
        landmarks: These points, so that another frame can find them again; None without any.
        lacking: Why the rows were not compared; None where they were.
        corrected: Whether the right image was turned back by it.
        of_frame: Whether it was measured in the same frame; else it is the mean of others.
    """

    pitch_rad: float
    roll_rad: float
    covariance: Array
    distortion_px: float = RECTIFICATION_STD_PX
    points: RowAlignment | None = None
    landmarks: Landmarks | None = None
    lacking: NotFitted | None = None
    corrected: bool = False
    of_frame: bool = True

    @property
    def seen(self) -> bool:
        """Whether the rows of both images were compared."""
        return self.lacking is None

    def as_array(self) -> Array:
        """Return pitch and roll (2,) [rad]."""
        return np.array([self.pitch_rad, self.roll_rad])

    @property
    def is_usual(self) -> bool:
        """Whether it is one that calibrations leave, which the standard deviations of all estimates hold."""
        return bool(np.all(np.abs(self.as_array()) <= CALIBRATED_TURN_STD_RAD[:2]))

    @property
    def std_rad(self) -> Array:
        """(2,) standard deviations of both."""
        std: Array = np.sqrt(np.diag(self.covariance))
        return std

    @classmethod
    def of_points(cls, rows: RowAlignment) -> CameraTurn:
        """Return the turn that the rows of matched points tell."""
        turn = float(rows.turn[0]), float(rows.turn[1])
        return cls(*turn, rows.covariance[:2, :2], rows.distortion_px, rows)

    @classmethod
    def of_offset(cls, offset: VerticalOffset, rig: StereoRig) -> CameraTurn:
        """Return the turn that the rows of the road or of the horizon tell."""
        smooth = turn_by_smooth_rows(LEAST_SMOOTH_PX, rig)
        stds = np.hypot([offset.std_px / rig.fy, offset.roll_std_rad], smooth)
        return cls(-offset.offset_px / rig.fy, -offset.roll_rad, np.diag(stds**2))

    @classmethod
    def known(cls, alignment: Alignment, rig: StereoRig) -> CameraTurn:
        """Return the turn that frames before have told, with the prior of calibrated pairs.

        Args:
            alignment: How the right camera is turned, by these frames.
            rig: Intrinsics.
        """
        if not np.all(alignment.known()[:2]):
            return cls.unknown(NotFitted("frames that tell the turn of the right camera", 0, Bound.LEAST, 1))
        distortion_px = rig.fx * alignment.unexplained_rad or RECTIFICATION_STD_PX
        turn = alignment.pitch_rad, alignment.roll_rad
        return with_prior(cls(*turn, alignment.covariance[:2, :2], distortion_px, of_frame=False))

    @classmethod
    def unknown(cls, why: NotFitted) -> CameraTurn:
        """Return what calibrations leave, where no rows are compared."""
        return cls(0.0, 0.0, np.diag(np.square(CALIBRATED_TURN_STD_RAD[:2])), lacking=why)

    def homography(self, rig: StereoRig, yaw_rad: float = 0.0) -> Array:
        """Return (3, 3) where a point lies in the right image, for where it would lie without the turn.

        Args:
            rig: Intrinsics.
            yaw_rad: The yaw of the camera, as far as it is to be corrected [rad].
        """
        matrix = camera_matrix(rig)
        rotation = optical_rotation(self.pitch_rad, self.roll_rad, yaw_rad)
        turned: Array = matrix @ rotation.T @ np.linalg.inv(matrix)
        return turned

    def rig_std(self, yaw_rad: float) -> RigStd:
        """Return the standard deviations of what remains unknown of the rig.

        Args:
            yaw_rad: That of the yaw of the right camera [rad].
        """
        variances = np.diag(self.covariance)
        if not self.corrected and self.seen:
            variances = variances + np.square([self.pitch_rad, self.roll_rad])
        pitch, roll = (math.sqrt(float(each)) for each in variances)
        measured = self.seen and self.of_frame
        return RigStd(pitch, roll, yaw_rad, self.distortion_px, rows_measured=measured, ahead=self._ahead)

    @property
    def _ahead(self) -> float:
        """How far ahead the right camera seems to sit, over the baseline, beyond what calibrations leave."""
        if self.landmarks is None or not math.isfinite(self.landmarks.ahead_std):
            return 0.0
        usual = math.hypot(self.landmarks.ahead_std, BASELINE_DIRECTION_STD_RAD)
        return math.sqrt(max(0.0, self.landmarks.ahead**2 - usual**2))


def measure_turn(
    images: tuple[Image, Image], rig: StereoRig, disparities: DenseDisparities, coarse: Extrinsics | None
) -> CameraTurn:
    """Compare the rows of both images, by points all over them; without such, on the road surface.

    Args:
        images: Left and right image, (H, W) uint8.
        rig: Intrinsics and baseline.
        disparities: Dense disparities of the left image.
        coarse: Pose over the road that these tell; None where they show none.
    """
    points = match_points(images, disparities)
    by_points = align_rows(points, rig)
    ahead = () if isinstance(by_points, NotFitted) else (by_points.ahead, by_points.ahead_std)
    landmarks = describe_points(images[0], points, *ahead)
    told = [] if isinstance(by_points, NotFitted) else [CameraTurn.of_points(by_points)]
    vague = by_points if isinstance(by_points, NotFitted) else _vague(told[0])
    on_road = None
    if vague is not None and coarse is not None:
        on_road = fitted(vertical_offset(images, rig, coarse))
    if on_road is not None:
        told.append(CameraTurn.of_offset(on_road, rig))
        vague = _vague(_mean(told))
    if vague is not None:
        return replace(CameraTurn.unknown(vague), landmarks=landmarks)
    return replace(with_prior(_mean(told)), landmarks=landmarks)


def find_landmarks(images: tuple[Image, Image], rig: StereoRig, ahead: float = 0.0) -> Landmarks:
    """Return points that the next frames may see again, without what their rows tell.

    Args:
        images: Left and right image, (H, W) uint8.
        rig: Intrinsics and baseline.
        ahead: How much farther ahead the right camera sat in the frame before, over the baseline.
    """
    small = SmallImages.of(images)
    disparities = small.match_blocks(n_disparities(rig, USUAL_HEIGHT_M, small.scale))
    return describe_points(images[0], match_points(images, disparities), ahead)


def _vague(turn: CameraTurn) -> NotFitted | None:
    """Return why a turn is hardly told; None where it is.

    The few points of a bare road are matched by chance, some of them.
    """
    most = _MOST_OF_PRIOR * np.array(CALIBRATED_TURN_STD_RAD[:2])
    index = int(np.argmax(turn.std_rad / most))
    value, limit = np.degrees([turn.std_rad[index], most[index]])
    if value < limit:
        return None
    what = f"standard deviation of the {('pitch', 'roll')[index]} that the rows of both images tell"
    return NotFitted(what, float(value), Bound.MOST, float(limit), "deg")


def _mean(told: Sequence[CameraTurn]) -> CameraTurn:
    """Return the mean of what tells a turn, weighted by information."""
    information = [np.linalg.inv(each.covariance) for each in told]
    covariance = np.linalg.inv(np.sum(information, axis=0))
    parts = [each @ turn.as_array() for each, turn in zip(information, told, strict=True)]
    pitch_rad, roll_rad = covariance @ np.sum(parts, axis=0)
    return replace(told[0], pitch_rad=float(pitch_rad), roll_rad=float(roll_rad), covariance=covariance)


def with_prior(measured: CameraTurn) -> CameraTurn:
    """Return a measured turn with the prior of calibrated pairs.

    Of these, few have turned by more than calibrations leave: the prior is a sum of two normal distributions,
    and so is what follows from it (Bayes). The angles are taken one by one, as they hardly correlate.

    Args:
        measured: What the images tell.
    """
    values, stds = np.zeros(2), np.zeros(2)
    mean, covariance = measured.as_array(), measured.covariance
    for index, calibrated_std in enumerate(CALIBRATED_TURN_STD_RAD[:2]):
        values[index], stds[index] = _shrunk(mean[index], covariance[index, index], calibrated_std)
    scale = stds / measured.std_rad
    return replace(
        measured,
        pitch_rad=float(values[0]),
        roll_rad=float(values[1]),
        covariance=covariance * np.outer(scale, scale),
    )


def _shrunk(value: float, variance: float, calibrated_std: float) -> tuple[float, float]:
    """Return mean and standard deviation of a measured angle, with the prior of calibrated pairs."""
    priors = np.array([calibrated_std, math.hypot(calibrated_std, TURNED_STD_RAD)]) ** 2
    total = priors + variance
    weights = np.array([1.0 - TURNED_ROWS_PART, TURNED_ROWS_PART]) * np.exp(
        -0.5 * value**2 * (1.0 / total - 1.0 / total.max())
    )
    weights /= np.sqrt(total)
    weights /= weights.sum()
    means, variances = value * priors / total, variance * priors / total
    mean = float(weights @ means)
    return mean, math.sqrt(float(weights @ (variances + (means - mean) ** 2)))


def turned_back(
    images: tuple[Image, Image], rig: StereoRig, turn: CameraTurn, yaw_rad: float = 0.0, first_row: int = 0
) -> tuple[tuple[Image, Image], CameraTurn]:
    """Return the images with the right one as a camera sees it that is not turned; and the turn, corrected.

    Args:
        images: Left and right image, (H, W) uint8.
        rig: Intrinsics.
        turn: Pitch and roll of the right camera.
        yaw_rad: Its yaw, as far as it is to be corrected [rad].
        first_row: Row from which on the image is needed; above, it is as it was.
    """
    if not turn.seen and yaw_rad == 0.0:
        return images, turn
    turned_from_straight = turn.homography(rig, yaw_rad)
    from_first_row = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, first_row], [0.0, 0.0, 1.0]])
    left, right = images
    straight = np.empty_like(right)
    straight[:first_row] = right[:first_row]
    cv2.warpPerspective(
        right,
        turned_from_straight @ from_first_row,
        (right.shape[1], right.shape[0] - first_row),
        straight[first_row:],
        flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return (left, straight), replace(turn, corrected=True)
