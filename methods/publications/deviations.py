"""How the methods that carry the paper's names differ from what was published.

Sources: the MExECON paper with its public code, and ECON (CVPR 2023) with its public code, on which
MExECON builds. What the two codes do beyond the texts counts as published where the texts are
silent; where a code contradicts its paper, the paper counts and the entry says so.
"""

from dataclasses import replace

from harness.core.protocols import Deviation
from methods.publications import published as with_parts
from methods.publications.published import Published

_MEXECON_SOURCE = (
    "MExECON: Multi-view Extended Explicit Clothed humans Optimized via Normal integration"
)
_ECON_SOURCE = "ECON: Explicit Clothed humans Optimized via Normal integration, CVPR 2023"
_LICENSED = "the published part is for registered, non-commercial users"
_CAMERAS_ARE_KNOWN = "the cameras are known, and an orthographic crop would add its own error"

_BODY_REASONS = {
    "body.model": f"{_LICENSED}; --set body.model=smplx takes the user's own file",
    "body.normals": f"{_LICENSED}; the shipped network was trained on generated avatars",
    "body.normals_every": (
        "time: a network run for each view and iteration; on the training avatar t00101 joints are "
        "26.4 mm off with normals that are estimated once, with the body that the fit starts from, "
        "and 25.8 mm with normals estimated anew each time, Chamfer is 22.1 and 22.2 mm"
    ),
    "body.keep": "constant steps scatter the last iterate by 2 mm, the mean of ten by 0.7",
}
_BODY_SETTINGS: dict[str, object] = {
    "body.model": "smplx",
    "body.stage": "jmbo",
    "body.start": "average",
    "body.normals": "econ",
    "body.normals_every": 1,
    "body.silhouette": 1.0,
    "body.normal": 0.2,
    "body.landmark": 0.1,
    "body.head": 0.1,
    "body.landmarks": "published",
    "body.uncovered": 1.0,
    "body.standoff_m": 0.0,
    "body.prior": 0.0,
    "body.iterations": 35,
    "body.early_stop": False,
    "body.keep": "last",
    "body.rate": 1e-2,
    "body.schedule": "plateau",
    "body.batch": 0,
}

_INITIAL_BODY = Deviation(
    "first body of each view",
    "PIXIE regresses SMPL-X from the photo",
    "the body model is fitted to MediaPipe's 2-D and 3-D landmarks of the photo, with a prior of "
    "pose and shape; a landmark that three photos or more agree on is where they put it",
    _LICENSED,
)
#: With PIXIE the average of its bodies is what the fit starts from, as published.
_STARTS: dict[str, object] = {"body.start": "pixie"}
_LANDMARKS = (
    Deviation(
        "landmark readings",
        "one reading by MediaPipe Holistic with model complexity 2",
        "the mean of six readings (in other light and in the mirror) with model complexity 1; the "
        "confidence falls where they differ",
        "the complexity 2 model is not in MediaPipe's wheel; six readings scatter by 14.5 mm on "
        "training avatars, one by 16.8 mm",
    ),
    Deviation(
        "landmark positions on the body",
        "joints and vertices of SMPL-X",
        "Anny's keypoints, moved by offsets that were learned on 34 training avatars; finger "
        "landmarks count 0.3",
        "Anny's keypoints are not where MediaPipe marks clothed people",
    ),
    Deviation(
        "views without a detected person",
        "their silhouette and normals still count",
        "they are left out",
        "no first body can be fitted to them",
    ),
)
_CAMERA = Deviation(
    "camera of the fit",
    "an orthographic crop of each view; of the cameras only relative rotations are used",
    "each view's full perspective camera",
    _CAMERAS_ARE_KNOWN,
)
_SINGLE_VIEW_DEPTH = Deviation(
    "distance of a single view's body",
    "none: the crop is orthographic and has no metres",
    "the body model's prior of people's height decides, or with --set body.depth=subject-centre "
    "the given centre of the subject",
    "results are compared in metres in the world's frame",
)
_FIT = (
    Deviation(
        "unit of the losses",
        "a crop of 512 pixels, in which the person's box fills 0.9",
        "a square of 1.1 times the longer side of the subject's box, at 256 pixels a subject",
        "the same share of the picture without a crop; a quarter of the pixels is enough",
    ),
    Deviation(
        "gradient of the silhouette",
        "soft rasteriser, whose masks are slightly dilated",
        "exact: an integral along the outline's edges, with whole-pixel masks for the value",
        "has no blur to tune",
    ),
    Deviation(
        "pixels of the normal term",
        "all",
        "a regular subset of at most 2 500 a view",
        "time; about every sixth pixel of the body is looked at",
    ),
    Deviation(
        "learning-rate schedule",
        "the paper names none; its code halves the rate after 5 iterations without progress",
        "as the code",
        "the printed iterations were made with it",
    ),
    Deviation(
        "what is optimised",
        "pose, shape, orientation and place; size and hands stay those of PIXIE",
        "the same of Anny, whose shape values include the size; hands stay at rest",
        "the body model is another",
    ),
    Deviation(
        "frame of the fit",
        "the first view's camera",
        "the first view's, but upright and around the subject",
        "the head term needs to know what is up",
    ),
)
_MEXECON_FIT = (
    Deviation(
        "normal loss",
        "L1 in the paper; its code leaves the absolute value out and sends gradients through the "
        "network",
        "L1, with the network outside the gradient",
        "as printed",
    ),
    Deviation(
        "weight of the head term",
        "0.1 in the paper, 0.3 in its code",
        "0.1",
        "as printed",
    ),
    Deviation(
        "frames",
        "the code mirrors landmarks against silhouettes and takes rotations about the vertical "
        "alone",
        "one frame for all terms; any camera",
        "an error of the code that the paper does not describe",
    ),
)
_ECON_FIT = (
    Deviation(
        "sides that are compared",
        "front and back renders of the body",
        "what the photo shows",
        "under perspective the two sides do not share an outline",
    ),
    Deviation(
        "weight of landmarks under loose clothes",
        "ten times as much where silhouettes overlap by less than half",
        "constant",
        "the silhouettes of the generated subjects do not differ so much",
    ),
    Deviation(
        "mean of the landmark loss",
        "over landmarks, each weighted by its visibility",
        "the same divided by the mean visibility, as in MExECON",
        "one definition for both methods",
    ),
)

PUBLISHED_JMBO = Published(
    _MEXECON_SOURCE,
    _BODY_SETTINGS,
    _BODY_REASONS,
    (_INITIAL_BODY, *_LANDMARKS, _CAMERA, *_FIT, *_MEXECON_FIT, *with_parts.STEPS),
    with_parts.ENDED,
    with_parts.ONLY_WITH,
    _STARTS,
)
JMBO_WITHOUT_HEAD = replace(PUBLISHED_JMBO, settings={**_BODY_SETTINGS, "body.head": 0.0})
BODY_AVERAGE = Published(
    _MEXECON_SOURCE,
    {"body.model": "smplx", "body.stage": "average"},
    _BODY_REASONS,
    (_INITIAL_BODY, *_LANDMARKS, _CAMERA, *with_parts.STEPS),
    with_parts.ENDED,
    with_parts.ONLY_WITH,
)
BODY_FRONT = Published(
    _MEXECON_SOURCE,
    {"body.model": "smplx", "body.stage": "front"},
    _BODY_REASONS,
    (_INITIAL_BODY, *_LANDMARKS, _CAMERA, _SINGLE_VIEW_DEPTH, *with_parts.STEPS),
    with_parts.ENDED,
    with_parts.ONLY_WITH,
)

_SURFACE_REASONS = {
    "surface.normals": f"{_LICENSED}; --set surface.normals=onnx takes the user's own network",
}
_SURFACE_SETTINGS: dict[str, object] = {
    "surface.normals": "econ",
    "surface.resolution": 512,
    "surface.bilateral_k": 4.0,
    "surface.prior_weight": 1e-4,
    "surface.boundary_weight": 1e-6,
    "surface.thickness_m": 0.02,
    "surface.clothes": "uniform",
    "surface.covered_m": 0.02,
    "surface.hands": "sheets",
    "surface.poisson_depth": 10,
    "surface.faces": 50_000,
    "surface.envelope": "none",
}
_SURFACE = (
    Deviation(
        "masks",
        "a segmentation network (U2-Net) on the photo",
        "the photo's own alpha channel",
        "captures carry exact masks; the privilege is named",
    ),
    Deviation(
        "camera of the maps",
        "an orthographic crop of 512 pixels, 256 to a unit",
        "the view's full perspective camera, cropped to the subject; the two weights are carried "
        "over to its resolution at the subject's depth",
        _CAMERAS_ARE_KNOWN,
    ),
    Deviation(
        "place of a depth map's vertices",
        "half a pixel off the pixels' centres",
        "at the pixels' centres",
        "an error of the code that the paper does not describe",
    ),
    Deviation(
        "solver of d-BiNI",
        "conjugate gradients to a residual of 1e-3 with a diagonal preconditioner, on a GPU",
        "the same reweighting (150 rounds, energy change 1e-4) with another linear solver, on a "
        "CPU",
        "runs everywhere; see methods/surface/bilateral.py",
    ),
    Deviation(
        "moving the body to the sheets before it completes them",
        "an affine map for each vertex under four regularisers, 100 iterations of Adam",
        "an offset along each vertex' normal, smooth over the surface: one linear system, three "
        "times",
        "equal results need no tuning; the sides between the sheets stand off as clothes do",
    ),
    Deviation(
        "volume of the Poisson reconstruction",
        "1.1 times the longest side",
        "1.25 times, at the same depth",
        "a bulge in a wide gap can reach the wall of the smaller one, where the surface stays open",
    ),
    Deviation(
        "closed result",
        "the largest piece as it comes",
        "the largest piece, cut apart where its folds touch, and checked to be closed",
        "a mesh that is not closed is a failure and not a number",
    ),
)
_MEXECON_SURFACE = (
    Deviation(
        "completion",
        "IF-Nets+ in the paper's text; its code turns that off and uses the body",
        "the body",
        _LICENSED,
    ),
    Deviation(
        "back normals",
        "the front network on the back photo, turned into the front's frame; the code integrates "
        "each view by itself",
        "each view is integrated by itself and its near sheet taken to the world by its camera",
        "under perspective the two views do not share a pixel grid",
    ),
    Deviation(
        "place of the back sheet",
        "moved by 0.02 units along x in the code",
        "where its camera puts it",
        "an error of the code that the paper does not describe",
    ),
)
_ECON_SURFACE = (
    Deviation(
        "hands that are replaced",
        "those that one reading of the photo finds",
        "those that at least half of the six readings find",
        "one reading finds hands that are hidden",
    ),
    Deviation(
        "normals",
        "the front map by Sapiens in the code's latest version, by ECON's own network in the paper",
        "one network for both sides",
        _LICENSED,
    ),
)

MEXECON = Published(
    _MEXECON_SOURCE,
    {**_BODY_SETTINGS, **_SURFACE_SETTINGS},
    {**_BODY_REASONS, **_SURFACE_REASONS},
    (*PUBLISHED_JMBO.steps, *_SURFACE, *_MEXECON_SURFACE),
    with_parts.ENDED,
    with_parts.ONLY_WITH,
    _STARTS,
)
MEXECON_CEILING = replace(
    MEXECON,
    reasons={
        **MEXECON.reasons,
        "surface.normals": "the ceiling of integration and completion; the fit keeps its normals",
    },
)
ECON = Published(
    _ECON_SOURCE,
    {
        **_BODY_SETTINGS,
        "body.normal": 1.0,
        "body.landmark": 1.0,
        "body.head": 0.0,
        "body.iterations": 50,
        **_SURFACE_SETTINGS,
        "surface.hands": "detected",
    },
    {**_BODY_REASONS, **_SURFACE_REASONS},
    (
        *(_INITIAL_BODY, *_LANDMARKS, _CAMERA, _SINGLE_VIEW_DEPTH),
        *(*_FIT, *_ECON_FIT, *_SURFACE, *_ECON_SURFACE, *with_parts.STEPS),
    ),
    {**with_parts.ENDED, "normals": ("surface.normals", "econ")},
    with_parts.ONLY_WITH,
    _STARTS,
)


_NOT_STATED = "not stated"

VGGT_ROW = Published(
    source="MExECON, comparison with VGGT, and VGGT's official code",
    settings={"network.fit": "crop", "keep.drop_share": 0.5},
    reasons={
        "network.fit": (
            "the official default fills the width and cuts what is taller, which are head and feet "
            "in photos of standing people; whether the authors' photos were cut is not known"
        ),
        "keep.drop_share": (
            "the official viewer drops the less confident half, which leaves gaps in a person's "
            "surface; VGGT's author advises a fifth; what the paper's mesh was made of is not known"
        ),
    },
    steps=(
        Deviation(
            "alignment",
            _NOT_STATED,
            "as align.mode says, in the title",
            "VGGT's world has a unit and axes of its own, so that there was one; it decides the "
            "numbers as much as the network does",
        ),
        Deviation(
            "points",
            "VGGT's dense point cloud; from which head is not stated",
            "depth, unprojected with the estimated cameras",
            "VGGT's authors call it the more accurate one",
        ),
        Deviation(
            "choice of points",
            _NOT_STATED,
            "exact mask, depth edges, confidence, consistency of views, outliers",
            "the background has to go, and the record says what each step keeps",
        ),
        Deviation(
            "normals of points",
            _NOT_STATED,
            "from the depth grid, facing the camera",
            "no side has to be guessed",
        ),
        Deviation(
            "surface",
            "Poisson surface reconstruction (2006), settings not stated",
            "screened Poisson reconstruction (2013), as mesh.depth and mesh.trim say",
            "its successor, which Open3D has",
        ),
        Deviation(
            "background of the photos",
            _NOT_STATED,
            "white",
            "what VGGT's own code puts behind transparent pixels",
        ),
    ),
)
