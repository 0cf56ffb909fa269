import errno
import os
import stat
from contextlib import suppress
from pathlib import Path

import pytest

from spinor_geom import files
from spinor_geom.files import atomic_folder, atomic_path, safe_name, together, write_json, write_text
from tests.systems import links, modes


def names(folder):
    return sorted(entry.name for entry in folder.iterdir())


def test_a_new_file_has_the_written_contents(tmp_path):
    target = tmp_path / "mesh.obj"
    with atomic_path(target) as temporary:
        assert temporary.parent == tmp_path
        assert temporary.suffix == ".obj"
        temporary.write_text("new")
        assert not target.exists()
    assert target.read_text() == "new"
    assert names(tmp_path) == ["mesh.obj"]


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_failure_leaves_old_file_and_no_temporary(tmp_path, error):
    target = tmp_path / "mesh.obj"
    target.write_text("old")

    def write_half():
        with atomic_path(target) as temporary:
            temporary.write_text("half of the new")
            raise error

    with pytest.raises(error):
        write_half()
    assert target.read_text() == "old"
    assert names(tmp_path) == ["mesh.obj"]


@modes
def test_access_rights_are_kept_and_new_files_follow_the_umask(tmp_path):
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


@links
def test_symbolic_link_stays_a_link(tmp_path):
    target = tmp_path / "target"
    target.write_text("old")
    link = tmp_path / "link"
    link.symlink_to(target)
    with atomic_path(link) as temporary:
        temporary.write_text("new")
    assert link.is_symlink()
    assert target.read_text() == "new"


def test_device_is_written_to_and_not_replaced():
    with atomic_path(os.devnull) as path:
        path.write_text("nothing")
    assert not Path(os.devnull).is_file()


def test_errors_name_the_caller_s_file_not_the_temporary_one(tmp_path):
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


def test_a_folder_appears_with_all_its_files_or_not_at_all(tmp_path):
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


@pytest.mark.parametrize(
    ("call", "code"), [("open", errno.EACCES), ("fsync", errno.EINVAL), ("fsync", errno.ENOTSUP), ("fsync", errno.EIO)]
)
def test_broken_disks_are_errors(tmp_path, monkeypatch, call, code):
    # as Windows refuses to open a folder, and some network file systems to flush one
    real = getattr(os, call)

    def refuses(what, *arguments):
        if os.path.isdir(what):
            raise OSError(code, os.strerror(code), None if isinstance(what, int) else str(what))
        return real(what, *arguments)

    monkeypatch.setattr(os, call, refuses)

    def write():
        write_json(tmp_path / "a.json", [1])
        with atomic_folder(tmp_path / "deep" / "folder", staging=tmp_path / "staging") as folder:
            (folder / "b").write_text("2")

    if code == errno.EIO:
        with pytest.raises(OSError, match=os.strerror(code)):
            write()
        return
    write()
    assert (tmp_path / "a.json").read_text().split() == ["[", "1", "]"]
    assert (tmp_path / "deep" / "folder" / "b").read_text() == "2"


def test_a_file_that_another_program_has_open_stays(tmp_path, monkeypatch):
    # as Windows does it: no file is replaced that is open, or read-only
    target = tmp_path / "mesh.obj"
    target.write_text("old")

    def refuses(source, to):
        raise PermissionError(errno.EACCES, "The file is in use", str(source), None, str(to))

    monkeypatch.setattr(os, "replace", refuses)
    with pytest.raises(PermissionError) as raised, atomic_path(target) as temporary:
        temporary.write_text("new")
    assert raised.value.filename == str(target)
    assert target.read_text() == "old"
    assert names(tmp_path) == ["mesh.obj"]


NAMES = ["CON", "con", "PRN", "aux", "NUL", "nul.obj", "Com1", "LPT9.tar.gz", "COM²", "CONIN$", "conout$.x", "AUX .ply"]


def test_names_of_devices_are_written_otherwise():
    safe = [safe_name([name]) for name in NAMES]
    assert safe[:2] == ["%43ON", "%63on"]
    assert len(set(safe)) == len(NAMES)
    stems, devices = ({name.partition(".")[0].strip().lower() for name in some} for some in (safe, NAMES))
    assert not stems & devices
    assert safe_name(["NUL.obj", "aux.obj"]) == "%4EUL.obj%/%61ux.obj"
    assert safe_name([safe[0]]) != safe[0]
    harmless = ["CONE.obj", "nully", "COM10.obj", "a.con", "auxiliary.obj", "com.obj", "lpt", "CON-1.obj"]
    assert [safe_name([name]) for name in harmless] == harmless


def test_names_leave_room_in_the_longest_path_of_windows():
    results = len("\\files\\" + "\\loop-12-" + "x" * 60 + ".safetensors")
    for parts in (["a" * 300], ["b" * 60] * 9, ["é" * 90, "c.obj"], ["\\" * 99], ["d" * 100, "e" * 100]):
        name = safe_name(parts)
        assert max(map(len, map(os.fsencode, name.split("/")))) <= 255
        assert len(os.fsencode(name)) + results <= 260 - 30  # a drive and a folder or two above the output


FILES = {"a.txt": "old a", "b.txt": None, "c.txt": "old c"}  # the old text of each


def write_all(folder):
    with together():
        for name in FILES:
            write_text(folder / name, f"new {name}")
            assert (folder / name).exists() == (FILES[name] is not None)


@pytest.mark.parametrize("step", ["_flush", "os.replace", "_flush_names", "_copied", "nothing"])
@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("error", [KeyboardInterrupt(), OSError(errno.EIO, "no"), OSError(errno.EACCES, "no", "x")])
def test_files_that_are_written_together_are_all_new_or_all_old(tmp_path, monkeypatch, step, count, error):
    for name, text in FILES.items():
        if text is not None:
            (tmp_path / name).write_text(text)
    calls, raised = 0, False
    module, attribute = (os, "replace") if step == "os.replace" else (files, step)
    own = getattr(module, attribute, None)

    def failing(*arguments):
        nonlocal calls, raised
        calls += 1
        if calls == count:
            raised = True
            raise error
        assert own is not None
        return own(*arguments)

    if own is not None:
        monkeypatch.setattr(module, attribute, failing)
    with suppress(KeyboardInterrupt, OSError):
        write_all(tmp_path)
    monkeypatch.undo()
    expected = FILES if raised else {name: f"new {name}" for name in FILES}
    assert {name: (tmp_path / name).read_text() for name in names(tmp_path)} == {k: v for k, v in expected.items() if v}


def test_a_group_inside_a_group_belongs_to_the_outer_one(tmp_path):
    with suppress(ZeroDivisionError), together():
        with together():
            write_text(tmp_path / "one.txt", "one")
        assert not (tmp_path / "one.txt").exists()
        raise ZeroDivisionError
    assert names(tmp_path) == []
    with together():
        write_text(tmp_path / "one.txt", "one")
        write_text(tmp_path / "one.txt", "two")
    assert (tmp_path / "one.txt").read_text() == "two"
    assert names(tmp_path) == ["one.txt"]
