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

"""Whether a change of the code has changed a number: every frame there is, before and after.

``python -m benchmarks.same_numbers COMMIT`` runs the calibrator of a commit and that of the working tree over
the bags of the project, the recorded frames beside it and random worlds, and compares what they say. It uses
the public names only, so that it also runs with the code of before a change of the layout.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from stereo_selfcal import Calibrator, StereoRig
from stereo_selfcal.bags import StereoBag
from stereo_selfcal.synth import world_recipes
from stereo_selfcal.synth.worlds import random_world, render_world

ROOT = Path(__file__).resolve().parents[1]
RECORDED = ROOT.parent / "shared" / "data"
FOLDERS = ("kitti_frames", "kitti_odometry07", "roads", "worlds")  # pairs of images
BAGS = (ROOT / "bags", RECORDED / "kitti_odometry02")
WORLDS = 300
WORLD_SEED = 170_017  # no other benchmark has it
PROCESSES = 2

# What counts as the same: this part of a standard deviation, as sums may be taken in another order.
SAME = 1e-6
# Where nothing says how sure a value is (a stage of a refused frame), that of a usual frame [m, rad, rad].
USUAL_STD = np.array([2e-3, 2e-4, 1e-3])
# Gates that read a radius. Of a straight road it is any great number, so its inverse, a curvature, counts.
RADII = ("straight", "flat")
SUM_OF_TERMS = 1e-12  # the terms of an uncertainty add up to its covariance

Task = tuple[str, str, int]  # kind, where, which


def tasks(worlds: int = WORLDS) -> list[Task]:
    """Return all frames, as something that can be sent to another process."""
    found: list[Task] = []
    for folder in BAGS:
        for bag in sorted({path.parent for path in folder.rglob("metadata.yaml")}):
            count = sum(1 for _ in StereoBag(bag).frames())
            found += [("bag", str(bag), index) for index in range(count)]
    for name in FOLDERS:
        for left in sorted((RECORDED / name).rglob("left*")):
            pictures = sorted(left.iterdir()) if left.is_dir() else [left]
            found += [("pair", str(picture), 0) for picture in pictures]
    return found + [("world", str(WORLD_SEED), index) for index in range(worlds)]


def _frame(task: Task) -> tuple[StereoRig, Any, Any]:
    kind, where, which = task
    if kind == "bag":
        bag = StereoBag(Path(where))
        rig = bag.read_rig()
        frame = next(frame for index, frame in enumerate(bag.frames()) if index == which)
        return rig, frame.left, frame.right
    if kind == "world":
        # Older commits know the first catalogue only, which is drawn alike ever since.
        first = [world_recipes.FIRST] if hasattr(world_recipes, "FIRST") else []
        drawn = random_world(np.random.default_rng([int(where), which]), *first)
        return drawn.scene.rig, *render_world(drawn, np.random.default_rng([int(where), which, 1]))
    left = Path(where)
    if left.stem == "left":
        right, rig = left.with_name(f"right{left.suffix}"), left.with_name("case.json")
        numbers = json.loads(rig.read_text(encoding="utf-8"))["rig"]
    else:
        right = left.parents[1] / "right" / left.name
        numbers = json.loads((left.parents[1] / "rig.json").read_text(encoding="utf-8"))
    names = ("width", "height", "fx", "fy", "cx", "cy", "baseline_m")
    images = [cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in (left, right)]
    return StereoRig(**{name: numbers[name] for name in names}), *images


def measure(task: Task) -> dict[str, Any]:
    """Return what the calibrator says of a frame, as JSON has it."""
    rig, left, right = _frame(task)
    result = Calibrator(rig).add(left, right)
    said: dict[str, Any] = {
        "task": [task[0], _relative(task[1]), task[2]],
        "reason": str(result.reason) if result.reason else "",
        "pose": None if result.extrinsics is None else result.extrinsics.as_array().tolist(),
        "covariance": None if result.covariance is None else np.asarray(result.covariance).tolist(),
        "lane_yaw_rad": result.lane_yaw_rad,
        "stages": {name: pose.as_array().tolist() for name, pose in result.stages.items()},
        "readings": [[each.name, each.value, each.threshold, bool(each.passed)] for each in result.gates],
        "notes": len(result.notes),
    }
    if result.covariance is not None and hasattr(result, "uncertainty"):
        total = sum(term.covariance for term in result.uncertainty)
        said["sum_of_terms"] = float(np.abs(total - result.covariance).max())
    return said


def _relative(where: str) -> str:
    for root in (ROOT, RECORDED):
        if Path(where).is_relative_to(root):
            return str(Path(where).relative_to(root))
    return where


def record(path: Path, worlds: int) -> None:
    """Write what the calibrator on the path says of every frame, a line each."""
    context = multiprocessing.get_context("spawn")
    with (
        context.Pool(PROCESSES, initializer=cv2.setNumThreads, initargs=(1,)) as pool,
        path.open("w") as file,
    ):
        for said in pool.imap(measure, tasks(worlds), chunksize=4):
            file.write(json.dumps(said) + "\n")
            file.flush()


def differences(before: dict[str, Any], after: dict[str, Any]) -> Iterator[str]:
    """Yield what of one frame is not the same."""
    if before["reason"] != after["reason"]:
        yield f"verdict: {before['reason'] or 'accepted'} -> {after['reason'] or 'accepted'}"
        return
    std = USUAL_STD if before["covariance"] is None else np.sqrt(np.diag(before["covariance"]))
    if before["pose"] is not None:
        yield from _apart("pose", before["pose"], after["pose"], std)
        yield from _apart("covariance", before["covariance"], after["covariance"], np.outer(std, std))
        yield from _apart("lane_yaw_rad", before["lane_yaw_rad"] or 0.0, after["lane_yaw_rad"] or 0.0, std[1])
    if list(before["stages"]) != list(after["stages"]):
        yield f"stages: {list(before['stages'])} -> {list(after['stages'])}"
    for name in before["stages"]:
        if name in after["stages"]:
            yield from _apart(f"stage {name}", before["stages"][name], after["stages"][name], std)
    if len(before["readings"]) != len(after["readings"]):
        yield f"readings: {len(before['readings'])} -> {len(after['readings'])}"
        return
    for (name, *of_before), (_, *of_after) in zip(before["readings"], after["readings"], strict=True):
        was, now = of_before[:2], of_after[:2]
        if name in RADII:
            was, now = [1.0 / value for value in was], [1.0 / value for value in now]
        yield from _apart(f"reading {name}", was, now, max(map(abs, was)) or 1.0)
        if of_before[2] != of_after[2]:
            yield f"reading {name}: passed {of_before[2]} -> {of_after[2]}"
    if before["notes"] != after["notes"]:
        yield f"notes: {before['notes']} -> {after['notes']}"


def _apart(what: str, before: Any, after: Any, scale: Any) -> Iterator[str]:
    off = np.abs(np.subtract(before, after)) / scale
    # Neither infinity nor NaN may hide a change.
    same = (off <= SAME) | (np.asarray(before) == np.asarray(after)) | (np.isnan(before) & np.isnan(after))
    if not np.all(same):
        yield f"{what}: off by {np.max(off):.1e} of its scale"


def compare(before: Path, after: Path, say: Callable[[str], object]) -> bool:
    """Say what differs between two records; return whether nothing does."""
    first, second = (
        {json.dumps(said["task"]): said for said in map(json.loads, path.read_text().splitlines())}
        for path in (before, after)
    )
    same = True
    for task in sorted(first.keys() ^ second.keys()):
        same = False
        say(f"{task}: in one record only")
    greatest = 0.0
    counts: Counter[str] = Counter()
    for task in first.keys() & second.keys():
        found = list(differences(first[task], second[task]))
        counts[f"{first[task]['task'][0]} {'accepted' if not first[task]['reason'] else 'refused'}"] += 1
        greatest = max(greatest, second[task].get("sum_of_terms", 0.0))
        if found:
            same = False
            say(f"{task}: {'; '.join(found)}")
    told = ", ".join(f"{count} {name}" for name, count in sorted(counts.items()))
    say(f"{sum(counts.values())} frames ({told}): {'all the same' if same else 'NOT the same'}")
    say(f"terms of the uncertainty against the covariance: {greatest:.1e} at most, {SUM_OF_TERMS:g} allowed")
    return same and greatest <= SUM_OF_TERMS


def main(arguments: list[str]) -> int:
    """Compare two commits, or write or compare records."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.same_numbers", description=__doc__)
    parser.add_argument("commit", nargs="?", help="what the working tree is compared with")
    parser.add_argument("--worlds", type=int, default=WORLDS, help="random worlds beside the recordings")
    parser.add_argument("--record", type=Path, metavar="FILE", help="write a record and compare nothing")
    parser.add_argument("--compare", type=Path, nargs=2, metavar=("BEFORE", "AFTER"), help="two records")
    chosen = parser.parse_args(arguments)
    say = partial(print, flush=True)
    if chosen.record:
        record(chosen.record, chosen.worlds)
        return 0
    if chosen.compare:
        return 0 if compare(*chosen.compare, say) else 1
    if not chosen.commit:
        parser.error("name a commit, or a record to write")
    with tempfile.TemporaryDirectory() as folder:
        tree, before, after = Path(folder, "tree"), Path(folder, "before"), Path(folder, "after")
        subprocess.run(["git", "worktree", "add", "--detach", tree, chosen.commit], cwd=ROOT, check=True)
        try:
            for path, code in ((before, tree), (after, ROOT)):
                # This file with the package of that tree.
                run = [sys.executable, __file__, "--record", path, "--worlds", str(chosen.worlds)]
                environment = {**os.environ, "PYTHONPATH": str(code)}
                subprocess.run(list(map(str, run)), env=environment, check=True)
        finally:
            subprocess.run(["git", "worktree", "remove", "--force", tree], cwd=ROOT, check=True)
        return 0 if compare(before, after, say) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
