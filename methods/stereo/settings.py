"""The settings of photo-consistency, each with where its value comes from."""

from dataclasses import dataclass, field

from harness.core.errors import HarnessError

#: Samples of a window from its middle, at most: the kernels read rows of 16.
MOST_RADIUS = 7

#: Four rounds from a hull that stands off by centimetres to a surface within a millimetre. Chosen
#: on the training subject t00021; the last one leaves the mesh as it is.
_ROUNDS_M = (
    (0.045, 0.008, 0.006, 0.006),
    (0.030, 0.012, 0.004, 0.005),
    (0.015, 0.010, 0.002, 0.005),
    (0.006, 0.006, 0.0012, 0.0),
)
#: From a surface that other evidence made, which is as often inside as outside. Mostly it is within
#: a centimetre. Between the legs of a skirt its normals mislead: it stands off by up to 5 cm where
#: the cloth falls back (on the training subject t00127, whose normals are 1.0 degrees better with
#: 6 cm of search behind it than with 3), and is dented by as much where the cloth spans (on t00182,
#: 0.3 degrees better with 4 cm before it than with 1.5, and 0.11 mm in the mean of the distances to
#: and from the scan; t00022 and t00127 are as far off within 0.01 mm, and 0.3 and 0.1 degrees
#: better).
_NEAR_ROUNDS_M = (
    (0.060, 0.040, 0.006, 0.006),
    (0.030, 0.020, 0.004, 0.005),
    (0.015, 0.012, 0.002, 0.005),
    (0.006, 0.006, 0.0012, 0.0),
)


@dataclass(frozen=True, slots=True)
class MatchSettings:
    """How depth maps are searched (PatchMatch with slanted planes, Bleyer 2011).

    Attributes:
        pixel_m: Photos are made smaller until a pixel spans about this much of the subject. Half
            the resolution of ``paper8`` spans 2.25 mm: a third of its cost and, because fabric's
            fine grain is averaged, as many points.
        flatten_px: Width of the Gaussian whose local mean is taken away, pixels; longer waves are
            light and shade, which differ between views. Six pixels are wider than the window.
        radius_px: Half the window; 9 x 9 pixels are 2 cm of the subject.
        behind_m: How far behind the start surface a depth may lie. A hull stands off by up to 5 cm.
        before_m: How far before it; a start that holds the subject is hardly ever behind it.
        tries: Depths that every pixel tries first, one in each part of the range.
        rounds: How often depths spread to neighbours; a fourth time changes fewer than one depth in
            fifty.
        best_share: Weight of the better neighbour's cost, so that one occluded view does not spoil
            what the other shows.
        aside_m: How far before and behind a depth its sharpness is taken: two to three pixels'
            shift between views at 45 degrees.
        seed: Seed of the random tries.
    """

    pixel_m: float = 0.00225
    flatten_px: float = 6.0
    radius_px: int = 4
    behind_m: float = 0.05
    before_m: float = 0.008
    tries: int = 8
    rounds: int = 3
    best_share: float = 0.65
    aside_m: float = 0.006
    seed: int = 0


@dataclass(frozen=True, slots=True)
class KeepRules:
    """Which points of the depth maps are kept.

    Attributes:
        correlation: Least normalised cross-correlation of a point's own view. Right and wrong
            matches of training photos separate between 0.7 and 0.8.
        neighbour_correlation: Least of the neighbour whose map agrees.
        sharpness: Least rise of the cost a little before and behind. Stripes along the line between
            two cameras correlate at any depth.
        depth_m: How far the neighbour's depth may differ.
        angle_deg: How far its normal may.
        cell_m: Points are averaged in cells of this size, or of a pixel where that is larger.
        isolated_m: A point without six others within this distance, or within four pixels, goes.
        hands_m: Points so near to the fitted body's hands do not count: fingers are thinner than a
            window, and points on them are off by 6 to 9 mm in one case of ten.
    """

    correlation: float = 0.75
    neighbour_correlation: float = 0.65
    sharpness: float = 0.05
    depth_m: float = 0.003
    angle_deg: float = 40.0
    cell_m: float = 0.0025
    isolated_m: float = 0.008
    hands_m: float = 0.03


@dataclass(frozen=True, slots=True)
class PullRound:
    """One round of moving the surface to the points.

    Attributes:
        inward_m: How far inside the surface a point may lie.
        outward_m: How far outside.
        membrane_m: Over which length the motion is smooth.
        remesh_m: Edge of the new mesh after the round; 0 keeps the mesh.
    """

    inward_m: float
    outward_m: float
    membrane_m: float
    remesh_m: float


@dataclass(frozen=True, slots=True)
class NarrowSettings:
    """The search along the surface's normals in full resolution.

    Attributes:
        reach_m: How far to either side.
        step_m: Between two offsets.
        radius: Half the patch, in samples; 11 x 11 samples on the tangent plane.
        sample_m: Between two samples, or a pixel where that is larger: 1.1 mm is a pixel of
            ``paper8``.
        flatten_px: As of ``MatchSettings``, in pixels of the full resolution.
        correlation: Least correlation at the peak.
        margin: By how much the peak exceeds every other more than ``apart_m`` away.
        apart_m: See ``margin``; stripes have a second peak.
        agree_m: How far the offsets of two pairs of views may differ.
        membrane_m: As of ``PullRound``.
        facing: Least cosine between a vertex' normal and the direction to either view.
    """

    reach_m: float = 0.006
    step_m: float = 0.0005
    radius: int = 5
    sample_m: float = 0.0011
    flatten_px: float = 10.0
    correlation: float = 0.8
    margin: float = 0.2
    apart_m: float = 0.003
    agree_m: float = 0.0015
    membrane_m: float = 0.0012
    facing: float = 0.3


@dataclass(frozen=True, slots=True)
class DentSettings:
    """Which hollows of a start surface photos are asked about before it is pulled.

    Attributes:
        radius_m: Of a ball that does not fit in: hollows are up to twice as wide. 0 asks of none.
        step_m: Of the lattice on which they are found.
        least_m3: Smaller hollows stay; points pull those out.
    """

    radius_m: float = 0.03
    step_m: float = 0.006
    least_m3: float = 8e-6

    def __post_init__(self) -> None:
        if self.radius_m and not self.step_m <= self.radius_m <= 0.1:
            raise HarnessError(
                f"setting 'radius_m' cannot be '{self.radius_m}'",
                expected=f"0, or {self.step_m} (a step of the lattice) to 0.1 metres",
            )
        if not 0.003 <= self.step_m <= 0.02:
            raise HarnessError(
                f"setting 'step_m' cannot be '{self.step_m}'", expected="0.003 to 0.02 metres"
            )


@dataclass(frozen=True, slots=True)
class StereoSettings:
    """All of them.

    Attributes:
        match: The depth maps.
        keep: The points.
        pulls: The rounds.
        narrow: The search that finishes.
        dents: Which hollows of the start are asked about; of a start that is a hull, none.
    """

    match: MatchSettings = field(default_factory=MatchSettings)
    keep: KeepRules = field(default_factory=KeepRules)
    pulls: tuple[PullRound, ...] = tuple(PullRound(*row) for row in _ROUNDS_M)
    narrow: NarrowSettings = field(default_factory=NarrowSettings)
    dents: DentSettings | None = None

    def __post_init__(self) -> None:
        radii = self.match.radius_px, self.narrow.radius
        if self.match.tries < 1 or not 1 <= min(radii) <= max(radii) <= MOST_RADIUS:
            widest = 2 * MOST_RADIUS + 1
            raise HarnessError(
                "stereo cannot search with these settings",
                expected=f"windows of 3 x 3 to {widest} x {widest} and at least one try",
                got=str(self.match),
            )


def near_settings() -> StereoSettings:
    """Settings for a start that other evidence made, such as a fused surface.

    Dents are asked about; it is searched from 40 mm before it to 60 mm behind, and pulled in four
    rounds.
    """
    return StereoSettings(
        match=MatchSettings(behind_m=0.060, before_m=0.040),
        pulls=tuple(PullRound(*row) for row in _NEAR_ROUNDS_M),
        dents=DentSettings(),
    )
