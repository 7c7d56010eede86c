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
