"""Tests of `uvms_drake.campaign.figures`."""



import pytest

from uvms_drake.campaign.figures import CAMPAIGN_FIGURES, make_campaign_figures
from uvms_drake.campaign.run import run_one
from uvms_drake.campaign.summary import (
    summarise_campaign,
    summarise_times,
)

pytestmark = pytest.mark.long


def test_figures_of_runs_that_all_end_alike(campaign, tmp_path):
    """Without contact the force error at the end is the same in all but rounding."""
    run = run_one(campaign, 0)
    results = [run["result"] | {"index": i, "force_error": 20.0 + 4e-15 * i,
                                "settling_time_s": None} for i in range(3)]
    summary = summarise_campaign(campaign, results)
    paths = make_campaign_figures(summary, summarise_times([run["wall"]]), tmp_path)
    assert {path.name for path in paths} == set(CAMPAIGN_FIGURES)
    assert all(path.stat().st_size > 5000 for path in paths)
