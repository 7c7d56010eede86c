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

"""What the running node costs with nothing to do, and how long others wait for its answers.

The node, the camera (two 1280 x 720 mono8 at 30 Hz) and the clients are processes of their own, of the
environment with ROS (``make .venv``); the time of the node's process is read from /proc.
"""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from .options import RESULTS, Options
from .table import Table

Array = npt.NDArray[np.float64]

ROOT = Path(__file__).resolve().parents[1]
PYTHON = ROOT / ".venv" / "bin" / "python"
HZ = 30
# Of this run: what else runs on the machine must not be in it.
_DOMAIN = str(80 + os.getpid() % 20)
_SETTLE_S = 15.0
# Memory goes up and down with every look, and a heap takes minutes to find its size: a trend needs longer.
_MEASURED_S = {
    "lazy": 1200.0,
    "watch": 180.0,
    "kept": 120.0,
}
_READ_EVERY_S = 1.0
_A_MINUTE = 60  # readings
_LEAST_MINUTES = 5  # of a slope
_KIBIBYTES = 1024
_END_S = 20.0
# Before answers are measured: until the process that asks has started, and joined.
_JOINED_S = 25.0

# Fast DDS has 512 KiB of shared memory for each sender, which is less than one of these images: the second
# of a pair is mostly lost then. With room for some, all of them arrive.
_TRANSPORT = """<profiles xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
<transport_descriptors>
<transport_descriptor>
<transport_id>shm</transport_id><type>SHM</type><segment_size>20971520</segment_size>
</transport_descriptor>
<transport_descriptor><transport_id>udp</transport_id><type>UDPv4</type></transport_descriptor>
</transport_descriptors>
<participant profile_name="camera" is_default_profile="true">
<rtps>
<userTransports><transport_id>shm</transport_id><transport_id>udp</transport_id></userTransports>
<useBuiltinTransports>false</useBuiltinTransports>
</rtps>
</participant>
</profiles>
"""

VARIANTS = {
    "lazy": "nothing to do, as it is: subscribed while images are wanted, and 1 s of every 30 s",
    "watch": "calibrated, with the watch: subscribed, images taken for each of its frames, every 2 s",
    "kept": "nothing to do, subscribed all the time, images taken 1 s of every 30 s",
}


def ros_environment(domain: str) -> dict[str, str]:
    """Return the environment of a process with ROS, in a domain of its own.

    Raises:
        FileNotFoundError: There is no environment with ROS.
    """
    if not PYTHON.is_file():
        raise FileNotFoundError(f"{PYTHON} is needed, with ROS: make .venv")
    return {
        **os.environ,
        "PYTHONPATH": str(ROOT),
        "AMENT_PREFIX_PATH": str(ROOT / ".venv"),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_DOMAIN_ID": domain,
        "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
    }


@contextmanager
def process(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    """Run a process of :mod:`.graph`; it is ended with the block."""
    environment = ros_environment(_DOMAIN)
    command = [str(PYTHON), "-m", "benchmarks.graph", *arguments]
    with tempfile.NamedTemporaryFile("w", suffix=".xml") as profile:
        profile.write(_TRANSPORT)
        profile.flush()
        yield from _run(command, {**environment, "FASTRTPS_DEFAULT_PROFILES_FILE": profile.name})


def _run(command: list[str], environment: dict[str, str]) -> Iterator[subprocess.Popen[str]]:
    started = subprocess.Popen(command, cwd=ROOT, env=environment, text=True, stdout=subprocess.PIPE)
    try:
        yield started
        if started.poll():
            raise RuntimeError(f"{' '.join(command)} ended by itself with status {started.returncode}")
    finally:
        if started.poll() is None:
            started.send_signal(signal.SIGINT)
        try:
            started.wait(_END_S)
        except subprocess.TimeoutExpired:
            started.kill()
            started.wait()


def cpu_s(pid: int) -> float:
    """Return the time a process has computed, in user and kernel [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def memory_mib(pid: int, *names: str) -> tuple[float, ...]:
    """Return fields of /proc/PID/status, such as VmRSS [MiB]."""
    lines = Path(f"/proc/{pid}/status").read_text(encoding="ascii").splitlines()
    values = dict(line.split(":", 1) for line in lines)
    return tuple(int(values[name].split()[0]) / _KIBIBYTES for name in names)


@dataclass(frozen=True, slots=True)
class Usage:
    """What a process used, minute by minute.

    Attributes:
        core: Processor time over time.
        own_mib: (N,) least memory of its own in each minute (RssAnon) [MiB].
        most_mib: Most of the same at any time [MiB].
        shared_mib: Memory shared with other processes, at the first and at the last time (RssShmem) [MiB].
    """

    core: float
    own_mib: Array
    most_mib: float
    shared_mib: tuple[float, float]

    @property
    def growth_mib_per_h(self) -> float:
        """Slope of the least memory of each minute over the second half [MiB/h]; NaN if that is short."""
        later = self.own_mib[len(self.own_mib) // 2 :]
        if len(later) < _LEAST_MINUTES:
            return math.nan
        return 60.0 * float(np.polyfit(np.arange(len(later)), later, 1)[0])


def usage(pid: int, seconds: float) -> Usage:
    """Read once a second what a process uses, for so long [s]."""
    start_s, before_s = time.monotonic(), cpu_s(pid)
    own, shared = [], []
    while time.monotonic() - start_s < seconds:
        sizes = memory_mib(pid, "RssAnon", "RssShmem")
        own.append(sizes[0])
        shared.append(sizes[1])
        time.sleep(_READ_EVERY_S)
    core = (cpu_s(pid) - before_s) / (time.monotonic() - start_s)
    starts = range(0, max(len(own) - _A_MINUTE, 0) + 1, _A_MINUTE)
    minutes = np.array([min(own[i : i + _A_MINUTE]) for i in starts])
    return Usage(core, minutes, max(own), (shared[0], shared[-1]))


def memory_table(options: Options) -> Iterator[Table]:
    """Memory and cost of the variants with nothing to do, and with the watch over a calibration."""
    table = Table(
        "memory",
        f"Memory: two cameras of 1280 x 720 mono8 at {HZ} Hz, nothing to do; and the watch",
        [
            "variant",
            "minutes",
            "of a core",
            "own memory: first minute, middle, last; most",
            "its growth in the second half",
            "shared memory: at first, at the end",
        ],
        f"The node's process, after {_SETTLE_S:.0f} s. Memory [MiB]. Its own (RssAnon) is the least of a "
        "minute: it rises while images are looked at, and what is never given back raises the least. The "
        "growth is the slope of a line through those of the second half, as in the first minutes pages are "
        "touched for the first time. Shared (RssShmem) are the segments of DDS, which belong to the senders "
        "too. Asked of the first: no growth.",
    )
    with process("camera", str(HZ)):
        for name, text in VARIANTS.items():
            seconds = _MEASURED_S[name] if options.folder == RESULTS else 10.0
            with process("node", name) as node:
                if name.startswith("watch"):
                    with process("calibrate", "0.1") as caller:
                        caller.wait()
                time.sleep(_SETTLE_S)
                used = usage(node.pid, seconds)
            own, growth = used.own_mib, used.growth_mib_per_h
            three = ", ".join(f"{own[i]:.1f}" for i in (0, len(own) // 2, -1))
            table.add(
                text,
                f"{seconds / 60:.3g}",
                f"{used.core:.1%}",
                f"{three}; {used.most_mib:.1f}",
                "too short to tell" if math.isnan(growth) else f"{growth:+.2f} MiB per hour",
                ", ".join(f"{shared:.1f}" for shared in used.shared_mib),
            )
    yield table


def answer_table(options: Options) -> Iterator[Table]:
    """How long others wait for answers while the node has nothing to do, and while it calibrates."""
    seconds = 30.0 if options.folder == RESULTS else 5.0
    table = Table(
        "answers",
        "How long get_parameters waits for its answer",
        ["node", "calls", "median", "99 %", "longest", "above 50 ms"],
        f"Asked fifty times a second for {seconds:.0f} s by a process of its own, with the camera running. "
        "'calibrating': ~/calibrate is called again once it has answered. Asked: at most 50 ms. The answers "
        "of the first ten seconds do not count: as a process joins, Fast DDS keeps others from sending for "
        "up to a third of a second, whatever the node does. Where the machine has other work, it is to be "
        "measured with a priority above that: nice -n -15, and -15 written to /proc/self/autogroup where "
        "sched_autogroup_enabled is 1. (With chrt -r 1, processes wait for each other's slices of 100 ms.)",
    )
    with ExitStack() as stack:
        stack.enter_context(process("camera", str(HZ)))
        stack.enter_context(process("node", "lazy"))
        time.sleep(_SETTLE_S)
        for state in ("idle", "calibrating"):
            name = state
            with ExitStack() as clients:
                caller = None
                if state == "calibrating":
                    caller = clients.enter_context(process("calibrate", str(seconds + _JOINED_S)))
                    time.sleep(3.0)
                asker = clients.enter_context(process("ask", str(seconds)))
                times = np.array(json.loads(asker.communicate()[0]))
                if caller is not None:
                    accepted, refused, _ = json.loads(caller.communicate()[0])
                    name = f"calibrating: {accepted} times accepted, {refused} refused"
            percentiles = (f"{np.percentile(times, q):.1f} ms" for q in (50, 99, 100))
            table.add(name, str(len(times)), *percentiles, str(int(np.count_nonzero(times > 50.0))))
    yield table
