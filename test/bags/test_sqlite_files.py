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

"""SQLite files of killed and of running recorders, in any folder: all is read, and nobody is held up."""

import os
import shutil
import sqlite3

import pytest
from bag_making import cameras, make_bag

from stereo_selfcal.bags import BagError, StereoBag

N_FRAMES = 4


def frames_of(path):
    with StereoBag(path) as bag:
        return len(list(bag.frames()))


@pytest.fixture
def storage(tmp_path):
    """Return the .db3 of a recording without metadata.yaml, as a killed recorder leaves it."""
    folder = make_bag(tmp_path / "made", cameras(), N_FRAMES, "sqlite3")
    return next(folder.glob("*.db3"))


def half_in_a_wal(storage, folder):
    """Copy a file, and beside it the log in which the second half of its messages is."""
    folder.mkdir()
    connection = sqlite3.connect(storage)
    connection.execute("PRAGMA journal_mode = WAL")
    connection.execute("PRAGMA wal_autocheckpoint = 0")
    rows = connection.execute("SELECT * FROM messages").fetchall()
    for part in (rows[: len(rows) // 2], rows[len(rows) // 2 :]):
        if part[0] == rows[0]:
            connection.execute("DELETE FROM messages")
        connection.executemany("INSERT INTO messages VALUES (?, ?, ?, ?)", part)
        connection.commit()
        if part[0] == rows[0]:
            connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    for file in storage.parent.glob("*.db3*"):
        shutil.copy(file, folder)
    connection.close()
    return folder / storage.name


@pytest.mark.parametrize("shared_memory", [True, False])
def test_messages_that_are_only_in_the_wal_are_read(storage, tmp_path, shared_memory):
    file = half_in_a_wal(storage, tmp_path / "killed")
    if not shared_memory:
        (file.parent / f"{file.name}-shm").unlink()
    assert frames_of(file.parent) == N_FRAMES
    assert frames_of(file) == N_FRAMES
    (file.parent / f"{file.name}-wal").unlink()
    (file.parent / f"{file.name}-shm").unlink()
    assert frames_of(file) == N_FRAMES // 2


def test_wal_that_cannot_be_read_in_its_place_is_read_from_a_copy(storage, tmp_path):
    """SQLite wants to write -shm, which it cannot in a folder that is read-only."""
    file = half_in_a_wal(storage, tmp_path / "killed")
    shared = file.parent / f"{file.name}-shm"
    shared.unlink()
    shared.mkdir()
    before = sorted((path.name, path.stat().st_mtime_ns) for path in file.parent.iterdir())
    assert frames_of(file) == N_FRAMES
    assert sorted((path.name, path.stat().st_mtime_ns) for path in file.parent.iterdir()) == before


def test_wal_beside_the_file_that_a_link_leads_to_is_read(storage, tmp_path):
    file = half_in_a_wal(storage, tmp_path / "killed")
    (tmp_path / "links").mkdir()
    (tmp_path / "links" / "other.db3").symlink_to(file)
    assert frames_of(tmp_path / "links") == N_FRAMES


def test_change_that_was_not_finished_is_undone(storage, tmp_path):
    connection = sqlite3.connect(storage, isolation_level=None)
    connection.execute("PRAGMA journal_mode = DELETE")
    connection.execute("PRAGMA synchronous = FULL")
    connection.execute("PRAGMA cache_size = 1")
    connection.execute("BEGIN IMMEDIATE")
    connection.execute("UPDATE messages SET data = zeroblob(100)")
    for _ in range(300):
        connection.execute(
            "INSERT INTO messages SELECT NULL, topic_id, timestamp, data FROM messages LIMIT 10"
        )
    (tmp_path / "killed").mkdir()
    for file in storage.parent.glob("*.db3*"):
        shutil.copy(file, tmp_path / "killed")
    connection.execute("ROLLBACK")
    connection.close()
    journal = next((tmp_path / "killed").glob("*-journal"))
    assert journal.stat().st_size > 0
    before = journal.read_bytes()
    assert frames_of(tmp_path / "killed") == N_FRAMES
    assert journal.read_bytes() == before


@pytest.mark.parametrize("mode", ["WAL", "DELETE", "MEMORY"])
def test_recorder_that_still_writes_is_not_held_up_and_the_reading_ends(storage, mode):
    recorder = sqlite3.connect(storage, timeout=0, isolation_level=None)
    recorder.execute(f"PRAGMA journal_mode = {mode}")
    more = "INSERT INTO messages SELECT NULL, topic_id, timestamp + 1000000000, data FROM messages LIMIT 4"
    with StereoBag(storage) as bag:
        frames = bag.frames()
        for _ in range(N_FRAMES):
            next(frames)
            recorder.execute(more)  # "database is locked" if the reader held it
        assert next(frames, None) is None
    recorder.close()


def test_file_that_another_process_locks_for_good_is_refused_by_name(storage, monkeypatch):
    monkeypatch.setattr("stereo_selfcal.bags.sqlite_storage._BUSY_S", 0.05)
    recorder = sqlite3.connect(storage, isolation_level=None)
    recorder.execute("PRAGMA locking_mode = EXCLUSIVE")
    recorder.execute("BEGIN EXCLUSIVE")
    try:
        assert frames_of(storage) == N_FRAMES  # as it was before
    except BagError as error:
        assert "locked" in str(error)
    recorder.close()


@pytest.mark.parametrize(
    "name",
    ["run #2", "what?", "100%25", "50%", "a&mode=memory", "a b", "ü", "a:b", "file:x", "quote'\"", "[x]*"],
)
def test_any_character_may_be_in_a_path(tmp_path, name):
    folder = tmp_path / name / name
    folder.parent.mkdir()
    made = make_bag(tmp_path / "bag", cameras(), N_FRAMES, "sqlite3")
    made.rename(folder)
    assert frames_of(folder) == N_FRAMES
    (folder / "metadata.yaml").unlink()
    file = folder / f"{name}.db3"
    next(folder.glob("*.db3")).rename(file)
    assert frames_of(folder) == N_FRAMES
    assert frames_of(file) == N_FRAMES


@pytest.mark.skipif(os.name != "posix", reason="names are bytes on POSIX only")
def test_path_that_is_no_utf_8_is_read(tmp_path):
    made = make_bag(tmp_path / "bag", cameras(), N_FRAMES, "sqlite3")
    folder = tmp_path / os.fsdecode(b"run \xff")
    made.rename(folder)
    assert frames_of(folder) == N_FRAMES


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("UPDATE topics SET name = NULL WHERE id = 1", "the name of a topic is None, a text is needed"),
        ("UPDATE topics SET type = NULL", "the type of a topic is None, a text is needed"),
        ("UPDATE messages SET timestamp = 'noon'", "a time is 'noon', a whole number is needed"),
        ("UPDATE messages SET timestamp = 1.5", "a time is '1.5'"),
        ("UPDATE messages SET data = NULL", r"message \d has no data"),
        ("UPDATE messages SET data = 'text'", r"message \d has no data"),
        ("UPDATE topics SET serialization_format = 'json'", "Serialization format 'json' is not supported"),
        ("UPDATE topics SET offered_qos_profiles = 'a: [1, 2'", None),
        ("DROP TABLE topics", "tables 'messages' and 'topics' of a recording are missing"),
        ("DROP TABLE messages", "tables 'messages' and 'topics' of a recording are missing"),
        (
            "UPDATE message_definitions SET encoded_message_definition = hex(zeroblob(40000))",
            "has 80.0 kB, at most 65.5 kB",
        ),
    ],
)
def test_values_of_a_wrong_type_are_named(storage, change, words):
    connection = sqlite3.connect(storage)
    if change.startswith("UPDATE"):  # a table without conditions on its columns
        table = change.split()[1]
        connection.execute(f"CREATE TABLE other AS SELECT * FROM {table}")
        connection.execute(f"DROP TABLE {table}")
        connection.execute(f"ALTER TABLE other RENAME TO {table}")
    connection.execute(change)
    connection.commit()
    connection.close()
    if words is None:  # it is not needed
        assert frames_of(storage) == N_FRAMES
        return
    with pytest.raises(BagError, match=words) as error:
        frames_of(storage)
    assert "\n" not in str(error.value)
