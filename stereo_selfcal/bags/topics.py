"""The topics of the two cameras, found by type and name; no guess is made between equal candidates."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

from .errors import BagError
from .order import natural_key

Side = Literal["left", "right"]

IMAGE = "sensor_msgs/msg/Image"
COMPRESSED_IMAGE = "sensor_msgs/msg/CompressedImage"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"

# image_transport's suffix of a CompressedImage topic; camera_info belongs to the topic without it.
COMPRESSED_SUFFIX = "/compressed"

# "left" as a word: left/, image_left, left0, but neither "leftover" nor "cleft".
_LEFT = re.compile(r"(?<![a-z])left(?![a-z])", re.IGNORECASE)
_SIDE = re.compile(r"(?<![a-z])(left|right)(?![a-z])", re.IGNORECASE)
# cam0/cam1 (EuRoC), camera_0/camera_1, infra1/infra2 (RealSense), image_00/image_01 (KITTI).
_NUMBERED = re.compile(r"(?<![a-z])((?:cam|camera|infra|image)_?)(\d+)(?=[/_]|$)", re.IGNORECASE)
# Image topics that show no scene in grey values.
_NO_CAMERA_IMAGE = re.compile(r"(?<![a-z])(depth|disparity|compressedDepth)(?![a-z])", re.IGNORECASE)
# Words that image_proc appends to one camera's image; without them the names are equal.
_QUALIFIER = re.compile(
    r"_?(?<![a-z])(rectified|rect|raw|mono|gray|grey|color|colour)(?![a-z])", re.IGNORECASE
)
_COLOUR = re.compile("colou?r")
_GREY = re.compile("mono|gr[ae]y")


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
        """Name of the CameraInfo topic that belongs to this image: its sibling ``camera_info``."""
        return f"{self.base.rpartition('/')[0]}/camera_info"


@dataclass(frozen=True, slots=True)
class StereoTopics:
    """The image topics of the two cameras."""

    left: Topic
    right: Topic


def find_stereo_topics(
    topics: Iterable[Topic], left: str | None = None, right: str | None = None, raw: bool = False
) -> StereoTopics:
    """Return the image topics of the left and the right camera.

    A pair are two topics of one image type whose names differ in one word, ``left`` and ``right``.
    Only if there is none, two cameras numbered n and n + 1 are taken. Of one camera's topics a
    rectified one is preferred to a raw one, Image to CompressedImage, grey to colour.

    Args:
        topics: All topics of the recording.
        left: Name of the left image topic, None to find it.
        right: The same of the right one.
        raw: Whether raw images are preferred to rectified ones instead.

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
    pairs = _pairs_by_side(usable) or _pairs_by_number(usable)
    if left is not None:
        wanted = _named(images, left, "left")
        pairs = [pair for pair in pairs if pair.left == wanted]
    elif right is not None:
        wanted = _named(images, right, "right")
        pairs = [pair for pair in pairs if pair.right == wanted]
    if not pairs:
        raise BagError(_no_pair(usable, left, right))
    best = _best(pairs, raw)
    if len(best) > 1:
        candidates = "; ".join(f"{pair.left.name} with {pair.right.name}" for pair in best)
        raise BagError(
            f"several stereo cameras could be meant ({candidates}): choose with --left and --right"
        )
    return best[0]


def find_stereo_pairs(topics: Iterable[Topic], raw: bool = False) -> list[StereoTopics]:
    """Return the image topics of every stereo camera, ordered by name; as :func:`find_stereo_topics`.

    Raises:
        BagError: There is no pair.
    """
    images, usable = _images(topics)
    if not usable:
        raise BagError(f"no images: {_no_images(images)}; record both image topics of the stereo camera")
    pairs = _pairs_by_side(usable) or _pairs_by_number(usable)
    if not pairs:
        raise BagError(_no_pair(usable, None, None))
    return _best(pairs, raw)


def _images(topics: Iterable[Topic]) -> tuple[list[Topic], list[Topic]]:
    """Return the image topics, and those of them that show a scene."""
    images = [t for t in topics if t.msgtype in (IMAGE, COMPRESSED_IMAGE)]
    return images, [t for t in images if t.count > 0 and not _NO_CAMERA_IMAGE.search(t.name)]


def _named(images: Sequence[Topic], name: str, side: Side) -> Topic:
    """Return the image topic a user named; ``X`` also finds ``X/compressed``."""
    full = f"/{name.strip('/')}"
    for candidate in (full, full + COMPRESSED_SUFFIX):
        for topic in images:
            if topic.name == candidate:
                if topic.count == 0:
                    raise BagError(f"--{side} {topic.name}: the recording has no message on it")
                return topic
    listed = ", ".join(t.name for t in images) or "none"
    raise BagError(f"--{side} {name}: no such image topic in the recording; its image topics: {listed}")


def _no_images(images: Sequence[Topic]) -> str:
    if not images:
        return "the recording has no topic of type sensor_msgs/Image or CompressedImage"
    return f"nothing usable among {', '.join(f'{t.name} ({t.count} messages)' for t in images)}"


def _no_pair(usable: Sequence[Topic], left: str | None, right: str | None) -> str:
    listed = ", ".join(t.name for t in usable)
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


def _pairs_by_side(topics: Sequence[Topic]) -> list[StereoTopics]:
    """Return the pairs whose names differ in exactly one word, left and right."""
    known = {(t.name, t.msgtype): t for t in topics}
    pairs = []
    for topic in topics:
        for match in _LEFT.finditer(topic.name):
            word = match.group()
            other = "RIGHT" if word.isupper() else "Right" if word[0].isupper() else "right"
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
    leaf = topic.base.rpartition("/")[2].lower()
    says = "rect" in leaf, "raw" in leaf
    wanted, other = says[::-1] if raw else says
    return 0 if wanted else 2 if other else 1


def _rank(pair: StereoTopics, raw: bool) -> tuple[int, bool, int]:
    """Order of preference among the topics of one camera, smallest first."""
    leaf = pair.left.base.rpartition("/")[2].lower()
    colour = 2 if _COLOUR.search(leaf) else 1 if _GREY.search(leaf) else 0
    return _rectification(pair.left, raw), pair.left.msgtype == COMPRESSED_IMAGE, colour


def _best(pairs: Sequence[StereoTopics], raw: bool) -> list[StereoTopics]:
    """Return the preferred pair of every camera, only those of the preferred kind when there are any."""
    cameras: dict[str, list[StereoTopics]] = {}
    for pair in pairs:
        namespace, _, leaf = pair.left.base.rpartition("/")
        camera = f"{namespace}/{_QUALIFIER.sub('', leaf)} {_QUALIFIER.sub('', pair.right.base)}"
        cameras.setdefault(camera, []).append(pair)
    chosen = []
    for group in cameras.values():
        first = min(_rank(pair, raw) for pair in group)
        chosen += [pair for pair in group if _rank(pair, raw) == first]
    best = min(_rectification(pair.left, raw) for pair in chosen)
    of_best = [pair for pair in chosen if _rectification(pair.left, raw) == best]
    return sorted(of_best, key=lambda pair: natural_key(pair.left.name))
