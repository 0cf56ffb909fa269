"""Batches with processes of their own: the same bytes whatever happens on the way."""

from __future__ import annotations

import contextlib
import csv
import itertools
import os
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import psutil
import pyarrow.parquet as pq
import pytest

from spinor_geom import BatchProgress, BatchResult, batch
from spinor_geom.batching.engine import TOGETHER, Workers, _blocks
from spinor_geom.batching.inputs import SMALL, Source
from spinor_geom.batching.options import BatchOptions
from spinor_geom.batching.store import RUN, STAGING, failure, opened_store
from spinor_geom.cli.main import main
from spinor_geom.errors import BatchError, OptionError
from tests.batching.files import circle, curve_text, holed_text, record, results, write_curves
from tests.systems import signals

PROGRAM = "import sys; from spinor_geom.cli.main import main; sys.exit(main(sys.argv[1:]))"
CURVES = 40
# of the sockets that listen on this machine (/proc/net/tcp) the inodes of those that take a connection
CONNECT = """
import os, socket
os.setgroups([])
os.setgid(65534)
os.setuid(65534)
for line in open("/proc/net/tcp").readlines()[1:]:
    words = line.split()
    if words[3] == "0A":
        with socket.socket() as one:
            one.settimeout(5)
            if one.connect_ex(("127.0.0.1", int(words[1].split(":")[1], 16))) == 0:
                print(words[9])
"""


@pytest.fixture(scope="module", autouse=True)
def found(harmful_site: str) -> Iterator[None]:
    """Processes find the package."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", harmful_site)
        patch.setenv("OMP_NUM_THREADS", "1")
        yield


@pytest.fixture(scope="module")
def corpus(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Files of all kinds, one of them broken; one kills the process that reads it first."""
    folder = tmp_path_factory.mktemp("corpus") / "in"
    write_curves(folder, CURVES, points=24)
    (folder / "roof.obj").write_bytes(holed_text().encode())
    (folder / "open.obj").write_text("g left\n" + curve_text(circle(9), closed=False))
    (folder / "broken.obj").write_bytes(b"\x7fELF\0")
    (folder / "closed_mesh.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n")
    (folder / "killed.obj").write_text(curve_text(circle(9)))
    return folder


@pytest.fixture(scope="module")
def seen() -> list[BatchProgress]:
    return []


@pytest.fixture(scope="module")
def reference(corpus: Path, seen: list[BatchProgress], tmp_path_factory: pytest.TempPathFactory) -> BatchResult:
    return batch(corpus, tmp_path_factory.mktemp("reference") / "out", workers=1, on_progress=seen.append)


def started(*arguments: object, limit_file: int | None = None) -> subprocess.Popen[str]:
    """The command line, in a process of its own."""

    def limited() -> None:
        import resource

        # whatever started the tests may ignore interrupts, as shells do for what runs in the background
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        if limit_file is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit_file, limit_file))

    return subprocess.Popen(
        [sys.executable, "-c", PROGRAM, "batch", *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=os.path.abspath(os.sep),
        # a process whose files may not grow would leave cut-off bytecode to all others
        env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"},
        preexec_fn=limited,
        start_new_session=True,
    )


def local_cluster(**options: Any) -> Any:
    from distributed import LocalCluster

    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": "127.0.0.1:0", **options}
    return LocalCluster(host="127.0.0.1", silence_logs=50, **options)


def wait_until(condition: Callable[[], bool], seconds: float = 120.0) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def records(output: Path) -> list[Path]:
    return sorted((output / "files").rglob("record.json"))


def solvers_below(pid: int) -> list[psutil.Process]:
    """The processes that solve below another one."""
    found = []
    for process in psutil.Process(pid).children(recursive=True):
        with contextlib.suppress(psutil.Error):  # some come and go
            if "spinor_geom.batching.solver" in process.cmdline():
                found.append(process)
    return found


def solvers_of(pid: int) -> list[psutil.Process]:
    """The processes that solve for a driver, once they are there."""
    solvers: list[psutil.Process] = []

    def found() -> bool:
        solvers[:] = solvers_below(pid)
        return bool(solvers)

    wait_until(found)
    return solvers


def test_a_batch_counts_what_it_did(reference: BatchResult, seen: list[BatchProgress]) -> None:
    done = reference.progress
    assert not reference.complete
    assert (done.files, done.files_failed, done.loops, done.loops_failed) == (CURVES + 5, 2, CURVES + 3, 1)
    assert (done.files_total, done.files_before) == (CURVES + 5, 0)
    assert [now.files for now in seen] == list(range(1, CURVES + 6))
    assert seen[-1].files_total == CURVES + 5


def test_the_tables_have_a_row_for_each_loop(reference: BatchResult) -> None:
    rows = pq.read_table(reference.table).to_pylist()
    with reference.table_csv.open(newline="") as file:
        lines = list(csv.DictReader(file))
    # a closed mesh and a broken file have no loops
    assert len(rows) == len(lines) == CURVES + 5
    assert [row["source"] for row in rows] == sorted(row["source"] for row in rows)
    for row, line in zip(rows, lines, strict=True):
        assert {key: "" if value is None else str(value) for key, value in row.items()} == line
        if row["status"] == "done" and row["loop"] is not None:
            entry = record(reference.output, row["source"])["loops"][row["loop"]]
            assert row["area"] == entry["area"] > 0
            assert row["seconds"] > 0
            assert (reference.output / "files" / row["source"] / row["patch"]).exists()
    assert {row["source"]: row["reason"] for row in rows if row["status"] == "failed"}.keys() == {
        "in/broken.obj",
        "in/open.obj",
    }


def test_failures_stand_in_the_log_and_on_the_page(reference: BatchResult) -> None:
    lines = [line.split("\t") for line in reference.log.read_text().splitlines()]
    assert [line[:2] for line in lines] == [["failed", "in/broken.obj"], ["failed", "in/open.obj"]]
    assert "zero byte" in lines[0][2]
    assert lines[1][2].startswith("loop 0 (left): the curve is open")
    page = reference.page.read_text()
    assert page.count("<svg") > 20
    assert "zero byte" in page
    assert "<script" not in page


def test_nothing_is_left_half_written(reference: BatchResult) -> None:
    assert not (reference.output / STAGING).exists()
    assert not [path for path in reference.output.rglob(".*") if path.name != ".lock"]


@signals
def test_a_killed_driver_is_resumed_to_the_same_bytes(reference: BatchResult, corpus: Path, tmp_path: Path) -> None:
    output = tmp_path / "out"
    driver = started(corpus, "-o", output, "--workers", 1)
    solvers = solvers_of(driver.pid)
    wait_until(lambda: len(records(output)) > 3)
    driver.send_signal(signal.SIGKILL)
    driver.communicate()
    psutil.wait_procs(solvers, timeout=20)
    assert not any(process.is_running() for process in solvers)
    before = {path: path.stat().st_ino for path in records(output)}
    assert 3 < len(before) < CURVES
    (output / STAGING / "half").mkdir(parents=True)

    again = started(corpus, "-o", output, "--workers", 1, "--resume")
    _, said = again.communicate(timeout=120)
    assert again.returncode == 1  # two of the files are broken
    assert "2 of 45 files are not wholly done" in said
    assert {path: path.stat().st_ino for path in before} == before
    assert results(output) == results(reference.output)
    assert (output / "failures.log").read_text() == reference.log.read_text()
    assert not (output / STAGING).exists()

    # a resumed run with nothing to do starts no workers and changes nothing
    begin = time.monotonic()
    third = batch(corpus, output, resume=True)
    assert time.monotonic() - begin < 20
    assert third.progress.files_before == CURVES + 5
    assert {path: path.stat().st_ino for path in before} == before


@signals
def test_killed_processes_cost_time_only(reference: BatchResult, corpus: Path, tmp_path: Path) -> None:
    output = tmp_path / "out"
    driver = started(corpus, "-o", output, "--workers", 1)
    for _ in range(2):
        count = len(records(output))
        wait_until(lambda count=count: len(records(output)) > count + 1)
        solvers_of(driver.pid)[0].kill()
    _, said = driver.communicate(timeout=120)
    assert driver.returncode == 1
    assert "2 of 45 files" in said
    assert results(output) == results(reference.output)


def test_a_cluster_leaves_the_same_bytes(reference: BatchResult, corpus: Path, tmp_path: Path) -> None:
    with local_cluster() as cluster:
        killed = []

        def kill_a_worker(now: BatchProgress) -> None:
            if now.files > 3 and not killed:
                killed.append(psutil.Process(solvers_below(os.getpid())[0].ppid()))
                killed[0].kill()

        result = batch(corpus, tmp_path / "out", scheduler=cluster.scheduler_address, on_progress=kill_a_worker)
        assert killed
        # the workers go on, for others; what solved for this batch does not
        assert len(cluster.scheduler_info["workers"]) > 0
        assert solvers_below(os.getpid()) == []
    assert results(result.output) == results(reference.output)


@pytest.mark.skipif(shutil.which("openssl") is None, reason="makes a certificate")
def test_a_cluster_with_tls_is_used_by_its_client_or_itself(tmp_path: Path) -> None:
    from distributed import Client
    from distributed.security import Security

    key, certificate = str(tmp_path / "key.pem"), str(tmp_path / "certificate.pem")
    made = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-subj", "/CN=batch"]
    subprocess.run([*made, "-keyout", key, "-out", certificate], check=True, capture_output=True)
    names = {f"tls_{role}_{kind}" for role in ("scheduler", "worker", "client") for kind in ("key", "cert")}
    files = {name: key if name.endswith("key") else certificate for name in names}
    security = Security(require_encryption=True, tls_ca_file=certificate, **files)

    (path,) = write_curves(tmp_path / "in", 1)
    with local_cluster(security=security, n_workers=1, protocol="tls") as cluster:
        assert cluster.scheduler_address.startswith("tls://")
        with pytest.raises(BatchError, match="no Dask scheduler answers there"):
            batch(path, tmp_path / "unknown", scheduler=cluster.scheduler_address)
        assert batch(path, tmp_path / "cluster", scheduler=cluster).complete
        with Client(cluster, set_as_default=False) as client:
            assert batch(path, tmp_path / "client", scheduler=client).complete
            assert client.status == "running"


def test_a_local_batch_listens_nowhere_and_ends_its_processes(corpus: Path, tmp_path: Path) -> None:
    seen: dict[int, int] = {}

    def look(now: BatchProgress) -> None:
        if now.files % 10 == 1:
            driver = psutil.Process()
            for process in [driver, *driver.children(recursive=True)]:
                for one in process.net_connections():
                    if one.status == psutil.CONN_LISTEN:
                        seen[one.laddr.port] = process.pid

    before = {one.laddr.port for one in psutil.Process().net_connections() if one.status == psutil.CONN_LISTEN}
    assert batch(corpus, tmp_path / "out", workers=2, on_progress=look).progress.files
    assert seen.keys() <= before
    assert solvers_below(os.getpid()) == []


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root can be another user")
@signals
def test_another_user_finds_no_port_of_a_batch(corpus: Path, tmp_path: Path) -> None:
    driver = started(corpus, "-o", tmp_path / "out", "--workers", 2)
    solvers = solvers_of(driver.pid)
    pids = [str(process.pid) for process in (psutil.Process(driver.pid), *solvers)]
    inodes = {os.readlink(link) for pid in pids for link in Path("/proc", pid, "fd").iterdir()}
    other = subprocess.run([sys.executable, "-c", CONNECT], capture_output=True, text=True)
    driver.communicate(timeout=120)
    assert other.returncode == 0, other.stderr
    reached = {f"socket:[{inode}]" for inode in other.stdout.split()}
    assert not inodes & reached


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=128k", "tmpfs", disk], capture_output=True)
    if mounted.returncode:
        pytest.skip("mounting is not permitted here")
    yield disk
    subprocess.run(["umount", "-l", disk], check=True)


@pytest.mark.slow
@signals
def test_a_full_disk_ends_the_run_and_room_lets_it_go_on(
    reference: BatchResult, corpus: Path, small_disk: Path
) -> None:
    driver = started(corpus, "-o", small_disk / "out", "--workers", 1)
    _, said = driver.communicate(timeout=120)
    assert driver.returncode == 2
    assert "No space left on device" in said
    whole = results(reference.output)
    there = results(small_disk / "out")
    assert there
    assert set(there.items()) < set(whole.items())
    subprocess.run(["mount", "-o", "remount,size=64m", small_disk], check=True)
    again = started(corpus, "-o", small_disk / "out", "--workers", 1, "--resume")
    again.communicate(timeout=120)
    assert again.returncode == 1
    assert results(small_disk / "out") == whole


@pytest.mark.slow
@signals
def test_files_that_may_not_grow_end_the_run(corpus: Path, tmp_path: Path) -> None:
    # as full disks do, where no disk can be mounted
    driver = started(corpus / "curve000.obj", "-o", tmp_path / "out", "--workers", 1, limit_file=1500)
    _, said = driver.communicate(timeout=120)
    assert driver.returncode == 2
    assert "File too large" in said
    assert records(tmp_path / "out") == []
    assert len(list(tmp_path.rglob("*.obj"))) == 0


@pytest.mark.slow
@signals
def test_an_interrupt_ends_all_processes_with_one_sentence(corpus: Path, tmp_path: Path) -> None:
    output, many = tmp_path / "out", tmp_path / "in"
    many.mkdir()
    for number in range(200):  # so many that it is not done before it is interrupted
        shutil.copy(corpus / "curve000.obj", many / f"{number}.obj")
    driver = started(many, "-o", output, "--workers", 1)
    solvers = solvers_of(driver.pid)
    wait_until(lambda: len(records(output)) > 1)
    os.killpg(driver.pid, signal.SIGINT)  # as a terminal does it
    _, said = driver.communicate(timeout=60)
    assert (driver.returncode, said) == (130, "spinor-geom: interrupted\n")
    psutil.wait_procs(solvers, timeout=20)
    assert not any(process.is_running() for process in solvers)


@signals
def test_two_runs_exclude_each_other(corpus: Path, tmp_path: Path) -> None:
    with opened_store(tmp_path / "out", BatchOptions(), resume=False):
        for more in ([], ["--resume"]):
            second = started(corpus, "-o", tmp_path / "out", *more)
            _, said = second.communicate(timeout=60)
            assert second.returncode == 2
            assert "another batch is writing to this folder" in said
    with opened_store(tmp_path / "out", BatchOptions(), resume=True):
        pass


def test_folders_that_hold_something_are_left_alone(
    reference: BatchResult, corpus: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = str(reference.output)
    assert main(["batch", str(corpus), "-o", output]) == 2
    assert "holds a batch already" in capsys.readouterr().err
    assert main(["batch", str(corpus), "-o", output, "--resume", "--format", "ply"]) == 2
    assert "was begun with other options" in capsys.readouterr().err
    assert main(["batch", str(corpus), "-o", str(corpus)]) == 2
    assert "is the output folder" in capsys.readouterr().err
    assert main(["batch", str(corpus / "roof.obj"), "-o", str(corpus)]) == 2
    assert "holds other things" in capsys.readouterr().err
    (tmp_path / "files").mkdir()
    (tmp_path / RUN).write_text("{")
    assert main(["batch", str(corpus), "-o", str(tmp_path), "--resume"]) == 2
    assert "is damaged" in capsys.readouterr().err
    assert main(["batch", str(corpus / "nothing.obj"), "-o", str(tmp_path / "new")]) == 2
    assert "no such file" in capsys.readouterr().err


def test_a_run_without_results_is_no_obstacle(corpus: Path, tmp_path: Path) -> None:
    for device in ("cpu", "cuda"):
        with opened_store(tmp_path / "out", BatchOptions(device=device), resume=False):
            pass


def test_faults_and_changed_files_are_done_again(corpus: Path, tmp_path: Path) -> None:
    (path,) = write_curves(tmp_path / "in", 1)
    with opened_store(tmp_path / "out", BatchOptions(), resume=False) as store:
        source = Source(key="a", path=str(path), size=3, modified=4)
        for status, complete in (("done", True), ("failed", True), ("fault", False)):
            store.commit(source, failure("a", "", status=status), {})
            assert (store.completed(source) is not None) == complete
            assert store.completed(Source(key="a", path=str(path), size=3, modified=5)) is None


@pytest.mark.parametrize(
    "wrong",
    [
        {"workers": 0},
        {"workers": 1, "scheduler": "tcp://127.0.0.1:1"},
        {"retries": -1},
        {"time_limit": 0},
        {"memory_limit": -5},
        {"tolerance": 0.0},
    ],
)
def test_options_are_checked_before_anything_is_made(corpus: Path, tmp_path: Path, wrong: dict[str, object]) -> None:
    with pytest.raises(OptionError):
        batch(corpus, tmp_path / "out", **wrong)  # type: ignore[arg-type]
    assert not (tmp_path / "out").exists()


def test_a_scheduler_that_is_not_there_is_said(corpus: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(BatchError, match="no Dask scheduler answers there"):
        batch(corpus, tmp_path / "out", scheduler="nonsense://here")


def of_threads(count: int) -> Workers:
    return Workers(executor=ThreadPoolExecutor(count), count=lambda: count)


def test_a_million_inputs_are_taken_as_they_are_needed() -> None:
    taken = itertools.count()
    endless = (Source(key=str(number), path="", size=100) for number in taken)
    blocks = list(itertools.islice(_blocks(endless, Counter(files_total=10**6), of_threads(2)), 50))
    assert [len(block) for block in blocks] == [TOGETHER] * 50
    assert next(taken) <= 50 * TOGETHER + 1


def test_the_last_files_are_shared_out_evenly() -> None:
    sources = [Source(key=str(number), path="", size=100) for number in range(40)]
    blocks = list(_blocks(iter(sources), Counter(files_total=40), of_threads(4)))
    assert [source for block in blocks for source in block] == sources
    assert max(map(len, blocks)) == 5
    assert [len(block) for block in blocks[-4:]] == [1] * 4


def test_large_files_stand_alone() -> None:
    sizes = [100, SMALL + 1, SMALL + 1, 200, SMALL - 150, 30]
    sources = (Source(key=str(number), path="", size=size) for number, size in enumerate(sizes))
    found = [[source.size for source in block] for block in _blocks(sources, Counter(files_total=6), of_threads(1))]
    assert all(sum(block) <= SMALL or len(block) == 1 for block in found)
    assert [size for block in found for size in block] == sizes


def test_results_that_are_gone_are_made_again(tmp_path: Path) -> None:
    write_curves(tmp_path / "in", 1)
    (tmp_path / "in" / "roof.obj").write_bytes(holed_text().encode())
    output = tmp_path / "out"
    made = results(batch(tmp_path / "in", output, workers=1).output)
    gone = [path for path in (output / "files").rglob("*.obj") if path.is_file()]
    assert any(path.name == "filled.obj" for path in gone)
    for path in gone:
        path.unlink()
        again = batch(tmp_path / "in", output, workers=1, resume=True)
        assert (again.complete, again.progress.files_before) == (True, 1)
        assert results(output) == made


def test_names_that_terminals_obey_do_not_reach_the_log(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a.obj").write_text("g \x1b[31mred\x1b]0;x\x07\n" + curve_text(circle(9), closed=False))
    result = batch(tmp_path / "a.obj", tmp_path / "out", workers=1)
    log = result.log.read_text()
    assert "?[31mred" in log
    assert all(character.isprintable() or character in "\t\n" for character in log)
    assert main(["fill", str(tmp_path / "no\x1b[2J.obj"), "-o", str(tmp_path / "f.obj")]) == 2
    assert "\x1b" not in capfd.readouterr().err
