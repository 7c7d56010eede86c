"""python -m stereo_selfcal: which program runs, and what is imported for it."""

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from stereo_selfcal import __main__ as program

ROOT = Path(__file__).resolve().parent.parent


@pytest.mark.parametrize("name", ["node", "replay", "fleet", "synth", "limits", "demo"])
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


@pytest.mark.parametrize("name", ["replay", "fleet", "synth", "limits"])
def test_offline_programs_import_no_ros(name):
    code = (
        f"import sys; from stereo_selfcal.__main__ import main; main([{name!r}, '--help']);"
        "assert 'rclpy' not in sys.modules and 'sensor_msgs' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True, capture_output=True)
