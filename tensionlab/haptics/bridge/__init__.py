"""Bridge for game engines: poses and effects come in over a WebSocket or OSC, the state of the rig goes out."""
