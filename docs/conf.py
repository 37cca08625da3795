"""Configuration of Sphinx: ``sphinx-build -W --keep-going -j 2 docs build/docs``.

Without the notebooks: ``-D nb_execution_mode=off``. Pages load no external resources; links are checked at the end.
"""

import sys
from pathlib import Path

import fitmodels

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

project = "fitmodels"
author = "The fitmodels developers"
project_copyright = author
version = release = fitmodels.__version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "commands",
    "links",
    "mathml",
    "notebooks",
    "roles",
    "packages",
    "schema",
]
exclude_patterns = ["_ext", "examples", "reproduction"]

myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 120
nb_execution_in_temp = True
nb_ipywidgets_js: dict[str, dict[str, str]] = {}  # no external scripts

autodoc_default_options = {"members": True, "member-order": "bysource"}
autodoc_typehints = "none"  # types, shapes and units are in the docstrings
autosummary_generate = False
napoleon_google_docstring = False
napoleon_use_rtype = False

toc_object_entries_show_parents = "hide"

html_theme = "furo"
html_title = f"fitmodels {version}"
html_static_path = ["_static"]
html_css_files = ["pages.css"]
html_math_renderer = "mathml"
html_copy_source = False
html_show_sphinx = False
