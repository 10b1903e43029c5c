"""What every test shares."""

from __future__ import annotations

import copy
import gc
import hashlib
import importlib.util
import os
import pickle
import signal
import sys
import tempfile
from collections import Counter, OrderedDict
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType

# Before any test imports torch or Open3D: many small computations, a few cores, several workers.
os.environ.setdefault("OMP_NUM_THREADS", "1")

# A job in the background of a script starts with SIGINT ignored, and tests send it to themselves.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

import hypothesis
import numpy as np
import pytest

# Derandomised, so that a build that was green stays green until the code changes.
hypothesis.settings.register_profile("house", deadline=None, derandomize=True, max_examples=50)
hypothesis.settings.load_profile("house")


def pytest_configure(config: pytest.Config) -> None:
    """What a developer has imported, or works on, changes neither tests nor generated documents."""
    own = tempfile.TemporaryDirectory(prefix="harness-tests-")
    config.add_cleanup(own.cleanup)
    for variable in ("HARNESS_PARTS", "HARNESS_WEIGHTS"):
        os.environ[variable] = str(Path(own.name, variable.lower()))
        Path(os.environ[variable]).mkdir()
    os.environ.pop("HARNESS_WORKSPACE", None)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: object) -> object:
    """Several processes: each file's tests run in one of them, the longest files first.

    What a module makes for all its tests is then made once. Not by xdist's own groups, which have
    no effect with pytest 9.2 (pytest-xdist issue 1386).
    """
    from xdist.scheduler import LoadFileScheduling

    config.option.loadscopereorder = False  # as ordered below, instead of by number of tests
    return LoadFileScheduling(config, log)


#: The files that take longest, the longest first; what comes last leaves the other process idle.
LONG_TESTS = (
    "test_frames.py",
    "test_killed_runs.py",
    "test_stale_keys.py",
    "test_avatars_build.py",
    "test_body_fit.py",
    "test_econ_network.py",
    "test_avatars_creased_people.py",
    "test_eval.py",
    "test_clothed.py",
    "test_fusion.py",
    "test_vggt.py",
    "test_changed_inputs.py",
    "test_normal_samples.py",
    "test_fit.py",
    "test_examples.py",
    "test_kin.py",
    "test_pixie.py",
    "test_patchmatch.py",
    "test_bad_input.py",
    "test_added_methods.py",
    "test_conform.py",
    "test_soak.py",
    "test_completion.py",
    "test_avatars_wrinkles.py",
    "test_method.py",
    "test_avatars_clothes.py",
)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Nightly tests run when they are asked for: with ``-m "not slow"`` they do not, either.

    Among several processes, files come in the order of how long they take, roughly.
    """
    if "nightly" not in config.option.markexpr:
        nightly = [item for item in items if item.get_closest_marker("nightly")]
        config.hook.pytest_deselected(items=nightly)
        items[:] = [item for item in items if not item.get_closest_marker("nightly")]
    if "PYTEST_XDIST_WORKER" in os.environ:
        slow = Counter(
            item.path
            for item in items
            if item.get_closest_marker("slow") or item.get_closest_marker("nightly")
        )
        place = {name: number for number, name in enumerate(LONG_TESTS)}
        last = len(LONG_TESTS)
        items.sort(key=lambda item: (place.get(item.path.name, last), -slow[item.path]))


def pytest_collection_finish() -> None:
    """Collecting garbage no longer searches the millions of objects of imported packages."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def _patient_networks() -> Iterator[None]:
    """Among several processes, threads of onnxruntime that wait leave the cores to the others.

    By themselves they keep a core busy while they wait, a third of a network's time. The answers
    are the same.
    """
    if "PYTEST_XDIST_WORKER" not in os.environ or not importlib.util.find_spec("onnxruntime"):
        yield
        return
    import onnxruntime

    made = onnxruntime.SessionOptions

    def patient() -> onnxruntime.SessionOptions:
        options = made()
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")
        return options

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(onnxruntime, "SessionOptions", patient)
        yield


@pytest.fixture(scope="session")
def photograph():
    """``photograph(mesh, camera, colours)``: a figure in soft light from the upper left, RGBA."""

    def photo(mesh, camera, colours):
        from harness.geometry.raycast import Raycaster

        caster = Raycaster(mesh)
        fine = camera.resized(2 * camera.width, 2 * camera.height)
        hits = caster.cast(fine)
        normals = caster.normals_at(hits, fine, "camera")
        light = 0.5 + 0.5 * np.clip(normals @ np.array([-0.4, 0.5, 0.76]), 0, 1)
        colour = hits.interpolate(colours, mesh.faces) * light[..., None]
        image = np.dstack([colour, hits.mask])
        small = image.reshape(camera.height, 2, camera.width, 2, 4).mean(axis=(1, 3))
        alpha = small[..., 3:]
        small[..., :3] /= np.where(alpha > 0, alpha, 1)
        return np.round(255 * small).astype(np.uint8)

    return photo


class Answers:
    """What functions gave for arguments of the same content: the last ``most`` answers."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._known: OrderedDict[bytes, object] = OrderedDict()

    def remembering(self, function: Callable, named: Callable[..., object]) -> Callable:
        """The function, which works an answer out once; ``named`` holds all that it depends on."""

        def remembered(*arguments):
            content = pickle.dumps((function.__qualname__, named(*arguments)))
            key = hashlib.sha256(content).digest()
            if key not in self._known:
                self._known[key] = function(*arguments)
            self._known.move_to_end(key)
            while len(self._known) > self._most:
                self._known.popitem(last=False)
            return copy.deepcopy(self._known[key])

        return remembered


@pytest.fixture(scope="session")
def answers() -> Answers:
    """Some 12 MB for each answer of a network."""
    return Answers(most=32)


@pytest.fixture
def shared_fits(answers: Answers, monkeypatch: pytest.MonkeyPatch) -> None:
    """What several methods do to the very same numbers is done once for all tests that ask for it.

    Landmark fits and networks depend on their arguments alone, which are compared by content: other
    photos, other cameras or a moved world are worked out. Not for tests of repeatability. The body
    model is told by its class, which has no settings (Anny).
    """
    from methods.body import fitting
    from methods.normals.onnx_estimator import OnnxNormals

    def start_named(body, views, detections, start):
        start = {name: values.detach().numpy() for name, values in start.items()}
        return type(body).__name__, views, detections, start

    network = answers.remembering(
        OnnxNormals.__call__, lambda own, *maps: (own.part.sha256, own.training_set, maps)
    )
    monkeypatch.setattr(OnnxNormals, "__call__", network)
    for name, named in (
        ("fit_each_view", lambda body, *more: (type(body).__name__, *more)),
        ("fit_jointly", start_named),
    ):
        fit = answers.remembering(getattr(fitting, name), named)
        monkeypatch.setattr(fitting, name, fit)


@pytest.fixture(scope="session")
def published_camera_file() -> Path:
    """The cameras of the authors' public example, where a copy lies above the checkout."""
    name = "shared/data/cameras/0021_camera_parameters.json"
    found = [folder / name for folder in Path(__file__).parents if (folder / name).is_file()]
    if not found:
        pytest.skip("the published camera file is not here")
    return found[0]


@pytest.fixture(scope="session")
def stand_in() -> Callable[[str], ModuleType]:
    """``stand_in("thuman_tree")``: a module of ``tests/stand_in``, which makes files."""
    modules: dict[str, ModuleType] = {}

    def load(name: str) -> ModuleType:
        if name not in modules:
            path = Path(__file__).parent / "stand_in" / f"{name}.py"
            spec = importlib.util.spec_from_file_location(name, path)
            assert spec is not None
            assert spec.loader is not None
            modules[name] = sys.modules[name] = importlib.util.module_from_spec(spec)
            spec.loader.exec_module(modules[name])
        return modules[name]

    return load
