"""How hypothesis draws: the same examples every time, so that one commit is green or red; anew in the long tests."""

from hypothesis import settings
from tally import LONG

# Time limits of single examples would judge the machine, and a database would remember failures from run to run.
settings.register_profile("usual", derandomize=True, deadline=None, database=None)
settings.register_profile("long", derandomize=False, deadline=None, database=None, print_blob=True)
settings.load_profile("long" if LONG else "usual")
