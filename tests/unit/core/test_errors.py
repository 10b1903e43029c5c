"""The exception tree: messages, exit codes, travel."""

from __future__ import annotations

import copy
import pickle

import pytest

from harness.core import errors
from harness.core.errors import (
    DataError,
    HarnessError,
    Killed,
    MethodError,
    WriteError,
    did_you_mean,
)

CLASSES = [
    each
    for each in vars(errors).values()
    if isinstance(each, type) and each.__module__ == errors.__name__
]


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (HarnessError("it failed"), "it failed"),
        (HarnessError("it failed", got="b"), "it failed (got b)"),
        (HarnessError("it failed", expected="a", got="b"), "it failed (expected a; got b)"),
        (HarnessError("it failed", hint="Try again"), "it failed. Try again"),
        (DataError("x", expected="a", hint="Try").located("f.ply"), "f.ply: x (expected a). Try"),
    ],
)
def test_messages(error: HarnessError, message: str) -> None:
    assert str(error) == message


def test_each_class_has_its_own_exit_code_and_none_is_the_answer_no() -> None:
    # What may be told apart inside, and not by who runs a command.
    assert (Killed.exit_code, WriteError.exit_code) == (MethodError.exit_code, DataError.exit_code)
    codes = [kind.exit_code for kind in CLASSES if kind not in (Killed, WriteError)]

    assert len(set(codes)) == len(codes) == 5
    assert not {0, 1} & set(codes)


def _pickled(error: HarnessError) -> HarnessError:
    return pickle.loads(pickle.dumps(error))  # noqa: TID251 - our own bytes


@pytest.mark.parametrize("kind", CLASSES)
def test_an_error_survives_copying_and_pickling(kind: type[HarnessError]) -> None:
    error = kind("what", expected="a", got="b", hint="next")

    for twin in (copy.copy(error), _pickled(error), error.located("x")):
        assert type(twin) is kind
        assert (twin.expected, twin.got, twin.hint) == ("a", "b", "next")


def test_did_you_mean() -> None:
    assert did_you_mean("chamfr", ["chamfer", "normal"]) == "Did you mean 'chamfer'?"
    assert did_you_mean("zzz", ["b", "a"]) == "Known: a, b"
    assert did_you_mean("zzz", []) == "Known: none"
    many = did_you_mean("zzz", [f"name{i:02d}" for i in range(23)])
    assert many.endswith("name19 and 3 more")
    one_more = did_you_mean("zzz", [f"name{i:02d}" for i in range(21)])
    assert one_more.endswith("name19, name20")
