"""Tests of `uvms_drake.common.cache`."""

import os

import pytest

from uvms_drake.common.cache import cache_dir, cached, source_digest

VALUE = {"J_max": 2.904009999999997, "worst": [0.1, 1e-300, -0.0], "how": "proven"}


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "uvms_drake"


class Counter:
    """Returns a value and counts how often it was asked."""

    def __init__(self, value: object = VALUE):
        self.value, self.calls = value, 0

    def __call__(self) -> object:
        self.calls += 1
        return self.value


def test_a_second_call_returns_the_same_without_computing():
    compute = Counter()
    assert cached({"seed": 0}, compute) == VALUE
    assert cached({"seed": 0}, compute) == VALUE
    assert compute.calls == 1


def test_another_source_of_the_package_computes_again(monkeypatch):
    compute = Counter()
    cached({}, compute)
    monkeypatch.setattr("uvms_drake.common.cache.source_digest", lambda: "another")
    cached({}, compute)
    assert compute.calls == 2


def test_further_files_make_another_digest(tmp_path, monkeypatch):
    monkeypatch.setattr("uvms_drake.common.cache.FOLDER", tmp_path)
    (tmp_path / "law.py").write_text("k = 1\n", encoding="utf-8")
    (tmp_path / "gains.yaml").write_text("k: 1.0\n", encoding="utf-8")
    digests = []
    for gain in ("1.0", "2.0"):
        (tmp_path / "gains.yaml").write_text(f"k: {gain}\n", encoding="utf-8")
        source_digest.cache_clear()
        digests.append((source_digest(), source_digest("*.yaml")))
    source_digest.cache_clear()
    (python, whole), (same, changed) = digests
    assert python == same and len({python, whole, changed}) == 3


@pytest.mark.parametrize("damage", [
    b"", b"{", b"[]", b"\xff\xfe", b'{"value": 1}', b"null", b'{"key": 1, "value": 2}'])
def test_a_corrupt_file_is_computed_again_and_repaired(folder, damage):
    compute = Counter()
    cached({"seed": 0}, compute)
    (path,) = folder.iterdir()
    path.write_bytes(damage)
    assert cached({"seed": 0}, compute) == VALUE
    assert cached({"seed": 0}, compute) == VALUE
    assert compute.calls == 2


def test_a_folder_that_cannot_be_written_is_no_error(tmp_path, monkeypatch):
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    monkeypatch.setenv("XDG_CACHE_HOME", str(blocked))
    compute = Counter()
    assert cached({}, compute) == VALUE
    assert cached({}, compute) == VALUE
    assert compute.calls == 2


def test_an_error_of_the_computation_is_not_kept(folder):
    def fail() -> object:
        raise ValueError("no")
    with pytest.raises(ValueError, match="no"):
        cached({}, fail)
    assert not folder.exists() or not os.listdir(folder)


def test_without_the_variable_it_is_in_the_home_folder(monkeypatch, tmp_path):
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert cache_dir() == tmp_path / ".cache" / "uvms_drake"
