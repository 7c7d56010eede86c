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

"""From the light that falls on a pixel to the grey value that is stored."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from .cameras import Array, Array32

Image = npt.NDArray[np.uint8]
_FULL = 255.0


@dataclass(frozen=True)
class Sensor:
    """What the cameras do to their images.

    Attributes:
        gain: Grey levels per unit of light, left and right.
        gamma: Exponent of the tone curve.
        noise: Standard deviation of the noise that is the same everywhere [grey levels].
        shot: Variance of the noise that grows with the light [grey levels].
        blur_px: Standard deviation of the blur.
        vignette: Share of the light that the corners lose.
        bayer: Whether a colour pattern was interpolated.
        jpeg: Quality of a JPEG compression, 0: there was none.
        step: Grey levels per stored level.
        shake_px: Amplitude by which a rolling shutter moves the rows of a shaking camera.
        shake_periods: Vibrations while one image is read.
        shake_phase_rad: Phase of the vibration.
        black: Grey value of no light.
    """

    gain: tuple[float, float] = (255.0, 255.0)
    gamma: float = 1.0
    noise: float = 1.0
    shot: float = 0.0
    blur_px: float = 0.5
    vignette: float = 0.0
    bayer: bool = False
    jpeg: int = 0
    step: int = 1
    shake_px: float = 0.0
    shake_periods: float = 1.0
    shake_phase_rad: float = 0.0
    black: float = 0.0

    def row_shift_px(self, rows: int) -> Array:
        """Return what the vibration adds to each row."""
        phase = 2 * np.pi * self.shake_periods * np.arange(rows) / rows + self.shake_phase_rad
        shift: Array = self.shake_px * np.sin(phase)
        return shift

    def develop(self, light: Array32, warmth: Array32 | None, right: bool, rng: np.random.Generator) -> Image:
        """Return the stored image.

        Args:
            light: Light on each pixel, shape (rows, cols).
            warmth: Colour of each pixel times its light, needed with a colour pattern only.
            right: Whether this is the right camera.
            rng: Source of the noise.
        """
        light = light * np.float32(self.gain[right])
        if warmth is not None:
            warmth = warmth * np.float32(self.gain[right])
        if self.blur_px > 0:
            light = cv2.GaussianBlur(light, (0, 0), self.blur_px).astype(np.float32)
        if self.vignette:
            light = light * self._vignette(light.shape)
        if self.bayer and warmth is not None:
            colours = np.stack([light + 0.25 * warmth, light, light - 0.35 * warmth], axis=-1)
            return self._compressed(_interpolated(self._counted(_pattern(colours), rng)))
        return self._compressed(self._counted(light, rng))

    def _vignette(self, shape: tuple[int, ...]) -> Array32:
        y = np.linspace(-1, 1, shape[0], dtype=np.float32)[:, None]
        x = np.linspace(-1, 1, shape[1], dtype=np.float32)[None]
        fall: Array32 = 1 - np.float32(self.vignette) * (x * x + y * y) / 2
        return fall

    def _counted(self, light: Array32, rng: np.random.Generator) -> Image:
        """Return grey values: tone curve, noise, quantisation."""
        grey = np.clip(light, 0, None)
        if self.gamma != 1:
            grey = np.float32(_FULL) * (grey / np.float32(_FULL)) ** np.float32(self.gamma)
        spread = np.float32(self.noise) if not self.shot else np.sqrt(self.noise**2 + self.shot * grey)
        noisy = grey + spread * rng.standard_normal(grey.shape, dtype=np.float32) + np.float32(self.black)
        stored = np.round(noisy / self.step) * self.step if self.step > 1 else np.round(noisy)
        image: Image = np.clip(stored, 0, _FULL).astype(np.uint8)
        return image

    def _compressed(self, image: Image) -> Image:
        if not self.jpeg:
            return image
        done, code = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, self.jpeg])
        if not done:
            raise RuntimeError("the image could not be compressed")
        decoded = cv2.imdecode(code, cv2.IMREAD_GRAYSCALE)
        return np.ascontiguousarray(decoded, dtype=np.uint8)


def _pattern(colours: Array32) -> Array32:
    """Return one colour per pixel: red and green in even rows, green and blue in odd ones."""
    raw: Array32 = colours[..., 1].copy()
    raw[0::2, 0::2] = colours[0::2, 0::2, 0]
    raw[1::2, 1::2] = colours[1::2, 1::2, 2]
    return raw


def _interpolated(raw: Image) -> Image:
    """Return the grey image of a colour pattern, as a camera's driver makes it."""
    # OpenCV names the pattern by the second row's second and third pixel: this one is called BG.
    colour = cv2.cvtColor(raw, cv2.COLOR_BayerBG2BGR)
    return np.ascontiguousarray(cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
