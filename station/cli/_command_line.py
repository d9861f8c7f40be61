"""What is wrong with a command line, in sentences of ours: those of the parser and its validator reach nobody."""

import difflib
import re
from collections.abc import Sequence
from typing import Any, Literal, get_args, get_origin

from pydantic import BaseModel, ValidationError

from station.config.validation_messages import mistakes
from station.errors import UsageError
from station.messages import Message

#: A serial as most products print it.
_SERIAL = re.compile(r"[A-Za-z]{1,5}[-_]?\d{2,}")


def command_line_error(command: str, parameters: Sequence[Any], words: Sequence[str], exc: Any) -> UsageError:
    """The error for what typer's parser raised over these words, for a command with these parameters."""
    return UsageError("command-line-wrong", command=command, why=_reason(exc, parameters, words))


def _reason(exc: Any, parameters: Sequence[Any], words: Sequence[str]) -> Message:
    if isinstance(exc.__cause__, ValidationError):
        return Message("option-wrong", option=_name(exc.param), reason=_wrong_value(exc.param, exc.__cause__))
    option = getattr(exc, "option_name", None)
    if option is None:
        param = getattr(exc, "param", None)
        if param is None:
            surplus = _surplus(exc)
            option = _option_for(surplus, [o for p in parameters for o in p.opts], words)
            if option is not None:
                return Message("words-for-option", words=surplus, option=option)
            return Message("words-surplus", words=surplus)
        return Message("argument-missing", name=_name(param))
    known = next((p for p in parameters if option in (*p.opts, *p.secondary_opts)), None)
    if known is None:
        if not option.startswith("--"):
            option = next((w for w in words if w.startswith(option)), option)  # the parser names `-x` of `-xyz`
        return _unknown(option, [o for p in parameters for o in (*p.opts, *p.secondary_opts) if o.startswith("-")])
    return Message("option-takes-no-value" if known.is_flag else "option-without-value", option=option)


def _option_for(surplus: str, options: Sequence[str], words: Sequence[str]) -> str | None:
    """The option that a single word was meant for: `station run six-point`, as `station check six-point`."""
    option = "--serial" if _SERIAL.fullmatch(surplus) else "--recipe"
    return option if option in options and option not in words and " " not in surplus else None


def _wrong_value(param: Any, exc: ValidationError) -> Message:
    kind = param.type_descriptor.annotation
    if get_origin(kind) is Literal:
        given = repr(exc.errors(include_url=False)[0]["input"])[:60]
        return Message("value-none-of", choices=tuple(map(repr, get_args(kind))), given=given)
    return mistakes(exc, BaseModel)[0]


def _unknown(option: str, known: Sequence[str]) -> Message:
    near = [o for o in known if len(option) > 2 and o.startswith(option)] or [
        f"--{name}" for name in difflib.get_close_matches(option.strip("-")[:40], [o.strip("-") for o in known], n=1)
    ]
    if near:
        return Message("option-near", option=option[:40], nearest=near[0])
    return Message("option-unknown", option=option[:40])


def _name(param: Any) -> str:
    """`--option`, or an argument as the usage line shows it."""
    options = [o for o in param.opts if o.startswith("-")]
    return max(options, key=len) if options else str(param.name).upper().rstrip("_")


def _surplus(exc: Any) -> str:
    """The words that no argument takes, from the brackets in which the parser has them."""
    text = str(exc.message)
    return text[text.find("(s) (") + 5 : -1][:60] if "(s) (" in text else text[:60]
