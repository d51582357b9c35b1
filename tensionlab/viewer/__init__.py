"""A rig in the browser: its design page, served by viser.

`state` is all that a person can change, `evaluation` and `volume` ask the public interface about it, `scene` turns
the answers into arrays that are drawn. Only `server`, `drawing`, `panel` and `page` know viser.
"""
