"""What is missing is one sentence with the command that installs it, wherever it is met."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from harness.cli import main as command_line
from harness.core import missing
from harness.core.errors import MissingPart
from harness.core.process import interrupts
from harness.core.process.registry import Registry
from harness.core.process.workers import run_worker
from harness.run import method_choice as chosen_method
from harness.run.method_choice import chosen_methods

ROOT = Path(__file__).parents[3]


def test_a_checkout_installs_from_itself_and_others_by_name(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    pinned = f"pip install -c {ROOT}/constraints.txt -e '{ROOT}[methods]'"
    assert missing.how_to_install("torch.nn") == pinned
    assert missing.how_to_install("open_normals") == f"pip install -e {ROOT}/packages/open-normals"
    monkeypatch.setattr(missing, "_CHECKOUT", tmp_path)
    assert missing.how_to_install("bpy") == "pip install 'mexecon-harness[render]'"
    assert missing.how_to_install("clothed_avatars") == "pip install clothed-avatars"
    assert missing.how_to_install("nobodys") == ""
    monkeypatch.setattr(missing.sys, "version_info", (3, 13, 0))
    assert missing.how_to_install("mediapipe").startswith("in an environment of Python 3.12, pip")
    assert missing.how_to_install("torch") == "pip install 'mexecon-harness[methods]'"


@pytest.fixture
def lacking(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A module that imports what is not there, as a worker finds it, too."""
    (tmp_path / "wants.py").write_text(
        "from harness.core.process.workers import worker_main\n"
        "def handle(job, report):\n    raise ModuleNotFoundError('no torch', name='torch')\n"
        "if __name__ == '__main__':\n    worker_main(handle)\n"
    )
    (tmp_path / "asks.py").write_text("raise ModuleNotFoundError('no torch', name='torch')\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.syspath_prepend(tmp_path)


def test_a_worker_a_registry_and_the_command_line_say_it(
    lacking: None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    told = r"needs torch, which is not installed\. Run: pip install .*\[methods\]"
    with pytest.raises(MissingPart, match=told):
        run_worker("wants", {})
    with pytest.raises(MissingPart, match=f"method 'asks' {told}"):
        Registry("method", {"asks": "asks:nothing"}).resolve("asks")

    def broken() -> int:
        raise ModuleNotFoundError("no torch", name="torch")

    monkeypatch.setattr(command_line, "_exit_code", broken)
    # Another test of this process may have been sent a signal, and others send themselves some.
    monkeypatch.setattr(interrupts, "_received", None)
    monkeypatch.setattr(command_line, "answer_signals", lambda: None)
    with pytest.raises(SystemExit) as end:
        command_line.main()
    assert end.value.code == 4
    assert capsys.readouterr().err.count("\n") == 1


def test_what_is_nobodys_extra_stays_a_defect(monkeypatch: pytest.MonkeyPatch) -> None:
    assert missing.explained(ModuleNotFoundError("no x", name="x")) is None
    assert missing.explained(ImportError("cannot import name", name="torch")) is None


def test_a_method_whose_packages_are_not_there_is_refused_before_any_work(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(chosen_method, "absent_extras", lambda modules: ["mediapipe", "torch"])
    assert [each.name for each in chosen_methods(("hull8", "gt"), {})] == ["hull8", "gt"]
    with pytest.raises(MissingPart, match="method 'mexecon8' needs mediapipe.*pip install"):
        chosen_methods(("mexecon8",), {"surface.normals": "body", "body.normals": "off"})


def test_the_core_imports_no_extra() -> None:
    """Verbs of the light core are imported without what the extras bring."""
    import subprocess

    program = (
        "import sys\n"
        f"for name in {sorted(missing._EXTRAS)}: sys.modules[name] = None\n"
        "from harness.cli.verb_list import VERBS, verb_command\n"
        "for verb in VERBS: verb_command(verb)\n"
    )
    subprocess.run([sys.executable, "-c", program], check=True)
