"""Networks that turn photos into depth and cameras in one pass, each a thin source of points.

``source`` is what they share; ``vggt``, ``da3`` and ``mapanything`` say how each is asked and
answers; ``workers`` holds the one file that runs each of them in the user's own installation.
``checkpoint`` reduces VGGT's weights to what is used, and ``memory`` says what that takes.
"""
