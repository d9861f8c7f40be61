"""How Sphinx builds the site; docs/site/build.py calls it."""

import station

project = "CAN calibration station"
version = release = station.__version__
extensions = ["myst_parser"]
html_theme = "furo"
html_static_path = ["static"]
html_css_files = ["wide.css"]
html_title = f"{project} {release}"
html_copy_source = False
html_show_sphinx = False
myst_heading_anchors = 4
myst_enable_extensions = ["deflist"]
# Blocks show terminals, files and formulas of many kinds; none of them has to be a program.
suppress_warnings = ["misc.highlighting_failure"]
highlight_language = "text"
