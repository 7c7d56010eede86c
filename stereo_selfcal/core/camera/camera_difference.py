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

"""What differs between the CameraInfo of two pairs of cameras, in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ..errors import RigError
from .camera_info import CameraInfoError, CameraModel, InfoReason
from .camera_info_history import CameraInfoHistory

# Elements of P and K that have a name of their own.
_P_NAMES = {0: "fx", 2: "cx", 3: "P[3]", 5: "fy", 6: "cy"}
_K_NAMES = {0: "fx of K", 2: "cx of K", 4: "fy of K", 5: "cy of K"}
# Differences that are listed; more would not be read.
_MOST_LISTED = 6


@dataclass(frozen=True, slots=True)
class Difference:
    """One value that differs.

    Attributes:
        name: Of the value, with the camera unless it differs in the same way in both.
        before: The first value.
        after: The second value.
    """

    name: str
    before: str
    after: str


def find_differences(before: Sequence[CameraModel], after: Sequence[CameraModel]) -> tuple[Difference, ...]:
    """Return what differs of what is used of two pairs of cameras.

    Args:
        before: Left and right camera, or one of them.
        after: The same of the other pair.
    """
    by_camera = [_differences_of(a, b) for a, b in zip(before, after, strict=True)]
    found: list[Difference] = []
    for camera, differences in zip(before, by_camera, strict=True):
        for difference in differences:
            in_all = all(difference in each for each in by_camera) and len(by_camera) > 1
            name = difference.name if in_all else f"{difference.name} of the {camera.side} camera"
            named = Difference(name, difference.before, difference.after)
            if named not in found:
                found.append(named)
    return tuple(found)


def changes_text(differences: Sequence[Difference]) -> str:
    """Return differences as changes, ``fx 480 -> 516.6``."""
    return _listed([f"{each.name} {each.before} -> {each.after}" for each in differences])


def values_text(differences: Sequence[Difference], after: bool) -> str:
    """Return the values of one side alone, ``fx 480``."""
    return _listed([f"{each.name} {each.after if after else each.before}" for each in differences])


def alternating_error(values: tuple[str, str], times: str) -> CameraInfoError:
    """Return the error of two CameraInfo that alternate.

    Args:
        values: What each has that the other has not.
        times: How often and when, in words.
    """
    return CameraInfoError(
        InfoReason.ALTERNATING,
        f"CameraInfo alternates between {values[0]} and {values[1]}, {times}, as if two cameras were "
        "publishing on one topic: leave one of them",
    )


def check_steady(history: CameraInfoHistory, topic: str, side: str, rectified: bool) -> None:
    """Refuse CameraInfo of a topic that alternates.

    Args:
        history: The recent ones.
        topic: Name of the topic.
        side: "left" or "right".
        rectified: Whether the images are rectified.

    Raises:
        CameraInfoError: It alternates.
    """
    found = history.alternating
    if found is None:
        return
    try:
        models = [CameraModel.read(info, side, rectified) for info in found]
    except RigError as error:
        raise alternating_error(("usable values", f"others ({error})"), f"on {topic}") from error
    differences = find_differences(models[:1], models[1:])
    values = values_text(differences, after=False), values_text(differences, after=True)
    raise alternating_error(values, f"on {topic}")


def _listed(items: list[str]) -> str:
    more = f" and {len(items) - _MOST_LISTED} more" if len(items) > _MOST_LISTED else ""
    return ", ".join(items[:_MOST_LISTED]) + more


def _differences_of(before: CameraModel, after: CameraModel) -> list[Difference]:
    found = []
    for name in ("width", "height"):
        found += _number(name, getattr(before, name), getattr(after, name))
    for i, (a, b) in enumerate(zip(before.p, after.p, strict=True)):
        found += _number(_P_NAMES.get(i, f"P[{i}]"), a, b)
    if before.rectified and after.rectified:
        if before.correction != after.correction:
            turns = [_array(each.correction) if each.correction else "none" for each in (before, after)]
            found.append(Difference("R that is applied", *turns))
        return found
    for i, (a, b) in enumerate(zip(before.k, after.k, strict=True)):
        found += _number(_K_NAMES.get(i, f"K[{i}]"), a, b)
    for name in ("d", "r"):
        a, b = getattr(before, name), getattr(after, name)
        if a != b:
            found.append(Difference(name.upper(), _array(a), _array(b)))
    if before.model != after.model:
        found.append(Difference("distortion model", repr(before.model), repr(after.model)))
    return found


def _number(name: str, before: float, after: float) -> list[Difference]:
    return [] if before == after else [Difference(name, *_distinct(before, after))]


def _distinct(before: float, after: float) -> tuple[str, str]:
    """Return both values with as many digits as tell them apart."""
    for digits in (6, 9, 17):
        texts = f"{before:.{digits}g}", f"{after:.{digits}g}"
        if texts[0] != texts[1]:
            break
    return texts


def _array(values: Sequence[float]) -> str:
    return f"({', '.join(f'{value:.5g}' for value in values)})"
