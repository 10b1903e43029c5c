"""Settings of the N-view fusion, each with where its value is from."""

from dataclasses import dataclass

from harness.core.errors import HarnessError
from harness.core.settings import check_choice, check_range
from methods.normals import NormalChoice
from methods.nview.views import MOST_VIEWS


@dataclass(frozen=True, slots=True)
class FusionSettings:
    """Settings of the N-view fusion.

    Where no source is named, a value was chosen on four training subjects at ``quick8``. The
    optimum is flat there: 19 rounds, cells of 5 mm or no reweighting move the mean by at most
    0.15 mm and 0.3 degrees, but with 11 rounds two of the four do not come to rest. The last rounds
    on a finer lattice take 0.2 to 0.4 degrees off with exact normals.

    Attributes:
        views: How many of the photos are used, as evenly apart as can be; 0 uses all.
        normals: ``open`` (the network that is shipped), ``onnx``, ``body``, ``oracle`` (a
            privilege), or ``off``: outlines alone.
        normals_model: A network's file or the name of an imported one, for ``onnx``.
        resolution: Side of the working picture in pixels; ECON's is 512.
        body: ``on``, or ``off``: no body is fitted, and the surface starts from the visual hull.
        start: ``body``, the hull near the clothed body, or ``hull``.
        outlines: ``on``, or ``off``: the surface is not drawn to the outlines after the start.
        photos: ``on``, or ``off``: the surface does not follow what neighbouring photos agree on.
        rounds: Most rounds of moving the surface; it ends earlier where it rests.
        voxel_m: Step of the lattice on which the surface is made anew, and about the length of its
            edges, metres.
        fine_share: The same in the last rounds and of the result, as a share of ``voxel_m``.
        fine_rounds: How many last rounds that are: a second one gains nothing.
        margin_m: How far beyond the clothed body the hull is kept at the start, metres: MExECON
            inflates its body by as much.
        facing_power: Exponent of the cosine between a view's normal and its line of sight, as the
            weight of that normal.
        trusted_deg: A normal that its estimator expects to be off by so much counts half as much as
            an exact one; 0 lets all count alike, as they do where the estimator does not say. On
            two training subjects without photos it took 0.2 degrees off.
        disagreement_deg: Views that differ so much from the mean of all lose 63 % of their weight.
        doubt_deg: From round ``doubt_from`` on, a face that is still so far from its target gives
            half of its weight up.
        doubt_from: That round, counted from 0.
        regularity: Weight of a face's own smoothed normal where no view sees it, against 1.
        rim_m: A metre off the outline weighs as a slope of 1 over this length, metres.
        rim_reach_m: Rims are drawn to outlines that are about so near, metres.
        rim_reach_late_m: The same from round ``late_from`` on.
        late_from: That round, counted from 0.
        weak_m: A move of this length weighs as a slope of 1, metres: it fixes what nothing else
            does.
        step_m: Most that a vertex moves in a round, metres.
        deflation_rounds: In the first so many rounds, surface that contradicts all views that see
            it is moved inwards: it is the hull's phantom volume.
        deflation_m: By how much in a round, metres.
    """

    views: int = 0
    normals: str = "open"
    normals_model: str = ""
    resolution: int = 512
    body: str = "on"
    start: str = "body"
    outlines: str = "on"
    photos: str = "on"
    rounds: int = 15
    voxel_m: float = 0.006
    fine_share: float = 0.75
    fine_rounds: int = 1
    margin_m: float = 0.02
    facing_power: float = 2.0
    trusted_deg: float = 12.0
    disagreement_deg: float = 30.0
    doubt_deg: float = 30.0
    doubt_from: int = 4
    regularity: float = 0.15
    rim_m: float = 0.006
    rim_reach_m: float = 0.03
    rim_reach_late_m: float = 0.01
    late_from: int = 6
    weak_m: float = 0.5
    step_m: float = 0.012
    deflation_rounds: int = 6
    deflation_m: float = 0.01

    def __post_init__(self) -> None:
        check_choice("normals", self.normals, ("open", "onnx", "body", "oracle", "off"))
        check_choice("body", self.body, ("on", "off"))
        check_choice("start", self.start, ("body", "hull"))
        check_choice("outlines", self.outlines, ("on", "off"))
        check_choice("photos", self.photos, ("on", "off"))
        for name, low, high, unit in (
            ("views", 0, MOST_VIEWS, "views"),
            ("resolution", 64, 4096, "pixels"),
            ("rounds", 0, 100, "rounds"),
            ("fine_share", 0.2, 1.0, "times voxel_m"),
            ("voxel_m", 0.002, 0.05, "metres"),
            ("margin_m", 0.0, 0.2, "metres"),
            ("trusted_deg", 0.0, 180.0, "degrees"),
        ):
            check_range(name, getattr(self, name), low, high, unit)
        if self.normals == "body" and self.body == "off":
            raise HarnessError(
                "setting 'normals' cannot be 'body' where setting 'body' is 'off'",
                hint="Use normals=open, or fit the body",
            )
        # Refuses settings that do not go together before anything runs.
        _ = self.normal_choice

    @property
    def normal_choice(self) -> NormalChoice | None:
        """Which estimator runs; None where normals are off."""
        return NormalChoice.unless_off(self.normals, self.normals_model)

    @property
    def starts_at_body(self) -> bool:
        """Whether the surface starts near the clothed body."""
        return self.body == "on" and self.start == "body"

    @property
    def fine_m(self) -> float:
        """Step of the finer lattice, metres."""
        return self.fine_share * self.voxel_m

    def remade_step_m(self, number: int) -> float | None:
        """Step of the lattice on which the surface is made anew after a round, counted from 0.

        None where it is not. After the last round it always is, whatever this says.
        """
        first_fine = self.rounds - self.fine_rounds
        if number + 1 == first_fine:
            return self.fine_m
        return self.voxel_m if number % 2 == 1 and number < first_fine else None
