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

"""Parts of a calibration, by the function that does it, and the processor time each takes."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from unittest.mock import patch

from stereo_selfcal.core import calibrator
from stereo_selfcal.core.evidence import frame_evidence
from stereo_selfcal.core.search import solve, strategy

# The module that calls it, and the name it calls it by.
PARTS: dict[str, tuple[object, str]] = {
    "coarse road": (frame_evidence, "find_coarse_road"),
    "turn of the right camera": (frame_evidence, "measure_turn"),
    "its correction": (frame_evidence, "turned_back"),
    "road surface": (frame_evidence, "find_road_surface"),
    "farthest things": (frame_evidence, "far_disparity"),
    "gradients": (frame_evidence, "find_stripe_points"),
    "lines on the road": (strategy, "lines_on_road"),
    "lines of the whole image": (strategy, "find_hypotheses"),
    "extra lines": (strategy, "find_extra_lines"),
    "genetic algorithm": (solve, "maximise_each"),
    "covariance of lines": (solve, "propagate"),
    "closed form": (solve, "solve_plane"),
    "refinement": (solve, "refine"),
    "synchronisation": (solve, "measure_lateness"),
    "cross-checks": (solve, "cross_check_surface"),
    "cause of a refusal": (calibrator, "diagnose"),
}


@contextmanager
def clocked_parts() -> Iterator[dict[str, float]]:
    """Clock all parts inside; yield the seconds of this thread spent in each so far."""
    spent = dict.fromkeys(PARTS, 0.0)

    def clocked(name: str, function: Callable[..., object]) -> Callable[..., object]:
        def clock(*args: object, **kwargs: object) -> object:
            start = time.thread_time()
            try:
                return function(*args, **kwargs)
            finally:
                spent[name] += time.thread_time() - start

        return clock

    with ExitStack() as clocks:
        for name, (owner, attribute) in PARTS.items():
            clocks.enter_context(patch.object(owner, attribute, clocked(name, getattr(owner, attribute))))
        yield spent
