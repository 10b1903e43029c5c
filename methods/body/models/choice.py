"""Which body model a name stands for."""

from __future__ import annotations

from methods.body.models.anny_body import AnnyBody
from methods.body.models.model import ParametricBody
from methods.body.models.smplx_body import SmplxBody

__all__ = ["body_model"]


def body_model(name: str, model_file: str = "") -> ParametricBody:
    """The body model ``anny`` or ``smplx``, loaded.

    Raises:
        MissingPart: its package or the user's model file is not there.
        DataError: the file is not a model of SMPL-X.
    """
    return SmplxBody(model_file) if name == "smplx" else AnnyBody()
