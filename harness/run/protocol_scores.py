"""The meshes of a run under further protocols: each mesh and scan is read once for all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from harness.core.errors import HarnessError, ProtocolMismatch
from harness.core.files.hashing import content_hash
from harness.core.files.npz import read_array_npz
from harness.core.protocol_scores import ProtocolScore, ProtocolScores
from harness.core.protocols import MethodInfo, Privilege
from harness.core.records import MetricValue, ProtocolStamp, Record
from harness.core.settings import MetricProtocol
from harness.core.truth import TrueBody, face_regions, true_body
from harness.files.mesh_files import load_mesh
from harness.run.progress import Progress
from harness.run.publication import BODY_FILE, MESH_FILE
from harness.run.sources import ScanSet
from harness.run.store import RunStore
from metrics.body import EMDB, BodyPose, body_numbers
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
        has_body = BODY_FILE in record.files
        if missing or (has_body and EMDB.name not in known):
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
            if has_body and (truly := true_body(scan)) is not None:
                numbers = _body_numbers(folder.directory / BODY_FILE, truly)
                known[EMDB.name] = ProtocolScore(_EMDB_STAMP, sha256, metrics=numbers)
            ProtocolScores(tuple(known.values())).save(folder.directory)
    return [known[name] for name in (*stamps, EMDB.name) if name in known]


def _body_numbers(path: Path, truth: TrueBody) -> Mapping[str, MetricValue]:
    """A fitted body against the true one; none where the two are of different models."""
    body = read_array_npz(path, ("vertices", "joints", "parameter_joint_names"))
    names = tuple(str(name) for name in body.get("parameter_joint_names", ()))
    if names != truth.joint_names or not set(_JOINTS.values()) <= set(names):
        return {}
    mine, true = (
        BodyPose({smpl: joints[names.index(anny)] for smpl, anny in _JOINTS.items()}, vertices)
        for joints, vertices in (
            (body["joints"], body["vertices"]),
            (truth.joints, truth.vertices),
        )
    )
    return body_numbers(mine, true, EMDB)


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
_SETTINGS: dict[str, object] = {
    "summary": [
        {"key": key, "unit": "mm", "higher": False} for key in ("mpjpe", "pa_mpjpe", "pve")
    ],
    "joints": _JOINTS,
    "root": list(EMDB.root),
}
_EMDB_STAMP = ProtocolStamp(EMDB.name, EMDB.version, content_hash(_SETTINGS), _SETTINGS)


def _filed(stamp: ProtocolStamp, sha256: str, score: Score | HarnessError) -> ProtocolScore:
    if isinstance(score, HarnessError):
        return ProtocolScore(stamp, sha256, reason=str(score))
    return ProtocolScore(stamp, sha256, score.alignment, score.metrics)
