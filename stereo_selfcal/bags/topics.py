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

"""The topics of the two cameras, found by type and name; no guess is made between equal candidates."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from itertools import takewhile
from typing import Literal

from ..core.camera.topic_names import RAW_WORDS, RECTIFIED_WORDS, says_rectified, words_of
from .errors import BagError
from .order import natural_key

Side = Literal["left", "right"]

IMAGE = "sensor_msgs/msg/Image"
COMPRESSED_IMAGE = "sensor_msgs/msg/CompressedImage"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"

# image_transport's suffix of a CompressedImage topic; camera_info belongs to the topic without it.
COMPRESSED_SUFFIX = "/compressed"
# Transports that send a CompressedImage as well, of something else than a picture of one of OpenCV's formats.
_OTHER_TRANSPORTS = ("/compressedDepth", "/zstd", "/theora", "/ffmpeg", "/foxglove")

# Messages of transports that send video, or of other codecs: FFMPEGPacket, CompressedVideo, theora's Packet.
_VIDEO = re.compile(r"ffmpeg|h26[45]|hevc|theora|video|packet$", re.IGNORECASE)

# "left" as a word: left/, image_left, left0, but neither "leftover" nor "cleft"; and its first letter.
_LEFT = re.compile(r"(?<![a-z])left(?![a-z])", re.IGNORECASE)
_LEFT_LETTER = re.compile(r"(?<![a-z])l(?![a-z])", re.IGNORECASE)
_RIGHT_OF = {"left": "right", "Left": "Right", "LEFT": "RIGHT", "l": "r", "L": "R"}
_SIDE = re.compile(r"(?<![a-z])(left|right)(?![a-z])", re.IGNORECASE)
# cam0/cam1 (EuRoC), camera_0/camera_1, infra1/infra2 (RealSense), image_00/image_01 (KITTI).
_NUMBERED = re.compile(r"(?<![a-z])((?:cam|camera|infra|image)_?)(\d+)(?=[/_]|$)", re.IGNORECASE)
# Image topics that show no scene in grey values.
_NO_CAMERA_IMAGE = re.compile(r"(?<![a-z])(depth|disparity|compressedDepth)(?![a-z])", re.IGNORECASE)
_COLOUR_WORDS = frozenset({"color", "colour"})
_GREY_WORDS = frozenset({"mono", "gray", "grey"})
# Words that say how an image of a camera was processed; without them the names of its images are equal.
_QUALIFIERS = RECTIFIED_WORDS | RAW_WORDS | _COLOUR_WORDS | _GREY_WORDS
# Words for any image or CameraInfo; the others tell cameras apart.
_GENERIC = _QUALIFIERS | {"image", "img", "camera", "cam", "info", "data", "camerainfo"}


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic of a recording.

    Attributes:
        name: Full name with the leading slash.
        msgtype: Type in ROS 2's spelling, "sensor_msgs/msg/Image".
        count: Number of messages.
    """

    name: str
    msgtype: str
    count: int

    @property
    def base(self) -> str:
        """The image topic without image_transport's suffix."""
        return self.name.removesuffix(COMPRESSED_SUFFIX) if self.msgtype == COMPRESSED_IMAGE else self.name

    @property
    def camera_info(self) -> str:
        """Name that the CameraInfo topic of this image has by convention: its sibling ``camera_info``."""
        return f"{self.base.rpartition('/')[0]}/camera_info"


@dataclass(frozen=True, slots=True)
class StereoTopics:
    """The image topics of the two cameras."""

    left: Topic
    right: Topic


# Says of a pair whether its CameraInfo has a baseline; None where that is not known.
HasBaseline = Callable[["StereoTopics"], "bool | None"]


def find_stereo_topics(
    topics: Iterable[Topic],
    left: str | None = None,
    right: str | None = None,
    raw: bool = False,
    has_baseline: HasBaseline | None = None,
) -> StereoTopics:
    """Return the image topics of the left and the right camera.

    A pair are two topics of one image type whose names differ in one word, ``left`` and ``right``.
    Only if there is none, ``l`` and ``r`` are, and then two cameras numbered n and n + 1. Pairs without a
    baseline are none where another one has one: cameras that look front left and front right. Of one
    camera's topics a rectified one is preferred to a raw one, Image to CompressedImage, grey to colour.

    Args:
        topics: All topics of the recording.
        left: Name of the left image topic, None to find it.
        right: The same of the right one.
        raw: Whether raw images are preferred to rectified ones instead.
        has_baseline: Looks at the CameraInfo of a pair; asked only where there are several.

    Raises:
        BagError: There is no pair, or several cameras could be meant; the candidates are listed.
    """
    images, usable = _images(topics)
    if left is not None and right is not None:
        found = StereoTopics(_named(images, left, "left"), _named(images, right, "right"))
        if found.left == found.right:
            raise BagError(f"--left and --right are both {found.left.name}: give two topics")
        return found
    if not usable:
        raise BagError(f"no images: {_no_images(images)}; record both image topics of the stereo camera")
    kinds = _pairs_by_kind(usable)
    if left is not None:
        wanted = _named(images, left, "left")
        kinds = [[pair for pair in pairs if pair.left == wanted] for pairs in kinds]
    elif right is not None:
        wanted = _named(images, right, "right")
        kinds = [[pair for pair in pairs if pair.right == wanted] for pairs in kinds]
    pairs = _candidates(kinds, has_baseline)
    if not pairs:
        raise BagError(_no_pair(images, usable, left, right))
    best = _best(pairs, raw)
    if len(best) > 1:
        candidates = "; ".join(f"{pair.left.name} with {pair.right.name}" for pair in best)
        raise BagError(
            f"several stereo cameras could be meant ({candidates}): choose with --left and --right"
        )
    return best[0]


def find_camera_info(
    topics: Iterable[Topic], pair: StereoTopics, left: str | None = None, right: str | None = None
) -> tuple[Topic, Topic]:
    """Return the CameraInfo topics of the left and the right camera.

    By convention it is called ``camera_info`` and lies beside the image. Others are found by what their names
    have in common with the image's besides words such as image and rect: ``left_camera_info`` beside
    ``left_image_rect``.

    Args:
        topics: All topics of the recording.
        pair: The image topics.
        left: Name of the left CameraInfo topic, None to find it.
        right: The same of the right one.

    Raises:
        BagError: There is none, or several could be meant; all there are are listed.
    """
    infos = [topic for topic in topics if topic.msgtype == CAMERA_INFO]
    sides: tuple[tuple[Side, Topic, str | None], ...] = (
        ("left", pair.left, left),
        ("right", pair.right, right),
    )
    found = [
        _info_of(infos, image, side) if name is None else _named_info(infos, name, side)
        for side, image, name in sides
    ]
    return found[0], found[1]


def _named_info(infos: Sequence[Topic], name: str, side: Side) -> Topic:
    full = f"/{name.strip('/')}"
    for topic in infos:
        if topic.name == full and topic.count:
            return topic
    raise BagError(f"--{side}-info {name}: no message on such a CameraInfo topic; {_listed_infos(infos)}")


def _info_of(infos: Sequence[Topic], image: Topic, side: Side) -> Topic:
    """Return the CameraInfo topic of an image that nobody has named."""
    used = [topic for topic in infos if topic.count]
    for name in (image.camera_info, f"{image.base}/camera_info"):
        for topic in used:
            if topic.name == name:
                return topic
    of_camera = [topic for topic in used if _camera_words(topic.name) == _camera_words(image.base)]
    if of_camera:
        near = max(_common_parts(topic.name, image.base) for topic in of_camera)
        nearest = [topic for topic in of_camera if _common_parts(topic.name, image.base) == near]
        if len(nearest) == 1:
            return nearest[0]
    raise BagError(
        f"no CameraInfo on {image.camera_info} for {image.name}; {_listed_infos(used)}; name it with "
        f"--{side}-info, or give the rig with --rig"
    )


def _listed_infos(infos: Iterable[Topic]) -> str:
    return f"CameraInfo topics: {', '.join(sorted(topic.name for topic in infos)) or 'none'}"


def _camera_words(name: str) -> list[str]:
    """Return the words of a topic that tell its camera from others, in order."""
    return [word for word in words_of(name) if word not in _GENERIC]


def _common_parts(name: str, other: str) -> int:
    """Return how many parts of two paths are equal from the start on."""
    pairs = zip(name.split("/"), other.split("/"), strict=False)
    return len(list(takewhile(lambda pair: pair[0] == pair[1], pairs)))


def other_images(topics: Iterable[Topic], pair: StereoTopics) -> list[str]:
    """Return the names of the topics with images of other cameras than those of a pair."""
    known = {_camera_of(pair.left.base), _camera_of(pair.right.base)}
    return [topic.name for topic in _images(topics)[1] if _camera_of(topic.base) not in known]


def find_stereo_pairs(
    topics: Iterable[Topic], raw: bool = False, has_baseline: HasBaseline | None = None
) -> list[StereoTopics]:
    """Return the image topics of every stereo camera, ordered by name; as :func:`find_stereo_topics`.

    Raises:
        BagError: There is no pair.
    """
    images, usable = _images(topics)
    if not usable:
        raise BagError(f"no images: {_no_images(images)}; record both image topics of the stereo camera")
    pairs = _candidates(_pairs_by_kind(usable), has_baseline)
    if not pairs:
        raise BagError(_no_pair(images, usable, None, None))
    return _best(pairs, raw)


def _images(topics: Iterable[Topic]) -> tuple[list[Topic], list[Topic]]:
    """Return the image topics, and those of them that show a scene."""
    images = [t for t in topics if t.msgtype in (IMAGE, COMPRESSED_IMAGE) or _VIDEO.search(t.msgtype)]
    used = [
        t for t in images if t.count > 0 and not _NO_CAMERA_IMAGE.search(t.name) and not _other_transport(t)
    ]
    return images, [topic for topic in used if not _is_copy(topic, {each.name for each in used})]


def _is_copy(topic: Topic, names: Collection[str]) -> bool:
    """Whether a transport that is not known here sends the images of another of these topics."""
    if topic.msgtype != COMPRESSED_IMAGE or topic.name.endswith(COMPRESSED_SUFFIX):
        return False
    image = topic.name.rpartition("/")[0]
    return image in names or image + COMPRESSED_SUFFIX in names


def _other_transport(topic: Topic) -> bool:
    """Whether a topic is sent by a transport whose messages are no pictures."""
    compressed = topic.msgtype == COMPRESSED_IMAGE
    return topic.name.endswith(_OTHER_TRANSPORTS) if compressed else topic.msgtype != IMAGE


def _named(images: Sequence[Topic], name: str, side: Side) -> Topic:
    """Return the image topic a user named; ``X`` also finds ``X/compressed``."""
    full = f"/{name.strip('/')}"
    for candidate in (full, full + COMPRESSED_SUFFIX):
        for topic in images:
            if topic.name == candidate:
                if topic.count == 0:
                    raise BagError(f"--{side} {topic.name}: the recording has no message on it")
                if _other_transport(topic):
                    raise BagError(
                        f"--{side} {topic.name}: of the transports, raw and compressed can be read; "
                        "'ros2 run image_transport republish' makes them from this one"
                    )
                return topic
    listed = ", ".join(t.name for t in images) or "none"
    raise BagError(f"--{side} {name}: no such image topic in the recording; its image topics: {listed}")


def _no_images(images: Sequence[Topic]) -> str:
    if not images:
        return "the recording has no topic of type sensor_msgs/Image or CompressedImage"
    listed = ", ".join(f"{t.name} ({t.count} messages{_type_of(t)})" for t in images)
    if any(t.count and _other_transport(t) for t in images):
        return (
            f"nothing usable among {listed}; of the transports, raw and compressed can be read: play the "
            "recording through 'ros2 run image_transport republish' and record that"
        )
    return f"nothing usable among {listed}"


def _type_of(topic: Topic) -> str:
    return "" if topic.msgtype in (IMAGE, COMPRESSED_IMAGE) else f" of {topic.msgtype}"


def _no_pair(images: Sequence[Topic], usable: Sequence[Topic], left: str | None, right: str | None) -> str:
    listed = ", ".join(t.name for t in usable)
    known = {topic.base for topic in usable}
    unread = [t for t in images if t.count and _other_transport(t) and t.name.rpartition("/")[0] not in known]
    if unread:
        sent = ", ".join(f"{t.name}{_type_of(t)}" for t in unread)
        listed += f" (not read are {sent}: 'ros2 run image_transport republish' makes images of them)"
    if left is not None or right is not None:
        given, other = ("left", "right") if left is not None else ("right", "left")
        return f"no {other} camera found for --{given}: give --{other} too; image topics: {listed}"
    sides = {word.lower() for t in usable for word in _SIDE.findall(t.name)}
    if len(usable) == 1 or len(sides) == 1:
        which = f" ({sides.pop()})" if len(sides) == 1 else ""
        return (
            f"only one camera{which} in the recording, image topics: {listed}; "
            "record both, or name them with --left and --right"
        )
    return f"no left/right pair among the image topics {listed}: name them with --left and --right"


def _pairs_by_kind(topics: Sequence[Topic]) -> list[list[StereoTopics]]:
    """Return the pairs by left and right, those by l and r, and those by numbers: the surest first."""
    return [_pairs_by_word(topics, _LEFT), _pairs_by_word(topics, _LEFT_LETTER), _pairs_by_number(topics)]


def _candidates(kinds: Sequence[list[StereoTopics]], has_baseline: HasBaseline | None) -> list[StereoTopics]:
    """Return the pairs of the surest kind, without those that have no baseline where others have one."""
    if has_baseline is not None and sum(map(len, kinds)) > 1:
        first = next(pairs for pairs in kinds if pairs)
        if any(has_baseline(pair) is False for pair in first):
            said = [[(pair, has_baseline(pair)) for pair in pairs] for pairs in kinds]
            if any(has for pairs in said for _, has in pairs):
                kinds = [[pair for pair, has in pairs if has] for pairs in said]
    return next((pairs for pairs in kinds if pairs), [])


def _pairs_by_word(topics: Sequence[Topic], left: re.Pattern[str]) -> list[StereoTopics]:
    """Return the pairs whose names differ in exactly one word, that of the left one and that of the right."""
    known = {(t.name, t.msgtype): t for t in topics}
    pairs = []
    for topic in topics:
        for match in left.finditer(topic.name):
            word = match.group()
            other = _RIGHT_OF.get(word, _RIGHT_OF[word.lower()])
            name = topic.name[: match.start()] + other + topic.name[match.end() :]
            if (name, topic.msgtype) in known:
                pairs.append(StereoTopics(topic, known[name, topic.msgtype]))
    return pairs


def _pairs_by_number(topics: Sequence[Topic]) -> list[StereoTopics]:
    """Return the pairs whose names differ in exactly one camera number, n and n + 1."""
    known = {(t.name, t.msgtype): t for t in topics}
    pairs = []
    for topic in topics:
        for match in _NUMBERED.finditer(topic.name):
            number = str(int(match.group(2)) + 1).zfill(len(match.group(2)))
            name = topic.name[: match.start(2)] + number + topic.name[match.end(2) :]
            if (name, topic.msgtype) in known:
                pairs.append(StereoTopics(topic, known[name, topic.msgtype]))
    return pairs


def _rectification(topic: Topic, raw: bool) -> int:
    """Return 0 for a name that says rectified (``raw``: says raw), 2 for one that says the other, else 1."""
    says = says_rectified(topic.base)
    wanted, other = says[::-1] if raw else says
    return 0 if wanted else 2 if other else 1


def _rank(pair: StereoTopics, raw: bool) -> tuple[int, bool, int]:
    """Order of preference among the topics of one camera, smallest first."""
    # Of a folder that has the camera's name, as camera_color_left, the colour is the camera's.
    words = {word for part in _qualifying_parts(pair.left.base) for word in words_of(part)}
    colour = 2 if words & _COLOUR_WORDS else 1 if words & _GREY_WORDS else 0
    return _rectification(pair.left, raw), pair.left.msgtype == COMPRESSED_IMAGE, colour


def _qualifying_parts(name: str) -> list[str]:
    """Return the last part of a path, and those before it that only say how the image was processed."""
    *folders, leaf = name.split("/")
    return [*(part for part in folders if part and set(words_of(part)) <= _QUALIFIERS), leaf]


def _camera_of(name: str) -> str:
    """Return the name of an image topic without what says how the image was processed."""
    *folders, leaf = name.split("/")
    kept = [part for part in folders if part and not set(words_of(part)) <= _QUALIFIERS]
    return "/".join([*kept, "_".join(word for word in words_of(leaf) if word not in _QUALIFIERS)])


def _best(pairs: Sequence[StereoTopics], raw: bool) -> list[StereoTopics]:
    """Return the preferred pair of every camera, only those of the preferred kind when there are any."""
    cameras: dict[str, list[StereoTopics]] = {}
    for pair in pairs:
        cameras.setdefault(f"{_camera_of(pair.left.base)} {_camera_of(pair.right.base)}", []).append(pair)
    chosen = []
    for group in cameras.values():
        first = min(_rank(pair, raw) for pair in group)
        chosen += [pair for pair in group if _rank(pair, raw) == first]
    best = min(_rectification(pair.left, raw) for pair in chosen)
    of_best = [pair for pair in chosen if _rectification(pair.left, raw) == best]
    return sorted(of_best, key=lambda pair: natural_key(pair.left.name))
