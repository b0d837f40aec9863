"""What can be set of the view in a browser."""

from __future__ import annotations

from dataclasses import dataclass

from mbf_relay.parameters import ParameterSet, parameter


@dataclass(frozen=True)
class WebViewParameters(ParameterSet):
    """Parameters of the `web_view` node."""

    address: str = parameter("127.0.0.1", "where to listen; beyond this machine (0.0.0.0, say) a token is asked for")
    port: int = parameter(8642, "TCP port; 0 for a free one", minimum=0, maximum=65535)
    host_names: str = parameter(
        "", "further names, blanks between them, under which browsers may ask for this machine, such as that of a proxy"
    )
    view_token: str = parameter(
        "", "word that lets a browser look; made at start where empty and the address is no loopback"
    )
    drive_token: str = parameter("", "word that lets it drive too; likewise")
    max_clients: int = parameter(32, "browsers at a time; one more is told so and turned away", minimum=1, maximum=1000)

    map_frame: str = parameter("map", "frame in which all is drawn and goals are given", is_frame=True)
    base_frame: str = parameter(
        "base_footprint", "frame of the robot, where no amcl of its namespace names one", is_frame=True
    )
    teleop_speed: float = parameter(0.2, "speed with the stick pushed to its end", unit="m/s", above=0.0)
    teleop_turn: float = parameter(1.0, "rate of turn with the stick pushed to its end", unit="rad/s", above=0.0)
    record_folder: str = parameter("", "where bags go; empty for the folder ROS keeps its files in (~/.ros)")
    record_minutes: float = parameter(
        60.0, "length after which a recording ends by itself", unit="min", above=0.0, maximum=1440.0
    )
