"""The node as a real process over DDS: what it answers, publishes, sets and saves."""

import math
import signal
import threading
import time

import numpy as np
import pytest

pytest.importorskip("rclpy")

import ros_graph
from geometry_msgs.msg import PoseWithCovarianceStamped
from rcl_interfaces.msg import Parameter, ParameterEvent, ParameterType, ParameterValue
from rclpy.node import Node
from ros_graph import Camera, NodeProcess, blank, rendered, stamp_of, wait_for
from sensor_msgs.msg import Image
from visualization_msgs.msg import MarkerArray

from stereo_selfcal import Calibrator, CalibratorConfig, Extrinsics
from stereo_selfcal.canvas import GREEN, SKY_BLUE, VERMILION, YELLOW
from stereo_selfcal.core.pairing import stamp_to_s
from stereo_selfcal.result_file import RESULT_NAMES, load_result

RESULTS = [f"extrinsics.{name}" for name in RESULT_NAMES]
# For calls that are to fail, though images have to arrive: long enough on a busy machine.
SHORT_S = 4.0
LONG_S = 40.0
TRUTH = Extrinsics(1.4, math.radians(3.0), math.radians(0.8))  # of the scene straight_road


def assert_near_truth(extrinsics):
    assert abs(extrinsics.height_m - TRUTH.height_m) < 0.01
    assert abs(extrinsics.pitch_rad - TRUTH.pitch_rad) < math.radians(0.05)
    assert abs(extrinsics.roll_rad - TRUTH.roll_rad) < math.radians(0.3)


def test_result_is_the_same_in_every_place(graph, start, tmp_path):
    """Parameters, latched messages and file hold the numbers the Python API gives for that frame."""
    path = tmp_path / "out.yaml"
    start({"output_path": path, "road_frame": "asphalt", "seed": 3})
    assert graph.parameters(*RESULTS) == [None] * 6
    with Camera(graph, [rendered()]):
        answer = graph.calibrate()
    assert answer.success, answer.message
    assert answer.message.endswith(f"saved to {path}")

    saved = load_result(path)
    assert_near_truth(saved.extrinsics)
    assert saved.provenance["source"] == "/left/image_rect /right/image_rect"
    assert (saved.provenance["frames"], saved.provenance["seed"]) == (1, 3)
    stamp_s = saved.provenance["stamp"]
    index = next(i for i in range(10_000) if stamp_to_s(stamp_of(i)) == stamp_s)
    expected = Calibrator(ros_graph.RIG, CalibratorConfig(seed=3)).add(*rendered(), stamp_s)
    assert saved.extrinsics == expected.extrinsics
    assert saved.std == expected.std
    assert saved.rig == ros_graph.RIG

    values = [*expected.extrinsics.as_array(), *expected.std.as_array()]
    assert graph.parameters(*RESULTS) == values
    event = graph.latest(ParameterEvent, "extrinsics")
    assert event.node == "/stereo_selfcal"
    assert {p.name: p.value.double_value for p in event.changed_parameters} == dict(
        zip(RESULTS, values, strict=True)
    )
    pose = graph.latest(PoseWithCovarianceStamped, "pose")
    assert pose.header.frame_id == "asphalt"
    assert pose.header.stamp.sec * 10**9 + pose.header.stamp.nanosec == stamp_of(index)
    assert pose.pose.pose.position.z == expected.extrinsics.height_m
    covariance = np.array(pose.pose.covariance).reshape(6, 6)
    np.testing.assert_array_equal(covariance[np.ix_([2, 4, 3], [2, 4, 3])], expected.covariance)


def test_result_file_is_a_parameter_file_of_any_node(graph, start, tmp_path):
    path = tmp_path / "out.yaml"
    start({"output_path": path})
    with Camera(graph, [rendered()]):
        assert graph.calibrate().success
    node = Node(
        "any_node",
        cli_args=["--ros-args", "--params-file", str(path)],
        automatically_declare_parameters_from_overrides=True,
    )
    try:
        saved = load_result(path)
        assert node.get_parameter("extrinsics.height_m").value == saved.extrinsics.height_m
        assert node.get_parameter("extrinsics.roll_std_rad").value == saved.std.roll_rad
        assert node.get_parameter("provenance.source").value == saved.provenance["source"]
        assert node.get_parameter("provenance.rig.width").value == 640
    finally:
        node.destroy_node()


def test_result_file_among_the_nodes_own_parameters_is_no_result(graph, start, tmp_path):
    """Old extrinsics must not be taken for a calibration of this run."""
    path = tmp_path / "old.yaml"
    path.write_text("/**: {ros__parameters: {extrinsics: {height_m: 9.0}, provenance: {schema: 1}}}")
    start(arguments=["--params-file", str(path)])
    assert graph.parameters(*RESULTS) == [None] * 6


@pytest.mark.parametrize("encoding", ["mono16", "bgr8", "rgba8", "png"])
def test_encodings_give_the_numbers_of_mono8(graph, start, encoding):
    """Grey images in another coat; for the colours' own weights see test_images.py."""
    start({"image_transport": "compressed" if encoding == "png" else "raw"})
    with Camera(graph, [rendered()], encoding):
        answer = graph.calibrate()
    assert answer.success, answer.message
    expected = Calibrator(ros_graph.RIG).add(*rendered())
    assert graph.parameters(*RESULTS[:3]) == list(expected.extrinsics.as_array())


def test_bayer_images_calibrate(graph, start):
    start()
    with Camera(graph, [rendered()], "bayer_rggb8"):
        answer = graph.calibrate()
    assert answer.success, answer.message


def test_several_frames_are_fused(graph, start):
    start({"frames": 4, "queue_size": 50})
    with Camera(graph, [rendered(index=i) for i in range(4)]):
        answer = graph.calibrate()
    assert answer.success and "from 4 frames" in answer.message, answer.message
    assert_near_truth(Extrinsics(*graph.parameters(*RESULTS[:3])))


def test_approximate_pairs(graph, start):
    start({"timeout_s": SHORT_S})
    with Camera(graph, [rendered()], right_late_ns=7_000_000):
        answer = graph.calibrate()
        assert not answer.success
        assert "the nearest stamps differ by 7.000 ms: set approximate_sync" in answer.message
        assert graph.set_parameter("approximate_sync", True).successful
        assert graph.set_parameter("approximate_sync_tolerance_seconds", 0.006).successful
        answer = graph.calibrate()
        assert not answer.success
        assert "approximate_sync_tolerance_seconds allows 6.000 ms: raise it" in answer.message
        assert graph.set_parameter("approximate_sync_tolerance_seconds", 0.007).successful
        assert graph.set_parameter("timeout_s", LONG_S).successful
        answer = graph.calibrate()
        assert answer.success, answer.message


def test_missing_camera_is_named_with_rates(graph, start):
    start({"timeout_s": SHORT_S})
    with Camera(graph, [rendered()], sides=["left"]):
        answer = graph.calibrate()
    assert not answer.success
    assert answer.message.startswith("no pair in 4.0 s: left ")
    assert (
        "right 0.0 Hz; nothing arrives on /right/image_rect (0 publishers): start the camera"
        in answer.message
    )


def test_missing_camera_info_is_named_and_parameters_replace_it(graph, start):
    start({"timeout_s": SHORT_S})
    with Camera(graph, [rendered()], infos=["left"]):
        answer = graph.calibrate()
        assert not answer.success
        assert "no CameraInfo on /right/camera_info (0 publishers)" in answer.message
        for name, value in ros_graph.RIG.to_mapping().items():
            assert graph.set_parameter(f"rig.{name}", value).successful
        assert graph.set_parameter("timeout_s", LONG_S).successful
        answer = graph.calibrate()
    assert answer.success, answer.message


def test_unknown_encoding_is_named(graph, start):
    start({"timeout_s": SHORT_S})
    with Camera(graph, [rendered()], "yuv422"):
        answer = graph.calibrate()
    assert not answer.success
    assert "image encoding 'yuv422' is not supported" in answer.message


def test_refusal_changes_nothing(graph, start, tmp_path):
    """The last good result stays latched, set and on disk; the next call works again."""
    path = tmp_path / "out.yaml"
    start({"timeout_s": SHORT_S, "output_path": path})
    with Camera(graph, [blank()]):
        answer = graph.calibrate()
    assert not answer.success and answer.message.startswith("no frame accepted, ")
    assert graph.parameters(*RESULTS) == [None] * 6
    assert graph.latest(ParameterEvent, "extrinsics") is None
    assert not path.exists()
    assert graph.set_parameter("timeout_s", LONG_S).successful
    with Camera(graph, [rendered()]):
        assert graph.calibrate().success
    assert graph.set_parameter("timeout_s", SHORT_S).successful
    before, content = graph.parameters(*RESULTS), path.read_bytes()
    with Camera(graph, [blank()]):
        assert not graph.calibrate().success
    assert graph.parameters(*RESULTS) == before
    assert path.read_bytes() == content
    assert graph.latest(ParameterEvent, "extrinsics").changed_parameters[0].value.double_value == before[0]


def test_good_frame_after_bad_ones_is_found(graph, start):
    start({"timeout_s": LONG_S})
    with Camera(graph, [blank(), blank(), blank(), rendered()]):
        answer = graph.calibrate()
    assert answer.success, answer.message


def test_images_from_before_the_call_are_not_used(graph, start):
    start({"timeout_s": 1.0})
    with Camera(graph, [rendered()]):
        graph.wait_for_diagnostics(lambda values, _: int(values["pairs"]) > 3)
    answer = graph.calibrate()
    assert not answer.success
    assert answer.message.startswith("no pair in 1.0 s: left 0.0 Hz, right 0.0 Hz")


def test_unwritable_file_does_not_undo_the_calibration(graph, start, tmp_path):
    path = tmp_path / "missing" / "out.yaml"
    start({"output_path": path})
    with Camera(graph, [rendered()]):
        answer = graph.calibrate()
    assert answer.success
    assert f"in effect, but not saved: {path} cannot be written: no such file or directory" in answer.message
    assert None not in graph.parameters(*RESULTS)


def test_second_call_is_busy_and_parameters_answer_meanwhile(graph, start):
    start({"timeout_s": LONG_S})
    first = graph.start_calibrate()
    graph.wait_for_diagnostics(lambda values, _: values["state"] == "calibrating")
    second = graph.calibrate()
    assert not second.success
    assert second.message.startswith("busy: ")
    assert graph.parameters("timeout_s") == [LONG_S]
    assert not first.done()
    with Camera(graph, [rendered()]):
        answer = wait_for(first)
    assert answer.success, answer.message


def test_nobody_ever_sees_half_a_result(graph, start):
    """Two frames calibrated in turns, parameters read all the time: one result or the other, no mix."""
    start()
    seen, known, ended = set(), {(None,) * 6}, threading.Event()

    def read():
        while not ended.is_set():
            seen.add(tuple(graph.parameters(*RESULTS)))

    reader = threading.Thread(target=read)
    reader.start()
    try:
        for camera, index in enumerate((0, 5, 0, 5)):
            with Camera(graph, [rendered(index=index)], first=10_000 * camera):
                assert graph.calibrate().success
            known.add(tuple(graph.parameters(*RESULTS)))
    finally:
        ended.set()
        reader.join()
    assert len(known) == 3
    assert seen <= known


def test_bag_that_starts_over_keeps_pairing(graph, start):
    """Stamps jump back with every pass; every pass must pair (message_filters gets stuck)."""
    start()
    for _ in range(3):
        with Camera(graph, [rendered()]):  # starts at its first stamp again
            graph.wait_for_diagnostics(lambda values, _: float(values["pair_rate_hz"]) > 2)
            assert graph.calibrate().success
    graph.wait_for_diagnostics(lambda values, _: int(values["resets"]) >= 2)


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("calling", [False, True])
def test_signal_ends_it_cleanly(graph, start, how, calling):
    process = start({"timeout_s": 3000.0})
    graph.parameters("timeout_s")  # it is up
    if calling:
        graph.start_calibrate()
        graph.wait_for_diagnostics(lambda values, _: values["state"] == "calibrating")
    assert process.end(how) == 0
    assert "Traceback" not in process.output and "rror" not in process.output, process.output


def test_signal_while_images_stream_ends_it_cleanly(graph, start):
    """Callbacks in flight must end before the node is taken apart."""
    process = start({"timeout_s": 3000.0})
    with Camera(graph, [blank()]):
        graph.start_calibrate()
        graph.wait_for_diagnostics(lambda values, _: int(values["pairs"]) > 5)
        assert process.end() == 0
    assert "xception" not in process.output, process.output


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"timeout_s": -1.0}, "timeout_s is -1.0: it must lie in 0.1 ... 3600.0 s"),
        ({"timeout_s": "soon"}, "timeout_s is 'soon': a value of type float is needed"),
        ({"frames": 0}, "frames is 0: it must lie in 1 ... 10000"),
        ({"rig.cx": ".nan"}, "rig.cx is nan: it must lie in"),
        ({"image_transport": "theora"}, "is 'theora': it must be one of raw, compressed; have others republ"),
        ({"rectified": False, "rig.fx": 500.0}, "rig.fx is set, but rectified is false: rig.* describes"),
        ({"road_frame": "''"}, "road_frame is empty"),
        ({"publish_tf": True, "road_frame": "/road"}, "frames of /tf_static do not begin with a slash"),
        ({"search.height_min_m": 6.0}, "the first must be the smaller"),
    ],
)
def test_wrong_parameter_at_the_start_is_one_line(start, parameters, words):
    process = start(parameters)
    assert process.wait() == 2
    (line,) = [line for line in process.output.splitlines() if line.startswith("stereo_selfcal: ")]
    assert words in line


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--params-file", "/nowhere.yaml"], "Couldn't parse params file: '--params-file /nowhere.yaml'"),
        (["-r", "left"], "Couldn't parse remap rule: '-r left'"),
        (["--no-such-flag"], "--no-such-flag"),
    ],
)
def test_wrong_ros_arguments_are_one_line(start, arguments, words):
    process = start(arguments=arguments)
    assert process.wait() == 2
    (line,) = [line for line in process.output.splitlines() if line.startswith("stereo_selfcal: ")]
    assert "wrong ROS arguments: " in line and words in line


def test_whole_numbers_are_taken_for_floats(graph, start):
    start({"timeout_s": 7})
    assert graph.parameters("timeout_s") == [7.0]
    assert graph.set_parameter("timeout_s", 8).successful
    assert graph.parameters("timeout_s") == [8.0]


def test_wrong_values_are_refused_with_a_reason_and_change_nothing(graph, start):
    start()
    before = graph.parameters("timeout_s", "frames", "seed", "search.height_min_m", "image_transport")
    for name, value, words in (
        ("timeout_s", math.nan, "out of range"),
        ("timeout_s", 0.0, "out of range"),
        ("timeout_s", "soon", "Wrong parameter type"),
        ("frames", 0, "out of range"),
        ("seed", -1, "out of range"),
        ("search.height_min_m", 19.0, "search.height_min_m is 19.0, search.height_max_m is 4.0"),
        ("image_transport", "compressed", "read-only"),
        ("road_frame", "", "road_frame is empty"),
        ("extrinsics.height_m", 1.0, "extrinsics.height_m is a result: it is set by ~/calibrate alone"),
        ("no_such_parameter", 1, "undeclared"),
    ):
        outcome = graph.set_parameter(name, value)
        assert not outcome.successful
        assert words in outcome.reason
    assert graph.parameters("timeout_s", "frames", "seed", "search.height_min_m", "image_transport") == before
    assert graph.parameters("extrinsics.height_m") == [None]


def test_results_cannot_be_deleted(graph, start):
    start()
    with Camera(graph, [rendered()]):
        assert graph.calibrate().success
    unset = Parameter(name="extrinsics.height_m", value=ParameterValue(type=ParameterType.PARAMETER_NOT_SET))
    assert not graph.set_parameter("extrinsics.height_m", unset).successful
    assert graph.parameters("extrinsics.height_m") != [None]


def values_of(status):
    return {pair.key: pair.value for pair in status.values}


def test_diagnostics_say_why_nothing_happens_and_what_is_found(graph, start, tmp_path):
    path = tmp_path / "missing" / "out.yaml"
    start({"timeout_s": LONG_S, "output_path": path})
    by_topic = {
        topic: graph.wait_for_diagnostics(lambda _, s, topic=topic: s.name == f"/stereo_selfcal: {topic}")
        for topic in ("calibration", "images", "camera info")
    }
    assert {status.hardware_id for status in by_topic.values()} == {"stereo_camera"}
    assert {status.level for status in by_topic.values()} == {b"\1"}
    assert by_topic["calibration"].message.startswith("uncalibrated: call ~/calibrate")
    assert "nothing arrives on /left/image_rect (0 publishers)" in by_topic["images"].message
    assert by_topic["camera info"].message.startswith("no CameraInfo on /left/camera_info (publishers: 0)")
    with Camera(graph, [blank(), rendered()]):
        graph.wait_for_diagnostics(lambda v, s: float(v["pair_rate_hz"]) > 1 and s.level == b"\0")
        info = graph.wait_for_diagnostics(lambda v, s: v["baseline"] == "0.1481 m" and s.level == b"\0")
        assert info.message == "640 x 480 px, baseline 0.1481 m, from CameraInfo"
        while int(values_of(graph.wait_for_diagnostics(lambda v, _: v["state"]))["frames_rejected"]) == 0:
            assert graph.calibrate().success  # with one of the frames that are bare at times
    status = graph.wait_for_diagnostics(lambda v, _: v["state"] == "calibrated")
    values = values_of(status)
    assert status.level == b"\1" and f"in effect, but not saved: {path}" in status.message
    assert values["height"].startswith("1.40") and "mm)" in values["height"]
    assert values["last_rejection"] == "no_lines_found"
    assert values["rejected_no_lines_found"] == values["frames_rejected"]
    assert values["time_per_frame"].endswith(")")


def test_pictures_are_drawn_while_somebody_looks(graph, start):
    """Why there is nothing to see, then the current image, then what a call made of its frame."""
    start({"timeout_s": LONG_S})
    pictures = {"debug_image": [], "birds_eye": []}
    subscriptions = [
        graph.node.create_subscription(Image, f"{ros_graph.NAME}/{name}", received.append, 1)
        for name, received in pictures.items()
    ]
    shown, above = pictures["debug_image"], pictures["birds_eye"]

    def bar(messages):
        """Return the colour of the verdict of the last picture."""
        return tuple(messages[-1].data[3 * 2 : 3 * 2 + 3]) if messages else None

    try:
        ros_graph.wait_until(lambda: bar(shown) == VERMILION, "a notice that nothing arrives")
        with Camera(graph, [rendered()]):
            ros_graph.wait_until(lambda: bar(shown) == YELLOW, "the image, not calibrated")
            assert graph.calibrate().success
            ros_graph.wait_until(lambda: bar(shown) == bar(above) == GREEN, "the calibrated frame")
            calibrated = shown[-1]
            ros_graph.wait_until(lambda: bar(shown) == SKY_BLUE, "the calibration in force")
        pose = graph.latest(PoseWithCovarianceStamped, "pose")
    finally:
        graph.destroy(graph.node.destroy_subscription, *subscriptions)
    assert calibrated.header.stamp == pose.header.stamp
    assert calibrated.header.frame_id == "stereo_camera"
    assert (calibrated.encoding, calibrated.width) == ("bgr8", 960)
    assert len(calibrated.data) == calibrated.step * calibrated.height


def test_markers_wait_for_late_listeners(graph, start):
    start({"road_frame": "asphalt"})
    with Camera(graph, [rendered()]):
        assert graph.calibrate().success
    markers = graph.latest(MarkerArray, "markers").markers
    pose = graph.latest(PoseWithCovarianceStamped, "pose")
    assert {m.header.frame_id for m in markers} == {"asphalt"}
    assert all(m.header.stamp == pose.header.stamp for m in markers)
    assert [len(m.points) > 10 for m in markers if m.ns == "lane_lines"] == [True, True]


def test_malformed_request_does_not_end_the_node(tmp_path, graph):
    with NodeProcess(tmp_path) as process:
        broken = Parameter(name="timeout_s", value=ParameterValue(type=99))
        request = ros_graph.SetParameters.Request(parameters=[broken])
        graph.start(ros_graph.SetParameters, "set_parameters", request)
        deadline = time.monotonic() + ros_graph.PATIENCE_S
        while "99 is not a valid" not in process.output and time.monotonic() < deadline:
            time.sleep(0.1)
        assert graph.parameters("frames") == [1]
        assert process.end() == 0
