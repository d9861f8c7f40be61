"""Pages that commands write: templates of this folder, in which every text is escaped."""

from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

_FOLDER = Path(__file__).parent / "templates"


def environment() -> Environment:
    """The templates; only drawings, whose makers escape, go in as they are. A name that is not there is an error."""
    made = Environment(loader=FileSystemLoader(_FOLDER), autoescape=True, undefined=StrictUndefined)
    made.filters["drawing"] = Markup
    return made
