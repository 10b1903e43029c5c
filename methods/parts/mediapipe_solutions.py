"""MediaPipe, which finds landmarks and marks people (0.10.21, Apache-2.0, models in its wheel)."""

from concurrent.futures import ThreadPoolExecutor
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from harness.core.missing import not_installed


def titled(solution: str) -> str:
    """A solution's name as records and captures have it, with the installed version if any."""
    try:
        return f"MediaPipe {solution} {version('mediapipe')}"
    except PackageNotFoundError:
        return f"MediaPipe {solution}"


def solutions(purpose: str, otherwise: str = "") -> Any:
    """MediaPipe's module of solutions.

    Args:
        purpose: What needs it, as the beginning of a sentence: ``making masks``.
        otherwise: What to do instead of installing it, for the hint.

    Raises:
        MissingPart: MediaPipe is not installed.
    """
    try:
        # In a thread of its own: where PortAudio is missing, MediaPipe keeps the exception, and an
        # exception keeps all values of all functions that were being carried out in its thread.
        with ThreadPoolExecutor(1) as importer:
            mediapipe = importer.submit(_mediapipe).result()
    except ImportError as error:
        raise not_installed("mediapipe", purpose, otherwise) from error
    return mediapipe.solutions


def _mediapipe() -> Any:
    import mediapipe

    return mediapipe
