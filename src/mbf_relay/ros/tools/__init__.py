"""The demo, the clients, and commands on parameters, recorded drives and robots."""
