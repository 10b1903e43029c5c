"""What a method says of itself is checked where it is said."""

from __future__ import annotations

from typing import Any

import pytest

from harness.core.errors import MethodError
from harness.core.protocols import MethodInfo


def test_parameters_without_a_room_are_refused() -> None:
    flat: Any = {"voxel_m": 0.1}

    with pytest.raises(MethodError, match="grouped by room") as caught:
        MethodInfo("mine", "Mine", parameters=flat)

    assert "'voxel_m': 0.1" in str(caught.value)
