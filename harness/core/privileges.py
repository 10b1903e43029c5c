"""What a method may be given beyond pixels, each with one sentence that tables print."""

from __future__ import annotations

from enum import StrEnum


class Privilege(StrEnum):
    """Something that a method is given, or knows, beyond the pixels of its photos.

    The value is what records hold.
    """

    KNOWN_CAMERAS = "known_cameras"
    EXACT_MASKS = "exact_masks"
    SUBJECT_CENTRE = "subject_centre"
    GENERATOR_PRIOR = "generator_prior"
    TRUE_BODY = "true_body"
    TRUE_NORMALS = "true_normals"
    ALIGNED = "aligned_to_the_scan"
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
    Privilege.EXACT_MASKS: "The renderer's own coverage masks are given, not estimated ones.",
    Privilege.SUBJECT_CENTRE: (
        "The distance of the middle of the scan's bounding box is given, which fixes the depth "
        "and the size that a single view cannot tell."
    ),
    Privilege.GENERATOR_PRIOR: (
        "The body model is of the family that generated the avatars, and landmark offsets, default "
        "settings or networks were learned on training avatars; this helps on generated subjects."
    ),
    Privilege.TRUE_BODY: "The body model's parameters that were fitted to the scan are given.",
    Privilege.TRUE_NORMALS: "Normals of the data set are given in place of estimated ones.",
    Privilege.ALIGNED: "The result was moved or scaled onto the scan before it was measured.",
    Privilege.ORACLE_NORMALS: "The scan's own normals are rendered into the method's views.",
    Privilege.GROUND_TRUTH_MESH: "The scan itself is given.",
    Privilege.MADE_ELSEWHERE: (
        "The meshes were made outside the harness; what they were given is unknown."
    ),
}
