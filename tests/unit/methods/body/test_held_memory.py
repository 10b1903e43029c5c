"""What a body fit leaves in memory, asked in processes of their own: both load large libraries."""

from __future__ import annotations

import subprocess
import sys

import pytest

_CALLERS_VALUES = """
import gc, weakref
from %s import %s as load

class Photo:
    pass

def caller():
    photo = Photo()
    load()
    return weakref.ref(photo)

photo = caller()
gc.collect()
print(photo() is None)
"""

_MODEL = """
import weakref
from methods.body.models.choice import (body_model, forget_body_models)

body = body_model("anny")
held = weakref.ref(body._model)
forget_body_models()
print(held() is not None)
del body
forget_body_models()
print(held() is None)
"""


@pytest.mark.parametrize(
    ("program", "said"),
    [
        (_CALLERS_VALUES % ("methods.body.photos.detection", "_detector"), ["True"]),
        (_CALLERS_VALUES % ("harness.photos.masks", "_network"), ["True"]),
        (_MODEL, ["True", "True"]),
    ],
)
def test_large_values_go_when_nobody_needs_them(program: str, said: list[str]) -> None:
    command = [sys.executable, "-c", program]
    found = subprocess.run(command, capture_output=True, check=True, text=True)
    assert found.stdout.split()[-len(said) :] == said
