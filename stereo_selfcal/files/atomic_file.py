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

"""Files that are whole or not there at all, whenever the power goes or the process is killed."""

from __future__ import annotations

import errno
import fcntl
import os
import re
import secrets
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ..core.errors import OutputError, printable

_TEMPORARY = re.compile(r"\.stereo_selfcal\.[0-9a-f]{16}\.tmp")
_REJECTED = ".rejected"
# Far more than bad files ever come together; only to end the search for a free name.
_MOST_REJECTED = 1000
_RIGHTS = stat.S_IRWXU | stat.S_IRWXG | stat.S_IRWXO
# A new temporary file can be taken for a leftover only before it is locked, a matter of microseconds.
_LOCK_ATTEMPTS = 5
# Standard input, output and error.
_STREAMS = (0, 1, 2)
# There is no room: on the disk, of the user, in a file.
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def write_atomically(path: Path | str, content: bytes, executable: bool = False) -> None:
    """Replace a file in one step: whoever reads it, at whatever moment, finds the old or the new one.

    Once this returns the new content survives a power cut. The new file has the mode of the old one, and its
    owner and group where that is allowed. What a killed writer left beside the file is removed.

    Args:
        path: The file; its folder must exist. A link is followed.
        content: The new content.
        executable: Whether whoever may read it may run it: a script.

    Raises:
        OutputError: The file cannot be written. The old file is unchanged, and no temporary file remains.
    """
    try:
        refuse_other_than_files(path)
        target = Path(os.path.realpath(path))
        # A rename would put a file in the place of a device such as /dev/null.
        if os.path.lexists(target) and not target.is_file():
            raise OutputError(f"{_shown(path)} cannot be written: it is not a file; give the name of a file")
        remove_leftovers(target)
        _replace(target, content, executable)
    except (OSError, ValueError) as error:  # ValueError: a NUL character in the name
        raise cannot_be_written(path, error) from error


def refuse_other_than_files(path: Path | str) -> None:
    """Refuse what cannot be replaced by a file: ``/dev/stdout`` and other streams, devices, folders.

    Raises:
        OutputError: It is no file, or the one that a standard stream of this process goes to.
    """
    try:
        there = Path(path).stat()
    except (OSError, ValueError):
        return
    if not stat.S_ISREG(there.st_mode):
        # /proc/self/fd/1 leads to a pipe by a name under which nothing is: not by its real path.
        raise OutputError(f"{_shown(path)} cannot be written: it is not a file; give the name of a file")
    for descriptor in _STREAMS:
        with suppress(OSError):  # closed
            if os.path.samestat(there, os.fstat(descriptor)):
                raise OutputError(
                    f"{_shown(path)} cannot be written: what this program prints goes there, and would be "
                    "lost; give the name of another file"
                )


def cannot_be_written(path: Path | str, error: Exception) -> OutputError:
    """Return the error for a file that cannot be written, from that of the system: cause and remedy.

    Args:
        path: The file.
        error: What writing raised.
    """
    remedy = "choose a writable folder that exists"
    if getattr(error, "errno", None) in FULL:
        remedy = "make room, or choose another folder"
    elif getattr(error, "errno", None) == errno.ENAMETOOLONG:
        remedy = "choose a shorter name"
    return OutputError(f"{_shown(path)} cannot be written: {_detail(error)}; {remedy}")


def remove_leftovers(file: Path | str) -> None:
    """Remove what writers that were killed have left in the folder of a file.

    Only files that bear a temporary name of this package, and that no living process writes: a writer
    holds a lock on its file, which ends with it. What cannot be removed stays, as it does no harm.
    """
    with suppress(OSError, ValueError):
        target = Path(os.path.realpath(file))
        for path in target.parent.iterdir():
            if _TEMPORARY.fullmatch(path.name):
                with suppress(OSError):
                    _remove_leftover(path)


def set_aside(path: Path | str) -> Path:
    """Rename a file that is not to be overwritten; content and times stay as they are.

    Args:
        path: The file. A link is followed, and goes on leading to the old place.

    Returns:
        Where the file is now: ``<name>.rejected``, or the first of ``<name>.rejected-2``, ``-3``, ...
        that is free.

    Raises:
        OutputError: It is no file, or cannot be renamed; it is where it was.
    """
    try:
        target = Path(os.path.realpath(path))
        if not stat.S_ISREG(target.lstat().st_mode):
            raise OutputError(
                f"{_shown(path)} cannot be kept aside: it is not a file; give the name of a file"
            )
        aside = _reserve(target)
        try:
            target.replace(aside)
        except BaseException:
            with suppress(OSError):
                aside.unlink()
            raise
    except (OSError, ValueError) as error:
        raise OutputError(
            f"{_shown(path)} cannot be kept aside: {_detail(error)}; move it away, or choose another name"
        ) from error
    sync_folder(target.parent)
    return aside


def _replace(target: Path, content: bytes, executable: bool) -> None:
    with _temporary_file(target) as (temporary, descriptor):
        view = memoryview(content)
        while view:
            view = view[os.write(descriptor, view) :]
        _keep_rights(target, descriptor)
        if executable:
            _make_executable(descriptor)
        os.fsync(descriptor)  # before the rename, or a power cut could leave the new name without content
        temporary.replace(target)
    sync_folder(target.parent)


@contextmanager
def _temporary_file(target: Path) -> Iterator[tuple[Path, int]]:
    """Open a new locked file in the same folder, as a rename is atomic only within one file system.

    The lock is held until the end, by which the file has been renamed: a leftover is never locked.
    It is removed where anything fails.
    """
    for _ in range(_LOCK_ATTEMPTS):
        temporary = target.with_name(f".stereo_selfcal.{secrets.token_hex(8)}.tmp")
        # Before it has the rights of the old file nobody else may read it.
        rights = 0o600 if target.exists() else 0o666
        descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, rights)
        try:
            if _own(descriptor):
                yield temporary, descriptor
                return
        except BaseException:
            with suppress(OSError):
                temporary.unlink()
            raise
        finally:
            os.close(descriptor)
    raise OSError(errno.EBUSY, "its temporary files are taken away by another process")


def _keep_rights(target: Path, descriptor: int) -> None:
    """Give a new file the mode of the old one, and its owner and group where this process may."""
    try:
        old = target.stat()
    except FileNotFoundError:
        return
    new = os.fstat(descriptor)
    if (old.st_uid, old.st_gid) != (new.st_uid, new.st_gid):
        for owner in (old.st_uid, -1):  # the group alone, where the owner cannot be kept
            with suppress(OSError):
                os.fchown(descriptor, owner, old.st_gid)
                break
    mode = stat.S_IMODE(old.st_mode) & _RIGHTS
    if os.fstat(descriptor).st_gid != old.st_gid:
        # Of another group nobody may do more than anybody.
        mode &= ~stat.S_IRWXG | (mode & stat.S_IRWXO) << 3
    with suppress(OSError):  # a file system without modes
        os.fchmod(descriptor, mode)


def _make_executable(descriptor: int) -> None:
    """Let a file be run by all who may read it."""
    mode = stat.S_IMODE(os.fstat(descriptor).st_mode)
    readers = mode & (stat.S_IRUSR | stat.S_IRGRP | stat.S_IROTH)
    with suppress(OSError):  # a file system without modes
        os.fchmod(descriptor, mode | readers >> 2)


def _own(descriptor: int) -> bool:
    """Lock a new file; whether it is still there and nobody else has locked it as a leftover."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # a file system without locks; there, nobody removes leftovers either
        return True
    return os.fstat(descriptor).st_nlink > 0


def _remove_leftover(path: Path) -> None:
    if not stat.S_ISREG(path.lstat().st_mode):
        return
    # For writing, as NFS locks exclusively only what is open so.
    descriptor = os.open(path, os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        path.unlink()
    finally:
        os.close(descriptor)


def _reserve(target: Path) -> Path:
    """Make an empty file under the first free name, to be renamed over: nothing else is overwritten."""
    for number in range(1, _MOST_REJECTED + 1):
        aside = target.with_name(f"{target.name}{_REJECTED}{f'-{number}' if number > 1 else ''}")
        with suppress(FileExistsError):
            os.close(os.open(aside, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600))
            return aside
    raise OSError(errno.EEXIST, f"there are {_MOST_REJECTED} such files already")


def sync_folder(folder: Path) -> None:
    """Make a rename itself survive a power cut, where the file system and its rights allow."""
    with suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def _shown(path: Path | str) -> str:
    return printable(str(path))


def _detail(error: Exception) -> str:
    return (getattr(error, "strerror", None) or str(error)).lower()
