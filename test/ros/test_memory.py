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

"""Memory that is not in use goes back to the system, and what stays is not collected again and again."""

import platform
import subprocess
import sys
from pathlib import Path

import pytest

from stereo_selfcal.ros import memory

PEAK = """
import threading
from stereo_selfcal.ros.memory import trim_heap, use_one_heap

def resident():
    return next(int(line.split()[1]) for line in open("/proc/self/status") if line.startswith("VmRSS"))

def work():
    blocks = [bytearray(100_000) for _ in range(1000)]  # below what the C library maps apart
    pins.append(bytearray(100_000))  # above them in the heap, so that it does not just shrink
    peaks.append(resident())

use_one_heap()
pins, peaks, before = [], [], resident()
for _ in range(3):
    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
trim_heap()
print(peaks[0] - before, resident() - before)
"""

# Two images of 1280 x 720 pixels at a time, again and again.
IMAGES = """
import resource
from stereo_selfcal.ros.memory import use_one_heap

def images(n):
    for _ in range(n):
        pair = bytearray(1280 * 720), bytearray(1280 * 720)

use_one_heap()
images(2)
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
images(50)
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""

# The node as it is when its callbacks begin.
STARTED = """
import gc
from stereo_selfcal.ros import node

def spin(executor):
    print(gc.get_freeze_count(), len(gc.get_objects()), flush=True)

node._spin = spin
node.main(["--ros-args", "-p", "output_path:=''"])
"""


@pytest.mark.skipif(not Path("/proc/self/status").is_file(), reason="/proc tells what is in use")
def test_what_threads_have_used_is_given_back():
    run = subprocess.run([sys.executable, "-c", PEAK], capture_output=True, text=True, check=True)
    peak, kept = map(int, run.stdout.split())
    assert peak > 50_000
    assert kept < peak / 4


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="the heap is that of glibc")
def test_the_memory_of_an_image_is_that_of_the_next():
    run = subprocess.run([sys.executable, "-c", IMAGES], capture_output=True, text=True, check=True)
    pages_of_one = 1280 * 720 // 4096
    assert int(run.stdout) < pages_of_one


def test_another_c_library_is_no_fault(monkeypatch):
    monkeypatch.setattr(memory.ctypes, "CDLL", lambda name: object())
    memory.use_one_heap()
    memory.trim_heap()


def test_the_collector_has_little_to_go_through_while_the_node_runs():
    run = subprocess.run([sys.executable, "-c", STARTED], capture_output=True, text=True, check=True)
    spared, left = map(int, run.stdout.split())
    assert left < spared / 20


def test_heap_is_trimmed_once_after_each_unsubscribing(monkeypatch):
    trimmed = []
    monkeypatch.setattr(memory, "trim_heap", lambda: trimmed.append(True))
    trimmer, counts = memory.HeapTrimmer(), []
    for subscribed in (True, False, False, False, False, True, False, True, False, False):
        trimmer.tick(subscribed)
        counts.append(len(trimmed))
    assert counts == [0, 0, 1, 1, 1, 1, 1, 1, 1, 2]
