"""A static page of one run: tables, photos and surfaces that turn, opened from a file.

``model`` says what a page shows, ``compact_mesh`` and ``photos`` are the forms of its large files,
and ``folder`` writes it. ``web`` holds what every page is shipped with: style, code and three.js.
"""
