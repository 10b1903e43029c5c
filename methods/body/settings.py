"""Settings of a body fit: which body, how far the fit goes, and the weights of its cost."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Literal

from harness.core.arrays import Mask
from harness.core.artifacts import Body
from harness.core.errors import HarnessError
from harness.core.mesh import Mesh
from harness.core.settings import check_choice, check_range
from methods.body.fit.weights import Weights


@dataclass(frozen=True, slots=True)
class FitSettings(Weights):
    """Settings of a body fit; those of ``Weights`` and these.

    Attributes:
        model: The body model, ``anny`` or ``smplx``.
        model_file: The user's own SMPL-X model, for ``smplx``: a file, which has a slash or ends in
            .npz or .pkl, or the name of an imported one; empty is the imported neutral one, and for
            the start ``pixie`` SMPLX_NEUTRAL_2020 where it is imported.
        stage: How far the fit goes: ``front``, ``average``, ``landmarks`` or ``jmbo``.
        start: What JMBO starts from: ``average``, the mean of bodies that are fitted to the
            landmarks of each view; ``pixie``, the mean of those that PIXIE regresses from each view
            (the paper), which wants the model ``smplx`` and keeps the face and the hands that PIXIE
            sees in the first view; or ``landmarks``, one body fitted to the
            landmarks of all views, which also finds views with left and right exchanged.
        normals: What the normal term compares the body with: ``off``; ``open``, the network that is
            shipped; ``econ``, ECON's own, which the user imported; ``onnx``; or ``oracle``,
            rendered from the scan, a privilege.
        normals_model: A network's file or the name of an imported one, for ``onnx``.
        depth: What tells a single view how far away the subject is: ``height-prior``, how tall the
            body model takes people to be, or ``subject-centre``, a privilege.
        subject_px: Longer side of the subject in the pictures that the fit works on.
    """

    model: str = "anny"
    model_file: str = ""
    stage: str = "jmbo"
    start: str = "average"
    normals: str = "open"
    normals_model: str = ""
    depth: str = "height-prior"
    subject_px: int = 256

    def __post_init__(self) -> None:
        Weights.__post_init__(self)
        for name, known in (
            ("model", ("anny", "smplx")),
            ("stage", ("front", "average", "landmarks", "jmbo")),
            ("start", ("average", "landmarks", "pixie")),
            ("normals", ("off", "open", "econ", "onnx", "oracle")),
            ("depth", ("height-prior", "subject-centre")),
        ):
            check_choice(name, getattr(self, name), known)
        check_range("subject_px", self.subject_px, 32, 2048, "pixels")
        if self.uses_pixie and self.model != "smplx":
            raise HarnessError(
                f"setting 'start' cannot be 'pixie' where setting 'model' is '{self.model}'",
                hint="PIXIE regresses SMPL-X: --set body.model=smplx",
            )

    @property
    def uses_pixie(self) -> bool:
        """Whether PIXIE regresses the first body of each view."""
        return self.start == "pixie"

    @property
    def compares_normals(self) -> bool:
        """Whether the normal term counts."""
        return self.stage == "jmbo" and self.normal > 0 and self.normals != "off"

    @property
    def wants_network(self) -> bool:
        """Whether a normal network is run."""
        return self.compares_normals and self.normals in ("open", "econ", "onnx")

    @property
    def uses_oracle(self) -> bool:
        """Whether the scan's normals are asked for, which is a privilege."""
        return self.compares_normals and self.normals == "oracle"

    def in_use(self, views: int) -> dict[str, object]:
        """The settings that a fit to so many views depends on, by name."""
        unused = set[str]() if self.stage == "jmbo" else {field.name for field in fields(Weights)}
        if self.stage != "jmbo":
            unused |= {"normals", "normals_model"}
            if not self.uses_pixie:
                unused.add("start")
        if views > 1:
            unused.add("depth")
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        values["model_file"] = bool(self.model_file)
        values["normals_model"] = bool(self.normals_model)
        return {name: value for name, value in values.items() if name not in unused}


@dataclass(frozen=True, slots=True)
class FitCost:
    """How the cost of a joint optimisation came down.

    Attributes:
        totals: Total cost at each iteration.
        terms: Mean over views of each unweighted term, at the start and at the end.
        ended: ``converged`` or ``iterations``.
    """

    totals: tuple[float, ...]
    terms: Mapping[str, tuple[float, float]]
    ended: Literal["converged", "iterations"]

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values for a record's reader."""
        return {
            "iterations": len(self.totals),
            "ended": self.ended,
            "cost": [self.totals[0], min(self.totals)] if self.totals else [],
            "terms": {name: list(pair) for name, pair in self.terms.items()},
        }


@dataclass(frozen=True, slots=True, eq=False)
class BodyFitResult:
    """A body fitted to some views of a capture.

    Attributes:
        body: The body, world metres.
        views_used: Indices of the views that it was fitted to, in the capture.
        hands_found: Whether the detector found the left and the right hand in the first of them.
        regions: (V,) masks of the body's vertices: ``left_hand``, ``right_hand``, ``face`` and
            ``eyeballs``.
        views_left_out: Why a view could not be used, by its index.
        depth: What decided how far away the body of a single view is; empty for several views.
        swapped: Indices of the views whose landmarks had left and right exchanged; None where the
            fit does not look for them.
        cost: Cost of the joint optimisation; None for fits without one.
    """

    body: Body
    views_used: tuple[int, ...]
    hands_found: tuple[bool, bool]
    regions: Mapping[str, Mask]
    views_left_out: Mapping[int, str] = field(default_factory=dict[int, str])
    depth: str = ""
    swapped: tuple[int, ...] | None = None
    cost: FitCost | None = None

    @property
    def skin(self) -> Mesh:
        """The body's surface, world metres."""
        return Mesh(self.body.vertices, self.body.faces, source="fitted body")

    def details(self) -> dict[str, object]:
        """Plain JSON values for a record's reader; nothing is steered by them."""
        details: dict[str, object] = {"views_used": list(self.views_used)}
        if self.views_left_out:
            details["views_left_out"] = {
                str(view): why for view, why in self.views_left_out.items()
            }
        if self.depth:
            details["depth"] = self.depth
        if self.swapped is not None:
            details["swapped_views"] = list(self.swapped)
        if self.cost is not None:
            details["jmbo"] = self.cost.to_dict()
        return details


#: MExECON's equation as it is printed, from the average of the single views.
JMBO = FitSettings()
#: ECON's fit to one view: equal weights, no head term.
ECON_FIT = replace(JMBO, normal=1.0, landmark=1.0, head=0.0, iterations=50)
#: Better on clothed people: starts from all landmarks, clothes may stand off, a weak prior, no
#: normal term. Chosen on training avatars, where the optimum is flat: half or twice a value costs
#: at most 0.6 mm.
JMBO_PLUS = FitSettings(
    start="landmarks",
    normals="off",
    landmarks="all",
    uncovered=0.1,
    standoff_m=0.01,
    landmark=0.4,
    prior=2e-4,
    iterations=60,
    early_stop=True,
    keep="best",
    schedule="ramp",
)
