"""What a camera file of another program says, in one form for all of them."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from harness.core.cameras.camera import Camera
from harness.data.captures.lens import Lens


@dataclass(frozen=True, slots=True, eq=False)
class ForeignView:
    """One photo's camera as its file has it.

    Attributes:
        image: The photo's name in the file; empty where the file names none.
        camera: The pinhole, in the file's own world axes and unit of length.
        lens: What the lens adds to it.
        mask: The mask's name in the file; empty where it names none.
    """

    image: str
    camera: Camera
    lens: Lens = field(default_factory=Lens)
    mask: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class ForeignCameras:
    """The cameras in a file of another program.

    Attributes:
        path: The file or folder.
        layout: What it is: ``nerfstudio``, ``COLMAP text``, ``COLMAP binary``, ``published`` or
            ``capture``.
        views: In the order of the file.
        in_world: Whether the file's world is ours: metres, +Y up. That is so for our own captures.
        front_yaw_deg: Where the subject faces, for a file of which the world is ours.
    """

    path: Path
    layout: str
    views: tuple[ForeignView, ...]
    in_world: bool = False
    front_yaw_deg: float = 0.0

    @property
    def is_named(self) -> bool:
        """Whether the file says which photo each camera took."""
        return all(view.image for view in self.views)
