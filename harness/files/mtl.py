"""Materials of a Wavefront OBJ: which it uses, their colours, and how their pictures are placed."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from harness.core.errors import DataError
from harness.core.files.names import inside, named_path

_MOST_BYTES = 2**20
_BEFORE = re.compile(rb"(?:\A(?:\xef\xbb\xbf)?|[\r\n])[ \t]*\Z")
_MOST_BLANKS = 64
_NUMBER = r"\s+[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?(?=\s|$)"
#: Options of a picture, before its name as the format has them or after it.
_OPTION = re.compile(
    rf"(?:^|(?<=\s))-(?:(o|s|t|mm)((?:{_NUMBER}){{1,3}})"
    r"|(blendu|blendv|boost|bm|cc|clamp|imfchan|texres|type)\s+(\S+))(?:\s+|$)",
    re.IGNORECASE,
)
#: Options that change no place and no colour, whatever follows them; others may be off.
_HARMLESS = ("blendu", "blendv", "boost", "texres")


@dataclass(frozen=True, slots=True)
class Picture:
    """A material's picture and where it lies: texture coordinates are scaled, then moved."""

    path: Path
    scale: tuple[float, float] = (1.0, 1.0)
    offset: tuple[float, float] = (0.0, 0.0)

    @property
    def is_placed(self) -> bool:
        """Whether texture coordinates are not simply the picture's own."""
        return (self.scale, self.offset) != ((1.0, 1.0), (0.0, 0.0))


@dataclass(frozen=True, slots=True)
class Material:
    """A material as its file has it.

    Attributes:
        file: The material file.
        name: As ``usemtl`` calls it.
        colour: Diffuse colour (``Kd``), sRGB from 0 to 1; None where the file has no such numbers.
        map: What follows ``map_Kd``; empty where it has no picture.
    """

    file: Path
    name: str
    colour: tuple[float, float, float] | None = None
    map: str = ""

    def picture(self, mesh_path: Path, *folders: Path) -> Picture | None:
        """The picture, its options read; None if it has none.

        Args:
            mesh_path: The OBJ, from whose folder names count.
            folders: Further folders in which pictures may lie.

        Raises:
            DataError: an option that is not applied, or a picture that is not there.
        """
        if not self.map:
            return None
        placing = {"s": (1.0, 1.0), "o": (0.0, 0.0)}
        for option, numbers, flag, value in _OPTION.findall(self.map):
            words = numbers.split()
            known = (option or flag).lower()
            if known in placing:
                u, v = (*map(float, words), placing[known][1])[:2]
                placing[known] = (u, v)
            elif known not in _HARMLESS and value.lower() != "off":
                raise DataError(
                    f"material '{self.name}' of {self.file} changes its picture by '-{known}'",
                    expected="-s and -o, which are applied, or none",
                    got=f"map_Kd {self.map}",
                    hint="Bake it into the texture",
                )
        name = _OPTION.sub("", self.map).strip()
        path = picture_file(self.file, name, mesh_path.parent, *folders)
        if not path.is_file():
            raise DataError(
                f"the texture of {mesh_path} is missing",
                expected=str(path),
                hint="Copy the image next to the mesh, as it is in the dataset's archive",
            )
        return Picture(path, placing["s"], placing["o"])


@dataclass(frozen=True, slots=True)
class Materials:
    """What an OBJ names and what its material files define.

    Attributes:
        mesh_path: The OBJ.
        files: Its material files.
        defined: Their materials by name.
        named: What ``usemtl`` lines call, each once, in order.
    """

    mesh_path: Path
    files: tuple[Path, ...]
    defined: Mapping[str, Material]
    named: tuple[str, ...]

    def of(self, name: str) -> Material | None:
        """The material of a name; the only one where faces name none that is defined."""
        if len(self.defined) == 1 and not any(each in self.defined for each in self.named):
            return next(iter(self.defined.values()))
        return self.defined.get(name)

    @property
    def undefined(self) -> tuple[str, ...]:
        """Names that faces use and no material file defines."""
        return tuple(name for name in self.named if name not in self.defined)

    def only_picture(self, *folders: Path) -> Picture | str:
        """The one picture that all faces show as it is, or what they show instead, in words.

        Raises:
            DataError: as ``Material.picture``.
        """
        used = [self.of(name) for name in self.named or ("",)]
        shown = {each.picture(self.mesh_path, *folders) if each else None for each in used}
        picture = next(iter(shown))
        if len(shown) == 1 and picture and not picture.is_placed:
            return picture
        words = [f"{each.path.name} by -s or -o" if each.is_placed else each.path.name
                 for each in shown if each]  # fmt: skip
        words += [f"the plain colour of {each.name}" for each in used if each and not each.map]
        words += [f"{name}, which is not defined" for name in self.undefined]
        return ", ".join(sorted(words)) or "none"


def material_files(mesh_path: Path, *folders: Path) -> list[Path]:
    """The material files that an OBJ names, whether they are there or not.

    Args:
        mesh_path: The OBJ, from whose folder names count.
        folders: Further folders in which they may lie.

    Raises:
        DataError: one lies elsewhere.
    """
    found: list[Path] = []
    for line in _texts(mesh_path, b"mtllib"):
        whole = named_path(mesh_path, line, *folders)
        # A name may have spaces, and a line several names.
        names = line.split() if not whole.is_file() else [line]
        paths = [picture_file(mesh_path, name, mesh_path.parent, *folders) for name in names]
        found += paths if all(path.is_file() for path in paths) else [whole]
    return list(dict.fromkeys(found))


def materials_of(mesh_path: Path, *folders: Path) -> Materials:
    """The materials of an OBJ file; arguments as for ``material_files``.

    Raises:
        DataError: a material file that is not there, lies elsewhere or is none.
    """
    files = material_files(mesh_path, *folders)
    defined: dict[str, Material] = {}
    named = tuple(_texts(mesh_path, b"usemtl"))
    for file in files:
        if not file.is_file():
            raise DataError(
                f"{mesh_path} names a material file that is not there", expected=str(file)
            )
        for material in _defined(file):
            first = defined.setdefault(material.name, material)
            if replace(first, file=file) != material and material.name in named:
                raise DataError(
                    f"material '{material.name}' of {mesh_path} is defined twice, and differently",
                    got=f"in {first.file} and in {file}",
                    hint="Give one of both another name, where faces use it, too",
                )
    return Materials(mesh_path, tuple(files), defined, named)


def _texts(mesh_path: Path, keyword: bytes) -> list[str]:
    """What follows a keyword at the start of lines, each once; whatever ends or indents lines."""
    try:
        content = mesh_path.read_bytes()
    except OSError as error:
        raise DataError(f"could not read {mesh_path}: {error.strerror or error}") from error
    found = [
        decoded(match[1])
        # With the keyword first, twenty times as fast as from the start of each line.
        for match in re.finditer(keyword + rb"[ \t]+([^\r\n]*[^\s])", content)
        if _BEFORE.search(content[max(0, match.start() - _MOST_BLANKS) : match.start()])
    ]
    return list(dict.fromkeys(found))


def decoded(text: bytes) -> str:
    """Text of another program: UTF-8, else Latin-1, so that two names never become one."""
    try:
        return text.decode("utf-8-sig")
    except UnicodeDecodeError:
        return text.decode("latin-1")


def texture_image(mesh_path: Path) -> Path:
    """The image that all faces of an OBJ file show as it is.

    Raises:
        DataError: a file that is not there, or something else than one image all over.
    """
    found = materials_of(mesh_path).only_picture()
    if isinstance(found, Picture):
        return found.path
    raise DataError(
        f"{mesh_path} cannot be textured as it is",
        expected="one map_Kd image for all its faces",
        got=found,
        hint="'harness data add' makes one picture of several, and of plain colours",
    )


def picture_file(source: Path, name: str, base: Path, *folders: Path) -> Path:
    """The picture that a file names, whether it is there or not.

    Written on another system, a name may have quotes, backslashes, or letters of another case.

    Raises:
        DataError: it lies outside the folders.
    """
    literal = named_path(source, name, base, *folders, base=base)
    if literal.is_file():
        return literal
    plain = name.strip('"').replace("\\", "/")
    path = named_path(source, plain, base, *folders, base=base)
    if path.is_file() or not path.parent.is_dir():
        return path if path.is_file() else literal
    alike = [each for each in path.parent.iterdir() if each.name.lower() == path.name.lower()]
    return inside(source, alike[0], source.parent, base, *folders) if len(alike) == 1 else literal


def _defined(path: Path) -> list[Material]:
    if path.stat().st_size > _MOST_BYTES:
        raise DataError(
            f"{path} is no material file",
            expected=f"at most {_MOST_BYTES} bytes",
            got=str(path.stat().st_size),
        )
    found: list[Material] = []
    for line in map(decoded, path.read_bytes().splitlines()):
        word, _, rest = line.strip().replace("\t", " ").partition(" ")
        if word.lower() == "newmtl":
            found.append(Material(path, rest.strip()))
        elif found and word.lower() == "kd":
            found[-1] = replace(found[-1], colour=_colour(rest))
        elif found and word.lower() == "map_kd":
            found[-1] = replace(found[-1], map=rest.strip())
    return found


def _colour(text: str) -> tuple[float, float, float] | None:
    """Red, green and blue of ``Kd``; a single number is a grey. None of what is no colour."""
    try:
        values = [float(word) for word in text.split()[:3]]
    except ValueError:
        return None
    if not values or not all(0.0 <= value <= 1.0 for value in values):
        return None
    return values[0], values[1 % len(values)], values[2 % len(values)]
