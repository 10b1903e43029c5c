"""Generated clothed avatars: free to use, with the true body underneath.

Read ``recipe`` (who and what), ``body`` (Anny), ``garments`` and ``hair`` (surfaces in the rest
pose), ``visibility`` (the outer surface), ``texture`` and ``paint``, ``writer``; ``build`` joins
them.
"""

from harness.data.avatars.build import AVATARS_VERSION, make_avatar
from harness.data.avatars.recipe import AvatarRecipe, recipe_for, subject_ids

__all__ = ["AVATARS_VERSION", "AvatarRecipe", "make_avatar", "recipe_for", "subject_ids"]
