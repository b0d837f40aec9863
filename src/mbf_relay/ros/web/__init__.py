"""The node `web_view`: one page and one WebSocket, by which a browser sees a robot and drives it."""
