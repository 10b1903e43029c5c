"""The page itself: head, viewer, tables, methods and failures, as one HTML document."""

from __future__ import annotations

from html import escape
from urllib.parse import quote

from reports.page.data_script import thumbnail_path
from reports.page.frame import (
    RESULT_SECTIONS,
    PageFrame,
    about_html,
    failures_section,
    results_html,
)
from reports.page.model import PageModel, PageSubject

#: The page's own scripts in the order in which they are loaded; three.js comes before them.
SCRIPTS = (
    "page.js",
    "decode.js",
    "shaders.js",
    "views.js",
    "viewer.js",
    "loading.js",
    "controls.js",
    "tables.js",
)

_SHADINGS = (("error", "Error"), ("clay", "Clay"), ("normals", "Normals"), ("photo", "Photo"))


def page_html(model: PageModel) -> str:
    """The document; tables, methods and failures are complete in it, before any script runs."""
    first, *others = (f"web/{name}" for name in SCRIPTS)
    frame = PageFrame(
        title=model.title,
        lead=model.lead,
        scripts=(first, "data.js", "web/three.js", *others),
        sections=("surfaces", *RESULT_SECTIONS),
    )
    credit = (
        'The 3-D view uses <a href="web/three.LICENSE.txt">three.js</a> (MIT licence). '
        "This page loads nothing from a network."
    )
    return frame.html(
        "\n".join(
            [
                _viewer(model),
                results_html(model.tables, model.methods),
                failures_section(model.records, [subject.id for subject in model.subjects]),
                about_html(model.facts, credit),
            ]
        )
    )


def _viewer(model: PageModel) -> str:
    """The frame of the viewer; the script fills it."""
    if not any(subject.surfaces for subject in model.subjects):
        return ""
    subjects = "".join(_subject_choice(subject) for subject in model.subjects)
    shadings = "".join(
        f'<label><input type="radio" name="shading" value="{value}"'
        f"{' checked' if value == 'error' else ''}><span>{text}</span></label>"
        for value, text in _SHADINGS
    )
    metrics = "".join(
        f'<option value="{escape(scalar.id)}">{escape(scalar.title)} ({escape(scalar.unit)})'
        "</option>"
        for scalar in model.scalars
    )
    return f"""\
<section id="surfaces" aria-labelledby="surfaces-title">
<h2 id="surfaces-title" class="unseen">Surfaces</h2>
<noscript><p class="notice">The surfaces need JavaScript. The tables below do not.</p></noscript>
<div class="subjects" role="radiogroup" aria-label="Subject">{subjects}</div>
<div class="stage">
<div class="panels" role="group" aria-label="Surfaces side by side"></div>
<canvas tabindex="0" role="application" aria-label="3-D view. Drag or use the arrow keys to \
turn, plus and minus to zoom, 0 to return to the front, 1 to 9 to look through a photo's \
camera."></canvas>
<div class="divider" hidden></div>
<output class="probe" hidden></output>
<p class="notice" role="status" hidden></p>
</div>
<form class="tools" autocomplete="off" aria-label="How surfaces are shown">
<fieldset class="choice"><legend>Shading</legend>{shadings}</fieldset>
<div class="scale">
<label for="metric">Colour</label><select id="metric">{metrics}</select>
<div class="bar"><div class="ramp" aria-hidden="true"></div>\
<div class="ticks" aria-hidden="true"></div></div>
<label class="slide" for="limit">Limit<input type="range" id="limit" min="0" max="1000"></label>
</div>
<fieldset class="choice"><legend>Layout</legend>
<label><input type="radio" name="layout" value="side" checked><span>Side by side</span></label>
<label><input type="radio" name="layout" value="slider"><span>Slider</span></label>
</fieldset>
<label class="toggle"><input type="checkbox" id="light" checked><span>Light</span></label>
<label class="toggle"><input type="checkbox" id="wires"><span>Wireframe</span></label>
<label class="slide" for="overlay">Photo over it<input type="range" id="overlay" min="0" \
max="100" value="0" disabled></label>
<label class="slide" for="split" hidden>Boundary<input type="range" id="split" min="0" max="100" \
value="50"></label>
<button type="button" id="front">Front</button>
</form>
<div class="photos" role="group" aria-label="Look through a photo's camera"></div>
</section>"""


def _subject_choice(subject: PageSubject) -> str:
    picture = (
        f'<img src="{escape(quote(thumbnail_path(subject.id)))}" alt="" loading="lazy">'
        if subject.views
        else ""
    )
    about = f'<span class="about">{escape(subject.description)}</span>'
    return (
        f'<label><input type="radio" name="subject" value="{escape(subject.id)}">'
        f"<span>{picture}<b>{escape(subject.id)}</b>{about}</span></label>"
    )
