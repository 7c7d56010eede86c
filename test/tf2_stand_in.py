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

"""tf2_ros and tf2_msgs as the node uses them, where neither is installed; and what others send."""

import sys
from types import SimpleNamespace

from geometry_msgs.msg import TransformStamped
from rclpy.node import Node


class TFMessage:
    """In the place of tf2_msgs.msg.TFMessage."""

    def __init__(self, transforms=()):
        self.transforms = list(transforms)


def joint(parent, child, x_m=0.0):
    """Return a transform as another node would send it."""
    message = TransformStamped(child_frame_id=child)
    message.header.frame_id = parent
    message.transform.translation.x = x_m
    return message


class StandInTf2:
    """Keeps what the node sends, and hands it what others send.

    Attributes:
        made: The broadcasters that were made.
        sent: What they sent, a list of transforms each time.
        listeners: Callback by topic, while the node listens.
        others: (topic, transform) that others send; what is latched comes to every new listener.
    """

    def __init__(self, monkeypatch):
        self.made, self.sent, self.listeners, self.others = [], [], {}, []
        tf2 = self

        class StaticTransformBroadcaster:
            def __init__(self, node):
                tf2.made.append(node)

            def sendTransform(self, transforms):  # noqa: N802 - the name is tf2's
                tf2.sent.append(transforms)

        ros = SimpleNamespace(StaticTransformBroadcaster=StaticTransformBroadcaster)
        monkeypatch.setitem(sys.modules, "tf2_ros", ros)
        messages = SimpleNamespace(TFMessage=TFMessage)
        monkeypatch.setitem(sys.modules, "tf2_msgs", SimpleNamespace(msg=messages))
        monkeypatch.setitem(sys.modules, "tf2_msgs.msg", messages)
        create, destroy = Node.create_subscription, Node.destroy_subscription

        def create_subscription(node, kind, topic, callback, *args, **kwargs):
            if kind is not TFMessage:
                return create(node, kind, topic, callback, *args, **kwargs)
            self.listeners[topic] = callback
            return topic

        def destroy_subscription(node, subscription):
            if isinstance(subscription, str):
                return self.listeners.pop(subscription) is not None
            return destroy(node, subscription)

        monkeypatch.setattr(Node, "create_subscription", create_subscription)
        monkeypatch.setattr(Node, "destroy_subscription", destroy_subscription)

    def listened(self, node):
        """Let the node hear a whole burst: what others send, and what it has sent itself."""
        tree = next(timer.callback for timer in node.timers if timer.callback.__name__ == "tick")
        for _ in range(100):
            if self.listeners:
                break
            tree()
        for topic, transform in (
            *self.others,
            *(("/tf_static", each) for sent in self.sent for each in sent),
        ):
            self.listeners[topic](TFMessage([transform]))
        for _ in range(100):
            if not self.listeners:
                return
            tree()
        raise AssertionError("the burst does not end")
