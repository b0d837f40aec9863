"""The demo, the clients, and what records and reports drives."""
