"""Real and simulated modules: what is said over the link, and the firmware's own core to say it to."""
