"""When the node listens to the cameras: while somebody wants images, and now and then to see that they come.

Receiving 60 images a second costs a sixth of a core, though nobody needs them most of the time. So the
subscriptions are dropped then, and made for a second or so every half minute: the diagnostics can say what
arrives. Who wants single images, again and again, has them taken for that moment only: the subscriptions
stay, as making them anew costs more than not taking what comes. Needs no ROS.
"""

from __future__ import annotations

# Whoever wants an image each second (a picture that is watched), or each two (the watch), must not subscribe
# anew each time.
LINGER_S = 2.5
# How long a look takes: long enough for a rate. Where images come and no pair, a slower camera is waited for.
LOOK_S = 1.0
LONG_LOOK_S = 3.0
# From the end of a look to the next one: a second of each half minute. Where something is wrong, somebody
# is working on it, and wants to see what comes of it.
PERIOD_S = 30.0
PERIOD_IN_TROUBLE_S = 10.0


class SubscriptionSchedule:
    """Decides when to be subscribed, and when to take what arrives; callers lock.

    At the start, and as long as nothing arrives at all, it listens: that costs nothing.
    """

    def __init__(self) -> None:
        self._wanted = False
        self._wanted_until_s = float("-inf")
        self._looking = False
        self._arrived_s: float | None = None
        self._paired = False
        self._next_look_s = float("-inf")
        self._publishers: tuple[int, ...] | None = None

    @property
    def wanted(self) -> bool:
        """Whether images are wanted just now."""
        return self._wanted

    @property
    def taking(self) -> bool:
        """Whether images are to be taken just now: they are wanted, or looked at."""
        return self._wanted or self._looking

    def want(self) -> None:
        """Images are wanted from now on."""
        self._begin()
        self._wanted = True

    def release(self, now_s: float) -> None:
        """They are not any more.

        Args:
            now_s: Steady time [s].
        """
        self._wanted = False
        self._wanted_until_s = now_s + LINGER_S
        if not self._paired:  # the camera may have stopped: that is looked at
            self._next_look_s = now_s

    def arrived(self, now_s: float, paired: bool) -> bool:
        """Take note of an image; return whether it is the first one since they are taken.

        Args:
            now_s: Steady time [s].
            paired: Whether it made a pair.
        """
        self._paired |= paired
        first = self._arrived_s is None
        if first:
            self._arrived_s = now_s
        return first

    def due(self, now_s: float, publishers: tuple[int, ...]) -> bool:
        """Return whether to be subscribed from now on.

        Args:
            now_s: Steady time [s].
            publishers: Publishers of the topics: a camera that comes or goes is looked at.
        """
        changed, self._publishers = publishers != self._publishers, publishers
        if self._looking and self._seen(now_s):
            self._looking = False
            self._next_look_s = now_s + (PERIOD_S if self._paired else PERIOD_IN_TROUBLE_S)
        if not self._looking and (changed or now_s >= self._next_look_s):
            self._begin()
            self._looking = True
        return self.taking or now_s < self._wanted_until_s

    def _begin(self) -> None:
        if not self.taking:
            self._arrived_s, self._paired = None, False

    def _seen(self, now_s: float) -> bool:
        """Return whether a look has taken long enough."""
        if self._arrived_s is None:
            return False
        return now_s - self._arrived_s >= (LOOK_S if self._paired else LONG_LOOK_S)
