"""Every interval is one of 95 %."""

import pytest

from plumbline.optim.core.constants import SIDES
from plumbline.optim.core.quantities import Share


def test_a_share_has_wilson_s_interval_of_95_percent():
    """Five of ten: 0.237 to 0.763 (Wilson 1927, JASA 22)."""
    share = Share.count_of(5, 10)
    assert share.low == pytest.approx(0.2366, abs=1e-4)
    assert share.high == pytest.approx(0.7634, abs=1e-4)
    assert (pytest.approx(0.025), pytest.approx(0.975)) == SIDES
