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

"""Finding the two cameras among the topics of a recording."""

import pytest

from stereo_selfcal.bags.errors import BagError
from stereo_selfcal.bags.topics import (
    CAMERA_INFO,
    COMPRESSED_IMAGE,
    IMAGE,
    StereoTopics,
    Topic,
    find_camera_info,
    find_stereo_pairs,
    find_stereo_topics,
)

TRANSPORTS = ("/compressed", "/compressedDepth", "/zstd", "/theora", "/jxl")


def topics(*names, count=5):
    """Image topics; those that end as image_transport's do are compressed."""
    return [Topic(n, COMPRESSED_IMAGE if n.endswith(TRANSPORTS) else IMAGE, count) for n in names]


def both(*names):
    """Each name with {} as left and as right."""
    return [name.format(side) for name in names for side in ("left", "right")]


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (both("/stereo/{}/image_rect"), "/stereo/{}/image_rect"),
        (both("/{}/image_rect")[::-1], "/{}/image_rect"),
        # Of one camera: rectified before raw, Image before CompressedImage, grey before colour.
        (both("/s/{}/image_raw", "/s/{}/image_rect"), "/s/{}/image_rect"),
        (both("/s/{}/image_rect/compressed", "/s/{}/image_rect"), "/s/{}/image_rect"),
        (both("/s/{}/image_raw", "/s/{}/image_rect/compressed"), "/s/{}/image_rect/compressed"),
        (both("/s/{}/image_rect_color", "/s/{}/image_rect"), "/s/{}/image_rect"),
        (both("/s/{}/image_color", "/s/{}/image_mono"), "/s/{}/image_mono"),
        # Only one is complete.
        (["/s/left/image_rect", *both("/s/{}/image_raw")], "/s/{}/image_raw"),
        # ZED: the rectified pair beside raw ones in other namespaces, and depth.
        (
            both("/zed/{}_raw/image_raw_color", "/zed/{}/image_rect_color", "/zed/depth/{}/image_rect"),
            "/zed/{}/image_rect_color",
        ),
        # The side as a part of a name (KITTI).
        (both("/kitti/camera_gray_{}/image_raw"), "/kitti/camera_gray_{}/image_raw"),
        (both("/cam/image_{}"), "/cam/image_{}"),
        # The word left elsewhere in the name stays.
        (both("/left_arm/{}/image"), "/left_arm/{}/image"),
        # ZED from 5.1 on: the folders say how an image was processed.
        (
            both("/zed/{}/color/raw/image", "/zed/{}/color/rect/image", "/zed/{}/gray/rect/image"),
            "/zed/{}/gray/rect/image",
        ),
        (both("/zed/{}/color/raw/image", "/zed/{}/color/rect/image"), "/zed/{}/color/rect/image"),
        (both("/s/{}/raw/image", "/s/{}/image"), "/s/{}/image"),
        (both("/s/{}/unrectified", "/s/{}/imageRect"), "/s/{}/imageRect"),
        # What "ros2 bag record -a" finds of each image.
        (
            both(
                *(
                    f"/s/{{}}/image_raw{end}"
                    for end in ("", "/compressed", "/compressedDepth", "/zstd", "/theora")
                )
            ),
            "/s/{}/image_raw",
        ),
        (both("/s/{}/image_raw/compressed", "/s/{}/image_raw/zstd"), "/s/{}/image_raw/compressed"),
        (both("/s/{}/image_raw", "/s/{}/image_raw/jxl"), "/s/{}/image_raw"),  # one that is not known here
        (both("/s/{}/image_raw/compressed", "/s/{}/image_raw/jxl"), "/s/{}/image_raw/compressed"),
        (both("/s/{}/jxl"), "/s/{}/jxl"),
        # Left and right before numbers.
        (["/cam0/image", "/cam1/image", *both("/s/{}/image")], "/s/{}/image"),
    ],
)
def test_left_and_right_are_found(names, expected):
    found = find_stereo_topics(topics(*names))
    assert [found.left.name, found.right.name] == both(expected)


def test_capital_letters():
    found = find_stereo_topics(topics("/Left/image", "/Right/image"))
    assert (found.left.name, found.right.name) == ("/Left/image", "/Right/image")


@pytest.mark.parametrize(
    "names",
    [
        ["/cam0/image_raw", "/cam1/image_raw"],  # EuRoC
        ["/camera/infra1/image_rect_raw", "/camera/infra2/image_rect_raw"],  # RealSense
        ["/image_00/data", "/image_01/data"],  # KITTI
        ["/camera_9/image", "/camera_10/image"],
    ],
)
def test_numbered_cameras_are_found(names):
    found = find_stereo_topics(topics(*names, "/camera/depth/image_rect_raw"))
    assert [found.left.name, found.right.name] == names


@pytest.mark.parametrize(
    "names",
    [
        ["/front/left/image", "/front/right/image", "/rear/left/image", "/rear/right/image"],
        ["/cams/front_left", "/cams/front_right", "/cams/rear_left", "/cams/rear_right"],
        ["/cam0/image", "/cam1/image", "/cam2/image"],
        # Different cameras: neither the kind of message nor the colour may decide.
        [
            "/front/left/image_rect",
            "/front/right/image_rect",
            "/rear/left/image_rect/compressed",
            "/rear/right/image_rect/compressed",
        ],
    ],
)
def test_ambiguity_lists_the_candidates(names):
    with pytest.raises(BagError, match=r"--left and --right") as error:
        find_stereo_topics(topics(*names))
    assert all(name in str(error.value) for name in names)


VIDEO = [
    Topic(name, "ffmpeg_image_transport_msgs/msg/FFMPEGPacket", 9) for name in both("/{}/image_raw/ffmpeg")
]


@pytest.mark.parametrize(
    ("available", "message"),
    [
        ([], "no topic of type sensor_msgs/Image"),
        ([Topic("/left/camera_info", CAMERA_INFO, 5)], "no topic of type sensor_msgs/Image"),
        (topics("/left/image", "/right/image", count=0), r"/left/image \(0 messages\)"),
        (topics("/stereo/left/image_rect"), r"only one camera \(left\).*/stereo/left/image_rect"),
        (topics("/stereo/right/image_rect", "/stereo/right/image_raw"), r"only one camera \(right\)"),
        (topics("/camera/image"), "only one camera in the recording"),
        (topics("/front/image", "/rear/image"), "no left/right pair among .*/front/image, /rear/image"),
        (topics("/cleft/image", "/cright/image"), "no left/right pair"),
        (topics("/left/image/compressedDepth", "/right/image/compressedDepth"), "no images"),
        (
            VIDEO,
            r"/left/image_raw/ffmpeg \(9 messages of ffmpeg_.*/FFMPEGPacket\).*transport republish",
        ),
        (
            [*topics("/left/image"), *VIDEO],
            r"only one camera .*not read are /left/image_raw/ffmpeg of",
        ),
        ([Topic("/left/v", "foxglove_msgs/msg/CompressedVideo", 3)], "CompressedVideo.*republish"),
        ([Topic("/left/image/theora", "theora_image_transport/msg/Packet", 3)], "theora.*republish"),
        (topics("/left/image/zstd", "/right/image/zstd"), "raw and compressed can be read.*republish"),
    ],
)
def test_no_pair_says_what_there_is(available, message):
    with pytest.raises(BagError, match=message):
        find_stereo_topics(available)


FOUR = topics("/front/left/image", "/front/right/image", "/rear/left/image", "/rear/right/image")


@pytest.mark.parametrize(
    ("given", "found"),
    [
        ({"left": "/front/left/image"}, ("/front/left/image", "/front/right/image")),
        ({"right": "/rear/right/image"}, ("/rear/left/image", "/rear/right/image")),
        ({"left": "rear/left/image"}, ("/rear/left/image", "/rear/right/image")),
        (
            {"left": "/front/left/image", "right": "/rear/left/image"},
            ("/front/left/image", "/rear/left/image"),
        ),
    ],
)
def test_named_topics_win(given, found):
    pair = find_stereo_topics(FOUR, **given)
    assert (pair.left.name, pair.right.name) == found


def test_transport_suffix_may_be_left_out():
    pair = find_stereo_topics(
        topics("/a/left/image/compressed", "/a/right/image/compressed"), left="/a/left/image"
    )
    assert pair.right.name == "/a/right/image/compressed"
    assert pair.left.camera_info == "/a/left/camera_info"


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"left": "/zstd/left/image/zstd"}, "--left /zstd/.*: of the transports, raw and compressed can be"),
        ({"left": "/nowhere"}, "--left /nowhere: no such image topic.*/front/left/image"),
        ({"left": "/front/left/image", "right": "/front/left/image"}, "give two topics"),
        ({"left": "/front/right/image"}, "no right camera found for --left"),
        ({"right": "/front/left/image"}, "no left camera found for --right"),
    ],
)
def test_wrong_names_are_refused(given, message):
    with pytest.raises(BagError, match=message):
        find_stereo_topics([*FOUR, *topics("/zstd/left/image/zstd")], **given)


def test_named_topic_without_messages_is_refused():
    with pytest.raises(BagError, match="no message on it"):
        find_stereo_topics([*FOUR, *topics("/x/left/image", count=0)], left="/x/left/image")


def test_with_raw_the_raw_one_of_the_folders_is_taken():
    names = both("/zed/{}/color/raw/image", "/zed/{}/color/rect/image", "/zed/{}/gray/rect/image")
    found = find_stereo_topics(topics(*names), raw=True)
    assert found.left.name == "/zed/left/color/raw/image"


def test_cameras_whose_names_hold_a_colour_are_different_cameras():
    """KITTI's grey and colour cameras are pairs of their own; folders of ZED's colours are not."""
    names = both("/kitti/camera_gray_{}/image_raw", "/kitti/camera_color_{}/image_raw")
    assert [pair.left.name for pair in find_stereo_pairs(topics(*names))] == [
        "/kitti/camera_color_left/image_raw",
        "/kitti/camera_gray_left/image_raw",
    ]
    names = both("/zed/{}/color/rect/image", "/zed/{}/gray/rect/image")
    assert [pair.left.name for pair in find_stereo_pairs(topics(*names))] == ["/zed/left/gray/rect/image"]


def infos(*names, count=5):
    return [Topic(name, CAMERA_INFO, count) for name in names]


def info_names(images, available, **given):
    """Return the names of the CameraInfo topics found for an image topic with {} as the side."""
    kind = COMPRESSED_IMAGE if images.endswith(TRANSPORTS) else IMAGE
    left, right = (Topic(name, kind, 5) for name in both(images))
    return [topic.name for topic in find_camera_info(available, StereoTopics(left, right), **given)]


@pytest.mark.parametrize(
    ("images", "available", "expected"),
    [
        ("/s/{}/image_rect", both("/s/{}/camera_info"), "/s/{}/camera_info"),
        ("/s/{}/image_rect/compressed", both("/s/{}/camera_info"), "/s/{}/camera_info"),
        # Image and CameraInfo share one namespace.
        ("/s/{}_image_rect", both("/s/{}_camera_info"), "/s/{}_camera_info"),
        ("/s/image_{}", both("/s/camera_info_{}"), "/s/camera_info_{}"),
        ("/s/{}_image_rect", both("/s/{}_info", "/other/{}_info"), "/s/{}_info"),
        ("/{}Image", both("/{}CameraInfo"), "/{}CameraInfo"),
        # Below the image, and above it.
        ("/s/{}", both("/s/{}/camera_info"), "/s/{}/camera_info"),
        ("/s/{}/rect/image", both("/s/{}/camera_info"), "/s/{}/camera_info"),
        # One for each way to process the image.
        (
            "/zed/{}/gray/rect/image",
            both("/zed/{}/color/rect/camera_info", "/zed/{}/gray/rect/camera_info"),
            "/zed/{}/gray/rect/camera_info",
        ),
    ],
)
def test_camera_info_is_found(images, available, expected):
    assert info_names(images, infos(*available, "/gps/camera_info")) == both(expected)


def test_camera_info_can_be_named():
    available = infos(*both("/calibration/{}/info"), *both("/s/{}/camera_info"))
    given = {"left": "calibration/left/info", "right": "/calibration/right/info"}
    assert info_names("/s/{}/image", available, **given) == both("/calibration/{}/info")
    assert info_names("/s/{}/image", available, left=given["left"])[1] == "/s/right/camera_info"


@pytest.mark.parametrize(
    ("available", "given", "message"),
    [
        ([], {}, r"no CameraInfo on /s/left/camera_info for /s/left/image;.*none; .*--left-info.*--rig"),
        (
            infos("/s/left/camera_info"),
            {},
            "CameraInfo topics: /s/left/camera_info; name it with --right-info",
        ),
        (infos(*both("/s/{}/camera_info"), count=0), {}, "CameraInfo topics: none"),
        (infos(*both("/a/s/{}/info", "/b/s/{}/info")), {}, "no CameraInfo .*/a/s/left/info, /a/s/right/info"),
        (infos("/x/info"), {"left": "/y/info"}, "--left-info /y/info: no message on such.*: /x/info"),
        (infos("/x/info", count=0), {"left": "/x/info"}, "no message on such"),
    ],
)
def test_camera_info_that_is_not_found_can_be_named(available, given, message):
    with pytest.raises(BagError, match=message):
        info_names("/s/{}/image", available, **given)


def test_l_and_r_are_words_of_sides():
    names = ["/stereo/cam_l/image_rect", "/stereo/cam_r/image_rect", "/leader/image"]
    found = find_stereo_topics(topics(*names))
    assert [found.left.name, found.right.name] == names[:2]
    names = ["/CAM_L/image", "/CAM_R/image"]
    assert find_stereo_topics(topics(*names)).right.name == names[1]


def test_named_video_is_refused_with_the_remedy():
    with pytest.raises(BagError, match=r"raw and compressed can be read; .*republish"):
        find_stereo_topics(VIDEO, left="/left/image_raw/ffmpeg", right="/right/image_raw/ffmpeg")


SURROUND = [*both("/surround/front_{}/image_rect"), "/stereo/cam_l/image_rect", "/stereo/cam_r/image_rect"]


@pytest.mark.parametrize(
    "find", [find_stereo_topics, lambda *each: find_stereo_pairs(each[0], each[3], each[4])[0]]
)
def test_a_pair_without_a_baseline_is_none_where_another_has_one(find):
    found = find(topics(*SURROUND), None, None, False, lambda pair: "surround" not in pair.left.name)
    assert [found.left.name, found.right.name] == SURROUND[2:]


@pytest.mark.parametrize("has", [True, False, None])
def test_names_decide_where_no_baseline_or_every_one_is_known(has):
    found = find_stereo_topics(topics(*SURROUND), has_baseline=lambda pair: has)
    assert found.left.name == SURROUND[0]
