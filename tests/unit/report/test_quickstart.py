"""Which methods the quickstart runs, and what it shows of them meanwhile."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from harness.core.errors import HarnessError
from harness.data.manifest import load_manifest
from harness.report import quickstart as module
from harness.run.evaluate import EvalSummary
from harness.run.method_choice import ChosenMethod
from harness.run.plan import EvalRequest
from harness.run.progress import Silent
from harness.run.store import Outcome, RunStore
from harness.run.workspace import Workspace

GOLDEN = Path(__file__).parents[2] / "golden" / "run"
RECORD = next(each for each in RunStore(GOLDEN).records() if each.method_name == "hull8")


class Heard(Silent):
    """Keeps what is said."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def say(self, text: str) -> None:
        self.lines.append(text)


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """The methods of each request; what would be drawn of their meshes is left out."""
    requests: list[list[str]] = []

    def outcome(method: ChosenMethod) -> Outcome:
        return Outcome(replace(RECORD, method=method.info), cached=False)

    def evaluate(request: EvalRequest, progress: object) -> EvalSummary:
        requests.append([method.name for method in request.methods])
        assert len(request.source.subjects) == (1 if requests[-1] == ["mexecon+"] else 2)
        return EvalSummary(tuple(map(outcome, request.methods)))

    def write_page(*given: object) -> Path:
        raise HarnessError("no meshes")

    monkeypatch.setattr(module, "evaluate", evaluate)
    monkeypatch.setattr(module, "write_page", write_page)
    monkeypatch.setattr(module, "FIGURES", {"qualitative": write_page})
    return requests


def test_four_methods_are_run_with_a_table_after_each(tmp_path, asked):
    heard = Heard()
    result = module.quickstart(load_manifest(), Workspace(tmp_path), heard, 2)

    assert asked == [["hull8"], ["econ"], ["mexecon8"], ["mexecon+"]]
    assert [text.count("| Visual hull, 8 views") for text in heard.lines] == [1, 1, 1, 1]
    assert [text.count("MExECON+") for text in heard.lines] == [0, 0, 0, 1]
    assert result.summary.all_ok
    assert result.unavailable == ("figure qualitative: no meshes", "page: no meshes")


def test_all_methods_are_run_at_once(tmp_path, asked):
    heard = Heard()
    module.quickstart(load_manifest(), Workspace(tmp_path), heard, 2, every=True)

    (names,) = asked
    assert {*module.FIRST, "gt", "stereo8"} < {*names}
    assert "hull" not in names
    assert heard.lines == []
