#!/usr/bin/env python3
from mbf_relay.commands import end_in_silence

end_in_silence()
from mbf_relay.ros.tools.parameter_tables import main  # noqa: E402

main()
