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
    "marking stripes": (frame_evidence, "find_stripe_points"),
    "lines and pairs of them": (calibrator, "find_hypotheses"),
    "extra lines": (strategy, "find_extra_lines"),
    "genetic algorithm": (solve, "maximise_each"),
    "covariance of lines": (solve, "propagate"),
    "closed form": (solve, "solve_plane"),
    "refinement": (solve, "refine"),
    "texture and other cross-checks": (solve, "cross_check_texture"),
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
