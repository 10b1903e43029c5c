"""What a method has besides that runs on something the user installs: it can say what is missing.

Such a method describes itself, and is listed and documented, whether or not it can run here.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable


@runtime_checkable
class Installable(Protocol):
    """Knows whether it can run on this machine before it is run."""

    def require_installed(self) -> None:
        """Nothing, if it can.

        Raises:
            MissingPart: something is not installed; the hint is the next command.
            MethodError: this machine cannot hold it.
        """
        ...
