"""Frames from bags."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from ..bags import BagError, Selection, StereoBag, StereoFrame
from ..core.camera.rectifier import StereoRectifier
from ..core.camera.rig import StereoRig
from .recording import FrameSource


class BagSource(FrameSource):
    """The stereo camera of one or several bags, which are one recording in the order of time.

    Args:
        paths: The bags, as :class:`~stereo_selfcal.bags.StereoBag` takes them.
        left: Image topic of the left camera, None to find it.
        right: Image topic of the right camera, None to find it.
        tolerance_s: Greatest difference of the header stamps of a pair [s]; 0 means equal stamps.
        rig: The rig, None for that of the CameraInfo topics.
        selection: Which frames are used, None for all.
        raw: Whether the images are raw: they are undistorted and rectified with their CameraInfo.

    Raises:
        BagError: A bag cannot be read, or there is no unambiguous stereo pair or no rig.
    """

    def __init__(
        self,
        paths: Sequence[Path],
        left: str | None = None,
        right: str | None = None,
        tolerance_s: float = 0.0,
        rig: StereoRig | None = None,
        selection: Selection | None = None,
        raw: bool = False,
    ) -> None:
        if raw and rig is not None:
            raise BagError(
                "a rig file describes rectified cameras: K, D, R and P of raw ones come from CameraInfo; "
                "leave out --rig or --raw"
            )
        self._bag = StereoBag(paths, left, right, tolerance_s, raw)
        try:
            topics = self._bag.topics
            self.name = " ".join(path.resolve().name for path in paths)
            self.left_name, self.right_name = topics.left.name, topics.right.name
            self.n_images = topics.left.count, topics.right.count
            self.start_ns = self._bag.start_ns
            self._rectifier = self._bag.read_rectifier(not raw) if rig is None else StereoRectifier(rig)
            self.rig = self._rectifier.rig
            self.selection = selection or Selection()
        except BaseException:
            self.close()
            raise

    @property
    def length_s(self) -> float:
        """Duration of the recording, from its first message to its last [s]."""
        return (self._bag.end_ns - self._bag.start_ns) * 1e-9

    @property
    def remarks(self) -> tuple[str, ...]:
        """Sentences about unusual values of the CameraInfo, and about images that are in no frame."""
        return (*(doubt.message for doubt in self._rectifier.doubts), *self._bag.remarks)

    def frames(self) -> Iterator[StereoFrame]:
        """Yield the selected frames in the order of the recording."""
        return map(self._rectified, self._bag.frames(self.selection))

    def frame_at(self, recorded_ns: int) -> StereoFrame:
        """Return one frame again."""
        return self._rectified(self._bag.frame_at(recorded_ns))

    def _rectified(self, frame: StereoFrame) -> StereoFrame:
        left, right = self._rectifier.apply(frame.left, frame.right)
        return replace(frame, left=left, right=right)

    def close(self) -> None:
        """Close the bags."""
        self._bag.close()
