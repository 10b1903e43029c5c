"""One method on one subject: the privileged data it is given, and how its result is scored.

All of this decides a record's numbers, and the code that it imports counts in every record's key.
Code that only plans, files or times a run therefore does not belong here.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from harness.core.artifacts import Capture, Reconstruction, Scan
from harness.core.files.hashing import derive_seed
from harness.core.mesh import Mesh
from harness.core.process.shared_work import Sharing, alone
from harness.core.protocols import MethodInfo, Privilege
from harness.core.records import Scores
from harness.core.settings import MetricProtocol
from harness.core.truth import TrueBody, face_regions, true_body
from harness.run.body_scores import body_errors
from harness.run.mesh_scores import mesh_scores
from harness.run.normal_scores import normal_map_errors
from harness.run.oracle_normals import OracleNormals


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """What a result is compared with.

    Attributes:
        scan: The scan's files; its labels have been read once.
        mesh: The scan's surface, world metres.
        body: The true body, where the dataset has it.
    """

    scan: Scan
    mesh: Mesh
    body: TrueBody | None

    @classmethod
    def read(cls, scan: Scan, mesh: Mesh) -> Truth:
        """The truths beside a scan.

        Raises:
            DataError: a body or labels that cannot be read or are not the scan's.
        """
        face_regions(scan, mesh)
        return cls(scan, mesh, true_body(scan))


def seed_for(root_seed: int, method: str, subject: str) -> int:
    """The seed of a method of the catalogue on a subject, whatever its settings."""
    return derive_seed(root_seed, method, subject)


def lent_to(method: MethodInfo, capture: Capture, truth: Mesh) -> dict[str, object]:
    """What the method's declared privileges entitle it to, and nothing else."""
    lent: dict[str, object] = {}
    if Privilege.GROUND_TRUTH_MESH in method.privileges:
        lent[Privilege.GROUND_TRUTH_MESH] = truth.geometry()
    if Privilege.SUBJECT_CENTRE in method.privileges:
        lent[Privilege.SUBJECT_CENTRE] = truth.bounds.mean(axis=0)
    if Privilege.ORACLE_NORMALS in method.privileges:
        views = method.views or range(len(capture.cameras))
        lent[Privilege.ORACLE_NORMALS] = OracleNormals(
            truth, [capture.cameras[view] for view in views]
        )
    return lent


def scores_of(
    result: Reconstruction,
    capture: Capture,
    truth: Truth,
    protocol: MetricProtocol,
    share: Sharing = alone,
) -> Scores:
    """The numbers of a result under a protocol.

    Args:
        result: What a method made.
        capture: The photos that it was made from.
        truth: What it is compared with.
        protocol: How.
        share: Makes what scores of several methods need alike, or hands it out.

    Raises:
        DataError: one that cannot be compared.
        MissingPart: a body cannot be scored without MediaPipe.
    """
    # As it is filed: without texture coordinates, whose seams could split its normals. And however
    # large or far away: it is what the method made.
    mesh = result.mesh.geometry()
    scores = mesh_scores(mesh, truth.scan, truth.mesh, protocol, misplaced="tell")
    if result.body:
        errors = body_errors(result.body, capture, truth.mesh, truth.body, share)
        scores = replace(scores, metrics={**scores.metrics, **errors.by_id()})
    if result.normals:
        maps = normal_map_errors(result.normals, truth.scan, truth.mesh)
        scores = replace(scores, normal_maps=maps)
    return scores
