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

"""The camera in the vehicle as the node sends it: by the truth of a rendered road, or a sentence why not."""

import dataclasses
import math

import numpy as np
import pytest

pytest.importorskip("rclpy")

import painted_square as scene
from call_making import scripted_calls
from node_in_process import NodeInProcess
from rclpy.parameter import Parameter
from ros_graph import image_message, info_message
from tf2_stand_in import StandInTf2, joint

from stereo_selfcal.core.camera.rectifier import StereoRectifier
from stereo_selfcal.core.geometry.homography import SIDES
from stereo_selfcal.files.result_file import write_result
from stereo_selfcal.files.saved_result import topics_source
from stereo_selfcal.ros import selfcal as selfcal_module
from stereo_selfcal.ros.calibration import CallOutcome

FRAMES = ("zed_left", "zed_right")
RIG_PARAMETERS = {f"rig.{name}": value for name, value in scene.RIG.to_mapping().items()}
MOUNT = {"mount.x_m": scene.PLACE.x_m, "mount.y_m": scene.PLACE.y_m}
UNKNOWN_YAW = "show too few points beside the road), so the camera is in 'road', with yaw 0"


@pytest.fixture
def tf2(monkeypatch):
    return StandInTf2(monkeypatch)


def infos(frames=FRAMES):
    messages = [info_message(side, scene.RIG) for side in SIDES]
    for message, frame in zip(messages, frames, strict=True):
        message.header.frame_id = frame
    return messages


@pytest.fixture
def calibrated(monkeypatch, tf2):
    """Start a node of which ~/calibrate finds the truth of the scene, with the CameraInfo of some frames."""
    outcome = {}
    calls = scripted_calls(lambda: outcome["next"])
    monkeypatch.setattr(selfcal_module, "CalibrationCall", calls)
    started = []

    def start(frames=FRAMES, yaw_known=True, **parameters):
        node = NodeInProcess(**{"publish_tf": True, **MOUNT, **parameters})
        started.append(node)
        node.__enter__()
        tf2.listened(node.node)
        cameras = StereoRectifier.of_rig(scene.RIG)
        if not any(name.startswith("rig.") for name in parameters):
            for side, message in zip(SIDES, infos(frames), strict=True):
                node.send(f"/{side}/camera_info", message)
            cameras = StereoRectifier.from_camera_info(*infos(frames))
        outcome["next"] = CallOutcome("found", scene.calibrated(yaw_known), scene.RIG, 5, cameras)
        node.outcome = outcome
        return node

    yield start
    for node in started:
        node.__exit__()


def moved():
    """Return the scene's calibration of a camera that was moved, so that no yaw of before is kept."""
    result = scene.calibrated(yaw_known=False)
    pose = result.extrinsics
    return dataclasses.replace(result, extrinsics=dataclasses.replace(pose, height_m=pose.height_m + 0.3))


def last(node, name):
    return [message for topic, message in node.sent if topic == f"/stereo_selfcal/{name}"][-1]


def values(node):
    """Return level and values of the calibration in the next report."""
    node.report()
    status = [message for topic, message in node.sent if topic == "/diagnostics"][-1].status[0]
    return status.level, {pair.key: pair.value for pair in status.values}


def carried(pose, optical):
    """Return where a message puts the square: of a Pose or a Transform."""
    origin = getattr(pose, "position", None) or pose.translation
    rotation = getattr(pose, "orientation", None) or pose.rotation
    place = np.array([origin.x, origin.y, origin.z])
    return scene.square_on_road(place, scene.of_quaternion(rotation), optical)


@pytest.mark.parametrize(
    ("camera_frame", "child"),
    [("stereo_camera", "stereo_camera"), ("zed_left", "zed_left"), ("from_camera_info", "zed_left")],
)
def test_pose_and_transform_carry_a_point_to_where_the_truth_has_it(calibrated, tf2, camera_frame, child):
    node = calibrated(camera_frame=camera_frame)
    answer = node.calibrate()
    assert answer.success and "yaw" not in answer.message.replace("found", "")
    optical = child == "zed_left"
    pose = last(node, "pose")
    assert pose.header.frame_id == "base_footprint"
    assert carried(pose.pose.pose, optical) == pytest.approx(scene.TRUTH_M, abs=scene.TOLERANCE_M)
    camera, road = tf2.sent[-1]
    assert (camera.header.frame_id, camera.child_frame_id) == ("base_footprint", child)
    assert carried(camera.transform, optical) == pytest.approx(scene.TRUTH_M, abs=scene.TOLERANCE_M)
    # The road's frame is a leaf under the camera, turned with it.
    assert (road.header.frame_id, road.child_frame_id) == ("base_footprint", "road")
    assert (road.transform.translation.x, road.transform.translation.y) == (scene.PLACE.x_m, scene.PLACE.y_m)
    assert 2.0 * math.asin(road.transform.rotation.z) == pytest.approx(scene.YAW_RAD)
    assert last(node, "markers").markers[0].header.frame_id == "base_footprint"
    std = np.sqrt(np.diag(np.reshape(pose.pose.covariance, (6, 6))))
    assert std[5] == pytest.approx(math.radians(0.05), rel=0.01)
    level, told = values(node)
    assert level == b"\0"
    axes = "optical" if optical else "body"
    assert told["transform"] == f"{axes} frame {child} in base_footprint"


def test_unknown_yaw_is_the_transform_of_before_and_a_sentence(calibrated, tf2):
    node = calibrated(yaw_known=False)
    answer = node.calibrate()
    assert answer.success and UNKNOWN_YAW in answer.message
    assert "drive straight on for half a minute" in answer.message
    assert any(UNKNOWN_YAW in line for line in node.logged)
    pose = last(node, "pose")
    assert (pose.header.frame_id, pose.pose.pose.position.x, pose.pose.pose.position.y) == ("road", 0.0, 0.0)
    (camera,) = tf2.sent[-1]
    assert (camera.header.frame_id, camera.child_frame_id) == ("road", "stereo_camera")
    level, told = values(node)
    assert level == b"\0" and UNKNOWN_YAW in told["transform"]
    assert "yaw_rad" not in told


def test_yaw_is_set_with_the_other_results_and_taken_back(calibrated):
    names = ("extrinsics.yaw_rad", "extrinsics.yaw_std_rad")
    node = calibrated()

    def parameters():
        return [node.node.get_parameter(name).value for name in names]

    assert parameters() == [None, None]
    node.calibrate()
    expected = [scene.YAW_RAD, math.radians(0.05)]
    assert parameters() == pytest.approx(expected)
    changed = {each.name: each.value.double_value for each in last(node, "extrinsics").changed_parameters}
    assert [changed[name] for name in names] == pytest.approx(expected)
    _, told = values(node)
    assert [float(told[name]) for name in ("yaw_rad", "yaw_std_rad")] == pytest.approx(expected)
    (refused,) = node.node.set_parameters([Parameter(names[0], value=0.0)])
    assert not refused.successful and "is a result" in refused.reason
    node.outcome["next"] = dataclasses.replace(node.outcome["next"], result=moved())
    node.calibrate()
    assert parameters() == [None, None]
    assert set(names) <= {each.name for each in last(node, "extrinsics").deleted_parameters}
    node.outcome["next"] = dataclasses.replace(node.outcome["next"], result=scene.calibrated())
    node.calibrate()
    node.selfcal._activation.reset()
    assert parameters() == [None, None]


@pytest.mark.parametrize(
    ("parameters", "frames", "words"),
    [
        ({"camera_frame": "from_camera_info"}, ("", "zed_right"), "has no frame_id: set camera_frame"),
        ({"camera_frame": "from_camera_info"}, ("base_footprint", ""), "that of the vehicle or of the road"),
        ({"camera_frame": "zed_right"}, FRAMES, "the right camera by its CameraInfo"),
        ({"camera_frame": "front_optical"}, FRAMES, "by its name, but the left CameraInfo has 'zed_left': "),
        (
            {
                "camera_frame": "from_camera_info",
                **RIG_PARAMETERS,
            },
            FRAMES,
            "the rig is given, so that there is none: set camera_frame",
        ),
    ],
)
def test_camera_without_a_name_goes_nowhere_and_says_why(
    calibrated, tf2, tmp_path, parameters, frames, words
):
    path = tmp_path / "out.yaml"
    node = calibrated(frames, output_path=str(path), exports="urdf,autoware", **parameters)
    answer = node.calibrate()
    assert answer.success and f"saved to {path}, but not exported: " in answer.message
    assert words in answer.message.split("not exported: ")[1] and any(words in line for line in node.logged)
    assert tf2.sent == [] and [file.name for file in tmp_path.iterdir()] == ["out.yaml"]
    optical = parameters["camera_frame"] != "zed_right"
    assert carried(last(node, "pose").pose.pose, optical) == pytest.approx(scene.TRUTH_M, abs=0.01)
    level, told = values(node)
    assert level == b"\1" and words in told["transform"]


@pytest.mark.parametrize(
    ("image_frame", "axes"), [("zed_left", "optical"), ("/zed_left", "optical"), ("", "body")]
)
def test_images_name_the_camera_where_there_is_no_camera_info(calibrated, tf2, image_frame, axes):
    node = calibrated(camera_frame="zed_left", **RIG_PARAMETERS)
    image = image_message(np.zeros((720, 1280), np.uint8))
    image.header.frame_id = image_frame
    node.selfcal._input._intake.add("left", image)
    node.calibrate()
    assert values(node)[1]["transform"] == f"{axes} frame zed_left in base_footprint"
    found = carried(tf2.sent[-1][0].transform, axes == "optical")
    assert found == pytest.approx(scene.TRUTH_M, abs=scene.TOLERANCE_M)


@pytest.mark.parametrize("topic", ["/tf", "/tf_static"])
def test_frame_with_another_parent_is_told_and_not_sent(calibrated, tf2, topic):
    tf2.others = [(topic, joint("zed_link", "stereo_camera"))]
    node = calibrated()
    answer = node.calibrate()
    words = f"camera_frame 'stereo_camera' has the parent 'zed_link' on {topic} already"
    assert answer.success and words in answer.message and any(words in line for line in node.logged)
    assert tf2.sent == []
    level, told = values(node)
    assert level == b"\1" and words in told["transform"]


def test_parent_that_appears_later_is_a_warning(calibrated, tf2):
    node = calibrated()
    node.calibrate()
    assert values(node)[0] == b"\0"
    tf2.others = [("/tf", joint("zed_link", "stereo_camera"))]
    tf2.listened(node.node)
    level, told = values(node)
    assert level == b"\1" and "the transform was sent before that" in told["transform"]
    assert any("the transform was sent before that" in line for line in node.logged)


def test_yaw_that_got_lost_leaves_the_road_in_the_vehicle_and_says_so(calibrated, tf2):
    node = calibrated()
    node.calibrate()
    node.outcome["next"] = dataclasses.replace(node.outcome["next"], result=moved())
    answer = node.calibrate()
    words = "what was sent before stands on /tf_static until a restart: 'base_footprint' -> 'road'"
    assert answer.success and words in answer.message
    (camera,) = tf2.sent[-1]  # its own leaf is no road of somebody else
    assert camera.header.frame_id == "road"
    tf2.listened(node.node)
    level, told = values(node)
    assert level == b"\1" and told["transform"].endswith(words)
    node.outcome["next"] = dataclasses.replace(node.outcome["next"], result=scene.calibrated())
    assert "until a restart" not in node.calibrate().message


def test_camera_that_lost_its_name_says_that_the_old_transform_stands(calibrated, tf2):
    node = calibrated()
    node.calibrate()
    (outcome,) = node.node.set_parameters([Parameter("camera_frame", value="zed_right")])
    assert outcome.successful
    node.report()
    level, told = values(node)
    assert level == b"\1" and len(tf2.sent) == 1
    words = "until a restart: 'base_footprint' -> 'stereo_camera', 'base_footprint' -> 'road'"
    assert "which is the right camera by its CameraInfo" in told["transform"] and words in told["transform"]
    assert any(words in line for line in node.logged)


def test_second_camera_does_not_hang_below_the_road_of_the_first(calibrated, tf2):
    tf2.others = [("/tf_static", joint("base_footprint", "road"))]  # the first knows its yaw
    node = calibrated(yaw_known=False, camera_frame="rear")
    answer = node.calibrate()
    words = "set road_frame to a name of its own for each camera"
    assert answer.success and words in answer.message and tf2.sent == []
    level, told = values(node)
    assert level == b"\1" and words in told["transform"]
    node.node.set_parameters([Parameter("road_frame", value="rear_road")])
    node.report()
    (camera,) = tf2.sent[-1]
    assert (camera.header.frame_id, camera.child_frame_id) == ("rear_road", "rear")
    assert values(node)[0] == b"\0"


def test_old_configuration_with_a_road_of_its_own_goes_on(calibrated, tf2):
    """Who has joined the road to the vehicle by hand sets vehicle_frame to its name."""
    tf2.others = [("/tf_static", joint("base_link", "asphalt"))]
    node = calibrated(road_frame="asphalt")
    assert "set vehicle_frame to the name of road_frame" in node.calibrate().message
    assert tf2.sent == []
    node.node.set_parameters([Parameter("vehicle_frame", value="asphalt")])
    assert node.calibrate().message == "found; not saved, as output_path is empty"
    (camera,) = tf2.sent[-1]
    assert (camera.header.frame_id, camera.child_frame_id) == ("asphalt", "stereo_camera")
    assert camera.transform.translation.x == 0.0
    assert last(node, "pose").header.frame_id == "asphalt"


def test_frames_and_mount_that_are_set_later_are_published_within_a_second(calibrated, tf2):
    node = calibrated()
    node.calibrate()
    outcome = node.node.set_parameters(
        [Parameter("mount.x_m", value=2.5), Parameter("camera_frame", value="zed_left")]
    )
    assert all(each.successful for each in outcome)
    node.report()
    assert tf2.sent[-1][0].child_frame_id == "zed_left"
    shifted = scene.TRUTH_M + np.array([2.5 - scene.PLACE.x_m, 0.0, 0.0])
    assert carried(last(node, "pose").pose.pose, optical=True) == pytest.approx(shifted, abs=0.01)
    count = len(tf2.sent)
    node.report()
    assert len(tf2.sent) == count  # nothing is new
    (refused,) = node.node.set_parameters([Parameter("camera_frame", value="base_footprint")])
    assert not refused.successful and "no frame is its own parent" in refused.reason
    (refused,) = node.node.set_parameters([Parameter("mount.y_m", value=1200.0)])
    assert not refused.successful


def saved(path):
    topics = topics_source("/left/image_rect", "/right/image_rect")
    write_result(path, scene.calibrated(), scene.RIG, source=topics, seed=0)


@pytest.mark.parametrize("frames", [FRAMES, ("front_left", "front_right")])
def test_restored_transform_waits_for_the_camera_info_that_names_its_frame(calibrated, tf2, tmp_path, frames):
    """A driver may call its cameras otherwise than in the run before."""
    saved(tmp_path / "out.yaml")
    node = calibrated(output_path=str(tmp_path / "out.yaml"), camera_frame="from_camera_info")
    node.sent.clear()
    for side, message in zip(SIDES, infos(frames), strict=True):
        node.selfcal._input._infos.keep(side, message)
    node.report()
    assert tf2.sent[-1][0].child_frame_id == frames[0]
    assert carried(last(node, "pose").pose.pose, optical=True) == pytest.approx(scene.TRUTH_M, abs=0.01)


def test_restored_body_is_there_at_once_and_its_transform_with_camera_info(tf2, tmp_path):
    saved(tmp_path / "out.yaml")
    with NodeInProcess(publish_tf=True, output_path=str(tmp_path / "out.yaml"), **MOUNT) as node:
        placed = node.selfcal._activation.placed
        assert (placed.parent, placed.child) == ("base_footprint", "stereo_camera")
        tf2.listened(node.node)
        node.report()
        assert tf2.sent == []  # CameraInfo might call the left camera so
        for side, message in zip(SIDES, infos(), strict=True):
            node.send(f"/{side}/camera_info", message)
        node.report()
        assert tf2.sent[-1][0].child_frame_id == "stereo_camera"


def test_restored_calibration_of_another_name_waits(tf2, tmp_path):
    saved(tmp_path / "out.yaml")
    with NodeInProcess(publish_tf=True, output_path=str(tmp_path / "out.yaml"), camera_frame="zed") as node:
        tf2.listened(node.node)
        _, told = values(node)
        assert told["transform"].startswith("waits for the CameraInfo of both cameras")
        assert tf2.sent == [] and "yaw_rad" in told
