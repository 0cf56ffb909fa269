"""The text beside the picture."""

from types import SimpleNamespace

import numpy as np
import pytest

from spinor_geom.edit.panel import panel
from spinor_geom.edit.session import Preview, Session


@pytest.mark.parametrize(("found", "told"), [(0, ""), (3, "3"), (None, "unknown")])
def test_the_list_tells_patches_with_crossings_from_those_that_were_not_searched(found, told):
    session = Session([0])
    session.click(0)
    job = session.next_job()
    assert job is not None
    reach = np.zeros((2, 3))
    figures = {"area": 2.0, "intersections": found, "sentences": (), "reach": reach}
    preview = Preview(loops=(0,), chosen="film", kind="minimal", **figures)
    session.finish(job, preview)
    work = SimpleNamespace(message="", fillers=[])
    text = panel(session, work, [None], pointed=None, command="", size=(80, 40))
    (row,) = [line for line in text.splitlines() if line.startswith("0 ")]
    assert row.split() == ["0", "film", "2", *told.split()]
