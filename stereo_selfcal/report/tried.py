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

"""What was tried with a refused frame, in words: how lines were found, and why no attempt was accepted."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ..core.drive.drive import clock
from ..core.evidence.frame_evidence import FoundBy
from ..core.search.attempt import Verdict
from ..offline import AttemptSummary, FrameRow
from .choice import refusals

FOUND_BY_IN_WORDS = {
    FoundBy.ROAD: "two lane lines on the road surface",
    FoundBy.SURFACE: "the road surface, without a pair of lines",
    FoundBy.HOUGH: "two lane lines of the whole image",
    FoundBy.KNOWN: "two lane lines, followed from the frame before",
}
VERDICT_IN_WORDS = {
    Verdict.ACCEPTED: "accepted",
    Verdict.REFUSED: "refused",
    Verdict.NOT_FITTED: "no estimate",
}


def tried(rows: Sequence[FrameRow]) -> list[dict[str, Any]]:
    """Return, for every reason of a refusal, what was tried with one frame of it, the most frequent first."""
    found = []
    for reason, count, middle in refusals(rows):
        frames = [row for row in rows if row.reason == reason]
        with_attempts = [row for row in frames if row.attempts]
        row = with_attempts[len(with_attempts) // 2] if with_attempts else middle
        found.append(
            {
                "reason": reason,
                "frames": count,
                "without": count - len(with_attempts),
                "frame": row.name or f"at {clock(row.stamp_s)}",
                "steps": _steps(row),
            }
        )
    return found


def _steps(row: FrameRow) -> list[dict[str, str]]:
    """Return the attempts with a frame; after them the search for lines, where the frame failed in that."""
    if not row.attempts:
        return []
    steps = [_step(attempt) for attempt in row.attempts]
    if row.rejection is not None and all(each.reason != row.reason for each in row.attempts):
        lines = FOUND_BY_IN_WORDS[FoundBy.HOUGH]
        steps.append(_words(lines, "not found", row.reason or "", "", row.rejection.finding))
    return steps


def _step(attempt: AttemptSummary) -> dict[str, str]:
    why = attempt.message if attempt.rejection is None else attempt.rejection.finding
    verdict = VERDICT_IN_WORDS[attempt.verdict]
    return _words(FOUND_BY_IN_WORDS[attempt.found_by], verdict, attempt.reason or "", attempt.gate, why)


def _words(lines: str, verdict: str, reason: str, gate: str, why: str) -> dict[str, str]:
    lines, why = (text[:1].upper() + text[1:] for text in (lines, why))
    return {"lines": lines, "verdict": verdict, "reason": reason, "gate": gate, "why": why}
