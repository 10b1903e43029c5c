"""The kind of part ``smplx``: SMPL-X's model files, of which a user may import several."""

from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from harness.core.errors import HarnessError
from harness.core.files.hashing import file_sha256
from harness.core.files.npz import write_npz
from harness.core.protocols import Part
from methods.body.models.smplx_file import checked_model
from methods.parts.kind import About, ImportOptions
from methods.parts.store import ConvertedKind, Examined

#: The file of a part.
MODEL = "model.npz"
#: What the files are called where they are published; the last one belongs to PIXIE's shape values.
NAMES = ("SMPLX_NEUTRAL", "SMPLX_MALE", "SMPLX_FEMALE", "SMPLX_NEUTRAL_2020")

SMPLX = ConvertedKind(
    About(
        name="smplx",
        role="body model",
        purpose="the body model SMPL-X, as the paper uses it",
        licence="SMPL-X licence (non-commercial)",
        source="Register at https://smpl-x.is.tue.mpg.de and unpack models_smplx_v1_1.zip",
        files=tuple(f"{name}.npz" for name in NAMES),
        takes=("name",),
    ),
    "methods.body.models.smplx_part:examine",
    "harness eval --method mexecon8 --set body.model=smplx --set body.model_file={name}",
    preferred=NAMES[0],
)


def named_model(model_file: str, *, for_pixie: bool) -> str:
    """The setting ``body.model_file``, or the name of PIXIE's model where it is empty.

    Args:
        model_file: The setting.
        for_pixie: Whether PIXIE makes the first body. Its own model is then meant where it is
            imported, and otherwise what is meant without PIXIE.
    """
    own = NAMES[-1] in {part.name for part in SMPLX.installed()}
    return NAMES[-1] if for_pixie and not model_file and own else model_file


def model_path(model_file: str) -> Path | None:
    """The file that the setting ``body.model_file`` stands for; None where it is empty and none is.

    Args:
        model_file: A file, which has a slash or ends in .npz or .pkl; the name of an imported
            model; or nothing for the only one that is imported, or the neutral one.

    Raises:
        MissingPart: no model of that name is imported, or its file is gone.
        DataError: the imported file is another one.
    """
    if _is_file(model_file):
        return Path(model_file)
    if not model_file and not SMPLX.installed():
        return None
    return SMPLX.find(model_file).file(MODEL)


def smplx_part(model_file: str) -> Part:
    """The model of the setting ``body.model_file`` as records name it; errors as ``model_path``.

    A model that is not there has no digest.
    """
    role, licence = SMPLX.about.role, SMPLX.about.licence
    if _is_file(model_file):
        path = Path(model_file)
        # The space of shapes follows from the file's name, and not from its content.
        name = f"SMPL-X ({NAMES[-1]})" if is_pixies(model_file) else "SMPL-X"
        return Part(role, name, licence, file_sha256(path) if path.is_file() else "")
    if not model_file and not SMPLX.installed():
        return Part(role, "SMPL-X", licence)
    return SMPLX.find(model_file).installed.part(role)


def is_pixies(model_file: str) -> bool:
    """Whether the setting ``body.model_file`` stands for the model that PIXIE was made with.

    Raises:
        MissingPart, DataError: as ``model_path``.
    """
    if _is_file(model_file):
        return Path(model_file).stem == NAMES[-1]
    return bool(SMPLX.installed()) and SMPLX.find(model_file).installed.name == NAMES[-1]


def _is_file(model_file: str) -> bool:
    return "/" in model_file or model_file.endswith((".npz", ".pkl"))


def examine(file: Path, options: ImportOptions) -> Examined:
    """The model in a file; see ``methods.parts.store.Examine``.

    Raises:
        HarnessError: neither the file's name nor the options say which model it is.
    """
    arrays = checked_model(file)
    name = options.name or file.stem
    if not options.name and name not in NAMES:
        raise HarnessError(
            f"the name of {file} does not say which SMPL-X model it is",
            expected=" or ".join(NAMES),
            hint="Give it with --name",
        )
    shapes = arrays["shapedirs"].shape[2]

    def write(folder: Path) -> None:
        write_npz(folder / MODEL, arrays, compressed=False)

    return Examined(name, f"SMPL-X {name} ({shapes} shape and expression directions)", write)


def body_part(name: str, model_file: str = "") -> Part:
    """The part of the body model ``anny`` or ``smplx``; errors as ``smplx_part``."""
    if name == "anny":
        return Part("body model", f"Anny {_version('anny')}".strip(), "Apache-2.0")
    return smplx_part(model_file)


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return ""
