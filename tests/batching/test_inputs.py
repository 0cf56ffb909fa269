"""Inputs: the files that they match, their order and their safe names, and archives that are refused."""

import bz2
import gzip
import io
import json
import lzma
import os
import re
import struct
import tarfile
import tracemalloc
from dataclasses import asdict
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from spinor_geom.batching.archives import ArchiveReader, Member, members
from spinor_geom.batching.inputs import Inputs, Source
from spinor_geom.batching.settings import Limits
from spinor_geom.errors import ArchiveError, BatchError
from spinor_geom.files import safe_name
from tests.batching.files import packed_zip
from tests.systems import links, modes

LIMITS = Limits(seconds=30.0, memory=1 << 29, retries=0)
PACKERS = {".tar": lambda data: data, ".tar.gz": gzip.compress, ".tbz2": bz2.compress, ".tar.xz": lzma.compress}


def listed(given):
    return Inputs(given, output="/nowhere", limits=LIMITS)


def content(reader, source):
    return reader.read(Path(source.path), Member(name=source.member, size=source.size, place=source.place))


def keys(*given):
    return [source.key for source in listed(map(str, given))]


def problem(given):
    (source,) = listed([str(given)])
    return source.problem


def packed_tar(path, entries):
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w") as archive:
        for entry in entries:
            if isinstance(entry, tarfile.TarInfo):
                archive.addfile(entry)
                continue
            info = tarfile.TarInfo(entry[0])
            info.size = len(entry[1])
            archive.addfile(info, io.BytesIO(entry[1]))
    suffix = next(suffix for suffix in PACKERS if path.name.endswith(suffix))
    path.write_bytes(PACKERS[suffix](buffer.getvalue()))
    return path


@pytest.fixture
def folder(tmp_path):
    root = tmp_path / "scans"
    for name in ("b.obj", "a.OBJ", "deep/er/c.obj", "deep/readme.txt", "deep/d.mtl"):
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text("v 0 0 0\n")
    return root


def test_folders_are_searched_in_order_with_all_below(folder):
    assert keys(folder) == ["scans/a.OBJ", "scans/b.obj", "scans/deep/er/c.obj"]
    assert keys(folder / "b.obj") == ["b.obj"]


def test_inputs_that_are_named_as_others_are_numbered_have_different_keys(tmp_path):
    for name in ("c1/scans", "c2/scans", "c3/scans~2", "c4/Scans"):
        (tmp_path / name).mkdir(parents=True)
        (tmp_path / name / "a.obj").write_text("")
    given = [tmp_path / name for name in ("c1/scans", "c2/scans", "c3/scans~2", "c4/Scans")]
    assert keys(*given) == ["scans/a.obj", "scans~2/a.obj", "scans~2~2/a.obj", "Scans~3/a.obj"]


@pytest.mark.parametrize("suffix", [".tar", ".zip"])
@pytest.mark.filterwarnings("ignore:Duplicate name:UserWarning")  # from zipfile, for the duplicate written here
def test_members_of_one_name_are_numbered(tmp_path, suffix):
    names = ["a.obj", "./a.obj", "b/c.obj", "a.obj", "A.obj", "b\\c.obj", "b//c.obj", "a.obj~2/d.obj", "a.obj%~2/d.obj"]
    path = tmp_path / f"p{suffix}"
    entries = [(name, f"v {number} 0 0\n".encode()) for number, name in enumerate(names)]
    (packed_zip if suffix == ".zip" else packed_tar)(path, entries)
    found = list(listed([str(path)]))
    keys_there = " ".join(source.key.removeprefix(f"p{suffix}/") for source in found)
    assert keys_there == "a.obj a.obj%~2 b/c.obj a.obj%~3 A.obj%~4 b/c.obj%~2 b/c.obj%~3 a.obj~2/d.obj a.obj%25~2/d.obj"
    reader = ArchiveReader()
    for source, (_, data) in zip(found, entries, strict=True):
        assert content(reader, source) == data
    reader.close()


@pytest.mark.parametrize("given", ["nowhere", "nowhere/*.obj"])
def test_inputs_that_do_not_exist_stop_the_batch(tmp_path, given):
    with pytest.raises(BatchError, match="nowhere"):
        listed([str(tmp_path / given)])
    with pytest.raises(BatchError, match="no inputs"):
        listed([])


def test_results_are_no_inputs(folder):
    for pattern in (folder, folder / "**" / "*.obj"):
        found = [source.key for source in Inputs([str(pattern)], output=folder / "deep", limits=LIMITS)]
        assert not [key for key in found if "deep" in key]
        assert "scans/b.obj" in found
    with pytest.raises(BatchError, match="is the output folder"):
        Inputs([str(folder)], output=folder, limits=LIMITS)


def test_manifests_name_files_from_where_they_are(folder):
    table = folder / "list.csv"
    table.write_text("\ufeffid,path\n1,b.obj\n2,deep/er/c.obj\n3,\n4,gone.obj\n5,b.obj\n", encoding="utf-8")
    lines = folder / "list.jsonl"
    lines.write_text('{"path": "b.obj"}\n\n"deep/er/c.obj"\n{"file": 3}\n"\\ud800"\n"\\u0000"\n')
    found = list(listed([str(table)]))
    assert [(source.key, bool(source.problem)) for source in found] == [
        ("list.csv/1/b.obj", False),
        ("list.csv/2/deep/er/c.obj", False),
        ("list.csv/3/problem", True),
        ("list.csv/4/gone.obj", True),
        ("list.csv/5/b.obj", False),
    ]
    assert [Path(source.path).name for source in found[:2]] == ["b.obj", "c.obj"]
    assert "row 3 has no path" in found[2].problem
    assert [source.key for source in listed([str(lines)])] == [
        "list.jsonl/1/b.obj",
        "list.jsonl/3/deep/er/c.obj",
        "list.jsonl/4/problem",
        "list.jsonl/5/problem",
        "list.jsonl/6/%00",
    ]


@links
def test_patterns_follow_no_loops_of_links(folder):
    # two links: the ways through them double at each level
    (folder / "deep" / "up").symlink_to(folder)
    (folder / "deep" / "again").symlink_to(folder)
    assert keys(folder / "**" / "*.obj") == ["scans/b.obj", "scans/deep/er/c.obj"]
    assert keys(folder / "**") == ["scans/a.OBJ", "scans/b.obj", "scans/deep/er/c.obj"]
    # a level that is asked for is gone
    assert keys(folder / "deep" / "up" / "*.obj") == ["up/b.obj"]
    with pytest.raises(BatchError, match="matches no file"):
        listed([str(folder / "**" / "nothing.obj")])


def test_patterns_leave_hidden_files_alone_unless_they_name_them(folder):
    (folder / ".cache").mkdir()
    for hidden in (folder / "._b.obj", folder / ".cache" / "e.obj"):
        hidden.write_text("")
    assert keys(folder / "**" / "*.obj") == ["scans/b.obj", "scans/deep/er/c.obj"]
    assert keys(folder / ".cache" / "*.obj") == [".cache/e.obj".replace(".", "%2E", 1)]
    assert keys(folder / ".*.obj") == ["scans/%2E_b.obj"]


@pytest.mark.parametrize(
    ("name", "text"),
    [
        *(("a.csv", text) for text in ("file\nb.obj\n", "", "path\n" + "x" * (2 << 20))),
        *(("a.jsonl", text) for text in ("{", "[" * 100_000, "\udcff")),
    ],
)
def test_broken_manifests_are_one_problem(tmp_path, name, text):
    (tmp_path / name).write_text(text, encoding="utf-8", errors="surrogateescape")
    assert "cannot be read as a manifest" in problem(tmp_path / name)


@modes
def test_what_is_no_regular_file_is_not_opened(folder):
    os.mkfifo(folder / "e.obj")  # would wait for ever
    (folder / "f.obj").symlink_to("/etc/passwd")
    (folder / "g").symlink_to("/")
    found = {source.key: source.problem for source in listed([str(folder)])}
    assert "not a regular file" in found["scans/e.obj"]
    assert "is a link" in found["scans/f.obj"]
    assert not any(key.startswith("scans/g") for key in found)


def test_inputs_without_mesh_files_are_an_error_that_counts_the_other_files(folder, tmp_path):
    other = tmp_path / "photos"
    (other / "deep").mkdir(parents=True)
    for name in ("a.jpg", "b.JPG", "deep/c.jpg", "deep/notes.txt", "README"):
        (other / name).write_text("")
    packed = packed_zip(tmp_path / "photos.zip", [("a.jpg", b""), ("b/c.jpg", b"")])
    found = "among 5 files: 3 .jpg, 1 without a suffix, 1 .txt"
    for named, message in ((other, found), (packed, "among 2 files: 2 .jpg"), (other / "deep" / "**", "among 2 files")):
        with pytest.raises(BatchError, match=f"{re.escape(str(named))}: no mesh files {message}"):
            list(listed([str(folder), str(named)]))
    with pytest.raises(BatchError, match=r"^no mesh files among 1 file: 1 \.mtl"):
        list(listed([str(folder / "deep" / "d.mtl")]))
    (tmp_path / "empty").mkdir()
    with pytest.raises(BatchError, match="there are no files"):
        list(listed([str(tmp_path / "empty")]))
    # as a shell gives them, files of other formats are a problem each
    sources = {source.key: source.problem for source in listed(map(str, [folder / "b.obj", other / "a.jpg"]))}
    assert "is not a mesh file" in sources["a.jpg"]


@pytest.mark.parametrize("suffix", [*PACKERS, ".zip"])
def test_archives_are_read_member_by_member_in_any_order(tmp_path, suffix):
    data = {f"set/{number}.obj": os.urandom(3000 * number) for number in range(5)}
    entries = [*data.items(), ("set/readme.txt", b"no mesh")]
    path = tmp_path / f"pack{suffix}"
    (packed_zip if suffix == ".zip" else packed_tar)(path, entries)
    found = list(listed([str(path)]))
    assert [source.key for source in found] == [f"pack{suffix}/set/{number}.obj" for number in range(5)]
    reader = ArchiveReader()
    for source in [*found, found[3], found[1]]:
        source = Source(**json.loads(json.dumps(asdict(source))))
        assert content(reader, source) == data[source.member]
    reader.close()


def tar_entry(name, kind, target=""):
    info = tarfile.TarInfo(name)
    info.type, info.linkname = kind, target
    return info


GOOD = ("good.obj", b"v 0 0 0\n")


UNSAFE = ("../out.obj", "a/../../out.obj", "/etc/x.obj", "..\\out.obj", "C:\\x.obj", f"{'a' * 5000}.obj")


@pytest.mark.parametrize("suffix", [".tar.gz", ".zip"])
def test_members_with_unsafe_names_have_safe_keys(tmp_path, suffix):
    path = tmp_path / f"pack{suffix}"
    (packed_zip if suffix == ".zip" else packed_tar)(path, [GOOD, *((name, GOOD[1]) for name in UNSAFE)])
    found = list(listed([str(path)]))
    assert not any(source.problem for source in found)
    assert len({source.key for source in found}) == len(found) == len(UNSAFE) + 1
    for source in found:
        assert set(source.key.split("/")).isdisjoint(("", ".", ".."))
        assert ":" not in source.key
        assert content(ArchiveReader(), source) == GOOD[1]


def test_links_and_devices_in_an_archive_are_a_problem_each(tmp_path):
    kinds = (tarfile.SYMTYPE, tarfile.LNKTYPE, tarfile.FIFOTYPE, tarfile.CHRTYPE)
    bad = [tar_entry(f"{number}.obj", kind, "good.obj") for number, kind in enumerate(kinds)]
    found = list(listed([str(packed_tar(tmp_path / "pack.tar.gz", [*bad, GOOD]))]))
    assert ["a link, a device" in source.problem for source in found] == [True] * len(bad) + [False]


def test_encrypted_members_of_an_archive_are_not_read(tmp_path):
    path = packed_zip(tmp_path / "b.zip", [GOOD])
    data = bytearray(path.read_bytes())
    for magic, flags in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        data[data.index(magic) + flags] |= 1
    path.write_bytes(data)
    (source,) = listed([str(path)])
    with pytest.raises(ArchiveError, match="encrypted"):
        content(ArchiveReader(), source)


@pytest.mark.parametrize(("suffix", "parts"), [(".tar.gz", 1), (".tbz2", 10), (".tar.xz", 1), (".zip", 10)])
def test_bombs_are_refused_before_they_unpack(tmp_path, suffix, parts):
    path = tmp_path / f"bomb{suffix}"
    bombs = [(f"bomb{number}.obj", bytes((20 << 20) // parts)) for number in range(parts)]
    (packed_zip if suffix == ".zip" else packed_tar)(path, [GOOD, *bombs])
    assert "a decompression bomb" in problem(path)
    tracemalloc.start()
    with pytest.raises(ArchiveError, match="a decompression bomb"):
        list(members(path))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 15 << 20


# tarfile takes long for digits
LETTERS = bytes.maketrans(b"0123456789", b"ghijklmnop")


def pax_header(size, kind=tarfile.XHDTYPE, *, key="comment"):
    """A header of a tar archive with one entry, of a text that packs about a hundred times."""
    text = b"".join((b"%08x" % number).translate(LETTERS) * 125 for number in range(size // 1000))
    entry = b"%s=%s\n" % (key.encode(), text)
    length = next(n for n in range(len(entry) + 2, len(entry) + 20) if n == len(entry) + 1 + len(str(n)))
    info = tarfile.TarInfo("header")
    info.type, info.size = kind, length
    data = info.tobuf(tarfile.USTAR_FORMAT) + b"%d %s" % (length, entry)
    return data + bytes(-len(data) % tarfile.BLOCKSIZE)


def good_tar():
    info = tarfile.TarInfo(GOOD[0])
    info.size = len(GOOD[1])
    return info.tobuf(tarfile.USTAR_FORMAT) + GOOD[1].ljust(512, b"\0") + bytes(1024)


def test_headers_that_add_up_end_at_the_memory_limit(tmp_path):
    # global headers hold for all that follows: tarfile keeps them
    path = tmp_path / "bomb.tar.gz"
    with gzip.open(path, "wb", compresslevel=6) as file:
        for number in range(120):
            file.write(pax_header(1_000_000, tarfile.XGLTYPE, key=f"k{number}"))
        file.write(good_tar())
    limits = Limits(seconds=60.0, memory=100 << 20, retries=0)
    (source,) = Inputs([str(path)], output="/nowhere", limits=limits)
    assert source.key == "bomb.tar.gz/problem"
    assert source.problem == f"{path}: its process used more than 100 MiB of memory; raise the limit, or split the file"


def test_a_chain_of_headers_is_damage(tmp_path):
    # tarfile calls itself for each
    path = tmp_path / "chain.tar"
    path.write_bytes(pax_header(1000) * 2000 + good_tar())
    assert "cannot be read as an archive" in problem(path)


def test_a_damaged_header_is_not_the_end(tmp_path):
    path = packed_tar(tmp_path / "a.tar", [GOOD, GOOD, GOOD])
    data = bytearray(path.read_bytes())
    data[2 * tarfile.BLOCKSIZE] ^= 1
    path.write_bytes(data)
    assert keys(path) == ["a.tar/problem"]
    assert "a header is damaged" in problem(path)


def test_a_zip_with_wrong_sizes_gives_no_more_than_the_stated_size(tmp_path):
    path = packed_zip(tmp_path / "a.zip", [("a.obj", b"v 0 0 0\n" * 50_000)])
    data = bytearray(path.read_bytes())
    for magic, at in ((b"PK\x03\x04", 22), (b"PK\x01\x02", 24)):
        struct.pack_into("<I", data, data.index(magic) + at, 100)
    path.write_bytes(data)
    (member,) = members(path)
    with pytest.raises(ArchiveError, match=r"a\.obj: .*CRC"):
        ArchiveReader().read(path, member)


@pytest.mark.parametrize("suffix", [*PACKERS, ".zip"])
def test_every_truncated_archive_is_a_problem(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    (packed_zip if suffix == ".zip" else packed_tar)(path, [("a.obj", os.urandom(5000)), ("b.obj", os.urandom(5000))])
    data = path.read_bytes()
    for share in (0.0, 0.3):
        path.write_bytes(data[: int(share * len(data))])
        assert all(source.problem for source in list(listed([str(path)]))[-1:]), share


CHARACTERS = 'aA.~%2F \\:*?"<>|\0\n\r\x7f\u00e9\u0301\u2028\U0001f600'


@given(st.lists(st.lists(st.text(CHARACTERS, min_size=1, max_size=8), min_size=1, max_size=4), min_size=2, max_size=6))
def test_names_are_harmless_and_different_names_stay_different(names):
    # a part of an input's name has no separator
    plain = [[part.replace("/", "_") for part in parts] for parts in names]
    safe = [safe_name(parts) for parts in plain]
    assert len(set(safe)) == len({tuple(parts) for parts in plain})
    for name in safe:
        assert name.encode("utf-8")
        assert not name.startswith("/")
        assert not set(name) & set('\\:*?"<>|\0\n\r')
        assert all(part not in ("", ".", "..") and not part.startswith(".") for part in name.split("/"))
