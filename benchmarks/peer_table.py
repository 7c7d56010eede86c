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

"""Peers and ours on the same frames: errors and time."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import numpy as np

from stereo_selfcal import calibrate

from .frames import READABLE, SURFACES, UNITS, Array, held_out_frame, judge, rms, stage_errors
from .options import Options
from .peers import PEERS, Pair, Pose
from .plots import save_peer_plot
from .table import Table, number

NOISES = (0.0, 0.05, 0.10, 0.20)
OURS = "ours, calibrate()"


def peer_table(options: Options) -> Iterator[Table]:
    """Errors of every method over the held-out frames, textured and bare."""
    table = Table(
        "peers",
        f"What a user would pick instead: RMS (median) error, {options.poses} held-out poses a row",
        ["surface", "noise", "method", "answers", *UNITS, "median ms"],
        "The same frames for all, one thread, CPU time with the disparity. All peers are shown rows below "
        "the true horizon only, which no user knows; the v-disparity and the vanishing point take roll as 0. "
        "A method that raises or gives no finite answer has given none. SGBM default: no smoothness, as "
        "StereoSGBM_create has it; smooth: P1 = 8, P2 = 32 block areas, as OpenCV's samples have it, which "
        "helps under noise and draws slanted ground towards whole disparities.",
    )
    curves: dict[str, list[tuple[float, Array]]] = {}
    for surface in SURFACES:
        for noise in NOISES:
            errors: dict[str, list[Array]] = {name: [] for name in [*PEERS, OURS]}
            times: dict[str, list[float]] = {name: [] for name in errors}
            for pose in range(options.poses):
                scene, left, right = held_out_frame(surface, noise, pose)
                pair, truth = Pair.of(scene, left, right), scene.extrinsics.as_array()
                for name, method in PEERS.items():
                    start = time.thread_time()
                    answer = _answer(method, pair)
                    times[name].append(time.thread_time() - start)
                    if answer is not None:
                        errors[name].append(np.array(answer) - truth)
                start = time.thread_time()
                result = calibrate(left, right, scene.rig)
                times[OURS].append(time.thread_time() - start)
                errors[OURS] += list(stage_errors([judge(result, scene)], "final"))
            for name, rows in errors.items():
                readable = np.array(rows).reshape(-1, 3) * READABLE
                table.add(
                    surface,
                    f"{noise:.0%}",
                    name,
                    f"{len(rows)}/{options.poses}",
                    *(_cell(readable[:, i]) for i in range(3)),
                    f"{np.median(times[name]) * 1e3:.0f}",
                )
                if surface == "textured":
                    curves.setdefault(name, []).append((noise, rms(readable)))
    save_peer_plot(options.folder, curves, UNITS)
    yield table


def _answer(method: Callable[[Pair], Pose], pair: Pair) -> Pose | None:
    """Return a peer's pose, None when it has none."""
    try:
        pose: Pose = method(pair)
    except (ValueError, IndexError, ZeroDivisionError, np.linalg.LinAlgError):
        return None
    return None if all(not np.isfinite(value) for value in pose) else pose


def _cell(errors: Array) -> str:
    """Return RMS and, in brackets, the median of the absolute errors."""
    if not len(errors) or not np.isfinite(errors).any():
        return "-"
    return f"{number(float(rms(errors)))} ({number(float(np.median(np.abs(errors))))})"
