"""Results that are handed in: a folder of records and meshes, scored again before they count.

``entries`` reads them, ``copying`` writes results of a run and puts those without faults on a
board, ``verify`` finds what is wrong with them, ``compare`` says what they would change, ``page``
shows a board, and ``record_file`` has the records of a run in one file.
"""
