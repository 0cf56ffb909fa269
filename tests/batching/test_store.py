"""The output folder of a batch on different disks and operating systems."""

import pytest

from spinor_geom.batching.inputs import Source
from spinor_geom.batching.settings import BatchOptions
from spinor_geom.batching.store import failure, opened_store
from spinor_geom.errors import BatchError


def opened(folder):
    with opened_store(folder, BatchOptions(), resume=False) as store:
        return store


@pytest.mark.parametrize("below", [".", "deeper"])
def test_a_file_as_output_folder_is_named(tmp_path, below):
    (tmp_path / "out").write_text("a file")
    with pytest.raises(BatchError, match="is a file"):
        opened(tmp_path / "out" / below)


def test_results_of_names_that_a_disk_takes_for_the_same_do_not_replace_one_another(tmp_path):
    store = opened(tmp_path)
    first, second = (Source(key=f"in/{name}.obj", path=f"/{name}.obj") for name in "Aa")
    done = {**failure(first.key, ""), "status": "done"}
    assert store.commit(first, done, {})["status"] == "done"
    # what a disk without capitals finds under the other name
    store.folder(first.key).rename(store.folder(second.key))
    refused = store.commit(second, {**done, "source": second.key}, {})
    assert (refused["status"], "in/A.obj has the same results folder" in refused["reason"]) == ("failed", True)
    assert (store.record(second.key) or {})["source"] == first.key
    assert store.completed(second) is None
