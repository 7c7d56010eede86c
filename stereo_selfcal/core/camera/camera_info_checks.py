"""Unusual values of a usable CameraInfo, which somebody should check."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .camera_info import EQUIDISTANT, CameraModel, InfoReason

# Baselines of the stereo cameras of cars. The baseline of a lorry or of a toy may be outside this range.
_USUAL_BASELINE_M = (0.03, 2.0)

# Most zoom of a rectification. It is 0.73 for the cameras of KITTI and 0.95 for those of EuRoC. A factor of
# two occurs where the K of a CameraInfo was scaled to another resolution and its P was not. The images of
# wide lenses are zoomed more.
_MOST_ZOOM = 2.0
_MOST_ZOOM_FISHEYE = 4.0
# Least distance of the principal point from the border, as a fraction of the image's side. A nearer one
# belongs to another resolution, or to a crop.
_BORDER = 0.15
_SAME_PX = 1e-6


@dataclass(frozen=True, slots=True)
class Finding:
    """One unusual value of a CameraInfo.

    Attributes:
        reason: Kind of the finding.
        message: Sentence with the value, the usual range and the remedy.
    """

    reason: InfoReason
    message: str

    def __str__(self) -> str:
        return f"{self.reason}: {self.message}"


def find_unusual_values(
    left: CameraModel, right: CameraModel, baseline_m: float, rectified: bool
) -> list[Finding]:
    """Return the unusual values of two usable cameras.

    A D that is not zero is no finding, because the CameraInfo of a rectified image is that of the raw camera.

    Args:
        left: The left camera.
        right: The right camera.
        baseline_m: Distance of the cameras [m].
        rectified: Whether the images are supposed to be rectified.
    """
    found = []
    least_m, most_m = _USUAL_BASELINE_M
    if not least_m <= baseline_m <= most_m:
        text = (
            f"the baseline is {baseline_m:.4g} m, usual is at least {least_m:g} m and at most {most_m:g} m: "
            "check P[3]"
        )
        found.append(Finding(InfoReason.BASELINE_UNUSUAL, text))
    for camera in (left, right):
        found += _unusual_values_of(camera, rectified)
    return found


def check_image_size(model: CameraModel, size: tuple[int, int]) -> Finding | None:
    """Compare the size of an image with the size in its CameraInfo.

    Args:
        model: The camera.
        size: Width and height of an image of this camera [px].

    Returns:
        The finding, None where the sizes agree.
    """
    if size == (model.width, model.height):
        return None
    return Finding(
        InfoReason.IMAGE_SIZE,
        f"the {model.side} image is {size[0]} x {size[1]}, its CameraInfo is for {model.width} x "
        f"{model.height} (region of interest and binning applied): publish the CameraInfo of these images",
    )


def _unusual_values_of(camera: CameraModel, rectified: bool) -> list[Finding]:
    found = []
    side, k, p = camera.side, camera.k, camera.p
    most = _MOST_ZOOM_FISHEYE if camera.model == EQUIDISTANT else _MOST_ZOOM
    for name, raw, projected in (("fx", k[0], p[0]), ("fy", k[4], p[5])):
        if raw > 0 and projected > 0 and not 1 / most < projected / raw < most:
            text = (
                f"{name} of the {side} CameraInfo is {raw:.5g} in K and {projected:.5g} in P, usual is a "
                f"ratio of at most {most:g}: they may belong to different resolutions"
            )
            found.append(Finding(InfoReason.FOCAL_LENGTHS_DISAGREE, text))
            break
    for name, column, row in (("K", k[2], k[5]), ("P", p[2], p[6])):
        off = max(abs((column + 0.5) / camera.width - 0.5), abs((row + 0.5) / camera.height - 0.5))
        if off > 0.5 - _BORDER and not camera.cropped:
            text = (
                f"principal point ({column:.5g}, {row:.5g}) of {name} of the {side} CameraInfo lies at the "
                f"border of the {camera.width} x {camera.height} image: it may belong to another resolution"
            )
            found.append(Finding(InfoReason.PRINCIPAL_POINT, text))
            break
    same = all(abs(k[3 * i + j] - p[4 * i + j]) <= _SAME_PX for i in range(3) for j in range(3))
    unturned = len(camera.r) == 9 and bool(np.allclose(camera.r, np.eye(3).ravel(), atol=_SAME_PX))
    if rectified and same and unturned and any(camera.d):
        text = (
            f"the {side} CameraInfo is that of a single camera, not of a rectified pair (P is K, R is the "
            "identity, D is not zero): if the images are not rectified, set rectified: false or calibrate "
            "them as a pair"
        )
        found.append(Finding(InfoReason.SEEMS_UNRECTIFIED, text))
    return found
