"""The page in a headless Chromium: what is drawn, what the controls do, what is asked for."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.unit.reports.page.chromium import Page
from tests.unit.reports.page.pages import CELLS, PHOTO, write_page
from tests.unit.reports.page.viewing import (
    FLAT,
    HIGH,
    LOW,
    MIDDLE,
    NEEDS_CHROMIUM,
    before_scripts,
    choose,
    middle_of,
    move,
    near,
    opened,
    pixel,
)

pytestmark = NEEDS_CHROMIUM


def test_all_triangles_arrive_and_nothing_but_files_is_asked_for(tab: Page, folder: Path) -> None:
    opened(tab, folder, "show=hull8 mexecon vggt /truth")

    wanted = {name: 2 * cells**2 for name, cells in CELLS.items()}
    assert tab.run("HarnessPage.viewer.triangles()") == wanted
    assert tab.requests
    assert [a for a in tab.requests if not a.startswith(("file:", "data:", "blob:"))] == []
    assert tab.complaints == []


def test_errors_have_the_colours_of_the_bar(tab: Page, folder: Path) -> None:
    opened(tab, folder, f"show=hull8 mexecon vggt&{FLAT}")

    for panel, colour in enumerate((LOW, MIDDLE, HIGH)):
        assert near(middle_of(tab, panel), colour), panel


def test_the_limit_changes_what_is_the_last_colour(tab: Page, folder: Path) -> None:
    opened(tab, folder, f"show=mexecon&{FLAT}")
    assert near(middle_of(tab, 0), MIDDLE)

    move(tab, "limit", 500)  # 10 mm, as far as this surface is off
    assert near(middle_of(tab, 0), HIGH)
    assert "10" in tab.run("document.querySelector('.ticks').textContent")


def test_another_metric_has_other_colours_and_its_own_limit(tab: Page, folder: Path) -> None:
    opened(tab, folder, f"show=vggt&{FLAT}")
    tab.run(
        "(() => { const menu = document.getElementById('metric'); menu.value = 'normal_error';"
        " menu.dispatchEvent(new Event('change', { bubbles: true })); })()"
    )

    assert near(middle_of(tab, 0), LOW)
    assert "60" in tab.run("document.querySelector('.ticks').textContent")


def test_normals_that_face_the_camera_are_blue(tab: Page, folder: Path) -> None:
    opened(tab, folder, "show=vggt&shading=normals")

    assert near(middle_of(tab, 0), (128, 128, 255))


def test_the_back_of_an_open_surface_looks_different(tab: Page, folder: Path) -> None:
    opened(tab, folder, f"show=vggt&shading=clay&{FLAT}")
    front = middle_of(tab, 0)
    tab.run("HarnessPage.viewer.lookThrough(2)")

    assert not near(middle_of(tab, 0), front, 20)


def test_a_photo_lies_on_the_surface_that_its_camera_sees(tab: Page, folder: Path) -> None:
    opened(tab, folder, f"show=vggt&shading=photo&{FLAT}")

    assert near(middle_of(tab, 0), PHOTO[:3], 8)


def test_the_photo_over_the_surface_can_be_faded_in(tab: Page, folder: Path) -> None:
    opened(tab, folder, f"show=hull8&{FLAT}")
    assert not tab.run("document.getElementById('overlay').disabled")
    move(tab, "overlay", 100)
    assert near(middle_of(tab, 0), PHOTO[:3], 8)

    move(tab, "overlay", 50)
    half = tuple((a + b) // 2 for a, b in zip(PHOTO, LOW, strict=False))
    assert near(middle_of(tab, 0), half, 8)


def test_the_slider_shows_one_surface_on_each_side(tab: Page, folder: Path) -> None:
    opened(tab, folder, f"show=hull8 vggt&layout=slider&{FLAT}")
    left, right = ("panels[0].width * 0.4", "panels[0].width * 0.6")
    height = "panels[0].height / 2"
    assert near(pixel(tab, left, height), LOW)
    assert near(pixel(tab, right, height), HIGH)

    move(tab, "split", 70)
    assert near(pixel(tab, right, height), LOW)
    assert tab.run("document.querySelector('.divider').style.left") == "70%"


def test_pointing_reads_the_error_from_the_surface(tab: Page, folder: Path) -> None:
    opened(tab, folder, "show=mexecon&shading=clay")
    script = (
        "(() => { const { width, height } = HarnessPage.viewer.panels()[0];"
        " return HarnessPage.viewer.valueAt(width * {x}, height / 2); })()"
    )

    assert tab.run(script.replace("{x}", "0.5"))["value"] == pytest.approx(10.0, abs=0.06)
    assert tab.run(script.replace("{x}", "0.01")) is None


def test_keys_turn_the_view_and_lead_back(tab: Page, folder: Path) -> None:
    opened(tab, folder, "show=hull8")
    press = (
        "document.querySelector('canvas').dispatchEvent("
        "new KeyboardEvent('keydown', {{ key: '{}' }}))"
    )
    assert tab.run("HarnessPage.viewer.state.view") == 0

    tab.run(press.format("ArrowRight"))
    assert tab.run("HarnessPage.viewer.state.view") is None
    tab.run(press.format("2"))
    assert tab.run("HarnessPage.viewer.state.view") == 1
    tab.run(press.format("0"))
    assert tab.run("HarnessPage.viewer.state.view") == 0


def test_a_turned_view_passes_smoothly_out_of_a_photo(tab: Page, folder: Path) -> None:
    opened(tab, folder, f"show=hull8&{FLAT}")
    edge = ("panels[0].width / 2", "panels[0].height * {}")
    rows = [edge[1].format(share / 100) for share in range(2, 50, 2)]
    before = [pixel(tab, edge[0], row) for row in rows]
    tab.run("HarnessPage.viewer.turn(0, 0, 1)")

    assert tab.run("HarnessPage.viewer.state.view") is None
    assert [pixel(tab, edge[0], row) for row in rows] == before


def test_tables_are_sorted_by_a_column(tab: Page, folder: Path) -> None:
    opened(tab, folder)
    values = (
        "[...document.querySelector('[data-table=geometry]').tBodies].filter((b) => "
        "!b.classList.contains('apart')).map((b) => "
        "b.rows[0].querySelector('[data-value]')?.dataset.value ?? null)"
    )
    head = "document.querySelector('[data-table=geometry] th.number')"
    upward = [float(v) for v in tab.run(values) if v is not None]
    assert upward == sorted(upward)
    assert tab.run(f"{head}.getAttribute('aria-sort')") == "ascending"

    tab.run(f"{head}.querySelector('button').click()")
    assert [float(v) for v in tab.run(values) if v is not None] == sorted(upward, reverse=True)
    assert tab.run(f"{head}.getAttribute('aria-sort')") == "descending"


def test_a_method_tells_its_parts_and_a_number_its_records(tab: Page, folder: Path) -> None:
    opened(tab, folder)
    tab.run("document.querySelector('a.method[data-method=mexecon]').focus()")
    assert "Parts" in tab.run("document.getElementById('card').textContent")

    tab.run("document.querySelector('button.value[data-method=hull8]').click()")
    links = tab.run("[...document.querySelectorAll('#card a')].map((a) => a.getAttribute('href'))")
    assert links == [f"records/hull8/a0{k}.json" for k in (1, 2, 3)]
    tab.run("document.dispatchEvent(new KeyboardEvent('keydown', { key: 'Escape' }))")
    assert tab.run("document.getElementById('card').hidden")


def test_everything_that_can_be_used_has_a_name(tab: Page, folder: Path) -> None:
    opened(tab, folder)
    nameless = tab.run(
        "[...document.querySelectorAll('button, select, input, a, canvas')].filter((e) => !("
        "e.getAttribute('aria-label') || e.textContent.trim() || e.labels?.length))"
        ".map((e) => e.outerHTML)"
    )

    assert nameless == []


def go_to(tab: Page, subject: str) -> None:
    choose(tab, "subject", subject)
    tab.run(
        "new Promise((done) => { const { state } = HarnessPage.viewer; const wait = () => "
        f"state.subject === '{subject}' && location.hash.includes('{subject}')"
        " ? done() : setTimeout(wait, 20); wait(); })"
    )


def test_another_subject_keeps_the_panels_that_it_has(tab: Page, folder: Path) -> None:
    opened(tab, folder, "show=hull8 mexecon vggt")
    go_to(tab, "a02")
    assert tab.run("HarnessPage.viewer.triangles()") == {"hull8": 32, "vggt": 72}

    go_to(tab, "a01")
    assert tab.run("HarnessPage.viewer.triangles()") == {"hull8": 32, "mexecon": 50, "vggt": 72}


def test_nothing_is_wider_than_a_phone(tab: Page, folder: Path) -> None:
    opened(tab, folder, size=(360, 740))
    tab.run(
        "(() => { const row = document.querySelector('.subjects');"
        " for (let k = 0; k < 20; k++) row.append(row.lastElementChild.cloneNode(true)); })()"
    )

    assert tab.run("document.documentElement.scrollWidth") <= 360
    assert len(tab.run("HarnessPage.viewer.state.panels")) == 2


def test_a_copied_and_a_locked_folder_open_as_well(tab: Page, folder: Path, tmp_path: Path) -> None:
    copy = tmp_path / "with spaces & ä" / "page"
    shutil.copytree(folder, copy)
    for path in [copy, *copy.rglob("*")]:
        path.chmod(0o555 if path.is_dir() else 0o444)
    try:
        opened(tab, copy, "show=hull8 /truth")
        assert tab.run("HarnessPage.viewer.triangles()") == {"hull8": 32, "/truth": 18}
        assert tab.complaints == []
        assert all("/with%20spaces" in a for a in tab.requests if a.startswith("file:"))
    finally:
        for path in [copy, *copy.rglob("*")]:
            path.chmod(0o755)


def test_a_missing_surface_is_said_and_the_others_are_shown(
    tab: Page, folder: Path, tmp_path: Path
) -> None:
    copy = tmp_path / "page"
    shutil.copytree(folder, copy)
    (copy / "surfaces" / "vggt" / "a01.js").unlink()
    opened(tab, copy, "show=hull8 vggt")

    assert tab.run("HarnessPage.viewer.triangles()") == {"hull8": 32, "vggt": 0}
    assert "copy the whole folder" in tab.run(
        "document.querySelector('.stage .notice').textContent"
    )


def test_a_page_without_photos_turns_as_well(tab: Page, tmp_path: Path) -> None:
    bare = write_page(tmp_path / "page", photos=False).parent
    opened(tab, bare, f"show=hull8&{FLAT}")

    assert near(middle_of(tab, 0), LOW)
    assert tab.complaints == []


def test_without_graphics_photos_and_tables_are_there(tab: Page, folder: Path) -> None:
    with before_scripts(tab, "HTMLCanvasElement.prototype.getContext = () => null;"):
        opened(tab, folder)
        assert "WebGL" in tab.run("document.querySelector('.stage .notice').textContent")
        assert tab.run("document.querySelectorAll('.photos img').length") == 4
        assert tab.run("HarnessPage.tablesReady")
        assert tab.complaints == []


STAGE = {"light": (241, 239, 234), "dark": (26, 29, 32)}


def test_the_stage_has_its_colour_in_the_canvas_itself(tab: Page, folder: Path) -> None:
    opened(tab, folder, "show=hull8")
    for theme, colour in STAGE.items():
        tab.run(f"document.documentElement.dataset.theme = '{theme}'")
        assert pixel(tab, "2", "panels[0].height - 2") == colour

    opaque = "document.querySelector('canvas').getContext('webgl2').getContextAttributes().alpha"
    assert tab.run(opaque) is False


def test_paper_is_white(tab: Page, folder: Path) -> None:
    opened(tab, folder, "show=hull8")
    tab.run(
        "document.documentElement.dataset.theme = 'dark'; dispatchEvent(new Event('beforeprint'))"
    )
    assert pixel(tab, "2", "panels[0].height - 2") == (255, 255, 255)

    tab.run("dispatchEvent(new Event('afterprint'))")
    assert pixel(tab, "2", "panels[0].height - 2") == STAGE["dark"]


def test_graphics_that_were_reset_draw_again(tab: Page, folder: Path) -> None:
    opened(tab, folder, f"show=hull8 vggt&{FLAT}")
    tab.run(
        "new Promise((done) => { const canvas = document.querySelector('canvas');"
        " const lose = canvas.getContext('webgl2').getExtension('WEBGL_lose_context');"
        " canvas.addEventListener('webglcontextrestored', () => setTimeout(done, 50));"
        " const restore = () => setTimeout(() => lose.restoreContext(), 50);"
        " canvas.addEventListener('webglcontextlost', restore);"
        " lose.loseContext(); })"
    )

    assert near(middle_of(tab, 0), LOW)
    assert near(middle_of(tab, 1), HIGH)


#: What a screen reader calls things that can be used.
USABLE = {"button", "link", "combobox", "slider", "radio", "checkbox", "tab", "application"}


def test_a_screen_reader_hears_a_name_for_everything_that_can_be_used(
    tab: Page, folder: Path
) -> None:
    opened(tab, folder, "show=hull8 mexecon")
    nodes = tab.call("Accessibility.getFullAXTree")["nodes"]
    usable = [
        (node["role"]["value"], node["name"]["value"])
        for node in nodes
        if not node["ignored"] and node["role"]["value"] in USABLE
    ]

    assert {role for role, _ in usable} == USABLE
    assert [role for role, name in usable if not name.strip()] == []
    assert {"Surface 1", "Surface 2"} <= {name for role, name in usable if role == "combobox"}
    assert any(name.startswith("3-D view") for _, name in usable)


def test_tab_reaches_every_control_of_the_viewer(tab: Page, folder: Path) -> None:
    opened(tab, folder, "show=hull8 mexecon")
    reached = set()
    for _ in range(60):
        for kind in ("rawKeyDown", "keyUp"):
            values = {"type": kind, "key": "Tab", "code": "Tab", "windowsVirtualKeyCode": 9}
            tab.call("Input.dispatchKeyEvent", values)
        reached.add(
            tab.run("(({ id, name, tagName }) => id || name || tagName)(document.activeElement)")
        )

    wanted = {"subject", "CANVAS", "SELECT", "shading", "metric", "limit", "layout", "light"}
    assert wanted | {"wires", "overlay", "front"} <= reached


def touch(tab: Page, kind: str, *points: tuple[float, float]) -> None:
    found = [{"x": x, "y": y, "id": number} for number, (x, y) in enumerate(points)]
    tab.call("Input.dispatchTouchEvent", {"type": f"touch{kind}", "touchPoints": found})


def test_fingers_turn_and_zoom_on_a_phone_and_scroll_past_the_view(tab: Page, folder: Path) -> None:
    tab.call("Emulation.setTouchEmulationEnabled", {"enabled": True, "maxTouchPoints": 2})
    try:
        opened(tab, folder, "show=hull8 mexecon", size=(390, 844))
        box = tab.run(
            "(({ x, y }) => [x, y])(document.querySelector('canvas').getBoundingClientRect())"
        )
        x, y = box[0] + 100, box[1] + 150
        edge = "panels[0].width * 0.1", "panels[0].height / 2"
        assert tab.run("HarnessPage.viewer.state.view") == 0
        before = pixel(tab, *edge)

        touch(tab, "Start", (x, y))
        for step in range(1, 9):
            touch(tab, "Move", (x + 12 * step, y))
        touch(tab, "End")
        assert tab.run("HarnessPage.viewer.state.view") is None
        assert pixel(tab, *edge) != before

        distance = "HarnessPage.viewer.distance()"
        far = tab.run(distance)
        touch(tab, "Start", (x - 20, y), (x + 20, y))
        for step in range(1, 9):
            touch(tab, "Move", (x - 20 - 5 * step, y), (x + 20 + 5 * step, y))
        touch(tab, "End")
        assert tab.run(distance) < 0.9 * far
        assert tab.run("scrollY") == 0

        tab.run("document.getElementById('front').click()")
        touch(tab, "Start", (x, y + 200))
        for step in range(1, 13):
            touch(tab, "Move", (x, y + 200 - 20 * step))
        touch(tab, "End")
        tab.run("new Promise((done) => setTimeout(done, 200))")
        assert tab.run("scrollY") > 100
        assert tab.run("HarnessPage.viewer.state.view") == 0
    finally:
        tab.call("Emulation.setTouchEmulationEnabled", {"enabled": False})
