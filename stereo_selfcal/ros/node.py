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

"""The ROS 2 node as a process: starts ROS, spins the executor, ends cleanly."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Sequence

import rclpy
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
from rclpy.utilities import remove_ros_args

from ..closed_streams import open_closed_streams, tell_error
from ..core.errors import ConfigError, SelfcalError, one_line, printable
from ..files.node_settings import NODE_NAME
from ..interrupts import ignore_ctrl_c_at_the_end
from ..unforeseen import unforeseen
from .arguments import RosParser
from .memory import spare_what_stays, use_one_heap
from .selfcal import SelfcalNode
from .shutdown import silent_after_shutdown

# For: parameter services, timers, odometry, a call of ~/calibrate that waits, and a second call, told "busy".
_THREADS = 5
# Pause between the last answer and the end of the services. Without it, Fast DDS crashed in 2 of some 440
# shutdowns, probably as the acknowledgement of the answer came late. With it, it crashed in none of 571.
_CALM_S = 0.2
_EXIT_BAD_USAGE = 2
_LOG_PERIOD_S = 5.0


class _Executor(MultiThreadedExecutor):  # type: ignore[misc]  # rclpy has no types
    """An executor whose callbacks can be waited for."""

    _sigint_gc = None  # __del__ of rclpy 7 asks for it, even where a signal came before it was made

    def finish(self) -> None:
        """Wait for the running callbacks, before the node is destroyed.

        ``shutdown()`` of rclpy 7 is meant to wait and does not. Nor does it ask for the errors of the
        callbacks that it did not wait for: each would be printed as "never retrieved" when it is forgotten.
        They all come from the shutdown.
        """
        pool = getattr(self, "_executor", None)
        if pool is not None:
            pool.shutdown(wait=True)
        for callback in getattr(self, "_futures", ()):
            callback.exception()


def _end_at_hangup() -> None:
    """Let SIGHUP, which a terminal that closes sends, end the node as SIGTERM does.

    rclpy handles SIGINT and SIGTERM only, and a handler of Python's own would run no earlier than a wait in C
    ends. With ``nohup``, the signal stays ignored. To be called before there are other threads, as they
    inherit the mask.
    """
    if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
        return
    hangup = {signal.SIGHUP}
    signal.pthread_sigmask(signal.SIG_BLOCK, hangup)

    def wait() -> None:
        signal.sigwait(hangup)
        os.kill(os.getpid(), signal.SIGTERM)

    threading.Thread(target=wait, name="hangup", daemon=True).start()


def _spin(executor: MultiThreadedExecutor) -> None:
    """Run callbacks until the context is shut down (Ctrl-C, SIGTERM, SIGHUP)."""
    while executor.context.ok():
        try:
            executor.spin_once()
        except (KeyboardInterrupt, ExternalShutdownException):
            return
        except Exception:  # noqa: BLE001 - one bad request (a parameter of unknown type) must not end the node
            if executor.context.ok():
                for node in executor.get_nodes():
                    node.get_logger().error(
                        f"a callback failed:\n{traceback.format_exc()}",
                        throttle_duration_sec=_LOG_PERIOD_S,  # bad requests may come at any rate
                    )


def _serve(selfcal: SelfcalNode) -> None:
    """Run the node until its context is shut down, and take it apart."""
    executor = None
    try:
        with silent_after_shutdown(selfcal.node.context):  # a signal may come before there is an executor
            executor = _Executor(_THREADS)
            executor.add_node(selfcal.node)
            _spin(executor)
    finally:
        selfcal.stop()
        if executor is not None:
            executor.finish()
            time.sleep(_CALM_S)
            executor.shutdown()
        selfcal.node.destroy_node()


def _run(arguments: list[str]) -> None:
    """Start ROS and run the node until it is told to end."""
    use_one_heap()
    _end_at_hangup()
    try:
        rclpy.init(args=arguments)
    except RuntimeError as error:
        raise ConfigError(f"ROS does not start: {one_line(error)}") from error
    try:
        try:
            selfcal = SelfcalNode()
        except Exception:
            if not rclpy.ok():  # a signal ended ROS meanwhile, and everything failed
                return
            raise
        spare_what_stays()
        _serve(selfcal)
    finally:
        rclpy.try_shutdown()
        ignore_ctrl_c_at_the_end()  # rclpy has put back what was before its own handlers


def _without_ros_arguments(arguments: list[str]) -> list[str]:
    try:
        return list(remove_ros_args(arguments))
    except RuntimeError as error:  # base class of those of rcl
        raise ConfigError(f"wrong ROS arguments: {one_line(error)}") from error


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until Ctrl-C, SIGTERM or SIGHUP.

    Args:
        args: Arguments without the program name, None for those of the process.

    Returns:
        Exit status: 0 after Ctrl-C, SIGTERM or SIGHUP, 2 after a wrong argument or parameter, 3 after what
        was not foreseen.
    """
    open_closed_streams()
    arguments = list(sys.argv[1:] if args is None else args)
    parser = RosParser(
        prog="node",
        description="Calibrate a stereo camera on request: subscribes to left and right image_rect and "
        "their camera_info, answers ~/calibrate. Parameters, remappings: --ros-args -p NAME:=VALUE -r A:=B.",
        epilog="exit status: 0 ended by Ctrl-C, SIGTERM or SIGHUP; 2 wrong arguments or parameters; 3 "
        "something unforeseen, with a traceback",
    )
    try:
        parser.parse_args(_without_ros_arguments(arguments))
        _run(arguments)
    except KeyboardInterrupt:
        pass
    except SelfcalError as error:
        tell_error(f"{NODE_NAME}: {printable(str(error))}\n")
        return _EXIT_BAD_USAGE
    except Exception as error:  # noqa: BLE001 - whatever it is, it is told with its traceback and a status
        return unforeseen(NODE_NAME, error)
    return 0


if __name__ == "__main__":
    sys.exit(main())
