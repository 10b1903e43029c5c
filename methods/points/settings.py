"""The settings that all sources of points share."""

from __future__ import annotations

from dataclasses import dataclass

from harness.core.settings import check_choice, check_range
from methods.points.alignment import ALIGNMENTS


@dataclass(frozen=True, slots=True)
class AlignSettings:
    """How a source's world becomes the harness's.

    Attributes:
        mode: One of ``ALIGNMENTS``; it is printed in the method's title.
    """

    mode: str = "sim3_cameras"

    def __post_init__(self) -> None:
        check_choice("mode", self.mode, ALIGNMENTS)


@dataclass(frozen=True, slots=True)
class KeepSettings:
    """Which pixels of the depth maps become points, in the order of the steps.

    Attributes:
        erode_px: The mask loses so many pixels of the picture at its rim, where depth maps run over
            from the subject to the background.
        edge: A pixel goes whose depth differs from a neighbour's by more than this share of it:
            3 cm at 3 m, which a surface has only where it is seen at less than 8 degrees.
        drop_share: So many of a view's least confident pixels go; 0.2 is what VGGT's author
            advises. A source without confidences loses none.
        consistency_m: A point goes where more views contradict it than confirm it: where it is
            beside their mask, or before their surface by more than this. 0 turns the step off.
        outlier_neighbours: A point is compared with so many nearest ones.
        outlier_spacing: It goes where its mean distance to them is above so many times the distance
            of neighbouring pixels on a surface like its own. 0 turns the step off. The usual rule,
            a distance far above the mean of all, takes what only one view sees: on an avatar's
            true depth it made hands 2.6 mm worse instead of 0.3.
        normal_px: Half the window in which a pixel's normal is fitted.
    """

    erode_px: int = 1
    edge: float = 0.01
    drop_share: float = 0.2
    consistency_m: float = 0.02
    outlier_neighbours: int = 16
    outlier_spacing: float = 4.0
    normal_px: int = 2

    def __post_init__(self) -> None:
        check_range("erode_px", self.erode_px, 0, 50)
        check_range("edge", self.edge, 1e-4, 10.0)
        check_range("drop_share", self.drop_share, 0.0, 0.95)
        check_range("consistency_m", self.consistency_m, 0.0, 10.0)
        check_range("outlier_neighbours", self.outlier_neighbours, 2, 200)
        check_range("outlier_spacing", self.outlier_spacing, 0.0, 1000.0)
        check_range("normal_px", self.normal_px, 1, 20)


@dataclass(frozen=True, slots=True)
class MeshSettings:
    """How points become a surface.

    Attributes:
        cell_m: Points that face the same way are averaged in cells of this size; 0 keeps all.
        depth: Depth of the octree of the screened Poisson reconstruction; at 9 a finest cell is
            4.4 mm on a standing adult.
        silhouettes: ``held`` presses what bulges beyond a mask back to its outline; ``ignored`` is
            the plain way.
        trim: The surface loses this share of its vertices, those with the fewest points around. It
            is open then; 0 leaves it closed. With ``--keep`` both are written.
    """

    cell_m: float = 0.002
    depth: int = 9
    silhouettes: str = "ignored"
    trim: float = 0.0

    def __post_init__(self) -> None:
        check_range("cell_m", self.cell_m, 0.0, 0.1)
        check_range("depth", self.depth, 4, 12)
        check_choice("silhouettes", self.silhouettes, ("ignored", "held"))
        check_range("trim", self.trim, 0.0, 0.9)
