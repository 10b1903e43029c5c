"""Content ids and seeds: equal inputs give equal ids, and different inputs give different ones."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path

_CHUNK_BYTES = 1 << 20


def canonical_json(value: object) -> str:
    """JSON text that is equal for equal values: sorted keys, no spaces, no NaN."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)


def content_hash(value: Mapping[str, object]) -> str:
    """Sixteen hexadecimal digits of the sha256 of a mapping's canonical JSON.

    Keys are part of what is hashed, so two values that swap places give another hash.
    """
    return hashlib.sha256(canonical_json(value).encode()).hexdigest()[:16]


def file_sha256(path: Path) -> str:
    """The sha256 of a file's bytes, as 64 hexadecimal digits."""
    digest = hashlib.sha256()
    with path.open("rb") as stream:
        while chunk := stream.read(_CHUNK_BYTES):
            digest.update(chunk)
    return digest.hexdigest()


def derive_seed(root_seed: int, *context: str | int) -> int:
    """A 63-bit seed for one use of randomness, from the root seed and what it is for.

    Different contexts give independent seeds, such as ``derive_seed(0, "a01", "samples")`` and
    ``derive_seed(0, "a02", "samples")``. A root seed of 0 is not special.
    """
    text = canonical_json([root_seed, *context])
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "big") >> 1
