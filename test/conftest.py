"""How hypothesis draws: the same examples every time, so that one commit is green or red; anew in the long tests.

And how tests are called that are given long texts to read.
"""

from hypothesis import settings
from tally import LONG

# Time limits of single examples would judge the machine, and a database would remember failures from run to run.
settings.register_profile("usual", derandomize=True, deadline=None, database=None)
settings.register_profile("long", derandomize=False, deadline=None, database=None, print_blob=True)
settings.load_profile("long" if LONG else "usual")

LONGEST_ID = 60
"""Letters of a text by which a test is called: some are whole files."""


def pytest_make_parametrize_id(val):
    """Return the beginning of a text that is too long to call a test by; None leaves it to pytest."""
    if isinstance(val, (str, bytes)) and len(val) > LONGEST_ID:
        return ascii(val[:LONGEST_ID])[:LONGEST_ID] + "..."
    return None
