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

"""What is said of the images of a recording that are in no frame."""

from __future__ import annotations

from ..core.camera.pairing import PairCounts
from ..core.camera.stamp_pattern import NoPairCause, StampPattern


def unpaired_reason(pattern: StampPattern, queue_size: int) -> str:
    """Return why images of both sides formed no pair, with the remedy.

    Args:
        pattern: Of their stamps.
        queue_size: Images of a side that wait for a partner.
    """
    tolerance_s = pattern.tolerance_s
    if tolerance_s is not None:
        return f"{pattern}: give --approximate-sync-tolerance {tolerance_s:g} ({pattern.half_frame})"
    if pattern.cause is NoPairCause.LOST:
        return f"{pattern}; no tolerance helps: record anew where nothing is lost"
    if pattern.cause is NoPairCause.QUEUE:
        return f"{pattern}, but they were recorded more than {queue_size} images apart"
    return str(pattern)


def remarks_on(counts: PairCounts, said: tuple[int, int]) -> tuple[str, ...]:
    """Return what is to be said of images that are in no frame.

    Args:
        counts: Of the images that were read.
        said: How many left and right ones there are by the index of the recording.
    """
    remarks = []
    if (counts.left, counts.right) != said:
        remarks.append(
            f"{counts.left} left and {counts.right} right images were read, the recording should have "
            f"{said[0]} and {said[1]}: it may be damaged"
        )
    if counts.repeated_remark:
        remarks.append(counts.repeated_remark)
    alone = (
        counts.left - counts.repeated_left - counts.pairs,
        counts.right - counts.repeated_right - counts.pairs,
    )
    if any(alone):
        remarks.append(f"{alone[0]} left and {alone[1]} right images have no partner of the same time")
    return tuple(remarks)
