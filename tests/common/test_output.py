"""Tests of `uvms_drake.common.output`."""

import pytest

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.common.output import output_folder


def test_files_appear_together_at_the_end(tmp_path):
    target = tmp_path / "a" / "b"
    with output_folder(target, ["x.txt", "y.txt"]) as folder:
        (folder / "x.txt").write_text("1")
        assert not (target / "x.txt").exists()
    assert [path.name for path in target.iterdir()] == ["x.txt"]


def test_a_failure_leaves_a_former_run_as_it_was(tmp_path):
    (tmp_path / "x.txt").write_text("old")
    with pytest.raises(ZeroDivisionError), output_folder(tmp_path, ["x.txt"]) as folder:
        (folder / "x.txt").write_text("new")
        raise ZeroDivisionError
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("x.txt", "old")]


def test_a_failure_removes_the_folders_that_were_made(tmp_path):
    with pytest.raises(KeyboardInterrupt), output_folder(tmp_path / "a" / "b", []):
        raise KeyboardInterrupt
    assert list(tmp_path.iterdir()) == []


def test_stale_files_of_a_former_run_go_and_those_of_the_user_stay(tmp_path):
    for name in ("x.png", "log.npz", "notes.txt"):
        (tmp_path / name).write_text("old")
    with output_folder(tmp_path, ["x.png", "log.npz"]) as folder:
        (folder / "log.npz").write_text("new")
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {
        "log.npz": "new", "notes.txt": "old"}


@pytest.mark.parametrize("below", ["", "sub", "sub/sub"])
def test_a_path_that_cannot_be_written_to_is_refused_at_once(tmp_path, below):
    (tmp_path / "file").write_text("in the way")
    target = tmp_path / "file" / below
    with pytest.raises(InvalidParameter, match=r"--output = .*: must be a folder that can be"), \
            output_folder(target, []):
        pytest.fail("the block was entered")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
