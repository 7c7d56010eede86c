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

"""When the node subscribes to the images: while they are wanted, and for a short probe now and then.

Receiving 60 images a second costs a sixth of a core, and most of the time nobody needs them. The node
therefore drops the subscriptions when no image is wanted. Every half minute it subscribes again for about a
second, so that the diagnostics can say what arrives. This is called a probe.

The watch and the pictures want single images again and again. The subscriptions stay between two of them, as
making them anew costs more than leaving the images in between untaken. Needs no ROS.
"""

from __future__ import annotations

# The subscriptions stay for this time after the last wish. It bridges the pauses of a picture that is watched
# (one image a second) and of the watch (one image every two seconds).
LINGER_S = 2.5
# Length of a probe: long enough to measure a rate. It is longer while images come but no pair, as a slow
# camera may need more time.
PROBE_S = 1.0
PROBE_WITHOUT_PAIR_S = 3.0
# From the end of a probe to the beginning of the next. It is shorter while no pair comes, because somebody is
# probably working on the cameras and wants to see the effect.
PROBE_PERIOD_S = 30.0
PROBE_PERIOD_WITHOUT_PAIR_S = 10.0


class SubscriptionSchedule:
    """Decides when to be subscribed and when to take images. Not thread-safe: callers lock.

    The first probe lasts until an image arrives: a subscription without messages costs nothing.
    """

    def __init__(self) -> None:
        self._wanted = False
        self._linger_until_s = float("-inf")
        self._probing = False
        self._first_image_s: float | None = None
        self._paired = False
        self._next_probe_s = float("-inf")
        self._publishers: tuple[int, ...] | None = None

    @property
    def wanted(self) -> bool:
        """Whether somebody wants images now."""
        return self._wanted

    @property
    def taking(self) -> bool:
        """Whether images are to be taken now: somebody wants them, or a probe is running."""
        return self._wanted or self._probing

    def want(self) -> None:
        """Note that somebody wants images from now on."""
        self._forget_images_unless_taking()
        self._wanted = True

    def release(self, now_s: float) -> None:
        """Note that nobody wants images any more.

        Args:
            now_s: Steady time [s].
        """
        self._wanted = False
        self._linger_until_s = now_s + LINGER_S
        if not self._paired:  # the camera may have stopped: a probe will tell
            self._next_probe_s = now_s

    def image_arrived(self, now_s: float, paired: bool) -> bool:
        """Note an image. Return whether it is the first since images are taken.

        Args:
            now_s: Steady time [s].
            paired: Whether it made a pair.
        """
        self._paired |= paired
        first = self._first_image_s is None
        if first:
            self._first_image_s = now_s
        return first

    def update(self, now_s: float, publishers: tuple[int, ...]) -> bool:
        """End a probe that is over, begin one that is due, and return whether to be subscribed.

        Args:
            now_s: Steady time [s].
            publishers: Number of publishers of each topic. A change begins a probe.
        """
        changed, self._publishers = publishers != self._publishers, publishers
        if self._probing and self._probe_is_over(now_s):
            self._probing = False
            self._next_probe_s = now_s + (PROBE_PERIOD_S if self._paired else PROBE_PERIOD_WITHOUT_PAIR_S)
        if not self._probing and (changed or now_s >= self._next_probe_s):
            self._forget_images_unless_taking()
            self._probing = True
        return self.taking or now_s < self._linger_until_s

    def _forget_images_unless_taking(self) -> None:
        if not self.taking:
            self._first_image_s, self._paired = None, False

    def _probe_is_over(self, now_s: float) -> bool:
        if self._first_image_s is None:
            return False
        return now_s - self._first_image_s >= (PROBE_S if self._paired else PROBE_WITHOUT_PAIR_S)
