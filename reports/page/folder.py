"""A page becomes a folder that can be copied anywhere and opened from there."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

from harness.core.arrays import Bytes
from harness.core.camera import Camera
from harness.core.errors import HarnessError
from harness.core.files.atomic import atomic_directory, write_json
from harness.core.records import Record
from reports.page.data_script import (
    board_script,
    coarse_path,
    coarse_script,
    data_script,
    photos_path,
    photos_script,
    surface_path,
    surface_script,
    thumbnail_path,
)
from reports.page.document import (
    RESULT_SECTIONS,
    SCRIPTS,
    PageFrame,
    about_html,
    failures_section,
    page_html,
    record_path,
    results_html,
)
from reports.page.meshes import COMPACT_VERSION, CompactMesh
from reports.page.model import BoardModel, PageModel, thumbnail, webp

#: The page's own scripts in the order in which they are loaded; the data come after the first.
BOARD_SCRIPTS = ("page.js", "tables.js")


def board_html(model: BoardModel) -> str:
    """The document; it is complete before any script runs."""
    first, *others = (f"web/{name}" for name in BOARD_SCRIPTS)
    frame = PageFrame(model.title, model.lead, (first, "data.js", *others), RESULT_SECTIONS)
    return frame.html(
        "\n".join(
            [
                results_html(model.tables, model.methods),
                failures_section(model.records, model.subjects),
                about_html(model.facts, "This page loads nothing from a network."),
            ]
        )
    )


#: Says that a folder is a page, which may be replaced by a newer one.
MARK_FILE = "page.json"
_STYLE = "page.css"
_SHIPPED = (*SCRIPTS, _STYLE, "three.js", "three.LICENSE.txt")


@dataclass(frozen=True, slots=True)
class PageFolder:
    """A page that is being written, one large file after the other.

    Attributes:
        directory: Where its files go for now.
    """

    directory: Path

    def add_surface(
        self, subject: str, method: str, mesh: CompactMesh, coarse: CompactMesh | None = None
    ) -> None:
        """Write one surface, and its coarse form if it has one."""
        self._write(surface_path(subject, method), surface_script(subject, method, mesh))
        if coarse is not None:
            self._write(coarse_path(subject, method), coarse_script(subject, method, coarse))

    def add_photos(self, subject: str, photos: Sequence[Bytes], cameras: Sequence[Camera]) -> None:
        """Write the photos of a subject, the frontal one first.

        Args:
            subject: Its id.
            photos: (H, W, 4) each.
            cameras: Theirs, at the size that the page shows.
        """
        pictures = [
            webp(rgba, (camera.width, camera.height))
            for rgba, camera in zip(photos, cameras, strict=True)
        ]
        self._write(photos_path(subject), photos_script(subject, pictures))
        (self.directory / thumbnail_path(subject)).write_bytes(thumbnail(photos[0]))

    def add_records(self, records: Sequence[Record]) -> None:
        """Write the records that stand behind the numbers."""
        for record in records:
            record.save(self.directory / record_path(record))

    def add_record(self, shown: Record, original: Record) -> None:
        """Write a record as it was handed in, where the page looks for the one that it shows."""
        original.save(self.directory / record_path(shown))

    def finish(self, model: PageModel) -> None:
        """Write the document, its data, and what every page is shipped with."""
        self.add_records(model.records)
        self._write("data.js", data_script(model))
        self._write("index.html", page_html(model))
        self._finish(model.title, _SHIPPED)

    def finish_board(self, model: BoardModel) -> None:
        """Write a leaderboard instead; ``add_record`` wrote its records."""
        self._write("data.js", board_script(model))
        self._write("index.html", board_html(model))
        self._finish(model.title, (*BOARD_SCRIPTS, _STYLE))

    def _finish(self, title: str, shipped: Sequence[str]) -> None:
        web = files("reports.page") / "web"
        for name in shipped:
            self._write(f"web/{name}", (web / name).read_text(encoding="utf-8"))
        write_json(self.directory / MARK_FILE, {"page": title, "meshes": COMPACT_VERSION})

    def _write(self, name: str, text: str) -> None:
        # The folder as a whole is written atomically.
        path = self.directory / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")


@contextmanager
def page_folder(path: Path) -> Iterator[PageFolder]:
    """A page that takes the place of ``path`` as a whole when the block succeeds.

    Raises:
        HarnessError: there is something at ``path`` that is no page; it is left alone.
        DataError: a full disk or a missing right.
    """
    if path.exists() and not _is_replaceable(path):
        raise HarnessError(
            f"{path} is not empty and is no page",
            hint="Name a new folder: a page replaces its folder as a whole",
        )
    with atomic_directory(path) as temporary:
        yield PageFolder(temporary)


def _is_replaceable(path: Path) -> bool:
    return path.is_dir() and ((path / MARK_FILE).is_file() or not any(path.iterdir()))
