"""Rows of recipes: methods of others, in the user's own installation, with the user's own weights.

Each answers with a mesh, depth maps, points or Gaussians; the rest is the same for all.

Before: ``renderers/blender/scene.py``. After: ``metrics/distance.py``.
"""

from __future__ import annotations

from methods.foreign.recipes import RecipeMethod
from methods.publications.deviations import VGGT_ROW

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
