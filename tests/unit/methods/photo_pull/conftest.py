"""The sphere that stereo's tests photograph."""

from __future__ import annotations

from tests.unit.methods.stereo.conftest import sphere
