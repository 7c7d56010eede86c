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

"""What the name of an image topic says about its images: rectified, raw, coloured."""

from __future__ import annotations

import re

_WORD = re.compile(r"[a-z]+|\d+")
_HUMP = re.compile(r"(?<=[a-z0-9])(?=[A-Z])")
RECTIFIED_WORDS = frozenset({"rect", "rectified", "rectify"})
RAW_WORDS = frozenset({"raw", "unrectified", "unrect", "distorted", "unrectify"})


def words_of(name: str) -> list[str]:
    """Return the words of a topic or of a part of one, in small letters: ``imageRect_0`` has three."""
    return _WORD.findall(_HUMP.sub("_", name).lower())


def says_rectified(topic: str) -> tuple[bool, bool]:
    """Return whether a topic says that its images are rectified, and whether it says that they are raw.

    The whole path decides (``left/color/rect/image``), and of it the last part that says either. Both are
    true for ``image_rect_raw``, which is what RealSense calls rectified images.

    Args:
        topic: Name of an image topic.
    """
    for part in reversed(topic.split("/")):
        words = set(words_of(part))
        rectified, raw = bool(words & RECTIFIED_WORDS), bool(words & RAW_WORDS)
        if rectified or raw:
            return rectified, raw
    return False, False
