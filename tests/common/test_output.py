"""Tests of `uvms_drake.common.output`."""

import errno
import os

import pytest

import uvms_drake as uv
from uvms_drake.common.output import output_folder

MANIFEST = ".uvms-drake.json"


def names(folder):
    return sorted(path.name for path in folder.iterdir() if path.name != MANIFEST)


def write(folder, files, names=("x.txt", "y.txt"), **options):
    """Writes files, by name and content, as a command does."""
    with output_folder(folder, names, **options) as output:
        for name, text in files.items():
            (output.folder / name).write_text(text)


def test_files_appear_together_at_the_end(tmp_path):
    target = tmp_path / "a" / "b"
    with output_folder(target, ["x.txt", "y.txt"]) as output:
        (output.folder / "x.txt").write_text("1")
        assert not (target / "x.txt").exists()
    assert names(target) == ["x.txt"]
    assert output.kept == ["x.txt"]


def test_what_is_kept_stays_whatever_becomes_of_the_rest(tmp_path):
    write(tmp_path, {"x.txt": "old", "y.txt": "old"})
    with pytest.raises(ZeroDivisionError) as caught, \
            output_folder(tmp_path, ["x.txt", "y.txt"], replaces=True) as output:
        (output.folder / "x.txt").write_text("new")
        output.keep(replaces=True)
        (output.folder / "y.txt").write_text("half")
        raise ZeroDivisionError
    assert names(tmp_path) == ["x.txt"]
    assert (tmp_path / "x.txt").read_text() == "new"
    assert caught.value.__notes__ == [f"saved in {tmp_path}: x.txt"]


def test_a_full_disk_is_one_line_that_says_what_is_saved(tmp_path):
    with pytest.raises(uv.RunFailed) as caught, output_folder(tmp_path, ["x.txt"]) as output:
        (output.folder / "x.txt").write_text("1")
        output.keep()
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    assert str(caught.value) == ("the files cannot be written: No space left on device; "
                                 f"saved in {tmp_path}: x.txt")
    assert names(tmp_path) == ["x.txt"]


def test_a_failure_removes_the_folders_that_were_made(tmp_path):
    with pytest.raises(KeyboardInterrupt), output_folder(tmp_path / "a" / "b", []):
        raise KeyboardInterrupt
    assert list(tmp_path.iterdir()) == []


def test_stale_files_of_a_former_run_go_and_those_of_the_user_stay(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    write(tmp_path, {"x.txt": "old", "y.txt": "old"})
    write(tmp_path, {"y.txt": "new"}, replaces=True)
    assert names(tmp_path) == ["notes.txt", "y.txt"]
    assert (tmp_path / "y.txt").read_text() == "new"
    write(tmp_path, {"x.txt": "new"})
    assert names(tmp_path) == ["notes.txt", "x.txt", "y.txt"]


@pytest.mark.parametrize("own", ["file", "changed", "folder", "link"])
def test_a_file_of_somebody_else_is_never_replaced(tmp_path, own):
    match own:
        case "file":
            (tmp_path / "x.txt").write_text("mine")
        case "changed":
            write(tmp_path, {"x.txt": "old"})
            (tmp_path / "x.txt").write_text("old, with a note of mine")
        case "folder":
            (tmp_path / "x.txt").mkdir()
        case "link":
            (tmp_path / "x.txt").symlink_to("nowhere")
    before = names(tmp_path)
    with pytest.raises(uv.InvalidParameter, match=r"without files of others: x\.txt in it"), \
            output_folder(tmp_path, ["x.txt", "y.txt"], replaces=True):
        pytest.fail("the block was entered")
    assert names(tmp_path) == before


def test_what_a_killed_run_has_left_is_removed_and_what_one_at_work_has_is_not(tmp_path):
    (tmp_path / ".run-dead").mkdir()
    (tmp_path / ".run-dead" / "x.txt").write_text("half")
    with output_folder(tmp_path, ["x.txt"]) as first:
        assert not (tmp_path / ".run-dead").exists()
        with output_folder(tmp_path, ["y.txt"]) as second:
            assert first.folder.exists()
            assert second.folder.exists()
    assert names(tmp_path) == []


@pytest.mark.parametrize("below", ["", "sub", "sub/sub"])
def test_a_path_that_cannot_be_written_to_is_refused_at_once(tmp_path, below):
    (tmp_path / "file").write_text("in the way")
    target = tmp_path / "file" / below
    with pytest.raises(uv.InvalidParameter, match=r"--output = .*: must be a folder that can be"), \
            output_folder(target, []):
        pytest.fail("the block was entered")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize("path", ["n" * 300, "a\0b"])
def test_a_path_that_no_disk_can_hold_is_refused(tmp_path, path):
    with pytest.raises(uv.InvalidParameter, match=r"^--output = .*: must be a folder"), \
            output_folder(tmp_path / path, []):
        pytest.fail("the block was entered")
