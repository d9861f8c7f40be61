"""Messages are data: an id and its parameters. Only the faces turn one into a sentence, in the reader's language.

A catalogue is a folder `catalogues/CODE/` of TOML files with one line a message: `id = "Sentence with {parameters}."`
Parameters take Python's format specs (`{offset:+.4g}`), `{count:plural(frame|frames)}` and, for a sequence,
`{names:join(; )}`; `{coefficient:term}` is the name of a quantity in that language. A parameter may itself be a
message, or a sequence of them; it is rendered in the same language.
"""

from station.messages.catalogue import languages, render, templates, term, term_id
from station.messages.message import Message, Value
from station.messages.system import system_reason

__all__ = ["Message", "Value", "languages", "render", "system_reason", "templates", "term", "term_id"]
