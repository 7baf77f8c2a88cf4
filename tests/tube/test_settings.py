"""Tests of `uvms_drake.tube.estimates`."""

import pytest

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.tube.estimates import CertificateSettings, check_settings


@pytest.mark.parametrize(("key", "value"), [
    ("constant_samples", 9), ("tube_samples", 0), ("terminal_samples", -5),
    ("safety_factor", 0.99), ("seed", -1)])
def test_what_means_nothing_is_named(key, value):
    with pytest.raises(InvalidParameter) as caught:
        check_settings(CertificateSettings(**{key: value}))
    assert caught.value.key == key
