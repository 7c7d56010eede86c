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

"""Where the node keeps its result: a file of its own, one that can be written, and none of other cameras."""

import os

import pytest

pytest.importorskip("rclpy")

from call_making import scripted_calls
from node_in_process import NodeInProcess
from result_making import EXTRINSICS, RIG, a_result, write

from stereo_selfcal.core.errors import ConfigError
from stereo_selfcal.files.result_file import load_result
from stereo_selfcal.ros import selfcal as selfcal_module
from stereo_selfcal.ros import store
from stereo_selfcal.ros.calibration import CallOutcome

FRONT = "/front/left/image_rect /front/right/image_rect"
HEIGHT = "extrinsics.height_m"


@pytest.fixture(autouse=True)
def home(tmp_path, monkeypatch):
    """Return a home folder of its own; whatever is saved goes there."""
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.delenv("ROS_HOME", raising=False)
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "log"))  # ROS itself would use the folders above
    return tmp_path


def node_of(namespace, **parameters):
    return NodeInProcess({"namespace": namespace}, **{"output_path": None, **parameters})


def value(node, name):
    return node.node.get_parameter(name).value


@pytest.fixture
def finding(monkeypatch):
    """Let each call of ~/calibrate find the same result at once."""

    outcome = CallOutcome("calibrated", a_result(), RIG, 5)
    monkeypatch.setattr(selfcal_module, "CalibrationCall", scripted_calls(lambda: outcome))


@pytest.mark.parametrize(
    ("namespace", "ros_home", "expected"),
    [
        ("/", None, "~/.ros/stereo_selfcal.yaml"),
        ("/front", None, "~/.ros/front/stereo_selfcal.yaml"),
        ("/car/rear", None, "~/.ros/car/rear/stereo_selfcal.yaml"),
        ("/front", "", "~/.ros/front/stereo_selfcal.yaml"),
        ("/front", "/data/ros", "/data/ros/front/stereo_selfcal.yaml"),
    ],
)
def test_default_output_path_has_namespace_and_name_of_the_node(monkeypatch, namespace, ros_home, expected):
    if ros_home is not None:
        monkeypatch.setenv("ROS_HOME", ros_home)
    with node_of(namespace) as node:
        assert value(node, "output_path") == expected


def test_two_nodes_do_not_share_a_result(home, finding):
    with node_of("/front") as node:
        answer = node.calibrate()
        assert answer.success
        assert answer.message.endswith(f"; saved to {home}/.ros/front/stereo_selfcal.yaml")
    with node_of("/rear") as node:
        assert value(node, HEIGHT) is None
    with node_of("/front") as node:
        assert value(node, HEIGHT) == EXTRINSICS.height_m


def test_file_of_other_topics_is_not_taken_and_both_are_named(home):
    path = home / "shared.yaml"
    write(path, source=FRONT)
    with node_of("/rear", output_path=str(path)) as node:
        assert value(node, HEIGHT) is None
        said = next(line for line in node.logged if "is not used" in line)
        assert "/front/left/image_rect" in said and "/rear/left/image_rect" in said and str(path) in said
        assert node.selfcal._keeper.reason == said
    assert path.is_file()


def test_old_default_file_is_taken_where_its_topics_fit_and_only_there(home):
    (home / ".ros").mkdir()
    write(home / ".ros" / "stereo_selfcal.yaml", source=FRONT)
    with node_of("/front") as node:
        assert value(node, HEIGHT) == EXTRINSICS.height_m
    with node_of("/rear") as node:
        assert value(node, HEIGHT) is None
        assert any("is not used: the calibration is of the images of /front" in line for line in node.logged)


def test_own_file_goes_before_the_old_default(home):
    (home / ".ros" / "front").mkdir(parents=True)
    write(home / ".ros" / "stereo_selfcal.yaml", source=FRONT)
    write(home / ".ros" / "front" / "stereo_selfcal.yaml", a_result(n_frames=9), source=FRONT)
    with node_of("/front") as node:
        assert node.selfcal._keeper.active.result.n_frames == 9


def test_result_saved_over_that_of_other_topics_keeps_it_and_says_where(home, finding):
    path = home / "shared.yaml"
    write(path, source=FRONT)
    with node_of("/rear", output_path=str(path)) as node:
        answer = node.calibrate()
    assert answer.success and f"is kept as {path}.rejected" in answer.message
    assert load_result(f"{path}.rejected").provenance["source"] == FRONT


@pytest.mark.parametrize("name", ["no/such/folder/out.yaml", ".", f"{'n' * 300}.yaml", "file/out.yaml"])
def test_output_path_that_cannot_be_written_is_refused_at_the_start(home, name):
    (home / "file").write_text("")
    with (
        pytest.raises(ConfigError, match=r"output_path: .* cannot be written: "),
        node_of("/", output_path=f"{home}/{name}"),
    ):
        pass


def test_default_place_that_cannot_be_written_is_a_warning_and_the_calibration_is_in_force(home, finding):
    """Nobody chose it, and a vehicle may have a file system that is read only."""
    (home / ".ros").write_text("no folder")
    with node_of("/front") as node:
        assert any("results will not be saved: " in line for line in node.logged)
        answer = node.calibrate()
        assert answer.success and "in effect, but not saved: " in answer.message
        assert value(node, HEIGHT) == EXTRINSICS.height_m


@pytest.mark.parametrize(
    ("where", "error", "words"),
    [
        ("write_result", OSError(36, os.strerror(36)), "cannot be written: file name too long"),
        ("write_result", PermissionError(13, os.strerror(13)), "cannot be written: permission denied"),
        ("write_exports", OSError(28, os.strerror(28)), "no space left on device"),
        ("write_result", ZeroDivisionError("division by zero"), "ZeroDivisionError: division by zero"),
    ],
)
def test_calibration_is_in_force_and_successful_whatever_error_saving_ends_with(
    home, finding, monkeypatch, where, error, words
):
    def fail(*_, **__):
        raise error

    monkeypatch.setattr(store, where, fail)
    with node_of("/", output_path=f"{home}/out.yaml", exports="urdf") as node:
        answer = node.calibrate()
        assert answer.success
        assert words in answer.message and ("not saved" in answer.message or "not exported" in answer.message)
        assert value(node, HEIGHT) == EXTRINSICS.height_m
        assert node.selfcal._keeper.active.save_failed
