"""Workers in interpreters of their own: what they are told, what they answer, how they end."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest

from harness.core.errors import DataError, Killed, MethodError, MissingPart
from methods.foreign.interpreter import Interpreter, environment_of
from methods.foreign.method_file import MANIFEST, Worker, read_worker
from methods.foreign.running import asked
from tests.unit.methods.foreign.toys import runs, until

DESCRIPTION = """\
name = "toy"
script = "worker.py"
modules = ["json", "toy_network.model"]
install = "pip install toy-network"
licence = "MIT"
"""
DOUBLES = """\
import json, os, sys
import numpy as np
from toy_network.model import factor
given = np.load(sys.argv[1], allow_pickle=False)
settings = json.loads(str(given["settings"]))
report = json.dumps({"argv": len(sys.argv), "path": os.environ.get("PYTHONPATH", "")})
np.savez(sys.argv[2], found=factor * given["a"] + settings["plus"], report=np.array(report))
"""


@pytest.fixture
def folder(tmp_path) -> Path:
    """A worker's folder."""
    place = tmp_path / "worker"
    place.mkdir()
    (place / MANIFEST).write_text(DESCRIPTION)
    (place / "worker.py").write_text(DOUBLES)
    return place


@pytest.fixture
def packages(tmp_path) -> Path:
    """What the foreign interpreter has: a namespace package, as some networks are."""
    place = tmp_path / "site"
    (place / "toy_network").mkdir(parents=True)
    (place / "toy_network" / "model.py").write_text("factor = 2.0\n")
    return place


@pytest.fixture
def foreign(tmp_path, packages) -> Interpreter:
    program = tmp_path / "python"
    program.write_text(f'#!/bin/sh\nPYTHONPATH={packages} exec {sys.executable} "$@"\n')
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    return Interpreter(program)


def test_arrays_go_there_and_back(folder, foreign):
    worker = read_worker(folder)
    answer = asked(worker, foreign, {"a": np.arange(6.0).reshape(2, 3)}, {"plus": 0.5})
    np.testing.assert_array_equal(answer.arrays["found"], 2 * np.arange(6.0).reshape(2, 3) + 0.5)
    assert set(answer.arrays) == {"found"}
    assert answer.report["argv"] == 3


def test_what_an_interpreter_has_is_found_without_importing_it(folder, foreign, packages):
    (packages / "toy_network" / "model.py").write_text("raise SystemExit('imported')\n")
    found = foreign.packages(read_worker(folder))
    assert found.python == sys.version.split()[0]
    assert Path(found.place) == packages / "toy_network"
    assert len(found.sha256) == 64


def test_another_package_has_another_digest(folder, packages):
    digests = []
    for content in ("factor = 2.0\n", "factor = 3.0\n"):
        (packages / "toy_network" / "model.py").write_text(content)
        # A path of its own, because an interpreter is asked once a process.
        other = packages.parent / f"site{len(digests)}"
        packages.rename(other)
        digests.append(Interpreter(None, (other,)).packages(read_worker(folder)).sha256)
        other.rename(packages)
    assert digests[0] != digests[1]


def test_what_is_missing_is_named_with_the_command(folder):
    with pytest.raises(MissingPart, match="no toy_network.model.*Run: pip install toy-network"):
        Interpreter(None).packages(read_worker(folder))


@pytest.mark.parametrize("program", ["gone", "broken"])
def test_an_interpreter_that_does_not_run_is_said(program, tmp_path, folder):
    path = tmp_path / program
    if program == "broken":
        path.write_text("#!/bin/sh\necho no such library >&2\nexit 3\n")
        path.chmod(0o755)
    with pytest.raises(MissingPart, match="does not run.*again with --python"):
        Interpreter(path).packages(read_worker(folder))


def test_a_foreign_interpreter_does_not_get_our_packages():
    base = {"PYTHONPATH": "/ours", "PYTHONHOME": "/other", "VIRTUAL_ENV": "/venv", "LANG": "C"}
    foreign = environment_of(Interpreter(Path("/there/python"), (Path("/there/vggt"),)), base)
    assert foreign == {"PYTHONPATH": "/there/vggt", "PYTHONSAFEPATH": "1", "LANG": "C"}
    own = environment_of(Interpreter(), base)
    assert own["PYTHONPATH"] == "/ours"
    assert "PYTHONPATH" not in environment_of(Interpreter(Path("/there/python")), base)


@pytest.mark.parametrize(
    ("program", "kind", "said"),
    [
        ("raise ValueError('of the network')", MethodError, "of the network"),
        ("os._exit(9)", MethodError, "exit status 9 and no answer"),
        ("os.kill(os.getpid(), signal.SIGSEGV)", MethodError, "signal SIGSEGV and no answer"),
        ("os.kill(os.getpid(), signal.SIGKILL)", Killed, "when memory runs out"),
    ],
)
def test_a_worker_that_dies_says_how(program, kind, said, folder, foreign):
    (folder / "worker.py").write_text(f"import os, signal\n{program}\n")
    with pytest.raises(MethodError, match=said) as died:
        asked(read_worker(folder), foreign, {}, {})
    assert died.type is kind


def test_a_refusal_is_one_sentence(folder, foreign):
    (folder / "worker.py").write_text(
        "import sys, numpy as np\nnp.savez(sys.argv[2], refusal=np.array('not with these photos'))"
    )
    with pytest.raises(MethodError, match="'toy' refused: not with these photos$"):
        asked(read_worker(folder), foreign, {}, {})


def test_nothing_is_unpickled(folder, foreign, tmp_path):
    trap = tmp_path / "trapped"
    (folder / "worker.py").write_text(
        textwrap.dedent(
            f"""
            import os, sys, numpy as np
            class Trap:
                def __reduce__(self):
                    return os.mkdir, ({str(trap)!r},)
            np.savez(sys.argv[2], found=np.array([Trap()], dtype=object))
            """
        )
    )
    with pytest.raises(DataError):
        asked(read_worker(folder), foreign, {}, {})
    assert not trap.exists()


def test_a_worker_ends_with_the_process_that_asked(folder, foreign, tmp_path):
    mark = tmp_path / "alive"
    (folder / "worker.py").write_text(
        f"import time, pathlib, os\npathlib.Path({str(mark)!r}).write_text(str(os.getpid()))\n"
        "time.sleep(60)\n"
    )
    program = (
        "import sys; from pathlib import Path; from methods.foreign.running import asked\n"
        "from methods.foreign.interpreter import Interpreter\n"
        "from methods.foreign.method_file import read_worker\n"
        f"asked(read_worker(Path({str(folder)!r})), Interpreter(), {{}}, {{}})\n"
    )
    process = subprocess.Popen([sys.executable, "-c", program], env={**os.environ})
    try:
        until(mark.exists)
        until(lambda: mark.read_text() != "")
        worker = int(mark.read_text())
        process.kill()
        process.wait()
        until(lambda: not runs(worker))
    finally:
        process.kill()
        process.wait()


WRONG = {
    "not TOML": "name = ",
    "description of a worker": 'name = "toy"\n',
    "an array at 'modules'; got str": DESCRIPTION.replace(
        '["json", "toy_network.model"]', '"json"'
    ),
    "text at 'licence'; got int": DESCRIPTION.replace('"MIT"', "3"),
    "script that is not there": DESCRIPTION.replace("worker.py", "other.py"),
    "outside the folders": DESCRIPTION.replace("worker.py", "../../other.py"),
    "unknown words": DESCRIPTION + 'command = ["{python}", "{photos}", "{request}", "{answer}"]\n',
    "does not take {answer}": DESCRIPTION + 'command = ["{python}", "{script}", "{request}"]\n',
}


@pytest.mark.parametrize("complaint", WRONG)
def test_descriptions_that_are_wrong_are_refused(complaint, folder):
    (folder / MANIFEST).write_text(WRONG[complaint])
    with pytest.raises(DataError, match=complaint):
        read_worker(folder)


def test_a_launcher_goes_before_the_interpreter(folder, foreign):
    command = (
        '["env", "X=1", "{python}", "{start}", "{parent}", "{script}", "{request}", "{answer}"]'
    )
    (folder / MANIFEST).write_text(f"{DESCRIPTION}command = {command}\n")
    worker: Worker = read_worker(folder)
    answer = asked(worker, foreign, {"a": np.ones(2)}, {"plus": 1})
    np.testing.assert_array_equal(answer.arrays["found"], [3.0, 3.0])
