"""The home of all published numbers: those that the MExECON paper prints, and those by subject.

They are shown beside ours only as a block of their own: other subjects, other photos, and a
protocol that is known from the authors' code alone. Nothing here is ever ranked against a measured
row. ``printed.py`` has the paper's tables, ``stored.py`` reads the results by subject from the
files beside it, ``table.py`` makes the table of both.
"""

from reports.published.printed import (
    PUBLISHED,
    UNIT_NOTE,
    PublishedBlock,
    PublishedRow,
    PublishedValue,
)
