"""All errata, which take some seconds."""

import pytest

from uvms_drake.papers.nikou2018.errata import all_errata


@pytest.fixture(scope="session")
def errata():
    return all_errata()
