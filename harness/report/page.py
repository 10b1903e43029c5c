"""``harness report --page``: a run's records, photos and surfaces become a page of files."""

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from harness.core.errors import HarnessError
from harness.core.protocols import Privilege
from harness.core.records import Record
from harness.core.rigs import camera_yaw_deg
from harness.core.units import UNITS_RULE, Unit
from harness.data.manifest import SHAREABLE, Dataset, Manifest
from harness.geometry.images import load_rgba
from harness.report.figures import TrueSurface, measured_mesh
from harness.report.tables import every_table, in_order
from harness.run.progress import Progress
from harness.run.record_inputs import require_photos
from harness.run.sealed import Look, admit
from harness.run.sources import ScanSet, Source
from harness.run.store import RunStore
from harness.run.workspace import Workspace
from reports.page.folder import PageFolder, page_folder
from reports.page.meshes import CompactMesh, ScalarColumn, coarse_mesh
from reports.page.model import (
    TRUTH,
    Fact,
    PageMethod,
    PageModel,
    PageScalar,
    PageSubject,
    PageSurface,
    PageView,
    page_methods,
    photo_camera,
)
from reports.tables.table import Table

#: Surfaces beside the photo and the truth that a page shows at first.
_OPENING = 2
#: Rows that were given part of the answer are not what a reader wants to see first.
_ANSWERS = frozenset(
    {Privilege.ORACLE_NORMALS, Privilege.GROUND_TRUTH_MESH, Privilege.MADE_ELSEWHERE}
)


def page_lead(records: Sequence[Record], dataset: Dataset, subjects: Sequence[PageSubject]) -> str:
    """One sentence on what was measured."""
    methods = len({record.method_name for record in records})
    photos = max((len(subject.views) for subject in subjects), default=0)
    source = f"from {photos} photos each" if photos else "from photos made elsewhere"
    return (
        f"{_counted(methods, 'method')} on {_counted(len(subjects), 'subject')} of "
        f"{dataset.title[:1].lower()}{dataset.title[1:]}, reconstructed {source} and measured "
        "against the true surface."
    )


def page_facts(records: Sequence[Record], dataset: Dataset) -> tuple[Fact, ...]:
    """The lines of the page's head: data, photos, rules, programs."""
    first = records[0]
    made = [record.environment for record in records if record.environment]
    times = sorted(record.created_utc for record in records if record.created_utc)
    commits = _listed((each.commit or "")[:12] for each in made)
    facts = (
        Fact("Dataset", f"{dataset.title} ({first.dataset})"),
        Fact("Licence of the scans", dataset.licence),
        Fact("Photos", _listed(record.recipe for record in records) or "made elsewhere"),
        Fact("Metric protocol", first.protocol.text),
        Fact("Lengths", f"1 m is one {first.length_unit} (scale rule '{first.scale_rule}')"),
        Fact("Program", f"mexecon-harness {_listed(each.harness for each in made)}"),
        Fact("Commit", commits),
        Fact("Machine", _listed(f"{each.system}, {each.cpus} CPUs" for each in made)),
        Fact("Evaluated (UTC)", " to ".join(dict.fromkeys((*times[:1], *times[-1:])))),
    )
    return tuple(fact for fact in facts if fact.text)


def opening_methods(
    tables: Sequence[Table], methods: Sequence[PageMethod], shown: Collection[str]
) -> tuple[str, ...]:
    """The best methods of the geometry table that were given no part of the answer.

    By the first column, on the subjects that all of its ranked rows have, if there are such
    subjects; where no method has numbers, the first ones that are shown.
    """
    fair = {
        method.info.name for method in methods if _ANSWERS.isdisjoint(method.info.privileges)
    } & set(shown)
    geometry = next((table for table in tables if table.name == "geometry"), None)
    ranked: list[tuple[float, str]] = []
    if geometry is not None:
        column = geometry.columns[0]
        for row in geometry.rows:
            if row.method in fair and column.id in row.cells:
                mean = geometry.common_mean(row, column)
                ranked.append((row.cells[column.id].value if mean is None else mean, row.method))
    best = [method for _, method in sorted(ranked)]
    rest = [method.info.name for method in methods if method.info.name in shown]
    return tuple(dict.fromkeys((*best, *rest)))[:_OPENING]


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}{'' if count == 1 else 's'}"


def _listed(texts: Iterable[str]) -> str:
    """The different texts, sorted, with commas."""
    return ", ".join(sorted({text for text in texts if text}))


#: Distances are kept to 0.05 mm, angles to a degree: finer than any colour.
_DISTANCE_STEP_MM, _ANGLE_STEP_DEG = 0.05, 1.0
_LIMITS_MM = (5.0, 10.0, 20.0, 50.0, 100.0)
_LIMIT_PERCENTILE = 98.0
_LIMIT_DEG, _GREATEST_DEG = 60.0, 180.0
#: Numbers of a record that stand beside its surface.
_VALUES = ("chamfer", "normal_error")
_TASK = "surfaces of the page"


@dataclass(slots=True)
class SubjectWriter:
    """Writes the subjects of a page.

    Attributes:
        store: The run.
        records: Whose surfaces are shown, by method in order.
        scans: The true surfaces; its subjects are those of the page.
        photos: Where photos are; None for meshes that were made elsewhere.
        opening: Methods that are shown at first: errors of the first decide the colours' range.
        progress: Hears of every surface.
    """

    store: RunStore
    records: tuple[Record, ...]
    scans: ScanSet
    photos: Source | None
    opening: tuple[str, ...]
    progress: Progress
    _high_mm: list[float] = field(default_factory=list[float])

    def write_all(self, folder: PageFolder) -> tuple[PageSubject, ...]:
        """Write every subject, and say what was written."""
        by_subject = {subject: self._records_of(subject) for subject in self.scans.subjects}
        surfaces = sum(len(records) + 1 for records in by_subject.values())
        self.progress.expect(_TASK, surfaces)
        return tuple(self._write(folder, *item) for item in by_subject.items())

    def scalars(self) -> tuple[PageScalar, ...]:
        """What surfaces are coloured by, with limits that suit what was written."""
        unit, degree = Unit.millimetre.value, Unit.degree.value
        if self.scans.dataset.scale == UNITS_RULE:
            unit = "thousandths of a scan unit"
        # Of a middle subject: one bad surface would leave the others without colours.
        high = float(np.median(self._high_mm)) if self._high_mm else 0.0
        limit = next((limit for limit in _LIMITS_MM if high <= limit), _LIMITS_MM[-1])
        return (
            PageScalar("distance", "Distance to the truth", unit, limit, _LIMITS_MM[-1]),
            PageScalar("normal_error", "Normal error", degree, _LIMIT_DEG, _GREATEST_DEG),
        )

    def _records_of(self, subject: str) -> list[Record]:
        """Those that have a surface."""
        return [
            record for record in self.records if record.subject == subject and record.status == "ok"
        ]

    def _write(self, folder: PageFolder, subject: str, records: Sequence[Record]) -> PageSubject:
        scan, mesh = self.scans.load(subject)
        truth = TrueSurface(scan, mesh)
        surfaces = [self._write_surface(folder, record, truth) for record in records]
        coarse = coarse_mesh(mesh)
        folder.add_surface(subject, TRUTH, CompactMesh.of(mesh.geometry()), coarse)
        self.progress.done(_TASK)
        faces, has_coarse = len(mesh.faces), coarse is not None
        surfaces.append(PageSurface(TRUTH, "Truth", faces, has_coarse=has_coarse))
        classes = self.scans.dataset.classes.get(subject)
        return PageSubject(
            id=subject,
            description=f"{classes.clothing}, {classes.pose}" if classes else "",
            views=self._write_photos(folder, subject, records),
            surfaces=tuple(surfaces),
        )

    def _write_surface(self, folder: PageFolder, record: Record, truth: TrueSurface) -> PageSurface:
        found = measured_mesh(self.store, record, truth)
        columns = (
            ScalarColumn("distance", found.errors.distance_mm, _DISTANCE_STEP_MM),
            ScalarColumn("normal_error", found.errors.normal_deg, _ANGLE_STEP_DEG),
        )
        if record.method_name in self.opening[:1]:
            high = float(np.percentile(found.errors.distance_mm, _LIMIT_PERCENTILE))
            self._high_mm.append(high)
        name, coarse = record.method_name, coarse_mesh(found.mesh, columns)
        folder.add_surface(record.subject, name, CompactMesh.of(found.mesh, columns), coarse)
        self.progress.done(_TASK)
        values = {name: record.metrics[name].value for name in _VALUES if name in record.metrics}
        faces, has_coarse = len(found.mesh.faces), coarse is not None
        return PageSurface(name, record.method.title, faces, values, has_coarse)

    def _write_photos(
        self, folder: PageFolder, subject: str, records: Sequence[Record]
    ) -> tuple[PageView, ...]:
        if self.photos is None:
            return ()
        capture = self.photos.capture(subject)
        for record in records:
            require_photos(record, capture)
        cameras = [photo_camera(camera) for camera in capture.cameras]
        pictures = [load_rgba(capture.image_path(view)) for view in range(len(cameras))]
        folder.add_photos(subject, pictures, cameras)
        return tuple(
            PageView(round((camera_yaw_deg(camera) - capture.front_yaw_deg) % 360, 3), camera)
            for camera in cameras
        )


@dataclass(frozen=True, slots=True)
class PageRequest:
    """What ``harness report --page`` was asked for.

    Attributes:
        store: The run.
        directory: The folder to write; an older page there is replaced.
        methods: Rows of tables in this order; all if empty.
        subjects: Subjects that count; all that have a record if empty.
        surfaces: Methods whose surfaces can be looked at; those of ``methods`` if empty.
        include_licensed: Whether a dataset that may not be passed on is shown all the same.
        reason: Why sealed subjects are looked at; needed for these only.
    """

    store: RunStore
    directory: Path
    methods: tuple[str, ...] = ()
    subjects: tuple[str, ...] = ()
    surfaces: tuple[str, ...] = ()
    include_licensed: bool = False
    reason: str = ""


def write_page(
    request: PageRequest,
    manifest: Manifest,
    workspace: Workspace,
    progress: Progress,
    records: Sequence[Record] | None = None,
) -> Path:
    """The page's ``index.html``, written now together with everything that it shows.

    Args:
        request: What is wanted.
        manifest: Where the records' dataset is described.
        workspace: Where scans and photos lie.
        progress: Hears of every surface.
        records: Only these of the run's; all by default.

    Raises:
        HarnessError: nothing to show, a licence that does not allow it, sealed subjects without a
            reason, or a folder that holds something else.
        ProtocolMismatch: records that are not comparable.
        DataError: a scan, photo or mesh that is not there or is another one.
    """
    chosen = _chosen(request, request.store.records() if records is None else records)
    name = chosen[0].dataset
    dataset = manifest.select(name)[1]
    _check_licence(name, dataset, include=request.include_licensed)
    seen = in_order(chosen, request.surfaces)
    present = {record.subject for record in chosen}
    subjects = tuple(subject for subject in dataset.subjects if subject in present)
    recipe = next((record.recipe for record in chosen if record.recipe), "")
    shown = tuple(dict.fromkeys(record.method_name for record in seen))
    look = Look("page", name, subjects, request.reason, shown, recipe)
    admit(manifest, workspace, look, progress)
    tables, methods = every_table(chosen, request.subjects or None), page_methods(chosen)
    writer = SubjectWriter(
        store=request.store,
        records=tuple(seen),
        scans=ScanSet.select(manifest, workspace, name, subjects),
        photos=Source.select(manifest, workspace, name, subjects, recipe) if recipe else None,
        opening=opening_methods(tables, methods, shown),
        progress=progress,
    )
    with page_folder(request.directory) as folder:
        made = writer.write_all(folder)
        folder.finish(
            PageModel(
                title=request.store.directory.name,
                lead=page_lead(chosen, dataset, made),
                facts=page_facts(chosen, dataset),
                tables=tables,
                methods=methods,
                subjects=made,
                scalars=writer.scalars(),
                opening=writer.opening,
                records=tuple(chosen),
            )
        )
    return request.directory / "index.html"


def _chosen(request: PageRequest, records: Sequence[Record]) -> list[Record]:
    """The records that count, by method in order."""
    if not records:
        raise HarnessError(
            f"{request.store.directory} has no record to show", hint="Run 'harness eval' first"
        )
    ordered = in_order(records, request.methods)
    chosen = [
        record for record in ordered if not request.subjects or record.subject in request.subjects
    ]
    if missing := set(request.subjects) - {record.subject for record in chosen}:
        raise HarnessError(f"no record of {', '.join(sorted(missing))} in this run")
    return chosen


def _check_licence(name: str, dataset: Dataset, *, include: bool) -> None:
    """Refuse to put scans and photos into a folder made for sharing where that is not allowed."""
    if include or dataset.may_be_passed_on:
        return
    raise HarnessError(
        f"a page holds the scans and photos of dataset '{name}' and is made to be passed on, which "
        "their licence does not allow",
        expected=f"a licence such as {', '.join(SHAREABLE)}",
        got=dataset.licence,
        hint="For your own eyes add --include-licensed, and give the folder to nobody whom the "
        "licence does not cover",
    )
