"""Generated clothed avatars: free to use, with the true body underneath.

Read ``recipe`` (who and what: ``subjects``, ``training``, ``populations``, ``creased_people``,
``looks``, ``wardrobe``, ``weaves``, ``poses``, ``postures``), ``body`` (Anny), ``deformation``
(bodies that Anny cannot give), ``patterns`` and ``panels`` (clothes cut on ``quads``), ``drape``
(Blender's cloth solver, in ``drape_worker``; ``stored`` keeps its results), ``creased_clothes`` and
``wrinkles`` (folds finer than a drape has), ``hair`` and ``extras``, ``shell`` (one outer surface),
``scanner`` (its noise), ``atlas``, ``fabric`` and ``paint`` (its texture), ``checks``, ``writer``;
``build`` joins them, ``sheet`` shows the result.
"""
