"""PIXIE's way from a picture of a body to the numbers of SMPL-X, without crops of head and hands.

Feng et al., "Collaborative Regression of Expressive Bodies using Moderation", 3DV 2021. Names of
layers are those of the tensors in the checkpoint.
"""

from __future__ import annotations

import itertools

from torch import Tensor, nn

from methods.body.pixie.backbone import HrNet
from methods.body.pixie.part import OUTPUTS

_FEATURES, _HIDDEN = 2048, 1024
_MEAN, _DEVIATION = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)


class _Encoder(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.encoder = HrNet()

    def forward(self, picture: Tensor) -> Tensor:
        features: Tensor = self.encoder(picture)
        return features


class _Linear(nn.Module):
    """Linear layers with ReLU between them."""

    def __init__(self, *sizes: int) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        for before, after in itertools.pairwise(sizes):
            layers += [nn.Linear(before, after), nn.ReLU()]
        self.layers = nn.Sequential(*layers[:-1])

    def forward(self, features: Tensor) -> Tensor:
        found: Tensor = self.layers(features)
        return found


class PixieBody(nn.Module):
    """All layers that a picture of the body goes through."""

    def __init__(self) -> None:
        super().__init__()
        self.Encoder_body = _Encoder()
        self.Extractor_head_share = _Linear(_FEATURES, _FEATURES)
        self.Extractor_left_hand_share = _Linear(_FEATURES, _FEATURES)
        self.Extractor_right_hand_share = _Linear(_FEATURES, _FEATURES)
        self.Regressor_body = _Linear(_FEATURES, _HIDDEN, OUTPUTS["body"])
        self.Regressor_head_share = _Linear(_FEATURES, _HIDDEN, _HIDDEN, OUTPUTS["head"])
        self.Regressor_hand_share = _Linear(_FEATURES, _HIDDEN, _HIDDEN, OUTPUTS["left_hand"])

    def forward(self, picture: Tensor) -> tuple[Tensor, ...]:
        """The numbers of ``OUTPUTS``, each (B, count).

        Args:
            picture: (B, 3, 224, 224) RGB in [0, 1]; it is normalised here and nowhere else.
        """
        mean, deviation = (picture.new_tensor(each)[:, None, None] for each in (_MEAN, _DEVIATION))
        features = self.Encoder_body((picture - mean) / deviation)
        hands = (self.Extractor_left_hand_share, self.Extractor_right_hand_share)
        return (
            self.Regressor_body(features),
            self.Regressor_head_share(self.Extractor_head_share(features)),
            *(self.Regressor_hand_share(extract(features)) for extract in hands),
        )
