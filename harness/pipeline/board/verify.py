"""``harness results verify``: every mesh is scored again; nothing that a record says is believed.

A board that only collects numbers collects mistakes. Here the mesh is what is handed in; the record
must say what anybody finds who measures that mesh.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from harness.core.errors import HarnessError, ProtocolMismatch
from harness.core.files.hashing import file_sha256
from harness.core.formats.mesh_files import load_mesh
from harness.core.records import Record
from harness.core.settings import MetricProtocol
from harness.data.manifest import Manifest
from harness.pipeline.board.entries import Entry
from harness.pipeline.board.proof import date_faults, differences
from harness.pipeline.inputs.scan_set import ScanSet
from harness.pipeline.inputs.sealed import Look, admit
from harness.pipeline.inputs.workspace import Workspace
from harness.pipeline.progress import Progress
from harness.pipeline.run.result_files import MESH_FILE
from harness.pipeline.scoring.meshes import mesh_scores
from reports.tables.selection import check_comparable, check_one_method

_TASK = "meshes scored again"
#: What is said of a subject that is not there.
NO_RECORD = "no record"


@dataclass(frozen=True, slots=True)
class Finding:
    """Something that is wrong with an entry.

    Attributes:
        entry: Method and version.
        subject: Whose result; empty where it is of all.
        what: A sentence without a full stop.
    """

    entry: str
    subject: str
    what: str

    def __str__(self) -> str:
        return f"{self.entry}{f', {self.subject}' if self.subject else ''}: {self.what}"


@dataclass(frozen=True, slots=True)
class Verification:
    """What was found in an entry.

    Attributes:
        entry: Method and version.
        scored: Subjects whose mesh was scored again.
        failed: Subjects that the record itself says have no result.
        unproven: Metrics of records that no mesh can prove, such as those of fitted bodies.
        findings: What is wrong; empty if nothing is.
    """

    entry: str
    scored: tuple[str, ...]
    failed: tuple[str, ...]
    unproven: tuple[str, ...]
    findings: tuple[Finding, ...]


@dataclass(frozen=True, slots=True)
class Truths:
    """What results are measured against.

    Attributes:
        manifest: Where datasets and protocols are described.
        workspace: Where the true surfaces are.
        complete: Dataset or split that must be complete; the records' own dataset if empty.
        reason: Why sealed subjects are looked at; needed for these only.
    """

    manifest: Manifest
    workspace: Workspace
    complete: str = ""
    reason: str = ""

    def scans(self, entry: Entry, dataset: str, progress: Progress) -> ScanSet:
        """The true surfaces for an entry of a dataset; a look at sealed ones is logged before."""
        scans = ScanSet.select(self.manifest, self.workspace, self.complete or dataset, ())
        look = Look("results handed in", scans.name, scans.subjects, self.reason, (entry.method,))
        admit(self.manifest, self.workspace, look, progress)
        return scans


def verify_entry(entry: Entry, truths: Truths, progress: Progress) -> Verification:
    """Score every mesh of an entry again, and compare with what its records say.

    Args:
        entry: What was handed in.
        truths: What it is measured against.
        progress: Hears of every mesh.

    Raises:
        HarnessError: an unknown dataset, or a sealed one without a reason.
        DataError: a true surface is not there.
    """
    return _Verifier(entry, truths, progress).verify()


@dataclass(frozen=True, slots=True)
class _Verifier:
    entry: Entry
    truths: Truths
    progress: Progress

    def verify(self) -> Verification:
        records, findings = self._read()
        scored: list[str] = []
        failed: list[str] = []
        unproven: dict[str, None] = {}
        if records:
            scans = self.truths.scans(self.entry, records[0].dataset, self.progress)
            absent = [s for s in scans.subjects if s not in self.entry.subjects()]
            findings += [self._finding(subject, NO_RECORD) for subject in absent]
            findings += self._together(records)
            self.progress.expect(_TASK, len(records))
            for record in records:
                if record.subject not in scans.subjects:
                    # Of a split, others of its dataset are left out; a board does not get them.
                    if record.subject not in scans.dataset.subjects:
                        what = f"no subject of {scans.name}"
                        findings.append(self._finding(record.subject, what))
                    continue
                findings += self._faults(record, scans, unproven)
                (scored if record.status == "ok" else failed).append(record.subject)
                self.progress.done(_TASK)
        return Verification(
            self.entry.title, tuple(scored), tuple(failed), tuple(unproven), tuple(findings)
        )

    def _finding(self, subject: str, what: str) -> Finding:
        return Finding(self.entry.title, subject, what)

    def _read(self) -> tuple[list[Record], list[Finding]]:
        """The records that can be read, and what is wrong with the others."""
        records: list[Record] = []
        findings: list[Finding] = []
        for subject in self.entry.subjects():
            try:
                if links := self.entry.links(subject):
                    findings.append(self._finding(subject, f"{links[0]} is a link, not a file"))
                else:
                    records.append(self.entry.record(subject))
            except HarnessError as error:
                findings.append(self._finding(subject, str(error)))
        datasets = sorted({record.dataset for record in records})
        if len(datasets) > 1:
            findings.append(self._finding("", f"records of {' and '.join(datasets)} in one entry"))
        return [record for record in records if record.dataset in datasets[:1]], findings

    def _together(self, records: Sequence[Record]) -> Iterator[Finding]:
        """Why no table can hold all records, if none can."""
        try:
            check_comparable(records)
            check_one_method([record for record in records if record.status == "ok"])
        except ProtocolMismatch as error:
            yield self._finding("", str(error))

    def _faults(
        self, record: Record, scans: ScanSet, unproven: dict[str, None]
    ) -> Iterator[Finding]:
        """What is wrong with one record."""
        if record.dataset != scans.name:
            yield self._finding(record.subject, f"of dataset {record.dataset}, not {scans.name}")
            return
        protocol = self.truths.manifest.protocols.get(record.protocol.name)
        if protocol is None or protocol.sha != record.protocol.sha:
            known = f"not {protocol.sha}" if protocol else "which the manifest does not have"
            yield self._finding(
                record.subject, f"measured with protocol {record.protocol.text}, {known}"
            )
            return
        for what in date_faults(record):
            yield self._finding(record.subject, what)
        if record.status != "ok":
            if record.metrics or record.regions or record.normal_maps:
                yield self._finding(record.subject, f"{record.status}, but with numbers")
            if self.entry.mesh_path(record.subject).exists():
                yield self._finding(record.subject, f"{record.status}, but with a mesh")
            return
        try:
            yield from self._mesh_faults(record, scans, protocol, unproven)
        except HarnessError as error:
            yield self._finding(record.subject, str(error))

    def _mesh_faults(
        self, record: Record, scans: ScanSet, protocol: MetricProtocol, unproven: dict[str, None]
    ) -> Iterator[Finding]:
        path = self.entry.mesh_path(record.subject)
        if not path.is_file():
            yield self._finding(record.subject, "no mesh beside its record")
            return
        sha256 = file_sha256(path)
        if sha256 != record.files.get(MESH_FILE):
            yield self._finding(
                record.subject, f"the mesh (sha256 {sha256[:12]}…) is not the one that was scored"
            )
        scan, truth = scans.load(record.subject)
        found = mesh_scores(load_mesh(path), scan, truth, protocol, misplaced="tell")
        for text in differences(record, found):
            yield self._finding(record.subject, text)
        unproven.update(dict.fromkeys(name for name in record.metrics if name not in found.metrics))
