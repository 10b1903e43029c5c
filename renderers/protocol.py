"""What a renderer is: a textured mesh and a recipe go in, RGBA files come out."""

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from harness.core.errors import DataError
from harness.core.mesh import Mesh
from harness.core.process.registry import Registry
from harness.core.process.threads import StepReport
from harness.core.settings import RenderRecipe
from harness.geometry.images import check_picture


@dataclass(frozen=True, slots=True)
class RenderOutcome:
    """What a renderer reports about its work.

    Attributes:
        device: The device that computed the pictures, such as ``CPU (2 threads)`` or a GPU's name.
        warnings: What a reader of the capture should know.
    """

    device: str
    warnings: tuple[str, ...] = ()

    @property
    def device_kind(self) -> str:
        """The first word of ``device``, which the pictures depend on: ``CPU`` or a GPU type."""
        return self.device.split()[0]


class Renderer(Protocol):
    """Photographs a mesh. Found by name in ``renderers.protocol``; made without arguments."""

    def render(
        self, mesh: Mesh, recipe: RenderRecipe, directory: Path, progress: StepReport
    ) -> RenderOutcome:
        """Write ``rgb/00.png`` and so on below ``directory``, one per camera of the recipe.

        8-bit RGBA: sRGB colour, not premultiplied; alpha is the share of the pixel's square that
        the mesh covers. Equal arguments give equal files on one machine.

        Args:
            mesh: World metres, with texture.
            recipe: Cameras, light and quality.
            directory: An existing folder.
            progress: Called after every view.

        Raises:
            DataError: the mesh has no texture, or its image cannot be read.
            MethodError: the renderer died.
            MissingPart: the program that it uses is not installed.
        """
        ...


def texture_of(mesh: Mesh) -> Path:
    """The image file of a mesh's texture.

    Raises:
        DataError: the mesh has none, the file is missing, or it is not a usable picture.
    """
    if mesh.texture is None or mesh.uv is None:
        raise DataError(
            f"{mesh.source} has no texture to photograph",
            hint="Load it with its texture: an OBJ with vt records and a material's map_Kd image",
        )
    if not mesh.texture.is_file():
        raise DataError(f"the texture of {mesh.source} is missing", expected=str(mesh.texture))
    check_picture(mesh.texture)
    return mesh.texture


RENDERERS = Registry(
    "renderer",
    {
        # Path-traced photographs, in Blender's own process.
        "blender": "renderers.blender.scene:BlenderRenderer",
        # First hits with plain shading: fast, needs no Blender.
        "raycast": "renderers.raycast:RaycastRenderer",
    },
)
