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

"""What the running node costs in each of its states, beside a node that only subscribes.

The node, the camera and the clients are processes of their own (:mod:`.graph`). The processor time of the
node's process, and of the threads of DDS in it, is read from /proc.
"""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .idle import HZ, process
from .options import RESULTS, Options
from .table import Table

_SETTLE_S = 8.0
# Longer than from one probe to the next, so that one is in it.
_MEASURED_S, _QUICK_S = 31.0, 5.0
_ASKED_S, _QUICK_ASKED_S = 8.0, 3.0
# Until a process has started and joined, and ten seconds more, in which it does not measure yet.
_JOINED_S = 25.0
# Fast DDS calls its threads so. Those without a name are Python's, or wait.
_DDS = "dds."
SIZES = {"1280 x 720": (), "1920 x 1080": ("full_hd",)}
STATES = {
    "plain": "only subscribes to both images (rclpy), takes all",
    "raw": "the same with raw subscriptions",
    "idle": "this node, idle",
    "watching": "watching, every 2 s",
    "road_pose": "watching, and ~/road_pose is listened to",
    "calibrating": "calibrating, one call of ~/calibrate after the other",
}


@dataclass(frozen=True, slots=True)
class Used:
    """What a process has used so far.

    Attributes:
        total_s: Processor time [s].
        dds_s: Of which in the threads of DDS [s].
        taken: Images taken.
        lost: Images lost between two that were taken.
        work_s: Processor time of calibrating and following [s].
        at_s: Steady time [s].
    """

    total_s: float
    dds_s: float
    taken: float
    lost: float
    work_s: float
    at_s: float

    @classmethod
    def now(cls, pid: int, counters: np.memmap) -> Used:
        """Read it."""
        total_s = dds_s = 0.0
        for task in Path(f"/proc/{pid}/task").iterdir():
            # Of the scheduler, in nanoseconds: ticks are too coarse for threads that run shortly.
            spent_s = 1e-9 * int((task / "schedstat").read_text(encoding="ascii").split()[0])
            total_s += spent_s
            if (task / "comm").read_text(encoding="utf-8").startswith(_DDS):
                dds_s += spent_s
        return cls(total_s, dds_s, *map(float, counters), time.monotonic())


def cost_table(options: Options) -> Iterator[Table]:
    """Cost of each state, at two sizes of image."""
    whole = options.folder == RESULTS
    seconds, asked_s = (_MEASURED_S, _ASKED_S) if whole else (_QUICK_S, _QUICK_ASKED_S)
    table = Table(
        "idle",
        f"The node in each of its states: two topics of mono8 images at {HZ} Hz",
        [
            "images",
            "node",
            "of a core",
            "of which calibrating and following",
            "of which threads of DDS",
            "all the rest",
            "images taken a second",
            "lost of them",
            "get_parameters: median, 99 %, longest",
        ],
        f"The node's process for {seconds:.0f} s, after {_SETTLE_S:.0f} s, with shared memory of 20 MiB for "
        "each sender. Threads of DDS receive what is subscribed to, taken or not. 'Lost' are images missing "
        "between two that were taken without a pause. After that, get_parameters was called fifty times a "
        f"second for {asked_s:.0f} s, which is not in the processor time. Asked at 1280 x 720: idle below "
        "1.5 % of a core, watching below 5 %.",
    )
    for size, more in SIZES.items():
        with process("camera", str(HZ), *more):
            for state, text in STATES.items():
                table.add(size, text, *_cells(state, seconds, asked_s))
    yield table


def _cells(state: str, seconds: float, asked_s: float) -> Iterator[str]:
    """Measure one state and yield its cells."""
    kind = state if state in ("plain", "raw") else "lazy"
    with tempfile.NamedTemporaryFile() as file, ExitStack() as stack:
        file.write(np.zeros(3).tobytes())
        file.flush()
        counters = np.memmap(file.name, np.float64, "r", shape=(3,))
        node = stack.enter_context(process("node", kind, file.name, str(HZ)))
        if state in ("watching", "road_pose"):
            with process("calibrate", "0.1") as caller:
                caller.wait()
        lasts_s = _SETTLE_S + seconds + asked_s + _JOINED_S
        client = {"road_pose": "listen", "calibrating": "calibrate"}.get(state)
        if client is not None:
            stack.enter_context(process(client, str(lasts_s)))
        time.sleep(_SETTLE_S)
        before = Used.now(node.pid, counters)
        time.sleep(seconds)
        after = Used.now(node.pid, counters)
        with process("ask", str(asked_s)) as asker:
            times = np.array(json.loads(asker.communicate()[0]))
    elapsed_s = after.at_s - before.at_s
    total = (after.total_s - before.total_s) / elapsed_s
    dds = (after.dds_s - before.dds_s) / elapsed_s
    work = (after.work_s - before.work_s) / elapsed_s
    taken, lost = after.taken - before.taken, after.lost - before.lost
    yield from (f"{share:.1%}" for share in (total, work, dds, total - work - dds))
    yield f"{taken / elapsed_s:.1f}"
    yield f"{lost / max(taken + lost, 1.0):.1%}"
    yield ", ".join(f"{np.percentile(times, q):.1f}" for q in (50, 99, 100)) + " ms"
