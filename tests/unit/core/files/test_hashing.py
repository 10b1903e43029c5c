"""Content ids and seeds."""

from __future__ import annotations

import hashlib
import itertools
from pathlib import Path

import pytest

from harness.core.files.hashing import canonical_json, content_hash, derive_seed, file_sha256


def test_order_does_not_matter_names_do() -> None:
    assert content_hash({"a": 1, "b": {"c": 2, "d": 3}}) == content_hash(
        {"b": {"d": 3, "c": 2}, "a": 1}
    )
    assert content_hash({"a": 1, "b": 2}) != content_hash({"a": 2, "b": 1})
    assert content_hash({"a": [1, 2]}) != content_hash({"a": [2, 1]})
    assert content_hash({"a": 1}) != content_hash({"a": 1, "b": None})
    assert content_hash({"a": "1"}) != content_hash({"a": 1})
    assert content_hash({"a": ["b", "c"]}) != content_hash({"a": ["b,c"]})


def test_a_content_id_is_fixed_for_all_time() -> None:
    # Records on disk are found by it.
    text = rb'{"a":1,"b":[0.5,"\u00fc",null]}'
    assert content_hash({"b": [0.5, "ü", None], "a": 1}) == hashlib.sha256(text).hexdigest()[:16]
    assert content_hash({"b": [0.5, "ü", None], "a": 1}) == "65ec6facee4d6aab"


@pytest.mark.parametrize("value", [float("nan"), float("inf"), {1, 2}, b"bytes"])
def test_what_has_no_canonical_form_is_refused(value: object) -> None:
    with pytest.raises((ValueError, TypeError)):
        canonical_json({"a": value})


def test_file_sha256_is_the_files_own(tmp_path: Path) -> None:
    content = bytes(range(256)) * 10_000
    (tmp_path / "a").write_bytes(content)

    assert file_sha256(tmp_path / "a") == hashlib.sha256(content).hexdigest()


def test_seeds_differ_by_every_part_of_their_context() -> None:
    contexts: list[tuple[str | int, ...]] = [
        (), ("a01",), ("a02",), ("a01", "samples"), ("samples", "a01"), ("a01samples",),
        (0,), (1,), ("0",), ("a01", 0), ("a01", 1), ("a0", "1samples"),
    ]  # fmt: skip
    seeds = [derive_seed(root, *c) for root, c in itertools.product((0, 1, -1, 2**70), contexts)]

    assert len(set(seeds)) == len(seeds)
    assert all(0 <= seed < 2**63 for seed in seeds)


def test_zero_is_a_seed_like_any_other_and_stays_what_it_is() -> None:
    assert derive_seed(0, "a01", "samples") == derive_seed(0, "a01", "samples")
    assert derive_seed(0) != 0
    assert derive_seed(0, "a01", "samples") == 3523034152409173637
