"""``harness train``: which of two networks is meant."""

from __future__ import annotations

import pytest

from harness.core.errors import HarnessError
from normal_training.learning.settings import NetworkPart
from normal_training.verb import asked_part


def test_one_flag_says_which_network_is_trained() -> None:
    assert asked_part(detail=False, both=False) is NetworkPart.FIRST
    assert asked_part(detail=True, both=False) is NetworkPart.SECOND
    assert asked_part(detail=False, both=True) is NetworkPart.BOTH
    with pytest.raises(HarnessError, match="exclude each other"):
        asked_part(detail=True, both=True)
