"""Parameters of the web view."""

from __future__ import annotations

from dataclasses import dataclass

from mbf_relay.parameters import ParameterSet, parameter


@dataclass(frozen=True)
class WebViewParameters(ParameterSet):
    """Parameters of the `web_view` node."""

    address: str = parameter(
        "127.0.0.1", "address to listen on; one beyond this machine, such as 0.0.0.0, makes browsers need a token")
    port: int = parameter(8642, "TCP port; 0 for any free one", minimum=0, maximum=65535)
    host_names: str = parameter(
        "", "further names of this machine that browsers may use, such as a proxy's, separated by spaces")
    view_token: str = parameter(
        "", "token a browser needs to look; if empty, one is made at start unless the address is loopback")
    drive_token: str = parameter(
        "", "token a browser needs to drive too; if empty, one is made at start if looking needs one")
    max_clients: int = parameter(
        32, "largest number of browsers at a time; further ones are turned away with a message", minimum=1,
        maximum=1000)

    map_frame: str = parameter("map", "frame of the display and of the goals", is_frame=True)
    base_frame: str = parameter(
        "base_footprint", "frame of the robot, if no amcl of the same namespace gives it", is_frame=True)
    teleop_speed: float = parameter(0.2, "speed at the stick's end", unit="m/s", above=0.0)
    teleop_turn: float = parameter(1.0, "rotational speed at the stick's end", unit="rad/s", above=0.0)
    record_folder: str = parameter("", "folder for bags; empty for ROS's home (~/.ros)")
    record_minutes: float = parameter(
        60.0, "length at which a recording ends by itself", unit="min", above=0.0, maximum=1440.0)
