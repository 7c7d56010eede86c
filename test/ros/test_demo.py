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

"""The demo, and the same recording through node and replay: the same numbers to the last digit."""

import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import yaml

pytest.importorskip("rclpy")

import ros_graph
from ros_graph import NodeProcess, wait_for, wait_until

from stereo_selfcal.cli import replay
from stereo_selfcal.files.result_file import load_result
from stereo_selfcal.ros import demo as demo_module
from stereo_selfcal.ros.demo import DemoError, packaged_bag
from stereo_selfcal.ros.player import BagPlayer
from stereo_selfcal.synth.bag import write_bag
from stereo_selfcal.synth.scenes import named_scene

N_FRAMES = 4
DRIVE = ros_graph.ROOT / "bags" / "drive"


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    path = tmp_path_factory.mktemp("bags") / "short"
    write_bag(path, replace(named_scene("straight_road"), n_frames=N_FRAMES))
    return path


def test_node_and_replay_give_the_same_numbers(graph, tmp_path, bag):
    """The whole bag, fused; reliable on both ends, so that no frame is missing."""
    live, offline = tmp_path / "live.yaml", tmp_path / "offline.yaml"
    player = BagPlayer(graph.node, bag)
    topics = [t for side in (player.topics.left, player.topics.right) for t in (side.name, side.camera_info)]
    names = ("left/image_rect", "left/camera_info", "right/image_rect", "right/camera_info")
    parameters = tmp_path / "parameters.yaml"
    overrides = {topic: {"subscription": {"reliability": "reliable", "depth": 50}} for topic in topics}
    parameters.write_text(
        yaml.safe_dump({"/**": {"ros__parameters": {"queue_size": 50, "qos_overrides": overrides}}})
    )
    arguments = ["--params-file", str(parameters)]
    for name, topic in zip(names, topics, strict=True):
        arguments += ["-r", f"{name}:={topic}"]
    with NodeProcess(tmp_path, {"output_path": live, "frames": N_FRAMES, "timeout_s": 60.0}, arguments):
        # A call that succeeds shows that every topic is connected: once, two passes were over before the
        # CameraInfo of one camera was, and a publisher does not know whether its reader knows it.
        wait_until(lambda: all(graph.node.count_subscribers(topic) for topic in topics), "the subscriptions")
        answer = graph.start_calibrate()
        while not answer.done():
            player.play_once()
        assert answer.result().success, answer.result().message
        graph.wait_for_diagnostics(lambda values, _: values["state"] == "calibrated")
        answer = graph.start_calibrate()
        graph.wait_for_diagnostics(lambda values, _: values["state"] == "calibrating")
        player.play_once()
        response = wait_for(answer)
    assert response.success, response.message
    assert replay.main([str(bag), "--output", str(offline)]) == 0
    a, b = load_result(live), load_result(offline)
    assert (a.extrinsics, a.std, a.rig) == (b.extrinsics, b.std, b.rig)
    same = ("stamp", "frames", "seed", "version")
    assert [a.provenance[name] for name in same] == [b.provenance[name] for name in same]


def demo(*arguments):
    return subprocess.run(
        [sys.executable, "-m", "stereo_selfcal", "demo", *map(str, arguments)],
        cwd=ros_graph.ROOT,
        capture_output=True,
        text=True,
        timeout=4 * ros_graph.PATIENCE_S,
        check=False,
    )


def test_demo_calibrates_and_compares_with_the_truth(bag, tmp_path):
    run = demo("--bag", bag, "--output-dir", tmp_path / "out")
    assert run.returncode == 0, run.stderr
    assert "Traceback" not in run.stderr
    saved = load_result(tmp_path / "out" / "extrinsics.yaml")
    assert abs(saved.extrinsics.height_m - 1.4) < 0.01
    assert (tmp_path / "out" / "overview.png").read_bytes().startswith(b"\x89PNG")
    assert f"{saved.extrinsics.height_m:+.4f}" in run.stdout and "truth" in run.stdout
    assert "the same numbers" in run.stdout


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    """Play the drive of the package; return what the demo printed, and its folder."""
    folder = tmp_path_factory.mktemp("drive")
    run = demo("--output-dir", folder)
    assert run.returncode == 0, run.stderr
    return run.stdout, folder


def test_the_drive_is_calibrated_with_its_surface_and_its_yaw(drive):
    printed, folder = drive
    saved, truth = load_result(folder / "extrinsics.yaml"), yaml.safe_load((DRIVE / "truth.yaml").read_text())
    error = saved.extrinsics.as_array() - [truth[name] for name in ("height_m", "pitch_rad", "roll_rad")]
    assert np.all(np.abs(error) < 3.0 * saved.std.as_array())
    travel = saved.evidence.travel
    assert travel.tells_yaw
    assert abs(travel.yaw_rad - truth["yaw_rad"]) < 3.0 * np.sqrt(travel.covariance[0, 0])
    assert "not checked against the texture" not in printed
    assert re.search(r"^yaw \[deg\]( +[-+\d.]+){4}$", printed, re.MULTILINE)
    assert f"{saved.extrinsics.height_m:+.4f}" in printed and "truth" in printed


def test_live_and_replay_of_the_drive_agree_within_their_std(drive, tmp_path):
    _, folder = drive
    live, offline = load_result(folder / "extrinsics.yaml"), tmp_path / "offline.yaml"
    assert replay.main([str(DRIVE), "--output", str(offline)]) == 0
    other = load_result(offline)
    assert np.all(np.abs(live.extrinsics.as_array() - other.extrinsics.as_array()) < live.std.as_array())
    assert other.n_frames >= live.n_frames > 12


def test_the_demo_says_what_was_refused_and_writes_a_report(drive):
    printed, folder = drive
    assert re.search(
        r"^replay   \d+ of 59 frames accepted\n  +\d+ x lines_not_straight$", printed, re.MULTILINE
    )
    assert f"report   {folder / 'report.html'}: open it in a browser" in printed
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert page.startswith("<!DOCTYPE html>") and "lines_not_straight" in page
    assert (folder / "overview.png").read_bytes().startswith(b"\x89PNG")


def test_a_report_is_opened_where_there_is_a_display(bag, tmp_path, monkeypatch):
    opened = []
    monkeypatch.setattr(demo_module.webbrowser, "open", lambda url: opened.append(url) or True)
    monkeypatch.setattr(demo_module.sys.stdout, "isatty", lambda: True, raising=False)
    monkeypatch.setenv("DISPLAY", ":0")
    report = tmp_path / "report.html"
    assert demo_module._write_report(bag, report).endswith(f"{report}, opened")
    assert opened == [report.as_uri()]
    monkeypatch.delenv("DISPLAY")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    assert demo_module._write_report(bag, report).endswith("open it in a browser")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--bag", "missing"), "demo: missing"),
        (("--bag", "missing", "--lines"), "not allowed with argument"),
        (("--bag", "stereo_selfcal", "--output-dir", "/proc/x"), "/proc/x cannot be written"),
    ],
)
def test_demo_says_in_one_line_what_is_wrong(arguments, words, tmp_path):
    arguments = arguments if "--output-dir" in arguments else (*arguments, "--output-dir", tmp_path)
    run = demo(*arguments)
    assert run.returncode == 2
    assert run.stderr.startswith("demo: ") and words in run.stderr and len(run.stderr.splitlines()) == 1


def test_demo_finds_the_recording_of_a_checkout_and_of_an_installation(tmp_path, monkeypatch):
    assert packaged_bag("straight_road").resolve() == ros_graph.ROOT / "bags" / "straight_road"
    monkeypatch.chdir(tmp_path)
    assert packaged_bag() == ros_graph.ROOT / "bags" / "drive"
    monkeypatch.setattr(demo_module, "__file__", str(tmp_path / "lib" / "stereo_selfcal" / "ros" / "demo.py"))
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{tmp_path / 'other'}:{tmp_path / 'install'}")
    with pytest.raises(DemoError, match=r"not installed with the package: make one .* and give --bag"):
        packaged_bag()
    installed = tmp_path / "install" / "share" / "stereo_selfcal" / "bags" / "drive"
    installed.mkdir(parents=True)
    (installed / "metadata.yaml").write_text("")
    assert packaged_bag() == installed


def test_demo_whose_output_nobody_reads_any_more_ends_quietly(monkeypatch, capsys):
    def fail(*_arguments):
        raise BrokenPipeError

    streams = []
    monkeypatch.setattr(demo_module, "run_demo", fail)
    monkeypatch.setattr(demo_module, "let_go", streams.append)
    assert demo_module.main([]) == 141
    assert streams == [sys.stdout]
    assert capsys.readouterr().err == ""
