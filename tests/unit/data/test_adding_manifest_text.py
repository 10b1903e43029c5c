"""A dataset is written into a manifest's text: all that stood there stays, to the letter."""

from __future__ import annotations

from pathlib import Path

import pytest

from harness.core.errors import DataError, HarnessError
from harness.data.manifest import Dataset, load_manifest
from harness.run.add_dataset import MARK, check_addable, with_dataset

SHIPPED = (Path(__file__).parents[3] / "data_manifest.yaml").read_text()


def entry(**changes) -> Dataset:
    values = {
        "title": 'A "title": with # signs', "kind": "scans", "licence": "own", "root": "data/x",
        "scale": "metres", "facing": "+z", "subjects": ("0001", "a", "1e3", "no"), **changes,
    }  # fmt: skip
    return Dataset(**values)


def read(tmp_path, text) -> dict[str, Dataset]:
    path = tmp_path / "m.yaml"
    path.write_bytes(text.encode())
    return load_manifest(path).datasets


def test_nothing_that_stood_there_is_touched(tmp_path):
    text = with_dataset(SHIPPED, "mine", entry(), replace=False)
    before, after = SHIPPED.splitlines(), text.splitlines()
    start = next(k for k, line in enumerate(after) if MARK in line)
    added = len(after) - len(before)
    assert [*after[: start - 1], *after[start - 1 + added :]] == before
    found = read(tmp_path, text)
    assert found["mine"] == entry()
    assert list(found)[-1] == "mine"


@pytest.mark.parametrize(
    "changes",
    [
        {"facing": {"0001": 90.0, "a": -12.5, "1e3": 1e-7, "no": 0.0}},
        {"facing": "fit", "scale": "fit", "kind": "thuman"},
        {"kind": "captures", "subjects": ()},
        {"subjects": tuple(f"{k:05d}" for k in range(400))},
        {"root": "/a folder/with: colon", "title": "ähnlich, 人"},
        {"title": "null", "licence": "1.0"},
    ],
)
def test_every_value_reads_back(tmp_path, changes):
    text = with_dataset(SHIPPED, "mine", entry(**changes), replace=False)
    assert read(tmp_path, text)["mine"] == entry(**changes)
    assert max(map(len, text.splitlines())) < 140


def test_line_ends_of_another_system_stay(tmp_path):
    text = with_dataset(SHIPPED.replace("\n", "\r\n"), "mine", entry(), replace=False)
    assert text.count("\n") == text.count("\r\n")
    assert read(tmp_path, text)["mine"] == entry()


def test_an_entry_with_comments_below_and_no_line_after_it(tmp_path):
    text = SHIPPED[: SHIPPED.index("  avatars-scanned:")].rstrip() + "\n    # sealed: true\n"
    rest = SHIPPED[SHIPPED.index("rigs:") :]
    whole = rest + text[text.index("datasets:") :] + "# the end"
    whole = "schema: 1\n" + whole
    found = with_dataset(whole, "mine", entry(), replace=False)
    assert found.index("# sealed: true") < found.index(MARK) < found.index("# the end")
    assert read(tmp_path, found)["mine"] == entry()


def test_only_entries_that_were_written_here_are_replaced(tmp_path):
    text = with_dataset(SHIPPED, "mine", entry(), replace=False)
    text = with_dataset(text, "other", entry(), replace=False)
    with pytest.raises(HarnessError, match="already.*--replace"):
        check_addable(text, "mine", replace=False)
    check_addable(text, "mine", replace=True)
    new = with_dataset(text, "mine", entry(subjects=("b",)), replace=True)
    found = read(tmp_path, new)
    assert found["mine"].subjects == ("b",)
    assert list(found)[-2:] == ["mine", "other"]
    # Back to what it was, to the letter.
    assert with_dataset(new, "mine", entry(), replace=True) == text
    with pytest.raises(HarnessError, match="did not write"):
        with_dataset(text, "avatars", entry(), replace=True)


def test_datasets_in_braces_are_refused():
    text = "schema: 1\ndatasets: {a: {title: b}}\n"
    with pytest.raises(DataError, match="one below the other"):
        with_dataset(text, "mine", entry(), replace=False)
