"""The meshes of a run under further protocols: each mesh and scan is read once for all."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from harness.core.arrays import Floats
from harness.core.artifacts import Scan
from harness.core.camera_frames import ANNY_TO_WORLD
from harness.core.errors import HarnessError, ProtocolMismatch
from harness.core.files.hashing import content_hash
from harness.core.files.npz import read_array_npz
from harness.core.protocol_scores import ProtocolScore, ProtocolScores
from harness.core.protocols import MethodInfo, Privilege
from harness.core.records import ProtocolStamp, Record
from harness.core.settings import MetricProtocol
from harness.core.truth import face_regions, true_body
from harness.files.mesh_files import load_mesh
from harness.run.progress import Progress
from harness.run.publication import BODY_FILE, MESH_FILE
from harness.run.sources import ScanSet
from harness.run.store import RunStore
from metrics.body import BODY_PROTOCOLS, BodyPose, BodyProtocol, body_numbers
from metrics.score import Score, score_all


def score_protocols(
    store: RunStore,
    truth: ScanSet,
    protocols: Sequence[MetricProtocol],
    methods: Sequence[str],
    progress: Progress,
) -> dict[str, list[ProtocolScore]]:
    """The scores of the run's meshes under protocols, filed beside their records; by cell.

    What was measured before of the same mesh under the same protocol is kept. Fitted bodies are
    measured as well, where the true one is known and of the same model.

    Args:
        store: The run.
        truth: What it is measured against; its subjects count.
        protocols: Besides that of the records.
        methods: Rows of the run.
        progress: Counts the meshes.

    Raises:
        DataError: a mesh or a scan that cannot be read.
    """
    cells = [
        record
        for record in store.records()
        if record.status == "ok"
        and record.method_name in methods
        and record.subject in truth.subjects
    ]
    progress.expect("meshes under further protocols", len(cells))
    found = {}
    for record in sorted(cells, key=lambda each: each.subject):
        found[f"{record.method_name}/{record.subject}"] = _scored(store, truth, protocols, record)
        progress.done("meshes under further protocols")
    return found


def require_aligned(method: MethodInfo, protocol: MetricProtocol) -> None:
    """Nothing, if a protocol can measure what a method answers.

    Raises:
        ProtocolMismatch: an answer in a frame of its own, and nothing that aligns it.
    """
    if Privilege.OWN_FRAME in method.privileges and protocol.alignment.by == "none":
        raise ProtocolMismatch(
            f"method '{method.name}' answers in a frame of its own, and protocol "
            f"'{protocol.name}' aligns nothing",
            expected="a protocol that aligns, such as sith",
            hint=f"Run: harness eval --method {method.name} --protocol sith",
        )


def _scored(
    store: RunStore, truth: ScanSet, protocols: Sequence[MetricProtocol], record: Record
) -> list[ProtocolScore]:
    folder, sha256 = store.cell(record.method_name, record.subject), record.files[MESH_FILE]
    with folder.locked():
        there = ProtocolScores.beside(folder.directory, sha256).scores
        stamps = {protocol.name: ProtocolStamp.of(protocol) for protocol in protocols}
        known = {score.protocol.name: score for score in there}
        missing = [
            protocol
            for protocol in protocols
            if protocol.name not in known
            or known[protocol.name].protocol.sha != stamps[protocol.name].sha
        ]
        wanted = _BODY_STAMPS if BODY_FILE in record.files else {}
        bodies = [
            name
            for name, stamp in wanted.items()
            if name not in known or known[name].protocol.sha != stamp.sha
        ]
        if missing or bodies:
            mesh = load_mesh(folder.directory / MESH_FILE)
            scan, surface = truth.load(record.subject)
            regions = face_regions(scan, surface)
            scores = score_all(mesh, surface, missing, misplaced="tell", regions=regions)
            for name, score in scores.items():
                known[name] = _filed(stamps[name], sha256, score)
            for protocol in missing:
                try:
                    require_aligned(record.method, protocol)
                except ProtocolMismatch as error:
                    known[protocol.name] = _filed(stamps[protocol.name], sha256, error)
            for name in bodies:
                made = folder.directory / BODY_FILE
                known[name] = body_score(made, scan, BODY_PROTOCOLS[name], sha256)
            ProtocolScores(tuple(known.values())).save(folder.directory)
    return [known[name] for name in (*stamps, *wanted) if name in known]


def body_score(path: Path, scan: Scan, protocol: BodyProtocol, mesh_sha256: str) -> ProtocolScore:
    """A fitted body against the true one under a protocol of bodies.

    Both have to be Anny's. Where a file has no pose there are no angles, and the reason says so.

    Args:
        path: ``body.npz`` of a result.
        scan: Perhaps with a true body beside it.
        protocol: Which joints and which root.
        mesh_sha256: Of the result's mesh.

    Raises:
        DataError: a file that cannot be read.
    """
    stamp, truth = _BODY_STAMPS[protocol.name], true_body(scan)
    if truth is None:
        reason = f"the scan of '{scan.subject}' has no true body"
        return ProtocolScore(stamp, mesh_sha256, reason=reason)
    body = read_array_npz(
        path, ("vertices", "joints", "parameter_joint_names", f"parameter_{_POSE}")
    )
    names = tuple(str(name) for name in body.get("parameter_joint_names", ()))
    if names != truth.joint_names or not set(_JOINTS.values()) <= set(names):
        reason = f"{path.name} and the true body are not both Anny's: joints have other names"
        return ProtocolScore(stamp, mesh_sha256, reason=reason)
    poses = body.get(f"parameter_{_POSE}"), truth.pose
    turns = np.eye(3), truth.turn
    mine, true = (
        BodyPose(
            {smpl: joints[names.index(anny)] for smpl, anny in _JOINTS.items()},
            vertices,
            {} if pose is None else _rotations(pose, names, turn, protocol),
        )
        for joints, vertices, pose, turn in zip(
            (body["joints"], truth.joints), (body["vertices"], truth.vertices), poses, turns,
            strict=True,
        )
    )  # fmt: skip
    whose = f"the result's {path.name}", "the true body"
    lacking = [each for each, pose in zip(whose, poses, strict=True) if pose is None]
    reason = ""
    if protocol.turned and lacking:
        reason = f"no MPJAE: no {_POSE}, so no rotations, in {' and in '.join(lacking)}"
    numbers = body_numbers(mine, true, protocol)
    return ProtocolScore(stamp, mesh_sha256, metrics=numbers, reason=reason)


def _rotations(
    pose: Floats, names: Sequence[str], turn: Floats, protocol: BodyProtocol
) -> dict[str, Floats]:
    """(3, 3) by which each of a protocol's joints is turned from Anny's rest, in the world.

    Along a chain of bones the turns of Anny's ``local-ref`` follow one another.
    """
    of_bone: dict[str, Floats] = {}
    for chain in _CHAINS:
        total = np.eye(3)
        for bone in chain:
            total = total @ pose[names.index(bone), :3, :3]
            of_bone[bone] = total
    to_world = turn @ ANNY_TO_WORLD
    return {smpl: to_world @ of_bone[_JOINTS[smpl]] @ ANNY_TO_WORLD.T for smpl in protocol.turned}


_POSE = "pose_parameters"
#: Anny's joints in the places of SMPL's, by the name before the side.
_MIDDLE = {
    "pelvis": "root", "spine1": "spine04", "spine2": "spine03", "spine3": "spine02",
    "neck": "neck01", "head": "head",
}  # fmt: skip
_SIDED = {
    "hip": "upperleg01", "knee": "lowerleg01", "ankle": "foot", "foot": "toe2-1",
    "collar": "clavicle", "shoulder": "upperarm01", "elbow": "lowerarm01", "wrist": "wrist",
    "hand": "finger3-1",
}  # fmt: skip
_JOINTS = {
    **_MIDDLE,
    **{f"left_{smpl}": f"{anny}.L" for smpl, anny in _SIDED.items()},
    **{f"right_{smpl}": f"{anny}.R" for smpl, anny in _SIDED.items()},
}
_TRUNK = ("root", "spine05", "spine04", "spine03", "spine02", "spine01")
_ARM = ("clavicle", "shoulder01", "upperarm01", "upperarm02", "lowerarm01")
_LEG = ("pelvis", "upperleg01", "upperleg02", "lowerleg01")
#: Anny's bones from the root to the elbows and the knees.
_CHAINS = [
    (*start, *(f"{bone}.{side}" for bone in limb))
    for side in "LR"
    for start, limb in ((_TRUNK, _ARM), (_TRUNK[:1], _LEG))
]
#: What is not as in the publication's program.
_DIFFERS = {
    "body-emdb": "Anny's joints in the places of SMPL's, and its vertices",
    "body-3dpw14": "Anny's joints in the places of those regressed from SMPL's vertices as for "
    "Human3.6M: its head is the base of the skull, not the crown; PVE is over Anny's vertices",
}


def _stamp(protocol: BodyProtocol) -> ProtocolStamp:
    units = {"mpjpe": "mm", "pa_mpjpe": "mm", "pve": "mm", "pa_pve": "mm"}
    if protocol.turned:
        units |= {"mpjae": "deg", "pa_mpjae": "deg"}
    settings: dict[str, object] = {
        "summary": [{"key": key, "unit": unit, "higher": False} for key, unit in units.items()],
        "joints": {name: _JOINTS[name] for name in (*protocol.joints, *protocol.root)},
        "root": list(protocol.root),
        "turned": list(protocol.turned),
        "differs": _DIFFERS[protocol.name],
    }
    return ProtocolStamp(protocol.name, protocol.version, content_hash(settings), settings)


_BODY_STAMPS = {name: _stamp(protocol) for name, protocol in BODY_PROTOCOLS.items()}


def _filed(stamp: ProtocolStamp, sha256: str, score: Score | HarnessError) -> ProtocolScore:
    if isinstance(score, HarnessError):
        return ProtocolScore(stamp, sha256, reason=str(score))
    return ProtocolScore(stamp, sha256, score.alignment, score.metrics)
