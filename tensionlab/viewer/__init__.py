"""Pages in the browser, served by viser: one to design a rig, and one of a run, in progress or from its log.

On the design page, `state` holds all that a person can change, `evaluation` and `volume` ask the public interface
about it, `scene` turns the answers into arrays, and `design_drawing` and `design_panel` show them. The page of a
run is `run_page`, followed by `live` or played by `replay`. `gate` alone knows viser's inside.
"""
