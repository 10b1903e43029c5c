"""What was found of the subjects that were looked at last."""

from __future__ import annotations

import threading
from collections import OrderedDict

from harness.core.errors import HarnessError
from harness.pipeline.run.plan import SubjectFiles

_MOST = 64


class KnownFiles:
    """Photos and scans of subjects, or why there are none; for several threads.

    A method's worker looks again whether they are still the same, so that a subject's cells can
    share what was found.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._found: OrderedDict[str, SubjectFiles | HarnessError] = OrderedDict()

    def get(self, subject: str) -> SubjectFiles | HarnessError | None:
        """What was found last, or None."""
        with self._lock:
            return self._found.get(subject)

    def put(self, subject: str, files: SubjectFiles | HarnessError) -> None:
        """Take this for what there is of a subject; what is oldest goes."""
        with self._lock:
            self._found[subject] = files
            self._found.move_to_end(subject)
            while len(self._found) > _MOST:
                self._found.popitem(last=False)
