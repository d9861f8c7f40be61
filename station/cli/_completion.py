"""Scripts of `station completion`, from the commands themselves."""

from collections.abc import Mapping

from station.cli.app import commands, long_options
from station.errors import UsageError

_BASH = """\
_station() {
    local word=${COMP_WORDS[COMP_CWORD]}
    case "${COMP_CWORD}:${COMP_WORDS[1]}" in
        1:*) COMPREPLY=($(compgen -W "COMMANDS --help --version" -- "$word")); return;;
CASES
    esac
    [[ $word == -* ]] || COMPREPLY=($(compgen -f -- "$word"))
}
complete -o filenames -F _station station
"""


def script(shell: str) -> str:
    """The script for a shell. Errors: UsageError."""
    found = {name: long_options(name) for name in commands()}
    if shell == "fish":
        return _fish(found)
    if shell not in ("bash", "zsh"):
        raise UsageError("completion-unknown-shell", shell=shell[:20])
    cases = [f'        *:{n}) COMPREPLY=($(compgen -W "{" ".join(o)}" -- "$word"));;' for n, o in found.items()]
    text = _BASH.replace("COMMANDS", " ".join(found)).replace("CASES", "\n".join(cases))
    return text if shell == "bash" else "autoload -U +X bashcompinit && bashcompinit\n" + text


def _fish(found: Mapping[str, tuple[str, ...]]) -> str:
    lines = []
    for name, line in commands().items():
        lines.append(f"complete -c station -n __fish_use_subcommand -a {name} -d {_quoted(line)}")
        condition = f"'__fish_seen_subcommand_from {name}'"
        lines += [f"complete -c station -n {condition} -l {option.removeprefix('--')}" for option in found[name]]
    return "\n".join(lines)


def _quoted(text: str) -> str:
    return "'" + text.replace("\\", "\\\\").replace("'", "\\'") + "'"
