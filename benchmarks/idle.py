"""What the running node costs with nothing to do, and how long others wait for its answers.

The node, the camera (two 1280 x 720 mono8 at 30 Hz) and the clients are processes of their own, of the
environment with ROS (``make .venv``); the time of the node's process is read from /proc.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np

from .options import RESULTS, Options
from .table import Table

ROOT = Path(__file__).resolve().parents[1]
PYTHON = ROOT / ".venv" / "bin" / "python"
HZ = 30
# Of this run: what else runs on the machine must not be in it.
_DOMAIN = str(80 + os.getpid() % 20)
_SETTLE_S = 15.0
# Memory goes up and down with every look: a trend needs many of them.
_MEASURED_S = {"lazy": 600.0, "always": 120.0, "bytes": 120.0}
_READ_EVERY_S = 1.0
_KIBIBYTES = 1024
_END_S = 20.0

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
    "lazy": "as it is: subscribed while images are wanted, and 1 s of every 30 s",
    "always": "subscribed all the time",
    "bytes": "subscribed all the time, images not deserialised (raw subscriptions)",
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


def resident_mib(pid: int) -> float:
    """Return the memory of a process that is in use [MiB]."""
    lines = Path(f"/proc/{pid}/status").read_text(encoding="ascii").splitlines()
    line = next(line for line in lines if line.startswith("VmRSS"))
    return int(line.split()[1]) / _KIBIBYTES


def idle_table(options: Options) -> Iterator[Table]:
    """Cost of the variants with nothing to do."""
    table = Table(
        "idle",
        f"Idle: two cameras of 1280 x 720 mono8 at {HZ} Hz, nothing to do",
        ["variant", "seconds", "of a core", "memory at first", "growth per minute"],
        f"CPU time of the node's process, after {_SETTLE_S:.0f} s. "
        "Growth is the slope of a line through the memory of each second. Asked: below 3 %, no growth.",
    )
    with process("camera", str(HZ)):
        for name, text in VARIANTS.items():
            seconds = _MEASURED_S[name] if options.folder == RESULTS else 10.0
            with process("node", name) as node:
                time.sleep(_SETTLE_S)
                start_s, before_s = time.monotonic(), cpu_s(node.pid)
                sizes = []
                while time.monotonic() - start_s < seconds:
                    sizes.append(resident_mib(node.pid))
                    time.sleep(_READ_EVERY_S)
                used = (cpu_s(node.pid) - before_s) / (time.monotonic() - start_s)
            slope = 60.0 / _READ_EVERY_S * float(np.polyfit(np.arange(len(sizes)), sizes, 1)[0])
            cells = f"{used:.1%}", f"{sizes[0]:.1f} MiB", f"{slope:+.2f} MiB"
            table.add(text, f"{seconds:.0f}", *cells)
    yield table


def answer_table(options: Options) -> Iterator[Table]:
    """How long others wait for answers while the node has nothing to do, and while it calibrates."""
    seconds = 30.0 if options.folder == RESULTS else 5.0
    table = Table(
        "answers",
        "How long get_parameters waits for its answer",
        ["node", "calls", "median", "99 %", "longest", "above 50 ms"],
        f"Asked fifty times a second for {seconds:.0f} s by a process of its own, with the camera running. "
        "'calibrating': ~/calibrate is called again once it has answered. Asked: at most 50 ms. Where the "
        "machine has other work, it is to be measured with a priority above that (chrt -r 1).",
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
                    caller = clients.enter_context(process("calibrate", str(seconds + 5.0)))
                    time.sleep(3.0)
                asker = clients.enter_context(process("ask", str(seconds)))
                times = np.array(json.loads(asker.communicate()[0]))
                if caller is not None:
                    accepted, refused, _ = json.loads(caller.communicate()[0])
                    name = f"calibrating: {accepted} times accepted, {refused} refused"
            percentiles = (f"{np.percentile(times, q):.1f} ms" for q in (50, 99, 100))
            table.add(name, str(len(times)), *percentiles, str(int(np.count_nonzero(times > 50.0))))
    yield table
