"""What methods, renderers and metrics promise, and what a method may be given beyond pixels."""

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from harness.core.arrays import Floats
from harness.core.artifacts import Capture, Reconstruction
from harness.core.errors import MethodError
from harness.core.process.shared_work import Sharing, alone
from harness.core.results import Unmeshed
from harness.core.typed_json import to_json


class Privilege(StrEnum):
    """Something that a method is given, or knows, beyond the pixels of its photos.

    The value is what records hold.
    """

    KNOWN_CAMERAS = "known_cameras"
    FOCAL_LENGTH = "focal_length"
    EXACT_MASKS = "exact_masks"
    SUBJECT_CENTRE = "subject_centre"
    GENERATOR_PRIOR = "generator_prior"
    TRUE_BODY = "true_body"
    TRUE_NORMALS = "true_normals"
    ALIGNED = "aligned_to_the_scan"
    OWN_FRAME = "own_frame"
    ORACLE_NORMALS = "oracle_normals"
    GROUND_TRUTH_MESH = "ground_truth_mesh"
    MADE_ELSEWHERE = "made_elsewhere"

    @property
    def label(self) -> str:
        """A few words for a table's footnote."""
        return self.value.replace("_", " ")

    @property
    def sentence(self) -> str:
        """One sentence that says what is given."""
        return _SENTENCES[self]


_SENTENCES = {
    Privilege.KNOWN_CAMERAS: "The exact intrinsics and poses of the cameras are given.",
    Privilege.FOCAL_LENGTH: "The focal length of the cameras is given, and not their poses.",
    Privilege.EXACT_MASKS: "The renderer's own coverage masks are given, not estimated ones.",
    Privilege.SUBJECT_CENTRE: (
        "The distance of the middle of the scan's bounding box is given, which fixes the depth "
        "and the size that a single view, or parallel orthographic ones, cannot tell."
    ),
    Privilege.GENERATOR_PRIOR: (
        "The body model is of the family that generated the avatars, and landmark offsets, default "
        "settings or networks were learned on training avatars; this helps on generated subjects."
    ),
    Privilege.TRUE_BODY: "The body model's parameters that were fitted to the scan are given.",
    Privilege.TRUE_NORMALS: "Normals of the data set are given in place of estimated ones.",
    Privilege.ALIGNED: (
        "The result was moved or scaled onto the scan, or by its cameras onto the true ones, "
        "before it was measured."
    ),
    Privilege.OWN_FRAME: (
        "The result is in a unit and axes of its own, and is measured where the protocol's "
        "alignment moves it."
    ),
    Privilege.ORACLE_NORMALS: "The scan's own normals are rendered into the method's views.",
    Privilege.GROUND_TRUTH_MESH: "The scan itself is given.",
    Privilege.MADE_ELSEWHERE: (
        "The meshes were made outside the harness; what they were given is unknown."
    ),
}


#: Methods count views as those of a ring of so many, unless they count further.
RING = 8


def even_places(count: int, total: int) -> tuple[int, ...]:
    """``count`` of the places 0 to ``total`` - 1, from 0 on, as evenly apart as can be."""
    # A whole number of places apart where that can be; of enough places never the same one twice.
    return tuple(place * total // count for place in range(count))


@dataclass(frozen=True, slots=True)
class Part:
    """A learned or licensed ingredient of a method, as records name it.

    Attributes:
        role: What it is for, such as ``body model``.
        name: What it is, with its version.
        licence: SPDX id or the licence's name.
        sha256: Digest of its weights, where it has any.
    """

    role: str
    name: str
    licence: str
    sha256: str = ""


@dataclass(frozen=True, slots=True)
class Deviation:
    """One difference between a published method and what runs here.

    Attributes:
        what: The setting or step. ``room.setting`` names a setting of ``MethodInfo.parameters``.
        published: What the publication or its authors' code does.
        here: What this method does.
        why: The reason.
    """

    what: str
    published: str
    here: str
    why: str


@dataclass(frozen=True, slots=True)
class MethodInfo:
    """What a method says of itself before it runs.

    Attributes:
        name: The name on the command line.
        title: The name in tables.
        views: Counted from the front towards the subject's left (0 is the front, of eight 4 is the
            back), or None for all views.
        parts: Ingredients with their licences.
        privileges: What it is given beyond pixels.
        parameters: Every setting that influences the output, by the name of the room that it
            belongs to, such as ``body``, and by its own.
        deviations: Differences from the publication whose name the method carries; empty for a
            method that claims no publication.
        view_count: How many of all views it takes, as evenly apart as can be; None for those in
            ``views``.
        needs_perspective: Why it takes no orthographic photos, one sentence; empty if it does.
        trained_on: Datasets, subjects (``dataset/subject``, or a range of them as
            ``dataset/first..last``) and people (as the manifest's ``identity`` names them) that its
            networks have seen.

    Raises:
        MethodError: parameters that are not grouped by room.
    """

    name: str
    title: str
    views: tuple[int, ...] | None = None
    parts: tuple[Part, ...] = ()
    privileges: tuple[Privilege, ...] = ()
    parameters: Mapping[str, Mapping[str, object]] = field(
        default_factory=dict[str, Mapping[str, object]]
    )
    deviations: tuple[Deviation, ...] = ()
    view_count: int | None = None
    needs_perspective: str = ""
    trained_on: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        # Methods of third parties are not type-checked with ours.
        for room, own in self.parameters.items():
            if not isinstance(own, Mapping):  # pyright: ignore[reportUnnecessaryIsInstance]
                raise MethodError(
                    f"the parameters of method '{self.name}' are not grouped by room",
                    expected="settings by room, such as {'hull': {'voxel_m': 0.01}}",
                    got=f"{room!r}: {own!r}",
                )

    def views_of(self, total: int) -> tuple[int, ...]:
        """The views that the method takes of so many, counted from the front.

        Views that are not there are among them where it asks for more than there are.
        """
        if self.view_count is not None:
            return even_places(self.view_count, total)
        return tuple(range(total)) if self.views is None else self.views

    def identity(self) -> dict[str, object]:
        """What of this decides the output: everything but words for readers."""
        return {
            "name": self.name,
            "views": None if self.views is None else list(self.views),
            "parts": to_json(self.parts),
            "privileges": to_json(self.privileges),
            "parameters": {room: dict(own) for room, own in self.parameters.items()},
        }

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values, as records hold them."""
        return {
            **self.identity(),
            "title": self.title,
            "deviations": to_json(self.deviations),
            **({"trained_on": list(self.trained_on)} if self.trained_on else {}),
        }


@dataclass(frozen=True, slots=True)
class Context:
    """What the pipeline lends a method for one subject.

    Attributes:
        seed: For this method and subject; equal inputs must give equal output.
        workdir: Folder for intermediate results.
        stage: ``with context.stage("carve"):`` times a stage and watches its memory.
        privileged: What the method's declared privileges ask for, by privilege's value.
        keep: Whether intermediate results are wanted; without it nothing need be written.
        share: Makes what other methods make alike, or hands it out where one has made it.
    """

    seed: int
    workdir: Path
    stage: Callable[[str], AbstractContextManager[None]]
    privileged: Mapping[str, Any] = field(default_factory=dict[str, Any])
    keep: bool = False
    share: Sharing = alone


@runtime_checkable
class Method(Protocol):
    """Makes a clothed mesh from a capture, or what the harness makes one of."""

    info: MethodInfo

    def reconstruct(self, capture: Capture, context: Context) -> Reconstruction | Unmeshed:
        """The subject's clothed surface in metres, world frame.

        Depth maps, points or Gaussians become one by the steps of ``methods.points.surfacing``;
        settings of the method in the rooms ``align``, ``keep`` and ``mesh`` are theirs.

        Raises:
            MethodError: the capture cannot be reconstructed; the reason goes into the record.
            MissingPart: a part is not installed.
        """
        ...


@runtime_checkable
class Configurable(Protocol):
    """What a method with settings has besides; a method without any need not have it.

    It is no ``Method`` itself: asking whether a method is one would ask for its ``info``, which
    fails where a part is missing, though other settings may choose to do without that part.
    """

    def configured(self, parameters: Mapping[str, str]) -> Method:
        """The method with other settings, given as text by ``room.setting``.

        Raises:
            HarnessError: a name that is no setting, or a text that a setting cannot be.
        """
        ...


@dataclass(frozen=True, slots=True, eq=False)
class EstimatedNormals:
    """Clothed normals of one photo, on its pixels.

    Attributes:
        front, back: (H, W, 3) of the side that the photo shows and of the hidden one: x right, y
            up, z towards the viewer; 0 outside the mask.
        front_error_deg, back_error_deg: (H, W) by how much the estimator expects each to be off;
            None from one that does not say.
    """

    front: Floats
    back: Floats
    front_error_deg: Floats | None = None
    back_error_deg: Floats | None = None


class NormalEstimator(Protocol):
    """Predicts clothed normals from a photo and the body's normals."""

    def __call__(
        self, rgb: Floats, mask: Floats, body_front: Floats, body_back: Floats
    ) -> EstimatedNormals:
        """The normals of both sides.

        Args:
            rgb: (H, W, 3) sRGB in [0, 1].
            mask: (H, W) the subject's.
            body_front: (H, W, 3) unit normals of the body's near side, 0 where there is none.
            body_back: The same of its far side.
        """
        ...
