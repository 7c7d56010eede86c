"""Whether a file can be written is known before there is anything to write."""

import os

import pytest

from stereo_selfcal.core.errors import OutputError
from stereo_selfcal.files.writable import check_writable


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
