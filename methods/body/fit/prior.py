"""What bodies are likely before any picture is seen: poses near rest, joints within limits."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from methods.body.models.model import Parameters, ParametricBody

if TYPE_CHECKING:
    from torch import Tensor


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
