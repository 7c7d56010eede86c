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

"""Files are whole or not there, nothing is left beside them, and nothing is lost that was to be kept."""

import fcntl
import os
import stat
import subprocess
import sys
import threading

import pytest

from stereo_selfcal.core.errors import OutputError, printable
from stereo_selfcal.files import atomic_file
from stereo_selfcal.files.atomic_file import remove_leftovers, set_aside, write_atomically

LEFTOVER = ".stereo_selfcal.0123456789abcdef.tmp"


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_file_replaces_the_old_one_and_leaves_nothing_beside_it(tmp_path):
    path = tmp_path / "out.yaml"
    path.write_text("old")
    write_atomically(path, b"new")
    assert path.read_bytes() == b"new"
    assert names(tmp_path) == ["out.yaml"]


def test_file_has_the_rights_of_any_new_file(tmp_path):
    mask = os.umask(0o022)
    try:
        write_atomically(tmp_path / "out.yaml", b"new")
    finally:
        os.umask(mask)
    assert stat.S_IMODE((tmp_path / "out.yaml").stat().st_mode) == 0o644


def test_link_is_followed(tmp_path):
    (tmp_path / "real").mkdir()
    link = tmp_path / "link.yaml"
    link.symlink_to(tmp_path / "real" / "out.yaml")
    write_atomically(link, b"new")
    assert link.is_symlink()
    assert (tmp_path / "real" / "out.yaml").read_bytes() == b"new"


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda folder: folder / "missing" / "out.yaml", "no such file or directory"),
        (lambda folder: folder, "is not a file"),
        (lambda folder: folder / ("n" * 300), "name too long; choose a shorter name"),
        (lambda folder: folder / "a\0b", "null"),
        (lambda _: "/proc/out.yaml", "cannot be written"),
        (lambda _: "/dev/null", "is not a file"),
    ],
)
def test_unwritable_path_is_named_with_the_remedy(tmp_path, make, words):
    path = make(tmp_path)
    with pytest.raises(OutputError) as error:
        write_atomically(path, b"new")
    assert printable(str(path)) in str(error.value) and words in str(error.value)
    assert names(tmp_path) == []


@pytest.mark.parametrize("call", ["os.write", "os.fsync", "pathlib.Path.replace"])
@pytest.mark.parametrize(("number", "words"), [(28, "no space left"), (122, "quota exceeded")])
def test_full_disk_leaves_the_old_file_and_no_other(tmp_path, monkeypatch, call, number, words):
    def fail(*_args):
        raise OSError(number, os.strerror(number))

    path = tmp_path / "out.yaml"
    path.write_text("old")
    monkeypatch.setattr(call, fail)
    with pytest.raises(OutputError, match=rf"out\.yaml cannot be written: .*{words}.*; make room, or"):
        write_atomically(path, b"new")
    assert path.read_text() == "old"
    assert names(tmp_path) == ["out.yaml"]


def test_disk_that_takes_only_a_part_is_full(tmp_path):
    """The kernel itself ends the file in the middle of the content."""
    path = tmp_path / "out.yaml"
    path.write_text("old")
    code = (
        "import resource, sys\n"
        "from stereo_selfcal.files.atomic_file import write_atomically\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))\n"
        "write_atomically(sys.argv[1], bytes(5000))\n"
    )
    run = subprocess.run([sys.executable, "-c", code, str(path)], capture_output=True, text=True, check=False)
    assert "OutputError" in run.stderr and "file too large; make room" in run.stderr
    assert path.read_text() == "old"
    assert names(tmp_path) == ["out.yaml"]


def test_read_only_folder_is_reported(tmp_path, monkeypatch):
    """By the answer of the system: rights alone would not stop root."""
    opened = os.open

    def refuse(path, flags, *args, **kwargs):
        if flags & os.O_CREAT and str(path).startswith(str(tmp_path)):
            raise OSError(30, os.strerror(30))
        return opened(path, flags, *args, **kwargs)

    path = tmp_path / "out.yaml"
    path.write_text("old")
    monkeypatch.setattr(os, "open", refuse)
    with pytest.raises(OutputError, match="read-only file system; choose a writable folder"):
        write_atomically(path, b"new")
    with pytest.raises(OutputError, match="cannot be kept aside: read-only file system; move it away"):
        set_aside(path)
    assert path.read_text() == "old"
    assert names(tmp_path) == ["out.yaml"]


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_folder_without_the_right_to_write(tmp_path):
    path = tmp_path / "out.yaml"
    path.write_text("old")
    tmp_path.chmod(0o500)
    try:
        with pytest.raises(OutputError, match="permission denied"):
            write_atomically(path, b"new")
    finally:
        tmp_path.chmod(0o700)
    assert path.read_text() == "old"


@pytest.mark.parametrize(
    ("change", "steps"),
    [
        (lambda path: write_atomically(path, b"new"), ["file", "rename", "folder"]),
        (set_aside, ["rename", "folder"]),
    ],
)
def test_file_is_synced_before_and_its_folder_after_the_rename(tmp_path, monkeypatch, change, steps):
    done = []
    sync, replace = os.fsync, type(tmp_path).replace
    monkeypatch.setattr(
        os,
        "fsync",
        lambda fd: done.append("folder" if stat.S_ISDIR(os.fstat(fd).st_mode) else "file") or sync(fd),
    )
    monkeypatch.setattr(
        type(tmp_path), "replace", lambda self, to: done.append("rename") or replace(self, to)
    )
    (tmp_path / "out.yaml").write_text("old")
    change(tmp_path / "out.yaml")
    assert done == steps


def test_leftovers_of_a_killed_writer_go_with_the_next_write(tmp_path):
    (tmp_path / LEFTOVER).write_text("half")
    write_atomically(tmp_path / "out.yaml", b"new")
    assert names(tmp_path) == ["out.yaml"]


def test_leftovers_go_where_the_link_leads(tmp_path):
    (tmp_path / "real").mkdir()
    (tmp_path / "real" / LEFTOVER).write_text("half")
    (tmp_path / "out.yaml").symlink_to(tmp_path / "real" / "out.yaml")
    remove_leftovers(tmp_path / "out.yaml")
    assert names(tmp_path / "real") == []


def test_only_our_own_leftovers_are_removed(tmp_path):
    others = (f"x{LEFTOVER}", f"{LEFTOVER}x", ".0123456789abcdef.tmp", ".stereo_selfcal.0123.tmp", "out.yaml")
    for name in others:
        (tmp_path / name).write_text("somebody's")
    (tmp_path / LEFTOVER).mkdir()
    (tmp_path / LEFTOVER.replace("0", "f")).symlink_to(tmp_path / "out.yaml")
    before = names(tmp_path)
    remove_leftovers(tmp_path / "out.yaml")
    assert names(tmp_path) == before
    assert all((tmp_path / name).read_text() == "somebody's" for name in others)


def test_file_of_a_living_writer_is_no_leftover(tmp_path, monkeypatch):
    """Another writer of the same folder comes between content and rename."""
    seen = []
    sync = os.fsync

    def interrupted(descriptor):
        if not seen:
            seen.append(names(tmp_path))
            write_atomically(tmp_path / "other.yaml", b"other")
            remove_leftovers(tmp_path / "out.yaml")
            seen.append(names(tmp_path))
        sync(descriptor)

    monkeypatch.setattr(os, "fsync", interrupted)
    write_atomically(tmp_path / "out.yaml", b"new")
    (temporary,) = seen[0]
    assert atomic_file._TEMPORARY.fullmatch(temporary)
    assert seen[1] == [temporary, "other.yaml"]
    assert names(tmp_path) == ["other.yaml", "out.yaml"]
    assert (tmp_path / "out.yaml").read_bytes() == b"new"


@pytest.mark.parametrize("taken", ["locked", "removed"])
def test_writer_tries_again_when_its_new_file_is_taken_for_a_leftover(tmp_path, monkeypatch, taken):
    """In the moment between making and locking it."""
    lock, held = fcntl.flock, []

    def late(descriptor, operation):
        if not held:
            (name,) = names(tmp_path)
            held.append(os.open(tmp_path / name, os.O_RDWR))
            lock(held[0], operation)
            (tmp_path / name).unlink()
            if taken == "removed":
                lock(held[0], fcntl.LOCK_UN)
        lock(descriptor, operation)

    monkeypatch.setattr(fcntl, "flock", late)
    write_atomically(tmp_path / "out.yaml", b"new")
    os.close(held[0])
    assert (tmp_path / "out.yaml").read_bytes() == b"new"
    assert names(tmp_path) == ["out.yaml"]


def test_file_system_without_locks_will_do(tmp_path, monkeypatch):
    def refuse(*_args):
        raise OSError(95, os.strerror(95))

    monkeypatch.setattr(fcntl, "flock", refuse)
    (tmp_path / LEFTOVER).write_text("half, or somebody's who writes just now")
    write_atomically(tmp_path / "out.yaml", b"new")
    assert (tmp_path / "out.yaml").read_bytes() == b"new"
    assert names(tmp_path) == [LEFTOVER, "out.yaml"]


def test_writers_at_once_do_not_disturb_each_other(tmp_path):
    contents = [bytes([i]) * 100_000 for i in range(8)]
    threads = [
        threading.Thread(
            target=lambda c=content: [write_atomically(tmp_path / "out.yaml", c) for _ in range(5)]
        )
        for content in contents
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert (tmp_path / "out.yaml").read_bytes() in contents
    assert names(tmp_path) == ["out.yaml"]


def test_file_set_aside_is_untouched_and_overwrites_no_earlier_one(tmp_path):
    path = tmp_path / "out.yaml"
    for number, expected in enumerate(("out.yaml.rejected", "out.yaml.rejected-2", "out.yaml.rejected-3")):
        path.write_bytes(bytes([number]))
        path.chmod(0o640)
        os.utime(path, ns=(1, 1_234_567_890_123_456_789))
        before = path.stat()
        assert set_aside(path) == tmp_path / expected
        after = (tmp_path / expected).stat()
        for field in ("st_ino", "st_mode", "st_mtime_ns", "st_size"):
            assert getattr(after, field) == getattr(before, field)
    assert not path.exists()
    assert [(tmp_path / name).read_bytes() for name in names(tmp_path)] == [b"\0", b"\1", b"\2"]


def test_file_behind_a_link_is_set_aside_where_it_is(tmp_path):
    (tmp_path / "real").mkdir()
    (tmp_path / "real" / "out.yaml").write_text("bad")
    link = tmp_path / "link.yaml"
    link.symlink_to(tmp_path / "real" / "out.yaml")
    assert set_aside(link) == tmp_path / "real" / "out.yaml.rejected"
    write_atomically(link, b"new")
    assert link.is_symlink()
    assert (tmp_path / "real" / "out.yaml").read_bytes() == b"new"


@pytest.mark.parametrize("name", ["missing", ".", "a\0b", "n" * 250])
def test_what_cannot_be_set_aside_is_named_and_left(tmp_path, name):
    (tmp_path / ("n" * 250)).write_text("its name is too long for another ending")
    before = names(tmp_path)
    with pytest.raises(OutputError, match="cannot be kept aside"):
        set_aside(tmp_path / name)
    assert names(tmp_path) == before


def test_failing_rename_leaves_no_reserved_name(tmp_path, monkeypatch):
    def fail(*_args):
        raise OSError(5, os.strerror(5))

    (tmp_path / "out.yaml").write_text("bad")
    monkeypatch.setattr("pathlib.Path.replace", fail)
    with pytest.raises(OutputError, match="input/output error"):
        set_aside(tmp_path / "out.yaml")
    assert names(tmp_path) == ["out.yaml"]


@pytest.mark.parametrize("mode", [0o600, 0o640, 0o664, 0o444, 0o755])
def test_a_replaced_file_keeps_its_mode(tmp_path, mode):
    path = tmp_path / "out.yaml"
    path.write_text("old")
    path.chmod(mode)
    (tmp_path / "link").symlink_to(path)
    for name in ("out.yaml", "link"):
        write_atomically(tmp_path / name, b"new")
        assert stat.S_IMODE(path.stat().st_mode) == mode and path.read_bytes() == b"new"


@pytest.mark.skipif(os.getuid() != 0, reason="only root may give files away")
def test_a_replaced_file_keeps_its_owner_and_group(tmp_path):
    path = tmp_path / "out.yaml"
    path.write_text("old")
    os.chown(path, 12, 34)
    write_atomically(path, b"new")
    assert (path.stat().st_uid, path.stat().st_gid) == (12, 34)


def test_where_the_group_cannot_be_kept_the_new_one_gets_no_more_than_anybody(tmp_path, monkeypatch):
    def refuse(*_args):
        raise PermissionError(1, "Operation not permitted")

    path = tmp_path / "out.yaml"
    path.write_text("old")
    path.chmod(0o674)
    real = os.stat_result
    monkeypatch.setattr(os, "fchown", refuse)
    stat_of = type(path).stat

    def other_group(self, **options):
        found = stat_of(self, **options)
        return real([*found[:5], found.st_gid + 1, *found[6:]]) if self.name == "out.yaml" else found

    monkeypatch.setattr(type(path), "stat", other_group)
    write_atomically(path, b"new")
    monkeypatch.undo()
    assert stat.S_IMODE(path.stat().st_mode) == 0o644


def test_nobody_else_can_read_a_private_file_while_it_is_replaced(tmp_path, monkeypatch):
    path = tmp_path / "out.yaml"
    path.write_text("old")
    path.chmod(0o600)
    seen = []
    write = os.write

    def look(descriptor, content):
        seen.append(stat.S_IMODE(os.fstat(descriptor).st_mode))
        return write(descriptor, content)

    monkeypatch.setattr(os, "write", look)
    write_atomically(path, b"new")
    assert seen == [0o600]
