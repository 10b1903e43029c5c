"""The sphere that stereo's tests photograph."""

from tests.unit.methods.stereo.conftest import sphere

__all__ = ["sphere"]
