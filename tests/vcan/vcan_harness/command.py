"""Running a program to its end."""

import subprocess
from collections.abc import Mapping
from pathlib import Path


def run(
    *words: str, timeout_s: float = 20.0, folder: Path | None = None, environment: Mapping[str, str] | None = None
) -> str:
    """What the program prints. Errors: OSError with its own message when it fails, is not there or takes too long."""
    try:
        done = subprocess.run(
            words,
            check=False,
            capture_output=True,
            text=True,
            timeout=timeout_s,
            stdin=subprocess.DEVNULL,
            cwd=folder,
            env=environment,
        )
    except FileNotFoundError as error:
        raise OSError(f"{words[0]} is not installed") from error
    except subprocess.TimeoutExpired as error:
        raise OSError(f"{' '.join(words)}: not done within {timeout_s:g} s") from error
    if done.returncode:
        printed = done.stderr.strip() or done.stdout.strip() or f"exit code {done.returncode}"
        raise OSError(f"{' '.join(words)}:\n{printed}")
    return done.stdout
