"""Sphinx's settings of the documentation site; ``build.py`` lays out the pages that it reads."""

from __future__ import annotations

from typing import get_origin

from numpy import ndarray

import harness
from harness.core import arrays

project = "mexecon-harness"
author = "the mexecon-harness authors"
version = release = harness.__version__
language = "en"

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
root_doc = "index"
# As deep as headings go; links to them are checked.
myst_heading_anchors = 6

autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
autodoc_type_aliases = {
    name: f"harness.core.arrays.{name}"
    for name, alias in vars(arrays).items()
    if get_origin(alias) is ndarray and name != "NDArray"
}
python_use_unqualified_type_names = True
# Attributes are fields of their class, not entries beside those of the class's own code.
napoleon_use_ivar = True
# Their types stand in the signature.
napoleon_attr_annotations = False
napoleon_google_docstring = True
napoleon_numpy_docstring = False

html_theme = "furo"
html_title = "mexecon-harness"
html_copy_source = False
html_show_copyright = False
html_show_sphinx = False
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_theme_options = {
    "light_css_variables": {"color-brand-primary": "#245a7a", "color-brand-content": "#245a7a"},
    "dark_css_variables": {"color-brand-primary": "#8fc1dc", "color-brand-content": "#8fc1dc"},
}
