"""The weights of JMBO's cost and how it is brought down; the defaults are the paper's."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from harness.core.settings import check_choice, check_range
from methods.body.models.model import Parameters, ParametricBody

if TYPE_CHECKING:
    from torch import Tensor

#: MediaPipe's landmarks that ECON and MExECON compare: nose, eyes, ears, shoulders, elbows, wrists,
#: fingers, heels and toes. Hips, knees and ankles were left out there.
PUBLISHED_LANDMARKS = (0, 2, 5, 7, 8, *range(11, 23), *range(29, 33))
#: A detection counts there if its confidence is above this.
PUBLISHED_CONFIDENCE = 0.5
_HEAVIEST = 1e6


@dataclass(frozen=True, slots=True)
class Weights:
    """The cost and how it is brought down. The defaults are the paper's equation.

    Attributes:
        silhouette, normal, landmark, head: Weights of the terms; 0 turns one off.
        landmarks: Which of the detector's landmarks are compared: ``published``, the 21 of ECON and
            MExECON where the detector is more than half sure, or ``all``.
        uncovered: Weight, within the silhouette term, of subject that the body does not cover: 1
            is the paper's L1; less lets clothes stand off the body.
        standoff_m: Width of the subject's rim that costs nothing when uncovered, metres; 0 in the
            paper's L1.
        prior: Weight of the pose and shape prior; the paper has none.
        iterations: Number of iterations, at most.
        early_stop: Whether the fit ends when the cost hardly falls any more.
        keep: What is the result: the ``mean`` of the last ten iterates, the ``last`` one, or the
            ``best``, which costs least.
        rate: Adam's first step.
        schedule: ``plateau`` halves the step after 5 iterations without progress, as in the paper;
            ``ramp`` starts with small steps, for Adam's first ones are blind, and ends with them.
        batch: Views per iteration; 0 takes all.
        normals_every: Iterations after which a network estimates the normals anew with the body
            that the fit has reached; the authors' code does so after each, 0 never does.
    """

    silhouette: float = 1.0
    normal: float = 0.2
    landmark: float = 0.1
    head: float = 0.1
    landmarks: str = "published"
    uncovered: float = 1.0
    standoff_m: float = 0.0
    prior: float = 0.0
    iterations: int = 35
    early_stop: bool = False
    keep: str = "mean"
    rate: float = 1e-2
    schedule: str = "plateau"
    batch: int = 0
    normals_every: int = 0

    def __post_init__(self) -> None:
        for name, known in (
            ("landmarks", ("published", "all")),
            ("keep", ("mean", "last", "best")),
            ("schedule", ("plateau", "ramp")),
        ):
            check_choice(name, getattr(self, name), known)
        for name in ("silhouette", "normal", "landmark", "head", "uncovered", "prior"):
            check_range(name, getattr(self, name), 0.0, _HEAVIEST)
        for name, least, most, unit in (
            ("standoff_m", 0.0, 0.5, "metres"),
            ("iterations", 0, 10_000, "iterations"),
            ("rate", 1e-6, 1.0, ""),
            ("batch", 0, 10_000, "views"),
            ("normals_every", 0, 10_000, "iterations"),
        ):
            check_range(name, getattr(self, name), least, most, unit)

    @property
    def is_published(self) -> bool:
        """Whether the cost is the paper's equation, whatever the weights of its terms."""
        paper, own = Weights(), ("landmarks", "uncovered", "standoff_m", "prior", "schedule")
        return all(getattr(self, name) == getattr(paper, name) for name in own)

    def draws(self, views: int) -> bool:
        """Whether the views of each iteration are drawn, so that a fit to so many has a seed."""
        return 0 < self.batch < views


#: Standard deviation of a limb's rotation, radians; divided by the root of a joint's stiffness.
_DEVIATION_RAD = 0.8
#: Standard deviation of bending against a hinge, radians.
_HINGE_DEVIATION_RAD = 0.1


class ParameterPrior:
    """Negative log-probability of parameters: Gaussians, one-sided at the hinges."""

    def __init__(self, body: ParametricBody) -> None:
        import torch

        stiffness = np.array([joint.stiffness for joint in body.free], dtype=np.float32)
        self._root = torch.from_numpy(np.sqrt(stiffness) / np.float32(_DEVIATION_RAD))
        self._mean, self._deviation = torch.from_numpy(body.shape_prior)
        hinged = [i for i, joint in enumerate(body.free) if joint.hinge is not None]
        self._hinged = torch.tensor(hinged, dtype=torch.long)
        axes = [joint.hinge for joint in body.free if joint.hinge is not None]
        self._axes = torch.tensor(np.array(axes, dtype=np.float32).reshape(-1, 3))
        self._least = torch.tensor([body.free[i].least_rad for i in hinged])

    def __call__(self, parameters: Parameters) -> Tensor:
        """(B,) the cost of the parameters, 0 for the mean shape in the rest pose."""
        return 0.5 * (self.residuals(parameters) ** 2).sum(1)

    def residuals(self, parameters: Parameters) -> Tensor:
        """(B, L) numbers, the sum of whose halved squares is the cost."""
        import torch

        pose, shape = parameters["pose"], parameters["shape"]
        bent = (pose[:, self._hinged] * self._axes).sum(2)
        against = torch.relu(self._least - bent) / _HINGE_DEVIATION_RAD
        shaped = (shape - self._mean) / self._deviation
        return torch.cat([(self._root * pose).flatten(1), against, shaped], 1)
