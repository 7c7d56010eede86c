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

"""What the command line tools share."""

import io
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from stereo_selfcal.cli.console import Progress, UsageError, check_writable, run, without_ros_args

ROOT = Path(__file__).resolve().parent.parent.parent


@pytest.mark.parametrize(
    ("given", "kept"),
    [
        (["bag", "--json"], ["bag", "--json"]),
        (["bag", "--ros-args", "-r", "a:=b"], ["bag"]),
        (["--ros-args", "-p", "x:=1", "--", "bag"], ["bag"]),
        (["--ros-args", "--", "a", "--ros-args", "-r", "x:=y"], ["a"]),
        (["--", "-bag"], ["--", "-bag"]),
        ([], []),
    ],
)
def test_ros_arguments(given, kept):
    assert without_ros_args(given) == kept


def raising(error):
    def work(argv):
        raise error

    return work


@pytest.mark.parametrize(
    ("error", "status", "line"),
    [
        (UsageError("what\nand why"), 2, "tool: what and why\n"),
        (FileNotFoundError(2, "No such file", "x"), 2, "tool: [Errno 2] No such file: 'x'\n"),
        (KeyboardInterrupt(), 130, "tool: interrupted\n"),
        (SystemExit(0), 0, ""),
    ],
)
def test_failures_become_a_line_and_a_status(error, status, line, capsys):
    assert run("tool", raising(error), []) == status
    assert capsys.readouterr() == ("", line)


def test_what_was_not_foreseen_is_told_with_its_traceback_and_status_3(capsys):
    try:
        raise KeyError("the cause\x1b[2J")
    except KeyError as error:
        unknown = ZeroDivisionError("by\nnothing")
        unknown.__cause__ = error
    assert run("tool", raising(unknown), []) == 3
    out, err = capsys.readouterr()
    lines = err.splitlines()
    assert out == "" and lines[0] == "Traceback (most recent call last):"
    assert "KeyError: 'the cause\\x1b[2J'" in lines and lines[-2] == "ZeroDivisionError: by\\nnothing"
    assert re.fullmatch(r"tool: this was not foreseen \(ZeroDivisionError\).* please report .*", lines[-1])


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_progress_bar_on_a_terminal_only():
    terminal, pipe = Terminal(), io.StringIO()
    for stream in (terminal, pipe):
        progress = Progress(4, stream)
        for done in (0, 2, 4, 5):
            progress.show(done)
        progress.clear()
    assert pipe.getvalue() == ""
    assert "[###############...............] 2/4" in terminal.getvalue()
    assert terminal.getvalue().endswith("\r\x1b[K")
    assert "\n" not in terminal.getvalue()
    Progress(0, Terminal()).show(0)


def test_progress_without_a_total_counts():
    terminal = Terminal()
    progress = Progress(None, terminal)
    progress.show(7)
    assert terminal.getvalue() == "\r7 \x1b[K"
    progress.clear()
    assert terminal.getvalue().endswith("\r\x1b[K")


def test_check_writable_leaves_no_trace(tmp_path):
    check_writable(tmp_path / "new.yaml", "--output")
    assert not list(tmp_path.iterdir())
    (tmp_path / "link").symlink_to(tmp_path / "folder-that-is-not" / "x")
    for path in (tmp_path, tmp_path / "link", Path(os.devnull), tmp_path / "a" / "b"):
        with pytest.raises(UsageError, match="--output"):
            check_writable(path, "--output")


# A shell starts its background jobs with SIGINT ignored, and nohup with SIGHUP: this run may be one of them.
PROGRAM = """
import signal, sys, time
from stereo_selfcal.cli.console import run
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.{hangup})
def work(argv):
    sys.stdout.write("begun\\n")
    sys.stdout.flush()
    {rest}
    return 0
sys.exit(run("tool", work, []))
"""


def start(rest):
    return subprocess.Popen(
        [sys.executable, "-c", PROGRAM.format(rest=rest, hangup="SIG_DFL")],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def test_ctrl_c_is_quiet():
    with start("time.sleep(60)") as process:
        assert process.stdout.readline() == "begun\n"
        time.sleep(0.1)
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=20)
    assert (process.returncode, err) == (130, "tool: interrupted\n")


@pytest.mark.parametrize(
    ("how", "line"),
    [(signal.SIGHUP, "ended, as the terminal is gone (SIGHUP)"), (signal.SIGTERM, "ended by SIGTERM")],
)
def test_sighup_and_sigterm_end_it_cleanly_and_take_temporary_files_away(tmp_path, how, line):
    rest = f"""
    import os, tempfile
    from stereo_selfcal.files import atomic_file
    os.fsync = lambda _: (sys.stdout.write("writing\\n"), sys.stdout.flush(), time.sleep(60))
    with tempfile.TemporaryDirectory(dir={str(tmp_path)!r}):
        atomic_file.write_atomically({str(tmp_path / "out.yaml")!r}, b"new")"""
    with start(rest) as process:
        assert process.stdout.readline() == "begun\n" and process.stdout.readline() == "writing\n"
        assert len(list(tmp_path.iterdir())) == 2
        process.send_signal(how)
        _, err = process.communicate(timeout=20)
    assert (process.returncode, err) == (128 + how, f"tool: {line}\n")
    assert list(tmp_path.iterdir()) == []


def test_what_nohup_ignores_stays_ignored():
    rest = "sys.stdin.read()"
    program = PROGRAM.format(rest=rest, hangup="SIG_IGN")
    with subprocess.Popen(
        [sys.executable, "-c", program], cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout.readline() == "begun\n"
        process.send_signal(signal.SIGHUP)
        process.stdin.close()
        assert process.wait(timeout=20) == 0


def test_a_terminal_that_is_gone_does_not_change_the_status():
    leader, follower = os.openpty()
    with subprocess.Popen(
        [sys.executable, "-c", PROGRAM.format(rest="time.sleep(60)", hangup="SIG_DFL")],
        cwd=ROOT,
        stdin=follower,
        stdout=follower,
        stderr=follower,
        start_new_session=True,
    ) as process:
        os.close(follower)
        assert os.read(leader, 100).startswith(b"begun")
        os.close(leader)
        process.send_signal(signal.SIGHUP)
        assert process.wait(timeout=20) == 129


def test_handlers_of_a_caller_are_put_back():
    before = signal.getsignal(signal.SIGTERM)
    assert run("tool", lambda argv: int(signal.getsignal(signal.SIGTERM) is before), []) == 0
    assert signal.getsignal(signal.SIGTERM) is before


@pytest.mark.parametrize("name", ["n" * 300, "a\0b"])
def test_a_name_that_no_file_can_have_is_refused_before_the_work(tmp_path, name):
    with pytest.raises(UsageError, match=r"--report .*cannot be written"):
        check_writable(tmp_path / name, "--report")


def test_a_full_disk_is_told_as_one(tmp_path, monkeypatch):
    def full(**_options):
        raise OSError(28, os.strerror(28))

    monkeypatch.setattr("tempfile.TemporaryFile", full)
    with pytest.raises(UsageError, match=r"no space left on device.*; make room, or"):
        check_writable(tmp_path / "out.html", "--report")


@pytest.mark.parametrize("flush", ["sys.stdout.flush()", ""])
def test_closed_pipe_is_quiet(flush):
    with subprocess.Popen(
        [
            sys.executable,
            "-c",
            PROGRAM.format(rest=f"sys.stdin.read(); sys.stdout.write('x' * 100); {flush}", hangup="SIG_DFL"),
        ],
        cwd=ROOT,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout.readline() == "begun\n"
        process.stdout.close()
        process.stdin.close()
        assert process.stderr.read() == ""
        assert process.wait(timeout=20) == 141
