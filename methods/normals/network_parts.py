"""The kind of part ``normals-onnx``: networks that estimate normals, shipped and imported."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

from methods.normals import installed
from methods.normals.recipes import RECIPES, prepared
from methods.parts.kind import About, ImportOptions, InstalledPart, PartCheck
from methods.parts.store import require_file


class _Networks:
    """Networks in the form of ``methods/normals/onnx_estimator.py``; see ``PartKind``."""

    about = About(
        name="normals-onnx",
        role="normal estimator",
        purpose="a network that turns a photo into normals of clothes",
        licence="as the file says",
        source="the package open-normals has one; 'harness train normals' trains another one; for "
        "photos of real people take DAViD's surface normal model (MIT, https://aka.ms/DAViD), with "
        f"--recipe {next(iter(RECIPES))}",
        files=("FILE.onnx",),
        takes=("name", "recipe"),
    )

    def installed(self) -> Sequence[InstalledPart]:
        """Shipped ones first; see ``PartKind``."""
        places = (*installed.shipped_places(), installed.imported_place())
        return [_described(network) for place in places for network in installed.listed(place)]

    def add(self, file: Path, options: ImportOptions) -> InstalledPart:
        """Check a network and copy it; see ``PartKind``."""
        options.require_taken_by(self.about)
        place = installed.imported_place()
        name = options.name or options.recipe or file.stem
        if not options.recipe:
            return _described(installed.import_file(file, name, place, replace=options.replace))
        require_file(file)
        with tempfile.TemporaryDirectory(prefix="network-") as folder:
            made = Path(folder) / f"{options.recipe}.onnx"
            prepared(file, options.recipe, made)
            return _described(installed.import_file(made, name, place, replace=options.replace))

    def check(self, part: InstalledPart) -> PartCheck:
        """A network against its sum; see ``PartKind``."""
        found = next(
            check
            for check in installed.check([part.name])
            if check.network.place.title == part.place
        )
        return PartCheck(part, found.state, found.note)

    def usage(self, part: InstalledPart) -> str:
        """The command that uses a network; see ``PartKind``."""
        shipped = part.place == "shipped" and part.name == installed.OPEN_NETWORK
        chosen = "open" if shipped else f"onnx --set surface.normals_model={part.name}"
        return f"harness eval --method econ --set surface.normals={chosen}"


def _described(network: installed.Network) -> InstalledPart:
    return InstalledPart(
        kind=_Networks.about.name,
        name=network.name,
        title=network.name,
        licence=network.licence,
        path=network.path,
        bytes=network.bytes,
        sha256=network.sha256,
        source_sha256=network.sha256,
        place=network.place.title,
        note=f"trained on {network.training_set}" if network.training_set else "",
    )


NETWORKS = _Networks()
