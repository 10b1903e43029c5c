"""Recipes: methods of others that a user installs, with what each needs and what of it is there.

``recipes/<name>/`` holds ``method.toml``, the one file that runs in the method's own interpreter,
and its pinned packages. What the user has, such as a checkout or weights, stays where it is; a note
below the data folder says where, with sums. Nothing of it is imported here.
"""

from __future__ import annotations

import contextlib
import hashlib
import shutil
import subprocess
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import psutil

from harness.core.errors import DataError, HarnessError, MethodError, MissingPart, did_you_mean
from harness.core.files.atomic import read_json, write_json
from harness.core.files.hashing import content_hash
from harness.core.protocols import MethodInfo, Part
from harness.core.typed_json import from_json, to_json
from methods.foreign.command_method import CommandMethod
from methods.foreign.environment import file_digest
from methods.foreign.interpreter import Interpreter, Launch
from methods.foreign.method_file import METHOD_FILE, MethodFile, Needs, read_method
from methods.parts.store import user_folder
from methods.publications.deviations import VGGT_ROW
from methods.publications.published import Published

RECIPES = Path(__file__).resolve().parents[2] / "recipes"
#: What all recipes' programs share.
EXCHANGE = "exchange.py"
_NOTE = "installed.json"
_GIB = 2**30
_CGROUP = Path("/sys/fs/cgroup")


def recipe_names() -> tuple[str, ...]:
    """The names of all recipes."""
    return tuple(sorted(path.parent.name for path in RECIPES.glob(f"*/{METHOD_FILE}")))


@dataclass(frozen=True, slots=True)
class NotedFile:
    """A file as it was when it was noted."""

    bytes: int
    sha256: str


@dataclass(frozen=True, slots=True)
class Installed:
    """What a user has of a recipe.

    Attributes:
        python: The interpreter; empty is the harness's own.
        checkout: Folder of the source; empty for none.
        weights: File or folder; empty for none.
        files: Sizes and sums, by path, of what the recipe names of both.
    """

    python: str = ""
    checkout: str = ""
    weights: str = ""
    files: Mapping[str, NotedFile] = field(default_factory=dict[str, NotedFile])

    @property
    def sha256(self) -> str:
        """One digest for all noted files."""
        lines = [f"{Path(path).name} {file.sha256}" for path, file in sorted(self.files.items())]
        return hashlib.sha256("\n".join(lines).encode()).hexdigest()


@dataclass(frozen=True, slots=True)
class Recipe:
    """A recipe.

    Attributes:
        name: Of its folder.
        method: What its ``method.toml`` says.
        needs: The part of that which is the user's to bring.
    """

    name: str
    method: MethodFile
    needs: Needs

    @classmethod
    def of(cls, name: str) -> Recipe:
        """The recipe of a name.

        Raises:
            HarnessError: there is none.
            DataError: its description is not right.
        """
        if name not in recipe_names():
            raise HarnessError(f"unknown recipe '{name}'", hint=did_you_mean(name, recipe_names()))
        method = read_method(RECIPES / name)
        if method.recipe is None:
            raise DataError(f"{method.path} describes no recipe", expected="a table [recipe]")
        return cls(name, method, method.recipe)

    @property
    def place(self) -> Path:
        """Where its note is, and what ``install --run`` makes; it need not exist."""
        return user_folder("HARNESS_RECIPES", "recipes") / self.name

    @property
    def command(self) -> str:
        """What installs it."""
        return f"harness recipes install {self.name}"

    def installed(self) -> Installed:
        """What was noted.

        Raises:
            MissingPart: nothing was; the hint is the next command.
            DataError: the note is not right.
        """
        path = self.place / _NOTE
        if not path.is_file():
            raise MissingPart(
                f"the recipe '{self.name}' is not installed", hint=f"Run: {self.command}"
            )
        return from_json(Installed, read_json(path), path, "a note of an installed recipe")

    def steps(self) -> Iterator[tuple[str, ...]]:
        """Commands that get what anybody may have: the source, and an environment with packages."""
        needs, place = self.needs, self.place
        if needs.checkout:
            yield ("git", "clone", needs.source, str(place / "checkout"))
            if needs.commit:
                yield ("git", "-C", str(place / "checkout"), "checkout", needs.commit)
        packages = str(self.method.folder / needs.environment)
        if needs.environment.endswith((".yml", ".yaml")):
            conda = ("conda", "env", "create", "--prefix", str(place / "env"))
            yield (*conda, "--file", packages)
        elif needs.environment:
            yield ("python3", "-m", "venv", str(place / "env"))
            yield (str(place / "env/bin/python"), "-m", "pip", "install", "-r", packages)

    def note(self, python: Path | None, checkout: Path | None, weights: Path | None) -> Installed:
        """Note what is given, beside what was noted before, with the sums of its files.

        Raises:
            MissingPart: something of it is not there.
        """
        path = self.place / _NOTE
        before = self.installed() if path.is_file() else Installed()
        given = {"python": python, "checkout": checkout, "weights": weights}
        paths = {name: str(each.expanduser().absolute()) for name, each in given.items() if each}
        found = replace(before, **paths)
        for name in paths:
            if not Path(paths[name]).exists():
                what = f"there is no {name} at {paths[name]}"
                raise MissingPart(what, hint=f"Run: {self.command}")
        files = {str(file): file for _, file in self._files(found) if file.is_file()}
        noted = {
            name: NotedFile(file.stat().st_size, file_digest(file)) for name, file in files.items()
        }
        found = replace(found, files=noted)
        self.place.mkdir(parents=True, exist_ok=True)
        write_json(path, to_json(found))
        return found

    def _files(self, found: Installed) -> Iterator[tuple[str, Path]]:
        """What is needed of checkout and weights: what to call it, and where it should be."""
        if found.checkout:
            yield from ((each, Path(found.checkout, each)) for each in self.needs.checkout)
        if found.weights and self.needs.network:
            named = self.needs.weights or ("",)
            yield from ((each or "weights", Path(found.weights, each)) for each in named)

    def require(self) -> Installed:
        """What is installed, if it is all there, and this machine can run it.

        Raises:
            MissingPart: something is not; one sentence with the next command.
            MethodError: the machine has too little memory.
        """
        found, needs = self.installed(), self.needs
        takes = {"checkout": bool(needs.checkout), "weights": bool(needs.network)}
        for what, needed in takes.items():
            if needed and not getattr(found, what):
                raise MissingPart(
                    f"the recipe '{self.name}' has no {what} yet",
                    expected=self._source_of(what),
                    hint=f"Run: {self.command} --{what} PATH",
                )
        for name, path in self._files(found):
            noted = found.files.get(str(path))
            if not path.is_file() or noted is None or path.stat().st_size != noted.bytes:
                kind = "--weights" if Path(found.weights) in (path, path.parent) else "--checkout"
                raise MissingPart(
                    f"the recipe '{self.name}' has no {name} as it was noted",
                    expected=f"{path}; {self._source_of(name)}",
                    hint=f"Run: {self.command} {kind} PATH",
                )
        interpreter(found).packages(self.name, needs.modules or ("json",), self.command)
        if needs.gpu_gib and (there := gpu_gib()) < needs.gpu_gib:
            raise MissingPart(
                f"the recipe '{self.name}' needs a GPU",
                expected=f"one with {needs.gpu_gib:g} GiB",
                got=f"{there:.0f} GiB" if there else "none that nvidia-smi shows",
                hint=f"Run on a machine with one: harness eval --method {self.method.name}",
            )
        return found

    def _source_of(self, name: str) -> str:
        """Where a file comes from, in words."""
        needs = self.needs
        found = [each.get for each in needs.downloads if each.what == name]
        if name in ("weights", *needs.weights):
            found += [each.get for each in needs.downloads if each.what not in needs.checkout]
        return found[0] if found else needs.source


def interpreter(found: Installed) -> Interpreter:
    """The Python that runs a recipe."""
    return Interpreter(Path(found.python) if found.python else None)


def gpu_gib() -> float:
    """Memory of the largest GPU that the driver shows; 0 for none."""
    program = shutil.which("nvidia-smi")
    if program is None:
        return 0.0
    query = [program, "--query-gpu=memory.total", "--format=csv,noheader,nounits"]
    try:
        said = subprocess.run(query, capture_output=True, text=True, timeout=60, check=False)
        return max((float(line) for line in said.stdout.split()), default=0.0) / 1024
    except (OSError, ValueError, subprocess.TimeoutExpired):
        return 0.0


def available_bytes() -> int:
    """What this process may still take: of the machine, and of the container it runs in."""
    free = int(psutil.virtual_memory().available)
    try:
        most = (_CGROUP / "memory.max").read_text().strip()
        used = int((_CGROUP / "memory.current").read_text())
        # What the kernel caches of files counts as used, and is given back when it is wanted.
        statistics = (_CGROUP / "memory.stat").read_text().split()
        cached = int(statistics[statistics.index("inactive_file") + 1])
        return free if most == "max" else min(free, int(most) - used + cached)
    except (OSError, ValueError, IndexError):
        return free


@dataclass(frozen=True, slots=True)
class RecipeMethod(CommandMethod):
    """A recipe as a method: it describes itself without its parts, and runs once they are there.

    Attributes:
        recipe: Name of the recipe.
        published: What the publication whose name the row carries says; None if none.
    """

    recipe: str = ""
    published: Published | None = None

    @classmethod
    def named(
        cls,
        recipe: str,
        row: str = "",
        views: tuple[int, ...] | None = None,
        published: Published | None = None,
    ) -> RecipeMethod:
        """A row of a recipe, under its own name or another one with other views."""
        method = Recipe.of(recipe).method
        file = replace(method, name=row or method.name, views=views or method.views)
        return cls(file, recipe=recipe, published=published)

    @property
    def info(self) -> MethodInfo:
        """What it is now, with its parts as far as they are there."""
        parts = [self.program()]
        with contextlib.suppress(MissingPart):
            parts += self._parts()
        found = self.described(*parts)
        own = self.published.deviations(found.parameters) if self.published else ()
        return replace(found, deviations=own)

    def program(self) -> Part:
        """Its own files, with what recipes share."""
        part = CommandMethod.program(self)
        sums = {"own": part.sha256, "shared": file_digest(RECIPES / EXCHANGE)}
        return replace(part, sha256=content_hash(sums))

    def _parts(self) -> Iterator[Part]:
        recipe = Recipe.of(self.recipe)
        needs, found = recipe.needs, recipe.installed()
        environment = self.environment()
        yield Part("environment", environment.text, "of its packages", environment.sha256)
        if needs.network:
            yield Part("network", needs.network, needs.network_licence, found.sha256)
        if needs.checkout:
            code = _python_sha256(Path(found.checkout))
            sums = content_hash({"files": found.sha256, "code": code})
            name = f"{needs.source} at {(needs.commit or _head(Path(found.checkout)))[:12]}"
            yield Part("checkout", name, self.file.licence, sums)
        elif needs.modules:
            package = interpreter(found).packages(recipe.name, needs.modules, recipe.command)
            name = f"{recipe.name} ({package.text})"
            yield Part("package", name, self.file.licence, package.sha256)

    def launch(self) -> Launch:
        """In the interpreter that was noted."""
        found = interpreter(Recipe.of(self.recipe).installed())
        return Launch(found, found.program)

    def given(self) -> dict[str, Path]:
        """Checkout and weights, and what recipes share."""
        found = Recipe.of(self.recipe).installed()
        paths = {"weights": found.weights, "checkout": found.checkout, "shared": str(RECIPES)}
        return {name: Path(path) for name, path in paths.items() if path}

    def require_installed(self) -> None:
        """Nothing, if all its parts are there and this machine can hold it.

        Raises:
            MissingPart: something is missing; one sentence with the next command.
            MethodError: this machine has too little memory.
        """
        recipe = Recipe.of(self.recipe)
        found = recipe.require()
        network = self.file.settings.get("network", {})
        if not recipe.needs.view_gib or network.get("device") == "cuda":
            return
        default = recipe.method.settings.get("network", {}).get("side", 1)
        share = (float(network.get("side", default)) / float(default)) ** 2
        views = len(self.file.views or ())
        weights = sum(file.bytes for file in found.files.values()) / _GIB
        needed = 1.0 + weights + views * share * recipe.needs.view_gib
        if (free := available_bytes() / _GIB) < needed:
            raise MethodError(
                f"this machine cannot hold '{self.file.name}'",
                expected=f"about {needed:.1f} GiB of free memory",
                got=f"{free:.1f} GiB",
                hint="End other programs, take fewer views, a smaller 'side', or a larger machine",
            )


def _python_sha256(checkout: Path) -> str:
    """Content id of all Python files of a checkout."""
    files = {path.relative_to(checkout).as_posix(): path for path in checkout.rglob("*.py")}
    return content_hash({name: file_digest(files[name]) for name in sorted(files)})


def _head(checkout: Path) -> str:
    """Which commit a checkout is at, as far as its files say."""
    try:
        head = (checkout / ".git" / "HEAD").read_text().strip()
        name = head.removeprefix("ref: ")
        return (checkout / ".git" / name).read_text().strip() if name != head else head
    except OSError:
        return "an unknown state"


vggt8 = RecipeMethod.named("vggt", published=VGGT_ROW)
vggt2 = RecipeMethod.named("vggt", row="vggt2", views=(0, 4))
da3_8 = RecipeMethod.named("da3")
mapanything8 = RecipeMethod.named("mapanything")
pi3_8 = RecipeMethod.named("pi3")
econ_authors = RecipeMethod.named("econ-authors")
mexecon_authors = RecipeMethod.named("mexecon-authors")
sith = RecipeMethod.named("sith")
pshuman = RecipeMethod.named("pshuman")
gaussians_2d = RecipeMethod.named("2dgs")
