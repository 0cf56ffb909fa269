"""Batches with worker processes: the results are the same bytes after crashes, interruptions and restarts."""

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
from concurrent.futures import ThreadPoolExecutor

import psutil
import pytest

from spinor_geom import batch
from spinor_geom.batching.engine import MOST_BYTES, MOST_FILES, _blocks
from spinor_geom.batching.inputs import Inputs, Source
from spinor_geom.batching.settings import BatchOptions
from spinor_geom.batching.store import RUN, STAGING, failure, opened_store
from spinor_geom.batching.workers import Workers, open_workers
from spinor_geom.cli.main import main
from spinor_geom.errors import BatchError
from tests.batching.files import circle, curve_text, holed_text, record, results, write_curves
from tests.batching.test_task import LIMITS, solved
from tests.systems import signals

PROGRAM = "import sys; from spinor_geom.cli.main import main; sys.exit(main(sys.argv[1:]))"
CURVES = 20
pytestmark = pytest.mark.usefixtures("_found")


@pytest.fixture(scope="module")
def corpus(tmp_path_factory):
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
def seen():
    return []


def listening():
    """This process and its descendants, with the ports on which they listen."""
    driver = psutil.Process()
    return {
        (process.pid, one.laddr.port)
        for process in [driver, *driver.children(recursive=True)]
        for one in process.net_connections()
        if one.status == psutil.CONN_LISTEN
    }


@pytest.fixture(scope="module")
def reference(corpus, seen, tmp_path_factory):
    """A batch with one worker, which listens nowhere and ends its processes."""
    before = listening()

    def look(now):
        seen.append(now)
        if now.files == 10:
            assert solvers_below(os.getpid())
            assert listening() <= before

    result = batch(corpus, tmp_path_factory.mktemp("reference") / "out", workers=1, on_progress=look)
    assert solvers_below(os.getpid()) == []
    return result


def started(*arguments, limit_file=None):
    """The command line, in a new process."""

    def limited():
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


def local_cluster(**options):
    from distributed import LocalCluster

    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": "127.0.0.1:0", **options}
    return LocalCluster(host="127.0.0.1", silence_logs=50, **options)


def wait_until(condition, seconds=120.0):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def records(output):
    return sorted((output / "files").rglob("record.json"))


def solvers_below(pid):
    """The solver processes among the descendants of a process."""
    found = []
    for process in psutil.Process(pid).children(recursive=True):
        with contextlib.suppress(psutil.Error):  # some come and go
            if "spinor_geom.batching.solver" in process.cmdline():
                found.append(process)
    return found


def solvers_of(pid):
    """The solver processes of a driver, as soon as they exist."""
    solvers: list[psutil.Process] = []

    def found():
        solvers[:] = solvers_below(pid)
        return bool(solvers)

    wait_until(found)
    return solvers


def test_a_batch_counts_what_it_did(reference, seen):
    done = reference.progress
    assert not reference.complete
    assert (done.files, done.files_failed, done.loops, done.loops_failed) == (CURVES + 5, 2, CURVES + 3, 1)
    assert (done.files_total, done.files_before) == (CURVES + 5, 0)
    assert [now.files for now in seen] == list(range(1, CURVES + 6))
    assert seen[-1].files_total == CURVES + 5


def test_the_table_has_a_row_for_each_loop(reference):
    with reference.table.open(newline="") as file:
        rows = list(csv.DictReader(file))
    # a closed mesh and a broken file have no loops
    assert len(rows) == CURVES + 5
    assert [row["source"] for row in rows] == sorted(row["source"] for row in rows)
    for row in rows:
        if row["status"] == "done" and row["loop"]:
            entry = record(reference.output, row["source"])["loops"][int(row["loop"])]
            assert float(row["area"]) == entry["area"] > 0
            assert float(row["seconds"]) > 0
            assert (reference.output / "files" / row["source"] / row["patch"]).exists()
    assert {row["source"] for row in rows if row["status"] == "failed"} == {"in/broken.obj", "in/open.obj"}


def test_failures_are_in_the_log_and_on_the_page(reference):
    lines = [line.split("\t") for line in reference.log.read_text().splitlines()]
    assert [line[:2] for line in lines] == [["failed", "in/broken.obj"], ["failed", "in/open.obj"]]
    assert "zero byte" in lines[0][2]
    assert lines[1][2].startswith("loop 0 (left): the curve is open")
    page = reference.page.read_text()
    assert page.count("<svg") > 20
    assert "zero byte" in page
    assert "<script" not in page


@pytest.mark.slow
@signals
def test_a_killed_driver_is_resumed_to_the_same_bytes(reference, corpus, tmp_path, capsys):
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

    assert main(["batch", str(corpus), "-o", str(output), "--workers", "1", "--resume"]) == 1  # two files are broken
    assert "2 of 25 files have failures" in capsys.readouterr().err
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


@pytest.mark.slow
def test_a_cluster_leaves_the_same_bytes(reference, corpus, tmp_path):
    with local_cluster() as cluster:
        killed = []

        def kill_a_worker(now):
            if now.files > 3 and not killed:
                killed.append(psutil.Process(solvers_below(os.getpid())[0].ppid()))
                killed[0].kill()

        result = batch(corpus, tmp_path / "out", scheduler=cluster.scheduler_address, on_progress=kill_a_worker)
        assert killed
        # the workers go on, for others; what solved for this batch does not
        assert len(cluster.scheduler_info["workers"]) > 0
        assert solvers_below(os.getpid()) == []
    assert results(result.output) == results(reference.output)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("openssl") is None, reason="makes a certificate")
def test_a_cluster_with_tls_is_used_by_its_client_or_itself(tmp_path):
    from distributed import Client
    from distributed.security import Security

    key, certificate = str(tmp_path / "key.pem"), str(tmp_path / "certificate.pem")
    made = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-subj", "/CN=batch"]
    subprocess.run([*made, "-keyout", key, "-out", certificate], check=True, capture_output=True)
    names = {f"tls_{role}_{kind}" for role in ("scheduler", "worker", "client") for kind in ("key", "cert")}
    files = {name: key if name.endswith("key") else certificate for name in names}
    security = Security(require_encryption=True, tls_ca_file=certificate, **files)

    def works(scheduler):
        with open_workers(None, scheduler, "token") as pool:
            return pool.executor.submit(int, "3").result() == 3

    with local_cluster(security=security, n_workers=1, protocol="tls") as cluster:
        assert cluster.scheduler_address.startswith("tls://")
        with pytest.raises(BatchError, match="cannot connect to a Dask scheduler"):
            works(cluster.scheduler_address)
        assert works(cluster)
        with Client(cluster, set_as_default=False) as client:
            assert works(client)
            assert client.status == "running"


@pytest.mark.slow
@signals
def test_files_that_may_not_grow_end_the_run(corpus, tmp_path):
    # as full disks do, where no disk can be mounted
    driver = started(corpus / "curve000.obj", "-o", tmp_path / "out", "--workers", 1, limit_file=1500)
    _, errors = driver.communicate(timeout=120)
    assert driver.returncode == 2
    assert "File too large" in errors
    assert records(tmp_path / "out") == []
    assert len(list(tmp_path.rglob("*.obj"))) == 0


@pytest.mark.slow
@signals
def test_an_interrupt_ends_all_processes_with_one_sentence(corpus, tmp_path):
    output, many = tmp_path / "out", tmp_path / "in"
    many.mkdir()
    for number in range(200):  # so many that it is not done before it is interrupted
        shutil.copy(corpus / "curve000.obj", many / f"{number}.obj")
    driver = started(many, "-o", output, "--workers", 1)
    solvers = solvers_of(driver.pid)
    wait_until(lambda: len(records(output)) > 1)
    os.killpg(driver.pid, signal.SIGINT)  # as a terminal does it
    _, errors = driver.communicate(timeout=60)
    assert (driver.returncode, errors) == (130, "spinor-geom: interrupted\n")
    psutil.wait_procs(solvers, timeout=20)
    assert not any(process.is_running() for process in solvers)


def test_two_runs_exclude_each_other(corpus, tmp_path, capsys):
    with opened_store(tmp_path / "out", BatchOptions(), resume=False):
        for more in ([], ["--resume"]):
            assert main(["batch", str(corpus), "-o", str(tmp_path / "out"), *more]) == 2
            assert "another batch is writing to this folder" in capsys.readouterr().err
    with opened_store(tmp_path / "out", BatchOptions(), resume=True):
        pass


def test_folders_that_hold_something_are_left_alone(reference, corpus, tmp_path, capsys):
    output = str(reference.output)
    assert main(["batch", str(corpus), "-o", output]) == 2
    assert "already contains a batch" in capsys.readouterr().err
    assert main(["batch", str(corpus), "-o", output, "--resume", "--format", "ply"]) == 2
    assert "was started with other options" in capsys.readouterr().err
    assert main(["batch", str(corpus), "-o", str(corpus)]) == 2
    assert "is the output folder" in capsys.readouterr().err
    assert main(["batch", str(corpus / "roof.obj"), "-o", str(corpus)]) == 2
    assert "contains other files" in capsys.readouterr().err
    (tmp_path / "files").mkdir()
    for content in ("{", "3", "[" * 100_000):
        (tmp_path / RUN).write_text(content)
        assert main(["batch", str(corpus), "-o", str(tmp_path), "--resume"]) == 2
        assert "is damaged" in capsys.readouterr().err
    assert main(["batch", str(corpus / "nothing.obj"), "-o", str(tmp_path / "new")]) == 2
    assert "no such file" in capsys.readouterr().err


def test_faults_and_changed_files_are_done_again(corpus, tmp_path):
    (path,) = write_curves(tmp_path / "in", 1)
    with opened_store(tmp_path / "out", BatchOptions(), resume=False) as store:
        source = Source(key="a", path=str(path), size=3, modified=4)
        for status, complete in (("done", True), ("failed", True), ("fault", False)):
            store.commit(source, failure("a", "", status=status), {})
            assert (store.completed(source) is not None) == complete
            assert store.completed(Source(key="a", path=str(path), size=3, modified=5)) is None


def of_threads(count):
    return Workers(executor=ThreadPoolExecutor(count), count=lambda: count)


def test_a_million_inputs_are_taken_as_they_are_needed():
    taken = itertools.count()
    endless = (Source(key=str(number), path="", size=100) for number in taken)
    blocks = list(itertools.islice(_blocks(endless, Counter(files_total=10**6), of_threads(2)), 50))
    assert [len(block) for block in blocks] == [MOST_FILES] * 50
    assert next(taken) <= 50 * MOST_FILES + 1


def test_the_last_files_are_shared_out_evenly():
    sources = [Source(key=str(number), path="", size=100) for number in range(40)]
    blocks = list(_blocks(iter(sources), Counter(files_total=40), of_threads(4)))
    assert [source for block in blocks for source in block] == sources
    assert max(map(len, blocks)) == 5
    assert [len(block) for block in blocks[-4:]] == [1] * 4


def test_large_files_stand_alone():
    sizes = [100, MOST_BYTES + 1, MOST_BYTES + 1, 200, MOST_BYTES - 150, 30]
    sources = (Source(key=str(number), path="", size=size) for number, size in enumerate(sizes))
    found = [[source.size for source in block] for block in _blocks(sources, Counter(files_total=6), of_threads(1))]
    assert all(sum(block) <= MOST_BYTES or len(block) == 1 for block in found)
    assert [size for block in found for size in block] == sizes


def test_results_that_are_gone_are_made_again(tmp_path):
    write_curves(tmp_path / "in", 1)
    (tmp_path / "in" / "roof.obj").write_bytes(holed_text().encode())
    solved([tmp_path / "in"], tmp_path / "out")
    made = results(tmp_path / "out")
    files = [path for path in (tmp_path / "out" / "files").rglob("*.obj") if path.is_file()]
    assert "filled.obj" in {path.name for path in files}
    with opened_store(tmp_path / "out", BatchOptions(), resume=True) as store:
        sources = list(Inputs([tmp_path / "in"], output=tmp_path / "out", limits=LIMITS))
        for path in files:
            data = path.read_bytes()
            path.unlink()
            incomplete = [source for source in sources if store.completed(source) is None]
            assert [source.key for source in incomplete] == [f"in/{path.parent.name}"]
            path.write_bytes(data)
        assert all(store.completed(source) for source in sources)
    files[0].unlink()
    again = batch(tmp_path / "in", tmp_path / "out", workers=1, resume=True)
    assert (again.complete, again.progress.files_before) == (True, 1)
    assert results(tmp_path / "out") == made
