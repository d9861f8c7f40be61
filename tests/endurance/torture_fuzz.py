"""Coverage-guided fuzzing of everything that reads what people hand in, with atheris (libFuzzer for Python).

    python tests/endurance/torture_fuzz.py [--runs 5000] [--seed 1] [--targets recipe,dbc,…] [--json]
    python tests/endurance/torture_fuzz.py --seconds 60 --corpus build/fuzz-corpus

--seconds: of all targets together, in place of --runs. --corpus: inputs that went new ways are kept there, a folder a
target, and the next time goes on from them. Each target of torture_input.py has a process of its own: `runs` inputs,
grown from a good one by what makes the station's modules (and, with them, PyYAML, cantools and canopen's EDS reader) go
new ways. Faulty is what torture_input calls so; libFuzzer itself ends a process over 1 GiB or an input over 5 s.
"""

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from importlib.util import find_spec
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))

MOST_MIB, MOST_S = 1024, 5
#: No longer than so many times the good input, or 4 kB.
_LONGER, _AT_LEAST = 2, 4096
_INSTRUMENTED = ("station", "yaml", "cantools.database.can", "canopen.objectdictionary", "can.io")


def child(name: str, runs: int, seconds: int, seed: int, folder: Path, corpus: Path) -> None:
    """Fuzzes one target in this process; libFuzzer ends it. runs, seconds: the first that is reached; 0 s: no limit."""
    import atheris

    with atheris.instrument_imports(include=list(_INSTRUMENTED)):
        from tests.endurance import torture_input

        target = torture_input.targets(folder)[name]
    corpus.mkdir(parents=True, exist_ok=True)
    (corpus / "good").write_bytes(target.good)

    def one(data: bytes) -> None:
        shown = torture_input.attempt(target, data, folder)
        if shown not in ("taken", "refused"):
            raise AssertionError(shown)

    longest = max(_LONGER * len(target.good), _AT_LEAST)
    limits = (
        f"-runs={runs}",
        f"-max_total_time={seconds}",
        f"-seed={seed}",
        f"-max_len={longest}",
        f"-rss_limit_mb={MOST_MIB}",
        f"-timeout={MOST_S}",
    )
    words = folder / "words"
    words.write_text("".join(f'"{_escaped(token)}"\n' for token in torture_input.TOKENS if len(token) < 64))
    atheris.Setup([sys.argv[0], *limits, f"-dict={words}", f"-artifact_prefix={folder}/", str(corpus)], one)
    atheris.Fuzz()


def _escaped(token: bytes) -> str:
    """A token as a libFuzzer dictionary wants it."""
    return "".join(f"\\x{byte:02x}" for byte in token)


def fuzz(name: str, runs: int, seed: int, seconds: int = 0, corpus: Path | None = None) -> dict[str, Any]:
    """One target in a process of its own: how many inputs it had, how much it covers, and what was wrong."""
    from tests.endurance.torture_input import SELDOM

    runs = max(runs // SELDOM.get(name, 1), 1)  # that reader has a process of its own, out of coverage's sight
    begun_s = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, __file__, "--child", name, "--runs", str(runs), "--seed", str(seed)]
        kept = corpus / name if corpus else Path(folder) / "corpus"
        command += ["--seconds", str(seconds), "--corpus", str(kept)]
        done = subprocess.run(
            [*command, "--folder", folder], capture_output=True, text=True, check=False, errors="replace"
        )
        broken = [p.read_bytes() for p in Path(folder).glob("*-*") if p.name.startswith(("crash", "timeout", "oom"))]
    numbers = [int(n) for n in re.findall(r"^#(\d+)\s", done.stderr, re.MULTILINE)]
    covered = [int(n) for n in re.findall(r"cov: (\d+)", done.stderr)]
    printed = re.findall(r"AssertionError: (.*)", done.stderr)[:1] or done.stderr.splitlines()[-3:]
    return {
        "target": name,
        "inputs": max(numbers, default=0),
        "first_covered": covered[0] if covered else 0,
        "covered": covered[-1] if covered else 0,
        "faulty": [] if done.returncode == 0 else [f"{name}: {printed} input {(broken or [b''])[0][:200]!r}"],
        "lasted_s": round(time.monotonic() - begun_s, 1),
    }


def main() -> int:
    """Prints the counts; 1 when an input was faulty."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=5000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=int, default=0)
    parser.add_argument("--corpus", type=Path)
    parser.add_argument("--targets", default="")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--child", default="", help=argparse.SUPPRESS)
    parser.add_argument("--folder", type=Path, default=Path(), help=argparse.SUPPRESS)
    given = parser.parse_args()
    if find_spec("atheris") is None:
        sys.exit("atheris is not installed here: python -m pip install --group fuzz")
    if given.child:
        child(given.child, given.runs, given.seconds, given.seed, given.folder, given.corpus)
    from tests.endurance import torture_input

    with tempfile.TemporaryDirectory() as folder:
        names = given.targets.split(",") if given.targets else list(torture_input.targets(Path(folder)))
    seconds = max(given.seconds // len(names), 1) if given.seconds else 0
    runs = 1 << 30 if seconds else given.runs
    found = [fuzz(name, runs, given.seed, seconds, given.corpus) for name in names]
    faulty = [line for each in found for line in each["faulty"]]
    inputs = sum(each["inputs"] for each in found)
    if given.json:
        print(json.dumps({"inputs": inputs, "faulty": len(faulty), "seed": given.seed, "said": faulty, "of": found}))
        return int(bool(faulty))
    what = "coverage-guided hostile inputs with a traceback, over 5 s or over 1 GiB"
    print(f"{what}: {len(faulty)} of {inputs}   goal: 0   seed {given.seed}")
    for each in found:
        print(f"  {each['target']}: {each['inputs']} inputs, {each['first_covered']} → {each['covered']} branches, "
              f"{each['lasted_s']:.0f} s")  # fmt: skip
    for line in faulty:
        print(f"  {line}")
    return int(bool(faulty))


if __name__ == "__main__":
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    sys.exit(main())
