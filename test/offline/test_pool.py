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

"""Frames calibrated by several processes: in order, the same to the last bit, and no child is left."""

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import worker_tasks

from stereo_selfcal import Calibrator, CalibratorConfig
from stereo_selfcal.bags import BagError, StereoFrame
from stereo_selfcal.cli.report import as_json
from stereo_selfcal.offline import FrameSource, Selection, WorkerError, as_csv, calibrate_recording, pool
from stereo_selfcal.offline.pool import default_jobs
from stereo_selfcal.synth.scenes import PAPER_RIG, custom_scene

ROOT = Path(__file__).resolve().parent.parent.parent


# For tests of processes and not of numbers: lines alone, in a quarter of the time.
QUICK = CalibratorConfig.from_mapping({"texture": {"check": 0}})
# Recordings of few frames that have several parts.
SHORT_PARTS = CalibratorConfig.from_mapping({"known.cold_every_s": 0.5})


@cache
def road_images():
    scene = custom_scene(name="road", n_frames=2, noise_fraction=0.02)
    return [(frame.left, frame.right) for frame in scene.frames()]


class Road(FrameSource):
    """A few frames of a road and black ones, over and over."""

    name, left_name, right_name = "road", "left", "right"
    rig, selection, start_ns = PAPER_RIG, Selection(), 0

    def __init__(self, n, error=None):
        self.n_images = n, n
        self.error = error
        black = np.zeros((PAPER_RIG.height, PAPER_RIG.width), np.uint8)
        self.images = [*road_images(), (black, black)]
        self.given = 0

    def frames(self):
        for index in range(self.n_images[0]):
            self.given += 1
            yield StereoFrame(index / 10, *self.images[index % 3], index, f"{index}.png")
        if self.error:
            raise self.error

    def frame_at(self, recorded_ns):
        raise NotImplementedError


@pytest.fixture
def soon(monkeypatch):
    """Workers from the second frame on."""
    monkeypatch.setattr(pool, "_ALONE_FRAMES", 1)


def text(replay):
    return as_json(replay) + as_csv(replay.rows)


@pytest.mark.slow
@pytest.mark.parametrize("jobs", [2, 3])
def test_the_outcome_is_the_same_with_any_number_of_jobs(soon, jobs):
    alone, seen = calibrate_recording(Road(24), SHORT_PARTS), []
    together = calibrate_recording(Road(24), SHORT_PARTS, on_row=seen.append, jobs=jobs)
    assert seen == list(together.rows)
    assert text(together) == text(alone)
    assert [row.name for row in together.rows] == [f"{index}.png" for index in range(24)]
    assert [row.accepted for row in together.rows] == [True, True, False] * 8
    # Of each half second, the first frame is cold, and the one after a black one.
    assert [row.known_start for row in together.rows] == [row.known_start for row in alone.rows]
    assert [row.known_start for row in alone.rows][:6] == [False, True, False, False, True, False]
    assert together.rows[0].gates == alone.rows[0].gates


def test_workers_have_frames_at_the_same_time_and_this_process_has_none(soon, monkeypatch, tmp_path):
    monkeypatch.setattr(pool, "_calibrate", worker_tasks.meet)
    black = np.zeros((PAPER_RIG.height, PAPER_RIG.width), np.uint8)
    frames = (StereoFrame(2.0 * i, black, black, i, str(tmp_path / f"{i}.png")) for i in range(4))
    _, *by_workers = pool.calibrate_in_order(frames, Calibrator(PAPER_RIG), 2)
    heads, processes = zip(*by_workers, strict=True)
    assert [head.recorded_ns for head in heads] == list(range(1, 4))
    assert None not in processes and os.getpid() not in processes


def test_few_frames_start_no_process(monkeypatch):
    monkeypatch.setattr(pool, "_workers", None)
    assert len(calibrate_recording(Road(3), QUICK, jobs=2).rows) == 3


@pytest.mark.slow
def test_frames_before_the_damage_are_done(soon):
    replay = calibrate_recording(Road(5, BagError("bag: cut off")), QUICK, jobs=2)
    assert len(replay.rows) == 5
    assert replay.damage == (
        "bag: cut off; it ended early, after 5 frames: --max-frames 5 calibrates from these alone"
    )


@pytest.mark.slow
def test_a_worker_that_dies_is_an_error_with_a_reason(soon, monkeypatch):
    monkeypatch.setattr(pool, "_calibrate", worker_tasks.die)
    with pytest.raises(WorkerError, match=r"a worker process died near the frame of \d\.\d00 s.*--jobs"):
        calibrate_recording(Road(40), QUICK, jobs=2)


@pytest.mark.slow
def test_a_bug_in_a_worker_is_raised_here(soon, monkeypatch):
    monkeypatch.setattr(pool, "_calibrate", worker_tasks.fail)
    with pytest.raises(ZeroDivisionError, match="a bug"):
        calibrate_recording(Road(40), QUICK, jobs=2)


@pytest.mark.slow
def test_a_fault_on_one_frame_refuses_it_and_its_traceback_comes_from_the_worker(soon, caplog):
    road = Road(4)
    road.images[2] = tuple(image.view(worker_tasks.Faulty) for image in road.images[2])
    alone = calibrate_recording(road, QUICK)
    caplog.clear()
    together = calibrate_recording(road, QUICK, jobs=2)
    assert text(together) == text(alone)
    assert [row.reason for row in together.rows] == [None, None, "internal_error", None]
    assert "ZeroDivisionError: a bug (worker_tasks.py, line" in together.rows[2].rejection.message
    (logged,) = caplog.messages
    assert "Traceback (most recent call last)" in logged and "worker_tasks.py" in logged


@pytest.mark.slow
def test_workers_end_when_nobody_wants_the_rest(soon):
    """A reader of standard output has gone away, say."""

    def on_row(row):
        if row.stamp_s > 0.5:
            raise BrokenPipeError

    with pytest.raises(BrokenPipeError):
        calibrate_recording(Road(2000), QUICK, on_row=on_row, jobs=2)
    assert not multiprocessing.active_children()


@pytest.mark.slow
def test_few_frames_are_in_memory(soon):
    """A decoder that is faster than the workers waits for them."""
    road = Road(40)
    behind = []
    rows = iter(range(40))
    config = replace(QUICK, known=SHORT_PARTS.known)
    calibrate_recording(road, config, on_row=lambda row: behind.append(road.given - next(rows)), jobs=2)
    stretch = config.known.cold_every_s * 10.0
    assert max(behind) <= max(pool._AHEAD * 2, 4 * stretch) + 2 < 40


def test_default_jobs_are_the_cores():
    assert default_jobs() >= 1


# Prints its children when the workers are at work, and goes on for a minute.
PROGRAM = """
import multiprocessing, signal, sys
from pathlib import Path
sys.path.insert(0, "test/offline")

def main():
    import test_pool
    from stereo_selfcal.cli.console import run
    from stereo_selfcal.offline import calibrate_recording, pool
    pool._ALONE_FRAMES = 1
    signal.signal(signal.SIGINT, signal.default_int_handler)
    seen = []

    def on_row(row):
        seen.append(row)
        if len(seen) == 4:
            children = [str(child.pid) for child in multiprocessing.active_children()]
            sys.stdout.write(" ".join(children) + "\\n")
            sys.stdout.flush()

    def work(argv):
        return len(calibrate_recording(test_pool.Road(2000), test_pool.QUICK, on_row, 2).rows)

    sys.exit(run("tool", work, []))

if __name__ == "__main__":
    main()
"""


def alive(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs /proc")
@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGHUP, signal.SIGTERM, signal.SIGKILL])
def test_no_child_outlives_its_parent(tmp_path, end):
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    with subprocess.Popen(
        [sys.executable, str(program)],
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "test")])},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as process:
        children = [int(pid) for pid in process.stdout.readline().split()]
        assert len(children) == 2
        if end is signal.SIGKILL:
            process.send_signal(end)
        else:
            os.killpg(process.pid, end)  # as a terminal does
        _, err = process.communicate(timeout=60)
    if end is not signal.SIGKILL:
        assert process.returncode == 128 + end
        assert err.startswith(("tool: interrupted", "tool: ended")) and err.count("\n") == 1
    until = time.monotonic() + 30
    while any(map(alive, children)) and time.monotonic() < until:
        time.sleep(0.05)
    assert not any(map(alive, children))


def test_workers_keep_their_memory_and_this_process_keeps_its_variables(monkeypatch):
    monkeypatch.setenv("MALLOC_TRIM_THRESHOLD_", "1000000")  # the user's own
    monkeypatch.delenv("MALLOC_MMAP_THRESHOLD_", raising=False)
    before = dict(os.environ)
    with pool.for_workers():
        assert os.environ["MALLOC_TRIM_THRESHOLD_"] == "1000000"
        assert int(os.environ["MALLOC_MMAP_THRESHOLD_"]) == 32 * 2**20
    assert dict(os.environ) == before


def test_who_ends_early_does_not_wait_for_workers_that_start(soon, monkeypatch):
    monkeypatch.setattr(pool, "_start_worker", worker_tasks.start_slowly)
    black = np.zeros((PAPER_RIG.height, PAPER_RIG.width), np.uint8)
    frames = (StereoFrame(i / 10, black, black, i, f"{i}.png") for i in range(100))
    results = pool.calibrate_in_order(frames, Calibrator(PAPER_RIG), 2)
    next(results)
    start_s = time.monotonic()
    results.close()
    assert time.monotonic() - start_s < worker_tasks.PATIENCE_S
    assert multiprocessing.active_children() == []
