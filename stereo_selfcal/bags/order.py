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

"""The order of names with numbers in them: that of the numbers, as people count."""

from __future__ import annotations

import re

_NUMBERS = re.compile(r"([0-9]+)")


def natural_key(name: str) -> tuple[tuple[str | int, ...], str]:
    """Return what to sort names by: ``a2`` comes before ``a10``, ``a02`` beside ``a2``.

    Args:
        name: Name of a file or a topic; any text.
    """
    parts = _NUMBERS.split(name)  # text and digits by turns, so equal places hold equal types
    return tuple(int(part) if index % 2 else part for index, part in enumerate(parts)), name
