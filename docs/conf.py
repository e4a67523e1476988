"""Settings of the documentation: ``make docs`` builds it, without a network."""

from pathlib import Path

from sb3_hucrl import __version__, checks

project = "sb3_hucrl"
version = release = __version__

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.viewcode"]
exclude_patterns = ["_build", "jupyter_execute"]

# Tutorials are notebooks. They are executed once, and again when their code changes.
nb_execution_mode = "cache"
nb_execution_cache_path = str(Path(__file__).parent / "_build" / "notebooks")
nb_execution_in_temp = True
nb_execution_timeout = 600
nb_execution_raise_on_error = True
nb_merge_streams = True

# Links such as results.md#calibration.
myst_heading_anchors = 3
# Indented blocks are commands.
highlight_language = "text"

autodoc_member_order = "bysource"
# Docstrings say what a parameter means, signatures of which type it is.
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
autodoc_typehints_format = "short"
# Ranges of numbers by their names: sb3_hucrl.checks says what they are.
autodoc_type_aliases = {name: name for name in checks.__all__ if hasattr(checks.kinds, name)}
# What overrides a method of gymnasium or PyTorch does what theirs says.
autodoc_inherit_docstrings = False
autodoc_default_options = {"members": True, "show-inheritance": True}
python_use_unqualified_type_names = True

html_theme = "furo"
html_show_copyright = False
html_title = f"sb3_hucrl {release}"
