"""Which body model a name stands for."""

from harness.core.process.threads import give_freed_memory_back
from methods.body.models import anny_body, smplx_file
from methods.body.models.anny_body import AnnyBody
from methods.body.models.model import ParametricBody
from methods.body.models.smplx_body import SmplxBody


def body_model(name: str, model_file: str = "") -> ParametricBody:
    """The body model ``anny`` or ``smplx``, loaded.

    Raises:
        MissingPart: its package or the user's model file is not there.
        DataError: the file is not a model of SMPL-X.
    """
    return SmplxBody(model_file) if name == "smplx" else AnnyBody()


def forget_body_models() -> None:
    """Body models that nobody holds are read anew when they are next asked for.

    They stay in memory otherwise, Anny with 250 MiB.
    """
    anny_body.forget()
    smplx_file.forget()
    give_freed_memory_back()
