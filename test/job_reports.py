"""What the reports say that a job of the tests leaves."""

import re
import xml.etree.ElementTree as ElementTree

SUMMARY = r"SUMMARY\s+\S* \* RESULT: .*?TESTS: (\d+)\s+\S* \* ERRORS: (\d+).*?FAILURES: (\d+)"
"""The end of rostest's output, coloured or not."""


def of_pytest(path: str) -> "tuple[int, int, int]":
    """Return how many tests passed, failed and were skipped by a pytest report; one failure where there is none."""
    try:
        root = ElementTree.parse(path).getroot()
    except (OSError, ElementTree.ParseError):
        return 0, 1, 0
    totals = [0, 0, 0, 0]
    for suite in root.iter("testsuite"):
        for index, name in enumerate(("tests", "failures", "errors", "skipped")):
            totals[index] += int(suite.get(name, 0))
    tests, failures, errors, skipped = totals
    return tests - failures - errors - skipped, failures + errors, skipped


def of_rostest(log: str) -> "tuple[int, int, int]":
    """Return how many tests passed, failed and were skipped by rostest's own summary; one failure without it."""
    with open(log, encoding="utf-8", errors="replace") as stream:
        text = stream.read()
    found = re.search(SUMMARY, text, re.DOTALL)
    if not found:
        return 0, 1, 0
    tests, errors, failures = (int(number) for number in found.groups())
    return max(0, tests - errors - failures), errors + failures, 0
