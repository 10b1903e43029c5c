"""Good methods are certified; each broken one fails the question that it breaks, and no other."""

from __future__ import annotations

import json
import os
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from harness.board import conform as conforming
from harness.board import conform as left_behind
from harness.board import conform_trial as trial_worker
from harness.board.conform import ConformRequest, conform
from harness.board.conform_trial import CHECKS, Certificate, Trial
from harness.core.process.workers import WorkerDied
from harness.core.typed_json import to_json
from harness.data.manifest import load_manifest
from harness.files.mesh_files import load_mesh, save_mesh
from harness.files.obj import write_obj
from harness.run.method_choice import ChosenMethod
from harness.run.sources import Source
from harness.run.workspace import Workspace

pytestmark = pytest.mark.nightly

EXAMPLE = Path(__file__).parents[2] / "examples" / "voxel_carving"

#: A method that knows the subject, and others that are each wrong in one thing.
METHODS = """
import itertools
import os
import time
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from harness.core.artifacts import Reconstruction
from harness.core.errors import MethodError
from harness.files.mesh_files import load_mesh
from harness.core.protocols import MethodInfo, Privilege
from harness.core.results import PointCloud
from harness.geometry.images import load_rgba
from methods.points.filtering import MeshSettings
from methods.points.splats import directions

SCAN = load_mesh(Path({scan!r})).geometry()
COUNT = itertools.count()


class Good:
    def __init__(self, name):
        self.info = MethodInfo(name=name, title=name, views=(0, 4))

    def reconstruct(self, capture, context):
        for view in self.info.views:
            load_rgba(capture.image_path(view))
        return Reconstruction(self.changed(SCAN, capture, context))

    def changed(self, mesh, capture, context):
        return mesh


def wrong(name, changed):
    made = type(name, (Good,), {{"changed": lambda self, *given: changed(*given)}})(f"b-{{name}}")
    return made


def turned(*rows):
    return lambda mesh, capture, context: replace(mesh, vertices=mesh.vertices @ np.array(rows).T)


def fails(mesh, capture, context):
    raise MethodError("there is no mesh of me")


def shaken(mesh, by):
    return replace(mesh, vertices=mesh.vertices + 0.001 * (by % 7))


def peeks(mesh, capture, context):
    load_rgba(capture.image_path(1))
    return mesh


def stays(mesh, capture, context):
    if os.fork() == 0:
        time.sleep(60)
        os._exit(0)
    return mesh


def egg():
    # Points on a standing ellipsoid as large as a person, and their normals.
    ways, sizes = directions(6000), (SCAN.extent / 2) * (1, 1, 1.5)
    return SCAN.bounds.mean(axis=0) + sizes * ways, ways / sizes


class Kind(Good):
    def __init__(self, name, make, *given):
        self.info = MethodInfo(name=name, title=name, views=(0, 4), privileges=given,
                               parameters={{"mesh": asdict(MeshSettings(depth=6))}})
        self.make = make

    def reconstruct(self, capture, context):
        return self.make(capture)


def cloud_of(capture):
    return PointCloud(*egg())


def cloud_elsewhere(capture):
    points, normals = egg()
    return PointCloud(7 * points[:, [2, 0, 1]] + 3, normals[:, [2, 0, 1]])


cloud = Kind("cloud", cloud_of)
elsewhere = Kind("elsewhere", cloud_elsewhere, Privilege.OWN_FRAME)
good = Good("good")
runs = wrong("runs", fails)
metres = wrong("metres", turned((1000, 0, 0), (0, 1000, 0), (0, 0, 1000)))
place = wrong("place", lambda mesh, *_: replace(mesh, vertices=mesh.vertices + (0, 0.85, 0)))
up = wrong("up", turned((1, 0, 0), (0, 0, -1), (0, 1, 0)))
facing = wrong("facing", turned((-1, 0, 0), (0, 1, 0), (0, 0, -1)))
handedness = wrong("handedness", lambda mesh, *_: replace(
    mesh, vertices=mesh.vertices * (-1, 1, 1), faces=mesh.faces[:, ::-1]))
winding = wrong("winding", lambda mesh, *_: replace(mesh, faces=mesh.faces[:, ::-1]))
watertight = wrong("watertight", lambda mesh, *_: replace(
    mesh, faces=np.delete(mesh.faces, [200, 201], axis=0)))
repeats = wrong("repeats", lambda mesh, *_: shaken(mesh, next(COUNT)))
declared_views = wrong("declared_views", peeks)
renamed = wrong("renamed", lambda mesh, capture, _: shaken(mesh, len(str(capture.subject))))
leaves_nothing = wrong("leaves_nothing", stays)
"""
BROKEN = ("runs", "metres", "place", "up", "facing", "handedness", "winding", "watertight",
          "repeats", "declared_views", "renamed", "leaves_nothing")  # fmt: skip


@pytest.fixture(scope="module")
def odd_world(make_world, tmp_path_factory) -> Path:
    """The toy world, in which the first subject holds one arm ahead, and has a nose."""
    world = make_world(tmp_path_factory.mktemp("odd"))
    path = world / "scans/model/t1/t1.obj"
    mesh = load_mesh(path, seams=True)
    vertices = mesh.vertices.copy()
    vertices[vertices[:, 0] > 0.23] += (0.0, 0.2, 0.3)
    nose = (vertices[:, 1] > 1.35) & (vertices[:, 2] > 0.05)
    vertices[nose, 2] += 0.15
    write_obj(path, replace(mesh, vertices=vertices))
    return world


@pytest.fixture
def tried(odd_world, tmp_path_factory, monkeypatch):
    """``tried("good")``: the certificate of a method on that subject."""
    place = tmp_path_factory.mktemp("broken")
    manifest = load_manifest(odd_world / "data_manifest.yaml")
    source = Source.select(manifest, Workspace(odd_world), "toy", ("t1",), "tiny")
    save_mesh(place / "scan.ply", source.load("t1")[1].geometry())
    methods = METHODS.format(scan=str(place / "scan.ply"))
    (place / "conform_methods.py").write_text(methods)
    about = place / "conform_methods-1.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: conform-methods\nVersion: 1\n")
    points = "".join(f"b-{name} = conform_methods:{name}\n" for name in BROKEN)
    for name in ("good", "cloud", "elsewhere"):
        points += f"{name} = conform_methods:{name}\n"
    points = f"[harness.methods]\n{points}"
    (about / "entry_points.txt").write_text(points)
    monkeypatch.setenv("PYTHONPATH", str(place), prepend=os.pathsep)
    monkeypatch.syspath_prepend(place)
    monkeypatch.delitem(sys.modules, "conform_methods", raising=False)
    monkeypatch.setattr(left_behind, "_PATIENCE_S", 1.0)

    def certificate(name: str, memory_mib: float | None = None) -> Certificate:
        if name != "b-leaves_nothing":
            # The others need no process of their own to be broken.
            monkeypatch.setattr(conforming, "run_worker", in_this_process)
        method = ChosenMethod.of(name, {})
        return conform(ConformRequest(source, method, memory_mib=memory_mib), Silent())

    return certificate


def in_this_process(module: str, job: Trial, *, timeout_s: float | None, environment: dict) -> dict:
    """What a worker answers; the trial that is killed is carried out, and has no answer."""
    assert module == trial_worker.__name__
    answer = to_json(trial_worker.handle(job, lambda *_: None))
    assert list(environment) == [left_behind.MARK]
    if "killed" in job.folder.parts:
        raise WorkerDied("it was killed")
    return answer


class Silent:
    """Nobody is told."""

    def expect(self, task: str, steps: int) -> None: ...
    def done(self, task: str, steps: int = 1) -> None: ...
    def say(self, line: str) -> None: ...


def test_a_good_method_is_certified(tried):
    certificate = tried("good")
    answers = {check.id: check.answer for check in certificate.checks}
    assert certificate.conforms, certificate.checks
    assert list(answers) == list(CHECKS)
    assert [name for name, answer in answers.items() if answer != "yes"] == []
    assert len(certificate.environment_sha256) == 16


def test_points_are_asked_what_a_mesh_is_asked(tried):
    """Masks take what is beside the subject: the egg's surface is closed all the same."""
    answers = {check.id: check.answer for check in tried("cloud").checks}
    assert [answers[name] for name in ("runs", "watertight", "winding", "repeats", "renamed")] == (
        5 * ["yes"]
    )


def test_a_frame_of_its_own_is_not_asked_where_it_is(tried):
    certificate = tried("elsewhere")
    assert certificate.conforms, certificate.checks
    answers = {check.id: check.answer for check in certificate.checks}
    assert [name for name, answer in answers.items() if answer == "not asked"] == [
        *("metres", "place", "up", "facing", "handedness")
    ]


@pytest.mark.parametrize("name", BROKEN)
def test_each_broken_method_fails_its_own_question(tried, name):
    assert tried(f"b-{name}").failed == (name,)


def test_one_that_takes_too_much_fails_at_its_cost(tried):
    assert tried("good", memory_mib=1.0).failed == ("cost",)


@pytest.mark.parametrize("method", ["hull8", "voxel-carving"])
def test_our_own_are_certified(world, photographed, harness, method):
    if method == "voxel-carving":
        assert harness("methods", "add", str(EXAMPLE)).returncode == 0
    options = ("--set", "hull.voxel_m=0.02") if method == "hull8" else ()
    done = harness("conform", method, "--dataset", "toy", "--recipe", "tiny", *options)
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"It conforms. Certificate: {world}/certificates/{method}.json" in done.stdout
    stored = json.loads((world / f"certificates/{method}.json").read_text())
    assert stored["conforms"] is True
    assert stored["subject"] == "t1"
    assert stored["harness"]["python"]
    if method == "voxel-carving":
        assert stored["identity"]["parts"][1]["role"] == "environment"
