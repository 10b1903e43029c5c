"""Results that are handed in: a folder of records and meshes, scored again before they count.

``entries`` says where files lie, ``export`` writes results of a run, ``verify`` finds what is wrong
with them, ``compare`` says what they would change, ``merge`` puts results without faults on a
board, and ``page`` shows a board.
"""
