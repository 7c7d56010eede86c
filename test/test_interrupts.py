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

"""SIGINT at any moment of a start: the program ends without a traceback, by the signal or as it says."""

import importlib.util
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from stereo_selfcal import __main__ as program
from stereo_selfcal.cli.console import run

ROOT = Path(__file__).resolve().parent.parent
NODE = ["node", "--ros-args", "-p", "output_path:=''"]
REPLAY = ["replay", str(ROOT / "bags" / "straight_road")]


def start(command, ignored=False):
    """Start a program that tells on stderr what it has imported: moments that no slow machine shifts."""
    wanted = signal.SIG_IGN if ignored else signal.default_int_handler
    before = signal.signal(signal.SIGINT, wanted)
    try:
        return subprocess.Popen(
            [sys.executable, "-X", "importtime", "-m", "stereo_selfcal", *command],
            cwd=ROOT,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )
    finally:
        signal.signal(signal.SIGINT, before)


def wait_for_import(process, module):
    for line in process.stderr:
        if line.rstrip().endswith(f" {module}"):
            return
    raise AssertionError(f"{module} was not imported")


MOMENTS = ["stereo_selfcal.unforeseen", "numpy", "cv2", "stereo_selfcal.core.camera.rig"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "module"),
    [(REPLAY, module) for module in MOMENTS]
    + [
        (NODE, module)
        for module in ("stereo_selfcal.unforeseen", "rclpy", "cv2", "stereo_selfcal.ros.selfcal")
    ],
)
def test_sigint_while_modules_are_imported_leaves_no_traceback(command, module):
    if command is NODE and importlib.util.find_spec("rclpy") is None:
        pytest.skip("the node needs ROS")
    with start(command) as process:
        wait_for_import(process, module)
        process.send_signal(signal.SIGINT)
        said = process.stderr.read()
        status = process.wait(timeout=60)
    assert "Traceback" not in said and "not foreseen" not in said, said
    assert status in (-signal.SIGINT, 128 + signal.SIGINT, *([0] if command is NODE else []))


@pytest.mark.slow
def test_sigint_that_is_ignored_stays_ignored():
    with start(["limits"], ignored=True) as process:
        wait_for_import(process, "stereo_selfcal.unforeseen")
        process.send_signal(signal.SIGINT)
        process.stderr.read()
        assert process.wait(timeout=60) == 0


def test_installed_programs_see_to_ctrl_c_before_their_module_is_imported(monkeypatch):
    seen = []
    monkeypatch.setattr(program, "end_at_once_by_ctrl_c", lambda: seen.append("ctrl-c"))
    monkeypatch.setattr(program, "main", lambda argv: seen.append(argv[0]) or 7)
    for name in program.COMMANDS:
        assert getattr(program, name)() == 7
    assert seen == [word for name in program.COMMANDS for word in ("ctrl-c", name)]


def test_the_program_of_pip_sees_to_ctrl_c_too(monkeypatch):
    seen = []
    monkeypatch.setattr(program, "end_at_once_by_ctrl_c", lambda: seen.append("ctrl-c"))
    monkeypatch.setattr(program, "main", lambda: seen.append("main") or 7)
    assert program.program() == 7
    assert seen == ["ctrl-c", "main"]


def test_an_error_that_a_signal_caused_is_told_as_the_signal(capsys):
    """Modules in C make a RuntimeError of the exception by which a signal is told."""

    def work(argv):
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt as error:
            raise RuntimeError("the module cannot be initialised") from error

    assert run("tool", work, []) == 130
    assert capsys.readouterr().err == "tool: interrupted\n"


def test_a_signal_inside_exec_gives_the_status_of_the_signal():
    """Python notes a plain KeyboardInterrupt there and ends by SIGINT, whatever the program returns."""
    code = (
        "import signal, sys; from stereo_selfcal.cli.console import run; "
        "signal.signal(signal.SIGINT, signal.default_int_handler); "
        "sys.exit(run('tool', lambda argv: exec('signal.raise_signal(15)'), []))"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (143, "tool: ended by SIGTERM\n")
