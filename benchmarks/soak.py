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

"""The node for ten minutes at 30 Hz, calibrating every ten seconds: memory, lost answers, the log."""

from __future__ import annotations

import json
import math
import subprocess
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from .idle import PYTHON, ROOT, ros_environment
from .options import Options
from .table import Table

RATE_HZ = 30.0
CALL_EVERY_S = 10.0
ASK_EVERY_S = 1.0
# Every third call sees a bare road, and is refused when this is over.
TIMEOUT_S = 3.0
BARE_EVERY = 3
LOST_S = 30.0  # an answer that takes longer is lost
_DOMAIN = "96"  # any that the tests, which take their own, will hardly have
_S_PER_MINUTE = 60.0
_LEAST_MINUTES = 3


@dataclass(slots=True)
class Minute:
    """What happened in one minute.

    Attributes:
        own_mib: Memory of the node itself, once a second [MiB].
        rss_mib: The same with what it shares with others: libraries, the cameras' images [MiB].
        calls: Calls of ~/calibrate that were answered: accepted, refused.
        asked_s: How long the parameter service took to answer [s].
        log_lines: Lines in the node's log at the end of the minute.
    """

    own_mib: list[float] = field(default_factory=list)
    rss_mib: list[float] = field(default_factory=list)
    calls: list[bool] = field(default_factory=list)
    asked_s: list[float] = field(default_factory=list)
    log_lines: int = 0


@dataclass(slots=True)
class SoakReport:
    """What was measured.

    Attributes:
        minutes: Minute by minute.
        images: Images sent by each camera.
        calls: Calls of ~/calibrate sent.
        lost_calls: Calls without an answer.
        asked: Questions to the parameter service.
        lost_questions: Questions without an answer.
        log_bytes: Length of the log.
        cpu_s: Processor time of the node [s].
        elapsed_s: Duration [s].
        ending_s: From SIGINT to the end of the process, in the middle of a call [s].
        exit_status: Its exit status.
    """

    minutes: list[Minute] = field(default_factory=list)
    images: int = 0
    calls: int = 0
    lost_calls: int = 0
    asked: int = 0
    lost_questions: int = 0
    log_bytes: int = 0
    cpu_s: float = 0.0
    elapsed_s: float = 0.0
    ending_s: float = 0.0
    exit_status: int = 0

    @property
    def growth_mib(self) -> float:
        """Growth of the median resident memory from the second minute to the last [MiB]; NaN before those."""
        if len(self.minutes) < _LEAST_MINUTES:
            return math.nan
        return float(np.median(self.minutes[-1].rss_mib) - np.median(self.minutes[1].rss_mib))


def _spread(values: list[float]) -> str:
    return f"{min(values):.1f}, {np.median(values):.1f}, {max(values):.1f}"


def soak(seconds: float) -> SoakReport:
    """Run the node that long [s], in the environment with ROS."""
    environment = ros_environment(_DOMAIN)
    with tempfile.TemporaryDirectory() as folder:
        command = [str(PYTHON), "-m", "benchmarks.soaking", str(seconds), folder]
        run = subprocess.run(
            command, cwd=ROOT, env=environment, text=True, stdout=subprocess.PIPE, check=True
        )
    values = json.loads(run.stdout)
    return SoakReport(**{**values, "minutes": [Minute(**minute) for minute in values["minutes"]]})


def soak_table(options: Options) -> Iterator[Table]:
    """A soak of the length of the options."""
    report = soak(options.soak_s)
    minutes = Table(
        "soak",
        f"{options.soak_s / _S_PER_MINUTE:g} min at {RATE_HZ:g} Hz, 1280 x 720, "
        f"~/calibrate every {CALL_EVERY_S:g} s",
        [
            "minute",
            "own memory: least, median, most",
            "resident: least, median, most",
            "calls: accepted, refused",
            "get_parameters: median, longest",
            "lines in the log",
        ],
        "The node in a process of its own, two cameras in another; every third call sees a bare road and is "
        f"refused after {TIMEOUT_S:g} s, and the watch looks at a frame every 2 s. Memory [MiB], read once a "
        "second: what the node has of its own (RssAnon), and what is resident with libraries and the memory "
        "it shares (VmRSS). The most is that of frames being calibrated; what leaks raises the least.",
    )
    for number, minute in enumerate(report.minutes, 1):
        asked_ms = 1e3 * np.array(minute.asked_s or [math.nan])
        minutes.add(
            str(number),
            _spread(minute.own_mib),
            _spread(minute.rss_mib),
            f"{sum(minute.calls)}, {len(minute.calls) - sum(minute.calls)}",
            f"{np.median(asked_ms):.1f} ms, {asked_ms.max():.0f} ms",
            str(minute.log_lines),
        )
    yield minutes
    whole = Table("soak_whole", "The whole of it", ["what", "measured", "asked"])
    growth = "too short" if math.isnan(report.growth_mib) else f"{report.growth_mib:+.1f} MiB"
    whole.add("growth of the memory, second minute to last", growth, "below 5 MB")
    whole.add("calls of ~/calibrate without an answer", f"{report.lost_calls} of {report.calls}", "0")
    whole.add(
        "questions to get_parameters without an answer", f"{report.lost_questions} of {report.asked}", "0"
    )
    whole.add("log", f"{report.log_bytes} bytes", f"a line for each of the {report.calls} calls")
    whole.add("frames sent per second", f"{report.images / report.elapsed_s:.1f}", f"{RATE_HZ:g}")
    whole.add("processor time of the node", f"{100 * report.cpu_s / report.elapsed_s:.1f} % of a core", "")
    whole.add(
        "from SIGINT in the middle of a call to the end",
        f"{report.ending_s:.2f} s, status {report.exit_status}",
        "2 s, status 0",
    )
    yield whole
