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

"""The calibration in the formats of other tools, as text and as files beside the result file.

:data:`CAMERA_INFO` is the CameraInfo of the pair, corrected by how the right camera was found to be turned.
All others hold the transform of ``~/pose`` and ``/tf_static``, with all its digits: roll, pitch, yaw about
fixed axes, as URDF, tf2 and Autoware have them. The parent is the vehicle, or the road while the yaw is not
known; the child is the camera body or the optical frame of the left camera (:mod:`.frames`). Homographies are
over the road in either case.
"""

from __future__ import annotations

import math
import shlex
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple
from xml.sax.saxutils import quoteattr

import yaml

from ..core.camera.rig import StereoRig
from ..core.errors import ConfigError, OutputError, printable
from ..core.geometry.camera_info_repair import RepairedPair
from ..core.geometry.homography import SIDES, image_from_road
from ..core.geometry.vehicle import CameraAxes
from .atomic_file import write_atomically
from .camera_info_file import format_camera_info, is_ours
from .frames import PlacedCamera, bare
from .node_settings import CAMERA_FRAME

_TRANSLATION, _ROTATION = ("x", "y", "z"), ("roll", "pitch", "yaw")
_UNITS = "metres, radians; roll, pitch, yaw about fixed axes"
_CHILDREN = {
    CameraAxes.BODY: "Camera body (x forward, y left, z up; in the middle of the baseline)",
    CameraAxes.OPTICAL: "Optical frame of the left camera (x right, y down, z forward)",
}
_VEHICLE = "in the vehicle's frame (on the road, x forward along the direction of travel; the yaw is known)"
_ROAD = "in the road's frame (under the camera, x forward along its heading; yaw 0"
_HOMOGRAPHY = """\
# s (u, v, 1) = image_from_road (x, y, 1): the point x metres ahead of the cameras and y metres left of the
# middle between them, on the road, is seen in column u and row v of the rectified image (the centre of its
# first pixel is 0, 0). s is the depth of the point in front of the camera [m]; where s < 0 it is not seen.
# x points along the heading of the camera, which is not the direction of travel: this holds for road_frame.
"""


def urdf(placed: PlacedCamera, rig: StereoRig) -> str:
    """Return a URDF with the joint from the vehicle to the camera.

    The links are those of the description that includes it.

    Args:
        placed: The camera in the vehicle.
        rig: The rig (not needed here; all exports are called alike).
    """
    parent, child = _frames(placed)
    joint = quoteattr(f"{parent}_to_{child}")
    transform = placed.camera.transform.as_dict()
    xyz, rpy = (" ".join(repr(transform[axis]) for axis in axes) for axes in (_TRANSLATION, _ROTATION))
    return f"""\
<?xml version="1.0" encoding="utf-8"?>
<!-- {_describe(placed)} -->
<robot name="stereo_selfcal">
  <joint name={joint} type="fixed">
    <parent link={quoteattr(parent)}/>
    <child link={quoteattr(child)}/>
    <origin xyz="{xyz}" rpy="{rpy}"/>
  </joint>
</robot>
"""


def static_transform_publisher(placed: PlacedCamera, rig: StereoRig) -> str:
    """Return a shell script of one command, which publishes the transform on ``/tf_static``.

    Args:
        placed: The camera in the vehicle.
        rig: The rig (not needed here; all exports are called alike).
    """
    words = ["ros2", "run", "tf2_ros", "static_transform_publisher"]
    for name, value in placed.camera.transform.as_dict().items():
        words += [f"--{name}", repr(value)]
    parent, child = _frames(placed)
    words += ["--frame-id", parent, "--child-frame-id", child]
    return f"#!/bin/sh\n# {_describe(placed)}\n{shlex.join(words)}\n"


def autoware(placed: PlacedCamera, rig: StereoRig) -> str:
    """Return a YAML file as the sensor kits of Autoware have it: ``parent: {child: {x, y, z, ...}}``.

    Args:
        placed: The camera in the vehicle.
        rig: The rig (not needed here; all exports are called alike).
    """
    parent, child = _frames(placed)
    document = {parent: {child: placed.camera.transform.as_dict()}}
    text: str = yaml.safe_dump(document, sort_keys=False, allow_unicode=True)
    return f"# {_describe(placed)}\n{text}"


def homographies(placed: PlacedCamera, rig: StereoRig) -> str:
    """Return a YAML file with the ground homography of each camera, (3, 3) row by row.

    Args:
        placed: The camera over the road.
        rig: The rig.
    """
    document: dict[str, object] = {
        "road_frame": bare(placed.road),
        "camera_frame": bare(placed.child),
        "image_width": rig.width,
        "image_height": rig.height,
    }
    for side in SIDES:
        rows = [[float(value) for value in row] for row in image_from_road(rig, placed.pose, side)]
        document[side] = {"image_from_road": rows}
    text: str = yaml.safe_dump(
        document, sort_keys=False, allow_unicode=True, default_flow_style=None, width=math.inf
    )
    return _HOMOGRAPHY + text


def _frames(placed: PlacedCamera) -> tuple[str, str]:
    """Return the names of parent and child as tf2 takes them."""
    return bare(placed.parent), bare(placed.child)


def _describe(placed: PlacedCamera) -> str:
    """Return what a transform is of, as a comment. It has no names in it: those may hold anything."""
    road = f"{_ROAD}, as it is not known)" if placed.yaw_remark else f"{_ROAD})"
    parent = _VEHICLE if placed.camera.yaw_known else road
    return f"{_CHILDREN[placed.camera.axes]} {parent}: {_UNITS}."


def camera_infos(pairs: Sequence[RepairedPair], camera_name: str) -> dict[str, str]:
    """Return the CameraInfo files of camera_info_manager, by the ending of their names.

    Args:
        pairs: The corrected pair of the images that were calibrated. Where those are rectified images of raw
            cameras with a CameraInfo of their own, the corrected pair of these as well.
        camera_name: Name of the pair.
    """
    texts = {}
    for pair in pairs:
        images = "rectified" if pair.rectified else "raw"
        of_driver = "_raw" if pair is not pairs[0] else ""
        for side, info, original in zip(SIDES, (pair.left, pair.right), pair.originals, strict=True):
            name = f"{camera_name}/{side}"
            whose = f"of the {side} camera, for its {images} images"
            texts[f".{side}{of_driver}.yaml"] = format_camera_info(info, name, f"{whose}\n{pair.describe()}")
            if not of_driver:
                comment = f"{whose}\nas it was before it was corrected"
                texts[f".{side}_original.yaml"] = format_camera_info(original, name, comment)
    return texts


class Export(NamedTuple):
    """One format: the ending of its file's name, and the function that returns its text."""

    suffix: str
    text: Callable[[PlacedCamera, StereoRig], str]


EXPORTS: Mapping[str, Export] = {
    "urdf": Export(".urdf.xml", urdf),
    "static_transform_publisher": Export(".static_transform_publisher.sh", static_transform_publisher),
    "autoware": Export(".autoware.yaml", autoware),
    "homographies": Export(".homographies.yaml", homographies),
}

_SCRIPT = ".sh"  # ending of what is to be run as it is

CAMERA_INFO = "camera_info"
EXPORT_NAMES = (*EXPORTS, CAMERA_INFO)
# Files of the CameraInfo; those of raw cameras are not always written.
_CAMERA_INFO_SUFFIXES = tuple(f".{side}{what}.yaml" for what in ("", "_original", "_raw") for side in SIDES)


def parse_exports(text: str) -> tuple[str, ...]:
    """Return the names in a comma separated list, each once; none for an empty text.

    Raises:
        ConfigError: A name is not one of :data:`EXPORT_NAMES`.
    """
    names = tuple(dict.fromkeys(name.strip() for name in text.split(",") if name.strip()))
    for name in names:
        if name not in EXPORT_NAMES:
            raise ConfigError(f"there is no export {name!r}: they are {', '.join(EXPORT_NAMES)}")
    return names


def export_paths(result_path: Path, names: Sequence[str]) -> list[Path]:
    """Return the files that :func:`write_exports` may write, in the order of the names."""
    suffixes = [
        suffix
        for name in names
        for suffix in (_CAMERA_INFO_SUFFIXES if name == CAMERA_INFO else (EXPORTS[name].suffix,))
    ]
    return [_beside(result_path, suffix) for suffix in suffixes]


def write_exports(
    result_path: Path,
    names: Sequence[str],
    placed: PlacedCamera | None,
    rig: StereoRig,
    pairs: Sequence[RepairedPair] = (),
    pair_name: str = CAMERA_FRAME,
) -> list[Path]:
    """Write exports beside a result file, each whole or not at all.

    Args:
        result_path: The result file; ``out.yaml`` gets ``out.urdf.xml`` and so on beside it.
        names: Names of the exports (:data:`EXPORT_NAMES`).
        placed: The camera in the vehicle; None where there is no calibration, for which the CameraInfo alone
            is written.
        rig: The rig it holds for.
        pairs: The CameraInfo for :data:`CAMERA_INFO`, as :func:`camera_infos` takes them.
        pair_name: Name of the pair of cameras in it.

    Returns:
        The files, in the order of the names.

    Raises:
        OutputError: A frame has no name, or one that not every format can hold, or a CameraInfo file that
            was not written here would be replaced; then no file is written. Or a file cannot be written;
            those before it are.
    """
    if placed is not None and placed.problem and any(name in EXPORTS for name in names):
        raise OutputError(placed.problem)
    frames = (pair_name,) if placed is None else (placed.parent, placed.child, pair_name)
    for frame in frames:
        if not frame.isprintable():
            raise OutputError(f"frame {frame!r} cannot be exported: give it a name of printable characters")
    texts: dict[Path, str] = {}
    for name in names:
        if name != CAMERA_INFO:
            if placed is not None:
                texts[_beside(result_path, EXPORTS[name].suffix)] = EXPORTS[name].text(placed, rig)
            continue
        for suffix, text in camera_infos(pairs, pair_name).items():
            path = _beside(result_path, suffix)
            if not is_ours(path):
                raise OutputError(
                    f"{printable(str(path))} is not replaced: a CameraInfo that was not written by this "
                    "program is there; move it away, or choose another name for the result"
                )
            texts[path] = text
    for path, text in texts.items():
        write_atomically(path, text.encode("utf-8"), executable=path.name.endswith(_SCRIPT))
    return list(texts)


def _beside(result_path: Path, suffix: str) -> Path:
    return result_path.with_name(result_path.stem + suffix)
