"""The sphere that stereo's tests photograph."""

from tests.unit.methods.stereo.conftest import sphere, textured

__all__ = ["sphere", "textured"]
