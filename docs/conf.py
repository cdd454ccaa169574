"""Settings of the documents: ``make docs`` builds them, and a warning is an error."""

import re

import plumbline

project = "plumbline"
author = "plumbline contributors"
release = plumbline.__version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.mathjax",
    "sphinx.ext.napoleon",
]
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
# The tests run the notebooks, and `make notebooks` stores what they show; to run them once more for
# each build of the pages would take minutes and could show something else than what is committed.
nb_execution_mode = "off"
exclude_patterns = ["_build"]

autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
autodoc_typehints = "signature"
napoleon_google_docstring = True
napoleon_use_ivar = True

html_theme = "furo"
html_title = "plumbline"


def shorter(app, what, name, obj, options, signature, returns):
    """A signature that calls the library of effects, and what NumPy takes, by their names."""
    said = re.sub(r"\((<class '[^']+'>,? ?)+\)", "EFFECTS", signature or "")
    said = re.sub(r"~?[\w.]*_Buffer \| .*?\[complex \| bytes \| str\]", "ArrayLike", said)
    return said or None, returns


def setup(app):
    """Tables in plain text have no lexer of their own."""
    from pygments.lexers.special import TextLexer

    app.add_lexer("csv", TextLexer)
    app.connect("autodoc-process-signature", shorter)
