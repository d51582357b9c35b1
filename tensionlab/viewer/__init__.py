"""Pages in the browser, served by viser: one to design a rig, and one of a run, in progress or from its log.

On the design page, `state` holds all that a person can change, `history` makes edits, `evaluation` and `workspace`
ask the public interface about the state, and `design_scene` and `design_panel` show the answers. The page of a run
is `run_page`, followed by `live` or played by `replay`. `server` alone knows viser's inside.
"""
