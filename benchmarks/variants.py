"""Frames nobody has seen, made of recorded ones: mirrored, smaller, cut, in other light, with noise.

What was found for the frames as they are must hold for their variants: a threshold that fits single frames by
chance does not.
"""

from __future__ import annotations

import multiprocessing
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from stereo_selfcal import Calibrator
from stereo_selfcal.core.types import Image

from .frames import READABLE, Array
from .options import Options
from .recorded import BAG, FRAMES, STRAIGHT, WRONG, Recorded, recording_frames, single_frames
from .table import Table, numbers

PROCESSES = 2
_NOISE_GREY = 3.0  # three times that of the recorded frames
_WHITE = 255


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """What became of one variant of one frame.

    Attributes:
        variant: Name of the variant.
        name: Name of the frame.
        tag: Its tag.
        reason: Of the refusal; empty where it was accepted.
        error: Estimate minus reference (mm, deg, deg); empty when refused.
        std: Reported standard deviations of it.
        stage: The last one that ran.
    """

    variant: str
    name: str
    tag: str
    reason: str
    error: Array
    std: Array
    stage: str = ""

    @property
    def wrong(self) -> bool:
        """Whether it was accepted and is farther off than any result may be."""
        return not self.reason and bool(np.any(np.abs(self.error) > WRONG))


def as_it_is(frame: Recorded) -> Recorded:
    """Return the frame."""
    return frame


def mirrored(frame: Recorded) -> Recorded:
    """Flip both images and swap the cameras: the road rolls to the other side."""
    rig = replace(frame.rig, cx=frame.rig.width - 1 - frame.rig.cx)
    left, right = (np.ascontiguousarray(image[:, ::-1]) for image in (frame.right, frame.left))
    return replace(frame, rig=rig, left=left, right=right, reference=frame.reference * [1.0, 1.0, -1.0])


def scaled(frame: Recorded, scale: float) -> Recorded:
    """Make both images smaller, pixels averaged."""
    rig = frame.rig
    size = (round(rig.width * scale), round(rig.height * scale))
    by_column, by_row = size[0] / rig.width, size[1] / rig.height
    left, right = (cv2.resize(image, size, interpolation=cv2.INTER_AREA) for image in _images(frame))
    rig = replace(
        rig,
        width=size[0],
        height=size[1],
        fx=rig.fx * by_column,
        fy=rig.fy * by_row,
        cx=(rig.cx + 0.5) * by_column - 0.5,
        cy=(rig.cy + 0.5) * by_row - 0.5,
    )
    return replace(frame, rig=rig, left=_bytes(left), right=_bytes(right))


def cut(frame: Recorded, left: int = 0, right: int = 0, top: int = 0, bottom: int = 0) -> Recorded:
    """Cut columns and rows off both images."""
    rig = frame.rig
    kept = (slice(top, rig.height - bottom), slice(left, rig.width - right))
    smaller = replace(
        rig,
        width=rig.width - left - right,
        height=rig.height - top - bottom,
        cx=rig.cx - left,
        cy=rig.cy - top,
    )
    return replace(frame, rig=smaller, left=_bytes(frame.left[kept]), right=_bytes(frame.right[kept]))


def toned(frame: Recorded, gamma: float, gain: float = 1.0, right_gain: float = 1.0) -> Recorded:
    """Expose both images otherwise, the right one with a gain of its own, and clip what is too bright."""
    left, right = (_WHITE * gain * (image / _WHITE) ** gamma for image in _images(frame))
    return replace(frame, left=_bytes(left), right=_bytes(right * right_gain))


def noisy(frame: Recorded) -> Recorded:
    """Add noise, of its own to each image, the same in every run."""
    rng = np.random.default_rng(zlib.crc32(f"{frame.tag} {frame.name}".encode()))
    left, right = (image + rng.normal(0.0, _NOISE_GREY, image.shape) for image in _images(frame))
    return replace(frame, left=_bytes(left), right=_bytes(right))


VARIANTS: dict[str, Callable[[Recorded], Recorded]] = {
    "as it is": as_it_is,
    "mirrored": mirrored,
    "0.8 of its size": lambda frame: scaled(frame, 0.8),
    "0.6 of its size": lambda frame: scaled(frame, 0.6),
    "cut: 200 columns left, 40 rows above": lambda frame: cut(frame, left=200, top=40),
    "cut: 150 columns right, 30 rows below": lambda frame: cut(frame, right=150, bottom=30),
    "gamma 1.5, right 10 % darker": lambda frame: toned(frame, 1.5, right_gain=0.9),
    "gamma 0.7, a gain of 1.15": lambda frame: toned(frame, 0.7, 1.15),
    "noise of 3 grey levels": noisy,
    "mirrored, 0.7 of its size": lambda frame: scaled(mirrored(frame), 0.7),
}


def variant_tables(_: Options) -> Iterator[Table]:
    """Judge every variant of every frame; nothing where the recordings are not there."""
    if not (BAG.is_dir() and FRAMES.is_dir()):
        return
    context = multiprocessing.get_context("spawn")
    with context.Pool(PROCESSES, initializer=cv2.setNumThreads, initargs=(1,)) as pool:
        found = dict(zip(VARIANTS, pool.map(judge_variant, VARIANTS, chunksize=1), strict=True))
    yield _by_variant(found)
    yield _exceptions([judged for each in found.values() for judged in each])


def judge_variant(name: str) -> list[Judged]:
    """Calibrate one variant of all frames, and of the recording as a whole (last)."""
    judged = []
    for frame in map(VARIANTS[name], single_frames()):
        judged.append(_judge(name, frame, Calibrator(frame.rig)))
    recording = list(map(VARIANTS[name], recording_frames()))
    calibrator = Calibrator(recording[0].rig)
    judged += [_judge(name, frame, calibrator) for frame in recording]
    mean = np.mean([frame.reference for frame in recording], axis=0)
    fused = calibrator.estimate
    if fused.extrinsics is not None and fused.std is not None:
        error = fused.extrinsics.as_array() * READABLE - mean
        judged.append(Judged(name, "fused", "fused", "", error, fused.std.as_array() * READABLE))
    return judged


def _judge(variant: str, frame: Recorded, calibrator: Calibrator) -> Judged:
    result = calibrator.add(frame.left, frame.right)
    if result.extrinsics is None or result.std is None:
        return Judged(variant, frame.name, frame.tag, str(result.reason), np.array([]), np.array([]))
    error = result.extrinsics.as_array() * READABLE - frame.reference
    std = result.std.as_array() * READABLE
    return Judged(variant, frame.name, frame.tag, "", error, std, list(result.stages)[-1])


def _by_variant(found: dict[str, list[Judged]]) -> Table:
    limits = numbers(WRONG)
    table = Table(
        "variants",
        "Variants of the recorded frames: what is accepted, and how far it is off (mm, deg, deg)",
        [
            "variant",
            "straight ones",
            "median",
            "90 %",
            "error / std, RMS",
            "others",
            "recording",
            "fused",
            "wrong",
        ],
        f"Straight: tag `{STRAIGHT}`. Wrong: accepted, of any frame, and off by more than {limits}.",
    )
    for name, judged in found.items():
        table.add(name, *_summary(judged))
    table.add("all", *_summary([each for judged in found.values() for each in judged]))
    return table


def _summary(judged: list[Judged]) -> list[str]:
    straight = [each for each in judged if each.tag == STRAIGHT]
    recording = [each for each in judged if each.tag == "recording"]
    fused = [each for each in judged if each.tag == "fused"]
    others = [each for each in judged if each.tag not in (STRAIGHT, "recording", "fused")]
    accepted = [each for each in straight if not each.reason]
    errors = np.abs([each.error for each in accepted])
    ratio = errors / [each.std for each in accepted]
    return [
        _part(straight),
        numbers(np.median(errors, axis=0)),
        numbers(np.quantile(errors, 0.9, axis=0)),
        numbers(np.sqrt(np.mean(ratio**2, axis=0))),
        _part(others),
        _part(recording),
        numbers(np.max(np.abs([each.error for each in fused]), axis=0)),
        str(sum(each.wrong for each in judged)),
    ]


def _part(judged: list[Judged]) -> str:
    return f"{sum(not each.reason for each in judged)} of {len(judged)}"


def _exceptions(judged: list[Judged]) -> Table:
    table = Table(
        "variants_exceptions",
        "The wrong ones, and the straight ones that were refused",
        ["frame", "tag", "variant", "verdict", "error (mm, deg, deg)", "reported std", "stage"],
    )
    for each in judged:
        if each.wrong:
            table.add(
                each.name, each.tag, each.variant, "wrong", numbers(each.error), numbers(each.std), each.stage
            )
        elif each.tag == STRAIGHT and each.reason:
            table.add(each.name, each.tag, each.variant, each.reason, "-", "-", "-")
    return table


def _images(frame: Recorded) -> tuple[Image, Image]:
    return frame.left, frame.right


def _bytes(grey: npt.NDArray[Any]) -> Image:
    """Return grey values in whole levels, as a camera delivers them."""
    return np.ascontiguousarray(np.clip(np.rint(grey), 0, _WHITE).astype(np.uint8))
