from __future__ import annotations

import errno
import os
import stat
from pathlib import Path

import pytest

from spinor_geom.files import atomic_folder, atomic_path


def names(folder: Path) -> list[str]:
    return sorted(entry.name for entry in folder.iterdir())


def test_new_file_appears_with_what_was_written(tmp_path: Path) -> None:
    target = tmp_path / "mesh.obj"
    with atomic_path(target) as temporary:
        assert temporary.parent == tmp_path
        assert temporary.suffix == ".obj"
        temporary.write_text("new")
        assert not target.exists()
    assert target.read_text() == "new"
    assert names(tmp_path) == ["mesh.obj"]


def test_failure_leaves_old_file_and_no_temporary(tmp_path: Path) -> None:
    target = tmp_path / "mesh.obj"
    target.write_text("old")

    def write_half() -> None:
        with atomic_path(target) as temporary:
            temporary.write_text("half of the new")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        write_half()
    assert target.read_text() == "old"
    assert names(tmp_path) == ["mesh.obj"]


def test_interrupt_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt), atomic_path(tmp_path / "a.ply"):
        raise KeyboardInterrupt
    assert names(tmp_path) == []


def test_writer_that_removes_its_file_leaves_the_old_one(tmp_path: Path) -> None:
    target = tmp_path / "a"
    target.write_text("old")
    with pytest.raises(FileNotFoundError), atomic_path(target) as temporary:
        temporary.unlink()
    assert target.read_text() == "old"


def test_access_rights_are_kept_and_new_files_follow_the_umask(tmp_path: Path) -> None:
    target = tmp_path / "private"
    target.write_text("old")
    target.chmod(0o640)
    with atomic_path(target) as temporary:
        temporary.write_text("new")
    assert stat.S_IMODE(target.stat().st_mode) == 0o640
    fresh = tmp_path / "fresh"
    with atomic_path(fresh) as temporary:
        temporary.write_text("new")
    plain = tmp_path / "plain"
    plain.write_text("")
    assert fresh.stat().st_mode == plain.stat().st_mode


def test_symbolic_link_stays_a_link(tmp_path: Path) -> None:
    target = tmp_path / "target"
    target.write_text("old")
    link = tmp_path / "link"
    link.symlink_to(target)
    with atomic_path(link) as temporary:
        temporary.write_text("new")
    assert link.is_symlink()
    assert target.read_text() == "new"


def test_device_is_written_to_and_not_replaced() -> None:
    with atomic_path(os.devnull) as path:
        path.write_text("nothing")
    assert not Path(os.devnull).is_file()


def test_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(IsADirectoryError, match="is a folder"), atomic_path(tmp_path):
        pass


def test_errors_name_the_caller_s_file_not_the_temporary_one(tmp_path: Path) -> None:
    missing, full, other = tmp_path / "missing" / "a.obj", tmp_path / "full", tmp_path / "other"
    with pytest.raises(FileNotFoundError) as missed, atomic_path(missing):
        pass
    assert missed.value.filename == str(missing)
    with pytest.raises(OSError, match="No space") as filled, atomic_path(full):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    assert filled.value.filename == str(full)
    with pytest.raises(FileNotFoundError) as read, atomic_path(full):
        other.read_text()
    assert read.value.filename == str(other)


def test_a_folder_appears_with_all_its_files_or_not_at_all(tmp_path: Path) -> None:
    target, staging = tmp_path / "deep" / "er" / "target", tmp_path / "staging"
    with atomic_folder(target, staging=staging) as folder:
        (folder / "a").write_text("1")
        assert not target.exists()
    assert (target / "a").read_text() == "1"
    with pytest.raises(IsADirectoryError), atomic_folder(target, staging=staging) as folder:
        folder.write_text("2")
    assert [path.name for path in target.iterdir()] == ["a"]
    with atomic_folder(target, staging=staging) as folder:
        (folder / "b").write_text("2")
    assert [path.name for path in target.iterdir()] == ["b"]
    assert list(staging.iterdir()) == []


def test_files_of_a_folder_are_on_the_disk_before_it_appears(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    events: list[str] = []
    fsync, rename = os.fsync, os.rename
    monkeypatch.setattr(os, "fsync", lambda descriptor: (events.append("fsync"), fsync(descriptor)))
    monkeypatch.setattr(os, "rename", lambda *names: (events.append("rename"), rename(*names)))
    with atomic_folder(tmp_path / "target", staging=tmp_path / "staging") as folder:
        (folder / "a").write_text("1")
        (folder / "b").write_text("2")
    # two files and the folder, then the names above it
    assert events == ["fsync"] * 3 + ["rename", "fsync"]
