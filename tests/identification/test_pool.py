"""The BlueROV2 beside pool runs, where a clone of the public repository is."""

import os
from pathlib import Path

import numpy as np
import pytest
from validation import pool

CLONE = os.environ.get("UVMS_DRAKE_POOL", "")


@pytest.mark.long
@pytest.mark.skipif(not CLONE, reason="UVMS_DRAKE_POOL is not the path of a clone of "
                                      "github.com/hkolano/UVMS-SysID-with-EAs")
def test_the_model_with_a_fitted_trim_is_nearer_to_the_runs_than_the_simulator_of_their_authors(
        tmp_path):
    found = pool.main([CLONE, "--compare-only", "--output", str(tmp_path)])
    authors, same, other = found.values()
    assert same[0] < 0.5 and same[1] < 0.6
    assert other[0] < 0.55 and other[1] < 0.6
    assert np.all(other < 0.4 * authors)
    assert (Path(tmp_path) / "pool_runs.png").stat().st_size > 0
