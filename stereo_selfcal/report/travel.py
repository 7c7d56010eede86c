"""The camera against the direction of travel, in words."""

from __future__ import annotations

from ..core.geometry.pose import DEGREES
from ..core.geometry.travel import Travel
from ..files.frames import unknown_yaw_cause

_LABEL = "The yaw against the direction of travel"


def travel_sentence(travel: Travel | None) -> str:
    """Return how well the yaw is known, or why it is not; a sentence without a full stop.

    Args:
        travel: The camera against the direction of travel; None where nothing tells it.
    """
    if travel is None:
        return f"{_LABEL} is not known: {unknown_yaw_cause(travel)}"
    seen = f"{travel.n_steps} steps of {travel.driven_s:.1f} s of drive"
    std, pitch_std = (DEGREES.text(float(value)) for value in travel.std)
    if not travel.tells_yaw:
        return (
            f"{_LABEL} is not known better than that of any mount (std {std} after {seen}): the car drove "
            "bends only, or too short a way"
        )
    yaw, pitch = (DEGREES.text(value, "+") for value in (travel.yaw_rad, travel.pitch_rad))
    return f"{_LABEL} is {yaw} (std {std}), the pitch against it {pitch} (std {pitch_std}), by {seen}"
