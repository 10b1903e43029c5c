"""Bodies as a fit gives them: a true Anny body with errors of the size that fits have.

A normal estimator meets fitted bodies, so it is trained on these and not on the truth.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.core.arrays import Floats
from harness.core.truth import TrueParameters
from methods.body.models.anny_body import AnnyBody


@dataclass(frozen=True, slots=True)
class FitErrors:
    """Standard deviations of a fit's errors.

    Attributes:
        joint_deg: Rotation of each free joint, about each axis.
        root_deg: Rotation of the whole body, about each axis.
        place_m: Its place, along each axis.
        phenotype: Each phenotype value.
        spread: Deviation of the logarithm of one factor on all of these: some fits are good and
            some are bad.
    """

    joint_deg: float = 0.7
    root_deg: float = 0.4
    place_m: float = 0.004
    phenotype: float = 0.02
    spread: float = 0.9


def as_fitted(body: AnnyBody, truth: TrueParameters, errors: FitErrors, seed: int) -> Floats:
    """(V, 3) metres: the vertices of a body that a fit might have found, in the truth's frame.

    Joints that fits do not turn, such as the fingers', are at rest. Equal seeds give equal bodies.
    """
    from scipy.spatial.transform import Rotation

    draw = np.random.default_rng(seed)
    scale = float(np.exp(draw.normal(0.0, errors.spread)))
    turned = [0, *(body.joint_names.index(joint.name) for joint in body.free)]
    pose = np.tile(np.eye(4), (len(truth.pose_parameters), 1, 1))
    pose[turned] = truth.pose_parameters[turned]
    degrees = np.array([errors.root_deg, *[errors.joint_deg] * len(body.free)])[:, None]
    turns = Rotation.from_rotvec(
        np.radians(scale * degrees * draw.normal(size=(len(turned), 3)))
    ).as_matrix()
    pose[turned, :3, :3] = turns @ pose[turned, :3, :3]
    pose[0, :3, 3] += scale * errors.place_m * draw.normal(size=3)
    phenotype = {
        name: float(np.clip(value + scale * errors.phenotype * draw.normal(), 0.0, 1.0))
        for name, value in truth.phenotype.items()
    }
    return body.posed_as(pose, phenotype).vertices[0].double().numpy()
