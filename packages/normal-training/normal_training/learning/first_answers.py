"""Training samples in which a network's first answers take the place of the body.

The second network of a ``Detailed`` is trained on these. They are stored, because a training looks
at each sample many times.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from harness.core.files.hashing import content_hash, file_sha256
from harness.core.files.npz import write_npz
from harness.geometry.images import packed_normals
from normal_training.learning.networks.detailed import FirstLook
from normal_training.learning.networks.starting import network_from
from normal_training.learning.sample_key import stored_key
from normal_training.learning.samples import Samples, read_samples

FIRST_ANSWERS_VERSION = 2
"""Changes whenever any output does."""


class FirstAnswers:
    """Samples with the answers of the first network in a file.

    Args:
        start: The ``.onnx`` file, of one network or two.

    Attributes:
        name: Of the network: the beginning of its sum.

    Raises:
        MissingPart, DataError: as ``network_from``.
    """

    def __init__(self, start: Path) -> None:
        self._look = FirstLook(network_from(start)).eval()
        self._sha256 = file_sha256(start)
        self.name = self._sha256[:16]

    def write(self, samples: Path, path: Path) -> None:
        """The samples of a file, with first answers, in a file, unless it is there and current.

        Raises:
            DataError: not a file of samples.
        """
        key = self._key(samples)
        if stored_key(path) == key:
            return
        arrays = read_samples(samples)
        photos = Samples([arrays], [str(arrays["key"])])
        answers: dict[str, list[np.ndarray]] = {"body_front": [], "body_back": []}
        for index in range(len(photos)):
            batch = photos.at([index])
            scene = batch.image, batch.mask, batch.body_front, batch.body_back
            with torch.no_grad():
                found = self._look(*scene)
            for rows, normals in zip(answers.values(), found, strict=True):
                rows.append(packed_normals(normals[0].movedim(0, -1).numpy()))
        stacked = {name: np.stack(rows) for name, rows in answers.items()}
        write_npz(path, {**arrays, **stacked, "key": np.array(key)}, compressed=False)

    def _key(self, samples: Path) -> str:
        return content_hash(
            {
                "version": FIRST_ANSWERS_VERSION,
                "samples": stored_key(samples),
                "network": self._sha256,
            }
        )
