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

"""Whether a file can be written is known before there is anything to write."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from stereo_selfcal.core.errors import OutputError
from stereo_selfcal.files.writable import check_writable

ROOT = Path(__file__).resolve().parents[2]


def test_file_in_a_folder_that_exists_is_writable_and_nothing_is_left(tmp_path):
    check_writable(tmp_path / "out.yaml")
    (tmp_path / "there.yaml").write_text("")
    check_writable(tmp_path / "there.yaml")
    (tmp_path / "link.yaml").symlink_to(tmp_path / "there.yaml")
    check_writable(tmp_path / "link.yaml")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["link.yaml", "there.yaml"]


@pytest.mark.parametrize(
    ("name", "words"),
    [
        (".", "not a file"),
        ("pipe", "not a file"),
        ("no/such/folder/out.yaml", "no such file or directory; choose a writable folder"),
        ("file/out.yaml", "not a directory"),
        (f"{'n' * 300}.yaml", "name too long"),
        (f"{'n/' * 3000}.yaml", "name too long"),
        ("a\0b", "null"),
        ("loop", "not a file"),
    ],
)
def test_what_cannot_be_written_is_said_with_its_cause(tmp_path, name, words):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "file").write_text("")
    (tmp_path / "loop").symlink_to("loop")
    with pytest.raises(OutputError, match="cannot be written: ") as error:
        check_writable(tmp_path / name)
    assert words in str(error.value)


def test_folder_without_the_right_to_write_is_said(tmp_path, monkeypatch):
    def refuse(**_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("tempfile.TemporaryFile", refuse)
    with pytest.raises(OutputError, match="permission denied; choose a writable folder"):
        check_writable(tmp_path / "out.yaml")


def test_missing_folders_are_no_hindrance_where_they_are_made(tmp_path):
    home = tmp_path / "home" / ".ros"
    check_writable(home / "front" / "out.yaml", made=home)
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(OutputError, match="no such file"):
        check_writable(tmp_path / "elsewhere" / "out.yaml", made=home)
    (tmp_path / "home").write_text("a file")
    with pytest.raises(OutputError, match="not a directory"):
        check_writable(home / "out.yaml", made=home)


@pytest.mark.parametrize("stream", ["stdout", "stderr"])
@pytest.mark.parametrize(
    ("to", "words"),
    [
        (subprocess.PIPE, "not a file; give the name of a file"),
        (None, "what this program prints goes there, and would be lost; give the name of another file"),
    ],
)
def test_streams_of_the_process_are_no_files_to_replace(tmp_path, stream, to, words):
    """Behind /dev/stdout is a pipe, or the file that the printed lines go to."""
    code = (
        "from stereo_selfcal.files import atomic_file, writable\n"
        "for check in (writable.check_writable, lambda path: atomic_file.write_atomically(path, b'new')):\n"
        f"    try: check('/dev/{stream}')\n"
        "    except Exception as error: open('said', 'a').write(f'{error}|')\n"
    )
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    with (tmp_path / "log").open("w") as log:
        streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, stream: to or log}
        run = subprocess.run(
            [sys.executable, "-c", code], cwd=tmp_path, env=environment, check=False, **streams
        )
    assert run.returncode == 0, run.stderr
    said = (tmp_path / "said").read_text().split("|")
    assert len(said) == 3 and all(words in each for each in said[:2])
    assert (tmp_path / "log").read_text() == ""
