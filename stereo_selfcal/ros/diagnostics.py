"""What goes to ``/diagnostics``, from a plain snapshot of the node; needs no graph."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from ..core.pairing import PairCounts

_LEAST_ELAPSED_S = 1e-3  # two reports at once must not divide by zero


@dataclass(frozen=True, slots=True)
class Snapshot:
    """What the node knows of itself when it reports.

    Attributes:
        node: Full name of the node.
        camera_frame: Frame of the camera: the hardware the report is about.
        calibrating: Whether a call is running.
        counts: Images and pairs so far.
        before: The same when the last report was made.
        elapsed_s: Time since then [s].
        last_answer: What the last call answered.
        last_success: Whether that was a result, None before the first call.
    """

    node: str
    camera_frame: str
    calibrating: bool
    counts: PairCounts
    before: PairCounts
    elapsed_s: float
    last_answer: str = "not called yet"
    last_success: bool | None = None


def diagnostics_message(stamp: Time, snapshot: Snapshot) -> DiagnosticArray:
    """Return the report of the node.

    Args:
        stamp: Time of the report.
        snapshot: What is to be reported.
    """
    counts, elapsed_s = snapshot.counts, max(snapshot.elapsed_s, _LEAST_ELAPSED_S)
    added = counts.since(snapshot.before)
    values = {
        "state": "calibrating" if snapshot.calibrating else "idle",
        "left_rate_hz": f"{added.left / elapsed_s:.1f}",
        "right_rate_hz": f"{added.right / elapsed_s:.1f}",
        "pair_rate_hz": f"{added.pairs / elapsed_s:.1f}",
        **{name: str(getattr(counts, name)) for name in counts.__slots__},
        "last_answer": snapshot.last_answer,
        "camera_frame": snapshot.camera_frame,
    }
    level, text = DiagnosticStatus.OK, f"{values['pair_rate_hz']} pairs per second; {snapshot.last_answer}"
    if not added.pairs:
        level = DiagnosticStatus.WARN
        text = f"no pairs: left {values['left_rate_hz']} Hz, right {values['right_rate_hz']} Hz"
    elif snapshot.last_success is False:
        level = DiagnosticStatus.WARN
    message = DiagnosticArray(status=[_status("calibration", snapshot, level, text, values)])
    message.header.stamp = stamp
    return message


def _status(
    topic: str, snapshot: Snapshot, level: bytes, text: str, values: Mapping[str, str]
) -> DiagnosticStatus:
    pairs = [KeyValue(key=key, value=value) for key, value in values.items()]
    return DiagnosticStatus(
        level=level,
        name=f"{snapshot.node}: {topic}",
        message=text,
        hardware_id=snapshot.camera_frame,
        values=pairs,
    )
