"""How long a page takes to open: ``python -m tests.unit.reports.page.times runs/quickstart/page``.

Seconds until the first view and until all full surfaces are drawn, on the clock and of processor
time in all processes of the browser. The first line is of a browser that has just started.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import psutil

from tests.unit.reports.page.chromium import Page, browser, find_chromium

#: Resolves when graphics have really drawn what the promise stands for.
DRAWN = """(async () => {
  await HarnessPage.%s;
  await new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
  const gl = document.querySelector('canvas').getContext('webgl2');
  gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
  return [performance.now() / 1000, HarnessPage.viewer.drawn()];
})()"""
LIMIT_S = 300


def processor_s() -> float:
    """Processor time of all processes that this one has started and that still run."""
    times = [child.cpu_times() for child in psutil.Process().children(recursive=True)]
    return sum(each.user + each.system for each in times)


def opened(tab: Page, page: Path, address: str) -> str:
    """A line on one opening of the page."""
    begin = processor_s()
    tab.open(page / "index.html", f"#{address}" if address else "", (1280, 900))
    parts: list[str] = []
    for name, promise in (("first view", "firstView"), ("full", "ready")):
        seconds, faces = tab.run(DRAWN % promise, LIMIT_S)
        used = processor_s() - begin
        parts.append(
            f"{name} {seconds:.2f} s (processor {used:.2f} s), {sum(faces.values())} faces"
        )
    return "; ".join(parts)


def main() -> None:
    """Open the page several times and say how long each took."""
    parser = argparse.ArgumentParser(description="Measure how long a page takes to open.")
    parser.add_argument("page", type=Path, help="folder of a page")
    parser.add_argument("--address", default="", help="what is shown, as after # in the address")
    parser.add_argument("--times", type=int, default=5, help="how often it is opened again")
    arguments = parser.parse_args()
    program = find_chromium()
    if program is None:
        parser.error("no Chromium: install it (apt-get install chromium) or set HARNESS_CHROMIUM")
    with tempfile.TemporaryDirectory() as profile, browser(program, Path(profile)) as tab:
        for _ in range(1 + arguments.times):
            print(opened(tab, arguments.page.resolve(), arguments.address), flush=True)
            time.sleep(0.3)


if __name__ == "__main__":
    main()
