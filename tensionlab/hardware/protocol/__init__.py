"""Module protocol: frames, messages, codes and parameters. Pure: no link, no module."""
