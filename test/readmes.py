"""What the repository's READMEs show, for tests that run it."""

import re
from pathlib import Path
from typing import Dict, List

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
