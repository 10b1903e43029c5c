"""What a page shows, as plain values: nothing here knows of files or of HTML."""

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from PIL import Image

from harness.core.arrays import Bytes
from harness.core.camera import Camera
from harness.core.protocols import MethodInfo
from harness.core.records import Record
from reports.tables.selection import select
from reports.tables.table import Table

#: The name of the true surface where others have the name of their method. No method has a slash.
TRUTH = "/truth"


@dataclass(frozen=True, slots=True)
class Fact:
    """A line of the page's head: what it is, and what it says."""

    label: str
    text: str


@dataclass(frozen=True, slots=True)
class PageScalar:
    """A number per vertex that surfaces are coloured by.

    Attributes:
        id: As in the surfaces' files.
        title: For people, without unit.
        unit: Symbol.
        limit: Value of the last colour at first.
        greatest: Largest value that the limit can be set to.
    """

    id: str
    title: str
    unit: str
    limit: float
    greatest: float


@dataclass(frozen=True, slots=True)
class PageMethod:
    """One method, with what a reader must know to compare it.

    Attributes:
        info: Its parts, privileges, settings and deviations.
        notes: What its rows of tables say in footnotes.
        competes: Whether its rows may be the best of a table.
    """

    info: MethodInfo
    notes: tuple[str, ...] = ()
    competes: bool = True


@dataclass(frozen=True, slots=True)
class PageView:
    """A photo of a subject, counted from the front.

    Attributes:
        yaw_deg: Where its camera stands, from the subject's front towards its left.
        camera: For the photo's own number of pixels.
    """

    yaw_deg: float
    camera: Camera


@dataclass(frozen=True, slots=True)
class PageSurface:
    """A surface that can be looked at.

    Attributes:
        method: Whose it is; ``TRUTH`` for the true one.
        title: For people.
        faces: How many triangles it has.
        values: Numbers of this surface by metric's id, such as ``chamfer``.
        has_coarse: Whether a coarse form of it was written, too.
    """

    method: str
    title: str
    faces: int
    values: Mapping[str, float] = field(default_factory=dict[str, float])
    has_coarse: bool = False


@dataclass(frozen=True, slots=True)
class PageSubject:
    """One subject.

    Attributes:
        id: Within the dataset.
        description: What it wears and does; empty where that is not known.
        views: Its photos; empty where there are none.
        surfaces: The true one last.
    """

    id: str
    description: str
    views: tuple[PageView, ...]
    surfaces: tuple[PageSurface, ...]


@dataclass(frozen=True, slots=True)
class PageModel:
    """Everything that a page shows, apart from photos and meshes themselves.

    Attributes:
        title: Name of the run.
        lead: One sentence on what was measured.
        facts: The head's lines.
        tables: In the order of their tabs.
        methods: In the order of the tables.
        subjects: In the order of the dataset.
        scalars: What surfaces can be coloured by; the first one at first.
        opening: Names of the surfaces that are shown at first, left to right.
        records: The records behind all numbers.
    """

    title: str
    lead: str
    facts: tuple[Fact, ...]
    tables: tuple[Table, ...]
    methods: tuple[PageMethod, ...]
    subjects: tuple[PageSubject, ...]
    scalars: tuple[PageScalar, ...]
    opening: tuple[str, ...]
    records: tuple[Record, ...]


@dataclass(frozen=True, slots=True)
class BoardModel:
    """Everything that a leaderboard shows.

    Attributes:
        title: Name of the board.
        lead: One sentence on what is on it.
        facts: The lines at its end.
        tables: In the order of their tabs; names differ.
        methods: Every row's method, in the order of the tables.
        records: The records behind all numbers.
        subjects: The subjects that a method should have.
    """

    title: str
    lead: str
    facts: tuple[Fact, ...]
    tables: tuple[Table, ...]
    methods: tuple[PageMethod, ...]
    records: tuple[Record, ...]
    subjects: tuple[str, ...]


#: The longer side of a photo on the page, in pixels; no photo is made larger.
MOST_PHOTO_PIXELS = 960
_THUMBNAIL_PIXELS = 192
_QUALITY = 86


def webp(rgba: Bytes, size: tuple[int, int]) -> bytes:
    """A photo (H, W, 4) as a WebP file of a size (width, height); equal pixels give equal bytes."""
    picture = Image.fromarray(rgba)
    if picture.size != size:
        # Premultiplied, so that the colour behind transparent pixels does not bleed into edges.
        picture = picture.convert("RGBa").resize(size, Image.Resampling.BOX).convert("RGBA")
    stream = io.BytesIO()
    picture.save(stream, format="WEBP", quality=_QUALITY, alpha_quality=90, method=3)
    return stream.getvalue()


def photo_camera(camera: Camera) -> Camera:
    """The camera of the photo as the page shows it."""
    return camera.resized(*_fitted((camera.width, camera.height), MOST_PHOTO_PIXELS))


def thumbnail(rgba: Bytes) -> bytes:
    """A small WebP of a photo."""
    height, width = rgba.shape[:2]
    return webp(rgba, _fitted((width, height), _THUMBNAIL_PIXELS))


def _fitted(size: Sequence[int], most: int) -> tuple[int, int]:
    scale = min(1.0, most / max(size))
    return max(1, round(size[0] * scale)), max(1, round(size[1] * scale))


def page_methods(records: Sequence[Record]) -> tuple[PageMethod, ...]:
    """What a reader must know of each method, in the order of the records."""
    infos = {record.method_name: record.method for record in records}
    return tuple(
        PageMethod(infos[group.method], _further(group.notes), group.competes)
        for group in select(records).groups
    )


def _further(notes: Sequence[str]) -> tuple[str, ...]:
    """The footnotes that say more than the lists of parts and privileges of the same card."""
    return tuple(note for note in notes if not note.startswith(("Given: ", "Parts: ")))
