"""What the repository's READMEs show, for tests that run it."""

import re
import subprocess
from pathlib import Path
from typing import Dict, List, Optional

ROOT = Path(__file__).resolve().parents[1]


def texts() -> Dict[Path, str]:
    """Return every README and guide of the repository by its path."""
    paths = [ROOT / ".github" / "CONTRIBUTING.md", *ROOT.rglob("README.md")]
    return {path: path.read_text(encoding="utf-8") for path in sorted(paths)}


def blocks(language: str) -> List[str]:
    """Return the code blocks of a language in all of them."""
    found = []
    for text in texts().values():
        found += re.findall(rf"^```{language}\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    return found


def block_with(language: str, word: str) -> str:
    """Return the one code block of a language that has a word in it."""
    found = [block for block in blocks(language) if word in block]
    assert len(found) == 1, f"{len(found)} {language} blocks of the READMEs have '{word}' in them"
    return found[0]


def commands() -> List[str]:
    """Return the roslaunch and rosrun lines of the READMEs' shell blocks, each once."""
    lines = [line.split("#")[0].strip() for block in blocks("sh") for line in block.splitlines()]
    return list(dict.fromkeys(line for line in lines if line.startswith(("roslaunch ", "rosrun "))))


def command_with(*words: str) -> str:
    """Return the one command that has all of the words in it."""
    found = [line for line in commands() if all(word in line for word in words)]
    assert len(found) == 1, f"the READMEs have {len(found)} commands with {words}"
    return found[0]


def first_command(start: str) -> str:
    """Return the shortest command that starts so."""
    found = [line for line in commands() if line.startswith(start)]
    assert found, f"the READMEs have no command that starts with '{start}'"
    return min(found, key=len)


def run_to_end(command: str, folder: str, environment: Optional[Dict[str, str]] = None, timeout: float = 120.0) -> str:
    """Run a command in a folder until it has succeeded; return what it printed."""
    done = subprocess.run(
        ["bash", "-c", command], cwd=folder, timeout=timeout, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        env=environment,
    )
    output = done.stdout.decode(errors="replace")
    assert done.returncode == 0, f"'{command}' said:\n{output}"
    return output
