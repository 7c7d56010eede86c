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

"""python -m stereo_selfcal: which program runs, and what is imported for it."""

import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from bag_making import cameras, make_bag

from stereo_selfcal import __main__ as program
from stereo_selfcal import __version__

ROOT = Path(__file__).resolve().parent.parent


@pytest.mark.parametrize("name", ["node", "replay", "fleet", "history", "synth", "limits", "demo"])
def test_command_gets_the_rest_of_the_line(name, monkeypatch):
    seen = []

    def load(module):
        return SimpleNamespace(main=lambda argv: seen.append((module, argv)) or 7)

    monkeypatch.setattr(program, "import_module", load)
    assert program.main([name, "--help", "x"]) == 7
    assert seen == [(program.COMMANDS[name][0], ["--help", "x"])]


@pytest.mark.parametrize("arguments", [["--help"], ["-h"]])
def test_help_names_every_command(arguments, capsys):
    assert program.main(arguments) == 0
    out = capsys.readouterr().out
    assert all(name in out for name in program.COMMANDS)


@pytest.mark.parametrize(("arguments", "message"), [([], "no command"), (["fly"], "unknown command 'fly'")])
def test_wrong_command(arguments, message, capsys):
    assert program.main(arguments) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert message in err


def test_missing_ros_is_said_in_one_line(monkeypatch, capsys):
    def load(module):
        raise ModuleNotFoundError("No module named 'rclpy'", name="rclpy")

    monkeypatch.setattr(program, "import_module", load)
    assert program.main(["node"]) == 2
    assert "node needs the Python module rclpy" in capsys.readouterr().err


def test_missing_rosbags_is_said_with_the_line_that_installs_it(monkeypatch, capsys):
    def load(module):
        raise ModuleNotFoundError("No module named 'rosbags'", name="rosbags.highlevel")

    monkeypatch.setattr(program, "import_module", load)
    assert program.main(["replay"]) == 2
    err = capsys.readouterr().err
    assert "replay needs the Python module rosbags.highlevel" in err
    assert "pip install --break-system-packages rosbags" in err


def test_version_is_said(capsys):
    assert program.main(["--version"]) == 0
    assert capsys.readouterr().out == f"stereo_selfcal {__version__}\n"


@pytest.mark.parametrize(("called", "usage"), [("bin/stereo_selfcal", "stereo_selfcal"), ("x", "python -m")])
def test_help_calls_the_program_by_the_name_it_was_called_by(called, usage, monkeypatch):
    monkeypatch.setattr("sys.argv", [called])
    assert program.usage().startswith(f"usage: {usage} ")


@pytest.mark.parametrize("name", ["replay", "fleet", "history", "synth", "limits"])
def test_offline_programs_import_no_ros(name):
    code = (
        f"import sys; from stereo_selfcal.__main__ import main; main([{name!r}, '--help']);"
        "assert 'rclpy' not in sys.modules and 'sensor_msgs' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True, capture_output=True)


def test_a_module_that_cannot_be_imported_is_told_with_status_3(monkeypatch, capsys):
    def load(module):
        raise ImportError("libGL.so.1: cannot open shared object file")

    monkeypatch.setattr(program, "import_module", load)
    assert program.main(["replay"]) == 3
    err = capsys.readouterr().err
    assert "Traceback" in err and "ImportError: libGL.so.1" in err and "please report" in err


# What the package imports, but for what Python itself has imported before it comes to the package.
SHADOWS = (
    *("apsw", "argparse", "base64", "csv", "cv2", "dataclasses", "fcntl", "heapq", "jinja2", "json", "lz4"),
    *("multiprocessing", "numpy", "pickle", "platform", "queue", "random", "rosbags", "secrets", "selectors"),
    *("shlex", "socket", "statistics", "struct", "subprocess", "tempfile", "typing", "yaml", "zstandard"),
)


@pytest.mark.slow
@pytest.mark.skipif(sys.version_info < (3, 11), reason="Python 3.10 has no safe path for worker processes")
def test_no_module_is_taken_from_the_current_folder_by_the_program_or_its_workers(tmp_path):
    bag = make_bag(tmp_path / "bag", cameras(), n_frames=30)
    work = tmp_path / "work"
    work.mkdir()
    for name in SHADOWS:
        (work / f"{name}.py").write_text(f"open({str(tmp_path / 'taken')!r}, 'a').write('{name} ')")
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    for module in ("stereo_selfcal", "-mstereo_selfcal"):
        option = ["-m"] if module[0] != "-" else []
        command = [sys.executable, *option, module, "replay", str(bag), "--jobs", "2", "--report", "out.html"]
        run = subprocess.run(command, cwd=work, env=environment, capture_output=True, text=True, check=False)
        assert run.returncode == 1, run.stderr
        assert not (tmp_path / "taken").exists(), (tmp_path / "taken").read_text()


def test_the_package_is_found_in_the_current_folder_all_the_same():
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    command = [sys.executable, "-m", "stereo_selfcal", "--help"]
    subprocess.run(command, cwd=ROOT, env=environment, check=True, capture_output=True)


@pytest.mark.parametrize("name", ["replay", "fleet", "history", "synth", "limits"])
def test_help_says_every_exit_status(name):
    run = subprocess.run(
        [sys.executable, "-m", "stereo_selfcal", name, "--help"],
        cwd=ROOT,
        check=True,
        capture_output=True,
        text=True,
    )
    assert "exit status: 0 " in run.stdout and "3 something unforeseen, with a traceback" in run.stdout
