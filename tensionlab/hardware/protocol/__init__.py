"""The protocol of the modules: frames, messages, codes. Pure: no link, no module."""
